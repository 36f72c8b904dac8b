"""Natural frequencies of dense equations that also turn."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

Array = NDArray[np.float64]


def oscillations(M: Array, V: Array | None, K: Array) -> Array:
    """Omega (n,) rad/s of M q'' + V q' + K q = 0 with an antisymmetric V, ascending; zero where K does not hold.

    With modes of K, of rates z' and strains omega z the equations are antisymmetric, (0, W; -W, -V): round-off stays
    that of the largest omega, not of its square.
    """
    if V is None or not np.any(V):
        return np.sqrt(np.maximum(scipy.linalg.eigh(K, M, eigvals_only=True), 0.0))
    omega2, X = scipy.linalg.eigh(K, M)
    W = np.diag(np.sqrt(np.maximum(omega2, 0.0)))
    turning = np.block([[np.zeros_like(W), W], [-W, -X.T @ V @ X]])
    return np.asarray(np.abs(scipy.linalg.eigvalsh(1j * (turning - turning.T) / 2.0)[len(W) :]))
