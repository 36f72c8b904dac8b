"""Running and reducing scenes; choosing and checking their structural models by comparison with richer models."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pmr.compare import other_runs
from pmr.compare.accuracy import accuracy_summary, accuracy_warnings
from pmr.compare.forces import pad_extremes
from pmr.compare.frequencies import frequency_part, response_on_way, result_paths
from pmr.compare.responses import check_installed, check_memory, memory_warnings
from pmr.compare.second_order import axial_part
from pmr.compare.summary import origin_part, reliability_part, simulation_part, theory_part
from pmr.compare.trust import budget_warnings, quantities_not_covered
from pmr.errors import InputError, SimulationError, begin_aside, call_on_first_rank, environment, reason_of
from pmr.errors.environment import Clock
from pmr.fem.compat import MPI
from pmr.fem.compat import versions as fenicsx_versions
from pmr.files.arrays import Summary
from pmr.fullmodel.actions import probe_summary
from pmr.fullmodel.build import AssembledBody, build_bodies, free_motion_warnings, models_of
from pmr.fullmodel.build import warnings as build_warnings
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.walls import summary as summary_of_walls
from pmr.pipeline.bodies import Bodies, Motions, Precomputed, stress_at_pads
from pmr.pipeline.model_errors import (
    FutureMotion,
    RunMotion,
    decide_models,
    measure_mesh,
    measure_model,
    reduce_scene,
    start_other_mesh,
    start_richer,
    start_stresses,
)
from pmr.reduction.bodies import Reduction
from pmr.reduction.cache import Cache, cache_in
from pmr.reduction.from_scene import Vectors, with_array_basis
from pmr.results import Frequencies, Loads, Response, RunResult
from pmr.results.run import SummaryPart, combine_parts, grave_warnings
from pmr.scene import Scene
from pmr.scene.keys import ALONE
from pmr.simulation.petsc import Checkpoint
from pmr.system.body import FullBody
from pmr.system.contacts import Place
from pmr.system.states import BodyStates
from pmr.system.system import System

#: Stages of a run with seconds in summary.json, in addition to the simulators.
STAGES = ("assemble", "snapshots", "pod", "reduce", "machine", "recover", "estimate")


@dataclass(frozen=True)
class Outcome:
    """Result of a run, and the system of its reduced bodies; a run returns it on rank 0.

    `grave` is the number of grave warnings, which are the first ones of the result's warnings.
    """

    result: RunResult
    system: System
    grave: int = 0

    @property
    def reduced(self) -> Any:
        """The `pmr.ReducedModel` of a single body, or a mapping of the names of all sections to their models."""
        models = self.system.reduced
        return models.get(ALONE, models)

    def save(self, folder: Path) -> Path:
        """Write the reduced model to ``reduced.npz`` in a folder, or the system to ``system.npz``, and return the path.

        The system is written for a boom of sections, and for a single body with terms such as geometric stiffness.
        """
        if ALONE in self.system.bodies and not self.system.terms:
            return self.system.reduced[ALONE].save(folder / "reduced.npz")
        return self.system.save(folder / "system.npz")


@contextmanager
def _keys_as_written(scene: Scene) -> Iterator[None]:
    """Context in which an InputError gets its key as the scene's file spells the key."""
    try:
        yield
    except InputError as error:
        raise error.with_key(scene.file_key(error.key)) from None


