"""What probes say, over time and as load cycles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.report.blocks import Block, Drawing, Grid
from pmr.report.figures.histories import drawn_history
from pmr.report.forces import cells, place_called, size
from pmr.report.numbers import SPACE, Unit, significant, unit_for
from pmr.results import Response, RunResult
from pmr.results.fatigue import cycles
from pmr.results.response import Extremes
from pmr.results.tables import probe_extremes

Array = NDArray[np.float64]

#: Measures of probes that are drawn, and whose load cycles are counted; all others stand in tables alone.
MOST_DRAWN = 4
#: Share of the largest value of its unit below which what a probe measures is round-off.
NOTHING = 1e-5
#: Classes of the range of load cycles.
CLASSES = 10
STRAIN = Unit(1e-6, "µm/m")


def probes(result: RunResult, prefix: str) -> Block | None:
    """Histories of probes, their extremes, and rainflow counts of stresses and strains."""
    probes_by_name = {probe["name"]: probe for probe in result.summary.get("probes", ())}
    response = result.responses["reduced"]
    extremes_by_name = probe_extremes(response, result.along_at(response.t))
    extremes_by_name = {name: peak for name, peak in extremes_by_name.items() if name in probes_by_name}
    if not extremes_by_name:
        return None
    largest = dict[str, float]()
    for name, extreme in extremes_by_name.items():
        unit = probes_by_name[name]["unit"]
        largest[unit] = max(largest.get(unit, 0.0), size(extreme))
    units = {unit: _unit(unit, size) for unit, size in largest.items()}
    named = [n for n, peak in extremes_by_name.items() if size(peak) > NOTHING * largest[probes_by_name[n]["unit"]]]
    rows = []
    for name in named:
        unit = units[probes_by_name[name]["unit"]]
        rows.append((f"{name} in {unit.name}", *cells(extremes_by_name[name], unit)))
    extremes = Grid(_places(result, probes_by_name.values()), ("", "least", "largest"), tuple(rows))
    drawn = _foremost(named, extremes_by_name)
    counted = [
        _rainflow_grid(result, name, units[probes_by_name[name]["unit"]])
        for name in drawn
        if probes_by_name[name]["unit"] != "mm"
    ]
    figures = tuple(
        (_history(result, f"{prefix}-probe-{k}", name, probes_by_name[name]["unit"]),) for k, name in enumerate(drawn)
    )
    text = "All load cycles stand in tables/cycles.csv." if counted else ""
    return Block("Probes", figures, text=text, grids=(extremes, *counted, *_damage(result)))


def _damage(result: RunResult) -> list[Grid]:
    """Damage by each stress, where an S-N line is given."""
    fatigue = result.summary.get("fatigue")
    if not fatigue:
        return []
    rows = [(row["name"], _number(row["damage"]), _number(row["life"])) for row in fatigue]
    caption = "Damage by load cycles on the scene's S-N line, after Palmgren and Miner: 1 is failure. The life is how "
    return [Grid(f"{caption}often all that is asked for may come.", ("", "damage", "life"), tuple(rows))]


def _number(value: float | None) -> str:
    return "without end" if value is None else significant(value)


def _foremost(names: Iterable[str], extremes_by_name: Mapping[str, Extremes]) -> list[str]:
    """Choose the largest component of each measure of a probe, of the first few."""
    groups = dict[str, list[str]]()
    for name in names:
        groups.setdefault(name.rpartition(" ")[0], []).append(name)
    return [max(group, key=lambda name: size(extremes_by_name[name])) for group in groups.values()][:MOST_DRAWN]


def _history(result: RunResult, anchor: str, name: str, unit: str) -> Drawing:
    size, base = {"mm": (1e-3, "m"), "1": (1e6, STRAIN.name)}.get(unit, (1.0, unit))

    def values(response: Response) -> Array:
        is_there = name in response.other_names
        return size * response.other(name) if is_there else np.full(len(response.t), np.nan)

    label = " ".join(name.split(" ")[-2:]).capitalize()
    return drawn_history(anchor, result, values, name[:1].upper() + name[1:], label, base)


def _unit(unit: str, largest: float) -> Unit:
    """In which values of a unit are printed, of which this one is the largest."""
    return STRAIN if unit == "1" else unit_for(largest, unit) if unit == "Pa" else Unit(1.0, unit)


def _places(result: RunResult, probes_of_run: Iterable[Mapping[str, Any]]) -> str:
    """Places of the probes, each once."""
    texts = dict[str, str]()
    for probe in probes_of_run:
        name = probe["name"].rpartition(" ")[0]
        place = ", ".join(significant(round(x, 4) + 0.0, 3) for x in probe["at"])
        texts[name] = f"{name} at ({place}){SPACE}m" + (f", {probe['face']}" if probe["face"] else "")
    return f"Least and largest values, when they occur, and {place_called(result)} then: {'; '.join(texts.values())}."


def _rainflow_grid(result: RunResult, name: str, unit: Unit) -> Grid:
    """Rainflow counts in classes of the range."""
    response = result.responses["reduced"]
    load_cycles = cycles(response.t, response.other(name))
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
    return Grid(caption, (f"range in {unit.name}", "cycles", f"mean in {unit.name}"), tuple(rows))
