from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from pmr.errors import InputError
from pmr.models.mesh_drawing import graded_nodes, read_nodes


@pytest.mark.parametrize("grading", [0.1, 1.0, 8.0])
def test_grading_is_the_ratio_of_last_to_first_element(grading: float) -> None:
    nodes = graded_nodes(5.0, 9, grading)
    h = np.diff(nodes)
    assert len(nodes) == 10 and nodes[0] == 0.0 and nodes[-1] == pytest.approx(5.0)
    assert h[-1] / h[0] == pytest.approx(grading)
    assert h[1:] / h[:-1] == pytest.approx(np.full(8, grading ** (1 / 8)))


def write(file: Path, x, cells, kind: str = "line", y: float = 0.0, form: str = "vtu") -> Path:
    points = np.zeros((len(x), 3))
    points[:, 0], points[-1, 1] = x, y
    meshio.write(file, meshio.Mesh(points, [(kind, np.array(cells))]), file_format=form)
    return file


@pytest.mark.parametrize(("suffix", "form"), [("vtu", "vtu"), ("msh", "gmsh"), ("inp", "abaqus")])
def test_nodes_are_read_in_any_order(tmp_path: Path, suffix: str, form: str) -> None:
    file = write(tmp_path / f"beam.{suffix}", [5.0, 0.0, 1.0, 2.5], [[2, 3], [1, 2], [3, 0]], form=form)
    assert read_nodes(file, 5.0).tolist() == [0.0, 1.0, 2.5, 5.0]


@pytest.mark.parametrize(
    ("x", "cells", "kind", "y", "says"),
    [
        ([0, 1, 5], [[0, 1, 2]], "triangle", 0.0, "cells of type triangle"),
        ([0, 2, 5], [[0, 1], [1, 2]], "line", 0.1, "off the x axis"),
        ([0, 2, 4], [[0, 1], [1, 2]], "line", 0.0, "nodes from 0 to 4 m, but the beam has 5 m from 0"),
        ([0, 2, 2, 5], [[0, 1], [2, 3]], "line", 0.0, "two nodes at one place"),
        ([0, 2, 3, 5], [[0, 1], [2, 3]], "line", 0.0, "no single chain"),
        ([0, 2, 3, 5], [[0, 1], [1, 2], [0, 3]], "line", 0.0, "no single chain"),
        ([0, np.nan, 5], [[0, 1], [1, 2]], "line", 0.0, "not finite"),
        ([0, 2, 5], [[0, 1], [1, 2], [2, 1]], "line", 0.0, "3 lines on 3 nodes that form no single chain"),
    ],
)
def test_what_is_no_beam_is_refused_with_what_was_found(tmp_path: Path, x, cells, kind, y, says: str) -> None:
    file = write(tmp_path / "beam.vtu", x, cells, kind, y)
    with pytest.raises(InputError, match=says):
        read_nodes(file, 5.0)


def test_a_file_that_meshio_cannot_read_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "beam.vtu"
    file.write_text("no mesh")
    with pytest.raises(InputError, match="meshio can't read it"):
        read_nodes(file, 5.0)
