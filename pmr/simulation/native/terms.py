r"""Terms that vary in time (`pmr.system.terms`) in a step, compiled: forces on its right-hand side, iterated.

.. math::
    w = -\sum_k c_k(t_{n+1}) \, (V_k \dot z + G_k z), \qquad
    \ddot z = S^{-1} (B f + w - \Omega^2 z^* - D v^* - C^T \lambda)

at the end of the step as all other forces, so that the scheme stays what it is.  S, the rows' factor and their tables
stay those of the constant matrices: w begins with what a cubic through the four steps before makes of it, and
multipliers and w are found anew until w no longer changes.  Each time its error is multiplied by at most the largest
ratio of

.. math:: dq\, x^T G x + dv\, x^T V x \quad \text{to} \quad x^T (1 + dv D + dq K) x, \qquad dq \approx h^2 / 4

over motions x that the contacts allow: less than the share of the buckling load with any step, and some 1e-4 where a
period takes some hundred steps.  So one to three times are the rule.  It does not converge, and is refused, beyond the
buckling load or where a tension raises frequencies that the step does not resolve.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
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

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
#: Of what is never counted from the end, which a signed number might be.
Numbers = NDArray[np.uint64]

#: Change of w that counts as none, and the one that is accepted after the last time, over the largest w so far.
CONVERGED, ACCEPTED = 1e-11, 1e-8
#: Times that w is found in a step at most; returned where that is not enough.
LIMIT, UNCONVERGED = 100, -3
#: A change so many times the largest w, or the first one of the step, diverges.
DIVERGED = 1e6
SETTLED, AGAIN, LAST = 0, -4, -5
#: What of an amplitude is round-off of another one's, over its largest; at so many times they are compared at first.
SAME, SAMPLES = 1e-15, 16
#: Entries of a matrix below this share of its largest one are round-off of zero: most planes of bending do not couple.
NOTHING = 1e-13
#: Entries of `Terms.numbers`: largest |w|^2 so far, times that w was found in this step, |w|^2 of the first one, work
#: since the start in J, |change|^2 of w before, by what it is multiplied from one time to the next at most, and
#: the times since this was last found.
LARGEST, TIMES, FIRST, WORK, CHANGE, SHRINKS, TRUSTED = range(7)
#: A change that is foreseen to be so much smaller than what counts as none isn't looked at, but for one in so many.
FORESEEN, MOST_TRUSTED = 0.1, 16


class Terms(NamedTuple):
    """Terms with J signals as their sum, of which only what is not zero is stored: u registers of four rows each.

    A register belongs to one column and to z or z'.  It is a sum over the signals that it depends on, e in all.
    """

    now: Array  # (4 u,): with present amplitudes, one block of four rows after the other
    column: Numbers  # (u,): the mode by which each makes forces
    of_rows: Indices  # (r' / 4, 3): where those of four rows begin, those of them on z', and where they end
    parts: Array  # (4 e,): with amplitudes of 1, those of a register one after the other
    signal: Numbers  # (e,): what a part is multiplied by
    first_part: Indices  # (u + 1,): where the parts of a register begin, as many ones after fewer
    to: Indices  # (u,): where in `now` this register begins
    c: Array  # (J,): present amplitudes; NaN before the start
    given: Array  # (r',): S^-1 B f where `State.given` is not; else (0,)
    force: Array  # (r',): w
    new_force: Array  # (r',): and what the displacement makes of it that it leads to
    divided: Array  # (r',): S^-1 w
    old_force: Array  # (4, r'): w of the steps before, the last one first
    old_z: Array  # (r',)
    numbers: Array  # (7,)


def independent(c: Array) -> tuple[Indices, Array]:
    """Numbers (J,) of amplitudes none of which is a multiple of another one, and their shares (J, K) in c (T, K).

    Terms with one signal, as a frame that turns has for each section, are one term.  At least one is left.
    """
    kept, shares, largest = list[int](), np.zeros((c.shape[1], c.shape[1])), np.abs(c).max(axis=0)
    some = np.unique(np.linspace(0, len(c) - 1, SAMPLES).astype(int))
    for k in np.flatnonzero(largest):
        at = np.argmax(np.abs(c[:, k]))
        for j in kept:
            share = c[at, k] / c[at, j] if c[at, j] else 0.0
            if all(np.abs(c[on, k] - share * c[on, j]).max() <= SAME * largest[k] for on in (some, slice(None))):
                shares[j, k] = share
                break
        else:
            kept.append(int(k))
            shares[k, k] = 1.0
    kept = kept or list(range(min(1, c.shape[1])))
    return np.array(kept, np.int64), shares[kept]


def terms(form: SystemForm, shares: Array) -> Terms | None:
    """Those of a system, on its modes, of signals with these `shares` (J, K) in them; None where it has none."""
    system = form.system
    if not system.terms:
        return None
    r = int(form.starts[-1])
    found, numbers, signal = _registers(form, shares)
    known, u = np.unique(numbers, return_inverse=True)
    count = np.bincount(u, minlength=len(known))
    by_count = np.argsort(count, kind="stable")  # loops as long as the one before are foreseen
    place = np.empty(len(known), np.int64)
    place[by_count] = np.arange(len(known))
    order = np.lexsort((signal, place[u]))
    first = np.searchsorted(known, r * np.arange(2 * (r // LANES) + 1))
    return Terms(
        now=aligned(np.zeros(LANES * len(known))),
        column=(known % r).astype(np.uint64),
        of_rows=np.stack([first[:-2:2], first[1::2], first[2::2]], axis=1).astype(np.int64),
        parts=aligned(found[order].ravel()),
        signal=signal[order].astype(np.uint64),
        first_part=np.cumsum([0, *count[by_count]], dtype=np.int64),
        to=LANES * by_count.astype(np.int64),
        c=np.full(len(shares), np.nan),
        given=aligned(np.zeros(0 if form.on_tables is None else r)),
        force=aligned(np.zeros(r)),
        new_force=aligned(np.zeros(r)),
        divided=aligned(np.zeros(r)),
        old_force=aligned(np.zeros((4, r))),
        old_z=aligned(np.zeros(r)),
        numbers=np.zeros(7),
    )


def _registers(form: SystemForm, shares: Array) -> tuple[Array, Indices, Indices]:
    """All registers that are not zero, of each signal: entries (e, 4), numbers (e,) by rows, rate and column; signals.

    Those of four rows that act on z come before those of the same rows that act on z'.
    """
    r, columns = int(form.starts[-1]), form.columns
    where = {name: range(own.start, own.stop) for name, own in columns.items()}
    sums = dict[tuple[int, int], sp.csr_matrix]()
    for number, term in enumerate(form.modal.terms):
        for key, A in term.among(where, r).matrices.items():
            A.data[np.abs(A.data) <= NOTHING * np.abs(A.data).max(initial=0.0)] = 0.0
            for signal in np.flatnonzero(shares[:, number]).tolist():
                at = int(key == "damping"), signal
                sums[at] = sums.get(at, sp.csr_matrix((r, r))) + shares[signal, number] * A
    entries, numbers, signals = [np.empty((0, LANES))], [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for (of_rates, signal), A in sums.items():
        A.eliminate_zeros()
        tall = A.tobsr((LANES, 1))
        rows = np.repeat(np.arange(r // LANES), np.diff(tall.indptr))
        entries.append(tall.data[:, :, 0])
        numbers.append((2 * rows + of_rates) * r + tall.indices)
        signals.append(np.full(len(rows), signal))
    return np.concatenate(entries), np.concatenate(numbers), np.concatenate(signals)


@compiled_and_inlined
def begin(terms: Terms, state: State, c: Array) -> None:
    """Forces w of the present state with amplitudes c (J,), where a simulation or steps of another length begin."""
    _combine(terms, c)
    _find_forces(terms, state.modes)
    for n in range(0, len(terms.force), LANES):
        w = load(terms.new_force, n)
        store(terms.force, n, w)
        for k in range(len(terms.old_force)):
            store(terms.old_force[k], n, w)
        store(terms.old_z, n, load(state.modes[Z], n))


@inlined
def expect(terms: Any, divided: Divided, state: State, f: Array, c: Any) -> None:
    """Begin a step under loads f (i,) and with amplitudes c (J,) at its end: w as the steps before go on."""
    if terms is not None:  # decided when compiled
        _combine(terms, c)
        terms.numbers[TIMES] = 0.0
        for n in range(0, len(terms.force), LANES):
            ends = load(terms.old_force[0], n) * 4.0 - load(terms.old_force[3], n)  # of a cubic
            store(terms.force, n, ends + (load(terms.old_force[2], n) * 4.0 - load(terms.old_force[1], n) * 6.0))
        for n in range(0, len(terms.given), LANES):
            value = spread(0.0)
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
    """Find w anew from the multipliers: SETTLED, AGAIN or for the LAST time where these have to follow, UNCONVERGED."""
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
    if numbers[TIMES] > 1.0:
        numbers[SHRINKS] = max(numbers[SHRINKS] / 2.0, change / numbers[CHANGE])
        numbers[TRUSTED] = 0.0
    numbers[CHANGE] = change
    if change <= bound**2 * largest or change != change:  # what is not a number is said elsewhere
        numbers[LARGEST] = largest
        return SETTLED
    if last:
        return UNCONVERGED
    _take(terms, divided, scheme, state.modes)
    numbers[TRUSTED] += 1.0
    known = 0.0 < numbers[SHRINKS] and numbers[TRUSTED] < MOST_TRUSTED
    if known and change * numbers[SHRINKS] <= (FORESEEN * CONVERGED) ** 2 * largest:
        numbers[LARGEST] = largest
        return LAST
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
            for k in range(len(terms.old_force) - 1, 0, -1):
                store(terms.old_force[k], n, load(terms.old_force[k - 1], n))
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
    """Their sum with amplitudes c (J,), where these are others than before."""
    same = True
    for k in range(len(c)):
        same = same and c[k] == terms.c[k]
        terms.c[k] = c[k]
    if same:
        return
    for u in range(len(terms.to)):
        value = spread(0.0)
        for e in range(terms.first_part[u], terms.first_part[u + 1]):
            value = value + load(terms.parts, LANES * e) * terms.c[terms.signal[e]]
        store(terms.now, terms.to[u], value)


@inlined
def _find_forces(terms: Terms, modes: Array) -> None:
    """W of the present displacements and their rates, as `Terms.new_force`."""
    z, v = modes[Z], modes[V]
    for k in range(len(terms.of_rows)):
        first, middle, last = terms.of_rows[k, 0], terms.of_rows[k, 1], terms.of_rows[k, 2]
        of_z, of_v = spread(0.0), spread(0.0)
        for u in range(first, middle):
            of_z = of_z - load(terms.now, LANES * u) * z[terms.column[u]]
        for u in range(middle, last):
            of_v = of_v - load(terms.now, LANES * u) * v[terms.column[u]]
        store(terms.new_force, LANES * k, of_z + of_v)


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
    modes, coupled, given = state.modes, len(divided.damped) > 0, len(terms.given) == 0
    for n in range(0, len(terms.force), LANES):
        z, v = load(modes[Z_NEXT], n), load(modes[V_NEXT], n)
        a = load(state.given if given else terms.given, n) + load(terms.divided, n)
        if coupled:
            a = a + load(modes[OTHERS], n)
        else:
            a = a - load(modes[STIFFNESS], n) * z - load(modes[DAMPING], n) * v
        held = spread(0.0)
        for k in range(len(state.multipliers)):
            row = state.weighted[k] if coupled else modes[ROW + k]
            held = held + load(row, n) * state.multipliers[k]
        a = a - (held if coupled else held * load(modes[UNIT], n))
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
