"""Chapter about a load chart: picture, limits, load cases, table of loads, and a page for each governing limit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pmr.errors import letters, two_digits
from pmr.files.arrays import Array
from pmr.report.blocks import END_OF_SCREEN, SCREEN, Block, Chapter, Grid, KeyNumber, Table
from pmr.report.columns import spread_indices
from pmr.report.figures.canvas import drawing
from pmr.report.figures.load_chart import (
    NOT_PERMITTED,
    BentBoom,
    LoadChart,
    bent_boom,
    duty_lines,
    load_chart,
    pointer_cells,
)
from pmr.report.numbers import SPACE, format_input, format_quantity
from pmr.report.studies.chart_words import (
    NO_LOAD,
    ceiling,
    format_load,
    headline,
    load_step,
    round_down,
    slewing_clause,
)
from pmr.report.studies.finished import FinishedStudy
from pmr.report.subject import shown_force_name
from pmr.results.response import FORCES
from pmr.scene.keys import ALONE
from pmr.studies import charting
from pmr.studies.charting import governing_limit
from pmr.studies.duty import NOT_LIMITED, DutyTable, LeastLoads, LoadCase
from pmr.studies.limits import KINDS, STABILITY, STABILITY_WORDS

#: Endings of the names of the arrays with error bars: for the sum of all parts, then for each part.
PARTS = ("", *(f".{of}" for of in charting.PARTS))
#: Text in place of a load if no load up to the largest one that was tried reaches the limit.
NOT_REACHED = "limit not reached"
#: Most boom lengths in the tables of loads, and most of them side by side: more are cut off on paper.
MOST_LENGTHS, LENGTHS_BESIDE = 24, 8
#: Least error bar in kg that is shown beside a load.
SHOWN = 0.5


def build_chapter(study: FinishedStudy, prefix: str) -> Chapter:
    """Build the chapter about a load chart; `prefix` is put before every identifier.

    If no limit is reached at any point, the chapter has only the tables of limits and load cases.
    """
    names = [*(str(limit["name"]) for limit in study.study_file["limits"]), STABILITY]
    parts = [study.results.arrays(run.key) for run in study.results.runs]
    table = LeastLoads.from_rows(parts, len(study.study_file["slewing"]))
    load = np.where(np.isnan(table.load), np.inf, table.load)
    which = governing_limit(table.load.reshape(-1, len(names))).reshape(load.shape[:2])
    least = np.where(which >= 0, load.min(axis=2), np.nan)
    blocks = [
        _statement_block("What load and radius are", parts[0]["at.definitions"]),
        _statement_block("What is not in this chart", parts[0]["at.left_out"]),
        Block("Limits", grids=(_limit_grid(study, names, parts),)),
        Block("Load cases", grids=(_case_grid(study),)),
    ]
    chapter = Chapter(
        anchor=prefix, title=study.title, headline=headline(study, least, parts[0]["at.slewing"]), blocks=blocks
    )
    if not np.isfinite(least).any():  # the picture and the table of loads would be empty
        return chapter
    error = np.where(which >= 0, np.take_along_axis(table.error, np.maximum(which, 0)[..., None], 2)[..., 0], np.nan)
    up_to = float(study.study_file["up_to"])
    shown_names = [*names[:-1], STABILITY_WORDS]
    chart, beyond = LoadChart(table.place, least, which, shown_names, up_to), bool((which < 0).any())
    slewed = f" Loads are {slewing_clause(parts[0]['at.slewing'])}."
    ends = f" Where it is grey, the search ends at {format_load(up_to)}: it carries more." if beyond else ""
    caption = (
        "Load in kg over radius and height of the tip, from the pivot, undeformed, with curves of constant load. "
        f"Colours and letters say which limit governs.{slewed}{ends} A pointer on the picture shows values."
    )
    picture = drawing(f"{prefix}-chart", load_chart, caption, chart)
    caption = "Allowed load over the radius of the tip for boom lengths from the pivot; letters and colours as above."
    lines, duty = (
        drawing(f"{prefix}-duty", duty_lines, caption, chart),
        DutyTable.from_loads(table, up_to),
    )
    not_covered = str(parts[0]["not_covered"][0])
    texts = [_cell_text(study, table, chart, error, number) for number in range(least.size)]
    shown = f"{SCREEN}{pointer_cells(chart, texts)}{END_OF_SCREEN}</svg>"
    picture = replace(picture, svg=picture.svg.removesuffix("</svg>") + shown)
    explained = replace(
        blocks[2],
        text=" ".join(_paragraphs(study, parts)),
        grids=(*blocks[2].grids, *_error_bar_grids(study, names, parts)),
    )
    over_radius = Block("Load over radius", (lines,), grids=tuple(_duty_grids(study, duty, not_covered)))
    pages = governing_pages(study, shown_names, parts, prefix)
    return replace(
        chapter,
        key_numbers=_key_numbers(study, least, error, parts),
        blocks=[Block("Load chart", (picture,)), *blocks[:2], over_radius, explained, blocks[3], *pages],
    )


def _statement_block(heading: str, statements: Array) -> Block:
    """Build a block of statements (n, 2), each a subject and clauses about it."""
    return Block(heading, table=Table("", tuple((str(subject), str(clauses)) for subject, clauses in statements)))


def _cell_text(study: FinishedStudy, table: LeastLoads, chart: LoadChart, error: Array, number: int) -> str:
    """Text under a pointer on a cell of the chart: position, load, and the load at which each limit is reached.

    The cells are counted by `number`: all angles of the first reach, then those of the next one.  `error` (E, A) are
    error bars in kg.
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
    bar = f"{SPACE}±{SPACE}{error[i, k]:.0f}" if error[i, k] >= SHOWN else ""
    lines.append(f"load {chart.load[i, k]:.5g}{bar} kg, by {chart.names[chart.which[i, k]]}")
    loads_of_limits = zip(chart.names, table.load[i, k], strict=True)
    return "\n".join(
        [*lines, *(f"{name}: {NOT_REACHED if np.isnan(v) else f'{v:.5g} kg'}" for name, v in loads_of_limits)]
    )


