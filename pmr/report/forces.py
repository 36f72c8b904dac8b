"""Sections about forces, and about what drives a boom: histories, and tables of the least and largest values."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from pmr.files.arrays import Summary
from pmr.report.blocks import Block, Drawing, Grid
from pmr.report.columns import Force, forces_of
from pmr.report.figures import drawing
from pmr.report.figures.histories import output_figure, panel_figure
from pmr.report.numbers import format_percent, format_quantity, format_time, prose
from pmr.report.sentences import Measured, extremes_grid, extremes_of
from pmr.report.subject import (
    drive_of,
    force_words,
    has_free_luffing,
    has_pushing_pads,
    is_alone,
    is_luffing_cylinder_alone,
    shown_force_name,
    support_words,
)
from pmr.results import RunResult
from pmr.results.quantities import REACTION_OF, UNIT_QUANTITIES
from pmr.results.response import ROUND_OFF, Output
from pmr.results.tables import reaction_extremes
from pmr.scene.keys import LUFFING_CYLINDER
from pmr.scene.mechanism import AT_PIVOT, CYLINDER

MOST_FORCES = 4  # largest number of panels in one figure
SLIGHT = 0.01  # share of the largest force of a kind below which a force has no panel
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
    """Figure to be drawn of outputs of one unit over time: end of its identifier, its caption and its outputs."""

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

    `prefix` begins the identifiers of its figures.  None if there are no such cylinders and ropes.
    """
    caption = "Forces of ropes or chains, all strands of each together, and of a cylinder that moves all of them: by "
    caption += "virtual work, without friction of sheaves"
    ropes = extremes_grid(result, caption, rope_forces(result.summary))
    return _force_block(result, prefix, "cylinder", "cylinder forces", ropes)


def rope_forces(summary: Summary) -> list[Measured]:
    """Extremes of the force of each rope in a `summary`, and of each cylinder that pulls ropes.

    An elastic rope is named with its length and stiffness.
    """
    forces = list[Measured]()
    for rope in summary.get("ropes", ()):
        elastic = ""
        if "length" in rope:
            length, stiffness = format_quantity(rope["length"], "m"), format_quantity(rope["stiffness"], "N/m")
            elastic = f", {length} long, EA/l {stiffness}"
        name = f"{drive_of(rope)} of {rope['name']}{elastic}"
        forces.append(Measured.from_summary(name, "rope_force", rope["force"]))
    return forces


def support_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about supports, with figures over time and tables of extremes; None if there is nothing to show.

    There is something to show if a support is elastic, or if a rigid support other than the pivot bears a force.  The
    figures have the forces of elastic supports, the tables those of elastic and rigid supports.  `prefix` begins the
    identifiers of the figures.
    """
    caption = "Least and largest forces and moments on rigid supports, positive along the axes"
    if "ground" in result.summary:
        caption += " (those on the ground along the axes of the machine, with moments about the pivot)"
    return _force_block(result, prefix, "support", "supports", _reaction_grid(result, False, caption))


def pivot_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about forces on the machine, and their moments about the pivot; None if the run has none.

    The forces are those of all of the boom's supports together.  A table has the extremes of the luffing cylinder.
    `prefix` begins the identifiers of the figures.
    """
    if result.frame is None:
        return None  # supports may be called so
    outputs = [output for output in result.responses["reduced"].outputs if output.name.startswith(REACTION_OF + PIVOT)]
    has_cylinder = any(output.name == CYLINDER for output in outputs)
    on = "of the boom on its machine"
    panels = [
        Panel(
            f"pivot-{name}",
            prose(
                "pivot",
                quantity=quantity,
                has_cylinder=has_cylinder and unit == "N",
                is_computed=has_free_luffing(result),
            ),
            _acting_outputs(result, outputs, unit),
        )
        for unit, quantity, name in (
            ("N", f"Forces {on}", "forces"),
            ("N m", f"Moments {on} about the pivot", "moments"),
        )
    ]
    grids = (
        _reaction_grid(result, True, "Least and largest forces and moments on the machine"),
        _driven_grid(result, "luffing_cylinder"),
    )
    return _output_block(result, prefix, "Forces on the machine", panels, grids)


