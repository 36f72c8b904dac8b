"""The payload of a scene's run beside the loads that a chart of the same scene allows in the run's postures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from pmr.scene import Scene
from pmr.studies.duty import LeastLoads, interpolate_loads

#: Number of times of a run that are looked at, and largest difference in m between extensions that count as equal.
TIMES, SAME_EXTENSION = 1001, 1e-3


class LeastAllowed(NamedTuple):
    """Posture of a run in which a chart allows least, and the load and limit of the chart there."""

    load: float  # kg
    limit: int  # number of the limit that allows this load; -1 if no limit is reached
    t: float  # s
    luffing: float  # rad
    length: float  # m, boom length


def payload_of(scene: Scene) -> float:
    """Return the sum in kg of the masses that are payloads."""
    return sum(mass.mass for part in scene.sections for mass in part.masses if mass.payload)


def least_allowed(
    scene: Scene, least: LeastLoads, rows: Sequence[Mapping[str, Any]], up_to: float
) -> LeastAllowed | None:
    """Return the posture of a scene's run in which its chart allows least; None if the chart has none of its postures.

    `least` are the loads of the chart, the smallest of all slewing angles, and `rows` the extensions in m of its rows
    by parameter, such as ``extension.fly``.  Postures are those at `TIMES` even times from 0 to the end of the run.
    The chart has a posture if its luffing angle is among those of the chart, and its extensions are between those of
    two rows.  Loads are interpolated between luffing angles as in the duty table, and between two boom lengths in
    their inverse.  Where one of these two allows nothing, nothing is allowed.  `up_to` in kg is the largest load that
    was tried; the load is at most that.
    """
    assert scene.frame is not None and scene.frame.luffing is not None
    t, ordered = np.linspace(0.0, scene.time.end, TIMES), [rows[row] for row in least.order]
    names = [name.removeprefix("extension.") for name in ordered[0]]
    of_rows = np.array([[float(row[f"extension.{name}"]) for name in names] for row in ordered])  # (E, n)
    of_run = np.array([scene.extension(scene.names.index(name)).value(t) for name in names]).reshape(-1, TIMES)
    luffing = np.asarray(scene.frame.angles.luffing.value(t))
    number = np.interp(of_run.sum(axis=0), of_rows.sum(axis=1), np.arange(len(ordered)))  # row at each time
    drawn_out = np.array([np.interp(number, np.arange(len(ordered)), column) for column in of_rows.T])
    inside = np.all(np.abs(drawn_out.reshape(-1, TIMES) - of_run) < SAME_EXTENSION, axis=0)
    angles, order = np.unique(least.luffing, return_index=True)
    inside &= (luffing > angles[0] - 1e-6) & (luffing < angles[-1] + 1e-6)
    if not inside.any():
        return None
    t, number, luffing = t[inside], number[inside], np.clip(luffing[inside], angles[0], angles[-1])
    first = np.minimum(number.astype(int), max(len(ordered) - 2, 0))
    second, share = np.minimum(first + 1, len(ordered) - 1), (number - first)[:, None]
    of_chart = np.nan_to_num(least.load[:, order], nan=up_to)
    loads = np.stack([interpolate_loads(luffing, angles, of_row, up_to) for of_row in of_chart])  # (E, T, l)
    low, high = (loads[rows_at, np.arange(len(t))] for rows_at in (first, second))
    some = np.minimum(low, high) > 0.0
    low, high = np.where(some, low, 1.0), np.where(some, high, 1.0)
    between = np.where(some, 1.0 / ((1.0 - share) / low + share / high), 0.0)
    k = int(between.min(axis=1).argmin())
    limit, load = int(between[k].argmin()), float(between[k].min())
    lengths = np.linalg.norm(least.place[:, 0], axis=1)
    length = float(np.interp(number[k], np.arange(len(ordered)), lengths))
    return LeastAllowed(load, limit if load < (1.0 - 1e-9) * up_to else -1, float(t[k]), float(luffing[k]), length)
