"""Duty tables beside the points of a chart."""

import csv
import io
import tomllib

import numpy as np
import plain_machines
import pytest
from numpy.typing import ArrayLike

from pmr.errors import letters
from pmr.files.arrays import Array
from pmr.scene import load_any
from pmr.scene.members import member_at
from pmr.simulation.at_rest import scene_at_rest
from pmr.simulation.frame import load_signals
from pmr.simulation.statics.postures import load_names
from pmr.studies.chart_draft import chart_study_text
from pmr.studies.duty import NOT_LIMITED, DutyTable, LeastLoads
from pmr.studies.kinds.chart import Study
from pmr.studies.tasks import scene_of

UP_TO = 5000.0


def table(lengths: tuple[float, ...], angles: tuple[float, ...], moment: float) -> DutyTable:
    """Two limits, of which the first allows the moment about the pivot, and the second 800 kg beyond 45 degrees."""
    angle = np.deg2rad(angles)
    rows = []
    for length in lengths:
        radius, height = length * np.cos(angle), length * np.sin(angle)
        tipping = moment / radius
        load = np.stack(
            [np.where(tipping > UP_TO, np.nan, tipping), np.where(angle > np.pi / 4, 800.0, np.nan)], axis=1
        )
        rows.append({"load": load, "error": 0.1 * load, "place": np.stack([radius, height], axis=1), "luffing": angle})
    return DutyTable.from_loads(LeastLoads.from_rows(rows, 1), UP_TO)


def of_one_length(
    degrees: ArrayLike, load: ArrayLike, up_to: float = UP_TO, length: float = 10.0, error: float = 0.1
) -> DutyTable:
    """Boom whose limits allow `load` (angles, limits), or (angles,) of one, in kg, by a share `error` off."""
    angle = np.deg2rad(degrees)
    allowed = np.array(load, dtype=float).reshape(len(angle), -1)
    place = length * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    row = {"load": allowed, "error": error * allowed, "place": place, "luffing": angle}
    return DutyTable.from_loads(LeastLoads.from_rows([row], 1), up_to)


def test_loads_between_angles_follow_the_limit_and_end_where_the_tip_does() -> None:
    """A moment about the pivot allows moment / radius: the table has it at all radii, whatever the angles are."""
    angles, lengths = tuple(np.linspace(0.0, 44.0, 6)), (12.0, 8.0)
    duty = table(lengths, angles, 9000.0)
    assert duty.lengths == pytest.approx([8.0, 12.0])  # in increasing order
    for e, length in enumerate(duty.lengths):
        radius = length * np.cos(np.deg2rad(angles))
        reached = (duty.radii <= length) & (duty.radii >= radius.min())
        assert np.array_equal(np.isfinite(duty.load[:, e]), reached)
        assert duty.load[reached, e] == pytest.approx(9000.0 / duty.radii[reached], rel=2e-3)
        assert np.all(duty.load[reached, e] <= (1.0 + duty.interpolation) * 9000.0 / duty.radii[reached] + 1e-9)
        assert np.all(np.diff(duty.load[reached, e]) < 0.0)  # more radius, less load
        below = 0.9 - duty.lower[reached, e] / duty.load[reached, e]
        assert np.all((below >= -1e-12) & (below < 0.02))  # the error bars, and the doubt of the interpolation
    assert 2e-3 < duty.interpolation < 0.02
    assert duty.radii[[0, 1, -1]] == pytest.approx([8.0 * np.cos(np.deg2rad(44.0)), 6.0, 12.0])  # the least one, too
    at_end = duty.load[np.isclose(duty.radii, 8.0), 0]
    assert at_end == pytest.approx([9000.0 / 8.0])


def test_of_limits_that_cross_between_two_angles_the_smaller_counts_at_each_radius() -> None:
    """Each limit is interpolated by itself: the table has the corner in which the two meet."""
    degrees = np.linspace(0.0, 60.0, 13)
    radius = 10.0 * np.cos(np.deg2rad(degrees))
    duty = of_one_length(degrees, np.stack([9000.0 / radius, 600.0 + 50.0 * radius], axis=1))
    assert duty.load[:, 0] == pytest.approx(np.minimum(9000.0 / duty.radii, 600.0 + 50.0 * duty.radii), rel=1e-3)
    assert set(duty.which[:, 0].tolist()) == {0, 1}


def test_of_a_radius_above_and_below_the_horizontal_the_smaller_load_counts() -> None:
    degrees = np.linspace(30.0, -30.0, 9)  # in any order
    duty = of_one_length(degrees, 1000.0 + 200.0 * np.sin(np.deg2rad(degrees)))
    height = np.sqrt(100.0 - duty.radii**2)
    assert duty.load[:, 0] == pytest.approx(1000.0 - 20.0 * height, rel=1e-3)


