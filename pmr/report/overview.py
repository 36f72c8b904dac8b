"""Rows of the first page on what was simulated: bodies, masses, pads, loads, weight, machine, angles and reach."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from pmr.files.arrays import Array
from pmr.report.columns import axis_points, body_axes, spread_indices
from pmr.report.numbers import MINUS, SPACE, format_input, format_quantity, prose, significant
from pmr.report.scene_tables import SceneWords, describe_plain
from pmr.report.subject import (
    AppliedLoad,
    choice_clause,
    crossing,
    is_raised,
    moving_part,
    reach,
    rings_of,
    scene_loads,
    structural_model_words,
)
from pmr.results import RunResult
from pmr.scene.built import PadRing, Support
from pmr.scene.choice import model_of
from pmr.scene.cylinder import DrivenCylinder
from pmr.scene.ground import Ground
from pmr.scene.hoist import Hoist
from pmr.scene.joints import JointPads, OneBody
from pmr.scene.keys import qualified_name
from pmr.scene.members import members
from pmr.scene.structures import PointMass

PLACES = 400  # number of times at which the position of the tip is evaluated
Rows = Iterator[tuple[str, str]]


def system_rows(result: RunResult) -> Rows:
    """Yield rows (name, text) that describe the system of a run.

    The rows begin with bodies, masses, pads, loads and weight.  Then come the machine, the ground and the drives, and
    at last the range of the motion and the time.  Rows about parts that the scene lacks are left out.
    """
    yield from _body_rows(result)
    yield from _mass_rows(result)
    yield from _pad_rows(result)
    for load in scene_loads(result):
        yield qualified_name(load.body, load.name), load_text(load)
    scene, gravity = result.scene, result.scene.gravity
    if scene.hoist is not None:
        yield "hoist", describe_hoist(scene.hoist, scene.time.end)
    weight = "left out" if gravity is None else f"included, {significant(gravity.acceleration)}{SPACE}m/s²"
    weight += f", in full from {format_input(gravity.rise, 's')} on" if gravity is not None and gravity.rise else ""
    yield "weight of the boom", weight
    if scene.frame is not None and result.frame is not None:
        words = SceneWords(scene.frame.unit)
        for name, part in (("machine", scene.frame.machine), ("motion of the base", scene.frame.base)):
            if part is not None:
                yield name, words.describe(part)
    yield from angle_rows(result)
    if scene.frame is not None:
        if scene.frame.cylinder is not None:
            foot, lug = (_place_from_pivot(x, z) for x, z in (scene.frame.cylinder.foot, scene.frame.cylinder.lug))
            yield "luffing cylinder", f"foot on the machine {foot}; lug on the boom {lug} while the boom lies level"
        if (ground := scene.frame.ground) is not None:
            yield "stands on", _describe_ground(ground, scene.frame.unit)
            corners = (f"{of.name} {format_place(of.at)}" for of in ground.outriggers)
            yield "outriggers, x and y from the pivot", "; ".join(corners)
            weights = [f"{of.name} {_format_mass(of.mass)} {format_place(of.at)}" for of in ground.masses]
            if weights:
                yield "masses of the machine, x, y, z from the pivot", "; ".join(weights)
    for name, joint in ((part.name, part.joint) for part in scene.sections):
        if joint is not None and joint.line is not None:
            yield f"{joint.driver} of {name}", f"acts {_distances(joint.line, BESIDE) or 'on'} the axis of the sections"
    for number, extension in scene.free_extensions.items():
        low, high = extension.stroke
        yield f"extension of {scene.names[number]}", format_range(low, high, f"{SPACE}m") + _drive_clause(extension)
    yield from length_rows(result)
    yield from _tip_rows(result)
    yield "time", format_input(scene.time.end, "s")


def angle_rows(result: RunResult) -> Rows:
    """Yield rows with the ranges of luffing and slewing angle, without angles that are 0 at all times.

    Without a frame, a row says by how much gravity's direction raises the boom.  Without frame and weight there is no
    row.
    """
    scene, gravity = result.scene, result.scene.gravity
    if scene.frame is not None and result.frame is not None:
        for name, angle in zip(("luffing", "slewing"), result.frame.angles, strict=True):
            low, high = np.rad2deg(angle.bounds(0.0, scene.time.end))
            if low or high:
                free = name == "luffing" and scene.frame.computed_key == "luffing"
                yield name, format_range(low, high, "°") + (_drive_clause(scene.frame.cylinder) if free else "")
    elif gravity is not None:
        raised = f"{format_input(round(gravity.elevation, 1))}°" if is_raised(result) else "0°, it lies level"
        yield "raised by", raised


def length_rows(result: RunResult) -> Rows:
    """Yield a row with the range of the boom's length in m.

    Where a mass on a wheel crosses a section, the row has the way of this mass.  For a body alone, it has the length
    beyond the mouth or the position of the slider; there is no row if nothing slides.
    """
    if result.reach is not None and (mover := crossing(result)):
        yield f"way of {mover}", format_range(float(result.reach.min()), float(result.reach.max()), f"{SPACE}m")
    elif result.reach is not None:
        yield "boom length", format_range(float(result.reach.min()), float(result.reach.max()), f"{SPACE}m")
    elif moving_part(result) == "mouth":
        low, high = result.scene.path_bounds
        yield "length beyond the mouth", format_range(reach(result) - high, reach(result) - low, f"{SPACE}m")
    elif moving_part(result) == "slider":
        yield "slider at", f"s = {format_range(*result.scene.path_bounds, f'{SPACE}m')}"


def format_place(at: Sequence[float]) -> str:
    """Format the coordinates `at` of a place in m, in brackets, with the unit behind them."""
    return f"({', '.join(format_input(value) for value in at)}){SPACE}m"


def _place_from_pivot(x: float, z: float) -> str:
    """Words for a place in the boom's plane that is x m ahead of the pivot and z m above it."""
    along, up = "ahead of" if x >= 0.0 else "behind", "above" if z >= 0.0 else "below"
    return f"{format_input(abs(x), 'm')} {along} the pivot and {format_input(abs(z), 'm')} {up} it"


