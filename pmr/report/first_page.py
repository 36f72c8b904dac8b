"""The first page for the one who decides: what was asked, what it carries, how far it may be trusted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from pmr.report import machine, sentences, trust
from pmr.report.blocks import Table
from pmr.report.columns import is_round_off, tips
from pmr.report.machine import extent
from pmr.report.numbers import SPACE, length, percent, plain, quantity, significant
from pmr.report.subject import direction_words, drive_of, is_alone, moving_part, rings_of
from pmr.report.subject import length as reach_of
from pmr.results import RunResult
from pmr.results.tables import FORCE_OF
from pmr.scene.keys import cylinder_of, named
from pmr.scene.mechanism import supports_at_lug

Rows = Iterator[tuple[str, str]]

#: What the largest force of a kind is called; those of points that slide are pads without faces.
CALLED = {
    "pad": "largest pad force",
    "cylinder": "largest force of a cylinder that extends",
    "rope": "largest rope force",
    "support": "largest force of a support",
    "moment": "largest moment of a support",
    "force on the machine": "largest force of the boom on its machine",
    "moment on the machine": "largest moment of the boom on its machine, about the pivot",
    "force on the ground": "largest force of the machine on the ground",
    "moment on the ground": "largest moment of the machine on the ground",
}
MOMENTS = ("moment", "moment on the machine", "moment on the ground")
#: What names of the reactions of a machine that moves by itself begin with.
MACHINE = "machine "
#: Of the largest force: what is below is round-off.
ROUND_OFF = 1e-9


def tables(result: RunResult) -> tuple[Table, ...]:
    """The three tables; each row has its figure, and where and when."""
    all_tables = (
        Table("What was asked", tuple(machine.rows(result))),
        Table("What it carries", tuple(capacity_rows(result))),
        trust.table(result),
    )
    return tuple(table for table in all_tables if table.rows)


def capacity_rows(result: RunResult) -> Rows:
    """Rows of what the structure carries: whether it holds, how far it gives, how it vibrates, forces of each kind."""
    summary = result.summary
    yield from _stress(result)
    if fatigue_or_buckling := summary.get("fatigue"):
        life = (
            ""
            if fatigue_or_buckling[0]["life"] is None
            else f", endured {significant(fatigue_or_buckling[0]['life'])} times"
        )
        yield (
            "largest damage by fatigue",
            f"{significant(fatigue_or_buckling[0]['damage'])}, {fatigue_or_buckling[0]['name']}{life}",
        )
    if (fatigue_or_buckling := summary.get("buckling", {})).get("factor") is not None:
        when = f"at {_round(fatigue_or_buckling['t'])}{SPACE}s{_raised_text(result, fatigue_or_buckling['t'])}"
        yield "buckling factor", f"{significant(fatigue_or_buckling['factor'])}, {when}"
    yield from _deflection(result)
    yield from _lowest(result)
    yield from _luffing_rows(result)
    yield from _forces(result)
    yield from _machine_rows(result)


def _stress(result: RunResult) -> Rows:
    """The largest stress with its share of the yield stress; in two rows where they are not of the same place."""
    summary = result.summary
    largest = summary.get("max_von_mises", {}).get("reduced")
    if largest is None:
        yield "stress", "not computed: a table [recovery] asks for it"
        return
    peak, used = (summary.get(name, {}).get("reduced") for name in ("stress_peak", "utilisation"))
    stress_text = quantity(largest, "Pa")
    share = f"{percent(used['value'])} of the yield stress of {quantity(used['yield'], 'Pa')}" if used else ""
    if used and used["stress"] == largest:
        stress_text, peak, used = f"{stress_text}, {share}", used, None
    yield "largest von Mises stress", stress_text if peak is None else f"{stress_text}, {_stressed_at(result, peak)}"
    if used:
        yield "largest stress over yield stress", f"{share}, {_stressed_at(result, used)}"


def _stressed_at(result: RunResult, peak: Mapping[str, Any]) -> str:
    """Place and time of a largest stress."""
    of = sentences.part_of(peak)
    of = f"{of}, " if of else ""
    return f"{of}{_round(peak['position'][0])}{SPACE}m from the tail, at {_round(peak['t'])}{SPACE}s" + _raised_text(
        result, peak["t"]
    )


def _forces(result: RunResult) -> Rows:
    """The largest of each kind, pads, cylinders and supports apart, and the largest moment of a support."""
    summary = result.summary
    below = [row for row in summary.get("reactions", ()) if _of_machine(result, row)]
    ground = {row["name"].removeprefix(MACHINE): row for row in below}
    supports = [row for row in summary.get("reactions", ()) if not _at_pivot(result, row) and row not in below]
    held = {_full_name(result, row["name"]): row for row in supports if row["name"] not in _luffing_names(result)}
    drives = {
        drive: [row for row in summary.get("ropes", ()) if drive_of(row) == drive] for drive in ("rope", "cylinder")
    }
    pivot = {row["name"].removeprefix("pivot "): row for row in summary.get("reactions", ()) if _at_pivot(result, row)}
    listed = {
        "cylinder": {f"cylinder of {row['name']}, which pulls the ropes": row["force"] for row in drives["cylinder"]},
        "rope": {f"rope of {row['name']}, all strands": row["force"] for row in drives["rope"]},
        "support": {name: row for name, row in held.items() if row["unit"] == "N"},
        "moment": {name: row for name, row in held.items() if row["unit"] == "N m"},
        "force on the machine": {f"along {axis}": pivot[axis] for axis in "xyz" if axis in pivot},
        "moment on the machine": {f"about {axis}": pivot[f"r{axis}"] for axis in "xyz" if f"r{axis}" in pivot},
        "force on the ground": {f"along {axis}": ground[axis] for axis in "xyz" if axis in ground},
        "moment on the ground": {f"about {axis}": ground[f"r{axis}"] for axis in "xyz" if f"r{axis}" in ground},
    }
    for kind, called in CALLED.items():
        if kind == "support" and _luffing_names(result):
            called = "largest force of another support"
        if of_kind := listed.get(kind):
            name, reaction = max(of_kind.items(), key=lambda named: max(named[1]["max"], -named[1]["min"]))
            end = "max" if reaction["max"] >= -reaction["min"] else "min"
            if abs(reaction[end]) > 0.0:
                when = _moment(result, reaction[f"t_{end}"], reaction[f"s_{end}"])
                yield called, f"{quantity(reaction[end], reaction['unit'] if kind in MOMENTS else 'N')}, {name}, {when}"
            elif kind == "support":
                yield called, f"0, {name}"
        else:
            yield from _largest(result, kind, called)


def _at_pivot(result: RunResult, reaction: Mapping[str, Any]) -> bool:
    """Is it a reaction of all supports of a boom in a frame together, about its pivot?"""
    return result.scene.frame is not None and str(reaction["name"]).startswith("pivot ")


def _of_machine(result: RunResult, reaction: Mapping[str, Any]) -> bool:
    """Is it a force of a machine that moves by itself on the ground?"""
    frame = result.scene.frame
    return frame is not None and frame.machine is not None and str(reaction["name"]).startswith(MACHINE)


def _luffing_names(result: RunResult) -> set[str]:
    """Names of supports that stand for the cylinder which raises the boom, whose force along itself has a row."""
    frame = result.scene.frame
    if frame is None or frame.cylinder is None or result.summary.get("luffing_cylinder") is None:
        return set()
    body = next(iter(result.scene.bodies))
    return {named(body, name) for name in supports_at_lug(result.scene)}


def _full_name(result: RunResult, name: str) -> str:
    """The name of a support's force, with its direction where the name has none."""
    for body, part in result.scene.bodies.items():
        for support in part.supports:
            if len(support.held) == 1 and name == named(body, support.name):
                return f"{name} along {support.held[0]}"
    return name


