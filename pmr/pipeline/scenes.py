"""Running and reducing scenes; choosing and checking their structural models by comparison with richer models."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pmr.compare.accuracy import mesh, order
from pmr.compare.frequencies import frequency_part, response_on_way, result_paths
from pmr.compare.model_part import Motion, largest_model_error, model_budget
from pmr.compare.moving_frame import decide_second_order as with_order
from pmr.compare.responses import check_installed, check_memory, memory_warnings
from pmr.compare.summary import origin_part, reliability_part, simulation_part, theory_part
from pmr.compare.trust import budget_warnings, quantities_not_covered
from pmr.errors import ConvergenceError, InputError, NotHeldError, SimulationError, call_on_first_rank, environment
from pmr.errors.environment import Clock
from pmr.fem.compat import MPI
from pmr.fem.compat import versions as fenicsx_versions
from pmr.fullmodel.build import AssembledBody, build_bodies, free_motion_warnings, log_warnings, models_of
from pmr.fullmodel.build import warnings as build_warnings
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.probes import probe_summary
from pmr.fullmodel.walls import summary as summary_of_walls
from pmr.pipeline.bodies import Bodies, Motions, Precomputed
from pmr.reduction.bodies import Reduction, reduce_bodies, with_stress_flags
from pmr.reduction.cache import Cache, cache_in
from pmr.reduction.from_scene import Vectors, with_array_basis
from pmr.reduction.recovery import RecoveredBody
from pmr.results import Frequencies, Loads, Response, RunResult
from pmr.results.run import SummaryPart, combine_parts, grave_warnings
from pmr.scene import Scene
from pmr.scene.checks import check_scene
from pmr.scene.choice import model_of
from pmr.scene.keys import ALONE
from pmr.scene.members import members
from pmr.scene.model_ladder import candidate_scenes, comparable_scene, model_comparison
from pmr.simulation.petsc import Checkpoint
from pmr.system.body import FullBody
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
) -> Outcome | None:
    """Reduce, simulate and compare a scene; return the outcome on rank 0 of `comm`, None on other ranks; collective.

    The file `checkpoint` lets a full-order simulation continue after an interruption.  The folder `cache` keeps
    reductions and frequencies of full models for later runs.  With a folder `measures` the run also measures the errors
    of mesh and structural model, even if the scene does not ask for them; the folder keeps what takes longest.  They
    are measured last; before, `keep` is called on rank 0 with the outcome without these errors.  `shared` are results
    of a single body's full model that other runs have computed.

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
        scene = chosen.scene
        with clock.stage("assemble"):
            built = build_bodies(scene, comm)
            free_motions = free_motion_warnings(scene, built) if scene.free_motions == "allowed" else []
        size, outputs = _total_sizes(built)
        free = comm.bcast(environment.available_memory() if comm.rank == 0 else None)
        check_memory(scene, size, outputs, free, tell=comm.rank == 0)
        caches = {} if cache is None else {name: cache_in(cache, body.model) for name, body in built.items()}
        bodies = Bodies(scene, built, clock, caches, shared)
        scene = bodies.scene  # with the chosen step
        with clock.stage("frequencies"):
            frequencies = bodies.frequencies()
        motions = bodies.simulate(None if checkpoint is None else Checkpoint(checkpoint))
        recovered = {} if scene.recovery is None else bodies.recover(motions)
        outcome = None if motions.reduced is None else _outcome(bodies, motions, frequencies, recovered, free_motions)
        if outcome is not None and chosen.chosen_model is not None:
            outcome.result.summary["chosen_model"] = chosen.chosen_model
        if keep is not None:
            call_on_first_rank(comm, lambda: outcome and keep(outcome))
        budget = {} if chosen.budget_part is None else {"model": chosen.budget_part}
        budget |= _measure(bodies, motions, budget, measures)
        if outcome is not None and budget:
            complete_budget: dict[str, Any] = budget | outcome.result.summary.get("budget", {})
            if isinstance(complete_budget.get("mesh"), Mapping):
                response = outcome.result.responses["reduced"]
                complete_budget["mesh_not_covered"] = quantities_not_covered(
                    bodies.written_scene, response, complete_budget["mesh"]
                )
            outcome.result.summary["budget"] = complete_budget
            further = budget_warnings(bodies.written_scene, outcome.result.summary["budget"])
            outcome.result.summary["warnings"][outcome.grave : outcome.grave] = further  # put before the hints
        return outcome


