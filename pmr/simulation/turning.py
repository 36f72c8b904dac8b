"""How the frame of a boom turns: angular velocity, angular acceleration and rotation, from its angles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmr.scene.frame import rotation
from pmr.scene.signals import SignalBase

Array = NDArray[np.float64]
#: An angle in rad, its rate and its second rate, (T,) each.
Angle = tuple[Array, Array, Array]


@dataclass(frozen=True)
class Turning:
    """Angular velocity (T, 3) in rad/s and acceleration (T, 3) of the frame in its axes, and its rotation (T, 3, 3)."""

    velocity: Array
    acceleration: Array
    rotation: Array  # from its axes into those of the ground

    @classmethod
    def of(cls, luffing: SignalBase, slewing: SignalBase, t: Array, rocking: Sequence[SignalBase] = ()) -> Turning:
        """At the times t (T,) s, on a base that rolls, pitches and yaws by `rocking`, or keeps its direction."""
        return cls.by(_motion_of(luffing, t), _motion_of(slewing, t), [_motion_of(angle, t) for angle in rocking])

    @classmethod
    def by(cls, luffing: Angle, slewing: Angle, rocking: Sequence[Angle] = ()) -> Turning:
        """Rotation by angles (T,) rad, with their rates and second rates."""
        turning = cls._on_base(luffing, slewing)
        if not rocking:
            return turning
        base = cls.from_rocking(rocking)
        velocity, acceleration = (
            np.einsum("tji,tj->ti", turning.rotation, vectors) for vectors in (base.velocity, base.acceleration)
        )
        return cls(
            velocity + turning.velocity,
            acceleration + np.cross(velocity, turning.velocity) + turning.acceleration,
            base.rotation @ turning.rotation,
        )

    @classmethod
    def from_rocking(cls, rocking: Sequence[Angle]) -> Turning:
        """A base that rolls by a, pitches by b and yaws by c, :math:`R_Z(c) R_Y(b) R_X(a)`, in its own axes."""
        (a, a1, a2), (b, b1, b2), (c, c1, c2) = rocking
        (ca, sa), (cb, sb) = ((np.cos(angle), np.sin(angle)) for angle in (a, b))
        velocity = np.stack([a1 - c1 * sb, b1 * ca + c1 * sa * cb, c1 * ca * cb - b1 * sa], axis=-1)
        acceleration = np.stack(
            [
                a2 - c2 * sb - c1 * b1 * cb,
                b2 * ca - b1 * a1 * sa + c2 * sa * cb + c1 * a1 * ca * cb - c1 * b1 * sa * sb,
                c2 * ca * cb - c1 * a1 * sa * cb - c1 * b1 * ca * sb - b2 * sa - b1 * a1 * ca,
            ],
            axis=-1,
        )
        ones, none = np.ones_like(a), np.zeros_like(a)
        roll = np.moveaxis(np.array([[ones, none, none], [none, ca, -sa], [none, sa, ca]]), -1, 0)
        return cls(velocity, acceleration, rotation(-b, c) @ roll)

    @classmethod
    def _on_base(cls, luffing: Angle, slewing: Angle) -> Turning:
        (phi, rise, second), (psi, turn, faster) = luffing, slewing
        sine, cosine = np.sin(phi), np.cos(phi)
        return cls(
            np.stack([turn * sine, -rise, turn * cosine], axis=-1),
            np.stack(
                [faster * sine + turn * rise * cosine, -second, faster * cosine - turn * rise * sine],
                axis=-1,
            ),
            rotation(phi, psi),
        )

    @property
    def up(self) -> Array:
        """The vertical (T, 3), in its axes."""
        return self.rotation[:, 2]

    @cached_property
    def gradient(self) -> Array:
        """A (T, 3, 3) in 1/s^2."""
        spin = _skew(self.velocity)
        return _skew(self.acceleration) + spin @ spin


def _motion_of(angle: SignalBase, t: Array) -> Angle:
    return angle.value(t), angle.rate(t), angle.second_rate(t)


def _skew(vectors: Array) -> Array:
    """Matrices (T, 3, 3) whose product with r is v x r."""
    x, y, z = vectors.T
    none = np.zeros_like(x)
    return np.stack([none, -z, y, z, none, -x, -y, x, none], axis=-1).reshape(-1, 3, 3)
