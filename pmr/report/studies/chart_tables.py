"""Tables, sentences and numbers of a load chart: its limits and cases, and what it carries in these cases."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import letters, two_digits
from pmr.files.arrays import Array, Summary
from pmr.report.blocks import Grid
from pmr.report.columns import spread_indices
from pmr.report.figures.load_chart import NOT_PERMITTED
from pmr.report.numbers import SPACE, format_input, format_percent, format_quantity, prose
from pmr.report.studies.tables import FinishedStudy
from pmr.results.quantities import LIMITED
from pmr.studies import charting
from pmr.studies.duty import ChartLoads, DutyTable
from pmr.studies.limits import KINDS, STABILITY, STABILITY_WORDS
from pmr.studies.load_cases import LoadCase
from pmr.studies.study import StudyResults

#: Sign in tables where the boom is not permitted even empty, and at radii outside the luffing angles of the chart.
NO_LOAD, OUTSIDE = "—", "·"
#: Words on a motion that no load of a chart contains.
NOT_IN_LOADS = "not in the loads"
#: Largest step in kg to which loads are rounded down in tables; smaller ones keep three digits of the largest load.
STEP = 10.0


def load_step(largest: float) -> float:
    """Return the step in kg to which loads are rounded down in a table whose largest load is `largest` in kg.

    It is one unit of the third digit of this load, at most `STEP`.
    """
    return STEP if largest <= 0.0 else min(float(10.0 ** (np.floor(np.log10(largest)) - 2.0)), STEP)


def round_down(value: float, step: float) -> float:
    """Round a load or a radius down to a multiple of `step`, which has the same unit."""
    return float(np.floor(value / step + 1e-9) * step)


def format_load(load: float | np.floating) -> str:
    """Format a load rounded down to four digits, from 100 kg on without decimals, never with a power of ten."""
    digit = 10.0 ** (np.floor(np.log10(load)) - 3.0) if load > 0.0 else 1.0
    digit = max(digit, 1.0) if load >= 100.0 else digit
    return f"{format_input(float(f'{round_down(float(load), float(digit)):.10g}'))}{SPACE}kg"


def format_bar(error: float | np.floating) -> str:
    """Format an error bar in kg, rounded up to two digits."""
    digit = 10.0 ** (np.floor(np.log10(error)) - 1.0) if error > 0.0 else 1.0
    return format_input(abs(float(f"{np.ceil(error / digit - 1e-9) * digit:.2g}")), "kg")


def format_radius(radius: float | np.floating) -> str:
    """Format a radius in m, rounded down to centimetres as in the duty table."""
    return f"{round_down(float(radius), 0.01):g}{SPACE}m"


def as_in_duty_table(loads: ChartLoads) -> Callable[[float | np.floating], str]:
    """Return a function that formats a load in kg, rounded down as in the duty table of a chart with these `loads`."""
    step = load_step(float(np.minimum(loads.least, loads.up_to).max()))
    return lambda load: format_load(round_down(float(load), step))


def ceiling(study: FinishedStudy) -> str:
    """Words in place of a load where no limit is reached up to the load at which the search ends."""
    return f"more than {format_load(study.study_file['up_to'])} (search ends there)"


def case_rows(study_file: Summary) -> Iterator[tuple[str, str]]:
    """Yield rows on the load cases in service of a study file, and a last row on what the loads do not contain.

    `study_file` are the keys of the study file.  A row states the factors of load and weights, the wind and other
    loads; cases that are alike share a row.  If all factors are 1 and neither wind nor another load acts, the only row
    says so.
    """
    cases = [case for case in map(LoadCase.model_validate, study_file["cases"]) if case.in_service]
    plain = all(case.weight == case.machine == case.load == 1.0 and case.hoisting_class is None for case in cases)
    calm = not any(case.wind or any(case.loads.values()) for case in cases)
    if plain and calm:
        yield "load cases", "static, factors of load and weight 1.0, no wind, no motion: not a rated capacity"
        return
    names, lifted = dict[str, list[str]](), []
    for case in cases:
        lifted.append(case.load * case.hoisting_factor(study_file["classes"]))
        loads = ", ".join(filter(None, (_acting_forces(case), _wind_words(case)))) or "no wind"
        factors = f"factor of load {lifted[-1]:.4g}, of the boom's weight {case.weight:.4g}"
        factors += "" if case.machine == 1.0 else f", of the machine's {case.machine:.4g}"
        names.setdefault(f"{factors}, {loads}", []).append(case.name)
    missing = [] if all(case.wind for case in cases) else ["wind" if calm else "wind beyond these loads"]
    missing += ["a factor of the load"] * (min(lifted) <= 1.0)
    missing += ["wind on machine and load"] * all(case.wind is not None and not case.wind.on for case in cases)
    missing += [] if any(case.hoisting_class for case in cases) else ["hoisting"]
    for words, alike in names.items():
        several = f"{len(alike)} load cases: {', or '.join(alike)}"
        yield (
            several if alike[1:] else f"load case {alike[0]}",
            f"{'in each: ' if alike[1:] else ''}boom at rest, {words}",
        )
    yield "not in the loads", ", ".join([*missing, "luffing, slewing, telescoping", "swing of the load on its rope"])


def motion_rows(study_file: Summary, figures: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield a row for each motion that the loads contain, or about which something is computed beside them.

    `study_file` are the keys of the study file, and `figures` those of the study.
    """
    factors = dict[str, list[str]]()
    for case in map(LoadCase.model_validate, study_file["cases"]):
        if case.in_service and case.hoisting_class is not None:
            words = f"{case.hoisting_factor(study_file['classes']):.4g}, of the class {case.hoisting_class} at "
            factors.setdefault(f"{words}{case.hoisting_speed:g}{SPACE}m/s", []).append(case.name)
    contained = "; ".join(f"{factor} ({', '.join(names)})" for factor, names in factors.items())
    hoist, computed = study_file.get("hoist"), ""
    if hoist and "hoist.most" in figures:
        computed = prose("hoisting", hoist=hoist, figures=figures)
    if contained or computed:
        yield "hoisting", f"{f'in the loads, by the factor {contained}' if contained else NOT_IN_LOADS}{computed}"
    for motion in ("luffing", "slewing"):
        stops = [stop for stop in study_file.get("stops", ()) if stop["of"] == motion]
        if stops:
            yield motion, NOT_IN_LOADS + "".join(prose("stopping", stop=stop) for stop in stops)


