"""Tasks of a load chart: where the boom stands, as a reduced system and a richer one say; what limits allow there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.files import npz
from pmr.scene import Scene
from pmr.simulation.statics.equilibrium import buckling_factors
from pmr.simulation.statics.loaded import Loaded
from pmr.simulation.statics.postures import (
    HOOK,
    WEIGHT,
    Bent,
    Postures,
    Stands,
    acceleration_loads,
    places_of,
    unit_loads,
)
from pmr.simulation.statics.swings import Rope, lift_off
from pmr.studies.allowed import Place, allowed_loads, bent_further
from pmr.studies.engine.task import TaskResult
from pmr.studies.field_probes import with_fields
from pmr.studies.governing import chosen, details
from pmr.studies.limits import LEAST, STABILITY, Limit
from pmr.studies.richer_model import STRESS, UNCOMPARED
from pmr.studies.stops import Stopping
from pmr.system.assembly import Assembly
from pmr.system.system import System

Array = NDArray[np.float64]

#: How many times as large an error is taken as another model says; where buckling decides (docs/load_chart.md).
#: That of reduction is taken twice: a run with the load as a mass has other modes, and as large an error of its own.
MARGIN, MARGIN_OF_BUCKLING = 1.25, 2.0
#: Parts of an error bar.
PARTS = ("reduction", "mesh", "model", "rotation")
#: Why the error of the mesh is not known.
NO_FINER_MESH = "a finer one is made of beams with rigid walls alone"
#: Luffing angles at each extension whose forces attachment modes answer.
ANSWERED = 3
#: Places at which the richer model's buckling factor is compared with that of full order.
MEASURED = 5


def postures(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: `Postures` of the reduced system, ``reduced.``, and with ``error`` of a richer one, ``richer.``.

    Those of a finer mesh, ``finer.``, are there where all bodies are beams.

    ``mended`` is the share of a mesh's error that it does not have.
    Arrays ``reach`` (P,) m along the boom and ``tip`` (P, 3) m on the ground, undeformed, as well, and ``contacts``, of
    which warnings have to know.  Warnings are those of a run that hold for the scene wherever it stands.
    """
    from pmr.compare.accuracy import mesh
    from pmr.compare.accuracy.mesh import FINER, ORDER
    from pmr.fullmodel.build import warnings
    from pmr.reduction.bodies import join_bodies, reduce_bodies
    from pmr.studies import shared
    from pmr.studies.chart_warnings import contacts_as_text

    at = Stands.of(arguments["at"])
    scene = with_fields(Scene.model_validate(arguments["boom"]), arguments.get("fields", ()), at.count)
    built = shared.bodies_of(scene)
    full = shared.full_system(scene)
    system = join_bodies(scene, reduce_bodies(scene, built))
    reduced = Postures.of(scene, system, at)
    reach = at.reach(scene)
    arrays = {
        **npz.arrays(Bent.of(system, at), "bent."),
        "reach": reach,
        "contacts": contacts_as_text(system),
        "tip": at.on_ground(scene, reach),
        **npz.arrays(reduced, "reduced."),
        **{f"turned.{angle}": acceleration_loads(scene, system, at, angle) for angle in arguments.get("turned", ())},
    }
    if arguments["error"]:
        better = richer_system(scene, system, at, arguments["up_to"])
        arrays |= npz.arrays(Postures.of(scene, better, at), "richer.")
        if (finer := on_finer_mesh(scene)) is not None:
            arrays |= npz.arrays(Postures.of(scene, finer, at), "finer.")
            arrays["mended"] = np.array(1.0 - FINER**-ORDER)
        arrays["too_stiff"] = np.array(too_stiff(scene, better, full, at, arguments["up_to"]))
    of_structures = [line for body in built.values() for line in warnings(body.structure)]
    lines = dict.fromkeys((*of_structures, *mesh.warnings(scene)))
    return TaskResult(arrays=arrays, warnings=tuple(lines))


