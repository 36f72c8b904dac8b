"""What the compiled loop of `march` reads and changes, as named arrays.

Everything that has an entry for each mode is a row of one table, `State.modes`: so a compiler sees that rows do not
overlap and works on several modes at once.  They are r' long: the bodies' modes one after the other, each body's
rounded up to a whole number of vector registers (`pmr.simulation.native.simd`); what is added is zero and stays zero.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Rows of `State.modes`.  Constants: Omega^2, D, 1 and the first input, divided by S (`pmr.simulation.native.step`).
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


class Memory(NamedTuple):
    """What a force and its share in generalized-alpha's a do in the following step, on a unit mass."""

    gain: float  # next share = gain * next force + a_from_force * force + a_from_share * share
    a_from_force: float  # predicted a; v and z likewise
    a_from_share: float
    v_from_force: float
    v_from_share: float
    z_from_force: float
    z_from_share: float


class Modes(NamedTuple):
    """The modes' equations without contacts: unit mass, i inputs."""

    stiffness: Array  # (r',): Omega^2
    damping: Array  # (1, r'): the diagonal of D, or (r', r') where it couples modes
    B: Array  # (i, r'): transposed


class Divided(NamedTuple):
    """What of these a step needs divided by S = 1 + D dv + Omega^2 dq, for one length of step."""

    B: Array  # (i, r'): S^-1 B, transposed
    damped: Array  # (3, r', r'): S^-1 Omega^2, S^-1 D, S^-1 where damping couples the modes; else (0, 0, 0)


class Tables(NamedTuple):
    """The m rows of one body on one path; polynomials on k intervals, highest power first."""

    breaks: Array  # (k + 1,) m
    rows: Array  # (k, m, p, r'): C
    # (k, m, p', w), for one length of step: dq C S^-1 C^T + G + pads, (m, m), and behind it dq C S^-1 B + H, (m, i)
    couplings: Array
    constant_rows: int  # how many of the first rows never move


class Outputs(NamedTuple):
    """Constants of o outputs of such a body, filled up to o' by those that make whole cache lines; k intervals."""

    of_modes: Array  # (r, o')
    of_rows: Array  # (k, q, o'): X, row after row, highest power first, and W; q = 0 without residual flexibility


class Reach(NamedTuple):
    """Which bodies, contacts and modes have to do with each other: a chain costs no more than its links."""

    # (bodies, 6): of each body the first and behind the last of its modes, of its inputs, and of the contacts on it
    bodies: Indices
    moves: Indices  # (m, 2): the first and behind the last mode that a contact holds
    beside: Indices  # (m, 2): and of the contacts on its bodies, in whole registers: no others share anything with it
    of_mode: Indices  # (r',): the body of each mode
    begins: Indices  # (m,): where the rows of `State.factor` begin; before that it is zero, and never looked at


class Contact(NamedTuple):
    """Rows that only push, among m rows, and which of all rows hold at present."""

    memory: Memory

    pushes: NDArray[np.bool_]  # (m,)
    clearance: Array  # (m,) m; 0 where a row holds both ways
    closed: NDArray[np.bool_]  # (m,): rows that hold; true where they do both ways
    wrong: NDArray[np.bool_]  # (m,): rows that have to change sides
    factored: Indices  # (1,): how many closed rows `State.factor` is of; negative where it is of others
    numbers: Indices  # (m,): those rows, ascending
    excess: Array  # (m,) m: how far the rows would come out beyond their clearance without multipliers
    entries: Array  # (m,): room for one row of a matrix, or a right-hand side
    force: Array  # (m,) N: multipliers at the end of the step before
    share: Array  # (m,) N: and their part in the acceleration-like a
    impulse: Array  # (m,) N s: what they gave since these are counted, as the scheme weighs forces
    calls: Indices  # (1,): the address of `settle` (`pmr.simulation.native.linking`)
    reach: Any = None  # `State.reach`


class State(NamedTuple):
    """What changes; r' modes, m rows."""

    modes: Array  # (11 + max(m, 1), r')
    multipliers: Array  # (m,)
    position: Array  # (1,): s at which the rows of a table stand; NaN before the first step, of a table or not
    interval: Indices  # (1,): likewise
    couplings: Array  # (m, w): `Tables.couplings` where the rows stand; w is m + i, rounded up like r'
    factor: Array  # (m, m): L below the diagonal, 1 / pivots on it, of the Schur complement L diag(pivots) L^T
    weighted: Array  # (m, r'): C / S where they are needed apart
    shares: Array  # (q,): what `Outputs.of_rows` is multiplied by
    # (r',): accelerations S^-1 B f where the inputs move the rows through them alone; (0,) where `couplings` do it
    given: Array
    pushed: Any = None  # (m',) m: H f, how far these inputs move the rows by themselves; None where `couplings` do it
    contact: Contact | None = None  # None, a type of its own to the compiler, where all rows hold both ways
    reach: Any = None  # `Reach`; None where few bodies are taken as if all contacts held all modes


class Drive(NamedTuple):
    """Paths s (., P) and loads f (., i) at `per` equal parts of each step, where the first one begins included.

    What comes behind them is None of a body that is nothing but its tables.
    """

    s: Array
    f: Array
    # (T,): the level of each step (`pmr.simulation.native.levels`), -1 where it is to be found
    given: Any
    c: Any  # (., J): amplitudes of terms, like s and f
    per: int
    peaks: Any  # (T, m) N: largest multipliers within each step that is recorded; (T, 0) where all steps are whole


class Record(NamedTuple):
    """What is recorded of T steps; what is None is not."""

    z: Any  # (T, r) or (T, r')
    v: Any
    multipliers: Array  # (T, m) N
    peaks: Any = None  # (T, m) N: largest within the step, where it may be made in parts: `Drive.peaks`
    parts: Any = None  # (T,): of how many
    impulses: Any = None  # (T, m) N s: given in the step, where contacts only push
    energy: Any = None  # (T, 2) J: what is stored, and the work since the start
    given: Any = None  # (T,) J: the work of terms since the start
    friction: Any = None  # (T, n) N: of the pads that rub
