"""Sections about forces, and about what drives a boom: histories, and tables of the least and largest values."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pmr.files.arrays import Summary
from pmr.report.blocks import Block, Drawing, Grid
from pmr.report.columns import Force, forces_of
from pmr.report.figures.canvas import drawing
from pmr.report.figures.histories import output_figure, panel_figure
from pmr.report.numbers import (
    NOTHING,
    SPACE,
    Unit,
    format_input,
    format_quantity,
    format_time,
    significant,
    unit_for,
)
from pmr.report.subject import (
    crossing,
    drive_of,
    force_words,
    has_free_luffing,
    has_pushing_pads,
    is_alone,
    is_luffing_cylinder_alone,
    moving_part,
    shown_force_name,
)
from pmr.results import RunResult
from pmr.results.quantities import QUANTITIES, UNIT_QUANTITIES
from pmr.results.response import ROUND_OFF, Extremes, Output
from pmr.results.tables import REACTION_OF, reaction_extremes
from pmr.scene.keys import LUFFING_CYLINDER
from pmr.scene.mechanism import AT_PIVOT

MOST_FORCES = 6  # largest number of panels in one figure
#: Sentences on the sign of forces, by the kind of output, for forces whose signs seem to contradict another table.
SIGNS = {
    "support": " Positive along the axes: a support that is pressed down has a negative force, and so has one in place "
    "of a luffing cylinder while the cylinder pushes."
}
#: Beginning of the names of those supports whose forces are the reactions at the pivot.
PIVOT = f"{AT_PIVOT} "
#: Keys in summary.json of what a hoist does, by their names, and the quantities that they are.
HOIST = {"height of the hook": ("height", "hook_height"), "swing along the boom": ("swing_along", "swing"),
         "swing across the boom": ("swing_across", "swing"), "force of the rope": ("force", "hoist_force")}  # fmt: skip


class Panel(NamedTuple):
    """Figure of outputs of one unit over time: the end of its identifier, its caption and its outputs."""

    anchor: str
    caption: str
    outputs: Sequence[Output]


def contact_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about the forces of pads or sliders; None if the run has neither.

    `prefix` begins the identifiers of its figures.
    """
    return _force_block(result, prefix, "pad", "pad forces" if not is_alone(result) else force_words(result))


def cylinder_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about forces of ropes and of cylinders that push sections out.

    `prefix` begins the identifiers of its figures.  None if no cylinder pushes a section out.
    """
    block, ropes = _force_block(result, prefix, "cylinder", "cylinder forces"), rope_forces(result.summary)
    if block is None or not ropes:
        return block
    caption = "Forces of ropes or chains, all strands of each together, and of a cylinder that moves all of them: by "
    caption += "virtual work, without friction of sheaves"
    return replace(block, grids=(*block.grids, extremes_grid(result, caption, ropes, "N")))


def rope_forces(summary: Summary) -> dict[str, Extremes]:
    """Extremes of the force of each rope, by its name and, if it is elastic, its length and stiffness."""
    forces = dict[str, Extremes]()
    for rope in summary.get("ropes", ()):
        elastic = ""
        if "length" in rope:
            length, stiffness = format_quantity(rope["length"], "m"), format_quantity(rope["stiffness"], "N/m")
            elastic = f", {length} long, EA/l {stiffness}"
        forces[f"{drive_of(rope)} of {rope['name']}{elastic}"] = Extremes.from_summary(rope["force"])
    return forces


def support_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about supports; None if the run has none.

    It has figures of the forces of elastic supports over time, and tables of extremes for elastic and rigid supports.
    `prefix` begins the identifiers of the figures.
    """
    caption = "Least and largest forces and moments on rigid supports, positive along the axes"
    block, rigid = _force_block(result, prefix, "support", "supports"), _reaction_grids(result, False, caption)
    if block is None:
        return Block(heading="Supports", grids=rigid) if rigid else None
    return replace(block, grids=(*block.grids, *rigid))


