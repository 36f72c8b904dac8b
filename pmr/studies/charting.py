"""Tasks of a load chart: where the boom stands, as a reduced system and a richer one say; what limits allow there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.files import records
from pmr.scene import Scene
from pmr.simulation.postures import HOOK, WEIGHT, Postures, Stands, acting, places_of, weights_of
from pmr.studies.allowed import allowed_loads
from pmr.studies.engine.task import TaskResult
from pmr.studies.limits import Limit
from pmr.system.assembly import Assembly
from pmr.system.buckling import buckling_factors
from pmr.system.lift_off import Rope, lift_off
from pmr.system.loaded import Equations, Loaded
from pmr.system.system import System

Array = NDArray[np.float64]

#: How many times as large an error is taken as a richer model says; where buckling decides (docs/load_chart.md).
MARGIN, MARGIN_OF_BUCKLING = 1.25, 2.0
#: Luffing angles at each extension whose forces attachment modes answer.
ANSWERED = 3
#: Places at which the richer model's buckling factor is compared with that of full order.
MEASURED = 5


def stands_of(arguments: Mapping[str, Any]) -> Stands:
    """Where the boom stands, from a task's arguments."""
    at = arguments["at"]
    extensions = {name: np.array(one, float) for name, one in at["extensions"].items()}
    return Stands(extensions, np.array(at["luffing"], float), np.array(at["slewing"], float))


