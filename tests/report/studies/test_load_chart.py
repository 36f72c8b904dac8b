"""What the report of a load chart leaves out."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pmr.report.figures import HALF, style
from pmr.report.figures.load_chart import (
    LINES,
    NOT_PERMITTED,
    BentBoom,
    LoadChart,
    bent_boom,
    duty_lines,
    label_ends,
    load_chart,
)
from pmr.report.studies.chart import _key_numbers, _use_tables, build_chapter, duty_caption
from pmr.report.studies.chart_tables import (
    _load_cell,
    brief_rows,
    case_rows,
    duty_grids,
    format_bar,
    format_load,
    headline,
    load_step,
    round_down,
    terminal_grid,
)
from pmr.studies.charting import PARTS
from pmr.studies.duty import ChartLoads, DutyTable
from pmr.studies.limits import STABILITY_WORDS


def least_loads(load: Any, error: Any = np.nan) -> ChartLoads:
    """Loads (E, A) in kg of stability alone, with their errors in kg."""
    loads = np.asarray(load, dtype=float)
    return ChartLoads(loads[..., None], np.broadcast_to(error, loads.shape)[..., None], 2e4)


#: Keys of a study file without limits.
ASKED: dict[str, Any] = {"limits": [], "up_to": 2e4, "cases": [{"name": "rest"}], "error_bars": False}


def test_a_chart_on_which_no_limit_is_met_has_no_empty_picture_and_no_table_of_nothing() -> None:
    """At two extensions and three angles: the headline says so, and what else might have been looked for."""
    angles = {"least": 20.0, "most": 60.0, "count": 3}
    asked = {"limits": [], "slewing": [0.0], "luffing": angles, "up_to": 2e4, "error_bars": True, "classes": {}}
    unknown = dict.fromkeys(
        ("load", "error", "error.reduction", "error.mesh", "error.rotation"), np.full((3, 1), np.nan)
    )
    arrays = unknown | {
        "place": np.array([(10.0, 4.0), (8.0, 7.0), (5.0, 9.0)]),
        "luffing": np.deg2rad([20.0, 40.0, 60.0]),
        "at.remarks": np.array([""]),
        "at.left_out": np.array([["machine", "play in hinges"]]),
        "at.definitions": np.array([["load", "what hangs at the tip"]]),
        "at.slewing": np.array([0.0]),
    }
    runs = [SimpleNamespace(key=key, parameters={}, figures={}) for key in "ab"]
    figures = {"governs.stability": 0, "never.stability": 6, "at_no_load.stability": 0}
    results = SimpleNamespace(runs=runs, arrays=lambda key: arrays)
    study: Any = SimpleNamespace(
        title="Chart", study_file=asked | {"cases": [{"name": "rest"}]}, results=results, figures=figures
    )
    chapter = build_chapter(study, "part-1")
    headings = ["What load and radius are", "What is not in this chart"]
    headings += ["Limits", "Load cases"]
    assert [block.heading for block in chapter.blocks] == headings
    assert not any(block.drawings for block in chapter.blocks) and not chapter.key_numbers
    assert "not reached" not in str([grid.rows for block in chapter.blocks for grid in block.grids])
    start = (
        "No limit is reached up to 20\u202f000\u00a0kg in any of 6 postures. Only buckling of the boom was evaluated"
    )
    assert chapter.headline.startswith(start)


def test_the_first_sentence_says_whether_walls_and_pads_are_looked_at() -> None:
    """A limit of the stress of beams alone must not look as if loads were allowed."""
    pressure, force = {"of": "pad"}, {"of": "pad", "most": 6e4}
    for kind, is_said in (({"of": "stress"}, True), ({"of": "tipping"}, True), (pressure, True), (force, False),
                          ({"of": "field"}, False)):  # fmt: skip
        limits = [{"name": "limit", "factor": 1.5, **kind}]
        study: Any = SimpleNamespace(figures={}, study_file=ASKED | {"limits": limits})
        loads = least_loads([[500.0, 900.0]])
        rows = dict(brief_rows(study, loads, [{"extension.fly": 0.5}], np.zeros(1), np.array([0.0, 90.0])))
        sentence = headline(study, loads, np.array([[8.0, 4.0]]))
        assert (
            sentence.endswith(" A run states the stress of walls at pads.") is is_said
            and rows["slewing angles"] == "0°, 90°: the smallest load of all counts"
            and ("walls and pads are not" in sentence) is (is_said and kind is not pressure)
        )


@pytest.mark.parametrize(
    ("loads", "start"),
    [
        (
            [500.0, 900.0],
            "The limits allow 500 kg (8 m) to 900 kg (4.09 m), rounded down. This chart has no error bars.",
        ),
        ([500.0, np.nan], "The limits allow 500 kg (8 m) to more than 20 000 kg (search ends there), rounded down."),
        (
            [0.0, np.nan],
            "In 1 of 2 postures the boom is {}. Elsewhere the limits allow more than 20 000 kg (search ends there), "
            "rounded",
        ),
        ([0.0, 0.0], "In 2 of 2 postures the boom is {}."),
    ],
)
def test_the_first_sentence_has_the_range_of_loads_and_always_the_limits(loads: list[float], start: str) -> None:
    study: Any = SimpleNamespace(figures={}, study_file=ASKED)
    sentence = headline(study, least_loads([loads]), np.array([[8.0, 4.097]]))
    assert sentence.replace("\u00a0", " ").replace("\u202f", " ").startswith(start.format(NOT_PERMITTED))
    rows = dict(brief_rows(study, least_loads([loads]), [], np.zeros(1), np.array([0.0])))
    assert (rows["limits, no others"], rows["slewing angles"]) == (STABILITY_WORDS, "0°")
    assert rows["load cases"].endswith("not a rated capacity")


@pytest.mark.parametrize(
    ("least", "end"), [(19990.0, "19 990 kg (4 m)"), (2e4, "more than 20 000 kg (search ends there)")]
)
def test_the_first_sentence_has_the_upper_end_of_lower_bounds_where_no_limit_is_reached(least: float, end: str) -> None:
    study: Any = SimpleNamespace(figures={}, study_file=ASKED | {"error_bars": True})
    sentence = headline(study, least_loads([[500.0, np.nan]], [[20.0, 2e4 - least]]), np.array([[8.0, 4.0]]))
    said = sentence.replace("\u00a0", " ").replace("\u202f", " ")
    assert said.startswith(
        f"Use 480 kg (8 m) to {end}, rounded down: error bars are taken off. Without them it is 500 kg "
    )


def test_the_first_page_has_the_ranges_of_postures_and_all_cases_that_are_alike() -> None:
    cases = [{"name": name, "wind": {"speed": 14.0}} for name in ("from behind", "from the right")]
    study: Any = SimpleNamespace(figures={}, study_file=ASKED | {"cases": cases, "classes": {}})
    for fly, said in (
        (4.5, "middle and fly, 0.8 to 4.5\u00a0m each"),
        (3.0, "middle, 0.8 to 4.5\u00a0m; fly, 0.8 to 3\u00a0m"),
    ):
        rows = [{"extension.middle": 0.8, "extension.fly": 0.8}, {"extension.middle": 4.5, "extension.fly": fly}]
        found = dict(brief_rows(study, least_loads([[9.0]]), rows, np.deg2rad([60.0, 40.0, 20.0]), np.zeros(1)))
        assert (found["extensions"], found["luffing angles"]) == (said, "20° to 60°, 3 angles")
    assert found["2 load cases: from behind, or from the right"].startswith("in each: boom at rest, factor of load 1,")


def test_error_bars_are_rounded_up() -> None:
    shown = [format_bar(error) for error in (42.33, 42.0, 0.1234, 99.5, 0.0, 1310.0)]
    assert shown == [f"{text}\u00a0kg" for text in ("43", "42", "0.13", "100", "0", "1400")]


def test_no_load_is_called_zero_where_a_limit_is_passed_without_a_load() -> None:
    """In the first sentence, the picture, the lines over the radius, and the terminal's table."""
    load, which = np.array([[900.0, 600.0], [300.0, 0.0]]), np.zeros((2, 2), dtype=int)
    figures = {"governs.tip": 1, "governs.stability": 3}
    limits = [{"name": "tip", "factor": 1.5, "of": "pad", "most": 1e4}]
    study: Any = SimpleNamespace(figures=figures, study_file=ASKED | {"error_bars": True, "limits": limits})
    place = np.array([[[5.0, 5.0], [7.0, 1.0]], [[8.0, 8.0], [11.0, 2.0]]])
    of_limits = np.stack([[[950.0, 700.0], [300.0, 0.0]], [[900.0, 600.0], [400.0, np.nan]]], axis=-1)
    of_limits[1, 0] = (305.0, 310.0)
    errors = np.zeros_like(of_limits) + 10.5
    errors[1, 0] = (5.5, 21.0)  # so that another limit governs the load to use
    sentence = headline(study, ChartLoads(of_limits, errors, 2e4), place[..., 0]).replace("\u00a0", " ")
    assert f"In 1 of 4 postures the boom is {NOT_PERMITTED}." in sentence
    assert "Elsewhere use 289 kg (8 m) to 889 kg (5 m), rounded down: error bars are taken off." in sentence
    assert "Without them it is 305 kg (8 m) to 900 kg (5 m)." in sentence
    assert sentence.endswith(f"Of 4 postures, 3 are governed by the limit {STABILITY_WORDS}, 1 by tip.")
    chart = LoadChart(place, load, which, ["tip"], 2e4)
    for draw in (load_chart, duty_lines):
        assert [text.get_text() for text in draw(chart).legends[0].get_texts()] == ["A tip", NOT_PERMITTED]
    assert sum(patch.get_hatch() is not None for patch in load_chart(chart).axes[0].patches) == 1
    drawn = np.concatenate([line.get_xydata() for line in duty_lines(chart).axes[0].lines if line.get_marker() == "."])
    assert 0.0 not in drawn[:, 1]
    arrays = [
        {"place": at, "load": of[:, None], "error": np.full((2, 1), 10.5)} for at, of in zip(place, load, strict=True)
    ]
    runs = [SimpleNamespace(key=k, parameters={"extension.fly": 1.0 + k}) for k in range(2)]
    results: Any = SimpleNamespace(done=runs, runs=runs, arrays=lambda key: arrays[key])
    barred = ASKED | {"error_bars": True}
    grid = terminal_grid(results, 20, barred)
    assert [row[-3:] for row in grid.rows] == [("5–7", "589", "889"), ("8–11", "—", "289")]
    assert grid.head[:3] == ("fly out [m]", "boom length [m]", "radius [m]")
    assert grid.head[3:] == ("least load to use [kg]", "largest load to use [kg]")
    assert grid.caption.startswith("Error bars are taken off the loads.")
    assert terminal_grid(results, 20, barred | {"up_to": 800.0}).rows[0][-1] == "no limit reached"
    unbarred = terminal_grid(results, 20, ASKED)
    assert unbarred.head[3] == "least load [kg]" and unbarred.caption.startswith("The loads have no error bars.")
    assert "— is not permitted, even empty." in grid.caption and "duty.csv" in grid.caption
    results.runs = [*runs, SimpleNamespace(key=2)]
    caption = terminal_grid(results, 20, barred).caption
    assert "This chart is not complete: 1 of 3 extensions are missing." in caption and "duty.csv" not in caption


