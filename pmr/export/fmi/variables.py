"""Variables of an FMU, in the order of their value references (source/body.h)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.errors import BEYOND_ENDS
from pmr.export.fmi.blocks import Arrangement
from pmr.scene.built import force_of
from pmr.system.body import force_outputs
from pmr.system.contacts import SLIDER, named

Array = NDArray[np.float64]
#: What the parameter `start` may be.
STARTS = {"at rest": 0, "static": 1, "as given": 2}


@dataclass(frozen=True)
class Variable:
    """One variable: its value reference, and what a model description says of it."""

    name: str
    reference: int
    description: str
    causality: str = "output"
    variability: str = "continuous"
    initial: str = "calculated"  #: Empty where the causality says it
    unit: str = ""  #: Empty for a number
    start: float | None = None
    nominal: float | None = None
    derivative_of: int | None = None  #: Value reference of the state whose derivative this is
    within: tuple[float, float] | None = None  #: Smallest and largest value
    is_choice: bool = False  #: Whether it is the kind of start, the only variable that is no real number
    is_rate: bool = False  #: Whether it is the rate of an output


def variables(rows: Arrangement, start: Array, nominal: Array) -> list[Variable]:
    """All variables of a system, by `pmr.export.fmi.constants.source_text`'s start and nominal."""
    names = _Names()
    found = list(_given(rows, names, start))
    first, modes = 4 + 2 * _count(rows.paths) + 2 * _count(rows.system.input_names), len(nominal) // 2
    of_modes = [(part.name, k + 1) for part in rows.parts for k in range(part.form.body.size)]
    for k in range(2 * modes):
        (body, mode), rate = of_modes[k % modes], k >= modes
        called, unit = ("rate of mode", "m/s") if rate else ("mode", "m")
        what = f"{named(body, f'{called} {mode}')}, modal mass 1 kg"
        name = names(f"{named(body, f'mode {mode}')}{' rate' * rate}")
        size = float(nominal[k])
        found.append(Variable(name, first + k, what, "local", initial="approx", unit=unit, start=0.0, nominal=size))
    states = found[-2 * modes :]
    for k, state in enumerate(states):
        unit = "m/s2" if k >= modes else "m/s"
        reference = first + 2 * modes + k
        name = names(f"der_{state.name}")
        found.append(
            Variable(name, reference, f"derivative: {state.description}", "local", unit=unit, derivative_of=first + k)
        )
    found += _observed(rows, names, first + 4 * modes)
    return found


def path_names(paths: Sequence[str]) -> list[str]:
    """What the path coordinates are called: s alone where there is one for all sliders."""
    return ["s" if path == SLIDER else f"s {path}" for path in paths]


def _count(listed: Sequence[str]) -> int:
    """How many numbers these take: C has no arrays of nothing."""
    return max(len(listed), 1)


def _given(rows: Arrangement, names: _Names, start: Array) -> Iterator[Variable]:
    """Time, inputs and parameters."""
    system, paths = rows.system, path_names(rows.paths)
    units = [unit.replace("^", "") for part in rows.parts for unit in part.body.input_units]
    fixed = [names(name) for name in ("internal_step", "rho_inf", "start")]  # whatever loads are called
    yield Variable(names("time"), 0, "time", "independent", initial="", unit="s")
    own = [(names(path), names(f"{path}_rate")) for path in paths]
    at = 1
    for (name, _), path, (low, high) in zip(own, rows.paths, rows.ranges, strict=True):
        what = "of the sliders" if path == SLIDER else path
        what = f"path coordinate {what}; up to {BEYOND_ENDS * (high - low):.3g} m beyond an end it is taken there"
        yield Variable(name, at, what, "input", initial="", unit="m", start=float(start[at]), within=(low, high))
        at += 1
    first = 1 + _count(paths)
    inputs = [
        (name, first + k, f"rate of {path}", "m/s") for k, ((_, name), path) in enumerate(zip(own, paths, strict=True))
    ]
    first, count = first + _count(paths), _count(system.input_names)
    pairs = zip(system.input_names, units, strict=True)
    loads = [(names(name), first + k, f"load {name}", unit) for k, (name, unit) in enumerate(pairs)]
    rates = [
        (names(f"{name}_rate"), count + at, f"rate of the {what}", "m/s3" if unit == "m/s2" else f"{unit}/s")
        for name, at, what, unit in loads
    ]
    for name, at, what, unit in (*inputs, *loads, *rates):
        yield Variable(name, at, what, "input", "continuous", "", unit, float(start[at]))
    first += 2 * count
    how = "undeformed and at rest, in equilibrium with the loads, or as the start values of the modes say"
    given = (
        ("longest internal step in Co-Simulation", "s"),
        ("spectral radius of generalized-alpha at infinite frequency", ""),
        (how, ""),
    )
    for k, (what, unit) in enumerate(given):
        found = Variable(fixed[k], first + k, what, "parameter", "fixed", "exact", unit, float(start[first + k]))
        yield replace(found, is_choice=what is how)


def _observed(rows: Arrangement, names: _Names, first: int) -> Iterator[Variable]:
    """Outputs, their rates where they are motions, and the forces of the rows."""
    called, units = rows.system.output_names, rows.system.output_units
    force = [one for body in rows.system.bodies.values() for one in force_outputs(body).tolist()]
    count = _count(called)
    outputs = [names(name if not is_force else force_of(name)) for name, is_force in zip(called, force, strict=True)]
    for k, output in enumerate(outputs):
        yield Variable(output, first + k, called[k], unit=units[k])
    for k in np.flatnonzero(~np.array(force, bool)).tolist():
        name, what = names(f"{outputs[k]}_rate"), f"rate of {called[k]}"
        yield Variable(name, first + count + k, what, unit=f"{units[k]}/s", is_rate=True)
    for k, contact in enumerate(rows.system.contacts):
        on = "on the body with the opposite sign" if contact.outer is None else f"pushes {contact.inner.body} away"
        what = f"{force_of(contact.name)}; {on}"
        yield Variable(names(force_of(contact.name)), first + 2 * count + k, what, unit="N")


class _Names:
    """Names that are all different, of letters, digits and underscores, as every importer takes them."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def __call__(self, name: str) -> str:
        plain = re.sub(r"[^A-Za-z0-9]+", "_", name.replace("-", "m") if re.search(r"-\d", name) else name).strip("_")
        plain = plain if plain and not plain[0].isdigit() else f"v_{plain}"
        found, count = plain, 1
        while found in self._taken:
            count += 1
            found = f"{plain}_{count}"
        self._taken.add(found)
        return found
