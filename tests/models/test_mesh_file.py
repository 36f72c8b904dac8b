"""Meshes from decks: a boom of two instances beside the same drawn by pmr, and groups by nodes and surfaces."""

import importlib.util
import os
from pathlib import Path

import meshio
import numpy as np
import pytest
from deck_boom import ACROSS, ALONG, HEIGHT, LENGTH, UP, WALL, WIDTH, write_boom
from fuzz.mutations import scratched

import pmr
from pmr import InputError
from pmr.files.decks import read_deck
from pmr.fullmodel.build import warnings
from pmr.fullmodel.from_scene import structure_of
from pmr.models import StructuralModel
from pmr.models.mesh_file import read_mesh_file
from pmr.models.named_mesh import add_faces, read_mesh
from pmr.models.trace import Window
from pmr.scene.built import FaceNormal
from pmr.scene.members import members

FACES = "{ bottom = [-0.1, 0.1], top = [-0.1, 0.1], left = [0.0], right = [0.0] }"
SCENE = f"""
title = "Boom"
start = "equilibrium"
pads = [{{ name = "tail", at = 0.25, faces = {FACES} }}, {{ name = "mouth", moving = true, faces = {FACES} }}]
supports = [{{ name = "cylinder", directions = ["x"] }}]
slider.path = {{ kind = "smooth_ramp", times = [0.0, 0.02], values = [1.2, 1.3] }}
loads = [{{ name = "tip force", on = "tip", direction = "z", signal = -2000.0 }}]
gravity = {{}}
time = {{ end = 0.02, step = 1e-3 }}
reduction = {{ coordinates = 8, estimate = false }}
observe = {{ start = 0.2, end = 2.8 }}
compare.against = []
"""
DRAWN = f"""
body = {{ model = "shell", box = {{ length = {LENGTH}, width = {WIDTH}, height = {HEIGHT}, wall = {WALL} }} }}
mesh = {{ size = {WIDTH / ACROSS}, along = {LENGTH / 2 / ALONG} }}
"""
READ = f"""
body = {{ model = "shell", thickness = {WALL} }}
mesh.file = "boom.inp"
"""


