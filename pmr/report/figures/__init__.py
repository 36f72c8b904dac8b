"""Figures of a run: each function draws what a result holds, computes no new values and returns a matplotlib figure."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from html import escape
from math import ceil, floor, log10
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib import style as styles
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator, NullLocator

from pmr.errors import escape_controls
from pmr.report.blocks import END_OF_SCREEN, SCREEN, Drawing
from pmr.report.numbers import format_input, power_of_ten

WIDE = 6.7  # in, the text width of an A4 page
HALF = 3.25  # in, width of each of two figures beside each other
BINS_PER_INCH = 80.0  # intervals of a history, each drawn with its peaks; an interval is about as wide as a line

MOST_DECADES = 18  # decades of a logarithmic axis, at most
STEPS = (1, 2, 5, 10)  # distances between ticks, times a power of ten
TICK = 0.45  # in, room for a tick's label along the axis
INK, MUTED, SHADE, LIMIT = "#1c2733", "#5b6875", "#e8ecf0", "#b23b00"
#: Colours of sections from the base out (Okabe and Ito), used again after the last.
SECTIONS = (INK, "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
#: Colours of several curves of one kind (Okabe and Ito), and markers that tell them apart without colour.
SERIES = (("#0072b2", "o"), ("#d55e00", "s"), ("#00664b", "^"), ("#cc79a7", "D"), ("#000000", "v"))

ROW, ENTRY, LETTER = 0.14, 0.42, 0.062  # in, of a legend: height of a row, width of a line and of a letter
#: Labels that Matplotlib gives to what has no name.
_UNNAMED = re.compile(r"|_child\d+|_nolegend_")
LETTERS = 5  # of the labels of ticks for which there is room beside the label of the y-axis


@dataclass(frozen=True)
class Pen:
    """Line style of one simulator: colour (Okabe and Ito), width and dash in pt.

    The styles can be told from each other in grey too.
    """

    label: str
    colour: str
    width: float
    dash: tuple[float, ...] = ()

    def line(self, weight: float = 1.0) -> dict[str, Any]:
        """Keywords ``color``, ``linewidth`` and ``linestyle`` for ``Axes.plot``.

        `weight` multiplies the line's width; it is below 1 where many curves are close together.
        """
        pattern: Any = (0, tuple(length / self.width for length in self.dash)) if self.dash else "-"
        return {"color": self.colour, "linewidth": weight * self.width, "linestyle": pattern}


PENS: Mapping[str, Pen] = {
    "full": Pen("full", "#56b4e9", 2.4),
    "ancf": Pen("ANCF", "#00664b", 0.7),
    "reduced": Pen("reduced", "#d55e00", 1.0, (4.0, 2.5)),
}


def section_colours(names: Iterable[str]) -> dict[str, str]:
    """Colour of each section of a boom, by name, for `names` from the base out; all figures use the same colours.

    Colours repeat after the last one of `SECTIONS`.
    """
    return {name: SECTIONS[k % len(SECTIONS)] for k, name in enumerate(names)}


def mix_with_white(colour: str, share: float) -> Any:
    """Mix the share `share` (0 to 1) of a colour with white.

    The result is opaque, so that nothing below it shows through.
    """
    return colour if share == 1.0 else tuple(1.0 - share * (1.0 - channel) for channel in to_rgb(colour))


def style() -> AbstractContextManager[None]:
    """Draw figures in the style of the report within a ``with`` block; then the settings of Matplotlib are restored."""
    return styles.context(Path(__file__).with_name("report.mplstyle"))


class Sheet(NamedTuple):
    """Figure, and its axes in an array (rows, columns) of objects of Matplotlib."""

    figure: Figure
    axes: Any


def make_sheet(
    width: float,
    height: float,
    rows: int = 1,
    columns: int = 1,
    margins: Mapping[str, float] | None = None,
    **grid: Any,
) -> Sheet:
    """Make an empty figure of `width` x `height` inches, and its axes (rows, columns).

    `margins` are the distances in inches between axes and edges of the figure: ``left``, ``right``, ``top``,
    ``bottom``.  A margin that is not stated has its default.  Fixed margins make the axes of different figures line up,
    and no text has to be measured.  `grid` holds further keywords of `Figure.subplots`.
    """
    inches = {"left": 0.6, "right": 0.16, "top": 0.28, "bottom": 0.38, **(margins or {})}
    figure = Figure(figsize=(width, height))
    gridspec = {
        "left": inches["left"] / width,
        "right": 1.0 - inches["right"] / width,
        "top": 1.0 - inches["top"] / height,
        "bottom": inches["bottom"] / height,
    }
    gridspec.update(grid.pop("gridspec_kw", {}))
    axes = figure.subplots(rows, columns, squeeze=False, gridspec_kw=gridspec, **grid)
    for ax in axes.flat:
        ax.yaxis.set_major_locator(MaxNLocator(5, steps=STEPS))
        ax.xaxis.set_major_locator(MaxNLocator(8 if width > HALF else 6, steps=STEPS))
        _place_labels(ax)
    return Sheet(figure, axes)


def _place_labels(ax: Axes, aside: float = 0.42) -> None:
    """Put axis labels at fixed distances from the axes of `ax`.

    So labels line up, and no text has to be measured.  `aside` is the distance in inches of the label of the y-axis.
    """
    extent, inch = ax.get_window_extent(), mpl.rcParams["figure.dpi"]
    ax.yaxis.set_label_coords(-aside * inch / extent.width, 0.5)
    ax.xaxis.set_label_coords(0.5, -0.25 * inch / extent.height)


def equal_axes(ax: Axes) -> None:
    """Give the x-axis and the y-axis the same scale.

    The axes become narrower or lower, and their labels keep their distances from the axes.
    """
    ax.set_aspect("equal", adjustable="box", anchor="SW")
    ax.apply_aspect()
    _place_labels(ax)
    inches = ax.get_window_extent().width / mpl.rcParams["figure.dpi"]
    ax.xaxis.set_major_locator(MaxNLocator(int(np.clip(inches / TICK, 1, 8)), steps=STEPS))


class Paper(NamedTuple):
    """Figure, and its only axes."""

    figure: Figure
    ax: Axes


def make_axes(width: float, height: float, across: str, up: str, **margins: float) -> Paper:
    """Make a figure of `width` x `height` inches with one pair of axes, whose labels are `across` and `up`.

    `margins` are those of `make_sheet`.
    """
    figure, axes = make_sheet(width, height, margins=margins)
    axes[0, 0].set(xlabel=across, ylabel=up)
    return Paper(figure, axes[0, 0])


def make_panels(count: int, height: float, wspace: float, hspace: float, **grid: Any) -> Sheet:
    """Make a figure as wide as a page with `count` panels, two in a row; the sheet's `axes` are a list of them.

    A single panel is as wide as the figure.  `height` in inches is that of a row with the gap to the next one.  Each
    panel has room for a title, and the gaps between panels are `wspace` and `hspace` times as wide and high as a panel.
    `grid` holds further keywords of `Figure.subplots`.
    """
    rows, columns = -(-count // 2), min(count, 2)
    gaps = {"wspace": wspace, "hspace": hspace}
    figure, axes = make_sheet(
        WIDE, 0.66 + height * rows, rows, columns, margins={"top": 0.42}, gridspec_kw=gaps, **grid
    )
    for ax in axes.flat[count:]:
        ax.set_visible(False)
    return Sheet(figure, list(axes.flat[:count]))


def legend_rows(names: Sequence[str], width: float) -> int:
    """Number of rows that a legend of `names` needs above a figure of `width` inches."""
    entries, rows = [ENTRY + LETTER * len(name) for name in names], 1
    while rows < len(names):
        columns = np.array_split(entries, ceil(len(names) / rows))  # each as wide as its longest name
        if sum(float(column.max()) for column in columns) <= width - 0.6:
            break
        rows += 1
    return rows


def add_legend(figure: Figure, handles: Sequence[Artist] = ()) -> Figure:
    """Add a legend above the axes of a figure, where it covers no curve, and return the figure.

    The entries are `handles`; if there are none, all that is drawn with a label, in the order in which it was drawn.
    Each label has one entry; a figure without labels gets no legend.  The figure becomes higher by `ROW` inches for
    each row after the first one that the legend needs.
    """
    by_name: dict[str, Artist] = {str(handle.get_label()): handle for handle in handles}
    if not handles:
        drawn = (artist for ax in figure.axes for artist in ax.get_children())
        for artist in (artist for artist in drawn if isinstance(artist, Line2D | Patch | PolyCollection)):
            if not _UNNAMED.fullmatch(name := str(artist.get_label())):
                by_name.setdefault(name, artist)
    if not by_name:
        return figure
    left_edge, roomy = figure.axes[0].get_position().x0, figure.get_figwidth() > HALF
    rows = legend_rows(list(by_name), figure.get_figwidth())
    _raise_top(figure, ROW * (rows - 1))
    legend = figure.legend(
        handles=list(by_name.values()),
        labels=[str(number) for number, _ in enumerate(by_name)],
        loc="upper left",
        bbox_to_anchor=(left_edge - 0.01, 1.0),
        ncols=ceil(len(by_name) / rows),
        borderaxespad=0.25,
        columnspacing=1.2 if roomy else 0.9,
        handletextpad=0.6 if roomy else 0.4,
        handlelength=2.2 if roomy else 1.9,
    )
    for text, name in zip(legend.get_texts(), by_name, strict=True):
        text.set_text(name)  # Matplotlib leaves out labels that begin with _, so the text is set afterwards
    return figure


def _raise_top(figure: Figure, inches: float) -> None:
    """Make a figure higher by some `inches` above its axes, which keep their size and their distance from below."""
    share = figure.get_figheight() / (figure.get_figheight() + inches)
    figure.set_figheight(figure.get_figheight() + inches)
    for ax in figure.axes:
        box = ax.get_position(original=True)
        ax.set_position((box.x0, share * box.y0, box.width, share * box.height))


def log_axis(ax: Axes, low: float, high: float) -> None:
    """Make the y-axis logarithmic over the whole decades from `low` to `high`, both above 0.

    The axis spans at least one decade.  If the range spans more than `MOST_DECADES`, only the highest ones are shown.
    Labels are powers of ten as plain text, as math mode is switched off.
    """
    top = ceil(log10(high) - 1e-9)
    bottom = max(min(floor(log10(low)), top - 1), top - MOST_DECADES)
    decades = range(top, bottom - 1, -ceil((top - bottom) / 5))
    ax.set_yscale("log")
    ax.set_ylim(10.0 ** (bottom - 0.15), 10.0 ** (top + 0.15))
    ax.set_yticks([10.0**decade for decade in decades], [power_of_ten(decade) for decade in decades])
    ax.yaxis.set_minor_locator(NullLocator())


def octave_axis(ax: Axes, low: float, high: float) -> bool:
    """Make the y-axis logarithmic with labels 1, 2, 5, 10 if the range `low` to `high` spans one to four decades.

    Return true if the axis was made logarithmic.  For any other range the axis stays as it is, and false is returned.
    """
    if not 10.0 < high / max(low, 1e-300) < 1e4:
        return False
    ticks = _round_values(0.9 * low, 1.1 * high)
    ax.set_yscale("log")
    ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.yaxis.set_minor_locator(NullLocator())
    return True


def log_x(ax: Axes, low: float, high: float) -> None:
    """Make the x-axis logarithmic from `low` to `high`, both above 0, with the labels 1, 2, 5 times powers of ten.

    If the range spans more than three decades, the labels are powers of ten.
    """
    many = log10(high / low) > 3.0
    ticks = _round_values(0.999 * low, 1.001 * high, (1.0,) if many else (1.0, 2.0, 5.0))
    ax.set_xscale("log")
    ax.set_xlim(low, high)
    ax.set_xticks(ticks, [power_of_ten(round(log10(tick))) if many else format_input(tick) for tick in ticks])
    ax.xaxis.set_minor_locator(NullLocator())


def _round_values(low: float, high: float, steps: Sequence[float] = (1.0, 2.0, 5.0)) -> list[float]:
    """Values from `low` to `high`, each the product of one of `steps` and a power of ten."""
    decades = range(floor(log10(low)), ceil(log10(high)) + 1)
    return [tick for decade in decades for step in steps if low <= (tick := step * 10.0**decade) <= high]


def curve_style(number: int, size: float = 2.6) -> dict[str, Any]:
    """Keywords for ``Axes.plot`` of the curve with this number: colour, marker of the given `size`, and dash.

    When all colours of `SERIES` are used, they are used again with other dashes and marker fills.  After three rounds,
    styles repeat.
    """
    colour, marker = SERIES[number % len(SERIES)]
    cycle = number // len(SERIES) % 3
    return {
        "color": colour,
        "linewidth": 0.9,
        "linestyle": ("-", "--", ":")[cycle],
        "marker": marker,
        "markersize": size,
        "markerfacecolor": ("white", colour, "#c9d1d9")[cycle],
        "markeredgewidth": 0.7,
    }


def bins_of(ax: Axes) -> int:
    """Number of intervals (40 or more) into which a signal over the width of `ax` is cut, each drawn with its peaks."""
    inches = ax.get_window_extent().width / mpl.rcParams["figure.dpi"]
    return max(40, int(BINS_PER_INCH * inches))


FONT = "pmr figures"  # name of the font that the page embeds
#: Tags of an SVG, references to identifiers in it, and decimal numbers.
_TAG = re.compile(r"<[^>]*>")
_REFERENCE = re.compile(r'(href="|url\()#([^")]+)')
_NUMBER = re.compile(r"-?\d+\.\d+")


def svg(figure: Figure, name: str, description: str) -> str:
    """Turn a figure into an ``<svg>`` element whose identifiers are unique in the page; changes texts of the figure.

    Text remains text, so that it can be searched.  Text is in the font `FONT`, which the page embeds, so that it looks
    the same in every browser and in the PDF.  To keep pages with dozens of figures small, styles become attributes, and
    coordinates are rounded to two decimals of a point.

    Parameters
    ----------
    figure : Figure
    name : str
        Name of the figure, unique in the page; it is put before every identifier.
    description : str
        Text that a screen reader says in place of the figure.
    """
    buffer = io.BytesIO()
    for ax in figure.axes:
        letters = max(map(len, ax.yaxis.get_major_formatter().format_ticks(list(ax.get_yticks()))), default=0)
        if letters > LETTERS:
            _place_labels(ax, 0.1 + LETTER * letters)
    for text in figure.findobj(Text):
        text.set_parse_math(False)  # a user's $ is a dollar
        text.set_text(escape_controls(text.get_text()))
    with mpl.rc_context({"svg.hashsalt": name, "svg.fonttype": "none"}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # glyphs that DejaVu Sans lacks: the page shows them in another font
        figure.savefig(buffer, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    lines = map(escape_controls, buffer.getvalue().decode().split("\n"))  # labels of ticks are made when they are drawn
    _, opening, content = re.split(r"(<svg[^>]*>)", "\n".join(lines), maxsplit=1)
    content = re.sub(r"(?s)<defs>\s*<style.*?</defs>|<metadata.*?</metadata>|\s+(?=<(?!/text)|$)", "", content)
    box = re.search(r'viewBox="([^"]*)"', opening)
    assert box is not None  # as Matplotlib writes it
    _, _, width, height = box[1].split()
    used = {identifier for _, identifier in _REFERENCE.findall(content)}
    return (
        f'<svg viewBox="{box[1]}" width="{width}pt" height="{height}pt" role="img" stroke-linejoin="round" '
        f'font-family="{FONT}" aria-label="{escape(escape_controls(description))}">'
        f"{_TAG.sub(lambda tag: _shorten_tag(tag[0], name, used), content)}"
    )


def _shorten_tag(tag: str, name: str, used: Collection[str]) -> str:
    """Return a tag of an SVG with `name` before identifiers, attributes in place of styles, and rounded numbers.

    Identifiers that are not in `used` are left out.
    """
    tag = re.sub(r' id="([^"]*)"', lambda match: f' id="{name}-{match[1]}"' if match[1] in used else "", tag)
    tag = _REFERENCE.sub(rf"\1#{name}-\2", tag.replace("xlink:href", "href"))
    tag = re.sub(r' style="([^"]*)"', lambda match: "".join(map(_attribute, match[1].split(";"))), tag)
    return _NUMBER.sub(lambda number: f"{float(number[0]):.2f}".rstrip("0").rstrip("."), " ".join(tag.split()))


def _attribute(declaration: str) -> str:
    """Return a declaration of a style as an attribute with a space before it; empty for the name of a font."""
    key, _, value = map(str.strip, declaration.partition(":"))
    return f' {key}="{value}"' if value and key != "font-family" else ""


def drawing(name: str, draw: Callable[..., Figure], caption: str, *arguments: Any, fits: bool = False) -> Drawing:
    """Draw a figure in the report's style by ``draw(*arguments)``, and return it with its caption.

    `name` is the figure's identifier and has to be unique in the page.  If `fits` is true, a second figure is drawn by
    ``draw(*arguments, HALF)``.  It replaces the first one in narrow windows and is not printed.
    """
    with style():
        figure = draw(*arguments)
        shown = svg(figure, name, caption)
        if fits:
            shown += f"{SCREEN}{svg(draw(*arguments, HALF), f'{name}-narrow', caption)}{END_OF_SCREEN}"
        return Drawing(name, shown, caption, half=figure.get_figwidth() <= HALF, fits=fits)
