"""A body held where its sliders stand, as other programs take it: on frames (superelements) or on nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp
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


@dataclass(frozen=True)
class Places:
    """P named places that other bodies and loads act on: the mean over a group, or a section of the body.

    Attributes
    ----------
    names : tuple of str
    points : (P, 3) array, m
    displacement, rotation : (P, 3, m) arrays, 1 and 1/m
        Of the place under each of the body's modes.
    """

    names: tuple[str, ...]
    points: Array
    displacement: Array
    rotation: Array


@dataclass(frozen=True)
class NodalBody:
    """Mass and stiffness on N nodes with three displacements each, node by node, and m modes of it.

    Attributes
    ----------
    s : float, m
        Where the sliders stand.
    points : (N, 3) array, m
    M, K : sparse (3 N, 3 N)
        K has the springs of all that gives way at s; what is rigid the modes know.
    modes : (3 N, m) array
        The lowest at s, M-orthonormal, in 1/sqrt(kg).
    omega : (m,) array, rad/s
        K on the modes is diag(omega^2).
    damping : (m, m) array, 1/s
        D on the modes: not diagonal, as nothing damps what gives way at moving pads.
    places : Places
    """

    s: float
    points: Array
    M: sp.csr_matrix
    K: sp.csr_matrix
    modes: Array
    omega: Array
    damping: Array
    places: Places
