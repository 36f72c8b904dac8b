r"""Proper orthogonal decomposition of a snapshot pool.

.. math::
    S = V \Sigma W^T, \qquad V^T X V = I, \qquad
    \kappa(r) = \sum_{i \le r} \sigma_i^2 \Big/ \sum_i \sigma_i^2

with X = I (the paper) or X = M.  The Gram matrix S^T X S is never formed: it would square the condition and lose the
singular values below sqrt(eps) sigma_1.  Instead S = Q R with Q^T X Q = I, and R, of size k only, is decomposed by
LAPACK.  Volkwein: Model Reduction using Proper Orthogonal Decomposition, 2011, section 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.fem.compat import PETSc
from pmr.fem.distributed import fix_signs, inner, subtract, tall, times
from pmr.fem.matrices import gather
from pmr.fullmodel.eigensolvers import is_dense
from pmr.fullmodel.model import FullModel
from pmr.reduction.snapshots import Snapshots

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Basis:
    """A global basis."""

    V: PETSc.Mat  # dense (n, r), orthonormal in `product`; the largest entry of each column is positive
    sigma: Array  # (k,): all singular values of the pool, descending
    product: str  # ``"euclidean"`` or ``"mass"``

    @property
    def size(self) -> int:
        """Number of basis vectors r."""
        return int(self.V.getSize()[1])

    @property
    def accuracy(self) -> float:
        """Round-off to expect in the last vector, eps sigma_1 / sigma_r: what the pool knows exactly (zeros at a
        support, say) holds in V to about this.
        """
        return float(np.finfo(float).eps * self.sigma[0] / self.sigma[self.size - 1])

    def kappa(self, r: int | None = None) -> float:
        """Share of the pool's squared norm that the first r vectors hold (by default all of this basis)."""
        return kappa(self.sigma, self.size if r is None else r)


def kappa(sigma: Array, r: int) -> float:
    """Benner, Gugercin, Willcox 2015, section 3.1; the complement is summed, so that 1 - kappa keeps its digits."""
    squares = np.sort(sigma**2)
    return float(1.0 - squares[: len(sigma) - r].sum() / squares.sum())


def pod(
    model: FullModel,
    snapshots: Snapshots,
    size: int | None,
    product: str = "euclidean",
    solver: str = "auto",
    rigid_count: int = 0,
) -> Basis:
    """POD of a pool, truncated to `size` vectors; collective.

    Parameters
    ----------
    model : FullModel
        Gives the mass matrix for ``product = "mass"``.
    size : int or None
        r, at most the numerical rank of the pool; None for as many.
    product : ``"euclidean"`` or ``"mass"``
    solver : ``"auto"``, ``"dense"`` or ``"slepc"``
        LAPACK on rank 0 (reproducible), or Gram-Schmidt on the distributed matrix.  ``auto`` takes what the snapshots'
        solver would.
    beside : int
        Vectors that stand before these in the user's count of coordinates.

    Raises
    ------
    InputError
        If `size` exceeds the numerical rank of the pool.
    """
    decompose = _dense_pod if is_dense(model, solver) else _distributed_pod
    # Where all snapshots vanish (at a support), so does the basis: left in, these rows would fill with round-off.
    columns = np.array(snapshots.S.getDenseArray())
    first = snapshots.S.getOwnershipRange()[0]
    moving = np.flatnonzero(columns.any(axis=1))
    rows = PETSc.IS().createGeneral((first + moving).astype(PETSc.IntType), comm=model.M.comm)
    M = model.M.createSubMatrix(rows, rows)
    compact, sigma = decompose(tall(columns[moving], M), M if product == "mass" else None)
    local = np.zeros((len(columns), compact.shape[1]))
    local[moving] = compact
    rank = int(np.sum(sigma > sigma[0] * np.finfo(float).eps * max(snapshots.S.getSize())))
    size = rank if size is None else size
    if size > rank:
        rigid = (
            f" and there are {rigid_count} rigid-body modes" if rigid_count > 1 else " and there is one rigid-body mode"
        )
        allowed = (
            f"the snapshots span {rank} dimensions only{rigid if rigid_count else ''}; at most {rank + rigid_count}"
        )
        raise InputError("scene", "reduction.coordinates", size + rigid_count, allowed)
    return Basis(tall(fix_signs(local[:, :size], model.comm), model.M), sigma, product)


