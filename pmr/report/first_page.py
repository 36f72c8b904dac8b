"""The first page for the one who decides: what was asked, what it carries, how far it may be trusted."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from pmr.report import sentences
from pmr.report.blocks import Table
from pmr.report.columns import is_round_off, tips
from pmr.report.model_error import CALLED as MODELS
from pmr.report.numbers import SPACE, length, percent, plain, quantity, significant
from pmr.report.parameters import by_face
from pmr.report.subject import alone, loads_as_asked, spoken
from pmr.results import RunResult
from pmr.results.outputs import FORCES
from pmr.results.tables import FORCE_OF
from pmr.scene.choice import model_of
from pmr.scene.members import members
from pmr.scene.names import named

Rows = Iterator[tuple[str, str]]

#: What the largest force of a kind is called; those of points that slide are pads without faces.
CALLED = {"pad": "largest pad force", "cylinder": "largest cylinder force", "support": "largest force of a support"}
#: What measures what the mesh takes.
NO_MESH = "not known: a run with [accuracy] measures it"
#: Of the largest force: what is below is round-off.
ROUND_OFF = 1e-9


def tables(result: RunResult) -> tuple[Table, ...]:
    """The three tables; each row has its figure, and where and when."""
    found = (
        Table("What was asked", tuple(_asked(result))),
        Table("What it carries", tuple(_carried(result))),
        Table("How far to trust it", tuple(_trusted(result))),
    )
    return tuple(table for table in found if table.rows)


def _asked(result: RunResult) -> Rows:
    scene, masses = result.scene, {one["name"]: one for one in result.summary.get("masses", ())}
    for member, (name, part) in zip(members(scene), scene.bodies.items(), strict=True):
        box, model = part.body.box, spoken(model_of(member))
        size = ""
        if box is not None:
            sides = f"{plain(1e3 * box.width)} × {plain(1e3 * box.height)}"
            size = f", box of {plain(box.length)}{SPACE}m, {sides}{SPACE}mm, wall {by_face(box.wall)}{SPACE}mm"
        weight = masses.get(name)
        yield name or "structure", f"{model}{size}" + ("" if weight is None else f", {_kg(weight['mass'])}")
    for name, part in scene.bodies.items():
        for mass in part.masses:
            yield named(name, mass.name), f"{plain(mass.mass)}{SPACE}kg"
    if masses:
        yield "total mass", _kg(sum(one["mass"] + one["attached"] for one in masses.values()))
    for load in loads_as_asked(result):
        values = load.values
        most = float(values[np.argmax(np.abs(values))]) if len(values) else 0.0
        yield named(load.body, load.name), f"up to {quantity(most, load.unit)} {load.where}"
    if scene.frame is not None:
        for name, angle in zip(("luffing", "slewing"), scene.frame.angles, strict=True):
            low, high = np.rad2deg(angle.bounds(0.0, scene.time.end))
            if low or high:
                yield name, _between(low, high, "°")
    elif scene.gravity is not None and abs(scene.gravity.raised) >= 0.01:
        yield "raised by", f"{plain(round(scene.gravity.raised, 1))}°"
    if result.reach is not None:
        yield "reach", _between(float(result.reach.min()), float(result.reach.max()), f"{SPACE}m")
    yield "time", f"{plain(scene.time.end)}{SPACE}s"


def _kg(mass: float) -> str:
    return f"{plain(round(mass, 1))}{SPACE}kg"


def _between(low: float, high: float, unit: str) -> str:
    low, high = (round(float(end), 2) for end in (low, high))
    return f"{plain(low)} to {plain(high)}{unit}" if high > low else f"{plain(low)}{unit}"


def _carried(result: RunResult) -> Rows:
    summary = result.summary
    if (largest := summary.get("max_von_mises", {}).get("reduced")) is not None:
        where = sentences.where_the_peak_is(result, "reduced")
        yield "largest von Mises stress", f"{quantity(largest, 'Pa')}{f', {where}' if where else ''}"
    else:
        yield "stress", "not computed: a table [recovery] asks for it"
    if (used := summary.get("utilisation", {}).get("reduced")) is not None:
        where = used["section"] and f", {used['section']}"
        at = f"{plain(round(used['position'][0], 2))}{SPACE}m from the tail, at {plain(round(used['t'], 2))}{SPACE}s"
        limit = f"{percent(used['value'])} of {quantity(used['yield'], 'Pa')}"
        yield "largest stress over yield stress", f"{limit}{where}, {at}"
    if found := summary.get("fatigue"):
        life = "" if found[0]["life"] is None else f", endured {significant(found[0]['life'])} times"
        yield "largest damage by fatigue", f"{significant(found[0]['damage'])}, {found[0]['name']}{life}"
    yield from _forces(result)
    yield from _luffing(result)
    yield from _deflection(result)
    yield from _lowest(result)
    if (found := summary.get("buckling", {})).get("factor") is not None:
        yield "buckling factor", f"{significant(found['factor'])}, at {plain(round(found['t'], 2))}{SPACE}s"


def _forces(result: RunResult) -> Rows:
    """The largest of each kind, pads, cylinders and supports apart."""
    response = result.responses["reduced"]
    first, forces = len(response.output_names), response.slider_force
    if response.force_peaks is not None:
        forces = response.force_peaks
    most = float(np.abs(forces).max(initial=0.0))
    outputs = response.outputs[first : first + forces.shape[1]]
    for kind in FORCES:
        columns = [k for k, one in enumerate(outputs) if one.kind == kind]
        if not columns or not np.isfinite(forces[:, columns]).all():
            continue
        step, k = np.unravel_index(int(np.argmax(np.abs(forces[:, columns]))), (len(forces), len(columns)))
        value = float(forces[step, columns[k]])
        if abs(value) <= ROUND_OFF * most:
            continue
        name = outputs[columns[k]].name
        called = name.replace(FORCE_OF, "", 1)
        yield CALLED[kind], f"{quantity(value, 'N')}, {called}, {_when(result, int(step))}"


def _luffing(result: RunResult) -> Rows:
    """What the cylinder along itself presses or pulls with most, and its stroke."""
    if (found := result.summary.get("luffing_cylinder")) is not None:
        force, length = found["force"], found["length"]
        end = "max" if force["max"] >= -force["min"] else "min"
        when = f"at {plain(round(force[f't_{end}'], 2))}{SPACE}s, {_at(result, force[f's_{end}'])}"
        stroke = _between(length["min"], length["max"], f"{SPACE}m long")
        yield "cylinder that raises it, along itself", f"{quantity(force[end], 'N')}, {when}; {stroke}"


def _deflection(result: RunResult) -> Rows:
    response = result.responses["reduced"]
    sizes = {direction: what(response) for direction, what in tips(result).items() if not is_round_off(result, what)}
    for direction, values in sizes.items():
        step = int(np.argmax(np.abs(values)))
        yield f"largest deflection of the tip, {direction}", f"{length(float(values[step]))}, {_when(result, step)}"


def _lowest(result: RunResult) -> Rows:
    found = result.frequencies.models.get("reduced")
    if found is None or not found.size or not np.isfinite(found[:, 0]).any():
        return
    k = int(np.nanargmin(found[:, 0]))
    if found[k, 0] <= ROUND_OFF * np.nanmax(found):
        yield "lowest natural frequency", f"0, at {_at(result, float(result.frequencies.along[k]))}"
    else:
        where = _at(result, float(result.frequencies.along[k]))
        yield "lowest natural frequency", f"{significant(float(found[k, 0]))}{SPACE}Hz, at {where}"


def _when(result: RunResult, step: int) -> str:
    t = result.responses["reduced"].t
    where = _at(result, float(result.along_at(t[[0, step, -1]])[1]))
    return f"at {plain(round(float(t[step]), 2))}{SPACE}s, {where}"


def _at(result: RunResult, along: float) -> str:
    place = f"{plain(round(along, 2))}{SPACE}m"
    return f"s = {place}" if alone(result) else f"a reach of {place}"


def _trusted(result: RunResult) -> Rows:
    summary = result.summary
    yield "model", _model(summary)
    budget = summary.get("budget", {})
    yield "mesh", _share(budget.get("mesh"), "beam") or budget.get("mesh_reason") or NO_MESH
    step = summary.get("step", {})
    yield "time step", _share(step, "beam") or f"not known{_reason(step)}"
    errors, estimate = summary.get("errors", {}).get("reduced_vs_full", {}), summary.get("estimate") or {}
    if "beam" in errors:
        yield "reduction", f"{percent(errors['beam'])} off the full model"
    else:
        known = _share(estimate, "beam")
        yield "reduction", f"{known}, estimated" if known else "not known: nothing was compared with a full model"
    missing = [*(estimate.get("not_covered") or ()), *summary.get("budget", {}).get("model", {}).get("not_covered", ())]
    if missing:
        yield "not covered", "; ".join(_once(missing))


def _model(summary: Mapping[str, Any]) -> str:
    found = summary.get("budget", {}).get("model") or {}
    if found.get("beside") is None:
        reason = found.get("reason") or "compare.richer measures it"
        return reason if reason.startswith("not ") else f"not known: {reason}"
    known = _share(found, "beam")
    frequency = f"lowest frequencies {percent(found['frequency'])}" if found.get("frequency") is not None else ""
    beside = f"beside {MODELS[found['beside']]}"
    return ", ".join(filter(None, (f"{known} over the run" if known else "", frequency, beside)))


def _share(found: Any, key: str) -> str:
    value = found.get(key) if isinstance(found, dict) else found
    return percent(value) if value is not None else ""


def _reason(found: Mapping[str, Any]) -> str:
    return f": {found['reason']}" if found.get("reason") else ""


def _once(texts: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(texts))
