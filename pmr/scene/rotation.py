"""Rotation of a boom's frame by its angles, its angular velocity and its angular acceleration.

The order of the angles is that of `pmr.scene.frame`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from pmr.files.arrays import Array
from pmr.scene.signals import SignalBase

#: An angle in rad, its rate and its second rate, (T,) each.
AngleMotion = Sequence[Array]


@dataclass(frozen=True)
class FrameRotation:
    """Rotation (T, 3, 3) of the frame at T times, its angular velocity and its angular acceleration.

    `velocity` (T, 3) in rad/s and `acceleration` (T, 3) in rad/s^2 are in the frame's axes.
    """

    velocity: Array
    acceleration: Array
    rotation: Array  # (T, 3, 3), from the frame's axes into those of the ground

    @classmethod
    def from_signals(
        cls, luffing: SignalBase, slewing: SignalBase, t: Array, rocking: Sequence[SignalBase] = ()
    ) -> FrameRotation:
        """Rotation of the frame by the signals of its angles at the times t (T,) in s.

        `luffing` and `slewing` are signals in rad; `rocking` are those of roll, pitch, yaw of the frame's base, empty
        if the base does not turn.
        """
        return cls.from_angles(motion_of(luffing, t), motion_of(slewing, t), [motion_of(angle, t) for angle in rocking])

    @classmethod
    def from_angles(
        cls, luffing: AngleMotion, slewing: AngleMotion, rocking: Sequence[AngleMotion] = ()
    ) -> FrameRotation:
        """Rotation by the frame's angles (T,) in rad, with rates and second rates, on a base turned by `rocking`.

        An empty `rocking` stands for a base that does not turn.
        """
        turning = cls.about_axis(2, slewing).carry(cls.about_axis(1, tuple(-part for part in luffing)))
        return cls.from_rocking(rocking).carry(turning) if rocking else turning

    @classmethod
    def from_rocking(cls, rocking: Sequence[AngleMotion]) -> FrameRotation:
        """Rotation :math:`R_Z(c) R_Y(b) R_X(a)` of a base by roll a, pitch b and yaw c in rad.

        `rocking` has each of these angles with its rate and its second rate.
        """
        roll, pitch, yaw = (cls.about_axis(axis, angle) for axis, angle in enumerate(rocking))
        return yaw.carry(pitch).carry(roll)

    @classmethod
    def about_axis(cls, axis: int, angle: AngleMotion) -> FrameRotation:
        """Rotation about the axis x, y or z (`axis` 0, 1 or 2) by an `angle` with its rate and second rate."""
        value, rate, second = (np.asarray(part)[:, None] for part in angle)
        e = np.eye(3)[axis]
        along, sine, cosine = np.outer(e, e), np.sin(value)[..., None], np.cos(value)[..., None]
        return cls(rate * e, second * e, along + cosine * (np.eye(3) - along) + sine * skew(e))

    def carry(self, inner: FrameRotation) -> FrameRotation:
        """Rotation of a frame that turns by `inner` relative to a frame that turns by this rotation.

        Velocity and acceleration are in the axes of the inner frame.
        """
        velocity, acceleration = (
            np.einsum("tji,tj->ti", inner.rotation, vectors) for vectors in (self.velocity, self.acceleration)
        )
        return FrameRotation(
            velocity + inner.velocity,
            acceleration + np.cross(velocity, inner.velocity) + inner.acceleration,
            self.rotation @ inner.rotation,
        )

    @property
    def up(self) -> Array:
        """Vertical unit vector (T, 3) in the frame's axes."""
        return self.rotation[:, 2]

    @cached_property
    def gradient(self) -> Array:
        """Gradient A (T, 3, 3) in 1/s^2 of the acceleration field: skew(alpha) + skew(omega)^2.

        A point of the frame at r (3,) from the pivot has the acceleration A r relative to the pivot, in the frame's
        axes.
        """
        spin = skew(self.velocity)
        return skew(self.acceleration) + spin @ spin


def motion_of(angle: SignalBase, t: Array) -> AngleMotion:
    """Value, rate and second rate (T,) of an angle at the times t (T,) in s."""
    return angle.value(t), angle.rate(t), angle.second_rate(t)


def wind_direction(rotation: Array, azimuth: ArrayLike) -> Array:
    """Return the unit vectors (T, 3) in which wind blows, in axes that `rotation` (T, 3, 3) turns into the ground's.

    `azimuth` (T,), or one number, is the angle in rad from X of the ground to the left.
    """
    angle = np.asarray(azimuth)[..., None]
    return np.asarray(rotation[:, 0] * np.cos(angle) + rotation[:, 1] * np.sin(angle))


def skew(vectors: Array) -> Array:
    """Matrices (..., 3, 3) of vectors v (..., 3): a matrix times a vector r is the cross product v x r."""
    matrices = np.zeros((*vectors.shape, 3), vectors.dtype)
    matrices[..., 2, 1], matrices[..., 0, 2], matrices[..., 1, 0] = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.asarray(matrices - np.swapaxes(matrices, -1, -2))


def boom_rotation(luffing: Array, slewing: Array) -> Array:
    r"""Rotation :math:`R_Z(\psi) R_Y(-\varphi)` (T, 3, 3) from axes of the boom to axes of the base.

    The angles (T,) in rad are :math:`\varphi`, the argument `luffing`, and :math:`\psi`, the argument `slewing`.  A
    base that does not rotate has Z upwards, and X where the boom points at a slewing angle of 0.
    """
    still = np.zeros_like(luffing)
    return FrameRotation.from_angles((luffing, still, still), (slewing, still, still)).rotation