def _key_numbers(study: FinishedStudy, least_loads: Array, error: Array, parts: Parts) -> list[KeyNumber]:
    """Key numbers: number of points, and the largest of `least_loads` in kg.

    If any `error` bar is finite, the largest one follows with what it contains, and the number of points where another
    limit may govern within them.
    """
    count, most = len(study.study_file["limits"]) + 1, float(np.nanmax(least_loads))
    key_numbers = [KeyNumber(str(least_loads.size), "points", f"{count} limit{'s' if count > 1 else ''}")]
    if most > 0.0:
        governed = "most that a limit governs" if np.isnan(least_loads).any() else "most"
        key_numbers.append(KeyNumber(format_load(most), governed))
    if np.isfinite(error).any():
        largest, doubt = format_load(float(f"{np.nanmax(error):.2g}")), str(study.figures["in_doubt"])
        key_numbers.append(KeyNumber(largest, "error bar, at most", covered_parts(parts)))
        key_numbers.append(KeyNumber(doubt, "points where another limit may govern", "within the error bars"))
    return key_numbers


def covered_parts(parts: Parts) -> str:
    """List the parts of the error bars, then those that are unknown for the limit that governs, anywhere."""
    which = governing_limit(np.concatenate([part["load"] for part in parts]))
    rows = np.flatnonzero(which >= 0)
    covered, lacking = list[str](), list[str]()
    for of in charting.PARTS:
        error = np.concatenate([part[f"error.{of}"] for part in parts])[rows, which[rows]]
        (lacking if np.isnan(error).any() else covered).append("rotations" if of == "rotation" else of)
    return ", ".join(covered) + (f"; without {', '.join(lacking)}" if lacking else "")


