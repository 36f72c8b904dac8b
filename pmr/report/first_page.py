"""Tables of the first page: what was simulated, what the structure carries, how far the results may be trusted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from pmr.files.arrays import Summary
from pmr.report import errors, overview, sentences
from pmr.report.blocks import Table
from pmr.report.columns import axis_points, is_round_off, tip_displacements
from pmr.report.numbers import (
    SPACE,
    format_input,
    format_length,
    format_percent,
    format_quantity,
    format_time,
    significant,
)
from pmr.report.overview import format_range
from pmr.report.subject import (
    crossing,
    direction_words,
    drive_of,
    elevation,
    has_free_luffing,
    has_pushing_pads,
    is_alone,
    is_raised,
    joint_section,
    luffing_support_names,
    moving_part,
    wall_stress_words,
)
from pmr.report.subject import reach as reach_of
from pmr.results import RunResult
from pmr.results.field_stress import PeakSummary
from pmr.results.quantities import QUANTITIES, stress_name, stress_remark, wall_stress, wall_stress_on_short_cells
from pmr.results.response import Extreme, Extremes
from pmr.results.tables import FORCE_OF
from pmr.scene.keys import cylinder_name, qualified_name
from pmr.scene.left_out import left_out
from pmr.scene.mechanism import AT_GROUND, AT_PIVOT

Rows = Iterator[tuple[str, str]]


class LargestValue(NamedTuple):
    """Row of the table of largest values: its name, its text, and the share of the allowed value, None if unknown."""

    name: str
    text: str
    share: float | None = None


LargestValues = Iterator[LargestValue]

#: Where the hook is beside its head for a swing below and above 0, along and across the boom.
SWING_SIDES = {"along": ("inwards of", "outwards of"), "across": ("to the right of", "to the left of")}
#: Keys of the forces and moments whose largest values have a row; those of the luffing cylinder and of a free extension
#: have rows of their own.
FORCES = tuple(
    key for key, quantity in QUANTITIES.items() if quantity.unit in ("N", "N m") and quantity.reported
    and key not in ("luffing_force", "extension_force")
)  # fmt: skip
#: Name of the row with the length of the luffing cylinder.
LUFFING_LENGTH = "length of the luffing cylinder"
#: Beginnings of the names of reactions at the pivot, of outputs of a machine that moves, and of forces on the ground.
PIVOT, MACHINE, GROUND = f"{AT_PIVOT} ", "machine ", f"{AT_GROUND} "
#: Kinds of the outputs with the forces of a key, unless the summary has them.
OF_KINDS = {"pad_force": "pad", "cylinder_force": "cylinder", "support": "support", "outrigger_force": "outrigger"}
#: Words for the chambers of a cylinder.
OIL_SIDES = {"bore": "in the bore", "rod": "on the rod side"}
#: End of the name of a cylinder that moves sections by ropes.
ROPES = "which pulls the ropes"
#: Labels of the quantities whose errors are those of the boom's moment on its machine.
MARGIN_ERRORS = (QUANTITIES["reaction"].label, QUANTITIES["support_force"].label)
#: Clauses on the direction in which a mode moves the tip most.
TIP_MOVES = {"y": ", the tip moves sideways, along y", "z": ", the tip moves up and down, along z"}
#: Share of the highest natural frequency up to which a frequency is round-off and is printed as 0, and share of a
#: stroke up to which a length beyond it is round-off.
ROUND_OFF = 1e-9


def first_page_tables(result: RunResult) -> tuple[Table, ...]:
    """Build the tables of the first page; tables without rows are left out."""
    all_tables = (
        Table("What was asked", tuple(overview.system_rows(result))),
        Table("How sure", tuple(errors.certainty_rows(result))),
        Table("Largest values of this motion", tuple(largest_value_rows(result))),
        Table("What is not in this model", tuple(_left_out_rows(result))),
        errors.trust_table(result),
    )
    return tuple(table for table in all_tables if table.rows)


def _left_out_rows(result: RunResult) -> Rows:
    """Yield a row for each subject with what the scene's model leaves out (`pmr.scene.left_out`)."""
    rows, recovery = left_out(result.scene), result.scene.recovery
    if recovery is not None and "reduced" in result.summary.get("max_von_mises", {}):
        rows["strength"] += f", stresses between times {format_input(recovery.every, 's')} apart (recovery.every)"
    if "loads" in rows:
        rows["loads"] += ", factors of a standard (dynamic, safety)"
    yield from rows.items()


