"""Sketch of the system: the body, its supports, its sliders or pads, and its loads."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, Polygon, Rectangle
from numpy.typing import NDArray

from pmr.report.columns import axis_points
from pmr.report.figures import space
from pmr.report.figures.canvas import INK, LIMIT, MUTED, make_sheet
from pmr.report.figures.space import largest_stress
from pmr.report.numbers import format_input, format_quantity
from pmr.report.subject import (
    AppliedLoad,
    axial_supports,
    fixtures,
    input_loads,
    is_alone,
    moving_part,
    reach,
    slider_offsets,
)
from pmr.results import RunResult
from pmr.scene.box import Box

LOAD = "#7b2d8e"
WIDTH = 3.9  # in, narrow enough for a phone to show the whole sketch with legible text
LABELS = 1.2  # in, width of the texts beside the tip


class Paper:
    """Axes in m of known size in inches.

    `inch` is the length in m that one inch on paper stands for, in both directions.
    """

    def __init__(self, left_end: float, right_end: float, height: float) -> None:
        inches = WIDTH - LABELS - 0.2
        self.figure, axes = make_sheet(WIDTH, height, margins={"left": 0.0, "right": 0.0, "top": 0.0, "bottom": 0.0})
        self.ax: Axes = axes[0, 0]
        self.inch = (right_end - left_end) / inches
        self.ax.set_xlim(left_end - 0.2 * self.inch, right_end + LABELS * self.inch)
        self.ax.set_ylim(-height / 2.0 * self.inch, height / 2.0 * self.inch)
        self.ax.set_axis_off()

    def box(self, x: float, y: float, width: float, height: float, **look: Any) -> None:
        """Draw a rectangle with its lower left corner at (x, y), a `width` and a `height`; `look` are its keywords."""
        self.ax.add_patch(Rectangle((x, y), width, height, **look))

    def disc(self, x: float, y: float, radius: float, **look: Any) -> None:
        """Draw a circle of `radius` about the point (x, y)."""
        self.ax.add_patch(Circle((x, y), radius, linewidth=0.8, zorder=3.0, **look))

    def arrow(self, x: float, y: float, dx: float, dy: float, colour: str = LOAD, two_heads: bool = False) -> None:
        """Draw an arrow from (x, y) by (dx, dy), with a head at its end, or at both ends if `two_heads`.

        Nothing is drawn if its length is 0.
        """
        if dx or dy:
            head = f"{'<|' if two_heads else ''}-|>,head_length=4.5,head_width=1.9"
            look = {"arrowstyle": head, "color": colour, "linewidth": 0.9, "shrinkA": 0.0, "shrinkB": 0.0}
            self.ax.annotate("", (x + dx, y + dy), (x, y), arrowprops=look | {"mutation_scale": 1.0})

    def write(self, x: float, y: float, text: str, colour: str = INK, **where: Any) -> None:
        """Write a text in a colour at (x, y), centred there unless the keywords `where` align it otherwise."""
        self.ax.text(x, y, text, color=colour, **{"ha": "center", "va": "center", **where})

    def range(self, y: float, start: float, end: float, text: str) -> None:
        """Draw a dimension line from `start` to `end` at the height `y`, with arrows at both ends and a text below."""
        self.arrow(start, y, end - start, 0.0, MUTED, two_heads=True)
        self.write((start + end) / 2.0, y - 0.11 * self.inch, text, MUTED)


BODY, STEEL, PAD = "#0b5c99", "#d5e3ee", "#3b4a57"
ARROW = 0.3  # in, length of a load's arrow
DOUBLER, FRAME = 0.035, 0.07  # in, thickness of a doubler and depth of a frame
THIN, THICK = 0.22, 0.5  # in, least and largest height of a section in the drawing


@dataclass(frozen=True)
class _Stretch:
    """Range of the path coordinate s in m: its value at the start of the run, its least and its largest value."""

    start: float
    low: float
    high: float

    @property
    def moves(self) -> bool:
        """Whether the path coordinate changes at all."""
        return self.high > self.low

    def words(self, low: float, high: float) -> str:
        """Format the range from `low` to `high` in m as text."""
        return f"{format_input(round(low, 3), 'm')} … {format_input(round(high, 3), 'm')}"


def draw_sketch(result: RunResult) -> Figure:
    """Draw the system of a run.

    A boom is drawn from the side in true position, a body alone with its supports, sliders, pads and loads.
    """
    if _is_boom(result):
        return space.side_view(result)
    low, high = result.scene.path_bounds
    stretch = _Stretch(float(result.abscissa[0]), low, high)
    return _draw_telescopic(result, stretch) if moving_part(result) == "mouth" else _draw_on_supports(result, stretch)


def _is_boom(result: RunResult) -> bool:
    """Whether the sketch shows the system in true position: a boom of sections, a body in a frame or with a hoist."""
    raised = result.frame is not None or result.scene.hoist is not None
    return not is_alone(result) or (raised and bool(axis_points(result, result.responses["reduced"])))


def sketch_caption(result: RunResult) -> str:
    """Caption of the sketch."""
    if _is_boom(result):
        return space.view_caption(result, "from the side")
    low, high = result.scene.path_bounds
    name = space.ringed_stress_name(result)
    ring = f"; the ring is the place of the {name}" if largest_stress(result) is not None else ""
    if moving_part(result) == "mouth":
        return f"The system at its largest extension{'; dashed: the tip at its smallest' if high > low else ''}{ring}."
    return f"The system at the beginning{'; hollow: the other end of the way' if high > low else ''}{ring}."


def _draw_on_supports(result: RunResult, stretch: _Stretch) -> Figure:
    """Draw a body alone on its supports; sliders are drawn at the start of the run and at the far end of the path."""
    end = reach(result)
    paper = Paper(0.0, end, 1.35)
    paper.ax.plot([0.0, end], [0.0, 0.0], color=BODY, linewidth=2.4, solid_capstyle="butt")
    for fixture in fixtures(result):
        _draw_fixture(paper, fixture.position, fixture.kind)
    for ahead in slider_offsets(result):
        _draw_slider(paper, stretch.start + ahead, MUTED)
        if stretch.moves:
            _draw_slider(paper, (stretch.high if stretch.start < stretch.high else stretch.low) + ahead, "none")
    if stretch.moves:
        first = slider_offsets(result)[0]
        range_text = f"s = {stretch.words(stretch.low, stretch.high)}"
        paper.range(-0.28 * paper.inch, stretch.low + first, stretch.high + first, range_text)
    paper.range(-0.52 * paper.inch, 0.0, end, format_input(end, "m"))
    _draw_loads(paper, result, 0.0, end, 0.05 * paper.inch)
    _draw_stress_ring(paper, result, 0.0, 0.0)
    return paper.figure


def _draw_telescopic(result: RunResult, stretch: _Stretch) -> Figure:
    """Draw a body that slides out of a mouth at x = 0, at its largest extension."""
    end = reach(result)
    ahead = max((ring.at + ring.length / 2.0 for ring in result.scene.pads if ring.moving), default=0.0)
    paper = Paper(-stretch.high - 0.1, end - stretch.low, 1.5)
    inch, shape = paper.inch, result.scene.body.box
    tall = float(np.clip(shape.height if shape else 0.0, THIN * inch, THICK * inch))
    gap = 0.06 * inch
    tail, tip, outer = -stretch.low, end - stretch.low, tall / 2.0 + gap
    for side in (-1.0, 1.0):
        paper.ax.plot([-stretch.high - 0.1, ahead], [side * outer] * 2, color=MUTED, linewidth=1.6)
    _draw_body(paper, shape, tail, end, tall)
    for ring in result.scene.pads:
        centre = ring.at if ring.moving else tail + ring.at
        wide = max(ring.length, 0.05 * inch)
        sides = [side for side, face in ((1.0, "top"), (-1.0, "bottom")) if face in ring.faces]
        for side in sides or (-1.0, 1.0):
            paper.box(centre - wide / 2.0, min(side * tall / 2.0, side * outer), wide, gap, facecolor=PAD)
    for name in axial_supports(result):
        paper.ax.plot([-stretch.high - 0.1, tail], [0.0, 0.0], color=MUTED, linewidth=1.2)
        paper.write(
            (tail - stretch.high) / 2.0, 0.03 * inch, name, MUTED, va="bottom"
        ) if stretch.high - stretch.low > 0.7 * inch else None
    if stretch.moves:
        back = end - stretch.high
        paper.ax.plot([back] * 2, [-tall / 2.0, tall / 2.0], color=BODY, linewidth=0.8, linestyle=(0, (3, 2)))
        paper.ax.plot([0.0, 0.0], [-outer - 0.3 * inch, -outer], color=MUTED, linewidth=0.5)
    out = stretch.words(end - stretch.high, tip) if stretch.moves else format_input(tip, "m")
    paper.range(-outer - 0.24 * inch, 0.0, tip, f"{out} beyond the mouth")
    if result.scene.gravity is not None:
        middle = tail + 0.62 * end
        along, _, up = (ARROW * inch * part for part in result.scene.gravity.direction)
        paper.arrow(middle - along, tall / 2.0 - up, along, up, MUTED)
        paper.write(middle + 0.1 * inch, tall / 2.0 + 0.2 * inch, "g", MUTED)
    _draw_loads(paper, result, tail, tip, tall / 2.0)
    _draw_stress_ring(paper, result, tail, tall / 2.0)
    return paper.figure


def _draw_body(paper: Paper, shape: Box | None, tail: float, end: float, tall: float) -> None:
    """Draw the outline of a body of length `end` in m with its tapers, frames and doublers.

    Its tail is at x = `tail` in m, and `tall` is its largest height in the drawing.  If `shape` is None, the body is
    drawn as a rectangle.
    """
    stretches = shape.stretches if shape else []
    x = np.array([0.0, *(stretch.end for stretch in stretches)]) if stretches else np.array([0.0, end])
    heights = [stretches[0].first.height, *(stretch.last.height for stretch in stretches)] if stretches else [1.0, 1.0]
    half = tall / 2.0 * np.array(heights) / max(heights)
    upper = np.column_stack([tail + x, half])
    outline = np.vstack([upper, (upper * [1.0, -1.0])[::-1]])
    paper.ax.add_patch(Polygon(outline, facecolor=STEEL, edgecolor=BODY, linewidth=0.9))
    for x_frame in shape.frames if shape else ():
        tallest = float(np.interp(x_frame, x, half))
        deep = tallest if shape and shape.frame_depth == "full" else min(FRAME * paper.inch, tallest)
        for side in (1.0, -1.0):
            paper.ax.plot([tail + x_frame] * 2, [side * tallest, side * (tallest - deep)], color=BODY, linewidth=0.8)
    for doubler in shape.doublers if shape else ():
        along = np.array([doubler.start, *x[(x > doubler.start) & (x < doubler.end)], doubler.end])
        for side, face in ((1.0, "top"), (-1.0, "bottom")):
            if doubler.faces is None or face in doubler.faces:
                edge = np.column_stack([tail + along, side * np.interp(along, x, half)])
                inner = edge - [0.0, side * DOUBLER * paper.inch]
                paper.ax.add_patch(Polygon(np.vstack([edge, inner[::-1]]), facecolor=BODY, edgecolor="none"))


def _draw_stress_ring(paper: Paper, result: RunResult, tail: float, above: float) -> None:
    """Draw a ring around the point of the largest stress, and write its value above; draw nothing without stresses."""
    if (worst := largest_stress(result)) is not None:
        at = tail + worst.x
        paper.disc(at, 0.0, 0.08 * paper.inch, facecolor="none", edgecolor=LIMIT)
        paper.write(at, above + 0.22 * paper.inch, format_quantity(worst.value, "Pa"), LIMIT)


def _draw_fixture(paper: Paper, x: float, kind: str) -> None:
    """Draw a support at `x` m by the symbol of its `kind`."""
    inch = paper.inch
    if kind == "clamped":
        paper.box(x - 0.03 * inch, -0.16 * inch, 0.06 * inch, 0.32 * inch, facecolor=INK)
        return
    foot = np.array([(0.0, 0.0), (-0.08, -0.15), (0.08, -0.15)]) * inch
    paper.ax.add_patch(Polygon(foot + (x, 0.0), facecolor=INK, edgecolor="none"))
    if kind == "roller":
        paper.box(x - 0.09 * inch, -0.19 * inch, 0.18 * inch, 0.015 * inch, facecolor=INK)


def _draw_slider(paper: Paper, x: float, fill: str) -> None:
    """Draw a slider at `x` m: a roller above the body and one below, filled with the colour `fill`."""
    for side in (-1.0, 1.0):
        paper.disc(x, side * 0.08 * paper.inch, 0.05 * paper.inch, facecolor=fill, edgecolor=MUTED)
        paper.box(
            x - 0.09 * paper.inch, side * 0.14 * paper.inch, 0.18 * paper.inch, 0.01 * paper.inch, facecolor=MUTED
        )


def _draw_loads(paper: Paper, result: RunResult, tail: float, tip: float, above: float) -> None:
    """Draw loads and masses; names of loads at the tip stand beside the tip, all other names above their arrows.

    The body reaches from `tail` to `tip` in m, and arrows that point upwards start at the height `above`.
    """
    inch, listed = paper.inch, list(_draw_masses(paper, result, tip))
    for load in input_loads(result):
        at = min(tail + load.position, tip)
        _draw_load(paper, load, load.values, at, above)
        if at > tip - 0.5 * inch:
            listed.append((load.name, LOAD))
        else:
            paper.write(at, above + (ARROW + 0.12) * inch, load.name, LOAD)
    for k, (name, colour) in enumerate(listed):
        y = (0.075 * (len(listed) - 1) - 0.15 * k) * inch
        paper.write(tip + 0.22 * inch, y, name if len(name) < 24 else f"{name[:22]}…", colour, ha="left")


def _draw_masses(paper: Paper, result: RunResult, tip: float) -> Iterator[tuple[str, str]]:
    """Draw point masses where they are, and yield the name of each with the colour of its text.

    A mass on a group whose place is not known is drawn at the tip.
    """
    section = result.scene.only_section
    for mass in section.masses:
        at = section.position_of(mass.on)
        paper.disc(
            tip if at is None else tip - section.length + at, 0.0, 0.07 * paper.inch, facecolor=INK, edgecolor="none"
        )
        yield f"{mass.name}, {format_input(mass.mass, 'kg')}", INK


def _draw_load(paper: Paper, load: AppliedLoad, values: NDArray[np.float64], x: float, above: float) -> None:
    """Draw a load at `x` m as an arrow in its direction, with two heads if its `values` change sign.

    `above` is the height of the lower end of a vertical arrow.  A moment is drawn as an arc, and a lateral force as the
    tip of an arrow, seen from the front.  Temperatures and wind are not drawn.
    """
    size, two_heads = ARROW * paper.inch, bool(values.min(initial=0.0) < 0.0 < values.max(initial=0.0))
    back = not two_heads and values.min(initial=0.0) < 0.0
    if load.direction == "whole":
        return
    if load.direction == "turn":
        paper.ax.add_patch(
            Arc((x, 0.0), size, size, theta1=30.0, theta2=330.0, edgecolor=LOAD, facecolor="none", linewidth=0.9)
        )
    elif load.direction == "aside":
        for radius, fill in ((0.05, "white"), (0.015, LOAD)):
            paper.disc(x - 0.14 * paper.inch, 0.0, radius * paper.inch, facecolor=fill, edgecolor=LOAD)
    elif load.direction == "along":
        start = x + (size if back else 0.0)
        paper.arrow(start, 0.0, -size if back else size, 0.0, two_heads=two_heads)
    else:
        start = above + (size if back else 0.0)
        paper.arrow(x, start, 0.0, -size if back else size, two_heads=two_heads)