def run(
    scene: Scene,
    comm: MPI.Comm = MPI.COMM_WORLD,
    clock: Clock | None = None,
    checkpoint: Path | None = None,
    cache: Path | None = None,
    measures: Path | None = None,
    keep: Callable[[Outcome], None] | None = None,
    shared: Precomputed | None = None,
    helper: Executor | None = None,
) -> Outcome | None:
    """Reduce, simulate and compare a scene; return the outcome on rank 0 of `comm`, None on other ranks; collective.

    The file `checkpoint` lets a full-order simulation continue after an interruption.  The folder `cache` keeps
    reductions and frequencies of full models for later runs.  With a folder `measures` the run also measures the errors
    of mesh and structural model, even if the scene does not ask for them; the folder keeps what takes longest.  These
    errors are measured last; before, `keep` is called on rank 0 with the outcome without these errors.  `shared` are
    results of a single body's full model that other runs have computed.  `helper` has another process.  During the
    run it computes the stress in walls at pads, and reduces the richer model for the measurement of errors.

    Raises
    ------
    InputError
        If the scene asks for something that is not possible.  The error's source is ``"scene"``, its key that of the
        scene's file.
    ConvergenceError, SimulationError
        If a solver fails.
    """
    clock = clock or Clock()
    with _keys_as_written(scene):
        check_installed(scene)
        chosen = decide_models(scene, comm, clock, cache)
        scene, stresses, other_mesh, richer = chosen.scene, None, None, None
        if helper is not None and measures is not None:
            stresses = start_stresses(scene, helper)
        with clock.stage("assemble"):
            built = build_bodies(scene, comm)
            free_motions = free_motion_warnings(scene, built) if scene.free_motions == "allowed" else []
        size, outputs = _total_sizes(built)
        free = comm.bcast(environment.available_memory() if comm.rank == 0 else None)
        check_memory(scene, size, outputs, free, tell=comm.rank == 0)
        caches = {} if cache is None else {name: cache_in(cache, body.model) for name, body in built.items()}
        bodies = Bodies(scene, built, clock, caches, shared)
        scene = bodies.scene  # with the chosen step
        measured = None if measures is None else cache_in(measures, next(iter(built.values())).model)
        if helper is not None and measured is not None and chosen.budget_part is None:
            richer = start_richer(bodies.written_scene, measured, helper, stored=False)  # first, as it takes longest
        idle = helper if richer is None and (stresses is None or stresses.done()) else None
        with clock.stage("frequencies"):
            begun_frequencies = bodies.begin_frequencies(idle)
        motions = bodies.simulate(None if checkpoint is None else Checkpoint(checkpoint), idle)
        play = bodies.scene, bodies.system, bodies.excitation
        varied: Callable[[], Any] = partial(other_runs.simulate_varied_play, *play)
        if idle is not None and measured is not None:
            varied = begin_aside(idle, other_runs.simulate_varied_play, *play)
        if helper is not None and measured is not None:
            other_mesh = start_other_mesh(bodies.written_scene, measured, helper)
            if chosen.budget_part is None and richer is None:
                richer = start_richer(bodies.written_scene, measured, helper, stored=True)
        frequencies = begun_frequencies()
        outcome = None if motions.reduced is None else _outcome(bodies, motions, frequencies, free_motions)
        if outcome is not None and chosen.chosen_model is not None:
            outcome.result.summary["chosen_model"] = chosen.chosen_model
        if keep is not None:
            call_on_first_rank(comm, lambda: outcome and keep(outcome))
        budget = {} if chosen.budget_part is None else {"model": chosen.budget_part}
        budget |= _measure(bodies, motions, frequencies, budget, measured, stresses, other_mesh, richer, varied)
        if outcome is not None and budget:
            result, written = outcome.result, bodies.written_scene
            complete: dict[str, Any] = budget | result.summary.get("budget", {})
            if isinstance(errors := complete.get("mesh"), Mapping):
                complete["mesh_not_covered"] = quantities_not_covered(written, result.responses["reduced"], errors)
            result.summary["budget"] = complete
            result.summary["warnings"][outcome.grave : outcome.grave] = budget_warnings(written, complete)
        return outcome