def describe_hoist(hoist: Hoist, end: float) -> str:
    """Describe the payload on a hoist, the falls of its rope, and the axes along which wind acts on the payload.

    Only wind that acts before the time `end` in s is named.
    """
    hook = f" with a hook of {format_input(hoist.hook, 'kg')}" if hoist.hook else ""
    falls = "one fall" if hoist.falls == 1 else f"{hoist.falls} falls"
    axes = [axis for axis, signal in hoist.wind.signals.items() if any(signal.bounds(0.0, end))]
    wind = f", in wind along {', '.join(axes)}" if axes else ""
    return f"payload of {format_input(hoist.payload, 'kg')}{hook} on {falls}{wind}"


def _drive_clause(cylinder: DrivenCylinder | None) -> str:
    """Clause on what drives a computed luffing angle or extension: the drive of its `cylinder`, or nothing.

    `cylinder` is None for an angle without a cylinder, which nothing drives.
    """
    if cylinder is None or not cylinder.drives:
        return ", computed: nothing drives it"
    oil, drive = cylinder.oil, cylinder.drives[0]
    if oil is None:
        return f", computed: a given {drive} drives it"
    valves = "shut in" if oil.valve is None else "through a valve"
    valves += "" if oil.counterbalance is None else " and a counterbalance valve"
    return f", computed: oil of {format_quantity(oil.supply, 'Pa')} {valves} drives it"


def _describe_ground(ground: Ground, unit: str) -> str:
    """Describe the outriggers, the machine's masses and the slope of the ground, whose angles are in `unit`."""
    angles = ground.slope if unit == "degrees" else np.rad2deg(ground.slope)
    ways = [f"{format_input(round(float(angle), 2))}° along {axis}" for angle, axis in zip(angles, "XY", strict=True)]
    masses = _format_mass(sum(mass.mass for mass in ground.masses)) if ground.masses else ""
    return prose("ground", count=len(ground.outriggers), masses=masses, slope=ways if any(ground.slope) else ())