def lifts_more(figures: Mapping[str, Any]) -> bool:
    """Whether the scene's payload is more than the chart allows in a posture of its run; false without a payload.

    `figures` are those of the study.
    """
    return bool(figures.get("payload", 0.0) > figures.get("payload.load", np.inf))


def payload_sentences(figures: Mapping[str, Any], rounded: Callable[[float], str], has_bars: bool) -> str:
    """Sentences on the payload of the scene's run and what the chart allows in its postures; empty without a payload.

    `figures` are those of the study; `rounded` formats a load in kg, and `has_bars` says whether the chart has error
    bars.
    """
    if "payload" not in figures:
        return ""
    posture = {key: figures.get(f"payload.{key}") for key in ("load", "limit", "t", "luffing", "length")}
    limit = STABILITY_WORDS if posture["limit"] == STABILITY else posture["limit"]
    shown = {"limit": limit, "load": "" if posture["load"] is None else rounded(posture["load"])}
    payload, is_more = format_input(figures["payload"], "kg"), lifts_more(figures)
    return prose("payload", payload=payload, **posture | shown, is_more=is_more, has_bars=has_bars)


def _acting_forces(case: LoadCase) -> str:
    """List the loads that a case adds, with their values: loads of the scene, and forces of wind on areas.

    The text is empty if there are none.  A study file does not tell forces from moments, so that a load of the scene
    has both units.
    """
    words = [f"{name} {value:.5g}{SPACE}N (N{SPACE}m of a moment)" for name, value in case.loads.items()]
    forces = case.wind.forces if case.wind else {}
    return ", ".join([*words, *(f"{name} {force:.5g}{SPACE}N" for name, force in forces.items())])


def _wind_size(case: LoadCase) -> str:
    """Text with speed and pressure of the wind of a case; empty without wind.

    If the wind acts on no areas of the study file, the text adds that it acts on the sections.
    """
    if case.wind is None:
        return ""
    size = f"{case.wind.speed:g}{SPACE}m/s, {case.wind.pressure:.4g}{SPACE}Pa"
    return size if case.wind.on else f"{size}, on the sections"


