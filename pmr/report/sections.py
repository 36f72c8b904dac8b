"""Blocks of a run's chapter: one function for each block, which returns None if the result lacks the block's data.

A function whose block has figures takes the `prefix` of their identifiers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from pmr.errors import begin_aside
from pmr.files.arrays import Array, Summary
from pmr.report import first_page, forces, player, scene_tables, sentences, subject
from pmr.report.album import make_album
from pmr.report.blocks import Block, Chapter, Drawing, Grid, Notices, Player, Table, signed_deviation
from pmr.report.columns import axis_points, tip_displacements, undrawn_sentence
from pmr.report.errors import error_table, is_compared
from pmr.report.figures import drawing, histories, section_colours, shapes, space
from pmr.report.figures.histories import line_figure
from pmr.report.moving_bodies import MovingBodies
from pmr.report.numbers import NOTHING, SPACE, format_input, format_time, prose, significant, unit_for, with_sign
from pmr.report.sentences import Measured, extremes_grid
from pmr.report.subject import acting_loads, is_alone, moving_part, slider_offsets
from pmr.report.verdict import run_sentence, verdict
from pmr.results import Response, RunResult
from pmr.results.quantities import UNIT_QUANTITIES, stress_remark
from pmr.results.response import Extremes
from pmr.results.tables import WHOLE, probe_extremes, stress_by_part, summaries_by_section
from pmr.scene.keys import ALONE, qualified_name

Show = Callable[[RunResult, str], Block | None]


def chapter(result: RunResult, anchor: str, helper: Executor | None = None) -> Chapter:
    """Build the chapter about a run; `anchor` begins all identifiers in it.

    At the same time a process of `helper` draws every other section, unless `helper` is None.
    """
    drawn: list[Block | None] = [None] * len(SECTIONS)
    others = begin_aside(helper, _show_sections, SECTIONS[1::2], result, anchor)
    drawn[::2], drawn[1::2] = _show_sections(SECTIONS[::2], result, anchor), others()
    sections = [error_block(result), accuracy_block(result), *drawn]
    return Chapter(
        anchor=anchor,
        title=result.scene.title,
        sketch=system_drawing(result, anchor),
        first=first_page.first_page_tables(result),
        key_numbers=list(sentences.key_numbers(result)),
        opening=run_sentence(result),
        notices=Notices(verdict(result), result.summary.get("warnings", ())),
        blocks=[*filter(None, sections), origin_block(result)],
    )


def _show_sections(which: Sequence[Show], result: RunResult, anchor: str) -> list[Block | None]:
    """Build sections of a run's chapter; `anchor` begins all identifiers in them."""
    return [show(result, anchor) for show in which]


def system_drawing(result: RunResult, prefix: str) -> Drawing | None:
    """Draw the system from the side; `prefix` begins the figure's identifier.

    None if the run has no outputs along an axis.
    """
    if not axis_points(result):
        return None
    return drawing(f"{prefix}-sketch", space.side_view, space.view_caption(result, "from the side"), result)


def error_block(result: RunResult) -> Block | None:
    """Build the block with the error table of a run; None if the table has no rows.

    Its heading is "Errors" if the run was compared with another model, else "Largest values".
    """
    table = error_table(result)
    return Block(heading="Errors" if is_compared(result) else "Largest values", errors=table) if table.rows else None


def accuracy_block(result: RunResult) -> Block | None:
    """Build the block on the choices that meet a tolerance and the reasons for them; None if the run has no tolerance.

    The parts of the error are bars on the first page.
    """
    if (accuracy := result.summary.get("accuracy")) is None:
        return None
    reasons, budget = "; ".join(accuracy.get("reasons", ())), result.summary.get("budget", {})
    texts = [f"{reasons[:1].upper()}{reasons[1:]}."] if reasons else []
    texts += [f"Of all parts of the error, the {budget['first']} is to be improved first."] if "first" in budget else []
    return Block(heading="Choice of model and step", text=" ".join(texts))