def on_finer_mesh(scene: Scene) -> System | None:
    """Reduced in the same way on elements half as long, of beams, whose reduction takes little time; else none."""
    from pmr.compare.accuracy.mesh import finer_beams, has_rigid_beams, once
    from pmr.reduction.bodies import join_bodies, reduce_bodies
    from pmr.studies import shared

    if not has_rigid_beams(scene) or any(part.mesh.file is not None for part in scene.sections):
        return None
    finer = once(finer_beams(scene))
    return join_bodies(finer, reduce_bodies(finer, shared.bodies_of(finer)))


def richer_system(scene: Scene, system: System, at: Stands, up_to: float) -> System:
    """System with attachment modes for contact forces under no and half of the largest load, and for buckling."""
    from pmr.compare.estimate import system_with_attachment_modes

    few = at.some(_sample_places(at))
    sample, half = Postures.of(scene, system, few), up_to / 2.0
    loaded = [Loaded(sample.at(k, dict.fromkeys(sample.parts, 0.0) | {WEIGHT: 1.0})) for k in range(few.count)]
    most = [min(half, equilibrium.state(0.0).form.critical / 2.0) for equilibrium in loaded]
    forces = [np.array([equilibrium.state(0.0).forces for equilibrium in loaded])]
    forces.append(np.array([equilibrium.state(load).forces for equilibrium, load in zip(loaded, most, strict=True)]))
    weight, hook = sample.f[sample.parts.index(WEIGHT)], sample.f[sample.parts.index(HOOK)]
    loads = [weight, weight + np.array(most)[:, None] * hook]
    if sample.terms.size:
        shapes = np.array([equilibrium.state(0.0).form.buckled(half) for equilibrium in loaded])
        forces.append(shapes * np.abs(forces[-1]).max(axis=1, initial=0.0)[:, None])
        loads.append(np.zeros_like(weight))
    bearing = [np.nan_to_num(contact_forces) for contact_forces in forces]
    return system_with_attachment_modes(system, places_of(system, few), bearing, loads)


def too_stiff(scene: Scene, better: System, full: System, at: Stands, up_to: float) -> float:
    """By which share the buckling factor of a richer system is above that of full order, at most, at a few places.

    A shape of few coordinates buckles later than that of all (Rayleigh's quotient), and the two models' errors of
    opposite sign may cancel in their difference.
    """
    every = _sample_places(at)
    few = at.some(every[np.linspace(0, len(every) - 1, min(MEASURED, len(every))).astype(int)])
    factors = []
    for system in (better, full):
        assembly, x, (parts, _, c) = Assembly(system), places_of(system, few), unit_loads(scene, system, few)
        pressed = c[parts.index(WEIGHT)] + up_to / 2.0 * c[parts.index(HOOK)]
        named = [dict(zip(system.term_names, row.tolist(), strict=True)) for row in pressed]
        factors.append([buckling_factors(assembly, at_, amounts)[0] for at_, amounts in zip(x, named, strict=True)])
    richer, exact = np.array(factors)
    finite = np.isfinite(richer) & np.isfinite(exact)
    return max(0.0, float(np.max(richer[finite] / exact[finite] - 1.0, initial=0.0)))


def _sample_places(at: Stands) -> NDArray[np.int64]:
    """Numbers of places: at each extension those of the least, a middle and the largest angle."""
    groups = dict[tuple[float, ...], list[int]]()
    for k in range(at.count):
        groups.setdefault(tuple(float(extension[k]) for extension in at.extensions.values()), []).append(k)
    selection = set[int]()
    for numbers in groups.values():
        ordered = sorted(numbers, key=lambda k: float(at.luffing[k]))
        selection |= {ordered[i] for i in np.linspace(0, len(ordered) - 1, min(ANSWERED, len(ordered))).astype(int)}
    return np.array(sorted(selection))


