import re
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

from pmr import InputError
from pmr.models.box_mesh import BoxBoom, write_shell, write_solid
from pmr.models.named_mesh import NamedMesh, read_mesh
from pmr.scene.profile import BoxProfile

pytest.importorskip("gmsh")
SMALL = {"length": 1.2, "size": 0.1}
PROFILE = {"width": 0.3, "height": 0.4, "wall": 0.008}


def boom(**dimensions) -> BoxBoom:
    """Of the profile, with other dimensions of it or of the cells."""
    own = {key: dimensions.pop(key, value) for key, value in (PROFILE | {"radius": 0.0, "chamfer": 0.0}).items()}
    return BoxBoom(BoxProfile(**own).sides, **dimensions)


def shell(tmp_path: Path, **dimensions) -> NamedMesh:
    write_shell(boom(**(SMALL | dimensions)), tmp_path / "m.msh")
    return read_mesh(tmp_path / "m.msh", ("triangle",))


def content(points: np.ndarray) -> np.ndarray:
    """Areas of triangles (c, 3, 3), m^2."""
    return np.linalg.norm(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]), axis=1) / 2


@pytest.mark.parametrize("radius", [0.0, 0.04])
@pytest.mark.parametrize("frames", [(), (0.5, 0.9)])
def test_a_shell_has_the_area_of_its_walls_and_frames(tmp_path: Path, radius: float, frames) -> None:
    mesh = shell(tmp_path, radius=radius, frames=frames, frame_depth=0.03)
    area = {name: content(mesh.points[group.entities]).sum() for name, group in mesh.groups.items() if group.dim == 2}
    assert area["bottom"] == pytest.approx(1.2 * (0.3 - 2 * radius), rel=1e-12)
    assert area["left"] == area["right"] == pytest.approx(1.2 * (0.4 - 2 * radius), rel=1e-12)
    if radius:
        assert area["corners"] == pytest.approx(1.2 * 2 * np.pi * radius, rel=0.03)  # chords of the arcs
    if frames:
        inside = (0.3 - 0.06) * (0.4 - 0.06) - (4 - np.pi) * max(radius - 0.03, 0.0) ** 2
        ring = 0.3 * 0.4 - (4 - np.pi) * radius**2 - inside
        assert area["frames"] == pytest.approx(2 * ring, rel=0.02 if radius else 1e-12)
    assert sum(area.values()) == pytest.approx(content(mesh.points[mesh.cells]).sum(), rel=1e-12)


def test_the_walls_lie_where_their_names_say(tmp_path: Path) -> None:
    mesh = shell(tmp_path)
    for name, axis, at in (("bottom", 2, -0.2), ("top", 2, 0.2), ("left", 1, 0.15), ("right", 1, -0.15)):
        assert np.all(np.abs(mesh.points[mesh.groups[name].entities][..., axis] - at) < 1e-12)
    for name, at in (("tail", 0.0), ("tip", 1.2)):
        ends = mesh.points[mesh.groups[name].entities]
        assert np.all(np.abs(ends[..., 0] - at) < 1e-12)
        assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(1.4, rel=1e-12)


def test_the_mesh_is_symmetric(tmp_path: Path) -> None:
    mesh = shell(tmp_path)
    for mirror in ([1, -1, 1], [1, 1, -1]):
        here, there = (set(map(tuple, np.round(points, 9) + 0.0)) for points in (mesh.points, mesh.points * mirror))
        assert here == there


def test_layers_double_from_the_tail(tmp_path: Path) -> None:
    x = np.unique(np.round(shell(tmp_path, tail_layer=0.02, size_along=0.2).points[:, 0], 6))
    ends = x[::2]  # every other one is the middle of a layer
    assert np.diff(ends)[:4] == pytest.approx([0.02, 0.04, 0.08, 0.16], rel=1e-4)
    assert np.all(np.abs(np.diff(ends)[4:] - 0.225) < 1e-6)


