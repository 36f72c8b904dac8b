from dataclasses import replace

import numpy as np
import pytest
from boxes import HEIGHT, WIDTH, block, box
from surfaces import mapped

from pmr import InputError
from pmr.models.named_mesh import Group, NamedMesh
from pmr.models.shell import Shell
from pmr.models.solid import Solid
from pmr.models.trace import Window
from pmr.scene.structures import Plate, ShellBody, SolidBody

NORMALS = {"bottom": (0, 0, -1), "top": (0, 0, 1), "left": (0, 1, 0), "right": (0, -1, 0)}
WINDOW = Window((0.43, 1.01), (-0.07, 0.05), (0.02, 0.01))


def shell(mesh: NamedMesh) -> Shell:
    return Shell(ShellBody(plate=Plate(thickness=0.008)), mesh)


MODELS = {"shell": lambda: shell(box(skew=0.2)), "solid": lambda: Solid(SolidBody(), block())}


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("face", NORMALS)
def test_points_fill_the_window_and_move_along_the_outward_normal(face: str, kind: str) -> None:
    model = MODELS[kind]()
    strip = model.strip(face, WINDOW)
    assert strip.weights.sum() == pytest.approx(0.58 * 0.12, rel=2e-2)  # its edge cuts pieces of 1 to 2 cm
    assert strip.along.min() > 0.43 and strip.along.max() < 1.01
    assert strip.across.min() > -0.07 and strip.across.max() < 0.05
    place = np.zeros((len(strip.along), 3))
    beside, depth = (1, HEIGHT) if face in ("bottom", "top") else (2, WIDTH)
    place[:, 0], place[:, beside] = strip.along, strip.across
    place += np.array(NORMALS[face]) * depth / 2.0
    R = model.rigid_motions()
    expected = np.hstack([np.tile(NORMALS[face], (len(place), 1)), np.cross(place, NORMALS[face])])
    assert strip.normal @ R == pytest.approx(expected, abs=1e-12)


def test_a_quadratic_displacement_is_met_exactly() -> None:
    model = shell(box())
    nodes = model.nodes
    q = np.where(nodes.component == 2, nodes.points[:, 0] ** 2 - 3.0 * nodes.points[:, 0] * nodes.points[:, 1], 0.0)
    strip = model.strip("top", WINDOW)
    assert strip.normal @ q == pytest.approx(strip.along**2 - 3.0 * strip.along * strip.across, abs=1e-12)


@pytest.mark.parametrize("kind", MODELS)
def test_a_section_moves_as_what_is_around_it(kind: str) -> None:
    """Rigidly as a body at its centroid; of a parabola it has the mean over the cells around, no more."""
    model = MODELS[kind]()
    at = model.centroid(0.9)
    assert at == pytest.approx([0.9, 0.0, 0.0], abs=0.02)
    expected = np.hstack([np.eye(3), np.stack([np.cross(e, at) for e in np.eye(3)], axis=1)])
    assert model.displacement(0.9) @ model.rigid_motions() == pytest.approx(expected, abs=1e-12)
    nodes = model.nodes
    w = np.where(nodes.component == 2, nodes.points[:, 0] ** 2, 0.0)
    spread = (model.displacement(0.9) @ w)[2] - at[0] ** 2
    assert 0.25**2 / 12.0 < spread < 0.4**2 / 6.0  # hats of half-widths from 0.2 m up have their square over six
    with pytest.raises(InputError, match=r"place = 2\.3: a group or a number from 0 to 2 m"):
        model.displacement(2.3)


def bent(mesh: NamedMesh) -> NamedMesh:
    points = mesh.points.copy()
    points[:, 2] += 0.3 * points[:, 0] ** 2
    return NamedMesh(mesh.cell, points, mesh.cells, mesh.groups, mesh.regions)


def test_what_is_no_face_for_a_pad_is_refused() -> None:
    with pytest.raises(InputError, match="no group named floor; found: bottom"):
        shell(box()).strip("floor", WINDOW)
    with pytest.raises(InputError, match="tip is not a face"):
        shell(box()).strip("tip", WINDOW)
    with pytest.raises(InputError, match="not flat"):
        shell(bent(box())).strip("top", WINDOW)


def test_beside_a_face_there_are_no_points_and_the_face_says_what_it_offers() -> None:
    strip = shell(box()).strip("top", Window((2.1, 2.4), (-0.1, 0.1), (0.01, 0.01)))
    assert len(strip.along) == 0 and strip.normal.shape[0] == 0
    assert str(strip.extent) == "0 to 2 m along the axis, -0.15 to 0.15 m across"


def test_a_face_of_a_flat_shell_points_where_its_name_says() -> None:
    """It lies in the middle of the body, from where it is seen from neither side."""
    mesh = mapped((4, 2), lambda u, v: np.stack([2.0 * u, 0.4 * v - 0.2, 0.0 * u], axis=1))
    groups = dict.fromkeys(("bottom", "top", "left"), Group(2, mesh.cells))
    model = shell(replace(mesh, groups={**mesh.groups, **groups}))
    for face, sign in {"bottom": -1.0, "top": 1.0}.items():
        strip = model.strip(face, WINDOW)
        assert strip.normal @ model.rigid_motions()[:, 2] == pytest.approx(sign, abs=1e-12)
    with pytest.raises(InputError, match="pads.on = 'left': this face lies in the middle of the body"):
        model.strip("left", WINDOW)
