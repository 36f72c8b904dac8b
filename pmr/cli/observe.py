"""The commands `pmr observe` and `pmr identify`: estimates and parameters of a scene from measurements."""

from __future__ import annotations

import json
import math
import os
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table
from typer import Argument, Option

from pmr.cli.console import Folder, Model, MotionScene, Overrides, out, prepare_folder, scene_file, summary_beside
from pmr.errors import InputError, escape_controls
from pmr.files.whole import finish_swap, write_text

if TYPE_CHECKING:
    from pmr.files.arrays import Array


def observe(
    model: Model,
    scene: MotionScene,
    measured: Annotated[Path, Option(metavar="FILE", help="Measurements over time, as CSV.")],
    observer: Annotated[Path, Option(metavar="FILE", help="Sensors and unknowns, as TOML.")],
    out_dir: Folder = None,
    overrides: Overrides = None,
    leave_out: Annotated[bool, Option("--leave-out", help="Estimate without each sensor, too.")] = False,
    truth: Annotated[
        Path | None, Option(metavar="FILE", help="True values over time, as CSV, to judge bands by.")
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
    from pmr.scene.tomlfiles import result_name
    from pmr.system.system import System

    environment.check_report()  # before the work, not after it
    finish_swap(model.parent)
    description, system = ObserverFile.read(observer), System.load(model)
    loaded = load_any(scene_file(scene), overrides or ())
    estimator = description.observer(loaded, system, summary_beside(model))
    data = read_measurements(measured, estimator.units)
    true = {} if truth is None else read_measurements(truth, estimator.units)
    folder = out_dir or Path("reports", result_name(scene))
    prepare_folder(folder)
    observation = Observation.compute(estimator, data, leave_out, true, loaded.title)
    files, figures = observation.write(folder), observation.summary()
    table = Table("estimate at the end", "value", "standard deviation", title_justify="left")
    for name, last in figures["last"].items():
        table.add_row(escape_controls(name), f"{last['mean']:.5g} {figures['units'][name]}", f"{last['deviation']:.3g}")
    out.print(table)
    for name, ratio in figures["observability"].items():
        if ratio > 0.5:
            share = f"{100.0 * ratio:.0f} % of its width at the start"
            out.sentences(f"warning: these sensors hardly tell {name}: its band has {share} in the end")
    for sentence in figures["faults"]:
        out.sentences(f"warning: {sentence}")
    for name, share in figures["coverage"].items():
        out.sentences(f"{100.0 * share:.0f} % of the true values of {name} lie within the band of 90 %")
    for path in (*files, write_report(folder).html):
        out.text(str(path))


def identify(
    scene: Annotated[Path, Argument(metavar="SCENE", help="Scene file, folder or name of a workflow.")],
    measured: Annotated[Path, Option(metavar="FILE", help="Frequencies at places, as CSV.")],
    fit: Annotated[list[str], Option(metavar="KEY=START", help="Key to fit and its start; repeatable.")],
    out_dir: Folder = None,
    overrides: Overrides = None,
) -> None:
    """Fit keys of a scene to measured frequencies.

    Each row of the measurements is a place.  Its columns are the coordinates in m of the paths, by their names, or s if
    there is only one path; then the frequencies f1, f2 ... in Hz, and the damping ratios d1, d2 ... if you have them.
    A place with 1 in the column held_out is not fitted but judges the fit.  DIR then has fitted.toml, the scene with
    fitted values, and identify.json.

    For example:

        pmr identify dropbear --measured frequencies.csv --fit body.profile.length=0.5
    """
    import pmr
    from pmr.observe.identify import SHARES, FrequencyTable
    from pmr.scene import load_any
    from pmr.scene.tomlfiles import result_name

    table, file, changes = FrequencyTable.read(measured), scene_file(scene), list(overrides or ())
    start = _starts(fit)

    folder = out_dir or Path("reports", f"identify_{result_name(scene)}")
    prepare_folder(folder)
    result = table.identify(lambda fitted: pmr.reduce(load_any(file, [*changes, *fitted])).system, start)
    fitted, figures = folder / "fitted.toml", folder / "identify.json"
    base = f"extends = {json.dumps(os.path.relpath(file, folder))}"
    lines = {change.partition("=")[0].strip(): _toml_line(change) for change in [*changes, *result.overrides()]}
    write_text(fitted, "\n".join([base, *lines.values(), ""]))
    load_any(fitted)  # refuses what TOML can't hold, such as a key of a list that another change sets as a whole
    parameters = {
        name: {
            "start": start[name], "value": float(value), "error": float(error) if math.isfinite(error) else None,
            "at_bound": name in result.bounded,
        }
        for name, value, error in zip(result.names, result.values, result.errors, strict=True)
    }  # fmt: skip
    rms = {"start": result.start, "fitted": result.fitted, "held_out": result.held_out}
    by_mode = {name: _rms_by_mode(values) for name, values in rms.items()}
    columns = [f"f{k + 1}" for k in range(len(table.measured[0].frequencies))]
    columns += [f"d{k + 1}" for k in range(len(table.measured[0].damping))]
    places, errors = list[dict[str, object]](), {True: result.held_out.tolist(), False: result.fitted.tolist()}
    for place, each in zip(table.places.tolist(), table.measured, strict=True):
        beside = {
            name: {"measured": value, "model": value * (1.0 + error)}
            for name, value, error in zip(
                columns, (*each.frequencies, *each.damping), errors[each.held_out].pop(0), strict=True
            )
            if math.isfinite(value)
        }
        places.append({**dict(zip(table.paths, place, strict=True)), "held_out": each.held_out, **beside})
    content = {"parameters": parameters, "correlation": result.correlation.tolist(), "rms": by_mode, "places": places}
    write_text(figures, json.dumps(content, indent=2))
    printed = Table("key", "start", "fitted", "standard error", title_justify="left")
    for name, fit_of_key in parameters.items():
        text = "not determined" if fit_of_key["error"] is None else f"{fit_of_key['error']:.2g}"
        printed.add_row(escape_controls(name), f"{start[name]:.6g}", f"{fit_of_key['value']:.6g}", text)
    out.print(printed)
    for name, shares in by_mode.items():
        by_column = zip(columns, shares, strict=bool(shares))
        listed = ", ".join(f"{column} {100.0 * share:.2g} %" for column, share in by_column if share is not None)
        if listed:
            out.text(f"RMS error, {name.replace('_', ' ')}: {listed}")
    for name, value, error in zip(result.names, result.values, result.errors, strict=True):
        if error > 0.5 * abs(value):
            out.sentences(f"warning: these measurements hardly determine {name}")
    for name in result.bounded:
        bounds = f"a bound of the search, which goes from {SHARES[0]:g} to {SHARES[1]:g} times its start"
        ended = f"the fit of {name} ended at {parameters[name]['value']:.6g}, {bounds}"
        out.sentences(f"warning: {ended}: it is no best value")
    for path in (fitted, figures):
        out.text(str(path))


def _starts(fit: Sequence[str]) -> dict[str, float]:
    """Return the values at the start by key, from the texts `fit`, each ``KEY=START``; the last one of a key counts.

    Raises InputError for a text of another form.
    """
    starts = dict[str, float]()
    for text in fit:
        key, _, value = text.partition("=")
        try:
            starts[key.strip()] = float(value)
        except ValueError:
            raise InputError("command line", "--fit", text, "KEY=START with a number is allowed") from None
    return starts


def _toml_line(change: str) -> str:
    """Return the line of a TOML file for a change ``key=value`` of ``--set``, in which a bare word stands for a string.

    Names in the key are quoted where TOML needs it.
    """
    from pmr.scene.tomlfiles import toml_key

    key, _, value = change.partition("=")
    name = ".".join(map(toml_key, key.strip().split(".")))
    try:
        tomllib.loads(f"value = {value}")
    except tomllib.TOMLDecodeError:
        value = json.dumps(value.strip())
    return f"{name} = {value.strip()}"


def _rms_by_mode(errors: Array) -> list[float | None]:
    """Return the RMS of the relative errors (k, m) of m frequencies at k places, without those that are NaN.

    None stands for a frequency that was not measured at any place.
    """
    columns = [[error for error in column if math.isfinite(error)] for column in errors.T.tolist()]
    return [math.hypot(*column) / math.sqrt(len(column)) if column else None for column in columns]
