"""A system of bodies and a time step as the arrays that the compiled loop reads.

The bodies' modes stand one after the other in rows as long as `State.modes` has them, each body's filled up with zeros
to whole vector registers.  What the rows of all bodies need is laid out flat: breaks, coefficients and touched carriers
one row after the other, each row at its own offset.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import ROW, Memory, State
from pmr.simulation.native.contact import contact
from pmr.simulation.native.multibody_form import MultibodyForm, starts
from pmr.simulation.native.simd import LANES
from pmr.simulation.native.system import aligned
from pmr.system.system import System

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Polynomials(NamedTuple):
    """Rows b(x) on carriers, with their signs, one for each side of a contact that travels."""

    contact: Indices  # (q,)
    body: Indices  # (q,)
    path: Indices  # (q,)
    at: Array  # (q,) m: x = at + rate s
    rate: Array  # (q,)
    breaks: Array
    first_break: Indices  # (q,); the next entry of the flat array belongs to another row from `intervals` + 1 on
    intervals: Indices  # (q,)
    coefficients: Array  # [interval, entry, power], lowest power first, as many as `Sides.powers` has
    first_coefficient: Indices
    touched: Indices  # [interval, entry]: numbers of the body's carriers
    first_touched: Indices
    width: Indices


class Bodies(NamedTuple):
    """Constants of bodies with r' modes, K carriers and i inputs in all, and of m contacts; m' as r'."""

    B: Array  # (i, r'): S^-1 B, transposed, of the present step's length
    damped: Array  # (3, r', r') as `System.damped`, likewise, or (0, 0, 0)
    values: Array  # (K, r'): what the modes measure on the carriers
    inputs: Array  # (K, i) m/N: U R B
    energy: Array  # (i, i) m/N: B^T R B
    plain_inputs: Array  # (i, r'): B, transposed
    stiffness: Array  # (r',): Omega^2
    damping: Array  # (1, r'): the diagonal of D, or (r', r') where it couples modes
    flexibility: Array  # all U R U^T in m/N, flat, one body after the other; nothing of a body without
    first_flexibility: Indices  # (bodies + 1,)
    carriers: Indices  # (bodies + 1,): where each body's begin
    modes: Indices  # (bodies + 1,): likewise, in whole vector registers
    compliance: Array  # (m,) m/N
    moves: Indices  # (m, 2): the first and behind the last mode that a contact holds
    staying: Array  # (m, r'): rows of the sides that stay where they are
    staying_inputs: Array  # (m, i) m/N: H of these
    staying_half: Array  # (m, m') m/N: half of G between these
    staying_answers: Array  # (K, m') m/N: U R b^T of these
    rows: Polynomials


class Sides(NamedTuple):
    """What changes with the places of the q sides that travel, and what the step before left.

    Between two breaks all that a side measures is a polynomial of p' powers, whose coefficients are kept: with the
    modes, with the sides that stay, and with every other one that travels on the same body.
    """

    s: Array  # (P,) m: where the paths lead; NaN before the first step
    interval: Indices  # (q,); -1 before the first step
    entered: NDArray[np.bool_]  # (q,): whether the last move led into another one
    moved: NDArray[np.bool_]  # (1,): whether the contacts' rows have changed since `account` was last called
    powers: Array  # (q, p'): 1, d, d^2, ... of the distance d into the interval
    of_modes: Array  # (q, p', r')
    of_inputs: Array  # (q, p', i)
    of_staying: Array  # (q, p', m')
    of_others: Array  # (q, q, p', p'), the lower half
    room: Array  # (d, p')
    half: Array  # (m, m') m/N: N of G = N + N^T
    inputs: Array  # (m, i) m/N: H
    old_rows: Array  # (m, r')
    old_half: Array
    old_inputs: Array
    old_z: Array  # (r',)
    old_multipliers: Array  # (m,)
    old_loads: Array  # (i,)
    energy: Array  # (2,) J: what is stored, and the work done since the start


