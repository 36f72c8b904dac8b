"""What every signal can do, and those that only know a value before and after."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field

Array = NDArray[np.float64]
#: A number in the unit of what the signal drives: m of a path, N or N m of a load.
Real = Annotated[float, Field(strict=True, json_schema_extra={"unit": "the unit of what it drives"})]
Seconds = Annotated[float, Field(strict=True, json_schema_extra={"unit": "s"})]
Hertz = Annotated[float, Field(strict=True, json_schema_extra={"unit": "Hz"})]
Radians = Annotated[float, Field(strict=True, json_schema_extra={"unit": "rad"})]
Floats = tuple[Real, ...]


class SignalBase(BaseModel):
    """What every signal can do; times in s, broadcast over arrays."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @abstractmethod
    def value(self, t: ArrayLike) -> Array:
        """Value at the times ``t``; same shape as ``t``."""

    @abstractmethod
    def rate(self, t: ArrayLike) -> Array:
        """Time derivative at the times ``t``; at a kink the one of the interval that begins there."""

    @property
    def breaks(self) -> Floats:
        """Times in s at which the value or its rate may jump."""
        return ()

    @property
    def parts(self) -> tuple[SignalBase, ...]:
        """The signals that this one is the sum of."""
        return (self,)

    def highest_frequency(self, start: float, end: float) -> float:
        """Frequency in Hz of the fastest tone within [start, end]; 0 where the signal is no tone."""
        return 0.0

    def bounds(self, start: float, end: float) -> tuple[float, float]:
        """Smallest and largest value within [start, end].

        What holds here: a value is extreme at an end or at a break, on one side of it or the other.
        """
        breaks = [b for b in self.breaks if start <= b <= end]
        before = [max(start, float(np.nextafter(b, -np.inf))) for b in breaks]
        values = self.value([start, end, *breaks, *before])
        return float(values.min()), float(values.max())


class Constant(SignalBase):
    """The same value at all times."""

    kind: Literal["constant"] = Field(default="constant", description="One value")
    amount: Real = Field(description="The value")

    def value(self, t: ArrayLike) -> Array:
        return np.full(np.shape(t), self.amount)

    def rate(self, t: ArrayLike) -> Array:
        return np.zeros(np.shape(t))


class Step(SignalBase):
    """``before`` until ``time`` (exclusive), ``after`` from then on."""

    kind: Literal["step"] = Field(default="step", description="A step")
    time: Seconds = Field(description="When it steps")
    before: Real = Field(default=0.0, description="Value until then")
    after: Real = Field(description="Value from then on")

    def value(self, t: ArrayLike) -> Array:
        return np.where(np.asarray(t, dtype=float) < self.time, self.before, self.after)

    def rate(self, t: ArrayLike) -> Array:
        return np.zeros(np.shape(t))

    @property
    def breaks(self) -> Floats:
        return (self.time,)
