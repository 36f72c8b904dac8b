"""What a reduced model says of path, loads and time, as text of a Python script: numbers, never code."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pmr.reduced.model import ReducedModel
from pmr.scene.signals import Constant, SignalBase
from pmr.simulation.recorded import recorded
from pmr.simulation.stepping import TimeStepping

WIDTH = 88  # letters of a line
_LONGEST_NAME = 40


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
        parts: list[Any] = [part for signal in (self.path, *self.loads.values()) for part in signal.parts]
        return {part.kind for part in parts}

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
    """The scene in a model's provenance; raises InputError as `pmr.simulation.recorded.recorded`."""
    found = recorded(model, source)
    path, loads, stepping = found.excitation.path, found.excitation.loads, found.excitation.stepping
    names = _identifiers(tuple(loads))
    return SceneText(found.title, path, dict(zip(names, loads.values(), strict=True)), stepping)


def _identifiers(names: Sequence[str]) -> list[str]:
    """Names of functions, all different: letters beyond ASCII are no help, as Python takes some for the same."""
    found = ["load_" + re.sub(r"[^A-Za-z0-9]+", "_", name)[:_LONGEST_NAME] for name in names]
    return found if len(set(found)) == len(found) else [f"{name}_{i}" for i, name in enumerate(found)]


def _function(name: str, docstring: str, signal: SignalBase) -> str:
    return f'def {name}(t):\n    """{docstring}"""\n    return {_sum(signal)}'


def _sum(signal: SignalBase) -> str:
    """Calls of all terms; on a line each where they would make a long one."""
    calls = [_call(part) for part in signal.parts]
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
