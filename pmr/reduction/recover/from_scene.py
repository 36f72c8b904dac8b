"""Fields and stresses that a scene asks for, from reduced models and, beside them, full ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.fields.envelope import Envelope
from pmr.fullmodel.build import Built
from pmr.reduction.recover.coordinates import Recovery
from pmr.reduction.recover.fields import Seen, View, in_blocks, look
from pmr.reduction.reduced_body import ReducedBody
from pmr.scene import Scene
from pmr.system.states import BodyStates

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Recovered:
    """Fields of the reduced model, and of the full one where its states are known."""

    reduced: Seen
    full: Seen | None

    def summary(self) -> dict[str, Any]:
        """``max_von_mises`` in Pa, ``stress_peak``, ``stress_by_region`` and ``section_forces``, each by model.

        Of what a body has: a beam without a profile has no stresses, a shell no section forces.
        """
        peaks = {
            name: model_fields.stress.peak for name, model_fields in self._views() if model_fields.stress is not None
        }
        along = {name: envelope.extremes() for name, envelope in self.envelopes().items()}
        forces = {"section_forces": along} if along else {}
        if not peaks:
            return forces
        regions = {
            name: {r: p.summary() for r, p in model_fields.by_region.items()} for name, model_fields in self._views()
        }
        return forces | {
            "stress_by_region": {name: by_region for name, by_region in regions.items() if by_region},
            "max_von_mises": {name: peak.value for name, peak in peaks.items()},
            "stress_peak": {name: peak.summary() for name, peak in peaks.items()},
        }

    def histories(self) -> dict[str, Array]:
        """Largest von Mises stress (S,) in Pa over the recovered times, of ``reduced`` and ``full``."""
        return {
            name: model_fields.stress.largest for name, model_fields in self._views() if model_fields.stress is not None
        }

    def envelopes(self) -> dict[str, Envelope]:
        """Along a beam, of ``reduced`` and ``full``."""
        return {
            name: model_fields.envelope for name, model_fields in self._views() if model_fields.envelope is not None
        }

    def _views(self) -> list[tuple[str, Seen]]:
        return [("reduced", self.reduced), *([("full", self.full)] if self.full is not None else [])]


def recovered_steps(scene: Scene) -> NDArray[np.int64]:
    """Numbers (S,) of the steps whose states are recovered; empty where the scene asks for none."""
    if scene.recovery is None:
        return np.empty(0, np.int64)
    return np.arange(0, scene.time.steps + 1, round(scene.recovery.every / scene.time.step))


@dataclass(frozen=True)
class Looked:
    """A body's points and cells, and what was seen there of its reduced model."""

    view: View
    reduced: Seen


def of_reduced(
    scene: Scene, built: Mapping[str, Built], bodies: Mapping[str, ReducedBody], states: Mapping[str, BodyStates]
) -> dict[str, Looked]:
    """Fields of the reduced models of a scene's bodies.

    They have the `states` at the `recovered_steps`, the same on every rank.
    """
    recovery_of_scene, looked = scene.recovery, {}
    assert recovery_of_scene is not None
    for part in scene.sections:
        name, at = part.name, states[part.name]
        recovery = Recovery(built[name].model, bodies[name].V, bodies[name].model, part.reduction.solver)
        view = View(built[name], recovery_of_scene.stress)
        frames = min(recovery_of_scene.frames, len(at.t))
        pictures = np.unique(np.rint(np.linspace(0, len(at.t) - 1, frames)).astype(np.int64))
        looked[name] = Looked(
            view, look(view, at.t, recovery.blocks(at), pictures.tolist(), recovery_of_scene.components, at)
        )
    return looked


def beside_full(looked: Mapping[str, Looked], full: Mapping[str, BodyStates]) -> dict[str, Recovered]:
    """Fields beside those of the full models, whose states are this rank's rows; empty without; collective."""
    return {
        name: Recovered(
            of_body.reduced,
            look(of_body.view, full[name].t, in_blocks(full[name].p), acting=full[name]) if name in full else None,
        )
        for name, of_body in looked.items()
    }
