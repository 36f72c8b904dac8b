"""Forces of pads, cylinders, ropes, hoist, supports and the pivot, as figures and tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pmr.files.arrays import Array
from pmr.report.blocks import Block, Drawing, Grid
from pmr.report.columns import Force, forces_by_group
from pmr.report.figures import loads as figures
from pmr.report.figures.canvas import drawing
from pmr.report.figures.histories import drawn_history
from pmr.report.numbers import NOTHING, Unit, format_input, format_quantity, format_time, significant, unit_for
from pmr.report.subject import (
    crossing,
    drive_of,
    force_words,
    has_free_luffing,
    has_pushing_pads,
    is_alone,
    is_luffing_cylinder_alone,
    moving_part,
    places_at,
    shown_force_name,
)
from pmr.results import RunResult
from pmr.results.quantities import QUANTITIES
from pmr.results.response import LUFFING_ANGLE, Extremes, Output, Response
from pmr.results.tables import REACTION_OF, reaction_extremes
from pmr.scene.hoist import KEYS
from pmr.scene.keys import LUFFING_CYLINDER

#: Share of the largest force up to which a force is round-off: a support along which nothing acts has a force that is
#: not exactly 0.
ROUND_OFF = 1e-9
#: Sentences on the sign of forces, by the kind of output, for forces whose signs seem to contradict another table.
SIGNS = {
    "support": " Positive along the axes: a support that is pressed down has a negative force, and so has one in place "
    "of a luffing cylinder while the cylinder pushes."
}
#: Beginning of the names of those supports whose forces are the reactions at the pivot.
PIVOT = "pivot "
AT_PIVOT = f"{REACTION_OF}{PIVOT}"


def contact_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about the forces of pads or sliders; None if the run has neither.

    `prefix` begins the identifiers of its figures.
    """
    return _force_block(result, prefix, "pad", "pad forces" if not is_alone(result) else force_words(result))


def cylinder_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about forces of ropes and of cylinders that push sections out; None without such cylinders.

    `prefix` begins the identifiers of its figures.
    """
    block, ropes = _force_block(result, prefix, "cylinder", "cylinder forces"), tuple(_rope_grids(result))
    return replace(block, grids=(*block.grids, *ropes)) if block else None


def _rope_grids(result: RunResult) -> Iterator[Grid]:
    """Yield a table with the extremes of the forces of ropes, chains, and the cylinders that pull them."""
    extremes_of_ropes = {
        f"{drive_of(rope)} of {rope['name']}": Extremes.from_summary(rope["force"])
        for rope in result.summary.get("ropes", ())
    }
    if extremes_of_ropes:
        caption = (
            "Forces of ropes or chains, all strands of each together, and of a cylinder that moves all of them: by "
        )
        caption += "virtual work, without friction of sheaves."
        grid = _grid(extremes_of_ropes, "N", max(of.size for of in extremes_of_ropes.values()), caption)
        elastic = [
            (format_quantity(rope["length"], "m"), format_quantity(rope["stiffness"], "N/m"))
            if "length" in rope
            else ("", "")
            for rope in result.summary["ropes"]
        ]
        if any(any(rope) for rope in elastic):
            rows = tuple((*row, *rope) for row, rope in zip(grid.rows, elastic, strict=True))
            grid = Grid(caption, (*grid.head, "length", "EA/l"), rows)
        yield grid


def support_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about supports; None if the run has none.

    It has figures of the forces of elastic supports over time, and tables of extremes for elastic and rigid supports.
    `prefix` begins the identifiers of the figures.
    """
    block, rigid = _force_block(result, prefix, "support", "supports"), tuple(reaction_grids(result))
    if block is None:
        return Block(heading="Supports", grids=rigid) if rigid else None
    return replace(block, grids=(*block.grids, *rigid))


