"""Fields and stresses that a scene asks for, from the reduced model and, beside it, from the full one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.fullmodel.build import Built
from pmr.recover.coordinates import Recovery, chosen_states
from pmr.recover.fields import Seen, View, in_blocks, look
from pmr.scene import Scene
from pmr.simulate import Excitation
from pmr.system.body import Trajectory

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
    scene: Scene, built: Built, recovery: Recovery, reduced: Trajectory | None, full_states: Array | None
) -> Recovered:
    """Recover what the scene asks for; collective.

    Parameters
    ----------
    built : Built
    recovery : Recovery
    reduced : Trajectory
        The reduced model's states at the `recovered_steps`, on rank 0.
    full_states : (S, n_local) array, optional
        This rank's rows of the full model's coordinates at the same times.
    """
    wanted = scene.recovery
    assert wanted is not None
    comm, steps = built.model.comm, recovered_steps(scene)
    states = None
    if reduced is not None:
        loads = Excitation.of(scene).forces(recovery.reduced.input_names)[steps]
        states = chosen_states(reduced, loads, np.arange(len(steps)))
    states = comm.bcast(states)
    assert states is not None
    view = View.of(built.structure, comm, stresses=wanted.stress)
    frames = min(wanted.frames, len(steps))
    pictures = np.unique(np.rint(np.linspace(0, len(steps) - 1, frames)).astype(np.int64))

    def seen(blocks: Iterable[Array], pictured: NDArray[np.int64]) -> Seen:
        return look(view, states.t, blocks, pictured.tolist(), wanted.components)

    whole = None if full_states is None else seen(in_blocks(full_states), pictures[:0])
    return Recovered(seen(recovery.blocks(states), pictures), whole)
