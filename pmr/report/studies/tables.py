"""A finished study, read for its report, and tables of its runs: a row for each quantity, a column for each run."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import floor
from pathlib import Path
from typing import get_args

from pydantic import BaseModel

from pmr.files.arrays import Summary
from pmr.report.blocks import Block, Grid
from pmr.report.numbers import SPACE, format_in_unit, format_input, significant, unit_for
from pmr.results.quantities import unit_text
from pmr.scene.joints import BoomSection
from pmr.scene.keys import quantity_of as quantity_in
from pmr.scene.model_traits import MODELS
from pmr.scene.scene import BodyFile
from pmr.studies.study import RunRecord, Statement, StudyResults
from pmr.studies.tasks import Scalar, cell_number


@dataclass(frozen=True)
class FinishedStudy:
    """Content of a study's folder: its summary, and the results of its runs."""

    name: str  # of the folder, by which links refer to the study's chapter
    summary: Summary  # content of summary.json, without the runs
    results: StudyResults  # the runs and their arrays

    @classmethod
    def load(cls, folder: Path) -> FinishedStudy:
        """Read a study's folder."""
        summary = json.loads((folder / "summary.json").read_text())
        return cls(folder.name, {k: v for k, v in summary.items() if k != "runs"}, StudyResults.load(folder))

    @property
    def kind(self) -> str:
        """Kind of the study, such as ``chart``."""
        return str(self.summary["kind"])

    @property
    def title(self) -> str:
        """Title of the study."""
        return str(self.summary["title"])

    @property
    def study_file(self) -> Summary:
        """Keys that the study's kind has, with their values; without names of files and keys of all studies."""
        return dict(self.summary["asked"])

    @property
    def figures(self) -> Mapping[str, Scalar]:
        """Values that are computed from all runs together, by name; empty as long as a run has no result."""
        return dict(self.summary["figures"])

    @property
    def published(self) -> list[Statement]:
        """Published statements that the study file names for comparison."""
        return [Statement.model_validate(entry) for entry in self.summary["published"]]

    @property
    def unfinished_runs(self) -> list[RunRecord]:
        """Runs without a result."""
        return [run for run in self.results.runs if run.status != "done"]


TIME = "simulate.reduced"  # name of the time in s that one simulation of the reduced model takes
_PLACES = {"tip": "at the tip", "beam": "along the beam", "pad_force": "of the forces"}
#: Words for positions on the path, by the parts of values' names that stand for these positions.
PLACES = {"s_min": "least s", "s_middle": "middle s", "s_max": "largest s"}
_AGAINST = {"full": "", "ancf": " against ANCF"}


@dataclass(frozen=True)
class ValueLabel:
    """Label and unit of a value of a run; the unit is ``%`` for a fraction and ``–`` for a plain number."""

    label: str
    unit: str = "–"
    missing: bool = False  # whether 1 minus the value is printed in place of the value
    whole: bool = False  # whether the value is rounded down to a whole number, as allowed loads are

    def cell(self, value: Scalar) -> str:
        """Format a value for a table; None is printed as a dash."""
        if value is None:
            return "–"
        if isinstance(value, bool | str):
            return value_words(value)
        if self.missing:
            return significant(max(1.0 - cell_number(value), 0.0), 2)
        if self.whole:
            return f"{format_input(floor(cell_number(value)))}{SPACE}{self.unit}"
        return format_input(value) if isinstance(value, int) else format_in_unit(cell_number(value), self.unit)


def key_words(key: str) -> str:
    """Name a key of a scene in words: ``boundary size`` for ``mesh.boundary_size``, ``time step`` for ``time.step``.

    The table's name is put before ``step``, ``end``, ``file`` and ``mass``, which say too little alone.
    """
    section, _, last = key.rpartition(".")
    words = last.replace("_", " ")
    return (
        f"{section.rpartition('.')[2]} {words}".replace("_", " ") if last in ("step", "end", "file", "mass") else words
    )


