"""Section forces of beams beside statics: loads, pads, supports and inertia act where they are, not at nodes."""

from dataclasses import replace

import numpy as np
import pytest

from pmr.fem.compat import MPI
from pmr.fem.distributed import local_csr
from pmr.fullmodel.actions import Action, Weight
from pmr.fullmodel.build import AssembledBody
from pmr.fullmodel.pads import Pad, Pads, Slider, Support
from pmr.fullmodel.structure import Clamp, Structure, structural_model
from pmr.models.beam2d import Beam2D
from pmr.models.beam3d import Beam3D, box_beam
from pmr.reduction.section_forces import SectionForces
from pmr.scene.box import Box
from pmr.scene.structures import Beam3DBody, BoxProfile, PointMass
from pmr.system.states import BodyStates

LENGTH, TIP, POINT = 3.0, 700.0, 1.33
BOX = BoxProfile(width=0.2, height=0.3, wall=0.01)
UNEVEN = BoxProfile(
    width=0.2, height=0.3, chamfer=0.05, wall={"bottom": 0.012, "sides": 0.006, "top": 0.008, "left": 0.01}
)


def planar() -> Beam2D:
    return Beam2D(Beam3DBody(length=LENGTH, profile=BOX), np.array([0.0, 1.0, 1.7, LENGTH]))


def spatial(profile: BoxProfile = BOX) -> Beam3D:
    return Beam3D(Beam3DBody(length=LENGTH, profile=profile, shear=True, elements=3))


MODELS = {"beam2d": planar, "beam3d": spatial}


def found(
    structure: Structure, loads: tuple[float, ...], held: dict[str, float] | None = None, at: float = 0.0
) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], SectionForces]:
    """Section forces at rest by name, (places, values), where pads push with the forces `held` at s = `at`."""
    full, cut = structural_model(structure, MPI.COMM_SELF), structure.model.cut(4)
    g, held = local_csr(full.B) @ np.array(loads), held or {}
    rows = {row.name: row for row in full.rows.rows}
    for name, force in held.items():
        g -= force * rows[name].at(at).toarray()[0]
    fixed = [row.at(0.5).toarray()[0] for row in full.rows.rows if row.is_fixed]
    K, C = local_csr(full.K).toarray(), np.array(fixed).reshape(len(fixed), full.size)
    whole = np.block([[K, C.T], [C, np.zeros((len(C), len(C)))]])
    q = np.linalg.solve(whole, np.concatenate([g, np.zeros(len(C))]))[: full.size]
    return of_states(AssembledBody(full, structure), cut, q, loads, held, at)


def of_states(built, cut, q, loads, held, at):
    one = np.array([0.0])
    acting = BodyStates(
        one,
        np.full((1, len(held)), at),
        q[None],
        q[None],
        np.array([list(held.values())]),
        np.array([loads]),
        tuple(held),
    )
    forces = SectionForces(built, cut)
    values, names = forces.evaluate(q[None], acting)[0], np.array(forces.names)
    return {name: (forces.x[names == name], values[names == name]) for name in dict.fromkeys(forces.names)}, forces


def near(values: np.ndarray, exact: np.ndarray) -> bool:
    return bool(np.abs(values - exact).max() <= 1e-9 * np.abs(exact).max())


@pytest.mark.parametrize("model", MODELS)
def test_a_cantilever_bears_its_weight_and_a_load_between_nodes(model: str) -> None:
    """M_y = q (L - x)^2 / 2 + P (p - x): at every place, to round-off; nothing is left at the tip."""
    beam = MODELS[model]()
    loads = (Weight((1.0, 0.0, -1.0)), Action("point", POINT, "z"))
    forces, of = found(Structure(beam, clamps=(Clamp("tail"),), loads=loads), (9.81, -TIP))
    x, moment = forces["bending moment y"]
    q = beam.masses[0] * 9.81 / np.sqrt(2.0)
    known = q * (LENGTH - x) ** 2 / 2.0 + TIP * np.clip(POINT - x, 0.0, None)
    assert len(x) == 24 and near(moment, known)
    x, shear = forces["shear force z"]
    assert near(shear, -q * (LENGTH - x) - TIP * (x < POINT))
    x, normal = forces["normal force"]
    assert near(normal, q * (LENGTH - x))
    assert of.stresses is not None
    section = spatial().section
    stress = of.stresses.rows @ np.concatenate([values for _, values in forces.values()])
    top = of.stresses.points[:, 2] > 0.0
    axial = stress[:: len(of.stresses.components)][top][: len(x)]
    assert near(axial, q * (LENGTH - x) / section.area + known * 0.155 / section.second_moment_y)