def _wind_words(case: LoadCase) -> str:
    """Words on the wind of a case: its speed and pressure and, if it acts on no areas, the shape factor of sections."""
    if case.wind is None or case.wind.on:
        return f"wind of {_wind_size(case)}" if case.wind else ""
    area = f"with the height or width of their boxes and the shape factor {case.wind.shape:g}"
    return f"wind of {_wind_size(case)}, {area} unless the scene states others"


def brief_rows(
    study: FinishedStudy, loads: ChartLoads, rows: Sequence[Mapping[str, Any]], luffing: Array, slewing: Array
) -> Iterator[tuple[str, str]]:
    """Yield rows on what a chart's loads contain: cases, limits, postures, and the payload of the scene's run.

    `rows` are the extensions in m of the chart's `loads` by parameter, such as ``extension.fly``; `luffing` (A,) are
    angles in rad and `slewing` (k,) in degrees.
    """
    yield from case_rows(study.study_file)
    limits = [f"{limit['name']} (factor {limit['factor']:g})" for limit in study.study_file["limits"]]
    yield "limits, no others", ", ".join([*limits, STABILITY_WORDS])
    if ranges := _extension_ranges(rows):
        yield "extensions", ranges
    ends = dict.fromkeys(f"{angle:.4g}°" for angle in np.rad2deg([luffing.min(), luffing.max()]))
    yield "luffing angles", f"{' to '.join(ends)}, {len(luffing)} angles" if len(ends) > 1 else "".join(ends)
    listed = ", ".join(f"{angle:.4g}°" for angle in slewing)
    yield "slewing angles", f"{listed}{': the smallest load of all counts' if len(slewing) > 1 else ''}"
    if payload := payload_sentences(study.figures, as_in_duty_table(loads), bool(study.study_file["error_bars"])):
        yield "payload of the scene", payload


def _extension_ranges(rows: Sequence[Mapping[str, Any]]) -> str:
    """List the sections of a chart's `rows` with the range of their extensions in m, equal ranges once."""
    names = dict[str, list[str]]()
    for parameter in rows[0] if rows else ():
        out = [float(row[parameter] or 0.0) for row in rows]
        ends = dict.fromkeys(f"{end:.4g}" for end in (min(out), max(out)))
        names.setdefault(f"{' to '.join(ends)}{SPACE}m", []).append(parameter.removeprefix("extension."))
    return "; ".join(f"{' and '.join(of)}, {range_}{' each' if of[1:] else ''}" for range_, of in names.items())


def headline(study: FinishedStudy, loads: ChartLoads, radius: Array) -> str:
    """Sentences on the range of the loads to use with their radii, and on what governs.

    `loads` are those of all limits for E boom lengths and A luffing angles, and `radius` (E, A) in m is that of the
    tip.  Loads to use are less their error bars; if the study has none, the sentences say so.
    """
    limits, postures = study.study_file["limits"], loads.least.size
    if not np.isfinite(loads.least).any():
        hint = "" if limits else f" Only {STABILITY_WORDS} was evaluated: the study file can add limits."
        most = format_input(study.study_file["up_to"], "kg")
        return f"No limit is reached up to {most} in any of {postures} postures.{hint}"
    is_permitted, rounded = loads.lower_bound > 0.0, as_in_duty_table(loads)

    def ends(of: Array) -> str:
        """Least and largest load of the permitted postures, of `of` (E, A) in kg, with their radii."""
        texts = list[str]()
        for k in (of[is_permitted].argmin(), of[is_permitted].argmax()) if is_permitted.any() else ():
            load, at = float(of[is_permitted][k]), format_radius(radius[is_permitted][k])
            texts.append(ceiling(study) if load >= loads.up_to else f"{rounded(load)} ({at})")
        return " to ".join(dict.fromkeys(texts))

    names = [*(str(limit["name"]) for limit in limits), STABILITY_WORDS]
    counts = {name: int((loads.which_lower == k).sum()) for k, name in enumerate(names)}
    has_bars = bool(study.study_file["error_bars"])
    return prose(
        "headline",
        payload=payload_sentences(study.figures, rounded, has_bars) if lifts_more(study.figures) else "",
        governing={name: n for name, n in sorted(counts.items(), key=lambda item: -item[1]) if n},
        postures=postures,
        empty=int((~is_permitted).sum()),
        not_permitted=NOT_PERMITTED,
        to_use=ends(loads.lower_bound),
        without_bars=ends(loads.least) if has_bars else "",
        looks_at_walls=any(of["of"] == "field" or of["of"] == "pad" and of.get("most") for of in limits),
        looks_at_pads=any(of["of"] == "pad" for of in limits),
    )


