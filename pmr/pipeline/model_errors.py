"""Choice of the structural models of a scene, and errors of model and mesh, by comparison with other models."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from pmr.compare import other_runs
from pmr.compare.model_part import FREQUENCIES, Motion, frequency_error, largest_model_error, model_budget
from pmr.compare.second_order import decide_second_order as with_order
from pmr.errors import ConvergenceError, InputError, NotHeldError, SimulationError, call_on_first_rank, reason_of
from pmr.errors.environment import Clock
from pmr.fem.compat import MPI
from pmr.fullmodel.build import build_bodies, log_warnings, within_reach
from pmr.reduction.bodies import Reduction, reduce_bodies, with_stress_flags
from pmr.reduction.cache import Cache, SystemCache, cache_in
from pmr.reduction.from_scene import Vectors
from pmr.results import Frequencies, Response
from pmr.scene import Scene
from pmr.scene.checks import check_scene
from pmr.scene.choice import model_of, traits_of
from pmr.scene.members import members
from pmr.scene.model_ladder import candidate_scenes, comparable_scene, model_comparison
from pmr.system.system import System


def reduce_scene(
    scene: Scene, comm: MPI.Comm, clock: Clock | None = None, vectors: Vectors | None = None, reach: bool = False
) -> Reduction:
    """Build and reduce a scene's bodies on `vectors`, or on the scene's basis if `vectors` is None; collective.

    The full models are part of the result; their warnings are logged.  If `scene` leaves the choice of second order
    open, it is decided, and the result's scene has the decision.  If `reach` is true, the result is made faster, but is
    not valid for positions of pads that the scene does not pass through.  `clock` measures the wall time of the stages;
    None leaves them unmeasured.  Raises the errors of `build_bodies` and `reduce_bodies`.
    """
    clock = clock or Clock()
    with clock.stage("assemble"):
        built = build_bodies(scene, comm)
        built = within_reach(scene, built) if reach else built
    log_warnings(built.values(), comm)
    bodies = reduce_bodies(scene, built, clock=clock, vectors=vectors)
    models = {name: body.model for name, body in bodies.items()}
    scene = comm.bcast(call_on_first_rank(comm, lambda: with_order(scene, models)))
    return Reduction(scene, built, with_stress_flags(scene, bodies))


#: Errors of a comparison after which the run goes on; the error that was to be measured is then unknown.
UNKNOWN = (InputError, ConvergenceError, SimulationError)

#: The same of a comparison with a richer model or another mesh, which may lack a package or can't be meshed.
UNNEEDED = (*UNKNOWN, ValueError, ImportError)

#: Reason for no comparison if a machine's motion is computed: another model would have another motion of its base.
ON_MACHINE = (
    "not measured where the motion of a machine, luffing angle or extension is computed; a run of the same boom with a "
    "prescribed motion measures it: frame.luffing or joint.extension as a smooth_ramp between the values of this run, "
    "without the keys of what drives it"
)

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ModelDecision:
    """A scene with all structural models set, and the measurements by which they were chosen; alike on all ranks."""

    scene: Scene
    budget_part: Mapping[str, Any] | None = None  # ``budget.model`` of the chosen model; None without a choice
    chosen_model: Mapping[str, Any] | None = None  # ``chosen_model`` of summary.json


def decide_models(scene: Scene, comm: MPI.Comm, clock: Clock, cache: Path | None) -> ModelDecision:
    """Choose the simplest models whose difference to a shell is at most `compare.model_tolerance`; collective.

    If none is as close as this, the shell is taken.  A scene without a choice of models is returned unchanged.  If no
    model can be compared with a shell, the simplest models are taken, and the result contains the reason.  `cache` is a
    folder for the reduced systems that are compared, or None to store nothing.  Raises the errors of `build_bodies` and
    `_choose_model`.
    """
    options = candidate_scenes(scene)
    if not options:
        return ModelDecision(scene)
    with clock.stage("choice of the model"):
        cached = None
        if cache is not None:  # the smallest model takes no time
            cached = cache_in(cache, next(iter(build_bodies(options[0], comm).values())).model)
        return _choose_model(options, comm, cached)


@dataclass(frozen=True)
class RunMotion:
    """Motion of a run: its reduced `system`, responses of this system and of the full model, and frequencies of both.

    The responses are None on other ranks than 0.
    """

    system: System
    reduced: Response | None
    full: Response | None
    frequencies: Frequencies

    def motion(self, scene: Scene) -> Motion:
        """Motion with displacements and contact forces of the full model, reactions and frequencies of the reduced one.

        The error of the reduced model's frequencies is part of it.  Reactions are those of the reduced model, because a
        full model lacks reactions of supports that hold single coordinates.  To be called on rank 0 alone.
        """
        assert self.reduced is not None and self.full is not None
        of_full = {key: getattr(self.full, key) for key in ("displacement", "slider_force", "force_peaks")}
        f, exact = (self.frequencies.models[name][:, :FREQUENCIES] for name in ("reduced", "full"))
        error = frequency_error(f[:, : exact.shape[1]], exact) or 0.0
        return replace(Motion.compute(scene, self.system, replace(self.reduced, **of_full)), frequency_error=error)


#: Future of a motion that another process computes, which is None if an error is met; None without such a process.
FutureMotion = Future[Motion | None] | None


@dataclass(frozen=True)
class ComparedScene:
    """A scene to compare another one with; its bodies are reduced unless the cache has their system."""

    scene: Scene
    comm: MPI.Comm
    cache: SystemCache | None
    future: FutureMotion = None  # the motion, if another process computes it

    @cached_property
    def reduction(self) -> Reduction:
        """Full and reduced models of the scene's bodies; collective."""
        return reduce_scene(self.scene, self.comm, reach=True)

    @cached_property
    def system(self) -> System:
        """System of the reduced bodies; collective."""
        if self.cache is None:
            return self.reduction.system
        return self.cache.system_of(self.scene, lambda: self.reduction.system)

    def motion(self) -> Motion | None:
        """Simulate the scene, unless another process has; return its motion on rank 0, None on other ranks; collective.

        Raises an InputError, ConvergenceError or SimulationError if the scene can't be reduced or simulated.
        """
        if self.future is not None and not self.future.exception() and (motion := self.future.result()) is not None:
            return motion
        system = self.system
        return call_on_first_rank(self.comm, lambda: Motion.compute(self.scene, system))


