"""Simulators, a folder each: `native` (march, compiled), `exudyn` (with the ANCF reference), `petsc` (full order).

Every simulator fulfils `SystemSimulator`: the same arguments, and a `SystemTrajectory` that holds all steps, t = 0
included; a body alone is the system of one.  Full models, of which nobody keeps all steps, have `petsc.observe`.  What
a simulator can't do it doesn't try: `pmr.scene.choice.refuse` says so, with the key to change.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from pmr.simulation.excitation import Excitation
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import Progress, TimeStepping
from pmr.system.states import SystemTrajectory
from pmr.system.system import System

__all__ = ["Excitation", "InitialState", "Progress", "SystemSimulator", "TimeStepping"]


class SystemSimulator(Protocol):
    """Integrates a system of bodies over time: `native.systems.simulate`, `exudyn.simulate_system`."""

    def __call__(
        self,
        system: System,
        excitation: Excitation,
        initial: Mapping[str, InitialState] | None = None,
        progress: Progress | None = None,
    ) -> SystemTrajectory:
        """Simulate all bodies from t = 0 on.

        Parameters
        ----------
        system : System
        excitation : Excitation
            The system's paths, by name and within their rows' ranges, a load for each input and an amplitude for each
            term, and the time grid.
        initial : mapping of str to InitialState, optional
            Of each body; those that are missing start at rest, undeformed.  `native.systems.static_start` gives one.
        progress : callable, optional

        Raises
        ------
        InputError
            If a path leaves a row, a load is missing, a start violates a rigid contact, or a rigid one only pushes.
        SimulationError
            If a step fails, contacts depend on each other, a result is not finite, or the motion grows.
        """
        ...