def input_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block with figures of paths or extensions, loads, and angles of the boom over time.

    Angles that do not change and loads that do not act are left out.  Extensions are left out if none of them changes.
    None if nothing is left.  `prefix` begins the identifiers of the figures.
    """
    row, moves, colours = list[Drawing](), moving_part(result), section_colours(result.scene.bodies)

    def draw(
        name: str, caption: str, lines: Mapping[str, Array], base: str, quantity: str, *look: Sequence[str]
    ) -> None:
        """Append a figure of `lines`, histories (T,) by name, of the `quantity` in the unit `base`, over time.

        `name` ends the figure's identifier, and `caption` names what is drawn over time; `look` are colours of lines.
        """
        row.append(
            drawing(f"{prefix}-{name}", line_figure, f"{caption} over time.", result, lines, base, quantity, *look)
        )

    if moves and is_alone(result):
        ahead = {f"{moves} {with_sign(offset)} m" if offset else moves: offset for offset in slider_offsets(result)}
        lines = {name: result.abscissa + offset for name, offset in ahead.items()}
        draw("position", f"{moves.capitalize()} position along the body", lines, "m", "Position")
    elif np.ptp(result.paths.values, axis=0).any():
        lines = dict(zip(result.paths.names, result.paths.values.T, strict=True))
        draw("position", "Extension of each section", lines, "m", "Extension", [colours[name] for name in lines])
    by_unit = dict[str, dict[str, Array]]()
    for load in acting_loads(result):
        by_unit.setdefault(load.source.unit, {})[qualified_name(load.body, load.name)] = load.values
    for number, (unit, lines) in enumerate(by_unit.items()):
        draw(f"loads-{number}", "Loads", lines, unit, UNIT_QUANTITIES[unit].capitalize())
    if changing := subject.changing_angles(result):
        lines = {name: angle.value(result.responses["reduced"].t) for name, angle in changing.items()}
        draw("angles", " and ".join(changing).capitalize(), lines, "rad", "Angle")
    return Block("Prescribed motion and loads", row, text=_weight_sentence(result)) if row else None


def motion_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block with the animation of the motion, and pictures if the run has fields.

    The block is None if the run has neither fields nor outputs along an axis.  `prefix` begins the identifiers of the
    figures.
    """
    bodies, scale = MovingBodies(result), list[Drawing]()
    if not bodies.fields:
        return None
    data, pictures = player.body_motion(bodies), make_album(bodies, prefix)
    if bodies.cell_stresses and (data or pictures):
        caption = "Colours of the pictures: the largest von Mises stress of each cell"
        caption += f", {stress_remark(result.scene)}." if stress_remark(result.scene) else "."
        exceeded = max(float(of.max()) for of in bodies.cell_stresses.values()) > bodies.colour_limit
        scale.append(drawing(f"{prefix}-ramp", shapes.colour_scale, caption, bodies.colour_limit / 1e6, exceeded))
    return Block(
        heading="Motion",
        text=undrawn_sentence(result),
        player=Player(data, player.drawing_sentence(data)) if data else None,
        pictures=pictures,
        drawings=[*space.space_drawings(result, prefix), *histories.tip_drawings(result, prefix), *scale],
    )


def energy_block(result: RunResult, prefix: str) -> Block:
    """Build the block with the total energy and its parts; `prefix` begins the identifiers of its figures."""
    total, caption = attrgetter("energy.total"), "Total energy: kinetic and strain energy minus the work of the loads"
    first = histories.drawn_history(f"{prefix}-energy", result, total, caption, "Total energy", "J")
    caption = "Strain, kinetic and external energy; external energy is the work of the loads with the opposite sign"
    if result.scene.hoist is not None:
        caption += "; the strain energy includes the kinetic energy of the payload and the elastic energy of the rope"
    parts = {f"{part} energy": attrgetter(f"energy.{part}") for part in ("strain", "kinetic", "external")}
    drawn = drawing(f"{prefix}-energy-parts", histories.panel_figure, f"{caption}.", result, parts, "J", "Energy")
    return Block(heading="Energy", drawings=(first, drawn), text=sentences.energy_sentence(result))


