"""What a reduced model is compared with: the full model, by whoever is fastest for its size, and the ANCF cable."""

from __future__ import annotations

from pmr.clock import Clock
from pmr.fullorder import Watch, observe, respond
from pmr.operators import FullModel
from pmr.responses import course, full_simulator, simulate_reference
from pmr.results import Response
from pmr.scene import SceneBase


def references(scene: SceneBase, model: FullModel, clock: Clock | None = None) -> dict[str, Response]:
    """All that the scene asks for, ``full`` and ``ancf``; on rank 0, others may have none.  Collective."""
    found = {name: reference(name, scene, model, clock) for name in ("full", "ancf") if name in scene.compare.against}
    return {name: response for name, response in found.items() if response is not None}


def reference(name: str, scene: SceneBase, model: FullModel, clock: Clock | None = None) -> Response | None:
    """Response of ``"full"`` or ``"ancf"``; on rank 0, others may have none.  Collective.

    ``petsc`` works on the distributed model; for all others it is gathered on rank 0.
    """
    if name == "full" and full_simulator(scene, model.size) == "petsc":
        with (clock or Clock()).stage(name) as done:
            path, loads, stepping = course(scene)
            return respond(model, observe(model, path, loads, stepping, Watch(energies=True), progress=done))
    body = model.gather()
    return None if body is None else simulate_reference(name, scene, body, clock)