@pytest.mark.slow
def test_a_boom_of_two_instances_is_the_one_that_pmr_draws(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Frequencies, motion of the tip and mass: the cells are the same."""
    pytest.importorskip("gmsh")
    assert UP == round(HEIGHT / (WIDTH / ACROSS))  # as many cells up a side as pmr draws
    write_boom(tmp_path)
    results = []
    for name, body in (("deck", READ), ("drawn", DRAWN)):
        (tmp_path / f"{name}.toml").write_text(SCENE + body)
        results.append(pmr.run(pmr.load_scene(tmp_path / f"{name}.toml")).result)
    read, drawn = results
    assert read.summary["coordinates"] == drawn.summary["coordinates"]
    frequencies = [result.frequencies.models["reduced"] for result in results]
    np.testing.assert_allclose(frequencies[0], frequencies[1], rtol=1e-8)
    tips = [result.responses["reduced"].tip for result in results]
    np.testing.assert_allclose(tips[0], tips[1], rtol=0.0, atol=1e-8 * np.abs(tips[1]).max())
    assert read.summary["masses"][0]["mass"] == pytest.approx(drawn.summary["masses"][0]["mass"], rel=1e-10)
    assert caplog.text.count("without effect in a mesh") == 1


def test_groups_of_a_deck_are_its_sets_and_surfaces(tmp_path: Path) -> None:
    mesh = read_mesh(write_boom(tmp_path), ("triangle",))
    around = 2 * (ACROSS + UP)
    assert len(mesh.cells) == 4 * around * 2 * ALONG
    assert np.ptp(mesh.points, axis=0) == pytest.approx([LENGTH, WIDTH, HEIGHT], rel=1e-12)
    assert mesh.groups["tail"].dim == mesh.groups["rear.end"].dim == 1
    assert len(mesh.groups["tail"].entities) == len(mesh.groups["tip"].entities) == around
    middle = mesh.points[mesh.groups["rear.end"].entities]
    assert middle[..., 0] == pytest.approx(np.full((around, 2), LENGTH / 2), abs=1e-12)
    bottom = mesh.points[mesh.cells[mesh.regions["bottom"]]]
    assert len(bottom) == 4 * ACROSS * 2 * ALONG and bottom[..., 2] == pytest.approx(-HEIGHT / 2)
    assert not any(name.startswith("_") for name in mesh.groups)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("*TIE, NAME=joint\nfront.begin, rear.end\n", "",
         "half.inc: line 74: the cells form 2 parts that share no edges"),
        ("rear.end", "rear.begin", "line 18: ties of nodes at the same places are allowed: rear.begin has none where"),
        ("rear.end", "rear.side", "line 18: 'rear.side' is no surface of nodes, or of faces of elements, that is read"),
        ("front.begin, rear.end", "rear.end", "line 18: the names of two surfaces are allowed"),
        ("*TIE, NAME=joint", "*EQUATION",
         r"line 17: \*EQUATION is not read; a mesh is allowed whose elements are joined"),
        ("*TIE, NAME=joint", "*CONTACT PAIR", r"line 17: \*CONTACT PAIR is not read"),
        ("*STEP", "*MODEL CHANGE, TYPE=ELEMENT, REMOVE", r"line 22: \*MODEL CHANGE is not read"),
    ],
)  # fmt: skip
def test_what_does_not_join_instances_is_refused(old: str, new: str, says: str, tmp_path: Path) -> None:
    file = write_boom(tmp_path)
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(InputError, match=says) as refused:
        read_mesh(file, ("triangle",))
    assert "\n" not in str(refused.value)


def test_cards_and_bars_without_effect_are_named_with_their_lines(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = write_boom(tmp_path)
    file.write_text(file.read_text().replace("*STEP", "*FOUNDATION\nrear.bottom, F1, 1e6\n*STEP"))
    half = tmp_path / "half.inc"
    half.write_text(
        half.read_text().replace("*ELSET, ELSET=bottom", "*ELEMENT, TYPE=B31\n900, 1, 2\n*ELSET, ELSET=bottom")
    )
    read_mesh(file, ("triangle",))
    said = (
        "thicknesses are the scene's: *BOUNDARY (line 20), *FOUNDATION (line 22), elements B31 (line 135 of half.inc)"
    )
    assert said in caplog.text and "*STEP" not in caplog.text and "*FREQUENCY" not in caplog.text


def test_damaged_decks_are_read_or_refused_in_one_line(tmp_path: Path) -> None:
    """Surfaces, ties, sets and places of instances changed at random."""
    rng, file = np.random.default_rng(7), write_boom(tmp_path)
    text, part = file.read_bytes(), (tmp_path / "half.inc").read_bytes()
    head, sets = part.split(b"*ELSET, ELSET=bottom", 1)
    refused = 0
    for k in range(200 if os.environ.get("PMR_SWEEP") == "full" else 20):
        file.write_bytes(scratched(text, rng) if k % 2 else text)
        (tmp_path / "half.inc").write_bytes(head + scratched(b"*ELSET, ELSET=bottom" + sets, rng))
        try:
            read_mesh(file, ("triangle",))
        except InputError as error:
            refused += 1
            assert len(str(error).splitlines()) == 1
    assert refused > 3


CUBE = [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]  # in the order of C3D8
SIDES = {"S1": (2, 0), "S2": (2, 1), "S3": (1, 0), "S4": (0, 1), "S5": (1, 1), "S6": (0, 0)}


def nodes(points: list[tuple[float, ...]]) -> str:
    return "*NODE\n" + "".join(f"{k}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(points, 1))


def test_faces_of_solids_are_those_of_the_manuals(tmp_path: Path) -> None:
    """Of a cube; a tetrahedron has its fourth node beside face S1, its third one beside S2 and so on."""
    text = nodes(CUBE) + "*ELEMENT, TYPE=C3D8, ELSET=all\n1, 1, 2, 3, 4, 5, 6, 7, 8\n"
    text += "*ELEMENT, TYPE=C3D4, ELSET=tetra\n2, 1, 2, 4, 5\n"
    text += "".join(f"*SURFACE, NAME={side}\nall, {side}\n" for side in SIDES)
    text += "".join(f"*SURFACE, NAME=T{k}\n2, S{k}\n" for k in (1, 2, 3, 4))
    text += "*SURFACE, NAME=whole, TYPE=ELEMENT\nall,\n*SURFACE, NAME=points, TYPE=NODE\n3\n5\n"
    text += "*SURFACE, NAME=round, TYPE=CYLINDER\nSTART, 0., 0.\n*SURFACE, NAME=both, COMBINE=UNION\nS1, S2\n"
    (tmp_path / "cube.inp").write_text(text)
    surfaces = read_deck(tmp_path / "cube.inp").surfaces
    for side, (axis, at) in SIDES.items():
        assert surfaces[side.lower()] == {k for k, point in enumerate(CUBE, 1) if point[axis] == at}
    assert [{1, 2, 4, 5} - surfaces[f"t{k}"] for k in (1, 2, 3, 4)] == [{5}, {4}, {1}, {2}]
    assert surfaces["points"] == {3, 5} and not {"whole", "round", "both"} & {*surfaces}


def test_of_sets_with_one_name_the_edge_of_the_nodes_or_the_cells_are_taken(tmp_path: Path) -> None:
    """A program that draws writes both sets of an edge, and of a wall."""
    file = write_boom(tmp_path)
    around = 2 * (ACROSS + UP)
    both = f"*ELSET, ELSET=tail, INSTANCE=rear, GENERATE\n1, {around}\n*NSET, NSET=bottom, ELSET=bottom\n*TIE, NAME"
    file.write_text(file.read_text().replace("*TIE, NAME", both))
    mesh = read_mesh(file, ("triangle",))
    assert mesh.groups["tail"].dim == 1 and len(mesh.groups["tail"].entities) == around and "tail" not in mesh.regions
    assert mesh.groups["bottom"].dim == 2 and len(mesh.regions["bottom"]) == 4 * ACROSS * 2 * ALONG


def test_solids_of_several_kinds_are_refused_with_the_line_of_the_second(tmp_path: Path) -> None:
    text = nodes(CUBE) + "*ELEMENT, TYPE=C3D8\n1, 1, 2, 3, 4, 5, 6, 7, 8\n*ELEMENT, TYPE=C3D4\n2, 1, 2, 4, 5\n"
    (tmp_path / "cube.inp").write_text(text)
    with pytest.raises(InputError, match=r"cube\.inp: line 13: cells of one kind .* a tetra beside a hexahedron"):
        read_mesh_file(tmp_path / "cube.inp")


def test_a_set_of_nodes_on_a_solid_is_its_face(tmp_path: Path) -> None:
    text = (
        nodes(CUBE)
        + "*ELEMENT, TYPE=C3D8\n1, 1, 2, 3, 4, 5, 6, 7, 8\n*NSET, NSET=tail\n1, 4, 5, 8\n*NSET, NSET=edge\n1, 5\n"
    )
    (tmp_path / "cube.inp").write_text(text)
    mesh = read_mesh(tmp_path / "cube.inp", ("hexahedron",))
    assert mesh.groups["tail"].dim == 2 and mesh.points[mesh.groups["tail"].entities][..., 0].tolist() == [[0.0] * 4]
    assert mesh.groups["edge"].dim == 1


def test_of_elements_with_nodes_amid_edges_the_corners_count(tmp_path: Path) -> None:
    """Edges of shells are S3 to S6 in CalculiX, and E1 to E4 in Abaqus."""
    corners = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 1.0, 0.0), (0.0, 1.0, 0.0)]
    amid = [(1.0, 0.0, 0.0), (2.0, 0.5, 0.0), (1.0, 1.0, 0.0), (0.0, 0.5, 0.0)]
    text = (
        nodes([*corners, *amid])
        + "*ELEMENT, TYPE=S8R, ELSET=all\n7, 1, 2, 3, 4, 5, 6, 7, 8\n*NSET, NSET=tail\n1, 4, 8\n"
    )
    edges = {"S3": {1, 2}, "S6": {1, 4}, "E2": {2, 3}, "E3": {3, 4}, "SPOS": {1, 2, 3, 4}, "S1": {1, 2, 3, 4}}
    text += "".join(f"*SURFACE, NAME={face}\nall, {face}\n" for face in edges)
    (tmp_path / "plate.inp").write_text(text)
    surfaces = read_deck(tmp_path / "plate.inp").surfaces
    assert {face: surfaces[face.lower()] for face in edges} == edges
    read = read_mesh_file(tmp_path / "plate.inp")
    assert [(block.kind, block.corners.tolist()) for block in read.blocks] == [("quad", [[0, 1, 2, 3]])]
    mesh = read_mesh(tmp_path / "plate.inp", ("triangle",))
    assert len(mesh.points) == 5 and len(mesh.groups["tail"].entities) == 1
    (tmp_path / "plate.inp").write_text(text.replace("6, 2.0, 0.5, 0.0", "6, 2.01, 0.5, 0.0"))
    with pytest.raises(InputError, match="plate.inp: line 11: straight edges .*: element 7 has others"):
        read_mesh_file(tmp_path / "plate.inp")


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("m.med", "MED is not read; gmsh opens it"),
        ("m.xdmf", "meshio reads .xdmf files with the package h5py, .* .vtu and"),
    ],
)
def test_files_of_hdf5_are_refused_with_what_to_save_instead(name: str, says: str, tmp_path: Path) -> None:
    if name == "m.xdmf" and importlib.util.find_spec("h5py"):
        pytest.skip("h5py is installed")
    xml = '<Xdmf Version="3.0"><Domain><Grid Name="g"><Geometry GeometryType="XYZ"><DataItem DataType="Float" '
    xml += 'Dimensions="3 3" Format="HDF" Precision="8">m.h5:/0</DataItem></Geometry></Grid></Domain></Xdmf>'
    (tmp_path / name).write_text(xml)
    with pytest.raises(InputError, match=says):
        read_mesh(tmp_path / name, ("triangle",))


def test_an_inverted_cell_is_refused_with_its_line(tmp_path: Path) -> None:
    places = [(x, y, z) for x in (0, 1, 2) for z in (0, 1) for y in (0, 1)]
    lines = ["*NODE", *(f"{k}, {x}, {y}, {z}" for k, (x, y, z) in enumerate(places, 1)), "*ELEMENT, TYPE=C3D8"]
    lines += ["1, 1, 2, 4, 3, 5, 6, 8, 7", "2, 9, 10, 12, 11, 5, 6, 8, 7"]
    (tmp_path / "cells.inp").write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match="cells.inp: line 16: 1 of 2 cells are inverted"):
        read_mesh(tmp_path / "cells.inp", ("hexahedron",))


NORMALS = {"bottom": [0, 0, -1], "top": [0, 0, 2], "left": [0, 1, 0], "right": [0, -1, 0], "tail": [-1, 0, 0]}


def faces_by_normals(**normals: list[float]) -> str:
    return "\n[mesh.faces]\n" + "".join(f"{name}.normal = {normal}\n" for name, normal in normals.items())


def read_model(folder: Path, body: str) -> StructuralModel:
    (folder / "boom.toml").write_text(SCENE + body)
    return structure_of(members(pmr.load_scene(folder / "boom.toml"))[0]).model


def test_faces_by_normals_are_the_groups_of_a_deck(tmp_path: Path) -> None:
    """The boom's mesh as a file without groups: pads meet the same displacements, and the ends are its rim."""
    by_groups = read_model(tmp_path, READ.replace("boom.inp", write_boom(tmp_path).name))
    read = read_mesh_file(tmp_path / "boom.inp")
    cells = [(block.kind, block.corners) for block in read.blocks if block.kind == "quad"]
    meshio.write(tmp_path / "plain.vtu", meshio.Mesh(read.points, cells))
    plain = READ.replace("boom.inp", "plain.vtu")
    by_normals = read_model(tmp_path, plain + faces_by_normals(**NORMALS, tip=[1, 0, 0]))
    window = Window((0.7, 1.1), (-0.12, 0.12), (0.05, 0.05))
    for face in ("bottom", "top", "left", "right"):
        strip, expected = (model.strip(face, window) for model in (by_normals, by_groups))
        np.testing.assert_allclose(strip.weights, expected.weights, rtol=1e-12)
        assert len(strip.weights) and abs(strip.normal - expected.normal).max() <= 1e-12
    for end in ("tail", "tip"):
        numbers, expected = (model.coordinates_on(end, ("x", "ry")) for model in (by_normals, by_groups))
        assert len(numbers) and set(numbers) == set(expected)
    for body, normal, says in (
        (
            plain,
            [0, 3, 4],
            r"normal = \[0.0, 0.6, 0.8\]: a normal within 1 degrees of .*; the nearest face has \[0.0, 0.0, 1",
        ),
        (plain, [0, 0, 0], "three numbers, not all of them zero"),
        (READ, [0, 0, 1], "a name is allowed that is no group of .*boom.inp: "),
    ):
        with pytest.raises(InputError, match=says) as refused:
            read_model(tmp_path, body + faces_by_normals(top=normal))
        assert "mesh.faces.top" in str(refused.value) and "\n" not in str(refused.value)


def test_groups_by_a_list_of_nodes_are_the_groups_of_a_deck(tmp_path: Path) -> None:
    """The boom's mesh as a file without groups, and the nodes of its faces and ends in a CSV file."""
    by_groups = read_model(tmp_path, READ.replace("boom.inp", write_boom(tmp_path).name))
    read = read_mesh_file(tmp_path / "boom.inp")
    cells = [(block.kind, block.corners) for block in read.blocks if block.kind == "quad"]
    meshio.write(tmp_path / "plain.vtu", meshio.Mesh(read.points, cells))
    x, y, z = read.points.T
    levels = {"bottom": (z, z.min()), "top": (z, z.max()), "left": (y, y.max()), "right": (y, y.min())}
    levels |= {"tail": (x, x.min()), "tip": (x, x.max())}
    sides = {name: np.isclose(at, level) for name, (at, level) in levels.items()}
    lines = [
        ",".join([str(number), *(f"{value:.9g}" for value in point), *(name for name in sides if sides[name][number])])
        for number, point in enumerate(read.points)
    ]
    nodes, listed = tmp_path / "nodes.csv", READ.replace("boom.inp", "plain.vtu") + "mesh.groups.file = 'nodes.csv'\n"
    nodes.write_text("\n".join(["node,x,y,z,groups", *lines]) + "\n")
    by_list = read_model(tmp_path, listed)
    window = Window((0.7, 1.1), (-0.12, 0.12), (0.05, 0.05))
    for face in ("bottom", "top", "left", "right"):
        strip, expected = (model.strip(face, window) for model in (by_list, by_groups))
        assert len(strip.weights)
        np.testing.assert_allclose(strip.weights, expected.weights, rtol=1e-12)
    for end in ("tail", "tip"):
        numbers, expected = (model.coordinates_on(end, ("x", "ry")) for model in (by_list, by_groups))
        assert len(numbers) and set(numbers) == set(expected)
    scene = pmr.load_scene(tmp_path / "boom.toml")
    digest, recorded = scene.hash, scene.provenance
    assert recorded["scene"]["mesh"]["groups"] == {"file": "nodes.csv"} and "mesh.groups" in recorded["files"]
    for text, says in (
        (
            "0,-7,0.15,0.2,top",
            r"node of group top = .*: nodes of the mesh are allowed, in m; the nearest one is 7 m away",
        ),
        ("1,0,0", "line 2: node, x, y, z and names of groups are allowed"),
    ):
        nodes.write_text(f"node,x,y,z,groups\n{text}\n")
        assert pmr.load_scene(tmp_path / "boom.toml").hash != digest
        with pytest.raises(InputError, match=says) as refused:
            read_model(tmp_path, listed)
        assert "nodes.csv" in str(refused.value) and "\n" not in str(refused.value)
    with pytest.raises(InputError, match="a name is allowed that is no group of the mesh"):
        nodes.write_text("node,x,y,z,groups\n0,0,0,0,top\n")
        read_model(tmp_path, READ + "mesh.groups.file = 'nodes.csv'\n")
    (tmp_path / "empty.inp").write_text("*HEADING\n")
    with pytest.raises(InputError, match="cells of kind none"):
        read_model(tmp_path, READ.replace("boom.inp", "empty.inp") + "mesh.groups.file = 'nodes.csv'\n")


@pytest.mark.parametrize("name", ["plate.mesh", "plate.su2"])
def test_a_mesh_in_the_plane_is_one_in_space_at_height_zero(name: str, tmp_path: Path) -> None:
    """Files of some formats have two coordinates for each point."""
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 0.5], [0.0, 0.5]])
    meshio.write(tmp_path / name, meshio.Mesh(corners, [("triangle", np.array([[0, 1, 2], [0, 2, 3]]))]))
    mesh = read_mesh(tmp_path / name, ("triangle",))
    rows = sorted(map(tuple, mesh.points.tolist()))
    assert rows == [(0.0, 0.0, 0.0), (0.0, 0.5, 0.0), (2.0, 0.0, 0.0), (2.0, 0.5, 0.0)]


