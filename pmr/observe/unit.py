"""An observer as part of an FMU (`pmr.export.fmi.observer`)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from pmr.errors import InputError
from pmr.export.fmi.observer import UnitObserver
from pmr.observe.linear import gravity_of, select_outputs
from pmr.observe.measured import ObserverFile
from pmr.observe.observer import Observer
from pmr.scene.files import stored_scene
from pmr.scene.keys import RECORDED
from pmr.scene.scene import Scene
from pmr.system.system import System


def read_unit_observer(file: Path, model: Path) -> UnitObserver:
    """Observer for an FMU, from a file that describes it and the saved system `model`, with the scene stored there.

    The errors of the model are those in ``summary.json`` beside the model, if it is there.  Raises InputError for a
    model without its scene, and as `ObserverFile.observer`.
    """
    description, system, budget = ObserverFile.read(file), System.load(model), model.parent / "summary.json"
    if "scene" not in system.provenance:
        raise InputError(model.name, "provenance.scene", None, "a file that contains its scene is allowed")
    scene = stored_scene(system.provenance["scene"], "provenance.scene", RECORDED)
    summary: Any = json.loads(budget.read_text(encoding="utf-8")) if budget.is_file() else {}
    return unit_observer(description.observer(scene, system, summary), scene, system)


def unit_observer(observer: Observer, scene: Scene, system: System) -> UnitObserver:
    """Observer of a system for an FMU; `scene` is the one that its model was linearised along."""
    chosen, described = select_outputs(scene, system, observer.model.outputs), observer.filter_model()
    return UnitObserver(
        data=described.data(),
        step=observer.model.step,
        outputs=chosen.names,
        columns=np.array(chosen.columns, np.int32),
        orders=np.array(chosen.orders, np.int32),
        felt=gravity_of(scene, chosen),
        inputs=observer.model.inputs,
        sensors=tuple(sensor.output for sensor in observer.sensors),
        units=observer.units,
    )