def overload_sentences(result: RunResult) -> list[str]:
    """Sentences on the values that are above what is allowed, the worst first."""
    return [f"{row.name}: {row.text}" for row in largest_values(result) if row.share is not None and row.share > 1.0]


def largest_value_rows(result: RunResult) -> Rows:
    """Yield the rows (name, text) of the table of largest values."""
    yield from ((row.name, row.text) for row in largest_values(result))


def largest_values(result: RunResult) -> list[LargestValue]:
    """Rows of the table of largest values: first those with an allowed value, of which the largest share is used."""
    return sorted(_largest_values(result), key=lambda row: 0.0 if row.share is None else -row.share)


def _largest_values(result: RunResult) -> LargestValues:
    """Yield rows on stress, fatigue, buckling, deflection, frequency, forces and the machine's motion."""
    summary = result.summary
    yield from _stress_rows(result)
    if damages := summary.get("fatigue"):
        worst = damages[0]
        life = "" if worst["life"] is None else f", endured {significant(worst['life'])} times"
        text = f"{significant(worst['damage'])}, {worst['name']}{life}"
        yield LargestValue(QUANTITIES["damage"].reported, text, worst["damage"])
    if (buckling := summary.get("buckling", {})).get("factor") is not None:
        when = f"at {format_time(buckling['t'])}{_angles_clause(result, buckling['t'])}"
        text = f"{significant(buckling['factor'])}, {when}{_closed_pads_clause(result)}"
        yield LargestValue(QUANTITIES["buckling"].reported, text)
    yield from _deflection_rows(result)
    yield from _further_output_rows(result)
    yield from _frequency_rows(result)
    yield from _speed_rows(result)
    yield from _driven_rows(result)
    yield from _pressure_rows(result)
    yield from _indentation_rows(result)
    yield from _hoist_rows(result)
    yield from _force_rows(result)
    yield from _machine_rows(result)
    yield from _ground_rows(result)


def _stress_rows(result: RunResult) -> LargestValues:
    """Yield a row with the largest von Mises stress and its share of the yield stress.

    If the largest share of the yield stress occurs at another point than the largest stress, it has its own row.
    Local bending adds to stresses of beams, so they have a share only above the yield stress, as a lower bound; before
    them stands the stress of a shell, if known.
    """
    summary = result.summary
    largest = summary.get("max_von_mises", {}).get("reduced")
    if largest is None:
        yield LargestValue("stress", "not computed: a table [recovery] asks for it")
        return
    peak, used = (summary.get(name, {}).get("reduced") for name in ("stress_peak", "utilisation"))
    stress_text, local, of_beams = format_quantity(largest, "Pa"), "", bool(stress_remark(result.scene))
    if of_beams:
        local = ", without the bending of walls under pads"
        if (shell := wall_stress(summary)) is not None:
            yield _wall_stress_row(result, shell)
        else:
            prescribed = "" if result.scene.computed_key is None else "in a run with a prescribed motion "
            local += f", which adds to it; by how much is not known: {prescribed}compare.richer = 'shell' computes it"
        used = used if used and used["value"] > 1.0 else None
    share, highest = "", used["value"] if used else None
    if used:
        least = "at least " if of_beams else ""
        share = f"{least}{format_percent(used['value'])} of the yield stress of {format_quantity(used['yield'], 'Pa')}"
    if used and used["stress"] == largest:
        stress_text, peak, used = f"{stress_text}, {share}", used, None
    where = "" if peak is None else f", {_peak_clause(result, peak)}"
    yield LargestValue(stress_name(result.scene), f"{stress_text}{local}{where}", None if used else highest)
    if used:
        yield LargestValue("largest stress over yield stress", f"{share}, {_peak_clause(result, used)}", highest)


