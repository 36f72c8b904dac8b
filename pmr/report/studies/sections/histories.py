"""Tip displacement and energy over time, and the table of displacement errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pmr.files import records
from pmr.report import errors, marks, parameters
from pmr.report.blocks import Block, Chapter, Drawing, Grid, KeyNumber, Table, drawing
from pmr.report.figures import inputs
from pmr.report.figures.canvas import WIDE, key, sheet
from pmr.report.figures.timeline import Timeline
from pmr.report.numbers import length, percent
from pmr.report.studies.finished import FinishedStudy
from pmr.report.studies.names import case_name
from pmr.results import BodyResult, Frequencies, Loads, Paths, Response, RunResult, Shapes
from pmr.scene import Published, Scene
from pmr.scene.names import ALONE, SLIDER
from pmr.studies.results import RunRecord

SIMULATORS = ("full", "ancf", "reduced")
PANELS = {"Displacement": "m", "Total energy": "J"}


def content(study: FinishedStudy, prefix: str) -> Chapter:
    """Figures and errors of every scene."""
    results = {run.key: run_result(study, run) for run in study.results.runs if run.status == "done"}
    rows, reasons = [], list[str]()
    for name, result in results.items():
        rows += [replace(row, comparison=f"{case_name(name)}: {row.comparison}") for row in errors.rows(result)]
        reasons += [why for why in result.summary["notes"] if why not in reasons]
    source = str(study.summary["source"]) or "publication"
    published = marks.ErrorTable(f"Published: {source}.", rows, reasons)
    worst = max(study.figure(f"{name}.errors.reduced_vs_full.beam") for name in results)
    dropped = max(study.figure(f"{name}.dropped.beam") for name in results)
    return Chapter(
        anchor=prefix,
        title=study.title,
        headline=f"The reduced beam is within {percent(worst)} of the full one; without the pin's rows within "
        f"{percent(dropped)}.",
        key_numbers=[
            KeyNumber(
                percent(study.figure(f"{name}.errors.reduced_vs_full.beam")),
                f"error along the beam, {case_name(name)}",
            )
            for name, result in results.items()
        ],
        paragraphs=[
            "All three beams are simulated over the whole time span: the reduced and the full one by the compiled "
            "simulator, the ANCF cable with its sliding joint by Exudyn.",
        ],
        blocks=[
            *(
                Block(case_name(name).capitalize(), _figures(result, f"{prefix}-{name}"))
                for name, result in results.items()
            ),
            Block("Without the pin's rows", grids=(_dropped(study, results),)),
            Block("Beside the publication", errors=published),
            Block("Parameters", columns=_parameters(results)),
        ],
    )


def run_result(study: FinishedStudy, run: RunRecord) -> RunResult:
    """A run as the figures of single runs read it; displacements at the tip only."""
    arrays = study.results.arrays(run.key)
    scene = Scene.model_validate_json(str(arrays["scene"])).model_copy(update={"published": _published(study, run)})
    remarks = [
        statement.why for statement in study.published if statement.figure.startswith(f"{run.key}.") and statement.why
    ]
    summary = _nested(run.figures) | {"notes": list(dict.fromkeys(remarks)), "seconds": {}}
    responses = {name: records.record(Response, arrays, f"{name}.") for name in SIMULATORS}
    nowhere = np.zeros((0, 1))
    return RunResult(
        scene=scene,
        summary=summary,
        responses=responses,
        paths=Paths((SLIDER,), arrays["path"][:, None], arrays["path_rate"][:, None]),
        loads=Loads((), (), arrays["loads"]),
        bodies={ALONE: BodyResult(Shapes(arrays["singular_values"], arrays["x"], arrays["shapes"]))},
        frequencies=Frequencies(nowhere[:, 0], nowhere, {}),
    )


def tip_and_energy(result: RunResult) -> Figure:
    """Tip displacement above, energy below; grey while the slider moves."""
    time = Timeline(result)
    figure, axes = sheet(WIDE, 3.6, rows=2, sharex=True, gridspec_kw={"hspace": 0.12})
    signals = [time.signals(lambda response: response.tip), time.signals(lambda response: response.energy.total)]
    for row, ((label, base), curves) in enumerate(zip(PANELS.items(), signals, strict=True)):
        time.draw(axes[row], curves, label, base, last=row == len(PANELS) - 1)
    key(figure, time.legend(list(signals[0])))
    return figure


def _figures(result: RunResult, prefix: str) -> tuple[tuple[Drawing, ...], ...]:
    caption = "Transverse displacement of the tip (top) and total energy (bottom) over time. Grey: the slider moves."
    return (
        (
            drawing(f"{prefix}-position", inputs.position, "Slider position over time.", result),
            drawing(f"{prefix}-loads", inputs.loads, "Load over time.", result),
        ),
        (drawing(f"{prefix}-history", tip_and_energy, caption, result),),
    )


def _dropped(study: FinishedStudy, results: Mapping[str, RunResult]) -> Grid:
    rows = []
    for name in results:
        tip, beam, largest = (study.figure(f"{name}.dropped.{key}") for key in ("tip", "beam", "max_error"))
        rows.append((case_name(name), percent(tip), percent(beam), length(largest)))
    caption = "The same basis with the pin's rows dropped, against the full beam: all coordinates move."
    return Grid(caption, ("case", "tip", "beam", "largest difference"), tuple(rows))


def _published(study: FinishedStudy, run: RunRecord) -> Published | None:
    """What is published of one scene, gathered again from the study's statements."""
    own = {s.figure.removeprefix(f"{run.key}."): s.value for s in study.published if s.figure.startswith(f"{run.key}.")}
    if not own:
        return None
    nested = _nested(own)
    return Published(source=str(study.summary["source"]) or "publication", **nested)


def _nested(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Dotted keys as nested tables."""
    nested: dict[str, Any] = {}
    for name, value in flat.items():
        *path, last = name.split(".")
        table = nested
        for part in path:
            table = table.setdefault(part, {})
        table[last] = value
    return nested


def _parameters(results: Mapping[str, RunResult]) -> list[list[Table]]:
    """Beam and method, which the cases share, and what moves it in each."""
    first = next(iter(results.values()))
    moving = [
        replace(table, title=f"{table.title}, {case_name(name)}")
        for name, result in results.items()
        for table in [parameters.motion(result)]
    ]
    return [parameters.bodies(first), moving, [parameters.method(first)]]
