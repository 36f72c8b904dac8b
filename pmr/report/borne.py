"""What the body bears, in tables: forces, stresses by region; what probes say, over time and as load cycles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.report.blocks import Block, Drawing, Grid, drawing
from pmr.report.figures import captions, histories
from pmr.report.numbers import SPACE, Unit, significant, unit_for
from pmr.results import Response, RunResult
from pmr.results.extremes import Extremes, cycles
from pmr.results.tables import force_extremes, probe_extremes, reaction_extremes

Array = NDArray[np.float64]

#: Measures of probes that are drawn, and whose load cycles are counted; all others stand in tables alone.
MOST_DRAWN = 4
#: Share of the largest value of its unit below which what a probe measures is round-off.
NOTHING = 1e-5
#: The same of forces, which a support has even where nothing acts along it.
ROUND_OFF = 1e-9
#: Classes of the range of load cycles.
CLASSES = 10
STRAIN = Unit(1e-6, "µm/m")
_WHEN = ("at t in s", "and s in m")


def forces(result: RunResult) -> tuple[Grid, ...]:
    """Smallest and largest force of each pad, slider and support that gives way, then of the rigid ones."""
    response = result.responses["reduced"]
    found = force_extremes(response, result.along)
    largest = max(map(_size, found.values()), default=0.0)
    caption = "Least and largest forces, when they occur, and the path coordinate s then."
    grids = (_extremes(found, "N", largest, caption), *reactions(response, result.along, "s is the path coordinate"))
    return tuple(grid for grid in grids if grid.rows)


def reactions(response: Response, path: Array, s: str) -> Iterator[Grid]:
    """Smallest and largest forces and moments on rigid supports; `path` (T,) m is what is called s, in words `s`."""
    found = dict[str, dict[str, Extremes]]()
    for of, one in reaction_extremes(response, path).items():
        if _size(one) > 0.0:  # nothing acts along a support that only keeps a direction
            found.setdefault(of.unit, {})[of.support] = one
    for base, of_unit in found.items():
        what = "Moments on rigid supports" if base == "N m" else "Forces on rigid supports"
        caption = f"{what}, positive along the axes, when they occur, and s then; {s}."
        yield _extremes(of_unit, base, max(map(_size, of_unit.values())), caption)


def _extremes(found: Mapping[str, Extremes], base: str, largest: float, caption: str) -> Grid:
    """A row for each, in a unit that fits the largest; zero at no time where it is round-off beside that."""
    unit = unit_for(max(map(_size, found.values()), default=0.0), base)
    cells = {
        name: tuple(_cells(one, unit)) if _size(one) > ROUND_OFF * largest else ("0", "", "") * 2
        for name, one in found.items()
    }
    head = ("", f"least in {unit.name}", *_WHEN, f"largest in {unit.name}", *_WHEN)
    return Grid(caption, head, tuple((name or "slider", *shown) for name, shown in cells.items()))


def regions(result: RunResult) -> tuple[Grid, ...]:
    """The largest von Mises stress in each region of the mesh."""
    found = result.summary.get("stress_by_region", {})
    if len(found.get("reduced", {})) < 2:  # a single region is the body
        return ()
    unit = unit_for(max(peak["value"] for peak in found["reduced"].values()), "Pa")
    full: Mapping[str, Mapping[str, float]] = found.get("full", {})
    rows = []
    for name, peak in found["reduced"].items():
        place = ", ".join(significant(x, 3) for x in peak["position"])
        beside = (significant(full[name]["value"] / unit.size, 4),) if full else ()
        value = significant(peak["value"] / unit.size, 4)
        rows.append((name, value, *beside, significant(peak["t"], 4), f"({place})", peak["face"]))
    head = ("region", f"in {unit.name}", *(("full model",) if full else ()), "at t in s", "and x, y, z in m", "face")
    return (Grid("Largest von Mises stress in each region of the mesh.", head, tuple(rows)),)


def probes(result: RunResult, prefix: str) -> Block | None:
    """What the probes say: histories, extremes, and rainflow counts of stresses and strains."""
    known = {probe["name"]: probe for probe in result.summary.get("probes", ())}
    found = probe_extremes(result.responses["reduced"], result.along)
    found = {name: one for name, one in found.items() if name in known}
    if not found:
        return None
    largest = dict[str, float]()
    for name, one in found.items():
        unit = known[name]["unit"]
        largest[unit] = max(largest.get(unit, 0.0), _size(one))
    units = {unit: _unit(unit, size) for unit, size in largest.items()}
    told = [n for n, one in found.items() if _size(one) > NOTHING * largest[known[n]["unit"]]]
    rows = []
    for name in told:
        unit = units[known[name]["unit"]]
        rows.append((f"{name} in {unit.name}", *_cells(found[name], unit)))
    extremes = Grid(_places(known.values()), ("", "least", *_WHEN, "largest", *_WHEN), tuple(rows))
    drawn = _foremost(told, found)
    counted = [_counted(result, name, units[known[name]["unit"]]) for name in drawn if known[name]["unit"] != "mm"]
    figures = tuple((_drawn(result, f"{prefix}-probe-{k}", name, known[name]["unit"]),) for k, name in enumerate(drawn))
    text = "All load cycles stand in tables/cycles.csv." if counted else ""
    return Block("Probes", figures, text=text, grids=(extremes, *counted))


def _foremost(names: Iterable[str], found: Mapping[str, Extremes]) -> list[str]:
    """Of each measure of a probe the component that is largest, of the first few."""
    groups = dict[str, list[str]]()
    for name in names:
        groups.setdefault(name.rpartition(" ")[0], []).append(name)
    return [max(group, key=lambda name: _size(found[name])) for group in groups.values()][:MOST_DRAWN]


def _drawn(result: RunResult, anchor: str, name: str, unit: str) -> Drawing:
    size, base = {"mm": (1e-3, "m"), "1": (1e6, STRAIN.name)}.get(unit, (1.0, unit))

    def values(response: Response) -> Array:
        known = name in response.other_names
        return size * response.other(name) if known else np.full(len(response.t), np.nan)

    caption = captions.history(result, name[:1].upper() + name[1:], values)
    label = " ".join(name.split(" ")[-2:]).capitalize()
    return drawing(anchor, histories.history, caption, result, values, label, base, values)


def _unit(unit: str, largest: float) -> Unit:
    """In which values of a unit are printed, of which this one is the largest."""
    return STRAIN if unit == "1" else unit_for(largest, unit) if unit == "Pa" else Unit(1.0, unit)


def _places(known: Iterable[Mapping[str, Any]]) -> str:
    """Where the probes look, each once."""
    said = dict[str, str]()
    for probe in known:
        name = probe["name"].rpartition(" ")[0]
        place = ", ".join(significant(round(x, 4) + 0.0, 3) for x in probe["at"])
        said[name] = f"{name} at ({place}){SPACE}m" + (f", {probe['face']}" if probe["face"] else "")
    return f"Least and largest values: {'; '.join(said.values())}."


def _counted(result: RunResult, name: str, unit: Unit) -> Grid:
    """Rainflow counts in classes of the range."""
    response = result.responses["reduced"]
    found = cycles(response.t, response.other(name))
    top = float(found[:, 0].max(initial=0.0))
    rows = []
    for k in range(CLASSES, 0, -1):
        low, high = (k - 1) / CLASSES * top, k / CLASSES * top
        inside = found[(found[:, 0] > low) & (found[:, 0] <= high)]
        if len(inside):
            mean = float(np.average(inside[:, 1], weights=inside[:, 2]))
            span = f"{significant(low / unit.size, 3)} to {significant(high / unit.size, 3)}"
            rows.append((span, f"{inside[:, 2].sum():g}", significant(mean / unit.size, 3)))
    caption = f"Load cycles of {name}, counted by rainflow: classes of the range, and the mean within each."
    return Grid(caption, (f"range in {unit.name}", "cycles", f"mean in {unit.name}"), tuple(rows))


def _size(one: Extremes) -> float:
    return max(one.most, -one.least)


def _cells(one: Extremes, unit: Unit) -> Iterator[str]:
    for value, t, s in ((one.least, one.t_least, one.s_least), (one.most, one.t_most, one.s_most)):
        yield from (significant(value / unit.size, 3), significant(t, 4), significant(s, 4))
