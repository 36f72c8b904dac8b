"""Contacts with places of their own as the arrays that the compiled loop reads.

What the rows of all bodies need is laid out flat: breaks, coefficients and touched carriers one row after the other,
each row at its own offset.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.reduced.carriers import CarriedRows
from pmr.simulation.native.form import SystemForm, starts
from pmr.simulation.native.simd import LANES, aligned, padded
from pmr.system.friction import Friction
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
    beside: Indices  # (q, 2): the first and behind the last side on the same body


class Bodies(NamedTuple):
    """Constants of bodies with r' modes, K carriers and i inputs in all, and of m contacts; i' and m' as r'.

    Behind the m contacts stand the n pads that rub (`pmr.simulation.native.friction`), before they are filled up to m'.
    """

    values: Array  # (K, r'): what the modes measure on the carriers
    inputs: Array  # (K, i') m/N: U R B
    energy: Array  # (i, i') m/N: B^T R B
    flexibility: Array  # all U R U^T in m/N, flat, one body after the other; nothing of a body without
    first_flexibility: Indices  # (bodies + 1,)
    carriers: Indices  # (bodies + 1,): where each body's begin
    modes: Indices  # (bodies + 1,): likewise, in whole vector registers
    own_inputs: Indices  # (bodies, 2): the first and behind the last input that acts on a body
    moves: Indices  # (m, 2): as in `Reach`
    beside: Indices  # (m, 2): likewise, and of moments of pads that rub
    moved_by: Indices  # (m, 2): the first and behind the last input on a contact's bodies, the first a register's
    staying: Array  # (m, r'): rows of the sides that stay where they are
    staying_inputs: Array  # (m, i') m/N: H of these
    # (m, m') m/N: half of G between these, and of what contacts give way by themselves where all paths are at 0; all of
    # what they measure of moments of pads that rub
    staying_half: Array
    lengthening: Array  # (Q, m, m') 1/N: half of what ropes add whose length grows with a path
    lengthening_path: Indices  # (Q,): number of this path
    staying_answers: Array  # (K, m') m/N: U R b^T of these, and U R b'^T of pads that rub
    staying_slopes: Array  # (n, r') 1/m: C' of these
    rows: Polynomials


class SideOutputs(NamedTuple):
    """Constants of o outputs, filled up to o' by those that make whole vector registers."""

    of_modes: Array  # (r', o')
    of_inputs: Array  # (i, o') m/N: W
    of_staying: Array  # (m, o') m/N: X of the sides that stay
    of_carriers: Array  # (K, o') m/N: O R U^T
    of_staying_slopes: Array  # (n, o') 1/N: X' of the sides of pads that rub, where they stay


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
    of_inputs: Array  # (q, p', i')
    of_staying: Array  # (q, p', m')
    of_others: Array  # (q, q, p', p'), the lower half
    room: Array  # (d, p')
    half: Array  # (m, m') m/N: N of G + A = N + N^T
    inputs: Array  # (m, i') m/N: H
    loads: Array  # (i',) N
    forces: Array  # (m',) N
    push: Array  # (r',): B f
    old_push: Array
    old_rows: Array  # (m, r')
    old_half: Array
    old_inputs: Array
    old_z: Array  # (r',)
    old_loads: Array
    old_forces: Array
    of_loads: Array  # (2,) J: f^T B^T R B f, now and a step before
    energy: Array  # (2,) J: what is stored, NaN before the start, and the work done since
    calls: Indices  # (1,): the address of `move_sides` (`pmr.simulation.native.linking`)


