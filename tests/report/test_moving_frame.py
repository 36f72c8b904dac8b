"""What a report says of a frame that moves."""

import base64
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from boom_results import SUMMARY, MakeSpace
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from pmr import RunResult
from pmr.report import album, columns, player, sections, subject
from pmr.report import forces as loads
from pmr.report.document import render_runs
from pmr.report.figures import WIDE, histories, make_axes, section_colours, style
from pmr.report.figures import space as figures
from pmr.report.figures.histories import Timeline
from pmr.report.moving_bodies import MovingBodies
from pmr.report.sections import basis_block, chapter
from pmr.report.sentences import energy_sentence, frame_sentences
from pmr.results import Fields, Frequencies, Paths
from pmr.scene import load_any

TURNING = {
    "luffing": {"min": 0.0, "max": 1.0471975511965976}, "slewing": {"min": 0.0, "max": 0.0}, "angular_velocity": 0.1,
    "gyroscopic": 0.02, "centrifugal": 0.0001,
}  # fmt: skip


class _Result:
    def __init__(self, **summary: Any) -> None:
        self.summary = summary


def said(**summary: Any) -> str:
    result: RunResult = _Result(**summary)  # type: ignore[assignment]
    return frame_sentences(result)


def test_nothing_is_said_of_a_frame_that_there_is_not() -> None:
    assert said() == ""


def test_what_is_left_out_is_said_with_its_size() -> None:
    text = said(frame={**TURNING, "second_order": False})
    assert "left out" in text and "gyroscopic forces (2.00\u00a0%)" in text


@pytest.mark.parametrize(("factor", "expected"), [(3.2, "3.2"), (None, "no axial force compresses")])
def test_second_order_is_said_with_the_buckling_factor(factor: float | None, expected: str) -> None:
    text = said(frame={**TURNING, "second_order": True}, buckling={"factor": factor, "t": 10.0})
    assert expected in text and "left out" not in text


def test_the_energy_in_space_is_said_with_who_does_the_work() -> None:
    found: RunResult = _Result(energy={"change": 12.0, "drives": 20.0, "others": -5.0, "lost": 3.0})  # type: ignore[assignment]
    text = energy_sentence(found)
    for figure in ("12.0", "20.0", "\u22125.00", "3.00"):
        assert f"{figure}\u00a0J" in text
    assert energy_sentence(_Result()) == ""  # type: ignore[arg-type]


def test_published_frequencies_of_a_boom_that_keeps_its_length_say_of_which_posture_they_are(make_result) -> None:
    published = {"source": "a paper", "frequencies": [{"reach": 9.0, "first": 2.0}]}
    row = {"reach": 9.0, "published": 2.0, "reduced": 2.1}
    result = make_result(published=published, summary={"published_frequencies": [row]})
    for along, says in ((np.full(3, 9.0), True), (np.array([8.0, 9.0, 10.0]), False)):
        frequencies = Frequencies(along, along[:, None], {}, t=np.array([0.0, 1.0, 2.5]))
        (grid,) = basis_block(replace(result, frequencies=frequencies), "a").grids
        assert grid.caption.endswith("the frequency is the lowest one of its postures.") is says


FRAME = {
    "pivot": [0.5, 0.0, -0.3],
    "unit": "degrees",
    "luffing": {"kind": "smooth_ramp", "times": [0.0, 1.0], "values": [10.0, 70.0]},
    "slewing": {"kind": "smooth_ramp", "times": [0.0, 1.0], "values": [0.0, 120.0]},
}


