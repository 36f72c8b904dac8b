"""A body alone on its way along one path: how it is reduced, simulated and judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmr.compare.estimated import asks_for_other, other_of, reduction_error, step_part
from pmr.compare.frequencies import CURVES, frequency_curves, of_body, visited_positions
from pmr.compare.halved_steps import SteppedBody
from pmr.compare.references import references
from pmr.compare.responses import full_simulator, quantities, simulate
from pmr.compare.summary import Part, compared, contact, impacts, pads
from pmr.errors import ConvergenceError, InputError, on_first
from pmr.errors.environment import Clock
from pmr.fem.distributed import free_dropped
from pmr.fullmodel.build import Built
from pmr.fullmodel.eigensolvers import lowest_frequencies
from pmr.fullmodel.model import FullModel
from pmr.pipeline.bodies import Bodies, Judged, Motions
from pmr.pipeline.search import chosen
from pmr.reduced.model import ReducedModel
from pmr.reduction.basis import Basis
from pmr.reduction.cache import Cache, Reduced, with_provenance
from pmr.reduction.from_scene import build_basis, project, provenance, take_snapshots
from pmr.reduction.from_scene import summary as describe_basis
from pmr.reduction.ports import with_ports
from pmr.reduction.reactions import support_motions, with_reactions
from pmr.reduction.recover.coordinates import Recovery, chosen_states
from pmr.reduction.recover.from_scene import Recovered, recover, recovered_steps
from pmr.reduction.snapshots import Snapshots
from pmr.reduction.snapshots.free_body import FreeBody
from pmr.results import BodyResult, Frequencies, Shapes
from pmr.scene import Scene
from pmr.scene.choice import transverse
from pmr.scene.members import member_at
from pmr.scene.names import ALONE
from pmr.simulation import Excitation
from pmr.simulation.modal import modal_form
from pmr.simulation.petsc import Checkpoint
from pmr.system.body import Trajectory
from pmr.system.system import System


@dataclass(frozen=True)
class Reduction:
    """Everything from the operators to the reduced model."""

    model: FullModel
    snapshots: Snapshots
    basis: Basis
    reduced: ReducedModel

    @property
    def system(self) -> System:
        """The body alone as a system."""
        return System.of(self.reduced)


class Alone(Bodies):
    """With tables over its path, by any basis and by every simulator."""

    STAGES = ("assemble", "snapshots", "pod", "recover")

    def __init__(self, scene: Scene, built: Mapping[str, Built], clock: Clock, caches: Mapping[str, Cache]) -> None:
        super().__init__(scene, built, clock, caches)
        self._cached = caches.get(ALONE)
        self.reduction = _cached_or_reduced(scene, built[ALONE].model, clock, self._cached)
        self.choice = chosen(scene, {ALONE: self.reduction.reduced}, self._on_finer, self.comm, clock)
        if self.choice is not None:
            self.scene, models = self.choice.scene, self.choice.models
            self.reduction = replace(self.reduction, reduced=models[ALONE])
        self.reduced, self.excitation = self.reduction.reduced, Excitation.of(self.scene)
        self.other = self._other()

    @cached_property
    def system(self) -> System:
        return System.of(self.reduced)

    def frequencies(self) -> Frequencies:
        """Over the stretch that the path visits."""
        model, s, solver = self.reduction.model, visited_positions(self.scene, self.size), self.scene.reduction.solver

        def compute() -> NDArray[np.float64]:
            return lowest_frequencies(model, s, CURVES, solver)

        asked = {"s": s.tolist(), "count": CURVES, "solver": solver}
        full = compute() if self._cached is None else self._cached.arrays("frequencies", asked, compute)
        return frequency_curves(self.scene, self.reduced, s, full)

    def simulate(self, checkpoint: Checkpoint | None) -> Motions:
        scene, steps = self.scene, recovered_steps(self.scene).tolist()
        made = on_first(self.comm, lambda: simulate(scene, self.reduced, self.clock, steps))
        stepping = self.comm.bcast(None if made is None else made.made)
        found = references(scene, self.reduction.model, self.clock, steps, checkpoint, stepping)
        full = {} if found.states is None else {ALONE: found.states}
        if made is None:
            return Motions({}, {}, {}, {}, found.missing, None, full)
        simulators = {"reduced": made.first, "full": full_simulator(scene, self.size)}
        responses = {**made.responses, **found.responses}
        seconds = {**made.seconds, **{name: one.seconds for name, one in found.responses.items()}}
        return Motions(responses, seconds, made.agreement, simulators, found.missing, made.states, full)

    def recover(self, motions: Motions) -> Mapping[str, Recovered]:
        full = motions.full.get(ALONE)
        return {ALONE: recovered(self.scene, self.built[ALONE], self.reduction, motions.states, full)}

    def judge(self, motions: Motions, frequencies: Frequencies, seen: Mapping[str, Recovered]) -> Judged:
        scene, reduced, reduction, choice = self.scene, self.reduced, self.reduction, self.choice
        estimate, step = (None, None) if choice is None else (choice.found.estimate, choice.found.step_error)
        estimated = reduction_error(scene, reduced, self.clock, self.other, estimate)
        stepped = SteppedBody(modal_form(reduced), self.excitation, len(transverse(member_at(scene))))
        shapes = Shapes(reduction.basis.sigma, reduced.output_positions, reduced.outputs)
        parts = [
            Part(describe_basis(scene, reduction.model, reduction.snapshots, reduction.basis, reduced)),
            compared(motions.responses, quantities(scene), motions.simulators),
            impacts(reduced, self.excitation, motions.responses),
            estimated.part,
            step_part(stepped, frequencies.models["reduced"], self.clock, scene.accuracy is not None, step),
            pads(scene, motions.responses["reduced"]),
            contact(reduced, self.excitation),
            *(Part(one.summary()) for one in seen.values()),
        ]
        of_body_alone = BodyResult(shapes)
        return Judged(parts, motions.responses, of_body(scene, reduced), estimated.band, {ALONE: of_body_alone})

    def _on_finer(self, finer: Scene) -> Mapping[str, ReducedModel]:
        def make() -> ReducedModel:
            return reduce(finer, self.build(finer)[ALONE].model).reduced

        return {ALONE: make() if self._cached is None else self._cached.model_of(finer, make)}

    def _other(self) -> ReducedModel | None:
        """A model that tells the error of one which can't by itself; None where that can, or no model tells it."""
        if not asks_for_other(self.scene, self.reduced):
            return None
        other = other_of(self.scene, self.reduced)
        try:
            return _cached_or_reduced(other, self.reduction.model, Clock(), self._cached).reduced
        except (InputError, ConvergenceError):  # as few modes as a small mesh has: no reason not to run
            return None