def _outcome(
    bodies: Bodies,
    motions: Motions,
    frequencies: Frequencies,
    free_motions: Sequence[str],
) -> Outcome:
    """Return the outcome of a run with its errors, warnings and models; on rank 0 alone.

    `free_motions` are warnings of motions that the scene leaves free.
    """
    assert motions.reduced is not None  # as on rank 0
    system, excitation = bodies.system, bodies.excitation
    scene, built, clock, (size, outputs) = bodies.scene, bodies.built, bodies.clock, _total_sizes(bodies.built)
    choice, responses, by_frequency = bodies.choice, motions.responses, response_on_way(scene, system, excitation)
    stages = {name: clock.seconds[name] for name in STAGES if name in clock.seconds}
    searched = [] if choice is None else [SummaryPart(accuracy_summary(choice), accuracy_warnings(choice))]
    masses = {name: body.model.masses for name, body in built.items()}  # None of a body that is given by matrices
    structures = {id(body): body.structure for body in built.values()}.values()  # equal sections have one
    first = [
        origin_part(bodies.written_scene, fenicsx_versions()),
        SummaryPart({"coordinates": {"full": size, "reduced": sum(body.size for body in system.bodies.values())}}),
        simulation_part(motions.seconds, motions.reduced.agreement, stages),
    ]
    last = [
        *searched,
        SummaryPart(warnings=memory_warnings(scene, size, outputs)),
        *(SummaryPart(warnings=build_warnings(structure)) for structure in structures),
        SummaryPart(warnings=free_motions),
        axial_part(scene, system, excitation, {name: of.body for name, of in masses.items() if of is not None}),
        SummaryPart(warnings=other_runs.mesh_warnings(scene)),
        SummaryPart(probe_summary({name: body.structure.outputs for name, body in built.items()})),
        SummaryPart(summary_of_walls({name: body.structure.pads.walls for name, body in built.items()})),
        SummaryPart(_indentations(scene, system, built, responses)),
        reliability_part(motions.references.missing, responses, system),
        theory_part(scene, responses),
        frequency_part(by_frequency),
    ]
    parts = [*first, *bodies.summary_parts(motions, frequencies), *last]
    result = RunResult(
        bodies.written_scene,
        combine_parts(parts),
        responses,
        result_paths(scene, excitation),
        Loads(system.input_names, system.input_units, motions.reduced.first.loads),
        frequencies,
        bodies.results(motions),
        None if ALONE in built else scene.reach(excitation.times),
        by_frequency,
        motions.error().band if motions.error else None,
    )
    made_from = system.provenance | {"versions": result.summary["versions"]}
    return Outcome(
        result, replace(system, provenance=made_from) if system.provenance else system, len(grave_warnings(parts))
    )


def _indentations(
    scene: Scene, system: System, bodies: Mapping[str, AssembledBody], responses: Mapping[str, Response]
) -> dict[str, list[dict[str, float | str]]]:
    """Entry ``indentations`` of summary.json: rows of how far walls give way under the largest force of each pad.

    A row has the ``name`` of the pad, the ``value`` in m, and time ``t`` and path coordinate ``s`` of the force in the
    reduced model.  `bodies` are the bodies by name, and `responses` the responses by model.  The walls of all sections
    that the pad touches are taken, at the place where the pad is when its force is largest.  Dents by other pads are
    left out.  Without walls that give way the result is empty.
    """
    contacts, rows = {contact.name: contact for contact in system.contacts}, list[dict[str, float | str]]()
    for name, extremes in pad_extremes(scene, responses["reduced"]).items():
        contact, force = contacts.get(name), extremes.largest
        places = [Place(ALONE, name)] if contact is None else filter(None, (contact.inner, contact.outer))
        paths = {key: signal.value(np.array(force.t)) for key, signal in scene.driven_paths.items()}
        touched = [(bodies[place.body].structure.pads, place) for place in places if place.body in bodies]
        compliance = sum(pads.wall_compliance(place.row, float(place.coordinate(paths))) for pads, place in touched)
        if compliance:
            rows.append({"name": name, "value": abs(force.value) * compliance, "t": force.t, "s": force.s})
    return {"indentations": rows} if rows else {}


