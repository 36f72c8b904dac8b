"""Tables of the first page: what was simulated, what the structure carries, how far the results may be trusted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pmr.files.arrays import Summary
from pmr.report import overview, sentences, trust
from pmr.report.blocks import Table
from pmr.report.columns import axis_points, is_round_off, tip_displacements
from pmr.report.largest_forces import force_rows
from pmr.report.numbers import (
    SPACE,
    format_input,
    format_length,
    format_percent,
    format_quantity,
    format_time,
    significant,
)
from pmr.report.sentences import (
    LargestValue,
    LargestValues,
    angles_clause,
    extreme_clause,
    extremes_of,
    largest_value,
    peak_place_clause,
    position_text,
    two_decimals,
    value_at,
    wall_place_clause,
)
from pmr.report.subject import (
    crossing,
    direction_words,
    elevation,
    has_free_luffing,
    has_pushing_pads,
    is_alone,
    is_raised,
    play_clause,
    play_ratio,
    play_summary,
)
from pmr.results import RunResult
from pmr.results.quantities import QUANTITIES, stress_name, stress_remark, wall_stress
from pmr.results.response import Extremes
from pmr.scene.hints import PLAY, Effect, effects_left_out

Rows = Iterator[tuple[str, str]]

#: Clauses on the direction in which a mode moves the tip most.
TIP_MOVES = {"y": ", the tip moves sideways, along y", "z": ", the tip moves up and down, along z"}
#: Words for a number that is computed with every pad closed, in runs with pads that only push.
CLOSED_PADS = "with every pad closed"
#: Note below the table of effects that are left out.
WHERE_KEYS_STAND = "Tables and keys are those of the scene file."
#: Share of the highest natural frequency up to which a frequency is round-off and is printed as 0.
ROUND_OFF = 1e-9


def first_page_tables(result: RunResult) -> tuple[Table, ...]:
    """Build the tables of the first page; tables without rows are left out.

    What was computed stands before the input.  The tables are, in this order: largest values with a limit; the errors
    in brief; what the values leave out; other largest values; what was simulated; and all errors.  If no value has a
    limit, all largest values are in the first table.
    """
    first, *further = _largest_values_tables(result)
    all_tables = (
        first,
        Table("How sure the values are", tuple(trust.certainty_rows(result))),
        Table("What these values leave out, and who checks it", tuple(_left_out_rows(result)), note=WHERE_KEYS_STAND),
        *further,
        Table("What was asked", (*overview.system_rows(result), *_second_order_rows(result, True))),
        trust.trust_table(result),
    )
    return tuple(table for table in all_tables if table.rows)


def _left_out_rows(result: RunResult) -> Rows:
    """Yield a row for each subject, such as pads, with the effects that the scene's model leaves out.

    The effects are those of `pmr.scene.hints.effects_left_out`, and some that depend on the run.  For example, pads
    that lift off are added if frequencies or a buckling factor were computed with every pad closed.  Each effect is
    followed by what checks it, such as ``pmr chart`` or ``by hand``; effects with the same check are listed together.
    If a run in a frame leaves out effects of second order, the last row says so.
    """
    in_walls, recovery = wall_stress(result.summary) is not None, result.scene.recovery
    gap = play_summary(result).get("gap")
    play = f"play other than the assumed {format_input(1e3 * gap, 'mm')}" if gap else PLAY
    effects = effects_left_out(result.scene, play=play, in_walls=in_walls)
    by_chart = "by hand" if result.frame is None else "pmr chart"
    if has_pushing_pads(result) and (result.frequencies.models or "factor" in result.summary.get("buckling", {})):
        forces = [Extremes.from_summary(pad) for pad in result.summary.get("pads", ())]
        opened = [force.size for force in forces if force.lowest.value == 0.0]
        idle = sum(size <= result.responses["reduced"].force_floor for size in opened)
        some, always = f"{len(opened) - idle}", f"{idle} of {len(forces)} always"
        counts = f"{always}, {some} more at times" if idle else f"{some} of {len(forces)} at times"
        counts = f" ({counts if len(opened) > idle else always})" if opened else ""
        resting = "by hand" if result.frequencies.resting is None else "see the lowest natural frequency"
        lowered = {"natural frequencies": resting} if result.frequencies.models else {}
        lowered |= {"the buckling factor": by_chart} if "factor" in result.summary.get("buckling", {}) else {}
        for value, check in lowered.items():
            effects.setdefault("pads", []).append(Effect(f"open pads{counts}, which lower {value}", check))
            counts = ""
    if recovery is not None and "reduced" in result.summary.get("max_von_mises", {}):
        walls = ", in walls also when the force of a pad or support is largest" if in_walls else ""
        every = format_input(recovery.every, "s")
        text = f"stresses between the times at which they are computed (every {every}{walls})"
        effects["strength"].append(Effect(text, "set a smaller key recovery.every"))
    if "loads" in effects:
        effects["loads"].append(Effect("factors of a standard (dynamic, safety)", by_chart))
        if result.frame is not None and any(mass.payload for part in result.scene.sections for mass in part.masses):
            effects["loads"].append(Effect("whether the machine may lift the payload", by_chart))
    for subject, of in effects.items():
        checks = dict.fromkeys(effect.check for effect in of)
        texts = (f"{', '.join(effect.text for effect in of if effect.check == check)}: {check}" for check in checks)
        yield subject, "; ".join(texts)
    yield from _second_order_rows(result, False)


def _second_order_rows(result: RunResult, is_included: bool) -> Rows:
    """Yield a row on the axes of a boom in a frame, and on effects of second order.

    If `is_included` is true, a row is yielded only for a run with effects of second order, else only for a run without
    them.  Nothing is yielded without a frame.
    """
    motion = result.summary.get("frame")
    if motion is not None and bool(motion["second_order"]) is is_included:
        yield "axes, second order", sentences.frame_sentences(result)


def largest_value_rows(result: RunResult) -> Rows:
    """Yield the rows (name, text) of the table of largest values."""
    yield from ((row.name, row.text) for row in largest_values(result))


def _largest_values_tables(result: RunResult) -> list[Table]:
    """Build a table of the largest values that have an allowed value, and a table of the others.

    A table without rows is left out; if neither has rows, the first one is returned, empty.  In the second table, a
    heading stands above the first row of each part of the machine (`HEADINGS`).  There are no headings if all rows
    belong to one part.
    """
    headings, rows = dict[str, str](), largest_values(result)
    limited = [row for row in rows if row.share is not None]
    without_limit = [row for row in rows if row.share is None]
    for row in without_limit:
        if _heading(row) not in headings.values():
            headings[row.name] = _heading(row)
    tables = [
        Table("Largest values that have a limit", tuple((row.name, row.text) for row in limited)),
        Table(
            "Largest values of this motion",
            tuple((row.name, row.text) for row in without_limit),
            headings=headings if len(headings) > 1 else {},
        ),
    ]
    return [table for table in tables if table.rows] or tables[:1]


def largest_values(result: RunResult) -> list[LargestValue]:
    """Rows of the table of largest values, in the order of the page.

    Rows with an allowed value come first, from the largest used share to the smallest, with
    another play of pads if a run had it.  Rows without one follow by the
    part to which they belong, in the order of `PLACES`.
    """
    return sorted(
        _largest_values(result),
        key=lambda row: (0, -row.largest_share) if row.share is not None else (1, PLACES.index(row.place)),
    )


#: Headings of the other rows in their order, with the places of the quantities below each of them.
HEADINGS = {
    "Tip, frequency and speeds": ("tip", "boom", ""),
    "Supports and machine": ("support", "machine", "ground"),
    "Drives": ("cylinder", "rope", "hoist"),
    "Pads": ("pad",),
    "Stress": ("section", "probe"),
}
#: Places of quantities in the order of their rows on the first page.
PLACES = tuple(place for places in HEADINGS.values() for place in places)


def _heading(row: LargestValue) -> str:
    """Heading of a row without an allowed value, by the part to which it belongs."""
    return next(heading for heading, places in HEADINGS.items() if row.place in places)


def _largest_values(result: RunResult) -> LargestValues:
    """Yield all rows of the table of largest values, in no particular order.

    The rows are on stress, fatigue, buckling, deflection and other outputs, frequency, speeds, forces, and motion of
    the machine.
    """
    summary = result.summary
    yield from _stress_rows(result)
    if damages := summary.get("fatigue"):
        worst = damages[0]
        life = "" if worst["life"] is None else f", endured {significant(worst['life'])} times"
        yield largest_value(
            "damage", f"{significant(worst['damage'])} (failure at 1)\n{worst['name']}{life}", worst["damage"]
        )
    if (buckling := summary.get("buckling", {})).get("factor") is not None:
        when = f"at {format_time(buckling['t'])}{angles_clause(result, buckling['t'])}"
        text = f"{significant(buckling['factor'])}\n{when}{f', {CLOSED_PADS}' * has_pushing_pads(result)}"
        yield largest_value("buckling", text)
    yield from _deflection_rows(result)
    yield from _further_output_rows(result)
    yield from _frequency_rows(result)
    yield from _speed_rows(result)
    yield from force_rows(result)


def _stress_rows(result: RunResult) -> LargestValues:
    """Yield one to three rows on the largest von Mises stress and on its share of the yield stress.

    For beams, the first row is that of the stress in walls at pads, if a shell computed it.  Then comes the row of the
    model's largest stress.  This row also states the share of the yield stress, unless the share is larger at another
    point; then that share has a row of its own.  Stresses of beams lack the local bending of walls.  So their share is
    stated as a lower bound, and only if it is above 1.

    If no stress was computed, the only row says so and names the table of the scene that asks for stresses.
    """
    summary = result.summary
    largest = summary.get("max_von_mises", {}).get("reduced")
    if largest is None:
        yield LargestValue("stress", "not computed (table [recovery] of the scene)", place="section")
        return
    peak, used = (summary.get(name, {}).get("reduced") for name in ("stress_peak", "utilisation"))
    stress_text, local, of_beams = format_quantity(largest, "Pa"), "", bool(stress_remark(result.scene))
    if of_beams:
        every = result.scene.recovery.every if result.scene.recovery else 0.0
        at_times = f"; computed every {format_input(every, 's')} at points of the mesh" if every else ""
        local = f"; without the bending of walls under pads{at_times}"
        if (shell := wall_stress(summary)) is not None:
            yield _wall_stress_row(result, shell)
        else:
            local = "; without the bending of walls under pads, which adds to it; by how much is not known"
            local += _missing_clause(summary)
        used = used if used and used["value"] > 1.0 else None
    share, highest = "", used["value"] if used else None
    if used:
        least = "at least " if of_beams else ""
        share = f"{least}{format_percent(used['value'])} of the yield stress of {format_quantity(used['yield'], 'Pa')}"
    if used and used["stress"] == largest:
        stress_text, peak, used = f"{stress_text}: {share}", used, None
    notes = f"{'' if peak is None else peak_place_clause(result, peak)}{local}".removeprefix("; ")
    highest_beside = None if used else highest
    text = "\n".join(filter(None, (stress_text, notes)))
    yield largest_value("stress", text, highest_beside, stress_name(result.scene))
    if used:
        yield largest_value("utilisation", f"{share}\n{peak_place_clause(result, used)}", highest)


def _wall_stress_row(result: RunResult, shell: Summary) -> LargestValue:
    """Row on the largest stress in walls at pads, `shell`: value, error bar, share, place, time, and what it contains.

    `shell` is what `pmr.results.quantities.wall_stress` returns.
    """
    allowed, text, share, with_errors = shell.get("yield"), trust.wall_stress_words(result.summary), None, None
    error, by_pads = trust.wall_stress_error(result.summary), trust.pad_force_error(result.summary)
    if allowed is not None:
        share = shell["value"] / allowed
        text += f": {format_percent(share)} of the yield stress of {format_quantity(allowed, 'Pa')}"
        if error is not None:
            with_errors = share * (1.0 + error)
            text += f", {format_percent(with_errors)} with "
            text += "all known errors" if by_pads is not None else "the error by the mesh of the walls alone"
    text += f"\n{wall_place_clause(result, shell)}; if the pads press most at their centre"
    if "even" in shell:  # which files of earlier versions lack
        even = format_quantity(shell["even_error"] + shell["even"] * (by_pads or 0.0), "Pa", 2)
        text += f"; {format_quantity(shell['even'], 'Pa')} ± {even} if they press evenly"
    text += f"{play_clause(result, 'wall_stress')}; {WALL_STRESS_PARTS}"
    if error is not None:
        text += f"; ± is by the mesh of the walls {'alone' if by_pads is None else 'and the error of the pad forces'}"
    text += _missing_clause(result.summary)
    ratio = play_ratio(result, "wall_stress", "", shell["value"])
    with_play = None if share is None or ratio is None else share * ratio
    return largest_value("wall_stress", text, share)._replace(share_with_errors=with_errors, share_with_play=with_play)


#: What the stress in walls at pads contains.
WALL_STRESS_PARTS = "the bending of walls under pads is included, welds are not"


def _missing_clause(summary: Summary) -> str:
    """Clause on the sections in whose walls the stress at pads is not known, with the reasons; empty if all are known.

    If the summary has neither such a stress nor a reason, the clause says which run computes it.
    """
    model = summary.get("budget", {}).get("model") or {}
    missing = model.get("wall_stress_missing", {})
    if not missing and "wall_stress" not in model:
        return ": a run that also measures the errors of its mesh and model computes it"
    reasons = dict[str, list[str]]()
    for name, reason in missing.items():
        reasons.setdefault(reason, []).append(name or "the body")
    return "".join(f"; not known of {' and '.join(names)}: {reason}" for reason, names in reasons.items())


def _resting_clause(result: RunResult) -> str:
    """Clause on the lowest natural frequency without the pads that are open at rest; empty if it is not known."""
    resting = result.frequencies.resting
    if resting is None or not np.isfinite(resting).any():
        return ""
    lowest = significant(float(np.nanmin(resting)))
    return f"; {lowest}{SPACE}Hz without the pads that are open at rest"


def _speed_rows(result: RunResult) -> LargestValues:
    """Yield a row with the largest speeds of extensions, luffing and slewing; nothing if the boom does not move.

    The motion of a body alone has no speed here.
    """
    t, frame, texts = result.responses["reduced"].t, result.frame, list[str]()
    for number, name in enumerate(result.paths.names):
        if not is_alone(result) and (most := float(np.abs(result.paths.rates[:, number]).max())) > 0.0:
            texts.append(f"{name} slides at up to {format_quantity(most, 'm/s')}")
    for name, angle in zip(("luffing", "slewing"), () if frame is None else frame.angles, strict=False):
        if (most := float(np.rad2deg(np.abs(angle.rate(t)).max()))) > 0.0:
            texts.append(f"{name} at up to {significant(most)}°/s")
    if texts:
        yield LargestValue("largest speeds", ", ".join(texts))


def _deflection_rows(result: RunResult) -> LargestValues:
    """Yield a row with the largest tip displacement in each direction in which this displacement exceeds round-off.

    For a boom that is raised or in a frame, z is at right angles to the boom.  Then a further row has the largest
    vertical part of the displacement along z, unless the base moves or is inclined.  Where a mass on a wheel crosses
    other sections, the rows state the displacement of the mass, and the largest deflection of each of these sections.
    """
    response, mover = result.responses["reduced"], crossing(result)
    called = f"largest displacement of {mover}" if mover else QUANTITIES["tip"].reported
    is_turned = result.frame is not None or is_raised(result)
    for direction, what in tip_displacements(result).items():
        if is_round_off(result, what):
            continue
        values = what(response)
        largest, row = extremes_of(result, values).largest, f"{called}, {direction_words(result, direction)}"
        size = _deflection_text(direction, largest.value)
        if direction == "z" and is_turned:  # neither up nor down in space
            side = "above" if largest.value > 0.0 else "below"
            size = f"{format_length(abs(largest.value))} {side} the boom's straight axis"
        yield largest_value(
            "tip", f"{size}\n{extreme_clause(result, largest)}{play_clause(result, 'tip', direction)}", name=row
        )
        if direction == "z" and is_turned and (angles := elevation(result, response.t)) is not None:
            largest = extremes_of(result, values * np.cos(angles)).largest
            text = f"{_deflection_text('z', largest.value)}\n{extreme_clause(result, largest)}"
            yield largest_value("tip", text, name=f"{called}, vertical part")
    for line in axis_points(result)[:-1] if mover else ():
        deflections = line.displacement[:, :, 2]
        k = int(np.abs(deflections).max(axis=0).argmax())
        largest = extremes_of(result, deflections[:, k]).largest
        where = f"{_deflection_text('z', largest.value)}, {two_decimals(line.x[k])}{SPACE}m from its tail"
        text = f"{where}\n{extreme_clause(result, largest)}"
        yield largest_value("beam", text, name=f"largest deflection of {line.body}")


def _further_output_rows(result: RunResult) -> LargestValues:
    """Yield a row for each output that is measured but that no ``[[probes]]`` asks for, such as the tip's rotation."""
    response, probes = result.responses["reduced"], {probe["name"] for probe in result.summary.get("probes", ())}
    units = dict(zip(response.other_names, response.other_units, strict=True))
    for name, values in QUANTITIES["probe"].histories(response).items():
        if name not in probes:
            text = value_at(result, extremes_of(result, values).largest, units[name])
            yield LargestValue(f"largest {name}", text)


