"""Fields and stresses that a scene or a boom of sections asks for, from reduced models and, beside them, full ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.fullmodel.build import Built
from pmr.fullmodel.structure import Structure
from pmr.reduction.recover.coordinates import Recovery, ReducedStates, chosen_states
from pmr.reduction.recover.fields import Seen, View, in_blocks, look
from pmr.reduction.sections import ReducedSection
from pmr.scene import Scene
from pmr.scene.asked import Recovery as FieldsAsked
from pmr.system.system import System, SystemTrajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Recovered:
    """What is seen of the reduced model, and of the full one where its states are known."""

    reduced: Seen
    full: Seen | None

    def summary(self) -> dict[str, Any]:
        """``max_von_mises`` in Pa, ``stress_peak`` and ``stress_by_region``, each for ``reduced`` and ``full``.

        Empty without stresses.
        """
        peaks = {name: seen.stress.peak for name, seen in self._named() if seen.stress is not None}
        if not peaks:
            return {}
        regions = {name: {r: p.summary() for r, p in seen.by_region.items()} for name, seen in self._named()}
        return {
            "stress_by_region": {name: found for name, found in regions.items() if found},
            "max_von_mises": {name: peak.value for name, peak in peaks.items()},
            "stress_peak": {name: peak.summary() for name, peak in peaks.items()},
        }

    def histories(self) -> dict[str, Array]:
        """Largest von Mises stress (S,) in Pa over the recovered times, of ``reduced`` and ``full``."""
        return {name: seen.stress.largest for name, seen in self._named() if seen.stress is not None}

    def _named(self) -> list[tuple[str, Seen]]:
        return [("reduced", self.reduced), *([("full", self.full)] if self.full is not None else [])]


def recovered_steps(scene: Scene) -> NDArray[np.int64]:
    """Numbers (S,) of the steps whose states are recovered; empty where the scene asks for none."""
    if scene.recovery is None:
        return np.empty(0, np.int64)
    return np.arange(0, scene.time.steps + 1, round(scene.recovery.every / scene.time.step))


def recover(
    wanted: FieldsAsked, structure: Structure, recovery: Recovery, states: ReducedStates, full_states: Array | None
) -> Recovered:
    """Recover what is asked for; collective.

    Parameters
    ----------
    wanted : pmr.scene.asked.Recovery
    structure : Structure
        Of the model that `recovery` belongs to.
    states : ReducedStates
        At the `recovered_steps`, the same on every rank.
    full_states : (S, n_local) array, optional
        This rank's rows of the full model's coordinates at the same times.
    """
    view = View.of(structure, recovery.comm, stresses=wanted.stress)
    frames = min(wanted.frames, len(states.t))
    pictures = np.unique(np.rint(np.linspace(0, len(states.t) - 1, frames)).astype(np.int64))
    seen = look(view, states.t, recovery.blocks(states), pictures.tolist(), wanted.components)
    return Recovered(seen, None if full_states is None else look(view, states.t, in_blocks(full_states)))


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
    boom: Scene,
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
