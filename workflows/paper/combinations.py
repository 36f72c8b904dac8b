"""Selected combinations of snapshots and modes, with every number of coordinates up to all that their pools hold.

Weyrer et al., section "Selected Combinations Investigation". Errors are those against the full model's motion: e_NRMS
of the transverse displacement along the beam, and the error of the strain energy summed over all steps, in J. Each is
given for the three treatments of the pin's rows (`nested_models`); ``round_off`` is the paper's.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from experiment import Findings, Row, Settings, rows, run, save
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from nested_models import TREATMENTS, combination, errors
from published import COMBINATIONS, EXPLAINED, TREATED

from pmr.report.blocks import Block, Chapter, Grid, KeyNumber
from pmr.report.figures import SHADE, WIDE, add_legend, curve_style, drawing, log_axis, make_sheet
from pmr.report.numbers import format_input, format_percent

SETTINGS = {"scene": "paper_evolved", "combinations": [[5, 6], [15, 1], [10, 10]], "fewest": 3}
#: Coordinates for which kappa and errors are stated, the budget of the error map.
STATED = 20
#: An error that is no longer the largest possible one, which is 1.
BELOW_MAXIMUM = 0.999
MEASURES = {"beam": "e_NRMS of the beam (–)", "strain": "Strain energy error in J"}


def row(scene: str, snapshots: int, modes: int, most_modes: int, fewest: int) -> Row:
    """Return the errors (c,) of one combination over its c numbers of coordinates, by treatment.

    ``kappa`` is the share of the squared ``singular_values`` that `STATED` coordinates hold; an error is NaN where the
    snapshots span fewer dimensions.
    """
    basis, coordinates = combination(scene, snapshots, modes, most_modes), np.arange(fewest, snapshots * modes + 1)
    squares = np.sort(basis.singular_values**2)
    held = squares[: len(squares) - min(STATED, len(squares))].sum() / squares.sum()
    result: Row = {"coordinates": coordinates, "singular_values": basis.singular_values, "kappa": 1.0 - held}
    for treatment, models in basis.models.items():
        found = [errors(scene, models.of(r)) if models.has(r) else (np.nan, np.nan) for r in coordinates.tolist()]
        result[f"{treatment}.beam"], result[f"{treatment}.strain"] = np.transpose(found)
    return result


def main(settings: Settings, out: Path, jobs: int) -> Chapter:
    """Compute all combinations, save their numbers, and return the chapter of the report."""
    names = [f"({n},{m})" for n, m in settings["combinations"]]
    common = {"scene": settings["scene"], "fewest": settings["fewest"]}
    common["most_modes"] = max(m for _, m in settings["combinations"])
    parameters = [common | {"snapshots": n, "modes": m} for n, m in settings["combinations"]]
    results = dict(zip(names, rows(row, parameters, out, jobs), strict=True))
    figures = figures_of(results)
    save(out, figures=figures, rows=results)
    return chapter(results, Findings(figures, *COMBINATIONS))


def figures_of(results: dict[str, Row]) -> dict[str, float | None]:
    """Return ``<combination>.kappa`` and, by treatment, ``first``, ``beam`` and ``strain``.

    ``first`` is the fewest coordinates whose error is below the largest possible one, None without one; ``beam`` and
    ``strain`` are the errors with all coordinates.
    """
    figures: dict[str, float | None] = {}
    for name, result in results.items():
        short = name.strip("()").replace(",", "x")
        figures[f"{short}.kappa"] = result["kappa"]
        for treatment in TREATMENTS:
            error = result[f"{treatment}.beam"]
            valid = np.flatnonzero(np.isfinite(error))
            figures[f"{short}.{treatment}.first"] = first_below(result, treatment)
            for measure in MEASURES:
                figures[f"{short}.{treatment}.{measure}"] = float(result[f"{treatment}.{measure}"][valid[-1]])
    for treatment in TREATMENTS:
        firsts = [figures[key] for key in figures if key.endswith(f".{treatment}.first")]
        figures[f"{treatment}.first"] = min((one for one in firsts if one is not None), default=None)
    return figures


def first_below(result: Row, treatment: str) -> float | None:
    """Return the fewest coordinates whose error along the beam is below the largest possible one; None without one."""
    below = np.flatnonzero(np.nan_to_num(result[f"{treatment}.beam"], nan=1.0) < BELOW_MAXIMUM)
    return int(result["coordinates"][below[0]]) if len(below) else None


def chapter(results: dict[str, Row], findings: Findings) -> Chapter:
    """Return the chapter of the report on these rows, by combination."""
    stated = {
        name: {t: at_most(result["coordinates"], result[f"{t}.beam"], STATED) for t in TREATED}
        for name, result in results.items()
    }
    said = [
        ", ".join(f"{name} {format_percent(stated[name][treatment])}" for name in results)
        for treatment in ("round_off", "dropped")
    ]
    over = (
        "Normalised RMS error of the transverse displacement along the beam (top) and absolute error of the strain "
        "energy summed over all steps (bottom), over the number of coordinates; on the left with the pin's rows as the "
        "singular value decomposition leaves them, on the right without. Curves end where the snapshots span no more "
        "dimensions. "
        f"Shaded: {STATED - 4} to {STATED} coordinates, the budget of the error map."
    )
    sigma = "Singular values of the snapshots of each combination, over the first of them."
    at_budget = Grid(
        f"Error along the beam with {STATED} coordinates (or all that there are).",
        ("combination", *TREATED.values()),
        tuple((name, *(format_percent(error) for error in errors.values())) for name, errors in stated.items()),
    )
    first = Grid(
        "Number of coordinates from which on the error is below its maximum.",
        ("combination", *TREATED.values()),
        tuple((name, *(_number(first_below(result, t)) for t in TREATED)) for name, result in results.items()),
    )
    last = {
        name: result["round_off.beam"][np.isfinite(result["round_off.beam"])][-1] for name, result in results.items()
    }
    return Chapter(
        anchor="combinations",
        title="Selected combinations",
        headline=f"With {STATED} coordinates: {said[0]} with the pin's rows left in, {said[1]} with them dropped.",
        key_numbers=[
            KeyNumber(format_percent(float(error)), f"{name}, all, rows left in") for name, error in last.items()
        ],
        paragraphs=[EXPLAINED],
        blocks=[
            Block(
                "Errors over the number of coordinates",
                (drawing("combinations-errors", draw_errors, over, results),),
                grids=(at_budget, first),
            ),
            Block("Singular values", (drawing("combinations-sigma", draw_singular_values, sigma, results),)),
            *findings.blocks(),
        ],
    )


def at_most(coordinates: np.ndarray, error: np.ndarray, most: int) -> float:
    """Return the error (c,) at the largest number of coordinates (c,) that is at most `most` and has an error."""
    return float(error[np.flatnonzero((coordinates <= most) & np.isfinite(error))[-1]])


def _number(value: float | None) -> str:
    """Return a number as text, a dash for None."""
    return "–" if value is None else format_input(value)


def draw_errors(results: dict[str, Row]) -> Figure:
    """Draw both errors over the number of coordinates; on the left with the pin's rows, on the right without."""
    columns = ("round_off", "dropped")
    figure, axes = make_sheet(
        WIDE,
        4.4,
        rows=2,
        columns=2,
        margins={"top": 0.5},
        sharex=True,
        sharey="row",
        gridspec_kw={"wspace": 0.05, "hspace": 0.12},
    )
    for line, (measure, label) in enumerate(MEASURES.items()):
        values = []
        for column, treatment in enumerate(columns):
            ax = axes[line, column]
            ax.axvspan(STATED - 4.5, STATED + 0.5, color=SHADE, linewidth=0.0, zorder=0.0)
            for number, result in enumerate(results.values()):
                error = result[f"{treatment}.{measure}"]
                shown = np.nan_to_num(error) > 0.0
                ax.plot(result["coordinates"][shown], error[shown], **curve_style(number, 1.8))
                values.append(error[shown])
            if line == 0:
                ax.set_title(f"pin's {TREATED[treatment]}", loc="left", pad=4.0)
            else:
                ax.set_xlabel("Number of coordinates (–)")
        every = np.concatenate(values)
        log_axis(axes[line, 0], float(every.min()), float(every.max()))
        axes[line, 0].set_ylabel(label)
    axes[0, 0].set_xlim(0.0, max(result["coordinates"][-1] for result in results.values()) + 1.0)
    add_legend(figure, [Line2D([], [], label=name, **curve_style(number)) for number, name in enumerate(results)])
    return figure


def draw_singular_values(results: dict[str, Row]) -> Figure:
    """Draw the singular values of all combinations over the first of each."""
    figure, axes = make_sheet(WIDE, 2.4)
    ax, least = axes[0, 0], 1.0
    for number, result in enumerate(results.values()):
        relative = result["singular_values"] / result["singular_values"][0]
        shown = relative > 0.0
        ax.plot(np.arange(1, len(relative) + 1)[shown], relative[shown], **curve_style(number, 2.0))
        least = min(least, float(relative[shown].min()))
    log_axis(ax, least, 1.0)
    ax.set_xlim(0.0, None)
    ax.set_xlabel("Number k (–)")
    ax.set_ylabel("Singular value σ(k) / σ(1) (–)")
    add_legend(figure, [Line2D([], [], label=name, **curve_style(number)) for number, name in enumerate(results)])
    return figure


if __name__ == "__main__":
    run(main, SETTINGS, __doc__)
