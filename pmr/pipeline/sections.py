"""Sections that slide in one another: each is reduced by itself, then all are simulated as one system."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.compare import boom_figures as figures
from pmr.compare import pad_forces
from pmr.compare.boom_motions import FullBoom, FullRun
from pmr.compare.boom_runs import SteppedBoom
from pmr.compare.booms import quantities, with_friction
from pmr.compare.errors import relative_error
from pmr.compare.estimated import SimulatedSystem, sections_error, step_part
from pmr.compare.simulated import simulate_sections
from pmr.compare.summary import Part, compared
from pmr.errors import on_first
from pmr.errors.environment import Clock
from pmr.fullmodel.build import Built
from pmr.pipeline.bodies import Bodies, Judged, Motions
from pmr.pipeline.search import chosen
from pmr.reduced.model import ReducedModel
from pmr.reduction.cache import Cache
from pmr.reduction.recover.from_scene import Recovered, recover_sections, recovered_steps, states_of
from pmr.reduction.sections import ReducedSection, reduce_sections
from pmr.results import BodyResult, Frequencies, FrequencyMap
from pmr.scene import Scene
from pmr.simulation import Excitation, contact_step
from pmr.simulation.contact_step import contact_frequency
from pmr.simulation.excitation import places
from pmr.simulation.petsc import Checkpoint
from pmr.system.assembly import Assembly
from pmr.system.from_scene import system_of
from pmr.system.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SectionReduction:
    """The full models of sections by their names, and what they are reduced to; the same on every rank."""

    scene: Scene
    built: Mapping[str, Built]
    sections: Mapping[str, ReducedSection]

    @property
    def reduced(self) -> Mapping[str, ReducedModel]:
        """The reduced model of each section."""
        return {name: one.model for name, one in self.sections.items()}

    @property
    def system(self) -> System:
        """What `pmr.simulate(boom, ...)` takes, and a file holds."""
        return replace(system_of(self.scene, self.reduced), provenance=self.scene.recorded)


class Sections(Bodies):
    """On carriers, by free modes, joined by the pads and cylinders of their joints."""

    STAGES = ("assemble", "reduce", "recover", "estimate")

    def __init__(self, scene: Scene, built: Mapping[str, Built], clock: Clock, caches: Mapping[str, Cache]) -> None:
        super().__init__(scene, built, clock, caches)
        with clock.stage("reduce"):
            self.sections = reduce_sections(scene, built, caches)
        self.choice = chosen(scene, _modal(self.sections), self._on_finer, self.comm, clock)
        if self.choice is not None:
            self.scene, models = self.choice.scene, self.choice.models
            self.sections = {name: replace(one, modal=models[name]) for name, one in self.sections.items()}
        self.reduced = {name: one.model for name, one in self.sections.items()}
        self._system, self.excitation = system_of(self.scene, self.reduced), Excitation.of(self.scene)
        self._x = places(self._system, self.excitation)
        self._omega = contact_frequency(self._system, self.excitation)
        self._made = self.excitation.stepping  # in how many parts, once the reduced model was simulated
        self.full = FullBoom.of(self.scene, built) if "full" in self.scene.compare.against else None

    @property
    def system(self) -> System:
        return self._system

    def frequencies(self) -> Frequencies:
        """At some steps, every contact closed."""
        scene, large = self.scene, self.full is not None and self.full.simulator == "petsc"
        count = figures.FEWER_PLACES if large else figures.PLACES
        steps = figures.on_the_way(scene, self.excitation.times, count)
        curves = {} if self.full is None else {"full": self._full_frequencies(self.full, steps)}
        found = on_first(self.comm, lambda: self._reduced_frequencies(steps))
        curves |= {} if found is None else {"reduced": found[0]}
        over_joints = None if found is None else found[1]
        reach = scene.reach(self.excitation.times[steps])
        return Frequencies(reach, self.excitation.s[steps], curves, over_joints)

    def simulate(self, checkpoint: Checkpoint | None) -> Motions:
        scene, system, excitation, clock = self.scene, self.system, self.excitation, self.clock
        made = on_first(self.comm, lambda: simulate_sections(scene, system, excitation, clock))
        stepping = excitation.stepping
        if made is not None:
            stepping = contact_step.as_made(stepping, made.first.parts, self._omega)
        self._made, whole = self.comm.bcast(stepping), FullRun(None, "", {})
        if self.full is not None:
            whole = self.full.simulate(scene, self._made, recovered_steps(scene), clock, checkpoint)
        missing, full = ({"full": whole.missing}, {}) if whole.missing else ({}, whole.states)
        if made is None:
            return Motions({}, {}, {}, {}, missing, None, full)
        found = {} if whole.response is None else {"full": whole.response}
        found |= {"reduced": made.response}
        responses = {name: with_friction(scene, system.contacts, one) for name, one in found.items()}
        seconds = {**made.seconds} | {name: one.seconds for name, one in found.items() if name == "full"}
        simulators = {
            "reduced": scene.simulation.simulators[0],
            "full": self.full.simulator if self.full else "",
        }
        return Motions(responses, seconds, made.agreement, simulators, missing, made.first, full)

    def recover(self, motions: Motions) -> Mapping[str, Recovered]:
        steps = recovered_steps(self.scene)
        states = None if motions.states is None else states_of(self.system, motions.states, steps)
        return recover_sections(self.scene, self.built, self.sections, self.comm.bcast(states), motions.full)

    def judge(self, motions: Motions, frequencies: Frequencies, seen: Mapping[str, Recovered]) -> Judged:
        scene, system, excitation, choice = self.scene, self.system, self.excitation, self.choice
        responses, modal = motions.responses, _modal(self.sections)
        reduced = responses["reduced"]
        estimate, step = (None, None) if choice is None else (choice.found.estimate, choice.found.step_error)
        moved = SimulatedSystem(system, excitation.with_stepping(self._made), motions.states)
        error = sections_error(scene, modal, moved, self.clock, estimate)
        stepped = SteppedBoom(scene, system, excitation)
        sizes = {name: {"full": self.built[name].model.size, "reduced": one.size} for name, one in self.reduced.items()}
        more = {
            name: ({"estimate": error.sections[name]} if name in error.sections else {})
            | (seen[name].summary() if name in seen else {})
            for name in scene.names
        }
        parts = [
            Part({"basis": {"kind": "free modes of every section, with residual flexibility"}}),
            compared(responses, quantities(scene, reduced), motions.simulators, relative_error),
            error.part,
            figures.sections(scene, responses, sizes, more),
            figures.joints(scene, reduced, system),
            Part(pad_forces.reactions(scene, reduced, scene.reach(excitation.times)), pad_forces.missing(scene)),
            step_part(stepped, frequencies.models["reduced"], self.clock, scene.accuracy is not None, step),
            figures.beside_published(scene, frequencies),
            Part(
                contact_step.summary_of(self._omega, self._made),
                contact_step.warnings_of(self._omega, excitation.stepping),
            ),
        ]
        bodies = {name: BodyResult() for name in scene.names}
        return Judged(parts, responses, figures.in_frequency(scene, system, excitation), error.band, bodies)

    def _on_finer(self, finer: Scene) -> Mapping[str, ReducedModel]:
        return _modal(reduce_sections(finer, self.build(finer)))

    def _reduced_frequencies(self, steps: NDArray[np.int64]) -> tuple[Array, FrequencyMap | None]:
        """At some steps, and over two joints."""
        at_steps = Assembly(self.system).frequencies(self._x[steps], figures.CURVES)
        return at_steps, figures.frequency_map(self.scene, self.system)

    def _full_frequencies(self, full: FullBoom, steps: NDArray[np.int64]) -> Array:
        """At some steps."""
        if not self.caches:
            return full.frequencies(self.scene, steps)
        content = [one.content for one in self.caches.values()]
        asked = {"sections": content, "contacts": repr(full.whole.contacts)}
        asked["extensions"] = self.excitation.s[steps].tolist()
        cache = self.caches[self.scene.names[0]]
        return cache.arrays("frequencies", asked, lambda: full.frequencies(self.scene, steps))


def _modal(sections: Mapping[str, ReducedSection]) -> dict[str, ReducedModel]:
    """The models on free modes."""
    return {name: one.modal for name, one in sections.items()}
