"""Names of what a study varies and finds, and their values, as they stand in tables, figures and sentences."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import BaseModel

from pmr.report.numbers import SPACE, length, percent, plain, quantity, significant
from pmr.report.subject import MODELS
from pmr.scene.parts import Part
from pmr.scene.scene import BodyFile
from pmr.scene.section import quantity_of as quantity_in
from pmr.studies.engine.task import Scalar, number
from pmr.studies.results import RunRecord

TIME = "simulate.reduced"  # seconds of one simulation of the reduced model
_PLACES = {
    "tip": "at the tip",
    "beam": "along the beam",
    "pad_force": "of the forces",
}
#: Places of the path by the names that figures give them.
PLACES = {"s_min": "s least", "s_middle": "s midway", "s_max": "s largest"}
_AGAINST = {"full": "", "ancf": " against ANCF"}


@dataclass(frozen=True)
class Quantity:
    """Label of a figure of a run, and how its value is printed; `unit` and `size` are those of an axis."""

    label: str
    printed: Callable[[float], str] = lambda value: significant(value, 4).replace(SPACE, "")
    unit: str = "–"
    size: float = 1.0

    def cell(self, value: Scalar) -> str:
        """A value in a table."""
        if value is None:
            return "–"
        if isinstance(value, bool | str):
            return value_words(value)
        return plain(value) if isinstance(value, int) else self.printed(number(value))


def key_words(key: str) -> str:
    """A key of a scene in words: ``mesh.boundary_size`` as boundary size."""
    section, _, last = key.rpartition(".")
    words = last.replace("_", " ")
    return (
        f"{section.rpartition('.')[2]} {words}".replace("_", " ") if last in ("step", "end", "file", "mass") else words
    )


def value_words(value: Scalar) -> str:
    """A value that was chosen, in words."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value in MODELS:
        return MODELS[str(value)].partition(" ")[2]
    return value.replace("_", " ") if isinstance(value, str) else ("–" if value is None else plain(number(value)))


def unit_of(key: str) -> str:
    """Unit of a scene's key, as the scene declares it; empty for a plain number, a word, or what is no such key."""
    section: type[BaseModel] = Part if re.match(r"sections?\b", key) else BodyFile
    *path, last = key.split(".")
    for part in path:
        inside = section.model_fields.get(part.partition("[")[0])  # what is no key names an entry of a list
        if inside is not None:
            section = next(_sections(inside.annotation), section)
    quantity = quantity_in(section, last) if last in section.model_fields else None
    return "" if quantity is None or quantity.unit == "1" else quantity.unit.replace("^2", "²").replace("^3", "³")


def _sections(annotation: Any) -> Iterator[type[BaseModel]]:
    """Sections that a field may hold."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _sections(part)


def heading(key: str) -> str:
    """A key as it heads a column."""
    unit = unit_of(key)
    return f"{key_words(key)} in {unit}" if unit else key_words(key)


def run_name(run: RunRecord, left_out: str = "") -> str:
    """A run by what distinguishes it, but for one of its parameters."""
    words = []
    for key, value in run.parameters.items():
        unit = unit_of(key)
        if key == left_out:
            continue
        if key in ("case", "scene"):
            words.append(value_words(value))
        elif isinstance(value, int) and not isinstance(value, bool):
            words.append(f"{value_words(value)} {key_words(key)}")
        else:
            words.append(f"{key_words(key)} {value_words(value)}" + (f"{SPACE}{unit}" if unit else ""))
    return ", ".join(words) or run.key


def quantity_of(name: str) -> Quantity:
    """Quantity of a figure of a run."""
    parts = name.split(".", 2) if name.startswith("errors.") else name.split(".")
    if parts[0] == "errors" and len(parts) == 3:
        model, _, other = parts[1].partition("_vs_")
        of = "" if model == "reduced" else f", {model}"
        return Quantity(
            f"error {_PLACES.get(parts[2], f'of {parts[2]}')}{of}{_AGAINST.get(other, other)}", percent, "%", 0.01
        )
    if parts[0] == "frequency_error":
        return Quantity(f"error of frequency {parts[1]}", percent, "%", 0.01)
    if parts[0] == "frequencies" and len(parts) == 3:
        return Quantity(f"frequency {parts[2]}, {PLACES[parts[1]]}", lambda f: f"{significant(f, 4)}{SPACE}Hz", "Hz")
    if parts[0] == "mass":
        return Quantity(", ".join(parts), lambda mass: f"{significant(mass, 4)}{SPACE}kg", "kg")
    if parts[0] == "probes" and parts[-1] == "range":
        stress = " stress " in name
        printed = (lambda size: quantity(size, "Pa")) if stress else (lambda size: significant(size, 3))
        return Quantity(f"range of {name[7:-6]}", printed, "Pa" if stress else "–")
    return {
        "utilisation": Quantity("largest stress over yield stress", percent, "%", 0.01),
        "largest_force": Quantity("largest force", lambda force: quantity(force, "N"), "N"),
        "max_displacement": Quantity("largest displacement", length, "m"),
        "max_error": Quantity("largest difference", length, "m"),
        "coordinates.full": Quantity("coordinates, full"),
        "coordinates.reduced": Quantity("coordinates, reduced"),
        "basis.kappa": Quantity("left out by the basis, 1 − κ", lambda kappa: significant(max(1.0 - kappa, 0.0), 2)),
        "simulate.reduced": Quantity("time, reduced", lambda value: quantity(value, "s"), "s"),
        "simulate.full": Quantity("time, full", lambda value: quantity(value, "s"), "s"),
        "simulate.ancf": Quantity("time, ANCF", lambda value: quantity(value, "s"), "s"),
    }.get(name, Quantity(name.replace("_", " ").replace(".", ", ")))


def runs_with(runs: Iterable[RunRecord], name: str) -> list[RunRecord]:
    """Runs in which a figure is a number."""
    return [run for run in runs if number_of(run.figures.get(name)) is not None]


def differs(runs: Iterable[RunRecord], name: str) -> bool:
    """Whether a figure is known of several runs and not the same in all of them."""
    return len({quantity_of(name).cell(run.figures[name]) for run in runs_with(runs, name)}) > 1


def value_of(run: RunRecord, name: str) -> float:
    """A figure that is a number."""
    return number(run.figures[name])


def number_of(value: Scalar) -> float | None:
    """A value, if it is a number."""
    return None if value is None or isinstance(value, bool | str) else float(value)


def case_name(scene: str) -> str:
    """A scene's file as it is called in a sentence: ``paper_evolved`` is the evolved case."""
    name = scene.removeprefix("paper_").replace("_", " ")
    return f"{name} case" if scene.startswith("paper_") else name


def list_words(words: Iterable[str]) -> str:
    """``a, b and c``."""
    *most, last = words
    return f"{', '.join(most)} and {last}" if most else last
