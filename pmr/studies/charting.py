"""Loads that the limits of a chart allow at its places, in all load cases, with the parts of their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.files import npz
from pmr.simulation.statics.loaded import Loaded
from pmr.simulation.statics.postures import (
    HOOK,
    WEIGHT,
    Bent,
    Postures,
)
from pmr.simulation.statics.swings import Rope, lift_off
from pmr.studies import shared
from pmr.studies.allowed import Place, allowed_loads, bent_further
from pmr.studies.chart_models import CONTACTS, Models
from pmr.studies.chart_warnings import left_out_loads, warnings_of_row
from pmr.studies.governing import Stopping, chosen, details
from pmr.studies.limits import Limit
from pmr.studies.tasks import Arguments, Needs, TaskResult

Array = NDArray[np.float64]

#: How many times as large an error is taken as another model says; where buckling decides (docs/load_chart.md).
#: That of reduction is taken twice: a run with the load as a mass has other modes, and as large an error of its own.
MARGIN, MARGIN_OF_BUCKLING = 1.25, 2.0
#: Parts of an error bar.
PARTS = ("reduction", "mesh", "model", "rotation")


@dataclass(frozen=True)
class Chart:
    """Limits of a chart and the load cases in which they are evaluated."""

    limits: Sequence[Limit]
    amounts: Sequence[Sequence[float]]  # by case: of all parts
    up_to: float  # kg
    gravity: float  # m/s^2

    def places(self, at: Postures, k: int) -> list[Place]:
        """Return the k-th place of a model, in each load case."""
        return [Place(at, k, amounts, self.gravity) for amounts in self.amounts]

    def loads(self, places: Sequence[Place], near: Array | None = None, more: Sequence[Limit] = ()) -> Array:
        """Load in kg that each limit allows in each case (c, l), those `more` before stability."""
        nearby = [None] * len(places) if near is None else list(near)
        limits = [*self.limits, *more]
        return np.array([allowed_loads(limits, place, self.up_to, c) for place, c in zip(places, nearby, strict=True)])

    def passed_limits(self, at: Postures, k: int) -> NDArray[np.bool_]:
        """Which limits are passed without a load in each case (c, l), stability last where nothing stands."""
        is_passed = np.zeros((len(self.amounts), len(self.limits) + 1), dtype=bool)
        for row, place in zip(is_passed, self.places(at, k), strict=True):
            state = place.loaded.state(0.0)
            row[-1] = not state.stands
            row[:-1] = [state.stands and place.used(limit, state) > 1.0 for limit in self.limits]
        return is_passed

    def least_loads(self, loads: Array) -> Array:
        """Least of the loads (c, l) in kg of all cases, (l,); the largest load that is looked for in place of NaN."""
        return np.asarray(np.nan_to_num(_least(loads)[1], nan=self.up_to))

    def of_reduction(self, models: Models, k: int, loads: Array) -> Array:
        """Error (l,) in kg of the reduced model's allowed loads (c, l), by the richer model."""
        assert models.better is not None
        count, above = len(self.limits), models.above
        buckling = [number for number, limit in enumerate(self.limits) if limit.of == "buckling"]
        sooner = [self.limits[i].model_copy(update={"factor": self.limits[i].factor * (1.0 + above)}) for i in buckling]
        close = np.concatenate([loads[:, :count], loads[:, buckling], loads[:, count:]], axis=1)
        richer, reduced = (
            self.least_loads(self.loads(self.places(models.better, k), close, sooner)),
            self.least_loads(loads),
        )
        other = np.append(richer[:count], richer[-1])
        before = other.copy()
        before[buckling] = np.minimum(richer[count:-1], other[buckling])
        before[-1] /= 1.0 + above * (before[-1] < self.up_to)  # of one that is not met nothing is known
        margins = [MARGIN_OF_BUCKLING if limit.kind.directly else 2.0 * MARGIN for limit in self.limits]
        margins.append(MARGIN_OF_BUCKLING)
        return np.asarray(np.array(margins) * np.maximum(np.abs(other - reduced), np.abs(before - reduced)))

    def of_other(self, models: Models, of: str, k: int, loads: Array) -> Array:
        """Error (l,) in kg of the allowed loads (c, l) of the ``"mesh"`` or the ``"model"``, by a finer or richer one.

        Not a number where it is not known.
        """
        error = np.full(loads.shape[1], np.nan)
        if (other := models.compared.get(of)) is not None:
            which = [n for n, limit in enumerate(self.limits) if of == "mesh" or limit.kind.in_richer]
            compared, columns = replace(self, limits=[self.limits[n] for n in which]), [*which, len(self.limits)]
            loads_of_other = compared.loads(compared.places(other.postures, k), loads[:, columns])
            error[columns] = other.share * np.abs(self.least_loads(loads_of_other) - self.least_loads(loads)[columns])
        return error

    def of_rotation(self, places: Sequence[Place], loads: Array, reach: float) -> Array:
        """Part (l,) in kg of allowed loads that second order neglects, in the governing case."""
        case, load = _least(loads)
        by_case = {n: MARGIN * bent_further(self.limits, places[n], load, reach) for n in set(case.tolist())}
        return np.array([by_case[n][number] for number, n in enumerate(case.tolist())])