def start_richer(scene: Scene, cache: Cache, helper: Executor, stored: bool) -> FutureMotion:
    """Let another process, one of `helper`, reduce and simulate the richer model of a scene for `measure_model`.

    The process stores the system of the richer model in `cache`.  Returns a future of its motion.  Returns None unless
    `cache` has that system already, if `stored` is true, or lacks it, if `stored` is false.  Returns None, too, if
    `measure_model` has a reason to measure nothing, or if no process can be started.
    """
    with suppress(InputError):  # no comparison
        if scene.computed_key is None and cache.has_system(richer := model_comparison(scene).richer) == stored:
            return _start_motion(richer, cache, helper)
    return None


def start_other_mesh(scene: Scene, cache: Cache, helper: Executor) -> FutureMotion:
    """Let another process, one of `helper`, simulate a scene on another mesh for `measure_mesh`.

    Returns a future of its motion.  Returns None if `cache` lacks the system on that mesh: `measure_mesh` then makes
    it, as the other process is busy with the richer model.  Returns None, too, if `measure_mesh` has a reason to
    measure nothing, or if no process can be started.
    """
    with suppress(InputError):  # no comparison
        other = other_runs.motion_only(other_runs.other_mesh(scene).scene)
        if scene.goal is None and scene.computed_key is None and cache.has_system(other):
            return _start_motion(other, cache, helper)
    return None


def _start_motion(scene: Scene, cache: Cache, helper: Executor) -> FutureMotion:
    """Let another process, one of `helper`, compute a scene's motion; return its future, None without a process."""
    with suppress(BrokenExecutor, OSError):
        return helper.submit(_compute_motion, scene, cache.folder, cache.content)
    return None


def start_stresses(scene: Scene, helper: Executor) -> Future[None] | None:
    """Let another process, one of `helper`, compute the local stress in walls at pads and store it for later calls.

    Returns the future of its work, which has no result.  Returns None if the scene asks for no stresses, if no beam of
    it has walls that stay the same along it, or if no process can be started.
    """
    has_walls = any(traits_of(member).is_beam and member.part.has_even_walls for member in members(scene))
    if not has_walls or scene.recovery is None or not scene.recovery.stress:
        return None
    with suppress(BrokenExecutor, OSError):
        return helper.submit(_store_stresses, scene)
    return None


def _store_stresses(scene: Scene) -> None:
    """Compute and store the local stress in the walls of a scene; if that fails, store and raise nothing.

    The process that needs the stress meets the same error, and reports it.
    """
    from pmr.fullmodel.wall_stress import store_stresses  # FEniCSx, which bodies of given matrices go without

    with suppress(*UNNEEDED):
        store_stresses(scene)


def _compute_motion(scene: Scene, folder: Path, content: str) -> Motion | None:
    """Motion of a scene, whose system is stored in the `folder` of a `SystemCache`; `content` is the cache's digest.

    Returns None if a solver or the scene fails: the process that measures the error meets the same one, and reports it.
    """
    with suppress(*UNNEEDED):
        return ComparedScene(scene, MPI.COMM_WORLD, SystemCache(folder, content, MPI.COMM_WORLD)).motion()
    return None