def ground_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about forces of outriggers, margins against tipping and the use of the support polygon.

    `prefix` begins the identifiers of its figures.  None if the machine has no ground.
    """
    if (ground := result.summary.get("ground")) is None:
        return None
    captions = {
        "outrigger": "Forces of the outriggers on the ground; 0 where one lifts off.",
        "margin": "Margins against tipping over the edges of the support polygon: moments that hold the machine down.",
        "tipping": "Use of the support polygon: 0 where the resultant meets its middle, 100 % where the machine tips.",
    }
    panels = [Panel(f"ground-{kind}", caption, _of_kind(result, kind)) for kind, caption in captions.items()]
    measured = [
        Measured.from_summary(f"{of_what}{of['name']}", quantity, of)
        for key, quantity, of_what in (
            ("outriggers", "outrigger_force", "outrigger "),
            ("margins", "tipping_margin", "edge from "),
        )
        for of in ground[key]
    ]
    grid = extremes_grid(
        result, "Least and largest force of each outrigger and margin against tipping over each edge", measured
    )
    texts = [
        f"{of['name']} lifts off at {format_time(of['lifted']['t'])}" for of in ground["outriggers"] if "lifted" in of
    ]
    texts += [] if ground["tips"] is None else [f"the machine tips at {format_time(ground['tips'])}"]
    text = "; ".join(texts) or "all outriggers press on the ground all the time"
    text = f"{text[:1].upper()}{text[1:]}."
    return _output_block(result, prefix, "Outriggers and tipping", panels, [grid], text)


def driven_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about what drives a computed luffing angle or extension, over time.

    The block has the extension, the force on it, pressures, flows and power.  The result is None if angle and
    extensions are prescribed, and for a computed luffing angle that nothing drives.  `prefix` begins the identifiers of
    the figures.
    """
    outputs = [output for output in result.responses["reduced"].outputs if output.kind != "probe"]
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
    grid = _driven_grid(result, "extension_cylinder")
    return _output_block(result, prefix, "Extension" if driven else "Luffing", panels, [grid])


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
    measured = [Measured.from_summary(name, quantity, hoist[key]) for name, (key, quantity) in HOIST.items()]
    text = prose("hoist", factor=hoist["factor"], weight=hoist["weight_force"], slack=hoist.get("slack", ()))
    return _output_block(result, prefix, "Hoist", panels, [extremes_grid(result, "The hoist", measured)], text)


def _output_block(
    result: RunResult, prefix: str, heading: str, panels: Iterable[Panel], grids: Iterable[Grid], text: str = ""
) -> Block | None:
    """Build a block with a figure for each of the `panels` that has outputs, and with the `grids` that have rows.

    `heading` and `text` stand above them, and `prefix` begins the identifiers of the figures.  The result is None if
    there are neither figures nor tables.
    """
    drawings = [
        drawing(f"{prefix}-{panel.anchor}", output_figure, panel.caption, result, panel.outputs)
        for panel in panels
        if panel.outputs
    ]
    shown = tuple(grid for grid in grids if grid.rows)
    return Block(heading, drawings, text=text, grids=shown) if drawings or shown else None


def _of_kind(result: RunResult, kind: str) -> list[Output]:
    """Outputs of one `kind` in the response of the reduced model, without those that are zero at all times."""
    response = result.responses["reduced"]
    return [output for output in response.outputs if output.kind == kind and np.any(response.other(output.name))]


def _acting_outputs(result: RunResult, outputs: Sequence[Output], unit: str) -> list[Output]:
    """Choose those of `outputs` in this `unit` that at any time exceed round-off of the largest one in this unit."""
    response = result.responses["reduced"]
    sizes = [(output, float(np.abs(response.other(output.name)).max())) for output in outputs if output.unit == unit]
    largest = max((size for _, size in sizes), default=0.0)
    return [output for output, size in sizes if size > ROUND_OFF * largest]


def _reaction_words(name: str, unit: str) -> str:
    """Words for a reaction called `name`, such as ``pivot of base, about x``, or ``force along x`` of all supports."""
    words = support_words(name)
    return f"{UNIT_QUANTITIES[unit]} {words}" if words.startswith(("along ", "about ")) else words


def _driven_grid(result: RunResult, key: str) -> Grid:
    """Build the table of extremes of a cylinder (stroke, force, pressures, flow, power) from the summary's entry `key`.

    The table has no rows if the summary has no such entry.
    """
    keys = {"force": "luffing_force", "use": "luffing_use"}
    measured = [
        Measured.from_summary(name.replace("_", " "), keys.get(name) or f"driven_{name.partition('_')[0]}", extremes)
        for name, extremes in result.summary.get(key, {}).items()
        if name != "stops"
    ]
    measured = [of._replace(unit="%") if of.name == "use" else of for of in measured]
    raises = key == "luffing_cylinder"
    what = "the luffing cylinder" if raises else "the cylinder that drives the extension"
    signs = " A force is positive where the cylinder pushes, a speed where the cylinder gets longer."
    return extremes_grid(result, f"Least and largest values of {what}", measured, signs)


