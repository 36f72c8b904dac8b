from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from pmr.results import Fields
from pmr.results.field_series import Grid
from pmr.results.field_stress import FIBRE, PLANE, SPATIAL, StressRows, peaks_by_region, stress_history

#: Components of a pull along the first axis and of a shear, and the ones of pressure from all sides.
FORMS = {"plane": (PLANE, 2), "spatial": (SPATIAL, 5), "fibre": (FIBRE, 1)}


def rows(mises: np.ndarray, cell=(0, 1, 1), faces=("outer", "inner"), face=(0, 0, 1)) -> StressRows:
    c = len(mises)
    points = np.arange(3.0 * len(cell)).reshape(-1, 3)
    names = tuple("abcdef"[:c])
    return StressRows(sp.eye(c * len(cell), format="csr"), mises, names, points, np.array(cell), faces, np.array(face))


@pytest.mark.parametrize("form", FORMS)
def test_von_mises_of_tension_and_of_shear(form: str) -> None:
    mises, shear = FORMS[form]
    found = rows(mises)
    q = np.zeros((2, 3, len(mises)))
    q[0, 0, 0], q[1, 1, shear], q[1, 2, [0, shear]] = -7.0, 2.0, [3.0, 4.0]
    expected = [[7.0, 0.0, 0.0], [0.0, np.sqrt(12.0), np.sqrt(9.0 + 48.0)]]
    assert found.von_mises(found.evaluate(q.reshape(2, -1))) == pytest.approx(np.array(expected))


def test_pressure_from_all_sides_is_no_stress_of_von_mises() -> None:
    q = np.concatenate([np.full(3, 5.0), np.zeros(3)])
    assert rows(SPATIAL, cell=(0,), face=(0,)).von_mises(q.reshape(1, 1, 6)) == pytest.approx(0.0, abs=1e-7)
    both = np.array([2.0, 2.0, 0.0]).reshape(1, 1, 3)
    assert rows(PLANE, cell=(0,), face=(0,)).von_mises(both) == pytest.approx(2.0)


def test_a_cell_without_a_face_shows_what_it_has() -> None:
    found = rows(PLANE).by_cell(np.array([[1.0, 2.0, 9.0], [4.0, 5.0, 3.0]]), cells=2)
    assert found["outer"].tolist() == [[1.0, 2.0], [4.0, 5.0]] and found["inner"].tolist() == [[1.0, 9.0], [4.0, 3.0]]


def test_several_points_of_a_cell_give_their_largest() -> None:
    found = rows(PLANE, cell=(0, 0, 1), faces=("outer",), face=(0, 0, 0)).by_cell(np.array([[3.0, 1.0, 2.0]]), cells=2)
    assert found["outer"].tolist() == [[3.0, 2.0]]


def test_the_peak_says_when_and_where() -> None:
    grid = Grid(
        "triangle", np.zeros((4, 3)), np.array([[0, 1, 2], [1, 2, 3]]), {"top": np.array([1]), "all": np.arange(2)}
    )
    t, largest, point = np.array([0.0, 0.5, 1.0]), np.array([1.0, 7.0, 3.0]), np.array([0, 2, 1])
    peak = stress_history(rows(PLANE), grid, t, largest, point).peak
    assert (peak.value, peak.t, peak.cell, peak.face, peak.region) == (7.0, 0.5, 1, "inner", "all, top")
    assert peak.position == (6.0, 7.0, 8.0)
    assert peak.summary()["position"] == [6.0, 7.0, 8.0] and set(peak.summary()) == set(vars(peak))
    assert peak.shared == ()