def value_words(value: Scalar) -> str:
    """Describe the value of a parameter in words.

    That is yes or no for a truth value, the words for a structural model for its name, and a dash for None.
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value in MODELS:
        return MODELS[str(value)].words.partition(" ")[2]
    return (
        value.replace("_", " ")
        if isinstance(value, str)
        else ("–" if value is None else format_input(cell_number(value)))
    )


def unit_of(key: str) -> str:
    """Unit of a scene's key, as the scene declares it; empty for a pure number, a text or an unknown key.

    `key` is dotted.  In a scene of sections it begins with ``section.`` or ``sections[1].``; any other key is looked up
    in the tables of a scene of one body.
    """
    section: type[BaseModel] = BoomSection if re.match(r"sections?\b", key) else BodyFile
    *path, last = key.split(".")
    for part in path:
        inside = section.model_fields.get(part.partition("[")[0])  # else the name of an entry of a list
        if inside is not None:
            section = next(_sections(inside.annotation), section)
    quantity = quantity_in(section, last) if last in section.model_fields else None
    return "" if quantity is None else unit_text(quantity.unit)


def _sections(annotation: object) -> Iterator[type[BaseModel]]:
    """Yield the classes of a scene's tables that the type annotation of a field contains."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _sections(part)


def heading(key: str) -> str:
    """Column heading of the parameter `key`, with its unit."""
    unit = unit_of(key)
    return f"{key_words(key)} in {unit}" if unit else key_words(key)


def run_name(run: RunRecord, left_out: str = "") -> str:
    """Name a run by the values of its parameters other than `left_out`; by its key if it has no others."""
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


def quantity_of(name: str) -> ValueLabel:
    """Label and unit of the value called `name`.

    A name without a label of its own becomes the label of a plain number, with spaces for underscores.
    """
    parts = name.split(".", 2) if name.startswith("errors.") else name.split(".")
    if parts[0] == "errors" and len(parts) == 3:
        model, _, other = parts[1].partition("_vs_")
        of = "" if model == "reduced" else f", {model}"
        return ValueLabel(f"error {_PLACES.get(parts[2], f'of {parts[2]}')}{of}{_AGAINST.get(other, other)}", "%")
    if parts[0] == "frequency_error":
        return ValueLabel(f"error of frequency {parts[1]}", "%")
    if parts[0] == "frequencies" and len(parts) == 3:
        return ValueLabel(f"frequency {parts[2]}, {PLACES[parts[1]]}", "Hz")
    if parts[0] == "mass":
        return ValueLabel(", ".join(parts), "kg")
    if parts[0] == "probes" and parts[-1] == "range":
        measured = name[7:-6]  # probe, what it measures, and a component
        return ValueLabel(f"range of {measured}", "Pa" if measured.split(" ")[-2:-1] == ["stress"] else "–")
    return {
        "utilisation": ValueLabel("largest stress over yield stress", "%"),
        "load.least": ValueLabel("least load", "kg", whole=True),
        "load.most": ValueLabel("largest load", "kg", whole=True),
        "largest_force": ValueLabel("largest force", "N"),
        "max_displacement": ValueLabel("largest displacement", "m"),
        "max_error": ValueLabel("largest difference", "m"),
        "coordinates.full": ValueLabel("coordinates, full"),
        "coordinates.reduced": ValueLabel("coordinates, reduced"),
        "basis.kappa": ValueLabel("share of the snapshots that the basis leaves out, 1 − κ", missing=True),
        "simulate.reduced": ValueLabel("time, reduced", "s"),
        "simulate.full": ValueLabel("time, full", "s"),
        "simulate.ancf": ValueLabel("time, ANCF", "s"),
    }.get(name, ValueLabel(name.replace("_", " ").replace(".", ", ")))


def runs_with(runs: Iterable[RunRecord], name: str) -> list[RunRecord]:
    """Runs in which the value called `name` is a number."""
    return [run for run in runs if number_of(run.figures.get(name)) is not None]


def is_varied(runs: Iterable[RunRecord], name: str) -> bool:
    """Whether the value called `name`, as printed, differs between the runs that have it."""
    return len({quantity_of(name).cell(run.figures[name]) for run in runs_with(runs, name)}) > 1


