"""A boom as a planar beam: what it knows acts the same."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import one_body
import petsc_alone
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from booms import Boom, boom
from boxes import box
from springs import CompliantRows, displacement

from pmr import InputError, ReducedModel
from pmr import scene as scenes
from pmr.compare.errors import relative_error
from pmr.fem.compat import MPI
from pmr.fullmodel.build import build
from pmr.fullmodel.from_scene import structure_of
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.structure import structural_model
from pmr.models.beam3d import Beam3D
from pmr.models.box_mesh import BoxBoom, write_shell
from pmr.models.shell import Shell
from pmr.reduction.basis import modal_basis
from pmr.reduction.free_body import FreeBody
from pmr.reduction.residual import flexible_model
from pmr.reduction.snapshots import free_modes
from pmr.scene.built import GRAVITY
from pmr.scene.members import member_at
from pmr.scene.signals import Constant
from pmr.scene.structures import Beam3DBody, BoxProfile, Plate, ShellBody
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.modal import modal_form

LOADS = np.array([1500.0, 700.0, 9.81])
PUSHING = (
    "pads=[{name='tail',at=0.15,faces={bottom=[-0.1,0.1],top=[-0.1,0.1],left=[0.0],right=[0.0]},unilateral=true,"
    "clearance={left=1e-3,right=1e-3}},{name='mouth',moving=true,faces={bottom=[-0.1,0.1],top=[-0.1,0.1],left=[0.0],"
    "right=[0.0]},unilateral=true,clearance={left=1e-3,right=1e-3}}]"
)


def shell() -> Shell:
    return Shell(ShellBody(plate=Plate(thickness=0.008)), box(length=6.0, along=16, around=2, skew=0.2))


def beam() -> Beam3D:
    profile = BoxProfile(width=0.3, height=0.4, wall=0.008)
    return Beam3D(Beam3DBody(length=6.0, profile=profile, elements=20, shear=True))


def reduced(full: FullModel, r: int) -> ReducedModel:
    return flexible_model(FreeBody(full), modal_basis(free_modes(full, r)), {})


def at_rest(body: ReducedModel, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Outputs (T, o) and multipliers (T, m) in equilibrium under `LOADS`."""
    rows = CompliantRows(body)
    system = rows.system(s)
    f = np.tile(LOADS, (len(s), 1))
    q = np.linalg.solve(system[..., : body.size], (system[..., body.size :] @ LOADS)[..., None])[..., 0]
    multipliers = rows.multipliers(s, q, f)
    assert body.flexibility is not None
    return q @ body.outputs.T + displacement(body.flexibility, s, multipliers, f), multipliers


@pytest.fixture(scope="module", params=[shell, beam])
def scene(request) -> Boom:
    return boom(request.param(), overrides=["time.step=5e-3"])


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.mpi
def test_statics_is_that_of_the_full_model(scene: Boom) -> None:
    """With two rigid turns and two modes: what is left out is answered by the tables, everywhere on the path."""
    full = structural_model(scene.structure)
    body = reduced(full, 4)
    s = np.array([1.5, 1.777, 2.9, 4.0])
    y, multipliers = at_rest(body, s)
    whole = MPI.COMM_WORLD.bcast(full.gather())
    for k, place in enumerate(s):
        C = whole.C(place)
        answer = spla.spsolve(
            sp.bmat([[whole.K, C.T], [C, -sp.diags(whole.row_compliance)]], format="csc"),
            np.concatenate([whole.B @ LOADS, np.zeros(C.shape[0])]),
        )
        released = [full.rows.names.index(name) for name in body.row_names]
        forces = answer[whole.size :][released]
        assert multipliers[k] == pytest.approx(forces, abs=1e-6 * np.abs(forces).max())
        expected = whole.outputs @ answer[: whole.size]
        for part in (slice(0, 60), slice(60, None)):  # displacements, forces
            assert y[k, part] == pytest.approx(expected[part], abs=1e-6 * np.abs(expected[part]).max())


@pytest.mark.mpi
def test_rigid_pads_on_a_section_that_can_not_deform_are_named() -> None:
    model = beam()
    structure = boom(model).structure
    rigid = tuple(replace(pad, stiffness=np.inf) for pad in structure.pads.moving)
    full = structural_model(replace(structure, pads=replace(structure.pads, moving=rigid)))
    with pytest.raises(InputError, match="the rows mouth .* depend on each other at s ="):
        reduced(full, 6)


