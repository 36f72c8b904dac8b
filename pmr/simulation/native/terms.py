r"""Terms that vary in time (`pmr.system.terms`) in a step, compiled: forces on its right-hand side, iterated.

.. math::
    w = -\sum_k c_k(t_{n+1}) \, (V_k \dot z + G_k z), \qquad
    \ddot z = S^{-1} (B f + w - \Omega^2 z^* - D v^* - C^T \lambda)

at the end of the step as all other forces, so that the scheme stays what it is.  S, the rows' factor and their tables
stay those of the constant matrices: w begins with what the three steps before make of it, and multipliers and w are
found anew until w no longer changes.  Each time its error is multiplied by at most the largest ratio of

.. math:: dq\, x^T G x + dv\, x^T V x \quad \text{to} \quad x^T (1 + dv D + dq K) x, \qquad dq \approx h^2 / 4

over motions x that the contacts allow: less than the share of the buckling load with any step, and some 1e-4 where a
period takes some hundred steps.  So two to four times are the rule.  It does not converge, and is refused, beyond the
buckling load or where a tension raises frequencies that the step does not resolve.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import (
    DAMPING,
    OTHERS,
    ROW,
    STIFFNESS,
    UNIT,
    V_NEXT,
    Z_FREE,
    Z_NEXT,
    Divided,
    Scheme,
    State,
    V,
    Z,
)
from pmr.simulation.native.compilation import compiled_and_inlined, inlined
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.rows import dot
from pmr.simulation.native.simd import LANES, aligned, load, spread, store
from pmr.system.terms import Term

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Change of w that counts as none, and the one that is accepted after the last time, over the largest w so far.
CONVERGED, ACCEPTED = 1e-11, 1e-8
#: Times that w is found in a step at most; returned where that is not enough.
LIMIT, UNCONVERGED = 100, -3
#: A change so many times the largest w, or the first one of the step, diverges.
DIVERGED = 1e6
SETTLED, AGAIN = 0, -4
#: Entries of `Terms.numbers`: largest |w|^2 so far, times that w was found in this step, |w|^2 of the first one, work
#: since the start in J.
LARGEST, TIMES, FIRST, WORK = range(4)


class Terms(NamedTuple):
    """K terms as b blocks, each of which makes forces on the modes of one body from those of one body.

    Blocks are flat, one column after the other, as long as the modes' ranges are; e parts of terms make them up.
    """

    of_rates: NDArray[np.bool_]  # (b,): whether a block acts on z' or on z
    rows: Indices  # (b, 2): the first and behind the last mode on which it makes forces
    columns: Indices  # (b, 2): and by which
    first: Indices  # (b + 1,)
    now: Array  # sums over the terms, with their present amplitudes
    term: Indices  # (e,): which term a part is of
    block: Indices  # (e,): and of which block
    parts: Array  # the blocks of the parts, with amplitudes of 1
    first_part: Indices  # (e + 1,)
    c: Array  # (K,): present amplitudes; NaN before the start
    given: Array  # (r',): S^-1 B f
    force: Array  # (r',): w
    new_force: Array  # (r',): and what the displacement makes of it that it leads to
    divided: Array  # (r',): S^-1 w
    old_force: Array  # (3, r'): w of the steps before
    old_z: Array  # (r',)
    numbers: Array  # (4,)


def terms(form: SystemForm) -> Terms | None:
    """Those of a system, on its modes; None where it has none."""
    system = form.system
    if not system.terms:
        return None
    r, names = int(form.starts[-1]), list(system.bodies)
    ranges = {name: (int(form.starts[k]), int(form.starts[k + 1])) for k, name in enumerate(names)}
    blocks, found = dict[tuple[bool, str, str], int](), list[tuple[int, int, Array]]()
    for number, term in enumerate(form.modal.terms):
        for key, A in term.matrices.items():
            for row, column, part in _between(term, A, form):
                block = blocks.setdefault((key == "damping", row, column), len(blocks))
                found.append((number, block, part))
    sizes = [np.subtract(*ranges[row][::-1]) * np.subtract(*ranges[column][::-1]) for _, row, column in blocks]
    return Terms(
        of_rates=np.array([of_rates for of_rates, _, _ in blocks]),
        rows=np.array([ranges[row] for _, row, _ in blocks], np.int64),
        columns=np.array([ranges[column] for _, _, column in blocks], np.int64),
        first=np.cumsum([0, *sizes], dtype=np.int64),
        now=aligned(np.zeros(int(np.sum(sizes)))),
        term=np.array([number for number, _, _ in found], np.int64),
        block=np.array([block for _, block, _ in found], np.int64),
        parts=aligned(np.concatenate([part.ravel() for _, _, part in found])),
        first_part=np.cumsum([0, *(part.size for _, _, part in found)], dtype=np.int64),
        c=np.full(len(system.terms), np.nan),
        given=aligned(np.zeros(r)),
        force=aligned(np.zeros(r)),
        new_force=aligned(np.zeros(r)),
        divided=aligned(np.zeros(r)),
        old_force=aligned(np.zeros((3, r))),
        old_z=aligned(np.zeros(r)),
        numbers=np.zeros(4),
    )


def _between(term: Term, A: Array, form: SystemForm) -> Sequence[tuple[str, str, Array]]:
    """Parts of a matrix on the modes of a term's bodies, transposed and filled up, but those that are zero."""
    columns = form.columns
    sizes = [columns[name].stop - columns[name].start for name in term.bodies]
    ends = np.cumsum([0, *sizes])
    own = {name: slice(a, b) for name, a, b in zip(term.bodies, ends[:-1], ends[1:], strict=True)}
    found = []
    for row in term.bodies:
        for column in term.bodies:
            part = np.asarray(A[own[row], own[column]]).T
            if np.any(part):
                found.append((row, column, np.pad(part, [(0, -n % LANES) for n in part.shape])))
    return found


