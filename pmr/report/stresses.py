"""The largest von Mises stress: over time, of each section of a boom, and in each region of a mesh."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from pmr.report import sentences
from pmr.report.blocks import Block, Grid, drawing
from pmr.report.figures import forces as figures
from pmr.report.numbers import SPACE, quantity, significant, unit_for
from pmr.results import RunResult
from pmr.results.tables import stress_peaks
from pmr.scene.names import ALONE


def stress(result: RunResult, prefix: str) -> Block | None:
    """Of each body over time, and where it is largest."""
    rows, parts = [], {part["name"]: part for part in result.summary.get("sections", ())}
    for number, (name, body) in enumerate(result.bodies.items()):
        if "reduced" not in body.peak_stress:
            continue
        below = "; below, the difference to the full model" if "full" in body.peak_stress else ""
        peak = parts.get(name, result.summary).get("stress_peak", {}).get("reduced")
        dot = f" The dot is the largest of all, {sentences.where(peak)}." if peak else ""
        caption = f"Largest von Mises stress over {name or 'the whole body'}{below}.{dot}"
        anchor = f"{prefix}-stress" if name == ALONE else f"{prefix}-stress-{number}"
        rows.append((drawing(anchor, figures.stress, caption, result, body),))
    grids = (*_sections(result), *_regions(result))
    return Block(heading="Stress", rows=tuple(rows), grids=grids) if rows or grids else None


def _sections(result: RunResult) -> Iterator[Grid]:
    """Of every section: the largest stress of each model, when, and where it is along the section."""
    found = []
    for one in result.summary.get("sections", ()):
        for model, peak in one.get("stress_peak", {}).items():
            at, where = f"{peak['t']:.4g}{SPACE}s", f"{peak['position'][0]:.3g}{SPACE}m"
            face = f"{peak['face']} of {peak['region']}" if peak["region"] else peak["face"]
            found.append((f"{one['name']}, {model}", quantity(peak["value"], "Pa", 4), at, where, face))
    if found:
        head = ("", "von Mises", "at", "from the tail", "on")
        yield Grid("Largest von Mises stress of each section.", head, tuple(found))


def _regions(result: RunResult) -> Iterator[Grid]:
    found = stress_peaks(result)
    if len(found.get("reduced", {})) < 2:  # a single region is the body
        return
    unit = unit_for(max(peak["value"] for peak in found["reduced"].values()), "Pa")
    full: Mapping[str, Mapping[str, float]] = found.get("full", {})
    rows = []
    for name, peak in found["reduced"].items():
        place = ", ".join(significant(x, 3) for x in peak["position"])
        beside = (significant(full[name]["value"] / unit.size, 4),) if full else ()
        value = significant(peak["value"] / unit.size, 4)
        rows.append((name, value, *beside, significant(peak["t"], 4), f"({place})", peak["face"]))
    head = ("region", f"in {unit.name}", *(("full model",) if full else ()), "at t in s", "and x, y, z in m", "face")
    yield Grid("Largest von Mises stress in each region of the mesh.", head, tuple(rows))
