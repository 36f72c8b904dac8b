r"""A boom whose turning stops: how it swings while its rate falls steadily to nothing, and afterwards.

With loads b of a unit of the deceleration, which lasts from 0 to T, on the boom under its load m, which moves with the
tip along the rope,

.. math::
    (M + m c^T c)\, \ddot q + (K + G_0 + m\, G_1)\, q = b\, a(t), \qquad a = 1 \text{ up to } T,\ 0 \text{ after}

is solved in closed form, mode by mode, without damping.  Outputs and forces of contacts, rigid ones too, are those at
rest under what is left of the loads by what accelerates: :math:`b\, a - (M + m c^T c)\, \ddot q`.  Contacts stay closed
or open as they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.simulation.statics.loaded import Form

Array = NDArray[np.float64]

#: Periods of the lowest frequency that are looked at, from the start of the stop and from its end, and times in each.
PERIODS, SAMPLES = 2.0, 300


@dataclass(frozen=True)
class Acting:
    """Loads on coordinates (n,), what they move at contacts (m,) and at outputs (o,) by themselves."""

    b: Array
    g: Array
    direct: Array


@dataclass(frozen=True)
class Swing:
    """By a unit of the deceleration, beside what is there at rest: outputs (T, o) and forces (T, m) at times (T,) s."""

    t: Array
    outputs: Array
    forces: Array
    steady: tuple[Array, Array]  # (o,) and (m,): where the deceleration has lasted for long


def stopping_swing(form: Form, load: float, acting: Acting, duration: float) -> Swing | None:
    """How a structure swings under a `load` in kg; None where it does not stand under it."""
    if not form.held or not 0.0 <= load < form.critical:
        return None
    e, on, closed = form.equations, form.condensed, form.closed
    pull = np.linalg.lstsq(e.on[0], e.b[1], rcond=None)[0]
    hook, c = float(np.linalg.norm(pull)), -form.against @ on.place  # along the pull
    K = on.K + load * on.G[1]
    inertia, shapes = scipy.linalg.eigh(on.M + load * np.outer(c, c), (K + K.T) / 2.0)
    moving = inertia > len(K) * np.finfo(float).eps * inertia[-1]
    inertia, shapes = inertia[moving], shapes[:, moving]
    amplitude = shapes.T @ (on.own.T @ acting.b + on.gaps @ acting.g[closed])
    # what a unit of each mode's acceleration resists with: on coordinates, and along the rope
    along = load * (c @ shapes) / hook
    resisting = [
        e.M @ (on.own @ shapes) + np.outer(e.b[1], along),
        np.outer(e.g[1], along),
        np.outer(e.direct[1], along),
    ]
    each = zip((acting.b, acting.g, acting.direct), resisting, strict=True)
    outputs, forces = _at_rest(form, load, [np.column_stack(pair) for pair in each])
    omega = 1.0 / np.sqrt(inertia)
    looked = PERIODS * 2.0 * np.pi / float(omega.min())  # however long the stop lasts: else its samples miss the peaks
    t = np.append(np.linspace(0.0, min(duration, looked), SAMPLES), duration + np.linspace(0.0, looked, SAMPLES))
    lasts, after = t <= duration, np.maximum(t - duration, 0.0)
    accelerations = np.cos(np.outer(t, omega)) - np.where(lasts[:, None], 0.0, np.cos(np.outer(after, omega)))
    shares = np.column_stack([lasts, -accelerations * (amplitude * omega**2)])
    return Swing(t, shares @ outputs.T, shares @ forces.T, (outputs[:, 0], forces[:, 0]))


def _at_rest(form: Form, load: float, loads: list[Array]) -> tuple[Array, Array]:
    """Outputs (o, k) and forces (m, k) under loads (n, k), gaps (m, k) and direct outputs (o, k)."""
    e, closed = form.equations, form.closed
    C, F, K = e.C[closed], e.F[np.ix_(closed, closed)], e.K + e.G[0] + load * e.G[1]
    n, scale = len(K), float(np.abs(K).max()) or 1.0
    units = np.concatenate([np.ones(n), np.full(len(C), scale)])[:, None]
    matrix = np.block([[K, scale * C.T], [scale * C, -(scale**2) * F]])
    solution = units * np.linalg.solve(matrix, units * np.vstack([loads[0], loads[1][closed]]))
    forces = np.zeros((len(closed), solution.shape[1]))
    forces[closed] = solution[n:]
    outputs = e.outputs @ solution[:n] - e.X @ forces + loads[2]
    if len(e.by_load):
        outputs[-len(e.by_load) :] += load * (e.by_load @ solution[:n])
    return outputs, forces