def basis_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block with basis vectors, singular values of the snapshots, and natural frequencies.

    Basis vectors are drawn only if the tip moves along z alone.  Singular values are drawn only for a body alone whose
    basis is made from snapshots.  Figures and tables without data are left out; if nothing is left, the result is None.
    `prefix` begins the identifiers of the figures.
    """
    drawings = list[Drawing]()
    for number, (name, body) in enumerate(result.bodies.items()):
        if body.shapes is not None and set(tip_displacements(result)) == {"z"}:
            anchor, caption = f"{prefix}-basis{f'-{number}' if name else ''}", shapes.basis_caption(body.shapes)
            called = qualified_name(name, caption)
            drawings.append(drawing(anchor, shapes.basis_figure, called, result, body.shapes))
    grids, of = tuple(_published_frequency_grids(result)), result.body.shapes
    if is_alone(result) and of is not None and result.scene.reduction.uses_pod:  # other bases have singular values of 1
        caption = "Singular values of the snapshots. κ is the share of the sum of their squares that the basis keeps."
        drawings.append(drawing(f"{prefix}-singular-values", shapes.singular_value_figure, caption, result, of))
    has_basis = bool(drawings)
    if "reduced" in result.frequencies.models:
        drawings.append(
            drawing(f"{prefix}-frequencies", shapes.frequency_figure, shapes.frequencies_caption(result), result)
        )
    if (over := result.frequencies.over_joints) is not None:
        caption = prose("frequency_map", joints=over.joints, is_stressed=result.frequencies.t is not None)
        drawings.append(drawing(f"{prefix}-map", shapes.frequency_map_figure, caption, result))
    heading = "Basis and natural frequencies" if has_basis else "Natural frequencies"
    heading += "" if result.scene.hoist is None else ", without the payload of the hoist"
    heading += ", the luffing cylinder locked" if subject.has_free_luffing(result) else ""
    return Block(heading=heading, drawings=drawings, grids=grids) if drawings or grids else None


def _published_frequency_grids(result: RunResult) -> Iterator[Grid]:
    """Yield a table with the first natural frequency of each model and the published value.

    Nothing is yielded if no frequency is published.
    """
    rows, models = [], list[str]()
    for first in result.summary.get("published_frequencies", ()):
        models = [name for name in ("full", "reduced") if name in first]
        ours = [f"{first[name]:.4f} ({signed_deviation(first[name], first['published'])})" for name in models]
        rows.append((f"{first['reach']:.5g}{SPACE}m", f"{first['published']:g}", *ours))
    if rows and (published := result.scene.published) is not None:
        remarks = "".join(f" {remark}" for remark in published.remarks)
        caption = f"First natural frequency in Hz beside the published one ({published.source}).{remarks}"
        along = result.frequencies.along
        if len(along) > 1 and not np.ptp(along):
            caption += " The boom keeps its length; the frequency is the lowest one of its postures."
        yield Grid(caption, ("boom length", "published", *models), tuple(rows))


def response_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block with the frequency response of the tip; None if the scene does not ask for it.

    Loads that do not move the tip are left out.  `prefix` begins the identifiers of the figures.
    """
    response = result.frequency_response
    if response is None:
        return None
    drawings, grids = [], []
    condition = "everything at rest, each curve at one boom length in m"
    if is_alone(result):
        condition = "the sliders at rest, each curve at one s in m"
    for number, (load, output) in enumerate(zip(response.inputs, response.outputs, strict=True)):
        if not np.any(response.gain[:, :, number]):
            continue
        caption = f"Response of {output} to {load} with {condition}."
        drawings.append(drawing(f"{prefix}-response-{number}", shapes.gain_figure, caption, response, number))
        gains = result.summary["frequency_response"]["gain"][load]
        places = (format_input(round(float(s), 3), "m") for s in response.s)
        static, at = map(significant, gains["static"]), map(significant, gains["at"])
        largest = [significant(gain) if response.damped else "no damping" for gain in gains["largest"]]
        head = (subject.abscissa_label(result), f"static, {gains['unit']}", f"largest, {gains['unit']}", "at, Hz")
        grids.append(Grid(f"{output} under {load}", head, tuple(zip(places, static, largest, at, strict=False))))
    return Block(heading="Response in frequency", drawings=drawings, grids=tuple(grids))


def origin_block(result: RunResult) -> Block:
    """Build the last block: the scene's input, wall times, commit, date, machine, sizes and software of the run.

    Empty tables are left out.
    """
    all_tables = (
        *scene_tables.input_tables(result.scene),
        Table("Wall time", tuple(scene_tables.time_rows(result.summary.get("seconds", {})))),
        Table("Run", tuple(scene_tables.run_rows(result))),
        Table("Sizes", tuple(scene_tables.size_rows(result))),
    )
    shown = [table for table in all_tables if table.rows]
    return Block(heading="Provenance", tables=shown, software=scene_tables.software_versions(result.summary))


def _weight_sentence(result: RunResult) -> str:
    """Sentence that the weight acts and how it comes up; empty if no weight acts."""
    gravity = result.scene.gravity
    if gravity is None:
        return ""
    rise = (
        f" It grows from zero and has its full value from {format_input(gravity.rise, 's')} on." if gravity.rise else ""
    )
    turns = " Its direction in the boom's axes changes as the boom turns." if result.frame is not None else ""
    return f"The weight acts, too.{rise}{turns}"


