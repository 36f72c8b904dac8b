"""Of how many parts each step is made: as a reduced model's contacts asked for, or as many as resolve them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmr.kernel.laws import SchemeFactors
from pmr.simulation import contact_step
from pmr.simulation.stepping import TimeStepping

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Lengths:
    """Numbers of parts (T,) of T steps, the largest a multiple of all; N parts in all."""

    stepping: TimeStepping
    parts: Indices

    @classmethod
    def of(cls, stepping: TimeStepping, omega: float) -> Lengths:
        """Scheduled parts, or those that contacts of circular frequency `omega` in rad/s need; 0: none only pushes."""
        if omega == 0.0:
            return cls(stepping, np.ones(stepping.steps, np.int64))
        return cls(stepping, np.array(stepping.schedule or [contact_step.parts(omega, stepping)] * stepping.steps))

    @property
    def finest(self) -> int:
        return int(self.parts.max())

    def factors(self, parts: int) -> SchemeFactors:
        """Factors of the scheme for one of so many parts of a step."""
        return SchemeFactors.of(self.stepping.divide(parts).step, self.stepping.rho_inf)

    @cached_property
    def numbers(self) -> Indices:
        """(N,): which of the ends of steps in the most parts the times are, t = 0 among them."""
        return np.concatenate([[0], np.cumsum(np.repeat(self.finest // self.parts, self.parts))])

    @cached_property
    def times(self) -> Array:
        """(N,) s."""
        return np.asarray(self.stepping.divide(self.finest).times[self.numbers])

    @cached_property
    def ends(self) -> Indices:
        """Numbers of the times that end a step, (T + 1,), t = 0 among them."""
        return np.concatenate([[0], np.cumsum(self.parts)])

    @property
    def steps(self) -> int:
        """All parts of all steps, N - 1."""
        return len(self.numbers) - 1