def pivot_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about forces on the machine, and their moments about the pivot; None if the run has none.

    The forces are those of all of the boom's supports together.  `prefix` begins the identifiers of the figures.
    """
    response, row = result.responses["reduced"], list[Drawing]()
    acting = [
        reaction for reaction in response.outputs if reaction.kind == "reaction" and reaction.name.startswith(AT_PIVOT)
    ]
    for unit, what, name in (("N", "Forces", "forces"), ("N m", "Moments about the pivot", "moments")):
        some = [reaction for reaction in acting if reaction.unit == unit]
        largest = max((float(np.abs(response.other(reaction.name)).max()) for reaction in some), default=0.0)
        some = [reaction for reaction in some if np.abs(response.other(reaction.name)).max() > ROUND_OFF * largest]
        if some:
            caption = f"{what} of the boom on its machine, sum over all supports, in the axes of the boom."
            if any(reaction.name.endswith("cylinder") for reaction in some):
                caption += " The luffing cylinder carries a part of them, along itself, and the pivot the rest."
            if any(reaction.name.endswith("cylinder") for reaction in some) and has_free_luffing(result):
                caption += (
                    " Its force here is the one that these moments need; the force of its drive, in the table below, "
                    "differs from it by the moment of the structure's damping about the pivot."
                )
            row.append(drawing(f"{prefix}-pivot-{name}", figures.pivot_figure, caption, result, some))
    caption = "Least and largest {} on the machine, when they occur" + then_words(result) + "."
    grids = (*_rigid_support_grids(result, at_pivot=True, caption=caption), *_driven_grids(result, "luffing_cylinder"))
    return Block(heading="Forces on the machine", drawings=row, grids=grids) if row else None


def ground_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about forces of outriggers and margins against tipping; None for a machine without a ground.

    `prefix` begins the identifiers of its figures.
    """
    if (ground := result.summary.get("ground")) is None:
        return None
    outputs, row, grids = result.responses["reduced"].outputs, list[Drawing](), list[Grid]()
    captions = {
        "outrigger": "Forces of the outriggers on the ground; 0 where one lifts off.",
        "margin": "Margins against tipping over the edges of the support polygon: moments that hold the machine down.",
        "tipping": "Use of the support polygon: 0 where the resultant is in its middle, 1 where the machine tips.",
    }
    for kind, caption in captions.items():
        of_kind = [output for output in outputs if output.kind == kind]
        row.append(drawing(f"{prefix}-ground-{kind}", figures.ground_figure, caption, result, of_kind))
    for key, unit, what in (
        ("outriggers", "N", "force of each outrigger"),
        ("margins", "N m", "margin over each edge"),
    ):
        extremes = {of["name"]: Extremes.from_summary(of) for of in ground[key]}
        largest = max(extreme.size for extreme in extremes.values())
        caption = f"Least and largest {what}, when they occur{then_words(result)}."
        grids.append(_grid(extremes, unit, largest, caption))
    text = "; ".join(
        f"{of['name']} lifts off at {format_time(of['lifted']['t'])}" for of in ground["outriggers"] if "lifted" in of
    )
    if ground["tips"] is not None:
        text += f"{'; ' if text else ''}the machine tips at {format_time(ground['tips'])}"
    sentence = f"{text[:1].upper()}{text[1:]}." if text else "All outriggers press on the ground all the time."
    return Block(heading="Outriggers and tipping", text=sentence, drawings=row, grids=tuple(grids))