def _measure(
    bodies: Bodies,
    motions: Motions,
    frequencies: Frequencies,
    budget: Summary,
    cache: Cache | None,
    stresses: Future[None] | None,
    other_mesh: FutureMotion,
    richer: FutureMotion,
    varied: Callable[[], other_runs.VariedPlay | None],
) -> Summary:
    """Measure the errors of a run's model and mesh, and the effect of another play of pads; collective.

    The result has entries for ``budget`` of summary.json:

    - the error of the model, if the scene asks for it.  It is also measured if `budget` lacks it and there is a
      `cache`;
    - the error of the mesh, if there is a `cache` and the scene has neither tolerance nor budget;
    - the stress in walls at pads, beside the error of the model, which may also come from `budget`;
    - the effect of another play of pads.

    The result is empty if there is no `cache`, the scene does not ask for the error of the model and `budget` lacks it.
    The cache keeps what takes longest.  `stresses`, `other_mesh` and `richer` are what `start_stresses`,
    `start_other_mesh` and `start_richer` returned: futures of another process, or None.  `varied` simulates the reduced
    system with another play, or waits for its simulation.
    """
    comm, clock, scene = next(iter(bodies.built.values())).model.comm, bodies.clock, bodies.written_scene
    is_wanted, of_mesh, of_model = scene.compare.richer not in ("auto", "none"), dict[str, Any](), dict[str, Any]()
    if not is_wanted and cache is None and "model" not in budget:
        return {}
    with clock.stage("mesh and model"):
        if cache is not None and scene.goal is None:
            response = None if motions.reduced is None else motions.reduced.first.response
            of_mesh = measure_mesh(scene, bodies.system, response, comm, cache, other_mesh)
        if stresses is not None:
            wait([stresses])
        states = None
        if motions.reduced is not None:
            states = other_runs.states_under_load(bodies.scene, bodies.system, motions.reduced.first)
        walls = _stress_at_pads(bodies, motions, states)
        play = _play(bodies, motions, walls, varied)
        if is_wanted or "model" not in budget:
            with_full = "full" in scene.compare.against and "full" not in motions.references.missing
            responses = {} if motions.reduced is None else motions.responses
            of_run = RunMotion(bodies.system, responses.get("reduced"), responses.get("full"), frequencies)
            cache = cache or next(iter(bodies.caches.values()), None)
            of_model = {"model": measure_model(scene, comm, cache, of_run if with_full else None, richer)}
        model = {**budget, **of_model}.get("model", {})
        return {**of_mesh, "model": model | walls, **play}


def _stress_at_pads(bodies: Bodies, motions: Motions, states: Mapping[str, BodyStates] | None) -> Summary:
    """Return the entries of ``budget.model`` on stress in walls at pads of the bodies in their `states`; collective.

    There are none without a recovery of stresses.  The states are None on other ranks than 0.
    """
    scene, comm = bodies.scene, next(iter(bodies.built.values())).model.comm
    if scene.recovery is None or not scene.recovery.stress:
        return {}
    return stress_at_pads(scene, bodies.built, motions.recovered, comm.bcast(states))


def _play(
    bodies: Bodies, motions: Motions, walls: Summary, simulate: Callable[[], other_runs.VariedPlay | None]
) -> Summary:
    """Return the entry ``play`` of the error budget: largest values of the reduced system with another play.

    The keys are those of `pmr.compare.other_runs.VariedPlay.summary`; ``reason`` is there instead if the system can't
    be simulated.  `walls` is the stress in walls in the run, and `simulate` simulates with the other play.  The entry
    is missing if pads hold both ways.  Collective.
    """
    comm, scene = next(iter(bodies.built.values())).model.comm, bodies.scene
    try:
        varied = call_on_first_rank(comm, simulate)
    except (InputError, SimulationError) as error:
        return {"play": {"reason": reason_of(error)}}
    if not comm.bcast(varied is not None):
        return {}
    other_walls, part = _stress_at_pads(bodies, motions, None if varied is None else varied.simulation.states), None
    if motions.reduced is not None and varied is not None:
        part = varied.summary(scene, motions.reduced.first.response, walls, other_walls)
    return {"play": comm.bcast(part)}