@pytest.mark.parametrize("hexahedra", [True, False])
@pytest.mark.parametrize("radius", [0.0, 0.04])
def test_a_solid_has_the_volume_of_its_wall(tmp_path: Path, hexahedra: bool, radius: float) -> None:
    write_solid(boom(**SMALL, radius=radius), tmp_path / "m.msh", hexahedra)
    mesh = read_mesh(tmp_path / "m.msh", ("hexahedron", "tetrahedron"))
    p = mesh.points[mesh.cells]
    if hexahedra:
        tets = [p[:, [0, 1, 3, 7]], p[:, [0, 3, 2, 7]], p[:, [0, 2, 6, 7]], p[:, [0, 6, 4, 7]], p[:, [0, 4, 5, 7]],
                p[:, [0, 5, 1, 7]]]  # fmt: skip
        p = np.concatenate(tets)
    volume = np.abs(np.linalg.det(p[:, 1:] - p[:, :1])).sum() / 6
    section = 2 * 0.008 * (0.7 - 4 * radius) + 2 * np.pi * radius * 0.008
    assert volume == pytest.approx(1.2 * section, rel=1e-12 if radius == 0.0 else 0.02)
    assert np.all(np.abs(mesh.points[mesh.groups["left"].entities][..., 1] - 0.154) < 1e-9)


@pytest.mark.parametrize(
    ("dimensions", "says"),
    [
        ({"frames": (7.0,), "frame_depth": 0.1}, "frames"),
        ({"frames": (1.0,)}, "frame_depth"),
        ({"size": 0.0}, "size = 0.0: more than 0"),
    ],
)
def test_impossible_dimensions_are_refused(dimensions, says: str) -> None:
    with pytest.raises(InputError, match=says):
        boom(**dimensions)


@pytest.mark.parametrize("kind", ["shell", "hexahedra", "tetrahedra"])
def test_a_chamfered_boom_has_all_of_its_faces(tmp_path: Path, kind: str) -> None:
    walls = {"bottom": 0.012, "sides": 0.006, "top": 0.008}
    profile = BoxProfile(width=0.3, height=0.4, wall=walls, chamfer=(0.09, 0.12))
    drawn, file = BoxBoom(profile.sides, length=0.6, size=0.1), tmp_path / "m.msh"
    write_shell(drawn, file) if kind == "shell" else write_solid(drawn, file, kind == "hexahedra")
    mesh = read_mesh(file, ("triangle", "hexahedron", "tetrahedron"))
    for name, side in profile.faces.items():
        group = mesh.groups[name]
        corners = mesh.points[group.entities].reshape(-1, 3)
        outside = 0.0 if kind == "shell" else side.thickness / 2.0
        assert corners[:, 1:] @ side.normal == pytest.approx(side.normal @ side.start + outside, abs=1e-9)
        if kind == "shell":
            assert content(mesh.points[group.entities]).sum() == pytest.approx(0.6 * side.length, rel=1e-12)


def test_a_solid_with_rounded_corners_has_one_thickness(tmp_path: Path) -> None:
    walls = {"bottom": 0.012, "sides": 0.006, "top": 0.008}
    profile = BoxProfile(width=0.3, height=0.4, wall=walls, radius=0.05)
    with pytest.raises(InputError, match="one thickness of all walls is allowed for a solid with rounded corners"):
        write_solid(BoxBoom(profile.sides, length=0.6, size=0.1), tmp_path / "m.msh")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/proc says which signals are ignored")
def test_a_pipe_that_nobody_reads_does_not_end_the_process_after_a_mesh_was_drawn(tmp_path: Path) -> None:
    """gmsh gives SIGPIPE its default: a report's process that was killed took the run with it, without a word."""
    shell(tmp_path)
    ignored = int(re.findall(r"^SigIgn:\s*(\w+)$", Path("/proc/self/status").read_text(), flags=re.M)[0], 16)
    assert ignored & 1 << signal.SIGPIPE - 1