@pytest.mark.mpi
@pytest.mark.parametrize(("stiffness", "free"), [(1e3, 3), (1e-6, 6)])
def test_springs_within_the_stiffness_own_round_off_hold_nothing(stiffness: float, free: int) -> None:
    """Of a box of steel: a ring holds y, z and rx; n u K_ii is some 1e-5 N/m, so that 1e-6 N/m are lost in K."""
    structure = boom(beam()).structure
    soft = tuple(replace(pad, stiffness=stiffness) for pad in structure.pads.fixed)
    held = replace(structure.pads, fixed=soft, supports=())
    assert soft and FreeBody(structural_model(replace(structure, pads=held))).Z.shape[1] == free


def node_passing_share(body: ReducedModel, spacing: float) -> float:
    """Largest amplitude of a pad force at the wavelength of the nodes, over the largest force."""
    s = np.linspace(1.6, 1.6 + 6 * spacing, 1201)
    forces = at_rest(body, s)[1]
    u = np.linspace(-1.0, 1.0, len(s))
    smooth = np.polynomial.chebyshev.chebfit(u, forces, 8)
    rest = forces - np.polynomial.chebyshev.chebval(u, smooth).T
    window = np.hanning(len(s))[:, None]
    content = 2.0 * np.abs(np.sum(window * rest * np.exp(-2j * np.pi * s / spacing)[:, None], axis=0)) / window.sum()
    return float(content.max() / np.abs(forces).max())


@pytest.mark.slow
def test_pad_forces_hardly_feel_the_nodes() -> None:
    """Cells a third of the pad long, cut by one diagonal and skewed, so that nothing is alike on any two walls.

    What ripples is how the side pads, each on the middle of a thin wall, share the lateral force: 0.7 % of the largest
    force.  Cells as long as the pad and longer don't resolve how the wall gives way under it: 3 to 4 %.
    """
    model = Shell(ShellBody(plate=Plate(thickness=0.008)), box(length=6.0, along=60, around=4, skew=0.2))
    body = reduced(structural_model(boom(model).structure), 4)
    for spacing in (0.1, 0.05):
        assert node_passing_share(body, spacing) < 0.01


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.mpi
def test_ten_coordinates_follow_the_full_model() -> None:
    """Gusts included: the first one comes in the third second."""
    scene = boom(shell(), span=3.0, overrides=["time.step=5e-3"])
    full = structural_model(scene.structure)
    every = petsc_alone.observe(full, scene.excitation)
    few = one_body.observe(modal_form(reduced(full, 10)), scene.excitation)
    released = [i for i, row in enumerate(full.rows.rows) if not row.is_fixed]
    assert relative_error(few.y[:, 58:60], every.y[:, 58:60]) < 0.002
    assert relative_error(few.y[:, :58], every.y[:, :58]) < 0.002
    forces = (np.hstack([few.multipliers, few.y[:, 60:]]), np.hstack([every.multipliers[:, released], every.y[:, 60:]]))
    assert relative_error(*forces) < 0.002