def test_a_time_that_paraview_writes_is_no_group(tmp_path: Path) -> None:
    corners = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 0.5, 0.0]])
    cells, file = [("triangle", np.array([[0, 1, 2]]))], tmp_path / "plate.vtu"
    meshio.write(file, meshio.Mesh(corners, cells, cell_data={"gmsh:physical": [np.array([1])]}), binary=False)
    time = '<FieldData><DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" format="ascii">1.5</DataArray>'
    text = file.read_text()
    assert "<UnstructuredGrid>" in text
    file.write_text(text.replace("<UnstructuredGrid>", f"<UnstructuredGrid>{time}</FieldData>"))
    assert not read_mesh(file, ("triangle",)).groups


def test_a_face_of_a_hollow_solid_is_the_outermost_with_its_normal(tmp_path: Path) -> None:
    """A tube of cubes has the inside of its top, which looks downwards as its bottom does."""
    cubes = [(x, y, z) for x in range(5) for y in range(3) for z in range(3) if (y, z) != (1, 1)]
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])
    points, numbers = np.unique((np.array(cubes)[:, None] + corners).reshape(-1, 3), axis=0, return_inverse=True)
    meshio.write(tmp_path / "tube.vtu", meshio.Mesh(1.0 * points, [("hexahedron", numbers.reshape(-1, 8))]))
    mesh = read_mesh(tmp_path / "tube.vtu", ("hexahedron",))
    with_faces = add_faces(mesh, {name: FaceNormal(normal=normal) for name, normal in NORMALS.items()})
    planes = (("bottom", 15, 2, 0.0), ("top", 15, 2, 3.0), ("left", 15, 1, 3.0), ("tail", 8, 0, 0.0))
    for name, count, axis, level in planes:
        group = with_faces.groups[name]
        assert group.dim == 2 and len(group.entities) == count
        assert np.all(mesh.points[group.entities][..., axis] == level)


