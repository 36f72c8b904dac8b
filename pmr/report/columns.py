"""Which columns of a response are what: histories of tips, lines and forces, by the kinds of their outputs."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.report.numbers import NOTHING, round_number
from pmr.report.subject import is_alone
from pmr.results import Response, RunResult
from pmr.results.response import outputs_of
from pmr.results.tables import FORCE_OF
from pmr.scene.built import PadRing
from pmr.scene.frame import rotation
from pmr.scene.keys import named
from pmr.scene.members import as_pads

PLAYING = 30.0  # s that the whole motion plays at the speed set first
_FULL_SCALE = 32767


def extremes(values: ArrayLike, bins: int) -> NDArray[np.intp]:
    """Indices of samples that keep every peak.

    Plain thinning would alias whatever oscillates faster than the new step.  Here the signal is cut into
    `bins` equal intervals, and of each the smallest and the largest sample stay, in their order in time.

    Parameters
    ----------
    values : (T,) array
    bins : int
        Intervals; about one for each point of line width in the picture.

    Returns
    -------
    (n,) array of int
        Increasing, with the first and the last sample; n <= 2 bins + 2, and all T where that is no more.
    """
    values = np.asarray(values, dtype=float)
    count = len(values)
    if count <= 2 * bins + 2:
        return np.arange(count)
    pieces = _pieces(count, bins)
    low = [start + int(np.argmin(values[start:stop])) for start, stop in pieces]
    high = [start + int(np.argmax(values[start:stop])) for start, stop in pieces]
    return np.unique([0, *low, *high, count - 1])


def upper_envelope(values: ArrayLike, bins: int) -> NDArray[np.intp]:
    """Indices of the largest sample in each of `bins` intervals: the upper envelope of a noisy signal."""
    values = np.asarray(values, dtype=float)
    count = len(values)
    if count <= bins:
        return np.arange(count)
    return np.array([start + int(np.argmax(values[start:stop])) for start, stop in _pieces(count, bins)])


def spread(count: int, most: int) -> NDArray[np.intp]:
    """At most `most` indices, evenly spread over ``range(count)``, with both ends."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def onto(t: Array, times: Array, values: Array) -> Array:
    """Columns of `values`, known at `times`, at the times `t`; the same array where these are the same."""
    if len(t) == len(times) and np.allclose(t, times, rtol=0.0, atol=1e-9 * abs(t[-1])):
        return values
    if values.ndim == 1:
        return np.interp(t, times, values)
    return np.stack([np.interp(t, times, column) for column in values.T], axis=1)


def _pieces(count: int, bins: int) -> list[tuple[int, int]]:
    """`bins` intervals that make up ``range(count)``."""
    edges = np.linspace(0, count, bins + 1).astype(int).tolist()
    return list(zip(edges[:-1], edges[1:], strict=True))


def pack(values: NDArray[np.float64]) -> dict[str, Any]:
    """Little-endian 16-bit integers in base64, and the value of one count."""
    largest = float(np.abs(values).max(initial=0.0)) or 1.0
    counts = np.round(values / largest * _FULL_SCALE).astype("<i2")
    return {"count": largest / _FULL_SCALE, "data": base64.b64encode(counts.tobytes()).decode()}


def speeds(duration: float) -> dict[str, Any]:
    """Playback speeds as multiples of real time; the one set first is round and plays for about `PLAYING`."""
    first = round_number(max(duration / PLAYING, 1e-6))
    choices = [first / 5.0, first / 2.0, first, 2.0 * first, 4.0 * first]
    return {"first": first, "choices": [float(f"{choice:.3g}") for choice in choices]}


Array = NDArray[np.float64]
Quantity = Callable[[Response], Array]

#: Share of the largest displacement of a model below which one is round-off, where a response does not say.
ROUND_OFF = 1e-12


@dataclass(frozen=True)
class Force:
    """A force on a body: what a response calls it, and what it is called within its group.

    `column` is where it stands in a response without names.
    """

    column: int
    name: str
    called: str
    unit: str = "N"

    def of(self, response: Response) -> Array:
        """The force, or moment, over time, (T,) in its unit."""
        return response.force(self.called, self.column)


@dataclass(frozen=True)
class Line:
    """Places along a body's axis, and the columns of a response that hold their displacement along a direction."""

    body: str
    x: Array  # (o,) m
    columns: NDArray[np.int64]
    tail: Array  # (T,) m, where the body's tail is along the boom

    def moved(self, response: Response) -> Array:
        """That displacement, (T, o) m."""
        return response.displacement[:, self.columns]


