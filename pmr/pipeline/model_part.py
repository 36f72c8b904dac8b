"""The model's own error: a scene's bodies beside richer ones, reduced alike, measured once per structure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare import model_part
from pmr.errors import ConvergenceError, InputError
from pmr.errors.environment import Clock
from pmr.reduction.cache import Cache
from pmr.reduction.content import structure_in
from pmr.scene import Scene
from pmr.scene.richer import beside
from pmr.simulation import Excitation
from pmr.system.system import System

Array = NDArray[np.float64]


def measured(
    scene: Scene,
    inputs: tuple[str, ...],
    clock: Clock,
    caches: Mapping[str, Cache],
    system_of: Callable[[Scene], System],
) -> dict[str, Any] | None:
    """``budget.model`` of summary.json; None unless the scene asks for it.  Collective.

    What keeps it from being known stands there as ``reason``.
    """
    if scene.compare.richer == "none":
        return None
    excitation = Excitation.of(scene)
    with clock.stage("richer model"):
        try:
            own, richer, called = beside(scene)

            def compute() -> Array:
                both = (model_part.answers(system_of(one), excitation) for one in (own, richer))
                return model_part.compared(*both)

            s = excitation.s[model_part.steps_of(excitation)].tolist()
            asked = {"own": structure_in(own), "richer": structure_in(richer), "s": s, "inputs": inputs}
            cache = next(iter(caches.values()), None)
            found = compute() if cache is None else cache.arrays("model", asked, compute)
        except (InputError, ConvergenceError) as error:  # no reason not to run
            return {"beside": None, "reason": str(error)}
    amplitudes = model_part.amplitudes_of(excitation, inputs)
    return model_part.model_part(scene, found, called, inputs, amplitudes)
