"""Warnings of a load chart: a run's warnings, for the boom at rest at each point, without and with its load."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pmr.compare.errors import relative_error
from pmr.compare.forces import missing_reaction_warnings, pulled_pad_warnings, ropes_part, unknown_force_warnings
from pmr.compare.trust import budget_warnings, large_motion_warnings
from pmr.files.arrays import Array, Summary
from pmr.results import Energy, Response
from pmr.results.run import SummaryPart, grave_warnings
from pmr.scene import Scene
from pmr.scene.built import force_name
from pmr.simulation.statics.loaded import LoadedState
from pmr.simulation.statics.postures import HOOK, PostureMatrices
from pmr.studies.allowed import JUST_BELOW, Place
from pmr.studies.chart_models import ChartModels
from pmr.system.contacts import Contact

#: Names of the errors in a budget, by the kind of outputs and contacts.
KINDS = {"tip": "tip", "pad": "pad_force", "cylinder": "cylinder_force", "support": "support_force"}


@dataclass(frozen=True)
class Equilibrium:
    """The boom in equilibrium at a `place` (posture and load case) under a `load` in kg, with a `description`."""

    place: Place
    load: float
    description: str

    @property
    def state(self) -> LoadedState:
        """Outputs, contact forces and closed contacts in this equilibrium."""
        return self.place.equilibria.state(self.load)


@dataclass(frozen=True)
class RestingResponse(Response):
    """Response whose times 0, 1, 2, ... are the numbers of equilibria; `words` describe each equilibrium."""

    words: tuple[str, ...] = ()

    def when(self, t: float, s: float | None = None) -> str:
        """Return the description of equilibrium number `t`; the path coordinate `s` is ignored."""
        return self.words[int(t)]


def stable_equilibria(place: Place, load: float, reach: float) -> list[Equilibrium]:
    """Return the stable equilibria at a place: without a load, and slightly below `load` in kg if `load` is positive.

    An unstable equilibrium is left out.  `reach` in m, the length of the boom, is used in the descriptions only.
    """
    at, k = place.postures, place.k
    where = f"at a reach of {reach:.4g} m, raised {np.rad2deg(at.place.luffing[k]):.4g} degrees"
    if at.place.slewing[k]:
        where += f", slewed {np.rad2deg(at.place.slewing[k]):.4g} degrees"
    equilibria = [Equilibrium(place, 0.0, f"{where}, without a load")]
    if load > 0.0:
        loaded = f"{where}, under {float(f'{load:.4g}'):.10g} kg"
        equilibria.append(Equilibrium(place, load * (1.0 - JUST_BELOW), loaded))
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
    """Return a run's warnings at the points of a row of a chart, without a load and just below the least allowed load.

    `loads` (p, l) in kg are the loads that l limits allow at p points, and `cases` (p, l) the numbers of the load cases
    in which these loads are smallest.  `first` is the number of the row's first point.  ``places(postures, number)``
    returns, for the postures of a model and the number of a point, a `Place` for each load case.
    """
    reach, compared = models.reach, models.comparisons
    equilibria, of_compared = list[Equilibrium](), {part: list[Equilibrium]() for part in compared}
    for k, (of_limits, of_cases) in enumerate(zip(loads, cases, strict=True), first):
        limit = int(of_limits.argmin())
        case = int(of_cases[limit])
        standing = stable_equilibria(places(models.reduced, k)[case], float(of_limits[limit]), float(reach[k]))
        equilibria += standing
        for part, other in compared.items():
            of_compared[part] += [replace(at_rest, place=places(other.postures, k)[case]) for at_rest in standing]
    if not equilibria:
        return ()
    response = _response_at_equilibria(equilibria)
    parts = [
        SummaryPart(grave=pulled_pad_warnings(scene, contacts, response)),
        ropes_part(scene, response),
        SummaryPart(grave=large_motion_warnings(float(reach.max()), [response])),
    ]
    budget = {}
    for part, other in compared.items():
        other_model = {"beside": other.label} if part == "model" else {}
        budget[part] = _relative_errors(equilibria, of_compared[part], other.share) | other_model
    hints = [*unknown_force_warnings(scene, response), *missing_reaction_warnings(scene)]
    return (*grave_warnings(parts), *budget_warnings(scene, budget), *hints)


def unnamed_loads(scene: Scene, cases: Sequence[Summary]) -> Iterator[str]:
    """Yield a line for each load that acts in runs of the scene but is listed in ``loads`` of no case of the chart."""
    named = {HOOK} | {name for case in cases for name in case["loads"]}
    for part in scene.sections:
        for load in part.loads:
            if load.name not in named and any(load.signal.bounds(0.0, scene.time.end)):
                yield f"load {load.name!r} acts in runs of this scene, but the chart lacks it: no load case names it"


def replaced_mass_warnings(original: Scene, scene: Scene) -> list[str]:
    """Return a line for each mass of `original` that `scene` lacks and that is beside or beyond the tip's axis."""
    last, remaining = original.sections[-1], {mass.name for mass in scene.sections[-1].masses}
    lines = list[str]()
    for mass in last.masses:
        offset = np.subtract(mass.at or (last.length, 0.0, 0.0), (last.length, 0.0, 0.0))
        if mass.name not in remaining and np.any(offset):
            place = ", ".join(f"{value:.4g}" for value in offset)
            lines.append(
                f"mass {mass.name!r} is at ({place}) m from the end of the axis; the chart's load in its place acts "
                "on the axis: the chart lacks the moments of this offset and may allow too much"
            )
    return lines