def terminal_grid(results: StudyResults, rows: int, study_file: Summary) -> Grid:
    """Build the terminal's table of a chart, with a row for each of at most `rows` extensions.

    A row has the extensions, the boom length, the range of the radius, and the least and the largest load to use, less
    its error bar.  The caption says where more is, or how many extensions are still missing.  `study_file` are the keys
    of the study file.
    """
    up_to, has_bars = float(study_file["up_to"]), bool(study_file["error_bars"])
    names = list(dict.fromkeys(name for run in results.done for name in run.parameters))
    lines, empty = [], False
    for run in results.done[:rows]:
        arrays = results.arrays(run.key)
        place, load = arrays["place"], ChartLoads(arrays["load"], arrays["error"], up_to).lower_bound
        load = np.where(load >= up_to, np.inf, load)
        empty = empty or bool((load == 0.0).any())
        cells = [_load_cell(float(load[at])) for at in (load.argmin(), load.argmax())]
        lines.append(
            (
                *(f"{float(run.parameters[name] or 0.0):.3g}" for name in names),
                f"{np.linalg.norm(place[0]):.2f}",
                "–".join(f"{round_down(float(end), 0.01):g}" for end in (place[:, 0].min(), place[:, 0].max())),
                *cells,
            )
        )
    more = f"{len(results.done) - rows} more extensions, and all" if len(results.done) > rows else "All"
    sign = f"{NO_LOAD} is {NOT_PERMITTED}. " if empty else ""
    if len(results.done) == len(results.runs):
        caption = f"{sign}{more} points are in chart.csv, loads over radius in duty.csv, pages to print in report.pdf."
    else:
        missing = f"{len(results.runs) - len(results.done)} of {len(results.runs)} extensions are missing"
        caption = f"{sign}This chart is not complete: {missing}. Loads over radius are written when all are computed."
    heads = (*(f"{name.removeprefix('extension.')} out [m]" for name in names), "boom length [m]", "radius [m]")
    caption = f"{'Error bars are taken off the loads.' if has_bars else 'The loads have no error bars.'} {caption}"
    used = " to use" * has_bars
    return Grid(caption, (*heads, f"least load{used} [kg]", f"largest load{used} [kg]"), tuple(lines))


def _load_cell(load: float) -> str:
    """Format a load in kg, rounded down, for the terminal; `NO_LOAD` for 0, and words where no limit is reached."""
    if np.isinf(load):
        return "no limit reached"
    return NO_LOAD if load == 0.0 else f"{np.floor(load):.0f}"


#: Most boom lengths in the tables of loads, and most of them side by side: more are cut off on paper.
MOST_LENGTHS, LENGTHS_BESIDE = 24, 6


def limit_grid(study: FinishedStudy, names: list[str], parts: Parts, loads: ChartLoads) -> Grid:
    """Build the table of the limits `names`: amount, factor, and numbers of postures.

    What a quantity leaves out stands in a line below its name.  The numbers of postures are those at which the limit
    governs the load to use, is not reached, or is passed without a load.  `parts` are the results of the study, and
    `loads` are those of all limits in all postures.
    """
    limits = {str(limit["name"]): limit for limit in study.study_file["limits"]}
    rows = []
    for n, (name, remark) in enumerate(zip(names, parts[0]["at.remarks"], strict=True)):
        limit = limits.get(name, {"of": "loss of equilibrium", "factor": 1.0})
        amount = limit.get("most") or limit.get("least")
        of_load, of = loads.load[..., n], str(limit["of"])
        quantity = "pressures of pads" if of == "pad" and amount is None else LIMITED[of].label if of in LIMITED else of
        counts = (str(which.sum()) for which in (loads.which_lower == n, np.isnan(of_load), of_load == 0.0))
        first = parts[0]["at.remarks"].tolist().index(remark)  # a remark stands once
        of_limit = f"as for {letters(first)}" if remark and first < n else str(remark)
        rows.append(
            (
                f"{letters(n)} {STABILITY_WORDS if name == STABILITY else name}",
                "\n".join(filter(None, (quantity, of_limit))),
                _format_amount(limit, amount),
                f"{limit['factor']:g}",
                *counts,
            )
        )
    heads = ("limit", "quantity", "amount", "factor", "governs", "not reached", "exceeded by the empty boom")
    caption = prose("limits", turns=len(parts[0]["at.slewing"]), up_to=format_load(study.study_file["up_to"]))
    return Grid(caption, heads, tuple(rows), "blocks")