@dataclass(frozen=True)
class Models:
    """Postures of the reduced model, a richer one, one on a finer mesh and a richer structural one.

    Of the last three those are None that are not there.
    """

    own: Postures
    better: Postures | None
    finer: Postures | None
    structural: Postures | None
    called: str  # what the richer structural model is called, or why there is none
    mended: float  # share of a mesh's error that the finer one does not have
    above: float  # share by which the richer model's buckling factor is above that of full order
    reach: Array  # (P,) m

    @classmethod
    def of(cls, needs: Mapping[str, TaskResult]) -> Models:
        """Collect the results of the tasks `postures` and `richer_model`."""
        arrays, model_arrays = needs["postures"].arrays, needs["model"].arrays if "model" in needs else {}
        by_model = {name: _behind(arrays, f"{name}.") for name in ("reduced", "richer", "finer")}
        reduced, better, finer = (npz.record(Postures, fields) if fields else None for fields in by_model.values())
        assert reduced is not None
        mended, above = (float(arrays.get(name, np.nan)) for name in ("mended", "too_stiff"))
        model = _behind(model_arrays, "model.")
        structural = npz.record(Postures, model) if model else None
        called = str(model_arrays.get("called", model_arrays.get("reason", "")))
        return cls(reduced, better, finer, structural, called, mended, above, arrays["reach"])

    @property
    def compared_models(self) -> dict[str, tuple[Postures, str, float]]:
        """The model ``own``, and others by their part of the error: their names, and shares of the difference."""
        models = {"own": (self.own, "", 0.0)}
        model = {} if self.structural is None else {"model": (self.structural, self.called, 1.0)}
        return models | model | ({} if self.finer is None else {"mesh": (self.finer, "finer mesh", 1.0 / self.mended)})

    def not_covered(self, limits: Sequence[Limit]) -> list[str]:
        """Parts of the error that are not in the bars, a clause each."""
        if self.better is None:
            return ["any error: error_bars = false"]
        of = sorted({limit.of for limit in limits} & set(UNCOMPARED))
        model = f"the structural model: {self.called}" if self.structural is None else ""
        if not model and of:
            model = f"the structural model in limits of {' and '.join(of)}: {STRESS}"
        mesh = "" if self.finer is not None else f"the mesh: {NO_FINER_MESH}"
        return [*filter(None, (model, mesh)), f"large rotations in {STABILITY}"]


@dataclass(frozen=True)
class Chart:
    """Limits of a chart and the load cases in which they are evaluated."""

    limits: Sequence[Limit]
    amounts: Sequence[Sequence[float]]  # by case: of all parts
    up_to: float  # kg
    gravity: float  # m/s^2

    def places(self, at: Postures, k: int) -> list[Place]:
        """The k-th place in all load cases."""
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

    def known(self, loads: Array) -> Array:
        """The least of all cases (l,), the largest that is looked for where no limit is reached."""
        return np.asarray(np.nan_to_num(_least(loads)[1], nan=self.up_to))

    def of_reduction(self, models: Models, k: int, loads: Array) -> Array:
        """Error (l,) in kg of the reduced model's allowed loads (c, l), by the richer model."""
        assert models.better is not None
        count, above = len(self.limits), models.above
        buckling = [number for number, limit in enumerate(self.limits) if limit.of == "buckling"]
        sooner = [self.limits[i].model_copy(update={"factor": self.limits[i].factor * (1.0 + above)}) for i in buckling]
        close = np.concatenate([loads[:, :count], loads[:, buckling], loads[:, count:]], axis=1)
        richer, reduced = self.known(self.loads(self.places(models.better, k), close, sooner)), self.known(loads)
        other = np.append(richer[:count], richer[-1])
        before = other.copy()
        before[buckling] = np.minimum(richer[count:-1], other[buckling])
        before[-1] /= 1.0 + above * (before[-1] < self.up_to)  # of one that is not met nothing is known
        margins = [MARGIN_OF_BUCKLING if limit.of in LEAST else 2.0 * MARGIN for limit in self.limits] + [
            MARGIN_OF_BUCKLING
        ]
        return np.asarray(np.array(margins) * np.maximum(np.abs(other - reduced), np.abs(before - reduced)))

    def of_mesh(self, models: Models, k: int, loads: Array) -> Array:
        """Error (l,) in kg of the allowed loads (c, l), by a mesh of elements half as long; NaN without one."""
        if models.finer is None:
            return np.full(loads.shape[1], np.nan)
        apart = np.abs(self.known(self.loads(self.places(models.finer, k), loads)) - self.known(loads))
        return np.asarray(apart / models.mended)

    def of_model(self, models: Models, k: int, reduced: Array) -> Array:
        """Error (l,) kg of the structural model, by a richer one; not a number where that is not known."""
        error = np.full(reduced.shape[1], np.nan)
        if models.structural is not None:
            which = [n for n, limit in enumerate(self.limits) if limit.of not in UNCOMPARED]
            compared, columns = replace(self, limits=[self.limits[n] for n in which]), [*which, len(self.limits)]
            loads = compared.loads(compared.places(models.structural, k), reduced[:, columns])
            error[columns] = np.abs(compared.known(loads) - self.known(reduced)[columns])
        return error

    def of_rotation(self, places: Sequence[Place], loads: Array, reach: float) -> Array:
        """Part (l,) in kg of allowed loads that second order neglects, in the governing case."""
        case, load = _least(loads)
        by_case = {n: MARGIN * bent_further(self.limits, places[n], load, reach) for n in set(case.tolist())}
        return np.array([by_case[n][number] for number, n in enumerate(case.tolist())])


