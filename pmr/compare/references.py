"""What a reduced model is compared with: the full model, by whoever is fastest for its size, and the ANCF cable.

A reference is checked before it judges: one that fails, or that can't be trusted (`pmr.compare.trust`), is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.responses import MARCHED_UP_TO, Simulated, full_simulator, simulate_reference
from pmr.compare.trust import distrust
from pmr.errors import SimulationError, on_first
from pmr.errors.environment import Clock
from pmr.fullmodel.model import FullModel
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.simulators import REFERENCE, refuse
from pmr.simulation.excitation import Excitation
from pmr.simulation.needs import needs_on
from pmr.simulation.petsc import Checkpoint, Recording, observe, respond
from pmr.simulation.stepping import TimeStepping

Array = NDArray[np.float64]


@dataclass(frozen=True)
class References:
    """Responses by name, on rank 0, and states of the full model."""

    responses: dict[str, Response]  # ``full`` and ``ancf`` as the scene asks for them; other ranks may have none
    states: Array | None = None  # (S, n_local) of the full model at the chosen steps: this rank's rows
    missing: dict[str, str] = field(default_factory=dict)  # why one is none, by name; ``ancf`` on rank 0 alone


def references(
    scene: Scene,
    model: FullModel,
    clock: Clock | None = None,
    steps: Sequence[int] = (),
    checkpoint: Checkpoint | None = None,
    made: TimeStepping | None = None,
) -> References:
    """All that the scene asks for, and the full model's states at some of the `steps`; collective.

    The full model's steps are `made` as the reduced model's were, where rows only push.  With a `checkpoint` a
    full-order simulation that was cut off goes on.
    """
    found, missing, states = dict[str, Response](), dict[str, str](), None
    for name in [one for one in ("full", "ancf") if one in scene.compare.against]:
        try:
            if name == "full":
                response, states = _full(scene, model, clock or Clock(), steps, checkpoint, made)
            else:
                response = reference(name, scene, model, clock)
        except SimulationError as error:
            missing[name] = str(error).removeprefix(f"{name}: ")  # the clock's stage
        else:
            found |= {name: response} if response is not None else {}
    return References(found, states, missing)


def reference(name: str, scene: Scene, model: FullModel, clock: Clock | None = None) -> Response | None:
    """Response of ``"full"`` or ``"ancf"``; on rank 0, others may have none.  Collective.

    ``petsc`` works on the distributed model; for all others it is gathered on rank 0.  Raises SimulationError if it
    fails or can't be trusted; that of ``"full"`` on every rank.
    """
    if name == "full":
        return _full(scene, model, clock or Clock(), (), None, None)[0]
    body = model.gather()
    return None if body is None else _trusted(simulate_reference(name, scene, body, clock).response)


def _full(
    scene: Scene,
    model: FullModel,
    clock: Clock,
    steps: Sequence[int],
    checkpoint: Checkpoint | None,
    made: TimeStepping | None,
) -> tuple[Response | None, Array | None]:
    excitation, simulator = Excitation.of(scene), full_simulator(scene, model.size)
    excitation = excitation.with_stepping(made or excitation.stepping)
    refuse(simulator, needs_on(model, excitation), REFERENCE)
    if simulator == "petsc":
        recording = Recording(energies=True, states=[excitation.stepping.step * step for step in steps])
        with clock.stage("full") as done:
            history = observe(model, excitation, recording, progress=done, checkpoint=checkpoint)
        return _trusted(respond(model, history)), history.states.q if len(steps) else None
    kept = steps if model.size <= MARCHED_UP_TO else ()
    found = _gathered(scene, model, clock, kept, made)
    response = None if found is None else found.response
    if not len(kept):
        return response, None
    return response, _spread(model, None if found is None or found.states is None else found.states.q)


def _gathered(
    scene: Scene, model: FullModel, clock: Clock, steps: Sequence[int], made: TimeStepping | None
) -> Simulated | None:
    """What the full model does, on rank 0; where it fails there, all ranks know."""
    body = model.gather()

    def make() -> Simulated:
        assert body is not None
        found = simulate_reference("full", scene, body, clock, steps, made)
        _trusted(found.response)
        return found

    return on_first(model.comm, make)


def _trusted(response: Response) -> Response:
    reason = distrust(response)
    if reason is not None:
        raise SimulationError(reason)
    return response


def _spread(model: FullModel, states: Any) -> Array:
    """States (S, n) known on rank 0 as this rank's rows (S, n_local)."""
    whole = model.comm.bcast(states)
    return np.ascontiguousarray(whole[:, slice(*model.M.getOwnershipRange())])
