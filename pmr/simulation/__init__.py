"""Simulators, a folder each: `native` (march, compiled), `exudyn` (with the ANCF reference), `petsc` (full order).

Every simulator of a sliding body fulfils `Simulator`: the same arguments, and a `Trajectory` that holds all steps,
t = 0 included; of a system of bodies it is `SystemSimulator`.  Full models, of which nobody keeps all steps, have
`petsc.observe`.  What a simulator can't do it doesn't try: `pmr.scene.simulators.refuse`
says so, with the key to change.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from pmr.simulation.excitation import Excitation
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import Progress, TimeStepping
from pmr.system.body import SlidingBody, Trajectory
from pmr.system.system import System, SystemTrajectory

__all__ = ["Excitation", "InitialState", "Progress", "Simulator", "SystemSimulator", "TimeStepping"]


class Simulator(Protocol):
    """Integrates a sliding body over time."""

    def __call__(
        self,
        body: SlidingBody,
        excitation: Excitation,
        initial: InitialState | None = None,
        progress: Progress | None = None,
    ) -> Trajectory:
        """Simulate from t = 0 on.

        Parameters
        ----------
        body : SlidingBody
            Reduced or full.
        excitation : Excitation
            One path, within the body's domain, a load for each of the body's inputs, and the time grid.
        initial : InitialState, optional
            Coordinates and velocities at t = 0; at rest and undeformed by default.
        progress : callable, optional
            Called with the share of the time span that is done.

        Raises
        ------
        InputError
            If the path leaves the domain, a load is missing, or the initial position violates the rows.
        SimulationError
            If a step fails or a result is not finite.
        """
        ...


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
            The system's paths, by name, and a load for each ``body.input``.
        initial : mapping of str to InitialState, optional
            Of each body; those that are missing start at rest, undeformed.  `native.systems.static_start` gives one.
        progress : callable, optional

        Raises
        ------
        InputError
            If a path leaves a row, a load is missing, a start violates a rigid contact, or a rigid one only pushes.
        SimulationError
            If contacts depend on each other, a result is not finite, or the motion grows.
        """
        ...
