"""A study's part of the page."""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import dataclass

from pmr.report.marks import Row
from pmr.report.numbers import SPACE, plain, significant
from pmr.report.studies import sections
from pmr.report.studies.content import Block, Content, Grid
from pmr.report.studies.finished import FinishedStudy
from pmr.report.studies.statements import comparison
from pmr.studies.engine.task import Scalar
from pmr.studies.results import RunRecord

MOST_ROWS, MOST_COLUMNS = 60, 8


@dataclass(frozen=True)
class Plate:
    """A heading, for the index."""

    anchor: str
    title: str


@dataclass(frozen=True)
class Section:
    """A study, ready for the templates."""

    anchor: str
    title: str
    source: str
    content: Content
    rows: list[Row]
    reasons: list[str]
    plates: list[Plate]
    unfinished: list[str]


def section(study: FinishedStudy, anchor: str) -> Section:
    """Everything that the report says about one study; while a run is missing, its table alone."""
    known = {module.name for module in pkgutil.iter_modules(sections.__path__)}
    if study.kind in known and not study.unfinished:
        content: Content = importlib.import_module(f"{sections.__name__}.{study.kind}").content(study, anchor)
    else:
        content = table(study)
    found = comparison(study)
    rows = found.rows if content.rows is None else content.rows
    return Section(
        anchor=anchor,
        title=study.title,
        source=str(study.summary["source"]) or "publication",
        content=content,
        rows=rows,
        reasons=found.reasons if content.reasons is None else content.reasons,
        plates=_plates(anchor, content, bool(rows)),
        unfinished=[f"{run.key} ({run.status}: {run.reason})" for run in study.unfinished],
    )


def table(study: FinishedStudy) -> Content:
    """The runs, as many as fit on a page or two."""
    runs = study.results.runs
    names = list(dict.fromkeys(name for run in runs for name in (*run.parameters, *run.figures)))[:MOST_COLUMNS]
    rows = tuple((run.key, *(_cell(_value(run, name)) for name in names)) for run in runs[:MOST_ROWS])
    done = sum(run.status == "done" for run in runs)
    more = f" The first {MOST_ROWS}; all of them are in runs.csv." if len(runs) > MOST_ROWS else ""
    grid = Grid(f"Runs with their parameters and figures.{more} More figures: runs.csv.", ("run", *names), rows)
    return Content(headline=f"{done} of {len(runs)} runs are there.", blocks=[Block("Runs", grids=(grid,))])


def _value(run: RunRecord, name: str) -> Scalar:
    return run.parameters[name] if name in run.parameters else run.figures.get(name)


def _cell(value: Scalar) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool | str):
        return str(value)
    return plain(value) if isinstance(value, int) else significant(value, 4).replace(SPACE, "")


def _plates(anchor: str, content: Content, compared: bool) -> list[Plate]:
    plates = [Plate(f"{anchor}-{i}", block.heading) for i, block in enumerate(content.blocks, start=1)]
    if compared:
        plates.append(Plate(f"{anchor}-published", "Beside the publication"))
    if content.parameters:
        plates.append(Plate(f"{anchor}-parameters", "Parameters"))
    return plates
