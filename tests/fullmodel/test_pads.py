import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from boxes import block, box
from gathering import gathered

from pmr import InputError
from pmr.fem.compat import MPI
from pmr.fullmodel.actions import Action, PadForce, Weight
from pmr.fullmodel.pads import Pad, Pads, Support, fixed_pad, moving_pad, restrain, under_even_pad
from pmr.fullmodel.structure import Structure, structural_model
from pmr.models import StructuralModel
from pmr.models.beam2d import Beam2D
from pmr.models.beam3d import Beam3D
from pmr.models.named_mesh import Group
from pmr.models.shell import Shell
from pmr.models.solid import Solid
from pmr.scene.structures import Beam3DBody, BoxProfile, Plate, Profile, ShellBody, SolidBody
from pmr.system.rows import Row, Rows

TRAVEL = (0.4, 1.5)
FACES = {"bottom": (2, -1.0, 0.1), "top": (2, 1.0, -0.1), "left": (1, 1.0, 0.0), "right": (1, -1.0, 0.05)}


def shell(skew: float = 0.2, along: int = 8) -> Shell:
    return Shell(ShellBody(plate=Plate(thickness=0.008)), box(skew=skew, along=along))


def beam() -> Beam3D:
    profile = BoxProfile(width=0.3, height=0.4, wall=0.008)
    return Beam3D(Beam3DBody(length=2.0, profile=profile, elements=9))


MODELS = {"shell": shell, "beam": beam}


@pytest.fixture(scope="module", params=MODELS)
def model(request) -> StructuralModel:
    return MODELS[request.param]()


def free(model: StructuralModel) -> sp.csr_matrix:
    return sp.eye(model.size, format="csr")


def applied(row: Row, s: float, q: np.ndarray, derivative: int = 0) -> np.ndarray:
    return np.asarray((row.at(s, derivative) @ q)[0])


@pytest.mark.parametrize("face", FACES)
def test_a_pad_measures_a_rigid_motion_as_one_wherever_it_is(model: StructuralModel, face: str) -> None:
    axis, sign, across = FACES[face]
    row = moving_pad(Pad("p", face, at=0.03, across=across), model, free(model), TRAVEL)
    R = model.rigid_motions()
    for s in (0.4, 0.4321, 0.9, 1.2345, 1.5):
        place, normal = np.zeros(3), sign * np.eye(3)[axis]
        place[0], place[3 - axis] = s + 0.03, across
        expected = np.concatenate([normal, np.cross(place, normal)])
        assert applied(row, s, R) == pytest.approx(expected, abs=1e-12)
        moved = np.concatenate([np.zeros(3), np.cross(np.eye(3)[0], normal)])
        assert applied(row, s, R, derivative=1) == pytest.approx(moved, abs=1e-10)


def test_a_pad_measures_the_mean_of_a_parabola_without_a_ripple() -> None:
    """w = x^2 on a mesh that has nothing regular: s^2 and the spread of the weights, for every s alike."""
    model = shell()
    row = moving_pad(Pad("p", "top", across=0.02), model, free(model), TRAVEL)
    w = np.where(model.nodes.component == 2, model.nodes.points[:, 0] ** 2, 0.0)
    spread = [applied(row, s, w) - s**2 for s in np.linspace(*TRAVEL, 77)]
    step = 0.3 / 10
    assert spread == pytest.approx(np.full(77, (2 * step) ** 2 / 3 + step**2 / 6), rel=1e-9)


@pytest.mark.parametrize("make", MODELS.values())
@pytest.mark.parametrize(
    ("face", "across", "width", "across_to"),
    [("bottom", 0.06, 0.08, 3e-3), ("left", -0.15, 0.08, 3e-3), ("left", -0.16, 0.08, 0.04), ("top", 0.0, 0.3, 0.08)],
)
def test_an_even_pad_measures_the_mean_over_its_area(
    make: Callable[[], StructuralModel], face: str, across: float, width: float, across_to: float
) -> None:
    """Rigid motions and parabolas along the axis but for round-off, parabolas across to a share.

    The sides of pads cut skewed cells, but for sides that are on an edge of the face.
    """
    model, (axis, sign, _) = make(), FACES[face]
    pad = Pad("p", face, at=0.77, across=across, width=width)
    row = under_even_pad(pad, model)
    place, normal = np.zeros(3), sign * np.eye(3)[axis]
    place[0], place[3 - axis] = pad.at, across
    expected = np.concatenate([normal, np.cross(place, normal)])
    assert (row @ model.rigid_motions())[0] == pytest.approx(expected, abs=1e-12)
    if isinstance(model, Shell):
        points, on = model.nodes.points, sign * (model.nodes.component == axis)
        assert row @ (on * (points[:, 0] - pad.at) ** 2) == pytest.approx(0.3**2 / 12.0, rel=1e-9)
        assert row @ (on * (points[:, 3 - axis] - across) ** 2) == pytest.approx(width**2 / 12.0, rel=across_to)


