"""Warnings of a load chart: those that a run has, for the boom at rest at each place, without and with its load."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.errors import relative_error
from pmr.compare.forces import missing_reactions, pulled_rings, ropes_part, unknown_forces
from pmr.compare.trust import budget_warnings, large_motion
from pmr.results import Energy, Response
from pmr.results.run import Part, grave
from pmr.scene import Scene
from pmr.scene.built import force_of
from pmr.simulation.statics.loaded import State
from pmr.simulation.statics.postures import Postures
from pmr.studies.allowed import Place
from pmr.system.contacts import Contact
from pmr.system.contacts import Place as ContactPlace
from pmr.system.system import System

Array = NDArray[np.float64]

#: Share of a load by which less of it is looked at.
BELOW = 1e-6
#: Kinds of outputs and contacts, as a budget calls their errors.
KINDS = {"tip": "tip", "pad": "pad_force", "cylinder": "cylinder_force", "support": "support_force"}


@dataclass(frozen=True)
class AtRest:
    """A place under a load in kg at which the boom stands, and where that is in words."""

    place: Place
    load: float
    words: str

    @property
    def state(self) -> State:
        """Outputs and forces there."""
        return self.place.loaded.state(self.load)


@dataclass(frozen=True)
class RestingResponse(Response):
    """A response that has a place at rest for each time, numbered from 0."""

    words: tuple[str, ...] = ()

    def when(self, t: float, s: float | None = None) -> str:
        """The place in words."""
        return self.words[int(t)]


def contacts_as_text(system: System) -> NDArray[np.str_]:
    """Contacts of a system in JSON, as far as warnings depend on them."""
    records = [
        {
            "name": contact.name,
            "body": contact.inner.body,
            "path": contact.inner.path,
            "clearance": contact.clearance,
            "kind": contact.kind,
        }
        for contact in system.contacts
    ]
    return np.array(json.dumps(records))


def contacts_from_text(text: NDArray[np.str_]) -> list[Contact]:
    """The contacts that `contacts_as_text` wrote, without their places and stiffnesses."""
    return [
        Contact(
            record["name"],
            ContactPlace(record["body"], record["name"], path=record["path"]),
            clearance=record["clearance"],
            kind=record["kind"],
        )
        for record in json.loads(str(text))
    ]


def boom_at_rest(place: Place, load: float, reach: float) -> list[AtRest]:
    """The boom at a place without a load, and just below a load in kg, as far as it stands."""
    at, k = place.at, place.k
    where = f"at a reach of {reach:.4g} m, raised {np.rad2deg(at.luffing[k]):.4g} degrees"
    if at.slewing[k]:
        where += f", slewed {np.rad2deg(at.slewing[k]):.4g} degrees"
    rests = [AtRest(place, 0.0, f"{where}, without a load")]
    if load > 0.0:
        rests.append(AtRest(place, load * (1.0 - BELOW), f"{where}, under {load:.4g} kg"))
    return [at_rest for at_rest in rests if at_rest.state.stands]


def warnings_of_row(
    scene: Scene,
    contacts: Sequence[Contact],
    places: Callable[[Postures, int], Sequence[Place]],
    models: Mapping[str, tuple[Postures, str, float]],
    reach: Array,
    loads: Array,
    cases: Array,
    first: int,
) -> tuple[str, ...]:
    """Lines of a run's warnings at the places of a row, without a load and under the least of the loads (p, l) kg.

    `places` has a place in all load cases, by its number, of which `first` is the least of the row; `cases` (p, l) are
    those of the loads.  `models` are as ``others`` of `warnings`, and the chart's own one as ``own``; the boom's tip is
    at `reach` (P,) m along it.
    """
    rests, numbers = list[AtRest](), list[int]()
    for k, (of_limits, of_cases) in enumerate(zip(loads, cases, strict=True), first):
        limit = int(of_limits.argmin())
        place = places(models["own"][0], k)[of_cases[limit]]
        standing = boom_at_rest(place, float(of_limits[limit]), float(reach[k]))
        rests += standing
        numbers += [int(of_cases[limit])] * len(standing)
    other_models = {
        name: ([places(at, at_rest.place.k)[n] for at_rest, n in zip(rests, numbers, strict=True)], called, share)
        for name, (at, called, share) in models.items()
        if name != "own"
    }
    return warnings(scene, contacts, rests, float(reach.max()), other_models)


def warnings(
    scene: Scene,
    contacts: Sequence[Contact],
    rests: Sequence[AtRest],
    reach: float,
    other_models: Mapping[str, tuple[Sequence[Place], str, float]],
) -> tuple[str, ...]:
    """Lines of a run's warnings for places at rest, the gravest first, of a boom that reaches so far at most, in m.

    `others` has, by ``model`` and ``mesh``, the same places of another model, what that is called, and the share of
    the difference by which the chart's own is off.
    """
    if not rests:
        return ()
    response = _response(rests)
    parts = [
        Part(grave=pulled_rings(scene, contacts, response)),
        ropes_part(scene, response),
        Part(grave=large_motion(reach, [response])),
    ]
    budget = {}
    for name, (places, called, share) in other_models.items():
        other_rests = [AtRest(place, at_rest.load, at_rest.words) for place, at_rest in zip(places, rests, strict=True)]
        budget[name] = _off(rests, other_rests, share) | ({"beside": called} if name == "model" else {})
    hints = [*unknown_forces(scene, response), *missing_reactions(scene)]
    return (*grave(parts), *budget_warnings(scene, budget), *hints)


def _response(rests: Sequence[AtRest]) -> RestingResponse:
    """Displacements of the tip and forces of contacts, a place for each time."""
    at, states = rests[0].place.at, [at_rest.state for at_rest in rests]
    t, nothing = np.arange(len(rests), dtype=float), np.zeros(len(rests))
    tip = _numbers(at, "tip")[0]
    return RestingResponse(
        t=t,
        x=np.zeros(len(tip)),
        displacement=np.array([state.outputs[tip] for state in states]),
        energy=Energy(nothing, nothing, nothing),
        slider_force=np.array([state.forces for state in states]),
        residual_position=nothing,
        residual_velocity=nothing,
        seconds=0.0,
        output_names=tuple(at.output_names[n] for n in tip),
        force_names=tuple(map(force_of, at.force_names)),
        words=tuple(at_rest.words for at_rest in rests),
    )


def _off(rests: Sequence[AtRest], other: Sequence[AtRest], share: float) -> dict[str, Any]:
    """By kind, the share of what own figures are apart from those of another model, as fractions of the latter."""
    pairs = [(at_rest.state, counterpart.state) for at_rest, counterpart in zip(rests, other, strict=True)]
    pairs = [(mine, theirs) for mine, theirs in pairs if theirs.stands]
    differences = dict[str, float]()
    for kind, called in KINDS.items():
        y, reference = (
            np.array([_values(at_rest.place.at, pair[n], kind) for pair in pairs])
            for n, at_rest in enumerate((rests[0], other[0]))
        )
        if y.size and y.shape == reference.shape and np.any(reference):
            differences[called] = share * relative_error(y, reference)
    return differences


def _values(at: Postures, state: State, kind: str) -> list[float]:
    """Outputs and forces of a kind, in the order of their names."""
    outputs, forces = _numbers(at, kind)
    named = [(at.output_names[n], state.outputs[n]) for n in outputs]
    named += [(at.force_names[n], state.forces[n]) for n in forces]
    return [float(value) for _, value in sorted(named)]


def _numbers(at: Postures, kind: str) -> tuple[list[int], list[int]]:
    """Numbers of outputs and of contacts of a kind."""
    outputs, forces = at.output_kinds, at.force_kinds
    return [n for n, label in enumerate(outputs) if label == kind], [n for n, one in enumerate(forces) if one == kind]
