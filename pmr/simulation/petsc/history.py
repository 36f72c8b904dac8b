"""What is recorded of a full-order simulation: chosen outputs at every so many steps, whole states at a few times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.results import Energy

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Recording:
    """Choice of what is recorded.  Memory is of its order, and that of a few vectors.

    Attributes
    ----------
    outputs : sequence of int, optional
        Numbers of the outputs, those of one body after the other; all by default.
    every : int
        Keep each `every`-th step, the first one included.
    energies : bool
        Two products with a matrix at each of these steps.
    states : sequence of float, s
        Times at which the whole state is recorded; the nearest step counts.
    """

    outputs: Sequence[int] | None = None
    every: int = 1
    energies: bool = False
    states: Sequence[float] = ()


@dataclass(frozen=True)
class States:
    """Whole states of a body at t (S,) s: this rank's rows of q and v, (S, n_local), and the paths' s (S, P) in m."""

    t: Array
    s: Array
    q: Array
    v: Array


@dataclass(frozen=True)
class History:
    """Outputs of a full-order simulation; the same on every rank, but for `states`.

    Attributes
    ----------
    t : (T,) array, s
    s : (T, P) array, m
        Of the paths, in the order of the excitation.
    y : mapping of str to (T, o) array
        Chosen outputs of each body.
    forces, peaks : (T, m) arrays, N
        Of the contacts, positive where they push: at t, and the largest within the step that ends there of those that
        only push.
    supports : (T, h) array, N
        Multipliers of the supports that hold one coordinate, one body after the other (`FullSystem.with_supports`).
    residual_position : (T,) array, m
        Largest violation of a row, max |C q - lambda / k|; of one that only pushes, beyond its clearance.
    residual_velocity : (T,) array, m/s
        Largest violation of a rigid row's time derivative, max |C v + s' C' q|; NaN where a row gives way.
    energy : Energy or None
        As asked; strain energy includes that of the pads.
    states : mapping of str to States
        Of each body.
    seconds : float
        Wall time of the steps, those before an interruption included.
    preparation : float, s
        Wall time of the factorisation and the compliance of the path.
    surplus : float
        Share of the largest energy that neither loads nor moving rows put in (`pmr.simulation.balance`); NaN where
        energies were not asked for at every step.
    friction : (T, n) array, N, or None
        Of the pads that rub, along the boom (`pmr.system.friction`).
    """

    t: Array
    s: Array
    y: Mapping[str, Array]
    forces: Array
    peaks: Array
    supports: Array
    residual_position: Array
    residual_velocity: Array
    energy: Energy | None
    states: Mapping[str, States]
    seconds: float
    preparation: float
    surplus: float = np.nan
    friction: Array | None = None
