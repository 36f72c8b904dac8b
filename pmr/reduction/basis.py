r"""Bases of reduced models: proper orthogonal decomposition (POD) of snapshots, and Galerkin projection on a basis.

POD decomposes a pool of k snapshots S (n, k) into basis vectors V with singular values sigma:

.. math::
    S = V \Sigma W^T, \qquad V^T X V = I, \qquad
    \kappa(r) = \sum_{i \le r} \sigma_i^2 \Big/ \sum_i \sigma_i^2

with X = I (Weyrer, Gerstmayr, Mikkola, Orzechowski: Model Order Reduction of a Sliding Beam using a Global Basis; "the
paper" below) or X = M, and the share kappa(r) of the first r vectors.  The Gram matrix S^T X S is never formed: it
would square the condition number and lose the singular values below sqrt(eps) sigma_1.  Instead S = Q R with Q^T X Q =
I, and R, which is only (k, k) for k snapshots, is decomposed by LAPACK.  Volkwein: Model Reduction using Proper
Orthogonal Decomposition, 2011, section 1.

The Galerkin projection of the full model on a basis can be simulated without any finite-element library.

Eigenmodes vanish at the supports.  The vectors that an SVD of the whole pool returns do so up to round-off, which is
eps sigma_1 / sigma_j in vector j.  The projected row of a support consists of this round-off alone.  It is not zero, so
it holds one coordinate: one of the last, because the round-off grows as sigma_j falls.  The paper keeps its two rows of
supports, so that 18 of its 20 coordinates move.  Which combination of the last vectors is held changes with the sign of
a snapshot, and so does the error (2.00 to 2.05 % for the paper's evolved case: its beam with 20 coordinates).  Here
such rows are recognised.  They are either left out (error 1.49 %) or replaced by rows that hold exactly the last
coordinates (1.79 %; published: 1.82 %).  Both are reproducible.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy.linalg
from scipy.interpolate import PPoly

from pmr.errors import InputError
from pmr.fem.compat import PETSc
from pmr.fem.distributed import fix_signs, gather, inner, local_csr, subtract, tall, times
from pmr.files.arrays import Array
from pmr.fullmodel.eigensolvers import is_dense
from pmr.fullmodel.model import FullModel
from pmr.reduction.snapshots import Snapshots
from pmr.system.body_matrices import dependence_of_rows, symmetric_part
from pmr.system.polynomials import stack_tables
from pmr.system.reduced_model import ReducedModel, satisfied_rows
from pmr.system.truncation import checked_positions

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Basis:
    """Basis of r vectors for a full model with n coordinates, the same for all path coordinates."""

    V: PETSc.Mat  # dense (n, r), orthonormal in `product`; rigid-body modes before a POD are M-orthonormal in any case
    sigma: Array  # (k,): all k singular values of the pool, descending; those of rigid-body modes before all others
    product: str  # ``"euclidean"`` or ``"mass"``

    @property
    def size(self) -> int:
        """Number of basis vectors r."""
        return int(self.V.getSize()[1])

    @property
    def accuracy(self) -> float:
        """Relative round-off to expect in the last basis vector: eps sigma_1 / sigma_r, with the machine precision eps.

        If all snapshots satisfy an equation exactly, such as no displacement at a support, V satisfies this equation up
        to about this value.
        """
        return float(np.finfo(float).eps * self.sigma[0] / self.sigma[self.size - 1])

    def kappa(self, r: int | None = None) -> float:
        """Share of the pool's squared norm that lies in the r vectors with the largest singular values.

        If `r` is None, all vectors of the basis are meant.  The function `kappa` has the equation.
        """
        return kappa(self.sigma, self.size if r is None else r)


def kappa(sigma: Array, r: int) -> float:
    """Sum of the squares of the r largest singular values, over the sum of the squares of all k values `sigma` (k,).

    The values may have any order.  The result is 1 if r is k or more.  The squares of the other values are summed and
    taken off 1, so that 1 - kappa keeps its digits.  Benner, Gugercin, Willcox 2015, section 3.1.
    """
    squares = np.sort(sigma**2)
    return float(1.0 - squares[: max(len(sigma) - r, 0)].sum() / squares.sum())


def pod(
    model: FullModel,
    snapshots: Snapshots,
    size: int | None,
    product: str = "euclidean",
    solver: str = "auto",
    rigid_count: int = 0,
) -> Basis:
    """Basis by proper orthogonal decomposition of a pool of snapshots, truncated to `size` vectors; collective.

    The entry of largest magnitude of each vector is positive.

    Parameters
    ----------
    model : FullModel
        Full model; its mass matrix is used for ``product = "mass"``.
    snapshots : Snapshots
        The pool.
    size : int or None
        Number of vectors r, at most the numerical rank of the pool; None stands for this rank.
    product : ``"euclidean"`` or ``"mass"``
        Product in which the vectors are orthonormal.
    solver : ``"auto"``, ``"dense"`` or ``"slepc"``
        LAPACK on process 0 (reproducible), or Gram-Schmidt on the distributed matrix.  ``auto`` makes the same choice
        as for the solver of the snapshots.
    rigid_count : int
        Number of rigid-body modes that the caller puts before these vectors.  Only the message of the InputError uses
        it: the message counts these modes as coordinates, too.

    Raises
    ------
    InputError
        If `size` exceeds the numerical rank of the pool.
    """
    decompose = _dense_pod if is_dense(model, solver) else _distributed_pod
    # Coordinates at which all snapshots are zero (supports) are taken out: round-off would make them nonzero in the
    # basis.
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
    """Basis of the M-orthonormal eigenmodes in `modes`, unchanged; all singular values are set to 1."""
    return Basis(modes.S, np.ones(modes.S.getSize()[1]), "mass")


def with_rigid_modes(
    model: FullModel, snapshots: Snapshots, rigid: Array, size: int, product: str = "euclidean", solver: str = "auto"
) -> Basis:
    """Basis of `size` vectors: rigid-body modes, then the POD of the `snapshots` without these modes; collective.

    A residual flexibility can't replace a rigid-body motion, so the basis has to contain all rigid-body modes exactly.
    A POD basis of modes with the slider held contains them to a few digits only.  The rigid-body modes are
    M-orthonormal, and M-orthogonal to the other vectors, also if `product` is Euclidean.  Their singular values are
    those of the snapshots' projection on them.  Without rigid-body modes the result is that of `pod`.

    Parameters
    ----------
    rigid : (n_local, count) array
        Rigid-body modes, M-orthonormal: this rank's part of their coordinates.
    size, product, solver
        As for `pod`, except that `size` counts the rigid-body modes and can't be None.

    Raises
    ------
    InputError
        If `size` leaves no room for other vectors, or exceeds what the pool spans.
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


