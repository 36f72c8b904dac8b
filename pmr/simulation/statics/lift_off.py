r"""A load that is hoisted off the ground at a constant speed: how much more than its weight its rope pulls with.

With the stiffness k of the rope, its speed v, and u = c q how far the boom's tip has risen, the rope is taut at t = 0
and pulls with

.. math::
    F = k\, (c\, q - y + v\, t), \qquad M \ddot q + K q = -c^T F, \qquad m\, \ddot y = F - m g

where the load stays on the ground, y = 0, until F comes to m g, and a rope that becomes slack does not push.  Each part
is solved in closed form, mode by mode, without damping, up to two periods after the load is off the ground.  On a tip
that does not give way :math:`F_{max} / m g = 1 + v \sqrt{k / m} / g`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.simulation.statics.loaded import Form

Array = NDArray[np.float64]

#: Periods of the lowest frequency after the load is off the ground, and at how many times the force is looked at.
PERIODS, SAMPLES = 2.0, 4000
#: Times that a rope may become slack and taut before it lifts the load.
MOST = 100


@dataclass(frozen=True)
class Rope:
    """Hoisting rope."""

    stiffness: float  # N/m
    speed: float  # m/s


class _Forced:
    """Modes of M x'' + K x = f_0 + t f_1 from the time `since` on, from rest or with what they begin with.

    Shapes have a unit stiffness, so that those without inertia are among them: they follow the loads at once.
    """

    def __init__(self, M: Array, K: Array, f: tuple[Array, Array], start: tuple[Array, Array], since: float) -> None:
        inertia, self._shapes = scipy.linalg.eigh(M, K)
        some = inertia > len(K) * np.finfo(float).eps * inertia[-1]
        self._w = np.where(some, 1.0 / np.sqrt(np.where(some, inertia, 1.0)), 0.0)
        self._constant, self._growing = (self._shapes.T @ vector for vector in f)
        q, v = (self._shapes.T @ (K @ vector) for vector in start)
        self._amplitude = np.where(some, q - self._constant - self._growing * since, 0.0)
        self._rate = np.where(some, (v - self._growing) / np.where(some, self._w, 1.0), 0.0)
        self._since = since
        self.period = 2.0 * np.pi * float(np.sqrt(inertia[-1]))

    def along(self, row: Array, t: Array) -> Array:
        """Values (T, ...) that a row (n,) measures at times (T,)."""
        of, angle = row @ self._shapes, self._w * (t[:, None] - self._since)
        free = np.cos(angle) @ (of * self._amplitude) + np.sin(angle) @ (of * self._rate)
        return np.asarray(free + of @ self._constant + t * (of @ self._growing))

    def at(self, t: float) -> tuple[Array, Array]:
        """Displacements and rates (n,)."""
        angle = self._w * (t - self._since)
        x = self._amplitude * np.cos(angle) + self._rate * np.sin(angle) + self._constant + self._growing * t
        v = self._w * (self._rate * np.cos(angle) - self._amplitude * np.sin(angle)) + self._growing
        return self._shapes @ x, self._shapes @ v


def lift_off(form: Form, load: float, rope: Rope, gravity: float) -> float:
    """Largest force of the rope over the weight of a `load` in kg; NaN where the structure does not stand under it."""
    if not form.held or not 0.0 < load < form.critical:
        return np.nan
    M, place = form.condensed.M, form.condensed.place
    K, k, v, weight = form.condensed.K + load * form.condensed.G[1], rope.stiffness, rope.speed, load * gravity
    K, c = (K + K.T) / 2.0, form.against @ place
    n = len(c)
    still, t, q, rate, taut = np.zeros(n), 0.0, np.zeros(n), np.zeros(n), True
    # what the weight takes of the rope, and of the boom under it, with as much again for what swings
    longest = 2.0 * (weight / k + weight * float(c @ np.linalg.solve(K, c))) / v
    for _ in range(MOST):  # a rope may become slack again before it lifts anything
        stiff, pulls = (K + k * np.outer(c, c), -k * v * c) if taut else (K, still)
        phase = _Forced(M, stiff, (still, pulls), (q, rate), t)
        times = t + longest * np.linspace(0.0, 1.0, SAMPLES)[1:]
        pull = k * (phase.along(c, times) + v * times)
        changes = (pull >= weight) | (pull < 0.0) if taut else pull > 0.0
        if not changes.any():
            return np.nan
        t = float(times[np.argmax(changes)])
        q, rate = phase.at(t)
        if taut and pull[np.argmax(changes)] >= weight:
            break
        taut = not taut
    else:
        return np.nan
    rope_of, masses, stiffness = np.append(c, -1.0), scipy.linalg.block_diag(M, load), np.zeros((n + 1, n + 1))
    stiffness[:n, :n] = K
    stiffness += k * np.outer(rope_of, rope_of)
    loads = np.append(still, -weight), -k * v * rope_of
    lifted = _Forced(masses, stiffness, loads, (np.append(q, 0.0), np.append(rate, 0.0)), t)
    times = t + PERIODS * lifted.period * np.linspace(0.0, 1.0, SAMPLES)
    pull = k * (lifted.along(rope_of, times) + v * times)
    slack = int(np.argmax(pull < 0.0)) or len(pull)
    return float(np.max(pull[:slack]) / weight)
