"""Limits of the user's own: what a function of an installed package, or an expression in the file, makes of a state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError, environment
from pmr.errors.text import hint
from pmr.scene import Scene
from pmr.scene.keys import named
from pmr.simulation.statics.loaded import States
from pmr.simulation.statics.postures import Postures
from pmr.studies.expressions import Value, entries, value_of
from pmr.system.from_scene import force_names

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AtRest:
    """The boom in equilibrium under a load: what a function of the entry points `pmr.limits` is given."""

    load: float  # kg
    luffing: float  # rad
    slewing: float  # rad
    outputs: Mapping[str, float]  # m or Pa by name: the tip along the boom's axes, stresses at probes
    forces: Mapping[str, float]  # N or N m of pads and cylinders by name, positive where they push


Own = Callable[[AtRest], float]


def function_of(limit: str, name: str | None) -> Own:
    """Function of an entry point by its name; raises InputError where no package offers it."""
    offered = environment.plugin_objects("pmr.limits", frozenset())
    function: Any = offered.get(name or "")
    if function is None:
        choices = f"one of {', '.join(sorted(offered))}" if offered else "none: no package offers any"
        raise InputError("study", f"limits.{limit}.function", name, f"{choices} is allowed")
    if not callable(function):
        raise environment.plugin_error("pmr.limits", name or "")
    return cast(Own, function)


@lru_cache(256)  # each place of a chart asks for the same
def expression_of(text: str) -> Own:
    """Function of an expression in ``load``, ``luffing``, ``slewing``, ``output[name]`` and ``force[name]``.

    A ValueError says what is not allowed in it.
    """
    value: Value = value_of(text, ("load", "luffing", "slewing"), ("output", "force"))

    def evaluate(at: AtRest) -> float:
        numbers = {"load": at.load, "luffing": at.luffing, "slewing": at.slewing}
        return value(numbers | {"output": at.outputs, "force": at.forces})

    return evaluate


def check_names(limit: str, text: str, scene: Scene) -> None:
    """An InputError is raised for a force, a tip or a probe that an expression asks for and the scene does not have."""
    forces = [name for names in force_names(scene).values() for name in names]
    tip = named(scene.names[-1], scene.sections[-1].observe.tip)
    probes = [named(body, probe.name) for body, part in scene.bodies.items() for probe in part.probes]
    for table, columns in (("force", forces), ("output", [*forces, tip, *probes])):
        for name in entries(text, table):
            if not any(name == column or (table == "output" and name.startswith(f"{column} ")) for column in columns):
                allowed = f"{hint(name, columns)}{table} has {', '.join(columns)}"
                raise InputError("study", f"limits.{limit}.expression", name, allowed)


def amount_of(limit_function: Own, key: str, text: str | None, at: Postures, k: int) -> Callable[[States], Array]:
    """Apply a user's limit function to states at the k-th place (p,); raises InputError if it fails."""
    luffing, slewing = float(at.luffing[k]), float(at.slewing[k])

    def amount(load: float, outputs: Mapping[str, float], forces: Mapping[str, float]) -> float:
        try:
            value = float(limit_function(AtRest(load, luffing, slewing, outputs, forces)))
        except KeyError as error:
            name, names = str(error.args[0]), [*outputs, *forces]
            allowed = f"it asks for {name!r}: {hint(name, names)}{', '.join(names)} are allowed"
            raise InputError("study", key, text, allowed) from None
        except (ArithmeticError, TypeError, ValueError) as error:
            raise InputError("study", key, text, f"it failed: {error!r}") from None
        if np.isnan(value):
            raise InputError("study", key, text, "it returned no number")
        return value

    def amounts(states: States) -> Array:
        outputs, forces = (
            [dict(zip(names, row, strict=True)) for row in of.tolist()]
            for names, of in ((at.output_names, states.outputs), (at.force_names, states.forces))
        )
        return np.array(list(map(amount, states.load.tolist(), outputs, forces)))

    return amounts