def _wall_stress_row(result: RunResult, shell: Summary) -> LargestValue:
    """Row on the largest stress of the shells that the model is compared with: value, share, place, time, cells."""
    long, wide = (format_input(round(1e3 * size, 1)) for size in shell["cells"])
    at = PeakSummary(t=shell["t"], position=shell["position"], section=shell["section"])
    at["region"] = f"{shell['region']} wall" if shell["region"] else "walls"
    most, allowed = wall_stress_on_short_cells(shell), shell.get("yield")
    share = None if allowed is None else most / allowed
    used = (
        ""
        if allowed is None
        else f", {format_percent(most / allowed)} of the {format_quantity(allowed, 'Pa')} of yield"
    )
    cells = f"{format_quantity(shell['value'], 'Pa')} on a shell with cells of {long} × {wide}{SPACE}mm"
    if (growth := shell.get("growth")) is None:
        how = f"{cells}, shorter ones give more under pads"
    else:
        how = f"{cells}, times {growth:.2f} by which the nearest pad's part grows with short ones"
    return LargestValue(
        "largest von Mises stress in walls",
        f"{wall_stress_words(shell)}{used}, {_peak_clause(result, at)}; {how}; not converged, its error is "
        "not known; without welds",
        share,
    )


def _closed_pads_clause(result: RunResult) -> str:
    """Clause that a figure is computed with every pad closed, and how many pads of the run lift off."""
    if not has_pushing_pads(result):
        return ""
    forces = [Extremes.from_summary(pad) for pad in result.summary.get("pads", ())]
    opened = sum(force.least == 0.0 for force in forces)
    lift = f", and {opened} pads do at times in this run" if opened else ""
    return f"; with every pad closed: pads that lift off lower it{lift}"


def _peak_clause(result: RunResult, peak: PeakSummary) -> str:
    """Clause with the point and the time of a largest stress, and with the boom's angles at that time."""
    where = [sentences.peak_part_name(peak), f"{_round(peak['position'][0])}{SPACE}m from the tail"]
    return f"{', '.join(filter(None, where))}, at {format_time(peak['t'])}{_angles_clause(result, peak['t'])}"


def _force_rows(result: RunResult) -> LargestValues:
    """Yield a row for each kind of force or moment in `FORCES`.

    The row states its largest value, the part that bears it, and the time.
    """
    for key, forces in _extremes_of_forces(result).items():
        row, unit = QUANTITIES[key].reported, QUANTITIES[key].unit
        name = max(forces, key=lambda name: forces[name].size, default="")  # noqa: B023
        if not forces or (not forces[name].size and key != "support"):
            continue
        if key in ("ground_force", "ground_moment") and "ground" in result.summary:
            continue  # outriggers and the margin against tipping say what they mean
        largest = forces[name].largest
        if not largest.value:
            yield LargestValue(row, f"0, {name}")
        elif key == "cylinder_force" and not name.endswith(ROPES):
            text = f"{format_quantity(abs(largest.value), unit)}, {name} {_push_or_pull(largest)}"
            yield LargestValue(row, f"{text}, {_extreme_clause(result, largest)}")
        else:
            text = f"{format_quantity(largest.value, unit)}, {_bearer_words(key, name)}"
            yield LargestValue(row, f"{text}, {_extreme_clause(result, largest)}")
            if key == "pad_force":
                yield from _yield_rows(result, forces)


