"""The largest von Mises stress: over time, of each section of a boom, and in each region of a mesh."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pmr.report import sentences
from pmr.report.blocks import Block, Grid
from pmr.report.figures import loads as figures
from pmr.report.figures.canvas import drawing
from pmr.report.figures.histories import Timeline, difference_clause
from pmr.report.numbers import NOTHING, SPACE, plain, quantity, significant, unit_for
from pmr.results import RunResult
from pmr.results.tables import parts_of, stress_peaks
from pmr.scene.keys import ALONE, named


def stress(result: RunResult, prefix: str) -> Block | None:
    """Stress of each body over time, and where it is largest."""
    rows, parts = [], {part["name"]: part for part in result.summary.get("sections", ())}
    for number, (name, body) in enumerate(result.bodies.items()):
        if "reduced" not in body.peak_stress:
            continue
        below = difference_clause(Timeline(result), figures.stresses(result, body), "below, the difference")
        peak = parts.get(name, result.summary).get("stress_peak", {}).get("reduced")
        dot = f" The dot is the largest of all, {sentences.where(peak)}." if peak else ""
        caption = f"Largest von Mises stress over {name or 'the whole body'}{below}.{dot}"
        anchor = f"{prefix}-stress" if name == ALONE else f"{prefix}-stress-{number}"
        rows.append((drawing(anchor, figures.stress, caption, result, body),))
    grids = (*_sections(result), *_regions(result))
    return Block(heading="Stress", rows=tuple(rows), grids=grids) if rows or grids else None


def along_beams(result: RunResult, prefix: str) -> Block | None:
    """Normal force, shear forces and moments of the sections of beams: envelopes over time, and the largest."""
    largest, table_rows = dict[str, float](), list[tuple[str, ...]]()
    for part in parts_of(result.summary).values():
        for what, force in part.get("section_forces", {}).get("reduced", {}).items():
            if force["unit"] != "Pa":
                largest[what] = max(largest.get(what, 0.0), -force["min"], force["max"])
    shown = [what for what, value in largest.items() if value > NOTHING * max(largest.values())]
    if not shown:
        return None
    for name, part in parts_of(result.summary).items():
        for what, force in part.get("section_forces", {}).get("reduced", {}).items():
            if what in shown and (force["min"] or force["max"]):
                table_rows.append(
                    (named(name, what), *(_end(force, end, NOTHING * largest[what]) for end in ("min", "max")))
                )
    caption = "Forces and moments of sections along each beam, from the smallest to the largest over time."
    drawn = drawing(f"{prefix}-envelopes", figures.envelopes, caption, result, shown)
    grid = Grid("The smallest and the largest, where from the tail, and when.", ("", "min", "max"), tuple(table_rows))
    return Block(heading="Forces along beams", rows=((drawn,),), grids=(grid,))


def _end(force: Mapping[str, Any], end: str, nothing: float) -> str:
    """The smallest or the largest value, where from the tail, and when; 0 alone up to `nothing`."""
    if abs(force[end]) <= nothing:
        return "0"
    at, when = (plain(round(force[f"{of}_{end}"], 2)) for of in ("x", "t"))
    return f"{quantity(force[end], force['unit'])} at {at}{SPACE}m, {when}{SPACE}s"


def _sections(result: RunResult) -> Iterator[Grid]:
    """Largest stress of each section by each model, its time, and its place along the section."""
    table_rows = []
    for section in result.summary.get("sections", ()):
        for model, peak in section.get("stress_peak", {}).items():
            at, where = f"{peak['t']:.4g}{SPACE}s", f"{peak['position'][0]:.3g}{SPACE}m"
            face = f"{peak['face']} of {peak['region']}" if peak["region"] else peak["face"]
            table_rows.append((f"{section['name']}, {model}", quantity(peak["value"], "Pa", 4), at, where, face))
    if table_rows:
        head = ("", "von Mises", "at", "from the tail", "on")
        yield Grid("Largest von Mises stress of each section.", head, tuple(table_rows))


def _regions(result: RunResult) -> Iterator[Grid]:
    peaks = stress_peaks(result)
    if len(peaks.get("reduced", {})) < 2:  # a single region is the body
        return
    unit = unit_for(max(peak["value"] for peak in peaks["reduced"].values()), "Pa")
    full: Mapping[str, Mapping[str, float]] = peaks.get("full", {})
    rows = []
    for name, peak in peaks["reduced"].items():
        place = ", ".join(significant(x, 3) for x in peak["position"])
        of_full_model = (significant(full[name]["value"] / unit.size, 4),) if full else ()
        value = significant(peak["value"] / unit.size, 4)
        rows.append((name, value, *of_full_model, significant(peak["t"], 4), f"({place})", peak["face"]))
    head = ("region", f"in {unit.name}", *(("full model",) if full else ()), "at t in s", "and x, y, z in m", "face")
    yield Grid("Largest von Mises stress in each region of the mesh.", head, tuple(rows))
