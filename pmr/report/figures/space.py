"""Figures of a boom in true position: from the side, in the plane of luffing, and from above."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, zip_longest
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pmr.files.arrays import Array
from pmr.report.blocks import Drawing
from pmr.report.columns import Axis, axis_points, body_axes, frame_rotations, rope_axis, spread_indices
from pmr.report.figures import (
    HALF,
    INK,
    LIMIT,
    MUTED,
    Paper,
    add_legend,
    drawing,
    make_axes,
    mix_with_white,
    octave_axis,
    section_colours,
)
from pmr.report.figures.histories import line_figure
from pmr.report.numbers import SPACE, enlargement, format_quantity, prose
from pmr.report.subject import abscissa_label, fixtures, input_loads, is_alone, reach, slider_offsets
from pmr.results import RunResult
from pmr.results.quantities import QUANTITIES, stress_name, wall_stress

#: Number of moments at which a boom is drawn; they are evenly spaced along the path of its tip.
MOMENTS = 4
LARGEST = 0.05  # largest deflection in a drawing, as a share of the reach
WAY = 600  # number of points by which the path of a tip is measured
TALLEST, FLATTEST = 3.4, 1.0  # in, height of axes of one scale
LEFT, RIGHT, TOP, BOTTOM = 0.6, 0.16, 0.28, 0.42  # in
GROUND = "#9aa5b1"
RAISING: Mapping[str, Any] = {"color": MUTED, "linewidth": 1.6}  # style of a luffing cylinder
ROPE: Mapping[str, Any] = {"color": INK, "linewidth": 0.8, "marker": "s", "markersize": 4.0, "markevery": [-1]}
FAINT = 0.3  # share of a section's colour in the mixture with white, at moments without the largest stress
LOAD, ARROW = "#7b2d8e", 0.3  # colour of loads, and length of their arrows in inches
ACTING = 1e-3  # share of its largest value from which on a load acts
SYMBOLS = {"clamped": "s", "pad": "s"}  # markers of supports; others are triangles
APART = 0.35  # in, least distance between the ends of two axes that both have a label
#: Style of the ring at the largest stress.
RING: Mapping[str, Any] = {"marker": "o", "linestyle": "none", "markersize": 9.0, "markerfacecolor": "none",
                           "markeredgecolor": LIMIT, "markeredgewidth": 1.4}  # fmt: skip


def side_view(result: RunResult) -> Figure:
    """Draw the structure from the side at the moments of `drawn_steps`, with ground, supports, pads, rope and loads.

    The axes are the radius and the height from the pivot, or without a frame x from the tail and the height.
    """
    labels = ("x in m", "Height in m")
    if result.frame is not None:
        labels = ("Radius from the pivot in m", "Height over the pivot in m")
    return _draw_boom(result, "side", *labels, from_side=True)


def plan_view(result: RunResult) -> Figure:
    """Draw the boom and the rope of its hoist from above, at the moments of `drawn_steps`."""
    return _draw_boom(result, "plan", "X in m", "Y in m")


def buckling_figure(result: RunResult) -> Figure:
    """Draw the buckling factor during the run over the boom's length, or the luffing angle if the length is constant.

    The result has to be of a boom in a frame.  Moments without a factor are gaps.
    """
    over_way, frame, times = result.summary["buckling"]["over"], result.frame, result.responses["reduced"].t
    assert frame is not None  # only a boom in a frame has a factor
    t, factor = np.array(over_way["t"]), np.array([np.nan if value is None else value for value in over_way["factor"]])
    if not np.ptp(result.abscissa):
        x, label = np.rad2deg(frame.angles[0].value(t)), "Luffing angle in degrees"
    else:
        x, label = np.interp(t, times, result.abscissa_at(times)), f"{abscissa_label(result).capitalize()} in m"
    figure, ax = make_axes(HALF, 2.0, label, "Buckling factor (–)")
    ax.plot(x, factor, color=INK, linewidth=0.7, marker=".", markersize=3.0)
    ax.plot(x[:1], factor[:1], "o", color=INK, markersize=4.5)
    ax.axhline(1.0, color=LIMIT, linewidth=0.9, label="1: the boom buckles")
    ax.margins(x=0.04)
    if not octave_axis(ax, 1.0, float(np.nanmax(factor))):
        ax.set_ylim(bottom=0.0)
    return add_legend(figure)


def view_caption(result: RunResult, view: str) -> str:
    """Caption of a view of the boom; `view` names the direction from which the boom is seen, from the side or above."""
    steps, t = drawn_steps(result, "side" if view.endswith("side") else "plan"), result.responses["reduced"].t
    worst, slides = largest_stress(result), float(np.ptp(result.abscissa)) > 0.0
    return prose(
        "view",
        structure="body" if is_alone(result) else "boom",
        direction=view,
        times=t[steps].tolist(),
        worst=None if worst is None else float(t[worst.step]),
        ring=stress_name(result.scene) if wall_stress(result.summary) is None else QUANTITIES["wall_stress"].reported,
        moves_tip=result.frame is not None or (not is_alone(result) and slides),
        has_rope=rope_axis(result, steps) is not None,
        scale=exaggeration(result),
    )


def _draw_boom(result: RunResult, view: str, across: str, up: str, from_side: bool = False) -> Figure:
    """Draw the boom in a `view`, ``side`` or ``plan``, at the steps of `drawn_steps`.

    `across` and `up` are the labels of the axes.  If `from_side`, ground, luffing cylinder, supports, sliders and loads
    are drawn too.
    """
    steps, t, scale = drawn_steps(result, view), result.responses["reduced"].t, exaggeration(result)
    bodies = body_axes(result, steps, scale)
    way = getattr(body_axes(result, spread_indices(len(t), WAY), scale)[-1], view)[:, -1]
    raising, rope = _cylinders(result, steps) if from_side else [], rope_axis(result, steps, scale)
    ropes = [] if rope is None else [*getattr(rope, view)]
    worst, colours = largest_stress(result), section_colours(item.body for item in bodies)
    stand = result.frame.ground if from_side and result.frame is not None else None
    level = 0.0 if stand is None else -stand.height
    drawn = [np.array([[0.0, level]]), way, *(getattr(item, view).reshape(-1, 2) for item in bodies), *raising, *ropes]
    figure, ax = _make_paper(drawn, across, up)
    ax.plot(*way.T, color=MUTED, linewidth=0.6, linestyle=(0, (4.0, 2.5)), zorder=1.5)
    moment = 0 if worst is None else int(np.argmax(steps == worst.step))
    faint = [1.0 if worst is None or k == moment else FAINT for k in range(len(steps))]  # the ring is on one boom only
    for k, body in enumerate(bodies):
        width = 1.0 + 1.1 * (len(bodies) - 1 - k)
        for places, share in zip(getattr(body, view), faint, strict=True):
            over = 2.0 + share / 10.0 - k / 1e3  # a section is drawn on top of the sections that slide in it
            colour = mix_with_white(colours[body.body], share)
            name = body.body if share == 1.0 and len(bodies) > 1 else ""
            ax.plot(*places.T, color=colour, linewidth=width, solid_capstyle="butt", zorder=over, label=name)
    for name, lines in _lines_of_action(result, bodies, view):
        for places, share in zip(lines, faint, strict=True):
            colour = mix_with_white(MUTED, share)
            ax.plot(*places.T, color=colour, linestyle=":", zorder=2.2, label=name if share == 1.0 else "")
    for cylinder, rope_line, share in zip_longest(raising, ropes, faint):
        for name, places, look in (("luffing cylinder", cylinder, RAISING), ("rope and payload", rope_line, ROPE)):
            if places is not None:
                colour = mix_with_white(look["color"], share)
                ax.plot(*places.T, **{**look, "color": colour}, zorder=1.8, label=name if share == 1.0 else "")
    if stand is not None:
        ax.plot(ax.get_xlim(), [level, level], color=GROUND, linewidth=1.2, zorder=1.0, label="ground")
    _label_times(ax, getattr(bodies[-1], view), t[steps], moment)
    if worst is not None:
        body = next(item for item in bodies if item.body == worst.body)
        places = getattr(body, view)[moment]
        at = [np.interp(worst.x, body.x, places[:, k]) for k in (0, 1)]
        ax.plot(*at, **RING, zorder=5.0, label=format_quantity(worst.value, "Pa"))
    if from_side and result.frame is None:
        _draw_fixtures(ax, result, int(steps[moment]))
    else:
        ax.plot([0.0], [0.0], marker="^" if from_side else "o", markersize=6.0, color=INK, zorder=4.0)
    if from_side:
        _draw_loads(ax, result, {item.body: (item.x, item.side[moment]) for item in bodies}, worst)
    return add_legend(figure)


def _draw_fixtures(ax: Axes, result: RunResult, step: int) -> None:
    """Draw supports as triangles and pads and sliders as squares, where they are at the time step number `step`.

    For a body alone, empty squares show where its sliders are at one end of the path: the end that is farther from
    their place at this step.  The legend names each symbol once.
    """
    direction = frame_rotations(result, result.responses["reduced"].t[[step]])[0, [0, 2], 0]
    names, slides = {"pad": "pad"}, "slider" if is_alone(result) and result.scene.points else "pad that moves"
    places = [
        (fixture.position, SYMBOLS.get(fixture.kind, "^"), INK, names.get(fixture.kind, "support"))
        for fixture in fixtures(result)
    ]
    low, high = result.scene.path_bounds if is_alone(result) else (0.0, 0.0)
    now = float(result.abscissa[step])
    far = low if now - low > high - now else high
    for ahead in slider_offsets(result):
        places += [(far + ahead, "s", "white", f"{slides}, at its farther end")] * (high > low)
        places += [(now + ahead, "s", MUTED, slides)]
    labelled = set[str]()
    for place, marker, colour, label in places:
        look: dict[str, Any] = {
            "markeredgecolor": MUTED if marker == "s" else INK,
            "markerfacecolor": colour,
            "markersize": 5.0,
        }
        ax.plot(*(place * direction[:, None]), marker=marker, linestyle="none", **look, zorder=3.5,
                label="" if label in labelled else label)  # fmt: skip
        labelled.add(label)


def _draw_loads(
    ax: Axes, result: RunResult, axes: Mapping[str, tuple[Array, Array]], worst: LargestStress | None
) -> None:
    """Draw each force in the plane of the view as an arrow with its name; a force that changes sign has two heads.

    `axes` has, for each body, the points x (n,) in m of its axis, and their places (n, 2) in m in the view.  An arrow
    has the direction of the force at the time of its largest value.  This direction is taken in the body's axes, or in
    space for a force along an axis of the ground.  Forces whose arrows begin at one point have a common label.

    Not drawn are forces that are always zero, and forces on bodies that `axes` lacks.  `worst` is the largest stress of
    the run, or None.  If it is given, forces with one head that hardly act at the time of this stress are not drawn,
    either: at most the share `ACTING` of their largest value acts then.
    """
    inch = float(np.ptp(ax.get_xlim())) / (HALF - LEFT - RIGHT)
    forces, names = dict[tuple[str, str, float, bool], Array](), dict[tuple[float, ...], list[str]]()
    sizes = dict[tuple[str, str, float, bool], Array]()
    for load in input_loads(result):  # a force along an axis of the ground has two parts
        if load.body in axes and load.source.acts == "force" and load.direction in ("x", "z") and np.any(load.values):
            key = (load.body, load.source.name, load.position, load.name != load.source.name)
            force = forces.setdefault(key, np.zeros((len(load.values), 2)))
            force[:, ("x", "z").index(load.direction)] = load.values
            sizes[key] = np.abs(load.source.signal.value(result.responses["reduced"].t))  # out of the plane, too
    for (body, name, position, is_of_ground), force in forces.items():
        x, places = axes[body]
        at = np.array([np.interp(position, x, places[:, k]) for k in (0, 1)])
        along = (places[-1] - places[0]) / max(float(np.linalg.norm(places[-1] - places[0])), 1e-300)
        k = int(np.linalg.norm(force, axis=1).argmax())
        largest = force[k] / np.linalg.norm(force[k])
        if is_of_ground:  # it has the direction that it has at its largest, whatever the posture that is drawn
            along = frame_rotations(result, result.responses["reduced"].t[[k]])[0, 2, [2, 0]]
        foot = at - ARROW * inch * (largest[0] * along + largest[1] * np.array([-along[1], along[0]]))
        style, size = "<|-|>" if (force @ largest).min() < 0.0 else "-|>", sizes[body, name, position, is_of_ground]
        if worst is not None and style == "-|>" and size[worst.step] <= ACTING * size.max():
            continue
        arrow = {"arrowstyle": f"{style},head_length=4.5,head_width=1.9", "color": LOAD, "linewidth": 0.9,
                 "shrinkA": 0.0, "shrinkB": 0.0, "mutation_scale": 1.0}  # fmt: skip
        (x_foot, z_foot), (x_tip, z_tip) = foot.tolist(), at.tolist()
        ax.annotate("", (x_tip, z_tip), (x_foot, z_foot), arrowprops=arrow, annotation_clip=False)
        side = (round(x_foot, 1), round(z_foot, 1), float(z_foot > z_tip + 0.1 * inch))
        names.setdefault(side, []).append(name)
    for (x_foot, z_foot, is_above), of_place in names.items():
        ax.annotate(", ".join(of_place), (x_foot, z_foot), (0.0, 2.0 if is_above else -2.0), color=LOAD, ha="right",
                    textcoords="offset points", va="bottom" if is_above else "top", fontsize=7.0, zorder=3.0,
                    bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6})  # fmt: skip


def _lines_of_action(result: RunResult, bodies: Sequence[Axis], view: str) -> Iterator[tuple[str, Array]]:
    """Yield the cylinders and ropes that drive a section beside the axis, each with its ends (S, 2, 2) in m in a view.

    The ends are at the tails of the outer and the inner section, moved to the side by the distance that the joint
    states.  `bodies` are the axes of all bodies at S times, and `view` is ``side`` or ``plan``.
    """
    for outer, inner in pairwise(bodies):
        joint = result.scene.bodies[inner.body].joint
        if joint is not None and joint.line is not None:
            tails = np.stack([getattr(axis, view)[:, 0] for axis in (outer, inner)], axis=1)
            along = getattr(inner, view)[:, -1] - tails[:, 1]
            across = along[:, ::-1] * [-1.0, 1.0] / np.linalg.norm(along, axis=1)[:, None]
            yield f"{joint.driver} of {inner.body}", tails + joint.line[view == "side"] * across[:, None]


def _cylinders(result: RunResult, steps: NDArray[np.intp]) -> list[Array]:
    """Positions (2, 2) in m of the luffing cylinder's foot and lug, at each of the `steps`.

    The list is empty if the scene has no luffing cylinder.
    """
    frame, t = result.frame, result.responses["reduced"].t
    if frame is None or frame.cylinder is None:
        return []
    return [
        np.array([frame.cylinder.foot, lug]) for lug in frame.cylinder.lug_position(frame.angles[0].value(t[steps]))
    ]


def _label_times(ax: Axes, lines: Array, t: Array, most_stressed: int) -> None:
    """Write the time next to the end of each drawn body axis, one of `lines` (S, n, 2) in m, at times t (S,) in s.

    The line number `most_stressed` is labelled first, the last line second, and then all others in order.  A label that
    would come near an earlier one is left out.
    """
    labelled = list[Array]()
    for k in dict.fromkeys([most_stressed, len(t) - 1, *range(len(t))]):
        at = np.asarray(ax.transData.transform(lines[k, -1])) / ax.figure.dpi
        if all(float(np.linalg.norm(at - other)) >= APART for other in labelled):
            labelled.append(at)
            direction = lines[k, -1] - lines[k, -2]
            offset = 6.0 * direction / max(float(np.linalg.norm(direction)), 1e-300)
            where = "left" if offset[0] > 2.0 else "right" if offset[0] < -2.0 else "center"
            up = "center" if abs(offset[1]) < 4.0 else "bottom"
            text, box = f"{float(t[k]):.3g}{SPACE}s", {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
            ax.annotate(text, lines[k, -1], offset, textcoords="offset points", ha=where, va=up, fontsize=7.0,
                        zorder=3.0, bbox=box)  # fmt: skip


def _make_paper(drawn: Sequence[Array], across: str, up: str) -> Paper:
    """Make axes of one scale that have room for the points `drawn` (..., 2) in m, the pivot and labels.

    `across` and `up` are the labels of the axes.
    """
    every = np.concatenate([*drawn, np.zeros((1, 2))])
    low, high = every.min(axis=0), every.max(axis=0)
    wide = HALF - LEFT - RIGHT
    room = 0.04 * float((high - low).max()) + 1e-9
    low, high = low - room, high + room + [0.12 * float((high - low).max()), 0.06 * float((high - low).max())]
    metre = min(wide / float(high[0] - low[0]), TALLEST / float(high[1] - low[1]))
    tall = max(metre * float(high[1] - low[1]), FLATTEST)
    figure, ax = make_axes(HALF, tall + TOP + BOTTOM, across, up, left=LEFT, right=RIGHT, top=TOP, bottom=BOTTOM)
    for limits, size, k in ((ax.set_xlim, wide, 0), (ax.set_ylim, tall, 1)):
        middle, half = float(low[k] + high[k]) / 2.0, size / metre / 2.0
        limits(middle - half, middle + half)
    return Paper(figure, ax)


def exaggeration(result: RunResult) -> float:
    """Factor, a round number, by which a structure's deflection is enlarged in the drawing; 1 without a deflection.

    The largest deflection of the run is drawn with at most the share `LARGEST` of the reach.
    """
    largest = max(float(np.abs(line.displacement).max(initial=0.0)) for line in axis_points(result))
    return enlargement(largest, LARGEST * reach(result))


def drawn_steps(result: RunResult, view: str) -> NDArray[np.intp]:
    """Numbers (k,) of the time steps at which the boom is drawn, evenly spaced along its tip's path in a `view`.

    The `view` is ``side`` or ``plan``.  If the boom is luffed, both views have the moments of the side.  There are at
    most `MOMENTS` steps.  The first step is among them, and so is the step at which the tip reaches the end of its
    path.  There are two exceptions:

    - If the tip is at rest in this view, time is cut into `MOMENTS` equal parts.  The step of the largest deflection in
      each part is taken.
    - If the boom extends but does not turn in this view, drawings at other extensions would lie on top of each other.
      The only step is that of the largest extension.

    At last, the step of the largest stress, if there is one, replaces the step nearest to it.
    """
    t, out, worst = result.responses["reduced"].t, _tip_distance(result), largest_stress(result)
    along = frame_rotations(result, t)[:, :, 0]
    from_side = np.stack([np.hypot(along[:, 0], along[:, 1]), along[:, 2]], axis=1)
    if view == "side" or np.ptp(from_side, axis=0).max() > 1e-12:
        along = from_side
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(along * out[:, None], axis=0), axis=1)))
    if way[-1] <= 1e-9 * reach(result):
        deflection = np.linalg.norm(axis_points(result)[-1].displacement[:, -1], axis=1)
        parts = np.array_split(deflection, MOMENTS)
        firsts = np.cumsum([0, *map(len, parts[:-1])])
        steps = np.array([first + int(part.argmax()) for first, part in zip(firsts, parts, strict=True) if len(part)])
    elif np.ptp(along, axis=0).max() <= 1e-12:
        steps = np.array([int(np.argmax(out))])
    else:
        steps = np.unique(np.searchsorted(way, np.linspace(0.0, way[-1] * (1.0 - 1e-9), MOMENTS)))
    if worst is not None:
        away = np.abs(way[steps] - way[worst.step]) if way[-1] > 1e-9 * reach(result) else np.abs(steps - worst.step)
        steps[np.argmin(away)] = worst.step
    return steps


@dataclass(frozen=True)
class LargestStress:
    """Largest stress of a boom: time step, body, distance from the body's tail in m, and value in Pa."""

    step: int  # number of the time step
    body: str  # name
    x: float  # m, from the body's tail
    value: float  # Pa