def test_forces_are_those_about_centroid_and_shear_centre() -> None:
    """Weight acts at the centroid, which twists a section about its shear centre; the axis is beside both."""
    beam = spatial(UNEVEN)
    forces, _ = found(Structure(beam, clamps=(Clamp("tail"),), loads=(Weight((0.0, 1.0, -2.0)),)), (9.81,))
    (y_c, z_c), (y_s, z_s) = beam.section.centroid, beam.section.shear_centre
    x = forces["torque"][0]
    q = beam.masses[0] * 9.81 * np.array([1.0, -2.0]) / np.sqrt(5.0)
    assert near(forces["torque"][1], ((y_c - y_s) * q[1] - (z_c - z_s) * q[0]) * (LENGTH - x))
    assert near(forces["bending moment y"][1], -q[1] * (LENGTH - x) ** 2 / 2.0)
    assert near(forces["bending moment z"][1], q[0] * (LENGTH - x) ** 2 / 2.0)
    assert near(forces["shear force y"][1], q[0] * (LENGTH - x))


def test_weight_of_a_beam_with_a_doubler_is_borne_where_it_is() -> None:
    """A plate on the bottom changes centroid, stiffness and mass at a node; moments and shear go on without a step."""
    plate = {"start": 0.0, "end": 1.1, "thickness": 0.01, "faces": ["bottom"]}
    box = Box(length=LENGTH, width=0.2, height=0.3, wall=0.01, doublers=[plate])
    beam = box_beam(Beam3DBody(length=LENGTH, profile=box, shear=True, elements=3), box)
    forces, of = found(Structure(beam, clamps=(Clamp("tail"),), loads=(Weight(),)), (9.81,))
    (thick, thin), (x, shear) = beam.sections.area * 7850.0 * 9.81, forces["shear force z"]
    more = np.clip(1.1 - x, 0.0, None)
    assert near(shear, -thin * (LENGTH - x) - (thick - thin) * more)
    moment = thin * (LENGTH - x) ** 2 / 2.0 + (thick - thin) * more**2 / 2.0
    assert near(forces["bending moment y"][1], moment)
    stress = (of.stresses.rows @ np.concatenate([values for _, values in forces.values()]))[::2]
    top, last = of.stresses.face == of.stresses.faces.index("top left"), x > 1.2
    assert near(stress[top][last], moment[last] * 0.155 / beam.sections.each[1].second_moment_y)


@pytest.mark.parametrize("model", MODELS)
def test_a_pad_between_nodes_bends_the_beam_as_a_force_there(model: str) -> None:
    """It pushes inwards, from the bottom up: M_y = -P (s - x) up to its edge, nothing beyond."""
    pads = Pads(moving=(Pad("pad", "bottom", length=0.2, stiffness=np.inf),), travel=(0.5, 2.5))
    forces, _ = found(Structure(MODELS[model](), clamps=(Clamp("tail"),), pads=pads), (), {"pad": TIP}, at=1.41)
    x, moment = forces["bending moment y"]
    known = -TIP * np.clip(1.41 - x, 0.0, None)
    outside = np.abs(x - 1.41) > 0.1
    assert outside.sum() > 18 and np.abs((moment - known)[outside]).max() < 1e-9 * TIP
    x, shear = forces["shear force z"]
    assert np.abs(shear - TIP * (x < 1.41))[outside].max() < 1e-9 * TIP


def test_a_point_that_slides_pushes_where_it_is() -> None:
    pads = Pads(sliders=(Slider(),), travel=(0.5, 2.5))
    forces, _ = found(Structure(planar(), clamps=(Clamp("tail"),), pads=pads), (), {"slider": TIP}, at=2.1)
    x, moment = forces["bending moment y"]
    assert near(moment, TIP * np.clip(2.1 - x, 0.0, None))