def _response_at_equilibria(equilibria: Sequence[Equilibrium]) -> RestingResponse:
    """Return a response with tip displacements and contact forces of one equilibrium at each time; all else is zero."""
    at, states = equilibria[0].place.postures, [at_rest.state for at_rest in equilibria]
    t, nothing = np.arange(len(equilibria), dtype=float), np.zeros(len(equilibria))
    tip = _indices_of_kind(at, "tip")[0]
    return RestingResponse(
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
        words=tuple(at_rest.description for at_rest in equilibria),
    )


def _relative_errors(
    equilibria: Sequence[Equilibrium], counterparts: Sequence[Equilibrium], share: float
) -> dict[str, Any]:
    """Return the relative error of each kind of output and contact force, by the name of the error.

    The error is `share` times the difference to another model; `counterparts` are the equilibria of that model at the
    same places and loads as `equilibria`.  A kind is left out if a model lacks it or if the two models have different
    numbers of its outputs.
    """
    pairs = [(at_rest.state, counterpart.state) for at_rest, counterpart in zip(equilibria, counterparts, strict=True)]
    pairs = [(mine, theirs) for mine, theirs in pairs if theirs.in_equilibrium]
    differences = dict[str, float]()
    for kind, called in KINDS.items():
        y, reference = (
            np.array([_values_of_kind(at_rest.place.postures, pair[n], kind) for pair in pairs])
            for n, at_rest in enumerate((equilibria[0], counterparts[0]))
        )
        if y.size and y.shape == reference.shape and np.any(reference):
            differences[called] = share * relative_error(y, reference)
    return differences


def _values_of_kind(at: PostureMatrices, state: LoadedState, kind: str) -> list[float]:
    """Return the values of all outputs and contact forces of a kind in a state of the model `at`, sorted by name."""
    outputs, forces = _indices_of_kind(at, kind)
    named = [(at.columns.names[n], state.outputs[n]) for n in outputs]
    named += [(at.force_names[n], state.forces[n]) for n in forces]
    return [float(value) for _, value in sorted(named)]


def _indices_of_kind(at: PostureMatrices, kind: str) -> tuple[list[int], list[int]]:
    """Return the indices of the outputs of a kind in the model `at`, and the indices of its contacts of that kind."""
    outputs, forces = ([n for n, of in enumerate(kinds) if of == kind] for kinds in (at.output_kinds, at.force_kinds))
    return outputs, forces
