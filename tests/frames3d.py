"""Bodies as other programs assemble them, by NumPy alone: a lattice of bars, and a frame of beams with rotations."""

from itertools import combinations

import numpy as np

from pmr import from_matrices
from pmr.files.matrices import GivenMatrices

YOUNG, SHEAR, DENSITY = 2.1e11, 8e10, 7850.0  # steel
AREA, INERTIA = 4e-4, 3e-8  # m^2, m^4 of a tube


def stations(count: int, length: float, width: float, height: float) -> np.ndarray:
    """Corners (4 count, 3) in m of a box, four at each of `count` equally spaced stations along x."""
    x, y, z = np.meshgrid(
        np.linspace(0.0, length, count), [-width / 2, width / 2], [-height / 2, height / 2], indexing="ij"
    )
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


def groups(points: np.ndarray) -> dict[str, np.ndarray]:
    """Indices of the points at the ends and on the sides of a box, by name."""
    x, y, z = points.T
    sides = {"bottom": z == z.min(), "top": z == z.max(), "right": y == y.min(), "left": y == y.max()}
    return {"tail": x == x.min(), "tip": x == x.max(), **sides}


def lattice(count: int = 7, length: float = 6.0, width: float = 0.5, height: float = 0.6) -> GivenMatrices:
    """Assemble bars between all nodes of neighbouring stations, with half the mass of each bar at either end."""
    points = stations(count, length, width, height)
    K, M = np.zeros((2, 3 * len(points), 3 * len(points)))
    for i, j in pairs(count):
        axis = points[j] - points[i]
        span = np.linalg.norm(axis)
        at = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
        K[np.ix_(at, at)] += YOUNG * AREA / span**3 * np.kron([[1, -1], [-1, 1]], np.outer(axis, axis))
        M[at, at] += DENSITY * AREA * span / 2.0
    return from_matrices(M, K, points, groups(points))


def frame(count: int = 7, length: float = 6.0, width: float = 0.5, height: float = 0.6) -> GivenMatrices:
    """Assemble welded beams between all nodes of neighbouring stations; six coordinates a node."""
    points = stations(count, length, width, height)
    K, M = np.zeros((2, 6 * len(points), 6 * len(points)))
    for i, j in pairs(count):
        axis = points[j] - points[i]
        span = float(np.linalg.norm(axis))
        at = np.r_[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
        first = axis / span
        second = np.cross(first, np.eye(3)[np.abs(first).argmin()])
        second /= np.linalg.norm(second)
        turned = np.kron(np.eye(4), np.array([first, second, np.cross(first, second)]))
        K[np.ix_(at, at)] += turned.T @ beam(span) @ turned
        M[at, at] += np.tile(np.r_[[DENSITY * AREA * span / 2.0] * 3, [DENSITY * AREA * span**3 / 200.0] * 3], 2)
    return from_matrices(M, (K + K.T) / 2.0, points, groups(points))


def pairs(count: int) -> list[tuple[int, int]]:
    """Pairs of nodes that an element joins: those of a station, and those of neighbouring stations."""
    nodes = range(4 * count)
    return [(i, j) for i, j in combinations(nodes, 2) if j // 4 - i // 4 <= 1]


def beam(span: float) -> np.ndarray:
    """Stiffness (12, 12) of Euler's beam of length `span` m along its own x axis (Przemieniecki 1968, section 5.6)."""
    EI = YOUNG * INERTIA
    K = np.zeros((12, 12))
    for k, stiffness in ((0, YOUNG * AREA / span), (3, SHEAR * 2.0 * INERTIA / span)):
        K[np.ix_([k, k + 6], [k, k + 6])] += stiffness * np.array([[1, -1], [-1, 1]])
    bending = (
        EI
        / span**3
        * np.array(
            [
                [12, 6 * span, -12, 6 * span],
                [6 * span, 4 * span**2, -6 * span, 2 * span**2],
                [-12, -6 * span, 12, -6 * span],
                [6 * span, 2 * span**2, -6 * span, 4 * span**2],
            ]
        )
    )
    for at, signs in (([1, 5, 7, 11], [1, 1, 1, 1]), ([2, 4, 8, 10], [1, -1, 1, -1])):
        K[np.ix_(at, at)] += bending * np.outer(signs, signs)
    return K
