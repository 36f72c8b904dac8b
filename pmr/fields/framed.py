"""A body held where its sliders stand, as coordinates of frames: the form that superelements have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Frames:
    """F frames by name, and their origins (F, 3) in m."""

    names: tuple[str, ...]
    points: Array


@dataclass(frozen=True)
class FramedBody:
    """M y'' + C y' + K y = f, y (6 F + m) being six displacements (m) and rotations (rad) of each frame, then m modes.

    The first frame is the ground: what pads and supports at s are attached to.

    Attributes
    ----------
    s : float, m
        Where the sliders stand.
    places : Frames
    M, C, K : (6 F + m, 6 F + m) arrays, symmetric, SI units
        K has six rigid motions, those of all frames together.
    """

    s: float
    places: Frames
    M: Array
    C: Array
    K: Array

    @property
    def modes(self) -> int:
        """Number of modes m."""
        return len(self.M) - 6 * len(self.places.names)

    @property
    def omega(self) -> Array:
        """The m lowest frequencies (m,) in rad/s with the ground at rest and all other frames free."""
        values = scipy.linalg.eigh(self.M[6:, 6:], self.K[6:, 6:], eigvals_only=True)[::-1]
        return np.asarray(1.0 / np.sqrt(values[: self.modes]))
