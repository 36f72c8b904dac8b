from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
from boom_results import MakeSpace, make_fields, make_space  # noqa: F401 fixtures

from pmr.export.paraview import MovingFields, pads_over_time, write_series
from pmr.results import Fields
from pmr.results.field_series import Boxes, Grid

POINTS = np.random.default_rng(1).normal(size=(8, 3))
CELLS = {
    "line": [[0, 1], [1, 2], [2, 7]],
    "triangle": [[0, 1, 2], [1, 2, 3]],
    "tetra": [[0, 1, 2, 4]],
    "hexahedron": [[0, 1, 2, 3, 4, 5, 6, 7]],
}


def fields(cell: str, times: int = 3) -> Fields:
    grid = Grid(cell, POINTS, np.array(CELLS[cell]), {"some": np.array([0])})
    values = np.random.default_rng(2).normal(size=(times, 8, 3)).astype(np.float32)
    stress = {face: 1e8 * np.abs(values[:, : len(grid.cells), k]) for k, face in enumerate(("outer", "inner"))}
    signed = {"outer along": -stress["outer"]}
    return Fields(grid, 0.1 * np.arange(times), values, stress, signed)


@pytest.mark.parametrize("cell", CELLS)
def test_a_series_is_read_back(tmp_path: Path, cell: str) -> None:
    written = fields(cell)
    listing = write_series(tmp_path, "boom", {"": MovingFields(written)})
    assert listing == tmp_path / "boom.pvd"
    sets = ElementTree.parse(listing).getroot().findall("Collection/DataSet")
    assert [float(s.attrib["timestep"]) for s in sets] == written.t.tolist()
    for k, entry in enumerate(sets):
        mesh = meshio.read(tmp_path / entry.attrib["file"])
        assert np.array_equal(mesh.points, POINTS)
        assert [block.type for block in mesh.cells] == [cell] and np.array_equal(mesh.cells[0].data, CELLS[cell])
        assert np.array_equal(mesh.point_data["displacement"], written.displacement[k])
        assert {name: parts[0].tolist() for name, parts in mesh.cell_data.items()} == {
            f"von_mises_{name}": values[k].tolist() for name, values in written.von_mises.items()
        } | {
            "stress_outer_along": written.stress["outer along"][k].tolist(),
            "region_some": [1, *[0] * (len(CELLS[cell]) - 1)],
        }


def test_the_body_stands_where_it_is_beside_its_pads(tmp_path: Path) -> None:
    written, s = fields("triangle"), np.array([1.5, 2.0, 2.5])
    corners = np.random.default_rng(3).normal(size=(3, 2, 8, 3))
    pads = Boxes(("a", "b"), corners, {"force": np.array([[1.0, 2.0], [3.0, 4.0], [5.0, np.nan]])})
    sets = (
        ElementTree.parse(write_series(tmp_path, "boom", {"": MovingFields(written, -s)}, pads))
        .getroot()
        .findall("Collection/DataSet")
    )
    assert [(entry.attrib["part"], float(entry.attrib["timestep"])) for entry in sets] == [
        (part, t) for t in written.t.tolist() for part in ("0", "1")
    ]
    body, boxes = (meshio.read(tmp_path / entry.attrib["file"]) for entry in sets[-2:])
    assert np.allclose(body.points - POINTS, (-2.5, 0.0, 0.0), rtol=0.0, atol=1e-15)
    assert np.array_equal(boxes.points.reshape(2, 8, 3), corners[2])
    assert np.array_equal(boxes.cell_data["force"][0], (5.0, np.nan), equal_nan=True)
    assert boxes.cell_data["pad"][0].tolist() == [0, 1]


def test_a_shorter_series_leaves_nothing_of_a_longer_one(tmp_path: Path) -> None:
    for times in (3, 2):
        write_series(tmp_path, "boom", {"": MovingFields(fields("triangle", times))})
    assert sorted(file.name for file in (tmp_path / "boom").iterdir()) == ["00000.vtu", "00001.vtu"]


@pytest.mark.parametrize("kind", ["line", "triangle"])
def test_a_boom_in_a_frame_stands_where_that_is_in_space(
    tmp_path: Path,
    make_space: MakeSpace,  # noqa: F811
    make_fields: Callable[[str], Fields],  # noqa: F811
    kind: str,
) -> None:
    """Every place is pivot + R(t) (x + u), every displacement R(t) u; the pads that move are where the mouth is."""
    luffing, slewing = np.deg2rad(50.0), np.deg2rad(-30.0)
    frame = {"pivot": [0.5, 0.0, -0.3], "unit": "degrees", "luffing": 50.0, "slewing": -30.0}
    result = make_space(fields=make_fields(kind), frame=frame)
    ((fields, along),) = result.moving_fields.values()
    bodies = {"": MovingFields(fields, along, result.pose(fields.t))}
    sets = (
        ElementTree.parse(write_series(tmp_path, "boom", bodies, pads_over_time(result)))
        .getroot()
        .findall("Collection/DataSet")
    )
    ahead = np.array([np.cos(luffing) * np.cos(slewing), np.cos(luffing) * np.sin(slewing), np.sin(luffing)])
    left = np.array([-np.sin(slewing), np.cos(slewing), 0.0])
    turned = np.stack([ahead, left, np.cross(ahead, left)])  # rows: the boom's axes in space
    tip = int(np.argmax(fields.points[:, 0]))
    for k in (0, 10, 20):
        body, boxes = (meshio.read(tmp_path / entry.attrib["file"]) for entry in sets[2 * k : 2 * k + 2])
        u = fields.displacement[k].astype(float)
        assert body.points == pytest.approx((fields.points + [0.5, 0.0, -0.3]) @ turned, abs=1e-14)
        assert body.point_data["displacement"] == pytest.approx(u @ turned, abs=1e-9)  # in single precision
        moved = (body.points + body.point_data["displacement"])[tip]
        assert moved == pytest.approx((fields.points[tip] + u[tip] + [0.5, 0.0, -0.3]) @ turned, abs=1e-9)
        centres = boxes.points.reshape(-1, 8, 3).mean(axis=1) @ turned.T - [0.5, 0.0, -0.3]
        rings = np.unique(centres[:, 0].round(9))
        assert rings == pytest.approx(sorted({0.15, -along[k]}), abs=1e-9)  # tail and mouth, from the body's tail


@pytest.mark.slow
def test_vtk_opens_a_series(tmp_path: Path) -> None:
    pyvista = pytest.importorskip("pyvista")
    written = fields("triangle")
    reader = pyvista.get_reader(str(write_series(tmp_path, "boom", {"": MovingFields(written)})))
    assert reader.time_values == pytest.approx(written.t.tolist())
    reader.set_active_time_value(reader.time_values[2])
    mesh = reader.read()[0]
    assert np.array_equal(mesh.point_data["displacement"], written.displacement[2])
    assert np.array_equal(mesh.cell_data["von_mises_inner"], written.von_mises["inner"][2])
