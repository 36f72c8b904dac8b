r"""The profile of a boom: flat plates around a closed cell, and the arcs of rounded corners between them.

Dimensions are those of the mid-surface.  Seen from the tip y points to the right and z up; one walks around
counter-clockwise, from the bottom.  A rectangle loses what a chamfer cuts off its corners, y along and z up, which
leaves slanted plates::

                  top
               __________
    top right /          \ top left         y = -width/2 is the right, y = width/2 the left
             |            |
       right |            | left
             |            |
              \__________/
    bottom right  bottom   bottom left

Places across a face count from where it is nearest to the axis, y = z = 0: along y on bottom and top, along z on left
and right, upwards on slanted faces.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from pmr.scene.plates import FACES, Corner, Edge, Face, Half, Pair, Side, corners_of, sides_of
from pmr.scene.refusals import of_key
from pmr.scene.section import Distance, Length, Section, Thickness, Usual

WallName = Literal["sides", Face]
Cut = tuple[Distance, Distance]
CORNERS = "corners"
#: Lengths that are less, as a share of the larger of width and height, are none.
NOTHING = 1e-9


class BoxProfile(Section):
    """A closed profile of plates, by the dimensions of its mid-surface; width along y, height along z."""

    width: Annotated[Length, Usual(0.002, 10.0)] = Field(description="Width along y")
    height: Annotated[Length, Usual(0.002, 10.0)] = Field(description="Height along z")
    wall: Thickness | dict[WallName, Thickness] = Field(
        description="Thickness of the walls: one for all, or by face. `bottom` and `top` include their slanted plates "
        "and rounded corners, `sides` are left and right, in m"
    )
    radius: Annotated[Distance | dict[Half, Distance], Usual(0.0, 5.0)] = Field(
        default=0.0, description="Radius of the corners: one for all, or by `bottom` and `top`, in m"
    )
    chamfer: Annotated[Distance | Cut | dict[Half, Distance | Cut], Usual(0.0, 5.0)] = Field(
        default=0.0,
        description="Size of the chamfers, for all or by `bottom` and `top`: one number, or along y and z, in m",
    )

    @model_validator(mode="after")
    def _closes(self) -> BoxProfile:
        _check_chamfers(self)
        _check_walls(self)
        _check_radii(self)
        return self

    @property
    def edges(self) -> list[Edge]:
        """Faces as if all corners were sharp."""
        b, h = self.width / 2.0, self.height / 2.0
        (y0, z0), (y1, z1) = self.cut("bottom"), self.cut("top")
        right = [(-b + y1, h), (-b, h - z1), (-b, -h + z0)]
        ends = [np.array(p) for p in [(-b + y0, -h), (b - y0, -h), (b, -h + z0), (b, h - z1), (b - y1, h), *right]]
        alike, edges = self.thickness("bottom") == self.thickness("top"), list[Edge]()
        for face, start, end in zip(FACES, ends, [*ends[1:], ends[0]], strict=True):
            half: Half = "top" if start[1] > -self.negligible else "bottom"
            arc = CORNERS if alike else f"{half} {CORNERS}"
            edge = Edge(face, start, end, self.thickness(face), arc, self.radius_at(half), self.thickness(half))
            edges += [edge] * (edge.length > self.negligible)
        return edges

    @property
    def sides(self) -> tuple[Side, ...]:
        """Plates and arcs, around the profile."""
        return sides_of(self.edges, self.negligible)

    @property
    def faces(self) -> dict[str, Side]:
        """Flat plates, by their names."""
        return {side.name: side for side in self.sides if side.centre is None}

    @property
    def corners(self) -> tuple[Corner, ...]:
        """Corners of the plates, around the profile; rounded ones as if they were sharp."""
        return corners_of(self.edges)

    @property
    def walls(self) -> dict[str, float]:
        """Thickness in m by face, or of all."""
        each = {side.name: side.thickness for side in self.sides}
        return each if len(set(each.values())) > 1 else {"": next(iter(each.values()))}

    @property
    def negligible(self) -> float:
        """Length in m below which another length of the profile counts as zero."""
        return NOTHING * max(self.width, self.height)

    def thickness(self, face: str) -> float:
        """Thickness of the plate on a face, m; of bottom and top also that of rounded corners there."""
        if not isinstance(self.wall, dict):
            return self.wall
        by_name = {str(name): wall for name, wall in self.wall.items()}
        half = "sides" if face in ("left", "right") else face.split()[0]
        return by_name.get(face, by_name.get(half, 0.0))

    def radius_at(self, half: Half) -> float:
        """Radius of the corners at the bottom or at the top, m."""
        return self.radius.get(half, 0.0) if isinstance(self.radius, dict) else self.radius

    def cut(self, half: Half) -> Pair:
        """Off the corners at the bottom or at the top, along y and z, m."""
        cut = self.chamfer.get(half, 0.0) if isinstance(self.chamfer, dict) else self.chamfer
        return cut if isinstance(cut, tuple) else (cut, cut)


def _check_chamfers(profile: BoxProfile) -> None:
    cuts = profile.cut("bottom"), profile.cut("top")
    wide = any(bool(y) != bool(z) or y > profile.width / 2.0 + profile.negligible for y, z in cuts)
    if wide or sum(z for _, z in cuts) > profile.height + profile.negligible:
        allowed = (
            f"0 is allowed, or up to {profile.width / 2.0:g} m along y, half the width, and along z as much as leaves "
            f"bottom and top {profile.height:g} m together, the height"
        )
        raise of_key("chamfer", profile.chamfer, allowed)


def _check_walls(profile: BoxProfile) -> None:
    edges, half = profile.edges, min(profile.width, profile.height) / 2.0
    faces = [edge.face for edge in edges]
    if isinstance(profile.wall, dict):
        missing = [edge.face for edge in edges if not edge.thickness]
        strange = [name for name in profile.wall if name not in (*faces, "sides", "bottom", "top")]
        if missing or strange:
            allowed = f"the faces of this profile are allowed, and all of them needed: {', '.join(faces)}"
            raise of_key("wall", ", ".join(strange or missing), f"{allowed}; sides are left and right")
    if max(edge.thickness for edge in edges) >= half:
        raise of_key("wall", profile.wall, f"less than {half:g} m, half of width and height, is allowed")
    for k, edge in enumerate(edges):
        before, after = edges[k - 1], edges[(k + 1) % len(edges)]
        inside = edge.length - _mitre(edge, before, edge.turn(before)) - _mitre(edge, after, after.turn(edge))
        if inside <= profile.negligible:
            raise of_key("wall", profile.wall, f"thinner walls are allowed: {edge.face} has no room inside")


def _mitre(edge: Edge, other: Edge, angle: float) -> float:
    """Length that an edge lacks inside where it meets another one, m."""
    return float((other.thickness - edge.thickness * np.cos(angle)) / (2.0 * np.sin(angle)))


def _check_radii(profile: BoxProfile) -> None:
    """Arcs have an inside, and plates enough length for them."""
    edges = profile.edges
    for half in ("bottom", "top"):
        r, wall, most = profile.radius_at(half), profile.thickness(half), np.inf
        for k, edge in enumerate(edges):
            tangents, straight = 0.0, edge.length
            for after, before in ((edge, edges[k - 1]), (edges[(k + 1) % len(edges)], edge)):
                has_radius = not isinstance(profile.radius, dict) or (after.start[1] > -profile.negligible) == (
                    half == "top"
                )
                tangents += has_radius * np.tan(after.turn(before) / 2.0)
                straight -= 0.0 if has_radius else after.trim(before)
            most = min(most, max(straight, 0.0) / tangents) if tangents else most
        if r and not wall / 2.0 < r <= most + profile.negligible:
            allowed = f"0 is allowed, or more than {wall / 2.0:g} m, half the wall, and at most {most:g} m"
            raise of_key("radius", profile.radius, allowed)
