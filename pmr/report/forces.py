"""What bodies bear, as figures and tables: forces of pads, cylinders and supports."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from pmr.report.blocks import Block, Drawing, Grid, drawing
from pmr.report.columns import Force, forces
from pmr.report.figures import forces as figures
from pmr.report.numbers import NOTHING, SPACE, Unit, plain, quantity, significant, unit_for
from pmr.report.subject import alone, drive_of, forces_called, rings_of
from pmr.results import RunResult
from pmr.results.extremes import Extremes
from pmr.results.tables import FORCE_OF, REACTION_OF, reaction_extremes

#: Of the largest force: what is below is round-off, which a support has even where nothing acts along it.
ROUND_OFF = 1e-9
#: What the sign of a force says, where that of another table may seem to be against it.
SIGNS = {
    "support": " Positive along the axes: a support that is pressed down has a negative force, and so has one in place "
    "of a luffing cylinder while the cylinder pushes.",
}
#: What names begin with of what acts at the pivot.
PIVOT = "pivot "
AT_PIVOT = f"{REACTION_OF}{PIVOT}"


def contact(result: RunResult, prefix: str) -> Block | None:
    """Forces of pads or sliders, group by group."""
    return _block(result, prefix, "pad", "pad forces" if not alone(result) else forces_called(result))


def cylinders(result: RunResult, prefix: str) -> Block | None:
    """What cylinders push their sections out with, and where ropes move some of them, the cylinders that pull these."""
    found, ropes = _block(result, prefix, "cylinder", "cylinder forces"), tuple(_ropes(result))
    return replace(found, grids=(*found.grids, *ropes)) if found else None


def _ropes(result: RunResult) -> Iterator[Grid]:
    """Forces of ropes and chains, and of the cylinders that pull them."""
    found = {
        f"{drive_of(one)} of {one['name']}": Extremes.from_summary(one["force"])
        for one in result.summary.get("ropes", ())
    }
    if found:
        caption = (
            "Forces of ropes or chains, all strands of each together, and of a cylinder that moves all of them: by "
        )
        caption += "virtual work, without friction of sheaves."
        grid = _grid(found, "N", max(map(size, found.values())), caption)
        elastic = [
            (quantity(one["length"], "m"), quantity(one["stiffness"], "N/m")) if "length" in one else ("", "")
            for one in result.summary["ropes"]
        ]
        if any(any(one) for one in elastic):
            rows = tuple((*row, *one) for row, one in zip(grid.rows, elastic, strict=True))
            grid = Grid(caption, (*grid.head, "length", "EA/l"), rows)
        yield grid


def supports(result: RunResult, prefix: str) -> Block | None:
    """What the ground carries: supports that give way over time, and the extremes of these and of rigid ones."""
    found, rigid = _block(result, prefix, "support", "supports"), tuple(reactions(result))
    if found is None:
        return Block(heading="Supports", grids=rigid) if rigid else None
    return replace(found, grids=(*found.grids, *rigid))


def pivot(result: RunResult, prefix: str) -> Block | None:
    """What a boom in a frame that moves presses on its machine with: forces and moments about the pivot over time."""
    response, row = result.responses["reduced"], list[Drawing]()
    acting = [one for one in response.outputs if one.kind == "reaction" and one.name.startswith(AT_PIVOT)]
    for unit, what, name in (("N", "Forces", "forces"), ("N m", "Moments about the pivot", "moments")):
        some = [one for one in acting if one.unit == unit]
        largest = max((float(np.abs(response.other(one.name)).max()) for one in some), default=0.0)
        some = [one for one in some if np.abs(response.other(one.name)).max() > ROUND_OFF * largest]
        if some:
            said = f"{what} of the boom on its machine, sum over all supports, in the axes of the boom."
            if any(one.name.endswith("cylinder") for one in some):
                said += " The luffing cylinder carries a part of them, along itself, and the pivot the rest."
            row.append(drawing(f"{prefix}-pivot-{name}", figures.pivot, said, result, some))
    said = "Least and largest {} on the machine, when they occur, and " + place_called(result) + " then."
    grids = (*_rigid(result, at_pivot=True, caption=said), *_luffing(result))
    return Block(heading="Forces on the machine", rows=(tuple(row),), grids=grids) if row else None


def _luffing(result: RunResult) -> Iterator[Grid]:
    """Force, length, speed and power of the cylinder that raises the boom."""
    if (found := result.summary.get("luffing_cylinder")) is None:
        return
    rows = list[tuple[str, ...]]()
    for name, base in (("force", "N"), ("length", "m"), ("speed", "m/s"), ("power", "W")):
        one = Extremes.from_summary(found[name])
        unit = unit_for(size(one), base)
        rows.append((f"{name} in {unit.name}", *cells(one, unit)))
    caption = "The cylinder that raises the boom, hinged as frame.cylinder says: positive where it presses, and where "
    caption += f"it gets longer; when that is, and {place_called(result)} then."
    yield Grid(caption, ("", "least", "largest"), tuple(rows))


def _block(result: RunResult, prefix: str, kind: str, called: str) -> Block | None:
    """Figures of a kind's forces, so many panels in each, and a table of the extremes."""
    groups, drawn = forces(result, kind), list[tuple[Drawing, ...]]()
    anchor = "forces" if kind == "pad" else kind
    bearing = {name: [one for one in group if bears(result, one)] for name, group in groups.items()}
    for name, group in bearing.items():
        for first in range(0, len(group), figures.MOST_FORCES):
            some, number = group[first : first + figures.MOST_FORCES], len(drawn) + 1
            caption = _caption(result, kind, name)
            drawn.append((drawing(f"{prefix}-{anchor}-{number}", figures.forces, caption, result, some),))
    if not groups:
        return None
    grid = extremes(result, kind, [force for group in bearing.values() for force in group])
    idle = [_called(one) for name, group in groups.items() for one in group if one not in bearing[name]]
    text = f"No force at any time on {', '.join(idle)}." if idle else ""
    return Block(heading=called.capitalize(), text=text, rows=tuple(drawn), grids=(grid,) if grid.rows else ())


