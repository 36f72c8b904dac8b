"""Bodies in pictures; and the system from the side: what holds a body, moves along it or acts on it is drawn."""

from dataclasses import replace

import numpy as np
import pytest

from pmr import RunResult
from pmr.report.columns import axis_points
from pmr.report.figures import space, style
from pmr.report.moving_bodies import Block, MovingBodies, body_surface, build_surroundings, cell_stresses
from pmr.report.player import body_motion, playback_speeds
from pmr.results.field_series import THICK, Grid
from pmr.scene.box import Box


def test_each_third_of_the_way_shows_its_largest_stress(make_space, make_fields) -> None:
    fields = make_fields("triangle")
    result = make_space(fields=fields)
    found = MovingBodies(result).moments()
    # s rises from 1.5 m at 0.2 s to 4 m at 0.7 s, the stress follows half a sine over the second
    assert [moment.t for moment in found] == pytest.approx([0.35, 0.5, 0.55])
    assert [moment.extension for moment in found] == pytest.approx([6.0 - moment.s for moment in found])
    assert [moment.s for moment in found] == pytest.approx(
        MovingBodies(result).mouth[[moment.frame for moment in found]]
    )
    assert found[1].peak == pytest.approx(cell_stresses(fields).max())


def test_of_two_pictures_that_look_alike_the_one_with_the_larger_stress_is_shown(make_space, make_fields) -> None:
    """The stress peaks at 0.65 s, at the end of the second third of the way; the last third begins at 0.7 s."""
    slow = {"path": {"kind": "ramp", "times": [0.2, 0.9], "values": [1.5, 4.0]}}
    fields = make_fields("triangle")
    bell = np.exp(-(((fields.t - 0.65) / 0.1) ** 2))[:, None]
    peaked = replace(fields, von_mises={"outer": 1e6 * bell + 0.0 * cell_stresses(fields)})
    found = MovingBodies(make_space(fields=peaked, slider=slow)).moments()
    assert [moment.t for moment in found] == pytest.approx([0.4, 0.65])


def test_real_time_is_among_the_speeds_of_a_player() -> None:
    assert playback_speeds(14.0) == {"first": 0.2, "choices": [0.04, 0.1, 0.2, 0.4, 0.8, 1.0]}
    assert playback_speeds(150.0)["choices"] == [1.0, 2.5, 5.0, 10.0, 20.0]


def test_pictures_stand_in_order_of_time_where_the_mouth_goes_back(make_space, make_fields) -> None:
    back = {"path": {"kind": "ramp", "times": [0.2, 0.7], "values": [4.0, 1.5]}}
    found = MovingBodies(make_space(fields=make_fields("triangle"), slider=back)).moments()
    assert len(found) == 3 and [moment.t for moment in found] == sorted(moment.t for moment in found)


def test_a_mouth_at_rest_is_shown_once(make_space, make_fields) -> None:
    fields = make_fields("line")
    (only,) = MovingBodies(make_space(fields=fields, slider={"path": 2.0})).moments()
    assert (only.t, only.s) == (0.5, 2.0)


def test_without_stresses_the_largest_displacement_counts(make_space, make_fields) -> None:
    fields = replace(make_fields("line"), von_mises={})
    found = MovingBodies(make_space(fields=fields)).moments()
    assert [moment.t for moment in found] == pytest.approx([0.35, 0.5, 0.55])
    assert {moment.peak for moment in found} == {0.0}


def test_scale_and_quarters_of_the_colours_are_round(make_space, make_fields) -> None:
    fields = make_fields("triangle")
    result = make_space(fields=fields)
    assert MovingBodies(result).scale == 50.0  # 8 mm of 6 m
    assert MovingBodies(result).colour_limit == pytest.approx(48e6)
    assert np.quantile(cell_stresses(fields).max(axis=0), 0.98) <= MovingBodies(result).colour_limit
    for most, colour in ((24.3e6, 28e6), (47.3e6, 48e6), (9.9e6, 10e6), (4.0e5, 4.0e5)):
        level = replace(fields, von_mises={"outer": np.full_like(cell_stresses(fields), most)})
        assert MovingBodies(make_space(fields=level)).colour_limit == pytest.approx(colour)
    still = replace(fields, displacement=0.0 * fields.displacement, von_mises={"outer": 0.0 * cell_stresses(fields)})
    rests = make_space(fields=still)
    assert (MovingBodies(rests).scale, MovingBodies(rests).colour_limit) == (1.0, 1.0)