def stress_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block with the largest stress of each body over time, and tables of its times and places.

    The block is None if the run has no stresses.  `prefix` begins the identifiers of the figures.
    """
    drawings, parts = [], {part["name"]: part for part in result.summary.get("sections", ())}
    for number, (name, body) in enumerate(result.bodies.items()):
        if "reduced" not in body.peak_stress:
            continue
        below = histories.Timeline(result).difference_clause(histories.stress_histories(result, body))
        peak = parts.get(name, result.summary).get("stress_peak", {}).get("reduced")
        dot = f" The dot marks the largest value, {sentences.peak_clause(peak)}." if peak else ""
        caption = f"Largest von Mises stress in {name or 'the whole body'}{below}.{dot}"
        anchor = f"{prefix}-stress" if name == ALONE else f"{prefix}-stress-{number}"
        drawings.append(drawing(anchor, histories.stress_figure, caption, result, body))
    grids = tuple(_part_grids(result))
    heading = " ".join(filter(None, ("Stress", stress_remark(result.scene))))
    return Block(heading=heading, drawings=drawings, grids=grids, grids_first=True) if drawings or grids else None


def section_force_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block on forces and moments of beams' cross-sections: envelopes over time and a table of extremes.

    Forces and moments of at most the share `NOTHING` of the largest one are left out.  For this comparison a moment is
    divided by the length of the boom.  The block is None if no beam has such forces.  `prefix` begins the identifiers
    of the figures.
    """
    largest, arms = dict[str, float](), {"N": 1.0, "N m": subject.reach(result)}
    for part in summaries_by_section(result.summary).values():
        for what, force in part.get("section_forces", {}).get("reduced", {}).items():
            if (arm := arms.get(force["unit"])) is not None:
                largest[what] = max(largest.get(what, 0.0), -force["min"] / arm, force["max"] / arm)
    shown = [what for what, value in largest.items() if value > NOTHING * max(largest.values())]
    if not shown:
        return None
    recovery = result.scene.recovery
    every = f" They are computed every {format_input(recovery.every, 's')}." if recovery and recovery.every else ""
    caption = f"Range over time of the section forces and moments at each place along each beam.{every}"
    drawn = drawing(f"{prefix}-envelopes", shapes.envelope_figure, caption, result, shown)
    measured = [
        Measured(qualified_name(name, what), force["unit"], Extremes.from_summary(force, "x_"))
        for name, part in summaries_by_section(result.summary).items()
        for what, force in part.get("section_forces", {}).get("reduced", {}).items()
        if what in shown and (force["min"] or force["max"])
    ]
    caption, where = "Least and largest section forces and moments", ", and their distance from the tail"
    signs = " Normal forces are positive in tension, moments y with tension at the top, moments z with it on the right."
    grid = extremes_grid(result, caption, measured, signs + every, where=where)
    return Block(heading="Forces along beams", drawings=(drawn,), grids=(grid,), grids_first=True)


def _part_grids(result: RunResult) -> Iterator[Grid]:
    """Yield a table with the largest stress of each part of each body in each model.

    Nothing is yielded for a single part in a single model.
    """
    peaks = stress_by_part(result.summary)
    if len(peaks.get("reduced", {})) < (1 if "full" in peaks else 2):
        return
    unit = unit_for(max(peak["value"] for peak in peaks["reduced"].values()), "Pa")
    full, rows = peaks.get("full", {}), []
    for name, peak in peaks["reduced"].items():
        place = ", ".join(significant(x, 3) for x in peak["position"])
        of_full_model = (significant(full[name]["value"] / unit.size, 4),) if full else ()
        value = significant(peak["value"] / unit.size, 4)
        called = name.removesuffix(f": {WHOLE}")
        rows.append((called, value, *of_full_model, format_time(peak["t"]), f"({place})", peak["face"]))
    values = (f"reduced model, {unit.name}", f"full model, {unit.name}") if full else (f"stress in {unit.name}",)
    head = ("", *values, "time", "x, y, z in m", "face or corner")
    caption = (
        "Largest von Mises stress of each part. Places are in the axes of the part's own section. Stresses between"
    )
    caption += " the places and times that are looked at, such as those at probes, may be larger."
    yield Grid(caption, head, tuple(rows))


#: Largest number of quantities of probes that are drawn and whose load cycles are counted; others are in tables only.
MOST_DRAWN = 4
#: A measurement of a probe is round-off up to this share of the largest measurement with the same unit.
UNSEEN = 1e-5


