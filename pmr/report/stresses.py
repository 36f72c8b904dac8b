"""Blocks about von Mises stresses, forces along beams, and measurements of probes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from pmr.files.arrays import Summary
from pmr.report import sentences
from pmr.report.blocks import Block, Drawing, Grid
from pmr.report.figures import loads as figures
from pmr.report.figures.canvas import drawing
from pmr.report.figures.histories import Timeline, difference_clause, drawn_history
from pmr.report.forces import extremes_grid, then_words
from pmr.report.numbers import NOTHING, SPACE, Unit, format_input, format_quantity, significant, unit_for
from pmr.report.subject import places_at
from pmr.results import Response, RunResult
from pmr.results.fatigue import rainflow_cycles
from pmr.results.quantities import stress_remark
from pmr.results.response import Extremes
from pmr.results.tables import probe_extremes, stress_peaks, summaries_by_section
from pmr.scene.keys import ALONE, qualified_name


def stress_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block with the largest stress of each body over time, and tables of its times and places.

    It is None if the run has no stresses.  `prefix` begins the identifiers of the figures.
    """
    drawings, parts = [], {part["name"]: part for part in result.summary.get("sections", ())}
    for number, (name, body) in enumerate(result.bodies.items()):
        if "reduced" not in body.peak_stress:
            continue
        below = difference_clause(Timeline(result), figures.stress_histories(result, body))
        peak = parts.get(name, result.summary).get("stress_peak", {}).get("reduced")
        dot = f" The dot is the largest of all, {sentences.peak_clause(peak)}." if peak else ""
        caption = f"Largest von Mises stress over {name or 'the whole body'}{below}.{dot}"
        anchor = f"{prefix}-stress" if name == ALONE else f"{prefix}-stress-{number}"
        drawings.append(drawing(anchor, figures.stress_figure, caption, result, body))
    grids = (*_section_grids(result), *_region_grids(result))
    heading = " ".join(filter(None, ("Stress", stress_remark(result.scene))))
    return Block(heading=heading, drawings=drawings, grids=grids) if drawings or grids else None


def section_force_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block on forces and moments of beams' cross-sections: envelopes over time and a table of extremes.

    It is None if no beam has such forces.  `prefix` begins the identifiers of the figures.
    """
    largest, table_rows = dict[str, float](), list[tuple[str, ...]]()
    for part in summaries_by_section(result.summary).values():
        for what, force in part.get("section_forces", {}).get("reduced", {}).items():
            if force["unit"] != "Pa":
                largest[what] = max(largest.get(what, 0.0), -force["min"], force["max"])
    shown = [what for what, value in largest.items() if value > NOTHING * max(largest.values())]
    if not shown:
        return None
    for name, part in summaries_by_section(result.summary).items():
        for what, force in part.get("section_forces", {}).get("reduced", {}).items():
            if what in shown and (force["min"] or force["max"]):
                table_rows.append(
                    (
                        qualified_name(name, what),
                        *(_extreme_cell(force, end, NOTHING * largest[what]) for end in ("min", "max")),
                    )
                )
    caption = "Forces and moments of sections along each beam, from the smallest to the largest over time."
    drawn = drawing(f"{prefix}-envelopes", figures.envelope_figure, caption, result, shown)
    grid = Grid("The smallest and the largest, where from the tail, and when.", ("", "min", "max"), tuple(table_rows))
    return Block(heading="Forces along beams", drawings=(drawn,), grids=(grid,))


def _extreme_cell(force: Summary, end: str, nothing: float) -> str:
    """Format an extreme of a force, ``min`` or ``max`` as `end` says, with its distance from the tail and its time.

    A value of at most `nothing` is printed as ``0`` alone.
    """
    if abs(force[end]) <= nothing:
        return "0"
    at, when = (format_input(round(force[f"{of}_{end}"], 2)) for of in ("x", "t"))
    return f"{format_quantity(force[end], force['unit'])} at {at}{SPACE}m, {when}{SPACE}s"


def _section_grids(result: RunResult) -> Iterator[Grid]:
    """Yield a table with the largest stress of each section in each model, its time and its place along the section."""
    table_rows = []
    for section in result.summary.get("sections", ()):
        for model, peak in section.get("stress_peak", {}).items():
            at, where = f"{peak['t']:.4g}{SPACE}s", f"{peak['position'][0]:.3g}{SPACE}m"
            face = f"{peak['face']} of {peak['region']}" if peak["region"] else peak["face"]
            table_rows.append((f"{section['name']}, {model}", format_quantity(peak["value"], "Pa", 4), at, where, face))
    if table_rows:
        head = ("", "von Mises", "at", "from the tail", "on")
        yield Grid("Largest von Mises stress of each section.", head, tuple(table_rows))


def _region_grids(result: RunResult) -> Iterator[Grid]:
    """Yield a table with the largest stress in each region of the mesh; yield nothing for fewer than two regions."""
    peaks = stress_peaks(result)
    if len(peaks.get("reduced", {})) < 2:  # a single region is the whole body
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


#: Largest number of quantities of probes that are drawn and whose load cycles are counted; others are in tables only.
MOST_DRAWN = 4
#: A measurement of a probe is round-off up to this share of the largest measurement with the same unit.
UNSEEN = 1e-5
#: Number of intervals into which a rainflow table divides the ranges of load cycles.
CLASSES = 10
STRAIN = Unit(1e-6, "µm/m")


def probe_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block on probes: histories, extremes, load cycles of stresses and strains, and damage.

    It is None if the scene has no probes.  `prefix` begins the identifiers of the figures.
    """
    probes_by_name = {probe["name"]: probe for probe in result.summary.get("probes", ())}
    response = result.responses["reduced"]
    extremes_by_name = probe_extremes(response, places_at(result, response.t))
    extremes_by_name = {name: peak for name, peak in extremes_by_name.items() if name in probes_by_name}
    if not extremes_by_name:
        return None
    largest = dict[str, float]()
    for name, extreme in extremes_by_name.items():
        unit = probes_by_name[name]["unit"]
        largest[unit] = max(largest.get(unit, 0.0), extreme.size)
    units = {unit: _printed_unit(unit, size) for unit, size in largest.items()}
    named = [n for n, peak in extremes_by_name.items() if peak.size > UNSEEN * largest[probes_by_name[n]["unit"]]]
    unit_of = {name: units[probe["unit"]] for name, probe in probes_by_name.items()}
    caption = _probe_caption(result, probes_by_name.values())
    extremes = extremes_grid(caption, {name: extremes_by_name[name] for name in named}, unit_of)
    drawn = _drawn_measurements(named, extremes_by_name)
    counted = [_rainflow_grid(result, name, unit_of[name]) for name in drawn if probes_by_name[name]["unit"] != "mm"]
    figures = [
        _history_drawing(result, f"{prefix}-probe-{k}", name, probes_by_name[name]["unit"])
        for k, name in enumerate(drawn)
    ]
    text = "All load cycles stand in tables/cycles.csv." if counted else ""
    return Block("Probes", figures, text=text, grids=(extremes, *counted, *_damage_grids(result)))


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