def test_the_first_sentence_names_the_case() -> None:
    """Static and without factors it is no rated capacity; factors and wind are named, a case out of service is not."""
    asked: dict[str, Any] = {"classes": {}, "cases": [{"name": "rest"}, {"name": "left", "load": 0.0, "weight": 1.2}]}
    plain = "static, factors of load and weight 1.0, no wind, no motion: not a rated capacity"
    assert dict(case_rows(asked)) == {"load cases": plain}
    asked["cases"][0] |= {"load": 1.25, "loads": {"gust": 400.0}}
    assert dict(case_rows(asked)) == {
        "load case rest": "boom at rest, factor of load 1.25, of the boom's weight 1, "
        "gust 400\u00a0N (N\u00a0m of a moment)",
        "not in the loads": "wind beyond these loads, hoisting, luffing, slewing, telescoping, "
        "swing of the load on its rope",
    }
    asked["cases"][0] |= {"machine": 0.9}
    rows = dict(case_rows(asked))
    assert ", factor of load 1.25, of the boom's weight 1, of the machine's 0.9, gust 400" in rows["load case rest"]
    asked["cases"][0] |= {"wind": {"speed": 14.0}}
    assert dict(case_rows(asked))["not in the loads"].startswith("wind on machine and load, hoisting, luffing")


