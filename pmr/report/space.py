"""A boom in its true position in space: axes of its bodies, and the way of its tip, from the pivot, Z upwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.report.columns import lines
from pmr.report.subject import length
from pmr.results import RunResult
from pmr.scene.frame import rotation

Array = NDArray[np.float64]


#: Moments at which a boom is drawn, evenly along the way of its tip.
MOMENTS = 4


@dataclass(frozen=True)
class Axis:
    """The axis of a body at S times, (S, n, 2) m from the pivot.

    `side` has the distance in the plane of luffing and the height, `plan` the places as seen from above, of places `x`
    (n,) m along it.
    """

    body: str
    x: Array
    side: Array
    plan: Array


def axes(result: RunResult, steps: Sequence[int] | NDArray[np.intp], scale: float = 1.0) -> list[Axis]:
    """Axes of all bodies from the base out, by the reduced model; deflections are `scale` times as large."""
    response, frame = result.responses["reduced"], result.scene.frame
    chosen, aside = np.asarray(steps), {line.body: line for line in lines(result, response, "y")}
    turned, axes_of_bodies = turns(result, response.t[chosen]), []
    sine, cosine = turned[:, 2, 0, None], turned[:, 2, 2, None]  # of luffing
    for line in lines(result, response):
        places_in_boom = np.zeros((len(chosen), len(line.x), 3)) + (0.0 if frame is None else frame.place)
        places_in_boom[:, :, 0] += line.tail[chosen, None] + line.x
        for direction, of in ((1, aside.get(line.body)), (2, line)):
            if of is not None:
                places_in_boom[:, :, direction] += scale * response.displacement[np.ix_(chosen, of.columns)]
        places = np.einsum("sij,snj->sni", turned, places_in_boom)
        side = np.stack([cosine * places_in_boom[:, :, 0] - sine * places_in_boom[:, :, 2], places[:, :, 2]], axis=-1)
        axes_of_bodies.append(Axis(line.body, line.x, side, places[:, :, :2]))
    return axes_of_bodies


def turns(result: RunResult, t: Array) -> Array:
    """From the boom's axes into those of the ground, (T, 3, 3): by its frame, or as far as its weight has it raised."""
    if result.scene.frame is not None:
        return result.scene.frame.rotation(t)
    gravity = result.scene.gravity
    raised = np.full(len(t), 0.0 if gravity is None else np.deg2rad(gravity.raised))
    return rotation(raised, np.zeros(len(t)))


def moments(result: RunResult) -> NDArray[np.intp]:
    """Steps at which the boom is drawn: evenly along the way of its tip, with both ends; one where it rests.

    A boom at a constant angle stands at one moment alone, for shorter ones would lie on top of it. The moment of the
    largest stress is among them, in place of the one next to it.
    """
    t, out, worst = result.responses["reduced"].t, _out(result), largest_stress(result)
    turned = turns(result, t)
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(turned[:, :, 0] * out[:, None], axis=0), axis=1)))
    if way[-1] <= 1e-9 * length(result):
        steps = np.array([0])
    elif np.ptp(turned, axis=0).max() == 0.0:
        steps = np.array([int(np.argmax(out))])
    else:
        steps = np.unique(np.searchsorted(way, np.linspace(0.0, way[-1] * (1.0 - 1e-9), MOMENTS)))
    if worst is not None:
        steps[np.argmin(np.abs(way[steps] - way[worst.step]))] = worst.step
    return steps


@dataclass(frozen=True)
class Stressed:
    """Place and time of a boom's largest stress: a step, a body, and the distance from its tail in m."""

    step: int
    body: str
    x: float
    value: float  # Pa


def largest_stress(result: RunResult) -> Stressed | None:
    """The largest von Mises stress of the reduced model, where stresses were asked for."""
    peak = result.summary.get("stress_peak", {}).get("reduced")
    if peak is None:
        return None
    step = int(np.argmin(np.abs(result.responses["reduced"].t - peak["t"])))
    return Stressed(step, peak.get("section", ""), float(peak["position"][0]), float(peak["value"]))


def _out(result: RunResult) -> Array:
    """How far the tip is along the boom, (T,) m."""
    if result.reach is not None:
        return result.along_at(result.responses["reduced"].t)
    return np.full(len(result.responses["reduced"].t), length(result))


def slews(result: RunResult) -> bool:
    """Whether the boom is turned about the vertical, so that it is to be seen from above."""
    angle = result.summary.get("frame", {}).get("slewing", {"min": 0.0, "max": 0.0})
    return bool(angle["max"] > angle["min"])