def largest_stress(result: RunResult) -> LargestStress | None:
    """Largest von Mises stress of the reduced model; None if the run has no stresses.

    If the stress in walls at pads is known, it is returned instead.
    """
    peak, walls = result.summary.get("stress_peak", {}).get("reduced"), wall_stress(result.summary)
    if peak is None:
        return None
    peak = walls or peak
    step = int(np.argmin(np.abs(result.responses["reduced"].t - peak["t"])))
    return LargestStress(step, peak.get("section", ""), float(peak["position"][0]), float(peak["value"]))


def _tip_distance(result: RunResult) -> Array:
    """Distance (T,) in m of the tip from the base's tail, along the boom."""
    if result.reach is not None:
        return result.abscissa_at(result.responses["reduced"].t)
    return np.full(len(result.responses["reduced"].t), reach(result))


def slews(result: RunResult) -> bool:
    """Whether the boom turns about the vertical during the run, so that a view from above shows its motion."""
    angle = result.summary.get("frame", {}).get("slewing", {"min": 0.0, "max": 0.0})
    return bool(angle["max"] > angle["min"])


def space_drawings(result: RunResult, prefix: str) -> list[Drawing]:
    """Draw the boom from above if it slews, the tip over time, and the buckling factor if it is known.

    Nothing is drawn unless the boom is in a frame and has outputs along its axis.  `prefix` begins the identifiers of
    the figures.
    """
    if result.frame is None or not axis_points(result):
        return []
    drawings = list[Drawing]()
    if slews(result):  # the view from the side is at the top of the page
        drawings.append(drawing(f"{prefix}-plan", plan_view, view_caption(result, "from above"), result))
    caption = "The tip over time: its radius and its height from the pivot."
    radius, height = body_axes(result, range(len(result.responses["reduced"].t)))[-1].side[:, -1].T
    tip = {"radius": radius, "height": height}
    drawings.append(drawing(f"{prefix}-tip-in-space", line_figure, caption, result, tip, "m", "Tip from the pivot"))
    if any(result.summary.get("buckling", {}).get("over", {}).get("factor", ())):
        caption = "Buckling factor during this run, with every pad closed; the run begins at the larger dot. The boom "
        caption += "buckles under its axial forces times this factor."
        drawings.append(drawing(f"{prefix}-buckling", buckling_figure, caption, result))
    return drawings
