import hashlib
import subprocess
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from textbook import EA, EI, LENGTH, RHO_A

from pmr import InputError
from pmr.fem.compat import MPI
from pmr.fem.distributed import inner, times
from pmr.fullmodel.actions import Action
from pmr.fullmodel.build import full_model
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.structure import Clamp, Structure, structural_model
from pmr.models.beam2d import Beam2D
from pmr.reduction import snapshots
from pmr.reduction.free_body import FreeBody, rigid_modes
from pmr.reduction.snapshots import Snapshots, eigenmode_snapshots, free_modes, node_set, positions
from pmr.scene.structures import Profile
from pmr.system.rows import Rows

#: beta L of bending modes, from the characteristic equations (Blevins 1979, Table 8-1), and rigid-body modes before.
PINNED_FREE = (1, [3.92660231, 7.06858275, 10.21017612])

CLAMPED_FREE = (0, [1.87510407, 4.69409113, 7.85475744])

BENDING = {"pinned": PINNED_FREE, "clamped": CLAMPED_FREE}


@cache
def model(load_scene, *overrides: str) -> FullModel:
    return full_model(load_scene("paper_simple", ["compare.against=[]", "free_motions=allowed", *overrides]))


def local(snapshots: Snapshots) -> np.ndarray:
    return np.array(snapshots.S.getDenseArray())


@pytest.mark.parametrize("solver", ["dense", "slepc"])
@pytest.mark.parametrize("kind", BENDING)
def test_frequencies_are_those_of_the_beam_without_slider(load_scene, kind: str, solver: str) -> None:
    """Axial vibration, at 25 Hz among them, is reached by no load and by no slider."""
    full = model(load_scene, f"supports=[{{on=0.0,kind='{kind}'}}]")
    rigid, beta = BENDING[kind]
    found = free_modes(full, rigid + 3, solver)
    bending = np.array(beta) ** 2 / LENGTH**2 * np.sqrt(EI / RHO_A)
    assert found.omega == pytest.approx([0.0] * rigid + bending.tolist(), rel=2e-6)  # 1.2e-6 is the mesh's
    phi = local(found)
    assert np.abs(inner(phi, times(full.M, phi), full.comm) - np.eye(rigid + 3)).max() < 1e-12
    assert found.residuals.max() < 1e-13 and np.isnan(found.s).all()


def test_an_axial_load_brings_axial_modes_in(load_scene) -> None:
    full = model(load_scene, "loads=[{on=5.0,signal=-50},{name='N',on=5.0,direction='x',signal=3.0}]")
    axial = np.pi / 2.0 / LENGTH * np.sqrt(EA / RHO_A)
    assert free_modes(full, 6).omega[4] == pytest.approx(axial, rel=1e-3)


@pytest.mark.mpi
def test_dense_and_slepc_find_the_same_modes(load_scene) -> None:
    full = model(load_scene, "mesh.grading=3.0", "slider.offsets=[0.0,0.4]")
    dense, slepc = (local(free_modes(full, 8, solver)) for solver in ("dense", "slepc"))
    assert np.abs(dense - slepc).max() < 1e-8


@pytest.mark.parametrize(
    ("supports", "count"), [("pinned", 1), ("clamped", 0), ("roller", 2), (None, 3)], ids=lambda value: str(value)
)
def test_all_rigid_body_motions_are_found(load_scene, supports: str | None, count: int) -> None:
    full = model(load_scene, "mesh.elements=30", f"supports=[{{on=0.0,kind='{supports or 'roller'}'}}]")
    if supports is None:
        full = replace(full, rows=Rows(full.rows.rows[-1:], full.size))
    Z = rigid_modes(full)
    assert Z.shape[1] == count
    assert np.abs(inner(Z, times(full.M, Z), full.comm) - np.eye(count)).max(initial=0.0) < 1e-12
    # straight: x, w and theta are linear along the beam
    whole = np.concatenate(full.comm.allgather(Z)).reshape(31, 3, count)
    if count:
        assert np.abs(np.diff(whole[:, :2], 2, axis=0)).max() < 1e-14 * np.abs(whole).max()


def axial(full: FullModel) -> np.ndarray:
    """Which of this rank's coordinates are displacements along the axis."""
    return np.arange(*full.M.getOwnershipRange()) % 3 == 0


