from __future__ import annotations

import base64
import json
import re
from importlib import resources
from typing import Any

import numpy as np
import pytest

from pmr import RunResult
from pmr.report.columns import spread_indices
from pmr.report.player import FRAMES, POINTS, axis_motion, scale_words


def unpacked(series: dict[str, Any]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(series["data"]), dtype="<i2") * series["count"]


@pytest.fixture(scope="module")
def data(whole: RunResult) -> dict[str, Any]:
    return axis_motion(whole)


def test_motion_is_that_of_the_beam(whole: RunResult, data: dict[str, Any]) -> None:
    frames = spread_indices(len(whole.abscissa), FRAMES)
    assert [lane["label"] for lane in data["lanes"]] == ["full", "ANCF", "reduced"]
    for lane, name in zip(data["lanes"], ("full", "ancf", "reduced"), strict=True):
        (beam,) = lane["beams"]
        moved = unpacked(beam["w"]).reshape(data["frames"], -1)
        expected = whole.responses[name].displacement[frames]
        assert np.abs(moved - expected).max() <= 0.51 * beam["w"]["count"]
        assert beam["w"]["count"] < 1e-4 * np.abs(expected).max()


def test_slider_and_load_go_with_it(whole: RunResult, data: dict[str, Any]) -> None:
    frames = spread_indices(len(whole.abscissa), FRAMES)
    assert unpacked(data["s"]) == pytest.approx(whole.abscissa[frames], abs=1e-3)
    force, values = unpacked(data["loads"][0]["force"]).reshape(-1, 3), whole.loads.values[frames, 0]
    assert force[:, 2] == pytest.approx(values / np.abs(values).max(), rel=1e-3)
    assert data["loads"][0]["at"] == 5.0 and not force[:, :2].any()


def test_long_motion_is_thinned(make_result) -> None:
    data = axis_motion(make_result(steps=20_000))
    assert data["frames"] == FRAMES
    assert all(len(beam["x"]) <= POINTS for lane in data["lanes"] for beam in lane["beams"])
    assert len(json.dumps(data)) < 400_000


def test_exaggeration_is_round_and_said(data: dict[str, Any]) -> None:
    assert data["scale"] == 5.0  # 5 m * 0.1 / 0.05005 m, rounded down
    assert scale_words(data) == "Deflection is drawn 5 times its size; it reaches 50.0\u00a0mm."


def test_resting_beam_is_no_error(make_result) -> None:
    result = make_result(responses=("reduced",))
    result.responses["reduced"].displacement[:] = 0.0
    data = axis_motion(result)
    assert data["scale"] == 1.0
    assert scale_words(data) == "Nothing moves across the axis."


def test_playback_speed_is_one_of_the_choices(data: dict[str, Any]) -> None:
    assert data["speeds"]["first"] == pytest.approx(0.1)  # 3 s of motion play for 30 s
    assert data["speeds"]["first"] in data["speeds"]["choices"]


def test_player_reads_what_is_there(data: dict[str, Any]) -> None:
    player = resources.files("pmr.report").joinpath("templates", "axis_player.js").read_text(encoding="utf-8")
    assert set(re.findall(r"this\.data\.(\w+)", player)) <= set(data)
    assert set(re.findall(r"\bload\.(\w+)", player)) - {"moment"} <= set(data["loads"][0])
    assert {"x", "w", "label", "colour", "width", "dash"} <= set(data["lanes"][0]["beams"][0])


@pytest.mark.parametrize("script", ["axis_player.js", "body_player.js"])
def test_players_hide_nothing_of_what_they_share(script: str) -> None:
    folder = resources.files("pmr.report").joinpath("templates")
    member = re.compile(r"^  (?:get )?(\w+)\([^)]*\) \{", re.MULTILINE)
    shared, own = (set(member.findall(folder.joinpath(name).read_text("utf-8"))) for name in ("playback.js", script))
    assert {"toggle", "step", "clock"} <= shared and "draw" in own
    assert shared & own == {"constructor"}