def _bearer_words(key: str, name: str) -> str:
    """Words for the part that bears a force or moment of the kind `key`: a support of a section, or the boom's axis."""
    if key.startswith("machine"):
        return f"{name} of the boom's own axes"
    body, _, support = name.rpartition(": ")
    if key not in ("support", "support_moment") or not body:
        return name
    support, _, turn = support.rpartition(" ") if support.endswith((" rx", " ry", " rz")) else (support, "", "")
    return f"{support} of {body}" + (f", about {turn[1]}" if turn else "")


def _yield_rows(result: RunResult, forces: Mapping[str, Extremes]) -> LargestValues:
    """Yield a row with the pad whose force comes nearest to that at which walls begin to yield; `forces` are by pad.

    It is missing unless a shell was compared (`pmr.fullmodel.wall_stress.yield_forces`).
    """
    limits = (result.summary.get("budget", {}).get("model") or {}).get("pad_yield", {})
    shares = {
        name: (extremes.size / limit["force"], limit)
        for name, extremes in forces.items()
        if (limit := limits.get(joint_section(result, name))) is not None
    }
    if shares:
        pad = max(shares, key=lambda name: shares[name][0])
        share, limit = shares[pad]
        yield LargestValue(
            "largest pad force over that at which walls yield",
            f"{format_percent(share)} of {format_quantity(limit['force'], 'N')}, {pad}, "
            f"{_extreme_clause(result, forces[pad].largest)}; under the weakest pad of this joint alone the walls of "
            f"{limit['section']} then begin to yield at its edge; the bending of the whole section adds to it",
            share,
        )


def _pressure_rows(result: RunResult) -> LargestValues:
    """Yield a row with the largest mean pressure of a pad; nothing if no pad has a size."""
    pads = [pad for pad in result.summary.get("pads", ()) if "pressure" in pad]
    if pads:
        pad = max(pads, key=lambda pad: float(pad["pressure"]))
        force = Extremes.from_summary(pad).largest
        pressure, when = format_quantity(pad["pressure"], "Pa"), _extreme_clause(result, force)
        yield LargestValue(QUANTITIES["pad_pressure"].reported, f"{pressure}, {pad['name']}, {when}")


def _indentation_rows(result: RunResult) -> LargestValues:
    """Yield a row with the largest indentation of walls under a pad's own force; nothing if all walls are rigid."""
    if rows := result.summary.get("indentations"):
        largest = max(rows, key=lambda row: float(row["value"]))
        when = _extreme_clause(result, Extreme(largest["value"], largest["t"], largest["s"]))
        yield LargestValue(
            QUANTITIES["indentation"].reported, f"{format_length(largest['value'])}, {largest['name']}, {when}"
        )