def allowed(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
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
    from pmr.studies.chart_warnings import contacts_from_text, warnings_of_row

    models = Models.of(needs)
    at, cases, gravity = models.own, arguments["cases"], arguments["gravity"]
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
    bent = npz.record(Bent, _behind(needs["postures"].arrays, "bent."))
    by_angle = _behind(needs["postures"].arrays, "turned.")
    stops = [
        Stopping(stop["of"], stop["speed"], stop["within"], by_angle[stop["of"]]) for stop in arguments.get("stops", ())
    ]
    best, case = chosen(arrays["load"]), arrays["case"]
    at_best = [chart.places(at, first + k)[case[k, n]] if k >= 0 else None for n, k in enumerate(best.tolist())]
    pages = details(chart.limits, at_best, arrays["load"][best, np.arange(len(best))], bent, stops)
    arrays |= {f"at.{name}": values for name, values in (pages | {"place": best}).items()}
    arrays["not_covered"] = np.array(["; ".join(models.not_covered(chart.limits))] * len(rows))
    scene, contacts = Scene.model_validate(arguments["boom"]), contacts_from_text(needs["postures"].arrays["contacts"])
    loads, cases_of_loads = np.nan_to_num(arrays["load"], nan=chart.up_to), arrays["case"]
    of_places = warnings_of_row(
        scene, contacts, chart.places, models.compared_models, models.reach, loads, cases_of_loads, first
    )
    arrays["place"] = np.column_stack([radius, tip[:, 2]])
    return TaskResult(record, arrays, warnings=(*of_places, *needs["postures"].warnings))


def _at_place(chart: Chart, models: Models, k: int, rope: Rope | None) -> dict[str, NDArray[Any]]:
    """The arrays of `allowed` at the k-th place."""
    places = chart.places(models.own, k)
    loads = chart.loads(places)
    case, load = _least(loads)
    row: dict[str, NDArray[Any]] = {"load": load, "case": case}
    parts = dict.fromkeys((f"error.{of}" for of in PARTS), np.full(len(load), np.nan))
    if models.better is not None:
        parts["error.reduction"] = chart.of_reduction(models, k, loads)
        parts["error.mesh"] = chart.of_mesh(models, k, loads)
        parts["error.model"] = chart.of_model(models, k, loads)
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


def _behind(arrays: Mapping[str, NDArray[Any]], prefix: str) -> dict[str, NDArray[Any]]:
    return {name.removeprefix(prefix): values for name, values in arrays.items() if name.startswith(prefix)}


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


def sequence(
    names: Sequence[str], least: Sequence[float], most: Sequence[float], count: int, order: str
) -> list[dict[str, float]]:
    """Extensions between two ends: all sections together, or one after the other, the first of `names` first."""
    shares, steps = np.linspace(0.0, 1.0, count), list[dict[str, float]]()
    for share in shares:
        out = [share] * len(names) if order == "together" else np.clip(share * len(names) - np.arange(len(names)), 0, 1)
        steps.append({n: float(a + s * (b - a)) for n, a, b, s in zip(names, least, most, out, strict=True)})
    return steps