def test_where_no_limit_is_reached_the_largest_load_that_was_tried_stands_without_a_limit() -> None:
    duty = table((8.0,), (0.0, 10.0), 1e9)
    assert duty.which[np.isfinite(duty.load)].tolist() == [-1] * int(np.isfinite(duty.load).sum())
    assert set(duty.load[np.isfinite(duty.load)]) == {UP_TO}
    (row,) = [row for row in csv.DictReader(io.StringIO(duty.csv(["tipping", "tip"]))) if row["radius [m]"] == "8"]
    assert row["8 m: load [kg]"] == ">5000" and row["8 m: governed by"] == NOT_LIMITED
    single = table((8.0, 6.0), (0.0,), 9000.0)
    assert single.radii == pytest.approx([6.0, 8.0])
    assert np.isfinite(single.load).tolist() == [[True, False], [False, True]]


def test_files_hold_the_table() -> None:
    """A sheet's cells are numbers that show the letters of limits; what the tip does not reach is empty."""
    duty = table((12.0, 8.0), (0.0, 20.0, 40.0, 60.0), 9000.0)
    rows = list(csv.DictReader(io.StringIO(duty.csv(["tipping", "tip"]))))
    assert [float(row["radius [m]"]) for row in rows] == pytest.approx(duty.radii)
    for e, length in enumerate(("8 m", "12 m")):
        for column, values in (("load [kg]", duty.load), ("lower bound [kg]", duty.lower)):
            read = [float(row[f"{length}: {column}"] or "nan") for row in rows]
            np.testing.assert_allclose(read, values[:, e], rtol=1e-8)
        assert [row[f"{length}: lower bound by"] for row in rows] == [row[f"{length}: governed by"] for row in rows]
        by = [row[f"{length}: governed by"] for row in rows]
        assert by == [
            ["tipping", "tip"][k] if x == x else "" for k, x in zip(duty.which[:, e], duty.load[:, e], strict=True)
        ]
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.load_workbook(io.BytesIO(duty.workbook("Crane", ["tipping", "tip"])))
    assert book.sheetnames == ["Loads in kg", "Lower bounds in kg", "Limits"]
    for name, values in (("Loads in kg", duty.load), ("Lower bounds in kg", duty.lower)):
        sheet = book[name]
        cells = [[np.nan if cell.value is None else cell.value for cell in row[1:]] for row in sheet.iter_rows(2)]
        np.testing.assert_allclose(cells, values, rtol=1e-15)  # a sheet has 16 digits
    sheet = book["Loads in kg"]
    assert sheet.cell(2, 2).number_format == '0" B"' and [cell.value for cell in book["Limits"][3]] == ["B", "tip"]


def test_a_lower_bound_has_the_letter_of_the_limit_whose_error_makes_it() -> None:
    """1000 kg with an error of 10, 1200 kg with one of 500: the first limit governs, the second may allow 700 kg."""
    angle = np.deg2rad([0.0, 30.0])
    place, load = 10.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1), np.tile([1000.0, 1200.0], (2, 1))
    row = {"load": load, "error": np.tile([10.0, 500.0], (2, 1)), "place": place, "luffing": angle}
    duty = DutyTable.from_loads(LeastLoads.from_rows([row], 1), UP_TO)
    assert duty.lower == pytest.approx(np.full_like(duty.lower, 700.0))
    assert (duty.which == 0).all() and (duty.which_lower == 1).all()
    written = next(csv.DictReader(io.StringIO(duty.csv(["tipping", "tip"]))))
    assert (written["10 m: governed by"], written["10 m: lower bound by"]) == ("tipping", "tip")


def test_of_slewing_angles_the_least_load_counts() -> None:
    load = np.array([[[900.0, np.nan], [np.nan, 700.0], [800.0, 750.0]]])  # of one luffing angle
    place = np.tile([8.0, 0.0], (3, 1))
    row = {"load": load[0], "error": 0.1 * load[0], "place": place, "luffing": np.zeros(3)}
    least = LeastLoads.from_rows([row], 3)
    assert least.load.tolist() == [[[800.0, 700.0]]] and least.error == pytest.approx(0.1 * least.load)


def test_letters_go_on_behind_z() -> None:
    assert [letters(k) for k in (0, 25, 26, 27, 52)] == ["A", "Z", "AA", "AB", "BA"]


@pytest.mark.parametrize("next_load", [500.0, 8000.0])
@pytest.mark.parametrize("up_to", [5e4, 5e5])
def test_no_load_is_allowed_beside_an_angle_at_which_the_boom_is_not_permitted_empty(
    next_load: float, up_to: float
) -> None:
    """Somewhere before the next angle the boom is permitted empty, but the chart does not know from where on."""
    duty = of_one_length((0.0, 20.0, 40.0, 60.0), [0.0, 0.0, next_load, 3.0 * next_load], up_to)
    beyond = duty.radii > 10.0 * np.cos(np.deg2rad(40.0)) + 1e-6
    assert beyond.sum() > 5 and not duty.load[beyond].any() and not duty.lower[beyond].any()
    assert np.all(duty.load[~beyond] > next_load) and np.all(duty.which[beyond] == 0)
    at_angle = of_one_length((0.0, 60.0), [0.0, next_load], up_to)
    assert at_angle.radii[0] == pytest.approx(5.0)
    assert (at_angle.load[0], at_angle.load[1:].any()) == (pytest.approx([next_load]), False)


