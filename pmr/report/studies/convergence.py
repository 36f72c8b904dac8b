"""Chapter about a study of convergence with the mesh."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pmr.report.blocks import Block, Chapter, KeyNumber
from pmr.report.figures.canvas import WIDE, add_legend, curve_style, drawing, log_axis, log_x, make_sheet
from pmr.report.numbers import format_length
from pmr.report.studies.finished import FinishedStudy
from pmr.studies.tasks import cell_number

APPROACHES = {"ancf": "ANCF cable", "full": "full model"}
_NUMBERS = {"full": 0, "ancf": 2}  # numbers of the models' colours in SERIES


def build_chapter(study: FinishedStudy, prefix: str) -> Chapter:
    """Build the chapter about the error over the number of coordinates; `prefix` is put before every identifier."""
    approaches = {name: label for name, label in APPROACHES.items() if study.runs(approach=name)}
    chosen = {name: study.figures.get(f"chosen.{name}") for name in approaches}
    caption = (
        "Absolute error of the tip displacement, the norm over all steps of its difference to the finest beam of the "
        "same approach, over the number of coordinates. Filled: as many elements as the scene asks for."
    )
    figure = drawing(f"{prefix}-errors", error_figure, caption, study)
    finest = {
        name: max(cell_number(run.parameters["elements"]) for run in study.runs(approach=name)) for name in approaches
    }
    compared = [
        f"{len(study.runs(approach=name))} of the {label} with up to {finest[name]:g} elements"
        for name, label in approaches.items()
    ]
    reached = [f"the {label} to {format_length(study.figure(f'least.{name}'))}" for name, label in approaches.items()]
    return Chapter(
        anchor=prefix,
        title=study.title,
        headline=f"Meshes converge: {', '.join(reached)}.",
        key_numbers=[
            KeyNumber(format_length(cell_number(value)), f"{APPROACHES[name]}, as many elements as asked for")
            for name, value in chosen.items()
            if value is not None
        ],
        paragraphs=[
            f"{' and '.join(compared)} are compared with the finest of their kind.",
        ],
        blocks=[Block("Error over the number of coordinates", ((figure,),))],
    )


def error_figure(study: FinishedStudy) -> Figure:
    """Draw the absolute error of the tip over the number of coordinates, both on logarithmic axes."""
    figure, axes = make_sheet(WIDE, 2.9)
    ax = axes[0, 0]
    handles, every = [], []
    for name, label in APPROACHES.items():
        if not study.runs(approach=name):
            continue
        runs = [run for run in study.runs(approach=name) if run.figures.get("e_abs")]
        x = [cell_number(run.figures["coordinates"]) for run in runs]
        y = [cell_number(run.figures["e_abs"]) for run in runs]
        look = curve_style(_NUMBERS[name], 3.2)
        ax.plot(x, y, **look)
        error_at_choice = study.figures.get(f"chosen.{name}")
        for at, error in zip(x, y, strict=True):
            if error == error_at_choice:
                ax.plot([at], [error], **{**look, "markerfacecolor": look["color"], "markersize": 5.0})
        handles.append(Line2D([], [], label=label, **look))
        every += list(zip(x, y, strict=True))
    log_x(ax, 0.9 * min(x for x, _ in every), 1.1 * max(x for x, _ in every))
    log_axis(ax, min(y for _, y in every), max(y for _, y in every))
    ax.set_xlabel("Number of coordinates (–)")
    ax.set_ylabel("Absolute error of the tip in m")
    add_legend(figure, handles)
    return figure
