"""The boom at rest at points of a load chart: warnings as of a run, and details of the points where limits govern.

The details are the boom's shape, forces, stresses and its swing after a stop, under the largest load that each limit
governs in a row of the chart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pmr.compare.forces import history_by_name, missing_reaction_warnings, unknown_force_warnings
from pmr.compare.trust import large_motion_warnings
from pmr.files.arrays import Array, Summary
from pmr.results import Energy, Response
from pmr.results.quantities import von_mises_stress
from pmr.scene import Scene
from pmr.scene.built import force_name
from pmr.scene.hints import is_hung
from pmr.scene.keys import SceneTable, Usual
from pmr.simulation.native.watched import exceeded_limits, exceeded_warnings, pulled_pads, pushed_ropes
from pmr.simulation.statics.loaded import LoadedState, LoadedStates, LoadEffects
from pmr.simulation.statics.postures import HOOK, DeflectionOutputs, PostureMatrices
from pmr.simulation.statics.swings import stopping_swing
from pmr.studies.allowed import JUST_BELOW, Place
from pmr.studies.chart_models import ChartModels
from pmr.studies.limits import FIELD, Limit
from pmr.system.contacts import Contact


class Equilibrium(NamedTuple):
    """State of a boom at rest, stable or not (`LoadedState`), and a description of its posture and load in words."""

    state: LoadedState
    description: str


def stable_equilibria(place: Place, load: float, reach: float) -> list[Equilibrium]:
    """Return the stable equilibria at a place: without a load, and slightly below `load` in kg if `load` is positive.

    A place is a posture and a load case.  An unstable equilibrium is left out.  `reach` in m, the length of the boom,
    is used in the descriptions only.
    """
    at, k = place.postures, place.k
    where = f"at a boom length of {reach:.4g} m, raised {np.rad2deg(at.place.luffing[k]):.4g} degrees"
    if at.place.slewing[k]:
        where += f", slewed {np.rad2deg(at.place.slewing[k]):.4g} degrees"
    loads = {0.0: f"{where}, without a load"}
    if load > 0.0:
        loads[load * (1.0 - JUST_BELOW)] = f"{where}, under {float(f'{load:.4g}'):.10g} kg"
    equilibria = [Equilibrium(place.equilibria.state(acting), words) for acting, words in loads.items()]
    return [at_rest for at_rest in equilibria if at_rest.state.in_equilibrium]


def warnings_of_row(
    scene: Scene,
    contacts: Sequence[Contact],
    places: Callable[[PostureMatrices, int], Sequence[Place]],
    models: ChartModels,
    loads: Array,
    cases: Array,
    first: int,
) -> tuple[str, ...]:
    """Return the warnings that a run would have for a row of a chart; empty if no point has a warning.

    Each point is looked at without a load, and under slightly less than the load that is allowed there.  `loads` (p, l)
    in kg are the loads that l limits allow at p points, the largest load that was tried if a limit is not reached.
    `cases` (p, l) are the numbers of the load cases in which these loads are smallest.  `first` is the number of the
    row's first point.

    ``places(postures, number)`` returns a `Place` for each load case, from the postures of a model and the number of a
    point.  `contacts` are those of the system.  Unstable equilibria are ignored.
    """
    reach, equilibria = models.reach, list[Equilibrium]()
    for k, (of_limits, of_cases) in enumerate(zip(loads, cases, strict=True), first):
        limit = int(of_limits.argmin())
        case = int(of_cases[limit])
        equilibria += stable_equilibria(places(models.reduced, k)[case], float(of_limits[limit]), float(reach[k]))
    if not equilibria:
        return ()
    response = _response_at_equilibria(equilibria, models.reduced)
    exceeded = exceeded_limits([*pulled_pads(scene, contacts), *pushed_ropes(scene)], history_by_name(scene, response))
    return (
        *exceeded_warnings(exceeded, lambda k: equilibria[k].description),
        *large_motion_warnings(float(reach.max()), [response]),
        *unknown_force_warnings(scene, response),
        *missing_reaction_warnings(scene),
    )


def unnamed_loads(scene: Scene, cases: Sequence[Summary]) -> tuple[str, bool]:
    """Return a line on the loads of the scene that no load case names, and whether a case has wind on the sections.

    `cases` are the load cases of the chart.  The line is empty if there are no such loads.  Two kinds of loads do not
    count.  Forces that pull the last section's tip down in space have the chart's load in their place.  Wind of the
    scene does not count if a case has wind on the sections.
    """
    named = {HOOK, *(name for case in cases for name in case["loads"])}
    blown = any(load.acts == "wind" and load.name in named for part in scene.sections for load in part.loads)
    lacking = [
        load.name
        for part in scene.sections
        for load in part.loads
        if load.name not in named and any(load.signal.bounds(0.0, scene.time.end))
        if load.acts != "wind" or not blown
        if part is not scene.sections[-1] or not is_hung(load, scene)
    ]
    if not lacking:
        return "", blown
    some, is_in = ("loads", "are") if len(lacking) > 1 else ("load", "is")
    instead = "; the chart has its own wind, on the sections" if blown else ""
    names = " and ".join(dict.fromkeys(lacking))
    return f"the scene's {some} {names} {is_in} in no load case, so not in this chart{instead}", blown


def replaced_mass_warnings(original: Scene, scene: Scene, point: tuple[float, float, float] | None = None) -> list[str]:
    """Return a line for each mass of the last section that acts with the chart's load, but at another place.

    `original` is the scene of the study file, and `scene` the scene of the chart.  A line is returned for a mass that
    `scene` lacks, as the load is in its place, and that is neither at the tip nor at the load.  A line is also returned
    for a mass that is hoisted with the load, but is not at the load.  In both cases the chart lacks the moment of the
    offset.

    The load acts at `point` in m in the axes of the last section; None stands for the tip, the end of the axis.
    """
    last, remaining = original.sections[-1], {mass.name for mass in scene.sections[-1].masses}
    lines, end = list[str](), (last.length, 0.0, 0.0)
    for mass in last.masses:
        place, is_kept = mass.at or end, mass.name in remaining
        if not mass.hoisted if is_kept else not np.any(np.subtract(place, end)):
            continue
        if np.any(offset := np.subtract(place, point or end)):
            which = "which is hoisted with the chart's load" if is_kept else "in whose place the chart's load acts"
            lines.append(
                f"mass {mass.name!r}, {which}, is ({', '.join(f'{value:.4g}' for value in offset)}) m from that load: "
                "the chart lacks the moments of this offset and may allow too much; "
                f"point = [{', '.join(f'{value:.6g}' for value in place)}] in the study takes them along"
            )
    return lines


def _response_at_equilibria(equilibria: Sequence[Equilibrium], at: PostureMatrices) -> Response:
    """Return a response whose times are the numbers 0, 1, 2, ... of the `equilibria`.

    At each time it has the tip displacements and the contact forces of this equilibrium; all else is zero.  `at` are
    the postures of the model, with the names of its outputs and contacts.
    """
    states = [at_rest.state for at_rest in equilibria]
    t, nothing = np.arange(len(equilibria), dtype=float), np.zeros(len(equilibria))
    tip = [n for n, kind in enumerate(at.output_kinds) if kind == "tip"]
    shown = [*tip, *range(len(at.output_names), len(at.columns.names))]
    return Response(
        t=t,
        x=np.zeros(len(tip)),
        displacement=np.array([state.outputs[tip] for state in states]),
        energy=Energy(nothing, nothing, nothing),
        slider_force=np.array([state.forces for state in states]),
        residual_position=nothing,
        residual_velocity=nothing,
        seconds=0.0,
        output_names=tuple(at.columns.names[n] for n in tip),
        force_names=tuple(map(force_name, at.force_names)),
        kinds=tuple(at.columns.kinds[n] for n in shown),
        bodies=tuple(at.columns.bodies[n] for n in shown),
    )


class Stop(SceneTable):
    """A stop of luffing or slewing, in which the speed falls to zero at a constant rate."""

    of: Literal["luffing", "slewing"] = Field(description="Motion that is stopped")
    speed: Annotated[float, Field(gt=0.0)] = Field(
        description="Speed before the stop, in the scene's unit of angles per second"
    )
    within: Annotated[float, Field(gt=0.0), Usual(1e-3, 60.0, unit="s")] = Field(description="Duration of the stop, s")
    class_factor: Annotated[float, Field(ge=1.0)] | None = Field(
        default=None, description="Factor on the drive's forces that a standard gives, for comparison"
    )


@dataclass(frozen=True)
class StopMotion:
    """A stop of luffing or slewing (`angle`) from a `speed` in rad/s to rest in `duration` seconds.

    `acceleration_loads` (P, i) are the loads on i inputs at P postures by an acceleration of the angle of 1 rad/s^2.
    """

    angle: str
    speed: float
    duration: float
    acceleration_loads: Array

    def stop_figures(self, place: Place, load: float, limit: Limit | None) -> Array:
        """Return five numbers (5,) about this stop of the boom, at a place and under a `load` in kg.

        The swing after the stop is compared with the steady state: the deflection that the same deceleration would
        cause if it lasted.

        - The first number is a factor for the tip.  It is the largest displacement during and after the stop, as its
          component along the steady displacement, divided by the steady displacement.  It is NaN if the tip does not
          move.
        - The next three are used shares of `limit`: at rest, in the steady state, and the largest one during and after
          the stop.  The worse of both directions of motion is taken.  The three are NaN if `limit` is None.
        - The last one is the speed in rad/s.

        If the boom is unstable under the load, the other four numbers are NaN.
        """
        none, state = np.array([*[np.nan] * 4, self.speed]), place.equilibria.state(load)
        if not state.in_equilibrium:
            return none
        swing = stopping_swing(state.form, load, self._acting_loads(place, load), self.duration)
        if swing is None:
            return none
        tip = [n for n, kind in enumerate(place.postures.output_kinds) if kind == "tip"]
        steady = swing.steady[0][tip]
        factor = np.abs(swing.outputs[:, tip] @ steady).max() / (steady @ steady) if np.any(steady) else np.nan
        if limit is None:
            return np.append(factor, none[1:])
        share, rate = place.share(limit), self.speed / self.duration

        def most(outputs: Array, forces: Array) -> float:
            """Return the largest share of the limit when the boom stops in either direction.

            `outputs` (T, o) and `forces` (T, m), at T times during and after the stop, are those per unit of
            deceleration.
            """
            of, by = (state.outputs, state.forces), (rate * outputs, rate * forces)
            extremes = [np.vstack([values + more, values - more]) for values, more in zip(of, by, strict=True)]
            return float(share(LoadedStates.with_outputs(state, *extremes)).max())

        steadily, swinging = most(*(values[None] for values in swing.steady)), most(swing.outputs, swing.forces)
        return np.array([factor, place.used_share(limit, state), steadily, swinging, self.speed])

    def _acting_loads(self, place: Place, load: float) -> LoadEffects:
        """Return the loads at a place by an acceleration of the angle of 1 rad/s^2.

        They contain the inertia of the `load` in kg, as far as luffing lifts it: the load hangs, so that nothing
        accelerates it sideways.
        """
        at, k = place.postures, place.k
        f = self.acceleration_loads[k].copy()
        if self.angle == "luffing":  # the load hangs: only a lift of its rope accelerates it, nothing sideways
            x, _, z = at.place.hook[k]
            lifted = float(at.place.up[k] @ [-z, 0.0, x])  # m by a rotation of one radian
            f += load * lifted / place.gravity * at.loads.f[at.loads.names.index(HOOK), k]
        return LoadEffects(
            at.structure.B @ f, -at.rows.H[k] @ f, np.vstack([at.structure.direct, at.machine.loads[k]]) @ f
        )


def largest_governed_rows(load: Array) -> NDArray[np.int64]:
    """Return for each of l limits the row (l,) of `load` (p, l) in kg with the largest load that the limit governs.

    The p rows are points.  A limit governs a row if its load is the smallest of the row; rows with a smallest load of 0
    or NaN are ignored.  The result is -1 for a limit that governs no row.
    """
    least = np.where(np.isnan(load), np.inf, load)
    which, most = least.argmin(axis=1), least.min(axis=1)
    numbers = np.full(load.shape[1], -1)
    for k in range(load.shape[1]):
        governed = np.flatnonzero((which == k) & np.isfinite(most) & (most > 0.0))
        if len(governed):
            numbers[k] = governed[np.argmax(most[governed])]
    return numbers


def governing_details(
    limits: Sequence[Limit],
    places: Sequence[Place | None],
    loads: Array,
    bent: DeflectionOutputs,
    stops: Sequence[StopMotion],
) -> dict[str, NDArray[Any]]:
    """Return arrays that describe the boom at p places, one for each limit and the last one for stability.

    The n-th limit governs at the n-th place.  The boom is under slightly less than `loads` (p,) in kg.  If a limit
    governs nowhere, its place is None and its rows are NaN; if all places are None, the result is empty.  Arrays by
    name:

    - ``forces`` (p, m) N of m contacts, and their ``kinds`` (m,).
    - ``bent`` (p, b) m: b displacements across the boom, at the distances ``bent.x`` (b,) m from the tails of the
      sections with the numbers ``bent.section`` (b,), in the directions ``direction.names`` (b,).
    - ``stress`` (p, s) Pa: von Mises stress at s probes.
    - ``used`` (p, l): used shares of all limits; the last one is the load divided by the buckling load.
    - ``luffing`` and ``slewed`` (p,) rad: angles of the boom.
    - ``stops`` (p, stops, 5): numbers of `StopMotion.stop_figures`, for each of `stops`.
    - ``forces.names``, ``stress.names``, ``section.names``: names of contacts, probes, sections.
    """
    at = next((place.postures for place in places if place is not None), None)
    if at is None:
        return {}
    governing_limits = [*limits, None]  # stability has no share that a swing changes
    rows = [
        None if place is None else _place_arrays(limits, limit, place, load, bent, stops)
        for limit, place, load in zip(governing_limits, places, loads.tolist(), strict=True)
    ]
    example_row = next(row for row in rows if row is not None)
    empty = {name: np.full_like(values, np.nan) for name, values in example_row.items()}
    arrays = {name: np.array([(row or empty)[name] for row in rows]) for name in example_row}
    names = {"forces": at.force_names, "stress": tuple(_stress_columns(at))}
    names |= {"direction": bent.direction, "section": bent.names}
    arrays |= {f"{of}.names": np.array(named, dtype=np.str_) for of, named in names.items()}
    return arrays | {"kinds": np.array(at.force_kinds, dtype=np.str_), "bent.x": bent.x, "bent.section": bent.section}


def _stress_columns(at: PostureMatrices) -> dict[str, dict[str, int]]:
    """Return, by probe, the column of each stress component among the outputs of the postures `at`.

    Probes that limits of the stress field add are left out.
    """
    return {probe: components for probe, components in at.columns.stress_columns().items() if FIELD not in probe}


def _place_arrays(
    limits: Sequence[Limit],
    limit: Limit | None,
    place: Place,
    load: float,
    bent: DeflectionOutputs,
    stops: Sequence[StopMotion],
) -> dict[str, Array]:
    """Return the row of a place in each array of `governing_details`, by the array's name.

    `limit` is the limit that governs at the place, one of `limits`; None stands for stability.  The arrays are those
    under slightly less than `load` in kg, as there is no equilibrium at the load at which stability is lost.  `bent`
    are the outputs that show the bent boom, and `stops` the stopping motions whose swings are computed.
    """
    at, load = place.postures, load * (1.0 - JUST_BELOW)
    state = place.equilibria.state(load)
    shape = Place(bent.replace_outputs(at), place.k, place.amounts, place.gravity).equilibria.state(load)
    of_probes = [(list(numbers.values()), tuple(numbers)) for numbers in _stress_columns(at).values()]
    return {
        "forces": state.forces,
        "bent": shape.outputs,
        "stress": np.array([float(von_mises_stress(state.outputs[numbers], names)) for numbers, names in of_probes]),
        "used": np.array([*(place.used_share(limit, state) for limit in limits), load / state.form.critical]),
        "luffing": at.place.luffing[place.k],
        "slewed": at.place.slewing[place.k],
        "stops": np.array([stop.stop_figures(place, load, limit) for stop in stops]).reshape(-1, 5),
    }