class _SingularVectors(NamedTuple):
    """Left singular vectors (n_local, k), this rank's part, and singular values (k,)."""

    vectors: Array
    values: Array


def _dense_pod(S: PETSc.Mat, M: PETSc.Mat | None) -> _SingularVectors:
    """Left singular vectors (n_local, k) and values (k,) of S (n, k), in the product of M, by LAPACK on rank 0.

    The values are descending.  M is None for the Euclidean product.  Collective.
    """
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
    return _SingularVectors(np.ascontiguousarray(V[first:last]), sigma)


def _distributed_pod(S: PETSc.Mat, M: PETSc.Mat | None) -> _SingularVectors:
    """Left singular vectors (n_local, k) and values (k,) of S (n, k), in the product of M, by Gram-Schmidt.

    S = Q R is computed by orthogonalising twice; then R = U Sigma W^T gives V = Q U. The values are descending.  M is
    None for the Euclidean product.  Collective.
    """
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
    return _SingularVectors(Q @ U, sigma)


#: Smallest singular values of rows, scaled to unit length, below which the rows are dependent or nearly dependent.
INDEPENDENT, NEARLY_DEPENDENT = 1e-9, 1e-4


def reduced_model(model: FullModel, basis: Basis, provenance: dict[str, object]) -> ReducedModel:
    """Galerkin projection of a model on a basis V, without rows of supports that V satisfies; the same on every rank.

    The result consists of V^T A V for A = M, D, K and the model's `matrices`, and of V^T B, O V and C(s) V. Fixed rows
    that every basis vector satisfies (supports, for eigenmodes) are left out and named in the result.  The result keeps
    `provenance`, which says what it was made from.  An InputError is raised if the remaining rows depend on each other,
    as with a basis that is too small.  Collective.
    """
    complete = galerkin(model, basis, provenance)
    satisfied = satisfied_rows(complete.rows, tolerance=min(1e2 * basis.accuracy, 1e-3))
    reduced = without_rows(complete, [i for i in satisfied if model.rows.rows[i].is_fixed])
    _check_rank(reduced)
    return reduced


