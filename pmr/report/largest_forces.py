"""Rows of the first page on forces of cylinders, pads, supports and ropes, on the machine, and on the ground."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pmr.files.arrays import Summary
from pmr.report import trust
from pmr.report.numbers import MINUS, SPACE, format_input, format_length, format_percent, format_quantity, significant
from pmr.report.overview import format_range
from pmr.report.sentences import LargestValue, LargestValues, extreme_clause, largest_value, value_at
from pmr.report.subject import (
    drive_of,
    has_free_luffing,
    luffing_stand_ins,
    luffing_support_names,
    play_clause,
    play_ratio,
    play_summary,
    play_words,
    shown_force_name,
    support_words,
)
from pmr.results import RunResult
from pmr.results.quantities import FORCE_OF, QUANTITIES, REACTION_OF, resultant_name
from pmr.results.response import Extreme, Extremes
from pmr.scene.built import Support
from pmr.scene.keys import cylinder_name, qualified_name
from pmr.scene.mechanism import AT_GROUND, AT_PIVOT
from pmr.scene.members import members

#: Where the hook is beside its head for a swing below and above 0, along and across the boom.
SWING_SIDES = {"along": ("inwards of", "outwards of"), "across": ("to the right of", "to the left of")}
#: Keys of the forces and moments whose largest values have a row; those of the luffing cylinder and of a free extension
#: have rows of their own.
FORCES = tuple(
    key for key, quantity in QUANTITIES.items() if quantity.unit in ("N", "N m") and quantity.reported
    and key not in ("luffing_force", "extension_force")
)  # fmt: skip
#: Beginnings of the names of reactions at the pivot, of outputs of a machine that moves, and of forces on the ground.
PIVOT, MACHINE, GROUND = f"{AT_PIVOT} ", "machine ", f"{AT_GROUND} "
#: Kinds of the outputs with the forces of a key, unless the summary has them.
OF_KINDS = {"pad_force": "pad", "cylinder_force": "cylinder", "support": "support", "outrigger_force": "outrigger"}
#: Words for the chambers of a cylinder.
OIL_SIDES = {"bore": "in the bore", "rod": "on the rod side"}
#: End of the name of a cylinder that moves sections by ropes.
ROPES = "which pulls the ropes"
#: What the force of a lug takes for granted; the distance between both lugs is to be filled in.
LUGS = (
    "; both lugs, {} apart, are taken to share the force across the pin evenly and to bear its moment as a couple, and "
    "this lug to bear all of the force along the pin"
)
#: Difference that another play of pads makes to a share of a limit up to which the row on the share does not state it.
SHOWN_BY_PLAY = 0.01
#: Keys of the quantities whose errors are those of the boom's moment on its machine.
MARGIN_ERRORS = ("reaction", "support_force")


def force_rows(result: RunResult) -> LargestValues:
    """Yield rows on what bears or drives the boom: cylinders, pads, walls, hoist, supports, machine and ground."""
    yield from _driven_rows(result)
    yield from _pressure_rows(result)
    yield from _indentation_rows(result)
    yield from _hoist_rows(result)
    yield from _forces_by_kind_rows(result)
    yield from _support_use_rows(result)
    yield from _dynamic_factor_rows(result)
    yield from _machine_rows(result)
    yield from _ground_rows(result)


def _driven_rows(result: RunResult) -> LargestValues:
    """Yield rows on the luffing cylinder and on the drive of a computed extension: largest force, length, and oil.

    If the scene limits the luffing cylinder's force, a row has the largest used share of this limit.  If force and
    share are largest at the same time, one row states both.  There are no rows on a luffing cylinder whose force is not
    known, nor on an extension that is prescribed.
    """
    for way in ("luffing", "extension"):
        if (cylinder := result.summary.get(f"{way}_cylinder")) is None:
            continue
        force, length = Extremes.from_summary(cylinder["force"]).largest, cylinder["length"]
        text = value_at(result, replace(force, value=abs(force.value)), "N", f"it {_push_or_pull(force)}")
        use = Extremes.from_summary(cylinder["use"]).highest if cylinder.get("use") else None
        if way == "luffing":
            if use is None or use.t != force.t:  # else the row on the use has this force
                yield largest_value("luffing_force", text)
            yield _luffing_length_row(result, length)
        else:
            text += f"; {format_range(length['min'], length['max'], f'{SPACE}m out')}"
            yield largest_value("extension_force", text)
        if use is not None:
            note = f"{extreme_clause(result, use)}; allowed: {_allowed_forces_words(result)}"
            figure = f"{format_quantity(abs(force.value), 'N')}, it {_push_or_pull(force)}" if use.t == force.t else ""
            supports = luffing_stand_ins(result.scene) or members(result.scene)[0].part.supports
            gives = result.scene.holding_cylinder is not None or any(of.stiffness != "rigid" for of in supports)
            of_force = "support_force" if gives else "reaction"
            play = play_ratio(result, "luffing_force", "", abs(force.value)) if use.t == force.t else None
            yield _use_row(result, "luffing_use", figure, use.value, "the allowed force", note, of_force, play=play)
        pressures = {side: Extremes.from_summary(of) for side in OIL_SIDES if (of := cylinder.get(f"pressure_{side}"))}
        for side in sorted(pressures, key=lambda side: pressures[side].highest.value)[-1:]:
            yield largest_value("driven_pressure", value_at(result, pressures[side].largest, "Pa", OIL_SIDES[side]))
        if flow := cylinder.get("flow_supply"):
            power = f"{format_quantity(cylinder['power_supply']['max'], 'W')} at most"
            text = value_at(result, Extremes.from_summary(flow).largest, "m^3/s", power)
            yield largest_value("driven_flow", text, name="largest flow from the supply")


def _allowed_forces_words(result: RunResult) -> str:
    """Words for the forces that the luffing cylinder bears: push, pull, and the force that buckles its rod.

    The buckling force is that at the greatest length of the run.  Limits that the scene does not state are left out.
    """
    cylinder, greatest = result.scene.present_frame.cylinder, result.summary["luffing_cylinder"]["length"]["max"]
    assert cylinder is not None  # as its force is known
    forces = {"push": cylinder.allowed_push, "pull": cylinder.allowed_pull}
    words = [f"{format_quantity(force, 'N')} of {way}" for way, force in forces.items() if force is not None]
    if cylinder.rod is not None:
        of_rod = cylinder.model_copy(update={"allowed_push": None})
        buckles = float(of_rod.allowed_forces(greatest).push)
        words.append(f"less than {format_quantity(buckles, 'N')}, which buckles the rod at {format_length(greatest)}")
    return ", ".join(words)


class UsedSupport(NamedTuple):
    """Support that uses the largest share of its `allowed` force in N, with its name in results and its extremes in N.

    A pin with lugs is compared by the force of one lug: of the one that bears more.
    """

    name: str
    support: Support
    allowed: float
    extremes: Extremes


def _used_support(result: RunResult) -> UsedSupport | None:
    """Return the support that uses the largest share of its allowed force; None if no force in the summary has one."""
    extremes = {of["name"]: Extremes.from_summary(of.get("lug", of)) for of in result.summary.get("supports", ())}
    limited = [
        UsedSupport(name, support, support.allowed_force, extremes[name])
        for body, part in result.scene.bodies.items()
        for support in part.supports
        if support.allowed_force is not None and (name := resultant_name(body, support)) in extremes
    ]
    return max(limited, key=lambda of: of.extremes.size / of.allowed, default=None)


def _support_use_rows(result: RunResult) -> LargestValues:
    """Yield a row on the support that uses most of its allowed force: force, share and time; nothing without one."""
    if (used := _used_support(result)) is not None:
        spacing = used.support.lug_spacing
        of_force = "reaction" if used.support.stiffness == "rigid" else "support_force"
        of, key = f"the allowed {format_quantity(used.allowed, 'N')}", "support" if spacing is None else "lug_force"
        note = f"{_bearer_words('support', used.name)}, {extreme_clause(result, used.extremes.largest)}"
        note += _moment_clause(result, used) if spacing is None else LUGS.format(format_input(spacing, "m"))
        size = used.extremes.size
        play, figure = play_ratio(result, key, used.name, size), format_quantity(size, "N")
        figure += "" if spacing is None else " on one lug"
        yield _use_row(result, "support_use", figure, size / used.allowed, of, note, of_force, play=play)


def _moment_clause(result: RunResult, used: UsedSupport) -> str:
    """Clause on the largest moment of a support that the used share of its allowed force does not contain.

    The clause is empty if the support `used` bears no moment.
    """
    names = [
        qualified_name(body, used.support.row_name(direction))
        for body in result.scene.bodies
        if resultant_name(body, used.support) == used.name
        for direction in used.support.held_directions
    ]
    reactions = [of for of in result.summary.get("reactions", ()) if of["unit"] == "N m" and of["name"] in names]
    sizes = [Extremes.from_summary(of).size for of in reactions]
    if not any(sizes):
        return ""
    return (
        f"; this is the resultant of its forces, without its moments of up to {format_quantity(max(sizes), 'N m')}, "
        "which the force of a lug contains (key lug_spacing of the support)"
    )


def _luffing_length_row(result: RunResult, length: Summary) -> LargestValue:
    """Row on the range of the luffing cylinder's length, beside the stroke that the scene states.

    `length` is the entry of the summary on this length.  The row has a used share, above 1, only if prescribed angles
    need a length beyond the stroke.  For a computed angle it has none: the stops of the cylinder are springs, so that
    on a stop its length is a little beyond the stroke.
    """
    least, most, frame = length["min"], length["max"], result.scene.frame
    text, share = format_range(least, most, f"{SPACE}m"), None
    if frame is not None and frame.cylinder is not None and frame.cylinder.stroke is not None:
        low, high = frame.cylinder.stroke
        text += f"; its stroke is {format_range(low, high, f'{SPACE}m')}"
        if (beyond := frame.cylinder.beyond_stroke((least, most))) and not has_free_luffing(result):
            text += f", and the given angles need {format_percent(beyond)} more"
            share = 1.0 + beyond
    return largest_value("driven_length", text, share, "length of the luffing cylinder")


def _use_row(
    result: RunResult, key: str, figure: str, share: float, of: str, note: str, of_force: str, least: float = 1.0,
    play: float | None = None,
) -> LargestValue:  # fmt: skip
    """Row of the quantity `key`: a `figure`, the `share` that it is of a limit, and this share with all known errors.

    `of` are words for the limit, and `note` is the second line of the text.  The figure may be empty.  With errors, the
    share is larger by the error of the force with the key `of_force`, summed over all sources.  It is then divided by
    `least`, the smallest value of the limit as a share of its stated value, 1 if the limit is exact.  The result is
    infinite if `least` is not above 0.  If the error of the force is not known, the row has the `share` alone.  `play`
    is the ratio of the force with another play of pads to that of this run (`play_ratio`), None if it is not known.
    """
    error = trust.summed_errors(result.summary).by_key.get(of_force)
    with_errors = None if error is None else share * (1.0 + error) / least if least > 0.0 else np.inf
    text = f"{figure}: {format_percent(share)} of {of}".removeprefix(": ")
    if with_errors is not None:
        most = format_percent(with_errors) if np.isfinite(with_errors) else "no bound"
        text += f", {most} with all known errors"
    with_play = None if play is None else share * play
    if with_play is not None and with_play - share > SHOWN_BY_PLAY:
        text += f", {format_percent(with_play)} {play_words(play_summary(result)['gap'])}"
    row = largest_value(key, f"{text}\n{note}", share)
    return row._replace(share_with_errors=with_errors, share_with_play=with_play)


def _push_or_pull(force: Extreme) -> str:
    """Verb for the sign of a cylinder's force: ``pushes`` if the force is positive, else ``pulls``."""
    return "pushes" if force.value > 0.0 else "pulls"