def pivot_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about forces on the machine, and their moments about the pivot; None if the run has none.

    The forces are those of all of the boom's supports together.  `prefix` begins the identifiers of the figures.
    """
    outputs = [output for output in result.responses["reduced"].outputs if output.name.startswith(REACTION_OF + PIVOT)]
    note = ""
    if any(output.name.endswith("cylinder") for output in outputs):
        note = " The luffing cylinder carries a part of them, along itself, and the pivot the rest."
        if has_free_luffing(result):
            note += (
                " Its force here is the one that these moments need; the force of its drive, in the table below, "
                "differs from it by the moment of the structure's damping about the pivot."
            )
    of_boom = "of the boom on its machine, sum over all supports, in the axes of the boom."
    panels = [
        Panel(
            f"pivot-{name}",
            f"{what} {of_boom}{note if unit == 'N' else ''}",
            _acting_outputs(result, outputs, unit),
        )
        for unit, what, name in (("N", "Forces", "forces"), ("N m", "Moments about the pivot", "moments"))
    ]
    drawings = _draw_panels(result, prefix, panels)
    grids = (
        *_reaction_grids(result, True, "Least and largest forces and moments on the machine"),
        *_driven_grids(result, "luffing_cylinder"),
    )
    return Block(heading="Forces on the machine", drawings=drawings, grids=grids) if drawings else None


def ground_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about forces of outriggers and margins against tipping.

    `prefix` begins the identifiers of its figures.  None if the machine has no ground.
    """
    if (ground := result.summary.get("ground")) is None:
        return None
    captions = {
        "outrigger": "Forces of the outriggers on the ground; 0 where one lifts off.",
        "margin": "Margins against tipping over the edges of the support polygon: moments that hold the machine down.",
        "tipping": "Use of the support polygon: 0 where the resultant is in its middle, 1 where the machine tips.",
    }
    panels = [Panel(f"ground-{kind}", caption, _of_kind(result, kind)) for kind, caption in captions.items()]
    rows = [(of, unit) for key, unit in (("outriggers", "N"), ("margins", "N m")) for of in ground[key]]
    extremes = {of["name"]: Extremes.from_summary(of) for of, _ in rows}
    caption = "Least and largest force of each outrigger and margin over each edge"
    grid = extremes_grid(result, caption, extremes, {of["name"]: unit for of, unit in rows})
    texts = [
        f"{of['name']} lifts off at {format_time(of['lifted']['t'])}" for of in ground["outriggers"] if "lifted" in of
    ]
    texts += [] if ground["tips"] is None else [f"the machine tips at {format_time(ground['tips'])}"]
    text = "; ".join(texts) or "all outriggers press on the ground all the time"
    text = f"{text[:1].upper()}{text[1:]}."
    return Block("Outriggers and tipping", _draw_panels(result, prefix, panels), text=text, grids=(grid,))


def driven_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about what drives a computed luffing angle or extension, over time.

    It has the extension, the force on it, pressures, flows and power.  None if neither is computed, or nothing drives
    the luffing angle.  `prefix` begins the identifiers of its figures.
    """
    outputs = result.responses["reduced"].outputs
    driven = [output for output in outputs if output.name.startswith(("extension ", "rate of extension "))]
    extensions = [output for output in driven if output.name.startswith("extension of ")]
    flows = [output for output in _of_kind(result, "flow") if output.unit != "m^3"]
    panels = (
        Panel("luffing-extension", "Extension that is computed.", extensions),
        Panel(
            "luffing-force",
            "Force on the extension, positive where it pushes.",
            _acting_outputs(result, driven, "N"),
        ),
        Panel("luffing-pressure", "Pressures of the oil above that of the surroundings.", _of_kind(result, "pressure")),
        Panel("luffing-flow", "Flows into bore and rod side, and out of the supply.", flows),
        Panel(
            "luffing-power",
            "Power of the cylinder's force, and power out of the supply.",
            _of_kind(result, "power"),
        ),
    )
    drawings, heading = _draw_panels(result, prefix, panels), "Extension" if driven else "Luffing"
    return Block(heading, drawings, grids=_driven_grids(result, "extension_cylinder")) if drawings else None


def hoist_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about the hoist, with histories and a table of extremes; None if the run has none.

    `prefix` begins the identifiers of the figures.
    """
    if (hoist := result.summary.get("hoist")) is None:
        return None
    panels = (
        Panel("hoist-height", "Height of the hook.", _of_kind(result, "hook_height")),
        Panel(
            "hoist-swing",
            "Swing of the hook: along the boom, outwards positive, and across its plane.",
            _of_kind(result, "swing"),
        ),
        Panel("hoist-force", "Force of the rope.", _of_kind(result, "hoist_force")),
    )
    extremes = {name: Extremes.from_summary(hoist[key]) for name, (key, _) in HOIST.items()}
    units = {name: QUANTITIES[quantity].unit for name, (_, quantity) in HOIST.items()}
    weight, times = format_quantity(hoist["weight_force"], "N"), significant(hoist["factor"])
    text = f"The rope's largest force is {times} times that of the weight, {weight}."
    for span in hoist.get("slack", ()):
        start, end = (format_time(span[key]) for key in ("start", "end"))
        text += f" It is slack from {start} to {end}, then it pulls with up to {format_quantity(span['snatch'], 'N')}."
    grid = extremes_grid(result, "The hoist", extremes, units)
    return Block("Hoist", _draw_panels(result, prefix, panels), text=text, grids=(grid,))


