"""A boom at rest under its load, seen from the side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pmr.report.figures.canvas import INK, MUTED, WIDE, key, of_sections, sheet

Array = NDArray[np.float64]
#: Largest displacement as drawn, over the reach; height of the picture over its width, at most.
BENT, TALLEST = 0.06, 0.42


@dataclass(frozen=True)
class AtRest:
    """Places along the boom and how far they are displaced upwards across it, section by section."""

    along: Array  # (b,) m, from the base's tail
    across: Array  # (b,) m
    section: NDArray[np.int64]  # (b,)
    names: tuple[str, ...]  # of all sections
    luffing: float  # rad

    @property
    def scale(self) -> float:
        """How many times as large displacements are drawn, a round number."""
        largest = float(np.abs(self.across).max(initial=0.0))
        if largest <= 0.0:
            return 1.0
        enlargement = BENT * float(self.along.max()) / largest
        decade = 10.0 ** np.floor(np.log10(enlargement))
        return float(max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= enlargement))


def at_rest(boom: AtRest) -> Figure:
    """The undeformed axis, thin, and the bent sections, displacements enlarged."""
    c, s = np.cos(boom.luffing), np.sin(boom.luffing)
    deflection = boom.scale * boom.across
    x, z = boom.along * c - deflection * s, boom.along * s + deflection * c
    reach = float(boom.along.max())
    low = np.minimum(0.0, [min(x.min(), 0.0), min(z.min(), 0.0)])
    high = np.array([max(x.max(), reach * c, 0.1 * reach), max(z.max(), reach * s, 0.1 * reach)])
    edge = 0.04 * float(np.max(high - low))
    low, high = low - edge, high + edge
    tall = min((WIDE - 0.76) * float((high - low)[1] / (high - low)[0]), TALLEST * WIDE)
    figure, axes = sheet(WIDE, tall + 0.54, margins={"left": 0.6, "right": 0.16, "top": 0.26, "bottom": 0.42})
    ax = axes[0, 0]
    ax.plot([0.0, reach * c], [0.0, reach * s], color=MUTED, linewidth=0.6, zorder=1.0)
    colours = of_sections(boom.names)
    for k, colour in enumerate(colours.values()):
        of_section = boom.section == k
        order = np.argsort(boom.along[of_section])
        ax.plot(
            x[of_section][order], z[of_section][order], color=colour, linewidth=2.0, zorder=2.0, solid_capstyle="butt"
        )
    ax.plot(0.0, 0.0, marker="o", color=MUTED, markersize=4.0, zorder=3.0)
    ax.annotate("", (x[-1], z[-1] - 0.12 * reach), (x[-1], z[-1]), arrowprops={"arrowstyle": "->", "color": INK})
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(min(low[1], z[-1] - 0.14 * reach), high[1])
    ax.set_aspect("equal", adjustable="box", anchor="SW")
    ax.set_xlabel("Radius in m")
    ax.set_ylabel("Height in m")
    key(figure, [Line2D([], [], color=colour, linewidth=2.0, label=name) for name, colour in colours.items()])
    return figure
