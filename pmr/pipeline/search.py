"""Models and a step to a scene's tolerance or within its budget: sought on rank 0, with models on a finer mesh."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from pmr.compare.accuracy import order
from pmr.errors import on_first
from pmr.errors.environment import Clock
from pmr.fem.compat import MPI
from pmr.reduced.model import ReducedModel
from pmr.scene import Scene

Models = Mapping[str, ReducedModel]


def chosen(
    scene: Scene, models: Models, models_of: Callable[[Scene], Models], comm: MPI.Comm, clock: Clock
) -> order.Choice | None:
    """What is chosen from models by body, the same on every rank; None for a scene that orders nothing.  Collective.

    `models_of` makes those of a scene with a finer mesh, collective as well.
    """
    if scene.ordered is None:
        return None
    with clock.stage("search"):
        choice: order.Choice = comm.bcast(on_first(comm, lambda: order.choose(scene, models)))
    finer = order.finer(choice, scene)
    if finer is None:
        return order.without_mesh(choice)
    with clock.stage("finer mesh"):
        on_finer = models_of(finer)
        found: order.Choice = comm.bcast(on_first(comm, lambda: order.with_mesh(choice, scene, models, on_finer)))
    return found