def _pressure_rows(result: RunResult) -> LargestValues:
    """Yield a row with the largest mean pressure of a pad, and one with the largest share of an allowed pressure.

    If one pad has both, only the second row is yielded, as it states the pressure, too.  Pads without a pressure, and
    without an allowed one, have no row.
    """
    if pads := [pad for pad in result.summary.get("pads", ()) if "pressure" in pad]:
        pad = max(pads, key=lambda pad: float(pad["pressure"]))
        limited = [of for of in pads if "allowed_pressure" in of]
        used = max(limited, key=lambda of: float(of["pressure"] / of["allowed_pressure"]), default=None)
        if used is not pad:  # else the row on the use has this pressure
            pressed = replace(Extremes.from_summary(pad).largest, value=pad["pressure"])
            yield largest_value("pad_pressure", value_at(result, pressed, "Pa", pad["name"]))
        if used is not None:
            note = f"{used['name']}, {extreme_clause(result, Extremes.from_summary(used).largest)}"
            figure, of = (format_quantity(used[key], "Pa") for key in ("pressure", "allowed_pressure"))
            share = used["pressure"] / used["allowed_pressure"]
            play = play_ratio(result, "pad_force", "", Extremes.from_summary(used).size)
            yield _use_row(result, "pad_use", figure, share, of, note, "pad_force", play=play)