def modal_basis(modes: Snapshots) -> Basis:
    """Modes as they are: M-orthonormal, so that their singular values in the mass product are all 1."""
    return Basis(modes.S, np.ones(modes.S.getSize()[1]), "mass")


def with_rigid_modes(
    model: FullModel, snapshots: Snapshots, rigid: Array, size: int, product: str = "euclidean", solver: str = "auto"
) -> Basis:
    """Rigid-body modes first, then the POD of what the pool holds beside them; `size` vectors in all, collective.

    A residual flexibility can't stand in for a rigid-body motion, so the basis has to hold all of them exactly; a POD
    basis of modes with the slider held does so to a few digits only.

    Parameters
    ----------
    rigid : (n_local, count) array
        This rank's rows of the rigid-body modes, M-orthonormal.
    size, product, solver
        As for `pod`; the rigid-body modes' singular values are those of the share that the pool has in them.

    Raises
    ------
    InputError
        If `size` leaves no room for other vectors, or exceeds what the pool holds.
    """
    count = rigid.shape[1]
    if count == 0:
        return pod(model, snapshots, size, product, solver)
    if size <= count:
        allowed = f"the fixed supports leave {count} rigid-body modes free; more than these are allowed"
        raise InputError("scene", "reduction.coordinates", size, allowed)
    S = np.array(snapshots.S.getDenseArray())
    share = inner(times(model.M, rigid), S, model.comm)
    of_elastic = pod(
        model, replace(snapshots, S=tall(S - rigid @ share, model.M)), size - count, product, solver, count
    )
    V = np.hstack([rigid, np.array(of_elastic.V.getDenseArray())])
    gram = np.eye(count) if product == "mass" else inner(rigid, rigid, model.comm)
    held = np.linalg.svd(np.linalg.cholesky(gram).T @ share, compute_uv=False)
    return Basis(tall(V, model.M), np.concatenate([held, of_elastic.sigma]), product)


def _dense_pod(S: PETSc.Mat, M: PETSc.Mat | None) -> tuple[Array, Array]:
    """Vectors (n_local, k) and singular values (k,) by LAPACK on rank 0."""
    comm = S.comm.tompi4py()
    shares = comm.gather(np.array(S.getDenseArray()), root=0)
    mass = None if M is None else gather(M)
    result = None
    if shares is not None:
        A = np.concatenate(shares)
        if mass is None:
            result = np.linalg.svd(A, full_matrices=False)[:2]
        else:
            L = np.linalg.cholesky(mass.toarray())
            U, sigma = np.linalg.svd(L.T @ A, full_matrices=False)[:2]
            result = scipy.linalg.solve_triangular(L, U, lower=True, trans="T"), sigma
    V, sigma = comm.bcast(result)
    first, last = S.getOwnershipRange()
    return np.ascontiguousarray(V[first:last]), sigma


def _distributed_pod(S: PETSc.Mat, M: PETSc.Mat | None) -> tuple[Array, Array]:
    """Vectors (n_local, k) and singular values (k,): S = Q R by Gram-Schmidt twice over, R = U Sigma W^T, V = Q U."""
    Q, comm = np.array(S.getDenseArray(), order="F"), S.comm.tompi4py()
    k = Q.shape[1]
    R = np.zeros((k, k))
    for j in range(k):
        q, before = Q[:, j : j + 1], Q[:, :j]
        for _ in range(2):
            share = inner(before, q if M is None else times(M, q), comm)
            subtract(q, before, share)
            R[:j, j] += share[:, 0]
        R[j, j] = np.sqrt(inner(q, q if M is None else times(M, q), comm)[0, 0])
        q /= R[j, j] or 1.0
    U, sigma, _ = np.linalg.svd(R)
    return Q @ U, sigma
