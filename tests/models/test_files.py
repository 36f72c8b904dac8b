"""Mesh files: what is not read, and cells without points, are refused in a line of ours."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from pmr import InputError
from pmr.models.mesh_file import read_mesh_file
from pmr.models.named_mesh import read_mesh

DECK = """*NODE
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., 1., 0.
4, 0., 1., 0.
*ELEMENT, TYPE=S3, ELSET=Low
1, 1, 2, 3
*ELEMENT, TYPE=S3
2, 1, 3, 4
*ELEMENT, TYPE=T3D2, ELSET=tail
3, 4, 1
*ELSET, ELSET=Both, GENERATE
1, 2
"""


def written(folder: Path, text: str, name: str = "plate.inp") -> Path:
    (folder / name).write_text(text)
    return folder / name


def test_a_deck_is_read_as_cells_and_groups(tmp_path: Path) -> None:
    read = read_mesh_file(written(tmp_path, DECK))
    assert [(block.kind, block.corners.tolist()) for block in read.blocks] == [
        ("triangle", [[0, 1, 2]]),
        ("triangle", [[0, 2, 3]]),
        ("line", [[3, 0]]),
    ]
    groups = {name: [part.tolist() for part in parts] for name, parts in read.groups.items()}
    assert groups == {"Low": [[0], [], []], "tail": [[], [], [0]], "Both": [[0], [0], []]}
    mesh = read_mesh(tmp_path / "plate.inp", ("triangle",))
    assert len(mesh.cells) == 2 and len(mesh.regions["Low"]) == 1


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("*NODE", "*INCLUDE, INPUT=a.inp\n*NODE", "line 1: INPUT=a.inp: no such file"),
        ("*NODE", "*MPC\nBEAM, 1, 2\n*NODE", "line 1: *MPC is not read"),
        ("1, 1, 2, 3", "1, 1, 2, 9", "line 7: element 1 has node 9, which is not in the file"),
        ("*ELSET", "*NODE\n1, 5., 0., 0.\n*ELSET", "line 13: node 1 is there a second time"),
        ("TYPE=T3D2", "TYPE=T3D3", "line 11: element 3 of type T3D3 has too few nodes"),
        ("*NODE", "*NODE, SYSTEM=Q", "line 1: SYSTEM=Q is not read; R, C (cylindrical) and S (spherical) are allowed"),
    ],
)
def test_a_deck_that_is_not_read_is_refused_by_its_line(old: str, new: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read_mesh(written(tmp_path, DECK.replace(old, new, 1)), ("triangle",))
    assert f"plate.inp: {says}" in str(caught.value) and len(str(caught.value).splitlines()) == 1


def test_a_mesh_of_instances_is_that_of_one_deck(tmp_path: Path) -> None:
    """The plate, and the same as a part in a file of its own, written turned about x and moved, and put back."""
    whole = read_mesh_file(written(tmp_path, DECK))
    turned = DECK
    for k, (x, y) in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)], 1):  # (x, y, 0) was at (x - 2, 0, y)
        turned = turned.replace(f"{k}, {x}., {y}., 0.", f"{k}, {x - 2}., 0., {y}.")
    written(tmp_path, f"*PART, NAME=plate\n{turned}*END PART\n", "part.inc")
    placed = "*INSTANCE, NAME=p, PART=plate\n2., 0., 0.\n0., 0., 0., 1., 0., 0., -90.\n*END INSTANCE\n"
    split = read_mesh_file(written(tmp_path, f"*INCLUDE, INPUT=part.inc\n{placed}", "assembly.inp"))
    assert split.points == pytest.approx(whole.points, abs=1e-15)
    assert [block.corners.tolist() for block in split.blocks] == [block.corners.tolist() for block in whole.blocks]
    groups = [{name: [part.tolist() for part in parts] for name, parts in one.groups.items()} for one in (split, whole)]
    assert groups[0] == groups[1]


@pytest.mark.parametrize("corner", [7, -1])
def test_cells_with_corners_that_are_no_points_are_refused(corner: int, tmp_path: Path) -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    file = tmp_path / "plate.vtk"
    meshio.write(file, meshio.Mesh(points, [("triangle", np.array([[0, 1, 2]]))]), binary=False)
    text = file.read_text()
    assert text.count("0\n1\n2\n") == 1
    file.write_text(text.replace("0\n1\n2\n", f"0\n1\n{corner}\n"))
    with pytest.raises(InputError, match="1 cells of kind triangle have corners that are no points of it"):
        read_mesh(file, ("triangle",))


GMSH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
1 5 "tail"
$EndPhysicalNames
$Nodes
3
1 0 0 0
2 1 0 0
3 1 1 0
$EndNodes
$Elements
2
1 1 2 0 1 1 2
2 2 2 0 1 1 2 3
$EndElements
"""


def test_groups_that_gmsh_left_out_are_said_to_be(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="group tail holds no cells; gmsh with Mesh.SaveAll leaves groups out"):
        read_mesh(written(tmp_path, GMSH, "all.msh"), ("triangle",))


@pytest.mark.parametrize(
    "text",
    [
        "$MeshFormat\n",
        "$MeshFormat\n4 0 8\n$EndMeshFormat\n",
        "$NOD\n1\n1 0 0 0\n$ENDNOD\n",
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PartitionedEntities\n",
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 1 1 1\n0 1 1 1\n1\n0 0\n",
    ],
)
def test_a_file_of_gmsh_that_is_not_read_says_how_to_save_it(text: str, tmp_path: Path) -> None:
    options = ".*version 4.1 or 2.2 .*SaveAll = 0.*NbPartitions = 0.*SaveParametric = 0"
    with pytest.raises(InputError, match=f"m.msh: meshio can't read it; {options}"):
        read_mesh(written(tmp_path, text, "m.msh"), ("triangle",))


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
    mesh = read_mesh(plate(tmp_path), ("triangle",))
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
        ({"extra": [("tetra", [[0, 1, 2, 4]]), ("hexahedron", [[0, 1, 2, 3, 4, 5, 1, 0]])]},
         "mixed cells: hexahedron, tetrahedron"),
        ({"extra": [("tetra", [[0, 1, 2, 4]])]}, "cells of kind tetrahedron; cells of kind triangle are allowed"),
        ({"triangles": [[0, 1, 2], [0, 2, 3], [1, 4, 4], [1, 5, 2]]}, "1 of 4 cells are degenerate"),
        ({"triangles": [[0, 2, 3], [1, 4, 5]]}, "2 parts that share no edges"),
        ({"points": SQUARE * [1, np.nan, 1]}, "not finite"),
        ({"points": np.where(np.arange(6)[:, None] == 3, [0.9, 0.1, 0.0], SQUARE)},
         "1 pairs of .* folded on each other"),
    ],
)  # fmt: skip
def test_what_is_unfit_is_refused_with_what_was_found(tmp_path: Path, change, says: str) -> None:
    with pytest.raises(InputError, match=says):
        read_mesh(plate(tmp_path, **change), ("triangle",)).require(("tail", "tip"))


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
