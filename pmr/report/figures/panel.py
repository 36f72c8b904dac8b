"""Axes that draw quickly: all grid lines as one path, and labels without an object for each tick."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from matplotlib import rcParams
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.lines import Line2D
from matplotlib.text import Text
from numpy.typing import NDArray

from pmr.errors.text import visible

PAD = 7.0  # pt, between axes and labels
_Artist = TypeVar("_Artist", bound=Artist)
CLOSE = 1e-10  # of the range: a tick so near to its end is inside


class _Quick:
    """Axis without ticks as objects.

    Each would be two texts and three lines, of which our style shows a label and a line of the grid.  To make them, to
    copy their looks and to measure them would take longer than all else in a figure.
    """

    majorTicks: Any = ()  # noqa: N815
    minorTicks: Any = ()  # noqa: N815
    named: str  # the keyword that shows labels
    _labelled = _ruled = True  # until `set_tick_params` says otherwise

    def set_tick_params(self, which: Any = "major", reset: bool = False, **look: Any) -> None:
        super().set_tick_params(which, reset, **look)  # type: ignore[misc]
        self._labelled = look.get(self.named, self._labelled)
        self._ruled = look.get("gridOn", self._ruled)

    def get_major_ticks(self, numticks: int | None = None) -> list[Any]:
        return []

    def get_minor_ticks(self, numticks: int | None = None) -> list[Any]:
        return []

    def get_children(self: Any) -> list[Any]:
        return [self.label, self.offsetText]

    def get_tightbbox(self, renderer: Any = None, **_: Any) -> None:
        """Unknown: all labels stand at fixed distances, and nothing gives way to them."""

    def draw(self: Any, renderer: Any) -> None:
        if not self.get_visible():
            return
        places, formatter = np.asarray(self.get_majorticklocs(), float), self.get_major_formatter()
        names = np.array([visible(name) for name in formatter.format_ticks(places)], object)
        low, high = np.sort(self.get_transform().transform(self.get_view_interval()))
        at, near = self.get_transform().transform(places), CLOSE * (high - low)
        inside = (at >= low - near) & (at <= high + near)
        places, names = places[inside], names[inside]
        if self._ruled and len(places):
            self._rule(places).draw(renderer)
        if self._labelled and len(places):
            label = self._tick_label()
            for place, name in zip(places, names, strict=True):
                label.set(**{self.axis_name: place, "text": name})
                label.draw(renderer)
            if offset := formatter.get_offset():
                self.offsetText.set_text(offset)
                self._update_offset_text_position([label.get_window_extent(renderer)], [])
                self.offsetText.draw(renderer)
        self.label.draw(renderer)
        self.stale = False

    def _rule(self: Any, places: NDArray[np.float64]) -> Line2D:
        """Lines across the axes at `places` as one path."""
        ends = [np.repeat(places, 3), np.tile([0.0, 1.0, np.nan], len(places))]
        line = Line2D(
            *(ends if self.axis_name == "x" else ends[::-1]),
            transform=getattr(self.axes, f"get_{self.axis_name}axis_transform")("grid"),
            color=rcParams["grid.color"],
            linewidth=rcParams["grid.linewidth"],
        )
        return self._placed(line)

    def _tick_label(self: Any) -> Text:
        """A label to be put from tick to tick."""
        where, va, ha = getattr(self.axes, f"get_{self.axis_name}axis_text1_transform")(PAD)
        tick = f"{self.axis_name}tick"
        label = Text(
            transform=where, va=va, ha=ha, fontsize=rcParams[f"{tick}.labelsize"], color=rcParams[f"{tick}.color"]
        )
        return self._placed(label)

    def _placed(self: Any, artist: _Artist) -> _Artist:
        artist.axes = self.axes
        artist.set_figure(self.axes.figure)
        return artist


class _X(_Quick, XAxis):
    named = "labelbottom"


class _Y(_Quick, YAxis):
    named = "labelleft"


class Panel(Axes):
    """Axes of a figure of the report: x below, y on the left."""

    def _init_axis(self) -> None:
        super()._init_axis()  # type: ignore[misc]
        self.xaxis, self.yaxis = _X(self), _Y(self)
        for side, axis in (("bottom", self.xaxis), ("top", self.xaxis), ("left", self.yaxis), ("right", self.yaxis)):
            self.spines[side].register_axis(axis)

    def clear(self) -> None:
        super().clear()
        self.spines[["bottom", "left"]].set_position(("outward", 0.0))  # what ticks as objects would see to
