"""Exudyn as a simulator, and the ANCF reference in it; Exudyn itself is loaded when it is first asked for."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pmr.errors.environment import needed

if TYPE_CHECKING:
    from pmr.simulation.exudyn.simulator import (
        Formulation,
        Hook,
        OnBody,
        add_hook,
        add_pre_step_function,
        add_sensors,
        add_sliding_body,
        add_system,
        simulate,
        simulate_system,
    )

__all__ = [
    "FORMULATIONS",
    "Formulation",
    "Hook",
    "OnBody",
    "add_hook",
    "add_pre_step_function",
    "add_sensors",
    "add_sliding_body",
    "add_system",
    "simulate",
    "simulate_system",
]

#: Of the simulators of a scene, by their names.
FORMULATIONS: dict[str, Formulation] = {
    "exudyn": "springs",
    "exudyn-multiplier": "multipliers",
    "exudyn-callback": "callbacks",
}


def __getattr__(name: str) -> Any:
    """What stands in `simulator`; an InputError is raised where Exudyn is not installed."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    needed("exudyn")
    return getattr(import_module("pmr.simulation.exudyn.simulator"), name)
