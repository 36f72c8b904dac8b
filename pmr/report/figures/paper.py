"""Axes to sketch on: metres of the system, equal in both directions, with sizes of symbols in inches."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon, Rectangle

from pmr.report.figures.canvas import INK, MUTED, sheet

LOAD = "#7b2d8e"
WIDTH = 3.9  # in: so narrow that a phone shows it whole and its text can be read
LABELS = 1.2  # in, for what is written beside the tip


class Paper:
    """Axes in m of the system whose inches are known: `inch` m each, in both directions."""

    def __init__(self, left_end: float, right_end: float, height: float) -> None:
        inches = WIDTH - LABELS - 0.2
        self.figure, axes = sheet(WIDTH, height, margins={"left": 0.0, "right": 0.0, "top": 0.0, "bottom": 0.0})
        self.ax: Axes = axes[0, 0]
        self.inch = (right_end - left_end) / inches
        self.ax.set_xlim(left_end - 0.2 * self.inch, right_end + LABELS * self.inch)
        self.ax.set_ylim(-height / 2.0 * self.inch, height / 2.0 * self.inch)
        self.ax.set_axis_off()

    def box(self, x: float, y: float, width: float, height: float, **look: Any) -> None:
        self.ax.add_patch(Rectangle((x, y), width, height, **look))

    def disc(self, x: float, y: float, radius: float, **look: Any) -> None:
        self.ax.add_patch(Circle((x, y), radius, linewidth=0.8, zorder=3.0, **look))

    def arrow(self, x: float, y: float, dx: float, dy: float, colour: str = LOAD, two_heads: bool = False) -> None:
        """From (x, y) by (dx, dy), with a head at the end or at both."""
        size = np.hypot(dx, dy)
        if size == 0.0:
            return
        along, head = np.array([dx, dy]) / size, 0.07 * self.inch
        ends = [(np.array([x + dx, y + dy]), along)] + ([(np.array([x, y]), -along)] if two_heads else [])
        self.ax.plot([x, x + dx], [y, y + dy], color=colour, linewidth=0.9)
        for tip, way in ends:
            side = np.array([-way[1], way[0]])
            corners = [tip, tip - head * (way - 0.45 * side), tip - head * (way + 0.45 * side)]
            self.ax.add_patch(Polygon(corners, facecolor=colour, edgecolor="none"))

    def write(self, x: float, y: float, text: str, colour: str = INK, **where: Any) -> None:
        self.ax.text(x, y, text, color=colour, **{"ha": "center", "va": "center", **where})

    def range(self, y: float, start: float, end: float, text: str) -> None:
        """A stretch with arrows at both ends and a text below."""
        self.arrow(start, y, end - start, 0.0, MUTED, two_heads=True)
        self.write((start + end) / 2.0, y - 0.11 * self.inch, text, MUTED)
