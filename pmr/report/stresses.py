"""Blocks about von Mises stresses, forces along beams, and measurements of probes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from pmr.files.arrays import Summary
from pmr.report import sentences
from pmr.report.blocks import Block, Drawing, Grid
from pmr.report.figures import drawing, histories, shapes
from pmr.report.numbers import NOTHING, SPACE, format_time, significant, unit_for
from pmr.report.sentences import Measured, extremes_grid
from pmr.results import Response, RunResult
from pmr.results.quantities import stress_remark
from pmr.results.response import Extremes
from pmr.results.tables import WHOLE, probe_extremes, stress_by_part, summaries_by_section
from pmr.scene.keys import ALONE, qualified_name


def stress_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block with the largest stress of each body over time, and tables of its times and places.

    It is None if the run has no stresses.  `prefix` begins the identifiers of the figures.
    """
    drawings, parts = [], {part["name"]: part for part in result.summary.get("sections", ())}
    for number, (name, body) in enumerate(result.bodies.items()):
        if "reduced" not in body.peak_stress:
            continue
        below = histories.Timeline(result).difference_clause(histories.stress_histories(result, body))
        peak = parts.get(name, result.summary).get("stress_peak", {}).get("reduced")
        dot = f" The dot is the largest of all, {sentences.peak_clause(peak)}." if peak else ""
        caption = f"Largest von Mises stress over {name or 'the whole body'}{below}.{dot}"
        anchor = f"{prefix}-stress" if name == ALONE else f"{prefix}-stress-{number}"
        drawings.append(drawing(anchor, histories.stress_figure, caption, result, body))
    grids = tuple(_part_grids(result))
    heading = " ".join(filter(None, ("Stress", stress_remark(result.scene))))
    return Block(heading=heading, drawings=drawings, grids=grids) if drawings or grids else None


def section_force_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block on forces and moments of beams' cross-sections: envelopes over time and a table of extremes.

    It is None if no beam has such forces.  `prefix` begins the identifiers of the figures.
    """
    largest = dict[str, float]()
    for part in summaries_by_section(result.summary).values():
        for what, force in part.get("section_forces", {}).get("reduced", {}).items():
            if force["unit"] != "Pa":
                largest[what] = max(largest.get(what, 0.0), -force["min"], force["max"])
    shown = [what for what, value in largest.items() if value > NOTHING * max(largest.values())]
    if not shown:
        return None
    caption = "Forces and moments of sections along each beam, from the smallest to the largest over time."
    drawn = drawing(f"{prefix}-envelopes", shapes.envelope_figure, caption, result, shown)
    measured = [
        Measured(qualified_name(name, what), force["unit"], Extremes.from_summary(force, "x_"))
        for name, part in summaries_by_section(result.summary).items()
        for what, force in part.get("section_forces", {}).get("reduced", {}).items()
        if what in shown and (force["min"] or force["max"])
    ]
    grid = extremes_grid(result, "Least and largest of them", measured, where=", and where from the tail")
    return Block(heading="Forces along beams", drawings=(drawn,), grids=(grid,))


def _part_grids(result: RunResult) -> Iterator[Grid]:
    """Yield a table with the largest stress of each part of each body in each model.

    Nothing is yielded for a single part in a single model.
    """
    peaks = stress_by_part(result.summary)
    if len(peaks.get("reduced", {})) < (1 if "full" in peaks else 2):
        return
    unit = unit_for(max(peak["value"] for peak in peaks["reduced"].values()), "Pa")
    full, rows = peaks.get("full", {}), []
    for name, peak in peaks["reduced"].items():
        place = ", ".join(significant(x, 3) for x in peak["position"])
        of_full_model = (significant(full[name]["value"] / unit.size, 4),) if full else ()
        value = significant(peak["value"] / unit.size, 4)
        called = name.removesuffix(f": {WHOLE}")
        rows.append((called, value, *of_full_model, format_time(peak["t"]), f"({place})", peak["face"]))
    head = ("", f"in {unit.name}", *(("full model",) if full else ()), "at", "and x, y, z in m", "face")
    yield Grid("Largest von Mises stress of each part.", head, tuple(rows))


#: Largest number of quantities of probes that are drawn and whose load cycles are counted; others are in tables only.
MOST_DRAWN = 4
#: A measurement of a probe is round-off up to this share of the largest measurement with the same unit.
UNSEEN = 1e-5


def probe_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block on probes: histories, extremes, load cycles of stresses and strains, and damage.

    It is None if the scene has no probes.  `prefix` begins the identifiers of the figures.
    """
    probes = {probe["name"]: probe for probe in result.summary.get("probes", ())}
    response = result.responses["reduced"]
    measured = [
        Measured(name, {"1": "strain"}.get(unit := probes[name]["unit"], unit), extremes)
        for name, extremes in probe_extremes(response, result.abscissa_at(response.t)).items()
        if name in probes
    ]
    if not measured:
        return None
    largest = dict[str, float]()
    for _, unit, extremes in measured:
        largest[unit] = max(largest.get(unit, 0.0), extremes.size)
    measured = [of for of in measured if of.extremes.size > UNSEEN * largest[of.unit]]
    grid = extremes_grid(result, f"Least and largest values of {_places_of(probes.values())}", measured)
    figures = [
        _history_drawing(result, f"{prefix}-probe-{k}", of.name, of.unit)
        for k, of in enumerate(_drawn_measurements(measured))
    ]
    text = "All load cycles, counted by rainflow, stand in tables/cycles.csv."
    return Block("Probes", figures, text=text, grids=(grid, *_damage_grids(result)))