@dataclass(frozen=True)
class Ring:
    """Pads above or below a body: where they are along the boom (T,) m, and what they press with, in all (T,) N."""

    body: str
    at: Array
    above: bool
    force: Array


def tips(result: RunResult) -> Mapping[str, Quantity]:
    """The displacement of the tip, or that of the last section, (T,) m, along each direction across the axis."""
    last = list(result.scene.bodies)[-1]

    def of_axis(direction: str) -> Quantity:
        def displacement(response: Response) -> Array:
            outputs = outputs_of(result.scene, response)
            of = ("tip", last, direction)
            column = next(k for k, output in enumerate(outputs) if (output.kind, output.body, output.direction) == of)
            return response.displacement[:, column]

        return displacement

    outputs = outputs_of(result.scene, result.responses["reduced"])
    return {
        output.direction: of_axis(output.direction) for output in outputs if (output.kind, output.body) == ("tip", last)
    }


def is_round_off(result: RunResult, what: Quantity) -> bool:
    """Whether a displacement exceeds in no model what round-off may make of it."""
    return max(float(np.abs(what(response)).max()) for response in result.responses.values()) <= _floor(result)


def differ(result: RunResult, what: Quantity) -> float:
    """How far a displacement (T,) of any other model is from that of the reduced one at most, m; 0 without others."""
    reduced = result.responses["reduced"]
    displacements = [
        onto(reduced.t, response.t, what(response)) for name, response in result.responses.items() if name != "reduced"
    ]
    return max((float(np.abs(other - what(reduced)).max()) for other in displacements), default=0.0)


def unseen(result: RunResult) -> float:
    """Share of a quantity's largest value up to which models that differ have no panel for it: the step's error is as
    large, or it is nothing to look at.
    """
    step = result.summary.get("step") or {}
    return max(NOTHING, *(step.get(place) or 0.0 for place in ("tip", "beam")))


def _floor(result: RunResult) -> float:
    """Displacement that may be round-off, m; where that is not known, a share of the largest displacement."""
    return max(
        response.round_off or ROUND_OFF * float(np.abs(response.displacement).max(initial=0.0))
        for response in result.responses.values()
    )


def not_drawn(directions: Sequence[str]) -> str:
    """Why the tip's displacement along these directions has no figure; empty without any."""
    if not directions:
        return ""
    return f"The tip moves along {' and '.join(directions)} by no more than round-off."


def lines(result: RunResult, response: Response, direction: str = "z") -> list[Line]:
    """Columns of a response with the displacement of each body along a direction across its axis, from the base out."""
    outputs, bodies = outputs_of(result.scene, response), []
    for body, tail in zip(result.scene.bodies, _tails(result, len(response.t)).T, strict=True):
        columns = [k for k, output in enumerate(outputs) if output.body == body and output.direction == direction]
        columns.sort(key=lambda k: float(response.x[k]))
        if columns:
            bodies.append(Line(body, response.x[columns], np.array(columns, np.int64), tail))
    return bodies


def _tails(result: RunResult, steps: int) -> Array:
    """Place of each body's tail along the boom, (T, bodies) m; of a body alone 0."""
    if is_alone(result):
        return np.zeros((steps, 1))
    extensions = result.paths.values
    if len(extensions) != steps:
        at = np.linspace(0.0, 1.0, len(extensions))
        extensions = np.stack(
            [np.interp(np.linspace(0.0, 1.0, steps), at, extension) for extension in extensions.T], axis=1
        )
    return np.cumsum(np.hstack([np.zeros((steps, 1)), extensions]), axis=1)


