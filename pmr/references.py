"""What a reduced model is compared with: the full model, by whoever is fastest for its size, and the ANCF cable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.clock import Clock
from pmr.fullorder import Checkpoint, Watch, observe, respond
from pmr.operators import FullModel
from pmr.responses import MARCHED_UP_TO, course, full_simulator, simulate_reference
from pmr.results import Response
from pmr.scene import SceneBase
from pmr.simulate import march

Array = NDArray[np.float64]


@dataclass(frozen=True)
class References:
    """Responses by name, on rank 0, and states of the full model.

    Attributes
    ----------
    responses : dict
        ``full`` and ``ancf`` as the scene asks for them; other ranks may have none.
    states : (S, n_local) array or None
        This rank's rows of the full model's coordinates at the chosen steps, where it was simulated.
    """

    responses: dict[str, Response]
    states: Array | None = None


def references(
    scene: SceneBase,
    model: FullModel,
    clock: Clock | None = None,
    steps: Sequence[int] = (),
    checkpoint: Checkpoint | None = None,
) -> References:
    """All that the scene asks for, and the full model's states at some of the `steps`; collective.

    With a `checkpoint` a full-order simulation that was cut off goes on.
    """
    found = dict[str, Response]()
    states = None
    if "full" in scene.compare.against:
        response, states = _full(scene, model, clock or Clock(), steps, checkpoint)
        found |= {"full": response} if response is not None else {}
    if "ancf" in scene.compare.against and (response := reference("ancf", scene, model, clock)) is not None:
        found["ancf"] = response
    return References(found, states)


def reference(name: str, scene: SceneBase, model: FullModel, clock: Clock | None = None) -> Response | None:
    """Response of ``"full"`` or ``"ancf"``; on rank 0, others may have none.  Collective.

    ``petsc`` works on the distributed model; for all others it is gathered on rank 0.
    """
    if name == "full":
        return _full(scene, model, clock or Clock(), (), None)[0]
    body = model.gather()
    return None if body is None else simulate_reference(name, scene, body, clock)


def _full(
    scene: SceneBase, model: FullModel, clock: Clock, steps: Sequence[int], checkpoint: Checkpoint | None
) -> tuple[Response | None, Array | None]:
    if full_simulator(scene, model.size) == "petsc":
        path, loads, stepping = course(scene)
        watch = Watch(energies=True, states=[stepping.step * step for step in steps])
        with clock.stage("full") as done:
            history = observe(model, path, loads, stepping, watch, progress=done, checkpoint=checkpoint)
        return respond(model, history), history.states.q if len(steps) else None
    body = model.gather()
    response = None if body is None else simulate_reference("full", scene, body, clock)
    if not len(steps) or model.size > MARCHED_UP_TO:
        return response, None
    states = None if body is None else march.simulate(body, *course(scene)).q[np.asarray(steps)]
    return response, _spread(model, states)


def _spread(model: FullModel, states: Any) -> Array:
    """States (S, n) known on rank 0 as this rank's rows (S, n_local)."""
    whole = model.comm.bcast(states)
    return np.ascontiguousarray(whole[:, slice(*model.M.getOwnershipRange())])