def allow_row(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: what limits allow at some of the places; ``place`` (p, 2) m, radius and height of the undeformed tip.

    Arrays: ``load`` (p, l) kg, the least of all cases, with ``case`` (p, l), its number, and ``error`` (p, l) kg; NaN
    where no load up to the largest reaches a limit.  ``error`` is the sum of ``error.reduction``, ``error.mesh`` and
    ``error.model``, not a number where they are not known, and ``error.rotation``; ``not_covered`` (p,) says in words
    what it lacks.  With ``hoist`` also ``hoist`` (p,), by which factor of its
    weight the least load of all pulls as it is lifted off, in the first case's amounts.  ``passed`` (p, c, l) says
    which limits are passed in the cases out of service, `left`.  Arrays ``at.`` are those of
    `pmr.studies.governing.details` at ``at.place`` (l,), where each limit governs the largest load of these places, or
    -1.
    Figures are the extremes of the loads that all limits allow.
    """
    models = Models.of(needs)
    at, cases, gravity = models.reduced, arguments["cases"], arguments["gravity"]
    amounts = [[_amount(case, part) for part in at.parts] for case in cases]
    chart = Chart([Limit.model_validate(limit) for limit in arguments["limits"]], amounts, arguments["up_to"], gravity)
    rope = None if arguments.get("hoist") is None else Rope(*arguments["hoist"])
    first, last = arguments["rows"]
    idle = replace(chart, amounts=[[_amount(case, part) for part in at.parts] for case in arguments["left"]])
    rows = [_at_place(chart, models, k, rope) | {"passed": idle.passed_limits(at, k)} for k in range(first, last)]
    arrays = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    governing = np.min(np.nan_to_num(arrays["load"], nan=np.inf), axis=1)
    finite = governing[np.isfinite(governing)]
    record = {"load.least": float(finite.min()), "load.most": float(finite.max())} if len(finite) else {}
    tip, slewing = needs["postures"].arrays["tip"][first:last], at.slewing[first:last]
    radius = tip[:, 0] * np.cos(slewing) + tip[:, 1] * np.sin(slewing)
    bent = npz.record(Bent, needs["postures"].arrays, "bent.")
    stops = [
        Stopping(stop["of"], stop["speed"], stop["within"], needs["postures"].arrays[f"turned.{stop['of']}"])
        for stop in arguments.get("stops", ())
    ]
    best, case = chosen(arrays["load"]), arrays["case"]
    at_best = [chart.places(at, first + k)[case[k, n]] if k >= 0 else None for n, k in enumerate(best.tolist())]
    pages = details(chart.limits, at_best, arrays["load"][best, np.arange(len(best))], bent, stops)
    arrays |= {f"at.{name}": values for name, values in (pages | {"place": best}).items()}
    arrays["not_covered"] = np.array(["; ".join(models.not_covered(chart.limits))] * len(rows))
    scene, contacts = shared.scene_of(arguments), CONTACTS.validate_json(str(needs["postures"].arrays["contacts"]))
    loads, cases_of_loads = np.nan_to_num(arrays["load"], nan=chart.up_to), arrays["case"]
    of_places = warnings_of_row(scene, contacts, chart.places, models, loads, cases_of_loads, first)
    arrays["place"] = np.column_stack([radius, tip[:, 2]])
    left_out = left_out_loads(scene, [*cases, *arguments["left"]])
    return TaskResult(record, arrays, warnings=(*of_places, *left_out, *needs["postures"].warnings))


def _at_place(chart: Chart, models: Models, k: int, rope: Rope | None) -> dict[str, NDArray[Any]]:
    """The arrays of `allow_row` at the k-th place."""
    places = chart.places(models.reduced, k)
    loads = chart.loads(places)
    case, load = _least(loads)
    row: dict[str, NDArray[Any]] = {"load": load, "case": case}
    parts = dict.fromkeys((f"error.{of}" for of in PARTS), np.full(len(load), np.nan))
    if models.better is not None:
        parts["error.reduction"] = chart.of_reduction(models, k, loads)
        parts["error.mesh"] = chart.of_other(models, "mesh", k, loads)
        parts["error.model"] = chart.of_other(models, "model", k, loads)
        parts["error.rotation"] = chart.of_rotation(places, loads, float(models.reach[k]))
    sometimes = np.nan_to_num(parts["error.mesh"]) + np.nan_to_num(parts["error.model"])
    row |= parts | {"error": parts["error.reduction"] + sometimes + parts["error.rotation"]}
    if rope is not None:
        least = float(np.nanmin(np.append(load, np.inf)))
        row["hoist"] = np.array(_hoist_factor(places[0].loaded, least, rope, chart.gravity))
    return row


def _hoist_factor(loaded: Loaded, load: float, rope: Rope, gravity: float) -> float:
    """The factor by which a load pulls that is hoisted off the ground; NaN for none and where no limit is reached."""
    if not 0.0 < load < np.inf:
        return np.nan
    return lift_off(loaded.state(load).form, load, rope, gravity)


def _least(loads: Array) -> tuple[NDArray[np.int64], Array]:
    """Numbers of the cases (l,) that allow least, and how much that is, of loads (c, l)."""
    finite = np.where(np.isnan(loads), np.inf, loads)
    case = finite.argmin(axis=0)
    return case, loads[case, np.arange(loads.shape[1])]


def _amount(case: Mapping[str, Any], part: str) -> float:
    if part in (WEIGHT, HOOK):
        return float(case["weight" if part == WEIGHT else "load"])
    return float(case["loads"].get(part, 0.0))


def governing_limit(load: Array) -> NDArray[np.int64]:
    """Number of the limit that allows least at each place, -1 where none is reached, of loads (P, l) kg."""
    least = np.where(np.isnan(load), np.inf, load)
    return np.where(np.isfinite(least.min(axis=1)), least.argmin(axis=1), -1)


def lowest(load: Array, error: Array, up_to: float) -> Array:
    """Loads (P, l) kg less their errors; those of limits that are not reached are `up_to` at least without these."""
    return np.asarray(np.nan_to_num(load, nan=up_to) - np.nan_to_num(error))


def in_doubt(load: Array, error: Array, up_to: float) -> NDArray[np.bool_]:
    """Which limits (P, l) may govern within the error bars, where these are several."""
    low = lowest(load, error, up_to)
    low = np.where(np.isnan(load) & (low >= up_to), np.inf, low)
    high = np.where(np.isnan(load), np.inf, load + np.nan_to_num(error))
    may = (low <= high.min(axis=1)[:, None]) & np.isfinite(low)
    return may & (may.sum(axis=1) > 1)[:, None]
