import booms
import numpy as np
import one_body
import petsc_alone
import pytest
from boxes import box

from pmr.fem.compat import MPI
from pmr.fem.distributed import share
from pmr.fullmodel.build import AssembledBody
from pmr.fullmodel.structure import Clamp, Structure, couple, structural_model
from pmr.models.beam2d import Beam2D
from pmr.models.beam3d import Beam3D
from pmr.models.shell import Shell
from pmr.reduction.basis import modal_basis
from pmr.reduction.free_body import FreeBody
from pmr.reduction.recovery import BodyFields, Recovery, in_blocks, record_fields
from pmr.reduction.residual import flexible_model
from pmr.reduction.snapshots import free_modes
from pmr.scene.structures import Beam3DBody, BoxProfile, Plate, PointMass, Profile, ShellBody

pytestmark = pytest.mark.mpi
TIMES = np.linspace(0.0, 1.0, 131)  # three blocks


def shell() -> Shell:
    return Shell(ShellBody(plate=Plate(thickness=0.008)), box(along=4))


def clamped() -> Structure:
    payload = PointMass(name="payload", on="tip", mass=10.0, coupling="rigid")
    return Structure(shell(), (Clamp("tail"),), (payload,))


def alone(structure: Structure) -> AssembledBody:
    return AssembledBody(structural_model(structure), structure)


def states(size: int) -> np.ndarray:
    """The same whole states (S, n) on every rank."""
    return np.random.default_rng(5).normal(size=(len(TIMES), size)) * np.sin(3.0 * TIMES)[:, None]


def mine(z: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(z[:, slice(*share(z.shape[1], MPI.COMM_WORLD))])


def test_a_view_takes_the_coordinates_that_clamps_and_masses_leave() -> None:
    structure = clamped()
    T, model, view = couple(structure).T, structure.model, BodyFields(alone(structure))
    z = states(T.shape[1])
    q = (T @ z.T).T
    expected = (model.point_displacements() @ q.T).T.reshape(len(q), -1, 3)
    assert view.displacements(mine(z)) == pytest.approx(expected, abs=1e-12)
    held = np.flatnonzero(model.mesh.points[:, 0] == 0.0)
    assert len(held) and not expected[:, held].any()
    rows = model.stresses()
    sizes = rows.von_mises(rows.evaluate(q))
    found = view.stresses(mine(z)).values
    assert rows.von_mises(found) == pytest.approx(sizes, rel=1e-9, abs=1e-9 * sizes.max())


def test_one_look_finds_the_largest_stress_and_keeps_pictures() -> None:
    view, q = BodyFields(alone(Structure(shell()))), states(shell().size)
    seen = record_fields(view, TIMES, in_blocks(mine(q)), pictures=[130, 0, 67])
    rows = shell().stresses()
    sizes = rows.von_mises(rows.evaluate(q))
    assert seen.stress is not None
    assert seen.stress.largest == pytest.approx(sizes.max(axis=1), rel=1e-9)
    k, p = np.unravel_index(sizes.argmax(), sizes.shape)
    peak = seen.stress.peak
    assert peak.value == pytest.approx(sizes.max(), rel=1e-9) and peak.t == TIMES[k]
    assert peak.position == pytest.approx(rows.points[p]) and peak.face == rows.faces[rows.face[p]]
    assert peak.region in ("bottom", "left", "right", "top")
    fields = seen.fields
    assert fields.t.tolist() == TIMES[[0, 67, 130]].tolist()
    for k, state in enumerate((0, 67, 130)):
        points = (shell().point_displacements() @ q[state]).reshape(-1, 3)
        assert fields.displacement[k] == pytest.approx(points, rel=1e-6, abs=1e-6)
    for face in ("outer", "middle", "inner"):
        assert fields.von_mises[face][1] == pytest.approx(sizes[67, rows.points_on(face)], rel=1e-5)


def test_a_beam_shows_its_corners() -> None:
    profile = BoxProfile(width=0.3, height=0.4, wall=0.008)
    beam = Beam3D(Beam3DBody(length=2, profile=profile, elements=5))
    seen = record_fields(BodyFields(alone(Structure(beam))), TIMES, in_blocks(mine(states(beam.size))), pictures=[3])
    assert sorted(seen.fields.von_mises) == ["bottom left", "bottom right", "top left", "top right"]
    assert seen.fields.von_mises["top left"].shape == (1, 5) and seen.fields.grid.cell == "line"


def test_a_planar_beam_has_pictures_but_no_stresses() -> None:
    beam = Beam2D(Profile(length=2.0, bending_stiffness=1.0, mass_per_length=1.0), np.linspace(0.0, 2.0, 4))
    view, q = BodyFields(alone(Structure(beam))), states(beam.size)
    seen = record_fields(view, TIMES, in_blocks(mine(q)), pictures=[7])
    assert seen.stress is None and not seen.fields.von_mises
    expected = np.zeros((4, 3))
    expected[:, 2] = q[7, ::2]
    assert seen.fields.displacement[0] == pytest.approx(expected, rel=1e-6)
    assert view.stresses(mine(q)).values is None


@pytest.mark.slow
@pytest.mark.numerical
def test_ten_coordinates_know_the_largest_stress() -> None:
    """Its value at every time, and where and when the largest of all is; the full model's own states beside it."""
    model = Shell(ShellBody(plate=Plate(thickness=0.008)), box(length=6.0, along=16, around=2, skew=0.2))
    boom, steps = booms.boom(model, span=2.0, overrides=["time.step=5e-3"]), np.arange(0, 401, 4)
    full, t = structural_model(boom.structure), boom.excitation.times[steps]
    basis = modal_basis(free_modes(full, 10))
    body = flexible_model(FreeBody(full), basis, {})
    exact = petsc_alone.observe(full, boom.excitation, t.tolist())
    whole = one_body.simulate(body, boom.excitation)
    view, recovery = (
        BodyFields(AssembledBody(full, boom.structure)),
        Recovery(full, np.array(basis.V.getDenseArray()), body),
    )
    states = one_body.states(body, whole.at(steps), boom.excitation.f[steps])
    found = record_fields(view, t, recovery.blocks(states)).stress
    expected = record_fields(view, t, in_blocks(exact.states.q)).stress
    assert found is not None and expected is not None
    assert found.peak.value == pytest.approx(expected.peak.value, rel=3e-4)
    assert (found.peak.cell, found.peak.face, found.peak.t) == (expected.peak.cell, expected.peak.face, expected.peak.t)
    assert np.abs(found.largest - expected.largest).max() < 3e-4 * expected.peak.value
