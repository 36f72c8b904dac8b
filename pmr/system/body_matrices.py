r"""Matrices of a body for damping, a moving frame, axial forces and rigid supports, and whether matrices are sound.

Arrays of a reduced model that contradict each other, and values that no structure has, are described in words
(`describe_misfit`, `describe_asymmetry`).  Small dense matrices are tested for definiteness and for dependent rows.

Forces of rigid supports, which have no multiplier of their own, follow from the equations of motion.  With motions
:math:`\Phi` of the body that move one support by one and leave all others at rest,

.. math::
    \lambda_f = \Phi^T \bigl(B f - M \ddot q - D \dot q - K q - C(s)^T \lambda\bigr), \qquad C_f \Phi = I

is the force of the body on each support, with the rows :math:`C_f` of the rigid supports and the rows C(s) of sliders
and pads.  It is positive along the support's direction, like the force of a support with a stiffness.  Any such motions
are right for a full model.  A reduced model uses the static ones, with all sliders and pads released (Craig and
Bampton's constraint modes).  For these :math:`\Phi^T K q = 0` for every q that the supports allow, so the local
stiffness at a support, which few coordinates represent badly, has no influence.  For a statically determinate body they
are rigid motions, and the equations are the sums of forces and moments.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.errors import LONGEST_NAME, is_name
from pmr.files.arrays import Array
from pmr.system.polynomials import select_columns


@dataclass(frozen=True)
class Rayleigh:
    """Rayleigh damping D = alpha M + beta K, alpha in 1/s and beta in s.

    A mode with the circular frequency omega has the damping ratio zeta = (alpha / omega + beta omega) / 2.  Bathe:
    Finite Element Procedures, 1996, section 9.3.3.
    """

    alpha: float
    beta: float

    def matrix(self, M: Array, K: Array) -> Array:
        """Damping matrix alpha M + beta K (n, n) for a mass matrix M and a stiffness matrix K, (n, n) each."""
        return self.alpha * M + self.beta * K

    def modal_damping(self, omega2: Array) -> Array:
        """Modal damping phi^T D phi = 2 zeta omega (k,) in 1/s of M-orthonormal modes with `omega2` = omega^2 (k,)."""
        return self.alpha + self.beta * omega2


#: Name of a body's damping D among its `matrices`, if D is not Rayleigh's alone: then these hold it on all vectors.
DAMPING = "damping"
_E, _AXES = np.eye(3), "xyz"
#: Antisymmetric S with S u = e_k x u for displacements u, of the matrix T_k = int rho v . S u (test function v): an
#: angular velocity omega causes the forces 2 omega_k T_k q', an angular acceleration alpha the forces alpha_k T_k q.
ROTATING = {f"rotating {axis}": np.cross(_E[k], _E).T for k, axis in enumerate(_AXES)}
#: Symmetric S of the matrix N_jk = int rho (v_j u_k + v_k u_j) / 2 = int rho v . S u: the acceleration omega x (omega x
#: u) gives the matrix sum_jk omega_j omega_k N_jk - |omega|^2 M.
CARRIED = {
    f"carried {_AXES[j]}{_AXES[k]}": (np.outer(_E[j], _E[k]) + np.outer(_E[k], _E[j])) / 2.0
    for j, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
}


@dataclass(frozen=True)
class UnitLoad:
    """Load that causes a unit state of stress in a body held at its tail."""

    acceleration: Array = field(default_factory=lambda: np.zeros(3))  # (3,) m/s^2 of the frame
    stretch: float = 0.0  # 1/s^2: gradient of the acceleration along x in the direction x
    force: Array = field(default_factory=lambda: np.zeros(3))  # (3,) N on the tip


#: Unit loads of the matrices of geometric stiffness by axial force N, in a body held at its tail: accelerations
#: a_x = 1 m/s^2 and a_x = x in 1/s^2 of the frame (compression: N < 0), and a tension of 1 N at the tip.
AXIAL = {
    "axial uniform": UnitLoad(acceleration=_E[0]),
    "axial linear": UnitLoad(stretch=1.0),
    "axial tip": UnitLoad(force=_E[0]),
}
#: Unit loads of the matrices of geometric stiffness by bending: a unit acceleration, or 1 N at the tip, along y or z.
BENDING = {f"bending uniform {_AXES[k]}": UnitLoad(acceleration=_E[k]) for k in (1, 2)}
BENDING |= {f"bending tip {_AXES[k]}": UnitLoad(force=_E[k]) for k in (1, 2)}
STATES = AXIAL | BENDING


def _linear_field_motions(j: int, k: int) -> Iterator[tuple[Array, str]]:
    """Yield pairs of a matrix S (3, 3) and the name of a rotation u, such as ``rz``, so that S u is the field x_k e_j.

    There is one pair for the rotation about each axis c other than k.  This rotation displaces points along the third
    axis b by x_k or -x_k, so S is e_j e_b^T or -e_j e_b^T.  A pair with b = j comes first, because other fields have
    the same S.
    """
    for c in sorted({0, 1, 2} - {k}, key=lambda c: 3 - c - k != j):
        b = 3 - c - k
        yield np.cross(_E[c], _E[k])[b] * np.outer(_E[j], _E[b]), f"r{_AXES[c]}"


#: Inputs M e_j by constant acceleration fields e_j, in m/s^2, each as a matrix S and a rigid motion u with S u = e_j.
CONSTANT = {f"inertia {axis}": ((np.outer(_E[j], _E[j]), axis),) for j, axis in enumerate(_AXES)}
#: Inputs M x_k e_j ("inertia jk") by linear acceleration fields, in 1/s^2, as pairs of S and u with S u = x_k e_j.
LINEAR = {f"inertia {_AXES[j]}{_AXES[k]}": tuple(_linear_field_motions(j, k)) for j in range(3) for k in range(3)}


@dataclass(frozen=True)
class Reactions:
    """Work of a body's forces on unit motions Phi (n, h), each of which moves one of its h rigid supports by 1.

    The body has n coordinates, i inputs and m rows.  The equations are in the module's docstring; V is the basis of a
    reduced body, and the identity for a full one.
    """

    AXES = {"names": "h", "units": "h", "inputs": "hi", "rows": "hm"} | dict.fromkeys(
        ("inertia", "damping", "stiffness"), "hn"
    )

    # (h,): names of the supports' rows, and units N, or N m for a rotation
    names: tuple[str, ...]
    units: tuple[str, ...]
    # Phi^T M V, Phi^T D V and Phi^T K V (h, n); after the n columns of a reduced model its enrichment modes may follow
    inertia: Array
    damping: Array
    stiffness: Array
    inputs: Array  # Phi^T B (h, i)
    rows: PPoly  # (C(s) Phi)^T (h, m), with zeros for rows that are rigid supports
    # U Phi (K, h): values of Phi on the K carriers U, if each row of the body has its own path coordinate
    carried: Array | None = None
    # by name: Phi^T A V (h, n) for each matrix A of the body's `matrices`, and values (h,) of each of its `ports` on
    # Phi
    matrices: Mapping[str, Array] = field(default_factory=dict)
    ports: Mapping[str, Array] = field(default_factory=dict)

    @property
    def supports(self) -> list[tuple[str, str]]:
        """Name and unit of each support; the unit is N, or N m for a rotation."""
        return list(zip(self.names, self.units, strict=True))

    def project(self, V: Array) -> Reactions:
        """Reactions of the body on new coordinates p (r,), from which the old coordinates follow as V p, with V (n, r).

        Columns beyond the first n, which belong to enrichment modes, are cut off: V has no values for them.
        """
        inertia, damping, stiffness = (A[:, : len(V)] @ V for A in (self.inertia, self.damping, self.stiffness))
        matrices = {name: A[:, : len(V)] @ V for name, A in self.matrices.items()}
        return replace(self, inertia=inertia, damping=damping, stiffness=stiffness, matrices=matrices)

    def with_rows(self, numbers: list[int]) -> Reactions:
        """Reactions of the body if it has only the rows `numbers`, in this order and numbered anew from 0."""
        return replace(self, rows=select_columns(self.rows, numbers))


#: Deviation from symmetry, and size of a negative eigenvalue, that are allowed relative to the largest entry.
SYMMETRIC = 1e-6
#: Most letters of a name that is composed of several names.
LONGEST = 4 * LONGEST_NAME


def describe_misfit(part: Any, sizes: Mapping[str, int], prefix: str = "") -> str | None:
    """Description of what is wrong with arrays, names and tables of the dataclass `part`; None if nothing is.

    ``part.AXES`` has a letter for each axis of a field, such as ``{"rows": "mr"}`` for values (m, r).  The size of a
    letter is taken from `sizes`, or else from the first axis with this letter.  Fields that are None are not checked.
    Fields that are dataclasses with ``AXES`` of their own are checked by these.  Only the first fault is described.
    `prefix` begins the names of the fields in the description.
    """
    sizes = dict(sizes)
    for name, axes in part.AXES.items():
        value = getattr(part, name)
        if value is None:
            continue
        if wrong := describe_names(name, value):
            return prefix + wrong
        values, has = (value.c, value.c.shape[2:]) if isinstance(value, PPoly) else (value, np.shape(value))
        if len(has) != len(axes):
            return f"{prefix}{name} has shape {has}, {len(axes)} axes are allowed"
        for letter, size in zip(axes, has, strict=True):
            sizes.setdefault(letter, size)
        if has != (allowed := tuple(sizes[letter] for letter in axes)):
            return f"{prefix}{name} has shape {has}, {allowed} is allowed"
        if not isinstance(value, tuple) and not np.isfinite(values).all():
            return f"{prefix}{name} is not finite"
        if isinstance(value, PPoly) and not (np.all(np.diff(value.x) > 0.0) and np.isfinite(value.x).all()):
            return f"the breaks of {prefix}{name} do not increase"
    parts = vars(part) if part.AXES else {}
    within = (
        describe_misfit(inner, sizes, f"{prefix}{key}.") for key, inner in parts.items() if hasattr(inner, "AXES")
    )
    return next((wrong for wrong in within if wrong), None)


def describe_misshapen(field: str, matrices: Mapping[str, NDArray[np.float64]], size: int) -> str | None:
    """Description of the first matrix, as ``field.name``, that is not (size, size) or not finite; None if all are.

    `matrices` are matrices by name.
    """
    for name, A in matrices.items():
        if A.shape != (size, size) or not np.isfinite(A).all():
            return f"{field}.{name} has shape {A.shape} or is not finite, {(size, size)} is allowed"
    return None


def describe_names(field: str, names: object) -> str | None:
    """Description of the first entry of `names` that is no name (`pmr.errors.is_name`); None if there is none.

    `field` is what holds them.  None is also returned if `names` is no tuple.
    """
    wrong = [name for name in names if not is_name(name, LONGEST)] if isinstance(names, tuple) else []
    return f"{field} holds {wrong[0]!r:.60}, which is not a name" if wrong else None


def symmetric_part(A: NDArray[np.float64]) -> NDArray[np.float64]:
    """Symmetric part (A + A^T) / 2 of matrices (..., n, n), which removes round-off."""
    return (A + A.swapaxes(-2, -1)) / 2.0


def pivoted_cholesky(A: NDArray[np.float64]) -> NDArray[np.float64]:
    """Factor L (n, r) of a positive semidefinite matrix A = L L^T (n, n) of rank r, by pivoted Cholesky.

    The product equals A up to round-off.
    """
    factor, pivots, rank, _ = scipy.linalg.lapack.dpstrf(A, lower=1)
    L = np.zeros((len(A), rank))
    L[pivots - 1] = np.tril(factor)[:, :rank]
    return L


def describe_asymmetry(matrices: Mapping[str, NDArray[np.float64]]) -> str | None:
    """Description of the first of `matrices`, (n, n) each, that is not symmetric or has a negative eigenvalue.

    None is returned if all are sound.  The matrix called M must not be singular either.  Deviations up to `SYMMETRIC`
    of the largest entry count as round-off.
    """
    for name, matrix in matrices.items():
        size = np.abs(matrix).max(initial=0.0)
        if np.abs(matrix - matrix.T).max(initial=0.0) > SYMMETRIC * size:
            return f"{name} is not symmetric"
        lowest = np.linalg.eigvalsh(matrix / size)[0] if size else 0.0
        if lowest < -SYMMETRIC or (name == "M" and lowest <= 0.0):
            return f"{name} has a negative eigenvalue" if lowest < 0.0 else f"{name} is singular"
    return None


#: Norm of A - L L^T, over the norm of A, up to which the difference is round-off.
ROUND_OFF = 1e-9


def cholesky_root(A: Array) -> Array | None:
    """Factor L (n, r) of a positive semidefinite A = L L^T (n, n), by Cholesky with pivots.

    None is returned if A is not positive semidefinite, which shows in the norm of A - L L^T.  If the lowest eigenvalue
    of A is negative, this norm is at least its absolute value, whatever L is.
    """
    L = pivoted_cholesky(A)
    return L if np.linalg.norm(A - L @ L.T) <= ROUND_OFF * np.linalg.norm(A) else None


def first_singular(A: Array, B: Array) -> float:
    """Smallest load P > 0 at which A + P B is not positive definite; infinity if there is no such P.

    A and B are (n, n); only their symmetric parts count.  If A itself is not positive definite, 0 is returned.
    """
    A, B = (A + A.T) / 2.0, (B + B.T) / 2.0
    try:
        least = float(scipy.linalg.eigh(B, A, eigvals_only=True, subset_by_index=(0, 0))[0])
    except np.linalg.LinAlgError:
        return 0.0
    return -1.0 / least if least < 0.0 else np.inf


def natural_frequencies(M: Array, V: Array | None, K: Array) -> Array:
    """Frequencies omega (n,) in rad/s, ascending, of M q'' + V q' + K q = 0, with matrices (n, n).

    M and K are symmetric, M is positive definite, and V is antisymmetric, or None for zero.  Directions in which K is
    not positive have omega = 0.

    The equations are solved for W z and z', with the coordinates z of the modes of K and the diagonal matrix W of these
    modes' frequencies.  In these unknowns they have the antisymmetric matrix (0, W; -W, -V).  So round-off is relative
    to the largest omega, not to its square.
    """
    if V is None or not np.any(V):
        return np.sqrt(np.maximum(scipy.linalg.eigh(K, M, eigvals_only=True), 0.0))
    omega2, X = scipy.linalg.eigh(K, M)
    W = np.diag(np.sqrt(np.maximum(omega2, 0.0)))
    turning = np.block([[np.zeros_like(W), W], [-W, -X.T @ V @ X]])
    return np.asarray(scipy.linalg.svdvals((turning - turning.T) / 2.0)[::-2])  # each omega is a singular value twice


#: A row takes part in a dependence if its share is at least this fraction of the largest share.
TAKES_PART = 1e-2


@dataclass(frozen=True)
class Dependence:
    """Result of a test whether rows depend on each other: `measure` is 1 for orthogonal rows, 0 for dependent ones.

    `names` are the rows that take part in the combination of rows that is closest to zero.  A row takes part if its
    share in this combination is at least `TAKES_PART` of the largest share.
    """

    measure: float
    names: tuple[str, ...]


def dependence_of_rows(C: Array, names: Sequence[str]) -> Dependence:
    """Dependence of rows C (m, r), measured by their smallest singular value after each is scaled to unit length.

    `names` are the names of the m rows.  The result names the rows that nearly depend on each other; if some rows are
    zero, the measure is 0 and only these rows are named.
    """
    size = np.linalg.norm(C, axis=1)
    if not size.all():
        return Dependence(0.0, tuple(name for name, length in zip(names, size, strict=True) if length == 0.0))
    U, sigma, _ = np.linalg.svd(C / size[:, None], full_matrices=True)
    measure = float(sigma[-1]) if len(sigma) == len(C) else 0.0
    return Dependence(measure, _involved_names(U[:, -1], names))


def dependence_of_flexibility(F: Array, names: Sequence[str]) -> Dependence:
    """Dependence of rows, measured by the lowest eigenvalue of their symmetric flexibility F (m, m).

    `names` are the names of the rows.  F is scaled to a unit diagonal before.  If diagonal entries are not positive,
    the measure is 0 and only the rows of these entries are named.
    """
    diagonal = np.diagonal(F)
    if not np.all(diagonal > 0.0):
        return Dependence(0.0, tuple(name for name, d in zip(names, diagonal, strict=True) if not d > 0.0))
    scale = np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(F / np.outer(scale, scale))
    return Dependence(float(values[0]), _involved_names(vectors[:, 0], names))


def _involved_names(shares: Array, names: Sequence[str]) -> tuple[str, ...]:
    """Names out of `names` (m,) of the rows whose share in `shares` (m,) is at least `TAKES_PART` of the largest."""
    large = np.abs(shares) >= TAKES_PART * np.abs(shares).max()
    return tuple(name for name, takes_part in zip(names, large, strict=True) if takes_part)
