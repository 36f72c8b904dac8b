"""A system of bodies and a time step as the arrays that the compiled loop reads.

The bodies' modes stand one after the other in rows as long as `State.modes` has them, each body's filled up with zeros
to whole vector registers.  What the rows of all bodies need is laid out flat: breaks, coefficients and touched carriers
one row after the other, each row at its own offset.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.simulate.native.arrays import DAMPING, INPUT, ROW, STIFFNESS, UNIT, Memory, Scheme, State
from pmr.simulate.native.contact import contact
from pmr.simulate.native.multibody_form import MultibodyForm, starts
from pmr.simulate.native.system import aligned, divided
from pmr.system.system import System

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Polynomials(NamedTuple):
    """Rows b(x) on carriers, one for each side of a contact: powers p, width d."""

    breaks: Array
    first_break: Indices  # (q,); the next entry of the flat array belongs to another row from `intervals` + 1 on
    intervals: Indices  # (q,)
    coefficients: Array  # [interval, entry, power], highest power first
    first_coefficient: Indices
    powers: Indices
    touched: Indices  # [interval, entry]: numbers of the body's carriers
    first_touched: Indices
    width: Indices


class Bodies(NamedTuple):
    """Constants of bodies with r' modes, K carriers and i inputs in all, and of m contacts with q sides."""

    B: Array  # (i, r'): S^-1 B, transposed
    damped: Array  # (3, r', r') as `System.damped`, or (0, 0, 0)
    values: Array  # (K, r'): what the modes measure on the carriers
    inputs: Array  # (K, i) m/N: U R B
    energy: Array  # (i, i) m/N: B^T R B
    plain_inputs: Array  # (i, r'): B, transposed
    stiffness: Array  # (r',): Omega^2
    flexibility: Array  # all U R U^T in m/N, flat, one body after the other
    first_flexibility: Indices  # (bodies,)
    carriers: Indices  # (bodies + 1,): where each body's begin
    modes: Indices  # (bodies + 1,): likewise, in whole vector registers
    contact: Indices  # (q,)
    body: Indices  # (q,)
    sign: Array  # (q,)
    compliance: Array  # (m,) m/N
    rows: Polynomials


class Sides(NamedTuple):
    """What changes with the places x (q,) of a system's contacts, and what the step before left."""

    x: Array  # (q,) m; NaN before the first step
    interval: Indices  # (q,)
    weights: Array  # (q, d): b(x) times the side's sign
    numbers: Indices  # (q, d): carriers, among those of all bodies
    flexibility: Array  # (m, m) m/N: G
    inputs: Array  # (m, i) m/N: H
    old_rows: Array  # (m, r')
    old_flexibility: Array
    old_inputs: Array
    old_z: Array  # (r',)
    old_multipliers: Array  # (m,)
    old_loads: Array  # (i,)
    energy: Array  # (2,) J: what is stored, and the work done since the start


def bodies(form: MultibodyForm, scheme: Scheme) -> Bodies:
    """Constants of a system under a time step."""
    system, K, i = form.system, int(form.carriers[-1]), int(form.inputs[-1])
    values, inputs, energy = np.zeros((K, form.modes[-1])), np.zeros((K, i)), np.zeros((i, i))
    flexibility = []
    for k, (carried, columns) in enumerate(zip(form.carried, form.columns, strict=True)):
        rows, own = slice(form.carriers[k], form.carriers[k + 1]), slice(form.inputs[k], form.inputs[k + 1])
        values[rows, columns] = carried.values
        left = carried.flexibility
        flexibility.append(np.zeros(len(carried.values) ** 2) if left is None else left.rows.ravel())
        if left is not None:
            inputs[rows, own], energy[own, own] = left.inputs, left.energy
    D, omega2 = form.damping, form.along("K")
    damped = np.zeros((0, 0, 0))
    if not form.classically_damped:
        damped = np.stack([divided(A, omega2, D, scheme).T for A in (np.diag(omega2), D, np.eye(len(D)))])
    names, sides = list(system.bodies), system.sides
    return Bodies(
        B=aligned(divided(form.B.T, omega2, D, scheme)),
        damped=aligned(damped),
        values=aligned(values),
        inputs=inputs,
        energy=energy,
        plain_inputs=aligned(form.B.T),
        stiffness=aligned(omega2),
        flexibility=np.concatenate([np.empty(0), *flexibility]),
        first_flexibility=starts([len(one) for one in flexibility])[:-1],
        carriers=form.carriers,
        modes=form.modes,
        contact=np.array([side.contact for side in sides], np.int64),
        body=np.array([names.index(side.place.body) for side in sides], np.int64),
        sign=np.array([side.sign for side in sides], float),
        compliance=system.compliance,
        rows=_polynomials(system),
    )


def multibody_state(form: MultibodyForm, scheme: Scheme, constants: Bodies, memory: Memory) -> State:
    """At rest, before the contacts' rows are evaluated."""
    m, (i, r) = len(constants.compliance), constants.B.shape
    modes = np.zeros((ROW + max(m, 1), r))
    if i > 0:
        modes[INPUT] = constants.B[0]
    if form.classically_damped:
        omega2, D = form.along("K"), form.along("D")
        modes[UNIT] = divided(np.ones(r), omega2, np.diag(D), scheme)
        modes[STIFFNESS], modes[DAMPING] = modes[UNIT] * omega2, modes[UNIT] * D
    return State(
        modes=aligned(modes),
        multipliers=np.zeros(m),
        position=np.full(1, np.nan),
        interval=np.zeros(1, np.int64),
        couplings=np.zeros((m, m + i)),
        factor=np.zeros((m, m)),
        weighted=aligned(np.zeros((m, r))),
        shares=np.zeros(0),
        contact=contact(form.system.clearance, memory),
    )


def sides(constants: Bodies) -> Sides:
    """Before the first step."""
    m, (i, r) = len(constants.compliance), constants.B.shape
    q, width = len(constants.body), int(constants.rows.width.max(initial=1))
    return Sides(
        x=np.full(q, np.nan),
        interval=np.zeros(q, np.int64),
        weights=np.zeros((q, width)),
        numbers=np.zeros((q, width), np.int64),
        flexibility=np.zeros((m, m)),
        inputs=np.zeros((m, i)),
        old_rows=aligned(np.zeros((m, r))),
        old_flexibility=np.zeros((m, m)),
        old_inputs=np.zeros((m, i)),
        old_z=aligned(np.zeros(r)),
        old_multipliers=np.zeros(m),
        old_loads=np.zeros(i),
        energy=np.zeros(2),
    )


def _polynomials(system: System) -> Polynomials:
    rows = [system.row(side.place) for side in system.sides]
    c = [row.coefficients.transpose(1, 2, 0) for row in rows]  # interval, entry, power
    return Polynomials(
        breaks=np.concatenate([np.empty(0), *(row.breaks for row in rows)]),
        first_break=starts([len(row.breaks) for row in rows])[:-1],
        intervals=np.array([len(row.breaks) - 1 for row in rows], np.int64),
        coefficients=np.concatenate([np.empty(0), *(one.ravel() for one in c)]),
        first_coefficient=starts([one.size for one in c])[:-1],
        powers=np.array([one.shape[2] for one in c], np.int64),
        touched=np.concatenate([np.empty(0, np.int64), *(row.touched.ravel() for row in rows)]),
        first_touched=starts([row.touched.size for row in rows])[:-1],
        width=np.array([row.touched.shape[1] for row in rows], np.int64),
    )