def test_key_numbers_have_the_load_at_the_largest_radius_and_its_limit() -> None:
    place = np.array([[[5.0, 5.0], [7.0, 1.0]], [[8.0, 8.0], [11.25, 2.0]]])
    load, which = np.array([[900.0, 600.0], [300.0, 120.0]]), np.array([[0, 1], [0, 1]])
    for at_tip, shown in ((120.0, "120\u00a0kg"), (0.0, NOT_PERMITTED)):
        load[1, 1] = at_tip
        chart = LoadChart(place, load, which, ["tip", "pads of fly"], 2e4)
        turned = [{"at.slewing": np.linspace(0.0, 180.0, 5)}]
        most, farthest, postures = _key_numbers(chart, least_loads(load), turned)
        assert (postures.value, postures.note) == ("4", "each at 5 slewing angles; 2 limits")
        assert (most.value, most.note) == ("900\u00a0kg", "at a radius of 5\u00a0m")
        assert (farthest.value, farthest.label) == (shown, "at the largest radius, 11.25\u00a0m")
        assert farthest.note == "limited by pads of fly"
    load[0, 0], load[1, 1], parts = (
        1200.0,
        126.5,
        {f"error.{of}": np.zeros((1, 1)) for of in PARTS} | {"load": np.ones((1, 1))},
    )
    chart = LoadChart(place, load, which, ["tip", "pads of fly"], 2e4)
    of_limits = np.stack([load, load + [[10.0, 1e3], [1e3, 1e3]]], axis=-1)
    loads = ChartLoads(of_limits, np.full((2, 2, 2), 7.03), 2e4)
    *_, farthest, bar, doubt, _ = _key_numbers(chart, loads, [turned[0] | parts])
    assert (farthest.value, farthest.note) == ("120\u00a0kg", "limited by pads of fly")  # by 10 kg, as the duty table
    assert (bar.value, bar.note.partition(":")[0]) == ("7.1\u00a0kg", "taken off these loads")
    assert (doubt.value, doubt.label) == ("1", "of 4 postures with another limit")


