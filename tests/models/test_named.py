from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from pmr.errors import InputError
from pmr.models.named_mesh import read_mesh

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]], float)
TRIANGLES = [[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]]
CUBE = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)


def write(file: Path, points, cells, groups=None, form: str = "gmsh22") -> Path:
    """`groups`: name to (block, members); every entity belongs to at most one."""
    groups = groups or {}
    physical = [np.zeros(len(block), int) for _, block in cells]
    field_data = {}
    dims = {"vertex": 0, "line": 1, "triangle": 2, "quad": 2, "triangle6": 2, "tetra": 3, "hexahedron": 3}
    for number, (name, (block, members)) in enumerate(groups.items(), 1):
        physical[block][members] = number
        field_data[name] = np.array([number, dims[cells[block][0]]])
    mesh = meshio.Mesh(
        np.asarray(points, float),
        [(kind, np.array(block)) for kind, block in cells],
        cell_data={"gmsh:physical": physical, "gmsh:geometrical": physical},
        field_data=field_data,
    )
    meshio.write(file, mesh, file_format=form, **({"binary": False} if form.startswith("gmsh") else {}))
    return file


def plate(tmp_path: Path, points=SQUARE, triangles=None, extra=(), groups=None) -> Path:
    lines = ("line", [[0, 3], [4, 5]])
    groups = groups or {"tail": (1, [0]), "tip": (1, [1]), "near": (0, [0, 1])}
    return write(tmp_path / "m.msh", points, [("triangle", triangles or TRIANGLES), lines, *extra], groups)


def test_a_mesh_is_read_with_its_groups(tmp_path: Path) -> None:
    mesh = read_mesh(plate(tmp_path), ("triangle",), ("tail", "tip"))
    assert mesh.cell == "triangle" and len(mesh.cells) == 4
    assert np.all(np.diff(mesh.points[:, 0]) >= 0.0)  # numbered along the longest extent
    assert {name: group.dim for name, group in mesh.groups.items()} == {"tail": 1, "tip": 1, "near": 2}
    assert mesh.points[mesh.groups["tip"].entities].tolist() == [[[2, 0, 0], [2, 1, 0]]]
    assert mesh.regions["near"].tolist() == [0, 1]
    assert mesh.points[mesh.groups["near"].entities][:, :, 0].max() == 1.0


def test_points_that_no_cell_uses_are_left_out(tmp_path: Path) -> None:
    mesh = read_mesh(plate(tmp_path, points=np.vstack([SQUARE, [[9, 9, 9]]])), ("triangle",))
    assert len(mesh.points) == 6


def test_a_cell_may_belong_to_several_groups(tmp_path: Path) -> None:
    """Format 2 of gmsh lists it once for each of them."""
    groups = {"near": (0, [0, 1]), "all": (0, [2, 3, 4, 5]), "tail": (1, [0])}
    mesh = read_mesh(plate(tmp_path, triangles=TRIANGLES[:2] + TRIANGLES, groups=groups), ("triangle",))
    assert len(mesh.cells) == 4
    assert mesh.regions["near"].tolist() == [0, 1] and mesh.regions["all"].tolist() == [0, 1, 2, 3]


def test_hexahedra_come_in_the_order_of_a_tensor_product(tmp_path: Path) -> None:
    file = write(tmp_path / "m.vtu", CUBE, [("hexahedron", [list(range(8))])], form="vtu")
    mesh = read_mesh(file, ("hexahedron",))
    corners = mesh.points[mesh.cells[0]]
    assert np.array_equal(corners[1] - corners[0], [1, 0, 0]) and np.array_equal(corners[2] - corners[0], [0, 1, 0])
    assert np.array_equal(corners[3], [1, 1, 0]) and np.array_equal(corners[7], [1, 1, 1])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"groups": {"tail": (1, [0])}}, "no group named tip; found: tail"),
        (
            {"extra": [("tetra", [[0, 1, 2, 4]]), ("hexahedron", [[0, 1, 2, 3, 4, 5, 1, 0]])]},
            "mixed cells: hexahedron, tetrahedron",
        ),
        ({"extra": [("tetra", [[0, 1, 2, 4]])]}, "cells of kind tetrahedron; cells of kind triangle are allowed"),
        ({"triangles": [[0, 1, 2], [0, 2, 3], [1, 4, 4], [1, 5, 2]]}, "1 of 4 cells are degenerate"),
        ({"triangles": [[0, 2, 3], [1, 4, 5]]}, "2 parts that share no edges"),
        ({"points": SQUARE * [1, np.nan, 1]}, "not finite"),
        (
            {"points": np.where(np.arange(6)[:, None] == 3, [0.9, 0.1, 0.0], SQUARE)},
            "1 pairs of .* folded on each other",
        ),
    ],
)
def test_what_is_unfit_is_refused_with_what_was_found(tmp_path: Path, change, says: str) -> None:
    with pytest.raises(InputError, match=says):
        read_mesh(plate(tmp_path, **change), ("triangle",), ("tail", "tip"))


@pytest.mark.parametrize(
    ("kind", "points", "cell", "says"),
    [
        ("tetra", CUBE[[0, 1, 3, 4]], [0, 2, 1, 3], "1 of 1 cells are inverted"),
        ("hexahedron", CUBE, [4, 5, 6, 7, 0, 1, 2, 3], "1 of 1 cells are inverted"),
        ("hexahedron", CUBE - 1.5 * np.eye(8)[:, 6:7], list(range(8)), "inverted .negative volume at a corner"),
        ("triangle6", SQUARE, [0, 1, 2, 3, 4, 5], "cells of type triangle6; linear cells are allowed"),
    ],
)
def test_inverted_and_curved_cells_are_refused(tmp_path: Path, kind, points, cell, says: str) -> None:
    file = write(tmp_path / "m.vtu", points, [(kind, [cell])], form="vtu")
    with pytest.raises(InputError, match=says):
        read_mesh(file, ("tetrahedron", "hexahedron"))


def test_a_file_that_is_no_mesh_is_refused(tmp_path: Path) -> None:
    (tmp_path / "m.msh").write_text("no mesh")
    with pytest.raises(InputError, match="meshio can't read it"):
        read_mesh(tmp_path / "m.msh", ("triangle",))
