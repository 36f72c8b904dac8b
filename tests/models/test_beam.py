from pathlib import Path

import meshio
import numpy as np
import pytest
from textbook import EI, RHO_A, beam_matrices

from pmr import InputError
from pmr.fullmodel.pads import slider_row
from pmr.models.beam2d import Beam2D
from pmr.models.mesh_drawing import graded_nodes, read_nodes
from pmr.scene.structures import Profile


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
        ([0, 2, 2, 5], [[0, 1], [2, 3]], "line", 0.0, "no single chain"),
        ([0, 2, 3, 5], [[0, 1], [2, 3]], "line", 0.0, "no single chain"),
        ([0, 2, 3, 5], [[0, 1], [1, 2], [0, 3]], "line", 0.0, "no single chain"),
        ([0, np.nan, 5], [[0, 1], [1, 2]], "line", 0.0, "no single chain"),
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


NODES = np.array([0.0, 0.5, 0.8, 2.0, 3.1])


def beam(axial: bool = True, nodes: np.ndarray = NODES) -> Beam2D:
    body = Profile(length=nodes[-1], bending_stiffness=EI, mass_per_length=RHO_A, axial_stiffness=2e7, axial=axial)
    return Beam2D(body, nodes)


def interpolated(model: Beam2D, function, slope) -> np.ndarray:
    """Coordinates of the Hermite interpolant of a deflection."""
    q = np.zeros(model.size)
    for i, x in enumerate(model.nodes):
        start = len(model.directions) * i + len(model.directions) - 2
        q[start], q[start + 1] = function(x), slope(x)
    return q


@pytest.mark.parametrize("axial", [True, False])
@pytest.mark.parametrize("x", [0.0, 0.3, 0.5, 1.99, 2.0, 2.7, 3.1])
def test_a_point_row_is_exact_for_cubics(axial: bool, x: float) -> None:
    model = beam(axial)
    cubic = np.array([0.3, -1.0, 0.7, 2.0])
    q = interpolated(model, lambda z: np.polyval(cubic, z), lambda z: np.polyval(np.polyder(cubic), z))
    moved = dict(zip(model.directions, model.motion(x) @ q, strict=True))
    for direction, expected in (("z", np.polyval(cubic, x)), ("ry", -np.polyval(np.polyder(cubic), x))):
        assert moved[direction] == pytest.approx(expected, abs=1e-13)


def test_a_point_row_at_a_node_is_that_nodes_coordinate() -> None:
    row = beam().motion(0.8)[1]
    assert row.indices.tolist() == [7] and row.data.tolist() == [1.0]


def test_axial_displacement_is_interpolated_linearly() -> None:
    row = beam().motion(1.4)[0]
    assert row.indices.tolist() == [6, 9] and row.data == pytest.approx([0.5, 0.5])


@pytest.mark.parametrize("offset", [0.0, 0.25])
def test_the_slider_row_is_the_point_row_at_every_s(offset: float) -> None:
    model = beam()
    row = slider_row(model, offset)
    assert row.breaks == pytest.approx(NODES - offset)
    for s in np.linspace(-offset, NODES[-1] - offset, 57):
        expected = model.motion(min(s + offset, NODES[-1])).toarray()[1]
        assert np.abs(row.at(s).toarray()[0] - expected).max() < 1e-14


def test_the_slider_row_has_a_continuous_slope_across_nodes() -> None:
    model = beam()
    row, rng = slider_row(model), np.random.default_rng(0)
    q = rng.standard_normal(model.size)
    for node in NODES[1:-1]:
        left, right = (row.apply(np.array([node + side]), q[None], derivative=1)[0] for side in (-1e-9, 1e-9))
        assert left == pytest.approx(right, abs=1e-6)
        assert right == pytest.approx(-(model.motion(node) @ q)[2], abs=1e-6)


def test_the_textbook_oracle_bends_like_a_beam() -> None:
    """Cantilever under a tip force: F L^3 / (3 EI), exact at nodes of any mesh."""
    _, K = beam_matrices(NODES)
    F = np.zeros(len(K))
    F[-2] = 10.0
    q = np.linalg.solve(K[3:, 3:], F[3:])
    assert q[-2] == pytest.approx(10.0 * 3.1**3 / (3.0 * EI), rel=1e-10)


def test_a_few_short_elements_leave_less_round_off_than_many() -> None:
    coarse, fine, finest = (beam(nodes=np.linspace(0.0, 5.0, n + 1)).round_off for n in (20, 40, 2000))
    assert fine == pytest.approx(16.0 * coarse)
    one_short = np.unique([*np.linspace(0.0, 5.0, 21), 2.5 + 5.0 / 2000])
    assert beam(nodes=one_short).round_off == pytest.approx(finest / 2000, rel=0.01)
