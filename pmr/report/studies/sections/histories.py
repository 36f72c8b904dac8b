"""Tip displacement and energy over time, and the table of displacement errors."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pmr.files import records
from pmr.report import errors, marks, parameters, subject
from pmr.report.blocks import Block, Chapter, Drawing, Grid, KeyNumber, Table, drawing
from pmr.report.figures import inputs
from pmr.report.figures.canvas import WIDE, key, sheet
from pmr.report.figures.timeline import Timeline
from pmr.report.numbers import length, percent
from pmr.report.studies.finished import FinishedStudy
from pmr.report.studies.names import case_name
from pmr.results import BodyResult, Frequencies, Loads, Paths, Response, RunResult, Shapes
from pmr.scene import Published, Scene
from pmr.scene.former import stored
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
    beams = [name for name in results if f"{name}.dropped.beam" in study.figures]
    dropped = max((study.figure(f"{name}.dropped.beam") for name in beams), default=0.0)
    without = f"; without the pin's rows within {percent(dropped)}" if beams else ""
    return Chapter(
        anchor=prefix,
        title=study.title,
        headline=f"The reduced model is within {percent(worst)} of the full one{without}.",
        key_numbers=[
            KeyNumber(
                percent(study.figure(f"{name}.errors.reduced_vs_full.beam")),
                f"error along the beam, {case_name(name)}",
            )
            for name, result in results.items()
        ],
        paragraphs=[
            "All models are simulated over the whole time span: the reduced and the full one by the compiled "
            "simulator, of a beam the ANCF cable with its sliding joint by Exudyn.",
        ],
        blocks=[
            *(
                Block(case_name(name).capitalize(), _figures(result, f"{prefix}-{name}"))
                for name, result in results.items()
            ),
            *[Block("Without the pin's rows", grids=(_dropped(study, beams),))] * bool(beams),
            Block("Beside the publication", errors=published),
            Block("Parameters", columns=_parameters(results)),
        ],
    )


def run_result(study: FinishedStudy, run: RunRecord) -> RunResult:
    """A run as the figures of single runs read it; displacements at the tip only."""
    arrays = study.results.arrays(run.key)
    scene = stored(json.loads(str(arrays["scene"])), run.key).model_copy(update={"published": _published(study, run)})
    remarks = [
        statement.why for statement in study.published if statement.figure.startswith(f"{run.key}.") and statement.why
    ]
    summary = _nested(run.figures) | {"notes": list(dict.fromkeys(remarks)), "seconds": {}}
    known = [name for name in SIMULATORS if f"{name}.t" in arrays]
    responses = {name: records.record(Response, arrays, f"{name}.") for name in known}
    nowhere, of_sections = np.zeros((0, 1)), "paths" in arrays
    names = tuple(map(str, arrays["paths"])) if of_sections else (SLIDER,)
    path, rate = (arrays[one].reshape(len(arrays[one]), -1) for one in ("path", "path_rate"))
    return RunResult(
        scene=scene,
        summary=summary,
        responses=responses,
        paths=Paths(names, path, rate),
        loads=Loads(tuple(map(str, arrays.get("inputs", ()))), (), arrays["loads"]),
        bodies=_bodies(scene, arrays),
        reach=scene.reach(responses["reduced"].t) if of_sections else None,
        frequencies=Frequencies(nowhere[:, 0], nowhere, {}),
    )


def _bodies(scene: Scene, arrays: Mapping[str, Any]) -> dict[str, BodyResult]:
    if "shapes" not in arrays:
        return {name: BodyResult() for name in scene.names}
    return {ALONE: BodyResult(Shapes(arrays["singular_values"], arrays["x"], arrays["shapes"]))}


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
    of_sections = result.reach is not None
    moving, what = ("sections move", "Extensions") if of_sections else ("the slider moves", "Slider position")
    caption = f"Transverse displacement of the tip (top) and total energy (bottom) over time. Grey: {moving}."
    acting = [drawing(f"{prefix}-loads", inputs.loads, "Load over time.", result)] * bool(subject.loads(result))
    return (
        (drawing(f"{prefix}-position", inputs.position, f"{what} over time.", result), *acting),
        (drawing(f"{prefix}-history", tip_and_energy, caption, result),),
    )


def _dropped(study: FinishedStudy, results: Sequence[str]) -> Grid:
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
