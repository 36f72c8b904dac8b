"""Largest forces of a motion over those at rest in the same posture, under the same loads."""

from __future__ import annotations

from typing import Any

import numpy as np

from pmr.compare.simulated import simulate
from pmr.errors import SimulationError
from pmr.results import Response
from pmr.results.run import SummaryPart
from pmr.scene import Scene
from pmr.scene.built import Load
from pmr.scene.keys import SLIDER
from pmr.scene.signals import Constant
from pmr.simulation.at_rest import scene_at_rest
from pmr.system.system import System

#: Kinds of forces of which the largest one has a dynamic factor.
KINDS = ("pad", "support", "cylinder", "outrigger")


def dynamic_factors_part(scene: Scene, system: System, response: Response) -> SummaryPart:
    """Entry ``dynamic_factors`` of summary.json: the largest force of each kind of `KINDS` over its value at rest.

    Each row has the ``name`` of the force, its ``kind``, the time ``t`` in s and value ``largest`` in N of the largest
    force, and its value ``rest`` in N at rest in the posture of this time, under the loads of this time and the full
    weight.  The entry is missing for scenes without a frame, with a hoist, or with a base that moves or is inclined,
    and for those that compute the motion of their machine, luffing angle or extension.
    """
    frame = scene.frame
    if frame is None or scene.hoist is not None or scene.computed_key is not None or frame.base is not None:
        return SummaryPart()
    names, rows = [output.name for output in response.outputs], list[dict[str, Any]]()
    for kind in KINDS:
        of_kind = [k for k, output in enumerate(response.outputs) if output.kind == kind and output.unit == "N"]
        largest, number = max(((float(np.abs(response.column(k)).max()), k) for k in of_kind), default=(0.0, -1))
        if largest <= response.force_floor:
            continue
        values = response.column(number)
        step = int(np.abs(values).argmax())
        try:
            still = simulate(_still(scene, float(response.t[step])), system)
        except SimulationError:  # nothing holds the boom at rest in this posture
            continue
        rest = float(still.column([output.name for output in still.outputs].index(names[number]))[0])
        if abs(rest) > response.force_floor:
            rows.append({"name": names[number], "kind": kind, "t": float(response.t[step]),
                         "largest": float(values[step]), "rest": rest})  # fmt: skip
    return SummaryPart({"dynamic_factors": rows} if rows else {})


def _still(scene: Scene, t: float) -> Scene:
    """The scene at rest in its posture at the time `t`, under the loads of this time, for two steps."""
    assert scene.frame is not None  # as the caller says
    extensions = {
        part.name: np.array([scene.extension(number).value(t)])
        for number, part in enumerate(scene.sections)
        if part.joint is not None
    }
    if len(scene.sections) == 1 and scene.sections[0].slider is not None:
        extensions[SLIDER] = np.array([scene.sections[0].slider.path.value(t)])
    luffing, slewing = (float(signal.value(t)) for signal in scene.frame.angles)
    names = {load.name for part in scene.sections for load in part.loads}
    still = scene_at_rest(scene, extensions, luffing, slewing, dict.fromkeys(names, 0.0))
    sections = tuple(
        rest.model_copy(update={"loads": tuple(_steady(load, t) for load in part.loads)})  # names may occur twice
        for rest, part in zip(still.sections, scene.sections, strict=True)
    )
    time = still.time.model_copy(update={"end": 2.0 * still.time.step})
    return still.model_copy(update={"sections": sections, "start": "equilibrium", "time": time})


def _steady(load: Load, t: float) -> Load:
    """The load with its value at the time `t` for ever."""
    return load.model_copy(update={"signal": Constant(amount=float(load.signal.value(t)))})
