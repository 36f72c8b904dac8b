r"""Momenta and forces of a machine and its boom about the ground's origin, along axes of the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.scene import Scene
from pmr.scene.machine import DIRECTIONS
from pmr.scene.signals import Constant
from pmr.simulation.answers import Answering
from pmr.simulation.floating import Motion, State
from pmr.simulation.free_base import FreeBase
from pmr.simulation.machine.flexible import Flexible, Moved
from pmr.simulation.turning import Angle, Turning
from pmr.system.changing_rows import ChangingRows
from pmr.system.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Whole:
    """Machine and boom at a step."""

    momenta: Array  # (6,) linear, angular
    forces: Array  # (6,) from outside, but for what holds the machine
    springs: Array  # (6,) of springs and dampers, by their directions
    axes: Array  # (3, 3) about which roll, pitch and yaw turn, as columns


@dataclass(frozen=True)
class Carrier:
    """How a machine carries its boom: what the boom feels of its velocity and acceleration, in the boom's axes."""

    R: Array  # (3, 3) from the boom's axes to the ground's
    v: Array  # (3,) m/s of the pivot, along the ground's
    omega: Array  # (3,) rad/s of the boom
    turned: Array  # (3, 3): omega by rates of roll, pitch and yaw
    left: Array  # (3,) rad/s^2: its rate where these rates stay

    def change(self, before: Carrier) -> Array:
        """Of velocity and angular velocity in a step (6,)."""
        return np.append((self.R + before.R).T @ (self.v - before.v) / 2.0, self.omega - before.omega)

    def felt(self, second: Array) -> Array:
        """Accelerations (6,) by second rates of the directions (6,)."""
        return np.append(self.R.T @ second[:3], self.turned @ second[3:] + self.left)

    def second(self, felt: Array) -> Array:
        """The other way round."""
        return np.append(self.R @ felt[:3], np.linalg.solve(self.turned, felt[3:] - self.left))