def forces(result: RunResult, kind: str = "pad") -> dict[str, list[Force]]:
    """Forces of a kind of output by what they come from, that which stays first: all that the reduced model knows.

    Pads of a body alone are grouped by their rings; all others are one group without a name.
    """
    response = result.responses["reduced"]
    first, count = response.displacement.shape[1], response.slider_force.shape[1]
    outputs = outputs_of(result.scene, response)[first : first + count]
    numbers = {output.name: k for k, output in enumerate(outputs) if output.kind == kind}
    if kind == "pad" and is_alone(result) and result.scene.pads:
        groups = dict[str, list[Force]]()
        for ring in sorted(result.scene.pads, key=lambda ring: bool(ring.moving)):
            for name, _, _ in ring.places:
                if (called := FORCE_OF + name) in numbers:
                    pad = Force(numbers[called], name.removeprefix(f"{ring.name} "), called)
                    groups.setdefault(ring.name, []).append(pad)
        return groups
    chosen = [(k, output.name) for k, output in enumerate(outputs) if output.kind == kind]
    if kind == "pad" and is_alone(result):  # points that slide
        names = [f"slider {k + 1}" if len(chosen) > 1 else "" for k, _ in chosen]
    else:
        names = [called.removeprefix(FORCE_OF) for _, called in chosen]
    units = {
        named(body, FORCE_OF + support): unit
        for body, part in result.scene.bodies.items()
        for support, unit in part.springs.items()
    }
    group = [Force(k, name, called, units.get(called, "N")) for (k, called), name in zip(chosen, names, strict=True)]
    return {"": group} if group else {}


def rings(result: RunResult) -> Iterator[Ring]:
    """Pads above and below the bodies, all of a ring on one face together."""
    response = result.responses["reduced"]
    bodies, tails = list(result.scene.bodies.items()), _tails(result, len(response.t))
    for number, (body, of) in enumerate(bodies):
        places = [(_by_face(ring), _ring_places(result, ring, tails[:, number])) for ring in of.pads]
        if (joint := of.joint) is not None:
            mouth = tails[:, number - 1] + bodies[number - 1][1].length
            at_ends = [("tail", ring, tails[:, number] + ring.at) for ring in joint.tail]
            at_ends += [("mouth", ring, mouth - ring.at) for ring in joint.mouth]
            for end, ring, at in at_ends:
                called = " ".join(filter(None, (body, end, ring.name)))
                places.append((_by_face(as_pads(ring, called)) if ring.faces else _points(called), at))
        for faces, at in places:
            for face, names in faces.items():
                columns = [response.force_names.index(name) for name in names if name in response.force_names]
                if columns:
                    yield Ring(body, at, face == "top", response.slider_force[:, columns].sum(axis=1))


def _by_face(ring: PadRing) -> dict[str, list[str]]:
    """Names of the forces of a ring's pads below and above a body, by face."""
    return {side: [FORCE_OF + name for name, face, _ in ring.places if face == side] for side in ("bottom", "top")}


def _points(called: str) -> dict[str, list[str]]:
    """Names of the forces of points on the axis of a planar beam, by face."""
    return {"bottom": [f"{FORCE_OF}{called} below"], "top": [f"{FORCE_OF}{called} above"]}


def _ring_places(result: RunResult, ring: PadRing, tail: Array) -> Array:
    """Place of a ring on the ground along the axis, (T,) m."""
    return ring.at + (result.along if ring.moving else np.zeros_like(tail))


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


def body_axes(result: RunResult, steps: Sequence[int] | NDArray[np.intp], scale: float = 1.0) -> list[Axis]:
    """Axes of all bodies from the base out, by the reduced model; deflections are `scale` times as large."""
    response, frame = result.responses["reduced"], result.scene.frame
    chosen, aside = np.asarray(steps), {line.body: line for line in lines(result, response, "y")}
    turned, positions = turns(result, response.t[chosen]), []
    sine, cosine = turned[:, 2, 0, None], turned[:, 2, 2, None]  # of luffing
    for line in lines(result, response):
        places_in_boom = np.zeros((len(chosen), len(line.x), 3)) + (0.0 if frame is None else frame.place)
        places_in_boom[:, :, 0] += line.tail[chosen, None] + line.x
        for direction, of in ((1, aside.get(line.body)), (2, line)):
            if of is not None:
                places_in_boom[:, :, direction] += scale * response.displacement[np.ix_(chosen, of.columns)]
        places = np.einsum("sij,snj->sni", turned, places_in_boom)
        side = np.stack([cosine * places_in_boom[:, :, 0] - sine * places_in_boom[:, :, 2], places[:, :, 2]], axis=-1)
        positions.append(Axis(line.body, line.x, side, places[:, :, :2]))
    return positions


def turns(result: RunResult, t: Array) -> Array:
    """From the boom's axes into those of the ground, (T, 3, 3): by its frame, or as far as its weight has it raised."""
    if result.scene.frame is not None:
        return result.scene.frame.rotation(t)
    gravity = result.scene.gravity
    raised = np.full(len(t), 0.0 if gravity is None else np.deg2rad(gravity.raised))
    return rotation(raised, np.zeros(len(t)))