def _extremes_of_forces(result: RunResult) -> dict[str, dict[str, Extremes]]:
    """Least and largest forces and moments, by their kinds in `FORCES` and by the names of the parts that bear them.

    Supports that model the luffing cylinder are left out.  A cylinder that pulls ropes is included once, with the force
    with which it pulls.
    """
    response, summary = result.responses["reduced"], result.summary
    by_key = {key: dict[str, Extremes]() for key in FORCES}
    frame, resultants = result.frame, summary.get("supports", ())
    for support in resultants:
        if support["name"] not in luffing_support_names(result):
            by_key["support"][_full_name(result, support["name"])] = Extremes.from_summary(support)
    for reaction in summary.get("reactions", ()):
        name, place = str(reaction["name"]), "support"
        if name in luffing_support_names(result):
            continue
        if frame is not None and name.startswith(PIVOT):
            place, name = "machine", name.removeprefix(PIVOT)
        elif frame is not None and name.startswith((MACHINE, GROUND)):
            place, name = "ground", name.rpartition(" ")[2]
        moment = reaction["unit"] == "N m"
        if place == "support":
            if moment or not resultants:
                key = "support_moment" if moment else "support"
                by_key[key][_full_name(result, name)] = Extremes.from_summary(reaction)
        elif name in ("x", "y", "z", "rx", "ry", "rz"):  # the luffing cylinder has another name
            axis = f"about {name[1]}" if moment else f"along {name}"
            by_key[f"{place}_moment" if moment else f"{place}_force"][axis] = Extremes.from_summary(reaction)
    for rope in summary.get("ropes", ()):
        extremes = Extremes.from_summary(rope["force"])
        if drive_of(rope) == "rope":
            by_key["rope_force"][f"rope of {rope['name']}, all strands"] = extremes
        else:
            by_key["cylinder_force"][f"cylinder of {rope['name']}, {ROPES}"] = extremes
    if hoist := summary.get("hoist"):
        by_key["hoist_force"][f"{significant(hoist['factor'])} times that of the weight"] = Extremes.from_summary(
            hoist["force"]
        )
    elsewhere = {*luffing_support_names(result), *(cylinder_name(rope["name"]) for rope in summary.get("ropes", ()))}
    for key, kind in OF_KINDS.items():
        if by_key[key]:
            continue
        for number, output in enumerate(response.outputs):
            name, values = output.name.replace(FORCE_OF, "", 1), response.column(number)
            if output.kind == kind and name not in elsewhere and np.abs(values).max() > response.force_floor:
                by_key[key][name] = Extremes.from_history(values, response.t, result.abscissa_at(response.t))
    return by_key


def _full_name(result: RunResult, name: str) -> str:
    """Name of a support's force; if the support holds one direction only, the direction is appended."""
    for body, part in result.scene.bodies.items():
        for support in part.supports:
            if len(support.held_directions) == 1 and name == qualified_name(body, support.name):
                return f"{name} along {support.held_directions[0]}"
    return name


def _hoist_rows(result: RunResult) -> LargestValues:
    """Yield rows with the range of the hook's height and with its largest swing."""
    if (hoist := result.summary.get("hoist")) is None:
        return
    height = Extremes.from_summary(hoist["height"])
    yield LargestValue(
        "height of the hook", f"{format_quantity(height.least, 'm')} to {format_quantity(height.most, 'm')}"
    )
    swings = {way: Extremes.from_summary(hoist[f"swing_{way}"]).largest for way in ("along", "across")}
    way = max(swings, key=lambda name: abs(swings[name].value))
    largest = swings[way]
    degrees = f"{significant(np.rad2deg(abs(largest.value)))}° {way} the boom"
    side = SWING_SIDES[way][int(largest.value > 0.0)]
    text = f"{degrees}, the hook {side} the head, {_extreme_clause(result, largest)}"
    yield LargestValue(QUANTITIES["swing"].reported, text)


def _driven_rows(result: RunResult) -> LargestValues:
    """Yield rows with the largest force of the luffing cylinder and on a free extension, their lengths, and oil."""
    for way in ("luffing", "extension"):
        if (cylinder := result.summary.get(f"{way}_cylinder")) is None:
            continue
        largest, length = Extremes.from_summary(cylinder["force"]).largest, cylinder["length"]
        text = f"{format_quantity(abs(largest.value), 'N')}, it {_push_or_pull(largest)}, "
        text += _extreme_clause(result, largest)
        if way == "extension":
            text += f"; {format_range(length['min'], length['max'], f'{SPACE}m out')}"
        yield LargestValue(QUANTITIES[f"{way}_force"].reported, text)
        if way == "luffing":
            yield _luffing_length_row(result, length)
        pressures = {side: Extremes.from_summary(of) for side in OIL_SIDES if (of := cylinder.get(f"pressure_{side}"))}
        for side in sorted(pressures, key=lambda side: pressures[side].most)[-1:]:
            most = pressures[side].largest
            text = f"{format_quantity(most.value, 'Pa')}, {OIL_SIDES[side]}, {_extreme_clause(result, most)}"
            yield LargestValue(QUANTITIES["driven_pressure"].reported, text)
        if flow := cylinder.get("flow_supply"):
            most, power = Extremes.from_summary(flow).largest, cylinder["power_supply"]["max"]
            text = f"{format_quantity(most.value, 'm^3/s')}, {format_quantity(power, 'W')} at most"
            yield LargestValue("largest flow from the supply", f"{text}, {_extreme_clause(result, most)}")