def _paragraphs(study: FinishedStudy, parts: Parts) -> list[str]:
    """Paragraphs on the equilibrium, the error bars and hoisting."""
    bars = (
        "Error bars are the sum of four parts: the reduction, from a richer reduced model; the mesh, from elements "
        "half as long or, where walls give way, cells twice as long; the structural model, from shells in place of "
        "beams; and what second order neglects where the boom bends far. The lower bound in chart.csv is what all "
        "limits allow at least, less their error bars. "
        f"Neither error bars nor lower bounds contain: {parts[0]['not_covered'][0]}."
        if study.study_file["error_bars"]
        else "Error bars were not asked for."
    )
    frequency = (
        "Frequencies are those with the pads that are closed at rest under the load. A run's first page has every pad "
        "closed, which is stiffer: its frequency is higher where pads are open here."
    )
    return [
        "Equilibrium to second order with the contacts that are closed: axial forces of weight and load bend what is "
        "bent. A machine tips with the load at the deflected tip.",
        bars,
        *([frequency] if any(limit["of"] == "frequency" for limit in study.study_file["limits"]) else []),
        *_hoisting_sentences(study),
    ]


def _hoisting_sentences(study: FinishedStudy) -> list[str]:
    """List with a sentence on the force of a load that is hoisted off the ground, as a multiple of its weight.

    It is empty if the study does not compute hoisting.
    """
    hoist, figures = study.study_file.get("hoist"), study.figures
    if not hoist or "hoist.most" not in figures:
        return []
    rope = f"{hoist['speed']:g}{SPACE}m/s on a rope of {hoist['rope_stiffness']:.3g}{SPACE}N/m"
    sentence = (
        f"Hoisted off the ground at {rope}, the load that is allowed pulls with {figures['hoist.least']:.3g} to "
        f"{figures['hoist.most']:.3g} times its weight, computed at each point without damping"
    )
    if "hoist.class" in figures:
        sentence += f"; class {hoist['hoisting_class']} of EN 13001-2 has {figures['hoist.class']:.3g}"
    return [f"{sentence}. No load in the chart has this factor unless a case says so."]


def _limit_grid(study: FinishedStudy, names: list[str], parts: Parts) -> Grid:
    """Build the table of the limits `names`: amount, factor, and numbers of points.

    Behind the quantity stands what it leaves out.  Points are counted at which the limit governs, is not reached, or is
    passed without a load.
    """
    limits = {str(limit["name"]): limit for limit in study.study_file["limits"]}
    rows = []
    for n, (name, remark) in enumerate(zip(names, parts[0]["at.remarks"], strict=True)):
        limit = limits.get(name, {"of": "equilibrium", "factor": 1.0})
        amount = limit.get("most") or limit.get("least")
        counts = (str(study.figures[f"{what}.{name}"]) for what in ("governs", "never", "at_no_load"))
        rows.append(
            (
                f"{letters(n)} {STABILITY_WORDS if name == STABILITY else name}",
                ", ".join(filter(None, (str(limit["of"]), str(remark)))),
                _format_amount(limit, amount),
                f"{limit['factor']:g}",
                *counts,
            )
        )
    heads = ("limit", "of", "amount", "factor", "governs", "not reached", "passed empty")
    return Grid(
        "Limits with the letters of pictures and tables, the number of points at which they govern, at which no load "
        "up to the end of the search reaches them, and at which the boom passes them without a load: it is not "
        f"permitted there, even empty. Points are counted for each of the slewing angles {_degrees(parts)}.",
        heads,
        tuple(rows),
    )


def _degrees(parts: Parts) -> str:
    """List the slewing angles of a chart in degrees."""
    return ", ".join(f"{angle:.4g}°" for angle in parts[0]["at.slewing"])


