r"""A uniform cable and what its ANCF coordinates say at any material point.

.. math::
    r(x) = \sum_j S_j(\xi)\, q_j, \qquad K = e_3^T \frac{r' \times r''}{|r'|^2}

with the cubic shapes S of position and slope at both ends of an element.  Coordinates of a node: displacement
(x, y) and change of the slope r' (x, y), relative to the straight cable.  Gerstmayr, Irschik: On the correct
representation of bending and axial deformation in the absolute nodal coordinate formulation with an elastic
line approach, Journal of Sound and Vibration 318, 2008.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Position and slope, each in the plane.
COORDINATES_PER_NODE = 4

#: S of position and slope (over the element's length) at its left and right end, as polynomials in xi / h.
_SHAPES = np.array([[2.0, -3.0, 0.0, 1.0], [1.0, -2.0, 1.0, 0.0], [-2.0, 3.0, 0.0, 0.0], [1.0, -1.0, 0.0, 0.0]])
#: Distance in element lengths below which a point counts as lying on a node.
_ON_NODE = 1e-9


@dataclass(frozen=True)
class Cable:
    """A uniform cable along x from 0 to `length`, pinned at 0."""

    length: float  # m
    axial_stiffness: float  # EA, N
    bending_stiffness: float  # EI, N m^2
    mass_per_length: float  # rho A, kg/m
    elements: int  # all of the same length

    @property
    def element_length(self) -> float:
        """Length of each element, m."""
        return self.length / self.elements

    def left_elements(self, x: Array) -> NDArray[np.int64]:
        """Numbers (o,) of the elements that hold the material points x (o,) in m, the left one at a node."""
        return np.clip(np.ceil(x / self.element_length - _ON_NODE).astype(int) - 1, 0, self.elements - 1)

    def right_elements(self, x: Array) -> NDArray[np.int64]:
        """Number of the element at x, the right one at a node."""
        return np.clip(np.floor(x / self.element_length + _ON_NODE).astype(int), 0, self.elements - 1)


def values(cable: Cable, q: Array, x: Array) -> Array:
    """Displacements (T, o, 2) in m at the material points x (o,) in m; or velocities, from nodal velocities.

    q holds the coordinates (or velocities) of all nodes, (T, N, 4).
    """
    return _apply(_interpolation(cable, x, cable.left_elements(x), derivative=0), q)


def curvature(cable: Cable, q: Array, x: Array) -> Array:
    """Material curvature K (T, o) in 1/m at x (o,) in m: the mean of both sides where two elements meet."""
    left, right = (_curvature(cable, q, x, e) for e in (cable.left_elements(x), cable.right_elements(x)))
    return (left + right) / 2.0


def _curvature(cable: Cable, q: Array, x: Array, elements: NDArray[np.int64]) -> Array:
    slope = np.array([1.0, 0.0]) + _apply(_interpolation(cable, x, elements, derivative=1), q)
    bend = _apply(_interpolation(cable, x, elements, derivative=2), q)
    cross = slope[..., 0] * bend[..., 1] - slope[..., 1] * bend[..., 0]
    return np.asarray(cross / np.sum(slope**2, axis=-1))


def _interpolation(cable: Cable, x: Array, elements: NDArray[np.int64], derivative: int) -> Array:
    """Matrix (o, 2 N) from nodal values and slopes to a derivative at points x (o,) of `elements` (o,)."""
    h = cable.element_length
    matrix = np.zeros((len(x), 2 * (cable.elements + 1)))
    for j, shape in enumerate(_SHAPES):
        weights = np.polyval(np.polyder(shape, derivative), x / h - elements) / h**derivative
        matrix[np.arange(len(x)), 2 * elements + j] = weights * (h if j % 2 else 1.0)
    return matrix


def _apply(matrix: Array, q: Array) -> Array:
    """(T, o, 2) from nodal coordinates q (T, N, 4)."""
    steps, nodes, _ = q.shape
    return np.einsum("on,tnc->toc", matrix, q.reshape(steps, 2 * nodes, 2), optimize=True)
