"""Which moments of a motion are shown, how much they are exaggerated and what their colours mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.report.decimation import onto
from pmr.report.numbers import round_number
from pmr.report.space.layout import end_of
from pmr.results import Fields, RunResult

Array = NDArray[np.float64]

REACH = 0.08  # largest displacement as drawn, over the length of the body
EXTENSIONS = 3
ALMOST_ALL = 0.98  # of the cells: a few peaks must not leave the rest in one colour


@dataclass(frozen=True)
class Moment:
    """A time (s) of the fields, the mouth's position and the length beyond it (m), the largest stress (Pa)."""

    frame: int
    t: float
    s: float
    extension: float
    peak: float


def moments(result: RunResult, fields: Fields) -> list[Moment]:
    """In each third of the stretch that the mouth visits, farthest out first, the time of the largest stress.

    Without stresses that of the largest displacement; one moment alone where the mouth rests.
    """
    s, weight = positions(result, fields), stress_of(fields).max(axis=1) if fields.von_mises else _size(fields)
    parts = np.clip(((s - s.min()) / max(np.ptp(s), 1e-12) * EXTENSIONS).astype(int), 0, EXTENSIONS - 1)
    frames = [
        int(inside[np.argmax(weight[inside])])
        for part in np.unique(parts)
        if len(inside := np.flatnonzero(parts == part))
    ]
    largest = weight if fields.von_mises else np.zeros_like(weight)
    return [Moment(k, float(fields.t[k]), float(s[k]), end_of(result) - float(s[k]), float(largest[k])) for k in frames]


def positions(result: RunResult, fields: Fields) -> Array:
    """Where the mouth is at the times of the fields, (F,) m."""
    return onto(fields.t, result.responses["reduced"].t, result.path)


def stress_of(fields: Fields) -> NDArray[np.float32]:
    """The larger of the stresses on a cell's faces, (F, C) Pa."""
    return np.maximum.reduce(list(fields.von_mises.values()))


def scale(result: RunResult, fields: Fields) -> float:
    """How many times its size a displacement is drawn: a round number."""
    largest = float(_size(fields).max())
    return round_number(REACH * end_of(result) / largest) if largest > 0.0 else 1.0


def top(fields: Fields) -> float:
    """The stress in Pa that the last colour stands for, whose quarters are short numbers; few cells ever exceed it."""
    most = float(np.quantile(stress_of(fields).max(axis=0), ALMOST_ALL))
    if most <= 0.0:
        return 1.0
    decade = 10.0 ** np.floor(np.log10(most))
    step = (0.4 if most < 4.0 * decade else 0.8) * decade
    return float(f"{step * np.ceil(most / step - 1e-9):.2g}")


def _size(fields: Fields) -> Array:
    return np.linalg.norm(fields.displacement, axis=2).max(axis=1)