class FullSizes(NamedTuple):
    """Total numbers of coordinates and of outputs of all full models of a scene."""

    coordinates: int
    outputs: int


def _total_sizes(built: Mapping[str, AssembledBody]) -> FullSizes:
    """Return the total numbers of coordinates and of outputs of the full models `built`."""
    models = [body.model for body in built.values()]
    return FullSizes(sum(model.size for model in models), sum(model.outputs.getSize()[1] for model in models))


def full_model(
    scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD, distributed: bool = False
) -> FullBody | FullModel | Mapping[str, FullBody | FullModel] | None:
    r"""Assemble the full model of a scene's body, or of each of its sections; a collective call on all ranks.

    .. math:: M \ddot q + D \dot q + K q + C(s)^T \lambda = B f, \qquad C(s)\, q = 0, \qquad y = O q

    Parameters
    ----------
    scene : Scene
        One body, or a boom of sections.
    comm : MPI communicator
        Ranks that share the model.
    distributed : bool
        If true, a `FullModel` is returned, with PETSc's matrices spread over the ranks; if false, a `FullBody`, with
        SciPy's on rank 0, and None on the other ranks.

    Returns
    -------
    FullBody, FullModel, or a mapping of them by the sections' names
        Attributes of both are ``M``, ``D``, ``K`` (n, n) in SI units, ``B`` (n, i) with ``input_names``,
        ``rows.at(s)`` (m, n) with ``row_names``, and ``outputs`` with ``output_names``: O (o, n) of a `FullBody`, O^T
        (n, o) of a `FullModel`, of whose coordinates each rank has some.

    Raises
    ------
    InputError
        If the scene asks for something that is not possible, such as a mesh that can't be built.
    """
    with _keys_as_written(scene):
        models = models_of(build_bodies(scene, comm))
    if distributed:
        return models.get(ALONE, models)
    gathered = {name: model.gather() for name, model in models.items()}
    if comm.rank != 0:
        return None
    bodies = {name: body for name, body in gathered.items() if body is not None}
    return bodies.get(ALONE, bodies)


def reduce(
    scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD, clock: Clock | None = None, basis: Vectors | None = None
) -> Reduction:
    """Reduce the single body or all sections of a scene, without a simulation; a collective call on all ranks.

    Parameters
    ----------
    scene : Scene
        Scene with the bodies that are reduced; its section ``reduction`` says how.
    comm : MPI communicator
        Ranks that share the work.
    clock : Clock, optional
        Measures the stages.
    basis : (n, k) array or function, optional
        Vectors on the coordinates of `full_model(scene)`, for a scene of one body; or a function of the full model on
        PETSc's matrices that returns this rank's rows of such vectors.  They are made orthonormal in their order, in
        the scene's ``reduction.product``.  With ``reduction.flexibility`` the rigid-body modes come before these
        vectors, and the residual flexibility is that of all motions outside the span of both.

    Raises
    ------
    InputError
        As `run`; also for vectors that don't fit the full model, and if the scene has a tolerance or a budget: their
        search also chooses the time step, so only `run` can do it.
    """
    clock = clock or Clock()
    if scene.goal is not None:
        allowed = (
            "none is allowed for pmr.reduce, which makes only the reduced model: pmr.run(scene) chooses model and step"
        )
        raise InputError("scene", "budget" if scene.accuracy is None else "accuracy", None, allowed)
    with _keys_as_written(scene):
        scene = scene if basis is None else with_array_basis(scene)
        return reduce_scene(decide_models(scene, comm, clock, None).scene, comm, clock, basis)