def _indentation_rows(result: RunResult) -> LargestValues:
    """Yield a row with the largest indentation of walls under a pad's own force; nothing if all walls are rigid."""
    if rows := result.summary.get("indentations"):
        row = max(rows, key=lambda row: float(row["value"]))
        when = extreme_clause(result, Extreme(row["value"], row["t"], row["s"]))
        yield largest_value("indentation", f"{format_length(row['value'])}, {row['name']}\n{when}")


def _hoist_rows(result: RunResult) -> LargestValues:
    """Yield rows with the range of the hook's height and its largest swing, along or across the boom.

    Nothing is yielded without a hoist.
    """
    if (hoist := result.summary.get("hoist")) is None:
        return
    height = " to ".join(format_quantity(hoist["height"][end], "m") for end in ("min", "max"))
    yield largest_value("hook_height", height, name="height of the hook")
    swings = {way: Extremes.from_summary(hoist[f"swing_{way}"]).largest for way in SWING_SIDES}
    way = max(swings, key=lambda name: abs(swings[name].value))
    largest = swings[way]
    text = f"{format_quantity(abs(largest.value), 'rad')} {way} the boom, the hook "
    text += f"{SWING_SIDES[way][int(largest.value > 0.0)]} the head\n{extreme_clause(result, largest)}"
    yield largest_value("swing", text)


