"""Report of an observer, from the files that `pmr observe` left in a folder: a page of HTML, and the same page as PDF.

Each estimate is drawn with its band of 90 % beside what was measured and, where it is given, what is true.  Tables say
how many values lie within the bands, whether innovations are white, and how much wider bands are without each sensor.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pmr.files.arrays import Array, Summary
from pmr.report.blocks import Block, Chapter, Grid, KeyNumber, Notices
from pmr.report.columns import spread_indices
from pmr.report.document import ReportFiles, render, with_date, write_page
from pmr.report.figures import HALF, INK, LIMIT, MUTED, SERIES, add_legend, bins_of, drawing, make_axes
from pmr.report.figures.histories import BAND
from pmr.report.numbers import SPACE, format_percent, format_quantity, prose, significant, unit_for
from pmr.results.quantities import unit_text

#: p-value of the test of innovations below which the report says that the model lacks something.
DOUBTFUL = 0.01
#: Share of its first width above which the sensors hardly tell an unknown.
HARDLY = 0.5


def write_report(folder: Path) -> ReportFiles:
    """Write report.html and report.pdf about ``estimates.csv`` and ``observe.json`` in a folder; return their paths."""
    figures = json.loads((folder / "observe.json").read_text(encoding="utf-8"))
    table = np.genfromtxt(folder / "estimates.csv", delimiter=",", skip_header=1, encoding="utf-8").T
    chapter = build_chapter(figures, np.atleast_2d(table))
    title = with_date("Observer report", [figures])
    return write_page(render("study_report.html", chapter.title, [chapter], kind=title, introduction=()), folder)


def build_chapter(figures: Summary, table: Array) -> Chapter:
    """Build the chapter about an observer from the contents `figures` of ``observe.json``.

    `table` (c, T) are the c columns of ``estimates.csv`` in its order: time in s; mean and standard deviation of each
    estimate; measured value and innovation of each sensor; true values.  The first four estimates are key numbers.
    """
    sensors = list[str](figures["sensors"])
    units = {name: unit_text(unit) for name, unit in figures["units"].items()}
    t, estimates = table[0], 1 + 2 * len(units)
    measured = {name: table[estimates + 2 * k] for k, name in enumerate(sensors)}
    innovations = {name: table[estimates + 2 * k + 1] for k, name in enumerate(sensors)}
    truth = dict(zip(figures["coverage"], table[estimates + 2 * len(sensors) :], strict=True))
    none, last = np.full(len(t), np.nan), figures["last"]
    bands = [
        drawing(
            f"estimate-{k}", band_figure, _estimate_caption(name, figures), t, table[1 + 2 * k], table[2 + 2 * k],
            measured.get(name, none), truth.get(name, none), unit,
        )
        for k, (name, unit) in enumerate(units.items())
    ]  # fmt: skip
    tests = [
        drawing(f"innovation-{k}", innovation_figure, f"Innovations of {name}, over their standard deviations.", t, of)
        for k, (name, of) in enumerate(innovations.items())
        if np.isfinite(of).any()
    ]
    blocks = [
        Block("Estimates beside what was measured", drawings=bands),
        Block(
            "Innovations",
            drawings=tests,
            text=prose("innovations", doubtful=DOUBTFUL),
            grids=(_sensor_grid(figures, innovations),),
        ),
    ]
    if figures["observability"]:
        rows = [(name, format_percent(ratio)) for name, ratio in figures["observability"].items()]
        grid = Grid(OBSERVABILITY, ("unknown", "share"), tuple(rows))
        blocks.append(Block("What the sensors can tell", grids=(grid,)))
    if figures["without_sensor"]:
        blocks.append(Block("Which sensor matters", grids=_grids_without(figures["without_sensor"], list(units))))
    return Chapter(
        anchor="observer",
        title=figures["title"] or "Estimates from measurements",
        headline=f"{len(units)} estimates from {len(sensors)} sensors over {format_quantity(float(np.ptp(t)), 's')}.",
        key_numbers=[
            KeyNumber(_with_band(last[name], units[name]), name, f"at the end, band of 90{SPACE}%")
            for name in list(units)[:4]
        ],
        notices=Notices(warnings=list(_warnings(figures))),
        blocks=blocks,
    )


OBSERVABILITY = (
    "Standard deviation of each unknown after the motion, as a share of that before. Near 100 % the sensors tell "
    "nothing about it."
)


def _with_band(last: Mapping[str, float], unit: str) -> str:
    """Text of an estimate in `unit`: its mean, and half the width of its band of 90 %.

    `last` has ``mean`` and standard ``deviation`` of the estimate at the end of a run.
    """
    mean, half = last["mean"], WIDTH * last["deviation"]
    shown = unit_for(max(abs(mean), half), unit)
    return shown.after(f"{significant(mean / shown.size)} ± {significant(half / shown.size, 2)}")


def _estimate_caption(name: str, figures: Summary) -> str:
    """Caption of the figure of the estimate `name`.

    `figures` are the contents of ``observe.json``.  The caption tells the share of true values within the band, if
    `figures` has this share, and whether the error budget of the run covers the estimate.
    """
    is_covered = name not in figures["not_covered"]
    return prose("estimate", name=name, share=figures["coverage"].get(name), is_covered=is_covered)


def _sensor_grid(figures: Summary, innovations: Mapping[str, Array]) -> Grid:
    """Table of the sensors: values, share of innovations within the lines, p-value, and first alarm.

    `innovations` has the innovations (T,) of each sensor, divided by their standard deviations, by the sensor's name.
    They are NaN where nothing was measured.  `figures` are the contents of ``observe.json``.
    """
    rows = []
    for name, of in innovations.items():
        inside, p, alarm = np.abs(of[np.isfinite(of)]), figures["whiteness"][name], figures["first_alarm"].get(name)
        share = format_percent(float(np.mean(inside < WIDTH))) if len(inside) else "none"
        p_text = "not known" if p is None else significant(p, 2)
        alarm_text = "none" if alarm is None else format_quantity(alarm, "s")
        rows.append((name, str(len(inside)), share, p_text, alarm_text))
    head = ("sensor", "values", "between the lines", "p-value", "first alarm")
    return Grid("What each sensor measured beside what was predicted.", head, tuple(rows))


def _grids_without(without: Mapping[str, Mapping[str, float]], names: list[str]) -> tuple[Grid, ...]:
    """Tuple with one table of how much wider the band of each estimate of `names` is without each sensor.

    `without` has factors on the width by sensor, then by estimate; estimates that it lacks have no row.
    """
    rows = [
        (name, *(significant(of[name]) if name in of else "–" for of in without.values()))
        for name in names
        if any(name in of for of in without.values())
    ]
    caption = "Mean width of each band without one of the sensors, over that with all of them."
    return (Grid(caption, ("estimate", *(f"without {name}" for name in without)), tuple(rows)),)


def _warnings(figures: Summary) -> Iterator[str]:
    """Yield sentences on sensors at odds with the model, unknowns with a wide band, and innovations with a pattern."""
    yield from figures["faults"]
    for name, ratio in figures["observability"].items():
        if ratio > HARDLY:
            yield f"These sensors hardly tell {name}: its band still has {format_percent(ratio)} of its first width"
    doubtful = [name for name, p in figures["whiteness"].items() if p is not None and p < DOUBTFUL]
    if doubtful:
        yield f"Innovations are not white, so that the model lacks something: {', '.join(doubtful)}"


#: Standard deviations on each side of an estimate between which 90 % of the true values should lie.
WIDTH = 1.6449


def band_figure(t: Array, mean: Array, deviation: Array, measured: Array, truth: Array, unit: str) -> Figure:
    """Draw an estimate in `unit` over t (T,) in s, with its band of 90 %, measured and true values.

    `mean` and `deviation` (T,) are mean and standard deviation of the estimate.  `measured` and `truth` (T,) are NaN
    where there is no measured or no true value.
    """
    pen = unit_for(float(np.nanmax(np.abs(mean))), unit)
    figure, ax = make_axes(HALF, 1.9, "Time in s", pen.axis_label("Estimate"))
    shown, at = spread_indices(len(t), 2 * bins_of(ax)), np.flatnonzero(np.isfinite(measured))
    low, high = ((mean + sign * WIDTH * deviation)[shown] / pen.size for sign in (-1.0, 1.0))
    ax.fill_between(t[shown], low, high, color=BAND, linewidth=0.0, zorder=1.0, label="90 %")
    ax.plot(t[shown], mean[shown] / pen.size, color=INK, linewidth=0.8, label="estimate")
    if len(at):
        at = at[spread_indices(len(at), 2 * bins_of(ax))]
        ax.plot(t[at], measured[at] / pen.size, ".", color=MUTED, markersize=1.2, zorder=0.9, label="measured")
    if np.isfinite(truth).any():
        ax.plot(t[shown], truth[shown] / pen.size, "--", color=SERIES[0][0], linewidth=0.8, label="true")
    ax.set_xlim(t[0], t[-1])
    return add_legend(figure)


def innovation_figure(t: Array, innovations: Array) -> Figure:
    """Draw a sensor's innovations (T,), divided by their standard deviations, at t (T,) in s.

    If the model is right, 90 % of the innovations lie between two lines.
    """
    figure, ax = make_axes(HALF, 1.6, "Time in s", "Innovation (–)")
    at = np.flatnonzero(np.isfinite(innovations))
    at = at[spread_indices(len(at), 4 * bins_of(ax))]
    ax.plot(t[at], innovations[at], color=INK, linestyle="none", marker=".", markersize=1.2)
    for level in (-WIDTH, WIDTH):
        ax.axhline(level, color=LIMIT, linewidth=0.8, linestyle=(0, (4, 2)), label="90 %")
    ax.set_xlim(t[0], t[-1])
    return add_legend(figure)
