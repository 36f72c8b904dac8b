r"""Forces of rigid supports, which hold without a multiplier of their own, from the equations of motion.

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

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import columns

Array = NDArray[np.float64]


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