@pytest.mark.mpi
@pytest.mark.parametrize("solver", ["dense", "slepc"])
def test_rigid_bodies_that_nothing_reaches_are_left_out(load_scene, solver: str) -> None:
    """Three are free; nothing moves the beam along its axis, however the three are combined."""
    full = model(load_scene, "mesh.elements=30", "supports=[{on=0.0,kind='roller'}]")
    free = replace(full, rows=Rows(full.rows.rows[-1:], full.size))
    found, Z = free_modes(free, 6, solver), rigid_modes(free)
    assert Z.shape[1] == 3 and np.flatnonzero(found.omega == 0.0).tolist() == [0, 1]
    share = inner(times(free.M, Z), local(found)[:, :2], free.comm)
    assert np.abs(share.T @ share - np.eye(2)).max() < 1e-12
    assert np.abs(local(found)[:, :2]).max(initial=0.0, where=axial(free)[:, None]) < 1e-12


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize(
    "change", ["body.profile.bending_stiffness=1e-3", "body.profile.bending_stiffness=1e12", "mesh.elements=400"]
)
def test_rigid_and_soft_are_told_apart_at_any_scale(load_scene, change: str) -> None:
    full = model(load_scene, change, "body.profile.axial=false", "reduction.solver=dense")
    assert FreeBody(full).are_rigid(local(free_modes(full, 4))).tolist() == [True, False, False, False]
    clamped = model(load_scene, change, "body.profile.axial=false", "supports=[{on=0.0,kind='clamped'}]")
    assert not FreeBody(clamped).are_rigid(local(free_modes(clamped, 4))).any()


@pytest.mark.mpi
def test_a_count_out_of_range_is_refused(load_scene) -> None:
    full = model(load_scene, "mesh.elements=4", "supports=[{on=0.0,kind='roller'}]", "slider.path=2.0")
    # 5 nodes with w and theta, one held: 9 bending modes, and 5 axial ones that nothing reaches
    assert len(free_modes(full, 8).omega) == 8
    with pytest.raises(InputError, match="reduction.coordinates = 9: loads and sliders excite 9 modes"):
        free_modes(full, 9)
    bodies = replace(full, rows=Rows(full.rows.rows[-1:], full.size))
    with pytest.raises(InputError, match="supports leave 2 rigid-body modes free"):
        free_modes(bodies, 1)


@pytest.mark.parametrize("solver", ["dense", "slepc"])
def test_too_few_for_the_rigid_bodies_are_refused_at_once(load_scene, monkeypatch, solver: str) -> None:
    """All modes were computed first, in twice as many at a time; the solver for sparse matrices did not converge."""
    tip, tail = ("on='tip',signal={kind='constant',amount=1.0}", "on='tail',signal={kind='constant',amount=1.0}")
    loads = [f"{{name='{k}',direction='{d}',{of}}}" for k, (d, of) in enumerate([("z", tip), ("z", tail), ("x", tip)])]
    full = model(load_scene, "mesh.elements=40", "supports=[]", "slider.path=2.0", f"loads=[{','.join(loads)}]")
    computed, elastic_modes = list[int](), snapshots._elastic_modes
    monkeypatch.setattr(snapshots, "_elastic_modes", lambda *some: computed.append(some[2]) or elastic_modes(*some))
    with pytest.raises(InputError, match="supports leave 3 rigid-body modes free"):
        free_modes(full, 1, solver)
    assert len(computed) == 1


@pytest.mark.mpi
@pytest.mark.parametrize(("offsets", "left"), [("[0.0]", 1), ("[0.0,0.4,0.8]", 3)])
def test_modes_for_an_error_estimate_leave_as_many_as_there_are_rigid_sliders(
    load_scene, offsets: str, left: int
) -> None:
    few = ("mesh.elements=4", "supports=[{on=0.0,kind='roller'}]", "slider.path=2.0", f"slider.offsets={offsets}")
    full = model(load_scene, *few)
    assert len(free_modes(full, 4, "auto", 20).omega) == 9 - left
    assert len(free_modes(full, 8, "auto", 20).omega) == 8  # what is asked for is not taken away


@pytest.mark.mpi
@pytest.mark.parametrize("solver", ["dense", "slepc"])
def test_modes_beyond_the_coordinates_bend_where_axial_forces_act(solver: str) -> None:
    """Along a clamped beam the first vibration stands between the second and the third bending one: it is left out."""
    stiff = Profile(length=LENGTH, bending_stiffness=EI, mass_per_length=RHO_A, axial=True, axial_stiffness=30.0 * EI)
    beam, clamped = Beam2D(stiff, np.linspace(0.0, LENGTH, 13)), (Clamp("tail", ("x", "z", "ry")),)
    loads = tuple(Action(direction, "tip", direction) for direction in "xz")
    full = structural_model(Structure(beam, clamped, loads=loads, matrices=("axial uniform", "axial tip")))
    found, stressed = (free_modes(full, 1, solver, 2, stressed=one).omega for one in (False, True))
    bending = np.array(CLAMPED_FREE[1]) ** 2 / LENGTH**2 * np.sqrt(EI / RHO_A)
    along = np.pi / 2.0 / LENGTH * np.sqrt(30.0 * EI / RHO_A)
    np.testing.assert_allclose(stressed, bending, rtol=1e-3)
    np.testing.assert_allclose(found, sorted([*bending[:2], along]), rtol=2e-3)


