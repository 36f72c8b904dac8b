"""Given matrices as a structural model: places on nodes measure rigid motions as what they are."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from gathering import gathered

from pmr import InputError
from pmr.files.matrices import GivenMatrices
from pmr.fullmodel.build import AssembledBody
from pmr.fullmodel.pads import Pads, Support, restrain
from pmr.fullmodel.structure import Structure, structural_model
from pmr.models.matrices import Matrices
from pmr.models.trace import Window
from pmr.reduction.recovery import BodyFields
from pmr.scene import Damping


@pytest.fixture(scope="module")
def model() -> Matrices:
    """Nodes of a box of 3 x 0.4 x 0.2 m, rotations at those of the tip."""
    x, y, z = np.meshgrid(np.linspace(0.0, 3.0, 13), np.linspace(-0.2, 0.2, 5), [-0.1, 0.1], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    tip = points[:, 0] > 2.99
    pairs = [(k, d) for k in range(len(points)) for d in range(6 if tip[k] else 3)]
    node, direction = np.array(pairs).T
    groups = {
        "top": np.flatnonzero(points[:, 2] > 0.0),
        "tip": np.flatnonzero(tip),
        "edge": np.flatnonzero((points[:, 2] > 0.0) & (points[:, 1] > 0.19)),
    }
    one = sp.identity(len(node), format="csr")
    return Matrices(GivenMatrices(one, one, points, node, direction, groups))


def motion(model: Matrices, at: np.ndarray) -> np.ndarray:
    """Displacement (3, 6) of a point under each rigid motion."""
    return np.hstack([np.eye(3), np.stack([np.cross(np.eye(3)[k], at) for k in range(3)], axis=1)])


@pytest.mark.parametrize("place", ["tip", "top", 1.3])
def test_places_follow_rigid_motions(model: Matrices, place: str | float) -> None:
    R, centre = model.rigid_motions(), model.centroid(place)
    np.testing.assert_allclose(model.displacement(place) @ R, motion(model, centre), atol=1e-12)
    about = np.array([0.3, -0.2, 0.7])
    expected = np.vstack([motion(model, about), np.hstack([np.zeros((3, 3)), np.eye(3)])])
    np.testing.assert_allclose(model.motion(place, about) @ R, expected, atol=1e-12)
    if isinstance(place, float):
        assert centre[0] == pytest.approx(place, abs=1e-12)


@pytest.mark.parametrize("levels", ["graded", "scattered"])
def test_a_place_is_where_it_was_asked_for(levels: str) -> None:
    """Levels of nodes that get closer, or none at all, as tetrahedra have; at the ends, on levels and between them."""
    x, y, z = np.meshgrid(2.0 * np.linspace(0.0, 1.0, 9) ** 2, [-0.2, 0.2], [-0.1, 0.0, 0.1], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    inner = (points[:, 0] > 0.0) & (points[:, 0] < 2.0)
    if levels == "scattered":
        points[inner, 0] += np.random.default_rng(1).uniform(-0.01, 0.01, inner.sum())
    node, direction = np.repeat(np.arange(len(points)), 3), np.tile(np.arange(3), len(points))
    one = sp.identity(len(node), format="csr")
    found = Matrices(GivenMatrices(one, one, points, node, direction, {}))
    for place in (0.0, 0.01, 0.3286, 0.5, 1.999, 2.0):
        trace = found.trace(place)
        assert trace.centroid[0] == pytest.approx(place, abs=1e-8)  # a billionth of the extent is no distance
        assert np.ptp(trace.points[:, 1]) == pytest.approx(0.4) and np.ptp(trace.points[:, 2]) >= 0.1
        np.testing.assert_allclose(
            found.displacement(place) @ found.rigid_motions(), motion(found, trace.centroid), atol=1e-12
        )
        assert np.abs(trace.points[:, 0] - place).max() < 0.5


def flat(**groups: np.ndarray) -> Matrices:
    """Nodes of a plate of 2 x 0.4 m in the plane z = 0, with all six coordinates."""
    x, y = np.meshgrid(np.linspace(0.0, 2.0, 9), np.linspace(-0.2, 0.2, 5), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    node, direction = np.repeat(np.arange(len(points)), 6), np.tile(np.arange(6), len(points))
    one = sp.identity(len(node), format="csr")
    whole = np.arange(len(points))
    known = {"bottom": whole, "top": whole, "middle": whole, "tail": whole[points[:, 0] == 0.0]}
    return Matrices(GivenMatrices(one, one, points, node, direction, known | groups))


def test_a_face_of_a_flat_body_points_where_its_name_says() -> None:
    """Its middle is that of the body, which says nothing: every row of a pad was zero."""
    model, window = flat(), Window((0.5, 0.7), (-0.05, 0.05), (0.02, 0.01))
    for face, sign in {"bottom": -1.0, "top": 1.0}.items():
        np.testing.assert_allclose(model.strip(face, window).normal @ model.rigid_motions()[:, 2], sign, rtol=1e-12)
    with pytest.raises(InputError, match=r"pads.on = 'middle': this face lies in the middle of the body"):
        model.strip("middle", window)


def test_a_face_without_coordinates_along_its_normal_is_refused() -> None:
    model = flat()
    kept = (model.body_matrices.direction != 2) | ~np.isin(
        model.body_matrices.node, model.body_matrices.groups["bottom"][10:]
    )
    one = sp.identity(int(kept.sum()), format="csr")
    given = replace(
        model.body_matrices,
        M=one,
        K=one,
        node=model.body_matrices.node[kept],
        direction=model.body_matrices.direction[kept],
    )
    given = replace(given, groups={"bottom": model.body_matrices.groups["bottom"][10:]})
    with pytest.raises(InputError, match="coordinates along its normal: without them a pad holds nothing"):
        Matrices(given).strip("bottom", Window((0.7, 0.9), (-0.05, 0.05), (0.02, 0.01)))


def test_a_line_of_nodes_is_held_along_the_axes() -> None:
    """Its rotation about itself is open, and nobody asks for it."""
    model = flat()
    held = restrain(Pads(supports=(Support("a", "tail", "x"),)), model, sp.eye(model.size, format="csr"))
    measured = (held.rows[0].at(0.0) @ model.rigid_motions()).ravel()
    assert measured == pytest.approx([1.0, 0.0, 0.0, 0.0, 0.0, 0.0], abs=1e-12)
    with pytest.raises(InputError, match="points of this group lie on a line"):
        restrain(Pads(supports=(Support("a", "tail", "ry"),)), model, sp.eye(model.size, format="csr"))


@pytest.mark.parametrize(
    ("directions", "missing"), [((2, 3, 4), "x, y, rz"), ((0, 2, 4), "y, rx, rz"), ((0, 1, 2), "rx")]
)
def test_a_body_that_does_not_move_in_space_is_refused(directions: tuple[int, ...], missing: str) -> None:
    """A plate that bends (its scale of frequency was 0/0), a plane frame, nodes with displacements on a line."""
    points = np.column_stack([np.linspace(0.0, 30.0, 5), np.zeros(5), np.zeros(5)])
    node, direction = np.repeat(np.arange(5), len(directions)), np.tile(directions, 5)
    one = sp.identity(len(node), format="csr")
    with pytest.raises(InputError, match=f"direction: coordinates .* these know no rigid motion along {missing}$"):
        Matrices(GivenMatrices(one, one, points, node, direction, {}))


def test_a_strip_is_the_face(model: Matrices) -> None:
    strip = model.strip("top", Window((1.0, 1.5), (-0.1, 0.05), (0.02, 0.01)))
    assert strip.weights.sum() == pytest.approx(0.5 * 0.15, rel=1e-12)
    assert strip.extent.along == (0.0, 3.0) and strip.extent.across == pytest.approx((-0.2, 0.2))
    assert strip.along.min() > 1.0 and strip.along.max() < 1.5
    places = np.column_stack([strip.along, strip.across, np.full(len(strip.along), 0.1)])
    expected = np.stack([motion(model, at)[2] for at in places])  # outwards is up
    np.testing.assert_allclose(strip.normal @ model.rigid_motions(), expected, atol=1e-12)


def test_coordinates_on_a_group(model: Matrices) -> None:
    found = model.coordinates_on("tip", ("z", "rx"))
    assert len(found) == 2 * len(model.body_matrices.groups["tip"])
    assert set(model.body_matrices.direction[found]) == {2, 3}


@pytest.mark.parametrize(
    ("face", "says"), [("edge", "nodes that lie in a plane"), ("tip", "lies across"), ("none", "groups of the file")]
)
def test_what_is_no_face_is_refused(model: Matrices, face: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        model.strip(face, Window((1.0, 1.5), (-0.1, 0.05), (0.02, 0.01)))


def test_nothing_is_drawn_of_given_matrices(model: Matrices) -> None:
    with pytest.raises(InputError, match="no cells to draw"):
        BodyFields(AssembledBody(structural_model(Structure(model)), Structure(model)))


def test_damping_has_room_for_masses_that_couple_what_no_stiffness_does(model: Matrices) -> None:
    """K without the entries that another program leaves out, for they are zero."""
    n = model.size
    M = sp.identity(n) + sp.coo_matrix(([0.1, 0.1], ([0, 1], [1, 0])), shape=(n, n))
    given = replace(model.body_matrices, M=M.tocsr())
    full = structural_model(Structure(Matrices(given), damping=Damping(mass=2.0, stiffness=0.5)))
    expected = 2.0 * given.M + 0.5 * given.K
    np.testing.assert_array_equal(gathered(full.D), expected.toarray())
