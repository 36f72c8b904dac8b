"""The same for a boom of several sections: each is reduced by itself, then all are simulated as one system."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmr.compare import boom_figures as figures
from pmr.compare import memory, pad_forces
from pmr.compare.accuracy import order
from pmr.compare.boom_estimate import BoomError, boom_error
from pmr.compare.boom_motions import FullBoom, FullRun
from pmr.compare.boom_runs import SteppedBoom
from pmr.compare.booms import quantities, with_friction
from pmr.compare.errors import relative_error
from pmr.compare.estimated import step_part
from pmr.compare.frequencies import frequency_part
from pmr.compare.responses import check_installed
from pmr.compare.simulated import BoomSimulations, simulate_sections
from pmr.compare.summary import Part, compared, driven, gathered, made_with, simulated, theory, trusted
from pmr.errors import InputError, environment, on_first
from pmr.errors.environment import Clock
from pmr.fem.compat import MPI
from pmr.fem.compat import versions as fenicsx_versions
from pmr.fullmodel import probes
from pmr.fullmodel.build import Built, build_bodies, left_free
from pmr.fullmodel.build import warnings as build_warnings
from pmr.pipeline import Outcome, Reduction, reduce, run
from pmr.pipeline.search import chosen
from pmr.recover.from_scene import Recovered, recover_sections, recovered_steps, states_of
from pmr.reduced.model import ReducedModel
from pmr.reduction.cache import cache_in
from pmr.reduction.sections import ReducedSection, reduce_sections
from pmr.results import BodyResult, Frequencies, Loads, Paths, Response, RunResult
from pmr.scene import Scene
from pmr.simulation import contact_step
from pmr.simulation.excitation import Excitation
from pmr.simulation.native.multibody_march import contact_frequency, places
from pmr.simulation.petsc import Checkpoint
from pmr.system.assembly import Assembly
from pmr.system.from_scene import system_of
from pmr.system.system import System

Array = NDArray[np.float64]

#: Stages whose seconds stand in summary.json, beside those of the simulators.
STAGES = ("assemble", "reduce", "recover", "estimate")


@dataclass(frozen=True)
class BoomOutcome:
    """What a run of a boom returns on rank 0: its result, and the system of its reduced sections."""

    result: RunResult
    system: System

    @property
    def reduced(self) -> Mapping[str, ReducedModel]:
        """The reduced model of each section."""
        return self.system.reduced

    def save(self, folder: Path) -> Path:
        """Write the system into a folder."""
        return self.system.save(folder / "system.npz")


def run_boom(
    boom: Scene,
    comm: MPI.Comm = MPI.COMM_WORLD,
    clock: Clock | None = None,
    checkpoint: Checkpoint | None = None,
    cache: Path | None = None,
) -> BoomOutcome | None:
    """Run a boom on `comm`; what is not distributed runs on rank 0, the other ranks get None.

    With a `checkpoint` a full-order simulation that was cut off goes on.  In a `cache`, a folder, reductions of the
    sections and frequencies of full models are cached and found.

    Raises
    ------
    InputError
        If the boom asks for what cannot be had; its source is ``"scene"``.
    ConvergenceError, SimulationError
        If a solver fails.
    """
    check_installed(boom)
    return _Run(boom, comm, clock or Clock(), cache).outcome(checkpoint)


def _modal(sections: Mapping[str, ReducedSection]) -> dict[str, ReducedModel]:
    """The models on free modes."""
    return {name: one.modal for name, one in sections.items()}


class _Run:
    """A boom's sections, built and reduced, what is simulated of them, and what that says."""

    def __init__(self, boom: Scene, comm: MPI.Comm, clock: Clock, cache: Path | None) -> None:
        self.boom, self.comm, self.clock = boom, comm, clock
        with clock.stage("assemble"):
            self.built = build_bodies(boom, comm)
            self.free = left_free(boom, self.built) if boom.free_motions == "allowed" else []
        self.full_size = sum(one.model.size for one in self.built.values())
        self.outputs = sum(one.model.outputs.getSize()[1] for one in self.built.values())
        free = comm.bcast(environment.available_memory() if comm.rank == 0 else None)
        memory.check(boom, self.full_size, self.outputs, free, tell=comm.rank == 0)
        with clock.stage("reduce"):
            self.caches = (
                {} if cache is None else {name: cache_in(cache, one.model) for name, one in self.built.items()}
            )
            self.sections = reduce_sections(boom, self.built, self.caches)
        self.choice = chosen(boom, _modal(self.sections), self._on_finer, comm, clock)
        if self.choice is not None:
            models = self.choice.models
            self.boom = boom = self.choice.scene
            self.sections = {name: replace(one, modal=models[name]) for name, one in self.sections.items()}
        self.reduced = {name: one.model for name, one in self.sections.items()}
        self.system = system_of(boom, self.reduced)
        self.excitation = Excitation.of(boom)
        self.full = FullBoom.of(boom, self.built) if "full" in boom.compare.against else None

    def _on_finer(self, finer: Scene) -> dict[str, ReducedModel]:
        return _modal(reduce_sections(finer, build_bodies(finer, self.comm)))

    def outcome(self, checkpoint: Checkpoint | None) -> BoomOutcome | None:
        """All the rest; None beside rank 0."""
        boom, system, excitation, clock = self.boom, self.system, self.excitation, self.clock
        x, omega = places(system, excitation), contact_frequency(system, excitation)
        with clock.stage("frequencies"):
            large = self.full is not None and self.full.simulator == "petsc"
            steps = figures.on_the_way(boom, excitation.times, figures.FEWER_PLACES if large else figures.PLACES)
            curves = {} if self.full is None else {"full": self._full_frequencies(self.full, steps)}
        simulations = on_first(self.comm, lambda: simulate_sections(boom, system, excitation, clock))
        made = excitation.stepping
        if simulations is not None:
            made = contact_step.as_made(made, simulations.first.parts, omega)
        made, whole = self.comm.bcast(made), FullRun(None, "", {})
        if self.full is not None:
            whole = self.full.simulate(boom, made, recovered_steps(boom), clock, checkpoint)
        seen = self._recovered(simulations, whole)
        if simulations is None:
            return None
        found = {} if whole.response is None else {"full": whole.response}
        found |= {"reduced": simulations.response}
        responses = {name: with_friction(boom, system.contacts, one) for name, one in found.items()}
        curves |= {"reduced": Assembly(system).frequencies(x[steps], figures.CURVES)}
        modal = _modal(self.sections)
        estimate, step = (
            (None, None) if self.choice is None else (self.choice.found.estimate, self.choice.found.step_error)
        )
        error = boom_error(boom, modal, system, excitation.with_stepping(made), simulations.first, clock, estimate)
        stepped = SteppedBoom(boom, system, excitation)
        reach, over_joints = boom.reach(excitation.times), figures.frequency_map(boom, system)
        frequencies = Frequencies(reach[steps], excitation.s[steps], curves, over_joints)
        in_frequency = figures.in_frequency(boom, system, excitation)
        structures = {id(one): one.structure for one in self.built.values()}
        parts = [
            *self._parts(simulations, responses, error, seen),
            step_part(stepped, curves["reduced"], clock, boom.accuracy is not None, step),
            figures.beside_published(boom, frequencies),
            frequency_part(in_frequency),
            Part(probes.places({name: one.structure.outputs for name, one in self.built.items()})),
            driven(excitation),
            Part(contact_step.summary_of(omega, made), contact_step.warnings_of(omega, excitation.stepping)),
            trusted({"full": whole.missing} if whole.missing else {}, responses),
            *(Part(warnings=build_warnings(structure)) for structure in structures.values()),
            Part(warnings=self.free + memory.warnings(boom, self.full_size, self.outputs)),
            theory(boom, responses),
        ]
        paths = Paths(tuple(excitation.paths), excitation.s, excitation.rates)
        loads = Loads(system.input_names, system.input_units, excitation.forces(system.input_names))
        bodies = {name: BodyResult() for name in boom.names}
        bodies |= {
            name: BodyResult(fields=one.reduced.fields, peak_stress=one.histories()) for name, one in seen.items()
        }
        result = RunResult(boom, gathered(parts), responses, paths, loads, frequencies, bodies, reach, in_frequency)
        made_from = boom.recorded | {"versions": result.summary["versions"]}
        return BoomOutcome(result, replace(system, provenance=made_from))

    def _full_frequencies(self, full: FullBoom, steps: NDArray[np.int64]) -> Array:
        """At some steps."""
        if not self.caches:
            return full.frequencies(self.boom, steps)
        content = [one.content for one in self.caches.values()]
        asked = {"sections": content, "contacts": repr(full.whole.contacts)}
        asked["extensions"] = self.excitation.s[steps].tolist()
        cache = self.caches[self.boom.names[0]]
        return cache.arrays("frequencies", asked, lambda: full.frequencies(self.boom, steps))

    def _recovered(self, simulations: BoomSimulations | None, whole: FullRun) -> Mapping[str, Recovered]:
        """What the boom's recovery asks for of each section; collective."""
        if self.boom.recovery is None:
            return {}
        with self.clock.stage("recover"):
            steps = recovered_steps(self.boom)
            states = None if simulations is None else states_of(self.system, simulations.first, steps)
            full = {} if whole.missing else whole.states
            return recover_sections(self.boom, self.built, self.sections, self.comm.bcast(states), full)

    def _parts(
        self,
        simulations: BoomSimulations,
        responses: Mapping[str, Response],
        error: BoomError,
        seen: Mapping[str, Recovered],
    ) -> list[Part]:
        """What the models are, and how their motions compare."""
        boom, choice, reduced = self.boom, self.choice, responses["reduced"]
        sizes = {name: {"full": self.built[name].model.size, "reduced": one.size} for name, one in self.reduced.items()}
        simulators = {"reduced": boom.simulation.simulators[0], "full": self.full.simulator if self.full else ""}
        stages = {name: self.clock.seconds[name] for name in STAGES if name in self.clock.seconds}
        seconds = {**simulations.seconds, **({"full": responses["full"].seconds} if "full" in responses else {})}
        more = {
            name: ({"estimate": error.sections[name]} if name in error.sections else {})
            | (seen[name].summary() if name in seen else {})
            for name in boom.names
        }
        return [
            made_with(boom, fenicsx_versions()),
            Part({"coordinates": {kind: sum(size[kind] for size in sizes.values()) for kind in ("full", "reduced")}}),
            Part({"basis": {"kind": "free modes of every section, with residual flexibility"}}),
            compared(responses, quantities(boom, reduced), simulators, relative_error),
            simulated(seconds, simulations.agreement, stages),
            error.part,
            Part() if choice is None else Part(order.summary(choice), order.warnings(choice)),
            figures.sections(boom, responses, sizes, more),
            figures.joints(boom, reduced, self.system),
            Part(pad_forces.reactions(boom, reduced, boom.reach(self.excitation.times)), pad_forces.missing(boom)),
        ]


