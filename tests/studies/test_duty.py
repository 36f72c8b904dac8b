"""Duty tables beside the points of a chart."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest

from pmr.errors.text import letters
from pmr.studies.duty import NOT_LIMITED, DutyTable, LeastLoads

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


def test_loads_stand_where_the_tip_comes_and_are_those_of_a_computed_place() -> None:
    """Of neighbours the smaller load, so none is more than the moment allows; nothing beyond the boom's length."""
    angles, lengths = (0.0, 20.0, 40.0, 60.0, 70.0), (12.0, 8.0)
    duty = table(lengths, angles, 9000.0)
    assert duty.lengths == pytest.approx([8.0, 12.0])  # in increasing order
    for e, length in enumerate(duty.lengths):
        radius = length * np.cos(np.deg2rad(angles))
        reached = (duty.radii <= length) & (duty.radii >= radius.min())
        assert np.array_equal(np.isfinite(duty.load[:, e]), reached)
        computed = np.concatenate([9000.0 / radius[:3], [800.0]])
        assert np.isin(duty.load[reached, e].round(6), computed.round(6)).all()
        allowed = np.minimum(9000.0 / duty.radii, np.where(duty.radii < radius[3], 800.0, np.inf))
        assert np.all(duty.load[reached, e] <= allowed[reached] * (1.0 + 1e-12))
        assert duty.lower[reached, e] == pytest.approx(0.9 * duty.load[reached, e])
    at_end = duty.load[np.isclose(duty.radii, 8.0), 0]
    assert at_end == pytest.approx([9000.0 / 8.0])  # a computed place counts alone


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


def test_of_slewing_angles_the_least_load_counts() -> None:
    load = np.array([[[900.0, np.nan], [np.nan, 700.0], [800.0, 750.0]]])  # of one luffing angle
    place = np.tile([8.0, 0.0], (3, 1))
    row = {"load": load[0], "error": 0.1 * load[0], "place": place, "luffing": np.zeros(3)}
    least = LeastLoads.from_rows([row], 3)
    assert least.load.tolist() == [[[800.0, 700.0]]] and least.error == pytest.approx(0.1 * least.load)


def test_letters_go_on_behind_z() -> None:
    assert [letters(k) for k in (0, 25, 26, 27, 52)] == ["A", "Z", "AA", "AB", "BA"]
