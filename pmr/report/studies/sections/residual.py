"""Residual flexibility beside other bases."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pmr.report.blocks import Block, Chapter, Grid, KeyNumber, drawing
from pmr.report.figures.canvas import WIDE, log_axis, sheet
from pmr.report.numbers import percent, significant
from pmr.report.studies.curves import dots, log_x
from pmr.report.studies.finished import FinishedStudy
from pmr.studies.engine.task import number
from pmr.studies.results import RunRecord

NAMES = {
    "pod": "POD of eigenmodes",
    "modes": "free modes",
    "harmonic": "POD of harmonic responses",
    "trajectory": "POD of the full motion",
    "flexibility": "residual flexibility",
}
ESTIMATED = ("flexibility",)
COLUMNS = 2


def content(study: FinishedStudy, prefix: str) -> Chapter:
    """Errors over the number of coordinates and over seconds, and what the estimate says of them."""
    scenes, sizes = study.scenes, [int(r) for r in study.asked["coordinates"]]
    few = 6 if 6 in sizes else sizes[len(sizes) // 2]
    least, largest = (study.figures.get(f"ratio.{end}") for end in ("least", "largest"))
    ratio = "" if least is None else f"{significant(number(least), 3)} to {significant(number(largest), 3)}"
    over_r = (
        "Normalised RMS error along the beam against the full model, over the number of coordinates. What the "
        "full model's round-off decides is left out, and so are models that can't move."
    )
    over_time = (
        "The same errors over the time that the compiled simulator takes, in the second scene: the fastest of five "
        "simulations, measured while other runs were under way."
    )
    return Chapter(
        anchor=prefix,
        title=study.title,
        headline=_gain(study, few),
        key_numbers=[
            KeyNumber(percent(number(value)), f"{scene.replace('_', ' ')}, {few} coordinates")
            for scene in scenes[:2]
            if (value := study.figures.get(f"{scene}.flexibility.{few}")) is not None
        ]
        + ([KeyNumber(ratio, "estimate over true error")] if ratio else []),
        paragraphs=[
            "A basis of fixed vectors has to carry the kink under the slider wherever it goes; even the full model's "
            "own motion, decomposed afterwards, takes twenty vectors for that. Modes with the flexibility of those "
            "left out have it as a small table in the slider's position.",
            "The estimate needs no full model: it is made of the model's own four enrichment modes and "
            "attachment modes for its loads, and contains a margin of a quarter.",
        ],
        blocks=[
            Block(
                "Error over the number of coordinates",
                ((drawing(f"{prefix}-errors", errors, over_r, study),),),
                grids=(_errors(study, few), _ratios(study, sizes)),
            ),
            Block("Error over time", ((drawing(f"{prefix}-time", over_seconds, over_time, study),),)),
        ],
    )


def errors(study: FinishedStudy) -> Figure:
    """A panel a scene."""
    scenes = study.scenes
    rows = -(-len(scenes) // COLUMNS)
    gaps = {"wspace": 0.05, "hspace": 0.3}
    figure, axes = sheet(
        WIDE,
        0.7 + 1.45 * rows,
        rows=rows,
        columns=COLUMNS,
        margins={"top": 0.7},
        sharex=True,
        sharey=True,
        gridspec_kw=gaps,
    )
    every = [_curve(ax, study, scene) for ax, scene in zip(axes.flat, scenes, strict=False)]
    for ax in axes.flat[len(scenes) :]:
        ax.set_visible(False)
    found = np.concatenate([np.array(values) for values in every if values])
    log_axis(axes[0, 0], float(found.min()), 1.0)
    for ax in axes[:, 0]:
        ax.set_ylabel("e_NRMS (–)")
    for ax in axes[-1]:
        ax.set_xlabel("Number of coordinates (–)")
    _legend(figure)
    return figure


def over_seconds(study: FinishedStudy) -> Figure:
    """Error over the seconds of the march, one scene."""
    scene = study.scenes[min(1, len(study.scenes) - 1)]
    figure, axes = sheet(WIDE, 2.8, margins={"top": 0.5})
    ax, every = axes[0, 0], []
    for i, basis in enumerate(NAMES):
        for run in study.runs(scene=scene, basis=basis):
            shown = [(run.seconds[f"simulate.{r}"], e) for r, e in _known(study, run) if f"simulate.{r}" in run.seconds]
            if shown:
                x, y = np.array(shown).T
                ax.plot(1e3 * x, y, **dots(i, 2.2))
                every += shown
    seconds, found = np.array(every).T
    log_x(ax, 0.9e3 * float(seconds.min()), 1.1e3 * float(seconds.max()))
    log_axis(ax, float(found.min()), float(found.max()))
    ax.set_xlabel("Time of the whole simulation in ms")
    ax.set_ylabel("e_NRMS (–)")
    _legend(figure)
    return figure


def _gain(study: FinishedStudy, few: int) -> str:
    """How much the flexibility of the modes left out is worth."""
    gains = {}
    for scene in study.scenes:
        plain, flexible = (study.figures.get(f"{scene}.{basis}.{few}") for basis in ("modes", "flexibility"))
        if plain and flexible:
            gains[scene] = number(plain) / number(flexible)
    if not gains:
        return "Free modes with the flexibility of those left out, beside other bases."
    least, most = min(gains, key=lambda scene: gains[scene]), max(gains.values())
    return (
        f"The flexibility of the modes left out makes {few} free modes {significant(gains[least], 2)} to "
        f"{significant(most, 2)} times more accurate, least in the scene {least.replace('_', ' ')}."
    )


def _curve(ax: Axes, study: FinishedStudy, scene: str) -> list[float]:
    every = []
    for i, basis in enumerate(NAMES):
        for run in study.runs(scene=scene, basis=basis):
            if shown := _known(study, run):
                ax.plot(*np.array(shown).T, **dots(i, 2.2))
                every += [error for _, error in shown]
    ax.set_title(scene.replace("_", " "), loc="left", pad=3.0)
    return every


def _known(study: FinishedStudy, run: RunRecord) -> list[tuple[int, float]]:
    """Coordinates and errors that are neither missing nor round-off."""
    smallest = float(study.asked["round_off"])
    found = [(int(name.removeprefix("beam.")), e) for name, e in run.figures.items() if name.startswith("beam.")]
    return [(r, number(error)) for r, error in found if error is not None and number(error) > smallest]


def _errors(study: FinishedStudy, few: int) -> Grid:
    rows = []
    for scene in study.scenes:
        found = (study.figures.get(f"{scene}.{basis}.{few}") for basis in NAMES)
        rows.append((scene.replace("_", " "), *("–" if e is None else percent(number(e)) for e in found)))
    return Grid(f"Error along the beam with {few} coordinates.", ("scene", *NAMES.values()), tuple(rows))


def _ratios(study: FinishedStudy, sizes: list[int]) -> Grid:
    rows = []
    for scene in study.scenes:
        for basis in ESTIMATED:
            for run in study.runs(scene=scene, basis=basis):
                known = dict(_known(study, run))
                said = [run.figures.get(f"estimate.{r}") if r in known else None for r in sizes]
                ratios = (
                    "–" if e is None else significant(number(e) / known[r], 3) for r, e in zip(sizes, said, strict=True)
                )
                rows.append((f"{scene.replace('_', ' ')}, {NAMES[basis]}", *ratios))
    caption = "Estimate over true error, by the number of coordinates."
    return Grid(caption, ("scene", *(f"{r}" for r in sizes)), tuple(rows))


def _legend(figure: Figure) -> None:
    """Two rows, filled row by row."""
    handles = [Line2D([], [], label=label, **dots(i, 2.2)) for i, label in enumerate(NAMES.values())]
    by_column = [one for column in range(3) for one in handles[column::3]]
    figure.legend(handles=by_column, loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=3, borderaxespad=0.25)
