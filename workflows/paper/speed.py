"""Computational speed: the paper's way in Exudyn, per-step updates in Exudyn, and the compiled simulator.

Weyrer et al., section "Computational Speed". Only the solver is timed, several times; nothing else runs beside. The
paper's way with all coordinates takes minutes: of such approaches a `share` of the time span is simulated, in
stretches that are spread over it, each from rest, and times are extrapolated. ``--set "share={}"`` simulates the whole
span.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from experiment import Findings, Row, Settings, full_body, rows, run, save
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from published import speed

import pmr
from pmr.compare.outputs import run_from_start
from pmr.compare.responses import simulate_cable
from pmr.report.blocks import Block, Chapter, Grid, KeyNumber
from pmr.report.figures import INK, MUTED, WIDE, add_legend, drawing, log_x, make_sheet
from pmr.report.numbers import SPACE, format_input, format_percent, format_quantity, significant
from pmr.scene.signals import SignalBase
from pmr.simulation import Excitation
from pmr.simulation.exudyn import simulate_system
from pmr.simulation.exudyn.simulator import Formulation
from pmr.system.body import FullBody

SETTINGS = {
    "scenes": ["paper_simple", "paper_evolved"],
    "repeats": 5,
    "share": {"full-callbacks": 0.02, "full-callbacks-modified": 0.1, "reduced-callbacks": 0.2},
}
#: What is simulated, Exudyn's formulation or None for the compiled simulator, and words. ``callbacks`` is the paper's
#: way: dense matrices, rows and loads asked for in every iteration. Whether it reuses a Jacobian (modified Newton) it
#: does not say; the ratios that it states are close to those of one that does.
APPROACHES: dict[str, tuple[str, Formulation | None, str]] = {
    "ancf": ("ancf", None, "ANCF cable"),
    "full-callbacks-modified": ("dense", "callbacks-modified-newton", "full, callbacks, Jacobian reused"),
    "full-callbacks": ("dense", "callbacks", "full, callbacks"),
    "full-updates": ("full", "springs", "full, updates"),
    "full-march": ("full", None, "full, compiled"),
    "reduced-callbacks-modified": ("reduced", "callbacks-modified-newton", "reduced, callbacks, Jacobian reused"),
    "reduced-callbacks": ("reduced", "callbacks", "reduced, callbacks"),
    "reduced-updates": ("reduced", "springs", "reduced, updates"),
    "reduced-march": ("reduced", None, "reduced, compiled"),
}
PUBLISHED = [name for name in APPROACHES if name == "ancf" or "callbacks" in name]
#: Pairs whose times the paper compares, and those that say what the other ways gain.
RATIOS = {
    "full_over_ancf": ("full-callbacks-modified", "ancf"),
    "reduced_over_full": ("reduced-callbacks-modified", "full-callbacks-modified"),
    "reduced_over_ancf": ("reduced-callbacks-modified", "ancf"),
    "updates_over_callbacks": ("reduced-updates", "reduced-callbacks"),
    "callbacks_over_march.full": ("full-callbacks", "full-march"),
    "callbacks_over_march.reduced": ("reduced-callbacks", "reduced-march"),
    "modified_over_march.full": ("full-callbacks-modified", "full-march"),
    "modified_over_march.reduced": ("reduced-callbacks-modified", "reduced-march"),
    "updates_over_march.full": ("full-updates", "full-march"),
}
KEY_RATIOS = {
    "callbacks_over_march.reduced": "compiled against callbacks, reduced",
    "modified_over_march.reduced": "compiled against callbacks with a Jacobian that is reused, reduced",
}
#: Stretches over which a share of the time span is spread.
STRETCHES = 8
#: Of an ANCF node: position and slope vector, and the last node's share.
PER_NODE = 4
PAPER, OURS = "#d55e00", "#0072b2"


class Later(SignalBase):
    """A signal whose value at the time t is that of another `signal` at t + `begin`, in s."""

    signal: SignalBase
    begin: float

    def value(self, t: Any) -> Any:
        """Return the value of the other signal at t + `begin`."""
        return self.signal.value(np.asarray(t) + self.begin)

    def rate(self, t: Any) -> Any:
        """Return the rate of the other signal at t + `begin`."""
        return self.signal.rate(np.asarray(t) + self.begin)


def row(scene: str, approach: str, repeats: int, share: float) -> Row:
    """Return ``seconds`` (repeats,) that the solver takes for the whole time span, ``coordinates`` and ``share``.

    If only a `share` of the time span is simulated, seconds are extrapolated. A run of ten steps comes first and is not
    counted: it loads and compiles.
    """
    model, formulation, _ = APPROACHES[approach]
    loaded = pmr.load_scene(scene)
    if loaded.reduction.flexibility or loaded.body.profile is None or loaded.body.profile.axial_stiffness is None:
        allowed = "scenes without residual flexibility and with body.profile.axial_stiffness are allowed"
        raise pmr.InputError("speed", "scenes", scene, f"{allowed}, for callbacks and ANCF")
    if model == "reduced":
        body: pmr.ReducedModel | FullBody = pmr.reduce(loaded).reduced
    elif model in ("full", "dense"):
        full = full_body(loaded)
        body = pmr.project(full, np.eye(full.size)) if model == "dense" else full
    whole, steps = Excitation.from_scene(loaded), loaded.time.steps

    def seconds(begin: float, count: int) -> float:
        """Return the solver's seconds for `count` steps from the time `begin` in s on."""
        paths, loads = (
            {name: Later(signal=signal, begin=begin) for name, signal in signals.items()}
            for signals in (whole.paths, whole.loads)
        )
        part = Excitation(paths, loads, replace(whole.stepping, end=count * loaded.time.step))
        if model == "ancf":
            return simulate_cable(loaded, [loaded.only_section.length], part).seconds
        system = pmr.System.of(body)
        if formulation is None:
            return run_from_start(system, part).seconds
        return simulate_system(system, part, formulation=formulation).seconds

    stretches = [(0.0, steps)]
    if share < 1.0:
        each, part = max(1, round(share * steps / STRETCHES)), loaded.time.end / STRETCHES
        stretches = [((k + 0.5) * part - 0.5 * each * loaded.time.step, each) for k in range(STRETCHES)]
    seconds(0.0, min(10, steps))
    scale = steps / sum(count for _, count in stretches)
    measured = [scale * sum(seconds(*stretch) for stretch in stretches) for _ in range(repeats)]
    size = PER_NODE * (loaded.compare.ancf_elements + 1) if model == "ancf" else body.size
    return {"seconds": np.array(measured), "coordinates": size, "share": share}