def _error_bar_grids(study: FinishedStudy, names: list[str], parts: Parts) -> list[Grid]:
    """List with a table of the error bars of the limits `names` and of their parts, as shares of the load.

    It is empty if no error bars were asked for.
    """
    if not study.study_file["error_bars"]:
        return []
    load = np.concatenate([part["load"] for part in parts])
    rows = []
    for k, name in enumerate(names):
        some = load[:, k] > 0.0
        if not some.any():
            continue  # no load of the chart reaches this limit
        shares = [np.concatenate([p[f"error{of}"][:, k] for p in parts])[some] / load[some, k] for of in PARTS]
        rows.append(
            (
                STABILITY_WORDS if name == STABILITY else name,
                *(_format_share(np.median(share)) for share in shares),
                _format_share(shares[0].max()),
            )
        )
    caption = "Half width of the error bars as a share of the load: the median of all points, of each part by itself."
    return [Grid(caption, ("limit", "in all", "reduction", "mesh", "model", "large rotations", "largest"), tuple(rows))]


def _format_share(share: float) -> str:
    """Format a share in per cent; NaN is printed as ``not known``."""
    return "not known" if np.isnan(share) else f"{two_digits(100.0 * share)}{SPACE}%" if share >= 1e-5 else "0"


def _case_grid(study: FinishedStudy) -> Grid:
    """Build the table of load cases: factors of weights and load, wind, loads of the scene, and the verdict."""
    rows = []
    for content in study.study_file["cases"]:
        case = LoadCase.model_validate(content)
        hoisted = case.hoisting_factor(study.study_file["classes"])
        load = (
            f"{case.load:g}"
            if case.hoisting_class is None
            else f"{case.load:g} × {hoisted:.4g} ({case.hoisting_class})"
        )
        wind = "–" if case.wind is None else f"{case.wind.speed:g}{SPACE}m/s, {case.wind.pressure:.4g}{SPACE}Pa"
        forces = case.loads | (case.wind.forces if case.wind else {})
        acting = ", ".join(f"{name} {force:.5g}{SPACE}N" for name, force in forces.items()) or "–"
        stands = study.figures.get(f"stands.{case.name}")
        verdict = "in service" if case.in_service else f"stands at {stands} points"
        rows.append(
            (
                case.name,
                f"{case.weight:g}",
                f"{case.machine:g}",
                load if case.in_service else "0",
                wind,
                acting,
                verdict,
                case.standard or "–",
            )
        )
    heads = ("case", "boom's weight", "machine's weight", "load", "wind", "loads of the scene", "found", "factors from")
    return Grid("What acts at once: factors of weights and load, pressure of the wind, and loads.", heads, tuple(rows))


def _format_amount(limit: Mapping[str, object], amount: float | None) -> str:
    """Format the amount of a limit with its unit; None is printed as a dash."""
    if amount is None:
        return "–"
    unit = "Pa" if limit.get("area") else KINDS[str(limit["of"])].unit
    if unit == "Hz":
        return f"{amount:g}{SPACE}Hz"  # nobody speaks of a boom's millihertz
    return format_quantity(amount, unit) if unit else f"{amount:g}"


