"""Pictures of a body: at a few extensions, close to the largest stress, and its mesh."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.report.blocks import Picture
from pmr.report.motion.instants import Moment, cell_of_the_peak, instants, of_the_peak, scale, stress_of, top
from pmr.report.motion.renderer import NoPictureError, Piece, Shot, develop, framed
from pmr.report.motion.surface import Surface, surface
from pmr.report.motion.surroundings import Block, stage
from pmr.report.numbers import SPACE, plain, quantity
from pmr.results import Fields, RunResult

Array = NDArray[np.float64]

WIDTH = 1500  # px
SIDE = (0.34, -0.88, 0.30)  # from where the body is seen
NEAR = 1.0  # m that a close picture shows from bottom to top
STEEL, PAD, MOVING, SECTION = "#b9c4cd", "#3b4a57", "#d55e00", "#9fb0bd"


@dataclass(frozen=True)
class Album:
    """The pictures of a case, or in a clause why there are none."""

    pictures: tuple[Picture, ...] = ()
    absent: str = ""


def album(result: RunResult, prefix: str) -> Album:
    """Make the pictures; without fields there are none, and nothing is said."""
    fields = result.body.fields
    if fields is None:
        return Album()
    planned = list(_Views(result, fields).shots())
    try:
        developed = develop([shot for _, shot, _ in planned])
    except NoPictureError as error:
        return Album(absent=str(error))
    return Album(
        tuple(
            Picture(f"{prefix}-{name}", *shot.size, base64.b64encode(data).decode(), caption)
            for (name, shot, caption), data in zip(planned, developed, strict=True)
        )
    )


class _Views:
    """What the pictures of a case share: a body's surface, what stands around it, colours and scale."""

    def __init__(self, result: RunResult, fields: Fields) -> None:
        self.result, self.fields = result, fields
        self.body: Surface = surface(fields, result.scene.body.box)
        self.stage = stage(result, self.body)
        self.scale = scale(result, fields)
        self.limits = (0.0, top(fields) / 1e6 if fields.von_mises else 1.0)

    def shots(self) -> Iterator[tuple[str, Shot, str]]:
        """Names, pictures and captions."""
        chosen = instants(self.result, self.fields)
        views = [Shot((*self._body(m), *self._surroundings(m)), SIDE, self.limits) for m in chosen]
        for number, (moment, shot) in enumerate(zip(chosen, framed(views, WIDTH), strict=True), start=1):
            yield f"view-{number}", shot, self._caption(moment)
        if self.fields.von_mises:
            yield self._close(of_the_peak(self.result, self.fields, chosen))
        yield self._mesh()

    def _body(self, moment: Moment, edges: float = 0.6) -> tuple[Piece, ...]:
        """The body at a moment, displaced by `scale` times as much, in colours of its stress in MPa."""
        moved = self.body.moved(self.fields, self.fields.displacement[moment.frame])
        points = self.body.points + self.scale * moved - (moment.s, 0.0, 0.0)
        values = stress_of(self.fields)[moment.frame, self.body.cell] / 1e6 if self.fields.von_mises else None
        return (Piece(points, self.body.faces, values, STEEL, edges=edges),)

    def _surroundings(self, moment: Moment, opacity: float = 0.22) -> Iterator[Piece]:
        back = np.array([moment.s, 0.0, 0.0])
        yield from (_piece(block, PAD) for block in self.stage.near)
        yield from (_piece(block, PAD, back) for block in self.stage.tail)
        yield replace(_piece(self.stage.section, SECTION), opacity=opacity, edges=1.0)

    def _close(self, moment: Moment) -> tuple[str, Shot, str]:
        """The neighbourhood of the cell with the largest stress, from the side that it is on."""
        cell = cell_of_the_peak(self.result, self.fields, moment)
        place = self.fields.points[self.fields.cells[cell]].mean(axis=0)
        low, high = self.body.points.min(axis=0), self.body.points.max(axis=0)
        middle = (low + high) / 2.0
        left, above = place[1] > high[1] - 0.05 * (high[1] - low[1]), place[2] >= middle[2]
        direction = (SIDE[0], -SIDE[1] if left else SIDE[1], 0.45 if above else -0.45)
        pieces = (*self._body(moment, edges=0.8), *self._surroundings(moment, opacity=0.08))
        centre = (float(place[0]) - moment.s, float(middle[1]), float(middle[2]))
        shot = Shot(pieces, direction, self.limits, centre, NEAR, (WIDTH, WIDTH * 3 // 8))
        seen = f"seen from {'above' if above else 'below'} at {moment.t:.2f}{SPACE}s"
        return "close", shot, f"The neighbourhood of the largest stress, {seen}; displacements as above."

    def _mesh(self) -> tuple[str, Shot, str]:
        at = float(self.result.along[0])
        tail = tuple(_piece(block, PAD) for block in self.stage.tail)
        near = tuple(_piece(block, MOVING, np.array([-at, 0.0, 0.0])) for block in self.stage.near)
        body = Piece(self.body.points, self.body.faces, None, "#eef2f5", edges=0.9)
        (shot,) = framed([Shot((body, *tail, *near), SIDE)], WIDTH)
        count = f"{plain(len(self.fields.cells))} cells, {plain(len(self.fields.points))} vertices"
        where = f"grey the pads that stay on the body, orange those that move along it, at s = {plain(round(at, 3))}"
        return "mesh", shot, f"The mesh: {count}; {where}{SPACE}m."

    def _caption(self, moment: Moment) -> str:
        deformed = f"displacements {plain(self.scale)} times their size"
        stress = f", largest von Mises stress {quantity(moment.peak, 'Pa')}" if self.fields.von_mises else ""
        out = f"{moment.extension:.2f}{SPACE}m beyond the mouth"
        return f"{out}, at {moment.t:.2f}{SPACE}s{stress}; {deformed}."


def _piece(block: Block, colour: str, back: Array | None = None) -> Piece:
    return Piece(block.corners - (0.0 if back is None else back), block.sides, None, colour)