def _luffing_length_row(result: RunResult, length: Summary) -> LargestValue:
    """Row on the length of the luffing cylinder, and on the stroke that the scene states.

    The row has a share of what is allowed only where a given angle needs a length beyond the stroke.  A cylinder that
    turns the boom has stops, which are springs: on a stop it is a little beyond its stroke.
    """
    least, most = length["min"], length["max"]
    text, frame = format_range(least, most, f"{SPACE}m"), result.scene.frame
    if frame is None or frame.cylinder is None or frame.cylinder.stroke is None:
        return LargestValue(LUFFING_LENGTH, text)
    low, high = frame.cylinder.stroke
    text += f"; its stroke is {format_range(low, high, f'{SPACE}m')}"
    beyond = max(low - least, most - high) / (high - low)
    if has_free_luffing(result) or beyond < ROUND_OFF:
        return LargestValue(LUFFING_LENGTH, text)
    return LargestValue(
        LUFFING_LENGTH, f"{text}, and the given angles need {format_percent(beyond)} more", 1.0 + beyond
    )


def _speed_rows(result: RunResult) -> LargestValues:
    """Yield a row with the largest speeds of extensions, luffing and slewing; nothing if none of them moves."""
    t, frame, texts = result.responses["reduced"].t, result.frame, list[str]()
    for number, name in enumerate(result.paths.names):
        if not is_alone(result) and (most := float(np.abs(result.paths.rates[:, number]).max())) > 0.0:
            texts.append(f"{name} slides at up to {format_quantity(most, 'm/s')}")
    for name, angle in zip(("luffing", "slewing"), () if frame is None else frame.angles, strict=False):
        if (most := float(np.rad2deg(np.abs(angle.rate(t)).max()))) > 0.0:
            texts.append(f"{name} at up to {significant(most)}°/s")
    if texts:
        yield LargestValue("largest speeds", ", ".join(texts))


def _push_or_pull(force: Extreme) -> str:
    """Verb for the sign of a cylinder's force: ``pushes`` if the force is positive, else ``pulls``."""
    return "pushes" if force.value > 0.0 else "pulls"


def _deflection_rows(result: RunResult) -> LargestValues:
    """Yield a row with the largest tip displacement in each direction in which this displacement exceeds round-off.

    Where a mass on a wheel crosses other sections, the rows have its displacement, and the largest ones of these.
    """
    response, mover = result.responses["reduced"], crossing(result)
    called = f"largest displacement of {mover}" if mover else QUANTITIES["tip"].reported
    sizes = {
        direction: what(response)
        for direction, what in tip_displacements(result).items()
        if not is_round_off(result, what)
    }
    for direction, values in sizes.items():
        largest = Extremes.from_history(values, response.t, result.abscissa_at(response.t)).largest
        row, size = f"{called}, {direction_words(result, direction)}", _deflection_text(direction, largest.value)
        is_turned = result.frame is not None or is_raised(result)
        if direction == "z" and is_turned:  # neither up nor down in space
            side = "above" if largest.value > 0.0 else "below"
            size = f"{format_length(abs(largest.value))} {side} its straight axis"
        yield LargestValue(row, f"{size}, {_extreme_clause(result, largest)}")
        if direction == "z" and is_turned and (angles := elevation(result, response.t)) is not None:
            of = values * np.cos(angles)
            largest = Extremes.from_history(of, response.t, result.abscissa_at(response.t)).largest
            text = f"{_deflection_text('z', largest.value)}, {_extreme_clause(result, largest)}"
            yield LargestValue(f"{called}, vertical part", text)
    for line in axis_points(result, response)[:-1] if mover else ():
        deflections = line.displacements(response)
        k = int(np.abs(deflections).max(axis=0).argmax())
        largest = Extremes.from_history(deflections[:, k], response.t, result.abscissa_at(response.t)).largest
        where = f"{_deflection_text('z', largest.value)}, {_round(line.x[k])}{SPACE}m from its tail"
        yield LargestValue(f"largest deflection of {line.body}", f"{where}, {_extreme_clause(result, largest)}")