def reduce_with(
    scene: Scene,
    model: FullModel,
    snapshots: Snapshots,
    clock: Clock | None = None,
    body: FreeBody | None = None,
) -> Reduction:
    """From a model and its snapshots to the scene's reduced model; collective.

    A `body` whose factor the snapshots were made with is taken over and dropped.
    """
    clock = clock or Clock()
    with clock.stage("pod"):
        body = body or FreeBody(model, scene.reduction.solver)
        basis, motions = build_basis(scene, model, snapshots), support_motions(body)
        if scene.reduction.ports:
            basis = with_ports(body, basis)
        reduced = project(scene, body, basis, provenance(scene, basis))
        reduced = with_reactions(reduced, body, np.array(basis.V.getDenseArray()), motions)
    free_dropped(model.comm)
    return Reduction(model, snapshots, basis, reduced)


def recovered(
    scene: Scene,
    built: Built,
    reduction: Reduction,
    trajectory: Trajectory | None,
    full_states: NDArray[np.float64] | None = None,
) -> Recovered:
    """What the scene's recovery asks for; collective.

    The trajectory has the reduced model's states at the `recovered_steps`, on rank 0, `full_states` (S, n_local) this
    rank's rows of the full model's coordinates at the same times.
    """
    assert scene.recovery is not None
    V = np.array(reduction.basis.V.getDenseArray())
    recovery = Recovery(built.model, V, reduction.reduced, scene.reduction.solver)
    states = None
    if trajectory is not None:
        loads, steps = Excitation.of(scene).forces(recovery.reduced.input_names), recovered_steps(scene)
        states = chosen_states(trajectory, loads[steps], np.arange(len(steps)))
    return recover(scene.recovery, built.structure, recovery, built.model.comm.bcast(states), full_states)


def reduce(scene: Scene, model: FullModel, clock: Clock | None = None) -> Reduction:
    """From a full model to the scene's reduced one; collective."""
    clock = clock or Clock()
    with clock.stage("snapshots"):
        body = FreeBody(model, scene.reduction.solver)
        snapshots = take_snapshots(scene, model, body)
    return reduce_with(scene, model, snapshots, clock, body)


def _cached_or_reduced(scene: Scene, model: FullModel, clock: Clock, cached: Cache | None) -> Reduction:
    if cached is None:
        return reduce(scene, model, clock)

    def make() -> Reduced:
        made = reduce(scene, model, clock)
        return Reduced(made.snapshots, made.basis, made.reduced)

    asked = scene.reduction.model_dump(mode="json") | {"path": scene.travel, "searched": scene.ordered is not None}
    if scene.reduction.file is not None:
        asked["file"] = scene.hash  # which has the content
    found = cached.reduced(asked, make)
    found = with_provenance(found, provenance(scene, found.basis))
    return Reduction(model, found.snapshots, found.basis, found.model)
