r"""A body with its sliders and pads released: rigid-body modes, static solves, residual flexibility, and reactions.

The elastic response of such a body to a load g, beside its motion as a rigid body, is

.. math::
    x = P\, K^+ P^T g, \qquad P = I - Z Z^T M

Z has the rigid-body modes that the fixed rows leave free, M-orthonormal.  P^T makes a load self-equilibrated, so K^+
may be a solve with the rigid-body modes held at any statically determinate set of coordinates.  Free modes and the
residual flexibility are computed with the same factor.  Craig and Kurdila: Fundamentals of Structural Dynamics, 2nd
ed., 2006, section 17.6 (inertia relief).

Geometry decides which rigid-body modes there are.  With the M-orthonormal rigid motions R of the body, the values H of
these motions at clamps and springs, and the fixed rows C,

.. math::
    Z = R\, N, \qquad \begin{pmatrix} H \\ C R \end{pmatrix} N = 0, \qquad Z^T M Z = I

N is a null space of at most six columns, with each row scaled to unit length.  No eigenvalue has to be recognised as
zero: its round-off depends on lengths, meshes and the machine, and may be closer to a soft mode than to zero.  Z is
rigid to the last digit; computed eigenvectors would not be.

The module also computes the static motions of a full model that belong to its rigid supports, and from these motions
the reactions of a reduced model.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.interpolate import PPoly

from pmr.fem.compat import PETSc
from pmr.fem.distributed import free_objects, inner, local_csr, sparse, subtract, times
from pmr.files.arrays import Array, Mask
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.modes import BLOCK, Eigenpairs, largest_eigenpairs
from pmr.fullmodel.moving import StaticSolver, static_solver
from pmr.system.body_matrices import Reactions
from pmr.system.polynomials import stack_tables
from pmr.system.reduced_model import ReducedModel
from pmr.system.rows import Row, Rows, fixed_row, sparse_row


class FreeBody:
    """Rigid-body modes Z of a model, M Z, and solves with K^+; the factor of K is computed at the first solve.

    After `free_factor`, the next solve factorises anew.  All methods are collective.
    """

    def __init__(self, model: FullModel, choice: str = "auto") -> None:
        self.model, self.choice = model, choice
        self._solver: StaticSolver | None = None

    @property
    def comm(self) -> Any:
        """Communicator of the model."""
        return self.model.comm

    @cached_property
    def Z(self) -> Array:
        """The c rigid-body modes Z (n_local, c), M-orthonormal: this rank's part of the coordinates.

        Raises the ValueError of `rigid_modes`.
        """
        return np.asfortranarray(rigid_modes(self.model))

    @cached_property
    def MZ(self) -> Array:
        """Product M Z (n_local, c) of the mass matrix and the c rigid-body modes, this rank's part."""
        return times(self.model.M, self.Z)

    def are_rigid(self, local: Array) -> Mask:
        """Mask (k,) that marks, among k vectors, the combinations of rigid-body modes; collective.

        `local` (n_local, k) is this rank's part of the vectors.
        """
        dual = times(self.model.M, local)
        share = inner(self.Z, dual, self.comm)
        products = (local - self.Z @ share) * (dual - self.MZ @ share), local * dual
        far, size = self.comm.allreduce(np.array([np.sum(product, axis=0) for product in products]))
        return np.asarray(far <= RIGID**2 * size)

    def solve(self, g: Array) -> Array:
        """Solutions K^+ g (n_local, k), this rank's part, for k self-equilibrated loads g (n_local, k); collective.

        The array g may be overwritten.  Raises the errors of `static_solver`.
        """
        if self._solver is None:
            rows = [*fixed_rows(self.model), *_anchor_rows(self.model, self.Z)]
            self._solver = static_solver(self.model, rows, self.choice)
        return self._solver.solve(g)

    def elastic_modes(self, count: int) -> Eigenpairs:
        """Eigenpairs of the `count` lowest elastic modes on fixed supports, or of all if there are fewer; collective.

        Their values are 1/omega^2.  A ConvergenceError is raised if some of these modes do not converge.
        """
        loads = np.random.default_rng(7).uniform(-1.0, 1.0, (self.model.size, BLOCK))[self.model.share]
        dimension = self.model.size - len(fixed_rows(self.model)) - self.Z.shape[1]
        return largest_eigenpairs(
            self._relieve, self.model.M, self._relieve(np.asfortranarray(loads)), count, dimension
        )

    def free_factor(self) -> None:
        """Free the memory of the factor of K; the next solve factorises anew."""
        if self._solver is not None:
            self._solver.destroy()
        self._solver = None

    def _relieve(self, g: Array) -> Array:
        """Product P K^+ P^T g (n_local, k), this rank's part, for k loads g (n_local, k); in Fortran's order."""
        g = g.copy(order="F")
        subtract(g, self.MZ, inner(self.Z, g, self.model.comm))
        x = np.asfortranarray(self.solve(g))
        subtract(x, self.Z, inner(self.MZ, x, self.model.comm))
        return x


