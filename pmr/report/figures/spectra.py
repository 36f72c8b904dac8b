"""Figures of the basis' singular values and of the eigenfrequencies."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pmr.report.decimation import spread
from pmr.report.figures.canvas import HALF, INK, MUTED, PENS, key, log_axis, octave_axis, sheet
from pmr.report.numbers import share_captured
from pmr.report.subject import length, moving
from pmr.results import RunResult

CLOSED_FORM_POINTS = 11
TURN = 2.0 * np.pi  # rad


def singular_values(result: RunResult) -> Figure:
    """Singular values over the first of them; those of the basis are filled, kappa(r) is what they hold."""
    sigma, taken = result.shapes.singular_values, result.shapes.shapes.shape[1]
    figure, axes = sheet(HALF, 2.15)
    ax = axes[0, 0]
    number, relative = np.arange(1, len(sigma) + 1), sigma / sigma[0]
    positive = relative > 0.0
    for chosen, fill, label in (
        (positive & (number <= taken), PENS["reduced"].colour, f"taken, r = {taken}"),
        (positive & (number > taken), "white", "left out"),
    ):
        if chosen.any():
            look = _dots(PENS["reduced"].colour, fill, 3.2)
            ax.plot(number[chosen], relative[chosen], label=label, **look)
    if taken < len(sigma):
        ax.axvline(taken + 0.5, color=MUTED, linewidth=0.7, linestyle=(0, (3, 2)))
    log_axis(ax, float(relative[positive].min()), 1.0)
    ax.set_xlim(0.0, len(sigma) + 1.0)
    ax.set_xlabel("Number k (–)")
    ax.set_ylabel("Singular value σ(k) / σ(1) (–)")
    kappa = result.summary.get("basis", {}).get("kappa")
    if kappa is not None:
        ax.text(0.03, 0.06, share_captured(kappa, taken), transform=ax.transAxes)
    key(figure, ax.get_legend_handles_labels()[0])
    return figure


def frequencies(result: RunResult) -> Figure:
    """Lowest eigenfrequencies in Hz against the slider position; closed forms as far up as the models.

    Where a body slides out of a mouth, against what of it reaches beyond that.
    """
    curves = result.frequencies
    shown = [family for family in (curves.full, curves.reduced) if np.isfinite(family).any()]
    top = np.max([np.nanmax(family, axis=1) for family in shown], axis=0)[:, None]
    closed = np.where(curves.closed_form <= 1.01 * top, curves.closed_form, np.nan)
    telescopic = moving(result) == "mouth"
    x = length(result) - curves.s if telescopic else curves.s
    figure, axes = sheet(HALF, 2.15)
    ax = axes[0, 0]
    handles = []
    for label, omega, look, where in (
        ("full", curves.full, PENS["full"].line(), slice(None)),
        ("reduced", curves.reduced, PENS["reduced"].line(), slice(None)),
        ("closed form", closed, _dots(INK, "none", 2.6), spread(len(curves.s), CLOSED_FORM_POINTS)),
    ):
        if np.isfinite(omega).any():
            ax.plot(x[where], omega[where] / TURN, **look)
            handles.append(Line2D([], [], label=label, **look))
    octave_axis(ax, min(float(np.nanmin(family)) for family in shown) / TURN, float(top.max()) / TURN)
    ax.set_xlabel("Length beyond the mouth in m" if telescopic else "Slider position s in m")
    ax.set_ylabel("Eigenfrequency in Hz")
    key(figure, handles)
    return figure


def _dots(edge: str, fill: str, size: float) -> dict[str, Any]:
    return {
        "linestyle": "none",
        "marker": "o",
        "markersize": size,
        "markerfacecolor": fill,
        "markeredgecolor": edge,
        "markeredgewidth": 0.6,
    }