def postures(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: `Postures` of the reduced system, arrays ``reduced.``, and with ``error`` of a richer one, ``richer.``.

    Arrays ``reach`` (P,) m along the boom and ``tip`` (P, 3) m on the ground, undeformed, as well.
    """
    from pmr.reduction.bodies import joined, reduce_bodies
    from pmr.studies import shared

    scene, at = Scene.model_validate(arguments["boom"]), stands_of(arguments)
    built = shared.bodies_of(scene)
    full = shared.full_system(scene)
    weights = weights_of(full)
    system = joined(scene, reduce_bodies(scene, built))
    found = Postures.of(scene, system, at, weights)
    reach = at.reach(scene)
    arrays = {"reach": reach, "tip": at.on_ground(scene, reach), **records.arrays(found, "reduced.")}
    if arguments["error"]:
        better = richer_system(scene, system, at, weights, arguments["up_to"])
        arrays |= records.arrays(Postures.of(scene, better, at, weights), "richer.")
        arrays["too_stiff"] = np.array(too_stiff(scene, better, full, at, arguments["up_to"]))
    return TaskResult(arrays=arrays)


def richer_system(scene: Scene, system: System, at: Stands, weights: Any, up_to: float) -> System:
    """With attachment modes for what contacts bear under no load and half of the largest, and as the boom buckles."""
    from pmr.compare.richer import richer

    few = at.some(_answered(at))
    known, half = Postures.of(scene, system, few, weights), up_to / 2.0
    loaded = [Loaded(known.at(k, dict.fromkeys(known.parts, 0.0) | {WEIGHT: 1.0})) for k in range(few.count)]
    most = [min(half, one.state(0.0).form.critical / 2.0) for one in loaded]
    forces = [np.array([one.state(0.0).forces for one in loaded])]
    forces.append(np.array([one.state(load).forces for one, load in zip(loaded, most, strict=True)]))
    weight, hook = known.f[known.parts.index(WEIGHT)], known.f[known.parts.index(HOOK)]
    loads = [weight, weight + np.array(most)[:, None] * hook]
    if known.terms.size:
        shapes = np.array([one.state(0.0).form.buckled(half)[0] for one in loaded])
        forces.append(shapes * np.abs(forces[-1]).max(axis=1, initial=0.0)[:, None])
        loads.append(np.zeros_like(weight))
    return richer(system, places_of(system, few), [np.nan_to_num(one) for one in forces], loads)


def too_stiff(scene: Scene, better: System, full: System, at: Stands, up_to: float) -> float:
    """By which share the buckling factor of a richer system is above that of full order, at most, at a few places.

    A shape of few coordinates buckles later than that of all (Rayleigh's quotient), and the two models' errors of
    opposite sign may cancel in their difference.
    """
    every = _answered(at)
    few = at.some(every[np.linspace(0, len(every) - 1, min(MEASURED, len(every))).astype(int)])
    factors = []
    for system in (better, full):
        assembly, x, (parts, _, c) = Assembly(system), places_of(system, few), acting(scene, system, few)
        pressed = c[parts.index(WEIGHT)] + up_to / 2.0 * c[parts.index(HOOK)]
        named = [dict(zip(system.term_names, one.tolist(), strict=True)) for one in pressed]
        factors.append([buckling_factors(assembly, at_, one)[0] for at_, one in zip(x, named, strict=True)])
    found, exact = np.array(factors)
    known = np.isfinite(found) & np.isfinite(exact)
    return max(0.0, float(np.max(found[known] / exact[known] - 1.0, initial=0.0)))


def _answered(at: Stands) -> NDArray[np.int64]:
    """Numbers of places: at each extension those of the least, a middle and the largest angle."""
    groups = dict[tuple[float, ...], list[int]]()
    for k in range(at.count):
        groups.setdefault(tuple(float(one[k]) for one in at.extensions.values()), []).append(k)
    found = set[int]()
    for numbers in groups.values():
        ordered = sorted(numbers, key=lambda k: float(at.luffing[k]))
        found |= {ordered[i] for i in np.linspace(0, len(ordered) - 1, min(ANSWERED, len(ordered))).astype(int)}
    return np.array(sorted(found))


def allowed(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: what limits allow at some of the places; ``place`` (p, 2) m, radius and height of the undeformed tip.

    Arrays: ``load`` (p, l) kg, the least of all cases, with ``case`` (p, l), its number, and ``error`` (p, l) kg; NaN
    where a limit is not met up to the largest load.  With ``hoist`` also ``hoist`` (p,), by which factor of its weight
    the least load of all pulls as it is lifted off, in the first case's amounts.  Figures are the extremes of the loads
    that all limits allow.
    """
    limits = [Limit.model_validate(one) for one in arguments["limits"]]
    arrays = needs["postures"].arrays
    at = records.record(Postures, _behind(arrays, "reduced."))
    better = records.record(Postures, _behind(arrays, "richer.")) if arguments["error"] else None
    cases, up_to, gravity = arguments["cases"], arguments["up_to"], arguments["gravity"]
    amounts = [[_amount(case, part) for part in at.parts] for case in cases]
    margins = np.array(
        [MARGIN_OF_BUCKLING if one.of == "buckling" else MARGIN for one in limits] + [MARGIN_OF_BUCKLING]
    )
    above = float(arrays["too_stiff"]) if arguments["error"] else 0.0
    buckling = [number for number, one in enumerate(limits) if one.of == "buckling"]
    sooner = [limits[i].model_copy(update={"factor": limits[i].factor * (1.0 + above)}) for i in buckling]
    first, last = arguments["rows"]
    load, error = np.full((2, last - first, len(limits) + 1), np.nan)
    case = np.zeros((last - first, len(limits) + 1), np.int64)
    for k in range(first, last):
        found = np.array([allowed_loads(limits, at, k, one, up_to, gravity) for one in amounts])
        case[k - first], load[k - first] = _least(found)
        if better is not None:
            close = np.concatenate([found[:, :-1], found[:, buckling], found[:, -1:]], axis=1)
            others = [
                allowed_loads([*limits, *sooner], better, k, one, up_to, gravity, near)
                for one, near in zip(amounts, close, strict=True)
            ]
            known, own = (np.nan_to_num(one, nan=up_to) for one in (_least(np.array(others))[1], load[k - first]))
            other = np.append(known[: len(limits)], known[-1])
            before = other.copy()
            before[buckling] = np.minimum(known[len(limits) : -1], other[buckling])
            before[-1] /= 1.0 + above * (before[-1] < up_to)  # of one that is not met nothing is known
            error[k - first] = margins * np.maximum(np.abs(other - own), np.abs(before - own))
    governing = np.min(np.nan_to_num(load, nan=np.inf), axis=1)
    hoisted = {}
    if arguments.get("hoist") is not None:
        rope, named = Rope(*arguments["hoist"]), dict(zip(at.parts, amounts[0], strict=True))
        hoisted["hoist"] = np.array(
            [_hoisted(at.at(k, named), float(m), rope, gravity) for k, m in enumerate(governing, first)]
        )
    finite = governing[np.isfinite(governing)]
    record = {"load.least": float(finite.min()), "load.most": float(finite.max())} if len(finite) else {}
    tip, slewing = needs["postures"].arrays["tip"][first:last], at.slewing[first:last]
    radius = tip[:, 0] * np.cos(slewing) + tip[:, 1] * np.sin(slewing)
    place = np.column_stack([radius, tip[:, 2]])
    return TaskResult(record, {"load": load, "case": case, "error": error, "place": place, **hoisted})


def _hoisted(equations: Equations, load: float, rope: Rope, gravity: float) -> float:
    """The factor by which a load pulls that is hoisted off the ground; NaN for none and where no limit is met."""
    if not 0.0 < load < np.inf:
        return np.nan
    return lift_off(Loaded(equations).state(load).form, load, rope, gravity)


def _least(found: Array) -> tuple[NDArray[np.int64], Array]:
    """Numbers of the cases (l,) that allow least, and how much that is, of loads (c, l)."""
    known = np.where(np.isnan(found), np.inf, found)
    case = known.argmin(axis=0)
    return case, found[case, np.arange(found.shape[1])]


def _amount(case: Mapping[str, Any], part: str) -> float:
    if part in (WEIGHT, HOOK):
        return float(case["weight" if part == WEIGHT else "load"])
    return float(case["loads"].get(part, 0.0))


def _behind(arrays: Mapping[str, NDArray[Any]], prefix: str) -> dict[str, NDArray[Any]]:
    return {name.removeprefix(prefix): one for name, one in arrays.items() if name.startswith(prefix)}


def governing(load: Array) -> NDArray[np.int64]:
    """Number of the limit that allows least at each place, -1 where none is met, of loads (P, l) kg."""
    least = np.where(np.isnan(load), np.inf, load)
    return np.where(np.isfinite(least.min(axis=1)), least.argmin(axis=1), -1)


def in_doubt(load: Array, error: Array) -> NDArray[np.bool_]:
    """Which limits (P, l) may govern within the error bars, where these are several."""
    low = np.where(np.isnan(load), np.inf, load - np.nan_to_num(error))
    high = np.where(np.isnan(load), np.inf, load + np.nan_to_num(error))
    may = (low <= high.min(axis=1)[:, None]) & np.isfinite(low)
    return may & (may.sum(axis=1) > 1)[:, None]


def sequence(
    names: Sequence[str], least: Sequence[float], most: Sequence[float], count: int, order: str
) -> list[dict[str, float]]:
    """Extensions between two ends: all sections together, or one after the other, the first of `names` first."""
    shares, found = np.linspace(0.0, 1.0, count), list[dict[str, float]]()
    for share in shares:
        own = [share] * len(names) if order == "together" else np.clip(share * len(names) - np.arange(len(names)), 0, 1)
        found.append({n: float(a + s * (b - a)) for n, a, b, s in zip(names, least, most, own, strict=True)})
    return found