def main(settings: Settings, out: Path, jobs: int) -> Chapter:
    """Measure all approaches one after the other, save the times, and return the chapter of the report."""
    unknown = sorted(set(settings["share"]) - set(APPROACHES))
    if unknown:
        allowed = f"one of {', '.join(APPROACHES)} is allowed"
        raise pmr.InputError("speed", f"share.{unknown[0]}", settings["share"][unknown[0]], allowed)
    asked = [(scene, approach) for scene in settings["scenes"] for approach in APPROACHES]
    parameters = [
        {"scene": scene, "approach": name, "repeats": settings["repeats"], "share": settings["share"].get(name, 1.0)}
        for scene, name in asked
    ]
    found = rows(row, parameters, out, jobs=1)  # nothing runs beside a measurement
    results = {(Path(scene).stem, name): one for (scene, name), one in zip(asked, found, strict=True)}
    scenes = list(dict.fromkeys(scene for scene, _ in results))
    span = max(pmr.load_scene(scene).time.end for scene in settings["scenes"])
    median = {pair: float(np.median(one["seconds"])) for pair, one in results.items()}
    figures = {"span": span} | {f"{scene}.seconds.{name}": value for (scene, name), value in median.items()}
    figures |= {
        f"{scene}.{ratio}": median[scene, first] / median[scene, second]
        for scene in scenes
        for ratio, (first, second) in RATIOS.items()
    }
    save(out, figures=figures, seconds={f"{scene}-{name}": one["seconds"] for (scene, name), one in results.items()})
    return chapter(results, scenes, settings["repeats"], Findings(figures, *speed(scenes)))