@pytest.mark.slow
@pytest.mark.numerical
def test_ten_coordinates_follow_the_boom(scene: Boom) -> None:
    """All ten seconds, against 150 with residual flexibility."""
    full = structural_model(scene.structure)
    found = [one_body.observe(modal_form(reduced(full, r)), scene.excitation) for r in (10, min(150, full.size // 2))]
    few, many = ((o.y[:, 58:60], o.y[:, :58], np.hstack([o.multipliers, o.y[:, 60:]])) for o in found)
    assert max(relative_error(a, b) for a, b in zip(few, many, strict=True)) < 0.003


def weight_and_centre(scene: Boom) -> tuple[float, float]:
    """Of boom and payload, in N and m."""
    steel = 7850.0 * 2.0 * (0.3 + 0.4) * 0.008 * 6.0
    return (steel + 250.0) * GRAVITY, (3.0 * steel + 6.0 * 250.0) / (steel + 250.0)


@pytest.mark.slow
def test_a_boom_on_pads_that_only_push_rests_as_statics_says() -> None:
    """Its weight alone, drawn in: what is ahead of the mouth is heavier, so the tail is held down from above."""
    scene = boom(beam(), overrides=[PUSHING, "compare.against=[]"])
    full = structural_model(scene.structure)
    assert len(full.output_positions) == 60 and len(full.rows.names) == 13  # all pads, and the cylinder
    body = replace(reduced(full, 10), D=10.0 * np.eye(10))
    loads = dict.fromkeys(body.input_names, Constant(amount=0.0)) | {"gravity": scene.excitation.loads["gravity"]}
    excitation = Excitation({"boom": Constant(amount=1.5)}, loads, TimeStepping(4.0, 1e-2, rho_inf=0.5))
    found = one_body.observe(modal_form(body), excitation)
    forces = dict(zip(body.row_names, found.multipliers[-1], strict=True))
    weight, centre = weight_and_centre(scene)
    tail = weight * (centre - 1.5) / (1.5 - 0.15)
    for name, force in forces.items():
        carries = {"tail top": tail / 2.0, "mouth bottom": (weight + tail) / 2.0}.get(name.rsplit(" ", 1)[0], 0.0)
        assert force == pytest.approx(carries, rel=1e-3), name


@pytest.mark.slow
def test_side_pads_touch_within_their_clearance_only() -> None:
    """A gust carries the boom across; the pads it hasn't reached have no force at all."""
    scene = boom(beam(), span=3.0, overrides=[PUSHING, "compare.against=[]"])
    body = reduced(structural_model(scene.structure), 10)
    found = one_body.observe(modal_form(body), scene.excitation)
    sides = [k for k, name in enumerate(body.row_names) if name.split()[1:] in (["left"], ["right"])]
    forces, ys = found.multipliers[:, sides], found.y[:, 58]
    assert forces[:2000].max() == 0.0 and np.abs(ys[:2000]).max() < 1e-9  # before the gust
    assert np.count_nonzero(forces.max(axis=0) > 100.0) >= 2 and found.multipliers.min() == 0.0
    assert 1e-3 < np.abs(ys).max() < 0.1


OWN = """
title = "A mesh of one's own"
[body]
model = "shell"
thickness = 0.008
[mesh]
file = "boom.msh"
[[pads]]
name = "tail"
at = 0.15
faces = { bottom = [-0.1, 0.1], left = [0.0] }
[[pads]]
name = "mouth"
moving = true
faces = { bottom = [-0.1, 0.1], left = [0.0] }
[[supports]]
name = "cylinder"
directions = ["x"]
[slider]
path = { kind = "smooth_ramp", times = [0.1, 0.9], values = [1.5, 2.0] }
[[loads]]
name = "F"
signal = 1000.0
[time]
end = 1.0
step = 1e-2
[observe]
start = 0.5
end = 3.5
count = 4
"""


@pytest.mark.slow
def test_a_mesh_of_ones_own_is_read(tmp_path: Path) -> None:
    write_shell(
        BoxBoom(BoxProfile(width=0.3, height=0.4, wall=0.008).sides, length=4.0, size=0.2), tmp_path / "boom.msh"
    )
    (tmp_path / "own.toml").write_text(OWN)
    model = build(scenes.load(tmp_path / "own.toml")).model
    assert model.output_names[-4:] == ("tip z", *(f"force of tail {pad}" for pad in PADS))
    with pytest.raises(InputError, match=r"boom.msh: no group named nose; found: bottom, left, right, tail, tip, top"):
        build(scenes.load(tmp_path / "own.toml", ["observe.tip=nose"]))


@pytest.mark.parametrize(
    "corners",
    [
        ((0.0, -0.1, 0.0), (0.0, 0.1, 0.0), (0.0, 0.1, 4.0), (0.0, -0.1, 4.0)),  # upright
        ((2.0, -0.1, 0.0), (6.0, -0.1, 0.0), (6.0, 0.1, 0.0), (2.0, 0.1, 0.0)),  # ahead of the pivot
        ((0.0, 0.1, 0.0), (4.0, 0.1, 0.0), (4.0, 0.3, 0.0), (0.0, 0.3, 0.0)),  # beside it
    ],
)
def test_a_mesh_in_a_frame_lies_along_x_from_its_tail_on(
    tmp_path: Path, corners: tuple[tuple[float, float, float], ...]
) -> None:
    nodes = "\n".join(f"{k}, {x}, {y}, {z}" for k, (x, y, z) in enumerate(corners, 1))
    (tmp_path / "plate.inp").write_text(f"*NODE\n{nodes}\n*ELEMENT, TYPE=S4, ELSET=bottom\n1, 1, 2, 3, 4\n")
    scene = OWN.replace("boom.msh", "plate.inp") + "[gravity]\n[frame]\npivot = [0.0, 0.0, 0.0]\nluffing = 0.3\n"
    (tmp_path / "own.toml").write_text(scene)
    with pytest.raises(InputError, match=r"plate\.inp: .*along x whose tail is at x = 0.*: it has x from "):
        build(scenes.load(tmp_path / "own.toml"))


PADS = ("bottom right", "bottom left", "left")


CLAMP = "{on='tail',kind='clamped',points='all'}"
PADS_PLANAR = "pads=[{name='mouth',moving=true,faces={bottom=[0.0],left=[0.0]}}]"
PLAIN = [PADS_PLANAR, "body.shear=false", "mesh.elements=6", "observe.count=5", "masses=[]"]


def deflections(model: str, load: str, clamps: str) -> np.ndarray:
    """Vertical displacements in statics under one load, the mouth's pads apart; at five places and the tip."""
    loads = f"loads=[{{name='F',on='tip',direction='{load}',signal=1.0}}]"
    scene = scenes.load("boom_beam", [*PLAIN, f"body.model={model}", loads, f"supports=[{clamps}]"])
    body = build(scene, MPI.COMM_SELF).model.gather()
    assert body is not None
    y = body.outputs @ np.linalg.solve(body.K.toarray(), body.B[:, 0])
    return y if model == "beam2d" else y[[*range(5, 10), 11]]


@pytest.mark.parametrize("load", ["z", "ry"])
def test_planar_beams_answer_forces_and_moments_as_beams_in_space(load: str) -> None:
    """A clamp on all directions holds rotation too; a moment about y turns the tip the same way."""
    planar, space = (deflections(model, load, CLAMP) for model in ("beam2d", "beam3d"))
    assert np.abs(space).max() > 0.0
    assert planar == pytest.approx(space, rel=1e-6, abs=1e-9 * np.abs(space).max())


def test_a_lateral_clamp_holds_nothing_of_a_planar_beam() -> None:
    """What a support holds along y must not hold the vertical."""
    both = CLAMP + ",{on='tip',directions=['y'],points='all'}"
    alone, beside = (deflections("beam2d", "z", clamps) for clamps in (CLAMP, both))
    assert beside == pytest.approx(alone, rel=1e-12)


@pytest.mark.parametrize("model", ["beam2d", "beam3d"])
def test_the_tips_rotation_is_an_output_in_rad(model: str) -> None:
    """- F L^2 / (2 EI) under a force upwards: positive about y is downwards along x."""
    loads = "loads=[{name='F',on='tip',direction='z',signal=1.0}]"
    changes = [*PLAIN, f"body.model={model}", loads, f"supports=[{CLAMP}]", "observe.rotation=true"]
    scene = scenes.load("boom_beam", changes)
    body = build(scene, MPI.COMM_SELF).model.gather()
    assert body is not None
    number = body.output_names.index("tip ry")
    assert body.output_units[number] == "rad"
    box = scene.body.box
    outer, inner = (box.width + box.wall, box.height + box.wall), (box.width - box.wall, box.height - box.wall)
    EI = scene.body.material.young * (outer[0] * outer[1] ** 3 - inner[0] * inner[1] ** 3) / 12.0
    turned = body.outputs[number] @ np.linalg.solve(body.K.toarray(), body.B[:, 0])
    assert turned == pytest.approx(-(box.length**2) / (2.0 * EI), rel=1e-6)


def test_of_a_fine_beam_some_nodes_are_observed() -> None:
    """With all of them the tables of outputs would grow with the square of the mesh."""
    changes = ["mesh.elements=2500", "compare.against=[]"]
    structure = structure_of(member_at(scenes.load("paper_simple", changes)), MPI.COMM_SELF)
    assert structure.model.node_stations is not None
    *line, tip = [one.on for one in structure.outputs]
    assert line == pytest.approx(structure.model.node_stations[:-1:3]) and tip == "tip"
