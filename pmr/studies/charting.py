"""Loads that the limits of a chart allow at its points, in all load cases, and their errors by source.

A point of a chart is a posture of the boom: one extension of each section, one luffing and one slewing angle.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError, two_digits
from pmr.files import npz
from pmr.files.arrays import Array, Summary
from pmr.results.quantities import stress_remark
from pmr.scene import Scene
from pmr.scene.choice import has_walls_that_could_give
from pmr.scene.hints import PLAY, left_out
from pmr.scene.members import members, pads_on_faces
from pmr.scene.model_traits import model_traits
from pmr.simulation.statics.postures import (
    HOISTED,
    HOOK,
    MACHINE_WEIGHT,
    WEIGHT,
    DeflectionOutputs,
    PostureMatrices,
)
from pmr.simulation.statics.swings import Rope, lift_off
from pmr.studies import tasks
from pmr.studies.allowed import JUST_BELOW, Place, allowed_loads, large_rotation_changes
from pmr.studies.chart_models import CONTACTS, ChartModels
from pmr.studies.chart_points import (
    StopMotion,
    governing_details,
    largest_governed_rows,
    unnamed_loads,
    warnings_of_row,
)
from pmr.studies.further_limits import tip_rows
from pmr.studies.limits import KINDS, STABILITY_WORDS, Limit
from pmr.studies.tasks import Arguments, Needs, TaskResult

#: Factors on an error that another model indicates: in general, and where buckling decides (docs/load_chart.md).
MARGIN, MARGIN_OF_BUCKLING = 1.25, 2.0
#: What separates clauses on errors that an error bar does not cover.
CLAUSES = "; "
#: Where winds of load cases on the sections come from, in words.
WIND_WORDS = (
    "it turns with the boom, so it blows at the same angle to the boom at all slewing angles: wind from behind blows "
    "to where the boom points, and right and left are those of one who looks from the pivot to the tip"
)
#: Sources of error whose parts make up an error bar.
PARTS = ("reduction", "mesh", "model", "rotation", "play")


@dataclass(frozen=True)
class Chart:
    """Limits of a chart, and the load cases for which these are evaluated.

    In shapes of arrays, c is the number of load cases, and l that of limits: `limits` in their order, then stability.
    """

    limits: Sequence[Limit]
    amounts: Sequence[Sequence[float]]  # by case: the amount of each of the components `PostureMatrices.loads`
    up_to: float  # kg, largest load that is searched
    gravity: float  # m/s^2

    def places(self, at: PostureMatrices, k: int) -> list[Place]:
        """Return the k-th posture of the model `at` as one `Place` for each load case."""
        return [Place(at, k, amounts, self.gravity) for amounts in self.amounts]

    def loads(self, places: Sequence[Place], guesses: Array | None = None) -> Array:
        """Return the load (c, l) in kg that each of l limits allows at each of c `places`.

        A load is NaN if no load up to `up_to` reaches the limit, and 0 if the limit is exceeded without a load; see
        `allowed_loads`.  `guesses` (c, l) holds loads in kg near which each search begins, NaN where there is no guess;
        None stands for no guesses at all.
        """
        nearby = [None] * len(places) if guesses is None else list(guesses)
        return np.array(
            [allowed_loads(self.limits, place, self.up_to, near) for place, near in zip(places, nearby, strict=True)]
        )

    def passed_limits(self, at: PostureMatrices, k: int) -> NDArray[np.bool_]:
        """Return whether each of l limits is exceeded without a load in each of c cases, (c, l), at posture k of `at`.

        The last column, stability, is true in cases in which the boom has no stable equilibrium; in these cases all
        other columns are false.
        """
        is_passed = np.zeros((len(self.amounts), len(self.limits) + 1), dtype=bool)
        for row, place in zip(is_passed, self.places(at, k), strict=True):
            state = place.equilibria.state(0.0)
            row[-1] = not state.in_equilibrium
            row[:-1] = [state.in_equilibrium and place.used_share(limit, state) > 1.0 for limit in self.limits]
        return is_passed

    def least_loads(self, loads: Array) -> Array:
        """Return the smallest load (l,) in kg of each of l limits, from the `loads` (c, l) in kg in c cases.

        The smallest load is `up_to` for a limit whose loads are all NaN.
        """
        return np.asarray(np.nan_to_num(np.fmin.reduce(loads), nan=self.up_to))

    def reduction_errors(self, models: ChartModels, k: int, loads: Array) -> Array:
        """Return for each limit the error (l,) in kg by reduction of the smallest load of all cases.

        `loads` (c, l) in kg are the loads that the reduced model allows at the k-th posture.  Let d be the difference
        between the smallest loads that the reduced model and the richer model `ChartModels.enriched` allow.

        - For eigenvalues (buckling, frequency and stability) the error is `MARGIN_OF_BUCKLING` times d.
        - For other limits it is `MARGIN` times the sum of d and the error of a run.  The error of a run is the
          difference to the smallest load of `ChartModels.with_tip_mass`, but at least d.
        - For buckling and stability, d is also computed with a richer model whose buckling load is lower by the share
          `ChartModels.stiffness_excess`.  The larger d counts.
        """
        assert models.enriched is not None and models.with_tip_mass is not None
        enriched, above = self.places(models.enriched, k), models.stiffness_excess
        buckling = [n for n, limit in enumerate(self.limits) if limit.of == "buckling"]
        at_rest = [n for n, limit in enumerate(self.limits) if limit.kind.eigenvalue is None]
        error = self._load_differences(enriched, range(len(self.limits)), loads)
        sooner = [self.limits[n].model_copy(update={"factor": self.limits[n].factor * (1.0 + above)}) for n in buckling]
        early = self.least_loads(replace(self, limits=sooner).loads(enriched, loads[:, [*buckling, -1]]))
        early[-1] /= 1.0 + above * (early[-1] < self.up_to)  # of one that is not met nothing is known
        differences = np.abs(early - self.least_loads(loads)[[*buckling, -1]])
        error[[*buckling, -1]] = np.maximum(error[[*buckling, -1]], differences)
        of_run = self._load_differences(self.places(models.with_tip_mass, k), at_rest, loads)[:-1]
        at_rest_errors = MARGIN * (error[at_rest] + np.maximum(error[at_rest], of_run))
        error *= MARGIN_OF_BUCKLING
        error[at_rest] = at_rest_errors
        return error

    def comparison_errors(self, models: ChartModels, part: str, k: int, loads: Array) -> Array:
        """Return by how many kg (l,) mesh, structural model or play change the smallest load of each limit.

        `part` is ``"mesh"``, ``"model"`` or ``"play"``.  `loads` (c, l) in kg are the loads that the reduced model
        allows at the k-th posture, for c cases and l columns: the limits, then stability.  The smallest load of all
        cases is compared with that of the model ``models.comparisons[part]``.  The error is the magnitude of the
        difference, times the ``share`` of that model.

        The result is NaN for limits that this model can't evaluate.  It is NaN for all limits if there is no such
        model, or if its pads have play that no load takes up.  An InputError of a limit's function is raised with the
        name of this model in its message.
        """
        errors = np.full(loads.shape[1], np.nan)
        if (other := models.comparisons.get(part)) is not None:
            which = [n for n, limit in enumerate(self.limits) if part != "model" or limit.kind.in_richer_model]
            try:
                differences = self._load_differences(self.places(other.postures, k), which, loads)
            except InputError as error:
                if part == "play" and error.source == "system":
                    return errors
                allowed = f"{error.allowed} in the {other.label} that the scene is compared with"
                raise InputError(error.source, error.key, error.value, allowed) from None
            errors[[*which, -1]] = other.share * differences
        return errors

    def _load_differences(self, places: Sequence[Place], which: Sequence[int], loads: Array) -> Array:
        """Return by how many kg the smallest load that another model allows differs from that of the reduced model.

        The result (w + 1,) has magnitudes for the w limits with the numbers `which` and, last, for stability.  The
        smallest load is that of c cases.  `places` are the places of the other model, one for each case.  `loads` (c,
        l) in kg are those that the reduced model allows, with a column for each limit and a last one for stability.
        """
        compared, columns = replace(self, limits=[self.limits[n] for n in which]), [*which, -1]
        other = self.least_loads(compared.loads(places, loads[:, columns]))
        return np.asarray(np.abs(other - self.least_loads(loads)[columns]))

    def rotation_errors(self, places: Sequence[Place], loads: Array, reach: float) -> Array:
        """Return for each limit the error (l,) in kg by large rotations of its smallest load of all cases.

        `loads` (c, l) in kg are the loads that the limits allow at c `places`, one for each case; `reach` is the length
        of the boom in m.  The error is `MARGIN` times the change that `large_rotation_changes` returns for the case in
        which the limit's load is smallest; it is 0 for stability, and for limits that no load reaches.
        """
        case, load = _least_case(loads), np.fmin.reduce(loads)
        by_case = {n: MARGIN * large_rotation_changes(self.limits, places[n], load, reach) for n in set(case.tolist())}
        return np.array([by_case[n][number] for number, n in enumerate(case.tolist())])


def allow_row(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: compute the loads that the limits allow at the points of one row of a chart.

    Argument ``rows`` holds the number of the row's first point and the number of the first point after the row;
    ``cases`` are the load cases in service, ``left`` those out of service.  In the shapes of the result's arrays, p is
    the number of points, l that of limits (stability last) and c that of cases out of service:

    - ``place`` (p, 2) m: radius and height of the undeformed tip; ``luffing`` (p,) rad.
    - ``load`` (p, l) kg: the smallest over all cases in service, NaN if no load up to ``up_to`` reaches the limit;
      ``case`` (p, l): the number of that case.
    - ``outward`` (p,) m: by how much the deflections under the load that governs move the tip away from the pivot; NaN
      if none governs, and where stability does.
    - ``member`` (p,): the pad, cylinder, rope, support or probe that reaches the limit that governs; empty if unknown.
    - ``error`` (p, l) kg: the sum of ``error.reduction``, ``error.mesh``, ``error.model``, ``error.rotation`` and
      ``error.play``, those of mesh, model and play counting as 0 where they are NaN, which means unknown;
      ``not_covered`` (p,): the errors that it does not cover, clauses with `CLAUSES` in between.
    - ``hoist`` (p,), only if ``hoist`` is among the arguments: the largest force of the rope while the point's smallest
      load is hoisted off the ground, over the load's weight, with the amounts of the first case.
    - ``passed`` (p, c, l): whether the limit is exceeded without a load in a case out of service.
    - ``at.<name>``: arrays of `pmr.studies.chart_points.governing_details` at the points ``at.place`` (l,), where each
      limit governs the largest load of the row; ``at.place`` is -1 for a limit that governs at none.
      ``at.remarks`` (l,): what the quantity of each limit leaves out, in words; ``at.left_out`` (n, 2): what the chart
      leaves out, as pairs of a subject and clauses; ``at.definitions`` (n, 2): words and what they mean; ``at.ground``:
      height of the ground in m above the pivot, NaN without a ground.
      ``at.slewing``: the slewing angles of the row in degrees.

    Record: ``load.least`` and ``load.most``, the extremes over the points of the smallest load over all limits, in kg.
    """
    models = ChartModels.from_needs(needs)
    at, cases, gravity = models.reduced, arguments["cases"], arguments["gravity"]
    amounts = [[case_amount(case, part) for part in at.loads.names] for case in cases]
    chart = Chart([Limit.model_validate(limit) for limit in arguments["limits"]], amounts, arguments["up_to"], gravity)
    rope = None if arguments.get("hoist") is None else Rope(*arguments["hoist"])
    first, last = arguments["rows"]
    idle = replace(chart, amounts=[[case_amount(case, part) for part in at.loads.names] for case in arguments["left"]])
    scene = tasks.scene_of(arguments)
    rows = [
        _point_arrays(chart, models, k, rope, scene) | {"passed": idle.passed_limits(at, k)} for k in range(first, last)
    ]
    arrays = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    governing = np.min(np.nan_to_num(arrays["load"], nan=np.inf), axis=1)
    finite = governing[np.isfinite(governing)]
    record = {"load.least": float(finite.min()), "load.most": float(finite.max())} if len(finite) else {}
    tip, slewing = needs["postures"].arrays["tip"][first:last], at.place.slewing[first:last]
    radius = tip[:, 0] * np.cos(slewing) + tip[:, 1] * np.sin(slewing)
    bent = npz.record_from_arrays(DeflectionOutputs, needs["postures"].arrays, "bent.")
    stops = [
        StopMotion(stop["of"], stop["speed"], stop["within"], needs["postures"].arrays[f"turned.{stop['of']}"])
        for stop in arguments.get("stops", ())
    ]
    best, case = largest_governed_rows(arrays["load"]), arrays["case"]
    at_best = [chart.places(at, first + k)[case[k, n]] if k >= 0 else None for n, k in enumerate(best.tolist())]
    pages = governing_details(chart.limits, at_best, arrays["load"][best, np.arange(len(best))], bent, stops)
    remarks = [_remark(scene, limit) for limit in chart.limits]
    has_play = "play" in models.comparisons
    unnamed, has_wind = unnamed_loads(scene, [*cases, *arguments["left"]])
    left_out = left_out_of_chart(scene, chart.limits, has_play)
    left_out |= {"loads of the scene's run": unnamed} if unnamed and has_wind else {}
    wind = {"wind": WIND_WORDS} if has_wind else {}
    pages |= {"place": best, "remarks": np.array([*remarks, ""]), "left_out": np.array(list(left_out.items()))}
    play = {"play of pads": _play_words(float(needs["postures"].arrays["gap"]))} if has_play else {}
    pages["definitions"] = np.array(list((chart_definitions(scene, arguments.get("point")) | wind | play).items()))
    pages["slewing"] = np.unique(np.rad2deg(slewing).round(9))
    ground = scene.frame.ground if scene.frame is not None else None
    pages["ground"] = np.array(np.nan if ground is None else -ground.height)
    arrays |= {f"at.{name}": values for name, values in pages.items()}
    everywhere, loose = models.not_covered(chart.limits, scene), np.isnan(arrays["error.play"]).all(axis=1) & has_play
    clauses = [[*everywhere, "the play of pads that no load takes up"] if of else everywhere for of in loose]
    arrays["not_covered"] = np.array([CLAUSES.join(of_point) for of_point in clauses])
    contacts = CONTACTS.validate_json(str(needs["postures"].arrays["contacts"]))
    loads, cases_of_loads = np.nan_to_num(arrays["load"], nan=chart.up_to), arrays["case"]
    of_places = warnings_of_row(scene, contacts, chart.places, models, loads, cases_of_loads, first)
    of_errors = error_warnings(scene, models, [limit.name for limit in chart.limits], arrays)
    arrays |= {"place": np.column_stack([radius, tip[:, 2]]), "luffing": at.place.luffing[first:last]}
    of_loads = [unnamed] if unnamed and not has_wind else []
    return TaskResult(
        record,
        arrays,
        warnings=(*of_places, *of_errors, *of_loads, *arguments.get("warnings", ()), *needs["postures"].warnings),
    )


