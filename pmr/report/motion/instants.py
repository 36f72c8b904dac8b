"""Which moments of a motion are shown, how much they are exaggerated and what their colours mean."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.report.decimation import onto
from pmr.report.numbers import round_number
from pmr.report.subject import length
from pmr.results import Fields, RunResult

Array = NDArray[np.float64]

REACH = 0.08  # largest displacement as drawn, over the length of the body
EXTENSIONS = 3
#: Relative difference of two stresses that are one: they are kept in single precision.
SINGLE = 1e-5
ALMOST_ALL = 0.98  # of the cells: a few peaks must not leave the rest in one colour


@dataclass(frozen=True)
class Moment:
    """A time (s) of the fields, the mouth's position and the length beyond it (m), the largest stress (Pa)."""

    frame: int
    t: float
    s: float
    extension: float
    peak: float


def fields_by_body(result: RunResult) -> dict[str, Fields]:
    """Fields of all bodies that have some; all at the same times."""
    return {name: body.fields for name, body in result.bodies.items() if body.fields is not None}


def times(result: RunResult) -> Array:
    """Times of the fields, (F,) s."""
    return next(iter(fields_by_body(result).values())).t


def has_stresses(result: RunResult) -> bool:
    """Whether there are stresses."""
    return any(fields.von_mises for fields in fields_by_body(result).values())


def instants(result: RunResult) -> list[Moment]:
    """In each third of the stretch that the mouth visits the time of the largest stress, in order of time.

    Without stresses that of the largest displacement; one moment alone where the mouth rests.
    """
    s, t = positions(result), times(result)
    weight = _peaks(result) if has_stresses(result) else _size(result)
    parts = np.clip(((s - s.min()) / max(np.ptp(s), 1e-12) * EXTENSIONS).astype(int), 0, EXTENSIONS - 1)
    named = _named_frame(result)
    frames = [
        _largest(weight, inside, named) for part in np.unique(parts) if len(inside := np.flatnonzero(parts == part))
    ]
    largest = weight if has_stresses(result) else np.zeros_like(weight)
    chosen = sorted(frames)
    return [Moment(k, float(t[k]), float(s[k]), length(result) - float(s[k]), float(largest[k])) for k in chosen]


def of_the_peak(result: RunResult) -> Moment:
    """The stored moment nearest to the time of the largest stress that the summary names, or the one with the largest.

    Fields may be kept at fewer times than stresses.
    """
    t, s, named = times(result), positions(result), _named_peak(result).get("t")
    largest = _peaks(result) if has_stresses(result) else _size(result)
    k = int(np.argmax(largest)) if named is None else int(np.argmin(np.abs(t - named)))
    return Moment(k, float(t[k]), float(s[k]), length(result) - float(s[k]), float(largest[k]))


def place_of_the_peak(result: RunResult, moment: Moment) -> tuple[str, Array]:
    """The body with the largest stress, and where along its own axes (3,) m: as the summary has it.

    Where it has none: the middle of the cell with the largest stress at a moment.
    """
    fields, peak = fields_by_body(result), _named_peak(result)
    if "position" in peak and (body := peak.get("section", next(iter(fields)))) in fields:
        return body, np.array(peak["position"])
    stresses = {
        name: stress_of(fields_of_body)[moment.frame]
        for name, fields_of_body in fields.items()
        if fields_of_body.von_mises
    }
    body = max(stresses, key=lambda name: float(stresses[name].max()))
    stressed_fields = fields[body]
    return body, stressed_fields.points[stressed_fields.cells[int(np.argmax(stresses[body]))]].mean(axis=0)


def _largest(values: Array, among: NDArray[np.int64], preferred: int | None) -> int:
    """Number of the largest of the values `among` some; the preferred one if it is as large, as far as is kept."""
    largest = int(among[np.argmax(values[among])])
    if preferred is not None and preferred in among and values[preferred] >= (1.0 - SINGLE) * values[largest]:
        return int(preferred)
    return largest


def _named_peak(result: RunResult) -> Mapping[str, Any]:
    peak: Mapping[str, Any] = result.summary.get("stress_peak", {}).get("reduced") or {}
    return peak


def _named_frame(result: RunResult) -> int | None:
    """The frame at the time of the largest stress that the summary names, if it was kept."""
    t, field_times = _named_peak(result).get("t"), times(result)
    if t is None:
        return None
    near = int(np.argmin(np.abs(field_times - t)))
    return near if abs(field_times[near] - t) <= 1e-9 * max(1.0, abs(t)) else None


def positions(result: RunResult) -> Array:
    """Path of the mouth at the times of the fields, (F,) m; of a boom, how much shorter it is than at its longest."""
    s = result.along if result.reach is None else length(result) - result.reach
    return onto(times(result), result.responses["reduced"].t, s)


def places(result: RunResult) -> dict[str, Array]:
    """How far along x each body is drawn at the times of the fields, (F,) m: the mouth, or a base's tail, is at 0."""
    if result.reach is None:
        return {name: -positions(result) for name in fields_by_body(result)}
    return {name: along for name, (_, along) in result.travelling.items()}


def stress_of(fields: Fields) -> NDArray[np.float32]:
    """The larger of the stresses on a cell's faces, (F, C) Pa."""
    return np.maximum.reduce(list(fields.von_mises.values()))


def scale(result: RunResult) -> float:
    """How many times its size a displacement is drawn: a round number."""
    largest = float(_size(result).max())
    return round_number(REACH * length(result) / largest) if largest > 0.0 else 1.0


def top(result: RunResult) -> float:
    """The stress in Pa that the last colour stands for, whose quarters are short numbers; few cells ever exceed it."""
    cells = [stress_of(fields).max(axis=0) for fields in fields_by_body(result).values() if fields.von_mises]
    most = float(np.quantile(np.concatenate(cells), ALMOST_ALL))
    if most <= 0.0:
        return 1.0
    decade = 10.0 ** np.floor(np.log10(most))
    step = (0.4 if most < 4.0 * decade else 0.8) * decade
    return float(f"{step * np.ceil(most / step - 1e-9):.2g}")


def _peaks(result: RunResult) -> Array:
    """The largest stress of all bodies at each time, (F,) Pa."""
    each = [stress_of(fields).max(axis=1) for fields in fields_by_body(result).values() if fields.von_mises]
    return np.asarray(np.max(each, axis=0))


def _size(result: RunResult) -> Array:
    """The largest displacement of all bodies at each time, (F,) m."""
    each = [np.linalg.norm(fields.displacement, axis=2).max(axis=1) for fields in fields_by_body(result).values()]
    return np.asarray(np.max(each, axis=0))
