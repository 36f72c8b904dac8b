"""Enrichment modes: the first modes that a reduced model truncates, kept beside it.

Their flexibility is part of the model's tables; as coordinates they serve to estimate its error, or to have more
coordinates after all (`pmr.reduced.truncation`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

Array = NDArray[np.float64]
_CONSTANTS = ("stiffness", "damping", "B", "outputs")


@dataclass(frozen=True)
class EnrichmentModes:
    """c M-orthonormal modes of a body with m rows, i inputs and o outputs, in ascending order.

    Attributes
    ----------
    stiffness : (c,) array, (rad/s)^2
        omega^2.
    damping : (c,) array, 1/s
        phi^T D phi: 2 zeta omega.
    B : (c, i) array
    outputs : (o, c) array
    rows : PPoly with values (m, c)
        C(s) phi.
    """

    stiffness: Array
    damping: Array
    B: Array
    outputs: Array
    rows: PPoly

    @property
    def count(self) -> int:
        return len(self.stiffness)

    def arrays(self) -> dict[str, Array]:
        """Named arrays for a file, as `from_arrays` reads them."""
        constants = {f"companions.{name}": getattr(self, name) for name in _CONSTANTS}
        return constants | {"companions.breaks": self.rows.x, "companions.coefficients": self.rows.c}

    @classmethod
    def from_arrays(cls, data: Mapping[str, Array]) -> EnrichmentModes | None:
        """What `arrays` gave; None if there is none in `data`."""
        if "companions.stiffness" not in data:
            return None
        constants = {name: np.asarray(data[f"companions.{name}"], dtype=float) for name in _CONSTANTS}
        return cls(**constants, rows=PPoly(data["companions.coefficients"], data["companions.breaks"]))

    def contradiction(self, m: int, i: int, o: int) -> str | None:
        """What is wrong with the shapes for m rows, i inputs and o outputs, in words; None where all is sound."""
        c = self.count
        for name, shape in {"stiffness": (c,), "damping": (c,), "B": (c, i), "outputs": (o, c)}.items():
            array = getattr(self, name)
            if array.shape != shape or not np.isfinite(array).all():
                return f"enrichment.{name} has shape {array.shape} or is not finite, {shape} is allowed"
        if self.rows.c.shape[2:] != (m, c) or not np.isfinite(self.rows.c).all():
            return f"enrichment.rows has shape {self.rows.c.shape[2:]} or is not finite, {(m, c)} is allowed"
        if not np.all(self.stiffness > 0.0):
            return "enrichment.stiffness is not positive"
        return None
