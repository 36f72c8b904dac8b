r"""Where axes that move with a boom are in space.

.. math:: X = R(t)\, (o(t) + r), \qquad U = R(t)\, u

r and u are a place and a displacement along the moving axes, o is where their origin is from the pivot, along them too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """Moving axes at S times: their rotation (S, 3, 3) and their origin (S, 3) in m."""

    rotation: Array
    origin: Array

    def places(self, points: ArrayLike) -> Array:
        """Places (S, n, 3) in m from the pivot in space, of places (S, n, 3) or (n, 3) in the moving axes."""
        from_pivot = np.asarray(points, float) + self.origin[:, None, :]
        return np.asarray(np.einsum("sij,snj->sni", self.rotation, from_pivot))

    def at(self, k: int, points: ArrayLike) -> Array:
        """Places (..., 3) in m in space at time number k, of places (..., 3) in the moving axes."""
        return self.turned(k, np.asarray(points, float) + self.origin[k])

    def turned(self, k: int, vectors: ArrayLike) -> Array:
        """Vectors (..., 3) in space at time number k, of vectors (..., 3) in the moving axes."""
        return np.asarray(np.asarray(vectors, float) @ self.rotation[k].T)
