"""Exudyn as a simulator, and the ANCF reference in it; Exudyn itself is loaded when it is first asked for."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pmr.environment import needed

if TYPE_CHECKING:
    from pmr.simulate.exudyn.simulator import Formulation, add_sliding_body, simulate

__all__ = ["Formulation", "add_sliding_body", "simulate"]


def __getattr__(name: str) -> Any:
    """What stands in `pmr.simulate.exudyn.simulator`.

    Raises
    ------
    InputError
        If Exudyn is not installed.
    """
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    needed("exudyn")
    return getattr(import_module("pmr.simulate.exudyn.simulator"), name)
