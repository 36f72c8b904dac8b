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
from pmr.scene.built import Gravity
from pmr.scene.checks import MOST_STEPS
from pmr.scene.signals import Signal, SignalBase
from pmr.simulation.excitation import SLIDER, Excitation
from pmr.simulation.stepping import TimeStepping

Array = NDArray[np.float64]
_SIGNAL: TypeAdapter[Any] = TypeAdapter(Signal)


@dataclass(frozen=True)
class Recorded:
    """Title, and excitation with a load for each of the model's inputs."""

    title: str
    excitation: Excitation
    gravity: Gravity | None

    @property
    def first_loads(self) -> Array:
        """Loads (i,) that a model starts with step by step: those at t = 0, and weight in full, however it rises."""
        found = self.excitation.f[0].copy()
        if self.gravity is not None:
            found[-1] = self.gravity.acceleration
        return found


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
    return Recorded(title, Excitation({SLIDER: path}, loads, stepping), gravity)


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
