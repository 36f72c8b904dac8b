r"""The mass of transverse plates within a box, spread over the elements of its beam.

With the outline of a plane figure counter-clockwise, its normal n outwards and p from the axis,

.. math:: A = \frac12 \oint p \cdot n\, ds, \qquad \int p\, dA = \frac13 \oint p\, (p \cdot n)\, ds, \qquad
    \int p\, p^T dA = \frac14 \oint p\, p^T (p \cdot n)\, ds

a ring is the figure of the walls' middle without the one as far inside as it is deep.  A plate's mass goes to the two
elements whose middles it is between, so that its sum and its centre are exact; before the first middle and behind the
last one to the element there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmr.mesh.sides import ends_of
from pmr.models.profile_section import POINTS, WEIGHTS, normals, points_along
from pmr.scene.box import Box
from pmr.scene.plates import Side

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Plane:
    """Integrals over a plane figure about the axis: of 1, of p and of p p^T."""

    area: float  # m^2
    first: Array  # (2,) m^3
    second: Array  # (2, 2) m^4

    def less(self, other: Plane) -> Plane:
        """Subtract another plane figure."""
        return Plane(self.area - other.area, self.first - other.first, self.second - other.second)


@dataclass(frozen=True)
class RingMasses:
    """Areas that plates add to each of E elements, spread over its length."""

    ends: Array  # (E + 1,) m
    area: Array  # (E,) m^2
    first: Array  # (E, 2) m^3, about the axis
    second: Array  # (E, 2, 2) m^4

    def at(self, places: Array) -> RingMasses:
        """Areas of elements with their middles at these places (e,) m."""
        number = np.clip(np.searchsorted(self.ends, places) - 1, 0, len(self.area) - 1)
        return replace(self, area=self.area[number], first=self.first[number], second=self.second[number])

    @cached_property
    def centroid(self) -> Array:
        """(E, 2) m; the axis where nothing is added."""
        return self.first / np.where(self.area > 0.0, self.area, 1.0)[:, None]

    @cached_property
    def about_centroid(self) -> Array:
        """Second moments, (E, 2, 2) m^4."""
        return self.second - self.area[:, None, None] * np.einsum("ei,ej->eij", self.centroid, self.centroid)


def ring_masses(box: Box, stations: Array) -> RingMasses:
    """Areas that a box's frames add to elements with these ends (E + 1,) m."""
    h, middles = np.diff(stations), (stations[1:] + stations[:-1]) / 2.0
    area, first, second = np.zeros(len(h)), np.zeros((len(h), 2)), np.zeros((len(h), 2, 2))
    for x in box.frames:
        sides = box.profile_at(x).sides
        plate = enclosed_figure(sides)
        if box.frame_depth != "full":
            plate = plate.less(enclosed_figure(inset(sides, box.frame_depth)))
        k = int(np.clip(np.searchsorted(middles, x), 1, len(h) - 1)) if len(h) > 1 else 0
        share = np.clip((middles[k] - x) / (middles[k] - middles[k - 1]), 0.0, 1.0) if k else 0.0
        for e, share_of_element in ((k - 1, share), (k, 1.0 - share)):
            by = share_of_element * box.plate / h[e]
            area[e] += by * plate.area
            first[e] += by * plate.first
            second[e] += by * plate.second
    return RingMasses(stations, area, first, second)


def inset(sides: tuple[Side, ...], depth: float) -> tuple[Side, ...]:
    """Move the sides of a profile so far inside, m."""
    inner_sides = []
    for k, side in enumerate(sides):
        a, b = ends_of(sides, k, lambda _: -depth)
        inner_sides.append(replace(side, start=(float(a[0]), float(a[1])), end=(float(b[0]), float(b[1]))))
    return tuple(inner_sides)


def enclosed_figure(sides: tuple[Side, ...]) -> Plane:
    """Area and moments of the figure that a profile encloses."""
    area, first, second = 0.0, np.zeros(2), np.zeros((2, 2))
    for side in sides:
        p = points_along(side, POINTS)
        weights = WEIGHTS * side.length * np.sum(p * normals(side, POINTS), axis=1)
        area += float(weights.sum()) / 2.0
        first += weights @ p / 3.0
        second += np.einsum("q,qi,qj->ij", weights, p, p) / 4.0
    return Plane(area, first, second)
