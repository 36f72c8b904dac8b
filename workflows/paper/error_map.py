"""Error map: which combination of snapshots and modes serves best when coordinates are limited.

Weyrer et al., section "Optimal Combinations for Maximum Budget": for each combination the e_NRMS of the transverse
displacement along the beam, averaged over the largest few numbers of coordinates, so that a lucky one does not decide.
All three treatments of the pin's rows are mapped (`nested_models`); ``round_off`` is the paper's.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from experiment import Findings, Row, Settings, rows, run, save
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from nested_models import TREATMENTS, combination, errors
from published import ERROR_MAP, EXPLAINED, TREATED

from pmr.report.blocks import Block, Chapter, Grid, KeyNumber
from pmr.report.figures import HALF, INK, MUTED, WIDE, drawing, make_sheet
from pmr.report.numbers import format_input, format_percent

#: Pools hold `smallest_pool` to `largest_pool` snapshots; errors are averaged over the `averaged` largest numbers of
#: coordinates up to `budget` or the size of the pool, but not below `fewest`; the `marked` best are named; a curve is
#: drawn for a pool of `curve`.
SETTINGS = {
    "scene": "paper_evolved", "most_snapshots": 30, "most_modes": 16, "smallest_pool": 3, "largest_pool": 120,
    "budget": 20, "averaged": 5, "fewest": 3, "marked": 15, "curve": 26,
}  # fmt: skip
COLOURS = colormaps["viridis_r"]
LABELLED = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)


def row(scene: str, snapshots: int, modes: int, most_modes: int, coordinates: list[int]) -> Row:
    """Return the mean error of one combination over numbers of coordinates, by treatment.

    NaN if one of its models can't be simulated.
    """
    basis, known = combination(scene, snapshots, modes, most_modes), dict[tuple[int, int], float]()
    result: Row = {}
    for treatment, models in basis.models.items():
        each = []
        for r in coordinates:
            model = models.of(r)
            size = (
                (0, 0) if model is None else (model.size, len(model.row_names))
            )  # "last" moves as a smaller "dropped"
            if size not in known:
                known[size] = errors(scene, model)[0]
            each.append(known[size])
        result[treatment] = float(np.mean(each))
    return result


def main(settings: Settings, out: Path, jobs: int) -> Chapter:
    """Compute all combinations, save their numbers, and return the chapter of the report."""
    pools = range(settings["smallest_pool"], settings["largest_pool"] + 1)
    tiles = [
        (n, m)
        for n in range(1, settings["most_snapshots"] + 1)
        for m in range(1, settings["most_modes"] + 1)
        if n * m in pools
    ]

    def coordinates(pool: int) -> list[int]:
        """Return the numbers of coordinates over which errors of a pool of snapshots are averaged."""
        top = min(settings["budget"], pool)
        return list(range(max(settings["fewest"], top - settings["averaged"] + 1), top + 1))

    common = {"scene": settings["scene"], "most_modes": settings["most_modes"]}
    parameters = [common | {"snapshots": n, "modes": m, "coordinates": coordinates(n * m)} for n, m in tiles]
    results = dict(zip(tiles, rows(row, parameters, out, jobs), strict=True))
    figures = figures_of(results, settings["marked"])
    save(out, figures=figures, rows={f"{n}x{m}": result for (n, m), result in results.items()})
    return chapter(results, settings, Findings(figures, *ERROR_MAP))


def figures_of(results: dict[tuple[int, int], Row], marked: int) -> dict[str, object]:
    """Return the number of ``combinations`` and, by treatment, the best ones.

    ``best`` and its ``error``; ``marked``, the best `marked` ones; ``pool``, the median of their numbers of snapshots;
    ``singular``, how many can't be simulated.
    """
    figures: dict[str, object] = {"combinations": len(results)}
    pools = np.array([n * m for n, m in results])
    for treatment in TREATMENTS:
        error = np.array([result[treatment] for result in results.values()])
        order = np.argsort(error, kind="stable")[:marked]  # those without an error come last
        names = ["x".join(map(str, list(results)[i])) for i in order if np.isfinite(error[i])]
        if names:
            figures |= {f"{treatment}.best": names[0], f"{treatment}.error": float(error[order[0]])}
            figures |= {f"{treatment}.marked": " ".join(names), f"{treatment}.pool": float(np.median(pools[order]))}
        figures[f"{treatment}.singular"] = int(np.sum(~np.isfinite(error)))
    return figures


def chapter(results: dict[tuple[int, int], Row], settings: Settings, findings: Findings) -> Chapter:
    """Return the chapter of the report on these rows, by snapshots and modes."""
    figures = findings.figures
    best = {name: f"({str(figures[f'{name}.best']).replace('x', ',')})" for name in TREATED}
    error = {name: format_percent(float(figures[f"{name}.error"])) for name in TREATED}
    captions = {
        "round_off": "Normalised RMS error of the transverse displacement along the beam, averaged over up to "
        f"{settings['averaged']} numbers of coordinates, {settings['budget']} at most. Black squares: the "
        f"{settings['marked']} lowest errors, the curve is {settings['curve']} snapshots in all; the pin's rows left "
        f"in, as "
        "published. White: not investigated; crosses: a model that can't be simulated.",
        "last": "The same with the pin's rows holding the last two coordinates.",
        "dropped": "The same with the pin's rows dropped.",
    }
    maps = [
        drawing(f"error-map-{name.replace('_', '-')}", draw_map, caption, results, settings, figures, name, width)
        for (name, caption), width in zip(captions.items(), (WIDE, HALF, HALF), strict=True)
    ]
    pools = {name: format_input(float(figures[f"{name}.pool"])) for name in TREATED}
    singular = int(figures["round_off.singular"])
    return Chapter(
        anchor="error-map",
        title="Optimal combinations for a maximum budget",
        headline=f"{best['round_off']} is best with the pin's rows left in, at {error['round_off']}; with them "
        f"dropped it is {best['dropped']}, at {error['dropped']}.",
        key_numbers=[KeyNumber(f"{best[name]}: {error[name]}", f"best, {label}") for name, label in TREATED.items()],
        paragraphs=[
            f"{len(results)} combinations are simulated, each with up to {settings['averaged']} numbers of coordinates "
            f"and in three ways. {EXPLAINED}",
            f"The pools of the {settings['marked']} best combinations hold {pools['round_off']} snapshots with the "
            f"rows left in, {pools['last']} with two coordinates held and {pools['dropped']} with the rows dropped "
            f"(median).",
            *[f"{singular} combinations can't be simulated with the rows left in."] * bool(singular),
        ],
        blocks=[
            Block("Error map", maps),
            Block("The best combinations", grids=(_best(results, figures),)),
            *findings.blocks(),
        ],
    )


def _best(results: dict[tuple[int, int], Row], figures: Mapping[str, object]) -> Grid:
    """Return the table of the marked combinations, by treatment, best first."""
    columns = {name: str(figures[f"{name}.marked"]).split() for name in TREATED}

    def cell(name: str, place: int) -> str:
        """Return the combination of a rank and its error; a dash if there are fewer."""
        if place >= len(columns[name]):
            return "–"
        n, m = map(int, columns[name][place].split("x"))
        return f"({n},{m})  {format_percent(results[n, m][name])}"

    most = max(map(len, columns.values()))
    table = tuple((str(place + 1), *(cell(name, place) for name in TREATED)) for place in range(most))
    return Grid("Snapshots, modes and mean error of the marked combinations.", ("place", *TREATED.values()), table)


def draw_map(
    results: dict[tuple[int, int], Row], settings: Settings, figures: dict[str, object], treatment: str, width: float
) -> Figure:
    """Draw a treatment's errors as tiles over snapshots and modes, in logarithmic colours; `width` is in inches."""
    n, m, wide = settings["most_snapshots"], settings["most_modes"], width > HALF
    margins = {"left": 0.6, "right": 0.62, "top": 0.1, "bottom": 0.38}
    figure, axes = make_sheet(width, 0.48 + (width - 1.22) * (0.62 if wide else 0.75), margins=margins)
    ax, errors = axes[0, 0], {tile: result[treatment] for tile, result in results.items()}
    ax.grid(visible=False)
    norm = LogNorm(np.nanmin(list(errors.values())), 1.0)
    for (x, y), error in errors.items():
        if np.isfinite(error):  # a line closes the seam
            ax.add_patch(Rectangle((x - 0.5, y - 0.5), 1.0, 1.0, color=COLOURS(norm(error)), linewidth=0.3))
        else:
            ax.plot(x, y, marker="x", color=MUTED, markersize=2.0 if wide else 1.2, markeredgewidth=0.5)
    for name in str(figures.get(f"{treatment}.marked", "")).split():
        x, y = map(int, name.split("x"))
        look: dict[str, Any] = {"facecolor": "none", "edgecolor": "black", "linewidth": 0.9, "zorder": 3.0}
        ax.add_patch(Rectangle((x - 0.5, y - 0.5), 1.0, 1.0, **look))
    x = np.linspace(settings["curve"] / (m + 0.5), n + 0.5, 100)
    ax.plot(x, settings["curve"] / x, color=INK, linewidth=0.8, linestyle=(0, (4, 2)))
    ax.set_xlim(0.5, n + 0.5)
    ax.set_ylim(0.5, m + 0.5)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10], min_n_ticks=3))
    ax.set_xlabel("Number of snapshots")
    ax.set_ylabel("Modes at each snapshot")
    _draw_colour_key(figure, ax, norm)
    return figure


def _draw_colour_key(figure: Figure, ax: Axes, norm: LogNorm) -> None:
    """Draw a strip of colours to the right of the map, labelled in per cent."""
    box, inch = ax.get_position(), 1.0 / figure.get_figwidth()
    strip = figure.add_axes((box.x1 + 0.1 * inch, box.y0, 0.1 * inch, box.height))
    strip.imshow(np.linspace(0.0, 1.0, 256)[:, None], cmap=COLOURS, origin="lower", aspect="auto", extent=(0, 1, 0, 1))
    ticks = [error for error in LABELLED if 0.0 <= float(norm(error)) <= 1.0]
    strip.set_yticks([float(norm(error)) for error in ticks], [f"{100.0 * error:g} %" for error in ticks])
    strip.yaxis.tick_right()
    strip.set_xticks([])
    strip.grid(visible=False)
    for spine in strip.spines.values():
        spine.set_visible(False)


if __name__ == "__main__":
    run(main, SETTINGS, __doc__)
