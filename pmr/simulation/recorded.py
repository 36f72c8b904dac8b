"""The scene under which a reduced model was made, as far as its file remembers it: path, loads and time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from pmr.errors import InputError
from pmr.errors.text import visible
from pmr.scene import Scene
from pmr.scene.built import Gravity
from pmr.scene.checks import MOST_STEPS
from pmr.scene.former import stored_scene
from pmr.scene.section import RECORDED
from pmr.scene.signals import Signal
from pmr.simulation.excitation import SLIDER, Excitation
from pmr.simulation.stepping import TimeStepping
from pmr.system.contacts import ALONE
from pmr.system.system import System

Array = NDArray[np.float64]
_SIGNAL: TypeAdapter[Any] = TypeAdapter(Signal)


@dataclass(frozen=True)
class Recorded:
    """Title, and excitation with a load for each of the inputs."""

    title: str
    excitation: Excitation
    #: (i,) array: loads that a system starts with step by step, those at t = 0, and weight in full, however it rises
    first_loads: Array
    scene: Scene | None = None  #: Where more is known than what moves a body alone

    @property
    def static(self) -> bool:
        """True if it starts in equilibrium with the loads, else at rest and undeformed."""
        return self.excitation.start == "equilibrium"


def read_scene(system: System, source: str) -> Recorded:
    """The scene in a system's provenance.

    Raises InputError of the file `source` if there is none, or anything but numbers stands where they belong.
    """
    try:
        scene = system.provenance["scene"]
        if any(map(_names_a_file, _signals(scene))):
            raise ValueError("a signal in a model holds its numbers itself")
        if ALONE in system.bodies and not scene.get("frame"):
            return _of_body(scene, system)
        return _of_sections(scene, system)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        if isinstance(error, InputError):
            raise InputError(source, f"provenance.scene.{error.key}", error.value, error.allowed) from None
        why = "this one has none" if error.args == ("scene",) else repr(error)
        raise InputError(source, "provenance.scene", None, f"a file that holds its scene is allowed: {why}") from None


def _of_body(scene: Any, system: System) -> Recorded:
    """Recorded start of a body alone, by the keys of its scene that all versions of files have."""
    loads = [_SIGNAL.validate_python(load["signal"]) for load in scene["loads"]]
    weight = Gravity.model_validate(scene["gravity"]) if scene.get("gravity") else None
    if weight is not None:
        loads.append(weight.signal)
    end, step, rho_inf = (float(scene["time"][key]) for key in ("end", "step", "rho_inf"))
    stepping = _check_steps(TimeStepping(end, step, rho_inf))
    path, start = _SIGNAL.validate_python(scene["slider"]["path"]), scene.get("start", "rest")
    if len(loads) != len(system.input_names):
        raise ValueError(f"{len(loads)} given, one for each input is allowed: {', '.join(system.input_names)}")
    named = dict(zip(system.input_names, loads, strict=True))
    excitation = Excitation({SLIDER: path}, named, stepping, start=start)
    first_loads = excitation.f[0].copy()
    if weight is not None:
        first_loads[-1] = weight.acceleration
    return Recorded(visible(str(scene.get("title", "Sliding body"))), excitation, first_loads)


def _of_sections(scene: Any, system: System) -> Recorded:
    boom = stored_scene(scene, "provenance.scene", RECORDED)
    _check_steps(TimeStepping(boom.time.end, boom.time.step))
    if set(system.bodies) != set(boom.bodies) or not set(system.paths) <= set(boom.paths):
        raise ValueError(f"sections {', '.join(system.bodies)} and paths {', '.join(system.paths)} are needed")
    return of_boom(boom, system)


def _check_steps(stepping: TimeStepping) -> TimeStepping:
    if stepping.steps > MOST_STEPS:
        raise ValueError(f"{stepping.steps} steps, at most {MOST_STEPS:,} steps are allowed")
    return stepping


def of_boom(boom: Scene, system: System) -> Recorded:
    """Recorded start of a boom of several sections: equilibrium under its full weight by default."""
    excitation = Excitation.of(boom)
    gravity = boom.gravity and boom.gravity.model_copy(update={"rise": 0.0})
    in_full = Excitation.of(boom.model_copy(update={"gravity": gravity}))
    return Recorded(boom.title, excitation, in_full.forces(system.input_names)[0].copy(), boom)


def path_ranges(system: System) -> dict[str, tuple[float, float]]:
    """Smallest and largest s in m of each path in the scene of the sections; of others, where rows are defined."""
    ranges = system.ranges
    try:
        excitation = None if ALONE in system.bodies else read_scene(system, "system").excitation
    except InputError:
        excitation = None
    if excitation is None:
        return ranges
    ends = {path: signal.bounds(0.0, excitation.stepping.end) for path, signal in excitation.paths.items()}
    return {path: (max(low, ends[path][0]), min(high, ends[path][1])) for path, (low, high) in ranges.items()}


def _signals(scene: Any) -> list[Any]:
    """Signals of a body alone, or of the sections of a boom: numbers, never the name of a reader's file."""
    parts = [part for part in scene.get("sections", [scene]) if isinstance(part, dict)]
    return [part.get(key) for part in parts for key in ("joint", "slider", "loads")]


def _names_a_file(data: Any) -> bool:
    if isinstance(data, dict):
        return "file" in data or any(map(_names_a_file, data.values()))
    return isinstance(data, list) and any(map(_names_a_file, data))