def test_a_peak_that_is_shared_is_shown_where_the_text_has_it(make_space, make_fields) -> None:
    """Two cells and two moments with the same stress, as far as single precision keeps it: the summary decides."""
    fields = make_fields("triangle")
    count = cell_stresses(fields).shape[1]
    level = np.full((len(fields.t), count), 1e6, np.float32)
    level[[4, 12], 3] = 5e6
    level[[4, 12], count - 2] = np.nextafter(np.float32(5e6), np.float32(1e7), dtype=np.float32)
    twice = replace(fields, von_mises={"outer": level})
    for frame, cell in ((4, 3), (12, 3), (12, count - 2), (4, count - 2)):
        place = [0.1 * cell, 0.15, -0.2]
        peak = {"value": 5e6, "t": float(fields.t[frame]), "position": place, "cell": cell}
        result = make_space(fields=twice, summary={"stress_peak": {"reduced": peak}})
        bodies = MovingBodies(result)
        shown, (body, found) = bodies.moment_of_peak(), bodies.place_of_peak(bodies.moment_of_peak())
        assert (shown.frame, body, list(found)) == (frame, "", place)
    between = {"t": float(0.6 * fields.t[7] + 0.4 * fields.t[8])}  # kept neither then nor there
    shown = MovingBodies(make_space(fields=twice, summary={"stress_peak": {"reduced": between}})).moment_of_peak()
    assert shown.frame == 7
    largest = MovingBodies(make_space(fields=twice, summary={})).moment_of_peak()
    assert largest.frame == 4
    _, place = MovingBodies(make_space(fields=twice, summary={})).place_of_peak(largest)
    assert list(place) == list(fields.points[fields.cells[count - 2]].mean(axis=0))
    walls = {"value": 6e6, "t": float(fields.t[6]), "position": [0.3, 0.15, 0.1], "section": "", "region": "left"}
    summary = {"stress_peak": {"reduced": peak}, "budget": {"model": {"wall_stress": walls}}}
    bodies = MovingBodies(make_space(fields=twice, summary=summary))  # the first page has the stress in walls
    assert bodies.moment_of_peak().frame == 6
    assert list(bodies.place_of_peak(bodies.moment_of_peak()).point) == walls["position"]


@pytest.fixture(scope="module")
def blocks(make_space, make_fields) -> tuple[RunResult, object]:
    fields = make_fields("triangle")
    result = make_space(fields=fields)
    return result, build_surroundings(result, body_surface(fields))


def extent(block: Block) -> np.ndarray:
    return np.array([block.corners.min(axis=0), block.corners.max(axis=0)])


def test_pads_lie_on_their_faces(blocks) -> None:
    _, around = blocks
    right, left, top, side = (extent(block) for block in around.near)
    assert np.allclose(right, [(-0.15, -0.14, -0.2 - THICK), (0.15, -0.06, -0.2)])
    assert np.allclose(left[:, 1], (0.06, 0.14))
    assert np.allclose(top[:, 2], (0.2, 0.2 + THICK))
    assert np.allclose(side[:, 1], (-0.15 - THICK, -0.15)) and np.allclose(side[:, 2], (-0.04, 0.04))
    assert [extent(block)[:, 0].mean() for block in around.tail] == pytest.approx([0.15] * 3)


def test_the_next_section_holds_the_body_at_every_extension(blocks) -> None:
    result, around = blocks
    (back, *_), (front, *_) = extent(around.section[0])
    assert back < -result.abscissa.max() and front == pytest.approx(0.15)
    assert np.all(extent(around.section[0])[0, 1:] < (-0.15 - THICK, -0.2 - THICK))
    assert len(around.section[0].sides) == 4  # open at both ends


BOX = Box(length=6.0, width=0.3, height=0.4, wall=0.008)


