"""Modes of the full model at one path coordinate: orthonormal, with fixed signs, and how well they solve for it."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.errors import ConvergenceError, TooManyModesError
from pmr.fem.compat import PETSc, SLEPc
from pmr.fem.distributed import fix_signs, inner, times
from pmr.fullmodel.model import FullModel

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)

#: Of the Krylov sequences.
TOLERANCE, ITERATIONS = 1e-13, 500
#: Relative distance of omega^2 below which two modes count as one cluster.
CLUSTER = 1e-7


@dataclass(frozen=True)
class Modes:
    """Circular frequencies (k,) rad/s, this rank's rows of the modes (n_local, k), and residuals (k,).

    Modes are mass-normalised; their entry of largest magnitude is positive (`pmr.fem.distributed.fix_signs`).
    """

    omega: Array
    phi: Array
    residuals: Array


def lowest_of(K: PETSc.Mat, M: PETSc.Mat, sigma: float, count: int) -> SLEPc.EPS:
    """Krylov-Schur with shift-and-invert for the `count` lowest modes of (K, M); -sigma is the shift.

    It begins with a vector that is the same on any number of ranks, and along no direction of symmetry.
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


def solve_modes(eps: SLEPc.EPS, count: int) -> tuple[Array, list[PETSc.Vec]]:
    """Solve; omega^2 (count,) in ascending order, and the modes.

    Raises a `ConvergenceError` if fewer converge.
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
    return omega2[order], [vectors[i] for i in order]


def check_count(count: int, dimension: int) -> None:
    """Refuse to look for more modes than there are.

    Raises a `TooManyModesError` with both numbers.
    """
    if count > dimension:
        raise TooManyModesError(count, dimension)


def are_clustered(a: float, b: float) -> bool:
    """Whether omega^2 of two modes differ by round-off alone."""
    return abs(b - a) <= CLUSTER * max(abs(a), abs(b))


def finish_modes(model: FullModel, s: float, omega2: Array, phi: Array, cut: bool) -> Modes:
    """Make the modes M-orthonormal, fix signs, measure residuals."""
    if cut:
        logger.warning(
            "s = %g m: mode %d and the next one have the same frequency; the snapshot holds one of the two. "
            "Ask for one mode more or fewer",
            s,
            len(omega2),
        )
    comm = model.comm
    if phi.shape[1] == 0:
        return Modes(omega2, phi, omega2)
    # Cholesky instead of norms alone: an iterative solver leaves the modes orthogonal to its tolerance only.
    L = np.linalg.cholesky(inner(phi, times(model.M, phi), comm))
    phi = fix_signs(scipy.linalg.solve_triangular(L, phi.T, lower=True).T, comm)
    return Modes(np.sqrt(np.maximum(omega2, 0.0)), phi, _residuals(model, s, omega2, phi))


def _residuals(model: FullModel, s: float, omega2: Array, phi: Array) -> Array:
    """Backward errors of the eigenpairs; the rows' reactions, which balance the rest, are projected out."""
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
    return np.asarray(r / ((norm_K + np.abs(omega2) * norm_M) * p))