def _tip_rows(result: RunResult) -> Rows:
    """Yield a row with the range of the tip's position from the pivot in m.

    The row is yielded only for a boom that is in a frame, or that the direction of gravity raises (`is_raised`).
    """
    response = result.responses["reduced"]
    if axis_points(result) and (result.frame is not None or is_raised(result)):
        out, up = body_axes(result, spread_indices(len(response.t), PLACES))[-1].side[:, -1].T
        far, high = (
            format_range(float(coordinate.min()), float(coordinate.max()), f"{SPACE}m") for coordinate in (out, up)
        )
        yield "tip from the pivot", f"radius {far}, height {high}, with deflections"


def load_text(load: AppliedLoad) -> str:
    """Describe a load by the range of its values, its place and its axis, such as ``up to 2 kN at 3 m along z``.

    A load that is never positive is described as a positive load along the opposite axis.  A load that is always 0 is
    described as "0 at all times".
    """
    source, values = load.source, load.values
    axis = f"{source.direction} of the ground" if source.axes == "ground" else load.direction
    where = _place_words(source.on)
    if source.acts != "force":
        where = f"{source.acts} on the whole body,"
    elif source.point is not None:
        where += f" at {', '.join(f'{x:g}' for x in source.point)} m"
    if not np.any(values):
        return f"0 at all times, {where} along {axis}"
    if values.min(initial=0.0) < 0.0 and values.max(initial=0.0) <= 0.0:
        values, axis = -values, f"{MINUS}{axis}"
    return f"{_format_load(values, source.unit)} {where} along {axis}"


def _place_words(on: str | float) -> str:
    """Words for the place `on` a body: the name of a part, or the distance in m along the body's axis."""
    return f"on {on}" if isinstance(on, str) else f"at {format_input(on, 'm')}"


def _format_load(values: Array, unit: str) -> str:
    """Format a load as ``up to`` the value farthest from zero.

    A load that changes sign is formatted as its least to its largest value.  `unit` is the unit of `values` (T,),
    without a prefix.
    """
    low, high = float(values.min(initial=0.0)), float(values.max(initial=0.0))
    if low < 0.0 < high:
        return f"{format_quantity(low, unit)} to {format_quantity(high, unit)}"
    return f"up to {format_quantity(high or low, unit)}"


def format_range(low: float, high: float, unit: str) -> str:
    """Format the range `low` to `high`, rounded to 0.01; if both are equal after rounding, format one value.

    `unit` is appended without a space, so it has to begin with a space if one is needed.
    """
    low, high = (round(float(end), 2) for end in (low, high))
    return f"{format_input(low)} to {format_input(high)}{unit}" if high > low else f"{format_input(low)}{unit}"


def _body_rows(result: RunResult) -> Rows:
    """Yield rows with dimensions and mass of each body, then a row with all models and one with all yield stresses."""
    masses = {mass["name"]: mass["mass"] for mass in result.summary.get("masses", ())}
    models, limits = dict[str, None](), dict[str, None]()
    for member, (name, part) in zip(members(result.scene), result.scene.bodies.items(), strict=True):
        called = name or "structure"
        box, profile, mover = part.body.box, part.body.profile, part.body.mover
        properties = [] if box is None else [f"box with a mid-surface of {SceneWords().describe(box)}"]
        properties += [] if profile is None else [f"{format_input(profile.length, 'm')} long"]
        properties += [] if mover is None else [SceneWords().describe(mover)]
        properties += [_format_mass(masses[name])] if name in masses and mover is None else []
        if properties:
            yield called, ", ".join(properties)
        models[structural_model_words(model_of(member), part.body.walls)] = None
        if (limit := part.body.material.yield_stress) is not None:
            limits[format_quantity(limit, "Pa")] = None
    measured = result.summary.get("chosen_model")
    why = "" if measured is None else f"; {choice_clause(measured)}"
    yield "modelled as", "; ".join(models) + why
    if limits:
        yield "yield stress", "; ".join(limits)


def _mass_rows(result: RunResult) -> Rows:
    """Yield a row for each point mass, and a row with the total mass of the bodies with everything attached to them."""
    for name, part in result.scene.bodies.items():
        for mass in part.masses:
            where = f"{_place_words(mass.on)}{_offset(part, mass)}"
            yield qualified_name(name, mass.name), f"{format_input(mass.mass, 'kg')} {where}"
    if masses := result.summary.get("masses"):
        attached = " and ".join(mass.name for part in result.scene.bodies.values() for mass in part.masses)
        of = f" with {attached}" if attached else ""
        yield (
            "total mass",
            _format_mass(sum(mass_of_body["mass"] + mass_of_body["attached"] for mass_of_body in masses)) + of,
        )


