"""How far sections of a boom are accelerated along it by their extensions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from pmr.scene.signals import SignalBase
from pmr.scene.signals.base import Array, Floats, Strand


class Acceleration(SignalBase):
    r"""The sum of some paths twice differentiated, m/s^2, as a step of h sees it: a kink is spread over one.

    .. math:: a(t) = \big(\dot s(t + h/2) - \dot s(t - h/2)\big) / h

    What moves at t = 0 has moved so before: no kink is there.
    """

    paths: tuple[SignalBase, ...]
    step: float

    def value(self, t: ArrayLike) -> Array:
        t, half = np.asarray(t, float), self.step / 2.0
        before = np.maximum(t - half, 0.0)
        changes = [path.rate(t + half) - path.rate(before) for path in self.paths]
        return np.asarray(np.sum(changes, axis=0) / (t + half - before))

    @property
    def strands(self) -> tuple[Strand, ...]:
        return tuple(replace(strand, spread=self.step) for path in self.paths for strand in path.strands)

    def rate(self, t: ArrayLike) -> Array:
        t, half = np.asarray(t, float), self.step / 2.0
        before = np.maximum(t - half, 0.0)
        return np.asarray((self.value(t + half) - self.value(before)) / (t + half - before))

    def on_steps(self, step: float) -> Acceleration:
        return self.model_copy(update={"step": step})

    @property
    def breaks(self) -> Floats:
        return tuple(sorted({b for path in self.paths for b in path.breaks}))
