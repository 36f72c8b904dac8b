"""Simulators, one file each: `exudyn` (reduced and full bodies), `ancf` (an independent reference).

Every simulator of a sliding body fulfils `Simulator`: the same arguments, and a `Trajectory` that holds all
steps, t = 0 included.
"""

from __future__ import annotations

from typing import Protocol

from pmr.scene.signals import SignalBase
from pmr.simulate.start import InitialState
from pmr.simulate.stepping import Loads, Progress, TimeStepping
from pmr.system.body import SlidingBody, Trajectory

__all__ = ["InitialState", "Loads", "Progress", "Simulator", "TimeStepping"]


class Simulator(Protocol):
    """Integrates a sliding body over time."""

    def __call__(
        self,
        body: SlidingBody,
        path: SignalBase,
        loads: Loads,
        stepping: TimeStepping,
        initial: InitialState | None = None,
        progress: Progress | None = None,
    ) -> Trajectory:
        """Simulate from t = 0 on.

        Parameters
        ----------
        body : SlidingBody
            Reduced or full.
        path : signal
            Slider path s(t) in m, within the body's domain.
        loads : signal or sequence of signals
            One for each of the body's inputs, in their order; N (or N m).
        stepping : TimeStepping
        initial : InitialState, optional
            Coordinates and velocities at t = 0; at rest and undeformed by default.
        progress : callable, optional
            Told the share of the time span that is done.

        Raises
        ------
        InputError
            If the path leaves the domain, a load is missing, or the initial position violates the rows.
        SimulationError
            If a step fails or a result is not finite.
        """
        ...