def test_a_row_is_twice_continuously_differentiable(model: StructuralModel) -> None:
    """And no more: a declared order that holds exactly."""
    row = moving_pad(Pad("p", "bottom"), model, free(model), TRAVEL)
    q = np.random.default_rng(3).normal(size=model.size)
    inner = row.breaks[1:-1]
    for order, scale in ((0, 1.0), (1, 1e2), (2, 1e4)):
        jump = [abs(applied(row, b + 1e-9, q, order) - applied(row, b - 1e-9, q, order)) for b in inner]
        assert max(jump) < 1e-4 * scale
    assert min(abs(applied(row, b + 1e-9, q, 3) - applied(row, b - 1e-9, q, 3)) for b in inner) > 1.0


def test_the_path_has_as_many_carriers_on_any_mesh() -> None:
    rows = [moving_pad(Pad("p", "top"), m, free(m), TRAVEL) for m in (shell(), shell(along=30), beam())]
    assert {row.carriers.shape[0] for row in rows} == {37 + 7}  # 1.1 m in steps of 3 cm, and the pad's reach


def test_a_fixed_pad_is_a_moving_one_that_stays(model: StructuralModel) -> None:
    pad = Pad("p", "left", at=0.7, across=0.03, stiffness=1e7)
    row = fixed_pad(pad, model, free(model), (0.2, 0.5))
    q = np.random.default_rng(4).normal(size=model.size)
    moving = moving_pad(pad, model, free(model), (0.0, 0.6))
    assert applied(row, 0.3, q) == pytest.approx(float(applied(moving, 0.0, q)), rel=1e-12)
    assert not row.moves and row.compliance == 1e-7


def planar() -> Beam2D:
    body = Profile(length=2.0, bending_stiffness=1e7, mass_per_length=80.0, axial_stiffness=1e9, axial=True)
    return Beam2D(body, np.linspace(0.0, 2.0, 10))


def solid() -> Solid:
    return Solid(SolidBody(), block())


OFFERS = r"pads\.p: the pad leaves the face top .* allowed: 0 to 2 m along the axis"


@pytest.mark.parametrize("make", [planar, beam, shell, solid])
def test_a_pad_that_leaves_its_face_or_lies_beside_it_is_refused(make: Callable[[], StructuralModel]) -> None:
    """In part, just beyond and far away, before and behind: a weight of nothing is no pad."""
    model = make()
    for travel in ((0.1, 1.5), (0.4, 1.9), (7.0, 8.0), (-3.0, -2.5), (2.15, 2.5), (-0.4, -0.15)):
        with pytest.raises(InputError, match=OFFERS):
            moving_pad(Pad("p", "top"), model, free(model), travel)
    for at in (15.0, -0.2, 2.2, 1.9):
        with pytest.raises(InputError, match=OFFERS):
            fixed_pad(Pad("p", "top", at=at), model, free(model), TRAVEL)


@pytest.mark.parametrize("make", [beam, shell, solid])
def test_a_pad_beside_its_face_is_refused(make: Callable[[], StructuralModel]) -> None:
    for across in (1.0, -1.0, 0.13):
        with pytest.raises(InputError, match=OFFERS + r", -0\.15 to 0\.15 m across"):
            fixed_pad(Pad("p", "top", at=0.7, across=across), make(), free(make()), TRAVEL)


def test_a_hole_in_a_face_is_no_place_for_a_pad() -> None:
    """Two cells missing: most of the face is there, what the pad needs isn't."""
    model = shell(skew=0.0)
    top = model.mesh.groups["top"]
    middle = model.mesh.points[top.entities].mean(axis=1)
    kept = Group(2, top.entities[np.abs(middle[:, 0] - 0.9) > 0.2])
    holed = Shell(model.body, replace(model.mesh, groups={**model.mesh.groups, "top": kept}))
    assert fixed_pad(Pad("p", "top", at=1.5), holed, free(holed), TRAVEL).name == "p"
    with pytest.raises(InputError, match=r"pads\.p: the pad leaves the face top around"):
        fixed_pad(Pad("p", "top", at=0.9, length=0.2), holed, free(holed), TRAVEL)
    low, high = 0.9 - 0.2, 0.9 + 0.2  # the edges of the hole, at the most
    with pytest.raises(InputError, match=r"allowed: with its centre at ([\d.]+) to ([\d.]+) m or ([\d.]+) to ") as hole:
        moving_pad(Pad("p", "top", length=0.2), holed, free(holed), (0.3, 1.6))
    ends = [float(text) for text in re.findall(r"[\d.]+(?= (?:to|m))", str(hole.value).partition("centre at ")[2])]
    assert ends[0] <= 0.3 and ends[-1] >= 1.6 and 0.5 * low < ends[1] < low and high < ends[2] < 1.5


def test_pads_at_the_ends_fit_exactly(model: StructuralModel) -> None:
    assert moving_pad(Pad("p", "top"), model, free(model), (0.15, 1.85)).breaks[-1] == 1.85
    assert fixed_pad(Pad("p", "top", at=0.15), model, free(model), TRAVEL).name == "p"


def test_a_pad_on_a_face_that_a_beam_lacks_is_refused() -> None:
    with pytest.raises(InputError, match="this beam has the faces bottom, left, top, right"):
        moving_pad(Pad("p", "floor"), beam(), free(beam()), TRAVEL)


