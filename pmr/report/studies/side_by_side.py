"""Forces, frequencies and probes of a few runs side by side: a row for each, a column for each run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from pmr.report.blocks import Block, Grid
from pmr.report.numbers import SPACE, Unit, plain, significant, unit_for
from pmr.report.studies.names import PLACES, number_of, run_name
from pmr.studies.engine.task import Scalar
from pmr.studies.results import RunRecord

#: Runs that fit side by side; of more runs.csv has all figures, and curves show the largest.
MOST_RUNS = 6
#: What of a run's figures is shown here, and not among those of `pmr.report.studies.runs`.
ROOMS = (
    "forces.", "reactions.", "moments.", "stress.", "frequencies.", "probes.", "path.", "beam_forces.", "beam_moments.",
    "utilisation_", "ropes.",
)  # fmt: skip

#: Share of the largest value of its unit below which what a probe measures is round-off.
NOTHING = 1e-6
#: Headings of what has a largest value, and maybe a least one, with its room, its unit and which of both it has.
_SPANS = {
    "Forces of pads, sliders and supports": ("forces.", "N", "Least … largest"),
    "Forces of ropes, and of what pulls them": ("ropes.", "N", "Least … largest"),
    "Forces on rigid supports": ("reactions.", "N", "Least … largest"),
    "Moments on rigid supports": ("moments.", "N m", "Least … largest"),
    "Stress by region": ("stress.", "Pa", "Largest von Mises stress"),
    "Forces along beams": ("beam_forces.", "N", "Least … largest"),
    "Moments along beams": ("beam_moments.", "N m", "Least … largest"),
}
#: Words in names of probes by their units, and whether the unit takes a prefix.
_BASE = {"Pa": ("stress", True), "1": ("strain", False), "mm": ("displacement", False)}


def blocks(runs: Sequence[RunRecord]) -> Iterator[Block]:
    """Tables of what the runs have; none for many runs, or for runs that have nothing of it."""
    if not (done := few(runs)):
        return
    tables = {heading: _spans(done, *of) for heading, of in _SPANS.items()}
    tables |= {
        "Frequencies": (f"In Hz, while pads and sliders rest{_stretch(done)}.", _frequencies(done)),
        "Probes": ("Least … largest, and the largest range of a load cycle.", _probes(done)),
    }
    head = ("", *(run_name(run) for run in done))
    for heading, (caption, rows) in tables.items():
        if rows:
            yield Block(heading, grids=(Grid(caption, head, tuple(rows)),))


def few(runs: Sequence[RunRecord]) -> list[RunRecord]:
    """Runs with a result, where they fit side by side; else none."""
    done = [run for run in runs if run.status == "done"]
    return done if len(done) <= MOST_RUNS else []


def _spans(runs: Sequence[RunRecord], room: str, base: str, caption: str) -> tuple[str, list[tuple[str, ...]]]:
    """Caption and rows of what figures of a room say, each from its least to its largest value; without round-off."""
    sizes = {
        name: max(map(abs, _values(runs, room + name, "min", "max")), default=0.0)
        for name in _names(runs, room, ".max")
    }
    largest = max(sizes.values(), default=0.0)
    unit, names = unit_for(largest, base), [name for name, size in sizes.items() if size > NOTHING * largest]
    rows = [(name, *(_span(run, room + name, unit.size) for run in runs)) for name in names]
    return f"{caption} in {unit.name}; times and places are in runs.csv.", rows


def _frequencies(runs: Sequence[RunRecord]) -> list[tuple[str, ...]]:
    keys = dict.fromkeys(key for run in runs for key in run.figures if key.startswith("frequencies."))
    rows = []
    for key in keys:
        _, place, number = key.split(".")
        cells = (_format_value(run.figures.get(key), 1.0) for run in runs)
        rows.append((f"frequency {number}, {PLACES[place]}", *cells))
    return rows


def _stretch(runs: Sequence[RunRecord]) -> str:
    """Range of the path, if it is that of all runs alike."""
    ends = {(number_of(run.figures.get("path.s_min")), number_of(run.figures.get("path.s_max"))) for run in runs}
    low, high = ends.pop()
    if ends or low is None or high is None:
        return ""
    return f"; s is {plain(round(low, 6))}{SPACE}m at least and {plain(round(high, 6))}{SPACE}m at most"


def _probes(runs: Sequence[RunRecord]) -> list[tuple[str, ...]]:
    rows, names = [], _names(runs, "probes.", ".range")
    for base, (word, prefix) in _BASE.items():
        of_kind = [name for name in names if f" {word} " in name]
        sizes = {name: max(map(abs, _values(runs, f"probes.{name}", "min", "max")), default=0.0) for name in of_kind}
        largest = max(sizes.values(), default=0.0)
        unit = unit_for(largest, base) if prefix else Unit(1.0, base)
        for name in of_kind:
            if sizes[name] <= NOTHING * largest:
                continue
            of = f"{name} in {unit.name}" if unit.name != "1" else name
            rows.append((of, *(_span(run, f"probes.{name}", unit.size) for run in runs)))
            ranges = (_format_value(run.figures.get(f"probes.{name}.range"), unit.size) for run in runs)
            rows.append((f"{SPACE}{SPACE}range", *ranges))
    return rows


def _names(runs: Sequence[RunRecord], first: str, last: str) -> list[str]:
    keys = dict.fromkeys(key for run in runs for key in run.figures)
    return [key[len(first) : -len(last)] for key in keys if key.startswith(first) and key.endswith(last)]


def _values(runs: Sequence[RunRecord], name: str, *keys: str) -> Iterator[float]:
    for run in runs:
        for key in keys:
            if (value := number_of(run.figures.get(f"{name}.{key}"))) is not None:
                yield value


def _span(run: RunRecord, name: str, size: float) -> str:
    figures: Mapping[str, Scalar] = run.figures
    least, most = figures.get(f"{name}.min"), figures.get(f"{name}.max")
    first = "" if least is None else f"{_format_value(least, size)}{SPACE}…{SPACE}"
    return f"{first}{_format_value(most, size)}"


def _format_value(value: Scalar, size: float) -> str:
    number = number_of(value)
    return "–" if number is None else significant(number / size, 3)