class Rigid:
    """What `flexible` leaves to the machine.

    An InputError is raised as for `FreeBase` and `ChangingRows`.
    """

    def __init__(self, scene: Scene, system: System, flexible: Flexible) -> None:
        frame = scene.frame
        assert frame is not None and frame.machine is not None  # of those who ask
        self._of, self._flexible, self.machine = FreeBase(scene, system, flexible.assembly), flexible, frame.machine
        along = ChangingRows(flexible.assembly, (*scene.names, *self._of.aside))
        gives = np.any(along.at(flexible.extended(0).value).rows.F != 0.0, axis=1)
        self._answering = Answering(self._of, flexible.assembly, along, gives)
        none, t, machine = Constant(amount=0.0), flexible.times, frame.machine
        angle = 1.0 if frame.unit == "rad" else np.pi / 180.0
        units, motions = np.array([1.0] * 3 + [angle] * 3), {} if frame.base is None else frame.base.motions
        held = [motions.get(one, none) for one in DIRECTIONS]
        #: (3, T, 6): of directions that are held, and of what springs stand on
        self.given = (
            np.array([[getattr(one, what)(t) for one in held] for what in ("value", "rate", "second_rate")]).transpose(
                0, 2, 1
            )
            * units
        )
        begun = [[getattr(of, one) for one in DIRECTIONS] for of in (machine.start, machine.rate)]
        self.start = np.array(begun) * units  #: (2, 6): of free directions, with rates
        self._stiffness, self._damping = (
            np.array([getattr(of, one) for one in DIRECTIONS]) for of in (machine.stiffness, machine.damping)
        )
        pushed = [getattr(of, axis) or none for of in (machine.force, machine.moment) for axis in "xyz"]
        self._pushed = np.stack([one.value(t) for one in pushed], axis=1)
        self._weight = np.zeros(len(t)) if scene.gravity is None else scene.gravity.signal.value(t)

    @property
    def sprung(self) -> NDArray[np.bool_]:
        """(6,): whether a spring carries a direction."""
        return np.asarray(self._stiffness > 0.0)

    def balanced(self, whole: Whole) -> float:
        """Acceleration in m/s^2 that weight and springs may make where they are in balance but for round-off."""
        mass = self._of.boom.mass + self.machine.mass
        return float(np.abs(self._weight).max() + np.abs(whole.springs).max() / mass)

    def carrier(self, k: int, base: Array) -> Carrier:
        """Of a motion (3, 6), whose second rates do not count."""
        turning, _, axes = self._turned(k, np.vstack([base[:2], np.zeros((1, 6))]))
        R = turning.rotation[0]
        return Carrier(R, base[1, :3], turning.velocity[0], R.T @ axes, turning.acceleration[0])

    def at(self, k: int, base: Array, moved: Moved) -> Whole:
        """At step k, with the machine's motion (3, 6)."""
        turning, own, axes = self._turned(k, base)
        state, R, v = self._state(k, turning, moved), turning.rotation[0], base[1, :3]
        boom = state.momentum(R.T @ v)
        Rb, omega, c = own.rotation[0], own.velocity[0], np.array(self.machine.center)
        linear, lever = self.machine.mass * (v + Rb @ np.cross(omega, c)), Rb @ c
        P = R @ boom[:3] + linear
        H = R @ boom[3:] + np.cross(lever, linear) + Rb @ (np.array(self.machine.inertia) * omega)
        springs = self._springs(k, base)
        F, M = self._from_outside(k, base, moved, springs, axes, turning, R @ state.s + self.machine.mass * lever)
        x = base[0, :3]
        return Whole(np.append(P, H + np.cross(x, P)), np.append(F, M + np.cross(x, F)), springs, axes)

    def needed(self, k: int, base: Array, moved: Moved) -> Array:
        """What has to hold the machine, (6,) N and N m by its directions, for all to be accelerated so."""
        turning, own, axes = self._turned(k, base)
        assert moved.second is not None
        R, extended = turning.rotation[0], self._flexible.extended(k)
        state = self._state(k, turning, moved)
        second = np.concatenate([R.T @ base[2, :3], turning.acceleration[0], moved.second, extended.second])
        boom = (state.forces() + state.mass() @ second)[:6]
        Rb, omega, c = own.rotation[0], own.velocity[0], np.array(self.machine.center)
        a = base[2, :3] + Rb @ (np.cross(own.acceleration[0], c) + np.cross(omega, np.cross(omega, c)))
        linear, inertia = self.machine.mass * a, np.array(self.machine.inertia)
        turned = Rb @ (inertia * own.acceleration[0] + np.cross(omega, inertia * omega)) + np.cross(Rb @ c, linear)
        springs = self._springs(k, base)
        first = R @ state.s + self.machine.mass * (Rb @ c)
        F, M = self._from_outside(k, base, moved, springs, axes, turning, first)
        return np.append(R @ boom[:3] + linear - F, axes.T @ (R @ boom[3:] + turned - M))

    def _turned(self, k: int, base: Array) -> tuple[Turning, Turning, Array]:
        """The boom's frame, the machine's, and the axes (3, 3) of its angles."""
        rocking: list[Angle] = [(base[0, j, None], base[1, j, None], base[2, j, None]) for j in (3, 4, 5)]
        own = Turning.rocked(rocking)
        R, (c, s) = own.rotation[0], (np.cos(base[0, 5]), np.sin(base[0, 5]))
        axes = np.stack([R[:, 0], np.array([-s, c, 0.0]), np.array([0.0, 0.0, 1.0])], axis=1)
        luffing, slewing = self._flexible.angles(k)
        return Turning.by(luffing, slewing, rocking), own, axes

    def _state(self, k: int, turning: Turning, moved: Moved) -> State:
        extended = self._flexible.extended(k)
        motion = Motion(turning.velocity[0], np.zeros(3))
        return State(self._of.boom, motion, extended, moved.q, moved.rate, self._answering.moments(extended))

    def _springs(self, k: int, base: Array) -> Array:
        beyond = base[:2] - self.given[:2, k]
        return -self._stiffness * beyond[0] - self._damping * beyond[1]

    def _from_outside(
        self, k: int, base: Array, moved: Moved, springs: Array, axes: Array, turning: Turning, first: Array
    ) -> tuple[Array, Array]:
        """Force, and moment about the pivot; `first` is the first moment of all mass (3,) kg m from there."""
        weight = np.array([0.0, 0.0, -self._weight[k]])
        mass = self._of.boom.mass + self.machine.mass
        pushed, R = self._of.loads(moved.loads, self._flexible.extended(k)), turning.rotation[0]
        F = mass * weight + R @ pushed[:3] + self._pushed[k, :3] + springs[:3]
        M = np.cross(first, weight) + R @ pushed[3:] + self._pushed[k, 3:]
        if springs[3:].any():
            M = M + np.linalg.solve(axes.T, springs[3:])
        return F, M
