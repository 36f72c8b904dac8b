"""Circular frequencies of a reduced model with its rows held at one path coordinate after the other."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr import closed_form
from pmr.reduced import ReducedModel
from pmr.scene import Scene

Array = NDArray[np.float64]


def reduced_frequencies(model: ReducedModel, s: Array, count: int) -> Array:
    """The `count` lowest frequencies (S, count) in rad/s at the path coordinates s (S,) m.

    Where fewer coordinates are free than asked for, the rest is NaN.
    """
    result = np.full((len(s), count), np.nan)
    for i, at in enumerate(s):
        Z = scipy.linalg.null_space(model.C(at))
        omega2 = scipy.linalg.eigh(Z.T @ model.K @ Z, Z.T @ model.M @ Z, eigvals_only=True)[:count]
        result[i, : len(omega2)] = np.sqrt(np.maximum(omega2, 0.0))
    return result


def closed_form_frequencies(scene: Scene, s: Array, count: int) -> Array:
    """Bending frequencies (S, count) in rad/s of the scene's beam, or (S, 0) where there is no closed form."""
    body = scene.body
    pinned = len(scene.supports) == 1 and scene.supports[0].at == 0.0 and scene.supports[0].kind != "clamped"
    if not pinned or scene.slider.offsets != (0.0,):
        return np.empty((len(s), 0))
    return np.array(
        [
            closed_form.frequencies(float(at), body.length, body.bending_stiffness, body.mass_per_length, count)
            for at in s
        ]
    )