def driven_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about what drives a computed luffing angle or extension, over time.

    It has the extension, the force on it, pressures, flows and power.  None if neither is computed, or nothing drives
    the luffing angle.  `prefix` begins the identifiers of its figures.
    """
    response, extended = result.responses["reduced"], "extension_cylinder" in result.summary
    if LUFFING_ANGLE not in response.other_names and not extended:
        return None
    driven = [output for output in response.outputs if output.name.startswith(("extension ", "rate of extension "))]
    groups = (
        ("extension", [of for of in driven if of.name.startswith("extension of ")], "Extension that is computed."),
        ("force", [of for of in driven if of.unit == "N"], "Force on the extension, positive where it pushes."),
        ("pressure", _of_kind(response, "pressure"), "Pressures of the oil above that of the surroundings."),
        ("flow", _of_kind(response, "flow"), "Flows into bore and rod side, and out of the supply."),
        ("power", _of_kind(response, "power"), "Power of the cylinder's force, and power out of the supply."),
    )
    drawn = [
        drawing(f"{prefix}-luffing-{name}", figures.pivot_figure, caption, result, outputs)
        for name, outputs, caption in groups
        if outputs
    ]
    grids = tuple(_driven_grids(result, "extension_cylinder"))
    return Block(heading="Extension" if extended else "Luffing", drawings=drawn, grids=grids) if drawn else None


def _of_kind(response: Response, kind: str) -> list[Output]:
    """Outputs of a response whose kind is `kind` and that are not zero at all times; no volumes."""
    chosen = [output for output in response.outputs if output.kind == kind and output.unit != "m^3"]
    return [output for output in chosen if np.any(response.other(output.name))]


def _driven_grids(result: RunResult, key: str) -> Iterator[Grid]:
    """Yield a table with the extremes of what a cylinder does, if the summary has this `key`."""
    if (cylinder := result.summary.get(key)) is None:
        return
    listed = {name: extremes for name, extremes in cylinder.items() if name != "stops"}
    by_name = {name.replace("_", " "): Extremes.from_summary(extremes) for name, extremes in listed.items()}
    keys = {name: "luffing_force" if name == "force" else f"driven_{name.split()[0]}" for name in by_name}
    bases = {name: QUANTITIES[quantity].unit for name, quantity in keys.items()}
    units = {name: unit_for(extremes.size, bases[name]) for name, extremes in by_name.items()}
    raises = key == "luffing_cylinder"
    what = "The luffing cylinder, hinged as frame.cylinder says" if raises else "What drives the extension"
    caption = f"{what}: positive where it presses, and where it gets longer; when that is{then_words(result)}."
    yield extremes_grid(caption, by_name, units)


def extremes_grid(caption: str, extremes: Mapping[str, Extremes], units: Mapping[str, Unit]) -> Grid:
    """Build a table with a row for each name, whose extremes are in the unit of this name."""
    rows = ((f"{name} in {units[name].name}", *extreme_cells(of, units[name])) for name, of in extremes.items())
    return Grid(caption, ("", "least", "largest"), tuple(rows))


def _force_block(result: RunResult, prefix: str, kind: str, heading: str) -> Block | None:
    """Build a block about outputs of one kind: figures of their forces, figures of their moments, tables of extremes.

    A figure has at most `MOST_FORCES` panels.  Forces that are round-off at all times have no panel and are named in a
    sentence.  `prefix` begins the identifiers of the figures.  None if there are no outputs of this kind.
    """
    groups, drawn, grids = forces_by_group(result, kind), list[Drawing](), list[Grid]()
    if not groups:
        return None
    anchor = "forces" if kind == "pad" else kind
    bearing = [force for group in groups.values() for force in group if exceeds_round_off(result, force)]
    for unit in ("N", "N m"):
        for name, group in groups.items():
            shown = [force for force in group if force in bearing and force.unit == unit]
            for first in range(0, len(shown), figures.MOST_FORCES):
                panels, number = shown[first : first + figures.MOST_FORCES], len(drawn) + 1
                caption = _caption(result, kind, name, unit)
                drawn.append(drawing(f"{prefix}-{anchor}-{number}", figures.force_figure, caption, result, panels))
        named_forces = [force for force in bearing if force.unit == unit and force.output_name]
        grids += [force_extremes_grid(result, kind, named_forces)] if named_forces else []
    idle = [force.full_name for group in groups.values() for force in group if force not in bearing]
    text = f"No force at any time on {', '.join(idle)}." if idle else ""
    return Block(heading=heading.capitalize(), text=text, drawings=drawn, grids=tuple(grids))


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


def _caption(result: RunResult, kind: str, group: str, unit: str) -> str:
    """Caption of a figure of forces of one `kind` and `group`, or of moments if `unit` is ``N m``."""
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
    if not is_alone(result):
        return f"Pad forces over time. Positive where a pad pushes the sections apart.{within}"
    if not result.scene.pads:
        return "Slider force: the multiplier λ of the constraint. The slider pushes with −λ on the body."
    return f"Forces of the pads at the {group}, positive where they push the body inwards.{within}"


def force_extremes_grid(result: RunResult, kind: str, forces: Sequence[Force]) -> Grid:
    """Build the table of extremes of forces, or of moments, of one kind, with the largest friction if it is known.

    All of `forces` have the same unit.
    """
    response, t = result.responses["reduced"], result.responses["reduced"].t
    path, unit = places_at(result, t), forces[0].unit
    by_name = {force.full_name: Extremes.from_history(force.history(response), t, path) for force in forces}
    what = "moments" if unit == "N m" else "forces"
    on, signs = " on supports that give way" if kind == "support" else "", SIGNS.get(kind, "")
    if kind == "support" and is_luffing_cylinder_alone(result):
        on, signs = " of the luffing cylinder", " Positive where it pushes."
    caption = f"Least and largest {what}{on}, when they occur{then_words(result)}.{signs}"
    grid = _grid(by_name, unit, float(np.abs(response.slider_force).max(initial=0.0)), caption)
    cylinders_of_run = result.summary.get("cylinders", ())
    friction = {of["name"]: format_quantity(of["friction"], "N") for of in cylinders_of_run if "friction" in of}
    if not friction.keys() & by_name.keys():
        return grid
    rows = tuple((*row, friction.get(name, "")) for row, name in zip(grid.rows, by_name, strict=True))
    return Grid(grid.caption, (*grid.head, "friction up to"), rows)


def reaction_grids(result: RunResult) -> Iterator[Grid]:
    """Yield tables with the extremes of forces and of moments on rigid supports."""
    caption = "Least and largest {} on rigid supports, positive along the axes, when they occur"
    return _rigid_support_grids(result, at_pivot=False, caption=f"{caption}{then_words(result)}.")


def _rigid_support_grids(result: RunResult, at_pivot: bool, caption: str) -> Iterator[Grid]:
    """Yield a table of extremes for forces on rigid supports and one for moments.

    If `at_pivot`, the tables are about the forces at the pivot of a boom in a frame, which are sums over all supports;
    if not, they are about all other supports.  `caption` contains a ``{}`` in place of the word forces or moments.
    """
    response, by_unit = result.responses["reduced"], dict[str, dict[str, Extremes]]()
    for of, extreme in reaction_extremes(response, places_at(result, response.t)).items():
        if (result.frame is not None and of.support.startswith(PIVOT)) == at_pivot:
            name = shown_force_name(of.support).removeprefix(PIVOT)
            computed = (
                ", by the moment about the pivot" if name == LUFFING_CYLINDER and has_free_luffing(result) else ""
            )
            by_unit.setdefault(of.unit, {})[name + computed] = extreme
    for base, of_unit in by_unit.items():
        largest = max(extreme.size for extreme in of_unit.values())
        bearing = {name: extreme for name, extreme in of_unit.items() if extreme.size > ROUND_OFF * largest}
        if bearing:  # a support bears no force if nothing acts along its direction
            yield _grid(bearing, base, largest, caption.format("moments" if base == "N m" else "forces"))


def _grid(extremes_by_name: Mapping[str, Extremes], base: str, largest: float, caption: str) -> Grid:
    """Build a table with a row of extremes for each name, with the prefix of the unit that suits its largest value.

    `base` is the unit without prefix, `caption` the text above the table.  A value is printed as 0 if it is less than
    `NOTHING` times the largest value in this table, or less than `ROUND_OFF` times the argument `largest`.
    """
    most = max((extreme.size for extreme in extremes_by_name.values()), default=0.0)
    unit, nothing = unit_for(most, base), max(NOTHING * most, ROUND_OFF * largest)
    rows = tuple(
        (name or "slider", *extreme_cells(extreme, unit, nothing)) for name, extreme in extremes_by_name.items()
    )
    return Grid(caption, ("", f"least in {unit.name}", f"largest in {unit.name}"), rows)


def extreme_cells(extreme: Extremes, unit: Unit, nothing: float = 0.0) -> Iterator[str]:
    """Yield a cell for the least and one for the largest value in `unit`, each with its time and position.

    A value of at most `nothing`, given in the unit without prefix, is printed as ``0`` without time and position.
    A position that is NaN is left out.
    """
    for value, t, s in (
        (extreme.least, extreme.t_least, extreme.s_least),
        (extreme.most, extreme.t_most, extreme.s_most),
    ):
        when = f" at {format_time(t)}" + ("" if np.isnan(s) else f", {format_input(round(s, 2), 'm')}")
        yield f"{significant(value / unit.size)}{when}" if abs(value) > nothing else "0"


#: Name of each output, what its caption adds, and its quantity.
SHOWN = {
    "height": ("height of the hook", "", "hook_height"),
    "swing_along": ("swing along the boom", ", in the boom's plane, outwards positive", "swing"),
    "swing_across": ("swing across the boom", ", across that plane", "swing"),
    "force": ("force of the rope", "", "hoist_force"),
}


def _history(key: str, response: Response) -> Array:
    """Output of a hoist (T,) as it is shown: angles in degrees."""
    values = response.other(KEYS[key])
    return np.rad2deg(values) if _unit(key) == "°" else values


def _unit(key: str) -> str:
    """Unit in which an output is shown."""
    unit = QUANTITIES[SHOWN[key][2]].unit
    return "°" if unit == "rad" else unit


def hoist_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about the hoist, with histories and a table of extremes; None if the run has none.

    Quantities that do not change have no history.  `prefix` begins the identifiers of the figures.
    """
    figures = result.summary.get("hoist")
    if figures is None:
        return None
    drawings, extremes, response = list[Drawing](), dict[str, Extremes](), result.responses["reduced"]
    for number, (key, (name, clause, _)) in enumerate(SHOWN.items()):
        label = name.capitalize()
        if figures[key]["max"] > figures[key]["min"]:
            drawn = f"{prefix}-hoist-{number}", result, partial(_history, key), f"{label}{clause}", label, _unit(key)
            drawings.append(drawn_history(*drawn))
        extremes[name] = Extremes.from_history(_history(key, response), response.t, places_at(result, response.t))
    units = {name: unit_for(extremes[name].size, _unit(key)) for key, (name, *_) in SHOWN.items()}
    grid = extremes_grid(f"The hoist; when that is{then_words(result)}.", extremes, units)
    weight, times = format_quantity(figures["weight_force"], "N"), significant(figures["factor"])
    text = f"The rope's largest force is {times} times that of the weight, {weight}."
    for span in figures.get("slack", ()):
        start, end = (format_time(span[key]) for key in ("start", "end"))
        text += f" It is slack from {start} to {end}, then it pulls with up to {format_quantity(span['snatch'], 'N')}."
    return Block(heading="Hoist", text=text, drawings=drawings, grids=(grid,))
