import base64
import io
import re
import sys
from dataclasses import replace
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from PIL import Image
from waiting import PATIENCE

from pmr import scene as scenes
from pmr.report import album as pictures
from pmr.report import renderer as studio
from pmr.report import sections
from pmr.report.album import start_album
from pmr.report.bodies import drawn_moments
from pmr.report.document import render_runs as render
from pmr.report.renderer import NoPictureError, Piece, Shot, frame_shots, render_shots
from pmr.report.sections import chapter as case
from pmr.results import BodyResult, Paths
from pmr.results.pads import THICK

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
    first, second = render_shots([SHOT, SHOT])
    assert first == second == render_shots([SHOT])[0]
    seen = np.asarray(Image.open(io.BytesIO(first)).convert("RGB")).astype(int)
    assert seen.shape == (40, 80, 3)
    assert np.all(seen[:8] == 255) and np.all(seen[:, :28] == 255)  # white around it
    red, green, blue = seen[20, 40]
    assert red > 80 and red > 2 * green and red > 2 * blue  # the last colour


def test_without_vtk_the_report_says_so(monkeypatch, make_space, make_fields) -> None:
    hidden = (
        "import sys; sys.modules['vtkmodules'] = None; import runpy; runpy.run_module(sys.argv[1], run_name='__main__')"
    )
    run = studio.subprocess.run
    monkeypatch.setattr(studio.subprocess, "run", lambda c, **k: run([sys.executable, "-c", hidden, c[-1]], **k))
    found = start_album(make_space(fields=make_fields("line")), "case-1")()
    assert found.pictures == () and "vtkmodules" in found.absent


def test_a_driver_that_ends_its_process_ends_no_report(monkeypatch) -> None:
    run = studio.subprocess.run
    crash = "import os; os.abort()"
    monkeypatch.setattr(studio.subprocess, "run", lambda c, **k: run([sys.executable, "-c", crash], **k))
    with pytest.raises(NoPictureError, match="the graphics library ended unexpectedly"):
        render_shots([SHOT])


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_pictures_stand_in_the_page(monkeypatch, make_space, make_fields) -> None:
    monkeypatch.setattr(pictures, "render_shots", lambda shots: [b"picture"] * len(shots))
    page = render([case(make_space(fields=make_fields("triangle")), "case-1")])
    images = re.findall(
        r'<figure id="case-1-([^"]+)" class="picture">\s*<img src="data:image/png;base64,cGljdHVyZQ=="', page
    )
    assert images == ["view-1", "view-2", "view-3", "close"]
    assert 'id="case-1-ramp"' in page
    assert "displacements 50 times their size" in page
    assert "largest von Mises stress 47.2\u00a0MPa" in page


@pytest.mark.usefixtures("undrawn")
def test_all_else_is_drawn_while_pictures_are_made(monkeypatch, make_space, make_fields) -> None:
    drawn = Event()
    monkeypatch.setattr(sections, "SECTIONS", (lambda result, prefix: drawn.set(),))
    monkeypatch.setattr(pictures, "render_shots", lambda shots: [b"late" if drawn.wait(PATIENCE) else b""] * len(shots))
    (block,) = [of for of in case(make_space(fields=make_fields("line")), "case-1").blocks if of.pictures]
    assert {one.data for one in block.pictures} == {base64.b64encode(b"late").decode()}


@pytest.mark.usefixtures("undrawn")
def test_a_page_without_pictures_says_why(monkeypatch, make_space, make_fields) -> None:
    def refuse(shots: object) -> None:
        raise NoPictureError("nothing to draw with")

    monkeypatch.setattr(pictures, "render_shots", refuse)
    page = render([case(make_space(fields=make_fields("line")), "case-1")])
    assert "There are no pictures: nothing to draw with." in page and 'class="picture"' not in page


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
    views = pictures._Views(replace(alone, scene=scene, bodies=bodies, paths=paths, reach=8.0 + 0.0 * ahead[:, 0]))
    (moment, *_) = drawn_moments(views.result)
    places = [block.corners.mean(axis=0) for block in views._joint_pads(moment.frame)]
    assert [place[0] for place in places] == pytest.approx([2.15, 2.15, 5.85, 5.85])
    assert all(abs(place[2]) == pytest.approx(0.2 + THICK / 2.0) for place in places)  # walls are drawn thin
    (rod,) = (piece for piece in views._surrounding_pieces(moment) if piece.colour == pictures.CYLINDER)
    lug = np.array([np.cos(np.pi / 6.0) * 1.8 + 0.05, 0.0, 0.9 - 0.1 * np.cos(np.pi / 6.0)])
    assert rod.points[:4].mean(axis=0) == pytest.approx([0.4, 0.0, -1.2]) and rod.points[4:].mean(
        axis=0
    ) == pytest.approx(lug)
    (ground,) = views._ground_pieces(moment)
    assert ground.points[:, 2] == pytest.approx([-1.2] * 4) and ground.points[:, 0].max() == pytest.approx(
        1.05 * 8.0 * 0.75**0.5
    )