def _outcome(
    bodies: Bodies,
    motions: Motions,
    frequencies: Frequencies,
    recovered: Mapping[str, RecoveredBody],
    free_motions: Sequence[str],
) -> Outcome:
    """Return the outcome of a run with its errors, warnings and models; on rank 0 alone.

    `free_motions` are warnings of motions that the scene leaves free.
    """
    assert motions.reduced is not None  # as on rank 0
    system, excitation = bodies.system, bodies.excitation
    scene, built, clock, (size, outputs) = bodies.scene, bodies.built, bodies.clock, _total_sizes(bodies.built)
    choice, responses, by_frequency = (
        bodies.choice,
        motions.responses,
        response_on_way(scene, bodies.system, excitation),
    )
    stages = {name: clock.seconds[name] for name in STAGES if name in clock.seconds}
    first = [
        origin_part(bodies.written_scene, fenicsx_versions()),
        SummaryPart({"coordinates": {"full": size, "reduced": sum(body.size for body in system.bodies.values())}}),
        simulation_part(motions.seconds, motions.reduced.agreement, stages),
    ]
    last = [
        SummaryPart()
        if choice is None
        else SummaryPart(order.accuracy_summary(choice), order.accuracy_warnings(choice)),
        SummaryPart(warnings=memory_warnings(scene, size, outputs)),
        *(
            SummaryPart(warnings=build_warnings(member.structure))
            for member in {id(m): m for m in built.values()}.values()
        ),
        SummaryPart(warnings=free_motions),
        SummaryPart(warnings=mesh.mesh_warnings(scene)),
        SummaryPart(probe_summary({name: body.structure.outputs for name, body in built.items()})),
        SummaryPart(summary_of_walls({name: body.structure.pads.walls for name, body in built.items()})),
        reliability_part(motions.references.missing, responses, system),
        theory_part(scene, responses),
        frequency_part(by_frequency),
    ]
    judged, tip_error = bodies.summary_parts(motions, frequencies, recovered)
    parts = [*first, *judged, *last]
    summary = combine_parts(parts)
    result = RunResult(
        bodies.written_scene,
        summary,
        responses,
        result_paths(scene, excitation),
        Loads(system.input_names, system.input_units, excitation.forces(system.input_names)),
        frequencies,
        bodies.results(recovered),
        None if ALONE in built else scene.reach(excitation.times),
        by_frequency,
        tip_error,
    )
    made_from = system.provenance | {"versions": result.summary["versions"]}
    return Outcome(
        result, replace(system, provenance=made_from) if system.provenance else system, len(grave_warnings(parts))
    )


def _measure(bodies: Bodies, motions: Motions, budget: Mapping[str, Any], measures: Path | None) -> Mapping[str, Any]:
    """Measure the errors of a run's model and mesh, for ``budget`` of summary.json; collective.

    The model's is measured if the scene asks for it, or if `budget` lacks it and there is a folder `measures`; the
    mesh's if there is such a folder and the scene has no tolerance or budget.  The folder keeps what takes longest.
    """
    comm, clock, scene = next(iter(bodies.built.values())).model.comm, bodies.clock, bodies.written_scene

    is_wanted = scene.compare.richer not in ("auto", "none")
    if not is_wanted and measures is None:
        return {}
    model, parts = next(iter(bodies.built.values())).model, dict[str, Any]()
    cache = next(iter(bodies.caches.values()), None) if measures is None else cache_in(measures, model)
    with clock.stage("mesh and model"):
        if is_wanted or "model" not in budget:
            parts["model"] = measure_model(scene, comm, cache)
        if measures is not None and scene.goal is None:
            response = None if motions.reduced is None else motions.reduced.first.response
            parts |= measure_mesh(scene, bodies.system, response, comm, cache)
    return parts


