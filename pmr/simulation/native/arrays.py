"""What the compiled loop of `march` reads and changes, as named arrays.

Everything that has an entry for each mode is a row of one table, `State.modes`: so a compiler sees that rows do not
overlap and works on several modes at once.  They are r' long, the number of modes r rounded up to a whole number of
vector registers (`pmr.simulation.native.simd`); what is added is zero and stays zero.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Rows of `State.modes`.  Constants: Omega^2, D, 1 and the first input, all divided by S
#: (`pmr.simulation.native.step`).
STIFFNESS, DAMPING, UNIT, INPUT = range(4)
#: The predicted state with which the next step begins; the displacement it leads to without multipliers and loads.
Z_NEXT, V_NEXT, A_NEXT, Z_FREE = range(4, 8)
#: Accelerations that further inputs and rows, and damping that couples modes, add; the state at the end of the step.
OTHERS, Z, V = range(8, 11)
#: Entries of the first of the m rows (at least one, zero if there is none); the others follow.
ROW = 11


class Scheme(NamedTuple):
    """Generalized-alpha with one step size: what the acceleration of a step adds, and the prediction of the next."""

    z_gain: float  # dq: displacement that a unit of acceleration adds within the step
    v_gain: float  # dv
    z_from_v: float  # next z = predicted z + z_from_v predicted v + z_from_a predicted a + z_from_acceleration * it
    z_from_a: float
    z_from_acceleration: float
    v_from_a: float  # next v = predicted v + v_from_a predicted a + v_from_acceleration acceleration
    v_from_acceleration: float
    a_from_a: float  # next a = a_from_a predicted a + a_from_acceleration acceleration
    a_from_acceleration: float


class System(NamedTuple):
    """Constants of a body with r modes, m rows and i inputs; polynomials on k intervals, highest power first."""

    breaks: Array  # (k + 1,) m
    rows: Array  # (k, m, p, r'): C
    couplings: Array  # (k, m, p', w): dq C S^-1 C^T + G + pads, (m, m), and behind it dq C S^-1 B + H, (m, i)
    B: Array  # (i, r'): S^-1 B, transposed
    damped: Array  # (3, r, r'): S^-1 Omega^2, S^-1 D, S^-1 where damping couples the modes; else (0, 0, 0)
    constant_rows: int  # how many of the first rows never move


class Outputs(NamedTuple):
    """Constants of o outputs, filled up to o' by those that make whole cache lines; k intervals."""

    of_modes: Array  # (r, o')
    of_rows: Array  # (k, q, o'): X, row after row, highest power first, and W; q = 0 without residual flexibility


class Memory(NamedTuple):
    """What a force and its share in generalized-alpha's a do in the following step, on a unit mass."""

    gain: float  # next share = gain * next force + a_from_force * force + a_from_share * share
    a_from_force: float  # predicted a; v and z likewise
    a_from_share: float
    v_from_force: float
    v_from_share: float
    z_from_force: float
    z_from_share: float


class Contact(NamedTuple):
    """Rows that only push, among m rows, and which of all rows hold at present."""

    memory: Memory

    pushes: NDArray[np.bool_]  # (m,)
    clearance: Array  # (m,) m; 0 where a row holds both ways
    closed: NDArray[np.bool_]  # (m,): rows that hold; true where they do both ways
    wrong: NDArray[np.bool_]  # (m,): rows that have to change sides
    factored: NDArray[np.int64]  # (1,): how many closed rows `State.factor` is of; negative where it is of others
    numbers: NDArray[np.int64]  # (m,): those rows, ascending
    excess: Array  # (m,) m: how far the rows would come out beyond their clearance without multipliers
    entries: Array  # (m,): room for one row of a matrix, or a right-hand side
    force: Array  # (m,) N: multipliers at the end of the step before
    share: Array  # (m,) N: and their part in the acceleration-like a
    impulse: Array  # (m,) N s: what they gave since these are counted, as the scheme weighs forces


class State(NamedTuple):
    """What changes; r modes, m rows."""

    modes: Array  # (11 + max(m, 1), r')
    multipliers: Array  # (m,)
    position: Array  # (1,): s at which the rows stand; NaN before the first step
    interval: NDArray[np.int64]  # (1,)
    couplings: Array  # (m, w): `System.couplings` at s; w is m + i, rounded up like r'
    factor: Array  # (m, m): L below the diagonal, 1 / pivots on it, of the Schur complement L diag(pivots) L^T
    weighted: Array  # (m, r'): C / S where damping couples the modes; else (0, r')
    shares: Array  # (q,): what `Outputs.of_rows` is multiplied by
    contact: Contact | None = None  # None, a type of its own to the compiler, where all rows hold both ways