@pytest.fixture(scope="module")
def turned(make_space: MakeSpace) -> RunResult:
    """A beam that is raised and slewed, with a buckling factor and what it presses on its machine with."""
    angles = {"luffing": {"min": 0.17, "max": 1.22}, "slewing": {"min": 0.0, "max": 2.1}}
    said = {**angles, "angular_velocity": 3.0, "second_order": True, "gyroscopic": 0.02, "centrifugal": 1e-4}
    over = {"t": [0.0, 0.5, 1.0], "factor": [9.0, 4.0, None]}
    summary = SUMMARY | {"frame": said, "buckling": {"factor": 4.0, "t": 0.5, "over": over}}
    result = make_space(summary=summary, frame=FRAME)
    held = result.responses["reduced"]
    names, units = ("x", "y", "ry"), ("N", "N", "N m")
    acting = np.stack([-75e3 + 0.0 * held.t, 1e-6 * np.sin(held.t), 40e3 * np.cos(held.t)], axis=1)
    kinds = ("beam y",) * 5 + ("beam z",) * 5 + ("tip y", "tip z") + ("pad",) * 7 + ("reaction",) * 3
    pressed = replace(
        held,
        others=acting,
        other_names=tuple(f"reaction of pivot {name}" for name in names),
        other_units=units,
        force_names=tuple(f"force of {k}" for k in range(7)),
        kinds=kinds,
        bodies=("",) * len(kinds),
    )
    return replace(result, responses={**result.responses, "reduced": pressed})


def unpacked(series: dict[str, Any]) -> np.ndarray:
    return series["count"] * np.frombuffer(base64.b64decode(series["data"]), "<i2")


def expected_tip(result: RunResult, scale: float) -> np.ndarray:
    """Pivot and R(t) (x + u) of the tip, written out."""
    response, frame_ = result.responses["reduced"], result.scene.frame
    assert frame_ is not None
    luffing, slewing = (angle.value(response.t) for angle in frame_.angles)
    x, y, z = 0.5 + 6.0, scale * response.displacement[:, -2], -0.3 + scale * response.displacement[:, -1]
    out, up = x * np.cos(luffing) - z * np.sin(luffing), x * np.sin(luffing) + z * np.cos(luffing)
    X, Y = out * np.cos(slewing) - y * np.sin(slewing), out * np.sin(slewing) + y * np.cos(slewing)
    return np.stack([out, up, X, Y], axis=1)


def test_axes_stand_where_the_frame_has_turned_them(turned: RunResult) -> None:
    steps = [0, 300, 1000]
    (axis,) = columns.body_axes(turned, steps, 20.0)
    found = np.hstack([axis.side[:, -1], axis.plan[:, -1]])
    assert found == pytest.approx(expected_tip(turned, 20.0)[steps], abs=1e-12)


@pytest.mark.slow
def test_a_page_shows_the_boom_in_space_and_only_with_a_frame(turned: RunResult, boom: RunResult) -> None:
    here, there = render_runs([chapter(turned, "case-1")]), render_runs([chapter(boom, "case-1")])
    for figure in ("plan", "tip-in-space", "buckling", "pivot-forces", "pivot-moments"):
        assert f'id="case-1-{figure}"' in here and f'id="case-1-{figure}"' not in there
    assert "Height over the pivot in m" in here and '"pose": {' in here
    assert "Height over the pivot in m" not in there and '"pose": null' in there