def _anchor_rows(model: FullModel, Z: Array) -> list[Row]:
    """Rows that each hold one coordinate, so that together they hold the c rigid-body modes Z (n_local, c); collective.

    The c coordinates are those that determine the modes best.  The coordinates are chosen by pivoted QR of the modes,
    with each coordinate weighted by the square root of its mass.  The list is empty if c is 0.
    """
    if Z.shape[1] == 0:
        return []
    weighted = Z * np.sqrt(model.M.getDiagonal().getArray())[:, None]
    everywhere = np.concatenate(model.comm.allgather(weighted))
    pivots = scipy.linalg.qr(everywhere.T, mode="r", pivoting=True)[1][: Z.shape[1]]
    return [fixed_row(f"coordinate {i}", sparse_row(i, 1.0, model.size), model.rows.domain) for i in pivots]


#: Largest value of rows of unit length for a motion that counts as free.  Round-off in it is about 1e-13; for two
#: supports a millimetre apart on a boom of 100 m it is 1e-5.
HELD = 1e-9

#: Distance of a vector from the span of the rigid-body modes, over its size, up to which it is in the span: for exact
#: combinations it is 1e-15, for vectors that are M-orthogonal to the modes 1.
RIGID = 1e-6


def fixed_rows(model: FullModel) -> tuple[Row, ...]:
    """Rows of the fixed supports, which hold the body even if all sliders and pads are released.

    A fixed support is rigid, holds in both directions, and has the same row at every path coordinate s.
    """
    return tuple(row for row in model.rows.rows if row.is_fixed)


def released_rows(model: FullModel) -> Rows:
    """Rows of sliders and pads: all rows of the model that are not fixed (`Row.is_fixed`)."""
    return Rows(tuple(row for row in model.rows.rows if not row.is_fixed), model.size)


def rigid_modes(model: FullModel) -> Array:
    """The c rigid-body modes (n_local, c) that fixed supports leave free, M-orthonormal: this rank's part; collective.

    A ValueError is raised if the model's rigid motions are not known.
    """
    if model.rigid is None:
        raise ValueError("the model's rigid motions are not known, nor which of them its supports hold")
    R, held = model.rigid.coordinates, model.rigid.held_measures
    for _ in range(2):  # a single pass loses last digits for rotations about a distant origin
        U = np.linalg.inv(np.linalg.cholesky(inner(R, times(model.M, R), model.comm)).T)
        R, held = R @ U, held @ U
    first = model.M.getOwnershipRange()[0]
    rows = [row.project(R, first).c[-1, 0] for row in fixed_rows(model)]
    on_rows = model.comm.allreduce(np.reshape(rows, (len(rows), R.shape[1])))  # values of the fixed rows for R
    return np.ascontiguousarray(R @ _null_space(np.vstack([held, on_rows])))


def _null_space(rows: Array) -> Array:
    """Orthonormal combinations (k, c) of k motions for which all h rows, with the values `rows` (h, k), are zero.

    Each row is scaled to unit length; values up to `HELD` count as zero.
    """
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    scaled = rows[size[:, 0] > 0.0] / size[size[:, 0] > 0.0]
    count = rows.shape[1]
    if not len(scaled):
        return np.eye(count)
    _, values, Vt = np.linalg.svd(np.vstack([scaled, np.zeros((count, count))]), full_matrices=False)
    return np.asarray(Vt[values <= HELD].T)


