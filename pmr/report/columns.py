"""Histories from the columns of a response, chosen by the kinds of the outputs: tips, axes of bodies and forces."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.files.arrays import Array
from pmr.report.subject import luffing_support_names, shown_force_name
from pmr.results import Response, RunResult
from pmr.results.quantities import FORCE_OF
from pmr.scene.hoist import PLACES as HOOK_PLACES
from pmr.scene.hoist import Hoist
from pmr.scene.keys import qualified_name
from pmr.scene.rotation import boom_rotation

#: Remark on the force of a support that stands in for the luffing cylinder.
ACROSS = " (its support, across the boom)"


def extreme_indices(values: ArrayLike, bins: int) -> NDArray[np.intp]:
    """Indices of samples that keep every peak of a signal.

    Keeping every k-th sample would alias oscillations that are faster than the new step.  Here the signal is cut into
    `bins` equal intervals, and the smallest and the largest sample of each interval are kept.

    Parameters
    ----------
    values : (T,) array
    bins : int
        Number of intervals; about one for each line width in the picture.

    Returns
    -------
    (n,) array of int
        Indices in increasing order, the first and the last sample among them: all T if T <= 2 bins + 2, else at most
        2 bins + 2.
    """
    values = np.asarray(values, dtype=float)
    count = len(values)
    if count <= 2 * bins + 2:
        return np.arange(count)
    edges = np.linspace(0, count, bins + 1).astype(int)
    pieces = list(pairwise(edges))
    low = [start + int(np.argmin(values[start:stop])) for start, stop in pieces]
    high = [start + int(np.argmax(values[start:stop])) for start, stop in pieces]
    return np.unique([0, *low, *high, count - 1])


def spread_indices(count: int, limit: int) -> NDArray[np.intp]:
    """Return at most `limit` indices (n,) of ``range(count)``, evenly spread from the first to the last one."""
    return np.unique(np.linspace(0, count - 1, min(count, limit)).round().astype(int))


def interpolate(t: Array, times: Array, values: Array) -> Array:
    """Interpolate `values` (T,) or (T, n), known at `times` (T,) in s, linearly to the times `t` (S,) in s.

    Before the first of `times`, the result is the first value, and after the last one, the last value.  If `t` equals
    `times`, `values` itself is returned.
    """
    if len(t) == len(times) and np.allclose(t, times, rtol=0.0, atol=1e-9 * abs(t[-1])):
        return values
    if values.ndim == 1:
        return np.interp(t, times, values)
    return np.stack([np.interp(t, times, column) for column in values.T], axis=1)


ResponseFunction = Callable[[Response], Array]

#: Share of the largest displacement up to which a displacement is round-off; used if a response states no bound.
ROUND_OFF = 1e-12


@dataclass(frozen=True)
class Force:
    """A force or moment on a body: its name in the report, its name in a response, and its unit."""

    name: str
    output_name: str
    unit: str = "N"

    def history(self, response: Response) -> Array:
        """Read the force or moment (T,) in its `unit` from a response."""
        return response.force(self.output_name)


@dataclass(frozen=True)
class AxisPoints:
    """Points along a body's axis, sorted by x, with their displacements by the reduced model, in the boom's axes.

    Displacements along x are 0.  Displacements along y are 0, too, if the response has no outputs along y.
    """

    body: str
    x: Array  # (o,) m
    tail: Array  # (T,) m, position of the body's tail along the boom
    displacement: Array  # (T, o, 3) m


def tip_displacements(result: RunResult) -> Mapping[str, ResponseFunction]:
    """Functions that read the tip's displacement (T,) in m from a response, by the direction across the axis (y or z).

    The tip is that of the last section.
    """
    last = list(result.scene.bodies)[-1]

    def of_axis(direction: str) -> ResponseFunction:
        """Return a function that reads the displacement of the tip in `direction` from a response."""
        return lambda response: response.of("tip", last, direction)[:, 0]

    outputs = result.responses["reduced"].outputs
    return {of.direction: of_axis(of.direction) for of in outputs if (of.kind, of.body) == ("tip", last)}


def is_round_off(result: RunResult, quantity: ResponseFunction) -> bool:
    """Whether a displacement is at most round-off in every model; `quantity` reads the displacement from a response.

    The displacement of every response is compared with one bound: the largest `round_off` of all responses.  For a
    response without `round_off`, the share `ROUND_OFF` of its largest displacement takes its place.
    """
    floors = [
        response.round_off or ROUND_OFF * float(np.abs(response.displacement).max(initial=0.0))
        for response in result.responses.values()
    ]
    return max(float(np.abs(quantity(response)).max()) for response in result.responses.values()) <= max(floors)


def undrawn_sentence(result: RunResult) -> str:
    """Sentence on the directions in which the tip's displacements are round-off; empty without such directions."""
    still = [direction for direction, what in tip_displacements(result).items() if is_round_off(result, what)]
    words = {"y": "sideways", "z": "up or down"}
    return f"The tip does not move {' or '.join(words[direction] for direction in still)}." if still else ""


