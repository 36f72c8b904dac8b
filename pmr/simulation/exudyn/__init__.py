"""Exudyn as a simulator, and the ANCF reference in it; Exudyn itself is loaded when it is first asked for."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pmr.errors.environment import needed

if TYPE_CHECKING:
    from pmr.simulation.exudyn.simulator import Formulation, add_pre_step_function, add_sliding_body, simulate
    from pmr.simulation.exudyn.system import simulate_system

__all__ = ["Formulation", "add_pre_step_function", "add_sliding_body", "simulate", "simulate_system"]


def __getattr__(name: str) -> Any:
    """What stands in `simulator` and `system`; an InputError is raised where Exudyn is not installed."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    needed("exudyn")
    module = "system" if name == "simulate_system" else "simulator"
    return getattr(import_module(f"pmr.simulation.exudyn.{module}"), name)
