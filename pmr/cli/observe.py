"""The command `pmr observe`: estimates from measurements, by a saved system."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from pmr.cli.console import Folder, MotionScene, Overrides, out, print_sentences, print_text, scene_file
from pmr.cli.export import Model
from pmr.errors.text import escape_controls
from pmr.files.whole import finish_swap


def observe(
    model: Model,
    scene: MotionScene,
    measured: Annotated[Path, typer.Option("--measured", metavar="FILE", help="Measurements over time, as CSV.")],
    observer: Annotated[Path, typer.Option("--observer", metavar="FILE", help="Sensors and unknowns, as TOML.")],
    out_dir: Folder = None,
    overrides: Overrides = None,
    leave_out: Annotated[bool, typer.Option("--leave-out", help="Estimate without each sensor, too.")] = False,
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="FILE", help="True values over time, as CSV, to judge bands by.")
    ] = None,
) -> None:
    """Estimate payload, loads and outputs from measurements.

    The first column of the measurements is `t` in s, the others have the names of the sensors' outputs.  DIR then has
    estimates.csv, observe.json, report.html and report.pdf.

    For example:

        pmr observe reports/boom_three/system.npz --scene boom_three --measured day.csv --observer sensors.toml
    """
    from pmr.errors import environment
    from pmr.observe.measured import Observation, ObserverFile, read_measurements
    from pmr.report.observation import write_report
    from pmr.scene import load_any
    from pmr.system.system import System

    environment.check_report()  # before the work, not after it
    finish_swap(model.parent)
    description, data, system = ObserverFile.read(observer), read_measurements(measured), System.load(model)
    file, budget = scene_file(scene), model.parent / "summary.json"
    summary: Any = json.loads(budget.read_text(encoding="utf-8")) if budget.is_file() else {}
    loaded, true = load_any(file, overrides or ()), {} if truth is None else read_measurements(truth)
    estimator = description.observer(loaded, system, summary)
    observation = Observation.compute(estimator, data, leave_out, true, loaded.title)
    folder = out_dir or Path("reports", scene.stem)
    files, figures = observation.write(folder), observation.summary()
    table = Table("estimate at the end", "value", "standard deviation", title_justify="left")
    for name, last in figures["last"].items():
        table.add_row(escape_controls(name), f"{last['mean']:.5g} {figures['units'][name]}", f"{last['deviation']:.3g}")
    out.print(table)
    for name, ratio in figures["observability"].items():
        if ratio > 0.5:
            share = f"{100.0 * ratio:.0f} % of its width at the start"
            print_sentences(out, f"warning: these sensors hardly tell {name}: its band has {share} in the end")
    for name, t in figures["first_alarm"].items():
        print_sentences(out, f"warning: {name} disagrees with the model, is stuck or silent from {t:.3g} s on")
    for name, share in figures["coverage"].items():
        print_sentences(out, f"{100.0 * share:.0f} % of the true values of {name} lie within the band of 90 %")
    for path in (*files, write_report(folder).html):
        print_text(out, str(path))
