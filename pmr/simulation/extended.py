r"""Products of dense matrices in extended precision, with the arithmetic of double precision.

Each factor is split into its leading bits and the rest, A = A_h + A_l, so few of them that BLAS adds up A_h B_h without
any rounding:

.. math::
    A B = A_h B_h + (A_h B_l + A_l B)

Ozaki, Ogita, Oishi, Rump: Error-free transformations of matrix multiplication by using fast routines of matrix
multiplication and its applications, Numerical Algorithms 59, 2012.  NumPy's own product of longer numbers is a plain
loop: with 366 coordinates it takes eleven times as long.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Long = NDArray[np.longdouble]

#: Columns of A up to which the plain loop is faster.
SMALL = 64


def product(A: Long, B: Long) -> Long:
    """A B (m, n) of A (m, k) and B (k, n).

    Entries are off by some k 2^-73 of the largest entry of A's row times that of B's column, or by the rounding of the
    result where this is more; as `numpy.longdouble` is, where that is no longer than a double.
    """
    if A.shape[1] <= SMALL:
        return A @ B
    bits = (52 - int(np.ceil(np.log2(A.shape[1])))) // 2
    (A_high, A_low), (B_high, B_low) = _split(A, bits, 1), _split(B, bits, 0)
    exact = (A_high @ B_high).astype(np.longdouble)
    return np.asarray(exact + (A_high @ B_low + A_low @ (B_high + B_low)))


def _split(A: Long, bits: int, axis: int) -> tuple[Array, Array]:
    """The leading `bits` of each entry, counted from the largest one along the axis, and the rest."""
    _, exponent = np.frexp(np.abs(A).max(axis=axis, keepdims=True, initial=0.0).astype(float))
    rounds = np.ldexp(1.5, exponent + (52 - bits))
    plain = A.astype(float)
    high = (plain + rounds) - rounds
    return high, (A - high).astype(float)