def axis_points(result: RunResult) -> list[AxisPoints]:
    """Points of all bodies' axes from the base out; bodies without outputs along z are left out."""
    response, bodies = result.responses["reduced"], list[AxisPoints]()
    numbered = sorted(enumerate(response.outputs[: len(response.x)]), key=lambda item: float(response.x[item[0]]))
    for body, tail in zip(result.scene.bodies, result.tails.T, strict=True):
        aside, up = ([k for k, of in numbered if (of.body, of.direction) == (body, way)] for way in ("y", "z"))
        if up:
            displacement = np.zeros((len(response.t), len(up), 3))
            displacement[:, :, 2] = response.displacement[:, up]
            if aside:
                displacement[:, :, 1] = response.displacement[:, aside]
            bodies.append(AxisPoints(body, response.x[up], tail, displacement))
    return bodies


def forces_of(result: RunResult, kind: str = "pad") -> list[Force]:
    """Forces and moments of the reduced model that are outputs of one `kind`, such as ``pad`` or ``support``.

    Some supports stand in for the luffing cylinder.  Their names in the report end with the remark `ACROSS`.
    """
    units = {
        qualified_name(body, FORCE_OF + support): unit
        for body, part in result.scene.bodies.items()
        for support, unit in part.spring_units.items()
    }
    stand_ins = luffing_support_names(result) if result.scene.holding_cylinder is None else set()
    forces = list[Force]()
    for output in result.responses["reduced"].outputs:
        if output.kind == kind:
            name = output.name.replace(FORCE_OF, "", 1)
            shown = shown_force_name(name) + (ACROSS if name in stand_ins else "")
            forces.append(Force(shown, output.name, units.get(output.name, "N")))
    return forces


def largest_by_unit(result: RunResult) -> dict[str, float]:
    """Largest force in N and largest moment in N m of the reduced model: pads, cylinders, supports and reactions.

    A unit without such a force or moment is left out.
    """
    response, largest = result.responses["reduced"], dict[str, float]()
    histories = [
        (force.unit, force.history(response))
        for kind in ("pad", "cylinder", "support")
        for force in forces_of(result, kind)
    ]
    histories += [
        (of.unit, response.column(number)) for number, of in enumerate(response.outputs) if of.kind == "reaction"
    ]
    for unit, values in histories:
        largest[unit] = max(largest.get(unit, 0.0), float(np.abs(values).max(initial=0.0)))
    return largest


@dataclass(frozen=True)
class Axis:
    """Axis of a body at S times, as n points with coordinates in m from the pivot.

    `x` (n,) is the distance of the points from the body's tail along the axis.  `side` (S, n, 2) are the distance from
    the pivot in the plane of luffing and the height; `plan` (S, n, 2) are the two horizontal coordinates.
    """

    body: str
    x: Array
    side: Array
    plan: Array


def body_axes(result: RunResult, steps: Sequence[int] | NDArray[np.intp], scale: float = 1.0) -> list[Axis]:
    """Axes of all bodies from the base out, as the reduced model has them at the time indices `steps` (S,).

    Deflections are enlarged by the factor `scale`.
    """
    t = result.responses["reduced"].t[np.asarray(steps)]
    return [_axis_in_views(result, line.body, line.x, places, t) for line, places in _boom_places(result, steps, scale)]