def _further_output_rows(result: RunResult) -> LargestValues:
    """Yield a row for each output that is measured but that no ``[[probes]]`` asks for, such as the tip's rotation."""
    response, probes = result.responses["reduced"], {probe["name"] for probe in result.summary.get("probes", ())}
    units = dict(zip(response.other_names, response.other_units, strict=True))
    for name, values in QUANTITIES["probe"].histories(response).items():
        if name not in probes:
            most = Extremes.from_history(values, response.t, result.abscissa_at(response.t)).largest
            is_angle, value = units[name] == "rad", most.value
            size = f"{significant(np.rad2deg(value))}°" if is_angle else format_quantity(value, units[name])
            yield LargestValue(f"largest {name}", f"{size}, {_extreme_clause(result, most)}")


def _deflection_text(direction: str, value: float) -> str:
    """Format a deflection of `value` m along y or z by its size and its way in words."""
    way = {"y": ("right", "left"), "z": ("down", "up")}[direction][int(value > 0.0)]
    return f"{format_length(abs(value))} {way}"


def _machine_rows(result: RunResult) -> LargestValues:
    """Yield a row with the ranges of a moving machine's free coordinates: displacements of the pivot, and rotations."""
    frame = result.frame
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
        parts.append(f"{key} {format_range(size * motion['min'], size * motion['max'], unit)}")
    if parts:
        yield LargestValue("motion of the machine", ", ".join(parts))


def _ground_rows(result: RunResult) -> LargestValues:
    """Yield rows with the smallest force of an outrigger, the least margin against tipping and the polygon's use."""
    if (ground := result.summary.get("ground")) is None:
        return
    for key, rows in (
        ("outrigger_rest", ground["outriggers"]),
        ("tipping_margin", ground["margins"]),
        ("tipping", [ground["use"]]),
    ):
        quantity, extremes = QUANTITIES[key], {row["name"]: Extremes.from_summary(row) for row in rows}
        name = min(extremes, key=lambda name: extremes[name].least)
        value = quantity.value(extremes[name])
        is_use = key == "tipping"
        text = f"{format_percent(value.value)} (100{SPACE}%: it tips)" if is_use else (
            f"{format_quantity(value.value, quantity.unit)}, {name}"
        )  # fmt: skip
        error = _margin_error(result) if key == "tipping_margin" else ""
        text = f"{text}, {_extreme_clause(result, value)}{error}"
        yield LargestValue(quantity.reported, text, value.value if is_use else None)


def _margin_error(result: RunResult) -> str:
    """Clause with the error of a margin against tipping: that of the boom's moment, of pin and luffing cylinder.

    The moments of the machine's masses are exact for their given places.
    """
    summed, names = errors.summed_errors(result.summary), [f"{PIVOT}{axis}" for axis in ("rx", "ry")]
    labels = [label for label in MARGIN_ERRORS if label in summed.by_label]
    moments = [Extremes.from_summary(of).size for of in result.summary.get("reactions", ()) if of["name"] in names]
    if not labels or not moments or any({"model", "mesh"} & {*summed.lacking[label]} for label in labels):
        return "; its error is not known"
    size = format_quantity(max(summed.by_label[label] for label in labels) * max(moments), "N m", 2)
    return (
        f"; ± {size} by the errors of the boom's moment{summed.lacking_clause(*labels)}; masses of the machine are as "
        "given, and ground and chassis do not give way"
    )