def _force_block(result: RunResult, prefix: str, kind: str, heading: str, *more: Grid) -> Block | None:
    """Build a block about outputs of one kind: figures of forces, figures of moments, tables of extremes.

    A figure has at most `MOST_FORCES` panels.  Two sentences name the forces without a panel: forces that are round-off
    at all times, and forces below the share `SLIGHT` of the largest one with the same unit.  The table of extremes
    lacks only the forces that are round-off.

    `heading` is the title of the block, `prefix` begins the identifiers of the figures, and `more` are further tables.
    The result is None if there are no outputs of this kind and all further tables are without rows.
    """
    forces, drawn = forces_of(result, kind), list[Drawing]()
    anchor = "forces" if kind == "pad" else kind
    bearing = [force for force in forces if exceeds_round_off(result, force)]
    slight = list[Force]()
    for unit in ("N", "N m"):
        sizes = [(force, _size(result, force)) for force in bearing if force.unit == unit]
        least = SLIGHT * max((size for _, size in sizes), default=0.0)
        shown = [force for force, size in sizes if size >= least]
        slight += [force for force, size in sizes if size < least]
        for first in range(0, len(shown), MOST_FORCES):
            panels = {force.name: force.history for force in shown[first : first + MOST_FORCES]}
            name, quantity = f"{prefix}-{anchor}-{len(drawn) + 1}", UNIT_QUANTITIES[unit].capitalize()
            caption = _caption(result, kind, unit, is_first=first == 0)
            drawn.append(drawing(name, panel_figure, caption, result, panels, unit, quantity))
    idle = [force.name for force in forces if force not in bearing]
    text = f"There is no force at any time on {', '.join(idle)}. " if idle else ""
    named = ", ".join(force.name for force in slight)
    text += f"Forces below {format_percent(SLIGHT, 1)} of the largest one are not drawn: {named}." if slight else ""
    grids = tuple(grid for grid in (_force_grid(result, kind, bearing), *more) if grid.rows)
    if not forces and not grids:
        return None
    return Block(heading.capitalize(), drawn, text=text.strip(), grids=grids, grids_first=True)


def exceeds_round_off(result: RunResult, force: Force) -> bool:
    """Whether a force exceeds round-off at any time in any of the models."""
    responses = result.responses.values()
    return any(float(np.abs(force.history(of)).max(initial=0.0)) > of.force_floor for of in responses)


def _size(result: RunResult, force: Force) -> float:
    """Largest absolute value of a force, in N or N m, at any time in any of the models."""
    return max(float(np.abs(force.history(of)).max(initial=0.0)) for of in result.responses.values())


def _caption(result: RunResult, kind: str, unit: str, is_first: bool) -> str:
    """Caption of a figure of forces of one `kind`, or of moments if `unit` is ``N m``.

    The caption of a figure that is not the first one of its kind says so.
    """
    return prose(
        "forces",
        kind=kind,
        is_moment=unit == "N m",
        is_alone=is_alone(result),
        is_slider=is_alone(result) and not result.scene.pads,
        is_luffing_cylinder=kind == "support" and is_luffing_cylinder_alone(result),
        has_friction=any("friction" in of for of in result.summary.get("cylinders", ())),
        has_ropes=bool(result.summary.get("ropes")),
        has_peaks=result.responses["reduced"].force_peaks is not None and has_pushing_pads(result),
        is_first=is_first,
    )


def _force_grid(result: RunResult, kind: str, forces: Sequence[Force]) -> Grid:
    """Build the table of extremes of the `forces` (or moments) of one kind, with the largest friction if it is known.

    The table is empty for supports if the luffing cylinder is the only one that gives way, and the summary has an entry
    on this cylinder: its own table has the force.
    """
    response = result.responses["reduced"]
    friction = {of["name"]: f", friction up to {format_quantity(of['friction'], 'N')}"
                for of in result.summary.get("cylinders", ()) if "friction" in of}  # fmt: skip
    measured = [
        Measured(
            f"{force.name}{friction.get(force.name, '')}", force.unit, extremes_of(result, force.history(response))
        )
        for force in forces
    ]
    on, signs = " on supports that give way" if kind == "support" else "", SIGNS.get(kind, "")
    if kind == "support" and is_luffing_cylinder_alone(result):
        on, signs = " of the luffing cylinder", " The force is positive where the cylinder pushes."
        measured = [] if "luffing_cylinder" in result.summary else measured  # the table of the cylinder has this force
    return extremes_grid(result, f"Least and largest forces{on}", measured, signs, response.force_floor)


def _reaction_grid(result: RunResult, at_pivot: bool, caption: str) -> Grid:
    """Build the table, with its `caption`, of the extremes of forces and moments on rigid supports that bear any.

    If `at_pivot` is true, the forces are those at the pivot of a boom in a frame, the sums over all supports.  If it is
    false, they are those on each of the other supports.  If the luffing angle is prescribed and the summary has an
    entry on the luffing cylinder, the cylinder's force is left out, as it has its own table.
    """
    response, measured = result.responses["reduced"], list[Measured]()
    for of, extremes in reaction_extremes(response, result.abscissa_at(response.t)).items():
        is_at_pivot = result.frame is not None and of.support.startswith(PIVOT)
        if extremes.size > 0.0 and is_at_pivot == at_pivot:  # a support bears no force if nothing acts along it
            name = shown_force_name(of.support).removeprefix(PIVOT)
            if name == LUFFING_CYLINDER and not has_free_luffing(result) and "luffing_cylinder" in result.summary:
                continue  # the table of the cylinder has this force
            name += ", by the moment about the pivot" if name == LUFFING_CYLINDER else ""
            measured.append(Measured(_reaction_words(name, of.unit), of.unit, extremes))
    return extremes_grid(result, caption, measured)
