r"""Eigenmodes of the full model by SLEPc's Krylov-Schur or block Lanczos, their normalisation and residuals.

Block Lanczos finds the largest eigenvalues, the diagonal matrix :math:`\Theta`, and the eigenvectors, the columns of
:math:`\Phi`, of an operator H that is self-adjoint in the product of the mass M:

.. math::
    H \Phi = \Phi \Theta, \qquad \Phi^T M \Phi = I

A block of right-hand sides costs little more than one right-hand side (`pmr.fem.factor.Factor`).  A block of b columns
finds b vectors of a multiple eigenvalue, where a single column finds one.  Each new column is made M-orthogonal to all
earlier columns twice, so that no converged vector appears again.  Golub and Van Loan: Matrix Computations, 4th ed.,
2013, section 10.3.6.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg

from pmr.errors import ConvergenceError, TooManyModesError
from pmr.fem.compat import MPI, PETSc, SLEPc
from pmr.fem.distributed import fix_signs, inner, subtract, times
from pmr.files.arrays import Array
from pmr.fullmodel.model import FullModel

logger = logging.getLogger(__name__)


#: Columns of a block.  Fifteen modes of a shell of 70,000 coordinates take 72, 100, 144 and 224 columns in blocks of 2,
#: 4, 8 and 16, and their solves 1.08, 0.83, 0.74 and 0.79 s; vector by vector 80 columns took 1.8 s.
BLOCK = 8
#: Residual of an eigenpair over its eigenvalue.  The share of other modes in a mode is about that; it decides if a load
#: that acts on these other modes alone counts as exciting it.
RESIDUAL_TOLERANCE = 1e-15
#: Directions of a block that are shorter than this share of its longest one are left out: round-off decides them.
SPANNED = 1e-8
#: Largest number of blocks.
STEPS = 100


@dataclass(frozen=True)
class Eigenpairs:
    """Eigenvalues `theta` (k,), largest first, and this rank's rows (n_local, k) of the M-orthonormal eigenvectors."""

    theta: Array
    vectors: Array


def largest_eigenpairs(
    apply: Callable[[Array], Array], M: PETSc.Mat, start: Array, count: int, dimension: int
) -> Eigenpairs:
    """Compute the `count` largest eigenvalues theta of H phi = theta phi, with their eigenvectors phi; collective.

    The operator H is self-adjoint in the product of the mass M, in which the vectors are orthonormal.  If the dimension
    of the range of H is less than `count`, all eigenpairs are returned.

    Parameters
    ----------
    apply : callable
        Applies H M^-1 to columns (n_local, b) in Fortran's order and returns new ones, which are overwritten; rows are
        this rank's.
    M : PETSc.Mat
        Mass (n, n).
    start : (n_local, b) array
        First block, in the range of H.
    dimension : int
        Dimension of the range of H.

    Raises
    ------
    ConvergenceError
        If fewer than `count` converge within `STEPS` blocks.
    """
    comm = M.comm.tompi4py()
    room = np.empty((len(start), 16 * (count + start.shape[1])), order="F")  # memory is provided as columns are filled
    T, filled = np.empty((0, 0)), 0
    rough = _orthonormalise(start, times(M, start), comm, dimension)
    block = _orthonormalise(rough.vectors, times(M, rough.vectors), comm, dimension)
    for _ in range(STEPS):
        filled += block.vectors.shape[1]
        if filled > room.shape[1]:
            room = np.concatenate([room.T, np.empty_like(room.T)]).T
        Q = room[:, :filled]
        Q[:, len(T) :] = block.vectors
        near = slice(max(0, filled - 2 * start.shape[1]), filled)
        W = apply(block.dual)
        overlap = inner(Q[:, near], times(M, W), comm)  # H W is orthogonal by itself to all blocks before the last two
        T = _border(T, overlap)
        subtract(W, Q[:, near], overlap)
        rough = _orthonormalise(W, times(M, W), comm, dimension - filled)
        W = rough.vectors
        subtract(W, Q, inner(Q, rough.dual, comm))
        block = _orthonormalise(W, times(M, W), comm, dimension - filled)
        theta, S = np.linalg.eigh(T)
        theta, S = theta[::-1][:count], S[:, ::-1][:, :count]
        exhausted = block.vectors.shape[1] == 0
        residual = np.linalg.norm(rough.lengths @ S[-len(rough.lengths) :], axis=0)
        if exhausted or (len(theta) == count and np.all(residual <= RESIDUAL_TOLERANCE * np.abs(theta))):
            return Eigenpairs(theta, np.asfortranarray(Q @ S))
    raise ConvergenceError(
        f"block Lanczos: not all of {count} eigenpairs converged to {RESIDUAL_TOLERANCE:g} within {STEPS} blocks of "
        f"{start.shape[1]}; ask for fewer modes, refine the mesh or choose solver = dense"
    )


