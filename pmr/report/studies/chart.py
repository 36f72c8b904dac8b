"""Chapter about a load chart: picture, limits, load cases, table of loads, and a page for each governing limit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pmr.files.arrays import Array, Summary
from pmr.report.blocks import END_OF_SCREEN, SCREEN, Block, Chapter, KeyNumber, Notices, Table, Verdict
from pmr.report.columns import spread_indices
from pmr.report.figures import drawing
from pmr.report.figures.load_chart import (
    LINES,
    NARROW_LINES,
    NOT_PERMITTED,
    BentBoom,
    LoadChart,
    bent_boom,
    duty_lines,
    load_chart,
    pointer_cells,
)
from pmr.report.numbers import SPACE, format_quantity, prose
from pmr.report.studies.chart_tables import (
    Parts,
    as_in_duty_table,
    brief_rows,
    case_grid,
    ceiling,
    duty_grids,
    error_bar_grids,
    format_bar,
    format_load,
    format_radius,
    headline,
    lifts_more,
    limit_grid,
    motion_rows,
    present_parts,
)
from pmr.report.studies.tables import FinishedStudy
from pmr.report.subject import shown_force_name
from pmr.results.response import FORCES
from pmr.scene.keys import ALONE
from pmr.studies.charting import errors_not_covered, governing_limit
from pmr.studies.duty import NOT_LIMITED, ChartLoads, DutyTable, LeastLoads
from pmr.studies.limits import KINDS, STABILITY, STABILITY_WORDS

#: Text in place of a load if no load up to the largest one that was tried reaches the limit.
NOT_REACHED = "limit not reached"
#: Least error bar in kg that is shown beside a load.
SHOWN = 0.5


def build_chapter(study: FinishedStudy, prefix: str) -> Chapter:
    """Build the chapter about a load chart; `prefix` is put before every identifier.

    If no limit is reached at any point, the chapter has no picture, no loads over the radius and no pages of limits.
    """
    names = [*(str(limit["name"]) for limit in study.study_file["limits"]), STABILITY]
    parts = [study.results.arrays(run.key) for run in study.results.runs]
    table = LeastLoads.from_rows(parts, len(study.study_file["slewing"]))
    up_to = float(study.study_file["up_to"])
    loads = ChartLoads(table.load, table.error, up_to)
    which, has_bars = loads.which_lower, bool(study.study_file["error_bars"])
    stated = [
        _statement_block(heading, rows_of_block)
        for heading, rows_of_block in (
            ("What load and radius are", list(_definitions(study, parts))),
            ("Which motions are in the loads", list(motion_rows(study.study_file, study.figures))),
            ("What is not in this chart", list(map(tuple, parts[0]["at.left_out"].tolist()))),
        )
        if rows_of_block
    ]
    limits = Block("Limits", grids=(limit_grid(study, names, parts, loads),))
    cases = Block("Load cases", grids=(case_grid(study),))
    slewing = parts[0]["at.slewing"]
    rows = [run.parameters for run in study.results.runs]
    sentence = headline(study, loads, table.place[..., 0])
    chapter = Chapter(
        anchor=prefix,
        title=study.title,
        headline=sentence,
        notices=Notices(Verdict(sentence, is_exceeded=lifts_more(study.figures))),
        first=[Table("", tuple(brief_rows(study, loads, rows, table.luffing, slewing)))],
        blocks=[*stated, limits, cases],
    )
    if not np.isfinite(loads.least).any():  # the picture and the table of loads would be empty
        return chapter
    shown_names = [*names[:-1], STABILITY_WORDS]
    not_covered = errors_not_covered(np.concatenate([part["not_covered"] for part in parts]))
    nowhere = [
        name
        for k, (name, limit) in enumerate(
            zip(shown_names, [*study.study_file["limits"], {"of": STABILITY}], strict=True)
        )
        if not (which == k).any() and (limit["of"] == STABILITY or not KINDS[limit["of"]].in_richer_model)
    ]
    not_covered += f". Of these limits, {' and '.join(nowhere)} govern nowhere" if nowhere and has_bars else ""
    extensions = [" + ".join(f"{float(out or 0.0):.4g}" for out in rows[row].values()) for row in table.order]
    to_use = np.where(which >= 0, loads.lower_bound, np.nan)
    ground = float(parts[0].get("at.ground", np.nan))  # results of earlier versions have no height of the ground
    chart = LoadChart(table.place, to_use, which, shown_names, up_to, extensions, ground)
    ends_at = format_load(up_to) if (which < 0).any() else ""
    caption = prose("chart_caption", ends_at=ends_at, has_bars=has_bars, has_ground=np.isfinite(ground))
    picture = drawing(f"{prefix}-chart", load_chart, caption, chart, fits=True)
    texts = [_cell_text(study, table, chart, loads, number) for number in range(to_use.size)]
    shown = f"{SCREEN}{pointer_cells(chart, texts)}{END_OF_SCREEN}</svg>"
    picture = replace(picture, svg=picture.svg.replace("</svg>", shown, 1), hint="Point at the picture to see values.")
    lines = drawing(f"{prefix}-duty", duty_lines, duty_caption(chart.lengths, has_bars), chart, fits=True)
    duty = tuple(duty_grids(study, DutyTable.from_loads(table, up_to, rows), not_covered))
    method = prose("chart_method", study_file=study.study_file, play="play" in present_parts(parts))
    limits = replace(limits, text=method, grids=(*limits.grids, *error_bar_grids(study, names, parts)))
    over_radius = Block("Load over radius", (lines,), grids=duty)
    pages = governing_pages(study, shown_names, parts, prefix)
    return replace(
        chapter,
        key_numbers=_key_numbers(chart, loads, parts),
        blocks=[Block("Load chart", (picture,)), *stated, over_radius, limits, cases, *pages],
    )


def duty_caption(lengths: Sequence[str], has_bars: bool) -> str:
    """Caption of the lines of loads over the radius; it names those of the boom `lengths` that have no line.

    `has_bars` says whether error bars are taken off the loads.  Many lengths without a line are only counted.
    """
    drawn = spread_indices(len(lengths), LINES)
    lacking = [length for k, length in enumerate(lengths) if k not in drawn]
    names = f"of {', '.join(lacking)}" if len(lacking) < LINES else f"of {len(lacking)} of {len(lengths)} boom lengths"
    caption = f"Load{' to use, error bars taken off,' * has_bars} over the radius of the tip for boom lengths from the "
    caption += "pivot; letters and colours as above."
    caption += f" Lines {names} are left out; duty.csv has them." if lacking else ""
    few = f" In a narrow window, {NARROW_LINES} of {len(lengths)} boom lengths have a line."
    return caption + (few if len(lengths) > NARROW_LINES else "")


def _statement_block(heading: str, statements: Iterable[tuple[str, str]]) -> Block:
    """Build a block with a `heading` from statements, each a subject and clauses about it."""
    return Block(heading, tables=[Table("", tuple(statements))], columns=1)


def _definitions(study: FinishedStudy, parts: Parts) -> Iterator[tuple[str, str]]:
    """Yield what the chart calls load, radius and so on, and by how much deflections make the radius larger."""
    farther = study.figures.get("outward.most")
    for subject, clauses in parts[0]["at.definitions"].tolist():
        if subject == "radius" and farther is not None:
            way = format_quantity(float(farther), "m")
            clauses += f"; deflections under the load that is allowed move the tip up to {way} farther out (chart.csv)"
        yield subject, clauses


def _cell_text(study: FinishedStudy, table: LeastLoads, chart: LoadChart, loads: ChartLoads, number: int) -> str:
    """Text under a pointer on a cell of the chart: position, load, and the load of each limit.

    At a position without a governing limit, the text has the largest load of the study in place of these loads.  At a
    position where the boom is not permitted even empty, it names the limits that are passed without a load.

    The cells are counted by `number`: all angles of the first reach, then those of the next one.  `loads` are those
    of the `table` with their errors.
    """
    i, k = divmod(number, chart.load.shape[1])
    radius, height = chart.place[i, k]
    lines = [f"radius {radius:.2f} m, height {height:.2f} m"]
    for name, value in study.results.runs[table.order[i]].parameters.items():
        lines.append(f"{name.removeprefix('extension.')} out {float(value):.3g} m")
    lines.append(f"raised by {np.rad2deg(table.luffing[k]):.3g}°")
    if chart.which[i, k] < 0:
        return "\n".join([*lines, f"load {ceiling(study)}, {NOT_LIMITED}"])
    if chart.not_permitted[i, k]:
        passed = ", ".join(name for name, v in zip(chart.names, table.load[i, k], strict=True) if v == 0.0)
        return "\n".join([*lines, f"{NOT_PERMITTED}: beyond {passed}"])
    bar = f", error bar of {format_bar(loads.bar[i, k])} taken off" if loads.bar[i, k] >= SHOWN else ""
    lines.append(f"load {format_load(chart.load[i, k])}{bar}, by {chart.names[chart.which[i, k]]}")
    lines += ["loads of all limits without error bars:"] if bar else []
    loads_of_limits = zip(chart.names, table.load[i, k], strict=True)
    return "\n".join(
        [*lines, *(f"{name}: {NOT_REACHED if np.isnan(v) else format_load(v)}" for name, v in loads_of_limits)]
    )


def _key_numbers(chart: LoadChart, loads: ChartLoads, parts: Parts) -> list[KeyNumber]:
    """Key numbers: the largest load of a `chart`, the load at its largest radius, and last the number of postures.

    The chart has the loads to use, less the errors of `loads`.  They are rounded down as in the duty table.  The load
    at the largest radius is left out if no limit governs it.

    If an error bar is known, two more numbers stand before the last one: the largest error bar, with the errors that it
    contains, and the number of postures at which another limit may govern within the error bars.  `parts` are the
    arrays of each run of the study.
    """
    count, most, radius = len(chart.names), float(np.nanmax(chart.load, initial=0.0)), chart.place[..., 0]
    rounded, postures, turns = as_in_duty_table(loads), chart.load.size, len(parts[0]["at.slewing"])
    turned = f"each at {turns} slewing angles; " if turns > 1 else ""
    key_numbers = list[KeyNumber]()
    if most > 0.0:
        governed = "largest load that a limit governs" if np.isnan(chart.load).any() else "largest load"
        at_most = radius[np.unravel_index(np.nanargmax(chart.load), radius.shape)]
        key_numbers.append(KeyNumber(rounded(most), governed, f"at a radius of {format_radius(at_most)}"))
    farthest = np.unravel_index(np.argmax(radius), radius.shape)
    if chart.which[farthest] >= 0:
        load = NOT_PERMITTED if chart.not_permitted[farthest] else rounded(chart.load[farthest])
        by = f"limited by {chart.names[chart.which[farthest]]}"
        key_numbers.append(KeyNumber(load, f"at the largest radius, {format_radius(radius[farthest])}", by))
    if np.isfinite(loads.bar).any():
        off = f"taken off these loads: {covered_parts(parts)}"
        key_numbers.append(KeyNumber(format_bar(float(np.nanmax(loads.bar))), "largest error bar", off))
        doubt = str(loads.may_govern.any(axis=-1).sum())
        key_numbers.append(
            KeyNumber(doubt, f"of {postures} postures with another limit", "that may govern within the error bars")
        )
    return [*key_numbers, KeyNumber(str(postures), "postures", f"{turned}{count} limit{'s' if count > 1 else ''}")]


def covered_parts(parts: Parts) -> str:
    """Text that lists the parts that the error bars contain and, after "without", the parts that they lack.

    A part is lacking if, at any position, it is not known for the limit that governs there.  Play is in neither list if
    no pad of the scene can have it, or if an earlier version computed the chart.
    """
    which = governing_limit(np.concatenate([part["load"] for part in parts]))
    rows = np.flatnonzero(which >= 0)
    covered, lacking = list[str](), list[str]()
    for of in present_parts(parts):
        error = np.concatenate([part[f"error.{of}"] for part in parts])[rows, which[rows]]
        (lacking if np.isnan(error).any() else covered).append("rotations" if of == "rotation" else of)
    return ", ".join(covered) + (f"; without {', '.join(lacking)}" if lacking else "")


#: Share of the largest force or displacement below which a force or displacement is round-off.
ROUND_OFF = 1e-9


def governing_pages(study: FinishedStudy, names: list[str], arrays: Parts, prefix: str) -> Iterator[Block]:
    """Yield a block for each limit that governs anywhere, about the point at which it governs the largest load.

    `names` are the names of all limits, `arrays` are the arrays of each run of the study, and `prefix` begins the
    identifiers of the figures.
    """
    for n in range(len(names)):
        best = [(float(a["load"][k, n]) if (k := int(a["at.place"][n])) >= 0 else -1.0) for a in arrays]
        row = int(np.argmax(best))
        if best[row] > 0.0:
            yield _governing_page(study, names, n, row, arrays[row], f"{prefix}-at-{n + 1}")


def _governing_page(
    study: FinishedStudy, names: list[str], n: int, row: int, arrays: Mapping[str, Array], anchor: str
) -> Block:
    """Build the block about the largest load that limit number `n` of `names` governs.

    The load occurs in run number `row`, and `arrays` are those of this run.  `anchor` is the identifier of the figure.
    """
    k = int(arrays["at.place"][n])
    load, error = float(arrays["load"][k, n]), float(arrays["error"][k, n])
    to_use = ChartLoads(arrays["load"][k], arrays["error"][k], float(study.study_file["up_to"]))
    out = {p.removeprefix("extension."): float(v) for p, v in study.results.runs[row].parameters.items() if v}
    angle, tails = float(arrays["at.luffing"][n]), np.cumsum([0.0, *out.values()])
    section, upwards = arrays["at.bent.section"].astype(int), arrays["at.direction.names"] == "z"
    sections = tuple(str(name) if name != ALONE else "boom" for name in arrays["at.section.names"])
    boom = BentBoom(
        along=(arrays["at.bent.x"] + tails[section])[upwards],
        across=arrays["at.bent"][n][upwards],
        section=section[upwards],
        names=sections,
        luffing=angle,
    )
    caption = prose("bent_boom", load=format_load(load), scale=boom.scale)
    turns = "at.slewed" in arrays and len(arrays["at.slewing"]) > 1  # results of earlier versions have no such angle
    text = prose(
        "governing",
        raised=np.rad2deg(angle),
        slewed=np.rad2deg(arrays["at.slewed"][n]) if turns else None,
        out=out,
        place=arrays["place"][k],
        load=format_load(load),
        to_use=format_load(float(to_use.lower_bound)),
        bar=format_bar(error) if np.isfinite(error) else "",
        limit=names[n],
        member=arrays["member"][k],
        stops=_stops(study, arrays["at.stops"][n]),
    )
    drawn = drawing(anchor, bent_boom, caption, boom, fits=True)
    return Block(
        f"Governed by {names[n]}", (drawn,), text=text, tables=_use_tables(names, n, arrays, sections), columns=2
    )


def _stops(study: FinishedStudy, stops: Array) -> list[Summary]:
    """List the entries of the study's stops, with results at one point added.

    `stops` (stops, 5) has a row of five numbers for each stop:

    - ``factor``, the swing of the tip after the stop, as a multiple of the displacement by a steady deceleration.  NaN
      means that it is not known; then the stop is left out.
    - ``rest``, ``steady`` and ``most``, the use of the limit at rest, under the steady deceleration, and at most.
    - ``speed`` in rad/s, which the entry has in degrees/s.
    """
    return [
        stop | {"factor": factor, "rest": at_rest, "steady": steady, "most": most, "speed": np.rad2deg(speed)}
        for stop, (factor, at_rest, steady, most, speed) in zip(study.study_file["stops"], stops.tolist(), strict=True)
        if not np.isnan(factor)
    ]


def _use_tables(names: list[str], n: int, arrays: Mapping[str, Array], sections: tuple[str, ...]) -> list[Table]:
    """Build tables of the used shares of the limits `names`, and of stresses, tip displacements and forces.

    The values are those under the largest load that limit number `n` governs, from `arrays` of the study's results;
    `sections` are the names of the sections.  Forces of 0 share one row.  Deflections or forces that are all 0 have no
    table.
    """
    used = zip(names, arrays["at.used"][n], strict=True)
    shares = tuple((name, f"{100.0 * share:.3g}{SPACE}%") for name, share in used)
    tables = [Table("Used share of each limit, safety factor included", shares)]
    if len(stress := arrays["at.stress"][n]):
        probes = zip(arrays["at.stress.names"], stress, strict=True)
        tables.append(
            Table("Von Mises stress", tuple((str(name), format_quantity(float(value), "Pa")) for name, value in probes))
        )
    direction, of, bent = arrays["at.direction.names"], arrays["at.bent.section"], _zero_round_off(arrays["at.bent"][n])
    for d, way in (("z", "perpendicular to the boom, positive upwards"), ("y", "to the left")):
        if (direction == d).any():
            deflections = [float(bent[(of == k) & (direction == d)][-1]) for k in range(len(sections))]
            tips = tuple((name, format_quantity(value, "m")) for name, value in zip(sections, deflections, strict=True))
            tables += [Table(f"Deflections of the tips of sections, {way}", tips)] if any(deflections) else []
    columns = zip(arrays["at.forces.names"], arrays["at.kinds"], _zero_round_off(arrays["at.forces"][n]), strict=True)
    forces = [(shown_force_name(str(name)), kind, float(force)) for name, kind, force in columns if kind in FORCES]
    rows = [(name, format_quantity(force, "N")) for name, _, force in forces if force]
    remaining = "all other pads" if {kind for _, kind, force in forces if not force} == {"pad"} else "all others"
    rows += [(remaining, format_quantity(0.0, "N"))] if 0 < len(rows) < len(forces) else []
    return [*tables, Table("Forces, positive where they push", tuple(rows))] if rows else tables


def _zero_round_off(values: Array) -> Array:
    """Return `values` (any shape) with 0 for round-off.

    Round-off is what is smaller than the share `ROUND_OFF` of the largest absolute value.
    """
    return np.where(np.abs(values) < ROUND_OFF * np.abs(values).max(initial=0.0), 0.0, values)
