"""Draw a load chart as manuals of machines do: loads over radius and height, coloured by the governing limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from pmr.errors import escape_controls, letters
from pmr.files.arrays import Array
from pmr.report.columns import spread_indices
from pmr.report.figures import (
    HALF,
    INK,
    MUTED,
    ROW,
    SECTIONS,
    SHADE,
    WIDE,
    Paper,
    add_legend,
    equal_axes,
    make_axes,
    mix_with_white,
    section_colours,
)
from pmr.report.numbers import enlargement, format_input

#: Largest number of curves of constant load; largest number of cells that show a text under a pointer.
CURVES, MOST_CELLS = 12, 4000
#: Largest number of boom lengths with a line of loads over the radius, in wide and in narrow figures.
LINES, NARROW_LINES = 9, 5
#: Least distance of the letter of a limit from the number at a curve, as a share of the larger side of the picture.
LETTER_ROOM = 0.04
#: Width in points of a letter of a label, at most.
LETTER_WIDTH = 4.0
#: Least width, and height in points of the label of a boom length, and its least distance above the end of its line.
LABEL_WIDTH, LABEL_HEIGHT, LABEL_DISTANCE = 32.0, 10.0, 12.0
#: Words for positions where the boom passes a limit even without a load, and the hatching of their cells.
NOT_PERMITTED, HATCH = "not permitted, even empty", "xxxx"
#: How cells are drawn in which the boom is not permitted, even empty.
NOT_PERMITTED_STYLE: dict[str, Any] = {"facecolor": "white", "edgecolor": MUTED, "hatch": HATCH, "linewidth": 0.0}
#: Loads in kg for which curves of constant load are drawn, times a power of ten.
STEPS = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
#: Share (0 to 1) in which the colours of limits are mixed with white.
PALE = 0.55
#: Width of the strip for a single reach, and half the width of the strip for a single angle, as a share of the reach.
STRIP = 0.02
#: Largest height of the picture, as a multiple of the width of a page.
TALLEST = 0.65


@dataclass(frozen=True)
class LoadChart:
    """Load chart for E reaches and A angles.

    `place` (E, A, 2) is the position of the tip in m, as radius and height from the pivot.  `load` (E, A) is the load
    in kg, 0 where the boom passes a limit even without a load, and NaN where no limit is reached.  `which` (E, A) is
    the number of the governing limit in `names`, or -1 if no limit governs.  `up_to` in kg is the load at which the
    search ends.  `extensions` (E,) are texts such as ``3.2 + 0``, which tell reaches of equal length from each other.
    `ground` is the height of the ground in m, from the pivot as heights of `place`; it is NaN without a ground.
    """

    place: Array
    load: Array
    which: NDArray[np.int64]
    names: Sequence[str]
    up_to: float
    extensions: Sequence[str] = ()
    ground: float = np.nan

    @property
    def lengths(self) -> list[str]:
        """Labels (E,) with the distance of the tip from the pivot, such as ``30.25 m``.

        Labels that would be equal have the extensions behind them in brackets.
        """
        names = [f"{np.linalg.norm(place[0]):.2f} m" for place in self.place]
        return [
            f"{name} ({self.extensions[e]})" if self.extensions and names.count(name) > 1 else name
            for e, name in enumerate(names)
        ]

    @property
    def not_permitted(self) -> NDArray[np.bool_]:
        """Mask (E, A): positions at which a limit is passed even without a load."""
        return (self.which >= 0) & (self.load <= 0.0)

    @property
    def governing_limits(self) -> list[int]:
        """Numbers of the limits that govern a load above 0 at some position, in increasing order."""
        return sorted(int(k) for k in np.unique(self.which[~self.not_permitted]) if k >= 0)

    @property
    def labels(self) -> list[str]:
        """Letters and names of the governing limits, then words for positions without a governing limit.

        Words are added only for what occurs in the chart: positions at which no limit is reached, and positions at
        which the boom is not permitted even empty.
        """
        named = [f"{letters(k)} {self.names[k]}" for k in self.governing_limits]
        beyond = [f"more than {format_input(self.up_to)} kg (search ends there)"] * bool((self.which < 0).any())
        return named + beyond + [NOT_PERMITTED] * bool(self.not_permitted.any())

    @property
    def colours(self) -> dict[int, str]:
        """Colours of the governing limits by number, and of positions at which no limit is reached (-1)."""
        limits = {k: SECTIONS[(n + 1) % len(SECTIONS)] for n, k in enumerate(self.governing_limits)}
        return limits | ({-1: MUTED} if (self.which < 0).any() else {})


def pointer_cells(chart: LoadChart, texts: Sequence[str]) -> str:
    """Transparent cells that show a text under a pointer, as elements to be put at the end of a chart's SVG.

    `texts` are the texts of all positions: all angles of the first reach, then those of the next one.  The result
    is empty if there are no texts, or more than `MOST_CELLS`.
    """
    if not 0 < len(texts) <= MOST_CELLS:
        return ""
    figure, corners = load_chart(chart), _corners(chart.place)
    to_points = figure.axes[0].transData.transform(corners.reshape(-1, 2)) * 72.0 / figure.dpi
    x, y = to_points.reshape(corners.shape).transpose(2, 0, 1)
    y = figure.get_figheight() * 72.0 - y
    cells = []
    for number, text in enumerate(texts):
        i, k = divmod(number, chart.load.shape[1])
        round_ = [(i, k), (i + 1, k), (i + 1, k + 1), (i, k + 1)]
        path = "L".join(f"{x[at]:.2f} {y[at]:.2f}" for at in round_)
        cells.append(
            f'<path d="M{path}Z" fill="#fff" fill-opacity="0"><title>{escape(escape_controls(text))}</title></path>'
        )
    return "".join(cells)


def load_chart(chart: LoadChart, width: float = WIDE) -> Figure:
    """Draw a load chart: a coloured cell around each position of the tip, and curves of constant load.

    The figure is `width` inches wide.
    """
    corners = _corners(chart.place)
    low, high = np.minimum(corners.min(axis=(0, 1)), 0.0), np.maximum(corners.max(axis=(0, 1)), 0.0)
    hatched = chart.not_permitted
    low[1] = np.fmin(low[1], chart.ground)
    figure, ax = _side_view(low, high, TALLEST, width)
    colours = {k: mix_with_white(of, 1.0 - PALE) if k >= 0 else SHADE for k, of in chart.colours.items()}
    around = (corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:])
    cells = np.stack([*around, around[0]], axis=2)
    for number in np.unique(chart.which[~hatched]):  # one outline for each colour: single cells take seconds in a PDF
        is_of_limit = (chart.which == number) & ~hatched
        ax.add_patch(PathPatch(_outline(cells[is_of_limit]), color=colours[int(number)], linewidth=0.3, zorder=1.0))
    if hatched.any():
        ax.add_patch(PathPatch(_outline(cells[hatched]), zorder=1.0, **NOT_PERMITTED_STYLE))
    levels = _contour_loads(chart.load)
    if min(chart.load.shape) > 1 and levels:
        load = np.ma.masked_where(hatched | ~np.isfinite(chart.load), chart.load)
        drawn = ax.contour(*chart.place.transpose(2, 0, 1), load, levels=levels, colors=INK, linewidths=0.7, zorder=2.0)
        ax.clabel(drawn, fmt=format_input, fontsize=7.0, inline_spacing=2)
        for text in drawn.labelTexts:
            text.set_clip_on(False)  # a label at the edge of the picture would be cut
        _label_short_curves(ax, drawn)
        taken = np.array([text.get_position() for text in drawn.labelTexts]).reshape(-1, 2)
    else:
        taken = np.zeros((0, 2))
    for k in chart.governing_limits:
        at = _free_place(chart.place[(chart.which == k) & ~hatched], taken, LETTER_ROOM * float((high - low).max()))
        ax.text(float(at[0]), float(at[1]), letters(k), weight="bold", ha="center", va="center", zorder=5.0)
    ax.plot(0.0, 0.0, marker="o", color=MUTED, markersize=4.0, clip_on=False, zorder=3.0)
    if np.isfinite(chart.ground):
        ax.axhline(chart.ground, color=INK, linewidth=1.2, clip_on=False, zorder=3.0)
    equal_axes(ax)
    entries: list[Line2D | Patch] = [
        Line2D([], [], color=colour, linewidth=6.0, label=name)
        for colour, name in zip(colours.values(), chart.labels, strict=False)
    ]
    entries += [Patch(label=NOT_PERMITTED, **NOT_PERMITTED_STYLE)] if hatched.any() else []
    return add_legend(figure, entries)


def _label_short_curves(ax: Axes, curves: QuadContourSet) -> None:
    """Write the load below the lower end of each of the `curves` of constant load that are too short for a label."""
    labelled = {text.get_text() for text in curves.labelTexts}
    for level, pieces in zip(curves.levels, curves.allsegs, strict=True):
        longest = max(pieces, key=len, default=np.zeros((0, 2)))
        if len(longest) and format_input(level) not in labelled:
            end = longest[np.argmin(longest[:, 1])]
            ax.annotate(
                format_input(level), end, (0.0, -3.0), textcoords="offset points", fontsize=7.0, ha="center", va="top"
            )


def _free_place(places: Array, taken: Array, room: float) -> Array:
    """Choose the place for a label: of n `places` (n, 2), the one (2,) nearest to their mean with enough free room.

    The chosen place is at least `room` from all m places `taken` (m, 2), all in m.  If there is no such place, the one
    that is farthest from all `taken` is chosen.
    """
    apart = np.linalg.norm(places[:, None] - taken, axis=2).min(axis=1, initial=np.inf)
    if not (apart >= room).any():
        return np.asarray(places[np.argmax(apart)])
    from_mean = np.linalg.norm(places - places.mean(axis=0), axis=1)
    return np.asarray(places[np.argmin(np.where(apart >= room, from_mean, np.inf))])


def _outline(cells: Array) -> Path:
    """Outlines of n `cells` (n, 5, 2) in m as one path; the fifth corner of a cell is its first one again."""
    codes = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY] * len(cells)
    return Path(cells.reshape(-1, 2), codes)


def duty_lines(chart: LoadChart, width: float = WIDE) -> Figure:
    """Draw the load over the radius, a line for each of up to `LINES` boom lengths, as manuals print it.

    A narrow figure has up to `NARROW_LINES` lines.  The boom length stands above the end of its line, at the largest
    radius.  Colour and letter of a piece of a line say which limit governs; each limit has its letter once on a line.
    Where no limit is reached, arrows at the load at which the search ends point up.  Where the boom is not permitted
    even empty, there are crosses on the axis.  The figure is `width` inches wide.
    """
    figure, ax = make_axes(width, 3.4 + ROW, "Radius in m", "Load in kg", right=0.5, top=0.12 + ROW)
    most, ends = float(np.nanmax(chart.load, initial=0.0)), list[tuple[str, float, float]]()
    for e in spread_indices(len(chart.load), LINES if width > HALF else NARROW_LINES):
        radius, which, crossed = chart.place[e, :, 0], chart.which[e], chart.not_permitted[e]
        load = np.where(crossed, np.nan, chart.load[e])
        shown = np.where(which >= 0, chart.load[e], chart.up_to)
        ax.plot(radius, load, color="0.75", linewidth=0.5, zorder=1.0)
        ax.plot(radius[crossed], np.zeros(crossed.sum()), color=MUTED, marker="x", linestyle="none", clip_on=False)
        reached, beyond = np.flatnonzero((which >= 0) & ~crossed), which < 0
        ax.plot(radius[beyond], np.full(beyond.sum(), chart.up_to), color=MUTED, marker="^", linestyle="none")
        for k in np.unique(which[reached]):
            of_limit = np.where(which == k, load, np.nan)
            ax.plot(radius, of_limit, color=chart.colours[int(k)], marker=".", markersize=4.0, linewidth=1.4)
            first = int(np.argmax((which == k) & ~crossed))
            below = -7.0 if load[first] > 0.06 * most else 4.0  # not over the numbers of the axis
            ax.annotate(
                letters(int(k)), (radius[first], load[first]), (-7.0, below), textcoords="offset points", fontsize=6.0
            )
        end = int(np.argmax(radius))
        ends.append((chart.lengths[e], float(radius[end]), float(shown[end])))
    ax.set_ylim(bottom=0.0)
    label_ends(ax, ends)
    entries = [
        Line2D([], [], color=of, linewidth=2.0, label=name)
        for of, name in zip(chart.colours.values(), chart.labels, strict=False)
    ]
    if chart.not_permitted.any():
        entries.append(Line2D([], [], color=MUTED, marker="x", linestyle="none", label=NOT_PERMITTED))
    return add_legend(figure, entries)


def label_ends(ax: Axes, ends: Sequence[tuple[str, float, float]]) -> None:
    """Write labels above the ends of lines, and a thin line from each label to its end.

    A label stands as low as the labels written before it leave room.  Each of `ends` is a label, the radius in m and
    the load in kg at which its line ends.
    """
    taken = list[tuple[float, float]]()
    for text, radius, load in ends:
        x, low = ax.transData.transform((radius, load)) * 72.0 / ax.figure.dpi
        y = low + LABEL_DISTANCE
        for up in sorted(up for at, up in taken if abs(at - x) < max(LABEL_WIDTH, LETTER_WIDTH * len(text))):
            if abs(up - y) < LABEL_HEIGHT:
                y = up + LABEL_HEIGHT
        taken.append((x, y))
        ax.annotate(
            text,
            (radius, load),
            (0.0, y - low),
            textcoords="offset points",
            fontsize=7.0,
            ha="center",
            arrowprops={"arrowstyle": "-", "color": MUTED, "linewidth": 0.5, "shrinkA": 0.0, "shrinkB": 2.0},
        )


def _contour_loads(load: Array) -> list[float]:
    """Loads in kg for which curves are drawn: at most `CURVES` round numbers, in ascending order.

    Round numbers between the least and the largest `load` (any shape), in kg, are candidates; the largest of them are
    taken.  NaN and loads of 0 do not count.  If there is no such round number, three loads at equal distances are
    returned.  The result is empty if all loads are equal.
    """
    finite = load[np.isfinite(load) & (load > 0.0)]
    if not len(finite) or finite.max() <= finite.min():
        return []
    decades = range(int(np.floor(np.log10(finite.max()))) - 2, int(np.floor(np.log10(finite.max()))) + 1)
    every = [step * 10.0**decade for decade in decades for step in STEPS]
    inside = [level for level in every if finite.min() < level < finite.max()]
    return inside[-CURVES:] or np.linspace(finite.min(), finite.max(), 5)[1:-1].tolist()


def _side_view(low: Array, high: Array, tallest: float, width: float) -> Paper:
    """Make axes of radius and height in m from `low` (2,) to `high` (2,), in a figure of `width` inches.

    Their height is at most `tallest` times the width of a page.
    """
    top, tall = 0.12 + ROW, min((width - 0.76) * float(np.divide(*(high - low)[::-1])), tallest * WIDE)
    figure, ax = make_axes(width, tall + top + 0.42, "Radius in m", "Height in m", top=top, bottom=0.42)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return Paper(figure, ax)


def _corners(place: Array) -> Array:
    """Corners (E + 1, A + 1, 2) in m of the cells around the positions `place` (E, A, 2) in m of the tip.

    No cell extends beyond the outermost positions, so a cell at an end is half as long as the others.  A single reach
    is drawn as a strip that ends at this reach, a single angle as a strip with the angle in its middle.
    """
    if place.shape[1] == 1:
        turn = np.array([[np.cos(STRIP), np.sin(STRIP)], [-np.sin(STRIP), np.cos(STRIP)]])
        place = np.concatenate([place @ turn.T, place @ turn], axis=1)
    else:
        # boundaries (E, A + 1, 2) in m of the cells along the angle
        polar = np.stack([np.linalg.norm(place, axis=-1), np.arctan2(place[..., 1], place[..., 0])], axis=-1)
        radius, angle = np.moveaxis(_midpoints(polar, 1), -1, 0)
        place = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    return np.concatenate([(1.0 - STRIP) * place, place]) if len(place) == 1 else _midpoints(place, 0)


def _midpoints(values: Array, axis: int) -> Array:
    """Means of neighbouring `values` (..., n, ...) along `axis`, between the first and the last value.

    The result (..., n + 1, ...) has one entry more along this axis.
    """
    count = values.shape[axis]
    first, last = np.take(values, [0], axis), np.take(values, [-1], axis)
    middle = (np.take(values, range(count - 1), axis) + np.take(values, range(1, count), axis)) / 2.0
    return np.concatenate([first, middle, last], axis=axis)


#: Largest displacement in the drawing as a share of the reach; largest height of the picture over the width of a page.
BENT, SIDE_TALLEST = 0.06, 0.22


@dataclass(frozen=True)
class BentBoom:
    """Bent boom at rest, as b points on its axis and their displacements upwards, at right angles to the axis."""

    along: Array  # (b,) m, from the base's tail
    across: Array  # (b,) m, upwards at right angles to the axis
    section: NDArray[np.int64]  # (b,), number of the section that each point is on
    names: tuple[str, ...]  # names of all sections
    luffing: float  # rad, luffing angle

    @property
    def scale(self) -> float:
        """Factor, a round number, by which displacements are enlarged in the drawing."""
        return enlargement(float(np.abs(self.across).max(initial=0.0)), BENT * float(self.along.max()))


def bent_boom(boom: BentBoom, width: float = WIDE) -> Figure:
    """Draw a boom at rest from the side: a thin line for the undeformed axis, the bent sections, and an arrow.

    The arrow points down from the last point.  Displacements are enlarged; the figure is `width` inches wide.
    """
    c, s = np.cos(boom.luffing), np.sin(boom.luffing)
    deflection = boom.scale * boom.across
    x, z = boom.along * c - deflection * s, boom.along * s + deflection * c
    reach = float(boom.along.max())
    low = np.minimum(0.0, [min(x.min(), 0.0), min(z.min(), 0.0)])
    high = np.array([max(x.max(), reach * c, 0.1 * reach), max(z.max(), reach * s, 0.1 * reach)])
    edge = 0.04 * float(np.max(high - low))
    low, high = low - edge, high + edge
    figure, ax = _side_view(low, high, SIDE_TALLEST, width)
    ax.plot([0.0, reach * c], [0.0, reach * s], color=MUTED, linewidth=0.6, zorder=1.0)
    for k, (name, colour) in enumerate(section_colours(boom.names).items()):
        of_section = np.flatnonzero(boom.section == k)
        order = of_section[np.argsort(boom.along[of_section])]
        ax.plot(x[order], z[order], color=colour, linewidth=2.0, zorder=2.0, solid_capstyle="butt", label=name)
    ax.plot(0.0, 0.0, marker="o", color=MUTED, markersize=4.0, zorder=3.0)
    ax.annotate("", (x[-1], z[-1] - 0.12 * reach), (x[-1], z[-1]), arrowprops={"arrowstyle": "->", "color": INK})
    ax.set_ylim(min(low[1], z[-1] - 0.14 * reach), high[1])
    equal_axes(ax)
    return add_legend(figure)
