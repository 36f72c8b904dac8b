r"""How a frame that moves accelerates the sections of a boom, as amplitudes of constant fields.

With the tail of a section at X on the boom's axis, the base's tail at p from the pivot, and the vertical e_Z,

.. math::
    a(r) = g\, e_Z + \ddot X e_x + 2\, \omega \times \dot X e_x + A\, (p + X e_x + r), \qquad
    A = \tilde\alpha + \tilde\omega \tilde\omega

is what a body has to be accelerated by to stay at rest in the frame, its weight included: a constant, and A, for each
r_k along e_j.  Loads are minus these.  `pmr.scene.frame` has the axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.scene import Scene
from pmr.scene.choice import inertia_fields
from pmr.scene.frame import INERTIA
from pmr.scene.members import Member
from pmr.scene.signals import Constant, SignalBase
from pmr.scene.signals.base import Floats
from pmr.simulation.acceleration import Acceleration

Array = NDArray[np.float64]
#: In which the least and the largest amplitude are looked for.
SAMPLES = 10_001


@dataclass(frozen=True)
class Turning:
    """Angular velocity (T, 3) in rad/s and acceleration (T, 3) of the frame, and the vertical (T, 3), in its axes."""

    velocity: Array
    acceleration: Array
    up: Array

    @classmethod
    def of(cls, luffing: SignalBase, slewing: SignalBase, t: Array) -> Turning:
        """At the times t (T,) s."""
        phi, rise, second = luffing.value(t), luffing.rate(t), luffing.second_rate(t)
        turn, faster = slewing.rate(t), slewing.second_rate(t)
        sine, cosine, none = np.sin(phi), np.cos(phi), np.zeros_like(phi)
        return cls(
            np.stack([turn * sine, -rise, turn * cosine], axis=-1),
            np.stack(
                [faster * sine + turn * rise * cosine, -second, faster * cosine - turn * rise * sine],
                axis=-1,
            ),
            np.stack([sine, none, cosine], axis=-1),
        )

    @cached_property
    def gradient(self) -> Array:
        """A (T, 3, 3) in 1/s^2."""
        spin = _crossing(self.velocity)
        return _crossing(self.acceleration) + spin @ spin


def _crossing(vectors: Array) -> Array:
    """Matrices (T, 3, 3) whose product with r is v x r."""
    return np.asarray(np.cross(np.eye(3), vectors[:, None, :]).transpose(0, 2, 1) * -1.0)


class Motion(SignalBase):
    """A component of the acceleration field of a section; by differences where its rate is asked for."""

    luffing: SignalBase
    slewing: SignalBase
    gravity: SignalBase  # m/s^2
    pivot: tuple[float, float, float]  # m: the base's tail from the pivot
    paths: tuple[SignalBase, ...]  # whose sum is X
    step: float  # s, over which kinks of paths are spread
    field: str  # ``x`` of the constant part, ``xz`` of A_xz
    factor: float = 1.0

    def value(self, t: ArrayLike) -> Array:
        at = np.asarray(t, float)
        return (self.factor * self._component(at.ravel())).reshape(at.shape)

    def rate(self, t: ArrayLike) -> Array:
        t, half = np.asarray(t, float), self.step / 2.0
        before = np.maximum(t - half, 0.0)
        return np.asarray((self.value(t + half) - self.value(before)) / (t + half - before))

    def on_steps(self, step: float) -> Motion:
        return self.model_copy(update={"step": step})

    def _component(self, t: Array) -> Array:
        turning, along = Turning.of(self.luffing, self.slewing, t), "xyz".index(self.field[0])
        if len(self.field) == 2:
            return np.asarray(turning.gradient[:, along, "xyz".index(self.field[1])])
        place = np.array(self.pivot) + self._sum(t, "value")[:, None] * np.eye(3)[0]
        speed = self._sum(t, "rate")
        found = self.gravity.value(t) * turning.up[:, along]
        found += 2.0 * np.cross(turning.velocity, np.eye(3)[0])[:, along] * speed
        found += np.einsum("tk,tk->t", turning.gradient[:, along], place)
        if along == 0 and self.paths:
            found += Acceleration(paths=self.paths, step=self.step).value(t)
        return np.asarray(found)

    def _sum(self, t: Array, what: str) -> Array:
        return np.sum([np.zeros_like(t), *(getattr(path, what)(t) for path in self.paths)], axis=0)

    @property
    def breaks(self) -> Floats:
        return tuple(sorted({b for signal in self._signals for b in signal.breaks}))

    def highest_frequency(self, start: float, end: float) -> float:
        """Twice that of angles and paths: rates are squared, and turn what they multiply."""
        return 2.0 * max(signal.highest_frequency(start, end) for signal in self._signals)

    def bounds(self, start: float, end: float) -> tuple[float, float]:
        """Sampled."""
        values = self.value(np.append(np.linspace(start, end, SAMPLES), [b for b in self.breaks if start <= b <= end]))
        return float(values.min()), float(values.max())

    @property
    def _signals(self) -> tuple[SignalBase, ...]:
        return (self.luffing, self.slewing, self.gravity, *self.paths)


def motion_of(scene: Scene, number: int, field: str, factor: float = 1.0) -> Motion:
    """A component of the acceleration field of the section with that number."""
    frame = scene.frame
    assert frame is not None  # of a scene that has one
    luffing, slewing = frame.angles
    return Motion(
        luffing=luffing,
        slewing=slewing,
        gravity=scene.gravity.signal if scene.gravity else Constant(amount=0.0),
        pivot=frame.place,
        paths=tuple(scene.extension(k) for k in range(1, number + 1)),
        step=scene.time.step,
        field=field,
        factor=factor,
    )


def inertia_loads(scene: Scene, member: Member) -> dict[str, SignalBase]:
    """Amplitudes of the inputs by which the frame accelerates a body, by their names; none where it stands still."""
    return {INERTIA + field: motion_of(scene, member.number, field, -1.0) for field in inertia_fields(member)}