def _drawn_measurements(names: Iterable[str], extremes_by_name: Mapping[str, Extremes]) -> list[str]:
    """Choose the measurements to be drawn: of each of the first `MOST_DRAWN` quantities, the largest component."""
    groups = dict[str, list[str]]()
    for name in names:
        groups.setdefault(name.rpartition(" ")[0], []).append(name)
    return [max(group, key=lambda name: extremes_by_name[name].size) for group in groups.values()][:MOST_DRAWN]


def _history_drawing(result: RunResult, anchor: str, name: str, unit: str) -> Drawing:
    """Draw the measurement `name` of a probe in `unit` over time; `anchor` is the identifier of the drawing.

    Models that do not have this measurement have NaN for it, and are left out of the figure.
    """
    size, base = {"mm": (1e-3, "m"), "1": (1e6, STRAIN.name)}.get(unit, (1.0, unit))

    def values(response: Response) -> NDArray[np.float64]:
        """Measurement (T,) of a response in the unit of the axis; NaN if the response does not have it."""
        is_there = name in response.other_names
        return size * response.other(name) if is_there else np.full(len(response.t), np.nan)

    label = " ".join(name.split(" ")[-2:]).capitalize()
    return drawn_history(anchor, result, values, name[:1].upper() + name[1:], label, base)


def _printed_unit(unit: str, largest: float) -> Unit:
    """Unit in which values are printed that are stored in `unit`; `largest` is the largest of these values."""
    return STRAIN if unit == "1" else unit_for(largest, unit) if unit == "Pa" else Unit(1.0, unit)


def _probe_caption(result: RunResult, probes_of_run: Iterable[Summary]) -> str:
    """Caption of the table of extremes, with the point and the face of each probe."""
    texts = dict[str, str]()
    for probe in probes_of_run:
        name = probe["name"].rpartition(" ")[0]
        place = ", ".join(significant(round(x, 4) + 0.0, 3) for x in probe["at"])
        texts[name] = f"{name} at ({place}){SPACE}m" + (f", {probe['face']}" if probe["face"] else "")
    return f"Least and largest values, when they occur{then_words(result)}: {'; '.join(texts.values())}."


def _rainflow_grid(result: RunResult, name: str, unit: Unit) -> Grid:
    """Build a table of a measurement's load cycles, counted by rainflow, in `CLASSES` intervals of their range.

    `name` is the name of the measurement.  Intervals without cycles are left out.
    """
    response = result.responses["reduced"]
    load_cycles = rainflow_cycles(response.t, response.other(name))
    top = float(load_cycles[:, 0].max(initial=0.0))
    rows = []
    for k in range(CLASSES, 0, -1):
        low, high = (k - 1) / CLASSES * top, k / CLASSES * top
        inside = load_cycles[(load_cycles[:, 0] > low) & (load_cycles[:, 0] <= high)]
        if len(inside):
            mean = float(np.average(inside[:, 1], weights=inside[:, 2]))
            span = f"{significant(low / unit.size, 3)} to {significant(high / unit.size, 3)}"
            rows.append((span, f"{inside[:, 2].sum():g}", significant(mean / unit.size, 3)))
    caption = f"Load cycles of {name}, counted by rainflow: classes of the range, and the mean within each."
    return Grid(caption, (f"range in {unit.name}", "cycles", f"mean in {unit.name}"), tuple(rows), half=True)
