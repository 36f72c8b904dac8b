"""Booms that studies are made of: with other meshes and sizes, their full models as one system, and its motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.accuracy.order import trials_of
from pmr.compare.accuracy.trials import Trials
from pmr.compare.outputs import in_parts, run_from_start
from pmr.compare.responses import respond
from pmr.reduced.attachment import as_simulated
from pmr.reduced.model import ReducedModel
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.mechanism import frame_terms
from pmr.simulation import Excitation
from pmr.system.from_scene import contacts_of, system_of
from pmr.system.states import SystemTrajectory
from pmr.system.system import System
from pmr.system.terms import terms_of

Array = NDArray[np.float64]

#: Rigid-body motions of a section, at most.
RIGID = 6


def with_elements(boom: Scene, count: int) -> Scene:
    """Return the boom with so many elements in every section, and the full model alone."""
    return _with(boom, "mesh", {"elements": count})


def reduced_to(boom: Scene, modes: int) -> Scene:
    """Return the boom with free modes for so many elastic ones in every section, and those of an error estimate."""
    reduction = {"coordinates": RIGID + modes, "flexibility": True, "estimate": True}
    return _with(boom, "reduction", reduction)


def _with(boom: Scene, table: str, changes: Mapping[str, Any]) -> Scene:
    """Return the boom with changes in a table of every section, and nothing to be searched."""
    tables = [getattr(part, table).model_copy(update=changes) for part in boom.sections]
    parts = tuple(
        part.model_copy(update={table: changed_table})
        for part, changed_table in zip(boom.sections, tables, strict=True)
    )
    return boom.model_copy(update={"sections": parts, "accuracy": None, "budget": None})


@dataclass(frozen=True)
class Case:
    """A boom, its full models as one system, the motion of that, and what drives it, in the parts of a step it took."""

    boom: Scene
    built: Mapping[str, Any]
    full: System
    excitation: Excitation
    run: SystemTrajectory
    response: Response

    @classmethod
    def of(cls, boom: Scene) -> Case:
        built = built_of(boom)
        full = full_of(boom, built)
        excitation = in_parts(full, Excitation.of(boom))
        run = run_from_start(full, excitation)
        return cls(boom, built, full, excitation, run, respond(full, run))

    def at(self, system: System, factor: float, every: int) -> Array:
        """Displacements (T, o) in m of a system with a step that is so many times as long."""
        driven = Excitation.of(self.boom)
        excitation = driven.on_grid(replace(driven.stepping, step=factor * driven.stepping.step))
        return respond(system, run_from_start(system, excitation).at(slice(None, None, every))).displacement


def built_of(boom: Scene) -> Mapping[str, Any]:
    """The full models of its sections."""
    from pmr.fullmodel.build import build_bodies

    return build_bodies(boom)


def full_of(boom: Scene, built: Mapping[str, Any]) -> System:
    """Full models as one system in one piece."""
    from pmr.fullmodel.model import FullSystem

    models = {name: body.model for name, body in built.items()}
    full = FullSystem(models, contacts_of(boom, models)).gather()
    assert full is not None  # a task runs on one rank
    return replace(full, terms=terms_of(boom, full.bodies))


def sizes_of(boom: Scene, built: Mapping[str, Any]) -> Trials:
    """The reduced models of the sections, of all sizes."""
    from pmr.reduction.bodies import reduce_bodies

    return trials_of(boom, {name: body.modal for name, body in reduce_bodies(boom, built).items()})


def models_of(boom: Scene, trials: Trials, modes: int, basis: str) -> tuple[dict[str, ReducedModel], System]:
    """Models with so many elastic modes a section: on free modes, and as they are simulated."""
    modal = trials.models(trials.uniform(modes))
    if basis == "modes":
        modal = {name: _stiff(model) for name, model in modal.items()}
    stressed = any(frame_terms(boom))
    return modal, system_of(boom, {name: as_simulated(model, stressed) for name, model in modal.items()})


def _stiff(model: ReducedModel) -> ReducedModel:
    """Return the model without the flexibility of the modes that are left out."""
    assert model.carriers is not None  # as section models have
    carriers = replace(model.carriers, flexibility=None, inertia=None, answers=None)
    return replace(model, flexibility=None, enrichment=None, carriers=carriers)