def _damage_grids(result: RunResult) -> list[Grid]:
    """List with one table of the damage by each stress; empty if the scene has no S-N line."""
    fatigue = result.summary.get("fatigue")
    if not fatigue:
        return []
    rows = [(row["name"], _format_cycles(row["damage"]), _format_cycles(row["life"])) for row in fatigue]
    caption = "Damage by load cycles on the scene's S-N line, after Palmgren and Miner: 1 is failure. The life is how "
    return [Grid(f"{caption}often all that is asked for may come.", ("", "damage", "life"), tuple(rows))]


def _format_cycles(value: float | None) -> str:
    """Format the number of cycles `value`; None, which stands for a life without damage, is ``without end``."""
    return "without end" if value is None else significant(value)


def _drawn_measurements(measured: Sequence[Measured]) -> list[Measured]:
    """Choose the measurements to be drawn: of each of the first `MOST_DRAWN` quantities, the largest component."""
    groups = dict[str, list[Measured]]()
    for of in measured:
        groups.setdefault(of.name.rpartition(" ")[0], []).append(of)
    return [max(group, key=lambda of: of.extremes.size) for group in groups.values()][:MOST_DRAWN]


def _history_drawing(result: RunResult, anchor: str, name: str, unit: str) -> Drawing:
    """Draw the measurement `name` of a probe in `unit` over time; `anchor` is the identifier of the drawing.

    Models that do not have this measurement have NaN for it, and are left out of the figure.
    """

    def values(response: Response) -> NDArray[np.float64]:
        """Measurement (T,) of a response; NaN if the response does not have it."""
        return response.other(name) if name in response.other_names else np.full(len(response.t), np.nan)

    label = " ".join(name.split(" ")[-2:]).capitalize()
    return histories.drawn_history(anchor, result, values, name[:1].upper() + name[1:], label, unit)


def _places_of(probes: Iterable[Summary]) -> str:
    """Text that lists probes, from their entries in a summary, with the point and the face of each."""
    texts = dict[str, str]()
    for probe in probes:
        name = probe["name"].rpartition(" ")[0]
        place = ", ".join(significant(round(x, 4) + 0.0, 3) for x in probe["at"])
        texts[name] = f"{name} at ({place}){SPACE}m" + (f", {probe['face']}" if probe["face"] else "")
    return "; ".join(texts.values())