def test_tables_of_loads_have_all_boom_lengths_and_are_not_wider_than_paper() -> None:
    """Twelve lengths stand in two tables of six, without rows that are empty in one of them."""
    lengths, radii = np.linspace(7.6, 15.0, 12), np.array([5.0, 14.0])
    load = np.array([[9000.0] * 12, [np.nan] * 11 + [551.3]])
    which = np.zeros(load.shape, dtype=int)
    duty = DutyTable(radii, lengths, load, load, which, which, 2e4)
    study: Any = SimpleNamespace(figures={}, study_file={"error_bars": False})
    first, second = duty_grids(study, replace(duty, interpolation=0.0071), "")
    assert "which differs from straight lines by at most 0.71\u00a0% of the load." in first.caption
    assert "This chart has no error bars, as its study has error_bars = false." in first.caption
    heads = [*first.head[1:], *second.head[1:]]
    assert heads == [f"{length:.2f}\u00a0m" for length in lengths] and len(first.head) == 7
    assert [len(grid.rows) for grid in (first, second)] == [1, 2]
    assert first.head[0] == second.head[0] == "Load, kg, at radius in m"
    out = tuple({"extension.middle": 0.8, "extension.fly": 0.8 + 0.1 * (e == 11)} for e in range(12))
    bounds = replace(duty, lower=0.9 * load, which_lower=which + 2, extensions=out)
    _, use, *_, last = duty_grids(SimpleNamespace(figures={}, study_file={"error_bars": True}), bounds, "none")
    assert use.head[0] == "Load to use, kg, at radius in m" and use.rows[1][-1] == "490\u00a0C"
    assert use.head[-2:] == ("14.33\u00a0m, middle/fly\u00a00.8", "15.00\u00a0m, middle\u00a00.8, fly\u00a00.9")
    assert last.head[0] == "Load without error bars, kg, at radius in m" and last.rows[1][-1] == "550\u00a0A"
    assert second.rows[1] == ("14", *["·"] * 5, "550\u00a0A")
    for fine in (
        np.array([0.29, 0.58]),
        np.array([0.005, 0.01]),
    ):  # also where a radius times 100 is just below a number
        single = DutyTable(fine, lengths[:1], load[:, :1], load, which[:, :1], which[:, :1], 2e4)
        grid = next(duty_grids(study, single, ""))
        assert grid.rows[0][0] == f"{fine[0]:g}"