@pytest.mark.mpi
def test_every_rank_has_its_rows(load_scene) -> None:
    full = model(load_scene, "mesh.elements=20")
    assert len(local(free_modes(full, 3))) == full.M.getLocalSize()[0]
    assert MPI.COMM_WORLD.allreduce(full.M.getLocalSize()[0]) == full.size


@pytest.mark.parametrize(
    ("nodes", "snapshots", "expected"),
    [
        (51, 1, [25]), (51, 2, [2, 51]), (51, 5, [2, 14, 26, 38, 51]), (51, 10, [2, 7, 12, 18, 23, 29, 34, 40, 45, 51]),
        (10, 4, [2, 4, 7, 10]),
    ],
)  # fmt: skip
def test_the_papers_node_set(nodes: int, snapshots: int, expected: list[int]) -> None:
    assert node_set(nodes, snapshots).tolist() == expected


def at(load_scene, *overrides: str) -> np.ndarray:
    scene = load_scene("paper_simple", ["compare.against=['full']", *overrides])
    return positions(scene, full_model(scene))


def test_positions_on_nodes_over_the_path_or_as_listed(load_scene) -> None:
    assert at(load_scene) == pytest.approx([0.1, 1.3, 2.5, 3.7, 5.0])
    assert at(load_scene, "reduction.positions=path") == pytest.approx([1.25, 1.875, 2.5, 3.125, 3.75])
    listed = [1.0, 2.0, 2.22, 3.0, 4.0]
    assert at(load_scene, f"reduction.positions={listed}") == pytest.approx(listed)


@pytest.mark.parametrize(
    ("offsets", "first", "last"), [([0.0, 0.4], 0.1, 4.6), ([0.4, 0.0], 0.1, 4.6), ([0.0, -0.33], 0.5, 5.0)]
)
def test_with_several_sliders_all_of_them_stay_on_the_beam(load_scene, offsets, first: float, last: float) -> None:
    found = at(load_scene, f"slider.offsets={offsets}")
    assert (found[0], found[-1]) == pytest.approx((first, last))
    on_nodes = (found + offsets[0]) / 0.1
    assert on_nodes == pytest.approx(np.round(on_nodes))


def test_more_snapshots_than_nodes_are_refused(load_scene) -> None:
    with pytest.raises(InputError, match="at most 50"):
        at(load_scene, "reduction.snapshots=51")


@pytest.mark.mpi
def test_the_pool_holds_modes_at_each_position(load_scene) -> None:
    scene = load_scene()
    pool = eigenmode_snapshots(full_model(scene), scene)
    assert pool.S.getSize() == (153, 30) and pool.omega.shape == pool.residuals.shape == pool.s.shape == (30,)
    assert pool.s.reshape(5, 6)[:, 0] == pytest.approx([0.1, 1.3, 2.5, 3.7, 5.0])
    assert np.all(np.diff(pool.omega.reshape(5, 6)) > 0.0) and pool.residuals.max() < 1e-13


@pytest.mark.mpi
def test_a_position_on_the_support_is_refused(load_scene) -> None:
    scene = load_scene("paper_simple", ["reduction.positions=[0.0,2.0,2.22,3.0,4.0]"])
    with pytest.raises(InputError, match="slider"):
        eigenmode_snapshots(full_model(scene), scene)


DIGEST = """
import hashlib, sys
import numpy as np
from pmr import scene
from pmr.reduction.basis import pod
from pmr.fullmodel.build import full_model
from pmr.reduction.snapshots import eigenmode_snapshots
s = scene.load(sys.argv[1], ["reduction.solver=dense"])
model = full_model(s)
pool = eigenmode_snapshots(model, s)
basis = pod(model, pool, 20, solver="dense")
print(hashlib.sha256(pool.S.getDenseArray().tobytes() + basis.V.getDenseArray().tobytes()).hexdigest())
"""


@pytest.mark.slow
def test_two_runs_of_the_dense_path_agree_to_the_byte() -> None:
    scene = "workflows/paper_evolved.toml"
    digests = {
        subprocess.run([sys.executable, "-c", DIGEST, scene], capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    }
    assert len(digests) == 1 and len(digests.pop().strip()) == hashlib.sha256().digest_size * 2
    assert MPI.COMM_WORLD.size == 1