def _deflection_text(direction: str, value: float) -> str:
    """Format a deflection of `value` m along the `direction` y or z: its size, then its side, such as left or up."""
    way = {"y": ("right", "left"), "z": ("down", "up")}[direction][int(value > 0.0)]
    return f"{format_length(abs(value))} {way}"


def _frequency_rows(result: RunResult) -> LargestValues:
    """Yield a row with the lowest natural frequency over the path; nothing if none is known.

    The row also says where on the path the frequency is lowest, and in which direction its mode moves the tip.  It
    names the masses, and says if the pads count as closed or the luffing cylinder as locked.  It adds the lowest
    frequency without pads that are open at rest, if this is known.  A frequency below the share `ROUND_OFF` of the
    highest frequency is printed as 0.
    """
    frequencies = result.frequencies.models.get("reduced")
    if frequencies is None or not frequencies.size or not np.isfinite(frequencies[:, 0]).any():
        return
    k = int(np.nanargmin(frequencies[:, 0]))
    lowest, where = float(frequencies[k, 0]), position_text(result, float(result.frequencies.along[k]))
    size, notes = "0", [f"{'with' if crossing(result) else 'at'} {where}" if where else ""]
    if lowest > ROUND_OFF * np.nanmax(frequencies):
        masses = [f"{of.name} {format_input(of.mass, 'kg')}" for part in result.scene.sections for of in part.masses]
        notes += [f"with {' and '.join(masses)}" if masses else ""]
        notes += ["without the payload of the hoist" if result.scene.hoist is not None else "", _locked_words(result)]
        notes += [CLOSED_PADS * has_pushing_pads(result)]
        way = result.summary.get("lowest_mode", {}).get("direction", "")
        size = f"{significant(lowest)}{SPACE}Hz{TIP_MOVES.get(way, '')}"
    text = f"{size}\n{', '.join(filter(None, notes))}{_resting_clause(result) * (size != '0')}"
    yield largest_value("frequency", text.rstrip("\n"))


def _locked_words(result: RunResult) -> str:
    """Words that say that natural frequencies are those with the luffing cylinder locked.

    The words are empty unless the luffing angle is computed.  If a given length or oil drives the cylinder, the words
    add that the boom swings more slowly on the cylinder's spring or oil.  With a hoist they also name the payload.
    """
    if not has_free_luffing(result):
        return ""
    cylinder = None if result.scene.frame is None else result.scene.frame.cylinder
    on = {"oil": "on its oil", "length": "on its spring"}
    springs = [on[drive] for drive in (cylinder.drives if cylinder is not None else ()) if drive in on]
    load = " and with the payload of the hoist" if result.scene.hoist is not None else ""
    return "the luffing cylinder locked" + "".join(
        f": {spring}{load} the boom swings up and down more slowly" for spring in springs
    )
