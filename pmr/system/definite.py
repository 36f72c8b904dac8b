"""Small matrices: positive definite or not any more, rows that depend on each other, frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.reduced.soundness import pivoted_root

Array = NDArray[np.float64]

#: What is missing from a matrix L L^T as a share of it that is round-off.
ROUND_OFF = 1e-9
#: Share of a load that is known nearly by which less of it is where the search begins.
BESIDE = 1e-2
#: Steps of it, the share by which the last may change the load, and that by which the load has to be lower.
MOST_STEPS, SETTLED, BELOW = 30, 1e-12, 1e-6


def root(A: Array) -> Array | None:
    """L (n, r) of a positive semidefinite A = L L^T (n, n), by Cholesky with pivots; None where A is not.

    For any L, :math:`|A - L L^T|_F` is at least as large as the least eigenvalue is negative.
    """
    L = pivoted_root(A)
    return L if np.linalg.norm(A - L @ L.T) <= ROUND_OFF * np.linalg.norm(A) else None


class Free:
    """Motions that rows C (c, n) leave free: an orthonormal basis (n, r) of them, and matrices on it.

    By Householder's reflections, one for each row, so that no products of full matrices are needed.
    """

    def __init__(self, C: Array) -> None:
        self._reflections, _, self._scales, _, _ = scipy.linalg.lapack.dgeqp3(C.T)
        size = np.abs(np.diagonal(self._reflections))
        self._held = int(np.sum(size > max(C.shape) * np.finfo(float).eps * size.max(initial=0.0)))

    @property
    def basis(self) -> Array:
        return self._behind(np.eye(len(self._reflections)))[:, self._held :]

    def on(self, A: Array) -> Array:
        """Z^T A Z (r, r) of a symmetric matrix A (n, n)."""
        return self._behind(self._behind(A).T)[self._held :, self._held :]

    def _behind(self, A: Array) -> Array:
        """A (k, n) times the basis behind the directions that are held."""
        if not len(self._scales):
            return A
        rotated, *_ = scipy.linalg.lapack.dormqr("R", "N", self._reflections, self._scales, A, 64 * len(A))
        return np.asarray(rotated)


def first_singular(A: Array, B: Array, near: float = np.nan, up_to: float = np.inf) -> float:
    """The least P > 0 at which A + P B is not positive definite any more; 0 where A is not, infinite where none is.

    One that is above `up_to` need not be found, and is infinite then.  Where it is known to be `near` a load, it is
    found by inverse iteration from a little below that, and counts where the matrix is definite a little below what is
    found: since A is, it is so everywhere before.
    """
    A, B = (A + A.T) / 2.0, (B + B.T) / 2.0
    if not definite(A):
        return 0.0
    if 0.0 < near < np.inf and (load := _singular_above(A, B, near * (1.0 - BESIDE))) is not None:
        return load
    if np.isfinite(up_to) and definite(A + up_to * B):
        return np.inf
    try:
        least = float(scipy.linalg.eigh(B, A, eigvals_only=True, subset_by_index=(0, 0))[0])
    except np.linalg.LinAlgError:
        return 0.0
    return -1.0 / least if least < 0.0 else np.inf


def _singular_above(A: Array, B: Array, low: float) -> float | None:
    """The first singular load above `low`, of a definite A; None where A + low B is not, or where none settles."""
    factor, failed = scipy.linalg.lapack.dpotrf(A + low * B, lower=1)
    if failed:
        return None
    x, last = np.cos(np.arange(len(A), dtype=float)), np.inf  # has a part of every shape
    for _ in range(MOST_STEPS):
        b = -(B @ x)
        x, _ = scipy.linalg.lapack.dpotrs(factor, b, lower=1)
        # Rayleigh's quotient of -B x = (A + low B) x / (P - low)
        pressed = -float(x @ B @ x)
        if not pressed > 0.0:
            return None
        load = low + float(b @ x) / pressed
        if abs(load - last) <= SETTLED * load:
            return load if definite(A + load * (1.0 - BELOW) * B) else None
        last, x = load, x / np.linalg.norm(x)
    return None


def definite(A: Array) -> bool:
    """Whether a symmetric matrix is positive definite, by Cholesky."""
    return bool(scipy.linalg.lapack.dpotrf(A, lower=1, clean=0)[1] == 0)


def oscillations(M: Array, V: Array | None, K: Array) -> Array:
    """Omega (n,) rad/s of M q'' + V q' + K q = 0 with an antisymmetric V, ascending; zero where K does not hold.

    With modes of K, of rates z' and strains omega z the equations are antisymmetric, (0, W; -W, -V): round-off stays
    that of the largest omega, not of its square.
    """
    if V is None or not np.any(V):
        return np.sqrt(np.maximum(scipy.linalg.eigh(K, M, eigvals_only=True), 0.0))
    omega2, X = scipy.linalg.eigh(K, M)
    W = np.diag(np.sqrt(np.maximum(omega2, 0.0)))
    turning = np.block([[np.zeros_like(W), W], [-W, -X.T @ V @ X]])
    return np.asarray(np.abs(scipy.linalg.eigvalsh(1j * (turning - turning.T) / 2.0)[len(W) :]))


#: A row takes part in a dependence if its share is at least this part of the largest one.
TAKES_PART = 1e-2


@dataclass(frozen=True)
class Dependence:
    """How independent rows are: `measure` is 1 for rows that share nothing and 0 for dependent ones; `names` of these.

    Of rows whose combination all but vanishes, only those are named that take part in it.
    """

    measure: float
    names: tuple[str, ...]


def dependence_of_rows(C: Array, names: Sequence[str]) -> Dependence:
    """Smallest singular value of the rows (m, r) scaled to unit length; a row that vanishes depends on nothing else."""
    size = np.linalg.norm(C, axis=1)
    if not size.all():
        return Dependence(0.0, tuple(name for name, length in zip(names, size, strict=True) if length == 0.0))
    U, sigma, _ = np.linalg.svd(C / size[:, None], full_matrices=True)
    measure = float(sigma[-1]) if len(sigma) == len(C) else 0.0
    return Dependence(measure, _involved_names(U[:, -1], names))


def dependence_of_flexibility(F: Array, names: Sequence[str]) -> Dependence:
    """Smallest eigenvalue of a symmetric flexibility (m, m) scaled to a unit diagonal."""
    diagonal = np.diagonal(F)
    if not np.all(diagonal > 0.0):
        return Dependence(0.0, tuple(name for name, d in zip(names, diagonal, strict=True) if not d > 0.0))
    scale = np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(F / np.outer(scale, scale))
    return Dependence(float(values[0]), _involved_names(vectors[:, 0], names))


def _involved_names(shares: Array, names: Sequence[str]) -> tuple[str, ...]:
    large = np.abs(shares) >= TAKES_PART * np.abs(shares).max()
    return tuple(name for name, takes_part in zip(names, large, strict=True) if takes_part)