def test_no_panel_is_empty_and_round_off_is_not_drawn(turned: RunResult) -> None:
    """A force that stays at -75 kN lies within its axes; what is 1e-11 of it has no curve."""
    outputs = turned.responses["reduced"].outputs
    with style():
        drawn = histories.output_figure(turned, [one for one in outputs if one.name == "reaction of pivot x"])
        views = [figures.side_view(turned), figures.plan_view(turned), figures.buckling_figure(turned)]
    (ax,) = drawn.axes
    curve, (low, high) = ax.lines[0].get_ydata(), ax.get_ylim()
    assert np.asarray(curve) == pytest.approx(-75.0) and low < -75.0 < high and ax.get_ylabel() == "Force in kN"
    for view in views:
        for ax in view.axes:
            (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
            places = np.concatenate(
                [np.asarray(one.get_xydata()) for one in ax.lines if one.get_transform() == ax.transData]
            )
            places = places[np.isfinite(places).all(axis=1)]
            assert len(places) > 2
            assert (places >= (left, low)).all() and (places <= (right, high)).all()


def test_all_that_is_prescribed_is_shaded(make_space: MakeSpace) -> None:
    """Slewing until 0.1 s, however little, sliding from 0.2 s to 0.7 s, and luffing from 0.6 s on to 0.9 s."""
    luffing, slewing = (
        {"kind": "ramp", "times": times, "values": values}
        for times, values in (([0.6, 0.9], [0.0, 1.0]), ([0.0, 0.1], [0.0, 1e-6]))
    )
    time = Timeline(make_space(frame={"pivot": [0.0, 0.0, 0.0], "luffing": luffing, "slewing": slewing}))
    found = np.array([(phase.start, phase.end) for phase in time.phases])
    assert found == pytest.approx(np.array([(0.0, 0.1), (0.2, 0.9)]), abs=1.5e-3)  # of steps of 1 ms
    with style():
        _, ax = make_axes(WIDE, 2.0, "", "")
        time.frame(ax, "Force in N")
    assert [patch.get_label() for patch in ax.patches] == ["boom moves"] * 2


def boxes(figure: Figure, text: str) -> list[np.ndarray]:
    """Left lower and right upper corners (2, 2) in px of labels that hold a text, as they are drawn."""
    renderer = FigureCanvasAgg(figure).get_renderer()
    found = [one for one in figure.axes[0].texts if text in one.get_text()]
    for one in found:
        one.update_positions(renderer)
    return [Text.get_window_extent(one, renderer).get_points() for one in found]  # without lines that lead to it


def test_labels_of_moments_do_not_cover_each_other(make_space: MakeSpace) -> None:
    """A boom that luffs by 0.1 degrees has one, of the largest stress; one that luffs by 60 degrees has all four."""
    angle = {"kind": "smooth_ramp", "times": [0.0, 1.0]}
    for high, count in ((0.602, 1), (1.6, 4)):
        result = make_space(frame={"pivot": [0.0, 0.0, 0.0], "luffing": angle | {"values": [0.6, high]}})
        with style():
            found = boxes(figures.side_view(result), "\u00a0s")
        assert len(found) == count
        for k, one in enumerate(found):
            assert not any((one[0] < other[1]).all() and (other[0] < one[1]).all() for other in found[:k])


@pytest.mark.usefixtures("undrawn")
def test_an_angle_that_stays_as_it_is_is_not_drawn(make_space: MakeSpace, turned: RunResult) -> None:
    still, ramp = {"pivot": [0.0, 0.0, 0.0], "slewing": 0.2}, FRAME["luffing"]
    result = make_space(frame=still | {"luffing": ramp})
    assert list(subject.changing_angles(result)) == ["luffing"]
    assert list(subject.changing_angles(turned)) == ["luffing", "slewing"]
    captions = [one.caption for one in sections.input_block(result, "case-1").drawings]
    assert captions[-1] == "Luffing over time."
    drawings = sections.input_block(make_space(frame=still | {"luffing": 0.3}), "case-1").drawings
    assert [one.name for one in drawings] == ["case-1-position", "case-1-loads-0"]


@pytest.mark.usefixtures("undrawn")
def test_sums_over_all_supports_stand_with_the_machine_and_not_among_supports(turned: RunResult) -> None:
    """The force along y, 1e-11 of that along x, has no row."""
    block = loads.pivot_block(turned, "case-1")
    assert block is not None and [[row[0] for row in grid.rows] for grid in block.grids] == [
        ["force along x", "moment about y"]
    ]
    assert block.grids[0].rows[0][1] == "\u221275.0\u00a0kN at 0\u00a0s, 1.5\u00a0m"
    assert loads.support_block(turned, "case-1") is None


@pytest.mark.parametrize("kind", ["line", "triangle"])
def test_bodies_are_played_and_pictured_where_they_are(
    make_space: MakeSpace, make_fields: Callable[[str], Fields], kind: str
) -> None:
    """Rotations and origins of the page, and points of pictures: tail at its place from the pivot, tip above it."""
    result = make_space(fields=make_fields(kind), frame={"pivot": [0.5, 0.0, -0.3], "unit": "degrees", "luffing": 90.0})
    pose = player.body_motion(MovingBodies(result))["pose"]
    rotation, origin = unpacked(pose["rotation"]).reshape(-1, 3, 3), unpacked(pose["origin"]).reshape(-1, 3)
    s = result.scene.slider.path.value(result.body.fields.t)  # the body is drawn at -s, and pads at its mouth at 0
    assert origin == pytest.approx(np.stack([0.5 + s, 0.0 * s, -0.3 + 0.0 * s], axis=1), abs=1e-3)
    assert rotation == pytest.approx(np.tile([[0, 0, -1], [0, 1, 0], [1, 0, 0]], (len(s), 1, 1)), abs=1e-3)
    low, high = np.array(pose["centre"]) - pose["size"] / 2.0, np.array(pose["centre"]) + pose["size"] / 2.0
    assert low[2] <= 0.0 and high[2] >= 6.5
    shot = next(shot for _, shot, _ in album._Views(MovingBodies(result)).shots())
    body = shot.pieces[0].points
    assert body[:, 2].min() == pytest.approx(0.5, abs=0.2) and body[:, 2].max() == pytest.approx(6.5, abs=0.2)
    assert np.abs(body[:, 1]).max() < 0.3


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ((1.5, -0.15, -0.2),
         "seen from the right of the boom and from below; the picture has the tip at the right. "
         "The picture shows the state at 0.40\u00a0s,"),
        ((1.5, 0.15, 0.2),
         "seen from the left of the boom and from above; the picture has the tip at the left. "
         "The picture shows the state at 0.40\u00a0s,"),
    ],
)  # fmt: skip
def test_the_largest_stress_is_pictured_from_its_side_at_the_time_nearest_to_it(
    make_space: MakeSpace, make_fields: Callable[[str], Fields], place: tuple[float, ...], said: str
) -> None:
    """The body's axis is level in the picture, however it is raised: the camera is turned with it."""
    peak = {"t": 0.42, "position": place, "value": 49e6}
    frame = {"pivot": [0.0, 0.0, 0.0], "unit": "degrees", "luffing": 60.0}
    summary = SUMMARY | {"stress_peak": {"reduced": peak}}
    result = make_space(fields=make_fields("line"), frame=frame, summary=summary)
    ((shot, caption),) = [
        (shot, text) for name, shot, text in album._Views(MovingBodies(result)).shots() if name == "close"
    ]
    assert said in caption and "the stored time nearest to 0.42\u00a0s" in caption
    ring = shot.pieces[-1].points @ shot.view.T  # around the place, in front of all else
    middle, centre = ring.mean(axis=0), shot.view @ np.array(shot.centre)
    assert np.ptp(ring[:, :2], axis=0) == pytest.approx(2.0 * album.RING[1], rel=0.02)
    assert np.linalg.norm(middle[:2] - centre[:2]) == pytest.approx(0.2, abs=0.08)  # half a section from its axis
    axis, up, aside = np.array([0.5, 0.0, 3**0.5 / 2.0]), np.array([-(3**0.5) / 2.0, 0.0, 0.5]), np.array([0, 1.0, 0])
    assert np.array(shot.up) == pytest.approx(up, abs=1e-12)
    for way, k in ((up, 2), (aside, 1)):  # on the side of the axis that the place is on
        assert np.dot(shot.direction, way) * place[k] > 0.0
    across = np.cross(shot.up, shot.direction)
    assert (np.dot(across, axis) > 0.0) == ("tip at the right" in said)


def test_bodies_without_a_frame_have_no_pose(make_space: MakeSpace, make_fields: Callable[[str], Fields]) -> None:
    assert player.body_motion(MovingBodies(make_space(fields=make_fields("triangle"))))["pose"] is None


def test_extensions_are_drawn_in_the_colours_of_their_sections(boom: RunResult) -> None:
    scene, t = load_any("boom_two"), boom.responses["reduced"].t
    extensions = np.stack([path.value(t) for path in scene.paths.values()], axis=1)
    result = replace(boom, scene=scene, paths=Paths(tuple(scene.paths), extensions, np.zeros_like(extensions)))
    drawn = sections.input_block(result, "case-1").drawings[0]
    colours = section_colours(scene.bodies)
    assert drawn.name == "case-1-position" and all(colours[name] in drawn.svg for name in scene.paths)
