r"""How a structure swings under its load: when the load is hoisted off the ground, and when a turning motion stops.

First, a load that is hoisted off the ground at a constant speed: by how much the force of its rope exceeds its weight.
The load has the mass m and the height y, the rope the stiffness k and the speed v; M and K are mass matrix and
stiffness of the boom on its coordinates q, and u = c q is the upward displacement of its tip.  The rope becomes taut at
t = 0 and pulls with

.. math::
    F = k\, (c\, q - y + v\, t), \qquad M \ddot q + K q = -c^T F, \qquad m\, \ddot y = F - m g

with the acceleration g of gravity.  The load stays on the ground, y = 0, until F reaches m g; a slack rope has no
force.  Each phase is solved in closed form, mode by mode, without damping, up to two periods after the load leaves the
ground.  On a rigid tip :math:`F_{max} / m g = 1 + v \sqrt{k / m} / g`.

Second, a boom that stops turning: how it swings during a constant deceleration, and afterwards.

The loads b on the boom are those of a unit of the deceleration, which lasts from 0 to T.  The load m is a mass that
moves with the tip along the rope; G_0 and G_1 are the geometric stiffness of the fixed loads and of 1 kg of the load.
Then

.. math::
    (M + m c^T c)\, \ddot q + (K + G_0 + m\, G_1)\, q = b\, a(t), \qquad a = 1 \text{ up to } T,\ 0 \text{ after}

is solved in closed form, mode by mode, without damping.  Outputs and contact forces, also of rigid contacts, are those
at rest under the loads minus inertia, :math:`b\, a - (M + m c^T c)\, \ddot q`.  Contacts stay closed or open.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg

from pmr.files.arrays import Array
from pmr.simulation.statics.equilibrium import BorderedMatrix
from pmr.simulation.statics.loaded import Form, LoadEffects

#: Number of periods of the lowest frequency after the load leaves the ground, and number of times in these.
PERIODS, SAMPLES = 2.0, 4000
#: Most changes between a slack and a taut rope before it lifts the load.
MOST = 100


@dataclass(frozen=True)
class Rope:
    """Hoisting rope."""

    stiffness: float  # N/m
    speed: float  # m/s


class _ForcedMotion:
    """Solution of M x'' + K x = f_0 + t f_1 in modes, from the time `since` in s on.

    `start` are x and x' at that time, and `f` is (f_0, f_1).  Modes are scaled to a unit stiffness.  This allows modes
    without inertia, which follow the loads at once.
    """

    def __init__(self, M: Array, K: Array, f: tuple[Array, Array], start: tuple[Array, Array], since: float) -> None:
        """Compute modes of M (n, n) and K (n, n), and the motion's start in these.

        `f` has f_0 and f_1 (n,), `start` x and x' (n,) at the time `since` in s.
        """
        inertia, self._shapes = scipy.linalg.eigh(M, K)
        some = inertia > len(K) * np.finfo(float).eps * inertia[-1]
        self._w = np.where(some, 1.0 / np.sqrt(np.where(some, inertia, 1.0)), 0.0)
        self._constant, self._growing = (self._shapes.T @ vector for vector in f)
        q, v = (self._shapes.T @ (K @ vector) for vector in start)
        self._amplitude = np.where(some, q - self._constant - self._growing * since, 0.0)
        self._rate = np.where(some, (v - self._growing) / np.where(some, self._w, 1.0), 0.0)
        self._since = since
        self.period = 2.0 * np.pi * float(np.sqrt(inertia[-1]))

    def values(self, row: Array, t: Array) -> Array:
        """Scalar products (T,) of a `row` (n,) and x at the times t (T,) in s."""
        of, angle = row @ self._shapes, self._w * (t[:, None] - self._since)
        free = np.cos(angle) @ (of * self._amplitude) + np.sin(angle) @ (of * self._rate)
        return np.asarray(free + of @ self._constant + t * (of @ self._growing))

    def state(self, t: float) -> Array:
        """Displacements x and rates x' (2, n) at a time t in s."""
        angle = self._w * (t - self._since)
        x = self._amplitude * np.cos(angle) + self._rate * np.sin(angle) + self._constant + self._growing * t
        v = self._w * (self._rate * np.cos(angle) - self._amplitude * np.sin(angle)) + self._growing
        return np.array([self._shapes @ x, self._shapes @ v])


