r"""The ground below a boom's machine: masses of the machine, and outriggers or wheels that push on the ground.

The axes are those of the machine: X points where the boom points at a slewing angle of 0, Y to its left, and Z at a
right angle to the ground.  The ground rises along X by the first angle of `slope`, and along Y, once the machine is
turned about Y by that, by the second.  So roll and pitch of the machine are :math:`r_x = slope_2`, :math:`r_y =
-slope_1` (`pmr.scene.frame`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from pmr.scene.keys import (
    Distance,
    Mass,
    Name,
    Place,
    Point,
    Quantity,
    SceneTable,
    Stiffness,
    Switch,
    Text,
    Usual,
    key_error,
)
from pmr.scene.structures import BodyMoments

Corner = tuple[Place, Place]
#: Usual up to 0.3 rad or 17 degrees.
Slope = Annotated[
    float,
    Field(strict=True),
    Quantity("frame.unit", -90.0, 90.0),
    Usual(0.0, 0.3, "rad", "rad"),
    Usual(0.0, 17.0, "degrees", "degrees"),
]
#: As many as the kernel takes (`PMR_MOST_OUTRIGGERS` in src/pmr_kernel.h).
MOST_OUTRIGGERS = 32
#: Outriggers are on one line if the area of their polygon is below this share of the square of its length.
FLAT = 1e-9


class MachineMass(SceneTable):
    """A mass of the machine below the boom."""

    name: Text = Field(min_length=1, description="Name of the mass, for the report")
    mass: Annotated[Mass, Usual(0.02, 1e6, "boom")] = Field(gt=0.0, description="Mass")
    at: Annotated[Point, Usual(0.0, 3.0, "reach")] = Field(
        description="Position of its centre from the pivot: X where the boom points unslewed, Y to its left, Z up"
    )
    slews: Switch = Field(default=False, description="Whether it turns with the boom, as a counterweight does")
    inertia: BodyMoments = Field(
        default=(0.0, 0.0, 0.0), description="About its centre of mass, about X, Y and Z, which slew with it"
    )


class Outrigger(SceneTable):
    """An outrigger or a wheel, which pushes on the ground and lifts off where it would have to pull."""

    name: Name = Field(description="Name of the outrigger, in results and messages")
    at: Annotated[Corner, Usual(0.0, 3.0, "reach")] = Field(description="Position X, Y on the ground, from the pivot")
    stiffness: Stiffness = Field(
        default=1e8, description="Stiffness of outrigger and ground; only ratios of stiffnesses matter"
    )


class Ground(SceneTable):
    """Ground that carries the machine by outriggers or wheels, whose forces follow from those of boom and machine."""

    height: Annotated[Distance, Usual(0.0, 3.0, "reach")] = Field(
        default=0.0, description="Height of the pivot above it"
    )
    slope: tuple[Slope, Slope] = Field(
        default=(0.0, 0.0), description="Angles by which it rises along X and along Y of the machine, in frame.unit"
    )
    masses: tuple[MachineMass, ...] = Field(default=(), description="Masses of the machine below the boom")
    outriggers: tuple[Outrigger, ...] = Field(description="Outriggers or wheels, at least three of them")

    @model_validator(mode="after")
    def _check_outriggers(self) -> Self:
        """Refuse fewer than three outriggers or too many of them, outriggers on one line, and repeated names or places.

        Names of the machine's masses must not repeat either.
        """
        for key in ("masses", "outriggers"):
            names = [part.name for part in getattr(self, key)]
            if twice := next((name for name in names if names.count(name) > 1), None):
                raise key_error(f"{key}.name", twice, "a name of its own is allowed for each")
        corners = [outrigger.at for outrigger in self.outriggers]
        if len(corners) < 3:
            raise key_error("outriggers", len(corners), "three or more are allowed")
        if len(corners) > MOST_OUTRIGGERS:
            raise key_error("outriggers", len(corners), f"at most {MOST_OUTRIGGERS} are allowed")
        extent = float(np.ptp(np.array(corners), axis=0).max())
        if abs(polygon_area(convex_hull(corners))) <= FLAT * extent**2:
            raise key_error("outriggers", None, "places that are not on one line are allowed")
        if len(set(corners)) < len(corners):
            twice_at = next(corner for corner in corners if corners.count(corner) > 1)
            raise key_error("outriggers.at", list(twice_at), "a place of its own is allowed for each")
        return self

    @cached_property
    def corners(self) -> tuple[Outrigger, ...]:
        """The outriggers at the corners of the support polygon, anticlockwise."""
        at_place = {outrigger.at: outrigger for outrigger in self.outriggers}
        return tuple(at_place[corner] for corner in convex_hull(list(at_place)))

    @property
    def corner_numbers(self) -> list[int]:
        """Numbers of the outriggers at the corners of the support polygon, anticlockwise, from 0 in their order."""
        names = [outrigger.name for outrigger in self.outriggers]
        return [names.index(corner.name) for corner in self.corners]

    @cached_property
    def polygon(self) -> tuple[Corner, ...]:
        """Corners X, Y of the support polygon in m from the pivot, anticlockwise."""
        return tuple(corner.at for corner in self.corners)


def convex_hull(points: Sequence[Corner]) -> list[Corner]:
    """Return the corners of the convex hull of points X, Y, anticlockwise from the leftmost.

    Points on the edges of the hull are no corners, and equal points are one.
    """

    def half(ordered: Sequence[Corner]) -> list[Corner]:
        """Return the hull's corners on the right of the way through the `ordered` points, without the last corner."""
        chain = list[Corner]()
        for point in ordered:
            while len(chain) > 1 and polygon_area((chain[-2], chain[-1], point)) <= 0.0:
                chain.pop()
            chain.append(point)
        return chain[:-1]

    ordered = sorted(set(points))
    return half(ordered) + half(ordered[::-1])


def polygon_area(polygon: ArrayLike) -> float:
    """Return the signed area in m^2 of a polygon (k, 2) in m, positive if its corners X, Y run anticlockwise."""
    x, y = np.asarray(polygon, float).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0


def edge_rows(polygon: ArrayLike, height: float) -> NDArray[np.float64]:
    """Return rows (e, 6), one for each of e edges of a polygon, that give the moment of a force about the edge.

    The moment is the product of the row with the force and its moment about the pivot (6,).  The corners of `polygon`
    are X and Y in m from the pivot, in either direction.  Edges run anticlockwise; the first one begins at the first
    corner, or at the last one if the corners run clockwise.  The pivot is `height` in m above the corners.  A positive
    moment tips the machine over the edge.
    """
    corners = np.insert(np.asarray(polygon, float), 2, -height, axis=1)
    if polygon_area(polygon) < 0.0:
        corners = corners[::-1]
    edges = np.roll(corners, -1, axis=0) - corners
    edges /= np.linalg.norm(edges, axis=1)[:, None]
    return np.hstack([-np.cross(edges, corners), edges])
