"""Convergence with the mesh: the full beam and the ANCF cable with more and more elements.

Weyrer et al., section "Convergence Analysis": the absolute error e_abs in m of the transverse tip displacement is the
norm, over all steps, of the difference between this displacement and the displacement on the finest mesh of the same
approach. The scene may be a boom; it then has each number of elements in every section, and no cable (``ancf=[]``).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from experiment import Findings, Row, Settings, rows, run, save, warnings_of_response
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from published import CONVERGENCE

import pmr
from pmr.compare.errors import absolute_error, relative_error
from pmr.compare.responses import march_once, simulate_cable
from pmr.report.blocks import Block, Chapter, KeyNumber, Notices
from pmr.report.figures import WIDE, add_legend, curve_style, drawing, log_axis, log_x, make_sheet
from pmr.report.numbers import format_length
from pmr.scene import Scene
from pmr.scene.hints import hints
from pmr.simulation import Excitation
from pmr.studies.tasks import full_system

SETTINGS = {"scene": "paper_evolved", "ancf": list(range(2, 45, 2)), "full": list(range(2, 61, 2))}
APPROACHES = {"ancf": "ANCF cable", "full": "full model"}


def row(scene: str, approach: str, elements: int) -> Row:
    """Return ``tip`` in m, the number of ``coordinates`` and ``warnings`` of a beam or boom with some `elements`.

    ``tip`` is the transverse displacement (T,) of a single beam, or all d directions (T, d) of a boom's tip.
    """
    of_mesh, compare = {"mesh": {"elements": elements}}, {"ancf_elements": elements}
    loaded = pmr.load_scene(scene).vary_sections(lambda part: of_mesh, compare=compare)
    whole, alone = Excitation.from_scene(loaded), len(loaded.sections) == 1
    if approach == "ancf":
        motion = simulate_cable(loaded, [loaded.only_section.length], whole)
        size = 4 * (elements + 1)  # a node has its position and its slope, two coordinates each
        return {"tip": motion.displacement[:, -1], "coordinates": size, "warnings": list(hints(loaded))}
    system = full_system(loaded)
    response = march_once(loaded, system, whole)
    tip, size = response.of("tip", body=loaded.names[-1]), sum(body.size for body in system.bodies.values())
    lines = warnings_of_response(loaded, system, response)
    return {"tip": tip[:, -1] if alone else tip, "coordinates": size, "warnings": lines}


def check(settings: Settings) -> Scene:
    """Return the scene of the settings; InputError for numbers of elements or a scene that can't be compared."""
    scene = pmr.load_scene(settings["scene"])
    for key in ("full", "ancf"):
        elements = settings[key]
        if elements != sorted(set(elements)) or len(elements) == 1 or (key == "full" and not elements):
            raise pmr.InputError("convergence", key, elements, "two or more numbers that increase are allowed")
    profile, meshed = scene.sections[0].body.profile, any(part.mesh.file is not None for part in scene.sections)
    second_order = len(scene.sections) == 1 and scene.frame is not None and scene.frame.second_order
    if second_order or meshed or (settings["ancf"] and (profile is None or profile.axial_stiffness is None)):
        allowed = "a scene with mesh.elements and without second order is allowed, for cables with axial_stiffness"
        raise pmr.InputError("convergence", "scene", settings["scene"], allowed)
    if settings["ancf"] and len(scene.sections) > 1:
        raise pmr.InputError("convergence", "ancf", settings["ancf"], "[] is allowed: a cable is a single beam")
    return scene


