"""Frequency response of a state space."""

import numpy as np
from numpy.typing import NDArray

from pmr.export.state_space import StateSpace


def frequency_response(space: StateSpace, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Frequency response C (i omega - A)^-1 B + D, complex (S, W, q, i), at circular frequencies (W,) in rad/s.

    S is the number of state spaces, q of their outputs and i of their inputs.
    """
    resolvents = [np.linalg.solve(1j * w * np.eye(space.A.shape[1]) - space.A, space.B) for w in omega]
    return np.stack([space.C @ one + space.D for one in resolvents], axis=1)
