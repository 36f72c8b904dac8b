"""Axes of coordinates in a deck of Abaqus: those of `*SYSTEM`, cylindrical ones, and places of instances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pmr.files.arrays import Array
from pmr.files.cards import Card, DataLine

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Axes:
    """Origin (3,) in m of rectangular axes, and a matrix R (3, 3) whose columns are the axes."""

    origin: Array
    R: Array


def read_axes(card: Card) -> Axes | None:
    """Return the axes of a card `*SYSTEM`; None if it has no data, which stands for the axes of the whole.

    The first line has the origin a and a point b on the x axis, the second one a point c in the xy plane.  Without c
    the axes are turned about z; without b they are moved alone.  Raises InputError for points on a line.
    """
    numbers = [number for line in card.lines for number in _numbers(line, 6)]
    if not numbers:
        return None
    first = card.lines[0].place
    if len(numbers) not in (3, 6, 9):
        raise first.error("three coordinates of each of one to three points are allowed")
    a, *further = np.array(numbers).reshape(-1, 3)
    if not further:
        return Axes(a, np.eye(3))
    x = further[0] - a
    across = further[1] - a if len(further) > 1 else np.cross([0.0, 0.0, 1.0], x)
    z = np.cross(x, across)
    size = np.linalg.norm(x) * np.linalg.norm(across)
    if not np.linalg.norm(z) > 1e-9 * size > 0.0:
        raise first.error("three points that are not on a line are allowed")
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return Axes(a, np.stack([x, np.cross(z, x), z], axis=1))


def rectangular(card: Card, axes: Axes | None, coordinates: Sequence[float]) -> Point:
    """Return the place in the axes of the whole of a node with `coordinates` (3,) on a card `*NODE`.

    They are x, y, z, or with ``SYSTEM=C`` radius, angle in degrees and z, in the axes of `*SYSTEM`.
    """
    system = card.options.get("SYSTEM", "R").upper()
    if system not in ("R", "C"):
        raise card.place.error(f"SYSTEM={system} is not read; rectangular (R) and cylindrical (C) are allowed")
    x, y, z = coordinates
    if system == "C":
        angle = np.deg2rad(y)
        x, y = x * float(np.cos(angle)), x * float(np.sin(angle))
    if axes is not None:
        x, y, z = (axes.origin + axes.R @ [x, y, z]).tolist()
    return x, y, z


def move_instance(card: Card, points: Sequence[Point]) -> list[Point]:
    """Return nodes (N,) of an instance in its place, from their places in its part.

    The first line of its card has a translation.  The second one has two points on an axis and an angle in degrees by
    which the nodes are turned about it after they were moved.
    """
    if not points:
        return []
    places = np.array(points)
    if len(card.lines) > 2:
        raise card.lines[2].place.error("a line with the translation and one with the rotation are allowed")
    for line, count in zip(card.lines, (3, 7), strict=False):
        numbers = [*_numbers(line, count), *[0.0] * count][:count]
        if count == 3:
            places = places + numbers
            continue
        a, b, angle = np.array(numbers[:3]), np.array(numbers[3:6]), numbers[6]
        length = float(np.linalg.norm(b - a))
        if angle and not length > 0.0:
            raise line.place.error("two points on the axis of rotation, which differ, and an angle are allowed")
        if angle:
            places = a + Rotation.from_rotvec(np.deg2rad(angle) * (b - a) / length).apply(places - a)
    return [(x, y, z) for x, y, z in places.tolist()]


def _numbers(line: DataLine, most: int) -> list[float]:
    """Return the numbers of a line of data, at most `most` of them; an empty field in between is 0."""
    fields = list(line.fields)
    while fields and not fields[-1]:
        fields.pop()
    try:
        numbers = [float(field.upper().replace("D", "E") or "0") for field in fields]
    except ValueError:
        numbers = [np.nan]
    if len(numbers) > most or not np.isfinite(numbers).all():
        raise line.place.error(f"at most {most} numbers are allowed")
    return numbers