def value_of(run: RunRecord, name: str) -> float:
    """Return the value called `name` in a run, which has to be a number there."""
    return cell_number(run.figures[name])


def number_of(value: Scalar) -> float | None:
    """Return a value as a number; None for a missing value, a truth value or a text."""
    return None if value is None or isinstance(value, bool | str) else float(value)


def list_words(words: Iterable[str]) -> str:
    """Join one or more words as ``a, b and c``."""
    *most, last = words
    return f"{', '.join(most)} and {last}" if most else last


#: Rows of the table of largest values: for each word, the pattern that names of values match, and the unit.  A row has
#: the largest amount of these values, or the least one if the word begins with "lowest".
ROWS = {
    "mass": (r"mass", "kg"),
    "largest displacement": (r"max_displacement", "m"),
    "lowest frequency": (r"frequencies\..*", "Hz"),
    "largest force of a pad, slider or support": (r"forces\..*\.(min|max)", "N"),
    "largest force on a rigid support": (r"reactions\..*\.(min|max)", "N"),
    "largest moment on a rigid support": (r"moments\..*\.(min|max)", "N m"),
    "largest bending moment": (r"beam_moments\..*bending moment .\.(min|max)", "N m"),
    "largest von Mises stress": (r"stress\..*\.max", "Pa"),
    "largest stress over yield stress": (r"utilisation", "%"),
}


def largest_value_block(runs: Sequence[RunRecord]) -> Block | None:
    """Build the block with the largest absolute values of each run; None if there are fewer than two quantities.

    A row is a quantity of `largest_values`, a column is a run.
    """
    rows = [(word, *cells) for word, cells in largest_values(runs).items()]
    if len(rows) < 2:
        return None
    caption = "Largest absolute values of each run; their times and places are in runs.csv."
    return Block("At a glance", grids=(Grid(caption, ("", *map(run_name, runs)), tuple(rows)),))


def largest_values(runs: Sequence[RunRecord]) -> dict[str, list[str]]:
    """List the largest absolute value of every run as text with its unit, by quantity of `ROWS`.

    A quantity whose name begins with "lowest" has the lowest value instead.  A dash stands for a run without the
    quantity; quantities that no run has are left out.
    """
    cells = {}
    for word, (names, unit) in ROWS.items():
        values = [_extreme_amount(run, names, min if word.startswith("lowest") else max) for run in runs]
        if any(value is not None for value in values):
            cells[word] = ["–" if value is None else format_in_unit(value, unit) for value in values]
    return cells


def _extreme_amount(run: RunRecord, names: str, extreme: Callable[..., float | None]) -> float | None:
    """Largest or least absolute value of a run's values whose names match the pattern `names`.

    `extreme` is the function max or min.  The result is None if no name matches.
    """
    numbers = (number_of(value) for name, value in run.figures.items() if re.fullmatch(names, name))
    return extreme((abs(value) for value in numbers if value is not None), default=None)


#: Number of runs that fit side by side.  For more runs there are no tables of all values, which runs.csv has; curves
#: show the largest values.
MOST_RUNS = 6
#: Beginnings of the names of values that have a table in this module; `pmr.report.studies.runs` leaves them out.
ROOMS = (
    "forces.", "reactions.", "moments.", "stress.", "frequencies.", "probes.", "path.", "beam_forces.", "beam_moments.",
    "utilisation_", "ropes.",
)  # fmt: skip

