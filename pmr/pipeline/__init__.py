"""The main job: scene -> model -> snapshots -> basis -> reduced model -> simulations -> comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare import memory
from pmr.compare.accuracy import order
from pmr.compare.estimated import asks_for_other, other_of, reduction_error, step_part
from pmr.compare.frequencies import CURVES, frequency_curves, frequency_part, of_body, visited_positions
from pmr.compare.halved_steps import SteppedBody
from pmr.compare.references import references
from pmr.compare.responses import check_installed, full_simulator, quantities, simulate
from pmr.compare.summary import (
    Part,
    compared,
    contact,
    driven,
    gathered,
    made_with,
    pads,
    simulated,
    struck,
    theory,
    trusted,
)
from pmr.errors import ConvergenceError, InputError, environment, on_first
from pmr.errors.environment import Clock
from pmr.fem.compat import MPI
from pmr.fem.compat import versions as fenicsx_versions
from pmr.fem.distributed import free_dropped
from pmr.fullmodel.build import Built, build, full_model, left_free
from pmr.fullmodel.build import warnings as build_warnings
from pmr.fullmodel.eigensolvers import lowest_frequencies
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.probes import places
from pmr.pipeline.search import chosen
from pmr.recover.coordinates import Recovery, chosen_states
from pmr.recover.framed import framed_body as framed_body
from pmr.recover.from_scene import Recovered, recover, recovered_steps
from pmr.recover.nodal import held_body as held_body
from pmr.reduced.model import ReducedModel
from pmr.reduction.basis import Basis
from pmr.reduction.cache import Cache, Reduced, cache_in, with_provenance
from pmr.reduction.from_scene import build_basis, project, provenance, take_snapshots
from pmr.reduction.from_scene import summary as describe_basis
from pmr.reduction.ports import with_ports
from pmr.reduction.reactions import support_motions, with_reactions
from pmr.reduction.snapshots import Snapshots
from pmr.reduction.snapshots.free_body import FreeBody
from pmr.results import BodyResult, Frequencies, Loads, Paths, Response, RunResult, Shapes
from pmr.scene import Scene
from pmr.scene.choice import transverse
from pmr.scene.members import member_at
from pmr.scene.names import ALONE
from pmr.simulation import Excitation
from pmr.simulation.modal import modal_form
from pmr.simulation.petsc import Checkpoint
from pmr.system.body import Trajectory
from pmr.system.system import System

#: Stages whose seconds stand in summary.json, beside those of the simulators.
STAGES = ("assemble", "snapshots", "pod", "recover")


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


@dataclass(frozen=True)
class Outcome:
    """What a run returns on rank 0."""

    result: RunResult
    reduced: ReducedModel

    @property
    def system(self) -> System:
        """The body alone as a system."""
        return System.of(self.reduced)

    def save(self, folder: Path) -> Path:
        """Write the reduced model into a folder."""
        return self.reduced.save(folder / "reduced.npz")


def run(
    scene: Scene,
    comm: MPI.Comm = MPI.COMM_WORLD,
    clock: Clock | None = None,
    checkpoint: Checkpoint | None = None,
    cache: Path | None = None,
) -> Outcome | None:
    """Run a scene on `comm`; what is not distributed runs on rank 0, the other ranks get None.

    With a `checkpoint` a full-order simulation that was cut off goes on.  In a `cache`, a folder, reductions and
    frequencies of full models are cached and found.

    Raises
    ------
    InputError
        If the scene asks for what cannot be had; its source is ``"scene"``.
    ConvergenceError, SimulationError
        If a solver fails.
    """
    check_installed(scene)
    clock, scene = clock or Clock(), order.prepared(scene)
    with clock.stage("assemble"):
        built = build(scene, comm)
        free_motions = left_free(scene, {ALONE: built}) if scene.free_motions == "allowed" else []
    free = comm.bcast(environment.available_memory() if comm.rank == 0 else None)
    size, outputs = built.model.size, built.model.outputs.getSize()[1]
    memory.check(scene, size, outputs, free, tell=comm.rank == 0)
    cached = None if cache is None else cache_in(cache, built.model)
    reduction = _cached_or_reduced(scene, built.model, clock, cached)

    def models_of(finer: Scene) -> dict[str, ReducedModel]:
        def make() -> ReducedModel:
            return reduce(finer, comm).reduced

        return {ALONE: make() if cached is None else cached.model_of(finer, make)}

    choice = chosen(scene, {ALONE: reduction.reduced}, models_of, comm, clock)
    if choice is not None:
        scene, reduction = choice.scene, replace(reduction, reduced=choice.models[ALONE])
    other = _other(scene, reduction, cached)
    with clock.stage("frequencies"):
        curves = _frequency_curves(scene, reduction, cached)
    steps = recovered_steps(scene).tolist()
    found = references(scene, reduction.model, clock, steps, checkpoint)
    simulations = on_first(comm, lambda: simulate(scene, reduction.reduced, found.responses, clock, steps))
    seen = None
    if scene.recovery is not None:
        with clock.stage("recover"):
            states = None if simulations is None else simulations.states
            seen = recovered(scene, built, reduction, states, found.states)
    if simulations is None:
        return None
    responses = simulations.responses
    excitation, reduced = Excitation.of(scene), reduction.reduced
    estimate, step = (None, None) if choice is None else (choice.found.estimate, choice.found.step_error)
    estimated = reduction_error(scene, reduced, clock, other, estimate)
    stepped = SteppedBody(modal_form(reduced), excitation, len(transverse(member_at(scene))))
    in_frequency = of_body(scene, reduced)
    stages = {name: clock.seconds[name] for name in STAGES if name in clock.seconds}
    parts = [
        made_with(scene, fenicsx_versions()),
        Part({"coordinates": {"full": size, "reduced": reduced.size}}),
        Part(describe_basis(scene, reduction.model, reduction.snapshots, reduction.basis, reduced)),
        compared(responses, quantities(scene), {"reduced": simulations.first, "full": full_simulator(scene, size)}),
        simulated(simulations.seconds, simulations.agreement, stages),
        struck(reduced, excitation, responses),
        driven(excitation),
        estimated.part,
        step_part(stepped, curves.models["reduced"], clock, scene.accuracy is not None, step),
        Part() if choice is None else Part(order.summary(choice), order.warnings(choice)),
        Part(warnings=memory.warnings(scene, size, outputs)),
        Part(warnings=build_warnings(built.structure)),
        Part(warnings=free_motions),
        pads(scene, responses["reduced"]),
        Part(places({"": built.structure.outputs})),
        contact(reduced, excitation),
        trusted(found.missing, responses),
        theory(scene, responses),
        frequency_part(in_frequency),
        Part() if seen is None else Part(seen.summary()),
    ]
    result = _result(scene, gathered(parts), responses, reduction, curves)
    result = replace(result, frequency_response=in_frequency, tip_error=estimated.band)
    if seen is not None:
        body = replace(result.body, fields=seen.reduced.fields, peak_stress=seen.histories())
        result = replace(result, bodies={ALONE: body})
    return Outcome(result, reduction.reduced)


def reduce(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD, clock: Clock | None = None) -> Reduction:
    """From a scene to its reduced model; collective."""
    clock = clock or Clock()
    with clock.stage("assemble"):
        model = full_model(scene, comm)
    return _reduce(scene, model, clock)


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


def _reduce(scene: Scene, model: FullModel, clock: Clock) -> Reduction:
    with clock.stage("snapshots"):
        body = FreeBody(model, scene.reduction.solver)
        snapshots = take_snapshots(scene, model, body)
    return reduce_with(scene, model, snapshots, clock, body)


def _cached_or_reduced(scene: Scene, model: FullModel, clock: Clock, cached: Cache | None) -> Reduction:
    if cached is None:
        return _reduce(scene, model, clock)

    def make() -> Reduced:
        made = _reduce(scene, model, clock)
        return Reduced(made.snapshots, made.basis, made.reduced)

    asked = scene.reduction.model_dump(mode="json") | {"path": scene.travel, "searched": scene.ordered is not None}
    if scene.reduction.file is not None:
        asked["file"] = scene.hash  # which has the content
    found = cached.reduced(asked, make)
    found = with_provenance(found, provenance(scene, found.basis))
    return Reduction(model, found.snapshots, found.basis, found.model)


def _other(scene: Scene, reduction: Reduction, cached: Cache | None) -> ReducedModel | None:
    """A model that tells the error of one which can't by itself; None where that can, or no model tells it."""
    if not asks_for_other(scene, reduction.reduced):
        return None
    try:
        return _cached_or_reduced(other_of(scene, reduction.reduced), reduction.model, Clock(), cached).reduced
    except (InputError, ConvergenceError):  # as few modes as a small mesh has: no reason not to run
        return None


def _frequency_curves(scene: Scene, reduction: Reduction, cached: Cache | None) -> Frequencies:
    """Lowest frequencies over the stretch that the path visits."""
    model, s = reduction.model, visited_positions(scene, reduction.model.size)

    def compute() -> NDArray[np.float64]:
        return lowest_frequencies(model, s, CURVES, scene.reduction.solver)

    asked = {"s": s.tolist(), "count": CURVES, "solver": scene.reduction.solver}
    full = compute() if cached is None else cached.arrays("frequencies", asked, compute)
    return frequency_curves(scene, reduction.reduced, s, full)


def _result(
    scene: Scene,
    summary: dict[str, Any],
    responses: Mapping[str, Response],
    reduction: Reduction,
    curves: Frequencies,
) -> RunResult:
    shapes = Shapes(reduction.basis.sigma, reduction.reduced.output_positions, reduction.reduced.outputs)
    excitation = Excitation.of(scene)
    paths = Paths(tuple(excitation.paths), excitation.s, excitation.rates)
    names, units = reduction.reduced.input_names, reduction.reduced.input_units
    loads = Loads(names, units, excitation.forces(names))
    return RunResult(scene, summary, responses, paths, loads, curves, {ALONE: BodyResult(shapes)})