def test_a_pad_that_only_pushes_is_a_row_wherever_it_sits(model: StructuralModel) -> None:
    """Rigid or not, fixed or not; its clearance goes with the row, and it holds no rigid motion once and for all."""
    fixed = [Pad(name, "bottom", 0.2, stiffness=k, unilateral=True) for name, k in (("soft", 1e8), ("rigid", np.inf))]
    side = Pad("side", "left", unilateral=True, clearance=1e-3)
    pads = Pads((*fixed, Pad("spring", "top", 0.2)), (side, Pad("mouth", "bottom")), travel=TRAVEL)
    found = restrain(pads, model, free(model))
    assert [row.name for row in found.rows] == ["soft", "rigid", "side", "mouth"]
    assert [row.name for row in found.springs] == ["spring"]
    assert [row.clearance for row in found.rows] == [0.0, 0.0, 1e-3, None]
    assert not any(row.is_fixed or row.held_coordinate is not None for row in found.rows)
    finer = [row.refine(np.linspace(*TRAVEL, 3)) if not row.moves else row.refine(row.breaks) for row in found.rows]
    assert [row.clearance for row in finer] == [0.0, 0.0, 1e-3, None]
    rows = Rows(found.rows, model.size)
    assert np.array_equal(rows.clearance, [0.0, 0.0, 1e-3, np.nan], equal_nan=True)
    with pytest.raises(InputError, match=r"nor are rigid or unilateral are allowed: spring; .* multipliers"):
        found.force("soft", model.size)


def held(model: StructuralModel, stiffness: float = 3e8) -> Structure:
    """On four pads and a cylinder, with weight."""
    pads = Pads(
        fixed=(
            Pad("tail", "bottom", at=0.2, stiffness=stiffness),
            Pad("side", "left", at=0.2),
            Pad("edge", "bottom", at=0.2, across=0.1),
        ),
        moving=(Pad("mouth", "bottom"), Pad("beside", "left")),
        supports=(Support("cylinder", "tail", stiffness=1e7),),
        travel=TRAVEL,
    )
    outputs = (PadForce("tail"), PadForce("edge"), PadForce("cylinder"), Action("tip", "tip", "z"))
    return Structure(model, pads=pads, loads=(Weight(), Weight((1.0, 0.0, 0.0), "along")), outputs=outputs)


@pytest.mark.mpi
def test_pad_forces_balance_the_weight(model: StructuralModel) -> None:
    """Statically determinate: the multipliers and spring forces are those of the beam on two supports."""
    full = structural_model(held(model), MPI.COMM_WORLD)
    K, B, O = gathered(full.K), gathered(full.B), gathered(full.outputs).T
    assert full.rows.names == ("mouth", "beside")
    s, f = 1.1, np.array([9.81, 3.0])
    C = full.rows.at(s).toarray()
    matrix = np.block([[K, C.T], [C, -np.diag([row.compliance for row in full.rows.rows])]])
    answer = np.linalg.solve(matrix, np.concatenate([B @ f, np.zeros(2)]))
    assert full.output_positions[:3] == pytest.approx([0.2, 0.2, 0.0], abs=1e-12)
    mouth, beside = answer[-2:]
    tail, edge, cylinder, _ = O @ answer[:-2]
    M, R = gathered(full.M), model.rigid_motions()
    weight, centre = 9.81 * R[:, 2] @ M @ R[:, 2], 1.0
    # Faces at the bottom: an outward normal points down, so a pad that carries has a positive force.
    assert mouth == pytest.approx(weight * (centre - 0.2) / (s - 0.2), rel=1e-6)
    assert tail + edge + mouth == pytest.approx(weight, rel=1e-6)
    assert edge == pytest.approx(0.0, abs=1e-6 * weight) and beside == pytest.approx(0.0, abs=1e-6 * weight)
    assert cylinder == pytest.approx(3.0 * weight / 9.81, rel=1e-6)


def test_springs_are_what_neither_moves_nor_is_rigid(model: StructuralModel) -> None:
    found = restrain(held(model, stiffness=np.inf).pads, model, free(model))
    assert [row.name for row in found.rows] == ["tail", "mouth", "beside"]
    assert [row.name for row in found.springs] == ["side", "edge", "cylinder"]
    with pytest.raises(InputError, match="neither move nor are rigid or unilateral are allowed: side, edge, cylinder"):
        found.force("mouth", model.size)


def test_pads_that_are_far_too_small_are_refused() -> None:
    """For the path, and for the cells of a face: neither takes all memory."""
    with pytest.raises(
        InputError, match=r"pads\.p\.length = 1e-05: at least 0\.0011 m are allowed on a path of 1\.1 m"
    ):
        moving_pad(Pad("p", "top", length=1e-5), beam(), free(beam()), TRAVEL)
    with pytest.raises(InputError, match="cells of this face are up to .* finer cells or larger pads are allowed"):
        fixed_pad(Pad("p", "top", at=0.7, length=1e-4, width=1e-4), shell(), free(shell()), TRAVEL)
