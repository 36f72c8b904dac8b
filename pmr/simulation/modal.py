r"""Modal form of a sliding body: M and K are diagonalised simultaneously, and the moving rows are transformed.

.. math::
    K X = M X \Omega^2, \qquad X^T M X = I, \qquad q = X z

with coordinates q, modes X, circular frequencies in the diagonal of :math:`\Omega` and modal coordinates z.  M, K and D
of a sliding body never change, so they are diagonalised once; only the m rows change from step to step.

Also products of dense matrices in extended precision, with the arithmetic of double precision.  Each factor is split
into its leading bits and the remainder, A = A_h + A_l, with so few leading bits that BLAS adds up A_h B_h without any
rounding:

.. math::
    A B = A_h B_h + (A_h B_l + A_l B)

Ozaki, Ogita, Oishi, Rump: Error-free transformations of matrix multiplication by using fast routines of matrix
multiplication and its applications, Numerical Algorithms 59, 2012.  NumPy's own product of longer numbers is a plain
loop: with 366 coordinates it takes eleven times as long.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.simulation.start import InitialState, dense
from pmr.system.body import SlidingBody, project
from pmr.system.body_matrices import Rayleigh, symmetric_part
from pmr.system.reduced_model import ReducedModel

Long = NDArray[np.longdouble]

#: Columns of A up to which NumPy's plain loop is faster.
SMALL = 64


def product(A: Long, B: Long) -> Long:
    """Product A B (m, n) of A (m, k) and B (k, n) in extended precision.

    The error of an entry is about k 2^-73 times the largest entries of A's row and of B's column, or the rounding of
    the result if that is larger.  If `numpy.longdouble` is no longer than a double, the precision is that of a double.
    """
    if A.shape[1] <= SMALL:
        return A @ B
    bits = (52 - int(np.ceil(np.log2(A.shape[1])))) // 2
    (A_high, A_low), (B_high, B_low) = _split(A, bits, 1), _split(B, bits, 0)
    exact = (A_high @ B_high).astype(np.longdouble)
    return np.asarray(exact + (A_high @ B_low + A_low @ (B_high + B_low)))


def _split(A: Long, bits: int, axis: int) -> Array:
    """Split each entry of A (m, k) into its leading `bits` and the rest: two arrays of doubles in one array (2, m, k).

    The bits are counted from the leading one of the largest entry along `axis`.
    """
    _, exponent = np.frexp(np.abs(A).max(axis=axis, keepdims=True, initial=0.0).astype(float))
    rounds = np.ldexp(1.5, exponent + (52 - bits))
    plain = A.astype(float)
    high = (plain + rounds) - rounds
    return np.array([high, (A - high).astype(float)])


#: Coordinates up to which a body is diagonalised densely.
LARGEST = 3000
#: Modes are not rotated if their eigenvalues differ by at most this many times their coupling: any mixture is valid.
CLOSE = 1e3
#: Largest difference of a damping matrix from a sum of multiples of M and K, as a share, with which it is Rayleigh's
#: (differences by round-off: 3e-12 for a shell of 18,000 coordinates, 6e-10 for a solid of 20,000).
CLASSICAL = 1e-8
#: Any other damping couples modes if its entries between them exceed this share, and exceed what `ERROR`, the error of
#: the modes themselves, causes.
COUPLED, ERROR = 1e-9, 1e-10


@dataclass(frozen=True)
class ModalForm:
    """A body in its natural modes, without the coordinates that supports hold."""

    # with M = I, K = diag(omega^2) in (rad/s)^2, and D diagonal if damping is classical; without those rows of the
    # original body that only hold one coordinate
    body: ReducedModel
    X: Array  # q = X z (n, r); zero in the coordinates that are held
    inverse: Array  # X^T M (r, n): z = X^T M q
    rows: tuple[int, ...]  # indices of the rows of `body` among the rows of the original body

    @property
    def omega2(self) -> Array:
        """Squares (r,) in (rad/s)^2 of the body's natural circular frequencies without its contacts.

        The squares are ascending; those of coordinates without inertia come last.
        """
        return np.diagonal(self.body.K)

    def start(self, initial: InitialState) -> InitialState:
        """Return the state `initial` of the original body in modal coordinates: coordinates and rates (r,)."""
        return InitialState(self.inverse @ initial.q, self.inverse @ initial.v)


def modal_form(body: SlidingBody) -> ModalForm:
    """Diagonalise M and K of a reduced body, or of a full one with at most `LARGEST` coordinates.

    Coordinates without inertia, which are modes already, are not changed and come after all others.  Raises InputError
    if M is not positive definite, or the body is too large.  Coordinates that supports hold, and the rows of these, are
    left out.  The damping is made modal.
    """
    if body.size > LARGEST:
        allowed = f"the body has {body.size} coordinates, up to {LARGEST} are diagonalised; reduce it first"
        raise InputError("scene", "simulation.simulators", "march", allowed)
    free = np.setdiff1d(np.arange(body.size), list(body.held.values()))
    free_rows = [row for row in range(len(body.row_names)) if row not in body.held]
    M, D, K = (dense(A)[np.ix_(free, free)] for A in (body.M, body.D, body.K))
    still, law = np.isin(free, body.quasi_static), body.rayleigh
    moving, count = np.flatnonzero(~still), int(still.sum())
    omega2, modes = np.zeros(len(free)), np.zeros_like(M)
    inner = len(free) - count
    omega2[:inner], modes[moving, :inner] = diagonalise(*(A[np.ix_(moving, moving)] for A in (M, K)))
    omega2[inner:], modes[still, inner:] = np.diagonal(K)[still], np.eye(count)
    X = np.zeros((body.size, len(free)))
    X[free] = modes
    modal = replace(
        project(body, X).with_rows(free_rows),
        M=np.eye(len(free)),
        D=modal_damping(D, D if law is None else D - law.alpha * M - law.beta * K, omega2, modes, law),
        K=np.diag(omega2),
        quasi_static=np.arange(inner, len(free)),
    )
    return ModalForm(modal, X, np.asarray((body.M @ X).T), tuple(free_rows))


class Modes(NamedTuple):
    """Eigenvalues omega^2 (r,) in (rad/s)^2, and modes X (n, r) as columns."""

    omega2: Array
    X: Array


def diagonalise(M: Array, K: Array) -> Modes:
    """Eigenvalues omega^2 (r,), ascending, and modes X (r, r) with X^T M X = I and X^T K X = diag(omega^2).

    M and K are (r, r) and symmetric.  LAPACK leaves in the low eigenvalues an error of the machine precision times the
    largest eigenvalue.  In a fine beam this error would give a rigid rotation a stiffness and low modes a relative
    error of 1e-7.  Corrections to first order in the remaining couplings bring all pairs to round-off.  Their products
    are in extended precision if the machine has it (Ogita, Aishima: Iterative refinement for symmetric eigenvalue
    decomposition, Japan Journal of Industrial and Applied Mathematics 35, 2018).  An InputError is raised if M is not
    positive definite.
    """
    try:
        _, X = scipy.linalg.eigh(K, M)
    except scipy.linalg.LinAlgError:
        allowed = "a mass matrix that is positive definite is allowed"
        raise InputError("body", "M", None, allowed) from None
    M_long, K_long = ((A.astype(np.longdouble) + A.T) / 2.0 for A in (M, K))
    for _ in range(2):
        omega2, X = _refine_modes(M_long, K_long, X)
    order = np.argsort(omega2)
    return Modes(omega2[order], np.ascontiguousarray(X[:, order]))


def _refine_modes(M: Array, K: Array, X: Array) -> Modes:
    """Eigenvalues (r,) and modes (r, r) of M and K, from X (r, r), modes with errors, by a correction of first order.

    Products are in the precision of M and K (r, r).  The correction E has two parts.  Its antisymmetric part A turns
    modes, and has the couplings divided by gaps between eigenvalues.  Its symmetric part scales modes by half the
    defect from orthonormality.  Gaps between rigid motions are round-off, so couplings are made symmetric before the
    division.  Otherwise their asymmetric part, divided by such a gap, would cause an error of 1e-11 in X^T M X.  The
    modes are multiplied by I + E + E^2 / 2, which causes an error of A^4 / 4 in X^T M X.  The factor I + E would cause
    A^T A, and A may be as large as 1 / CLOSE.
    """
    X = X.astype(M.dtype)
    defect = np.asarray(symmetric_part(np.eye(len(M)) - product(X.T, product(M, X))), float)  # of X^T M X from I
    S = np.asarray(symmetric_part(product(X.T, product(K, X))), float)
    omega2 = np.diagonal(S) / (1.0 - np.diagonal(defect))
    coupling = S - np.diag(np.diagonal(S))
    gap = omega2[None, :] - omega2[:, None]
    near = np.abs(gap) <= CLOSE * (np.abs(coupling) + np.abs(omega2) * np.abs(defect))  # first order fails
    with np.errstate(divide="ignore", invalid="ignore"):
        correction = np.where(near, defect / 2.0, (coupling + omega2[None, :] * defect) / gap)
    correction += correction @ correction / 2.0
    return Modes(omega2, np.asarray(X + product(X, correction.astype(M.dtype)), float))


def modal_damping(D: Array, remainder: Array, omega2: Array, X: Array, rayleigh: Rayleigh | None) -> Array:
    """Matrix X^T D X (r, r) for r modes X (n, r), exactly diagonal if damping is Rayleigh's or couples no modes.

    Couplings that are round-off count as none.  `omega2` (r,) are the squared frequencies of the modes.  `remainder`
    (n, n) is D - alpha M - beta K, with alpha and beta of the `rayleigh` damping.  If `rayleigh` is None, `remainder`
    is D itself.
    """
    classical = np.zeros_like(omega2) if rayleigh is None else rayleigh.modal_damping(omega2)
    if np.linalg.norm(remainder) <= CLASSICAL * np.linalg.norm(D):
        return np.diag(classical)
    modal = X.T @ remainder @ X
    scales, all_of = np.sqrt(np.abs(np.diagonal(modal))), np.abs(modal).sum(axis=0)
    coupled = np.abs(modal) > COUPLED * np.outer(scales, scales) + ERROR * (all_of[:, None] + all_of)
    if not np.any(np.triu(coupled | coupled.T, 1)):
        modal = np.diag(np.diagonal(modal))
    return modal + np.diag(classical)
