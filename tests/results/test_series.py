from __future__ import annotations

from pathlib import Path

import numpy as np

from pmr.results.field_series import Fields, Grid


def test_fields_are_read_as_they_were_written(tmp_path: Path) -> None:
    grid = Grid("line", np.eye(3), np.array([[0, 1], [1, 2]]), {"first half": np.array([0])})
    cells = {"top left": np.array([[1.0, 2.0]], np.float32)}
    fields = Fields(grid, np.array([0.5]), np.ones((1, 3, 3), np.float32), cells)
    fields.save(tmp_path / "fields.npz")
    found = Fields.load(tmp_path / "fields.npz")
    assert found.grid.cell == "line" and found.grid.region(0) == "first half" and found.grid.region(1) == ""
    assert np.array_equal(found.grid.points, grid.points) and np.array_equal(found.grid.cells, grid.cells)
    assert np.array_equal(found.t, fields.t) and np.array_equal(found.displacement, fields.displacement)
    assert found.displacement.dtype == np.float32
    assert found.von_mises.keys() == cells.keys()
    assert np.array_equal(found.von_mises["top left"], cells["top left"])