def test_a_seam_whose_nodes_are_not_merged_is_named(tmp_path: Path) -> None:
    """A boom that was rolled up from a plate: its bottom and its left side meet at nodes of their own."""
    read_model(tmp_path, READ.replace("boom.inp", write_boom(tmp_path).name))
    read = read_mesh_file(tmp_path / "boom.inp")
    _, y, z = read.points.T
    corner = np.flatnonzero(np.isclose(y, y.max()) & np.isclose(z, z.min()))
    copies = np.arange(len(read.points))
    copies[corner] = len(read.points) + np.arange(len(corner))
    quads = [block.corners for block in read.blocks if block.kind == "quad"]
    opened = [np.where(np.isclose(z[q], z.min()).all(axis=1)[:, None], copies[q], q) for q in quads]
    for name, points, cells in (
        ("closed", read.points, quads),
        ("open", np.concatenate([read.points, read.points[corner]]), opened),
    ):
        meshio.write(tmp_path / f"{name}.vtu", meshio.Mesh(points, [("quad", q) for q in cells]))
        body = READ.replace("boom.inp", f"{name}.vtu") + faces_by_normals(**NORMALS, tip=[1, 0, 0])
        (tmp_path / "boom.toml").write_text(SCENE + body)
        texts = warnings(structure_of(members(pmr.load_scene(tmp_path / "boom.toml"))[0]))
        assert len(texts) == (name == "open")
    assert (
        f"at {len(np.unique(read.points[corner], axis=0))} places, first at (0, {y.max():g}, {z.min():g}) m" in texts[0]
    )
