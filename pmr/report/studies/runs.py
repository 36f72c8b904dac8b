"""What the runs of a study say, whatever was varied: errors and sizes over it, and every figure in tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pmr.report.blocks import Block, Chapter, Drawing, Grid, KeyNumber
from pmr.report.figures.canvas import WIDE, dots, drawing, log_axis, log_x, sheet
from pmr.report.numbers import SPACE, Unit, unit_for
from pmr.report.studies import tables
from pmr.report.studies.finished import FinishedStudy
from pmr.report.studies.tables import (
    TIME,
    differs,
    heading,
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
from pmr.studies.results import RunRecord
from pmr.studies.tasks import number

MOST_ROWS, MOST_COLUMNS, MOST_GRIDS, MOST_VALUES, MOST_PANELS = 60, 7, 3, 8, 4
COORDINATES = "reduction.coordinates"
#: What is drawn, if the runs have it: the first one that they have is what accuracy is judged by.
ERRORS = ("errors.reduced_vs_full.beam", "errors.reduced_vs_ancf.beam", "errors.full_vs_ancf.beam")
BESIDE = ("errors.reduced_vs_full.tip", "max_displacement", "max_error", "largest_force", "frequencies.s_min.1")
#: Share of a size by which it has to differ for a curve.
VISIBLE = 0.01
#: Sections of a scene whose keys decide how long a simulation takes.
COSTLY = ("reduction", "mesh", "time", "simulation", "body", "scene", "case")


def content(study: FinishedStudy, prefix: str) -> Chapter:
    """Headline, figures where something was varied by number, and tables of all runs."""
    runs = study.results.runs
    done = [run for run in runs if run.status == "done"]
    error = next((name for name in ERRORS if runs_with(done, name)), None)
    glance = tables.at_a_glance(tables.few(runs))
    return Chapter(
        anchor=prefix,
        title=study.title,
        opening=_opening_sentence(runs),
        headline=_headline(len(runs), done, error),
        key_numbers=list(_key_numbers(done, error)),
        blocks=[
            *([glance] if glance is not None else ()),  # what the machine bears, before how well that is known
            *_figures(done, error, prefix),
            Block("Runs", grids=tuple(_grids(runs))),
            *tables.blocks(runs),
        ],
    )


def _opening_sentence(runs: Sequence[RunRecord]) -> str:
    """How many runs, and over what, with the values of what takes few."""
    parts = []
    for key in dict.fromkeys(key for run in runs for key in run.parameters):
        values = list(dict.fromkeys(value_words(run.parameters.get(key)) for run in runs))
        if 1 < len(values) <= MOST_VALUES:
            unit = unit_of(key)
            parts.append(f"{key_words(key)} ({', '.join(values)}{f'{SPACE}{unit}' if unit else ''})")
        elif len(values) > 1:
            parts.append(f"{key_words(key)} ({len(values)} values)")
    count = f"{len(runs)} runs" if len(runs) != 1 else "One run"
    return f"{count} over {list_words(parts)}." if parts else ""


def _headline(count: int, done: Sequence[RunRecord], error: str | None) -> str:
    finished_text = f"{len(done)} of {count} runs are there." if len(done) < count or error is None else ""
    if error is None:
        return finished_text
    ordered = sorted(runs_with(done, error), key=lambda run: value_of(run, error))
    best, worst, what = ordered[0], ordered[-1], quantity_of(error)
    if len(ordered) < 2:
        return finished_text
    return (
        f"The {what.label} is {what.cell(best.figures[error])} at least ({run_name(best)}) and "
        f"{what.cell(worst.figures[error])} at most ({run_name(worst)}). {finished_text}".rstrip()
    )


def _key_numbers(done: Sequence[RunRecord], error: str | None) -> Iterator[KeyNumber]:
    """Errors at most and at best, what is largest of all."""
    for name in (error, "max_error", "max_displacement", "largest_force"):
        if name is None or not (runs_with_figure := runs_with(done, name)):
            continue
        what, ordered = quantity_of(name), sorted(runs_with_figure, key=lambda run: value_of(run, name))  # noqa: B023
        best, worst = ordered[0], ordered[-1]
        if not differs(runs_with_figure, name):
            yield KeyNumber(what.cell(worst.figures[name]), what.label, "in all runs")
        elif name in (error, "max_error"):
            note = f"at best {what.cell(best.figures[name])}, {run_name(best)}"
            yield KeyNumber(what.cell(worst.figures[name]), f"{what.label}, at most", note)
        else:
            yield KeyNumber(what.cell(worst.figures[name]), what.label, run_name(worst))
    timed = [run for run in done if run.seconds.get(TIME)]
    if timed and _cost_differs(timed):
        fastest = min(timed, key=lambda run: run.seconds[TIME])
        yield KeyNumber(quantity_of(TIME).cell(fastest.seconds[TIME]), "fastest simulation", run_name(fastest))


def _cost_differs(runs: Sequence[RunRecord]) -> bool:
    """Whether anything was varied on which the time of a simulation depends; that of a load is chance."""
    return any(key.partition(".")[0].partition("[")[0] in COSTLY for run in runs for key in run.parameters)


def _figures(done: Sequence[RunRecord], error: str | None, prefix: str) -> Iterator[Block]:
    """Errors and sizes over the parameter that has the most numbers, and over the seconds that simulations take."""
    over = varied_parameter(done)
    if over is None:
        return
    drawn = list[tuple[Drawing, ...]]()
    ranges = [name for name in dict.fromkeys(n for run in done for n in run.figures) if name.endswith(".range")]
    shown = [name for name in (error, *BESIDE, *ranges[:1]) if name and differs(done, name) and _is_visible(done, name)]
    if shown:
        other_parameters = {key_words(key) for key in done[0].parameters if key != over}
        apart = f", a curve for each {' and '.join(sorted(other_parameters))}" if other_parameters else ""
        caption = f"What was found over the {key_words(over)}{apart}."
        for k in range(0, len(shown), MOST_PANELS):  # more of them would leave a page empty
            name, panels = f"{prefix}-varied{k // MOST_PANELS or ''}", shown[k : k + MOST_PANELS]
            drawn.append((drawing(name, over_parameter, caption, done, over, panels),))
    timed = [run for run in done if run.seconds.get(TIME)]
    if error and len(runs_with(timed, error)) > 1 and _cost_differs(timed):
        label = quantity_of(error).label.capitalize()
        caption = f"{label} over the time that one simulation of the reduced model takes."
        drawn.append((drawing(f"{prefix}-seconds", over_seconds, caption, timed, over, error),))
    if drawn:
        yield Block(f"Over the {key_words(over)}", tuple(drawn))


def _is_visible(runs: Sequence[RunRecord], name: str) -> bool:
    """Whether a curve shows that a figure differs: errors are drawn by their powers of ten."""
    values = [value_of(run, name) for run in runs_with(runs, name)]
    return name.startswith(("errors", "max_error")) or max(values) - min(values) > VISIBLE * max(map(abs, values))


def varied_parameter(done: Sequence[RunRecord]) -> str | None:
    """The parameter over which figures are drawn: coordinates, or else the one that takes the most numbers."""
    counts = {
        key: len({number_of(run.parameters[key]) for run in done})
        for key in (done[0].parameters if done else ())
        if all(number_of(run.parameters.get(key)) is not None for run in done)
    }
    if counts.get(COORDINATES, 0) > 1:
        return COORDINATES
    most = max(counts, key=lambda key: counts[key], default=None)
    return most if most is not None and counts[most] > 1 else None


def overview(runs: Sequence[RunRecord], columns: int, rows: int) -> Grid:
    """Parameters, error and forces of each run, for a terminal on which so many columns and rows fit.

    A column for each of a few runs, else a row; then of more figures than fit those stay in which runs differ.  A kind
    of study that has none of these shows its own figures.
    """
    heads, error = _varied_keys(runs), next((name for name in ERRORS if runs_with(runs, name)), None)
    cells_by_name = {quantity_of(error).label: [_cell(run, error) for run in runs]} if error else {}
    cells_by_name |= tables.largest_values(runs)
    if len(cells_by_name) < 2:
        cells_by_name |= {quantity_of(name).label: [_cell(run, name) for run in runs] for name in _columns(runs)}
    more = f"{len(runs) - rows} more runs and all" if len(runs) > rows else "All"
    caption = f"{more} figures, with times and places, stand in runs.csv."
    if len(runs) <= columns - 2:  # the first column is as wide as two
        lines = [(name, *cells) for name, cells in cells_by_name.items()][:rows]
        return Grid(caption, ("", *map(run_name, runs)), tuple(lines))
    differ = [name for name, cells in cells_by_name.items() if len(set(cells)) > 1]
    first = [*differ, *(name for name in cells_by_name if name not in differ)][: max(columns - len(heads), 1)]
    lines = [(*_names(run, heads), *(cells_by_name[name][k] for name in first)) for k, run in enumerate(runs[:rows])]
    return Grid(caption, (*_headings(heads), *first), tuple(lines))


def _varied_keys(runs: Sequence[RunRecord]) -> list[str]:
    parameters = list(dict.fromkeys(key for run in runs for key in run.parameters))
    return [key for key in parameters if len({run.parameters.get(key) for run in runs}) > 1] or parameters[:1]


def _headings(keys: Sequence[str]) -> tuple[str, ...]:
    return tuple(map(heading, keys)) or ("run",)


def _names(run: RunRecord, keys: Sequence[str]) -> list[str]:
    return [value_words(run.parameters.get(key)) for key in keys] or [run.key]


def _grids(runs: Sequence[RunRecord]) -> Iterator[Grid]:
    """Parameters and figures of all runs, as many columns as fit on a page; what all have alike is said once."""
    parameters = list(dict.fromkeys(key for run in runs for key in run.parameters))
    heads = _varied_keys(runs)
    cells_by_name = {name: [_cell(run, name) for run in runs] for name in _columns(runs)}
    same = {name: cells[0] for name, cells in cells_by_name.items() if len(runs) > 1 and len(set(cells)) == 1}
    shown = [name for name in cells_by_name if name not in same and not _doubles(runs, name, parameters)]
    alike = "; ".join(f"{quantity_of(name).label}: {cell}" for name, cell in same.items() if cell != "–")
    wide = max(MOST_COLUMNS - max(len(heads), 1), 2)
    parts = [shown[k : k + wide] for k in range(0, len(shown), wide)][:MOST_GRIDS] or [[]]
    is_cut = len(shown) > wide * MOST_GRIDS or len(runs) > MOST_ROWS
    for place, part in enumerate(parts):
        rows = tuple(
            (*_names(run, heads), *(cells_by_name[name][k] for name in part)) for k, run in enumerate(runs[:MOST_ROWS])
        )
        sentences = [f"In all runs: {alike}."] if alike and place == 0 else []
        sentences += ["Everything else stands in runs.csv."] if is_cut and place == len(parts) - 1 else []
        names = tuple(quantity_of(name).label for name in part)
        yield Grid(" ".join(["Runs with what was varied and found.", *sentences]), (*_headings(heads), *names), rows)


def _columns(runs: Sequence[RunRecord]) -> list[str]:
    """Figures of the runs and seconds of their simulations."""
    figures = (name for run in runs for name in run.figures if not name.startswith(tables.ROOMS))
    seconds = (name for run in runs for name in run.seconds if name.startswith("simulate.") and _cost_differs(runs))
    return list(dict.fromkeys([*figures, *seconds]))


def _doubles(runs: Sequence[RunRecord], name: str, parameters: Sequence[str]) -> bool:
    """Whether a figure is what was asked for: so many coordinates."""
    values = [run.figures.get(name) for run in runs]
    return any(values == [run.parameters.get(key) for run in runs] for key in parameters)


def _cell(run: RunRecord, name: str) -> str:
    return quantity_of(name).cell(run.seconds[name] if name in run.seconds else run.figures.get(name))


MOST_CURVES = 15  # that are named
LOGARITHMIC = 5.0  # times as large as the least: from there on errors are drawn by their powers of ten


def over_parameter(done: Sequence[RunRecord], over: str, names: Sequence[str]) -> Figure:
    """A panel for each of the figures `names`, over a parameter; runs that differ in nothing else make a curve."""
    rows, columns = -(-len(names) // 2), min(len(names), 2)
    gaps = {"wspace": 0.28, "hspace": 0.42}
    figure, axes = sheet(WIDE, 0.7 + 1.75 * rows, rows, columns, _room(done, over), gridspec_kw=gaps)
    unit = unit_of(over)
    for name, ax in zip(names, axes.flat, strict=False):
        for look, group in _curves(done, over):
            x, y = _points(group, name, {run.key: number(run.parameters[over]) for run in group})
            ax.plot(x, y, **look)
        _value_axis(ax, name)
        ax.set_xlabel(f"{key_words(over).capitalize()} {f'in {unit}' if unit else '(–)'}")
        ax.margins(x=0.04)
    for ax in axes.flat[len(names) :]:
        ax.set_visible(False)
    _legend(figure, done, over)
    return figure


def over_seconds(done: Sequence[RunRecord], over: str, error: str) -> Figure:
    """An error over the seconds of a simulation."""
    figure, axes = sheet(WIDE, 2.5, margins=_room(done, over))
    ax, times = axes[0, 0], {run.key: 1e3 * run.seconds[TIME] for run in done}
    for look, group in _curves(done, over):
        x, y = _points(group, error, times)
        ax.plot(x, y, **look | {"linestyle": "none"})
    log_x(ax, 0.8 * min(times.values()), 1.25 * max(times.values()))
    _value_axis(ax, error)
    ax.set_xlabel("Time of one simulation in ms")
    _legend(figure, done, over)
    return figure


def _curves(done: Sequence[RunRecord], over: str) -> list[tuple[dict[str, Any], list[RunRecord]]]:
    """Runs that differ in nothing but the parameter `over`, and how they are drawn."""
    groups: dict[str, list[RunRecord]] = {}
    for run in done:
        groups.setdefault(run_name(run, over) if len(run.parameters) > 1 else "", []).append(run)
    return [(dots(k, 3.0) | {"label": name}, group) for k, (name, group) in enumerate(groups.items())]


def _points(group: Sequence[RunRecord], name: str, places: Mapping[str, float]) -> tuple[list[float], list[float]]:
    """Values of a figure in the unit of its axis, in the order of their places."""
    points = sorted((places[run.key], value_of(run, name) / quantity_of(name).size) for run in runs_with(group, name))
    return [x for x, _ in points], [y for _, y in points]


def _value_axis(ax: Axes, name: str) -> None:
    """Errors on a logarithmic axis, sizes on one that shows how far they differ."""
    what, values = quantity_of(name), np.concatenate([curve.get_ydata() for curve in ax.lines])
    largest, positive = float(np.abs(values).max()), values[values > 0.0]
    unit = unit_for(largest, what.unit) if what.unit != "%" else Unit(1.0, "%")
    for curve in ax.lines:
        curve.set_ydata(np.asarray(curve.get_ydata()) / unit.size)
    spread = float(positive.max() / positive.min()) if len(positive) else 1.0
    if (name.startswith("errors") or name == "max_error") and spread > LOGARITHMIC:
        log_axis(ax, float(positive.min()) / unit.size, float(positive.max()) / unit.size)
    else:
        ax.set_ylim(0.0, 1.15 * largest / unit.size or 1.0)
    ax.set_ylabel(f"{what.label.capitalize()} in {unit.name}")


def _room(done: Sequence[RunRecord], over: str) -> dict[str, float]:
    """Room of the legend above the axes, in inches."""
    return {"top": 0.16 + 0.15 * min(-(-len(_curves(done, over)) // 3), MOST_CURVES // 3)}


def _legend(figure: Figure, done: Sequence[RunRecord], over: str) -> None:
    """Curves by what distinguishes them, three in a row; a single one needs no name."""
    looks = [look for look, _ in _curves(done, over)][:MOST_CURVES]
    if len(looks) > 1:
        handles = [Line2D([], [], **look) for look in looks]
        figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=3, borderaxespad=0.25)
