"""Which way pads slide, and whether they do, as friction has it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pmr.scene.signals import SignalBase
from pmr.scene.signals.base import Array, Floats


class Sliding(SignalBase):
    r"""tanh(s'(t) / v) of a path s and the speed v in m/s at which friction is at 76 %."""

    path: SignalBase
    speed: float

    def value(self, t: ArrayLike) -> Array:
        return np.asarray(np.tanh(self.path.rate(t) / self.speed))

    def rate(self, t: ArrayLike) -> Array:
        now = self.value(t)
        return np.asarray((1.0 - now**2) * self.path.second_rate(t) / self.speed)

    @property
    def breaks(self) -> Floats:
        return self.path.breaks
