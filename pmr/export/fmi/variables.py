"""Variables of an FMU, in the order of their value references (source/body.h)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.errors import BEYOND_ENDS
from pmr.reduced.model import ReducedModel
from pmr.scene.built import force_of
from pmr.system.body import force_outputs

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


def variables(model: ReducedModel, modes: int, start: Array, nominal: Array) -> list[Variable]:
    """All variables of a model with so many modes, by `pmr.export.fmi.constants.source_text`'s start and nominal."""
    names = _Names()
    found = list(_given(model, names, start))
    count = max(len(model.input_names), 1)
    first = 6 + 2 * count
    for k in range(2 * modes):
        mode, rate = k % modes + 1, k >= modes
        called, unit = ("rate of mode", "m/s") if rate else ("mode", "m")
        what = f"{called} {mode}, modal mass 1 kg"
        name = names(f"mode_{mode}{'_rate' * rate}")
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
    found += _observed(model, names, first + 4 * modes)
    return found


def _given(model: ReducedModel, names: _Names, start: Array) -> Iterator[Variable]:
    """Time, inputs and parameters."""
    count, (low, high) = max(len(model.input_names), 1), model.domain
    units = [unit.replace("^", "") for unit in model.input_units]
    own = [names(name) for name in ("time", "s", "s_rate", "internal_step", "rho_inf", "start")]  # whatever loads are
    yield Variable(own[0], 0, "time", "independent", initial="", unit="s")
    beyond = f"up to {BEYOND_ENDS * (high - low):.3g} m beyond an end it is taken there"
    path = f"path coordinate of the sliders; {beyond}"
    yield Variable(own[1], 1, path, "input", initial="", unit="m", start=float(start[1]), within=(low, high))
    inputs = [(own[2], 2, "rate of s", "m/s")]
    pairs = zip(model.input_names, units, strict=True)
    loads = [(names(name), 3 + k, f"load {name}", unit) for k, (name, unit) in enumerate(pairs)]
    rates = [
        (names(f"{name}_rate"), count + at, f"rate of the {what}", "m/s3" if unit == "m/s2" else f"{unit}/s")
        for name, at, what, unit in loads
    ]
    for name, at, what, unit in (*inputs, *loads, *rates):
        yield Variable(name, at, what, "input", "continuous", "", unit, float(start[at]))
    first, step, rho_inf = 3 + 2 * count, start[3 + 2 * count], start[4 + 2 * count]
    how = "undeformed and at rest, in equilibrium with the loads, or as the start values of the modes say"
    given = (
        ("longest internal step in Co-Simulation", "s", step),
        ("spectral radius of generalized-alpha at infinite frequency", "", rho_inf),
        (how, "", STARTS["at rest"]),
    )
    for k, (what, unit, value) in enumerate(given):
        found = Variable(own[3 + k], first + k, what, "parameter", "fixed", "exact", unit, float(value))
        yield replace(found, is_choice=what is how)


def _observed(model: ReducedModel, names: _Names, first: int) -> Iterator[Variable]:
    """Outputs, their rates where they are motions, and the forces of the rows."""
    o, force = len(model.outputs), force_outputs(model)
    called = model.output_names or tuple(f"output {k}" for k in range(o))
    units = model.output_units or ("m",) * o
    outputs = [names(name if not is_force else force_of(name)) for name, is_force in zip(called, force, strict=True)]
    for k in range(o):
        yield Variable(outputs[k], first + k, called[k], unit=units[k])
    for k in np.flatnonzero(~force).tolist():
        name, what = names(f"{outputs[k]}_rate"), f"rate of {called[k]}"
        yield Variable(name, first + max(o, 1) + k, what, unit=f"{units[k]}/s", is_rate=True)
    for k, name in enumerate(model.row_names):
        what = f"{force_of(name)}; on the body with the opposite sign"
        yield Variable(names(force_of(name)), first + 2 * max(o, 1) + k, what, unit="N")


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


def named(found: Sequence[Variable], causality: str) -> list[Variable]:
    """Those of one causality."""
    return [variable for variable in found if variable.causality == causality]