def test_loads_of_tables_are_rounded_down() -> None:
    assert [round_down(load, load_step(13009.0)) for load in (13009.9, 559.9, 9.99)] == [13000.0, 550.0, 0.0]
    shown = [format_load(load) for load in (13008.79, 20000.0, 387.3, 13.9, 0.0)]
    assert shown == [f"{text}\u00a0kg" for text in ("13\u202f000", "20\u202f000", "387", "13.9", "0")]
    assert round_down(217.9, load_step(217.9)) == 217.0 and round_down(2.199, load_step(9.0)) == pytest.approx(2.19)


@pytest.mark.parametrize(("reaches", "angles"), [(4, 5), (1, 5), (4, 1), (2, 2)])
def test_colours_end_where_the_machine_does(reaches: int, angles: int) -> None:
    """No corner of a cell is further out than the longest reach, and that reach is coloured to its end."""
    reach, angle = np.linspace(8.0, 22.0, reaches), np.linspace(0.2, 1.2, angles)
    place = reach[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    names = ["tip", "pads"]
    load, which = np.full(place.shape[:2], 500.0), np.zeros(place.shape[:2], dtype=int)
    drawn = load_chart(LoadChart(place, load, which, names, 2e4))
    corners = np.concatenate([patch.get_path().vertices for patch in drawn.axes[0].patches])
    far = np.linalg.norm(corners, axis=1)
    assert far.max() == pytest.approx(reach[-1], rel=1e-12)
    assert far.min() <= reach[0] * (1.0 + 1e-12)
    turned = np.arctan2(corners[:, 1], corners[:, 0])[far > (1.0 - 1e-9) * reach[-1]]
    assert len(np.unique(turned.round(9))) == (angles + 1 if angles > 1 else 2)  # on the arc, between the places too


def test_pads_without_force_and_directions_without_deflection_fill_no_rows() -> None:
    """A page of a limit has one row for all pads without force, and has no table of deflections that are all 0."""
    arrays = {
        "at.used": np.array([[1.0]]),
        "at.stress": np.zeros((1, 0)),
        "at.direction.names": np.array(["z", "y"]),
        "at.bent.section": np.array([0, 0]),
        "at.bent": np.array([[-0.05, 1e-15]]),
        "at.forces.names": np.array(["tail top", "tail left", "tail right"]),
        "at.kinds": np.array(["pad", "pad", "pad"]),
        "at.forces": np.array([[5800.0, 0.0, 1e-9]]),
    }
    _, deflections, forces = _use_tables(["pads"], 0, arrays, ("boom",))
    assert deflections.title.endswith("positive upwards")
    assert forces.rows == (("tail top", "5.80\u00a0kN"), ("all other pads", "0\u00a0N"))
    arrays["at.kinds"] = np.array(["pad", "cylinder", "pad"])
    assert _use_tables(["pads"], 0, arrays, ("boom",))[-1].rows[-1][0] == "all others"


@pytest.mark.parametrize("load, text", [(7417.7, "7417"), (0.0, "—"), (np.inf, "no limit reached")])
def test_a_load_on_the_terminal_is_rounded_down(load: float, text: str) -> None:
    assert _load_cell(load) == text


@pytest.mark.parametrize("luffing", [1.2, 1.45])
def test_labels_of_a_steep_boom_do_not_overlap(luffing: float) -> None:
    """On axes that are narrow, for a metre as long across as up, the height's label and the ticks of both axes."""
    along, nothing = np.linspace(0.0, 20.0, 5), np.zeros(5)
    with style():
        figure = bent_boom(BentBoom(along, nothing, nothing.astype(int), ("base",), luffing))
        FigureCanvasAgg(figure).draw()
        axis = figure.axes[0].yaxis
        ticks = [text.get_window_extent().x0 for text in axis.get_ticklabels() if text.get_text()]
        assert axis.label.get_window_extent().x1 < min(ticks)
        across = [text.get_window_extent() for text in figure.axes[0].xaxis.get_ticklabels() if text.get_text()]
        assert all(left.x1 < right.x0 for left, right in zip(across, across[1:], strict=False)) and across


def test_the_legend_names_the_colour_of_places_where_no_limit_is_reached() -> None:
    place = np.array([[[1.0, 0.0], [0.7, 0.7]], [[2.0, 0.0], [1.4, 1.4]]])
    chart = LoadChart(place, np.array([[np.nan, 5.0], [4.0, 3.0]]), np.array([[-1, 0], [0, 0]]), ["tip"], 1.25e6)
    labels = [text.get_text() for text in load_chart(chart).legends[0].get_texts()]
    assert labels == ["A tip", "more than 1\u202f250\u202f000 kg (search ends there)"]


def test_lines_of_duty_have_length_and_letter_and_end_where_the_tip_does() -> None:
    """Two boom lengths; the shorter one is limited by `pads` where it is low, and by nothing where it is steep.

    The length stands above the end of its line, at the largest radius.
    """
    angle = np.deg2rad([10.0, 40.0, 70.0])
    place = np.array([8.0, 12.0])[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    load = np.array([[900.0, 1200.0, np.nan], [500.0, 700.0, 1500.0]])
    chart = LoadChart(place, load, np.array([[1, 1, -1], [0, 0, 1]]), ["tip", "pads"], 2000.0)
    ax = duty_lines(chart).axes[0]
    assert sorted(text.get_text() for text in ax.texts) == ["12.00 m", "8.00 m", "A", "B", "B"]
    ends = {text.get_text(): text.xy for text in ax.texts if text.get_text().endswith("m")}
    assert ends["8.00 m"] == (place[0, 0, 0], 900.0) and ends["12.00 m"] == (place[1, 0, 0], 500.0)
    drawn = np.concatenate([line.get_xydata() for line in ax.lines if line.get_marker() == "."])
    drawn = drawn[np.isfinite(drawn[:, 1])]
    assert np.allclose(sorted(drawn[:, 0]), sorted([*place[0, :2, 0], *place[1, :, 0]]))
    (beyond,) = [line.get_xydata() for line in ax.lines if line.get_marker() == "^" and len(line.get_xydata())]
    assert np.allclose(beyond, [[place[0, 2, 0], 2000.0]])
    more = "more than 2000 kg (search ends there)"
    assert [text.get_text() for text in ax.figure.legends[0].get_texts()] == ["A tip", "B pads", more]


def test_lines_of_one_length_are_told_apart_by_their_extensions() -> None:
    place = np.array([12.0, 12.001, 9.0])[:, None, None] * np.array([[1.0, 0.0], [0.8, 0.6]])
    load = np.array([[900.0, 950.0], [500.0, 700.0], [1500.0, 1600.0]])
    chart = LoadChart(place, load, np.zeros(load.shape, dtype=int), ["tip"], 2000.0, ["3 + 2", "2 + 3", "1 + 1"])
    ends = {text.get_text() for text in duty_lines(chart).axes[0].texts}
    assert ends == {"A", "12.00 m (3 + 2)", "12.00 m (2 + 3)", "9.00 m"}


@pytest.mark.parametrize("draw", [load_chart, duty_lines])
def test_pictures_of_loads_are_drawn_for_narrow_windows_too(draw: Any) -> None:
    place = np.array([12.0, 9.0])[:, None, None] * np.array([[1.0, 0.0], [0.8, 0.6]])
    chart = LoadChart(place, np.array([[900.0, 950.0], [500.0, 700.0]]), np.zeros((2, 2), dtype=int), ["tip"], 2000.0)
    assert draw(chart, HALF).get_figwidth() == HALF < draw(chart).get_figwidth()


def test_the_caption_of_lines_says_how_many_of_all_boom_lengths_are_drawn() -> None:
    place = np.stack([np.full((12, 2), 5.0), np.zeros((12, 2))], axis=2) * np.arange(1.0, 13.0)[:, None, None]
    chart = LoadChart(place, np.full((12, 2), 900.0), np.zeros((12, 2), dtype=int), ["tip"], 2e4)
    ends = [text for text in duty_lines(chart).axes[0].texts if text.get_text().endswith(" m")]
    narrow = [text for text in duty_lines(chart, HALF).axes[0].texts if text.get_text().endswith(" m")]
    caption, lacking = duty_caption(chart.lengths, True), set(chart.lengths) - {text.get_text() for text in ends}
    said = sorted(lacking, key=chart.lengths.index)
    assert f" Lines of {', '.join(said)} are left out;" in caption and len(ends) == LINES == 12 - len(lacking)
    assert f" {len(narrow)} of 12 boom lengths" in caption and "narrow" not in duty_caption(chart.lengths[:5], True)
    assert " of 91 of 100 boom lengths are left out" in duty_caption([f"{k} m" for k in range(100)], False)


def test_each_curve_has_its_load_and_the_ground_is_below_the_boom() -> None:
    """Also the curve of 500 kg, which is too short for a label on it."""
    angle = np.deg2rad(np.linspace(20.0, 60.0, 5))
    place = np.linspace(8.0, 15.0, 5)[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    load = 1200.0 - 130.0 * np.arange(5)[:, None] + 30.0 * np.arange(5)
    load[-1, 0] = 495.0
    for ground in (-1.6, np.nan):
        chart = LoadChart(place, load, np.zeros(load.shape, dtype=int), ["tip"], 2e4, ground=ground)
        ax = load_chart(chart).axes[0]
        assert {"500", "700", "1000"} <= {text.get_text() for text in ax.texts}
        lines = [line.get_ydata()[0] for line in ax.lines if len(line.get_ydata()) == 2]
        assert (lines, ax.get_ylim()[0]) == (([-1.6], -1.6) if ground == -1.6 else ([], 0.0))


def test_labels_above_ends_of_lines_keep_their_distance() -> None:
    """Also where rounding makes a label that was moved a little too near to the one below: it moved on for ever."""
    axes = Figure(figsize=(6.0, 3.0)).add_subplot()
    axes.set(xlim=(0.0, 15.0), ylim=(0.0, 1e4))
    loads = np.random.default_rng(5).uniform(0.0, 1e4, 200)
    label_ends(axes, [("15 m", 10.0, load) for load in loads.tolist()])
    figure = axes.figure
    assert isinstance(figure, Figure)
    up = np.sort([axes.transData.transform(of.xy)[1] * 72.0 / figure.dpi + of.xyann[1] for of in axes.texts])
    assert np.diff(up).min() > 9.999
