"""A body held where its sliders stand, on nodes: what flexible-body files of other programs are made from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
