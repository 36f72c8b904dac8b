"""What a reduced model says of path, loads and time, as text of a Python script: numbers, never code."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import TypeAdapter

from pmr.errors import InputError
from pmr.reduced.model import ReducedModel
from pmr.scene.checks import MOST_STEPS
from pmr.scene.signals import Constant, Signal, SignalBase, Sum
from pmr.scene.space import Gravity
from pmr.simulate.stepping import TimeStepping

WIDTH = 88  # letters of a line
_LONGEST_NAME = 40
_SIGNAL: TypeAdapter[Any] = TypeAdapter(Signal)


@dataclass(frozen=True)
class SceneText:
    """What a model's provenance says of path, loads (one an input, by the name of its function) and time."""

    title: str
    path: SignalBase
    loads: dict[str, SignalBase]
    stepping: TimeStepping

    @property
    def kinds(self) -> set[str]:
        """Kinds of all signals."""
        return {part.kind for signal in (self.path, *self.loads.values()) for part in _parts(signal)}

    def text(self) -> str:
        """Constants and functions of t."""
        times = (
            f"END = {self.stepping.end!r}  # s\n"
            f"STEP = {self.stepping.step!r}  # s\n"
            f"RHO_INF = {self.stepping.rho_inf!r}  # spectral radius at infinite frequency"
        )
        functions = [_function("slider_position", "s(t) in m.", self.path)]
        functions += [_function(name, "N (or N m).", signal) for name, signal in self.loads.items()]
        loads = f"LOADS = [{', '.join(self.loads)}]  # in the order of B's columns"
        return "\n\n\n".join([times, *functions, loads])


def scene_text(model: ReducedModel, source: str) -> SceneText:
    """The scene in a model's provenance.

    Raises
    ------
    InputError
        If there is none, or it holds anything but numbers where numbers belong.
    """
    try:
        scene = model.provenance["scene"]
        path = _signal(scene["slider"]["path"])
        signals = [_signal(load["signal"]) for load in scene["loads"]]
        if scene.get("gravity"):
            signals.append(Gravity.model_validate(scene["gravity"]).signal)
        end, step, rho_inf = (float(scene["time"][key]) for key in ("end", "step", "rho_inf"))
        stepping = TimeStepping(end, step, rho_inf)
        title = str(scene.get("title", "Sliding body"))
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        allowed = f"a reduced model that holds its scene (slider.path, loads, time) is allowed: {error!r}"
        raise InputError(source, "provenance.scene", None, allowed) from None
    if stepping.steps > MOST_STEPS:
        raise InputError(source, "provenance.scene.time", stepping.steps, f"at most {MOST_STEPS:,} steps are allowed")
    if len(signals) != len(model.input_names):
        allowed = f"{len(signals)} given, one for each input is allowed: {', '.join(model.input_names)}"
        raise InputError(source, "provenance.scene.loads", None, allowed)
    return SceneText(title, path, dict(zip(_identifiers(model.input_names), signals, strict=True)), stepping)


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


def _identifiers(names: Sequence[str]) -> list[str]:
    """Names of functions, all different: letters beyond ASCII are no help, as Python takes some for the same."""
    found = ["load_" + re.sub(r"[^A-Za-z0-9]+", "_", name)[:_LONGEST_NAME] for name in names]
    return found if len(set(found)) == len(found) else [f"{name}_{i}" for i, name in enumerate(found)]


def _function(name: str, docstring: str, signal: SignalBase) -> str:
    return f'def {name}(t):\n    """{docstring}"""\n    return {_sum(signal)}'


def _sum(signal: SignalBase) -> str:
    """Calls of all terms; on a line each where they would make a long one."""
    calls = [_call(part) for part in _parts(signal)]
    line = " + ".join(calls)
    if len(calls) == 1 or (len(line) <= WIDTH and "\n" not in line):
        return line
    lines = "\n+ ".join(calls).replace("\n", "\n        ")
    return f"(\n        {lines}\n    )"


def _call(signal: Any) -> str:
    """``kind(t, field=value, ...)``, an argument a line where it is long; a constant as a number."""
    if isinstance(signal, Constant):
        return repr(signal.amount)
    arguments = [f"{name}={value!r}" for name, value in signal.model_dump(exclude={"kind"}).items()]
    line = f"{signal.kind}(t, {', '.join(arguments)})"
    if len(line) <= WIDTH:
        return line
    return "\n".join([f"{signal.kind}(", "        t,", *(f"        {a}," for a in arguments), "    )"])


def _parts(signal: Any) -> Iterator[Any]:
    """The signal, or what it sums up."""
    if isinstance(signal, Sum):
        for term in signal.terms:
            yield from _parts(term)
    else:
        yield signal
