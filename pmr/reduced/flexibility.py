r"""Residual flexibility: what the truncated coordinates would have answered at once, as small tables in s.

With R the flexibility that a basis leaves out and q = V p + R (B f - C^T lambda), the rows and outputs become

.. math::
    C V p + H f - (G + 1/k) \lambda = 0, \qquad y = O V p + W f - X \lambda, \qquad
    G = C R C^T, \quad H = C R B, \quad X = O R C^T, \quad W = O R B

(static correction after MacNeal 1971 and Rubin 1975, here with rows C(s) that move).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import side_by_side, transposed
from pmr.reduced.inertia import Inertia
from pmr.reduced.soundness import misfit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Flexibility:
    """Tables of the residual flexibility of a body with m rows, i inputs and o outputs.

    Attributes
    ----------
    rows : PPoly with values (m, m), m/N
        G(s) = C R C^T: displacement at one row under a unit force at another.
    inputs : PPoly with values (m, i), m/N
        H(s) = C R B.
    outputs : PPoly with values (o, m), m/N
        X(s) = O R C^T.
    direct : (o, i) array, m/N
        W = O R B.
    energy : (i, i) array, m/N
        B^T R B: twice the residual strain energy under unit inputs.
    inertia : Inertia, optional
        What is neglected with the inertia of the residual part, or kept (`pmr.reduced.inertia`).
    """

    rows: PPoly
    inputs: PPoly
    outputs: PPoly
    direct: Array
    energy: Array
    inertia: Inertia | None = None

    @property
    def keeps_inertia(self) -> bool:
        """Whether the equations of motion keep the inertia of the residual part."""
        return self.inertia is not None and self.inertia.kept

    def row_motion(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """H(s) f - G(s) lambda, (T, m) in m: what the residual part adds at the rows, along a trajectory."""
        from pmr.constraints.applied import applied

        return applied(self._at_rows, s, np.hstack([loads, -multipliers]))

    def row_motion_change(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """What that changes by, (T - 1, m) in m, from each s (T,) to the next under forces and loads (T - 1, ...)."""
        from pmr.constraints.applied import applied_change

        return applied_change(self._at_rows, s, np.hstack([loads, -multipliers]))

    def displacement(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """W f - X(s) lambda, (T, o) in m: what the residual part adds to the outputs."""
        from pmr.constraints.applied import applied

        return np.asarray(loads @ self.direct.T - applied(self.outputs, s, multipliers))

    def strain_energy(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """g^T R g / 2 with g = B f - C^T lambda, (T,) in J."""
        from pmr.constraints.applied import applied

        doubled = np.einsum("ti,ti->t", loads @ self.energy, loads)
        of_rows = applied(self._at_rows, s, np.hstack([-2.0 * loads, multipliers]))
        return np.asarray(doubled + np.einsum("tm,tm->t", multipliers, of_rows)) / 2.0

    def input_motion(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """B^T R g, (T, i) in m: what the residual part adds to the motion of the loads' points."""
        from pmr.constraints.applied import applied

        return np.asarray(loads @ self.energy - applied(transposed(self.inputs), s, multipliers))

    @cached_property
    def _at_rows(self) -> PPoly:
        """H(s) and G(s) side by side."""
        return side_by_side(self.inputs, self.rows)

    def contradiction(self, m: int, i: int, o: int) -> str | None:
        """What is wrong with the shapes for m rows, i inputs and o outputs, in words; None where all is sound."""
        shapes = {"rows": (m, m), "inputs": (m, i), "outputs": (o, m), "direct": (o, i), "energy": (i, i)}
        wrong = misfit(self, shapes, "flexibility.")
        return wrong or (self.inertia.contradiction(m, i) if self.inertia else None)
