"""What stands around a body in a picture: its pads, and the next section that it slides in.

Pictures are in the next section's frame: the mouth stays at x = 0 and the body moves by -s along x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.report.motion.surface import Surface
from pmr.report.subject import is_alone
from pmr.results import RunResult
from pmr.results.pads import THICK, pad_corners
from pmr.scene.box import Box
from pmr.scene.built import PadRing

Array = NDArray[np.float64]

_CUBE = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_SIDES = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])


@dataclass(frozen=True)
class Block:
    """A box as drawn: its corners (8, 3) in m, and its sides (k, 4) as quadrilaterals."""

    corners: Array
    sides: NDArray[np.int64]


@dataclass(frozen=True)
class Stage:
    """The next section, pads at its mouth (`near`), which stay in the picture, and those that move with the body.

    Nothing around a boom, whose sections hold each other.
    """

    section: tuple[Block, ...]
    near: tuple[Block, ...]
    tail: tuple[Block, ...]


def stage(result: RunResult, body: Surface) -> Stage:
    """The surroundings of a body, at s = 0."""
    if not is_alone(result):
        return Stage((), (), ())
    low, high, box = body.points.min(axis=0), body.points.max(axis=0), result.scene.body.box
    rings_by_motion = {
        moving: [ring for ring in result.scene.pads if ring.moving is moving] for moving in (False, True)
    }
    near, tail = (
        tuple(block for ring in rings_by_motion[moving] for block in _pads(ring, low, high, box))
        for moving in (True, False)
    )
    ahead = max((ring.at + ring.length / 2.0 for ring in rings_by_motion[True]), default=0.1)
    start = np.array([low[0] - float(result.along.max()) - 0.1, *(low[1:] - 1.2 * THICK)])
    end = np.array([ahead, *(high[1:] + 1.2 * THICK)])
    return Stage((_block(start, end, _SIDES[2:]),), near, tail)


def _pads(ring: PadRing, low: Array, high: Array, box: Box | None) -> list[Block]:
    body = np.array([low, high])
    return [Block(pad_corners(ring, place, body, box, _CUBE + 0.5), _SIDES) for place in ring.places]


def _block(start: Array, end: Array, sides: NDArray[np.int64]) -> Block:
    return Block((start + end) / 2.0 + _CUBE * (end - start), sides)