def _remark(scene: Scene, limit: Limit) -> str:
    """Return the remark that the report prints after a limit; empty if there is nothing to say.

    The remark ends with the limit's note.  For a limit on the stress at probes, the names of the probes and a remark on
    stresses in the walls of boxes stand before it.  For a limit on pressures of pads that the scene states, these
    pressures stand before it.
    """
    if limit.by_scene:
        pads = [pad.ring.allowed_pressure for name, pad in pads_on_faces(scene).items() if limit.concerns(name)]
        allowed = [pressure for pressure in pads if pressure is not None]
        words = " to ".join(f"{1e-6 * end:.4g}" for end in dict.fromkeys((min(allowed), max(allowed))))
        return "; ".join(filter(None, (f"allowed_pressure of the scene: {words} MPa", limit.note)))
    if limit.of != "stress" or limit.kind.names is None:
        return limit.note
    places = ", ".join(filter(limit.concerns, limit.kind.names(scene)))
    return "; ".join(filter(None, (f"at {places} alone", stress_remark(scene), limit.note)))


def error_warnings(
    scene: Scene, models: ChartModels, names: Sequence[str], arrays: Mapping[str, NDArray[Any]]
) -> Iterator[str]:
    """Yield a warning for the mesh, and one for the model, if its error in a load that governs is more than allowed.

    The allowed error, a share of the load, is ``compare.model_tolerance`` of the scene.  `names` are those of the
    limits without stability.  `arrays` has ``load``, ``error.mesh`` and ``error.model``, each (p, l) in kg at p points
    and of l limits.  Only positive loads that are the smallest of their point are looked at.
    """
    load, allowed = arrays["load"], scene.compare.model_tolerance
    which = governing_limit(load)
    rows = np.flatnonzero((which >= 0) & (load[np.arange(len(load)), which] > 0.0))
    for part in ("mesh", "model") if len(rows) else ():
        if (other := models.comparisons.get(part)) is None:
            continue
        shares = np.nan_to_num(arrays[f"error.{part}"][rows, which[rows]] / load[rows, which[rows]])
        worst = int(shares.argmax())
        if shares[worst] <= allowed:
            continue
        name = [*names, STABILITY_WORDS][which[rows[worst]]]
        beside = f" beside a {other.label}" if part == "model" else ""
        in_cells = part == "model" and model_traits(other.label).has_cells
        giving = in_cells and any(map(has_walls_that_could_give, members(scene)))
        better = '; set body.walls = "give" to add the compliance of walls under pads' if giving else ""
        yield (
            f"the {part} is off by up to {two_digits(100.0 * shares[worst])} % in the load that {name} allows{beside}, "
            f"more than compare.model_tolerance = {allowed:g}: its error bar contains this{better}"
        )


