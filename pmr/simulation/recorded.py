"""The scene under which a reduced model was made, as far as its file remembers it: path, loads and time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from pmr.errors import InputError
from pmr.errors.text import visible
from pmr.reduced.model import ReducedModel
from pmr.scene import Scene
from pmr.scene.built import Gravity
from pmr.scene.checks import MOST_STEPS
from pmr.scene.section import RECORDED
from pmr.scene.signals import Signal, SignalBase
from pmr.simulation.excitation import SLIDER, Excitation
from pmr.simulation.stepping import TimeStepping
from pmr.system.contacts import ALONE
from pmr.system.system import System

Array = NDArray[np.float64]
_SIGNAL: TypeAdapter[Any] = TypeAdapter(Signal)


@dataclass(frozen=True)
class Recorded:
    """Title, and excitation with a load for each of the model's inputs."""

    title: str
    excitation: Excitation
    #: (i,) array: loads that a model starts with step by step, those at t = 0, and weight in full, however it rises
    first_loads: Array
    static: bool = False  #: Whether it starts in equilibrium with these; else at rest and undeformed


def recorded(model: ReducedModel, source: str) -> Recorded:
    """The scene in a model's provenance.

    Raises InputError of the file `source` if there is none, anything but numbers stands where they belong, or the model
    is a section of a boom.
    """
    model.ensure_whole(source)
    try:
        scene = model.provenance["scene"]
        path = _signal(scene["slider"]["path"])
        signals = [_signal(load["signal"]) for load in scene["loads"]]
        gravity = Gravity.model_validate(scene["gravity"]) if scene.get("gravity") else None
        if gravity is not None:
            signals.append(gravity.signal)
        end, step, rho_inf = (float(scene["time"][key]) for key in ("end", "step", "rho_inf"))
        stepping = TimeStepping(end, step, rho_inf)
        title = visible(str(scene.get("title", "Sliding body")))
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        why = "this one has none" if error.args == ("scene",) else repr(error)
        allowed = f"a reduced model that holds its scene (slider.path, loads, time) is allowed: {why}"
        raise InputError(source, "provenance.scene", None, allowed) from None
    if stepping.steps > MOST_STEPS:
        raise InputError(source, "provenance.scene.time", stepping.steps, f"at most {MOST_STEPS:,} steps are allowed")
    if len(signals) != len(model.input_names):
        allowed = f"{len(signals)} given, one for each input is allowed: {', '.join(model.input_names)}"
        raise InputError(source, "provenance.scene.loads", None, allowed)
    loads = dict(zip(model.input_names, signals, strict=True))
    excitation = Excitation({SLIDER: path}, loads, stepping)
    first_loads = excitation.f[0].copy()
    if gravity is not None:
        first_loads[-1] = gravity.acceleration
    return Recorded(title, excitation, first_loads, static=scene.get("start") == "equilibrium")


def recorded_system(system: System, source: str) -> Recorded:
    """The scene in a system's provenance, as `recorded` has that of a body alone, with the same errors."""
    if ALONE in system.bodies:
        return recorded(system.reduced[ALONE], source)
    try:
        scene = system.provenance["scene"]
        if any(map(_names_a_file, _signals(scene))):
            raise ValueError("a signal in a model holds its numbers itself")
        boom = Scene.model_validate(scene, context=RECORDED)
        if boom.time.steps > MOST_STEPS:
            raise ValueError(f"at most {MOST_STEPS:,} steps are allowed")
        if set(system.bodies) != set(boom.names) or not set(system.paths) <= set(boom.paths):
            raise ValueError(f"sections {', '.join(system.bodies)} and paths {', '.join(system.paths)} are needed")
        return of_boom(boom, system)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        why = "this one has none" if error.args == ("scene",) else repr(error)
        allowed = f"a system that holds its scene (sections, gravity, time) is allowed: {why}"
        raise InputError(source, "provenance.scene", None, allowed) from None


def of_boom(boom: Scene, system: System) -> Recorded:
    """What a boom of several sections starts with: equilibrium under its weight in full, unless it says otherwise."""
    excitation = Excitation.of(boom)
    gravity = boom.gravity and boom.gravity.model_copy(update={"rise": 0.0})
    in_full = Excitation.of(boom.model_copy(update={"gravity": gravity}))
    first_loads = in_full.forces(system.input_names)[0].copy()
    return Recorded(boom.title, excitation, first_loads, static=boom.start == "equilibrium")


def visited(system: System) -> dict[str, tuple[float, float]]:
    """Smallest and largest s in m of each path in the scene of the sections; of others, where rows are defined."""
    ranges = system.ranges
    try:
        excitation = None if ALONE in system.bodies else recorded_system(system, "system").excitation
    except InputError:
        excitation = None
    if excitation is None:
        return ranges
    ends = {path: signal.bounds(0.0, excitation.stepping.end) for path, signal in excitation.paths.items()}
    return {path: (max(low, ends[path][0]), min(high, ends[path][1])) for path, (low, high) in ranges.items()}


def _signals(scene: Any) -> list[Any]:
    """What may be signals in the sections of a boom."""
    parts = [part for part in scene["sections"] if isinstance(part, dict)]
    return [one for part in parts for one in (part.get("joint"), part.get("loads"))]


def _signal(data: Any) -> SignalBase:
    """A signal that a model brings along: numbers, never the name of a file on the reader's machine."""
    if _names_a_file(data):
        raise ValueError("a signal in a model holds its numbers itself")
    signal: SignalBase = _SIGNAL.validate_python(data)
    return signal


def _names_a_file(data: Any) -> bool:
    if isinstance(data, dict):
        return "file" in data or any(map(_names_a_file, data.values()))
    return isinstance(data, list) and any(map(_names_a_file, data))
