"""Figures of the benchmarks' page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.scale import own_memory
from pmr.report.figures import SERIES, WIDE, add_legend, curve_style, log_axis, log_x, make_sheet, octave_axis
from pmr.report.numbers import power_of_ten


def growth(found: Mapping[str, Any]) -> Figure:
    """Draw the time of a step over the number of modes, and over the number of coordinates of the full beam."""
    figure, axes = make_sheet(WIDE, 2.4, columns=2, gridspec_kw={"wspace": 0.22})
    for ax, name, above, label in (
        (axes[0, 0], "modes", 32, "Modes r (–)"),
        (axes[0, 1], "full", 100, "Coordinates of the full beam n (–)"),
    ):
        size, ns = np.array(found[name]["size"], float), np.array(found[name]["ns"])
        ax.plot(size, ns, **(curve_style(0, 3.2) | {"linewidth": 0.0}))
        fitted = size[size >= above]
        line = np.exp(np.polyval(np.polyfit(np.log(fitted), np.log(ns[size >= above]), 1), np.log(fitted)))
        ax.plot(fitted, line, color=SERIES[0][0], linewidth=1.0)
        _both_logarithmic(ax, size, ns)
        ax.set_xlabel(label)
        ax.set_ylabel("Time of a step (ns)")
    return figure


def offline(found: Mapping[str, Any]) -> Figure:
    """Draw the seconds of each stage over the number of coordinates, on one rank and on two."""
    figure, axes = make_sheet(WIDE, 2.8)
    ax, handles = axes[0, 0], list[Line2D]()
    for number, stage in enumerate(("assemble", "snapshots", "pod", "project")):
        for ranks in sorted({record["ranks"] for record in found["records"]}):
            known = [(r["size"], r["seconds"][stage]) for r in found["records"]
                     if r["ranks"] == ranks and stage in r["seconds"]]  # fmt: skip
            if known:
                look = curve_style(number, 3.2) | (
                    {"markerfacecolor": SERIES[number][0]} if ranks == 1 else {"linestyle": ":"}
                )
                lines = ax.plot(*np.array(known).T, label={"pod": "POD"}.get(stage, stage), **look)
                handles += lines if ranks == 1 else []
    sizes = np.array([record["size"] for record in found["records"]], float)
    seconds = np.array([s for record in found["records"] for s in record["seconds"].values()])
    log_x(ax, sizes.min() / 1.3, sizes.max() * 1.3)
    log_axis(ax, float(seconds.min()), float(seconds.max()))
    ax.set_xlabel("Coordinates of the full model (–)")
    ax.set_ylabel("Time (s)")
    add_legend(figure, handles)
    return figure


def scale(found: Mapping[str, Any]) -> Figure:
    """Draw the seconds of each stage and the memory over the number of coordinates, on one rank and on two."""
    figure, axes = make_sheet(WIDE, 2.8, columns=2, gridspec_kw={"wspace": 0.22})
    done, handles = [record for record in found["records"] if record["seconds"]], list[Line2D]()
    seconds = {"assembly": "assembly", "modes": "free modes", "flexibility": "flexibility"}
    for ranks in sorted({record["ranks"] for record in done}):
        records = [record for record in done if record["ranks"] == ranks]
        size = [record["size"] for record in records]
        for number, (stage, name) in enumerate({**seconds, "memory": "memory"}.items()):
            look = curve_style(number, 3.2) | (
                {"markerfacecolor": SERIES[number][0]} if ranks == 1 else {"linestyle": ":"}
            )
            value = [own_memory(r) / 1024.0 if stage == "memory" else r["seconds"][stage] for r in records]
            lines = axes[0, int(stage == "memory")].plot(size, value, label=name, **look)
            handles += lines if ranks == 1 else []
    sizes = np.array([record["size"] for record in done], float)
    for ax, label in zip(axes[0], ("Time (s)", "Memory of all ranks (GiB)"), strict=True):
        values = np.concatenate([line.get_ydata() for line in ax.get_lines()])
        log_x(ax, sizes.min() / 1.3, sizes.max() * 1.3)
        powers = [power for power in range(3, 8) if sizes.min() / 1.3 <= 10.0**power <= sizes.max() * 1.3]
        ax.set_xticks([10.0**power for power in powers], [power_of_ten(power) for power in powers])
        log_axis(ax, float(values.min()), float(values.max()))
        ax.set_xlabel("Coordinates of the full model (–)")
        ax.set_ylabel(label)
    add_legend(figure, handles)
    return figure


def _both_logarithmic(ax: Axes, x: Any, y: Any) -> None:
    """Make both axes logarithmic around the values x and y."""
    log_x(ax, float(np.min(x)) / 1.2, float(np.max(x)) * 1.2)
    ax.set_yscale("log")
    octave_axis(ax, float(np.min(y)) / 2.0, float(np.max(y)) * 2.0)
    ax.set_ylim(float(np.min(y)) / 1.3, float(np.max(y)) * 1.3)