def main(settings: Settings, out: Path, jobs: int) -> Chapter:
    """Compute all meshes, save the errors, and return the chapter of the report."""
    scene = check(settings)
    meshes = [(approach, count) for approach in APPROACHES for count in settings[approach]]
    parameters = [{"scene": settings["scene"], "approach": name, "elements": count} for name, count in meshes]
    results = dict(zip(meshes, rows(row, parameters, out, jobs), strict=True))
    counts = {body.mesh.elements for body in scene.bodies.values()}
    chosen = {"ancf": scene.compare.ancf_elements, "full": counts.pop() if len(counts) == 1 else None}
    figures = {}
    for approach in APPROACHES:
        if not settings[approach]:
            continue
        *coarser, last = settings[approach]
        finest = results[approach, last]["tip"]
        for count in coarser:
            tip = results[approach, count]["tip"]
            results[approach, count] |= {"e_abs": absolute_error(tip, finest), "e_nrms": relative_error(tip, finest)}
        figures[f"chosen.{approach}"] = results.get((approach, chosen[approach]), {}).get("e_abs")
        figures[f"least.{approach}"] = min(results[approach, count]["e_abs"] for count in coarser)
    shown = ("coordinates", "e_abs", "e_nrms")
    save(out, figures=figures, rows={f"{a}-{n}": {key: r.get(key) for key in shown} for (a, n), r in results.items()})
    return chapter(results, Findings(figures, *CONVERGENCE))


def chapter(results: dict[tuple[str, int], Row], findings: Findings) -> Chapter:
    """Return the chapter of the report on these rows, by approach and number of elements."""
    figures, finest = findings.figures, {approach: count for approach, count in results}  # the last is the finest
    caption = (
        "Absolute error of the tip displacement, the norm over all steps of its difference to the finest beam of the "
        "same approach, over the number of coordinates. Filled: as many elements as the scene asks for."
    )
    compared = [
        f"{sum(approach == name for approach, _ in results)} of the {APPROACHES[name]} with up to {count} elements"
        for name, count in finest.items()
    ]
    reached = [f"the {APPROACHES[name]} to {format_length(figures[f'least.{name}'])}" for name in finest]
    return Chapter(
        anchor="convergence",
        title="Convergence analysis",
        headline=f"Meshes converge: {', '.join(reached)}.",
        key_numbers=[
            KeyNumber(format_length(figures[f"chosen.{name}"]), f"{APPROACHES[name]}, as many elements as asked for")
            for name in finest
            if figures[f"chosen.{name}"] is not None
        ],
        paragraphs=[f"{' and '.join(compared)} are compared with the finest of their kind."],
        notices=Notices(
            warnings=list(dict.fromkeys(str(line) for one in results.values() for line in one["warnings"]))
        ),
        blocks=[
            Block(
                "Error over the number of coordinates",
                (drawing("convergence-errors", draw_errors, caption, results, figures),),
            ),
            *findings.blocks(),
        ],
    )


def draw_errors(results: dict[tuple[str, int], Row], figures: dict[str, float]) -> Figure:
    """Draw the absolute error of the tip over the number of coordinates, both on logarithmic axes."""
    figure, axes = make_sheet(WIDE, 2.9)
    ax, handles, every = axes[0, 0], [], []
    for name, number in (("ancf", 2), ("full", 0)):
        points = [(one["coordinates"], one["e_abs"]) for (a, _), one in results.items() if a == name and "e_abs" in one]
        if not points:
            continue
        look = curve_style(number, 3.2)
        ax.plot(*np.array(points).T, **look)
        for x, error in points:
            if error == figures[f"chosen.{name}"]:
                ax.plot([x], [error], **{**look, "markerfacecolor": look["color"], "markersize": 5.0})
        handles.append(Line2D([], [], label=APPROACHES[name], **look))
        every += points
    x, errors = np.array(every).T
    log_x(ax, 0.9 * float(x.min()), 1.1 * float(x.max()))
    log_axis(ax, float(errors.min()), float(errors.max()))
    ax.set_xlabel("Number of coordinates (–)")
    ax.set_ylabel("Absolute error of the tip in m")
    add_legend(figure, handles)
    return figure


if __name__ == "__main__":
    run(main, SETTINGS, __doc__)
