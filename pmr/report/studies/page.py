"""A study's part of the page."""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import replace

from pmr.report.blocks import Block, Chapter, Grid
from pmr.report.numbers import SPACE, plain, significant
from pmr.report.studies import sections
from pmr.report.studies.finished import FinishedStudy
from pmr.report.studies.statements import comparison
from pmr.studies.engine.task import Scalar
from pmr.studies.results import RunRecord

MOST_ROWS, MOST_COLUMNS = 60, 8


def chapter(study: FinishedStudy, anchor: str) -> Chapter:
    """Everything that the report says about one study; while a run is missing, its table alone."""
    known = {module.name for module in pkgutil.iter_modules(sections.__path__)}
    if study.kind in known and not study.unfinished:
        found: Chapter = importlib.import_module(f"{sections.__name__}.{study.kind}").content(study, anchor)
    else:
        found = table(study, anchor)
    published = comparison(study)
    if published.rows and not any(block.errors for block in found.blocks):
        found = replace(found, blocks=[*found.blocks, Block("Beside the publication", errors=published)])
    unfinished = [f"{run.key} ({run.status}: {run.reason})" for run in study.unfinished]
    return replace(found, unfinished=unfinished)


def table(study: FinishedStudy, anchor: str) -> Chapter:
    """The runs, as many as fit on a page or two."""
    runs = study.results.runs
    names = list(dict.fromkeys(name for run in runs for name in (*run.parameters, *run.figures)))[:MOST_COLUMNS]
    rows = tuple((run.key, *(_cell(_value(run, name)) for name in names)) for run in runs[:MOST_ROWS])
    done = sum(run.status == "done" for run in runs)
    more = f" The first {MOST_ROWS}; all of them are in runs.csv." if len(runs) > MOST_ROWS else ""
    grid = Grid(f"Runs with their parameters and figures.{more} More figures: runs.csv.", ("run", *names), rows)
    headline, blocks = f"{done} of {len(runs)} runs are there.", [Block("Runs", grids=(grid,))]
    return Chapter(anchor=anchor, title=study.title, headline=headline, blocks=blocks)


def _value(run: RunRecord, name: str) -> Scalar:
    return run.parameters[name] if name in run.parameters else run.figures.get(name)


def _cell(value: Scalar) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool | str):
        return str(value)
    return plain(value) if isinstance(value, int) else significant(value, 4).replace(SPACE, "")
