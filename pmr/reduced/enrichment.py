"""Enrichment modes: the first modes that a reduced model truncates, kept beside it.

Their flexibility is part of the model's tables; as coordinates they serve to estimate its error, or to have more
coordinates after all (`pmr.reduced.truncation`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.reduced.soundness import misfit

Array = NDArray[np.float64]


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

    def contradiction(self, m: int, i: int, o: int) -> str | None:
        """What is wrong with the shapes for m rows, i inputs and o outputs, in words; None where all is sound."""
        c = self.count
        shapes = {"stiffness": (c,), "damping": (c,), "B": (c, i), "outputs": (o, c), "rows": (m, c)}
        if wrong := misfit(self, shapes, "enrichment."):
            return wrong
        return None if np.all(self.stiffness > 0.0) else "enrichment.stiffness is not positive"