def _draw_panels(result: RunResult, prefix: str, panels: Iterable[Panel]) -> list[Drawing]:
    """Draw each of the `panels` that has outputs; `prefix` begins the identifiers of the figures."""
    return [
        drawing(f"{prefix}-{panel.anchor}", output_figure, panel.caption, result, panel.outputs)
        for panel in panels
        if panel.outputs
    ]


def _of_kind(result: RunResult, kind: str) -> list[Output]:
    """Outputs of the reduced model of one kind that are not zero at all times."""
    response = result.responses["reduced"]
    return [output for output in response.outputs if output.kind == kind and np.any(response.other(output.name))]


def _acting_outputs(result: RunResult, outputs: Sequence[Output], unit: str) -> list[Output]:
    """Outputs in this unit that act: they exceed round-off compared with the largest of them."""
    response = result.responses["reduced"]
    sizes = [(output, float(np.abs(response.other(output.name)).max())) for output in outputs if output.unit == unit]
    largest = max((size for _, size in sizes), default=0.0)
    return [output for output, size in sizes if size > ROUND_OFF * largest]


def _driven_grids(result: RunResult, key: str) -> tuple[Grid, ...]:
    """Return one table with the extremes of what a cylinder does; none if the summary lacks this `key`."""
    if (cylinder := result.summary.get(key)) is None:
        return ()
    extremes = {name.replace("_", " "): Extremes.from_summary(of) for name, of in cylinder.items() if name != "stops"}
    by_name = {"force": "luffing_force", "use": "luffing_use"}
    keys = {name: by_name.get(name) or f"driven_{name.split()[0]}" for name in extremes}
    units = {name: QUANTITIES[quantity].unit for name, quantity in keys.items()}
    raises = key == "luffing_cylinder"
    what = "The luffing cylinder, hinged as frame.cylinder says" if raises else "What drives the extension"
    caption = f"{what}: positive where it presses, and where it gets longer"
    return (extremes_grid(result, caption, extremes, units),)


def _force_block(result: RunResult, prefix: str, kind: str, heading: str) -> Block | None:
    """Build a block about outputs of one kind: figures of forces, figures of moments, tables of extremes.

    A figure has at most `MOST_FORCES` panels.  Forces that are round-off at all times have no panel and are named in a
    sentence.  `heading` is the title of the block, and `prefix` begins the identifiers of the figures.  None if there
    are no outputs of this kind.
    """
    forces, drawn = forces_of(result, kind), list[Drawing]()
    if not forces:
        return None
    anchor = "forces" if kind == "pad" else kind
    bearing = [force for force in forces if exceeds_round_off(result, force)]
    for unit in ("N", "N m"):
        shown = [force for force in bearing if force.unit == unit]
        for first in range(0, len(shown), MOST_FORCES):
            panels = {force.name: force.history for force in shown[first : first + MOST_FORCES]}
            name, quantity = f"{prefix}-{anchor}-{len(drawn) + 1}", UNIT_QUANTITIES[unit].capitalize()
            drawn.append(drawing(name, panel_figure, _caption(result, kind, unit), result, panels, unit, quantity))
    idle = [force.name for force in forces if force not in bearing]
    text = f"No force at any time on {', '.join(idle)}." if idle else ""
    grids = (_force_grid(result, kind, bearing),) if bearing else ()
    return Block(heading=heading.capitalize(), text=text, drawings=drawn, grids=grids)


def exceeds_round_off(result: RunResult, force: Force) -> bool:
    """Whether a force exceeds round-off at any time in any of the models."""
    responses = result.responses.values()
    return any(float(np.abs(force.history(of)).max(initial=0.0)) > of.force_floor for of in responses)


def then_words(result: RunResult) -> str:
    """Clause on the coordinate at which extremes occur: the path coordinate s for a body alone, else the boom length.

    Where a mass on a wheel crosses another section, it is the place of the wheel.  The clause is empty if nothing
    slides.
    """
    if not moving_part(result):
        return ""
    if mover := crossing(result):
        return f", and the place of {mover} then"
    return f", and {'the path coordinate s' if is_alone(result) else 'the boom length'} then"


