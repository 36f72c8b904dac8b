r"""Fixed-point iteration x = phi(x) of a step, sped up by generalized conjugate residuals, compiled.

With residuals :math:`f = \varphi(x) - x` and pairs of directions p and the changes q of the residual along them,
orthonormal among each other, the next x is

.. math:: x + f - \sum_j (q_j^T f)\, (p_j + q_j)

the one that minimises the residual over all x before, and one plain step from there (Eisenstat, Elman, Schultz:
Variational iterative methods for nonsymmetric systems of linear equations, SIAM Journal on Numerical Analysis 20, 1983;
Walker, Ni: Anderson acceleration for fixed-point iterations, SIAM Journal on Numerical Analysis 49, 2011).  Of a linear
phi it ends after as many times as phi' has distinct eigenvalues, however large these are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.compilation import inlined

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Pairs that are stored at most; the next one begins anew, as one that depends on those before does.
PAIRS = 32
#: A change of the residual that is so much smaller than before, without what earlier ones say of it, is round-off.
DEPENDENT = 1e-10
#: Entries of `History.counts`: stored pairs, and whether there is a residual before.
STORED, BEFORE = range(2)


class History(NamedTuple):
    """Iterates of n numbers in a step, of which the first `measured` count in a residual's size."""

    x: Array  # (n,)
    residual: Array  # (n,)
    old_x: Array  # (n,): where the residual was least so far
    old_residual: Array  # (n,): and that residual
    directions: Array  # (PAIRS, n): p
    changes: Array  # (PAIRS, n): q
    counts: Indices  # (2,)
    unit: Array  # (1,): of numbers that are of another kind than the first ones
    measured: int


def history(measured: int, others: int) -> History:
    """Empty history of iterates with so many numbers that are measured, and others that follow them."""
    n = measured + others
    return History(
        x=np.zeros(n),
        residual=np.zeros(n),
        old_x=np.zeros(n),
        old_residual=np.zeros(n),
        directions=np.zeros((PAIRS, n)),
        changes=np.zeros((PAIRS, n)),
        counts=np.zeros(2, np.int64),
        unit=np.ones(1),
        measured=measured,
    )


@inlined
def restart(history: History) -> None:
    """Forget all pairs, as where phi has become another function."""
    history.counts[STORED] = history.counts[BEFORE] = 0


@inlined
def extrapolate(history: History) -> None:
    """Replace `History.x`, the residual of which is given, by the next iterate."""
    x, f = history.x, history.residual
    if history.counts[BEFORE]:
        _add_pair(history)
    history.counts[BEFORE] = 1
    for j in range(history.counts[STORED]):
        share = _inner(history, history.changes[j], f)
        for i in range(len(x)):
            x[i] -= share * history.directions[j, i]
            f[i] -= share * history.changes[j, i]
    for i in range(len(x)):
        history.old_x[i], history.old_residual[i] = x[i], f[i]
        x[i] += f[i]


@inlined
def _add_pair(history: History) -> None:
    """Store the last direction, with its change made orthogonal to the changes before (Gram-Schmidt, twice)."""
    if history.counts[STORED] == len(history.changes):
        history.counts[STORED] = 0
    k = history.counts[STORED]
    p, q = history.directions[k], history.changes[k]
    for i in range(len(p)):
        p[i] = history.x[i] - history.old_x[i]
        q[i] = history.residual[i] - history.old_residual[i]
    size = _inner(history, q, q)
    for _ in range(2):
        for j in range(k):
            share = _inner(history, history.changes[j], q)
            for i in range(len(p)):
                p[i] -= share * history.directions[j, i]
                q[i] -= share * history.changes[j, i]
    left = _inner(history, q, q)
    if left > DEPENDENT**2 * size:
        for i in range(len(p)):
            p[i] /= np.sqrt(left)
            q[i] /= np.sqrt(left)
        history.counts[STORED] += 1
    else:
        history.counts[STORED] = 0


@inlined
def _inner(history: History, a: Array, b: Array) -> float:
    """Inner product of what is measured of two vectors (n,)."""
    total = 0.0
    for i in range(history.measured):
        total += a[i] * b[i]
    return total
