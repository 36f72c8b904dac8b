r"""Residual flexibility: what the truncated coordinates would have answered at once, as small tables in s.

Beside it the first modes in that part.

With R the flexibility that a basis leaves out and q = V p + R (B f - C^T lambda), the rows and outputs become

.. math::
    C V p + H f - (G + 1/k) \lambda = 0, \qquad y = O V p + W f - X \lambda, \qquad
    G = C R C^T, \quad H = C R B, \quad X = O R C^T, \quad W = O R B

(static correction after MacNeal 1971 and Rubin 1975, here with rows C(s) that move).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import applied_change, apply_table, columns, select_rows, side_by_side, transpose

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Flexibility:
    """Tables of the residual flexibility of a body with m rows, i inputs and o outputs."""

    AXES: ClassVar = {"rows": "mm", "inputs": "mi", "outputs": "om", "direct": "oi", "energy": "ii"}

    rows: PPoly  # G(s) = C R C^T (m, m) m/N: displacement at one row under a unit force at another
    inputs: PPoly  # H(s) = C R B (m, i) m/N
    outputs: PPoly  # X(s) = O R C^T (o, m) m/N
    direct: Array  # W = O R B (o, i) m/N
    energy: Array  # B^T R B (i, i) m/N: twice the residual strain energy under unit inputs

    def with_rows(self, numbers: Sequence[int]) -> Flexibility:
        """Return the flexibility of a body with none but these of its rows."""
        rows, inputs = (select_rows(table, numbers) for table in (self.rows, self.inputs))
        outputs = columns(self.outputs, numbers)
        return replace(self, rows=columns(rows, numbers), inputs=inputs, outputs=outputs)

    def row_motion(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """H(s) f - G(s) lambda, (T, m) in m: what the residual part adds at the rows, along a trajectory."""
        return apply_table(self._at_rows, s, np.hstack([loads, -multipliers]))

    def row_motion_change(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """Change of the rows' motion, (T - 1, m) m, from one s (T,) to the next under forces and loads (T - 1, ...)."""
        return applied_change(self._at_rows, s, np.hstack([loads, -multipliers]))

    def displacement(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """W f - X(s) lambda, (T, o) in m: what the residual part adds to the outputs."""
        return np.asarray(loads @ self.direct.T - apply_table(self.outputs, s, multipliers))

    def strain_energy(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """g^T R g / 2 with g = B f - C^T lambda, (T,) in J."""
        doubled = np.einsum("ti,ti->t", loads @ self.energy, loads)
        of_rows = apply_table(self._at_rows, s, np.hstack([-2.0 * loads, multipliers]))
        return np.asarray(doubled + np.einsum("tm,tm->t", multipliers, of_rows)) / 2.0

    def input_motion(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """B^T R g, (T, i) in m: what the residual part adds to the motion of the loads' points."""
        return np.asarray(loads @ self.energy - apply_table(self._of_rows, s, multipliers))

    @cached_property
    def _of_rows(self) -> PPoly:
        """H(s)^T."""
        return transpose(self.inputs)

    @cached_property
    def _at_rows(self) -> PPoly:
        """H(s) and G(s) side by side."""
        return side_by_side(self.inputs, self.rows)


@dataclass(frozen=True)
class EnrichmentModes:
    """The first c modes that a model truncates, M-orthonormal and in ascending order; m rows, i inputs, o outputs.

    Their flexibility is part of the model's tables; as coordinates they serve to estimate its error, or to have more
    coordinates after all (`pmr.reduced.truncation`).
    """

    AXES: ClassVar = {"stiffness": "c", "damping": "c", "B": "ci", "outputs": "oc", "rows": "mc"}

    stiffness: Array  # omega^2 (c,) in (rad/s)^2
    damping: Array  # phi^T D phi = 2 zeta omega (c,) 1/s
    B: Array  # (c, i)
    outputs: Array  # (o, c)
    rows: PPoly  # C(s) phi (m, c)
    # (r + c, r + c): what a model with them among its coordinates has as `matrices`
    matrices: Mapping[str, Array] = field(default_factory=dict)

    @property
    def count(self) -> int:
        return len(self.stiffness)
