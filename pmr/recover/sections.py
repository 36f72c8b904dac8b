"""Fields and stresses of a boom's sections, each from its own coordinates and the forces of its contacts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.fullmodel.build import Built
from pmr.recover.coordinates import Recovery, ReducedStates, chosen_states
from pmr.recover.from_scene import Recovered, recover
from pmr.reduce.sections import ReducedSection
from pmr.scene import Boom
from pmr.system.system import System, SystemTrajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SectionStates:
    """What a section of a simulated boom says at some steps, and the rows that its multipliers belong to."""

    states: ReducedStates
    rows: tuple[str, ...]


def states_of(system: System, trajectory: SystemTrajectory, steps: NDArray[np.int64]) -> dict[str, SectionStates]:
    """Of every section at some of the steps."""
    found, first = {}, 0
    for name, body in system.bodies.items():
        last = first + len(body.input_names)
        rows = tuple(side.place.row for side in system.sides if side.place.body == name)
        found[name] = SectionStates(
            chosen_states(trajectory.bodies[name], trajectory.loads[:, first:last], steps), rows
        )
        first = last
    return found


def recover_sections(
    boom: Boom,
    built: Mapping[str, Built],
    reduced: Mapping[str, ReducedSection],
    states: Mapping[str, SectionStates],
    full: Mapping[str, Array],
) -> dict[str, Recovered]:
    """What the boom asks for, section by section; collective.

    Parameters
    ----------
    states : mapping
        Of the reduced sections at the `recovered_steps`, the same on every rank.
    full : mapping of str to (S, n_local) array
        This rank's rows of the full sections' coordinates at the same steps; empty without a full model.
    """
    assert boom.recovery is not None
    found = {}
    for part in boom.sections:
        name, one = part.name, states[part.name]
        model, of = built[name].model, reduced[name]
        recovery = Recovery(model, of.V, of.model, part.reduction.solver, one.rows)
        found[name] = recover(boom.recovery, built[name].structure, recovery, one.states, full.get(name))
    return found
