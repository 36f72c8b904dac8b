import re
from dataclasses import replace
from importlib.resources import files

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.axis import Axis

from pmr import RunResult, report
from pmr.report.blocks import Drawing
from pmr.report.columns import tip_displacements
from pmr.report.figures import (
    HALF,
    PENS,
    SHADE,
    WIDE,
    legend_rows,
    log_axis,
    make_sheet,
    octave_axis,
    shapes,
    style,
    svg,
)
from pmr.report.figures.histories import Span, Timeline, drawn_history, history_figure, sliding_spans
from pmr.results import FrequencyMap, Paths

LABELS = {
    "position": ["Position in m", "Time in s"],
    "loads-0": ["Force in N", "Time in s"],
    "tip-z": ["Tip z in mm", "Difference in µm", "Time in s"],
    "energy": ["Total energy in J", "Difference in mJ", "Time in s"],
    "energy-parts": ["strain energy", "kinetic energy", "external energy", "Energy in J"],
    "forces-1": ["Force in N", "Time in s"],
    "basis": ["x in m", "Relative shape (–)"],
    "singular-values": ["Number k (–)", "Singular value σ(k) / σ(1) (–)"],
    "frequencies": ["Slider position s in m", "Natural frequency in Hz"],
}


def tip_history(result: RunResult) -> Drawing:
    """The tip's history alone."""
    return drawn_history(
        "a", result, tip_displacements(result)["z"], "Displacement of the tip, vertical, z", "Displacement", "m"
    )


WHOLE, BARE = "case-1", "case-2"


def test_every_figure_is_there(written) -> None:
    assert sorted(written.names(WHOLE)) == sorted(LABELS)
    assert sorted(written.names(BARE)) == sorted([*LABELS, "loads-1"])


@pytest.mark.parametrize("name", LABELS)
def test_axes_are_labelled_with_units(written, name: str) -> None:
    assert set(LABELS[name]) <= set(written.texts(WHOLE, name))


def test_curves_stand_in_the_page_and_are_named(written) -> None:
    for name in ("tip-z", "energy", "energy-parts", "forces-1"):
        assert {"full", "ANCF", "reduced"} <= set(written.texts(WHOLE, name)), name
        for pen in PENS.values():
            assert written.svg(WHOLE, name).count(f'stroke="{pen.colour}"') >= 2, name  # legend and curve


def test_long_signals_stay_small(make_result) -> None:
    assert len(tip_history(make_result(steps=60_000)).svg) < 60_000


def test_sliding_phase_is_shaded_and_named(written, make_result) -> None:
    assert written.svg(WHOLE, "tip-z").count(f'fill="{SHADE}"') == 3  # both panels and the legend
    assert "slider moves" in written.texts(WHOLE, "tip-z")
    still = tip_history(make_result(slider={"path": 2.0}))
    assert SHADE not in still.svg and "slider moves" not in still.svg


@pytest.mark.parametrize(
    ("rate", "spans"),
    [
        ([0, 0, 0, 0, 0, 0, 0, 0, 0], []),
        ([0, 0, 1, 1, 0, 0, 0, 0, 0], [(2, 4)]),
        ([0, 1, 1, 0, 0, -1, -1, 0, 0], [(1, 7)]),  # a moment's pause
        ([0, 1, 1, 0, 0, 0, -1, -1, 0], [(1, 3), (6, 8)]),
        ([1, 1, 1, 1, 1, 1, 1, 1, 1], [(0, 8)]),
    ],
)
def test_sliding_phases(rate: list[float], spans: list[tuple[float, float]]) -> None:
    assert sliding_spans(np.arange(9.0), np.array(rate, dtype=float)) == tuple(Span(*span) for span in spans)