@compiled_and_inlined
def begin(terms: Terms, state: State, c: Array) -> None:
    """Forces w of the present state with amplitudes c (K,), where a simulation or steps of another length begin."""
    _combine(terms, c)
    _find_forces(terms, state.modes)
    for n in range(0, len(terms.force), LANES):
        w = load(terms.new_force, n)
        store(terms.force, n, w)
        store(terms.old_force[0], n, w)
        store(terms.old_force[1], n, w)
        store(terms.old_force[2], n, w)
        store(terms.old_z, n, load(state.modes[Z], n))


@inlined
def expect(terms: Any, divided: Divided, state: State, f: Array, c: Any) -> None:
    """Begin a step under loads f (i,) and with amplitudes c (K,) at its end: w as the steps before go on."""
    if terms is not None:  # decided when compiled
        _combine(terms, c)
        terms.numbers[TIMES] = 0.0
        for n in range(0, len(terms.force), LANES):
            rise, value = load(terms.old_force[0], n) - load(terms.old_force[1], n), spread(0.0)
            store(terms.force, n, load(terms.old_force[2], n) + rise * 3.0)  # a parabola
            for l in range(len(f)):
                value = value + load(divided.B[l], n) * f[l]
            store(terms.given, n, value)
        _divide(terms, divided, state.modes)


@inlined
def push(terms: Any, scheme: Scheme, modes: Array) -> None:
    """Let w act on the displacement that a step leads to without multipliers and loads."""
    if terms is not None:
        for n in range(0, len(terms.force), LANES):
            store(modes[Z_FREE], n, load(modes[Z_FREE], n) + load(terms.divided, n) * scheme.z_gain)


@inlined
def revise(terms: Any, divided: Divided, scheme: Scheme, state: State) -> int:
    """Find w anew from the multipliers: SETTLED, AGAIN where these have to follow, or UNCONVERGED."""
    if terms is None:
        return SETTLED
    _reach(terms, divided, scheme, state)
    _find_forces(terms, state.modes)
    change, size = 0.0, 0.0
    for n in range(len(terms.force)):
        change += (terms.new_force[n] - terms.force[n]) ** 2
        size += terms.new_force[n] ** 2
    numbers = terms.numbers
    largest = max(numbers[LARGEST], size)
    numbers[TIMES] += 1.0
    if numbers[TIMES] == 1.0:
        numbers[FIRST] = size
    last, usual = numbers[TIMES] >= LIMIT, max(numbers[LARGEST], numbers[FIRST])
    if usual > 0.0 and change > DIVERGED**2 * usual:
        return UNCONVERGED
    bound = ACCEPTED if last else CONVERGED
    if change <= bound**2 * largest or change != change:  # what is not a number is said elsewhere
        numbers[LARGEST] = largest
        return SETTLED
    if last:
        return UNCONVERGED
    _take(terms, divided, scheme, state.modes)
    return AGAIN


@inlined
def finish(terms: Any, modes: Array) -> None:
    """Let w act as further inputs and rows do, before a step ends."""
    if terms is not None:
        for n in range(0, len(terms.force), LANES):
            store(modes[OTHERS], n, load(modes[OTHERS], n) + load(terms.divided, n))


