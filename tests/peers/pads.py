"""Pads on 8-node rectangles, from the definition in docs/pads.md alone, without `pmr`."""

from dataclasses import dataclass

import numpy as np

STATIONS = 10  # steps of the lattice over a pad's length


@dataclass(frozen=True)
class Patch:
    """Weight of a pad on a face normal to y or z, with its centre along x and across in m.

    `normal` is 1 or 2, `place` the coordinate of the face in m, and `lattice` a point along x of the pad's lattice in
    m.
    """

    normal: int
    place: float
    along: float
    across: float
    lattice: float
    length: float = 0.3
    width: float = 0.08

    def shares(self, points: np.ndarray, quads: np.ndarray) -> np.ndarray:
        """Shares of each node (N,) in the weighted mean of the normal displacement; they add up to one."""
        beside = 3 - self.normal
        face = quads[np.all(np.abs(points[quads, self.normal] - self.place) < 1e-9, axis=1)]
        total = np.zeros(len(points))
        for quad in face:
            corners = points[quad[[0, 1, 3]]][:, [0, beside]]
            x, wx = _gauss(self._stations(), *sorted(corners[:2, 0]))
            y, wy = _gauss(self._knots(), *sorted(corners[::2, 1]))
            if len(x) and len(y):
                r, s = np.meshgrid(
                    (x - corners[0, 0]) / (corners[1, 0] - corners[0, 0]),
                    (y - corners[0, 1]) / (corners[2, 1] - corners[0, 1]),
                    indexing="ij",
                )
                weight = np.outer(wx * self._weight_along(x), wy * _spline((y - self.across) / (self.width / 4.0)))
                total[quad] += np.einsum("aij,ij->a", _shapes(2.0 * r - 1.0, 2.0 * s - 1.0), weight)
        return total / total.sum()

    def _stations(self) -> np.ndarray:
        """Stations along x between which the weight is linear."""
        step = self.length / STATIONS
        first = np.ceil((self.along - self.length / 2.0 - self.lattice) / step - 1e-9)
        return self.lattice + step * (first + np.arange(-1, STATIONS + 2))

    def _knots(self) -> np.ndarray:
        """Knots of the weight across the pad."""
        return self.across + self.width / 4.0 * np.arange(-2, 3)

    def _weight_along(self, x: np.ndarray) -> np.ndarray:
        """Weight along the pad: the cubic spline at the stations, linear between these."""
        stations = self._stations()
        return np.interp(x, stations, _spline((stations - self.along) / (2.0 * self.length / STATIONS)))


def _spline(t: np.ndarray) -> np.ndarray:
    """Cubic B-spline with knots -2, -1, 0, 1, 2."""
    t = np.abs(t)
    return np.where(t < 1.0, 2.0 / 3.0 - t**2 + t**3 / 2.0, np.maximum(2.0 - t, 0.0) ** 3 / 6.0)


def _gauss(breaks: np.ndarray, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights of Gauss between `low` and `high`, exact up to degree 7 between two breaks."""
    edges = np.unique(np.clip(breaks, low, high))
    t, w = np.polynomial.legendre.leggauss(4)
    half = np.diff(edges)[:, None] / 2.0
    return ((edges[:-1, None] + half) + half * t).ravel(), (half * w).ravel()


def _shapes(r: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Quadratic shape functions (8, ...) of a rectangle, r and s from -1 to 1, in the order of `calculix.grid`."""
    corners = [(1 + a * r) * (1 + b * s) * (a * r + b * s - 1) / 4 for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    middles = [(1 - r**2) * (1 - s) / 2, (1 + r) * (1 - s**2) / 2, (1 - r**2) * (1 + s) / 2, (1 - r) * (1 - s**2) / 2]
    return np.stack([*corners, *middles])