def rope_axis(result: RunResult, steps: Sequence[int] | NDArray[np.intp], scale: float = 1.0) -> Axis | None:
    """Rope of the hoist from its head sheaves to its hook at the time steps `steps` (S,), as an axis of two points.

    The rope has its true length and direction, and hangs from the place of the head with deflections enlarged by the
    factor `scale`.  The result is None if `rope_places` returns None.
    """
    if (places := rope_places(result, steps, scale)) is None:
        return None
    x = np.array([0.0, float(np.linalg.norm(places[:, 1] - places[:, 0], axis=1).max())])
    return _axis_in_views(result, "hoist", x, places, result.responses["reduced"].t[np.asarray(steps)])


def rope_places(result: RunResult, steps: Sequence[int] | NDArray[np.intp], scale: float = 1.0) -> Array | None:
    """Positions (S, 2, 3) in m of the hoist's head sheaves and hook in the boom's axes, from the pivot.

    The positions are those at the time steps `steps` (S,).  Deflections of the head are enlarged by `scale`; the vector
    from head to hook is the true one.  The result is None without a hoist, or if the response has no places of a hook.
    """
    response, hoist = result.responses["reduced"], result.scene.hoist
    if hoist is None or not set(HOOK_PLACES) <= set(response.other_names):
        return None
    true, drawn = (_head_places(result, hoist, steps, factor) for factor in (1.0, scale))
    chosen = np.asarray(steps)
    hook = np.stack([response.other(name)[chosen] for name in HOOK_PLACES], axis=1)
    turned = frame_rotations(result, response.t[chosen])
    if result.frame is not None:
        turned = result.frame.base_rotation(response.t[chosen]) @ turned
    in_boom = np.einsum("sji,sj->si", turned, hook)
    return np.stack([drawn, drawn + in_boom - true], axis=1)


def _head_places(result: RunResult, hoist: Hoist, steps: Sequence[int] | NDArray[np.intp], scale: float) -> Array:
    """Positions (S, 3) in m of the head sheaves at the time steps `steps` (S,), in the boom's axes.

    Deflections are enlarged by `scale`.
    """
    head = hoist.section or result.scene.names[-1]
    line, places = next(of for of in _boom_places(result, steps, scale) if of[0].body == head)
    x = float(line.x[-1]) if hoist.on == "tip" else float(hoist.on)
    at = np.array([[np.interp(x, line.x, along) for along in moment.T] for moment in places])
    return np.asarray(at + [0.0, *hoist.offset])


def _boom_places(
    result: RunResult, steps: Sequence[int] | NDArray[np.intp], scale: float
) -> list[tuple[AxisPoints, Array]]:
    """Points of all bodies' axes with their positions (S, n, 3) in m from the pivot, in the boom's axes.

    Positions are those at the time steps `steps` (S,), with deflections enlarged by `scale`.
    """
    chosen, every = np.asarray(steps), list[tuple[AxisPoints, Array]]()
    for line in axis_points(result):
        places = scale * line.displacement[chosen] + (0.0 if result.frame is None else result.frame.tail_position)
        places[:, :, 0] += line.tail[chosen, None] + line.x
        every.append((line, places))
    return every


def _axis_in_views(result: RunResult, name: str, x: Array, places: Array, t: Array) -> Axis:
    """Return the axis called `name` in the base's axes, as seen from the side and from above, at the times t (S,) in s.

    The axis goes through the `places` (S, n, 3) in m, which are in the boom's axes and measured from the pivot.  The
    distances of these points along the axis are x (n,) in m.
    """
    turned = frame_rotations(result, t)
    sine, cosine = turned[:, 2, 0, None], turned[:, 2, 2, None]  # of the luffing angle
    in_space = np.einsum("sij,snj->sni", turned, places)
    side = np.stack([cosine * places[:, :, 0] - sine * places[:, :, 2], in_space[:, :, 2]], axis=-1)
    return Axis(name, x, side, in_space[:, :, :2])


def frame_rotations(result: RunResult, t: Array) -> Array:
    """Rotation matrices (T, 3, 3) from the boom's axes into those of its base at the times `t` (T,) in s.

    The boom's axes move with its frame.  A base that does not turn has the axes of the ground.  If the scene has no
    frame, the boom's axes have a constant angle, by which gravity is turned.
    """
    if result.frame is not None:
        return result.frame.rotation(t)
    gravity = result.scene.gravity
    raised = np.full(len(t), 0.0 if gravity is None else np.deg2rad(gravity.elevation))
    return boom_rotation(raised, np.zeros(len(t)))
