"""Fields and stresses that a scene asks for, from the reduced model and, beside it, from the full one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.fullmodel.structure import Structure
from pmr.recover.coordinates import Recovery, ReducedStates
from pmr.recover.fields import Seen, View, in_blocks, look
from pmr.scene import Boom, Scene
from pmr.scene.asked import Recovery as FieldsAsked

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


def recovered_steps(scene: Scene | Boom) -> NDArray[np.int64]:
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