def _total_sizes(built: Mapping[str, AssembledBody]) -> tuple[int, int]:
    """Return the total numbers of coordinates and of outputs of all full models."""
    models = [body.model for body in built.values()]
    return sum(model.size for model in models), sum(model.outputs.getSize()[1] for model in models)


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
        Whether the matrices stay PETSc's, spread over the ranks, or become SciPy's on rank 0.

    Returns
    -------
    FullBody, FullModel, or a mapping of them by the sections' names
        Attributes ``M``, ``D``, ``K`` (n, n) in SI units, ``B`` (n, i) with ``input_names``, ``outputs`` (o, n) with
        ``output_names``, ``rows.at(s)`` (m, n) with ``row_names``.  None on other ranks than the first where the
        matrices are SciPy's.

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
        return _reduce_scene(decide_models(scene, comm, clock, None).scene, comm, clock, basis)


def _reduce_scene(
    scene: Scene, comm: MPI.Comm, clock: Clock | None = None, vectors: Vectors | None = None
) -> Reduction:
    """Build and reduce a scene's bodies with these vectors, or with the scene's basis if they are None; collective."""
    clock = clock or Clock()
    with clock.stage("assemble"):
        built = build_bodies(scene, comm)
    log_warnings(built.values(), comm)
    bodies = reduce_bodies(scene, built, clock=clock, vectors=vectors)
    models = {name: body.model for name, body in bodies.items()}
    scene = comm.bcast(call_on_first_rank(comm, lambda: with_order(scene, models)))
    return Reduction(scene, built, with_stress_flags(scene, bodies))


#: Errors of a comparison after which the run goes on; the error that was to be measured is then unknown.
UNKNOWN = (InputError, ConvergenceError, SimulationError)
UNNEEDED = (*UNKNOWN, ValueError, ImportError)
#: Reason for no comparison if a machine's motion is computed: another model would have another motion of its base.
ON_MACHINE = "not measured for a boom on frame.machine; a run of the same boom without frame.machine measures it"
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ModelDecision:
    """A scene with all structural models set, and the measurements by which they were chosen; alike on all ranks."""

    scene: Scene
    budget_part: Mapping[str, Any] | None = None  # ``budget.model`` of the chosen model; None without a choice
    chosen_model: Mapping[str, Any] | None = None  # ``chosen_model`` of summary.json


def decide_models(scene: Scene, comm: MPI.Comm, clock: Clock, cache: Path | None) -> ModelDecision:
    """Choose the simplest models that differ from a shell by `compare.model_tolerance` at most; collective.

    A scene without a choice of models is returned unchanged.  If no model can be compared with a shell, the simplest
    models are taken, and the result contains the reason.  `cache` is a folder for the reduced systems that are
    compared.
    """
    options = candidate_scenes(scene)
    if not options:
        return ModelDecision(scene)
    with clock.stage("choice of the model"):
        cached = None
        if cache is not None:  # the smallest model takes no time
            cached = cache_in(cache, next(iter(build_bodies(options[0], comm).values())).model)
        return _choose_model(options, comm, cached)


def measure_model(scene: Scene, comm: MPI.Comm, cache: Cache | None) -> Mapping[str, Any]:
    """Return ``budget.model`` of summary.json: differences to a richer model, or ``reason`` for none; collective."""
    if scene.frame is not None and scene.frame.machine is not None:
        return {"beside": None, "reason": ON_MACHINE}
    label = "richer model"
    try:
        of_scene, other, label = model_comparison(scene)
        return _model_budget(of_scene, _motion_on_first(other, comm, cache), label, comm, cache)
    except UNNEEDED as error:
        return _unknown_model_error(error, label)


