r"""Largest eigenvalues of an operator that is self-adjoint in the mass product, by block Lanczos.

.. math::
    H \Phi = \Phi \Theta, \qquad \Phi^T M \Phi = I

A block of right-hand sides costs little more than one (`pmr.fem.factor.Factor`), and sees each of as many equal
eigenvalues as it has columns, of which a single vector sees one.  Columns are made M-orthogonal to all others, twice
over: none that has converged comes back.  Golub and Van Loan: Matrix Computations, 4th ed., 2013, section 10.3.6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import ConvergenceError
from pmr.fem.compat import PETSc
from pmr.fem.distributed import inner, subtract, times

Array = NDArray[np.float64]

#: Columns of a block.  Fifteen modes of a shell of 70,000 coordinates take 72, 100, 144 and 224 columns in blocks of 2,
#: 4, 8 and 16, and their solves 1.08, 0.83, 0.74 and 0.79 s; vector by vector 80 columns took 1.8 s.
BLOCK = 8
#: Residual of an eigenpair over its eigenvalue.  What a mode has of others is about that, and decides whether a load
#: that acts on the others alone is said to excite it.
TOLERANCE = 1e-15
#: Directions of a block that are shorter than this share of its longest one are left out: round-off decides them.
SPANNED = 1e-8
#: Blocks at most.
STEPS = 100


@dataclass(frozen=True)
class Pairs:
    """Eigenvalues (k,), the largest first, and this rank's rows of the vectors (n_local, k), M-orthonormal."""

    theta: Array
    vectors: Array


def largest(apply: Callable[[Array], Array], M: PETSc.Mat, start: Array, count: int, dimension: int) -> Pairs:
    """The `count` largest eigenvalues of H, fewer if the space has no more; collective.

    Parameters
    ----------
    apply : callable
        H M^-1 on columns (n_local, b), in Fortran's order like its answer; both are this rank's rows.
    M : PETSc.Mat
    start : (n_local, b) array
        The first block, in the range of H; overwritten.
    dimension : int
        Of the range of H.

    Raises
    ------
    ConvergenceError
        If fewer converge.
    """
    comm = M.comm.tompi4py()
    room = np.empty((len(start), 16 * (count + start.shape[1])), order="F")  # memory is taken as it fills
    T, filled = np.empty((0, 0)), 0
    rough = _orthonormal(start, times(M, start), comm, dimension)
    block = _orthonormal(rough.vectors, times(M, rough.vectors), comm, dimension)
    for _ in range(STEPS):
        filled += block.vectors.shape[1]
        if filled > room.shape[1]:
            room = np.concatenate([room.T, np.empty_like(room.T)]).T
        Q = room[:, :filled]
        Q[:, len(T) :] = block.vectors
        near = slice(max(0, filled - 2 * start.shape[1]), filled)
        W = apply(block.dual)
        overlap = inner(Q[:, near], times(M, W), comm)  # to all blocks before the last two H W is orthogonal by itself
        T = _grown(T, overlap)
        subtract(W, Q[:, near], overlap)
        rough = _orthonormal(W, times(M, W), comm, dimension - filled)
        W = rough.vectors
        subtract(W, Q, inner(Q, rough.dual, comm))
        block = _orthonormal(W, times(M, W), comm, dimension - filled)
        theta, S = np.linalg.eigh(T)
        theta, S = theta[::-1][:count], S[:, ::-1][:, :count]
        exhausted = block.vectors.shape[1] == 0
        residual = np.linalg.norm(rough.lengths @ S[-len(rough.lengths) :], axis=0)
        if exhausted or (len(theta) == count and np.all(residual <= TOLERANCE * np.abs(theta))):
            return Pairs(theta, np.asfortranarray(Q @ S))
    raise ConvergenceError(
        f"block Lanczos: not all of {count} eigenpairs converged to {TOLERANCE:g} within {STEPS} blocks of "
        f"{start.shape[1]}; ask for fewer modes, refine the mesh or choose solver = dense"
    )


@dataclass(frozen=True)
class _Block:
    """M-orthonormal columns X that span W but for what is too short, and M X; L with L^T L = W^T M W."""

    vectors: Array
    dual: Array
    lengths: Array


def _orthonormal(W: Array, MW: Array, comm: Any, most: int) -> _Block:
    """W M-orthonormalised: `most` directions at most, the longest ones."""
    values, turned = np.linalg.eigh(inner(W, MW, comm))
    is_spanned = values > SPANNED**2 * np.max(values, initial=0.0)
    is_spanned[: max(0, len(values) - most)] = False
    scaled = turned[:, is_spanned] / np.sqrt(values[is_spanned])
    lengths = (turned * np.sqrt(np.maximum(values, 0.0))).T
    return _Block(np.asfortranarray((scaled.T @ W.T).T), np.asfortranarray((scaled.T @ MW.T).T), lengths)


def _grown(T: Array, columns: Array) -> Array:
    """The symmetric matrix T with more columns, of which the last entries (d, b) are given and the others are zero."""
    d, b = columns.shape
    m = len(T) + b
    result = np.zeros((m, m))
    result[: m - b, : m - b] = T
    result[m - d :, m - b :] = columns
    result[m - b :, m - d :] = columns.T
    corner = columns[d - b :]
    result[m - b :, m - b :] = (corner + corner.T) / 2.0
    return result
