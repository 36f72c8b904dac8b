"""What a saved system says of paths, loads and time, as text of a Python script: numbers, never code."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.scene.frame import INERTIA
from pmr.scene.joints import Linear
from pmr.scene.signals import Constant, SignalBase
from pmr.simulation import contact_step
from pmr.simulation.acceleration import Acceleration
from pmr.simulation.contact_step import contact_frequency
from pmr.simulation.recorded import recorded
from pmr.simulation.statics.equilibrium import equilibrium
from pmr.simulation.stepping import TimeStepping
from pmr.system.assembly import Assembly
from pmr.system.system import System

Array = NDArray[np.float64]
WIDTH = 88  # letters of a line
_LONGEST_NAME = 40


@dataclass(frozen=True)
class SceneText:
    """What a system's provenance says of paths and loads (by the names of their functions), time and start."""

    title: str
    paths: dict[str, SignalBase]
    loads: dict[str, SignalBase]
    stepping: TimeStepping
    parts: int  # of each step, where contacts only push
    start: Array | None  # (n,) coordinates at t = 0; None: at rest, undeformed

    @property
    def kinds(self) -> set[str]:
        """Kinds of all signals."""
        signals = (*self.paths.values(), *self.loads.values())
        return {kind for signal in signals for kind in _kinds(signal)}

    def text(self) -> str:
        """Constants and functions of t."""
        times = (
            f"END = {self.stepping.end!r}  # s\n"
            f"STEP = {self.stepping.step!r}  # s\n"
            f"RHO_INF = {self.stepping.rho_inf!r}  # spectral radius at infinite frequency\n"
            f"PARTS = {self.parts}  # of each step: more than one where contacts only push"
        )
        names = {id(signal): name for name, signal in self.paths.items()}
        functions = [_function(name, "s(t) in m.", signal, names) for name, signal in self.paths.items()]
        functions += [_function(name, "In the unit of its input.", one, names) for name, one in self.loads.items()]
        lists = f"PATHS = {_listed(self.paths)}\nLOADS = {_listed(self.loads)}  # in the order of B's columns\n"
        start = None if self.start is None else self.start.tolist()
        lists += f"START = {listed(start) if start else None}  # coordinates at t = 0: in equilibrium; None: undeformed"
        return "\n\n\n".join([times, *functions, lists])


def scene_text(system: System, source: str) -> SceneText:
    """The scene in a system's provenance.

    Raises InputError as `pmr.simulation.recorded.recorded`, and for a frame that moves.
    """
    found = recorded(system, source)
    excitation = found.excitation
    if any(name.startswith(INERTIA) for body in system.bodies.values() for name in body.input_names):
        allowed = "a scene without a frame is allowed in a script; `pmr run` and `pmr simulate` simulate one by Exudyn"
        raise InputError(source, "frame", None, allowed)
    paths = _functions("position", excitation.paths, system.paths)
    loads = _functions("load", excitation.loads, system.input_names)
    start = None
    if found.static:
        assembly, s = Assembly(system), dict(zip(excitation.paths, excitation.s[0].tolist(), strict=True))
        start = equilibrium(assembly, system.coordinates(s), found.first_loads).q
    omega = contact_frequency(system, excitation)
    parts = contact_step.parts(omega, excitation.stepping) if omega else 1
    return SceneText(found.title, paths, loads, excitation.stepping, parts, start)


def listed(values: Sequence[object]) -> str:
    """A list as Python writes it; one a line where it is long."""
    line = repr(list(values))
    return line if len(line) <= WIDTH else "\n".join(["[", *(f"    {one!r}," for one in values), "]"])


def _listed(names: Iterable[str]) -> str:
    """A list of functions."""
    line = ", ".join(names)
    return f"[{line}]" if len(line) <= WIDTH else "\n".join(["[", *(f"    {one}," for one in names), "]"])


def _kinds(signal: Any) -> set[str]:
    """Of a signal and those that it is made of."""
    inner = [one for part in signal.parts if part is not signal for one in _kinds(part)]
    if isinstance(signal, Linear):
        inner += _kinds(signal.signal)
    elif isinstance(signal, Acceleration):
        inner += ["acceleration", "rate"]
    else:
        inner.append(signal.kind)
    return set(inner)


def _functions(kind: str, signals: Mapping[str, SignalBase], names: Sequence[str]) -> dict[str, SignalBase]:
    """Some of the signals, by the names of their functions."""
    return dict(zip(_identifiers(kind, names), (signals[name] for name in names), strict=True))


def _identifiers(kind: str, names: Sequence[str]) -> list[str]:
    """Names of functions, all different: letters beyond ASCII are no help, as Python takes some for the same."""
    found = [f"{kind}_" + re.sub(r"[^A-Za-z0-9]+", "_", name)[:_LONGEST_NAME] for name in names]
    return found if len(set(found)) == len(found) else [f"{name}_{i}" for i, name in enumerate(found)]


def _function(name: str, docstring: str, signal: SignalBase, paths: Mapping[int, str]) -> str:
    return f'def {name}(t):\n    """{docstring}"""\n    return {_sum(signal, paths)}'


def _sum(signal: SignalBase, paths: Mapping[int, str]) -> str:
    """Calls of all terms; on a line each where they would make a long one."""
    calls = [_call(part, paths) for part in signal.parts]
    line = " + ".join(calls)
    if len(calls) == 1 or (len(line) <= WIDTH and "\n" not in line):
        return line
    lines = "\n+ ".join(calls).replace("\n", "\n        ")
    return f"(\n        {lines}\n    )"


def _call(signal: Any, paths: Mapping[int, str]) -> str:
    """``kind(t, field=value, ...)``, an argument a line where it is long; a constant as a number."""
    if isinstance(signal, Constant):
        return repr(signal.amount)
    if isinstance(signal, Linear):
        return f"{signal.offset!r} + {signal.ratio!r} * ({_sum(signal.signal, paths)})"
    if isinstance(signal, Acceleration):
        return f"acceleration(t, [{', '.join(paths[id(path)] for path in signal.paths)}], {signal.step!r})"
    arguments = [f"{name}={value!r}" for name, value in signal.model_dump(exclude={"kind"}).items()]
    line = f"{signal.kind}(t, {', '.join(arguments)})"
    if len(line) <= WIDTH:
        return line
    return "\n".join([f"{signal.kind}(", "        t,", *(f"        {a}," for a in arguments), "    )"])
