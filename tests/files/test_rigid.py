"""What given matrices resist of rigid motions: supports that were left out of them, and springs to ground."""

import numpy as np
import pytest
import scipy.sparse as sp
from bricks import bricks

from pmr.files.matrices import GivenMatrices
from pmr.files.rigid import Resistance

BAR = bricks((4, 1, 1), (6.0, 0.5, 0.6))


def without(given: GivenMatrices, held: np.ndarray) -> Resistance:
    """The bar without the rows and columns of some coordinates (n,), which stand still."""
    rest = np.flatnonzero(~held)
    return Resistance(given.K[rest][:, rest], given.points, given.node[rest], given.direction[rest])


def springs(stiffness: dict[tuple[int, int], float]) -> Resistance:
    """The bar on springs in N/m between nodes and the ground, each along a direction."""
    K = BAR.K.tolil()
    for (node, direction), value in stiffness.items():
        at = np.flatnonzero((BAR.node == node) & (BAR.direction == direction)).item()
        K[at, at] += value
    return Resistance(K.tocsr(), BAR.points, BAR.node, BAR.direction)


def row(node: int, direction: int) -> np.ndarray:
    """Displacement of a node along an axis under unit translations and rotations about the origin, (6,)."""
    axis = np.eye(3)[direction]
    return np.r_[axis, np.cross(BAR.points[node], axis)]


def assert_same_span(found: np.ndarray, expected: np.ndarray) -> None:
    assert len(found) == np.linalg.matrix_rank(expected)
    assert np.linalg.matrix_rank(np.vstack([found, expected]), tol=1e-9 * np.abs(expected).max()) == len(found)


def test_a_free_body_resists_nothing() -> None:
    assert springs({}).held_motions().shape == (0, 6)


@pytest.mark.parametrize("digits", [6, 8, 14])
def test_rounded_points_and_entries_are_no_support(digits: int) -> None:
    """Of a body that does not begin at the origin; entries of fewer than nine digits make no body of it."""
    points = np.round(BAR.points * np.sqrt(2.0) + [1 / 3, 7 / 9, 2 / 3], digits)
    K = BAR.K.copy()
    exponent = 10.0 ** (np.floor(np.log10(np.abs(K.data))) - max(digits, 9))
    K.data = np.round(K.data / exponent) * exponent
    assert Resistance(K, points, BAR.node, BAR.direction).held_motions().shape == (0, 6)


def test_a_clamped_face_holds_all_motions() -> None:
    assert np.linalg.matrix_rank(without(BAR, np.isin(BAR.node, BAR.groups["tail"])).held_motions()) == 6


@pytest.mark.parametrize("held", [[(0, 0)], [(0, 0), (3, 2)], [(0, 0), (0, 1), (0, 2)], [(5, 1), (9, 1), (14, 2)]])
def test_supports_hold_the_displacements_that_are_left_out(held: list[tuple[int, int]]) -> None:
    gone = np.any([(BAR.node == node) & (BAR.direction == direction) for node, direction in held], axis=0)
    assert_same_span(without(BAR, gone).held_motions(), np.array([row(*one) for one in held]))


@pytest.mark.parametrize("stiffness", [1e2, 1e6, 1e13])
def test_springs_hold_what_they_are_stretched_by(stiffness: float) -> None:
    """From a billionth of the body's entries to a hundred times these."""
    found = springs({(4, 2): stiffness, (17, 1): 3.0 * stiffness}).held_motions()
    assert_same_span(found, np.array([row(4, 2), row(17, 1)]))


def test_a_soft_spring_counts_beside_a_stiff_support() -> None:
    assert_same_span(springs({(0, 0): 1e14, (17, 2): 1e3}).held_motions(), np.array([row(0, 0), row(17, 2)]))


def test_rotations_held_at_a_node_hold_the_body() -> None:
    """A beam of two nodes with six coordinates each: a spring about x at the first one."""
    K = np.zeros((12, 12))
    for i, (a, b) in enumerate([(100.0, 1.0)] * 3):  # any stiffness that leaves both nodes' rigid motion free
        stretch, turn = np.zeros((2, 12))
        stretch[[i, 6 + i]] = -1.0, 1.0
        if i:
            other, sign = (5, 1.0) if i == 1 else (4, -1.0)
            stretch[[other, 6 + other]] = -sign, -sign  # of 2 m in length, the mean of both rotations
        turn[[3 + i, 9 + i]] = -1.0, 1.0
        K += a * np.outer(stretch, stretch) + b * np.outer(turn, turn)
    node, direction = np.repeat([0, 1], 6), np.tile(np.arange(6), 2)
    points = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    assert Resistance(sp.csr_matrix(K), points, node, direction).held_motions().shape == (0, 6)
    K[3, 3] += 0.5
    found = Resistance(sp.csr_matrix(K), points, node, direction).held_motions()
    assert_same_span(found, np.eye(6)[[3]])


def test_a_matrix_with_unsorted_entries_is_left_as_it_is() -> None:
    """SciPy sorts indices in place, also those that two matrices share."""
    order = np.random.default_rng(1).permutation(len(BAR.node))
    K = BAR.K[order][:, order]
    assert not K.has_sorted_indices
    before = K.toarray()
    body = Resistance(K, BAR.points, BAR.node[order], BAR.direction[order])
    assert body.on_pattern(body.edges).max(axis=1).shape == (60, 1)
    np.testing.assert_array_equal(body.K.toarray(), before)
    np.testing.assert_array_equal(K.toarray(), before)
