"""The sketch of the system: everything that holds it, moves along it or acts on it is named or drawn."""

from __future__ import annotations

import re
from html import unescape

import pytest

from pmr.report import sentences
from pmr.report.blocks import Drawing
from pmr.report.figures import sketch
from pmr.report.figures.canvas import drawing
from pmr.results import RunResult

LOAD, GREY, INK = "#7b2d8e", "#5b6875", "#1c2733"


def drawn(result: RunResult) -> Drawing:
    return drawing("case-1-sketch", sketch.draw_sketch, sketch.sketch_caption(result), result)


def texts(result: RunResult) -> list[str]:
    return [
        unescape(text).replace("\u00a0", " ") for text in re.findall(r"<text[^>]*>([^<]+)</text>", drawn(result).svg)
    ]


def coloured(result: RunResult, colour: str) -> int:
    """Filled shapes of a colour: heads of arrows, points, masses."""
    svg = drawn(result).svg
    return svg.count(f'fill="{colour}"') + svg.count(f"fill: {colour}")


def test_a_beam_has_its_length_its_sliders_way_and_its_loads(whole: RunResult, make_result) -> None:
    assert texts(whole) == ["s = 1.25 m … 3.75 m", "5 m", "F"]
    still = make_result(slider={"path": 2.0})
    assert texts(still) == ["5 m", "F"] and "hollow" not in sketch.sketch_caption(still)
    assert "hollow" in sketch.sketch_caption(whole)


def test_a_boom_has_what_is_attached_to_it(boom: RunResult, make_space) -> None:
    assert texts(boom) == [
        *("cylinder", "2 m … 4.5 m beyond the mouth", "g", "payload, 250 kg", "tip force", "gust", "49.0 MPa")
    ]
    bare = make_space(loads=[], masses=[], supports=[])
    assert texts(bare) == ["2 m … 4.5 m beyond the mouth", "g", "49.0 MPa"] and coloured(bare, LOAD) == 0


def test_the_weight_points_where_it_does(boom: RunResult, make_space) -> None:
    raised = make_space(gravity={"inclination": 60.0})
    assert drawn(raised).svg != drawn(boom).svg and texts(raised) == texts(boom)
    assert ", raised by 60°," in sentences.opening_sentences(raised) and "raised" not in sentences.opening_sentences(
        boom
    )


@pytest.mark.parametrize(
    ("signal", "heads"),
    [(-50.0, 1), (50.0, 1), ({"kind": "sine", "amplitude": 5.0, "frequency": 3.0}, 2), (0.0, 1)],
)
def test_a_load_that_acts_both_ways_has_two_heads(make_result, signal: object, heads: int) -> None:
    result = make_result(loads=[{"name": "F", "on": 5.0, "signal": signal}])
    assert coloured(result, LOAD) == heads + 1  # and the name


def test_a_load_along_the_span_is_named_above_it(make_result) -> None:
    loads = [{"name": "M", "on": 2.0, "direction": "ry", "signal": 1.0}, {"name": "P", "on": 5.0, "signal": 1.0}]
    assert texts(make_result(loads=loads)) == ["s = 1.25 m … 3.75 m", "5 m", "M", "P"]
