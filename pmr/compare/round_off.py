"""Bounds on the round-off of displacements, forces and probes, and signals without it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.files.arrays import Array
from pmr.simulation.start import dense
from pmr.system.body import SlidingBody, force_outputs, length_outputs, other_outputs, released_rows

#: Share of a displacement or force that may remain as round-off if its contributions cancel: tens of thousands of units
#: of double precision.  BLAS routines leave up to 1.6e-12 of a displacement.
ROUND_OFF = 1e-11

#: Stiffness in N/m that makes a held coordinate rigid.
HOLDS = 1e300

#: Largest number of coordinates of a body whose round-off is bounded: this takes a dense matrix.
LARGEST_COMPLIANCE = 500


def largest_absolute(values: Array, axis: int | None = 0) -> Any:
    """Largest absolute value of `values` (any shape) along `axis`; NaN if an entry is NaN.

    An `axis` of 0 stands for each column, None for all entries.  The value is computed from maximum and minimum, which
    saves the memory of an array of absolute values.
    """
    return np.maximum(values.max(axis=axis, initial=0.0), -values.min(axis=axis, initial=0.0))


class Pair(NamedTuple):
    """A signal and its reference, (T, o) or (T,) each, in the same unit."""

    signal: Array
    reference: Array


def zero_round_off(signal: Array, reference: Array, round_off: float | Array) -> Pair:
    """`signal` and `reference` (T, o), each with zeros in those of its columns that do not exceed `round_off`.

    A reference that is nothing but round-off thus counts as zero.  `round_off` is one value, or one for each column
    (o,), in the unit of the signals.  Signal and reference may also be a single output (T,).
    """

    def clear_columns(values: Array) -> Array:
        """Copy of `values` (T, o) with zeros in columns of round-off; columns with NaN stay."""
        still = largest_absolute(values) <= round_off
        return np.where(still, 0.0, values) if np.any(still) else values

    return Pair(clear_columns(signal), clear_columns(reference))


def round_off(bodies: Mapping[str, SlidingBody], loads: Array, end: float) -> float:
    r"""Largest displacement in m that may be nothing but round-off, if loads (T, i) in N act for `end` seconds.

    .. math:: 10^{-11} \max_o \lVert O_o^T \rVert \sum_i \lVert B_i \rVert \max_t |f_i|, \qquad
        \lVert x \rVert^2 = x^T \big(K + (2 \pi / t_e)^2 M\big)^{-1} x

    with the row :math:`O_o` of each displacement output, the column :math:`B_i` of each of the i inputs, its load
    :math:`f_i`, stiffness K, mass M and :math:`t_e` = `end`.

    By the inequality of Cauchy and Schwarz, the product bounds the effect of the loads on an output of the bodies with
    released contacts, in any coordinates.  Round-off is a share of this effect, even if a slider cancels the
    displacement, or if loads along the axis don't bend the body at all.  The result is linear in the loads, so that no
    motion counts as round-off because the loads are small.  The result is 0 if a body has more than
    `LARGEST_COMPLIANCE` coordinates.
    """
    return float(ROUND_OFF * _largest_motions(bodies, loads, end, length_outputs).max(initial=0.0))


def probe_round_off(bodies: Mapping[str, SlidingBody], loads: Array, end: float) -> Array:
    """Round-off (k,), as in `round_off`, of each of k probes under `loads` for `end` seconds, in its own unit.

    Probes are outputs of the `bodies` that are neither in m nor in N.
    """
    return ROUND_OFF * _largest_motions(bodies, loads, end, other_outputs)


def _largest_motions(
    bodies: Mapping[str, SlidingBody], loads: Array, end: float, select: Callable[[SlidingBody], NDArray[np.bool_]]
) -> Array:
    """Bound (o,) on each of o selected outputs, in its unit, under loads (T, i) in N for `end` seconds.

    `select` returns the mask of the selected outputs of a body.  All bounds are 0 if one of the `bodies` has more than
    `LARGEST_COMPLIANCE` coordinates.
    """
    sizes, reach, first = list[Array](), 0.0, 0
    for body in bodies.values():
        chosen, last = select(body), first + body.B.shape[1]
        A = _dynamic_stiffness(body, end)
        reach += np.inf if A is None else _load_norm(A, body, loads[:, first:last])
        sizes.append(np.zeros(np.count_nonzero(chosen)) if A is None else _norms(A, dense(body.outputs)[chosen]))
        first = last
    sizes_of_outputs = np.concatenate(sizes)
    return sizes_of_outputs * reach if np.isfinite(reach) else np.zeros_like(sizes_of_outputs)


def force_round_off(body: SlidingBody, loads: Array, end: float, s: float) -> float:
    r"""Largest force in N that may be nothing but round-off in a body under loads (T, i) in N for `end` seconds.

    The force is bounded as in `round_off`, for the outputs that are forces and for the multipliers of the rows that
    move or only push.  With the inputs B and their loads f, the force of a row is at most

    .. math:: \lVert B \rVert |f| / \sqrt{\lVert C^T \rVert^2 + G + 1/k}

    (norms as in `round_off`).  C is the row and G its residual flexibility at the path coordinate s in m, and k is the
    row's stiffness.  `ROUND_OFF` times this bound is the result.  The result is 0 if the body has more than
    `LARGEST_COMPLIANCE` coordinates.
    """
    if (A := _dynamic_stiffness(body, end)) is None:
        return 0.0
    rows = released_rows(body)
    C = dense(body.C(s))[rows]
    give = _norms(A, C) ** 2 + np.asarray(body.row_compliance)[rows]
    if body.flexibility is not None:
        give = give + np.diag(body.flexibility.rows(s))[rows]
    stiff = 1.0 / np.sqrt(give[give > 0.0])
    forces = _norms(A, dense(body.outputs)[force_outputs(body)])
    return float(ROUND_OFF * np.concatenate([stiff, forces]).max(initial=0.0) * _load_norm(A, body, loads))


def _dynamic_stiffness(body: SlidingBody, end: float) -> Array | None:
    """Matrix K + (2 pi / end)^2 M (n, n) with held coordinates made rigid.

    The result is None if the body has more than `LARGEST_COMPLIANCE` coordinates, or unless `end` in s is positive.
    """
    if body.size > LARGEST_COMPLIANCE or not end > 0.0:
        return None
    stiffness = dense(body.K + (2.0 * np.pi / end) ** 2 * body.M)
    held = list(body.held.values())
    stiffness[held] = stiffness[:, held] = 0.0
    stiffness[held, held] = HOLDS
    return stiffness


def _norms(A: Array, rows: Array) -> Array:
    """Norms sqrt(x A^-1 x^T) (r,) of the rows x of `rows` (r, n), with the symmetric matrix A (n, n)."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("rn,nr->r", rows, np.linalg.solve(A, rows.T)), 0.0)))


def _load_norm(A: Array, body: SlidingBody, loads: Array) -> float:
    """Sum over the inputs of the largest absolute value of `loads` (T, i) times the norm of the input's column of B.

    The norm is that of `_norms` with the matrix A.
    """
    return float(_norms(A, np.asarray(body.B).T) @ np.abs(loads).max(axis=0, initial=0.0))