def _duty_grids(study: FinishedStudy, duty: DutyTable, not_covered: str) -> Iterator[Grid]:
    """Yield the table of loads over radius and boom length with letters of limits, and that of their lower bounds.

    The caption of the lower bounds says what is `not_covered` by them.
    """
    columns, step = spread_indices(len(duty.lengths), MOST_LENGTHS), load_step(float(np.nanmax(duty.load, initial=0.0)))

    def cell(r: int, e: int, values: Array) -> str:
        """Entry of `values`, in kg, at radius number `r` and boom length number `e`, with the letter of its limit.

        Empty where the entry is NaN, and `NO_LOAD` where nothing remains of it after rounding down.
        """
        if np.isnan(values[r, e]):
            return ""
        if values[r, e] >= duty.up_to:
            return duty.load_text(values[r, e])
        letter = letters(int(duty.which[r, e])) if duty.which[r, e] >= 0 else "–"
        load = round_down(float(values[r, e]), step)
        return f"{load:.10g}{SPACE}{letter}" if load > 0.0 else f"{NO_LOAD}{SPACE}{letter}"

    ends = (
        f" >{duty.up_to:.0f} is more than that: {NOT_LIMITED}, the search ends there."
        if (duty.load >= duty.up_to).any()
        else ""
    )
    more = (
        f" {len(columns)} of {len(duty.lengths)} boom lengths fit, evenly spread; all are in duty.csv."
        if len(columns) < len(duty.lengths)
        else ""
    )
    is_small = (duty.lower[:, columns] < step).any()
    least = f" {NO_LOAD} is {NOT_PERMITTED}, or with less than {step:g}{SPACE}kg." if is_small else ""
    caption = (
        f"Allowed load in kg, rounded down to {step:g}{SPACE}kg, over radius and boom length, from the pivot, "
        f"undeformed. The letter is that of the limit that governs.{least}{ends} Between the "
        "luffing angles of the chart, each limit is interpolated. Empty cells are "
        f"radii that the tip does not reach.{more}"
    )
    named = {caption: duty.load}
    if study.study_file["error_bars"]:
        named[f"Lower bounds: these loads, less error bars and doubt of interpolation. Not in them: {not_covered}."] = (
            duty.lower
        )
    parts_of_columns = np.array_split(columns, -(-len(columns) // LENGTHS_BESIDE))
    for text, values in named.items():
        for n, part in enumerate(parts_of_columns):
            head = ("radius in m", *(f"{duty.lengths[e]:.4g}{SPACE}m" for e in part))
            rows = [(f"{radius:g}", *(cell(r, int(e), values) for e in part)) for r, radius in enumerate(duty.radii)]
            caption = "The same for longer booms." if n else text
            yield Grid(caption, head, tuple(row for row in rows if any(row[1:])))


#: Arrays by name of each run of a study, one mapping for each run.
Parts = Sequence[Mapping[str, Array]]
#: Share of the largest force or displacement below which a force or displacement is round-off.
ROUND_OFF = 1e-9


def governing_pages(study: FinishedStudy, names: list[str], arrays: Parts, prefix: str) -> Iterator[Block]:
    """Yield a block for each limit of `names` that governs anywhere: about the largest load that it governs.

    `prefix` begins the identifiers of the figures.
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

    It occurs in run number `row`, and `arrays` are those of this run.  `anchor` is the identifier of the figure.
    """
    k = int(arrays["at.place"][n])
    load, error = float(arrays["load"][k, n]), float(arrays["error"][k, n])
    out = {p.removeprefix("extension."): float(v) for p, v in study.results.runs[row].parameters.items() if v}
    angle, tails = float(arrays["at.luffing"][n]), np.cumsum([0.0, *out.values()])
    section, upwards = arrays["at.bent.section"].astype(int), arrays["at.direction.names"] == "z"
    sections = tuple(str(name) if name != ALONE else "boom" for name in arrays["at.section.names"])
    radius, height = arrays["place"][k]
    boom = BentBoom(
        along=(arrays["at.bent.x"] + tails[section])[upwards],
        across=arrays["at.bent"][n][upwards],
        section=section[upwards],
        names=sections,
        luffing=angle,
    )
    caption = (
        f"The boom at rest under {load:.5g}{SPACE}kg, seen from the side, displacements drawn {boom.scale:g} times as "
        "large; the thin line is the boom without any load."
    )
    stands = ", ".join(f"{name} out {value:.3g}{SPACE}m" for name, value in out.items())
    bar = f"{SPACE}±{SPACE}{format_input(float(f'{error:.2g}'))}" if np.isfinite(error) else ""
    member = f" ({arrays['member'][k]})" if arrays["member"][k] else ""
    remark = f", {arrays['at.remarks'][n]}" if arrays["at.remarks"][n] else ""
    text = (
        f"Raised by {np.rad2deg(angle):.3g}°{', ' if stands else ''}{stands}: radius {radius:.4g}{SPACE}m, height "
        f"{height:.4g}{SPACE}m. It carries {load:.5g}{bar}{SPACE}kg, by {names[n]}{member}{remark}, the largest "
        "load that this limit governs."
    )
    text += "".join(f" {name}" for name in _stop_sentences(study, names[n], arrays["at.stops"][n]))
    drawn = drawing(anchor, bent_boom, caption, boom)
    return Block(
        f"Governed by {names[n]}", (drawn,), text=text, tables=_use_tables(names, n, arrays, sections), two_columns=True
    )


def _stop_sentences(study: FinishedStudy, limit: str, stops: Array) -> Iterator[str]:
    """Yield a sentence for each stop with results at this point, on how far the tip swings after it.

    Each row of `stops` has five numbers.  The first is the swing of the tip as a multiple of the displacement by a
    steady deceleration; it is NaN if not known.  The next three are the use of the limit at rest, under the steady
    deceleration, and at most.  The last is the speed in rad/s.
    """
    for stop, (factor, at_rest_share, steady, most, speed) in zip(
        study.study_file["stops"], stops.tolist(), strict=True
    ):
        if np.isnan(factor):
            continue
        sentence = (
            f"If {stop['of']} at {np.rad2deg(speed):.3g}°/s stops within {stop['within']:g}{SPACE}s, the tip swings "
        )
        sentence += f"{factor:.3g} times as far as a steady deceleration moves it"
        if stop["class_factor"] is not None:
            sentence += f" (the study's own factor is {stop['class_factor']:g})"
        if most > steady or most > at_rest_share:
            sentence += f", and the use of {limit} goes from {100 * at_rest_share:.3g} to {100 * most:.4g}{SPACE}%"
            sentence += f", by the steady deceleration to {100 * steady:.4g}{SPACE}%"
        yield f"{sentence}."


def _use_tables(names: list[str], n: int, arrays: Mapping[str, Array], sections: tuple[str, ...]) -> list[Table]:
    """Build tables of the use of each limit of `names`, and of stresses, displacements of tips and forces.

    They are those under the largest load that limit number `n` governs; `sections` are the names of the sections.
    """
    used = zip(names, arrays["at.used"][n], strict=True)
    tables = [Table("Used of each limit", tuple((name, f"{100.0 * share:.3g}{SPACE}%") for name, share in used))]
    if len(stress := arrays["at.stress"][n]):
        probes = zip(arrays["at.stress.names"], stress, strict=True)
        tables.append(
            Table(
                "Von Mises' stress", tuple((str(name), format_quantity(float(value), "Pa")) for name, value in probes)
            )
        )
    direction, of, bent = arrays["at.direction.names"], arrays["at.bent.section"], _zero_round_off(arrays["at.bent"][n])
    for d, way in (("z", "perpendicular to the boom, up where it lies level"), ("y", "to the left")):
        if (direction == d).any():
            deflections = [float(bent[(of == k) & (direction == d)][-1]) for k in range(len(sections))]
            tips = tuple((name, format_quantity(value, "m")) for name, value in zip(sections, deflections, strict=True))
            tables.append(Table(f"Tips of sections, {way}", tips))
    forces = zip(arrays["at.forces.names"], arrays["at.kinds"], _zero_round_off(arrays["at.forces"][n]), strict=True)
    some = tuple(
        (shown_force_name(str(name)), format_quantity(float(f), "N")) for name, kind, f in forces if kind in FORCES
    )
    return [*tables, Table("Forces, positive where they push", some)] if some else tables


def _zero_round_off(values: Array) -> Array:
    """Replace values below the share `ROUND_OFF` of the largest absolute value by 0."""
    return np.where(np.abs(values) < ROUND_OFF * np.abs(values).max(initial=0.0), 0.0, values)
