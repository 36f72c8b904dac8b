r"""From a box that is drawn with one profile all along to one that tapers: points keep their places in the section.

A point in side k, at the share xi along it and at the depth eta inside, which is 0 on walls and up to 1 on frames, goes
where these are in the profile at its place along the axis:

.. math:: p = (1 - \eta)\, a_k(\xi) + \eta\, b_k(\xi)

with the middle of the wall, a, and the same as far inside as frames are deep, b.  Both change linearly along the axis.
On plates that close the section what is not on walls keeps its place in the triangle of the axis and a side.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pmr.mesh.sides import Part, Side, ends_of

Array = NDArray[np.float64]

#: Round-off of the drawing, as a share of a side.
SLACK = 1e-6
#: Of a wall without frames, likewise: so near to its middle its points are.
THIN = 1e-6


def taper_points(points: Array, sides: Sequence[Side], parts: Sequence[Part], depth: float) -> Array:
    """Points (N, 3) m that were drawn with these sides, and frames that deep, where the parts have them."""
    tapered_points, unplaced, depth = points.copy(), np.ones(len(points), bool), depth if np.isfinite(depth) else 0.0
    for place in (_in_side, _in_triangle):
        for k in range(len(sides)):
            first_share, second_share, within = place(points[:, 1:], sides, k, depth)
            placed = unplaced & within
            unplaced &= ~placed
            for part in parts:
                rows = np.flatnonzero(placed & (points[:, 0] >= part.start) & (points[:, 0] <= part.end))
                if part.tapers and len(rows):
                    share = (points[rows, 0] - part.start)[:, None] / (part.end - part.start)
                    at = _side_points if place is _in_side else _at_in_triangle
                    first, last = (
                        at(first_share[rows], second_share[rows], each, k, depth) for each in (part.first, part.last)
                    )
                    tapered_points[rows, 1:] = (1.0 - share) * first + share * last
    return tapered_points


Places = tuple[Array, Array, NDArray[np.bool_]]


def _in_side(p: Array, sides: Sequence[Side], k: int, depth: float) -> Places:
    """Share along a side and depth inside, and whether both are within it."""
    xi, eta = _side_shares(p, sides, k, depth)
    return xi, eta, (np.abs(xi - 0.5) <= 0.5 + SLACK) & (np.abs(eta - 0.5) <= 0.5 + SLACK)


def _in_triangle(p: Array, sides: Sequence[Side], k: int, depth: float) -> Places:
    """Shares of both ends of a side, and whether the point is on the side's side of the axis."""
    first_share, second_share = np.linalg.solve(np.array([sides[k].start, sides[k].end]).T, p.T)
    return first_share, second_share, (first_share >= -SLACK) & (second_share >= -SLACK)


def _at_in_triangle(first_share: Array, second_share: Array, sides: Sequence[Side], k: int, depth: float) -> Array:
    return np.outer(first_share, sides[k].start) + np.outer(second_share, sides[k].end)


def _side_shares(p: Array, sides: Sequence[Side], k: int, depth: float) -> tuple[Array, Array]:
    """Share along a side, and depth inside, of points (N, 2) m; of those outside of it not within 0 and 1."""
    side = sides[k]
    scale = depth or THIN * side.length
    if side.centre is not None:
        arm, start = p - side.centre, np.subtract(side.start, side.centre)
        radius, angle = np.hypot(*start), np.arctan2(arm[:, 1], arm[:, 0]) - np.arctan2(start[1], start[0])
        angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
        return angle / side.angle, (radius - np.hypot(*arm.T)) / scale
    (a, b), (c, d) = ends_of(sides, k, lambda _: 0.0), ends_of(sides, k, lambda _: -scale)
    along = (b - a) / np.linalg.norm(b - a)
    eta = (p - a) @ [-along[1], along[0]] / scale
    start, end = (np.outer(1.0 - eta, outer) + np.outer(eta, inner) for outer, inner in ((a, c), (b, d)))
    return (p - start) @ along / np.maximum((end - start) @ along, SLACK * side.length), eta


def _side_points(xi: Array, eta: Array, sides: Sequence[Side], k: int, depth: float) -> Array:
    """Places (N, 2) m of shares along a side and depths inside."""
    side = sides[k]
    if side.centre is not None:
        start = np.subtract(side.start, side.centre)
        angle, r = np.arctan2(start[1], start[0]) + xi * side.angle, np.hypot(*start) - eta * depth
        return np.asarray(side.centre + r[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    (a, b), (c, d) = ends_of(sides, k, lambda _: 0.0), ends_of(sides, k, lambda _: -depth)
    start, end = (np.outer(1.0 - eta, outer) + np.outer(eta, inner) for outer, inner in ((a, c), (b, d)))
    return np.asarray((1.0 - xi)[:, None] * start + xi[:, None] * end)