def _forces_by_kind_rows(result: RunResult) -> LargestValues:
    """Yield a row for each kind of force or moment in `FORCES`: its largest value, the part that bears it, its time.

    A kind that is 0 at all times has no row, except for supports.  Some rows are left out because others say more:

    - Forces on the ground, if the machine has outriggers.
    - The force of a support or lug, if a row states which share of an allowed force it uses.

    The row of pad forces is followed by the row on the force at which walls yield, if this force is known.
    """
    used = _used_support(result)
    for key, forces in _extremes_of_forces(result).items():
        name, unit = max(forces, key=lambda name: forces[name].size, default=""), QUANTITIES[key].unit  # noqa: B023
        if not forces or (not forces[name].size and key != "support"):
            continue
        if key in ("ground_force", "ground_moment") and "ground" in result.summary:
            continue  # outriggers and the margin against tipping say what they mean
        if (
            used is not None
            and name == used.name
            and key == ("support" if used.support.lug_spacing is None else "lug_force")
        ):
            continue
        largest = forces[name].largest
        if not largest.value:
            yield largest_value(key, f"0{SPACE}{unit}, {name}")
        elif key == "cylinder_force" and not name.endswith(ROPES):
            pushed = replace(largest, value=abs(largest.value))
            yield largest_value(key, value_at(result, pushed, unit, f"{name} {_push_or_pull(largest)}"))
        else:
            play, words = play_clause(result, key) if key == "pad_force" else "", _bearer_words(key, name)
            if key.startswith("machine") and largest.value < 0.0:  # along the opposite axis
                head, _, axis = words.partition(" ")
                words, largest = f"{head} {MINUS}{axis}", replace(largest, value=-largest.value)
            yield largest_value(key, value_at(result, largest, unit, words), end=play)
            if key == "pad_force":
                yield from _yield_rows(result, forces)


