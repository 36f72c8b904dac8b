"""A boom in its true position in space: axes of its bodies, and the way of its tip, from the pivot, Z upwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.report.columns import lines
from pmr.report.subject import length
from pmr.results import RunResult

Array = NDArray[np.float64]


#: Moments at which a boom is drawn, evenly along the way of its tip.
MOMENTS = 4


@dataclass(frozen=True)
class Axis:
    """The axis of a body at S times, (S, n, 2) m from the pivot.

    `side` has the distance in the plane of luffing and the height, `plan` the places as seen from above.
    """

    body: str
    side: Array
    plan: Array


def axes(result: RunResult, steps: Sequence[int] | NDArray[np.intp], scale: float = 1.0) -> list[Axis]:
    """Of all bodies from the base out, by the reduced model; deflections are `scale` times as large."""
    frame, response = result.scene.frame, result.responses["reduced"]
    assert frame is not None  # of those who ask
    chosen, aside = np.asarray(steps), {one.body: one for one in lines(result, response, "y")}
    rotation, found = frame.rotation(response.t[chosen]), []
    sine, cosine = rotation[:, 2, 0, None], rotation[:, 2, 2, None]  # of luffing
    for line in lines(result, response):
        own = np.zeros((len(chosen), len(line.x), 3)) + frame.place
        own[:, :, 0] += line.tail[chosen, None] + line.x
        for direction, of in ((1, aside.get(line.body)), (2, line)):
            if of is not None:
                own[:, :, direction] += scale * response.displacement[np.ix_(chosen, of.columns)]
        places = np.einsum("sij,snj->sni", rotation, own)
        side = np.stack([cosine * own[:, :, 0] - sine * own[:, :, 2], places[:, :, 2]], axis=-1)
        found.append(Axis(line.body, side, places[:, :, :2]))
    return found


def moments(result: RunResult) -> NDArray[np.intp]:
    """Steps at which the boom is drawn: evenly along the way of its tip, with both ends; one where it rests."""
    frame, t = result.scene.frame, result.responses["reduced"].t
    assert frame is not None
    straight = frame.rotation(t)[:, :, 0] * _out(result)[:, None]
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(straight, axis=0), axis=1)))
    if way[-1] <= 1e-9 * length(result):
        return np.array([0])
    return np.unique(np.searchsorted(way, np.linspace(0.0, way[-1] * (1.0 - 1e-9), MOMENTS)))


def _out(result: RunResult) -> Array:
    """How far the tip is along the boom, (T,) m."""
    if result.reach is not None:
        return result.along_at(result.responses["reduced"].t)
    return np.full(len(result.responses["reduced"].t), length(result))


def slews(result: RunResult) -> bool:
    """Whether the boom is turned about the vertical, so that it is to be seen from above."""
    angle = result.summary.get("frame", {}).get("slewing", {"min": 0.0, "max": 0.0})
    return bool(angle["max"] > angle["min"])
