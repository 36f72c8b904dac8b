"""What the colours of pictures mean."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from pmr.report.figures.canvas import HALF, RAMP, sheet
from pmr.report.numbers import plain

STEPS = 60


def ramp(largest: float) -> Figure:
    """Colours from no stress to `largest`, in MPa, and beyond."""
    colours = LinearSegmentedColormap.from_list("stress", RAMP)
    figure, axes = sheet(HALF, 0.55, margins={"left": 0.1, "right": 0.3, "top": 0.08, "bottom": 0.36})
    ax = axes[0, 0]
    for k in range(STEPS):
        ax.axvspan(k / STEPS, (k + 1.2) / STEPS, color=colours(k / (STEPS - 1.0)), linewidth=0.0)
    ticks = np.linspace(0.0, 1.0, 5)
    names = [plain(float(f"{tick * largest:.3g}")) for tick in ticks]
    ax.set_xticks(ticks, [*names[:-1], f"≥ {names[-1]}"])
    ax.set_yticks([])
    ax.set_xlim(0.0, 1.0)
    ax.grid(False)
    ax.spines[:].set_visible(False)
    ax.set_xlabel("Von Mises stress in MPa")
    return figure
