import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pmr import scene as scenes
from pmr.report import album as pictures
from pmr.report.document import render_runs as render
from pmr.report.moving_bodies import MovingBodies, body_surface
from pmr.report.player import Piece, Shot, frame_shots, render_shot
from pmr.report.sections import chapter as case
from pmr.results import BodyResult, Paths
from pmr.results.field_series import THICK

SQUARE = Piece(np.array([(0.0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)]), np.array([(0, 1, 2, 3)]), np.array([1.0]))
SHOT = Shot((SQUARE,), (0.0, -1.0, 0.0), (0.0, 1.0), centre=(0.5, 0.0, 0.5), height=2.0, size=(80, 40))


def test_all_shots_of_a_side_have_one_scale_and_hold_what_they_show() -> None:
    high = Piece(SQUARE.points * (1.0, 1.0, 3.0), SQUARE.faces)
    one, two = frame_shots([SHOT, Shot((high,), SHOT.direction)], width=100, margin=0.5)
    assert one.size == (100, 100) and two.size == (100, 200)
    assert (one.height, two.height) == pytest.approx((2.0, 4.0))
    assert one.centre == pytest.approx((0.5, 0.0, 0.5)) and two.centre == pytest.approx((0.5, 0.0, 1.5))


@pytest.mark.slow
def test_a_picture_shows_what_it_is_told_to_and_is_the_same_again() -> None:
    first = render_shot(SHOT)
    assert first == render_shot(SHOT)
    seen = np.asarray(Image.open(io.BytesIO(first)).convert("RGB")).astype(int)
    assert seen.shape == (40, 80, 3)
    assert np.all(seen[:8] == 255) and np.all(seen[:, :28] == 255)  # white around it
    red, green, blue = seen[20, 40]
    assert red > 80 and red > 2 * green and red > 2 * blue  # the last colour


@pytest.mark.parametrize("size", [(80, 57), (114, 40), (402, 201)])
def test_a_picture_has_the_size_that_its_page_states(size: tuple[int, int]) -> None:
    assert Image.open(io.BytesIO(render_shot(replace(SHOT, size=size)))).size == size


def colours_of(*pieces: Piece) -> np.ndarray:
    """Colours (40, 80, 3) of a picture of pieces from the front."""
    picture = render_shot(replace(SHOT, pieces=pieces))
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)


def test_what_is_near_hides_what_is_far_and_a_layer_hides_those_below() -> None:
    """A red square and one behind it that is blue, in either order; the blue one wins in a layer above."""
    red, blue = replace(SQUARE, values=None, colour="#ff0000"), replace(SQUARE, values=None, colour="#0000ff")
    behind = replace(blue, points=blue.points + (0.0, 0.5, 0.0))
    for pieces in ((red, behind), (behind, red)):
        assert colours_of(*pieces)[20, 40, 0] > 100 > colours_of(*pieces)[20, 40, 2]
    assert colours_of(red, replace(behind, layer=1.0))[20, 40, 2] > 100
    seen_through = colours_of(behind, replace(red, opacity=0.3))[20, 40]
    assert seen_through[2] > seen_through[0] > 40


def test_faces_of_a_body_are_turned_outwards(make_fields) -> None:
    """However the cells of a mesh go round."""
    for kind in ("line", "triangle", "hexahedron"):
        surface = body_surface(make_fields(kind))
        piece = Piece(surface.points, surface.faces)
        away = surface.points[surface.faces].mean(axis=1) - surface.points.mean(axis=0)
        along = np.abs(piece.normals[:, 0]) > 0.9  # faces at the ends
        assert (np.sum(piece.normals * away, axis=1)[~along] > 0.0).all()
        assert list(piece.faces_towards((0.0, -1.0, 0.0))) == list(piece.normals[:, 1] < 0.0)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_pictures_stand_in_the_page(monkeypatch, make_space, make_fields) -> None:
    monkeypatch.setattr(pictures, "render_shot", lambda shot: b"picture")
    page = render([case(make_space(fields=make_fields("triangle")), "case-1")])
    images = re.findall(
        r'<figure id="case-1-([^"]+)" class="picture">\s*<img src="data:image/png;base64,cGljdHVyZQ=="', page
    )
    assert images == ["view-1", "view-2", "view-3", "close"]
    assert 'id="case-1-ramp"' in page
    assert "All pictures show displacements 50 times their size" in page
    assert "largest von Mises stress is 47.2\u00a0MPa" in page


def test_a_boom_stands_over_the_ground_on_its_cylinder_with_pads_at_their_places(make_space, make_fields) -> None:
    """Raised by 30 degrees, from 0 to 1 m; lines of fields without deflection, so all places are those of the scene."""
    scene = scenes.load_any(
        Path(__file__).parents[2] / "workflows" / "boom_two.toml",
        ["section.joint.extension=2.0", "time.end=1.0", "gravity={}", "frame.unit=degrees", "frame.luffing=30.0",
         "frame.pivot=[0.5,0.0,0.2]", "frame.cylinder={foot=[0.4,-1.2],lug=[1.8,-0.1]}"],
    )  # fmt: skip
    line, alone = make_fields("line"), make_space(fields=make_fields("line"))
    still = BodyResult(fields=replace(line, displacement=0.0 * line.displacement))
    steps = len(alone.responses["reduced"].t)
    ahead = np.full((steps, 1), 2.0)
    paths, bodies = Paths(("fly",), ahead, 0.0 * ahead), {"base": still, "fly": still}
    views = pictures._Views(
        MovingBodies(replace(alone, scene=scene, bodies=bodies, paths=paths, reach=8.0 + 0.0 * ahead[:, 0]))
    )
    (moment, *_) = views.bodies.moments()
    places = [piece.points.mean(axis=0) for piece in views._pads(moment, np.array([0.0, -1.0, 0.0]))]
    assert [place[0] for place in places] == pytest.approx([2.15, 2.15, 5.85, 5.85])
    assert all(abs(place[2]) == pytest.approx(0.2 + THICK / 2.0) for place in places)  # walls are drawn thin
    (rod,) = (piece for piece in views._pieces_at(moment, pictures.SIDE) if piece.colour == pictures.CYLINDER)
    lug = np.array([np.cos(np.pi / 6.0) * 1.8 + 0.05, 0.0, 0.9 - 0.1 * np.cos(np.pi / 6.0)])
    assert rod.points[:4].mean(axis=0) == pytest.approx([0.4, 0.0, -1.2]) and rod.points[4:].mean(
        axis=0
    ) == pytest.approx(lug)
    (ground,) = views._ground_pieces(moment)
    assert ground.points[:, 2] == pytest.approx([-1.2] * 4) and ground.points[:, 0].max() == pytest.approx(
        1.05 * 8.0 * 0.75**0.5
    )
