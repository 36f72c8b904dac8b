r"""Matrices of a body for damping, a moving frame, axial forces and rigid supports, besides mass and stiffness.

Forces of rigid supports, which have no multiplier of their own, follow from the equations of motion.  With motions
:math:`\Phi` of the body that move one support by one and leave all others at rest,

.. math::
    \lambda_f = \Phi^T \bigl(B f - M \ddot q - D \dot q - K q - C(s)^T \lambda\bigr), \qquad C_f \Phi = I

is the force of the body on each support, with the rows :math:`C_f` of the rigid supports and the rows C(s) of sliders
and pads.  It is positive along the support's direction, like the force of a support with a stiffness.  Any such motions
are right for a full model.  A reduced model uses the static ones, with all sliders and pads released: for these
:math:`\Phi^T K q = 0` for every q that the supports allow, so the local stiffness at a support, which few coordinates
represent badly, has no influence (Craig and Bampton's constraint modes; for a statically determinate body they are
rigid motions, and the equations are the sums of forces and moments).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from scipy.interpolate import PPoly

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
    """Pairs of a matrix S (3, 3) and the name of a rigid motion u, such as ``rz``: S u is the field x_k e_j.

    There is one pair for the rotation about each axis c other than k.  The rotation moves the third component b by x_k
    or -x_k, so S is e_j e_b^T with this sign.  A pair with b = j comes first, since other fields have the same S.
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

    AXES: ClassVar = {"names": "h", "units": "h", "inputs": "hi", "rows": "hm"} | dict.fromkeys(
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
        """Reactions of the body if it has only the rows with these `numbers`."""
        return replace(self, rows=select_columns(self.rows, numbers))
