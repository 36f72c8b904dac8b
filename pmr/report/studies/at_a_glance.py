"""What runs take and bear in one table: mass, deflection, frequency, largest forces, stress and utilisation."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial

from pmr.report.blocks import Block, Grid
from pmr.report.numbers import SPACE, length, percent, quantity, significant
from pmr.report.studies.names import number_of, run_name
from pmr.studies.results import RunRecord

#: A word for each row; the names of the figures that it is the largest of, in either direction; how it is printed.
ROWS: dict[str, tuple[str, Callable[[float], str]]] = {
    "mass": (r"mass", lambda mass: f"{significant(mass, 4)}{SPACE}kg"),
    "largest displacement": (r"max_displacement", length),
    "lowest frequency": (r"frequencies\..*", lambda f: f"{significant(f, 4)}{SPACE}Hz"),
    "largest force of a pad, slider or support": (r"forces\..*\.(min|max)", partial(quantity, base="N")),
    "largest force on a rigid support": (r"reactions\..*\.(min|max)", partial(quantity, base="N")),
    "largest moment on a rigid support": (r"moments\..*\.(min|max)", partial(quantity, base="N m")),
    "largest bending moment": (r"beam_moments\..*bending moment .\.(min|max)", partial(quantity, base="N m")),
    "largest von Mises stress": (r"stress\..*\.max", partial(quantity, base="Pa")),
    "largest stress over yield stress": (r"utilisation", percent),
}


def block(runs: Sequence[RunRecord]) -> Block | None:
    """A row for each quantity that any of the runs has, with its unit; None where that is but one."""
    rows = [(word, *cells) for word, cells in columns(runs).items()]
    if len(rows) < 2:
        return None
    caption = "Over the whole run, in either direction; times and places are below and in runs.csv."
    return Block("At a glance", grids=(Grid(caption, ("", *map(run_name, runs)), tuple(rows)),))


def columns(runs: Sequence[RunRecord]) -> dict[str, list[str]]:
    """For each quantity that any of the runs has the value of every run."""
    cells = {}
    for word, (names, printed) in ROWS.items():
        values = [_extreme(run, names, min if word.startswith("lowest") else max) for run in runs]
        if any(value is not None for value in values):
            cells[word] = ["–" if value is None else printed(value) for value in values]
    return cells


def _extreme(run: RunRecord, names: str, which: Callable[..., float | None]) -> float | None:
    numbers = (number_of(value) for name, value in run.figures.items() if re.fullmatch(names, name))
    return which((abs(value) for value in numbers if value is not None), default=None)