@pytest.mark.parametrize("stiffness", [np.inf, 3e6])
@pytest.mark.parametrize("model", MODELS)
def test_a_support_between_nodes_bears_the_load_there(model: str, stiffness: float) -> None:
    """Whatever it bears, moments are linear on both sides of it, and bend there."""
    pads = Pads(supports=(Support("prop", 1.2, "z", stiffness),), travel=(0.0, 1.0))
    load = Action("tip", "tip", "z")
    forces, _ = found(Structure(MODELS[model](), clamps=(Clamp("tail"),), loads=(load,), pads=pads), (-TIP,))
    x, moment = forces["bending moment y"]
    carried = (TIP * LENGTH - moment[0]) / 1.2
    assert 0.1 * TIP < carried < 4.0 * TIP
    assert near(moment, TIP * (LENGTH - x) - carried * np.clip(1.2 - x, 0.0, None))


@pytest.mark.parametrize("model", MODELS)
def test_what_the_inertia_of_a_free_beam_takes_is_in_its_forces(model: str) -> None:
    """A force at the tip of a free rod accelerates it by P (6 x / L - 2) / m, so that M = P x^2 (L - x) / L^2."""
    beam = MODELS[model]()
    structure = Structure(beam, loads=(Action("tip", "tip", "z"),))
    full, d = structural_model(structure, MPI.COMM_SELF), beam.directions
    M, K, R = local_csr(full.M), local_csr(full.K).toarray(), beam.rigid_motions()
    g = local_csr(full.B).toarray()[:, 0] * -TIP
    a = R @ np.linalg.solve(R.T @ M @ R, R.T @ g)
    q = np.linalg.lstsq(K, g - M @ a, rcond=1e-12)[0]
    x, moment = of_states(AssembledBody(full, structure), beam.cut(4), q, (-TIP,), {}, 0.0)[0]["bending moment y"]
    inertia = 0.0 if d == ("x", "z", "ry") else beam.body.material.density * beam.sections.second_moments[0, 1]
    known = free_rod(x, beam.masses[0], inertia)
    assert near(moment, known) and np.abs(moment[[0, -1]]).max() < 1e-9 * moment.max()


def free_rod(x: np.ndarray, mass: float, inertia: float) -> np.ndarray:
    """M_y at x of a free rod pulled down at its tip, from the inertia left of it, that of turning sections too."""
    turn = TIP * LENGTH / 2.0 / (mass * LENGTH**3 / 12.0 + inertia * LENGTH)
    start = TIP / (mass * LENGTH) - turn * LENGTH / 2.0
    return -mass * (start * x**2 / 2.0 + turn * x**3 / 6.0) + inertia * turn * x


def test_a_mass_on_a_node_hangs_from_the_beam() -> None:
    payload = PointMass(name="payload", on="tip", mass=100.0)
    structure = Structure(spatial(), clamps=(Clamp("tail"),), masses=(payload,), loads=(Weight(),))
    for one in (structure, replace(structure, masses=(payload.model_copy(update={"coupling": "rigid"}),))):
        forces, _ = found(one, (9.81,))
        x, shear = forces["shear force z"]
        assert near(shear, -9.81 * (100.0 + spatial().masses[0] * (LENGTH - x)))


def test_a_pad_that_rubs_turns_the_beam_and_pulls_it_from_where_it_is() -> None:
    """A moment m of friction f: M_y = -m and N = -f up to the pad; both ends of a piece know where that is."""
    pads = Pads(sliders=(Slider(),), travel=(0.5, 2.5))
    structure = Structure(planar(), clamps=(Clamp("tail"),), pads=pads)
    full, cut = structural_model(structure, MPI.COMM_SELF), structure.model.cut(4)
    (row,) = [row for row in full.rows.rows if not row.is_fixed]
    q = np.linalg.solve(local_csr(full.K).toarray(), TIP * row.at(2.1, 1).toarray()[0])
    one, nothing = np.array([[2.1]]), np.zeros((1, 0))
    acting = BodyStates(
        one[0],
        one,
        q[None],
        q[None],
        0.0 * one,
        nothing,
        ("slider",),
        friction_moments=TIP + 0.0 * one,
        friction_forces=50.0 + 0.0 * one,
    )
    forces = SectionForces(AssembledBody(full, structure), cut)
    values, names = forces.evaluate(q[None], acting)[0], np.array(forces.names)
    for name, size in (("bending moment y", TIP), ("normal force", 50.0)):
        x, known = forces.x[names == name], values[names == name]
        assert np.abs(known + size * (x < 2.1)).max() < 1e-9 * size and 0 < (x < 2.1).sum() < len(x)
