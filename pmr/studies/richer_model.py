"""A load chart's structural model beside a richer one: the same boom, made of shells, at the same places."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pmr.errors import ConvergenceError, InputError, SimulationError
from pmr.files import npz
from pmr.scene import Scene
from pmr.scene.richer import model_comparison
from pmr.simulation.statics.postures import Postures, Stands
from pmr.studies.engine.task import TaskResult

#: Limits of what the richer model has at other places, or not at all.
UNCOMPARED = ("stress", "field", "function", "expression")
#: Why these are not compared.
STRESS = "it depends on how walls bend at pads, loads and corners"
#: What makes the error unknown, as in runs.
UNKNOWN = (InputError, ConvergenceError, SimulationError, ValueError, ImportError)
#: Kinds of outputs and contacts that both models have to have.
COMPARED = ("tip", "support", "pad", "cylinder")


def richer_model(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: `Postures` of a richer structural model, ``model.``, and what it is ``called``; or the ``reason`` for none.

    It is the model that runs are compared with (`pmr.scene.richer.model_comparison`), with 20 free modes a section.
    """
    from pmr.reduction.bodies import join_bodies, reduce_bodies
    from pmr.studies import shared
    from pmr.system.from_scene import force_names

    scene, at = Scene.model_validate(arguments["boom"]), Stands.of(arguments["at"])
    try:
        of_scene, other, called = model_comparison(scene)
        if any(sorted(force_names(of_scene)[kind]) != sorted(force_names(other)[kind]) for kind in ("pad", "cylinder")):
            return _without(f"a {called} has other pads and cylinders")
        system = join_bodies(other, reduce_bodies(other, shared.bodies_of(other)))
        postures = Postures.of(other, system, at)
    except UNKNOWN as error:
        return _without(error.allowed if isinstance(error, InputError) else str(error))
    return TaskResult(arrays={**npz.arrays(postures, "model."), "called": np.array(called)})


def _without(reason: str) -> TaskResult:
    return TaskResult(arrays={"reason": np.array(reason)})