def errors_not_covered(by_point: Array) -> str:
    """Join the clauses on errors that the bars of a chart do not cover, each clause once, to one text.

    `by_point` (P,) has the clauses at each point, with `CLAUSES` between them.  Behind a clause that does not hold at
    all points stands the number of points at which it does.
    """
    counts = Counter(clause for clauses in by_point.tolist() for clause in clauses.split(CLAUSES))
    points = len(by_point)
    return CLAUSES.join(of if n == points else f"{of} at {n} of {points} points" for of, n in counts.items())


def left_out_of_chart(scene: Scene, limits: Sequence[Limit], has_play: bool) -> dict[str, str]:
    """Return what a chart of a scene leaves out, except motions, as text by subject, such as ``loads``.

    The subjects are limits that are not set, and what the model lacks.  `has_play` says whether the error bars have a
    part for the play of pads.
    """
    usual = dict.fromkeys(kind.words for kind in KINDS.values() if kind.words)
    lacking = [words for words in usual if words not in {limit.kind.words for limit in limits}]
    rows = {"usual limits that are not set": ", ".join(lacking)} if lacking else {}
    if "field" not in {limit.of for limit in limits}:
        rows["places without a limit"] = (
            "walls away from probes and pads, as beside the feet and lugs of cylinders; tubes and rods of cylinders"
        )
    in_walls = any(limit.of == "pad" and not limit.by_scene for limit in limits)
    rows |= left_out(scene, True, "play beyond error bars" if has_play else PLAY, in_walls)
    if in_walls and stress_remark(scene):  # limits of pad forces bound the bending of walls alone
        rows["strength"] = f"the sum of beam stress and of wall bending under pads, {rows['strength']}"
    return rows