def test_ticks_of_what_hardly_changes_are_labelled_without_an_offset(make_result) -> None:
    """The total energy of a boom at rest, 24.513 J, had the label +2.4513e1 above its axis, on top of the legend."""
    alone = make_result(responses=("reduced",))
    drawn = drawn_history("a", alone, lambda response: 24.513 + 1e-5 * np.sin(response.t), "Energy", "Energy", "J")
    numbers = [text for text in re.findall("<text[^>]*>([^<]+)</text>", drawn.svg) if text.startswith("24.")]
    assert len(numbers) > 2 and "e1<" not in drawn.svg


def test_reduced_beam_alone_is_compared_with_nothing(written) -> None:
    assert not any("Difference" in text for name in LABELS for text in written.texts(BARE, name))
    assert "difference" not in written.caption(BARE, "tip-z")


def test_closed_form_is_shown_where_there_is_one(written) -> None:
    assert "closed form" in written.texts(WHOLE, "frequencies")
    assert "closed form" not in written.texts(BARE, "frequencies")


@pytest.mark.filterwarnings("error")
def test_a_closed_form_above_all_models_is_left_out_without_a_warning(whole: RunResult) -> None:
    """A run of a body that does not slide ended with NumPy's "All-NaN slice" in the terminal."""
    models = dict(whole.frequencies.models)
    models["closed_form"] = np.column_stack([models["closed_form"], 2.0 * models["closed_form"][:, -1]])
    ax = shapes.frequency_figure(replace(whole, frequencies=replace(whole.frequencies, models=models))).axes[0]
    assert ax.get_ylim()[0] == pytest.approx(shapes.frequency_figure(whole).axes[0].get_ylim()[0])


def test_each_slider_has_its_force_and_each_load_its_unit(written) -> None:
    assert {"slider 1", "slider 2", "Force in N"} <= set(written.texts(BARE, "forces-1"))
    assert {"Force in kN", "F", "G"} <= set(written.texts(BARE, "loads-0"))
    assert {"Moment in N m", "M"} <= set(written.texts(BARE, "loads-1"))
    assert {"slider", "slider − 0.5 m"} <= set(written.texts(BARE, "position"))


def test_singular_values_say_what_is_taken(written) -> None:
    assert {"taken, r = 3", "left out", "κ(3) = 0.998750"} <= set(written.texts(WHOLE, "singular-values"))


def test_style_leaves_no_trace(bare: RunResult) -> None:
    with mpl.rc_context({"axes.linewidth": 7.5, "svg.hashsalt": "mine"}):
        before = dict(mpl.rcParams)
        tip_history(bare)
        assert dict(mpl.rcParams) == before
    assert pyplot.get_fignums() == []


def labels_of(axis: Axis) -> list[str]:
    found = axis.get_major_formatter().format_ticks(axis.get_majorticklocs())
    assert found
    return found


def test_what_would_steer_the_page_is_spelled_out_beside_a_tick() -> None:
    with style():
        figure, axes = make_sheet(3.0, 2.0)
        axes[0, 0].set_xticks([0.5], ["one\x1b"])
        assert "one\\x1b" in svg(figure, "a", "")


@pytest.mark.parametrize(("low", "high"), [(2e-17, 8e-17), (1e-30, 1e-2), (1.0, 1.0), (3e-13, 1.0)])
def test_logarithmic_axes_always_have_labels(low: float, high: float) -> None:
    _, axes = make_sheet(3.0, 2.0)
    ax = axes[0, 0]
    log_axis(ax, low, high)
    bottom, top = ax.get_ylim()
    inside = [tick for tick in ax.get_yticks() if bottom <= tick <= top]
    assert 2 <= len(inside) <= 8
    assert top >= high and (bottom <= low or top / bottom > 1e17)
    assert all(label.startswith("10") for label in labels_of(ax.yaxis))


def test_frequencies_over_decades_are_labelled_in_hertz() -> None:
    _, axes = make_sheet(3.0, 2.0)
    octave_axis(axes[0, 0], 0.9, 44.0)
    assert labels_of(axes[0, 0].yaxis) == ["1", "2", "5", "10", "20"]
    _, axes = make_sheet(3.0, 2.0)
    octave_axis(axes[0, 0], 0.0, 44.0)
    octave_axis(axes[0, 0], 31.0, 44.0)
    assert axes[0, 0].get_yscale() == "linear"