@pytest.mark.parametrize("round_off", [-1e-12, 0.0, 1e-12])
def test_a_peak_that_places_share_names_them_all(round_off: float) -> None:
    """The first one leads, whichever is larger by round-off; a point that two cells have in common counts once."""
    grid = Grid("triangle", np.zeros((4, 3)), np.array([[0, 1, 2], [1, 2, 3]]), {})
    four = rows(PLANE, cell=(0, 0, 1, 1), face=(0, 0, 0, 1))
    four.points[2] = four.points[1]
    at_peak = np.array([3.0, 7.0, 7.0, 7.0 * (1.0 + round_off)])
    t, largest, point = np.array([0.0, 0.5]), np.array([1.0, at_peak.max()]), np.array([0, int(at_peak.argmax())])
    peak = stress_history(four, grid, t, largest, point, at_peak).peak
    assert (peak.position, peak.cell, peak.t) == ((3.0, 4.0, 5.0), 0, 0.5)
    assert peak.shared == ((9.0, 10.0, 11.0),) and peak.summary()["shared"] == [[9.0, 10.0, 11.0]]
    at_peak[3] *= 0.999
    alone = stress_history(four, grid, t, np.array([1.0, 7.0]), np.array([0, 1]), at_peak).peak
    assert alone.shared == ()


def test_each_region_has_the_largest_stress_of_its_points() -> None:
    cells = {"a": [0], "b": [0, 1], "without points": [2]}
    grid = Grid("triangle", np.zeros((3, 3)), np.zeros((3, 3), int), {name: np.array(of) for name, of in cells.items()})
    found = peaks_by_region(rows(PLANE), grid, np.array([5.0, 7.0, 9.0]), np.array([0.1, 0.2, 0.3]))
    assert {name: (peak.value, peak.t, peak.cell, peak.face) for name, peak in found.items()} == {
        "a": (5.0, 0.1, 0, "outer"), "b": (9.0, 0.3, 1, "inner"),
    }  # fmt: skip
    assert found["b"].position == (6.0, 7.0, 8.0)


def test_signed_stresses_are_those_of_the_point_with_the_largest_von_mises() -> None:
    """Two points of the second cell share a face: the one that is pressed harder counts, with its sign."""
    found = rows(PLANE, face=(0, 0, 0), faces=("outer",))
    stresses = np.zeros((2, 3, 3))
    stresses[:, :, 0] = [[1.0, 2.0, -9.0], [4.0, -5.0, 3.0]]
    signed = found.components_by_cell(stresses, cells=2)
    assert signed["outer a"].tolist() == [[1.0, -9.0], [4.0, -5.0]]
    assert signed["outer b"].tolist() == [[0.0, 0.0], [0.0, 0.0]]
    mises = found.by_cell(found.von_mises(stresses), cells=2)["outer"]
    assert np.allclose(np.abs(signed["outer a"]), mises)


def test_a_cell_without_a_face_shows_the_signed_stress_that_it_has() -> None:
    stresses = np.zeros((1, 3, 3))
    stresses[0, :, 0] = [-1.0, 2.0, -3.0]
    signed = rows(PLANE).components_by_cell(stresses, cells=2)
    assert (signed["outer a"].tolist(), signed["inner a"].tolist()) == ([[-1.0, 2.0]], [[-1.0, -3.0]])


def test_fields_are_read_as_they_were_written(tmp_path: Path) -> None:
    grid = Grid("line", np.eye(3), np.array([[0, 1], [1, 2]]), {"first half": np.array([0])})
    cells = {"top left": np.array([[1.0, 2.0]], np.float32)}
    fields = Fields(grid, np.array([0.5]), np.ones((1, 3, 3), np.float32), cells)
    fields.save(tmp_path / "fields.npz")
    found = Fields.load(tmp_path / "fields.npz")
    assert found.grid.cell == "line" and found.grid.region_names(0) == "first half" and found.grid.region_names(1) == ""
    assert np.array_equal(found.grid.points, grid.points) and np.array_equal(found.grid.cells, grid.cells)
    assert np.array_equal(found.t, fields.t) and np.array_equal(found.displacement, fields.displacement)
    assert found.displacement.dtype == np.float32
    assert found.von_mises.keys() == cells.keys()
    assert np.array_equal(found.von_mises["top left"], cells["top left"])