@inlined
def account(terms: Any, modes: Array) -> None:
    """Add the work of w in the step that has ended, and keep what the next one asks for."""
    if terms is not None:
        work = 0.0
        for n in range(len(terms.force)):
            work += (terms.force[n] + terms.old_force[0, n]) / 2.0 * (modes[Z, n] - terms.old_z[n])
        terms.numbers[WORK] += work
        for n in range(0, len(terms.force), LANES):
            store(terms.old_force[2], n, load(terms.old_force[1], n))
            store(terms.old_force[1], n, load(terms.old_force[0], n))
            store(terms.old_force[0], n, load(terms.force, n))
            store(terms.old_z, n, load(modes[Z], n))


@inlined
def add(terms: Any, a: Array) -> None:
    """Add w to accelerations (r',)."""
    if terms is not None:
        for n in range(0, len(a), LANES):
            store(a, n, load(a, n) + load(terms.force, n))


@inlined
def _combine(terms: Terms, c: Array) -> None:
    """The blocks with amplitudes c (K,), where these are others than before."""
    same = True
    for k in range(len(c)):
        same = same and c[k] == terms.c[k]
        terms.c[k] = c[k]
    if same:
        return
    for n in range(0, len(terms.now), LANES):
        store(terms.now, n, spread(0.0))
    for e in range(len(terms.term)):
        at, amplitude = terms.first[terms.block[e]] - terms.first_part[e], terms.c[terms.term[e]]
        for n in range(terms.first_part[e], terms.first_part[e + 1], LANES):
            store(terms.now, at + n, load(terms.now, at + n) + load(terms.parts, n) * amplitude)


@inlined
def _find_forces(terms: Terms, modes: Array) -> None:
    """W of the present displacements and their rates, as `Terms.new_force`."""
    for n in range(0, len(terms.new_force), LANES):
        store(terms.new_force, n, spread(0.0))
    for b in range(len(terms.of_rates)):
        moving = modes[V] if terms.of_rates[b] else modes[Z]
        row, height = terms.rows[b, 0], terms.rows[b, 1] - terms.rows[b, 0]
        column, width = terms.columns[b, 0], terms.columns[b, 1] - terms.columns[b, 0]
        for n in range(0, height, LANES):
            at, odd, even = terms.first[b] + n, spread(0.0), spread(0.0)
            for l in range(0, width, 2):  # in two sums, for each addition has to wait for the one before
                even = even + load(terms.now, at) * moving[column + l]
                odd = odd + load(terms.now, at + height) * moving[column + l + 1]
                at += 2 * height
            store(terms.new_force, row + n, load(terms.new_force, row + n) - even - odd)


@inlined
def _divide(terms: Terms, divided: Divided, modes: Array) -> None:
    """S^-1 w."""
    if len(divided.damped) > 0:
        for n in range(len(terms.force)):
            terms.divided[n] = dot(divided.damped[2, n], terms.force)
    else:
        for n in range(0, len(terms.force), LANES):
            store(terms.divided, n, load(modes[UNIT], n) * load(terms.force, n))


@inlined
def _reach(terms: Terms, divided: Divided, scheme: Scheme, state: State) -> None:
    """Z and z' at the end of the step with the present multipliers and w."""
    modes, coupled = state.modes, len(divided.damped) > 0
    for n in range(0, len(terms.force), LANES):
        z, v = load(modes[Z_NEXT], n), load(modes[V_NEXT], n)
        a = load(terms.given, n) + load(terms.divided, n)
        if coupled:
            a = a + load(modes[OTHERS], n)
        else:
            a = a - load(modes[STIFFNESS], n) * z - load(modes[DAMPING], n) * v
        for k in range(len(state.multipliers)):
            if coupled:
                a = a - load(state.weighted[k], n) * state.multipliers[k]
            else:
                a = a - load(modes[UNIT], n) * load(modes[ROW + k], n) * state.multipliers[k]
        store(modes[Z], n, z + a * scheme.z_gain)
        store(modes[V], n, v + a * scheme.v_gain)


@inlined
def _take(terms: Terms, divided: Divided, scheme: Scheme, modes: Array) -> None:
    """The new w instead of the old one."""
    for n in range(0, len(terms.force), LANES):
        store(modes[Z_FREE], n, load(modes[Z_FREE], n) - load(terms.divided, n) * scheme.z_gain)
        store(terms.force, n, load(terms.new_force, n))
    _divide(terms, divided, modes)
    push(terms, scheme, modes)
