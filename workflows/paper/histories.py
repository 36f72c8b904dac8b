"""Histories: tip displacement and energy of the reduced beam, the full one and the ANCF cable, and their differences.

Weyrer et al., sections "Tip Displacement, Energy, and Accuracy" and "Accuracy". Each scene is reduced as its file says,
and once more on the same basis with the pin's rows dropped.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from experiment import Findings, Row, Settings, rows, run, save
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from published import histories

import pmr
from pmr.compare.errors import nrms
from pmr.report.blocks import Block, Chapter, Grid, KeyNumber
from pmr.report.figures import SHADE, WIDE, add_legend, curve_style, drawing, make_sheet
from pmr.report.numbers import format_length, format_percent

SETTINGS = {"scenes": ["paper_simple", "paper_evolved"]}
SIMULATORS = ("full", "ancf", "reduced")
PAIRS = ("reduced_vs_full", "full_vs_ancf", "reduced_vs_ancf")
MARCHED = [
    "simulation.simulators=['march']",
    "simulation.repeats=1",
    "simulation.full='march'",
    "compare.richer='none'",
]


def row(scene: str) -> Row:
    """Return errors between the three models, as in summary.json of the scene's run, and their histories.

    ``<model>.tip_history`` (T,) in m and ``<model>.energy`` (T,) in J at the times ``t`` (T,) in s; slider position
    ``s`` (T,) in m, ``moving`` (T,), the sum of the loads ``load`` (T,); ``dropped.<error>`` of the model without the
    pin's rows.
    """
    loaded = pmr.load_scene(scene, MARCHED)
    outcome = pmr.run(loaded)
    assert outcome is not None  # as on the first rank
    summary, responses = outcome.result.summary, outcome.result.responses
    result: Row = {"coordinates.full": summary["coordinates"]["full"]}
    result |= {"coordinates.reduced": summary["coordinates"]["reduced"], "basis.kappa": summary["basis"]["kappa"]}
    for kind in ("errors", "absolute_errors"):
        for pair, places in summary[kind].items():
            result |= {f"{kind}.{pair}.{place}": error for place, error in places.items() if error is not None}
    result |= {name: summary[name] for name in ("max_displacement", "max_error")}
    dropping = pmr.load_scene(scene, [*MARCHED, "reduction.basis='eigenmodes'"])
    dropped, full = pmr.simulate(dropping, pmr.reduce(dropping).reduced), responses["full"]
    result["dropped.tip"] = nrms(dropped.tip, full.tip)
    result["dropped.beam"] = nrms(dropped.displacement, full.displacement)
    result["dropped.max_error"] = float(np.abs(dropped.displacement - full.displacement).max())
    for name in SIMULATORS:
        result |= {f"{name}.tip_history": responses[name].tip, f"{name}.energy": responses[name].energy.total}
    t = full.t
    loads = [np.broadcast_to(load.signal.value(t), t.shape) for load in loaded.only_section.loads]
    path = loaded.slider.path
    return result | {"t": t, "s": path.value(t), "moving": np.abs(path.rate(t)) > 0.0, "load": np.sum(loads, axis=0)}


def main(settings: Settings, out: Path, jobs: int) -> Chapter:
    """Run all scenes, save their numbers, and return the chapter of the report."""
    scenes = settings["scenes"]
    results = dict(zip(scenes, rows(row, [{"scene": scene} for scene in scenes], out, jobs), strict=True))
    figures = {
        f"{Path(scene).stem}.{name}": value
        for scene, result in results.items()
        for name, value in result.items()
        if isinstance(value, float | int)
    }
    save(out, figures=figures)
    return chapter(results, Findings(figures, *histories(scenes)))


def chapter(results: dict[str, Row], findings: Findings) -> Chapter:
    """Return the chapter of the report on these rows, by scene."""
    names = {scene: f"{Path(scene).stem.removeprefix('paper_')} case" for scene in results}
    worst, dropped = (
        max(result[key] for result in results.values()) for key in ("errors.reduced_vs_full.beam", "dropped.beam")
    )
    caption = (
        "Slider position and load (top), transverse displacement of the tip (middle) and total energy (bottom) over "
        "time. Grey: the slider moves."
    )
    without = Grid(
        "The same basis with the pin's rows dropped, against the full beam: all coordinates move.",
        ("case", "tip", "beam", "largest difference"),
        tuple(
            (
                names[scene],
                format_percent(r["dropped.tip"]),
                format_percent(r["dropped.beam"]),
                format_length(r["dropped.max_error"]),
            )
            for scene, r in results.items()
        ),
    )
    between = Grid(
        "Normalised RMS errors between the models, tip / beam.",
        ("case", *(pair.replace("_vs_", " against ") for pair in PAIRS)),
        tuple(
            (
                names[scene],
                *(
                    " / ".join(format_percent(r[f"errors.{pair}.{place}"]) for place in ("tip", "beam"))
                    for pair in PAIRS
                ),
            )
            for scene, r in results.items()
        ),
    )
    return Chapter(
        anchor="histories",
        title="Tip displacement, energy and accuracy",
        headline=f"The reduced model is within {format_percent(worst)} of the full one; without the pin's rows within "
        f"{format_percent(dropped)}.",
        key_numbers=[
            KeyNumber(format_percent(r["errors.reduced_vs_full.beam"]), f"error along the beam, {names[scene]}")
            for scene, r in results.items()
        ],
        paragraphs=[
            "All models are simulated over the whole time span: the reduced and the full one by the compiled "
            "simulator, the ANCF cable with its sliding joint by Exudyn."
        ],
        blocks=[
            *(
                Block(names[scene].capitalize(), (drawing(f"histories-{n}", draw_histories, caption, result),))
                for n, (scene, result) in enumerate(results.items())
            ),
            Block("Errors", grids=(between, without)),
            *findings.blocks(),
        ],
    )


def draw_histories(result: Row) -> Figure:
    """Draw slider position, load, tip displacement and energy of one scene over time."""
    figure, axes = make_sheet(WIDE, 4.8, rows=4, sharex=True, gridspec_kw={"hspace": 0.18}, margins={"top": 0.35})
    t = result["t"]
    panels = [("Slider in m", {"": result["s"]}), ("Load in N", {"": result["load"]})]
    panels.append(("Tip in mm", {name: 1e3 * result[f"{name}.tip_history"] for name in SIMULATORS}))
    panels.append(("Energy in J", {name: result[f"{name}.energy"] for name in SIMULATORS}))
    for ax, (label, curves) in zip(axes[:, 0], panels, strict=True):
        ax.fill_between(
            t, 0.0, 1.0, where=result["moving"], transform=ax.get_xaxis_transform(), color=SHADE, linewidth=0.0
        )
        for number, curve in enumerate(curves.values()):
            ax.plot(t, curve, color=curve_style(number)["color"], linewidth=0.8)
        ax.set_ylabel(label)
    axes[-1, 0].set_xlabel("Time in s")
    labels = {"full": "full", "ancf": "ANCF", "reduced": "reduced"}
    add_legend(
        figure, [Line2D([], [], label=labels[name], color=curve_style(n)["color"]) for n, name in enumerate(SIMULATORS)]
    )
    return figure


if __name__ == "__main__":
    run(main, SETTINGS, __doc__)