def bears(result: RunResult, force: Force) -> bool:
    """Whether a force is in any model more than round-off beside the largest of all."""
    for response in result.responses.values():
        nothing = max(response.force_round_off, ROUND_OFF * float(np.abs(response.slider_force).max(initial=0.0)))
        if float(np.abs(force.of(response)).max(initial=0.0)) > nothing:
            return True
    return False


def _called(force: Force) -> str:
    return force.called.removeprefix(FORCE_OF) or force.name


def place_called(result: RunResult) -> str:
    """What tables of extremes say of where something was, in words."""
    return "the path coordinate s" if alone(result) else "the reach"


def _caption(result: RunResult, kind: str, group: str) -> str:
    in_parts = result.responses["reduced"].force_peaks is not None  # a step was made in parts, for pads that only push
    push = any(ring.unilateral for part in result.scene.bodies.values() for ring in rings_of(part))
    within = " Of pads that only push, the largest force within each step." if in_parts and push else ""
    if kind == "cylinder":
        note = "What a cylinder or rope pushes its section out with, friction included; negative where it pulls."
        return f"Cylinder forces over time. {note}"
    if kind == "support":
        return "Forces of supports that give way, positive along the axes."
    if not alone(result):
        return f"Pad forces over time. Positive where a pad pushes the sections apart.{within}"
    if not result.scene.pads:
        return "Slider force: the multiplier λ of the constraint. The slider pushes with −λ on the body."
    return f"Forces of the pads at the {group}, positive where they push the body inwards.{within}"


def extremes(result: RunResult, kind: str, wanted: list[Force]) -> Grid:
    """Smallest and largest of a kind's forces, and of friction the largest where it is known."""
    response, t = result.responses["reduced"], result.responses["reduced"].t
    path = result.along_at(t)
    found = {_called(force): Extremes.of(force.of(response), t, path) for force in wanted if force.called}
    friction = {one["name"]: one["friction"] for one in result.summary.get("cylinders", ()) if "friction" in one}
    on = " on supports that give way" if kind == "support" else ""
    caption = f"Least and largest forces{on}, when they occur, and {place_called(result)} then.{SIGNS.get(kind, '')}"
    grid = _grid(found, "N", float(np.abs(response.slider_force).max(initial=0.0)), caption)
    if not friction.keys() & found.keys():
        return grid
    column = [quantity(friction[name], "N") if name in friction else "" for name in found]
    rows = tuple((*row, cell) for row, cell in zip(grid.rows, column, strict=True))
    return Grid(grid.caption, (*grid.head, "friction up to"), rows)


def reactions(result: RunResult) -> Iterator[Grid]:
    """Smallest and largest forces and moments on rigid supports."""
    said = "Least and largest {} on rigid supports, positive along the axes, when they occur, and "
    return _rigid(result, at_pivot=False, caption=f"{said}{place_called(result)} then.")


def _rigid(result: RunResult, at_pivot: bool, caption: str) -> Iterator[Grid]:
    """Those at the pivot of a boom in a frame, which are sums over all supports, or those of each support."""
    response, found = result.responses["reduced"], dict[str, dict[str, Extremes]]()
    for of, one in reaction_extremes(response, result.along_at(response.t)).items():
        if (result.scene.frame is not None and of.support.startswith(PIVOT)) == at_pivot:
            found.setdefault(of.unit, {})[of.support.removeprefix(PIVOT)] = one
    for base, of_unit in found.items():
        largest = max(map(size, of_unit.values()))
        bearing = {name: one for name, one in of_unit.items() if size(one) > ROUND_OFF * largest}
        if bearing:  # nothing acts along a support that only keeps a direction
            yield _grid(bearing, base, largest, caption.format("moments" if base == "N m" else "forces"))


def _grid(found: Mapping[str, Extremes], base: str, largest: float, caption: str) -> Grid:
    """A row for each, in a unit that fits the largest of them; what is nothing beside that is 0.

    So is what is round-off beside `largest`, the largest of all kinds.
    """
    most = max(map(size, found.values()), default=0.0)
    unit, nothing = unit_for(most, base), max(NOTHING * most, ROUND_OFF * largest)
    rows = tuple((name or "slider", *cells(one, unit, nothing)) for name, one in found.items())
    return Grid(caption, ("", f"least in {unit.name}", f"largest in {unit.name}"), rows)


def size(one: Extremes) -> float:
    """The largest of both."""
    return max(one.most, -one.least)


def cells(one: Extremes, unit: Unit, nothing: float = 0.0) -> Iterator[str]:
    """Both, each with when and where; 0 alone up to `nothing`."""
    for value, t, s in ((one.least, one.t_least, one.s_least), (one.most, one.t_most, one.s_most)):
        when = f" at {plain(round(t, 3))}{SPACE}s, {plain(round(s, 3))}{SPACE}m"
        yield f"{significant(value / unit.size)}{when}" if abs(value) > nothing else "0"
