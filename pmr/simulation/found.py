"""A motion that has been found, as signals of a frame's base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import SkipValidation

from pmr.scene import Scene
from pmr.scene.frame import BaseMotion
from pmr.scene.machine import DIRECTIONS
from pmr.scene.signals import SignalBase

Array = NDArray[np.float64]
#: Of a step, within which a time is that of the step.
SAME = 1e-6
#: p = sum_k x^k of value, h rate, h^2 second rate at both ends of a step, (6, 6).
_ENDS = np.array([[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 2, 0, 0, 0], [1] * 6, range(6), [0, 0, 2, 6, 12, 20]])
_QUINTIC = np.linalg.inv(_ENDS.astype(float))


@dataclass(frozen=True, eq=False)
class Samples:
    """Motion in one direction at the steps, compared by identity."""

    step: float  # s
    values: Array  # (3, T): m or rad, with rate and second rate
    force: Array  # (T,) N or N m: what the machine presses with on the ground there
    inputs: Mapping[str, Array]  # (T,) by the names of those by which the frame accelerates the boom


class Found(SignalBase):
    """A direction of a machine, in m or in the unit of the frame's angles."""

    samples: SkipValidation[Any]
    unit: float  # so many of m or rad

    def value(self, t: ArrayLike) -> Array:
        return self._at(t, 0)

    def rate(self, t: ArrayLike) -> Array:
        return self._at(t, 1)

    def second_rate(self, t: ArrayLike) -> Array:
        return self._at(t, 2)

    def bounds(self, start: float, end: float) -> tuple[float, float]:
        """Least and largest value of the steps within a span of time."""
        of: Samples = self.samples
        first, last = int(np.floor(start / of.step)), int(np.ceil(end / of.step))
        some = of.values[0, max(first, 0) : last + 1] * self.unit
        return float(some.min()), float(some.max())

    def _at(self, t: ArrayLike, order: int) -> Array:
        """Value or rate at times t; between two steps by the polynomial of degree 5 through both."""
        of: Samples = self.samples
        at, h = np.clip(np.asarray(t, float) / of.step, 0.0, of.values.shape[1] - 1.0), of.step
        k = np.rint(at).astype(int)
        values = np.asarray(of.values[order][k])
        between = np.abs(at - k) > SAME
        if between.any():
            k = np.minimum(np.floor(at).astype(int), of.values.shape[1] - 2)
            scaled = of.values * (h ** np.arange(3))[:, None]
            ends = np.concatenate([scaled[:, k], scaled[:, k + 1]])
            c = np.moveaxis(np.tensordot(_QUINTIC, ends, 1), 0, -1)
            factor = np.array([np.prod(np.arange(p, p - order, -1)) for p in range(order, 6)])
            powers = (at - k)[..., None] ** np.arange(6 - order)
            values = np.where(between, (c[..., order:] * factor * powers).sum(axis=-1) / h**order, values)
        return np.asarray(values * self.unit)


class AtSteps(SignalBase):
    """Values of an input at the steps, joined by straight lines."""

    samples: SkipValidation[Any]
    name: str

    def value(self, t: ArrayLike) -> Array:
        of: Samples = self.samples
        values = of.inputs[self.name]
        return np.asarray(np.interp(np.asarray(t, float) / of.step, np.arange(len(values)), values))

    def rate(self, t: ArrayLike) -> Array:
        of: Samples = self.samples
        k = np.clip(np.floor(np.asarray(t, float) / of.step + SAME).astype(int), 0, of.values.shape[1] - 2)
        return np.asarray(np.diff(of.inputs[self.name])[k] / of.step)

    def bounds(self, start: float, end: float) -> tuple[float, float]:
        """Least and largest value of all steps."""
        values = self.samples.inputs[self.name]
        return float(values.min()), float(values.max())


def found_inputs(scene: Scene) -> dict[str, SignalBase]:
    """Inputs by which a machine was found to accelerate the boom, by their names; none where it was not.

    Their average over a step is that of the frame.  At its ends alone they are not, for generalized-alpha leaves what
    alternates from step to step undamped, and that is not to be multiplied with what changes meanwhile.
    """
    base = None if scene.frame is None else scene.frame.base
    samples = base.x.samples if base is not None and isinstance(base.x, Found) else None
    return {} if samples is None else {name: AtSteps(samples=samples, name=name) for name in samples.inputs}


def moves_by_itself(scene: Scene) -> bool:
    """Whether a machine's motion is found with the model, or was: not where all of its directions are held."""
    machine = None if scene.frame is None else scene.frame.machine
    return bool(found_inputs(scene)) or (machine is not None and bool(machine.free))


@dataclass(frozen=True)
class MachineMotion:
    """Motion of a machine at T steps: x, y, z of the pivot in m, roll, pitch and yaw in rad."""

    step: float  # s
    values: Array  # (3, T, 6), with rates and second rates
    forces: Array  # (T, 6) N and N m: what it presses with on the ground, by springs, dampers and where it is held
    inputs: Mapping[str, Array]  # (T,) by which it accelerates the boom; none where nothing is free
    momenta: Array  # (T, 6): linear and angular momentum of the whole about the ground's origin, along its axes


def in_motion(scene: Scene, track: MachineMotion) -> Scene:
    """The scene with a frame whose base moves so, in place of a machine that moves by itself."""
    frame = scene.frame
    assert frame is not None  # of a scene with a machine
    angle = 1.0 if frame.unit == "rad" else 180.0 / np.pi
    signals: dict[str, Any] = {
        direction: Found(
            samples=Samples(track.step, np.ascontiguousarray(track.values[:, :, k]), track.forces[:, k], track.inputs),
            unit=1.0 if k < 3 else angle,
        )
        for k, direction in enumerate(DIRECTIONS)
    }
    base = BaseMotion.model_construct(**signals)
    return scene.model_copy(update={"frame": frame.model_copy(update={"base": base, "machine": None})})