def lift_off(form: Form, load: float, rope: Rope, gravity: float) -> float:
    """Largest force of the rope while it hoists a `load` in kg off the ground, divided by the weight of the load.

    `gravity` is in m/s^2.  The result is NaN if no equilibrium exists under the load, if the load is 0, or if the rope
    does not lift the load.  `form` is the structure with its closed contacts.
    """
    if not form.held or not 0.0 < load < form.critical:
        return np.nan
    M, place = form.condensed.M, form.condensed.load_position
    K, k, v, weight = form.condensed.K + load * form.condensed.G[1], rope.stiffness, rope.speed, load * gravity
    K, c = (K + K.T) / 2.0, form.lifting_direction @ place
    n = len(c)
    still, t, q, rate, taut = np.zeros(n), 0.0, np.zeros(n), np.zeros(n), True
    # twice the time in which the rope's speed makes up for the deflections of rope and boom under the weight
    longest = 2.0 * (weight / k + weight * float(c @ np.linalg.solve(K, c))) / v
    for _ in range(MOST):  # a rope may become slack again before it lifts anything
        stiff, pulls = (K + k * np.outer(c, c), -k * v * c) if taut else (K, still)
        phase = _ForcedMotion(M, stiff, (still, pulls), (q, rate), t)
        times = t + longest * np.linspace(0.0, 1.0, SAMPLES)[1:]
        pull = k * (phase.values(c, times) + v * times)
        changes = (pull >= weight) | (pull < 0.0) if taut else pull > 0.0
        if not changes.any():
            return np.nan
        t = float(times[np.argmax(changes)])
        q, rate = phase.state(t)
        if taut and pull[np.argmax(changes)] >= weight:
            break
        taut = not taut
    else:
        return np.nan
    rope_of, masses, stiffness = np.append(c, -1.0), scipy.linalg.block_diag(M, load), np.zeros((n + 1, n + 1))
    stiffness[:n, :n] = K
    stiffness += k * np.outer(rope_of, rope_of)
    loads = np.append(still, -weight), -k * v * rope_of
    lifted = _ForcedMotion(masses, stiffness, loads, (np.append(q, 0.0), np.append(rate, 0.0)), t)
    times = t + PERIODS * lifted.period * np.linspace(0.0, 1.0, SAMPLES)
    pull = k * (lifted.values(rope_of, times) + v * times)
    slack = int(np.argmax(pull < 0.0)) or len(pull)
    return float(np.max(pull[:slack]) / weight)


#: Periods of the lowest frequency evaluated after the start of the stop and after its end, and times in each.
STOP_PERIODS, STOP_SAMPLES = 2.0, 300


class StaticResponse(NamedTuple):
    """Outputs (o, k) and contact forces (m, k) at rest under k load cases."""

    outputs: Array
    forces: Array


@dataclass(frozen=True)
class Swing:
    """Response to a unit of the deceleration: outputs (T, o) and contact forces (T, m) at times t (T,) in s.

    The response to the loads at rest is not included.  `steady` is the response to a deceleration that lasts.
    """

    t: Array
    outputs: Array
    forces: Array
    steady: StaticResponse  # outputs (o,) and contact forces (m,)


def stopping_swing(form: Form, load: float, acting: LoadEffects, duration: float) -> Swing | None:
    """Swing of a structure under a `load` in kg that is decelerated for `duration` s.

    The result holds histories of outputs and contact forces, during the deceleration and after it.  They are for a unit
    of the deceleration, and do not include the response to the loads at rest.  `form` is the structure with its closed
    contacts, and `acting` are the effects of a unit of the deceleration.  The result is None if no equilibrium exists
    under the load.
    """
    if not form.held or not 0.0 <= load < form.critical:
        return None
    e, on, closed = form.equations, form.condensed, form.closed
    hook, c = float(np.linalg.norm(form.pull)), -form.lifting_direction @ on.load_position  # along the pull
    K = on.K + load * on.G[1]
    inertia, shapes = scipy.linalg.eigh(on.M + load * np.outer(c, c), (K + K.T) / 2.0)
    moving = inertia > len(K) * np.finfo(float).eps * inertia[-1]
    inertia, shapes = inertia[moving], shapes[:, moving]
    amplitude = shapes.T @ (on.coordinates.T @ acting.b + on.gap_forces @ acting.g[closed])
    # inertia of a unit acceleration of each mode: on coordinates, and along the rope
    along = load * (c @ shapes) / hook
    resisting = [
        e.M @ (on.coordinates @ shapes) + np.outer(e.growing.b, along),
        np.outer(e.growing.g, along),
        np.outer(e.growing.direct, along),
    ]
    each = zip((acting.b, acting.g, acting.direct), resisting, strict=True)
    outputs, forces = _static_response(form, load, [np.column_stack(pair) for pair in each])
    omega = 1.0 / np.sqrt(inertia)
    looked = STOP_PERIODS * 2.0 * np.pi / float(omega.min())  # as many samples of a long stop as its peaks need
    t = np.append(
        np.linspace(0.0, min(duration, looked), STOP_SAMPLES), duration + np.linspace(0.0, looked, STOP_SAMPLES)
    )
    lasts, after = t <= duration, np.maximum(t - duration, 0.0)
    accelerations = np.cos(np.outer(t, omega)) - np.where(lasts[:, None], 0.0, np.cos(np.outer(after, omega)))
    shares = np.column_stack([lasts, -accelerations * (amplitude * omega**2)])
    return Swing(t, shares @ outputs.T, shares @ forces.T, StaticResponse(outputs[:, 0], forces[:, 0]))


def _static_response(form: Form, load: float, loads: list[Array]) -> StaticResponse:
    """Response at rest of `form` to k load cases.

    `loads` are forces on coordinates (n, k), gaps (m, k) and direct outputs (o, k); `load` in kg sets the geometric
    stiffness.
    """
    e, closed = form.equations, form.closed
    rows, K = e.rows.select(closed), e.K + e.fixed.G + load * e.growing.G
    n, solution = len(K), BorderedMatrix(K, rows.C, rows.F).solve(np.vstack([loads[0], loads[1][closed]]))
    forces = np.zeros((len(closed), solution.shape[1]))
    forces[closed] = solution[n:]
    outputs = e.outputs @ solution[:n] - e.rows.X @ forces + loads[2]
    if len(e.growing.outputs):
        outputs[-len(e.growing.outputs) :] += load * (e.growing.outputs @ solution[:n])
    return StaticResponse(outputs, forces)