def bodies(form: SystemForm, paths: Sequence[str]) -> Bodies:
    """Constants of a system that travels on `paths`, by their names."""
    system, all_carried = form.modal, carried(form)
    carriers = starts([len(one.values) for one in all_carried.values()])
    K, i = int(carriers[-1]), int(form.inputs[-1])
    values, inputs, energy = np.zeros((K, form.starts[-1])), np.zeros((K, i)), np.zeros((i, i))
    flexibility = []
    for k, (name, one) in enumerate(all_carried.items()):
        rows, own = slice(carriers[k], carriers[k + 1]), slice(form.inputs[k], form.inputs[k + 1])
        values[rows, form.columns[name]] = one.values
        left = one.flexibility
        flexibility.append(np.zeros((0, 0)) if left is None else left.rows)
        if left is not None:
            inputs[rows, own], energy[own, own] = left.inputs, left.energy
    m, given = len(system.contacts), system.compliance
    moved_by = [(form.inputs[on[0]] // LANES * LANES, form.inputs[on[-1] + 1]) for on in form.joined]
    staying, slopes = _staying(form, carriers), _staying_slopes(form, carriers)
    both = np.vstack([staying, slopes])
    answers, half = np.zeros((K, len(both) + -len(both) % LANES)), np.full(len(both) + -len(both) % LANES, 0.5)
    half[m:] = 1.0
    for first, last, R in zip(carriers, carriers[1:], flexibility, strict=False):
        if len(R):
            answers[first:last, : len(both)] = R @ both[:, first:last].T
    return Bodies(
        values=aligned(values),
        inputs=padded(inputs),
        energy=padded(energy),
        flexibility=np.concatenate([np.empty(0), *(R.ravel() for R in flexibility)]),
        first_flexibility=starts([R.size for R in flexibility]),
        carriers=carriers,
        modes=form.starts,
        own_inputs=np.stack([form.inputs[:-1], form.inputs[1:]], axis=1),
        moves=form.reach.moves,
        beside=_beside(form, len(half) if len(slopes) else 0),
        moved_by=np.array(moved_by, np.int64).reshape(-1, 2),
        staying=aligned(staying @ values),
        staying_inputs=padded(staying @ inputs),
        staying_half=aligned(staying @ answers * half + _beyond(given.constant / 2.0, len(half))),
        lengthening=aligned(_beyond(given.slopes / 2.0, len(half))),
        lengthening_path=np.array([list(paths).index(path) for path in given.paths], np.int64),
        staying_answers=aligned(answers),
        staying_slopes=aligned(slopes @ values),
        rows=_polynomials(system, paths),
    )


def _beyond(values: Array, wide: int) -> Array:
    """With zeros behind the last column."""
    return np.concatenate([values, np.zeros((*values.shape[:-1], wide - values.shape[-1]))], axis=-1)


def carried(form: SystemForm) -> dict[str, CarriedRows]:
    """The bodies' rows, of their modes; an InputError where a body has none on carriers."""
    found = {}
    for name, body in form.modal.bodies.items():
        if body.carriers is None:
            allowed = "a model with carriers is allowed (`pmr.reduction.residual.model.section_model`)"
            raise InputError("system", f"bodies.{name}", None, allowed)
        found[name] = body.carriers
    return found


def _staying(form: SystemForm, carriers: Indices, derivative: int = 0) -> Array:
    """B of the sides that stay where they are, with their signs, (m, K); or its derivative with respect to x."""
    system, names = form.modal, list(form.modal.bodies)
    staying = np.zeros((len(system.contacts), carriers[-1]))
    for side in system.sides:
        if side.place.path is None:
            first = carriers[names.index(side.place.body)]
            b = side.sign * system.row(side.place).weights(side.place.at, derivative).toarray()[0]
            staying[side.contact, first : first + len(b)] += b
    return staying


def _staying_slopes(form: SystemForm, carriers: Indices) -> Array:
    """The derivatives of pads that rub, (n, K)."""
    known = Friction.of(form.modal.contacts)
    return np.zeros((0, carriers[-1])) if known is None else _staying(form, carriers, 1)[known.pads]


def side_outputs(form: SystemForm, chosen: Sequence[int]) -> SideOutputs:
    """Constants of the `chosen` outputs (numbers), which are counted one body after the other."""
    all_carried = carried(form)
    carriers = starts([len(one.values) for one in all_carried.values()])
    of_modes, of_inputs, of_carriers = list[Array](), list[Array](), list[Array]()
    for k, (name, one) in enumerate(all_carried.items()):
        of_body = form.forms[name].body.outputs
        O = np.zeros((form.starts[-1], len(of_body)))
        W, X = np.zeros((form.inputs[-1], len(of_body))), np.zeros((carriers[-1], len(of_body)))
        O[form.columns[name]] = of_body.T
        if one.flexibility is not None:
            W[form.inputs[k] : form.inputs[k + 1]] = one.flexibility.direct.T
            X[carriers[k] : carriers[k + 1]] = one.flexibility.outputs.T
        of_modes, of_inputs, of_carriers = [*of_modes, O], [*of_inputs, W], [*of_carriers, X]
    X = np.hstack(of_carriers)
    of_staying, of_slopes = _staying(form, carriers) @ X, _staying_slopes(form, carriers) @ X
    of_all = (np.hstack(of_modes), np.hstack(of_inputs), of_staying, X, of_slopes)
    return SideOutputs(*(padded(one[:, list(chosen)]) for one in of_all))


def sides(constants: Bodies, paths: int) -> Sides:
    """Before the first step, with `paths` of them."""
    (m, wide), i, r = constants.staying_half.shape, constants.inputs.shape[1], constants.values.shape[1]
    q, width = len(constants.rows.body), int(constants.rows.width.max(initial=1))
    p = constants.rows.coefficients.shape[1]
    return Sides(
        s=np.full(paths, np.nan),
        interval=np.full(q, -1),
        entered=np.zeros(q, np.bool_),
        moved=np.zeros(1, np.bool_),
        powers=aligned(np.zeros((q, p))),
        of_modes=aligned(np.zeros((q, p, r))),
        of_inputs=aligned(np.zeros((q, p, i))),
        of_staying=aligned(np.zeros((q, p, wide))),
        of_others=aligned(np.zeros((q, q, p, p))),
        room=aligned(np.zeros((width, p))),
        half=aligned(np.zeros((m, wide))),
        inputs=aligned(np.zeros((m, i))),
        loads=aligned(np.zeros(i)),
        forces=aligned(np.zeros(wide)),
        push=aligned(np.zeros(r)),
        old_push=aligned(np.zeros(r)),
        old_rows=aligned(np.zeros((m, r))),
        old_half=aligned(np.zeros((m, wide))),
        old_inputs=aligned(np.zeros((m, i))),
        old_z=aligned(np.zeros(r)),
        old_loads=aligned(np.zeros(i)),
        old_forces=aligned(np.zeros(wide)),
        of_loads=np.zeros(2),
        energy=np.array([np.nan, 0.0]),
        calls=np.zeros(1, np.int64),
    )


def _beside(form: SystemForm, least: int) -> Indices:
    """As in `Reach`, the last at `least` so many: moments of pads that rub stand behind all contacts, (m, 2)."""
    found = form.reach.beside.copy()
    found[:, 1] = np.maximum(found[:, 1], least)
    return found


def _polynomials(system: System, paths: Sequence[str]) -> Polynomials:
    sides, names = [side for side in system.sides if side.place.path is not None], list(system.bodies)
    rows, bodies = [system.row(side.place) for side in sides], [side.place.body for side in sides]
    last = {body: number + 1 for number, body in enumerate(bodies)}
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
        beside=np.array([(bodies.index(body), last[body]) for body in bodies], np.int64).reshape(-1, 2),
    )