def chapter(results: dict[tuple[str, str], Row], scenes: list[str], repeats: int, findings: Findings) -> Chapter:
    """Return the chapter of the report on these rows, by scene and approach."""
    figures, span = findings.figures, findings.figures["span"]
    parts = {name: one["share"] for (_, name), one in results.items() if one["share"] < 1.0}
    said = ", ".join(f"{APPROACHES[name][2]}: {format_percent(share)}" for name, share in parts.items())
    extrapolated = f" Extrapolated from stretches spread over the time span: {said} of it." if parts else ""
    caption = (
        f"Solver time for {format_input(span, 's')} of motion, {repeats} repeats and their median. Orange: "
        f"the paper's three approaches in Exudyn; blue: other ways to the same trajectories. "
        f"Dashed: real time.{extrapolated}"
    )
    words = {scene: f"{scene.removeprefix('paper_')} case" for scene in scenes}
    slowest = max(figures[f"{scene}.seconds.reduced-march"] for scene in scenes)
    return Chapter(
        anchor="speed",
        title="Computational speed",
        headline=f"The compiled simulator needs {format_quantity(slowest, 's', 2)} for {format_input(span, 's')} "
        "of the reduced model.",
        key_numbers=[
            KeyNumber(f"{significant(figures[f'{scene}.{ratio}'], 2)}{SPACE}×", f"{text}, {words[scene]}")
            for scene in scenes
            for ratio, text in KEY_RATIOS.items()
        ],
        paragraphs=[
            "Callbacks are the paper's way: dense matrices, and Python called for rows, their Jacobian and loads in "
            "every iteration. Rows and loads are looked up there, not evaluated, which favours it. The paper does not "
            "say whether it takes a new Jacobian in each iteration or reuses it as long as Newton's method converges "
            "(modified Newton); both are timed. Updates set rows and loads once a step. The compiled simulator takes "
            "the modes of the beam's matrices as coordinates, once, and steps from there.",
            "Nothing else runs beside a measurement; loading and compiling are not measured.",
        ],
        blocks=[
            Block(
                "Solver time",
                (drawing("speed-seconds", draw_seconds, caption, results, scenes, span),),
                grids=tuple(_grid(results, scene, words[scene], span) for scene in scenes),
            ),
            *findings.blocks(),
        ],
    )


def _grid(results: dict[tuple[str, str], Row], scene: str, words: str, span: float) -> Grid:
    """Return the table of the solver's times in one scene, whose time span is `span` in s; `words` are its title."""
    lines = []
    for name, (_, _, text) in APPROACHES.items():
        one = results[scene, name]
        median, least = float(np.median(one["seconds"])), float(one["seconds"].min())
        real = f"{significant(span / median, 2)}{SPACE}×"
        lines.append(
            (text, format_input(one["coordinates"]), format_quantity(median, "s"), format_quantity(least, "s"), real)
        )
    head = ("approach", "coordinates", "median", "least", "against real time")
    return Grid(f"{words.capitalize()}: solver time for the whole time span.", head, tuple(lines))


def draw_seconds(results: dict[tuple[str, str], Row], scenes: list[str], span: float) -> Figure:
    """Draw repeats and medians of the solver's times on a logarithmic axis, one panel for each scene."""
    margins, places = {"left": 1.75, "top": 0.45}, {name: -n for n, name in enumerate(APPROACHES)}
    figure, axes = make_sheet(
        WIDE, 3.1, columns=len(scenes), margins=margins, sharey=True, gridspec_kw={"wspace": 0.08}
    )
    every = np.concatenate([one["seconds"] for one in results.values()])
    for ax, scene in zip(axes[0], scenes, strict=True):
        for name, place in places.items():
            seconds, colour = results[scene, name]["seconds"], PAPER if name in PUBLISHED else OURS
            look = {"linestyle": "none", "marker": "o", "markersize": 2.6, "alpha": 0.6}
            ax.plot(seconds, np.full(len(seconds), place), color=colour, **look)
            ax.plot([np.median(seconds)] * 2, [place - 0.28, place + 0.28], color=colour, linewidth=1.6)
        ax.axvline(span, color=INK, linewidth=0.8, linestyle=(0, (4, 2)))
        log_x(ax, float(every.min()) / 2.0, 2.0 * max(float(every.max()), span))
        ax.set_yticks(list(places.values()), [APPROACHES[name][2] for name in places])
        ax.set_ylim(0.6 - len(places), 0.6)
        ax.set_title(scene.replace("paper_", ""), loc="left", pad=3.0)
        ax.set_xlabel("Solver time in s")
    dot: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 3.0}
    handles = [
        Line2D([], [], label="the paper's way", color=PAPER, **dot),
        Line2D([], [], label="other ways, same trajectory", color=OURS, **dot),
        Line2D([], [], label="median", color=MUTED, linewidth=1.6),
        Line2D([], [], label="real time", color=INK, linewidth=0.8, linestyle=(0, (4, 2))),
    ]
    add_legend(figure, handles)
    return figure


if __name__ == "__main__":
    run(main, SETTINGS, __doc__)