def _dynamic_factor_rows(result: RunResult) -> LargestValues:
    """Yield one row that lists the dynamic factors: the largest forces of this motion divided by the forces at rest.

    The forces at rest are those in the same posture, under the same loads.  Nothing is yielded if the summary has no
    ``dynamic_factors``.  If supports have factors of their resultants, the factors of the resultants' components are
    left out.
    """
    rows = result.summary.get("dynamic_factors", ())
    hidden = "reaction" if any(row["kind"] == "resultant" for row in rows) else ""
    factors = [
        f"{_factor_words(row)} {row['largest'] / row['rest']:.2f} ({_rest_text(row)} at rest)"
        for row in rows
        if row["kind"] != hidden
    ]
    if factors:
        text = f"{', '.join(factors)}\n"
        text += "largest value divided by the value at rest (in the same posture, under the same loads)"
        yield LargestValue("dynamic factors", text, place="machine")


def _factor_words(row: Summary) -> str:
    """Words for the force of `row`, a dynamic factor in a summary, such as ``pin of base, along x`` for a reaction."""
    if row["kind"] == "resultant":
        return f"resultant of {_bearer_words('support', row['name'])}"
    if row["kind"] == "reaction":
        return support_words(row["name"].removeprefix(REACTION_OF))
    return shown_force_name(row["name"]).replace(FORCE_OF, "", 1)


def _rest_text(row: Summary) -> str:
    """Text of the value at rest in `row`, an entry of dynamic factors in a summary.

    It is the amount of a force in N, without its sign.  For tipping it is a share in per cent.
    """
    return format_percent(row["rest"]) if row["kind"] == "tipping" else format_quantity(abs(row["rest"]), "N")


def _bearer_words(key: str, name: str) -> str:
    """Words for the part called `name` that bears a force or moment of the kind `key`.

    The part is a support of a section, an outrigger, an axis of the boom, or another part whose name is returned as it
    is.
    """
    if key.startswith("machine"):
        return f"{name} of the boom's own axes"
    if key == "outrigger_force":
        return name.removeprefix("outrigger ")
    return support_words(name) if key in ("support", "support_moment", "lug_force") and ": " in name else name


def _yield_rows(result: RunResult, forces: Mapping[str, Extremes]) -> LargestValues:
    """Yield a row with the pad whose force comes nearest to the force at which the walls under it begin to yield.

    `forces` are the extremes of the forces, by pad.  Nothing is yielded if the yield forces were not computed
    (`pmr.fullmodel.wall_stress.yield_forces`).
    """
    limits = (result.summary.get("budget", {}).get("model") or {}).get("pad_yield", {})
    shares = {
        name: (extremes.size / limit["force"], limit)
        for name, extremes in forces.items()
        if (limit := limits.get(name)) is not None
    }
    if shares:
        pad = max(shares, key=lambda name: shares[name][0])
        share, limit = shares[pad]
        force, bar = format_quantity(limit["force"], "N"), format_quantity(limit["error"], "N", 2)
        even = format_quantity(limit["even"], "N")
        note = (
            f"pad {pad}, {extreme_clause(result, forces[pad].largest)}; the walls of section {limit['section']} begin "
            f"to yield at {force} of this pad alone if it presses most at its centre, at {even} (no error bar) if it "
            "presses evenly, both at the weakest place along its way; these forces leave out the bending of the boom, "
            "which the largest von Mises stress in walls contains; ± is by the mesh of the walls"
        )
        least, name = 1.0 - limit["error"] / limit["force"], "largest use of the pad force at which walls yield"
        figure = format_quantity(forces[pad].size, "N")
        play = play_ratio(result, "pad_force", "", forces[pad].size)
        row = _use_row(result, "pad_force", figure, share, f"{force} ± {bar}", note, "pad_force", least, play)
        yield row._replace(name=name)


