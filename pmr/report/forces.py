"""What bodies bear, as figures and tables: forces of pads, cylinders and supports."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from pmr.report.blocks import Block, Drawing, Grid, drawing
from pmr.report.columns import Force, forces
from pmr.report.figures import forces as figures
from pmr.report.numbers import Unit, quantity, significant, unit_for
from pmr.report.subject import alone, forces_called
from pmr.results import RunResult
from pmr.results.extremes import Extremes
from pmr.results.tables import REACTION_OF, reaction_extremes

#: Of the largest force: what is below is round-off, which a support has even where nothing acts along it.
ROUND_OFF = 1e-9
#: What names begin with of what acts at the pivot.
AT_PIVOT = f"{REACTION_OF}pivot "


def contact(result: RunResult, prefix: str) -> Block | None:
    """Forces of pads or sliders, group by group."""
    return _block(result, prefix, "pad", "pad forces" if not alone(result) else forces_called(result))


def cylinders(result: RunResult, prefix: str) -> Block | None:
    """What cylinders push their sections out with, and where ropes move some of them, the cylinders that pull these."""
    found, ropes = _block(result, prefix, "cylinder", "cylinder forces"), tuple(_ropes(result))
    return Block(heading=found.heading, rows=found.rows, grids=(*found.grids, *ropes)) if found else None


def _ropes(result: RunResult) -> Iterator[Grid]:
    """Forces of ropes and chains, and of the cylinders that pull them."""
    found = {
        f"{'rope' if one['follows'] else 'cylinder'} of {one['name']}": Extremes.from_summary(one["force"])
        for one in result.summary.get("ropes", ())
    }
    if found:
        caption = (
            "Forces of ropes or chains, all strands of each together, and of the cylinder that moves all of them: by "
        )
        caption += "virtual work, without friction of sheaves."
        grid = _grid(found, "N", max(map(size, found.values())), caption, result.coordinate)
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
    return Block(heading="Supports", rows=found.rows, grids=(*found.grids, *rigid))


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
                said += " The luffing cylinder carries its own force of these, along itself, and the pivot the rest."
            row.append(drawing(f"{prefix}-pivot-{name}", figures.pivot, said, result, some))
    return Block(heading="Forces on the machine", rows=(tuple(row),), grids=tuple(_luffing(result))) if row else None


def _luffing(result: RunResult) -> Iterator[Grid]:
    """Force, length, speed and power of the cylinder that raises the boom."""
    if (found := result.summary.get("luffing_cylinder")) is None:
        return
    s, rows = "the path coordinate" if alone(result) else "the reach", list[tuple[str, ...]]()
    for name, base in (("force", "N"), ("length", "m"), ("speed", "m/s"), ("power", "W")):
        one = Extremes.from_summary(found[name])
        unit = unit_for(size(one), base)
        rows.append((f"{name} in {unit.name}", *cells(one, unit)))
    caption = "The cylinder that raises the boom, hinged as frame.cylinder says: positive where it presses, and where "
    caption += f"it gets longer; s is {s}."
    yield Grid(caption, ("", "least", "at t in s", "and s in m", "largest", "at t in s", "and s in m"), tuple(rows))


def _block(result: RunResult, prefix: str, kind: str, called: str) -> Block | None:
    """Figures of a kind's forces, so many panels in each, and a table of the extremes."""
    groups, drawn = forces(result, kind), list[tuple[Drawing, ...]]()
    anchor = "forces" if kind == "pad" else kind
    for name, group in groups.items():
        if _nothing(result, group):
            continue  # the table says so
        for first in range(0, len(group), figures.MOST_FORCES):
            some, number = group[first : first + figures.MOST_FORCES], len(drawn) + 1
            caption = _caption(result, kind, name)
            drawn.append((drawing(f"{prefix}-{anchor}-{number}", figures.forces, caption, result, some),))
    if not groups:
        return None
    grid = extremes(result, [force for group in groups.values() for force in group])
    return Block(heading=called.capitalize(), rows=tuple(drawn), grids=(grid,) if grid.rows else ())


def _nothing(result: RunResult, group: list[Force]) -> bool:
    """Whether forces are round-off beside the largest of all, and there are larger ones."""
    response = result.responses["reduced"]
    size = max(float(np.abs(force.of(response)).max()) for force in group)
    return 0.0 < size <= ROUND_OFF * float(np.abs(response.slider_force).max(initial=0.0))


def _caption(result: RunResult, kind: str, group: str) -> str:
    in_parts = result.responses["reduced"].force_peaks is not None  # a step was made in parts, for pads that only push
    within = " Of those that only push the largest within each step." if in_parts else ""
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


def extremes(result: RunResult, wanted: list[Force]) -> Grid:
    """Smallest and largest of forces, and of friction the largest where it is known."""
    response, t = result.responses["reduced"], result.responses["reduced"].t
    path = result.along_at(t)
    found = {
        force.called.removeprefix("force of "): Extremes.of(force.of(response), t, path)
        for force in wanted
        if force.called
    }
    friction = {one["name"]: one["friction"] for one in result.summary.get("cylinders", ()) if "friction" in one}
    s = "the path coordinate s" if alone(result) else "the reach"
    caption = f"Least and largest forces, when they occur, and {s} then."
    largest = float(np.abs(response.slider_force).max(initial=0.0))
    grid = _grid(found, "N", largest, caption, result.coordinate)
    if not friction.keys() & found.keys():
        return grid
    column = [quantity(friction[name], "N") if name in friction else "" for name in found]
    rows = tuple((*row, cell) for row, cell in zip(grid.rows, column, strict=True))
    return Grid(grid.caption, (*grid.head, "friction up to"), rows)


def reactions(result: RunResult) -> Iterator[Grid]:
    """Smallest and largest forces and moments on rigid supports."""
    response, found = result.responses["reduced"], dict[str, dict[str, Extremes]]()
    for of, one in reaction_extremes(response, result.along_at(response.t)).items():
        if size(one) > 0.0:  # nothing acts along a support that only keeps a direction
            found.setdefault(of.unit, {})[of.support] = one
    s = "s is the path coordinate" if alone(result) else "s is the reach"
    for base, of_unit in found.items():
        what = "Moments on rigid supports" if base == "N m" else "Forces on rigid supports"
        caption = f"{what}, positive along the axes, when they occur, and s then; {s}."
        yield _grid(of_unit, base, max(map(size, of_unit.values())), caption, "s")


def _grid(found: Mapping[str, Extremes], base: str, largest: float, caption: str, place: str) -> Grid:
    """A row for each, in a unit that fits the largest; zero at no time where it is round-off beside that."""
    unit = unit_for(max(map(size, found.values()), default=0.0), base)
    rows = {
        name: tuple(cells(one, unit)) if size(one) > ROUND_OFF * largest else ("0", "", "") * 2
        for name, one in found.items()
    }
    when = ("at t in s", f"and {place} in m")
    head = ("", f"least in {unit.name}", *when, f"largest in {unit.name}", *when)
    return Grid(caption, head, tuple((name or "slider", *shown) for name, shown in rows.items()))


def size(one: Extremes) -> float:
    """The largest of both."""
    return max(one.most, -one.least)


def cells(one: Extremes, unit: Unit) -> Iterator[str]:
    """Both, each with when and where."""
    for value, t, s in ((one.least, one.t_least, one.s_least), (one.most, one.t_most, one.s_most)):
        yield from (significant(value / unit.size, 3), significant(t, 4), significant(s, 4))
