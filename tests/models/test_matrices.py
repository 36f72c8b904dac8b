"""Given matrices as a structural model: places on nodes measure rigid motions as what they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from gathering import gathered

from pmr.errors import InputError
from pmr.files.matrices import GivenMatrices
from pmr.fullmodel.structure import Structure, structural_model
from pmr.mesh.strip import Window
from pmr.models.matrices import Matrices
from pmr.recover.fields import View
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
        assert centre[0] == pytest.approx(place, abs=0.05)


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
    assert len(found) == 2 * len(model.given.groups["tip"])
    assert set(model.given.direction[found]) == {2, 3}


@pytest.mark.parametrize(
    ("face", "says"), [("edge", "nodes that lie in a plane"), ("tip", "lies across"), ("none", "groups of the file")]
)
def test_what_is_no_face_is_refused(model: Matrices, face: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        model.strip(face, Window((1.0, 1.5), (-0.1, 0.05), (0.02, 0.01)))


def test_nothing_is_drawn_of_given_matrices(model: Matrices) -> None:
    with pytest.raises(InputError, match="no cells to draw"):
        View.of(Structure(model))


def test_damping_has_room_for_masses_that_couple_what_no_stiffness_does(model: Matrices) -> None:
    """K without the entries that another program leaves out, for they are zero."""
    n = model.size
    M = sp.identity(n) + sp.coo_matrix(([0.1, 0.1], ([0, 1], [1, 0])), shape=(n, n))
    given = replace(model.given, M=M.tocsr())
    full = structural_model(Structure(Matrices(given), damping=Damping(mass=2.0, stiffness=0.5)))
    expected = 2.0 * given.M + 0.5 * given.K
    np.testing.assert_array_equal(gathered(full.D), expected.toarray())