def bodies(form: MultibodyForm, paths: Sequence[str]) -> Bodies:
    """Constants of a system that travels on `paths`, by their names; those of a step are zero."""
    system, K, i = form.system, int(form.carriers[-1]), int(form.inputs[-1])
    values, inputs, energy = np.zeros((K, form.modes[-1])), np.zeros((K, i)), np.zeros((i, i))
    flexibility = []
    for k, (carried, columns) in enumerate(zip(form.carried, form.columns, strict=True)):
        rows, own = slice(form.carriers[k], form.carriers[k + 1]), slice(form.inputs[k], form.inputs[k + 1])
        values[rows, columns] = carried.values
        left = carried.flexibility
        flexibility.append(np.zeros((0, 0)) if left is None else left.rows)
        if left is not None:
            inputs[rows, own], energy[own, own] = left.inputs, left.energy
    m, names = len(system.contacts), list(system.bodies)
    staying, answers, moves = np.zeros((m, K)), np.zeros((K, m + -m % LANES)), np.zeros((m, 2), np.int64)
    for k in range(m):
        on = [names.index(side.place.body) for side in system.sides if side.contact == k]
        moves[k] = form.modes[min(on)], form.modes[max(on) + 1]
    for side in system.sides:
        if side.place.path is None:
            first = form.carriers[names.index(side.place.body)]
            b = side.sign * system.row(side.place).weights(side.place.at).toarray()[0]
            staying[side.contact, first : first + len(b)] += b
    for first, last, R in zip(form.carriers, form.carriers[1:], flexibility, strict=False):
        if len(R):
            answers[first:last, :m] = R @ staying[:, first:last].T
    r = int(form.modes[-1])
    return Bodies(
        B=aligned(np.zeros((i, r))),
        damped=aligned(np.zeros((0, 0, 0) if form.classically_damped else (3, r, r))),
        values=aligned(values),
        inputs=inputs,
        energy=energy,
        plain_inputs=aligned(form.B.T),
        stiffness=aligned(form.along("K")),
        damping=aligned(form.along("D")[None] if form.classically_damped else form.damping),
        flexibility=np.concatenate([np.empty(0), *(R.ravel() for R in flexibility)]),
        first_flexibility=starts([R.size for R in flexibility]),
        carriers=form.carriers,
        modes=form.modes,
        compliance=system.compliance,
        moves=moves,
        staying=aligned(staying @ values),
        staying_inputs=staying @ inputs,
        staying_half=aligned(staying @ answers / 2.0),
        staying_answers=aligned(answers),
        rows=_polynomials(form.system, paths),
    )


def multibody_state(form: MultibodyForm, constants: Bodies, memory: Memory) -> State:
    """At rest, before the contacts' rows are evaluated and the constants of a step are known."""
    m, (i, r) = len(constants.compliance), constants.B.shape
    return State(
        modes=aligned(np.zeros((ROW + max(m, 1), r))),
        multipliers=np.zeros(m),
        position=np.full(1, np.nan),
        interval=np.zeros(1, np.int64),
        couplings=np.zeros((m, m + i)),
        factor=np.zeros((m, m)),
        weighted=aligned(np.zeros((m, r))),
        shares=np.zeros(0),
        contact=contact(form.system.clearance, memory),
    )


def sides(constants: Bodies, paths: int) -> Sides:
    """Before the first step."""
    (m, wide), (i, r) = constants.staying_half.shape, constants.B.shape
    q, width = len(constants.rows.body), int(constants.rows.width.max(initial=1))
    p = constants.rows.coefficients.shape[1]
    return Sides(
        s=np.full(paths, np.nan),
        interval=np.full(q, -1),
        entered=np.zeros(q, np.bool_),
        moved=np.zeros(1, np.bool_),
        powers=aligned(np.zeros((q, p))),
        of_modes=aligned(np.zeros((q, p, r))),
        of_inputs=np.zeros((q, p, i)),
        of_staying=aligned(np.zeros((q, p, wide))),
        of_others=aligned(np.zeros((q, q, p, p))),
        room=aligned(np.zeros((width, p))),
        half=aligned(np.zeros((m, wide))),
        inputs=np.zeros((m, i)),
        old_rows=aligned(np.zeros((m, r))),
        old_half=aligned(np.zeros((m, wide))),
        old_inputs=np.zeros((m, i)),
        old_z=aligned(np.zeros(r)),
        old_multipliers=np.zeros(m),
        old_loads=np.zeros(i),
        energy=np.zeros(2),
    )


def _polynomials(system: System, paths: Sequence[str]) -> Polynomials:
    sides, names = [side for side in system.sides if side.place.path is not None], list(system.bodies)
    rows = [system.row(side.place) for side in sides]
    powers = max((len(row.coefficients) for row in rows), default=1)
    c = []
    for row, side in zip(rows, sides, strict=True):
        wide = np.zeros((*row.touched.shape, powers + -powers % LANES))  # interval, entry, power
        wide[:, :, : len(row.coefficients)] = side.sign * row.coefficients[::-1].transpose(1, 2, 0)
        c.append(wide.reshape(-1, wide.shape[2]))
    return Polynomials(
        contact=np.array([side.contact for side in sides], np.int64),
        body=np.array([names.index(side.place.body) for side in sides], np.int64),
        path=np.array([paths.index(str(side.place.path)) for side in sides], np.int64),
        at=np.array([side.place.at for side in sides], float),
        rate=np.array([side.place.rate for side in sides], float),
        breaks=np.concatenate([np.empty(0), *(row.breaks for row in rows)]),
        first_break=starts([len(row.breaks) for row in rows])[:-1],
        intervals=np.array([len(row.breaks) - 1 for row in rows], np.int64),
        coefficients=aligned(np.concatenate([np.empty((0, powers + -powers % LANES)), *c])),
        first_coefficient=starts([len(one) for one in c])[:-1],
        touched=np.concatenate([np.empty(0, np.int64), *(row.touched.ravel() for row in rows)]),
        first_touched=starts([row.touched.size for row in rows])[:-1],
        width=np.array([row.touched.shape[1] for row in rows], np.int64),
    )