@pytest.mark.parametrize("up_to", [5e4, 1.1e5, 123457.0, 7e4 / 3.0])
def test_a_limit_that_is_not_reached_at_two_angles_does_not_govern_between_them(up_to: float) -> None:
    """Not by round-off either: the cell has `>` before the largest load that was tried."""
    duty = of_one_length((0.0, 20.0, 40.0, 60.0), [900.0, np.nan, np.nan, np.nan], up_to)
    between = duty.radii <= 10.0 * np.cos(np.deg2rad(20.0))
    assert between.sum() > 5 and np.all(duty.load[between] == up_to) and np.all(duty.lower[between] == up_to)
    assert np.all(duty.which[between] == -1) and np.all(duty.which[~between] == 0)


def test_boom_lengths_that_are_equal_are_told_apart_by_their_extensions() -> None:
    """Two ways to 12 m, whose loads differ, beside one to 8 m: none has the name of another."""
    angle = np.deg2rad(np.linspace(0.0, 44.0, 6))
    ways = [(12.0, 9000.0, 3.5, 3.0), (8.0, 9000.0, 1.0, 1.5), (12.0, 8000.0, 3.0, 3.5)]
    rows = [
        {"load": moment / (length * np.cos(angle))[:, None], "error": np.zeros((6, 1)), "luffing": angle,
         "place": length * np.stack([np.cos(angle), np.sin(angle)], axis=1)}
        for length, moment, _, _ in ways
    ]  # fmt: skip
    extensions = [{"extension.middle": middle, "extension.fly": fly} for _, _, middle, fly in ways]
    duty = DutyTable.from_loads(LeastLoads.from_rows(rows, 1), UP_TO, extensions)
    assert duty.column_names == ["8 m", "12 m (middle 3.5 + fly 3)", "12 m (middle 3 + fly 3.5)"]
    heads, *_, last = csv.reader(io.StringIO(duty.csv(["tipping"])))
    cells = dict(zip(heads, last, strict=True))
    assert float(cells["12 m (middle 3.5 + fly 3): load [kg]"]) == pytest.approx(9000.0 / 12.0)
    assert float(cells["12 m (middle 3 + fly 3.5): load [kg]"]) == pytest.approx(8000.0 / 12.0)


def test_a_drafted_chart_has_the_factor_of_hoisting_and_wind_on_all_sections(monkeypatch: pytest.MonkeyPatch) -> None:
    """From behind and, as something of this boom is beside its plane, from both sides at every slewing angle."""
    monkeypatch.setattr("pmr.studies.chart_draft.is_installed", lambda _: False)  # without walls at pads
    text = chart_study_text(plain_machines.CRANE, load_any(plain_machines.CRANE), 5000.0)
    text = text.replace("shape = 1.6", "shape = 2.0", 1)  # the shape factor of one case is not that of the others
    row = Study.model_validate(tomllib.loads(text)).plan().runs[0]
    acting = [(case["load"], case["loads"]) for case in row.arguments["cases"]]
    assert acting == [(pytest.approx(1.202), {f"wind {wind}": 122.5}) for wind in ("0 by 2", "90 by 1.6", "-90 by 1.6")]
    scene = scene_of(row.arguments)
    at_rest = scene_at_rest(scene, {}, 0.0, np.deg2rad(70.0), dict.fromkeys(load_names(scene), 100.0))
    for number, part in enumerate(scene.sections):
        side = float(load_signals(at_rest, member_at(at_rest, number))["wind 90 by 1.6 y 0"].value(0.0))
        outside = 1.0 if not number else float(at_rest.extension(number).value(0.0)) / part.length
        assert part.body.box is not None
        assert side == pytest.approx(100.0 * 1.6 * part.body.box.height * outside)


def test_a_kink_of_one_limit_between_two_angles_may_take_a_load_beyond_what_straight_lines_differ() -> None:
    """Two members of one limit govern in turn: docs/load_chart.md has these figures."""

    def allowed(at: Array) -> Array:
        return np.asarray(3000.0 / np.maximum(np.cos(at), 0.55 + 0.3 * np.sin(at)))

    degrees = np.linspace(0.0, 75.0, 7)
    duty = of_one_length(degrees, allowed(np.deg2rad(degrees)), 1e5, 12.0, error=0.0)
    true = allowed(np.arccos(duty.radii / 12.0))
    assert duty.interpolation == pytest.approx(0.014, abs=5e-4)
    assert np.max(duty.load[:, 0] / true) == pytest.approx(1.019, abs=5e-4)
    assert np.max(duty.lower[:, 0] / true) == pytest.approx(1.005, abs=5e-4)