def _largest(result: RunResult, kind: str, called: str) -> Rows:
    """The largest force of a kind in the response; none where it is round-off."""
    response = result.responses["reduced"]
    first, forces = len(response.output_names), response.slider_force
    if response.force_peaks is not None:
        forces = response.force_peaks
    outputs = response.outputs[first : first + forces.shape[1]]
    elsewhere = {*_luffing_names(result), *(cylinder_of(output["name"]) for output in result.summary.get("ropes", ()))}
    columns = [k for k, output in enumerate(outputs) if output.kind == kind and _force_of(output.name) not in elsewhere]
    if not columns or not np.isfinite(forces[:, columns]).all():
        return
    step, k = np.unravel_index(int(np.argmax(np.abs(forces[:, columns]))), (len(forces), len(columns)))
    value = float(forces[step, columns[k]])
    if abs(value) > ROUND_OFF * float(np.abs(forces).max(initial=0.0)):
        name = _force_of(outputs[columns[k]].name)
        way = f" {'pushes' if value > 0.0 else 'pulls'}" if kind == "cylinder" else ""
        shown = abs(value) if way else value
        yield called, f"{quantity(shown, 'N')}, {name}{way}, {_when(result, int(step))}"


def _force_of(name: str) -> str:
    return name.replace(FORCE_OF, "", 1)


