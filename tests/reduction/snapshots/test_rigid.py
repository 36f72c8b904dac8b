"""Rigid-body modes against the closed form: how many the supports leave, and that they are rigid to the last digit."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from pmr import ConvergenceError, run
from pmr import scene as scenes
from pmr.fem.distributed import inner, times
from pmr.fullmodel.build import build
from pmr.fullmodel.eigensolvers import eigensolver
from pmr.fullmodel.from_scene import structure_of
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.structure import Clamp, Structure, structural_model
from pmr.reduction.free_body import FreeBody, rigid_modes
from pmr.reduction.snapshots import _remove_rigid_modes, free_modes
from pmr.scene import Damping
from pmr.scene.members import member_at
from pmr.scene.structures import PointMass

BOOM = "boom_beam"
CLAMPED = "supports=[{on='tail',kind='clamped',points='all'}]"
#: Of 41 lengths from 5 to 9 m those at which the round-off of an eigenvalue, measured by a constant, misled.
LENGTHS = [pytest.param(5.5, marks=pytest.mark.mpi), 5.7, 5.8, 6.0, 6.1, 6.4, 7.1, 7.7, 8.2, 8.4, 8.6]


def boom(*overrides: str) -> Structure:
    return structure_of(member_at(scenes.load(BOOM, ["mesh.elements=12", "compare.against=[]", *overrides])))


def attached(structure: Structure, *clamps: Clamp, masses: tuple[PointMass, ...] = ()) -> FullModel:
    return structural_model(replace(structure, clamps=clamps, masses=masses))


def count(model: FullModel) -> int:
    return rigid_modes(model).shape[1]


def whole(model: FullModel, local: np.ndarray) -> np.ndarray:
    return np.concatenate(model.comm.allgather(local))


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("length", LENGTHS)
def test_pitch_and_yaw_are_left_at_any_length(length: float) -> None:
    """A ring at the tail and a cylinder: two rigid-body modes, turning about the ring."""
    model = build(scenes.load(BOOM, [f"body.box.length={length}", "observe.end=4.8", "recovery.stress=false"])).model
    modes = free_modes(model, 4)
    Z = np.array(modes.S.getDenseArray())
    assert modes.omega[:2].tolist() == [0.0, 0.0] and np.all(modes.omega[2:] > 100.0)
    assert FreeBody(model).are_rigid(Z).tolist() == [True, True, False, False]
    motion = whole(model, Z).reshape(-1, 6, 4)[:, :, :2]
    turns = motion[:, 3:]
    assert np.abs(turns - turns[:1]).max() < 1e-13 * np.abs(turns).max()
    at = np.linspace(0.0, length, 61) - 0.15
    expected = np.cross(turns.transpose(0, 2, 1), np.stack([at, 0 * at, 0 * at], axis=1)[:, None]).transpose(0, 2, 1)
    assert np.abs(motion[:, :3] - expected).max() < 1e-12 * np.abs(motion).max()


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize(
    ("pads", "left"),
    [
        ("faces={bottom=[0.0]}", 4),  # the cylinder holds x: y, roll, pitch and yaw are left
        ("faces={bottom=[-0.1,0.1]}", 3),
        ("faces={bottom=[-0.1,0.1],left=[0.0]}", 2),
        ("faces={bottom=[-0.1,0.1],left=[0.0],right=[0.0]}", 2),  # both say the same
        ("faces={bottom=[0.0],left=[-0.1,0.1]}", 2),
        ("faces={left=[-0.1,0.1]}", 3),
        ("faces={bottom=[-0.1,0.1],left=[0.0]},unilateral=true", 5),  # they may let go
    ],
)
@pytest.mark.parametrize("stiffness", ["'rigid'", pytest.param("3e8", marks=pytest.mark.mpi), "1e3"])
def test_what_pads_at_one_place_leave(pads: str, left: int, stiffness: str) -> None:
    mouth = "{name='mouth',moving=true,faces={bottom=[0.0]}}"
    structure = boom(f"pads=[{{name='tail',at=0.15,{pads},stiffness={stiffness}}},{mouth}]")
    assert count(attached(structure)) == left


@pytest.mark.mpi
def test_two_rings_and_a_cylinder_leave_nothing() -> None:
    rings = "{{name='{}',at={},faces={{bottom=[-0.1,0.1],left=[0.0]}}}}"
    mouth = "{name='mouth',moving=true,faces={bottom=[0.0]}}"
    model = attached(boom(f"pads=[{rings.format('a', 0.15)},{rings.format('b', 0.16)},{mouth}]"))
    assert count(model) == 0 and np.all(free_modes(model, 3).omega > 0.0)


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.parametrize(
    ("directions", "left"),
    [("xyz", 3), (("x", "y", "z", "rx", "ry", "rz"), 0), (("z", "ry"), 4), (("rx", "ry", "rz"), 3), ("y", 5)],
)
def test_what_a_clamp_at_an_end_leaves(directions: tuple[str, ...], left: int) -> None:
    bare = replace(boom(), pads=replace(boom().pads, fixed=(), supports=()), outputs=())
    payload = PointMass(name="payload", on="tip", mass=250.0, inertia=(3.0, 4.0, 5.0), coupling="rigid", at=(6, 0, 1))
    for masses in ((), (payload,)):
        model = attached(bare, Clamp("tail", tuple(directions)), masses=masses)
        Z = rigid_modes(model)
        assert Z.shape[1] == left
        assert inner(Z, times(model.M, Z), model.comm) == pytest.approx(np.eye(left), abs=1e-12)
        KZ = whole(model, times(model.K, Z))
        assert np.abs(KZ).max(initial=0.0) <= 1e-9 * model.K.norm() * np.abs(whole(model, Z)).max(initial=0.0)


@pytest.mark.parametrize(
    ("directions", "left"), [("['x','y','z','rx','ry','rz']", 0), ("['x','z']", 1), ("['ry']", 2), ("['y','rx']", 3)]
)
def test_a_planar_beam_is_clamped_in_its_plane(directions: str, left: int) -> None:
    """It knows x, z and the rotation about y, and nothing moves it sideways anyway."""
    pads = "pads=[{name='mouth',moving=true,faces={bottom=[0.0]}}]"
    clamps = f"supports=[{{on='tail',directions={directions},points='all'}}]"
    down = "loads=[{name='down',on='tip',direction='z',signal=1.0}]"
    planar = boom("body.model=beam2d", pads, clamps, down)
    assert count(structural_model(planar)) == left


@pytest.mark.parametrize("model", ["beam2d", "beam3d"])
def test_a_moment_about_y_lowers_the_tip_on_any_model(model: str) -> None:
    pads = "pads=[{name='mouth',moving=true,faces={bottom=[0.0]}}]"
    moment = "loads=[{name='moment',on='tip',direction='ry',signal=1.0}]"
    structure = boom(f"body.model={model}", "body.shear=false", pads, CLAMPED, moment)
    full = structural_model(replace(structure, damping=Damping())).gather()
    if full is None:
        return
    tip = full.outputs @ spsolve(full.K.tocsc(), full.B[:, 0])
    scene = scenes.load(BOOM)
    box = scene.body.box
    stiffness = scene.body.material.young * second_moment(box.width, box.height, box.wall)
    z = [name.startswith("tip z") for name in (action.name for action in structure.outputs)]
    assert tip[z] == pytest.approx([-(box.length**2) / (2.0 * stiffness)], rel=1e-9)


def second_moment(width: float, height: float, wall: float) -> float:
    """About y, of a tube given by its mid-surface."""
    whole = (width + wall) * (height + wall) ** 3
    return (whole - (width - wall) * (height - wall) ** 3) / 12.0


@pytest.mark.mpi
def test_modes_without_the_rigid_ones_are_refused() -> None:
    """Round-off so large that the lowest modes are others."""
    model = attached(boom())
    held = replace(model, rows=replace(model.rows, rows=tuple(row for row in model.rows.rows if row.is_fixed)))
    modes = eigensolver(held, "dense").lowest(held.rows.domain[0], 6)
    upper = replace(modes, omega=modes.omega[3:], phi=modes.phi[:, 3:])
    with pytest.raises(ConvergenceError, match="hides 2 rigid-body modes"):
        _remove_rigid_modes(held, rigid_modes(model), upper)


def test_a_model_that_does_not_know_its_motions_says_so() -> None:
    with pytest.raises(ValueError, match="rigid motions are not known"):
        rigid_modes(replace(attached(boom()), rigid=None))


@pytest.mark.slow
def test_the_boom_of_8_2_metres_is_followed() -> None:
    """With one of the two rigid-body modes taken for an elastic one the error is 4.6 %."""
    overrides = ["body.box.length=8.2", "observe.end=4.8", "recovery.stress=false", "time.step=5e-3"]
    outcome = run(scenes.load(BOOM, overrides))
    if outcome is None:
        return
    assert outcome.result.summary["errors"]["reduced_vs_full"]["beam"] < 1.2e-4