def test_the_band_of_the_estimate_holds_what_is_drawn(make_result) -> None:
    result = make_result()
    wide = np.full(len(result.abscissa), 2e-3)
    time = Timeline(result)
    figure = history_figure(time, time.signals(lambda response: response.tip), "Tip", "m", wide)
    (filled,) = [one for one in figure.axes[1].collections if len(one.get_paths()[0].vertices) > 4]
    off = 1e3 * np.abs(result.responses["reduced"].tip - result.responses["full"].tip).max()
    edges = filled.get_paths()[0].vertices[:, 1]
    assert edges.max() == -edges.min() == pytest.approx(2.0)
    drawn = {line.get_label(): np.abs(line.get_ydata()).max() for line in figure.axes[1].lines}
    assert drawn["reduced"] == pytest.approx(off)
    alone = Timeline(make_result(responses=("reduced",)))
    figure = history_figure(alone, alone.signals(lambda response: response.tip), "Tip", "m", wide)
    assert [ax.get_ylabel() for ax in figure.axes] == ["Tip in mm", "Error in mm"]


@pytest.mark.parametrize(("inches", "size"), [(WIDE, "legend.fontsize"), (HALF, "xtick.labelsize")])
def test_labels_are_readable_at_390_px(inches: float, size: str) -> None:
    """At least 9 px high: wide figures are wider than the screen and scroll, others fill it but for 16 px aside."""
    look, least = (files(report) / "templates" / "screen.css").read_text(), 0.0
    if inches == WIDE:
        least = 16.0 * float(re.findall(r"\.wide svg { min-width: ([\d.]+)rem", look)[0])
    with style():
        points = mpl.rcParams[size]
    assert points * max(least, 390.0 - 32.0) / (72.0 * inches) >= 9.0


def test_contours_have_their_labels_within_the_map(whole: RunResult) -> None:
    """Half of a label at the edge would be cut off."""
    first = np.linspace(0.8, 4.5, 9)
    found = FrequencyMap(("a", "b"), first, first, 6.0 - 0.5 * (first[:, None] + first))
    ways = Paths(("a", "b"), np.stack([first, first], axis=1), np.ones((9, 2)))
    result = replace(whole, paths=ways, frequencies=replace(whole.frequencies, over_joints=found))
    with style():
        ax = shapes.frequency_map_figure(result).axes[0]
    shown = [one for one in ax.texts if one.get_visible()]
    places = (np.array([one.get_position() for one in shown]) - first[0]) / (first[-1] - first[0])
    assert len(shown) >= 4 and (places > 0.05).all() and (places < 0.95).all()


def test_the_label_of_an_axis_keeps_clear_of_long_labels_of_its_ticks() -> None:
    """A displacement of 1.058 mm that changes by 4 µm has ticks of six characters."""
    with style():
        figure, axes = make_sheet(HALF, 1.9)
        axes[0, 0].plot([0.0, 1.0], [-1.0584, -1.0546])
        axes[0, 0].set_ylabel("Tip y in mm")
        svg(figure, "tip", "Tip")
        figure.draw_without_rendering()
        label = axes[0, 0].yaxis.label.get_window_extent()
        ticks = [tick.get_window_extent() for tick in axes[0, 0].get_yticklabels()]
    assert len(axes[0, 0].get_yticklabels()[1].get_text()) == 6
    assert 0.0 <= label.x0 and label.x1 <= min(tick.x0 for tick in ticks)


def test_a_legend_has_as_many_rows_as_its_longest_names_need() -> None:
    """Names of 25 letters, 1.97 in each: two of them are wider than half a page."""
    edges = ["rear right to front right", "front right to front left", "front left to rear left", "rear left"]
    assert legend_rows(edges, HALF) == 4 and legend_rows(edges[:1], HALF) == 1
    assert legend_rows(["x", "y", "z"], HALF) == 1 and legend_rows([], HALF) == 1
