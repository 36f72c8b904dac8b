"""Tables for engineers in CSV: forces, reactions, frequencies, stresses, probes and their load cycles, section forces.

Every column has its unit in brackets.  The column ``model`` names the model of a row: ``reduced``, ``full`` or
``ancf``.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from operator import eq
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pmr.errors import InputError
from pmr.errors.environment import import_package
from pmr.files.arrays import Array, Summary
from pmr.files.whole import finish_swap
from pmr.results.fatigue import rainflow_cycles
from pmr.results.quantities import (
    FORCE_OF,
    REACTION_OF,
    Columns,
    columns_by_support,
    lug_measure,
    resultant_name,
    supports_with_lugs,
)
from pmr.results.response import ROUND_OFF, Extremes, Response
from pmr.results.run import RunResult
from pmr.scene import Scene
from pmr.scene.keys import ALONE, qualified_name

if TYPE_CHECKING:
    from pandas import DataFrame


Cell = str | float

#: Name of the only region of a body without named regions.
WHOLE = "whole body"
#: Load cycles whose range is below this share of the largest range are not listed.
LEAST_LISTED = 0.01


@dataclass(frozen=True)
class Table:
    """Table: names of the c columns, and rows of c values each."""

    columns: tuple[str, ...]  # (c,), with units in brackets
    rows: tuple[tuple[Cell, ...], ...]


@dataclass(frozen=True)
class Reaction:
    """Name of a rigid support, and the unit of its reaction: N for a force, N m for a moment."""

    support: str
    unit: str


def build_tables(result: RunResult) -> dict[str, Table]:
    """Return the tables of a run that have rows, by the names of their files.

    For a boom of sections, ``s`` is the reach.
    """
    return {name: table for name, make in _TABLES.items() if (table := make(result)).rows}


def write_tables(result: RunResult, folder: Path) -> None:
    """Write each table of a run that has rows as ``tables/<name>.csv`` into `folder`; tables of other names stay."""
    (folder / "tables").mkdir(parents=True, exist_ok=True)
    for name, table in build_tables(result).items():
        with (folder / "tables" / f"{name}.csv").open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(table.columns)
            writer.writerows([cell if isinstance(cell, str) else repr(cell) for cell in row] for row in table.rows)


def force_table(result: RunResult) -> Table:
    """Return a table of the smallest and largest force of every pad, slider, cylinder and elastic support.

    Each value has its time and its path coordinate.
    """
    rows: list[tuple[Cell, ...]] = [
        (model, name, *extremes.summary().values())
        for model, response in result.responses.items()
        for name, extremes in force_extremes(response, result.abscissa_at(response.t)).items()
    ]
    return Table(("model", "force of", *_extreme_heads(" [N]")), tuple(rows))


def force_extremes(response: Response, path: Array) -> dict[str, Extremes]:
    """Return the extremes in N of each force of a response (`Response.force`), by the name of its contact.

    `path` (T,) are path coordinates in m over time.
    """
    return {
        name.removeprefix(FORCE_OF): Extremes.from_history(response.force(name), response.t, path)
        for name in response.force_names
    }


def probe_extremes(response: Response, path: Array) -> dict[str, Extremes]:
    """Return the extremes of all `others` of a response but reactions, by name: values at probes, friction and so on.

    `path` (T,) are path coordinates in m over time.
    """
    extremes = {name: Extremes.from_history(response.other(name), response.t, path) for name in response.other_names}
    return {name: extreme for name, extreme in extremes.items() if not name.startswith(REACTION_OF)}


def reaction_extremes(response: Response, path: Array) -> dict[Reaction, Extremes]:
    """Return the extremes of the force in N, or moment in N m, by the `Reaction` of each rigid support.

    A reaction that is round-off at all times, compared with the largest one of any unit, is set to zero.  `path` (T,)
    are path coordinates in m over time.
    """
    reactions = {
        Reaction(name.removeprefix(REACTION_OF), unit): response.other(name)
        for name, unit in zip(response.other_names, response.other_units, strict=True)
        if name.startswith(REACTION_OF)
    }
    sizes = {of: float(np.abs(values).max()) for of, values in reactions.items()}
    floor = max(response.force_round_off, ROUND_OFF * max(sizes.values(), default=0.0))
    return {
        of: Extremes.from_history(values if sizes[of] > floor else np.zeros_like(values), response.t, path)
        for of, values in reactions.items()
    }


def support_forces(scene: Scene, response: Response, directions: int = 1) -> dict[str, Array]:
    """Return the force (T,) in N over time of each support that has forces along at least `directions` directions.

    The forces are given by body and support, such as ``base: pivot``.  The force of a support with several directions
    is its resultant, 0 or more; that of a support with a single direction has a sign.  Components that are round-off
    are set to zero.  Supports with moments alone are left out, and so are forces at the pivot and on the ground.
    """
    columns, forces = Columns.from_scene(scene, response), dict[str, Array]()
    for name, numbers in columns_by_support(columns, lambda _: True).items():
        if columns.units[numbers[0]] == "N" and len(numbers) >= directions:
            parts = np.column_stack([response.clear_round_off(response.column(k)) for k in numbers])
            body = columns.bodies[numbers[0]]
            force = parts[:, 0] if len(numbers) == 1 else np.linalg.norm(parts, axis=1)
            forces[qualified_name(body, name.removeprefix(f"{body} "))] = force
    return forces


def lug_forces(scene: Scene, response: Response) -> dict[str, Array]:
    """Return the larger force (T,) in N of the two lugs of each pin over time, by the name of the pin's support.

    Components that are round-off are set to zero.  The result is empty if no pin has lugs.
    """
    columns, pins = Columns.from_scene(scene, response), supports_with_lugs(scene)
    if not columns.lugs:
        return {}
    values = np.column_stack([response.clear_round_off(response.column(k)) for k in range(len(columns.names))])
    measures = {name: lug_measure(columns, partial(eq, name)) for name in columns.lugs}
    return {resultant_name(*pins[name]): of_lug(values) for name, of_lug in measures.items() if of_lug is not None}


def reaction_table(result: RunResult) -> Table:
    """Return a table of the smallest and largest force or moment of every rigid support.

    Each value has its time and its path coordinate.
    """
    rows: list[tuple[Cell, ...]] = [
        (model, of.support, of.unit, *extremes.summary().values())
        for model, response in result.responses.items()
        for of, extremes in reaction_extremes(response, result.abscissa_at(response.t)).items()
    ]
    return Table(("model", "reaction of", "unit", *_extreme_heads()), tuple(rows))


def frequency_table(result: RunResult) -> Table:
    """Return a table of the lowest frequencies in Hz of each model over the path coordinate, or the reach of a boom.

    The last column is the lowest frequency without pads that are open at rest, if it is known.  The table has no rows
    if there are no frequencies.
    """
    lowest = result.frequencies
    heads = [f"{name.replace('_', ' ')} {k + 1} [Hz]" for name, f in lowest.models.items() for k in range(f.shape[1])]
    values = np.column_stack([lowest.along, *lowest.models.values()])
    if lowest.resting is not None:
        heads, values = [*heads, "reduced 1, pads open at rest [Hz]"], np.column_stack([values, lowest.resting])
    return Table((f"{result.abscissa_name} [m]", *heads), tuple(map(tuple, values.tolist())) if lowest.models else ())


def summaries_by_section(summary: Summary) -> dict[str, Summary]:
    """Return the part of summary.json about each section, by the section's name.

    For a body alone the whole summary is returned under the empty name.
    """
    return {part["name"]: part for part in summary.get("sections", ())} or {ALONE: summary}


def stress_by_part(summary: Summary) -> dict[str, dict[str, Summary]]:
    """Return the largest von Mises stress in `summary` by model, and then by region of each body.

    A body without named regions has one region, `WHOLE`.
    """
    peaks = dict[str, dict[str, Summary]]()
    for name, part in summaries_by_section(summary).items():
        for model, peak in part.get("stress_peak", {}).items():
            regions = part.get("stress_by_region", {}).get(model) or {WHOLE: peak}
            peaks.setdefault(model, {}).update(
                {qualified_name(name, region): region_peak for region, region_peak in regions.items()}
            )
    return peaks


def stress_table(result: RunResult) -> Table:
    """Return a table of the largest von Mises stress in each region, with its time and position."""
    rows = [
        (model, region, peak["value"], peak["t"], *peak["position"], peak["face"])
        for model, regions in stress_by_part(result.summary).items()
        for region, peak in regions.items()
    ]
    places = ("x [m]", "y [m]", "z [m]")
    return Table(("model", "region", "von Mises [Pa]", "t [s]", *places, "face"), tuple(rows))


def probe_table(result: RunResult) -> Table:
    """Return a table of the smallest and largest measurement of each probe, with times and path coordinates.

    Outputs of the same kind that no ``[[probes]]`` asks for, such as the tip's rotation, have neither place nor face.
    """
    rows = []
    for model, response in result.responses.items():
        extremes = probe_extremes(response, result.abscissa_at(response.t))
        for probe in _measured_probes(result, response):
            head = (model, probe["name"], probe["unit"], *probe["at"], probe["face"])
            rows.append((*head, *extremes[probe["name"]].summary().values()))
    return Table(("model", "probe", "unit", "x [m]", "y [m]", "z [m]", "face", *_extreme_heads()), tuple(rows))


def load_cycle_table(result: RunResult) -> Table:
    """Return a table of the rainflow cycles of stresses and strains at probes, for an assessment of fatigue.

    Cycles whose range is below the share `LEAST_LISTED` of the probe's largest range are left out.
    """
    rows = []
    for model, response in result.responses.items():
        for probe in _measured_probes(result, response):
            if probe["unit"] in ("Pa", "1"):
                loops = rainflow_cycles(response.t, response.other(probe["name"]))
                listed = loops[loops[:, 0] >= LEAST_LISTED * loops[:, 0].max(initial=0.0)]
                rows += [(model, probe["name"], probe["unit"], *cycle) for cycle in listed.tolist()]
    return Table(("model", "probe", "unit", "range", "mean", "count", "t_begin [s]", "t_end [s]"), tuple(rows))


def section_force_table(result: RunResult) -> Table:
    """Return a table of the smallest and largest force, moment and corner stress at each position along the beams."""
    rows = []
    for name, body in result.bodies.items():
        for model, envelope in body.envelopes.items():
            for k, (what, unit) in enumerate(zip(envelope.names, envelope.units, strict=True)):
                values = envelope.x, envelope.least[k], envelope.least_at[k], envelope.most[k], envelope.most_at[k]
                rows += [(model, name, what, unit, *row) for row in np.column_stack(values).tolist()]
    extremes = ("min", "t_min [s]", "max", "t_max [s]")
    return Table(("model", "body", "quantity", "unit", "x [m]", *extremes), tuple(rows))


_TABLES: Mapping[str, Callable[[RunResult], Table]] = {
    "forces": force_table,
    "reactions": reaction_table,
    "frequencies": frequency_table,
    "probes": probe_table,
    "cycles": load_cycle_table,
    "stress": stress_table,
    "section_forces": section_force_table,
}


def _extreme_heads(unit: str = "") -> tuple[str, ...]:
    """Return the headings of the columns of extremes.

    A `unit` in brackets, such as ``" [N]"``, follows after ``min`` and ``max``; `unit` is empty if the table has a
    column of units.
    """
    return f"min{unit}", "t_min [s]", "s_min [m]", f"max{unit}", "t_max [s]", "s_max [m]"


def _measured_probes(result: RunResult, response: Response) -> Iterator[Summary]:
    """Yield a mapping with name, unit, place and face for each output of a response that is a measurement."""
    probes = {probe["name"]: probe for probe in result.summary.get("probes", ())}
    for output in response.outputs:
        if output.kind == "probe":
            without_place = {"name": output.name, "unit": output.unit, "at": ("", "", ""), "face": ""}
            yield probes.get(output.name, without_place)


def load(folder: str | Path) -> dict[str, DataFrame]:
    """Return the results of a run or a study in a folder, as data frames of pandas, by name.

    The names of columns include the units.

    A run has its tables (`pmr.results.tables`), and the histories of each simulator over the time in s, under the name
    of the simulator.  A study has ``runs`` and ``seconds``.  A collection has the frames of all its studies, by names
    such as ``<study>/runs``.

    Raises
    ------
    InputError
        If there are no results in the folder, or pandas is not installed.
    """
    folder, pandas = Path(folder), import_package("pandas")
    finish_swap(folder)
    if not (folder / "summary.json").is_file():
        raise InputError(str(folder), "", None, "a folder that `pmr run` or `pmr study` wrote results to is allowed")
    if (folder / "runs.csv").is_file():
        return {name: pandas.read_csv(folder / f"{name}.csv") for name in ("runs", "seconds")}
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    if "studies" in summary:
        return {
            f"{study}/{name}": frame for study in summary["studies"] for name, frame in load(folder / study).items()
        }
    result = RunResult.load(folder)
    frames = {
        name: pandas.DataFrame(list(table.rows), columns=list(table.columns))
        for name, table in build_tables(result).items()
    }
    for name, response in result.responses.items():
        index = pandas.Index(response.t, name="t [s]")
        columns = {
            column: values
            for array, names in response.columns.items()
            if (values_of := getattr(response, array)) is not None
            for column, values in zip(names, values_of.T, strict=True)
        }
        frames[name] = pandas.DataFrame(columns, index=index)
    return frames
