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
SETTLED, AGAIN, LAST = 0, -4, -5
#: What of an amplitude is round-off of another one's, over its largest; at so many times they are compared at first.
SAME, SAMPLES = 1e-15, 16
#: Entries of `Terms.numbers`: largest |w|^2 so far, times that w was found in this step, |w|^2 of the first one, work
#: since the start in J, |change|^2 of w before, by what it is multiplied from one time to the next at most, and
#: the times since this was last found.
LARGEST, TIMES, FIRST, WORK, CHANGE, SHRINKS, TRUSTED = range(7)
#: A change that is foreseen to be so much smaller than what counts as none isn't looked at, but for one in so many.
FORESEEN, MOST_TRUSTED = 0.1, 16


class Terms(NamedTuple):
    """Terms with J signals as b blocks, each of which makes forces on the modes of one body from those of one body.

    Blocks are flat, one column after the other, as long as the modes' ranges are; each is made up of parts, one for
    each signal that it depends on, e in all.
    """

    of_rates: NDArray[np.bool_]  # (b,): whether a block acts on z' or on z
    rows: Indices  # (b, 2): the first and behind the last mode on which it makes forces
    columns: Indices  # (b, 2): and by which
    first: Indices  # (b + 1,)
    now: Array  # with present amplitudes
    parts: Array  # with amplitudes of 1, those of a block one after the other
    first_part: Indices  # (b + 1,): the number of the first one of a block
    signal: Indices  # (e,): what a part is multiplied by
    start: Indices  # (b,): where the parts of a block begin
    amplitudes: Array  # (e,): present ones
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
    r, names = int(form.starts[-1]), list(system.bodies)
    ranges = {name: (int(form.starts[k]), int(form.starts[k + 1])) for k, name in enumerate(names)}
    blocks = dict[tuple[bool, str, str], dict[int, Array]]()
    for number, term in enumerate(form.modal.terms):
        for key, A in term.matrices.items():
            for row, column, part in _between(term, A, form):
                of_signals = blocks.setdefault((key == "damping", row, column), {})
                for signal in np.flatnonzero(shares[:, number]).tolist():
                    of_signals[signal] = of_signals.get(signal, 0.0) + shares[signal, number] * part
    sizes = [np.subtract(*ranges[row][::-1]) * np.subtract(*ranges[column][::-1]) for _, row, column in blocks]
    found = [(signal, part.ravel()) for one in blocks.values() for signal, part in one.items()]
    return Terms(
        of_rates=np.array([of_rates for of_rates, _, _ in blocks], np.bool_),
        rows=np.array([ranges[row] for _, row, _ in blocks], np.int64).reshape(-1, 2),
        columns=np.array([ranges[column] for _, _, column in blocks], np.int64).reshape(-1, 2),
        first=np.cumsum([0, *sizes], dtype=np.int64),
        now=aligned(np.zeros(int(np.sum(sizes)))),
        parts=aligned(np.concatenate([np.empty(0), *(part for _, part in found)])),
        first_part=np.cumsum([0, *map(len, blocks.values())], dtype=np.int64),
        signal=np.array([signal for signal, _ in found], np.int64),
        start=np.cumsum([0, *(len(one) * size for one, size in zip(blocks.values(), sizes, strict=True))])[:-1],
        amplitudes=np.zeros(len(found)),
        c=np.full(len(shares), np.nan),
        given=aligned(np.zeros(0 if form.on_tables is None else r)),
        force=aligned(np.zeros(r)),
        new_force=aligned(np.zeros(r)),
        divided=aligned(np.zeros(r)),
        old_force=aligned(np.zeros((4, r))),
        old_z=aligned(np.zeros(r)),
        numbers=np.zeros(7),
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
    """The blocks with amplitudes c (J,), where these are others than before."""
    same = True
    for k in range(len(c)):
        same = same and c[k] == terms.c[k]
        terms.c[k] = c[k]
    if same:
        return
    for e in range(len(terms.signal)):
        terms.amplitudes[e] = terms.c[terms.signal[e]]
    for b in range(len(terms.of_rates)):
        amplitudes = terms.amplitudes[terms.first_part[b] : terms.first_part[b + 1]]
        size = terms.first[b + 1] - terms.first[b]
        for n in range(0, size, 4 * LANES):  # sizes are multiples of registers squared
            at, to, none = terms.start[b] + n, terms.first[b] + n, spread(0.0)
            one, two, three, four = none, none, none, none
            for e in range(len(amplitudes)):
                one = one + load(terms.parts, at) * amplitudes[e]
                two = two + load(terms.parts, at + LANES) * amplitudes[e]
                three = three + load(terms.parts, at + 2 * LANES) * amplitudes[e]
                four = four + load(terms.parts, at + 3 * LANES) * amplitudes[e]
                at += size
            store(terms.now, to, one)
            store(terms.now, to + LANES, two)
            store(terms.now, to + 2 * LANES, three)
            store(terms.now, to + 3 * LANES, four)


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
    modes, coupled, given = state.modes, len(divided.damped) > 0, len(terms.given) == 0
    for n in range(0, len(terms.force), LANES):
        z, v = load(modes[Z_NEXT], n), load(modes[V_NEXT], n)
        a = load(state.given if given else terms.given, n) + load(terms.divided, n)
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