def error_bar_grids(study: FinishedStudy, names: list[str], parts: Parts) -> list[Grid]:
    """List with one table of the error bars of the limits `names`, and of the bars' parts, as shares of the load.

    The bars are half widths.  Each cell has the median over all points of the chart at which a load reaches the limit;
    the last column has the largest total.  Limits that no load of the chart reaches have no row.  The list is empty if
    the study has no error bars.
    """
    if not study.study_file["error_bars"]:
        return []
    load, shown = np.concatenate([part["load"] for part in parts]), present_parts(parts)
    errors, rows = ["error", *(f"error.{of}" for of in shown)], []
    for k, name in enumerate(names):
        some = load[:, k] > 0.0
        if not some.any():
            continue  # no load of the chart reaches this limit
        shares = [np.concatenate([p[of][:, k] for p in parts])[some] / load[some, k] for of in errors]
        rows.append(
            (
                STABILITY_WORDS if name == STABILITY else name,
                *(_format_share(np.median(share)) for share in shares),
                _format_share(shares[0].max()),
            )
        )
    caption = "Half width of the error bars as a share of the load: medians over all points, and the largest total. "
    caption += "The median of the totals is not the sum of the other medians. "
    caption += "Limits that no load of the chart reaches are not listed."
    heads = ["large rotations" if of == "rotation" else "play of pads" if of == "play" else of for of in shown]
    return [Grid(caption, ("limit", "total", *heads, "largest total"), tuple(rows), "blocks")]


def present_parts(parts: Parts) -> list[str]:
    """List the names of the parts of error bars: all of them, but the play of pads only where it was computed."""
    play = any(np.isfinite(part["error.play"]).any() for part in parts if "error.play" in part)
    return [of for of in charting.PARTS if of != "play" or play]


def _format_share(share: float) -> str:
    """Format a share in per cent; NaN is printed as ``not known``, and a share below 1e-5 as 0."""
    return "not known" if np.isnan(share) else f"{two_digits(100.0 * share)}{SPACE}%" if share >= 1e-5 else "0"


def case_grid(study: FinishedStudy) -> Grid:
    """Build the table of load cases: factors of weights and load, wind, loads of the scene, and the verdict."""
    rows = []
    for content in study.study_file["cases"]:
        case = LoadCase.model_validate(content)
        hoisted = case.hoisting_factor(study.study_file["classes"])
        load = (
            f"{case.load:g}"
            if case.hoisting_class is None
            else f"{f'{case.load:g} × ' if case.load != 1.0 else ''}{hoisted:.4g} ({case.hoisting_class})"
        )
        stands = study.figures.get(f"stands.{case.name}")
        verdict = "in service" if case.in_service else f"stands at {stands} points"
        rows.append(
            (
                case.name,
                f"{case.weight:g}",
                f"{case.machine:g}",
                load if case.in_service else "0",
                _wind_size(case) or "none",
                _acting_forces(case) or "none",
                verdict,
                case.standard or "not stated",
            )
        )
    heads = (
        "case",
        "boom's weight",
        "machine's weight",
        "load",
        "wind",
        "loads of the scene",
        "state",
        "source of factors",
    )
    return Grid(
        "What acts together in each load case: factors of weights and load, pressure of the wind, and loads.",
        heads,
        tuple(rows),
        "blocks",
    )


def _format_amount(limit: Mapping[str, object], amount: float | None) -> str:
    """Format the amount of a limit with its unit.

    If the amount is None, the text is ``none``.  For a limit on pads it is ``of each pad`` instead, as each pad has its
    own allowed pressure.
    """
    if amount is None:
        return "of each pad" if limit["of"] == "pad" else "none"
    unit = "Pa" if limit.get("area") else KINDS[str(limit["of"])].unit
    if unit == "Hz":
        return f"{amount:g}{SPACE}Hz"  # nobody speaks of a boom's millihertz
    if limit["of"] == "tipping":
        return format_percent(amount)  # of the way from the middle of the support polygon to its edge
    return format_quantity(amount, unit) if unit else f"{amount:g}"