def _frequency_rows(result: RunResult) -> LargestValues:
    """Yield a row with the lowest natural frequency over the path and with its position; nothing if none is known.

    A frequency below the share `ROUND_OFF` of the highest frequency is printed as 0.
    """
    frequencies = result.frequencies.models.get("reduced")
    if frequencies is None or not frequencies.size or not np.isfinite(frequencies[:, 0]).any():
        return
    k = int(np.nanargmin(frequencies[:, 0]))
    lowest, where = float(frequencies[k, 0]), _position_text(result, float(result.frequencies.along[k]))
    where = f", {'with' if crossing(result) else 'at'} {where}" if where else ""
    if lowest > ROUND_OFF * np.nanmax(frequencies):
        masses = [f"{of.name} {format_input(of.mass, 'kg')}" for part in result.scene.sections for of in part.masses]
        closed = f", with {' and '.join(masses)}" if masses else ""
        closed += ", without the payload of the hoist" if result.scene.hoist is not None else ""
        closed += _locked_clause(result)
        way = result.summary.get("lowest_mode", {}).get("direction", "")
        where = f"{TIP_MOVES[way]}{where}" if way in TIP_MOVES else where
        yield LargestValue(
            QUANTITIES["frequency"].reported,
            f"{significant(lowest)}{SPACE}Hz{where}{closed}{_closed_pads_clause(result)}",
        )
    else:
        yield LargestValue(QUANTITIES["frequency"].reported, f"0{where}")


def _locked_clause(result: RunResult) -> str:
    """Clause that a luffing cylinder which gives way is locked here; empty for a given luffing angle."""
    if not has_free_luffing(result):
        return ""
    cylinder = None if result.scene.frame is None else result.scene.frame.cylinder
    on = {"oil": "on its oil", "length": "on its spring"}
    springs = [on[drive] for drive in (cylinder.drives if cylinder is not None else ()) if drive in on]
    load = " and with the payload of the hoist" if result.scene.hoist is not None else ""
    return ", the luffing cylinder locked" + "".join(
        f": {spring}{load} the boom swings up and down more slowly" for spring in springs
    )


def _extreme_clause(result: RunResult, extreme: Extreme) -> str:
    """Clause with the time of an extreme value, and with the reach (or path coordinate) and the angles at that time."""
    where = ", ".join(filter(None, (f"at {format_time(extreme.t)}", _position_text(result, extreme.s))))
    return f"{where}{_angles_clause(result, extreme.t)}"


def _angles_clause(result: RunResult, t: float) -> str:
    """Clause that a sentence ends with: luffing and slewing angle in degrees of a boom in a frame at `t` in s.

    It begins with a comma (", raised 30°, slewed 10°").  An angle that the frame does not set is left out; without a
    frame the clause is empty.
    """
    frame = result.frame
    if frame is None:
        return ""
    luffing, slewing = (float(np.rad2deg(angle.value(np.array([t]))[0])) for angle in frame.angles)
    angles = [] if frame.luffing is None else [f"raised {format_input(round(luffing, 1))}°"]
    angles += [] if frame.slewing is None else [f"slewed {format_input(round(slewing, 1))}°"]
    return "".join(f", {angle_text}" for angle_text in angles)


def _position_text(result: RunResult, position: float) -> str:
    """Describe `position` in m: the length of a boom, the length of a section beyond its mouth, or s of the sliders.

    The text is empty for a body that does not slide.
    """
    if mover := crossing(result):
        return f"{mover} at {_round(position)}{SPACE}m"
    if not is_alone(result):
        return f"boom length {_round(position)}{SPACE}m"
    if moving_part(result) == "mouth":
        return f"{_round(reach_of(result) - position)}{SPACE}m out"
    return f"s = {_round(position)}{SPACE}m" if moving_part(result) else ""


def _round(value: float) -> str:
    """Format the number `value`, rounded to two decimals."""
    return format_input(round(value, 2))