def chart_definitions(scene: Scene, point: tuple[float, float, float] | None) -> dict[str, str]:
    """Return what a chart of a scene calls load, radius, height and boom length, as text by subject.

    The load hangs at `point` in m in the axes of the last section; None stands for the tip.  Masses of the last section
    that are no payload are named with the load, and with the factor of load cases that multiplies their weight.
    """
    last = scene.sections[-1]
    remaining = [
        f"{mass.name}, {mass.mass:g} kg, with the factor of {'the load' if mass.hoisted else 'the weight of the boom'}"
        for mass in last.masses
        if not mass.payload
    ]
    load = (
        "what hangs at the tip" if point is None else f"what hangs at {list(point)} m in the axes of the last section"
    )
    if remaining:
        load += f", slings too; masses of the scene there are already taken off: {'; '.join(remaining)}"
    else:
        load += ", with hook block and rope: deduct their masses, as the scene has no mass there"
    ground = scene.frame.ground if scene.frame is not None else None
    above = f"; the height above the ground is {ground.height:g} m more" if ground is not None else ""
    return {
        "load": load,
        "radius": "horizontal distance of the undeformed tip from the pivot of the boom, measured before lifting",
        "height": f"height of the undeformed tip above the pivot{above}",
        "boom length": "distance of the undeformed tip from the pivot",
    }


