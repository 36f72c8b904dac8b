"""Circular frequencies of a reduced model with its rows held at one path coordinate after the other."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.compare import closed_form
from pmr.reduced.model import ReducedModel
from pmr.results import FrequencyCurves
from pmr.scene import Scene
from pmr.scene.choice import is_pinned_beam
from pmr.system.compliant_rows import CompliantRows

Array = NDArray[np.float64]


#: Frequencies that are compared, and places at which: beyond so many coordinates each of these costs some tenths of a
#: second and more.
CURVES, POSITIONS, FEWER_POSITIONS, LARGE = 6, 49, 11, 300


def visited_positions(scene: Scene, size: int) -> Array:
    """Path coordinates (S,) in m, evenly over the path, at which frequencies of `size` coordinates are compared."""
    low, high = scene.path_bounds
    return np.linspace(low, high, POSITIONS if size <= LARGE else FEWER_POSITIONS) if high > low else np.array([low])


def frequency_curves(scene: Scene, reduced: ReducedModel, s: Array, full: Array) -> FrequencyCurves:
    """Those of the reduced model, and in closed form where there is one, beside the full model's (S, f) at s (S,)."""
    count = full.shape[1]
    return FrequencyCurves(
        s,
        full,
        reduced=reduced_frequencies(reduced, s, count),
        closed_form=closed_form_frequencies(scene, s, count),
    )


def reduced_frequencies(model: ReducedModel, s: Array, count: int) -> Array:
    """The `count` lowest frequencies (S, count) in rad/s at the path coordinates s (S,) m.

    Where fewer coordinates are free than asked for, the rest is NaN.

    Raises
    ------
    SimulationError
        If rows that give way do so by nothing at one of the s.
    """
    result = np.full((len(s), count), np.nan)
    compliant = CompliantRows(model)
    firm = [i for i in range(len(model.row_names)) if i not in compliant.numbers]
    K = compliant.system(s)[:, :, : model.size] if compliant.numbers else np.repeat(model.K[None], len(s), axis=0)
    for i, at in enumerate(s):
        Z = scipy.linalg.null_space(model.C(at)[firm]) if firm else np.eye(model.size)
        if Z.shape[1] == 0:
            continue
        omega2 = scipy.linalg.eigh(Z.T @ K[i] @ Z, Z.T @ model.M @ Z, eigvals_only=True)[:count]
        result[i, : len(omega2)] = np.sqrt(np.maximum(omega2, 0.0))
    return result


def closed_form_frequencies(scene: Scene, s: Array, count: int) -> Array:
    """The `count` lowest frequencies (S, count) in rad/s of the scene's beam, or (S, 0) where there is no closed form.

    With axial coordinates those of the bar, held at 0 and free at its end, stand among those of bending.
    """
    profile = scene.body.profile
    if profile is None or not is_pinned_beam(scene):
        return np.empty((len(s), 0))
    axial = np.empty(0)
    if profile.axial and profile.axial_stiffness is not None:
        axial = closed_form.axial_frequencies(profile.length, profile.axial_stiffness, profile.mass_per_length, count)
    beam = profile.length, profile.bending_stiffness, profile.mass_per_length
    within = np.minimum(s, profile.length)  # a path may pass the end by round-off
    bending = [closed_form.frequencies(float(at), *beam, count) for at in within]
    return np.array([np.sort(np.concatenate([row, axial]))[:count] for row in bending])