@dataclass(frozen=True)
class _Block:
    """M-orthonormal columns that span a block of columns W (n_local, b), with the mass M.

    `vectors` X (n_local, c) are these columns; directions of W that are too short are left out.  `dual` (n_local, c) is
    the product M X.  `lengths` is a matrix L (b, b) with L^T L = W^T M W.
    """

    vectors: Array
    dual: Array
    lengths: Array


def _orthonormalise(W: Array, MW: Array, comm: MPI.Comm, most: int) -> _Block:
    """Return M-orthonormal vectors that span the columns of W (n_local, k), from M W, `MW` (n_local, k); collective.

    The vectors are principal directions of the columns.  Directions shorter than `SPANNED` times the longest are left
    out.  Of the others, at most the `most` longest are taken.  `lengths` (k, k) of the result has a row for each
    direction, from the shortest to the longest, including directions that are left out.  A row has the components of
    the columns of W along its direction.
    """
    values, turned = np.linalg.eigh(inner(W, MW, comm))
    is_spanned = values > SPANNED**2 * np.max(values, initial=0.0)
    is_spanned[: max(0, len(values) - most)] = False
    scaled = turned[:, is_spanned] / np.sqrt(values[is_spanned])
    lengths = (turned * np.sqrt(np.maximum(values, 0.0))).T
    return _Block(np.asfortranarray((scaled.T @ W.T).T), np.asfortranarray((scaled.T @ MW.T).T), lengths)


def _border(T: Array, columns: Array) -> Array:
    """Return the symmetric matrix (k + b, k + b) that has T (k, k), b more columns and, transposed, b more rows.

    `columns` (d, b) are the lowest d >= b rows of the new columns; the rows above them are zero.  The last b rows of
    `columns` are the new block on the diagonal, which is symmetrised.
    """
    d, b = columns.shape
    m = len(T) + b
    result = np.zeros((m, m))
    result[: m - b, : m - b] = T
    result[m - d :, m - b :] = columns
    result[m - b :, m - d :] = columns.T
    corner = columns[d - b :]
    result[m - b :, m - b :] = (corner + corner.T) / 2.0
    return result


#: Tolerance, and largest number of iterations, of Krylov-Schur.
TOLERANCE, ITERATIONS = 1e-13, 500
#: Relative distance of omega^2 below which two modes count as one cluster.
CLUSTER = 1e-7


@dataclass(frozen=True)
class Modes:
    """Modes of a model, k in all: frequencies, shapes and residuals.

    `omega` (k,) are circular frequencies in rad/s, `phi` (n_local, k) this rank's rows of the modes, and `residuals`
    (k,) their backward errors.  Modes are mass-normalised, and the entry of largest magnitude of each mode is positive
    (`pmr.fem.distributed.fix_signs`).
    """

    omega: Array
    phi: Array
    residuals: Array
    is_cut: bool = False  # whether the first mode that is left out has the frequency of the last one

    def warn_if_cut(self, s: float) -> None:
        """Log a warning if only one of two modes with the same frequency is included; to be called on a single rank.

        The path coordinate s in m is for the message.
        """
        if self.is_cut:
            logger.warning(
                "s = %g m: mode %d and the next one have the same frequency; the snapshot holds one of the two. "
                "Ask for one mode more or fewer",
                s,
                len(self.omega),
            )


def lowest_mode_solver(K: PETSc.Mat, M: PETSc.Mat, sigma: float, count: int) -> SLEPc.EPS:
    """Set up SLEPc's Krylov-Schur solver with shift-and-invert at -sigma for the `count` lowest modes of (K, M).

    The caller chooses the preconditioner that factorises K + sigma M.  The start vector is the same on any number of
    ranks.  The vector is random, so that no symmetry makes it orthogonal to a mode.  Collective.
    """
    eps = SLEPc.EPS().create(comm=M.comm)
    eps.setOperators(K, M)
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    eps.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    eps.setTarget(-sigma)
    eps.setDimensions(nev=count)
    eps.setTolerances(TOLERANCE, ITERATIONS)
    st = eps.getST()
    st.setType(SLEPc.ST.Type.SINVERT)
    st.getKSP().setType("preonly")
    start = M.createVecRight()
    first, last = start.getOwnershipRange()
    start.getArray()[:] = np.random.default_rng(7).uniform(0.5, 1.5, start.getSize())[first:last]
    eps.setInitialSpace([start])
    return eps