def _extremes_of_forces(result: RunResult) -> dict[str, dict[str, Extremes]]:
    """Least and largest forces and moments, by their kinds in `FORCES` and by the names of the parts that bear them.

    Supports that model the luffing cylinder are left out, and so are forces of pads, cylinders, supports and outriggers
    that are round-off at all times.  A cylinder that pulls ropes is included once, with the force with which it pulls.
    """
    response, summary = result.responses["reduced"], result.summary
    by_key = {key: dict[str, Extremes]() for key in FORCES}
    frame, resultants = result.frame, summary.get("supports", ())
    for support in resultants:
        if support["name"] not in luffing_support_names(result):
            by_key["support"][_full_name(result, support["name"])] = Extremes.from_summary(support)
            if "lug" in support:
                by_key["lug_force"][support["name"]] = Extremes.from_summary(support["lug"])
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
        if by_key[key] and kind != "cylinder":  # the summary has only those cylinders that pull ropes, or are pulled
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


def _machine_rows(result: RunResult) -> LargestValues:
    """Yield a row with the ranges of a moving machine's free coordinates: displacements of the pivot, and rotations.

    Nothing is yielded without a machine whose motion is computed.
    """
    frame = result.frame
    if frame is None or frame.machine is None:
        return
    motions = result.summary.get("frame", {}).get("base", {})
    degrees = 1.0 if frame.unit == "degrees" else np.rad2deg(1.0)
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
    """Yield rows with the smallest force of an outrigger, the least margin against tipping and the use of the polygon.

    The first two rows name the outrigger or the edge of the support polygon.  The row of the polygon's use names
    neither; it has a time and says that the machine tips at 100 %.  Nothing is yielded if the summary has no forces on
    the ground.
    """
    if (ground := result.summary.get("ground")) is None:
        return
    for key, rows in (
        ("outrigger_rest", ground["outriggers"]),
        ("tipping_margin", ground["margins"]),
        ("tipping", [ground["use"]]),
    ):
        quantity, extremes = QUANTITIES[key], {row["name"]: Extremes.from_summary(row) for row in rows}
        name = min(extremes, key=lambda name: extremes[name].lowest.value)
        value = quantity.reported_extreme(extremes[name])
        if key == "tipping":
            text = f"{format_percent(value.value)} (the machine tips at 100{SPACE}%)\n{extreme_clause(result, value)}"
            ratio = play_ratio(result, key, "", value.value)
            with_play = None if ratio is None else value.value * ratio
            yield largest_value(key, text, value.value)._replace(share_with_play=with_play)
        else:
            where, error = (f"edge from {name}", _margin_error(result)) if key == "tipping_margin" else (name, "")
            yield largest_value(key, value_at(result, value, quantity.unit, where), end=error)


def _margin_error(result: RunResult) -> str:
    """Clause with the error of a margin against tipping in N m.

    This is the error of the boom's moment about the pivot, which comes from pin and luffing cylinder.  The moments of
    the machine's masses have no error, as their places are given.  If a part of the error is missing, the clause says
    that the error is not known.
    """
    summed, names = trust.summed_errors(result.summary), [f"{PIVOT}{axis}" for axis in ("rx", "ry")]
    keys = [key for key in MARGIN_ERRORS if key in summed.by_key]
    moments = [Extremes.from_summary(of).size for of in result.summary.get("reactions", ()) if of["name"] in names]
    if not keys or not moments or any({"model", "mesh"} & {*summed.lacking[key]} for key in keys):
        return "; its error is not known"
    size = format_quantity(max(summed.by_key[key] for key in keys) * max(moments), "N m", 2)
    return (
        f"; ± {size} by the errors of the boom's moment{summed.lacking_clause(*keys)}, without those of the masses "
        "of the machine"
    )
