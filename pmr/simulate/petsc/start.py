r"""State of the full model at t = 0: velocities, accelerations and multipliers, as march and Exudyn find them.

.. math::
    \lambda_y = k\, C_y q_0, \qquad
    \begin{bmatrix} M & C_r^T \\ C_r & 0 \end{bmatrix} \begin{bmatrix} \ddot q_0 \\ \lambda_r \end{bmatrix}
    = \begin{bmatrix} B f - D v_0 - K q_0 - C_y^T \lambda_y \\ 0 \end{bmatrix}

with the rows that give way (y) and the rigid ones (r), whose own motion is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.fem.factor import Factor, product
from pmr.fem.matrices import local_csr
from pmr.fullmodel.model import FullModel
from pmr.simulate.start import InitialState, check_impulse, check_position, checked, row_drift

Array = NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """This rank's rows (n_local,) of position, velocity, acceleration-like variable and acceleration; lambda (m,)."""

    q: Array
    v: Array
    a: Array
    acceleration: Array
    multipliers: Array


def starting_state(model: FullModel, s: float, s_rate: float, f: Array, initial: InitialState | None) -> State:
    """State at the path coordinate s (m) that moves at s_rate (m/s) under the loads f (i,); collective.

    Raises
    ------
    InputError
        If the initial position violates a rigid row, a size is wrong, rows depend on each other or M is not positive
        definite.
    """
    first, last = model.M.getOwnershipRange()
    start = InitialState.at_rest(model.size) if initial is None else checked(initial, model.size)
    q, v = start.q[first:last].copy(), start.v[first:last].copy()
    multipliers = np.zeros(len(model.rows.rows))
    load = local_csr(model.inputs) @ f
    if not model.comm.allreduce(int(np.any(start.q) or np.any(start.v) or np.any(load))):
        return State(q, v, np.zeros_like(q), np.zeros_like(q), multipliers)
    C, soft = model.rows.at(s), model.rows.compliance > 0.0
    multipliers[soft] = (C @ start.q)[soft] / model.rows.compliance[soft]
    held = _Held(model, s)
    v -= held.impulse(s_rate, start)
    force = load - product(model.D, v) - product(model.K, q) - C[:, first:last].T @ multipliers
    acceleration, multipliers[~soft] = held.acceleration(force)
    return State(q, v, acceleration.copy(), acceleration, multipliers)


class _Held:
    """M with the rigid rows at one path coordinate."""

    def __init__(self, model: FullModel, s: float) -> None:
        rigid = model.rows.compliance == 0.0
        self._comm, self._share = model.comm, slice(*model.M.getOwnershipRange())
        self._names = tuple(name for name, stiff in zip(model.rows.names, rigid, strict=True) if stiff)
        self._C, self._C_s = (model.rows.at(s, derivative)[rigid].toarray() for derivative in (0, 1))
        self._mine = self._C[:, self._share]
        self._factor = Factor(model.M, "M")
        self._answers = self._factor.solve_columns(np.ascontiguousarray(self._mine.T))  # M^-1 C^T
        self._G = self._comm.allreduce(self._mine @ self._answers)

    def impulse(self, s_rate: float, start: InitialState) -> Array:
        """This rank's rows of what a velocity has too much, of least kinetic energy."""
        check_position(self._C, start.q, self._names)
        drift = row_drift(self._C, self._C_s, s_rate, start)
        if drift is None:
            return np.zeros(len(self._answers))
        impulse = np.linalg.lstsq(self._G, drift, rcond=None)[0]
        check_impulse(self._G @ impulse, drift, self._names)
        return np.asarray(self._answers @ impulse)

    def acceleration(self, force: Array) -> tuple[Array, Array]:
        """This rank's rows of the acceleration under a force given likewise, and the rows' multipliers."""
        free = self._factor.solve_columns(force[:, None])[:, 0]
        multipliers = np.linalg.lstsq(self._G, self._comm.allreduce(self._mine @ free), rcond=None)[0]
        self._factor.destroy()
        return free - self._answers @ multipliers, multipliers