def measure_mesh(
    scene: Scene, system: System, response: Response | None, comm: MPI.Comm, cache: Cache | None
) -> dict[str, Any]:
    """Return ``mesh`` of the budget and ``mesh_reason``: differences to the scene on another mesh; collective.

    `system` and `response` belong to the scene itself; `response` is None on other ranks than 0.
    """
    if scene.frame is not None and scene.frame.machine is not None:
        return {"mesh_reason": ON_MACHINE}

    def compare_scene(make: Callable[[], Scene], label: str) -> dict[str, Any]:
        """Return differences between the scene and the scene that `make` returns, or the reason why there are none.

        `label` is the name of the other scene.
        """
        try:
            motion = call_on_first_rank(comm, lambda: Motion.compute(scene, system, response))
            other_motion = _motion_on_first(make(), comm, cache)
        except UNNEEDED as error:
            return _unknown_model_error(error, label)
        part = None if motion is None or other_motion is None else model_budget(scene, other_motion, motion, label)
        errors: dict[str, Any] = comm.bcast(part)
        return errors

    return mesh.mesh_budget(scene, compare_scene)


def _unknown_model_error(error: Exception, label: str) -> dict[str, Any]:
    """Return the entries of summary.json for an error that can't be measured: ``reason`` and, if long, ``detail``."""
    reason = error.allowed if isinstance(error, InputError) else str(error)
    if isinstance(error, NotHeldError):
        short = f"nothing holds its {label}: {error.short}; pads or supports that hold this motion are needed"
        return {"beside": None, "reason": short, "detail": reason}
    return {"beside": None, "reason": reason}


def _choose_model(options: list[Scene], comm: MPI.Comm, cache: Cache | None) -> ModelDecision:
    """Compare beams with a shell, the last of `options`, from the simplest on, and choose as `decide_models` does."""
    *beams, shell = options
    tried = list[dict[str, Any]]()

    def chosen_figures(scene: Scene, **more: Any) -> dict[str, Any]:
        """Return ``chosen_model`` of summary.json for the scene that is chosen."""
        return _chosen_model(scene) | {"tolerance": scene.compare.model_tolerance, "tried": tried} | more

    try:
        best = _motion_on_first(comparable_scene(shell), comm, cache)
        for beam in beams:
            part = _model_budget(comparable_scene(beam), best, "shell", comm, cache)
            tried.append(_chosen_model(beam) | {"error": largest_model_error(part)})
            if comm.rank == 0:
                _log.info("%(name)s, walls %(walls)s: the error is %(error).2g of a shell's result", tried[-1])
            if tried[-1]["error"] <= beam.compare.model_tolerance:
                return ModelDecision(beam, part, chosen_figures(beam))
    except UNKNOWN as error:
        return ModelDecision(
            beams[0], {"beside": None, "reason": str(error)}, chosen_figures(beams[0], reason=str(error))
        )
    check_scene(shell)  # raises if the scene needs what only a beam has
    return ModelDecision(shell, None, chosen_figures(shell))


def _model_budget(
    scene: Scene, other: Motion | None, label: str, comm: MPI.Comm, cache: Cache | None
) -> dict[str, Any]:
    """Return, on every rank, the difference of a scene's motion to the motion `other`, which only rank 0 has."""
    motion = _motion_on_first(scene, comm, cache)
    part = None if motion is None or other is None else model_budget(scene, motion, other, label)
    errors: dict[str, Any] = comm.bcast(part)
    return errors


def _motion_on_first(scene: Scene, comm: MPI.Comm, cache: Cache | None) -> Motion | None:
    """Reduce and simulate a scene; return its motion on rank 0, None on other ranks."""

    def reduced_system() -> System:
        """Reduce the scene's bodies and join them."""
        return _reduce_scene(scene, comm).system

    system = reduced_system() if cache is None else cache.system_of(scene, reduced_system)
    return call_on_first_rank(comm, lambda: Motion.compute(scene, system))


def _chosen_model(scene: Scene) -> dict[str, Any]:
    """Return name and wall model of the outermost body's structural model."""
    last = members(scene)[-1]
    return {"name": model_of(last), "walls": last.part.body.walls}