def _luffing_rows(result: RunResult) -> Rows:
    """Largest force of the luffing cylinder along itself, and its stroke."""
    if (cylinder := result.summary.get("luffing_cylinder")) is not None:
        force, length = cylinder["force"], cylinder["length"]
        end = "max" if force["max"] >= -force["min"] else "min"
        when = _moment(result, force[f"t_{end}"], force[f"s_{end}"])
        stroke = extent(length["min"], length["max"], f"{SPACE}m long")
        way = "pushes" if end == "max" else "pulls"
        yield "largest force of the luffing cylinder", f"{quantity(abs(force[end]), 'N')}, it {way}, {when}; {stroke}"


def _deflection(result: RunResult) -> Rows:
    response = result.responses["reduced"]
    sizes = {direction: what(response) for direction, what in tips(result).items() if not is_round_off(result, what)}
    for direction, values in sizes.items():
        step = int(np.argmax(np.abs(values)))
        called = f"largest deflection of the tip, {direction_words(result, direction)}"
        way = {"y": ("right", "left"), "z": ("down", "up")}[direction][int(values[step] > 0.0)]
        yield called, f"{length(abs(float(values[step])))} {way}, {_when(result, step)}"


def _machine_rows(result: RunResult) -> Rows:
    """How far a machine that moves by itself does: displacements of the pivot, and angles."""
    frame = result.scene.frame
    if frame is None or frame.machine is None:
        return
    motions, degrees = (
        result.summary.get("frame", {}).get("base", {}),
        1.0 if frame.unit == "degrees" else np.rad2deg(1.0),
    )
    parts = []
    for key, motion in motions.items():
        if key not in frame.machine.free:
            continue
        turns = key.startswith("r")
        unit = "°" if turns else f"{SPACE}m" if max(abs(motion["min"]), abs(motion["max"])) >= 1.0 else f"{SPACE}mm"
        size = degrees if turns else 1.0 if unit == f"{SPACE}m" else 1e3
        parts.append(f"{key} {extent(size * motion['min'], size * motion['max'], unit)}")
    if parts:
        yield "motion of the machine", ", ".join(parts)


def _lowest(result: RunResult) -> Rows:
    frequencies = result.frequencies.models.get("reduced")
    if frequencies is None or not frequencies.size or not np.isfinite(frequencies[:, 0]).any():
        return
    k = int(np.nanargmin(frequencies[:, 0]))
    if frequencies[k, 0] <= ROUND_OFF * np.nanmax(frequencies):
        yield "lowest natural frequency", f"0, at {_position_text(result, float(result.frequencies.along[k]))}"
    else:
        where = _position_text(result, float(result.frequencies.along[k]))
        push = any(ring.unilateral for part in result.scene.bodies.values() for ring in rings_of(part))
        closed = ", every pad closed" if push else ""
        yield "lowest natural frequency", f"{significant(float(frequencies[k, 0]))}{SPACE}Hz, at {where}{closed}"


def _when(result: RunResult, step: int) -> str:
    t = result.responses["reduced"].t
    return _moment(result, float(t[step]), float(result.along_at(t[[0, step, -1]])[1]))


def _moment(result: RunResult, t: float, along: float) -> str:
    return f"at {_round(t)}{SPACE}s, {_position_text(result, along)}{_raised_text(result, t)}"


def _raised_text(result: RunResult, t: float) -> str:
    """How far a boom in a frame is raised then, and turned where it is at all."""
    frame = result.scene.frame
    if frame is None:
        return ""
    luffing, slewing = (float(np.rad2deg(angle.value(np.array([t]))[0])) for angle in frame.angles)
    angles = [] if frame.luffing is None else [f"raised {plain(round(luffing, 1))}°"]
    angles += [] if frame.slewing is None else [f"slewed {plain(round(slewing, 1))}°"]
    return "".join(f", {angle_text}" for angle_text in angles)


def _position_text(result: RunResult, along: float) -> str:
    """How far a boom reaches, or a section is out of its mouth; of a beam where its sliders are."""
    if not is_alone(result):
        return f"reach {_round(along)}{SPACE}m"
    if moving_part(result) == "mouth":
        return f"{_round(reach_of(result) - along)}{SPACE}m out"
    return f"s = {_round(along)}{SPACE}m"


def _round(value: float) -> str:
    return plain(round(value, 2))