def _offset(part: OneBody, mass: PointMass) -> str:
    """Clause with the distance of a mass's centre from the group that carries it; empty if it is not given or zero.

    Along the axis it is measured from the group if the scene knows where the group is, else from the tail.
    """
    if mass.at is None:
        return ""
    (x, *beside), place = mass.at, part.position_of(mass.on)
    along = ("ahead of it", "behind it") if place is not None else ("from the tail",) * 2
    parts = _distances((x - (place or 0.0), *beside), (along, *BESIDE))
    return f", its centre {parts}" if parts else ""


#: Words for a place with positive or negative y, and with positive or negative z.
BESIDE = (("to the left", "to the right"), ("above", "below"))


def _distances(at: Sequence[float], words: Sequence[tuple[str, str]]) -> str:
    """Words for the coordinates `at` in m, such as ``0.2 m ahead of it, 0.1 m above``, without coordinates that are 0.

    `words` has a pair for each coordinate: the words for a positive and for a negative value.
    """
    ways = zip(at, words, strict=True)
    return ", ".join(f"{format_input(abs(round(d, 3)), 'm')} {of[int(d < 0.0)]}" for d, of in ways if round(d, 3))


def _play_words(ring: PadRing | JointPads) -> str:
    """Clause with the play of a ring of pads that only push, by face; empty if the pads touch from the start.

    The play is the `clearance` of the ring.
    """
    by_face = ring.clearance if isinstance(ring.clearance, dict) else {"": ring.clearance}
    plays = [f"{face} {format_quantity(play, 'm')}".strip() for face, play in by_face.items() if play]
    return f"play {', '.join(plays)}" if plays else ""


def _pad_rows(result: RunResult) -> Rows:
    """Yield a row for each body's supports, then a row for each group of bodies whose pads are alike."""
    alike = dict[tuple[int, str], list[str]]()
    for name, part in result.scene.bodies.items():
        if rings := rings_of(part):
            count = sum(sum(len(places) for places in ring.faces.values()) if ring.faces else 1 for ring in rings)
            stiffness = dict.fromkeys(describe_plain(ring.stiffness, "N/m") for ring in rings)
            ways = dict.fromkeys("they only push" if ring.unilateral else "they hold both ways" for ring in rings)
            sizes = dict.fromkeys(
                f"{format_input(1e3 * ring.length)} × {format_input(1e3 * ring.width)}{SPACE}mm"
                for ring in rings
                if ring.faces
            )
            plays = dict.fromkeys(play for ring in rings if (play := _play_words(ring)))
            alike.setdefault((count, ", ".join((*sizes, *stiffness, *ways, *plays))), []).append(name)
        if part.supports:
            supports = (f"{support.name} {_describe_support(support)}".strip() for support in part.supports)
            yield " ".join(filter(None, (name, "held by"))), "; ".join(supports)
    for (count, pad_text), names in alike.items():
        of = ", ".join(filter(None, names))
        yield f"pads of {of}" if of else "pads", f"{count}{' each' if len(names) > 1 else ''}, {pad_text}"


def _describe_support(support: Support) -> str:
    """Describe a support: its kind if it has one, its position, its stiffness, and the directions that it holds."""
    where = f"on the {support.on}" if isinstance(support.on, str) else f"at {format_input(support.on, 'm')}"
    moves = ", ".join(of for of in support.directions or () if not of.startswith("r"))
    turns = ", ".join(of[1] for of in support.directions or () if of.startswith("r"))
    ways = " and ".join(filter(None, (f"along {moves}" if moves else "", f"about {turns}" if turns else "")))
    stiffness = SceneWords().describe_value(support, "stiffness", support.stiffness)
    return f"{where}, {stiffness} {ways}" if ways else f"{support.kind} {where}, {stiffness}"


def _format_mass(mass: float) -> str:
    """Format a mass in kg, rounded to 0.1 kg."""
    return format_input(round(mass, 1), "kg")