def probe_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block on probes: histories, extremes, load cycles of stresses and strains, and damage.

    Measurements that are round-off (`UNSEEN`) are left out, and only some histories are drawn (`_drawn_measurements`).
    The block is None if the scene has no probes.  `prefix` begins the identifiers of the figures.
    """
    probes = {probe["name"]: probe for probe in result.summary.get("probes", ())}
    response = result.responses["reduced"]
    measured = [
        Measured(name, {"1": "strain"}.get(unit := probes[name]["unit"], unit), extremes)
        for name, extremes in probe_extremes(response, result.abscissa_at(response.t)).items()
        if name in probes
    ]
    if not measured:
        return None
    largest = dict[str, float]()
    for _, unit, extremes in measured:
        largest[unit] = max(largest.get(unit, 0.0), extremes.size)
    measured = [of for of in measured if of.extremes.size > UNSEEN * largest[of.unit]]
    grid = extremes_grid(result, f"Least and largest values of {_places_of(probes.values())}", measured)
    figures = [
        _history_drawing(result, f"{prefix}-probe-{k}", of.name, of.unit)
        for k, of in enumerate(_drawn_measurements(measured))
    ]
    text = "The file tables/cycles.csv has all load cycles, counted by the rainflow method."
    if stress_remark(result.scene):
        text += (
            " A probe on a beam has the stress at that outer corner of the cross-section which is nearest to its place."
        )
    return Block("Probes", figures, text=text, grids=(grid, *_damage_grids(result)), grids_first=True)


def _damage_grids(result: RunResult) -> list[Grid]:
    """List with one table of the damage by each stress; empty if the scene has no S-N line."""
    fatigue = result.summary.get("fatigue")
    if not fatigue:
        return []
    rows = [(row["name"], _format_cycles(row["damage"]), _format_cycles(row["life"])) for row in fatigue]
    caption = "Damage by load cycles on the scene's S-N line, after Palmgren and Miner: 1 is failure. The life is the "
    return [Grid(f"{caption}number of such runs until failure.", ("", "damage", "life"), tuple(rows))]


def _format_cycles(value: float | None) -> str:
    """Format a damage, or a life in runs; None, which stands for a life without damage, is ``without end``."""
    return "without end" if value is None else significant(value)


def _drawn_measurements(measured: Sequence[Measured]) -> list[Measured]:
    """Choose which of `measured` are drawn: one component of each of the first `MOST_DRAWN` quantities.

    It is the component with the largest absolute value.
    """
    groups = dict[str, list[Measured]]()
    for of in measured:
        groups.setdefault(of.name.rpartition(" ")[0], []).append(of)
    return [max(group, key=lambda of: of.extremes.size) for group in groups.values()][:MOST_DRAWN]


def _history_drawing(result: RunResult, anchor: str, name: str, unit: str) -> Drawing:
    """Draw the measurement `name` of a probe in `unit` over time; `anchor` is the identifier of the drawing.

    Models that do not have this measurement have NaN for it, and are left out of the figure.
    """

    def values(response: Response) -> NDArray[np.float64]:
        """Measurement (T,) of a response; NaN if the response does not have it."""
        return response.other(name) if name in response.other_names else np.full(len(response.t), np.nan)

    label = " ".join(name.split(" ")[-2 : None if unit == "rad" else -1]).capitalize()  # a component would not fit
    return histories.drawn_history(anchor, result, values, name[:1].upper() + name[1:], label, unit)


def _places_of(probes: Iterable[Summary]) -> str:
    """Text that lists probes, from their entries in a summary, with the point and the face of each."""
    texts = dict[str, str]()
    for probe in probes:
        name = probe["name"].rpartition(" ")[0]
        place = ", ".join(significant(round(x, 4) + 0.0, 3) for x in probe["at"])
        texts[name] = f"{name} at ({place}){SPACE}m" + (f", {probe['face']}" if probe["face"] else "")
    return "; ".join(texts.values())


#: Functions of the blocks between that about accuracy and that about the origin, in the order of the page.
SECTIONS: tuple[Show, ...] = (
    motion_block, input_block, stress_block,
    section_force_block, probe_block, forces.contact_block,
    forces.cylinder_block, forces.support_block, forces.pivot_block, forces.ground_block, forces.driven_block,
    forces.hoist_block, energy_block, basis_block, response_block,
)  # fmt: skip
