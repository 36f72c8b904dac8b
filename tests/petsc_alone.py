"""Simulate a full model alone in PETSc, as the system of one body, with its rows in place of contacts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pmr.files.arrays import Array
from pmr.fullmodel.model import FullModel, FullSystem
from pmr.results import Energy
from pmr.simulation import Excitation, InitialState, petsc
from pmr.simulation.petsc import States


@dataclass(frozen=True)
class Alone:
    """Results of a model alone at T times: path s (T,), outputs y (T, o), forces of its rows (T, m), and states."""

    t: Array
    s: Array
    y: Array
    multipliers: Array
    peaks: Array
    states: States
    residual_position: Array
    residual_velocity: Array
    energy: Energy
    surplus: float
    seconds: float


def observe(
    model: FullModel,
    excitation: Excitation,
    states: Sequence[float] = (),
    initial: InitialState | None = None,
    *more: Any,
    **named: Any,
) -> Alone:
    """Simulate as `pmr.simulation.petsc.simulator` does."""
    system = FullSystem.of(model)
    found = petsc.observe(system, excitation, states, {} if initial is None else {"": initial}, *more, **named)
    names = [contact.name for contact in system.with_supports().contacts]
    rows = [names.index(name) for name in model.row_names]
    forces, peaks = (np.hstack([one, found.supports])[:, rows] for one in (found.contacts.forces, found.contacts.peaks))
    return Alone(
        found.t, found.s[:, 0], found.y[""], forces, peaks, found.states[""],
        found.errors.position, found.errors.velocity, found.energy, found.errors.surplus,
        found.seconds.steps,
    )  # fmt: skip
