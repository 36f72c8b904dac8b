"""Exudyn as a simulator, and the ANCF reference in it; Exudyn itself is loaded when it is first asked for."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from pmr.errors.environment import needed
from pmr.errors.lazy import names_from

if TYPE_CHECKING:
    from pmr.simulation.exudyn.simulator import (
        Formulation,
        Hook,
        NodeCoordinate,
        OnBody,
        add_drawing,
        add_hook,
        add_pre_step_function,
        add_sensors,
        add_sliding_body,
        add_system,
        simulate_system,
    )

__all__ = [
    "FORMULATIONS",
    "Formulation",
    "Hook",
    "NodeCoordinate",
    "OnBody",
    "add_drawing",
    "add_hook",
    "add_pre_step_function",
    "add_sensors",
    "add_sliding_body",
    "add_system",
    "simulate_system",
]

#: Of the simulators of a scene, by their names.
FORMULATIONS: dict[str, Formulation] = {
    "exudyn": "springs",
    "exudyn-multiplier": "multipliers",
    "exudyn-callback": "callbacks",
}

_PLACES = {name: f"pmr.simulation.exudyn.simulator:{name}" for name in __all__ if name != "FORMULATIONS"}
#: An InputError is raised where Exudyn is not installed.
__getattr__ = names_from(__name__, _PLACES, before=partial(needed, "exudyn"))
