r"""Modal form of a sliding body: M and K diagonalised at once, the moving rows carried along.

.. math::
    K X = M X \Omega^2, \qquad X^T M X = I, \qquad q = X z

M, K and D of a sliding body never change, so this is done once; only m rows are left that do not fit in.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.body import SlidingBody, Trajectory
from pmr.errors import InputError
from pmr.reduced import ReducedModel
from pmr.simulate.start import InitialState

Array = NDArray[np.float64]

#: Coordinates up to which a body is diagonalised densely.
LARGEST = 3000
#: Eigenvalues no further apart than this many times what couples them are left as they are: any mixture will do.
CLOSE = 1e3
#: Damping that is classical leaves off-diagonal terms of this size at most, relative to the diagonal ones; Rayleigh's
#: leaves this share besides the mass and stiffness that it is made of (shell of 18,000 coordinates: 3e-12, solid of
#: 20,000: 6e-10, as sharp as its modes are).
CLASSICAL = 1e-8


@dataclass(frozen=True)
class ModalForm:
    """A body in its own modes, its supports' coordinates held.

    Attributes
    ----------
    body : ReducedModel
        M = I, K = diag(omega^2) in (rad/s)^2; D diagonal where damping is classical.  Its rows are those of the
        original that do more than hold one coordinate.
    X : (n, r) array
        q = X z; zero in the coordinates that are held.
    inverse : (r, n) array
        X^T M: z = X^T M q.
    rows : tuple of int
        Numbers of the rows that `body` has, among the original's.
    """

    body: ReducedModel
    X: Array
    inverse: Array
    rows: tuple[int, ...]

    @property
    def omega2(self) -> Array:
        """Squares of the natural circular frequencies without the rows, (r,) in (rad/s)^2, ascending."""
        return np.diagonal(self.body.K)

    def start(self, initial: InitialState) -> InitialState:
        """An initial state of the original in modal coordinates."""
        return InitialState(self.inverse @ initial.q, self.inverse @ initial.v)

    @property
    def classically_damped(self) -> bool:
        """Whether the damping couples no modes."""
        return bool(np.count_nonzero(self.body.D - np.diag(np.diagonal(self.body.D))) == 0)


def modal_form(body: SlidingBody) -> ModalForm:
    """Diagonalise M and K of a reduced body, or of a full one small enough to be dense.

    Raises
    ------
    InputError
        If M is not positive definite, or the body is too large.
    """
    if body.size > LARGEST:
        allowed = f"the body has {body.size} coordinates, up to {LARGEST} are diagonalised; reduce it first"
        raise InputError("scene", "simulation.simulators", "march", allowed)
    free = np.setdiff1d(np.arange(body.size), list(body.held.values()))
    kept = [row for row in range(len(body.row_names)) if row not in body.held]
    M, D, K = (dense(A)[np.ix_(free, free)] for A in (body.M, body.D, body.K))
    omega2, modes = diagonalise(M, K)
    X = np.zeros((body.size, len(free)))
    X[free] = modes
    rows = body.rows_on(X)
    modal = ReducedModel(
        M=np.eye(len(free)),
        D=_modal_damping(M, D, K, omega2, modes),
        K=np.diag(omega2),
        B=X.T @ body.B,
        outputs=np.asarray(body.outputs @ X),
        rows=PPoly(np.ascontiguousarray(rows.c[:, :, kept]), rows.x),
        input_names=body.input_names,
        row_names=tuple(body.row_names[row] for row in kept),
        output_positions=body.output_positions,
        output_units=body.output_units,
        pads=body.row_compliance[kept],
        flexibility=body.flexibility,
        clearance=body.row_clearance[kept],
    )
    return ModalForm(modal, X, np.asarray((body.M @ X).T), tuple(kept))


def support_forces(body: SlidingBody, form: ModalForm, trajectory: Trajectory, loads: Array) -> Array:
    r"""Multipliers (T, h) in N of the rows that hold one coordinate, from the equations of those coordinates.

    .. math::
        \lambda_h = (B f - M \ddot q - D \dot q - K q - C^T \lambda)_h

    `trajectory` is in modal coordinates; the accelerations follow from the modal equations of motion.
    """
    held = list(body.held.values())
    z, v, multipliers, modal = trajectory.q, trajectory.v, trajectory.multipliers, form.body
    acceleration = loads @ modal.B.T - v @ modal.D - z @ modal.K
    acceleration -= np.einsum("tmr,tm->tr", modal.C(trajectory.s), multipliers)
    M, D, K = (np.asarray(A[held] @ form.X) for A in (body.M, body.D, body.K))
    unit = np.zeros((body.size, len(held)))
    unit[held, range(len(held))] = 1.0
    of_rows = body.rows_on(unit)(trajectory.s)[:, list(form.rows)]
    forces = loads @ body.B[held].T - acceleration @ M.T - v @ D.T - z @ K.T
    return np.asarray(forces - np.einsum("tmh,tm->th", of_rows, multipliers))


def diagonalise(M: Array, K: Array) -> tuple[Array, Array]:
    """omega^2 (r,) ascending and X (r, r) with X^T M X = I and X^T K X = diag(omega^2).

    LAPACK leaves an error of eps times the largest eigenvalue in the low ones, which for a fine beam gives a rigid
    rotation a stiffness and low modes a relative error of 1e-7.  Corrections to first order in the remaining
    couplings, with products in extended precision where the machine has one, bring all pairs to round-off (Ogita,
    Aishima: Iterative refinement for symmetric eigenvalue decomposition, Japan Journal of Industrial and Applied
    Mathematics 35, 2018).

    Raises
    ------
    InputError
        If M is not positive definite.
    """
    try:
        _, X = scipy.linalg.eigh(K, M)
    except scipy.linalg.LinAlgError:
        allowed = "a mass matrix that is positive definite is allowed"
        raise InputError("body", "M", None, allowed) from None
    M_long, K_long = ((A.astype(np.longdouble) + A.T) / 2.0 for A in (M, K))
    for _ in range(2):
        omega2, X = _refined(M_long, K_long, X)
    order = np.argsort(omega2)
    return omega2[order], np.ascontiguousarray(X[:, order])


def _refined(M: Array, K: Array, X: Array) -> tuple[Array, Array]:
    """Eigenvalues and vectors corrected to first order; products in the precision of M and K."""
    X = X.astype(M.dtype)
    defect = np.asarray(np.eye(len(M)) - X.T @ (M @ X), float)  # from M-orthonormality
    S = X.T @ (K @ X)
    omega2 = np.asarray(np.diagonal(S) / (1.0 - np.diagonal(defect)), float)
    coupling = np.asarray(S - np.diag(np.diagonal(S)), float)
    gap = omega2[None, :] - omega2[:, None]
    near = np.abs(gap) <= CLOSE * (np.abs(coupling) + np.abs(omega2) * np.abs(defect))  # no first order there
    with np.errstate(divide="ignore", invalid="ignore"):
        correction = np.where(near, defect / 2.0, (coupling + omega2[None, :] * defect) / gap)
    return omega2, np.asarray(X + X @ correction.astype(M.dtype), float)


def _modal_damping(M: Array, D: Array, K: Array, omega2: Array, X: Array) -> Array:
    """X^T D X, exactly diagonal where damping is Rayleigh's or modal.

    Rayleigh's part is taken out before the transformation: its round-off in the high modes would look like coupling.
    """
    if not np.any(D):
        return np.zeros_like(D)
    parts = np.stack([(M / np.linalg.norm(M)).ravel(), (K / np.linalg.norm(K)).ravel()], axis=1)
    alpha, beta = np.linalg.lstsq(parts, D.ravel(), rcond=None)[0] / [np.linalg.norm(M), np.linalg.norm(K)]
    rest = D - alpha * M - beta * K
    if np.linalg.norm(rest) <= CLASSICAL * np.linalg.norm(D):
        return np.diag(alpha + beta * omega2)
    terms = np.abs(D) + np.abs(alpha * M) + np.abs(beta * K)
    round_off = 1e-14 * np.abs(X).T @ terms @ np.abs(X)
    rest = X.T @ rest @ X
    scale = np.sqrt(np.abs(np.outer(np.diagonal(rest), np.diagonal(rest))))
    coupled = np.abs(rest) > CLASSICAL * scale + round_off
    if not np.any(np.triu(coupled | coupled.T, 1)):
        rest = np.diag(np.diagonal(rest))
    return rest + np.diag(alpha + beta * omega2)


def dense(A: Any) -> Array:
    """A matrix as a dense array."""
    return np.asarray(A.toarray() if sp.issparse(A) else A, dtype=float)
