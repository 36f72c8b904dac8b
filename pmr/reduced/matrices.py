r"""Matrices of a body beside mass and stiffness: damping, of a moving frame, of axial forces, of rigid supports.

Forces of rigid supports, which hold without a multiplier of their own, from the equations of motion.

With motions :math:`\Phi` of the body that move one support by one and leave all others at rest,

.. math::
    \lambda_f = \Phi^T \bigl(B f - M \ddot q - D \dot q - K q - C(s)^T \lambda\bigr), \qquad C_f \Phi = I

is what the body presses on each support with, positive along its direction, as the force of one that gives way.  Any
such motions do for a full model.  A reduced one takes the static ones, all that slides released: with them
:math:`\Phi^T K q = 0` for every q that the supports allow, so the local stiffness at a support, which few coordinates
know least of, has no say (Craig and Bampton's constraint modes; for a statically determinate body rigid motions, and
the sum of forces and moments).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import columns


@dataclass(frozen=True)
class Rayleigh:
    """D = alpha M + beta K, alpha in 1/s, beta in s; zeta = (alpha / omega + beta omega) / 2 in each mode.

    Bathe: Finite Element Procedures, 1996, section 9.3.3.
    """

    alpha: float
    beta: float

    def of(self, M: Array, K: Array) -> Array:
        """Alpha M + beta K of any matrices of one shape, with the units of damping."""
        return self.alpha * M + self.beta * K

    def modal(self, omega2: Array) -> Array:
        """phi^T D phi = 2 zeta omega (k,) in 1/s of M-orthonormal modes with omega^2 (k,)."""
        return self.alpha + self.beta * omega2


Array = NDArray[np.float64]

_E, _AXES = np.eye(3), "xyz"
#: S of T_k = int rho v . S u, S u = e_k x u, antisymmetric: an angular velocity makes 2 omega_k T_k q', its rate
#: alpha_k T_k q.
ROTATING = {f"rotating {axis}": np.cross(_E[k], _E).T for k, axis in enumerate(_AXES)}
#: S of N_jk = int rho (v_j u_k + v_k u_j) / 2: omega x (omega x u) makes sum_jk omega_j omega_k N_jk - |omega|^2 M.
CARRIED = {
    f"carried {_AXES[j]}{_AXES[k]}": (np.outer(_E[j], _E[k]) + np.outer(_E[k], _E[j])) / 2.0
    for j, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
}


@dataclass(frozen=True)
class UnitLoad:
    """Load that makes a unit state of stress in a body that is held at its tail."""

    acceleration: Array = field(default_factory=lambda: np.zeros(3))  # of the frame, (3,) m/s^2
    stretch: float = 0.0  # 1/s^2: by how much that along x grows with x
    force: Array = field(default_factory=lambda: np.zeros(3))  # on the tip, (3,) N


#: Geometric stiffness of the axial force N that, in a body held at its tail, a unit acceleration of the frame makes,
#: a_x = 1 m/s^2 or a_x = x in 1/s^2 (compression: N < 0), and a tension of 1 N at the tip.
AXIAL = {
    "axial uniform": UnitLoad(acceleration=_E[0]),
    "axial linear": UnitLoad(stretch=1.0),
    "axial tip": UnitLoad(force=_E[0]),
}
#: The same of bending: a unit acceleration across, or a force of 1 N across at the tip.
BENDING = {f"bending uniform {_AXES[k]}": UnitLoad(acceleration=_E[k]) for k in (1, 2)}
BENDING |= {f"bending tip {_AXES[k]}": UnitLoad(force=_E[k]) for k in (1, 2)}
STATES = AXIAL | BENDING


def _linear(j: int, k: int) -> Iterator[tuple[Array, str]]:
    """The rotation about c moves the component b, the third one, by x_k or by -x_k."""
    for c in range(3):
        if c != k:
            b = 3 - c - k
            yield np.cross(_E[c], _E[k])[b] * np.outer(_E[j], _E[b]), f"r{_AXES[c]}"


#: Inputs M times the constant fields e_j, in m/s^2: S and the rigid motion that S makes the field of.
CONSTANT = {f"inertia {axis}": ((np.outer(_E[j], _E[j]), axis),) for j, axis in enumerate(_AXES)}
#: Inputs M times the fields x_k e_j ("inertia jk"), in 1/s^2: likewise, by either of two rigid motions.
LINEAR = {f"inertia {_AXES[j]}{_AXES[k]}": tuple(_linear(j, k)) for j in range(3) for k in range(3)}


@dataclass(frozen=True)
class Reactions:
    """Work of a body's forces on the motions of its h rigid supports."""

    AXES: ClassVar = {"names": "h", "units": "h", "inputs": "hi", "rows": "hm"} | dict.fromkeys(
        ("inertia", "damping", "stiffness"), "hn"
    )

    # of the supports' rows; N, or N m of a rotation
    names: tuple[str, ...]
    units: tuple[str, ...]
    # Phi^T M V, Phi^T D V and Phi^T K V (h, n); a reduced model's may have columns of enrichment modes after its own
    inertia: Array
    damping: Array
    stiffness: Array
    inputs: Array  # Phi^T B (h, i)
    rows: PPoly  # (C(s) Phi)^T (h, m) of the rows that are no rigid supports, zero for these
    # U Phi (K, h) on the carriers of a body of a system, whose rows each have a path coordinate of their own
    carried: Array | None = None
    # Phi^T A V (h, n) of the body's `matrices`, and its `ports` on Phi, (h,) each, by their names
    matrices: Mapping[str, Array] = field(default_factory=dict)
    ports: Mapping[str, Array] = field(default_factory=dict)

    @property
    def supports(self) -> list[tuple[str, str]]:
        """Name and unit of each support."""
        return list(zip(self.names, self.units, strict=True))

    def on(self, V: Array) -> Reactions:
        """Reactions of the body projected on V (n, r)."""
        inertia, damping, stiffness = (A[:, : len(V)] @ V for A in (self.inertia, self.damping, self.stiffness))
        matrices = {name: A[:, : len(V)] @ V for name, A in self.matrices.items()}
        return replace(self, inertia=inertia, damping=damping, stiffness=stiffness, matrices=matrices)

    def with_rows(self, numbers: list[int]) -> Reactions:
        """Reactions of the body with none but these of its rows."""
        return replace(self, rows=columns(self.rows, numbers))