def area(points: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


@pytest.mark.parametrize(
    ("kind", "expected"), [("triangle", 1.4 * 6.0), ("line", 1.4 * 6.0), ("hexahedron", 1.4 * 6.0 + 2.0 * 0.12)]
)
def test_what_is_seen_is_the_outside(make_fields, kind: str, expected: float) -> None:
    fields = make_fields(kind)
    body = body_surface(fields, BOX)
    assert area(body.points, body.triangles) == pytest.approx(expected, rel=1e-6)
    centres = body.points[body.triangles].mean(axis=1)[:, 0]
    of_triangle = np.tile(body.cell, len(body.triangles) // len(body.cell))
    cells = fields.points[fields.cells].mean(axis=1)[of_triangle, 0]
    assert np.all(np.abs(centres - cells) <= 0.5 + 1e-9)  # each triangle with the cell that it belongs to


def test_what_two_solids_share_is_not_seen(make_fields) -> None:
    fields = make_fields("hexahedron")
    assert len(body_surface(fields).faces) == 4 * len(fields.cells) + 2
    wedge = replace(fields, grid=Grid("tetra", fields.points, np.array([[0, 1, 3, 4], [1, 3, 4, 5]])))
    assert len(body_surface(wedge).faces) == 6


def test_sections_of_beams_stay_across_the_axis(make_fields) -> None:
    fields = make_fields("line")
    turned = np.zeros((len(fields.points), 3), np.float32)
    turned[:, 2] = 0.01 * fields.points[:, 0]  # slope of 1 %: what is above moves back
    body = body_surface(fields, BOX)
    moved = body.point_displacements(fields, turned)
    assert np.allclose(moved[:, 0], -0.01 * body.points[:, 2], atol=1e-7)
    assert np.allclose(moved[:, 2], turned[body.vertex, 2])


def arrows(result: RunResult) -> dict[str, str]:
    """Styles of the arrows of loads in the drawing of the system, by the loads' names."""
    with style():
        texts = space.side_view(result).axes[0].texts
    drawn = [text.arrow_patch.get_arrowstyle() for text in texts if not text.get_text() and text.arrow_patch]
    names = [text.get_text() for text in texts if text.get_color() == space.LOAD and text.get_text()]
    return {name: type(arrow).__name__ for name, arrow in zip(names, drawn, strict=True)}


def markers(result: RunResult) -> list[tuple[str, float]]:
    """Markers of supports, pads and sliders in the drawing of the system, with their places along the body."""
    with style():
        lines = space.side_view(result).axes[0].lines
    return sorted((line.get_marker(), float(line.get_xdata()[0])) for line in lines if line.get_markersize() == 5.0)


def legend(result: RunResult) -> list[str]:
    """Names of the symbols in the legend of the view from the side."""
    with style():
        return [text.get_text() for text in space.side_view(result).legends[0].get_texts()]


def test_a_beam_has_its_support_its_slider_and_its_loads(whole: RunResult, make_result) -> None:
    assert markers(whole) == [("^", 0.0), ("s", 1.25), ("s", 3.75)] and list(arrows(whole)) == ["F"]
    still = make_result(slider={"path": 2.0})
    assert markers(still) == [("^", 0.0), ("s", 2.0)]
    far = "slider, at its farther end"
    assert legend(whole) == ["support", far, "slider"] and legend(still) == ["support", "slider"]


def test_a_boom_has_its_pads_and_its_load_along_z(boom: RunResult, make_space) -> None:
    assert markers(boom)[0] == ("s", 0.15) and arrows(boom) == {"tip force": "CurveFilledAB"}
    assert arrows(make_space(loads=[])) == {}


@pytest.mark.parametrize(
    ("signal", "heads"),
    [(-50.0, "CurveFilledB"), (50.0, "CurveFilledB"),
     ({"kind": "sine", "amplitude": 5.0, "frequency": 3.0}, "CurveFilledAB")],
)  # fmt: skip
def test_a_load_that_acts_both_ways_has_two_heads(make_result, signal: object, heads: str) -> None:
    assert arrows(make_result(loads=[{"name": "F", "on": 5.0, "signal": signal}])) == {"F": heads}


def test_a_load_that_does_not_act_at_the_time_of_the_largest_stress_is_left_out(make_result, make_space) -> None:
    """Without stresses all loads are drawn, though the boom is drawn as it is at the start."""
    late = {"kind": "smooth_ramp", "times": [0.6, 0.8], "values": [0.0, 5.0]}
    assert list(arrows(make_result(loads=[{"name": "F", "on": 5.0, "signal": late}]))) == ["F"]
    loads = [{"name": name, "on": "tip", "direction": "z", "signal": of} for name, of in (("late", late), ("F", 5.0))]
    assert list(arrows(make_space(loads=loads))) == ["F"]  # the stress is largest at 0.5 s


def test_what_slides_and_holds_is_played_without_fields(whole: RunResult) -> None:
    """The slider keeps its place, the support moves with the body: it is at -s while the slider is at 0."""
    data = body_motion(MovingBodies(whole))
    assert [np.mean(block["corners"][0::3]) for block in data["near"]] == [0.0]
    assert [np.mean(block["corners"][0::3]) for block in data["tail"]] == [0.0]
    assert data["section"] == [] and data["back"] == pytest.approx(-3.75)
    (body,) = data["bodies"]
    assert body["stress"] is None and body["motion"]["count"] == 1


def test_points_of_an_axis_are_sorted_in_each_direction_by_themselves(make_space) -> None:
    """Columns along y come in another order than those along z."""
    result = make_space()
    response, count = result.responses["reduced"], 3
    x = np.array([4.0, 2.0, 0.0, 0.0, 2.0, 4.0])
    moved = replace(
        response,
        x=x,
        displacement=np.tile(x, (len(response.t), 1)),
        kinds=("point y",) * count + ("point z",) * count,
        bodies=(next(iter(result.scene.bodies)),) * 2 * count,
        output_names=tuple(f"point {k}" for k in range(2 * count)),
        output_units=("m",) * 2 * count,
        slider_force=None,
        force_names=(),
        others=None,
        other_names=(),
        other_units=(),
    )
    (line,) = axis_points(replace(result, responses={"reduced": moved}))
    assert line.x.tolist() == [0.0, 2.0, 4.0]
    assert line.displacement[0].tolist() == [[0.0, x, x] for x in line.x]
