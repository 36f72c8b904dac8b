"""Time grid of a simulation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError

Array = NDArray[np.float64]
#: Called with the share of the time span, 0 to 1, that is done.
Progress = Callable[[float], None]


@dataclass(frozen=True)
class TimeStepping:
    """Generalized-alpha with a constant step, index 3: t_k = k step for k = 0 ... steps.

    Attributes
    ----------
    end : float, s
        A whole number of steps.
    step : float, s
    rho_inf : float
        Spectral radius at infinite frequency: 1 keeps all energy, 0 removes the highest frequencies at once.
    parts : int
        Equal parts of a step in which rows that only push are followed; 0, the default: as many as their contact takes
        (`pmr.simulation.contact_step`).  Without such rows a step is one.
    schedule : tuple of int
        Instead of it, the parts of each step: 1, 2, 4 and so on, as a simulation of a system chose them.

    Raises
    ------
    InputError
        If the values do not make up a time grid.
    """

    end: float
    step: float
    rho_inf: float = 0.9
    parts: int = 0
    schedule: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 < self.step <= self.end:
            allowed = f"more than 0 and at most end = {self.end:g} s is allowed"
            raise InputError("scene", "time.step", self.step, allowed)
        if abs(self.steps * self.step - self.end) > 1e-9 * self.end:
            allowed = f"a whole number of steps must make up end = {self.end:g} s"
            raise InputError("scene", "time.step", self.step, allowed)
        if not 0.0 <= self.rho_inf <= 1.0:
            raise InputError("scene", "time.rho_inf", self.rho_inf, "0 to 1 is allowed")
        if self.parts < 0:
            raise InputError("scene", "time.parts", self.parts, "0 or more is allowed")

    @property
    def steps(self) -> int:
        return round(self.end / self.step)

    def divide(self, parts: int) -> TimeStepping:
        """Time grid with `parts` steps for each step of this one."""
        return self if parts == 1 else TimeStepping(self.end, self.end / (self.steps * parts), self.rho_inf, 1)

    @property
    def times(self) -> Array:
        """(steps + 1,) s, 0 included."""
        return np.arange(self.steps + 1) * self.step