class SolvedModes(NamedTuple):
    """Eigenvalues omega^2 (k,) in (rad/s)^2, ascending, and the modes as k vectors."""

    omega2: Array
    vectors: list[PETSc.Vec]


def solve_modes(eps: SLEPc.EPS, count: int) -> SolvedModes:
    """Solve `eps` and free it; return the values omega^2 (count,), ascending, and the modes in the same order.

    Collective.  Raises a `ConvergenceError` if fewer than `count` converge.
    """
    eps.solve()
    converged = eps.getConverged()
    if converged < count:
        raise ConvergenceError(
            f"SLEPc: {converged} of {count} eigenpairs converged to {TOLERANCE:g} within "
            f"{eps.getIterationNumber()} iterations; ask for fewer modes, refine the mesh or choose solver = dense"
        )
    omega2, vectors = np.empty(count), []
    for i in range(count):
        vector = eps.getOperators()[0].createVecRight()
        omega2[i] = eps.getEigenpair(i, vector).real
        vectors.append(vector)
    order = np.argsort(omega2, kind="stable")
    eps.destroy()
    return SolvedModes(omega2[order], [vectors[i] for i in order])


def check_count(count: int, dimension: int) -> None:
    """Raise a `TooManyModesError` if `count` modes are requested and only `dimension` exist."""
    if count > dimension:
        raise TooManyModesError(count, dimension)


def are_clustered(a: float, b: float) -> bool:
    """Whether two values of omega^2 differ by at most the share `CLUSTER` of the larger magnitude."""
    return abs(b - a) <= CLUSTER * max(abs(a), abs(b))


def finish_modes(model: FullModel, s: float, omega2: Array, phi: Array, cut: bool) -> Modes:
    """Make modes M-orthonormal, fix their signs and compute their residuals; collective.

    Parameters
    ----------
    s : float, m
        Path coordinate at which the rows are held.
    omega2, phi : (k,) and (n_local, k) arrays
        Squared circular frequencies, and this rank's rows of the k modes.  Negative squares become frequencies of 0.
    cut : bool
        Whether the first mode that is left out has the frequency of the last mode in `phi`.
    """
    comm = model.comm
    if phi.shape[1] == 0:
        return Modes(omega2, phi, omega2, cut)
    # Cholesky instead of norms alone: an iterative solver leaves the modes orthogonal to its tolerance only.
    L = np.linalg.cholesky(inner(phi, times(model.M, phi), comm))
    phi = fix_signs(scipy.linalg.solve_triangular(L, phi.T, lower=True).T, comm)
    return Modes(np.sqrt(np.maximum(omega2, 0.0)), phi, _residuals(model, s, omega2, phi), cut)


def _residuals(model: FullModel, s: float, omega2: Array, phi: Array) -> Array:
    """Backward errors (k,) of k eigenpairs `omega2` (k,), `phi` (n_local, k) at path coordinate s in m; collective.

    The error of a mode is ||K phi - omega^2 M phi|| / ((||K|| + omega^2 ||M||) ||phi||) in infinity norms.  The error
    is 0 if the divisor is 0.  The part of a residual that is in equilibrium with forces on the rows does not count as
    an error.
    """
    comm = model.comm
    first, last = model.M.getOwnershipRange()
    residual = times(model.K, phi) - times(model.M, phi) * omega2
    C = model.rows.at(s)
    touched = np.unique(C.indices)
    dense = C[:, touched].toarray()
    mine = (touched >= first) & (touched < last)
    held = np.zeros((len(touched), len(omega2)))
    held[mine] = residual[touched[mine] - first]
    held = comm.allreduce(held)
    if len(touched):
        balanced = held - dense.T @ np.linalg.lstsq(dense.T, held, rcond=None)[0]
        residual[touched[mine] - first] = balanced[mine]
    norm_K, norm_M = (A.norm(PETSc.NormType.NORM_INFINITY) for A in (model.K, model.M))
    largest = np.array(
        comm.allgather([np.abs(residual).max(axis=0, initial=0.0), np.abs(phi).max(axis=0, initial=0.0)])
    )
    r, p = largest.max(axis=0)
    scale = (norm_K + np.abs(omega2) * norm_M) * p
    return np.divide(r, scale, out=np.zeros_like(r), where=scale > 0.0)  # 0 without any stiffness
