"""Simulators: `native` (compiled, called ``march``), `exudyn` (with the ANCF reference), `petsc` (full order).

Each has a folder of its own.  Every simulator is a `SystemSimulator`: all take the same arguments and return a
`SystemTrajectory` of all steps, t = 0 included; a single body is a system of one body.  `petsc.observe` simulates full
models and returns selected outputs, as all steps would be too large to store.  A simulator refuses what it can't do
(`pmr.scene.choice.refuse_unsupported`), and names the key to change.
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
    """Function that integrates a system of bodies over time, such as `native.systems.simulate`."""

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
            The time grid; a signal for each path of the system, by name and within the range of its rows; a signal for
            each input and for each term.
        initial : mapping of str to InitialState, optional
            Initial state of each body, by its name; bodies that are missing start at rest, undeformed.  By default all
            start as ``excitation.start`` says: at rest or in equilibrium.
        progress : callable, optional
            Called with the share of the time span that is done, 0 to 1.

        Raises
        ------
        InputError
            If a path leaves the range of a row, a load is missing, an initial state violates a rigid contact, or a
            rigid contact only pushes.
        SimulationError
            If a step fails, contacts depend on each other, a result is not finite, or the motion's energy grows without
            work.
        """
        ...
