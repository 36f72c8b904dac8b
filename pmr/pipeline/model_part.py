"""The model's own error, by a scene's bodies beside richer ones, reduced and moved alike; and models chosen by it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pmr.compare import model_part
from pmr.compare.accuracy import mesh
from pmr.compare.model_part import Motion
from pmr.errors import ConvergenceError, InputError, NotHeldError, SimulationError, on_first
from pmr.errors.environment import Clock
from pmr.fem.compat import MPI
from pmr.fullmodel.build import build_bodies
from pmr.reduction.cache import Cache, cache_in
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.checks import check
from pmr.scene.choice import model_of
from pmr.scene.members import members
from pmr.scene.model_ladder import candidates, comparable_scene, model_comparison
from pmr.system.system import System

SystemOf = Callable[[Scene], System]
#: What is no reason not to run: the error is not known then.  Of a model that the run does not need nothing is.
UNKNOWN = (InputError, ConvergenceError, SimulationError)
UNNEEDED = (*UNKNOWN, ValueError, ImportError)
#: Why nothing is known where the model itself finds how its base moves, and another model would find another motion.
ON_MACHINE = "not measured for a boom on frame.machine; the same boom without it tells"
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Decided:
    """A scene whose models are all known, and what was measured to choose them; the same on every rank."""

    scene: Scene
    part: Mapping[str, Any] | None = None  # ``budget.model`` of what was chosen; None where nothing was
    said: Mapping[str, Any] | None = None  # ``chosen_model`` of summary.json


def decide_models(scene: Scene, comm: MPI.Comm, clock: Clock, cache: Path | None, system_of: SystemOf) -> Decided:
    """The smallest models that are off by the scene's `compare.model_tolerance` at most, beside a shell; collective.

    Where none can be compared with a shell the smallest ones are taken, and the reason is said.
    """
    options = candidates(scene)
    if not options:
        return Decided(scene)
    with clock.stage("choice of the model"):
        cached = None
        if cache is not None:  # of the smallest model, which takes no time
            cached = cache_in(cache, next(iter(build_bodies(options[0], comm).values())).model)
        return _chosen(options, comm, cached, system_of)


def measure_model(scene: Scene, comm: MPI.Comm, cache: Cache | None, system_of: SystemOf) -> Mapping[str, Any]:
    """``budget.model`` of summary.json; what keeps it from being known stands there as ``reason``; collective."""
    if scene.frame is not None and scene.frame.machine is not None:
        return {"beside": None, "reason": ON_MACHINE}
    called = "richer model"
    try:
        of_scene, other, called = model_comparison(scene)
        return _part(of_scene, _motion_on_first(other, comm, cache, system_of), called, comm, cache, system_of)
    except UNNEEDED as error:
        return _unknown(error, called)


def mesh_measured(
    scene: Scene, system: System, response: Response | None, comm: MPI.Comm, cache: Cache | None, system_of: SystemOf
) -> dict[str, Any]:
    """``mesh`` of the budget and ``mesh_reason``, of the scene's own `system`, whose `response` rank 0 has.

    Collective.
    """
    if scene.frame is not None and scene.frame.machine is not None:
        return {"mesh_reason": ON_MACHINE}

    def beside_own(make: Callable[[], Scene], called: str) -> dict[str, Any]:
        try:
            motion = on_first(comm, lambda: Motion.of(scene, system, response))
            other_motion = _motion_on_first(make(), comm, cache, system_of)
        except UNNEEDED as error:
            return _unknown(error, called)
        part = (
            None
            if motion is None or other_motion is None
            else model_part.model_part(scene, other_motion, motion, called)
        )
        errors: dict[str, Any] = comm.bcast(part)
        return errors

    return mesh.mesh_budget(scene, beside_own)


def _unknown(error: Exception, called: str) -> dict[str, Any]:
    reason = error.allowed if isinstance(error, InputError) else str(error)
    if isinstance(error, NotHeldError):
        short = f"a {called} of it is not held: {error.short}; pads or supports against that are needed"
        return {"beside": None, "reason": short, "detail": reason}
    return {"beside": None, "reason": reason}


def _chosen(options: list[Scene], comm: MPI.Comm, cache: Cache | None, system_of: SystemOf) -> Decided:
    *beams, shell = options
    tried = list[dict[str, Any]]()

    def chosen_figures(scene: Scene, **more: Any) -> dict[str, Any]:
        return _chosen_model(scene) | {"tolerance": scene.compare.model_tolerance, "tried": tried} | more

    try:
        best = _motion_on_first(comparable_scene(shell), comm, cache, system_of)
        for beam in beams:
            part = _part(comparable_scene(beam), best, "shell", comm, cache, system_of)
            tried.append(_chosen_model(beam) | {"error": model_part.error(part)})
            if comm.rank == 0:
                _log.info("%(name)s, walls %(walls)s: off by %(error).2g of what a shell says", tried[-1])
            if tried[-1]["error"] <= beam.compare.model_tolerance:
                return Decided(beam, part, chosen_figures(beam))
    except UNKNOWN as error:
        return Decided(beams[0], {"beside": None, "reason": str(error)}, chosen_figures(beams[0], reason=str(error)))
    check(shell)  # which may not have what only a beam can
    return Decided(shell, None, chosen_figures(shell))


def _part(
    scene: Scene, other: Motion | None, called: str, comm: MPI.Comm, cache: Cache | None, system_of: SystemOf
) -> dict[str, Any]:
    """On every rank, of motions that rank 0 has."""
    motion = _motion_on_first(scene, comm, cache, system_of)
    part = None if motion is None or other is None else model_part.model_part(scene, motion, other, called)
    errors: dict[str, Any] = comm.bcast(part)
    return errors


def _motion_on_first(scene: Scene, comm: MPI.Comm, cache: Cache | None, system_of: SystemOf) -> Motion | None:
    """On rank 0; None on the others."""
    system = system_of(scene) if cache is None else cache.system_of(scene, lambda: system_of(scene))
    return on_first(comm, lambda: Motion.of(scene, system))


def _chosen_model(scene: Scene) -> dict[str, Any]:
    """The model that was chosen wherever none was known: that of the outermost body."""
    last = members(scene)[-1]
    return {"name": model_of(last), "walls": last.part.body.walls}
