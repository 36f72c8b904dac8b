import base64
import json
import re
from dataclasses import replace
from importlib import resources
from typing import Any

import numpy as np
import pytest

from pmr import RunResult
from pmr.report import player as players
from pmr.report.document import render_runs as render
from pmr.report.moving_bodies import MovingBodies, body_surface
from pmr.report.player import body_motion, compress, drawing_sentence
from pmr.report.sections import chapter as case
from pmr.results import BodyResult


def unpacked(series: dict[str, Any]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(series["data"]), dtype="<i2") * series["count"]


def frames_of(packed: dict[str, Any]) -> np.ndarray:
    columns, shapes = ([unpacked(one) for one in packed[name]] for name in ("coefficients", "shapes"))
    return np.stack(columns, axis=1) @ np.stack(shapes)


@pytest.fixture(scope="module")
def boom_in_motion(make_space, make_fields) -> RunResult:
    return make_space(fields=make_fields("hexahedron"))


@pytest.fixture(scope="module")
def data(boom_in_motion: RunResult) -> dict[str, Any]:
    return body_motion(MovingBodies(boom_in_motion))


def test_motion_and_stress_are_those_of_the_fields(boom_in_motion: RunResult, data: dict[str, Any]) -> None:
    fields = boom_in_motion.body.fields
    body = body_surface(fields)
    moved = body.point_displacements(fields, fields.displacement).reshape(len(fields.t), -1)
    assert np.abs(frames_of(data["bodies"][0]["motion"]) - moved).max() < 1e-4 * np.abs(moved).max()
    stress = fields.von_mises["outer"][:, body.cell] / 48e6
    assert np.abs(frames_of(data["bodies"][0]["stress"]) - stress).max() < 1e-4 * stress.max()
    assert data["lost"] < 1e-4


def test_the_page_gets_what_the_surface_has(boom_in_motion: RunResult, data: dict[str, Any]) -> None:
    body = body_surface(boom_in_motion.body.fields)
    assert np.allclose(unpacked(data["bodies"][0]["points"]).reshape(-1, 3), body.points, atol=1e-3)
    indices = np.frombuffer(base64.b64decode(data["bodies"][0]["triangles"]), "<u4").reshape(-1, 3)
    assert np.array_equal(indices, body.triangles) and data["bodies"][0]["faces"] == len(body.faces)
    assert np.array_equal(np.arange(len(indices)) % data["bodies"][0]["faces"], np.tile(np.arange(len(body.faces)), 2))
    assert np.allclose(unpacked(data["path"])[[0, -1]], (1.5, 4.0), atol=1e-3)
    assert (data["first"], data["scale"]) == (10, 50.0)  # the time of the largest stress


def test_few_shapes_hold_a_motion_that_needs_few_and_no_more_than_there_is_room_for() -> None:
    t, x = np.linspace(0.0, 1.0, 40)[:, None], np.linspace(0.0, 1.0, 300)
    frames = (np.sin(9.0 * t) * x + 0.1 * np.cos(20.0 * t) * x**2).astype(np.float32)
    packed = compress(frames, 3000)
    assert packed["count"] == 2 and packed["lost"] < 1e-4
    packed = compress(frames, 300)
    assert packed["count"] == 1 and 0.01 < packed["lost"] < 0.2
    found = np.linalg.norm(frames_of(packed) - frames) / np.linalg.norm(frames)
    assert found == pytest.approx(packed["lost"], rel=1e-2)


def test_what_rests_is_no_error(boom_in_motion: RunResult) -> None:
    fields = boom_in_motion.body.fields
    still = replace(fields, displacement=0.0 * fields.displacement, von_mises={})
    data = body_motion(MovingBodies(replace(boom_in_motion, bodies={"": BodyResult(None, still)})))
    assert data["bodies"][0]["stress"] is None and data["scale"] == 1.0
    assert "NaN" not in json.dumps(data)


def test_with_one_time_or_too_many_faces_nothing_is_played(monkeypatch, boom_in_motion: RunResult) -> None:
    fields = boom_in_motion.body.fields
    once = replace(
        fields, t=fields.t[:1], displacement=fields.displacement[:1], von_mises={"outer": fields.von_mises["outer"][:1]}
    )
    assert body_motion(MovingBodies(replace(boom_in_motion, bodies={"": BodyResult(None, once)}))) == {}
    monkeypatch.setattr(players, "MOST_FACES", 10)
    assert body_motion(MovingBodies(boom_in_motion)) == {}
    assert drawing_sentence({}) == ""


def test_scale_and_what_is_left_out_are_said(data: dict[str, Any]) -> None:
    assert drawing_sentence(data).startswith("Displacements are drawn 50 times their size, with an error of ")


def test_script_reads_what_is_there(data: dict[str, Any]) -> None:
    script = resources.files("pmr.report").joinpath("templates", "player.js").read_text("utf-8")
    asked = set(re.findall(r"this\.data\.(\w+)", script))
    assert asked <= set(data) and {"bodies", "tail", "back"} <= asked
    assert set(re.findall(r"\bbody\.(\w+)", script)) - {"rest"} <= set(data["bodies"][0])


@pytest.mark.usefixtures("undrawn")
def test_the_page_plays_offline_and_pictures_stand_beside(monkeypatch, boom_in_motion: RunResult) -> None:
    page = render([case(boom_in_motion, "case-1")])
    assert page.count("<canvas") == page.count("class Player") == 1
    assert re.search(r'<option value="50" selected>50 ×</option>', page)
    assert "http:" not in page and "https:" not in page and 'id="case-1-ramp"' in page
    assert ".animation { display: none; }" in page  # in print
