"""Chapter about the runs of a study: errors and other values over the varied parameters, and tables of all values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pmr.report.blocks import Block, Chapter, Drawing, Grid, KeyNumber
from pmr.report.figures import WIDE, add_legend, curve_style, drawing, log_axis, log_x, make_axes, make_panels
from pmr.report.numbers import SPACE, prose, unit_for
from pmr.report.studies import tables
from pmr.report.studies.tables import (
    TIME,
    FinishedStudy,
    heading,
    is_varied,
    key_words,
    list_words,
    number_of,
    quantity_of,
    run_name,
    runs_with,
    unit_of,
    value_of,
    value_words,
)
from pmr.studies.study import RunRecord
from pmr.studies.tasks import cell_number

MOST_ROWS, MOST_COLUMNS, MOST_GRIDS, MOST_VALUES, MOST_PANELS = 60, 7, 3, 8, 4
COORDINATES = "reduction.coordinates"
#: Names of errors, the most telling first; the first one that the runs have is drawn, and the headline states it.
ERRORS = ("errors.reduced_vs_full.beam", "errors.reduced_vs_ancf.beam", "errors.full_vs_ancf.beam")
BESIDE = ("errors.reduced_vs_full.tip", "max_displacement", "max_error", "largest_force", "frequencies.s_min.1")
#: A value is drawn if it differs between runs by more than this share of its largest value.
VISIBLE = 0.01
#: Sections of a scene file, and other parameters, that change the time that a simulation takes.
COSTLY = ("reduction", "mesh", "time", "simulation", "body", "scene", "case")


def build_chapter(study: FinishedStudy, prefix: str) -> Chapter:
    """Build the chapter about the runs of a study; `prefix` is put before every identifier."""
    runs = study.results.runs
    done = study.results.done
    error = next((name for name in ERRORS if runs_with(done, name)), None)
    glance = tables.largest_value_block(tables.few_runs(runs))
    return Chapter(
        anchor=prefix,
        title=study.title,
        opening=_opening_sentence(runs),
        headline=_headline(len(runs), done, error),
        key_numbers=list(_key_numbers(done, error)),
        blocks=[
            *([glance] if glance is not None else ()),  # largest values come before errors
            *_figures(done, error, prefix),
            Block("Runs", grids=tuple(_grids(runs))),
            *tables.value_blocks(runs),
        ],
    )


def _opening_sentence(runs: Sequence[RunRecord]) -> str:
    """Sentence on the number of runs and on each varied parameter, such as "6 runs over time step (0.01, 0.02 s)".

    Behind a parameter stand its values, if there are at most `MOST_VALUES`.  Of a parameter with more values only their
    number is stated.  If each run has another value, the number is left out, as it is the number of runs.  The text is
    empty if no parameter varies.
    """
    parts = []
    for key in dict.fromkeys(key for run in runs for key in run.parameters):
        values = list(dict.fromkeys(value_words(run.parameters.get(key)) for run in runs))
        if 1 < len(values) <= MOST_VALUES:
            unit = unit_of(key)
            parts.append(f"{key_words(key)} ({', '.join(values)}{f'{SPACE}{unit}' if unit else ''})")
        elif len(values) > 1:
            parts.append(f"{key_words(key)}{f' ({len(values)} values)' * (len(values) < len(runs))}")
    count = f"{len(runs)} runs" if len(runs) != 1 else "One run"
    return f"{count} over {list_words(parts)}." if parts else ""


def _headline(count: int, done: Sequence[RunRecord], error: str | None) -> str:
    """Sentence on the range of the error of the runs, with the runs at both ends, and on runs without a result.

    `count` is the number of all runs, `done` are the runs with a result, and `error` is the name of the error.  The
    range is left out if `error` is None or fewer than two runs have this error.  The number of runs with a result is
    stated if some runs have none, or if `error` is None.
    """
    texts = {"label": "", "least": "", "best": "", "largest": "", "worst": ""}
    if error is not None and len(ordered := sorted(runs_with(done, error), key=lambda run: value_of(run, error))) > 1:
        what, best, worst = quantity_of(error), ordered[0], ordered[-1]
        least, largest = what.cell(best.figures[error]), what.cell(worst.figures[error])
        names = {"best": run_name(best), "worst": run_name(worst)}
        texts = {"label": what.label, "least": least, "largest": largest, **names}
    finished = len(done) if len(done) < count or error is None else None
    return prose("runs_headline", done=finished, count=count, **texts)


def _key_numbers(done: Sequence[RunRecord], error: str | None) -> Iterator[KeyNumber]:
    """Yield the largest error, difference, displacement and force of all runs `done`, and the fastest simulation.

    `error` is the name of the error, None for a study without one.  Values that no run has are left out.  The fastest
    simulation is left out if times differ by chance only (`_cost_differs`).
    """
    for name in (error, "max_error", "max_displacement", "largest_force"):
        if name is None or not (runs_with_figure := runs_with(done, name)):
            continue
        what, ordered = quantity_of(name), sorted(runs_with_figure, key=lambda run: value_of(run, name))  # noqa: B023
        best, worst = ordered[0], ordered[-1]
        if not is_varied(runs_with_figure, name):
            yield KeyNumber(what.cell(worst.figures[name]), what.label, "in all runs")
        elif name in (error, "max_error"):
            note = f"smallest {what.cell(best.figures[name])}, {run_name(best)}"
            yield KeyNumber(what.cell(worst.figures[name]), f"{what.label}, at most", note)
        else:
            yield KeyNumber(what.cell(worst.figures[name]), what.label, run_name(worst))
    timed = [run for run in done if run.seconds.get(TIME)]
    if timed and _cost_differs(timed):
        fastest = min(timed, key=lambda run: run.seconds[TIME])
        yield KeyNumber(quantity_of(TIME).cell(fastest.seconds[TIME]), "fastest simulation", run_name(fastest))


def _cost_differs(runs: Sequence[RunRecord]) -> bool:
    """Whether `runs` have a parameter that decides the time of a simulation; else times differ by chance only."""
    return any(key.partition(".")[0].partition("[")[0] in COSTLY for run in runs for key in run.parameters)


def _figures(done: Sequence[RunRecord], error: str | None, prefix: str) -> Iterator[Block]:
    """Yield a block with figures of the runs `done`: values over the varied parameter, and an error over time taken.

    `error` is the name of the error, None if there is none.  Values that hardly differ between the runs are not drawn.
    Nothing is yielded if there is nothing to draw, or if no parameter has several numbers (`varied_parameter`).
    `prefix` begins the identifiers of the figures.
    """
    over = varied_parameter(done)
    if over is None:
        return
    drawn = list[Drawing]()
    ranges = [name for name in dict.fromkeys(n for run in done for n in run.figures) if name.endswith(".range")]
    shown = [
        name for name in (error, *BESIDE, *ranges[:1]) if name and is_varied(done, name) and _is_visible(done, name)
    ]
    if shown:
        other_parameters = {key_words(key) for key in done[0].parameters if key != over}
        apart = f", a curve for each {' and '.join(sorted(other_parameters))}" if other_parameters else ""
        caption = f"Results of the runs over the {key_words(over)}{apart}."
        for k in range(0, len(shown), MOST_PANELS):  # more panels would not fit on one page
            name, panels = f"{prefix}-varied{k // MOST_PANELS or ''}", shown[k : k + MOST_PANELS]
            drawn.append(drawing(name, value_figure, caption, done, over, panels))
    timed = [run for run in done if run.seconds.get(TIME)]
    if error and len(runs_with(timed, error)) > 1 and _cost_differs(timed):
        label = quantity_of(error).label.capitalize()
        caption = f"{label} over the time that one simulation of the reduced model takes."
        drawn.append(drawing(f"{prefix}-seconds", error_over_time_figure, caption, timed, over, error))
    if drawn:
        yield Block(f"Results over the {key_words(over)}", drawn)


def _is_visible(runs: Sequence[RunRecord], name: str) -> bool:
    """Whether the value `name` differs enough between runs for a curve to show the difference.

    Errors always do, as their axis is logarithmic.
    """
    values = [value_of(run, name) for run in runs_with(runs, name)]
    return name.startswith(("errors", "max_error")) or max(values) - min(values) > VISIBLE * max(map(abs, values))


def varied_parameter(done: Sequence[RunRecord]) -> str | None:
    """Parameter over which values of the runs `done` are drawn: the number of coordinates if it varies.

    Otherwise it is the parameter with the most values.  The result is None if no parameter has several numbers as
    values.
    """
    counts = {
        key: len({number_of(run.parameters[key]) for run in done})
        for key in (done[0].parameters if done else ())
        if all(number_of(run.parameters.get(key)) is not None for run in done)
    }
    if counts.get(COORDINATES, 0) > 1:
        return COORDINATES
    most = max(counts, key=lambda key: counts[key], default=None)
    return most if most is not None and counts[most] > 1 else None


def terminal_grid(runs: Sequence[RunRecord], columns: int, rows: int) -> Grid:
    """Build a table of runs with at most `columns` columns and `rows` lines, for a terminal; the rest is left out.

    The table shows parameters, the error and the largest values of each run.  If these are fewer than two values, it
    shows all values of the runs, too.  If all runs fit side by side, each run has a column.  If not, each run has a
    row.  Then values that differ between runs come first, as not all values may fit.
    """
    heads, error = _varied_keys(runs), next((name for name in ERRORS if runs_with(runs, name)), None)
    cells_by_name = {quantity_of(error).label: [_format_cell(run, error) for run in runs]} if error else {}
    cells_by_name |= tables.largest_values(runs)
    if len(cells_by_name) < 2:
        cells_by_name |= {quantity_of(name).label: [_format_cell(run, name) for run in runs] for name in _columns(runs)}
    more = f"{len(runs) - rows} more runs and all" if len(runs) > rows else "All"
    caption = f"{more} figures, with their times and places, are in runs.csv."
    if len(runs) <= columns - 2:  # the first column is as wide as two others
        lines = [(name, *cells) for name, cells in cells_by_name.items()][:rows]
        return Grid(caption, ("", *map(run_name, runs)), tuple(lines))
    differ = [name for name, cells in cells_by_name.items() if len(set(cells)) > 1]
    first = [*differ, *(name for name in cells_by_name if name not in differ)][: max(columns - len(heads), 1)]
    lines = [
        (*_parameter_cells(run, heads), *(cells_by_name[name][k] for name in first))
        for k, run in enumerate(runs[:rows])
    ]
    return Grid(caption, (*_headings(heads), *first), tuple(lines))


def _varied_keys(runs: Sequence[RunRecord]) -> list[str]:
    """Keys of the parameters that vary between runs; if none varies, the key of the first parameter."""
    parameters = list(dict.fromkeys(key for run in runs for key in run.parameters))
    return [key for key in parameters if len({run.parameters.get(key) for run in runs}) > 1] or parameters[:1]


def _headings(keys: Sequence[str]) -> tuple[str, ...]:
    """Column headings of the parameters `keys`; ``run`` if there are none."""
    return tuple(map(heading, keys)) or ("run",)


def _parameter_cells(run: RunRecord, keys: Sequence[str]) -> list[str]:
    """Cells with the values of the parameters `keys` in a run; if there are none, a cell with the key of the run."""
    return [value_words(run.parameters.get(key)) for key in keys] or [run.key]


def _grids(runs: Sequence[RunRecord]) -> Iterator[Grid]:
    """Yield tables of the values of all runs, at most `MOST_GRIDS` with `MOST_ROWS` runs and as many columns as fit.

    Values that are equal in all runs are only stated in the caption of the first table, and values that repeat a
    parameter are left out.  The last caption says if something is cut off.
    """
    parameters = list(dict.fromkeys(key for run in runs for key in run.parameters))
    heads = _varied_keys(runs)
    cells_by_name = {name: [_format_cell(run, name) for run in runs] for name in _columns(runs)}
    same = {name: cells[0] for name, cells in cells_by_name.items() if len(runs) > 1 and len(set(cells)) == 1}
    shown = [name for name in cells_by_name if name not in same and not _repeats_parameter(runs, name, parameters)]
    alike = "; ".join(f"{quantity_of(name).label}: {cell}" for name, cell in same.items() if cell != "–")
    wide = max(MOST_COLUMNS - max(len(heads), 1), 2)
    parts = [shown[k : k + wide] for k in range(0, len(shown), wide)][:MOST_GRIDS] or [[]]
    is_cut = len(shown) > wide * MOST_GRIDS or len(runs) > MOST_ROWS
    for place, part in enumerate(parts):
        rows = tuple(
            (*_parameter_cells(run, heads), *(cells_by_name[name][k] for name in part))
            for k, run in enumerate(runs[:MOST_ROWS])
        )
        sentences = [f"In all runs: {alike}."] if alike and place == 0 else []
        sentences += ["Everything else stands in runs.csv."] if is_cut and place == len(parts) - 1 else []
        names = tuple(quantity_of(name).label for name in part)
        yield Grid(" ".join(["Varied values and results of each run.", *sentences]), (*_headings(heads), *names), rows)


def _columns(runs: Sequence[RunRecord]) -> list[str]:
    """Names of the runs' values and of the times of their simulations.

    Values that have their own tables are left out, and so are times if they differ by chance only.
    """
    figures = (name for run in runs for name in run.figures if not name.startswith(tables.ROOMS))
    seconds = (name for run in runs for name in run.seconds if name.startswith("simulate.") and _cost_differs(runs))
    return list(dict.fromkeys([*figures, *seconds]))


def _repeats_parameter(runs: Sequence[RunRecord], name: str, parameters: Sequence[str]) -> bool:
    """Whether the value `name` equals one of `parameters` in all runs, as a number of coordinates may."""
    values = [run.figures.get(name) for run in runs]
    return any(values == [run.parameters.get(key) for run in runs] for key in parameters)


def _format_cell(run: RunRecord, name: str) -> str:
    """Format the value called `name` of a run, or the time called `name`."""
    return quantity_of(name).cell(run.seconds[name] if name in run.seconds else run.figures.get(name))


MOST_CURVES = 15  # largest number of curves in a legend
LOGARITHMIC = 5.0  # ratio of the largest to the least error above which the axis is logarithmic


def value_figure(done: Sequence[RunRecord], parameter: str, names: Sequence[str]) -> Figure:
    """Draw values of the runs `done` over a parameter, a panel for each of `names`.

    Runs that differ in this parameter only are joined by a curve.
    """
    figure, axes = make_panels(len(names), 1.75, 0.28, 0.42)
    unit = unit_of(parameter)
    for name, ax in zip(names, axes, strict=True):
        for look, group in _curves(done, parameter):
            x, y = _curve_points(group, name, {run.key: cell_number(run.parameters[parameter]) for run in group})
            ax.plot(x, y, **look)
        _value_axis(ax, name)
        ax.set_xlabel(f"{key_words(parameter).capitalize()} {f'in {unit}' if unit else '(–)'}")
        ax.margins(x=0.04)
    return add_legend(figure)


def error_over_time_figure(done: Sequence[RunRecord], parameter: str, error: str) -> Figure:
    """Draw the error called `error` of the runs `done` as points over the time in ms that one simulation took.

    Points of runs that differ only in `parameter` have one colour and marker.
    """
    figure, ax = make_axes(WIDE, 2.5, "Time of one simulation in ms", "")
    times = {run.key: 1e3 * run.seconds[TIME] for run in done}
    for look, group in _curves(done, parameter):
        x, y = _curve_points(group, error, times)
        ax.plot(x, y, **look | {"linestyle": "none"})
    log_x(ax, 0.8 * min(times.values()), 1.25 * max(times.values()))
    _value_axis(ax, error)
    return add_legend(figure)


def _curves(done: Sequence[RunRecord], parameter: str) -> list[tuple[dict[str, Any], list[RunRecord]]]:
    """Group the runs `done` that differ in `parameter` only; return a pair for each group.

    A pair has the keywords for ``Axes.plot`` of the group's curve, then the runs of the group.  The first `MOST_CURVES`
    curves have labels.
    """
    groups: dict[str, list[RunRecord]] = {}
    for run in done:
        groups.setdefault(run_name(run, parameter) if len(run.parameters) > 1 else "", []).append(run)
    styles = [curve_style(k, 3.0) | {"label": name if k < MOST_CURVES else ""} for k, name in enumerate(groups)]
    return list(zip(styles, groups.values(), strict=True))


def _curve_points(group: Sequence[RunRecord], name: str, places: Mapping[str, float]) -> NDArray[np.float64]:
    """Coordinates x and y of the n points of a curve (2, n), in increasing order of x, from a `group` of runs.

    `places` maps the key of each run to its x; y is the value called `name`.  Runs without this value have no point.
    """
    points = sorted((places[run.key], value_of(run, name)) for run in runs_with(group, name))
    return np.array(points).reshape(-1, 2).T


def _value_axis(ax: Axes, name: str) -> None:
    """Set up the y-axis for values called `name`: logarithmic for errors that differ much, else linear from 0.

    Errors differ much if one is more than `LOGARITHMIC` times another.  The curves, which have to be drawn already, are
    scaled to the unit of the axis.
    """
    what, values = quantity_of(name), np.concatenate([curve.get_ydata() for curve in ax.lines])
    largest, positive = float(np.abs(values).max()), values[values > 0.0]
    unit = unit_for(largest, what.unit)
    for curve in ax.lines:
        curve.set_ydata(np.asarray(curve.get_ydata()) / unit.size)
    spread = float(positive.max() / positive.min()) if len(positive) else 1.0
    if (name.startswith("errors") or name == "max_error") and spread > LOGARITHMIC:
        log_axis(ax, float(positive.min()) / unit.size, float(positive.max()) / unit.size)
    else:
        ax.set_ylim(0.0, 1.15 * largest / unit.size or 1.0)
    ax.set_ylabel(unit.axis_label(what.label.capitalize()))
