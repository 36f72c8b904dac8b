"""Rigid motions of a body in closed form, and what of them is held by more than constraint rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RigidMotions:
    """Rigid motions of a body, known from its geometry alone.

    Attributes
    ----------
    coordinates : (n_local, k) array
        This rank's rows of the coordinates under each of k motions: translations, then rotations (`directions` of the
        model).  Coordinates that are clamped are missing.
    held : (h, k) array
        What clamps and springs measure of each motion, in m or rad: a motion is free of them where all of it is zero.
    """

    coordinates: Array
    held: Array
