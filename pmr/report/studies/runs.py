"""What the runs of a study say, whatever was varied: errors and sizes over it, and every figure in tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pmr.report.blocks import Block, Chapter, Drawing, Grid, KeyNumber, drawing
from pmr.report.figures.canvas import WIDE, log_axis, sheet
from pmr.report.numbers import Unit, unit_for
from pmr.report.studies.axes import dots, log_x
from pmr.report.studies.finished import FinishedStudy
from pmr.report.studies.names import called, heading, key_words, quantity_of, unit_of, worded
from pmr.studies.engine.task import Scalar, number
from pmr.studies.results import RunRecord

MOST_ROWS, MOST_COLUMNS, MOST_GRIDS, MOST_CURVES = 60, 7, 3, 15
COORDINATES = "reduction.coordinates"
TIME = "simulate.reduced"
#: What is drawn, if the runs have it: the first one that they have is what accuracy is judged by.
ERRORS = ("errors.reduced_vs_full.beam", "errors.reduced_vs_ancf.beam", "errors.full_vs_ancf.beam")
BESIDE = ("errors.reduced_vs_full.tip", "max_displacement", "max_error")


def content(study: FinishedStudy, prefix: str) -> Chapter:
    """Headline, figures where something was varied by number, and tables of all runs."""
    runs = study.results.runs
    done = [run for run in runs if run.status == "done"]
    error = next((name for name in ERRORS if _known(done, name)), None)
    return Chapter(
        anchor=prefix,
        title=study.title,
        headline=_headline(len(runs), done, error),
        key_numbers=list(_key_numbers(done, error)),
        blocks=[*_figures(done, error, prefix), Block("Runs", grids=tuple(_grids(runs)))],
    )


def _headline(count: int, done: Sequence[RunRecord], error: str | None) -> str:
    there = f"{len(done)} of {count} runs are there."
    if error is None:
        return there
    known = sorted(_known(done, error), key=lambda run: _value(run, error))
    best, worst, what = known[0], known[-1], quantity_of(error)
    if len(known) < 2:
        return there
    return (
        f"The {what.label} is {what.cell(best.figures[error])} at least ({called(best)}) and "
        f"{what.cell(worst.figures[error])} at most ({called(worst)}). {there}"
    )


def _key_numbers(done: Sequence[RunRecord], error: str | None) -> Iterator[KeyNumber]:
    for name, which in ((error, "least"), ("max_error", "least"), ("max_displacement", "largest")):
        if name is None or not (known := _known(done, name)):
            continue
        run = (min if which == "least" else max)(known, key=lambda run: _value(run, name))  # noqa: B023
        what = quantity_of(name)
        label = what.label if which == "largest" else f"{what.label}, at best"
        yield KeyNumber(what.cell(run.figures[name]), label, called(run) if _differs(known, name) else "in all runs")
    if timed := [run for run in done if run.seconds.get(TIME)]:
        fastest = min(timed, key=lambda run: run.seconds[TIME])
        yield KeyNumber(quantity_of(TIME).cell(fastest.seconds[TIME]), "fastest simulation", called(fastest))


def _figures(done: Sequence[RunRecord], error: str | None, prefix: str) -> Iterator[Block]:
    """Errors and sizes over the parameter that has the most numbers, and over the seconds that simulations take."""
    over = varied(done)
    if over is None:
        return
    drawn = list[tuple[Drawing, ...]]()
    beside = [name for name in (error, *BESIDE) if name and _differs(done, name)]
    if beside:
        others = {key_words(key) for key in done[0].parameters if key != over}
        apart = f", a curve for each {' and '.join(sorted(others))}" if others else ""
        caption = f"What was found over the {key_words(over)}{apart}."
        drawn.append((drawing(f"{prefix}-varied", over_parameter, caption, done, over, beside),))
    timed = [run for run in done if run.seconds.get(TIME)]
    if error and len(_known(timed, error)) > 1:
        label = quantity_of(error).label.capitalize()
        caption = f"{label} over the time that one simulation of the reduced model takes."
        drawn.append((drawing(f"{prefix}-seconds", over_seconds, caption, timed, over, error),))
    if drawn:
        yield Block(f"Over the {key_words(over)}", tuple(drawn))


def varied(done: Sequence[RunRecord]) -> str | None:
    """The parameter over which figures are drawn: coordinates, or else the one that takes the most numbers."""
    counts = {
        key: len({_number(run.parameters[key]) for run in done})
        for key in (done[0].parameters if done else ())
        if all(_number(run.parameters.get(key)) is not None for run in done)
    }
    if counts.get(COORDINATES, 0) > 1:
        return COORDINATES
    most = max(counts, key=lambda key: counts[key], default=None)
    return most if most is not None and counts[most] > 1 else None


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
        groups.setdefault(called(run, over) if len(run.parameters) > 1 else "", []).append(run)
    return [(dots(k, 3.0) | {"label": name}, group) for k, (name, group) in enumerate(groups.items())]


def _points(group: Sequence[RunRecord], name: str, places: Mapping[str, float]) -> tuple[list[float], list[float]]:
    """Values of a figure in the unit of its axis, in the order of their places."""
    found = sorted((places[run.key], _value(run, name) / quantity_of(name).size) for run in _known(group, name))
    return [x for x, _ in found], [y for _, y in found]


def _value_axis(ax: Axes, name: str) -> None:
    """Errors on a logarithmic axis, sizes on one that shows how far they differ."""
    what, values = quantity_of(name), np.concatenate([curve.get_ydata() for curve in ax.lines])
    largest, positive = float(np.abs(values).max()), values[values > 0.0]
    unit = unit_for(largest, what.unit) if what.unit != "%" else Unit(1.0, "%")
    for curve in ax.lines:
        curve.set_ydata(np.asarray(curve.get_ydata()) / unit.size)
    if (name.startswith("errors") or name == "max_error") and len(positive):
        log_axis(ax, float(positive.min()) / unit.size, float(positive.max()) / unit.size)
    else:
        ax.set_ylim(0.0, 1.15 * largest / unit.size or 1.0)
    ax.set_ylabel(f"{what.label.capitalize()} in {unit.name}")


def _room(done: Sequence[RunRecord], over: str) -> dict[str, float]:
    """What the legend takes above the axes, in."""
    return {"top": 0.16 + 0.15 * min(-(-len(_curves(done, over)) // 3), MOST_CURVES // 3)}


def _legend(figure: Figure, done: Sequence[RunRecord], over: str) -> None:
    """Curves by what distinguishes them, three in a row; a single one needs no name."""
    looks = [look for look, _ in _curves(done, over)][:MOST_CURVES]
    if len(looks) > 1:
        handles = [Line2D([], [], **look) for look in looks]
        figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=3, borderaxespad=0.25)


def _grids(runs: Sequence[RunRecord]) -> Iterator[Grid]:
    """Parameters and figures of all runs, as many columns as fit on a page; what all have alike is said once."""
    parameters = list(dict.fromkeys(key for run in runs for key in run.parameters))
    heads = [key for key in parameters if len({run.parameters.get(key) for run in runs}) > 1] or parameters[:1]
    found = {name: [_cell(run, name) for run in runs] for name in _columns(runs)}
    same = {name: cells[0] for name, cells in found.items() if len(runs) > 1 and len(set(cells)) == 1}
    shown = [name for name in found if name not in same and not _doubles(runs, name, parameters)]
    alike = "; ".join(f"{quantity_of(name).label}: {cell}" for name, cell in same.items() if cell != "–")
    wide = max(MOST_COLUMNS - max(len(heads), 1), 2)
    parts = [shown[k : k + wide] for k in range(0, len(shown), wide)][:MOST_GRIDS] or [[]]
    left = len(shown) > wide * MOST_GRIDS or len(runs) > MOST_ROWS
    for number_of, part in enumerate(parts):
        head = tuple(map(heading, heads)) or ("run",)
        rows = tuple(
            (*([worded(run.parameters.get(key)) for key in heads] or [run.key]), *(found[name][k] for name in part))
            for k, run in enumerate(runs[:MOST_ROWS])
        )
        said = [f"In all runs: {alike}."] if alike and number_of == 0 else []
        said += ["Everything else stands in runs.csv."] if left and number_of == len(parts) - 1 else []
        names = tuple(quantity_of(name).label for name in part)
        yield Grid(" ".join(["Runs with what was varied and found.", *said]), (*head, *names), rows)


def _columns(runs: Sequence[RunRecord]) -> list[str]:
    """Figures of the runs and seconds of their simulations."""
    figures = (name for run in runs for name in run.figures)
    seconds = (name for run in runs for name in run.seconds if name.startswith("simulate."))
    return list(dict.fromkeys([*figures, *seconds]))


def _doubles(runs: Sequence[RunRecord], name: str, parameters: Sequence[str]) -> bool:
    """Whether a figure is what was asked for: so many coordinates."""
    values = [run.figures.get(name) for run in runs]
    return any(values == [run.parameters.get(key) for run in runs] for key in parameters)


def _cell(run: RunRecord, name: str) -> str:
    return quantity_of(name).cell(run.seconds[name] if name in run.seconds else run.figures.get(name))


def _known(runs: Iterable[RunRecord], name: str) -> list[RunRecord]:
    return [run for run in runs if _number(run.figures.get(name)) is not None]


def _differs(runs: Iterable[RunRecord], name: str) -> bool:
    """Whether a figure is known of several runs and not the same in all of them."""
    return len({quantity_of(name).cell(run.figures[name]) for run in _known(runs, name)}) > 1


def _value(run: RunRecord, name: str) -> float:
    return number(run.figures[name])


def _number(value: Scalar) -> float | None:
    return None if value is None or isinstance(value, bool | str) else float(value)