def duty_grids(study: FinishedStudy, duty: DutyTable, not_covered: str) -> Iterator[Grid]:
    """Yield the duty table of loads to use, with letters of limits over radius and boom length, then that without bars.

    At most `MOST_LENGTHS` boom lengths are shown.  Both tables have a part for each group of `LENGTHS_BESIDE` of them;
    a part leaves out radii at which none of its booms has a load.  A study without error bars has one table.  The first
    caption says what is `not_covered` by error bars.
    """
    columns, step = spread_indices(len(duty.lengths), MOST_LENGTHS), load_step(float(np.nanmax(duty.load, initial=0.0)))

    def cell(r: int, e: int, values: Array, which: NDArray[np.int64]) -> str:
        """Text of `values` (radii, lengths) in kg at radius number `r` and length number `e`, with the limit's letter.

        `which` (radii, lengths) are the numbers of the limits, -1 for none.  For NaN the text is `OUTSIDE`.  If no
        limit is reached, it is ``>`` and the largest load that was tried.  If nothing remains after rounding down, it
        is `NO_LOAD`.
        """
        if np.isnan(values[r, e]):
            return OUTSIDE
        if values[r, e] >= duty.up_to:
            return duty.load_text(values[r, e])
        letter = letters(int(which[r, e])) if which[r, e] >= 0 else "–"
        load = round_down(float(values[r, e]), step)
        return f"{load:.10g}{SPACE}{letter}" if load > 0.0 else f"{NO_LOAD}{SPACE}{letter}"

    has_bars = bool(study.study_file["error_bars"])
    caption = prose(
        "duty",
        has_bars=has_bars,
        not_covered=not_covered,
        step=f"{step:g}{SPACE}kg",
        no_load=NO_LOAD,
        outside=OUTSIDE,
        not_permitted=NOT_PERMITTED,
        is_small=(duty.lower[:, columns] < step).any(),
        beyond=f"{duty.up_to:.0f}" if (duty.load >= duty.up_to).any() else "",
        apart=f"{two_digits(100.0 * duty.interpolation)}{SPACE}%" if duty.interpolation > 5e-5 else "",
        shown=len(columns),
        count=len(duty.lengths),
    )
    tables = [("Load", caption, duty.load, duty.which)]
    if has_bars:
        without = "Load without error bars, in kg, for comparison. Another limit than above may govern it."
        tables = [
            ("Load to use", caption, duty.lower, duty.which_lower),
            ("Load without error bars", without, duty.load, duty.which),
        ]
    parts_of_columns = np.array_split(columns, -(-len(columns) // LENGTHS_BESIDE))
    digit = 0.01 if np.diff(duty.radii).min(initial=np.inf) >= 0.01 - 1e-9 else 1e-4
    for name, text, values, which in tables:
        for n, part in enumerate(parts_of_columns):
            head = (
                f"{name}, kg, at radius in m",
                *(
                    ", ".join([f"{duty.lengths[e]:.2f}{SPACE}m", *_extension_words(duty.extensions[e : e + 1])])
                    for e in part
                ),
            )
            rows = [
                (f"{round_down(radius, digit):g}", *(cell(r, int(e), values, which) for e in part))
                for r, radius in enumerate(duty.radii)
            ]
            caption = f"{name} for longer booms, in kg." if n else text
            yield Grid(caption, head, tuple(row for row in rows if set(row[1:]) != {OUTSIDE}), "small")


def _extension_words(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield the extensions in m of each of `rows`, sections with the same one together: ``middle/fly 2.48``."""
    for row in rows:
        names = dict[str, list[str]]()
        for parameter, out in row.items():
            names.setdefault(f"{float(out or 0.0):.3g}", []).append(parameter.removeprefix("extension."))
        yield from (f"{'/'.join(of)}{SPACE}{out}" for out, of in names.items())


#: Arrays by name of each run of a study, one mapping for each run.
Parts = Sequence[Mapping[str, Array]]