@dataclass(frozen=True)
class BoomReduction:
    """The full models of a boom's sections by their names, and what they are reduced to; the same on every rank."""

    boom: Scene
    built: Mapping[str, Built]
    sections: Mapping[str, ReducedSection]

    @property
    def reduced(self) -> Mapping[str, ReducedModel]:
        """The reduced model of each section."""
        return {name: one.model for name, one in self.sections.items()}

    @property
    def system(self) -> System:
        """What `pmr.simulate(boom, ...)` takes, and a file holds."""
        return replace(system_of(self.boom, self.reduced), provenance=self.boom.recorded)


def reduce_either(
    scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD, clock: Clock | None = None
) -> Reduction | BoomReduction:
    """Reduce a scene, as `pmr.pipeline.reduce`, or all sections of a boom; collective.

    Raises an InputError, besides, if a tolerance or a budget is to decide: it asks for a step as well.
    """
    if scene.ordered is not None:
        allowed = "none is allowed where the reduced model alone is made: pmr.run(scene) chooses model and step"
        raise InputError("scene", "budget" if scene.accuracy is None else "accuracy", None, allowed)
    if len(scene.sections) == 1:
        return reduce(scene, comm, clock)
    built = build_bodies(scene, comm)
    return BoomReduction(scene, built, reduce_sections(scene, built))


def run_either(
    scene: Scene,
    comm: MPI.Comm = MPI.COMM_WORLD,
    clock: Clock | None = None,
    checkpoint: Checkpoint | None = None,
    cache: Path | None = None,
) -> Outcome | BoomOutcome | None:
    """Run a scene the whole way, as `pmr.pipeline.run`, or a boom, as `run_boom`."""
    simulated = run_boom if len(scene.sections) > 1 else run
    try:
        return simulated(scene, comm, clock, checkpoint, cache)
    except InputError as error:
        raise error.called(scene.spelled(error.key)) from None