def support_motions(body: FreeBody) -> Array | None:
    r"""Unit motions Phi (n_local, h) of the h rigid supports of a body, this rank's part; collective.

    In motion j, support j moves by 1 and all others by 0.  None is returned if there are no rigid supports, or if the
    model's rigid motions are not known.  C_f are the rows of the supports and Z the rigid-body modes.  The motions
    satisfy C_f Phi = I and Z^T M Phi = 0, and Phi^T K q = 0 for all q with C_f q = 0:

    .. math::
        \Phi = P (\Phi_0 - K^+ K \Phi_0), \qquad \Phi_0 = R N + C_f^T (C_f C_f^T)^{-1} (I - C_f R N), \qquad
        N = (C_f R)^+

    R are the rigid motions, and P removes the share of Z.  If rigid motions are enough, as on statically determinate
    supports, no solve is needed.
    """
    model = body.model
    held = fixed_rows(model)
    if not held or model.rigid is None:
        return None
    share, R = model.share, model.rigid.coordinates
    S = sp.vstack([row.at(row.breaks[0]) for row in held], format="csr")
    measured = np.asarray(model.comm.allreduce(S[:, share] @ R))
    N = np.linalg.pinv(measured, rcond=HELD)
    remainder = np.eye(len(held)) - measured @ N
    remainder[np.abs(remainder) < HELD] = 0.0
    motions = R @ N
    if np.any(remainder) or np.any(
        np.abs(model.rigid.held_measures @ N) > HELD * np.abs(model.rigid.held_measures).max(initial=0.0)
    ):
        motions = motions + (S[:, share].T @ (np.linalg.pinv((S @ S.T).toarray()) @ remainder))
        motions = motions - body.solve(np.asfortranarray(times(model.K, np.asfortranarray(motions))))
    motions = np.asfortranarray(motions)
    subtract(motions, body.Z, inner(body.MZ, motions, model.comm))
    return motions


def with_reactions(reduced: ReducedModel, body: FreeBody, V: Array, motions: Array | None) -> ReducedModel:
    """Return `reduced`, the model on the basis V, with reactions of its rigid supports; unchanged if `motions` is None.

    V (n_local, r) and the supports' unit motions `motions` (n_local, h) are this rank's parts; collective.  If the
    carriers of `reduced` store the work of matrices on these motions, this work is moved to the reactions.
    """
    if motions is None:
        return reduced
    model, held = body.model, fixed_rows(body.model)
    first = model.M.getOwnershipRange()[0]
    tables = {row.name: row.project(motions, first) for row in model.rows.rows}
    for row in model.rows.rows:
        tables[row.name].c[:] = 0.0 if row.is_fixed else model.comm.allreduce(tables[row.name].c)
    nothing = PPoly(np.zeros((1, 1, len(held))), np.array(model.rows.domain))
    rows = stack_tables([tables.get(name, nothing) for name in reduced.row_names], model.rows.domain, len(held))
    inertia = inner(motions, times(model.M, V), model.comm)
    if model.rayleigh is None:
        damping = inner(motions, times(model.D, V), model.comm)
    else:
        damping = model.rayleigh.matrix(inertia, np.zeros_like(inertia))
    carriers = None if reduced.carriers is None else replace(reduced.carriers, supports={})
    return replace(
        reduced,
        carriers=carriers,
        reactions=Reactions(
            names=tuple(row.name for row in held),
            units=tuple(row.unit for row in held),
            inertia=inertia,
            damping=damping,
            stiffness=np.zeros_like(inertia),
            inputs=np.asarray(model.comm.allreduce(motions.T @ local_csr(model.B))),
            rows=PPoly(np.ascontiguousarray(rows.c.swapaxes(2, 3)), rows.x),
            carried=None if reduced.carriers is None else _carrier_motions(model, motions),
            matrices=_work_on_motions(reduced, model, V, motions),
            ports={
                name: model.comm.allreduce(np.asarray(row[:, model.share] @ motions)[0])
                for name, row in model.ports.items()
            },
        ),
    )


def _work_on_motions(reduced: ReducedModel, model: FullModel, V: Array, motions: Array) -> dict[str, Array]:
    """Work (h, r) of each of the model's matrices on h supports' motions and r basis vectors V, by the matrices' names.

    The carriers of `reduced` may store such work in `supports`.  If they do, the stored work is returned.  It covers
    all vectors of the carriers' matrices: first the r basis vectors, then the others.  Collective.
    """
    if reduced.carriers is not None and reduced.carriers.supports:
        return dict(reduced.carriers.supports)
    return {name: inner(motions, times(A, V), model.comm) for name, A in model.matrices.items()}


def _carrier_motions(model: FullModel, motions: Array) -> Array:
    """Values U Phi (K, h) of the motions Phi on the carriers U of all rows that are not rigid supports; collective.

    `motions` are this rank's part (n_local, h) of Phi.
    """
    U = released_rows(model).shared_carriers.carriers
    return np.asarray(model.comm.allreduce(U[:, model.share] @ motions))


#: K w counts as theta M w of an eigenmode w if they differ by at most this many times the round-off in the terms of K
#: w.
EIGENVECTOR = 100.0