def measure_model(
    scene: Scene,
    comm: MPI.Comm,
    cache: Cache | None,
    of_run: RunMotion | None = None,
    future: FutureMotion = None,
) -> Mapping[str, Any]:
    """Return the entry ``budget.model`` of summary.json: differences to a richer model, or the ``reason`` for none.

    The richer model is reduced and simulated, unless `future` is its motion (`start_richer`).  It is compared with the
    motion of a run's full model, `of_run`.  If `of_run` is None, the scene is reduced anew and simulated, and the
    richer model is compared with this motion.  Collective.  If `cache` is None, nothing is stored.
    """
    if scene.computed_key is not None:
        return {"beside": None, "reason": ON_MACHINE}
    label = "richer model"
    try:
        of_scene, other, label = model_comparison(scene)
        if of_run is None:
            motion = ComparedScene(of_scene, comm, cache).motion()
        else:
            motion = call_on_first_rank(comm, partial(of_run.motion, scene))
        richer_motion = ComparedScene(other, comm, cache, future).motion()  # last, as it takes longest
        return _model_budget(scene, motion, richer_motion, label, comm)
    except UNNEEDED as error:
        return _unknown_model_error(error, label)


def measure_mesh(
    scene: Scene,
    system: System,
    response: Response | None,
    comm: MPI.Comm,
    cache: Cache | None,
    future: FutureMotion = None,
) -> dict[str, Any]:
    """Return entries ``mesh`` and ``mesh_reason`` of the budget: differences to the scene on another mesh; collective.

    The other scene is reduced and simulated, unless `future` is its motion (`start_other_mesh`).  `system` and
    `response` belong to the scene itself; `response` is None on other ranks than 0.  If `cache` is None, nothing is
    stored.
    """
    if scene.computed_key is not None:
        return {"mesh_reason": ON_MACHINE}

    def compare_scene(make: Callable[[], Scene], label: str) -> dict[str, Any]:
        """Return differences by kind between the scene and the scene that `make` returns.

        If they can't be computed, ``reason`` says why.  `label` is the name of the other scene.
        """
        try:
            motion = call_on_first_rank(comm, lambda: Motion.compute(scene, system, response))
            other_motion = ComparedScene(make(), comm, cache, future).motion()
        except UNNEEDED as error:
            return _unknown_model_error(error, label)
        return _model_budget(scene, other_motion, motion, label, comm)

    return other_runs.mesh_budget(scene, compare_scene)


def _unknown_model_error(error: Exception, label: str) -> dict[str, Any]:
    """Return the entries of summary.json for an error that can't be measured.

    ``beside``, the name of the richer model, is None.  ``reason`` says why nothing was measured; for a NotHeldError,
    ``detail`` is its longer message.  `label` is the name of the scene with which the run was to be compared.
    """
    reason = reason_of(error)
    if isinstance(error, NotHeldError):
        short = f"nothing holds its {label}: {error.short}; pads or supports that hold this motion are needed"
        return {"beside": None, "reason": short, "detail": reason}
    return {"beside": None, "reason": reason}


def _choose_model(options: list[Scene], comm: MPI.Comm, cache: Cache | None) -> ModelDecision:
    """Choose a model among `options`: compare each beam, from the simplest on, with the shell, which is the last one.

    The choice is that of `decide_models`.  Collective.  If `cache` is None, nothing is stored.  Raises an InputError if
    no beam is accurate enough, and the scene needs what only a beam has.
    """
    *beams, shell = options
    tried = list[dict[str, Any]]()

    def chosen_figures(scene: Scene, **more: Any) -> dict[str, Any]:
        """Return ``chosen_model`` of summary.json for the chosen scene, with the further entries `more`."""
        return _chosen_model(scene) | {"tolerance": scene.compare.model_tolerance, "tried": tried} | more

    try:
        richest = ComparedScene(comparable_scene(shell), comm, cache)
        best = richest.motion()
        for beam in beams:
            motion = ComparedScene(comparable_scene(beam), comm, cache).motion()
            part = _model_budget(beam, motion, best, "shell", comm)
            tried.append(_chosen_model(beam) | {"error": largest_model_error(part)})
            if comm.rank == 0:
                _log.info("%(name)s, walls %(walls)s: the error is %(error).2g of a shell's result", tried[-1])
            if tried[-1]["error"] <= beam.compare.model_tolerance:
                return ModelDecision(beam, part, chosen_figures(beam))
    except UNKNOWN as error:
        reason = str(error)
        return ModelDecision(beams[0], {"beside": None, "reason": reason}, chosen_figures(beams[0], reason=reason))
    check_scene(shell)  # raises if the scene needs what only a beam has
    return ModelDecision(shell, None, chosen_figures(shell))


def _model_budget(
    scene: Scene, motion: Motion | None, other: Motion | None, label: str, comm: MPI.Comm
) -> dict[str, Any]:
    """Return the differences between the motions of two scenes, by kind as `model_budget` does; collective.

    The differences are those of `motion` to the motion `other` of the scene `label`.  Rank 0 has both motions; these
    are None on other ranks, which get the same result.
    """
    part = None if motion is None or other is None else model_budget(scene, motion, other, label)
    errors: dict[str, Any] = comm.bcast(part)
    return errors


def _chosen_model(scene: Scene) -> dict[str, Any]:
    """Return the structural model of the outermost body: its ``name``, and as ``walls`` the value of `body.walls`."""
    last = members(scene)[-1]
    return {"name": model_of(last), "walls": last.part.body.walls}