def _caption(result: RunResult, kind: str, unit: str) -> str:
    """Caption of a figure of forces of one `kind`, or of moments if `unit` is ``N m``."""
    in_parts = result.responses["reduced"].force_peaks is not None  # then steps were divided into parts
    peaks = in_parts and has_pushing_pads(result)
    within = " Of pads that only push, the largest force within each step." if peaks else ""
    if kind == "cylinder":
        note = "What a cylinder or rope pushes its section out with, friction included; negative where it pulls."
        return f"Cylinder forces over time. {note}"
    if kind == "support" and is_luffing_cylinder_alone(result):
        return "Force of the luffing cylinder, positive where it pushes."
    if kind == "support":
        return f"{'Moments' if unit == 'N m' else 'Forces'} of supports that give way, positive along the axes."
    if is_alone(result) and not result.scene.pads:
        return "Slider force: the multiplier λ of the constraint. The slider pushes with −λ on the body."
    inwards = "the body inwards" if is_alone(result) else "the sections apart"
    return f"Pad forces over time. Positive where a pad pushes {inwards}.{within}"


def _force_grid(result: RunResult, kind: str, forces: Sequence[Force]) -> Grid:
    """Build the table of extremes of forces and moments of one kind, with the largest friction if it is known."""
    response = result.responses["reduced"]
    friction = {of["name"]: f", friction up to {format_quantity(of['friction'], 'N')}"
                for of in result.summary.get("cylinders", ()) if "friction" in of}  # fmt: skip
    extremes, units = dict[str, Extremes](), dict[str, str]()
    for force in forces:
        name = f"{force.name}{friction.get(force.name, '')}"
        extremes[name] = Extremes.from_history(force.history(response), response.t, result.abscissa_at(response.t))
        units[name] = force.unit
    on, signs = " on supports that give way" if kind == "support" else "", SIGNS.get(kind, "")
    if kind == "support" and is_luffing_cylinder_alone(result):
        on, signs = " of the luffing cylinder", " Positive where it pushes."
    floor = ROUND_OFF * float(np.abs(response.slider_force).max())
    return extremes_grid(result, f"Least and largest forces{on}", extremes, units, signs, floor)


def _reaction_grids(result: RunResult, at_pivot: bool, caption: str) -> tuple[Grid, ...]:
    """Return one table, with its `caption`, of the extremes of forces and moments on rigid supports.

    If `at_pivot`, these are the forces at the pivot of a boom in a frame, which are sums over all supports; if not,
    they are those on all other supports.  The result is empty if no such support bears a force.
    """
    response, units, extremes = result.responses["reduced"], dict[str, str](), dict[str, Extremes]()
    for of, extreme in reaction_extremes(response, result.abscissa_at(response.t)).items():
        is_at_pivot = result.frame is not None and of.support.startswith(PIVOT)
        if extreme.size > 0.0 and is_at_pivot == at_pivot:  # a support bears no force if nothing acts along it
            name = shown_force_name(of.support).removeprefix(PIVOT)
            computed = name == LUFFING_CYLINDER and has_free_luffing(result)
            name += ", by the moment about the pivot" if computed else ""
            extremes[name], units[name] = extreme, of.unit
    return (extremes_grid(result, caption, extremes, units),) if extremes else ()


def extremes_grid(
    result: RunResult,
    caption: str,
    extremes: Mapping[str, Extremes],
    bases: Mapping[str, str] | str,
    remark: str = "",
    floor: float = 0.0,
    where: str | None = None,
) -> Grid:
    """Build a table with a row for each name in `extremes`: least and largest value, their times and their places.

    `bases` are the units without prefix, by name or one for all; values of one unit have one prefix.  A value is
    printed as 0 if it is less than `NOTHING` times the largest one with its unit, or if its magnitude is at most
    `floor`.  `where` are words for the places, by default `then_words`; `remark` is a sentence after the caption.
    """
    largest, units = dict[str, float](), {name: bases if isinstance(bases, str) else bases[name] for name in extremes}
    for name, of in extremes.items():
        largest[units[name]] = max(largest.get(units[name], 0.0), of.size)
    placed = where is not None or bool(moving_part(result))
    rows = []
    for name, of in extremes.items():
        most = largest[units[name]]
        cells = _extreme_cells(of, unit_for(most, units[name]), max(NOTHING * most, floor), placed)
        rows.append((name or "slider", *cells))
    there = then_words(result) if where is None else where
    return Grid(f"{caption}, when they occur{there}.{remark}", ("", "least", "largest"), tuple(rows))


def _extreme_cells(of: Extremes, unit: Unit, negligible: float, placed: bool) -> Iterator[str]:
    """Yield a cell for the least and one for the largest value in `unit`, each with its time and, if `placed`, place.

    A value whose magnitude does not exceed `negligible` is printed as ``0`` without time and place.  `negligible` is in
    the unit without prefix.
    """
    for extreme in (of.lowest, of.highest):
        place = f", {format_input(round(extreme.s, 2), 'm')}" if placed else ""
        value = f"{significant(extreme.value / unit.size)}{SPACE}{unit.name}".rstrip(SPACE)
        yield f"{value} at {format_time(extreme.t)}{place}" if abs(extreme.value) > negligible else "0"