#: A value is round-off if it is less than this share of the largest value with the same unit.
NOTHING = 1e-6
#: Ends of the names of values in tables: kinds of extremes, and numbers of frequencies.
_ENDS = re.compile(r"\.(min|max|range)$|(\.\d+)$")
#: For each table its heading, the pattern of the names of its values with the name of a row as group, and their unit.
_TABLES = (
    ("Forces of pads, sliders and supports", r"forces\.(.*)", "N"),
    ("Forces of ropes, and of what pulls them", r"ropes\.(.*)", "N"),
    ("Forces on rigid supports", r"reactions\.(.*)", "N"),
    ("Moments on rigid supports", r"moments\.(.*)", "N m"),
    ("Stress by region", r"stress\.(.*)", "Pa"),
    ("Forces along beams", r"beam_forces\.(.*)", "N"),
    ("Moments along beams", r"beam_moments\.(.*)", "N m"),
    ("Frequencies, while pads and sliders rest", r"frequencies\.(.*)", "Hz"),
    ("Stresses at probes", r"probes\.(.* stress \S+)", "Pa"),
    ("Strains at probes", r"probes\.(.* strain \S+)", "strain"),
    ("Displacements at probes", r"probes\.(.* displacement \S+)", "mm"),
)


def value_blocks(runs: Sequence[RunRecord]) -> Iterator[Block]:
    """Yield blocks with tables of forces, stresses, frequencies and probes, with a column for each run with a result.

    Nothing is yielded for more than `MOST_RUNS` such runs; a table without rows is left out.
    """
    if done := few_runs(runs):
        for heading, pattern, base in _TABLES:
            if (grid := _value_grid(done, re.compile(pattern), base)).rows:
                yield Block(heading, grids=(grid,))


def _value_grid(runs: Sequence[RunRecord], pattern: re.Pattern[str], base: str) -> Grid:
    """Build a table of values of `runs`, each from least to largest: those whose names match the `pattern`.

    `base` is the unit of these values without prefix.  Values that are round-off beside the largest one have no row.
    Ranges of load cycles have rows of their own.
    """
    keys = dict.fromkeys(key for run in runs for key in run.figures if _ENDS.search(key))
    names = {_ENDS.sub(r"\2", key): None for key in keys if pattern.fullmatch(_ENDS.sub(r"\2", key))}
    sizes = {name: max((abs(value) for run in runs for value in _span(run, name)), default=0.0) for name in names}
    largest, rows = max(sizes.values(), default=0.0), list[tuple[str, ...]]()
    unit = unit_for(largest, base)
    for name in (name for name in names if sizes[name] > NOTHING * largest):
        spans = (f"{SPACE}…{SPACE}".join(_format_value(v, unit.size) for v in _span(run, name)) for run in runs)
        match = pattern.fullmatch(name)
        rows.append((_row_name(match[1] if match else name, base), *(span or "–" for span in spans)))
        if any(f"{name}.range" in run.figures for run in runs):
            ranges = (_format_value(run.figures.get(f"{name}.range"), unit.size) for run in runs)
            rows.append((f"{SPACE}{SPACE}range of the largest load cycle", *ranges))
    caption = f"Least … largest in {unit.name}; times and places are in runs.csv."
    return Grid(caption, ("", *map(run_name, runs)), tuple(rows))


def _row_name(name: str, base: str) -> str:
    """Title of a table's row of values with the unit `base`: the key `name` itself, except for frequencies in Hz.

    The key of a frequency, such as ``s_min.2``, states a place on the path and the number of the frequency; its title
    is "frequency 2, s least".
    """
    if base != "Hz":
        return name
    place, number = name.split(".")
    return f"frequency {number}, {PLACES[place]}"


def _span(run: RunRecord, name: str) -> list[float]:
    """The least and the largest value called `name` of a run, in this order.

    If the run has a single value of this name, the list has this value alone.  If the run has none, the list is empty.
    """
    values = (number_of(run.figures.get(key)) for key in (f"{name}.min", f"{name}.max", name))
    return [value for value in values if value is not None]


def few_runs(runs: Sequence[RunRecord]) -> list[RunRecord]:
    """Runs with a result; an empty list if there are more than `MOST_RUNS` of them."""
    done = [run for run in runs if run.status == "done"]
    return done if len(done) <= MOST_RUNS else []


def _format_value(value: Scalar, size: float) -> str:
    """Format a value in a unit of size `size`; a value that is not a number is printed as a dash."""
    number = number_of(value)
    return "–" if number is None else significant(number / size, 3)
