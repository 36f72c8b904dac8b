"""What is recorded of a full-order simulation: chosen outputs at every so many steps, whole states at a few times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.fullmodel.model import FullModel
from pmr.results import Energy, Response
from pmr.scene.names import ALONE
from pmr.simulation.columns import called
from pmr.system.body import force_outputs, length_outputs

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Recording:
    """What to keep.  Memory is of its order, and that of a few vectors.

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
    """Whole states of a body at t (S,) s: this rank's rows of q and v, (S, n_local), and the paths' s in m.

    s is (S,) of a body on one path, (S, P) of one in a system.
    """

    t: Array
    s: Array
    q: Array
    v: Array


@dataclass(frozen=True)
class History:
    """Outputs of a full-order simulation of one body; the same on every rank, but for `states`.

    Attributes
    ----------
    t, s : (T,) arrays, s and m
    y : (T, o) array, m
    multipliers : (T, m) array, N
    residual_position : (T,) array, m
        Largest violation of a row, max |C q - lambda / k|; of one that only pushes, beyond its clearance.
    residual_velocity : (T,) array, m/s
        Largest violation of a rigid row's time derivative, max |C v + s' C' q|; NaN where a row gives way.
    energy : Energy or None
        As asked; strain energy includes that of the pads.
    surplus : float
        Share of the largest energy that neither loads nor moving rows put in (`pmr.simulation.balance`); NaN where
        energies were not asked for at every step.
    states : States
    seconds : float
        Wall time of the steps, those before an interruption included.
    preparation : float, s
        Wall time of the factorisation and the compliance of the path.
    peaks : (T, m) array, N, or None
        Largest multiplier within the step that ends at t, where rows only push; of the others that at t.
    """

    t: Array
    s: Array
    y: Array
    multipliers: Array
    residual_position: Array
    residual_velocity: Array
    energy: Energy | None
    states: States
    seconds: float
    preparation: float
    surplus: float = np.nan
    peaks: Array | None = None


@dataclass(frozen=True)
class SystemHistory:
    """The same of a system of bodies.

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
        Multipliers of the supports that hold one coordinate, one body after the other.
    states : mapping of str to States
        Of each body.
    residual_position, residual_velocity, energy, surplus, seconds, preparation
        As of a `History`.
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


def respond(model: FullModel, history: History) -> Response:
    """What `pmr.compare.errors` and the report ask of a simulator; of all outputs, with energies."""
    assert history.energy is not None
    force, length = force_outputs(model), length_outputs(model)
    released = sorted({*model.rows.moving, *np.flatnonzero(~np.isnan(model.rows.clearance)).tolist()})
    supports = [model.rows.rows[k] for k in model.rows.fixed]
    names = called(model, [model.rows.names[k] for k in released])
    names = names.with_reactions([row.name for row in supports], [row.unit for row in supports])
    others = np.hstack([history.y[:, ~(force | length)], history.multipliers[:, model.rows.fixed]])
    return Response(
        t=history.t,
        x=model.output_positions[length],
        displacement=history.y[:, length],
        energy=history.energy,
        slider_force=np.hstack([history.y[:, force], history.multipliers[:, released]]),
        residual_position=history.residual_position,
        residual_velocity=history.residual_velocity,
        seconds=history.preparation + history.seconds,
        surplus=history.surplus,
        output_names=names.moved,
        output_units=("m",) * len(names.moved),
        force_names=names.forces,
        force_peaks=None if history.peaks is None else np.hstack([history.y[:, force], history.peaks[:, released]]),
        others=others if others.shape[1] else None,
        other_names=names.others,
        other_units=names.other_units,
        kinds=names.all_kinds,
        bodies=(ALONE,) * len(names.all_kinds),
    )