def _play_words(gap: float) -> str:
    """Return the words on what a chart's error bars say about the play of pads.

    `gap` in m is the play of the boom with which the loads are compared; 0 if that boom has no play.
    """
    if gap:
        return (
            f"the loads are without play; error bars contain their change by {1e3 * gap:g} mm of play from face to "
            "face, all of it at top and left; a load case that presses the boom more to a side would change them more"
        )
    return "the loads are those of pads with the play of the scene; error bars contain the change of loads without play"


def _point_arrays(
    chart: Chart, models: ChartModels, k: int, rope: Rope | None, scene: Scene
) -> dict[str, NDArray[Any]]:
    """Return the arrays of `allow_row` at the point with the number `k`, by name, without the axis of points.

    They are ``load``, ``case``, ``member``, ``outward``, ``error`` and its parts and, with a `rope`, ``hoist``.  Errors
    are NaN without richer models.
    """
    places = chart.places(models.reduced, k)
    loads = chart.loads(places)
    case, load = _least_case(loads), np.fmin.reduce(loads)
    row: dict[str, NDArray[Any]] = {"load": load, "case": case, "member": np.array(""), "outward": np.array(np.nan)}
    which = int(governing_limit(load))
    if 0 <= which < len(chart.limits):
        place = places[case[which]]
        state = place.equilibria.state(float(load[which]) * (1.0 - JUST_BELOW))
        values = np.append(state.outputs, state.forces)
        row["member"] = np.array(chart.limits[which].governing_member(scene, place.postures.columns, values))
        x, _, z = tip_rows(place.postures.output_names, place.postures.output_kinds) @ state.outputs
        luffing = place.postures.place.luffing[k]
        row["outward"] = np.array(x * np.cos(luffing) - z * np.sin(luffing))
    parts = dict.fromkeys((f"error.{of}" for of in PARTS), np.full(len(load), np.nan))
    if models.enriched is not None:
        parts["error.reduction"] = chart.reduction_errors(models, k, loads)
        parts |= {f"error.{of}": chart.comparison_errors(models, of, k, loads) for of in ("mesh", "model", "play")}
        parts["error.rotation"] = chart.rotation_errors(places, loads, float(models.reach[k]))
    sometimes = [np.nan_to_num(parts[f"error.{of}"]) for of in ("mesh", "model", "play")]
    row |= parts | {"error": parts["error.reduction"] + sum(sometimes) + parts["error.rotation"]}
    if rope is not None:
        least, loaded = float(np.nanmin(np.append(load, np.inf))), places[0].equilibria
        is_hoisted = 0.0 < least < np.inf
        row["hoist"] = np.array(
            lift_off(loaded.state(least).form, least, rope, chart.gravity) if is_hoisted else np.nan
        )
    return row


def _least_case(loads: Array) -> NDArray[np.int64]:
    """Return for each of l limits the number (l,) of the case, of c, with the smallest of its `loads` (c, l) in kg.

    Loads that are NaN count as infinite; the number is 0 if all are.
    """
    return np.where(np.isnan(loads), np.inf, loads).argmin(axis=0)


def case_amount(case: Summary, part: str) -> float:
    """Return the amount of the component `part` in a load case; 0 for a component that the case does not name.

    The amount is a factor for a weight and for the load that is searched for.  It is in kg for `HOISTED`.  A load of
    the scene has an amount in its own unit, such as N.
    """
    key = {WEIGHT: "weight", MACHINE_WEIGHT: "machine", HOISTED: "hoisted", HOOK: "load"}.get(part)
    return float(case["loads"].get(part, 0.0) if key is None else case[key])


def governing_limit(load: Array) -> NDArray[np.int64]:
    """Return the number of the limit with the smallest load at each point, (...,); -1 where all loads are NaN.

    `load` (..., l) in kg holds the loads of l limits; NaN if no load up to the largest one reaches the limit.
    """
    least = np.where(np.isnan(load), np.inf, load)
    return np.where(np.isfinite(least.min(axis=-1)), least.argmin(axis=-1), -1)