class ResidualFlexibility:
    r"""Residual flexibility R, an operator in m/N, that a basis V (n_local, r) of a model leaves out; collective.

    V is this rank's part of the basis.  The basis has to contain the rigid-body modes that loads or rows excite.  The
    model is held by its fixed rows alone.  With rigid-body modes Z (Z^T M Z = I) and the rest of the basis W, combined
    so that W^T M W = I and W^T K W = diag(theta),

    .. math::
        R = P\, K^+ P^T, \qquad P = I - Z (M Z)^T - W (K W\, \mathrm{diag}(\theta)^{-1})^T

    P^T removes from a load what the basis responds to and makes it self-equilibrated; P removes the basis from the
    response.  For eigenmodes R is the sum of phi phi^T / omega^2 over the modes left out; for any other basis it is
    K^-1 - V (V^T K V)^-1 V^T.  The basis and the responses of R are K-orthogonal, and M-orthogonal too for eigenmodes.

    On soft supports, K w = theta M w for a low mode w is little but round-off: for a shell with theta = 2e-5 rad^2/s^2
    for its lowest mode, and 2e3 for the first mode that bends, three digits remained.  If K w is theta M w up to
    round-off, M w replaces K w / theta, since M w has all its digits.  Projecting on both sides avoids the cancellation
    of a difference.  With 6 and 20 modes of a cantilever on 50 elements, the errors of R are 2e-10 and 6e-10, scaled to
    a unit diagonal.  If R is computed as K^-1 minus the modal part, the errors are 1e-5 and 1e-4.  Projecting a second
    time gains nothing.  MacNeal: A hybrid method of component mode synthesis, Computers & Structures 1, 1971,
    pp. 581-601.
    """

    def __init__(self, body: FreeBody, V: Array) -> None:
        """Prepare solves for the responses of `body` that the basis V (n_local, r) leaves out; collective."""
        self.model = model = body.model
        self._body, self._comm = body, model.comm
        Z, MZ = body.Z, body.MZ
        self.rigid = body.are_rigid(V)  # (r,): which columns of the basis are motions of a rigid body
        W = V[:, ~self.rigid]
        W = W - Z @ inner(MZ, W, self._comm)
        W, dual = _diagonalise(model, W)
        self._basis = np.asfortranarray(np.hstack([Z, W]))
        self._dual = np.asfortranarray(np.hstack([MZ, dual]))

    def apply(self, g: Array) -> Array:
        """Product R g (n_local, k) in m, this rank's part, for loads g (n_local, k) in N; collective.

        The array g may be overwritten.
        """
        g = np.asfortranarray(g)
        subtract(g, self._dual, inner(self._basis, g, self._comm))
        x = np.asfortranarray(self._body.solve(g))
        subtract(x, self._basis, inner(self._dual, x, self._comm))
        return x

    def powers(self, c: Array, count: int) -> Array:
        """Vectors R c, R M R c, ... (n_local, `count`), this rank's part, for one load c (n_local,); collective.

        At least one vector is returned.
        """
        columns = [self.apply(np.array(c)[:, None])]
        while len(columns) < count:
            columns.append(self.apply(times(self.model.M, columns[-1])))
        return np.asfortranarray(np.hstack(columns))


def absolute_product(A: PETSc.Mat, X: Array) -> Array:
    """Product |A| |X| (n_local, k) of absolute values, which bounds the terms of A X and so its round-off; collective.

    X (n_local, k) and the result are this rank's parts.
    """
    sizes = sparse(abs(local_csr(A)), A, columns=A.getLocalSize()[1])
    sums = times(sizes, np.abs(X))
    free_objects(sizes)
    return sums


def _diagonalise(model: FullModel, W: Array) -> Array:
    """Combinations U of the columns W (n_local, k), and K U Theta^-1, as one array (2, n_local, k); collective.

    The combinations satisfy U^T M U = I and U^T K U = Theta, which is diagonal.  For each column that is an eigenvector
    up to round-off, the second result has the column of M U instead, which is equal and more accurate.
    """
    if W.shape[1] == 0:
        return np.array([W, W])
    comm = model.comm
    theta, Q = scipy.linalg.eigh(inner(W, times(model.K, W), comm), inner(W, times(model.M, W), comm))
    W = np.ascontiguousarray(W @ Q)
    KW, MW, of_K = times(model.K, W), times(model.M, W), absolute_product(model.K, W)
    differs, size = (np.diagonal(inner(x, x, comm)) for x in (KW - theta * MW, of_K))
    return np.array([W, np.where(differs <= (EIGENVECTOR * np.finfo(float).eps) ** 2 * size, MW, KW / theta)])
