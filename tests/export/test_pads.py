"""Where pads stand as they are drawn, and what slanted ones press on a machine with."""

from pathlib import Path

import numpy as np
import pytest
from boom_results import make_fields, make_space  # noqa: F401 fixtures

from pmr import scene as scenes
from pmr.export.paraview import pads_over_time
from pmr.results.field_series import CUBE, THICK, pad_corners
from pmr.scene.box import Box
from pmr.scene.built import PadRing


def test_pads_of_the_mouth_stay_and_those_of_the_tail_move_with_the_body(make_space, make_fields) -> None:  # noqa: F811
    result = make_space(fields=make_fields("triangle"))
    found, along = pads_over_time(result), result.moving_fields[""][1]
    assert found is not None and len(found.names) == sum(len(ring.named_pads) for ring in result.scene.pads)
    moving = [ring.moving for ring in result.scene.pads for _ in ring.named_pads]
    start = found.corners[:, :, :, 0].min(axis=2)
    for k, stays in enumerate(moving):
        assert np.allclose(start[:, k] - start[0, k], 0.0 if stays else along - along[0])
    size = np.ptp(found.corners, axis=2)
    assert np.allclose(size.min(axis=2), THICK)
    assert found.values["force"].shape == start.shape


def test_the_order_of_corners_is_that_of_a_hexahedron() -> None:
    """Each face of the lower four turns once around, the upper four stand above them."""
    assert np.array_equal(CUBE[:4, :2], CUBE[4:, :2]) and set(CUBE[:4, 2]) == {0.0}
    assert np.all(np.abs(np.diff(CUBE[:4], axis=0)).sum(axis=1) == 1.0)


@pytest.mark.parametrize("face", ["bottom left", "top left", "top right", "bottom right"])
def test_a_pad_lies_on_its_slanted_face(face: str) -> None:
    box = Box(length=2.0, width=0.3, height=0.4, wall=0.01, chamfer=(0.1, 0.12))
    ring, side = PadRing(name="tail", at=0.5, faces={face: (0.03,)}, length=0.2, width=0.06), box.faces[face]
    corners = pad_corners(ring, ring.named_pads[0], np.zeros((2, 3)), box, CUBE)
    outside = float(side.normal @ side.start) + 0.005
    assert sorted(corners[:, 1:] @ side.normal) == pytest.approx([outside] * 4 + [outside + THICK] * 4)
    assert sorted(corners[:, 1:] @ side.across_direction) == pytest.approx([0.0] * 4 + [0.06] * 4, abs=1e-12)
    assert sorted(corners[:, 0]) == pytest.approx([0.4] * 4 + [0.6] * 4)


def test_slanted_pads_press_on_the_machine_along_their_normals() -> None:
    """Force n and moment r x n about the pivot of each unit force."""
    from pmr.scene.mechanism import ground_contact_wrenches

    faces = "{'bottom left'=[0.02],'top right'=[-0.01],top=[0.05]}"
    file = Path(__file__).parents[2] / "workflows" / "boom_octagonal.toml"
    boom = scenes.load_any(file, [f"sections.base.pads=[{{name='ring',at=1.2,width=0.03,faces={faces}}}]"])
    found = {
        one.names[1]: one.wrench for one in ground_contact_wrenches(boom, {name: np.zeros(1) for name in boom.paths})
    }
    sides = boom.sections[0].body.box.faces
    for face, across in (("bottom left", 0.02), ("top right", -0.01), ("top", 0.05)):
        n = np.array([0.0, *sides[face].normal])
        r = np.array(
            [
                1.2,
                *(
                    across * sides[face].across_direction
                    + (sides[face].normal @ sides[face].start) * sides[face].normal
                ),
            ]
        )
        assert found[f"force of base ring {face}"][0] == pytest.approx([*n, *np.cross(r, n)], abs=1e-12)
