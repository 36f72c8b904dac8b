"""Terms that vary in time (`pmr.simulation.native.terms`) as the arrays that the compiled loop reads.

A system's terms become as few signals as there are amplitudes of which none is a multiple of another one, and of each
signal's matrices what is not zero, in registers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.simulation.native import friction
from pmr.simulation.native.extrapolation import History, history
from pmr.simulation.native.form import SystemForm, starts
from pmr.simulation.native.simd import LANES, aligned

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Matrices = dict[int, sp.csr_matrix]

#: What of an amplitude is round-off of another one's, over its largest; at so many times they are compared at first.
SAME, SAMPLES = 1e-15, 16
#: Entries of a matrix below this share of its largest one are round-off of zero: most planes of bending do not couple.
NOTHING = 1e-13


class Terms(NamedTuple):
    """Terms with J signals as their sum, of which only what is not zero is stored: u registers of four rows each.

    A register belongs to one column and to z or z'.  It is a sum over the signals that it depends on, e in all.
    """

    now: Array  # (4 u,): with present amplitudes, one block of four rows after the other
    column: Indices  # (u,): the mode by which each makes forces
    of_rows: Indices  # (r' / 4, 3): where those of four rows begin, those of them on z', and where they end
    parts: Array  # (4 e,): with amplitudes of 1, those of a signal one after the other
    first_part: Indices  # (J + 1,): where the parts of a signal begin
    to: Indices  # (e,): where in `now` a part is added
    c: Array  # (J,): present amplitudes; NaN before the start
    given: Array  # (r',): S^-1 B f where `State.given` is not; else (0,)
    force: Array  # (r',): w
    new_force: Array  # (r',): and what the displacement makes of it that it leads to
    divided: Array  # (r',): S^-1 w
    old_force: Array  # (4, r'): w of the steps before, the last one first
    old_z: Array  # (r',)
    numbers: Array  # (7,)
    calls: Indices  # (5,): addresses by BEGIN, EXPECT, REVISE, ACCOUNT and TURN (`pmr.simulation.native.linking`)
    rubbing: Any  # `Rubbing`; None of a body on its tables
    history: History


class Signals(NamedTuple):
    """A system's terms as sum_j d_j (V_j z' + G_j z) with few entries, d = mix c."""

    numbers: Indices  # (K,): of the terms whose amplitudes c are asked for; all others are multiples of these
    mix: Array  # (J, K)
    matrices: list[Matrices]  # (J): G and V (r', r') by 0 and 1


def signals(form: SystemForm, c: Array) -> Signals:
    """Those of a system whose terms have the amplitudes c (T, K)."""
    numbers, shares = independent(c)
    found, amplitudes, unit = list[Matrices](), list[Array](), np.eye(len(numbers))
    for k, own in enumerate(_matrices(form, shares)):
        for j, other in enumerate(found):
            if parts := _apart(other, own):
                amplitudes += [amplitudes[j] + factor * unit[k] for factor, _ in parts]
                found += [part for _, part in parts]
                del amplitudes[j], found[j]
                break
        else:
            amplitudes.append(unit[k])
            found.append(own)
    return Signals(numbers, np.array(amplitudes).reshape(len(found), len(numbers)), found)


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


def _matrices(form: SystemForm, shares: Array) -> list[Matrices]:
    """Those of each signal with these `shares` (K, terms) in the terms."""
    r, found = int(form.starts[-1]), [dict[int, sp.csr_matrix]() for _ in shares]
    where = {name: range(own.start, own.stop) for name, own in form.columns.items()}
    for number, term in enumerate(form.modal.terms):
        for key, A in term.among(where, r).matrices.items():
            A.data[np.abs(A.data) <= NOTHING * np.abs(A.data).max(initial=0.0)] = 0.0
            for signal in np.flatnonzero(shares[:, number]).tolist():
                own, at = found[signal], int(key == "damping")
                own[at] = own.get(at, sp.csr_matrix((r, r))) + shares[signal, number] * A
    for own in found:
        for A in own.values():
            A.eliminate_zeros()
            A.sort_indices()
    return found


def _apart(one: Matrices, other: Matrices) -> list[tuple[float, Matrices]]:
    """Parts of `one`, and the factor by which each is one of `other`, if one or two are all; else nothing.

    Of cylinders that share a place all entries have one factor.  Where a frame turns, entries above and below the
    diagonal have opposite ones: forces along one axis by motions along another one depend on one signal.
    """
    if one.keys() != other.keys() or not one:
        return []
    if any((one[at].indptr != A.indptr).any() or len(one[at].indices) != len(A.indices) for at, A in other.items()):
        return []
    if any((one[at].indices != A.indices).any() for at, A in other.items()):
        return []
    a, b = (np.concatenate([A[at].data for at in one]) for A in (one, other))
    left, found = np.ones(len(a), np.bool_), list[tuple[float, Matrices]]()
    while left.any() and len(found) < 2:
        at = np.argmax(np.abs(a) * left)
        own = left & (np.abs(b - b[at] / a[at] * a) <= NOTHING * np.abs(b).max())
        found.append((float(b[at] / a[at]), _chosen(one, own)))
        left &= ~own
    return [] if left.any() else found


def _chosen(matrices: Matrices, entries: NDArray[np.bool_]) -> Matrices:
    """These entries alone."""
    found, first = {}, 0
    for at, A in matrices.items():
        found[at] = A.copy()
        found[at].data *= entries[first : first + A.nnz]
        found[at].eliminate_zeros()
        first += A.nnz
    return found


def terms(form: SystemForm, matrices: Sequence[Matrices], paths: Sequence[str]) -> Terms:
    """Those of a system, on its modes, of signals with these matrices; without entries where it has none.

    Friction is among them, whose joints slide along `paths`.
    """
    rubbing = friction.rubbing(form, paths)
    r = int(form.starts[-1]) if form.system.terms or (rubbing is not None and len(rubbing.pads)) else 0
    entries, numbers, first_part = _registers(matrices, r)
    known, u = np.unique(numbers, return_inverse=True)
    first = np.searchsorted(known, r * np.arange(2 * (r // LANES) + 1))
    return Terms(
        now=aligned(np.zeros(LANES * len(known))),
        column=known % r,
        of_rows=np.stack([first[:-2:2], first[1::2], first[2::2]], axis=1).astype(np.int64),
        parts=aligned(entries.ravel()),
        first_part=first_part,
        to=LANES * u.astype(np.int64),
        c=np.full(len(matrices), np.nan),
        given=aligned(np.zeros(0 if form.on_tables is None else r)),
        force=aligned(np.zeros(r)),
        new_force=aligned(np.zeros(r)),
        divided=aligned(np.zeros(r)),
        old_force=aligned(np.zeros((4, r))),
        old_z=aligned(np.zeros(r)),
        numbers=np.zeros(7),
        calls=np.zeros(5, np.int64),
        rubbing=rubbing,
        history=history(r + (0 if rubbing is None else len(rubbing.gap)), 0 if rubbing is None else len(rubbing.s)),
    )


def _registers(matrices: Sequence[Matrices], r: int) -> tuple[Array, Indices, Indices]:
    """All registers that are not zero, of one signal after the other: entries (e, 4), numbers (e,), first (J + 1,).

    The numbers are by rows, rate and column: of four rows, those that act on z come before those that act on z'.
    """
    entries, numbers, counts = [np.empty((0, LANES))], [np.empty(0, np.int64)], list[int]()
    for own in matrices:
        count = 0
        for of_rates, A in own.items():
            tall = A.tobsr((LANES, 1))
            rows = np.repeat(np.arange(r // LANES), np.diff(tall.indptr))
            entries.append(tall.data[:, :, 0])
            numbers.append((2 * rows + of_rates) * r + tall.indices)
            count += len(rows)
        counts.append(count)
    return np.concatenate(entries), np.concatenate(numbers), starts(counts)