def galerkin(model: FullModel, basis: Basis, provenance: dict[str, object]) -> ReducedModel:
    """Galerkin projection of a model with all of its rows, even those that the basis satisfies up to round-off.

    The result keeps `provenance`, which says what it was made from, and is the same on every rank; collective.
    """
    comm = model.comm
    V = np.array(basis.V.getDenseArray())
    first = basis.V.getOwnershipRange()[0]
    projected = [row.project(V, first) for row in model.rows.rows]
    for row in projected:
        row.c[:] = comm.allreduce(row.c)
    pads = np.array([row.compliance for row in model.rows.rows])
    M, K = (symmetric_part(inner(V, times(A, V), comm)) for A in (model.M, model.K))
    return ReducedModel(
        M=M,
        D=symmetric_part(inner(V, times(model.D, V), comm)) if model.rayleigh is None else model.rayleigh.matrix(M, K),
        K=K,
        B=np.asarray(comm.allreduce(V.T @ local_csr(model.B))),
        outputs=np.asarray(comm.allreduce((V.T @ local_csr(model.outputs)).T)),
        rows=stack_tables(projected, model.rows.domain, basis.size),
        input_names=model.input_names,
        row_names=model.rows.names,
        output_positions=model.output_positions,
        output_names=model.output_names,
        output_units=model.output_units,
        output_kinds=model.output_kinds,
        provenance=provenance,
        pads=pads if pads.any() else None,
        clearance=None if np.isnan(model.rows.clearance).all() else model.rows.clearance,
        rayleigh=model.rayleigh,
        matrices={name: inner(V, times(A, V), comm) for name, A in model.matrices.items()},
        ports={name: np.asarray(comm.allreduce(row[:, model.share] @ V))[0] for name, row in model.ports.items()},
        rigid_work=_rigid_work(model),
    )


def _rigid_work(model: FullModel) -> Array | None:
    """Work R^T B (k, i) of unit inputs on the k rigid motions R of the model; collective.

    None is returned for a model with clamps, or if its rigid motions are not known.
    """
    if model.rigid is None or not model.rigid.complete:
        return None
    return np.asarray(model.comm.allreduce(model.rigid.coordinates.T @ local_csr(model.B)))


def without_rows(model: ReducedModel, numbers: Sequence[int]) -> ReducedModel:
    """Return the model without the rows with these `numbers`, from 0; the names of the rows are added to `left_out`."""
    numbers_left = [i for i in range(len(model.row_names)) if i not in numbers]
    left_out = (*model.left_out, *(model.row_names[i] for i in numbers))
    return replace(model.with_rows(numbers_left), left_out=left_out)


def with_held_coordinates(model: ReducedModel) -> ReducedModel:
    """Return the model with a row for each of the rows in `left_out`; each new row holds one coordinate at zero.

    The new rows come before all others.  The first of them holds the last coordinate, the next one the last but one,
    and so on.
    """
    count = len(model.left_out)
    held = np.zeros((len(model.rows.c), model.rows.c.shape[1], count, model.size))
    held[-1, :, range(count), model.size - 1 - np.arange(count)] = 1.0
    return replace(
        model,
        rows=PPoly(np.concatenate([held, model.rows.c], axis=2), model.rows.x),
        row_names=(*(f"{name} (holds coordinate {model.size - i})" for i, name in enumerate(model.left_out)),
                   *model.row_names),
        pads=None if model.pads is None else np.r_[np.zeros(count), model.pads],
        clearance=None if model.clearance is None else np.r_[np.full(count, np.nan), model.clearance],
        left_out=(),
    )  # fmt: skip


def _check_rank(model: ReducedModel) -> None:
    """Raise an InputError if rigid rows depend on each other at a path coordinate; warn if they nearly do.

    Rows depend on each other if their measure of dependence (`dependence_of_rows`) is below `INDEPENDENT`, and nearly
    do if it is below `NEARLY_DEPENDENT`.  The warning is logged.  The ends of the path are not checked: there a slider
    may be on a support.  Rows of pads with a stiffness may depend on each other: these pads share the force according
    to their stiffness.
    """
    rigid = np.flatnonzero(model.row_compliance == 0.0)
    names = [model.row_names[i] for i in rigid]
    if not names:
        return
    places = checked_positions(model)
    dependences = [dependence_of_rows(model.C(s)[rigid], names) for s in places]
    worst = int(np.argmin([dependence.measure for dependence in dependences]))
    measure, involved = dependences[worst].measure, ", ".join(dependences[worst].names)
    if measure < INDEPENDENT:
        raise InputError(
            "scene",
            "reduction.coordinates",
            model.size,
            f"the rows {involved} depend on each other in the reduced space at s = {places[worst]:.4g} m; ask for more",
        )
    if measure < NEARLY_DEPENDENT:
        logger.warning(
            "s = %.4g m: the rows %s nearly depend on each other in the reduced space (%.0e of what independent ones "
            "would have), so their forces are not determined; residual flexibility or a stiffness of the pads helps",
            places[worst],
            involved,
            measure,
        )
