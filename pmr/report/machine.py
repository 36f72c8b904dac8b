"""Tables that repeat a run's input: machine, motion and loads, each body, time stepping and reduction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.report.blocks import Table
from pmr.report.columns import axis_points, body_axes, spread_indices
from pmr.report.numbers import MINUS, SPACE, format_input, format_quantity, significant, with_sign
from pmr.report.subject import (
    AppliedLoad,
    is_alone,
    is_raised,
    moving_part,
    reach,
    rings_of,
    scene_loads,
    structural_model_words,
)
from pmr.results import RunResult
from pmr.scene import Body, Reduction, Scene
from pmr.scene.box import Box
from pmr.scene.built import Support
from pmr.scene.choice import choose_model, model_of
from pmr.scene.frame import Frame
from pmr.scene.joints import OneBody
from pmr.scene.keys import ALONE, qualified_name
from pmr.scene.members import member_at, members
from pmr.scene.signals import SignalBase
from pmr.scene.structures import PointMass, Profile

Array = NDArray[np.float64]
PLACES = 400  # number of times at which the position of the tip is evaluated
_SIGNAL_UNITS = {"time": "s", "times": "s", "frequency": "Hz", "frequencies": "Hz", "phase": "rad", "degree": ""}
_MOST_KNOTS = 6  # largest number of values of a sequence that are listed one by one
Rows = Iterator[tuple[str, str]]
#: A length in m, or several lengths in m: a tuple, or a mapping by face or direction.
Lengths = float | tuple[float, ...] | Mapping[Any, float | tuple[float, float]]


def system_rows(result: RunResult) -> Rows:
    """Yield rows (name, text) about bodies, point masses, pads, loads, weight, angles, reach, tip and time."""
    yield from _body_rows(result)
    yield from _mass_rows(result)
    yield from _pad_rows(result)
    for load in scene_loads(result):
        yield qualified_name(load.body, load.name), _load_text(load)
    scene = result.scene
    yield "weight of the boom", _describe_weight(result)
    if scene.frame is not None:
        yield from _machine_rows(scene.frame, scene.time.end)
        for name, angle in zip(("luffing", "slewing"), scene.frame.angles, strict=True):
            low, high = np.rad2deg(angle.bounds(0.0, scene.time.end))
            if low or high:
                yield name, format_range(low, high, "°")
    elif scene.gravity is not None:
        yield (
            "raised by",
            f"{format_input(round(scene.gravity.inclination, 1))}°" if is_raised(result) else "0°, it lies level",
        )
    if result.reach is not None:
        yield "reach along the boom", format_range(float(result.reach.min()), float(result.reach.max()), f"{SPACE}m")
    elif moving_part(result) == "mouth":
        low, high = scene.path_bounds
        yield "out of its mouth", format_range(reach(result) - high, reach(result) - low, f"{SPACE}m")
    yield from _tip_rows(result)
    yield "time", format_input(scene.time.end, "s")


def _tip_rows(result: RunResult) -> Rows:
    """Yield a row with the range of the tip's position from the pivot in m.

    Nothing is yielded unless a frame, or the angle by which gravity is turned, raises the boom.
    """
    response = result.responses["reduced"]
    if axis_points(result, response) and (result.scene.frame is not None or is_raised(result)):
        out, up = body_axes(result, spread_indices(len(response.t), PLACES))[-1].side[:, -1].T
        far, high = (
            format_range(float(coordinate.min()), float(coordinate.max()), f"{SPACE}m") for coordinate in (out, up)
        )
        yield "tip from the pivot", f"{far} out, {high} up"


def _load_text(load: AppliedLoad) -> str:
    """Describe a load by its values, its position and its axis.

    A load that is never positive is described as a positive load along the opposite axis.
    """
    where, _, axis = load.where.rpartition(" along ")
    if load.values.min(initial=0.0) < 0.0 and load.values.max(initial=0.0) <= 0.0:
        return f"{_format_load(-load.values, load.unit)} {where} along {MINUS}{axis}"
    return f"{_format_load(load.values, load.unit)} {load.where}"


def _format_load(values: Array, unit: str) -> str:
    """Format a load as ``up to`` the value farthest from zero.

    A load that changes sign is formatted as its least to its largest value.  `unit` is the unit of `values`, without a
    prefix.
    """
    low, high = float(values.min(initial=0.0)), float(values.max(initial=0.0))
    if low < 0.0 < high:
        return f"{format_quantity(low, unit)} to {format_quantity(high, unit)}"
    return f"up to {format_quantity(high or low, unit)}"


def _machine_rows(frame: Frame, end: float) -> Rows:
    """Yield rows about the machine below the pivot (mass, springs, loads, initial state) and about the ground's motion.

    `end` is the end of the simulated time in s.
    """
    if (machine := frame.machine) is not None:
        place = ", ".join(map(format_input, machine.center))
        free = f"free along {', '.join(machine.free)}" if machine.free else "held"
        yield "machine", f"{format_input(machine.mass, 'kg')} with its centre at ({place}){SPACE}m, {free}"
        if springs := [
            f"{key} {format_stiffness(value, key.startswith('r'))}" for key, value in machine.stiffness.nonzero.items()
        ]:
            yield "machine on springs", ", ".join(springs)
        for what, base, acting in (("force", "N", machine.force), ("moment", "N m", machine.moment)):
            for axis, signal in acting.signals.items():
                bounds = np.array(signal.bounds(0.0, end))
                yield (
                    f"{what} on the machine",
                    f"{_format_load(bounds, base)} {'along' if base == 'N' else 'about'} {axis}",
                )
        for what, values_by_key, per in (
            ("displaced", machine.start.nonzero, ""),
            ("moving", machine.rate.nonzero, "/s"),
        ):
            if values_by_key:
                texts = (
                    f"{key} {format_input(value)}{_coordinate_unit(key, frame.unit)}{per}"
                    for key, value in values_by_key.items()
                )
                yield f"machine {what} at the start", ", ".join(texts)
    if frame.base is not None:
        called = "ground" if frame.machine is not None else "machine"
        ranges = {key: signal.bounds(0.0, end) for key, signal in frame.base.motions.items()}
        parts = [f"{key} {format_range(*bounds, _coordinate_unit(key, frame.unit))}" for key, bounds in ranges.items()]
        parts += [f"accelerated along {key}" for key, signal in frame.base.accelerations.items() if signal is not None]
        yield f"motion of the {called}", ", ".join(parts)


def _coordinate_unit(key: str, angles: str) -> str:
    """Unit of a coordinate with a space before it: m for displacements.

    If the key of the coordinate begins with r, it is a rotation, and its unit is `angles` (° or rad).
    """
    if not key.startswith("r"):
        return f"{SPACE}m"
    return "°" if angles == "degrees" else f"{SPACE}rad"


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
        properties = [_describe_box(box)] if (box := part.body.box) is not None else []
        properties += [_format_mass(masses[name])] if name in masses else []
        if properties:
            yield called, ", ".join(properties)
        models[structural_model_words(model_of(member), part.body.walls)] = None
        if (limit := part.body.material.yield_stress) is not None:
            limits[format_quantity(limit, "Pa")] = None
    yield "modelled as", "; ".join(models)
    if limits:
        yield "yield stress", "; ".join(limits)


def _describe_box(box: Box) -> str:
    """Describe a box: length in m, width and height in mm, then its walls and everything that is attached to them."""
    parts = ", ".join(f"{name} {text}" for name, text in _box_parts(box))
    width, height = format_input(1e3 * box.width), format_input(1e3 * box.height)
    return f"box of {format_input(box.length, 'm')}, {width} × {height}{SPACE}mm, {parts}"


def _box_parts(box: Box) -> Rows:
    """Yield (name, text) of a box's walls, cut corners, doublers, frames and tapers."""
    yield "wall", f"{format_lengths(box.wall)}{SPACE}mm"
    for cut, cut_length in (("radius", box.radius), ("chamfer", box.chamfer)):
        if cut_length:
            yield cut, f"{format_lengths(cut_length)}{SPACE}mm"
    for doubler in box.doublers:
        faces = "all around" if doubler.faces is None else f"on {', '.join(doubler.faces)}"
        place = f"from {format_input(doubler.start)} to {format_input(doubler.end, 'm')}"
        yield "doubler", f"{format_input(1e3 * doubler.thickness, 'mm')} {place}, {faces}"
    if box.frames:
        deep = "closed" if box.frame_depth == "full" else f"{format_lengths(box.frame_depth)}{SPACE}mm deep"
        places = ", ".join(map(format_input, box.frames))
        yield (
            "frames",
            f"{len(box.frames)}, {format_input(1e3 * box.frame_plate_thickness, 'mm')} thick, {deep}, "
            f"at {places}{SPACE}m",
        )
    for name, taper in (("tail taper", box.tail_taper), ("tip taper", box.tip_taper)):
        if taper is not None:
            dimensions = taper.model_dump(exclude={"length"}, exclude_none=True)
            ends = ", ".join(f"{of} {format_lengths(size)}{SPACE}mm" for of, size in dimensions.items())
            yield name, f"over {format_input(taper.length, 'm')} to {ends}"


def _mass_rows(result: RunResult) -> Rows:
    """Yield a row for each point mass, and a row with the total mass of the bodies and all that is attached."""
    for name, part in result.scene.bodies.items():
        for mass in part.masses:
            yield qualified_name(name, mass.name), _describe_mass(mass)
    if masses := result.summary.get("masses"):
        attached = ", ".join(mass.name for part in result.scene.bodies.values() for mass in part.masses)
        of = f" with {attached}" if attached else ""
        yield (
            "total mass",
            _format_mass(sum(mass_of_body["mass"] + mass_of_body["attached"] for mass_of_body in masses)) + of,
        )


def _pad_rows(result: RunResult) -> Rows:
    """Yield a row for each body's supports, then a row for each group of bodies whose pads are alike."""
    alike = dict[tuple[int, str], list[str]]()
    for name, part in result.scene.bodies.items():
        if rings := rings_of(part):
            count = sum(sum(len(places) for places in ring.faces.values()) if ring.faces else 1 for ring in rings)
            stiffness = dict.fromkeys(format_stiffness(ring.stiffness) for ring in rings)
            ways = dict.fromkeys("only pushing" if ring.unilateral else "holding both ways" for ring in rings)
            alike.setdefault((count, ", ".join((*stiffness, *ways))), []).append(name)
        if part.supports:
            supports = (f"{support.name} {_describe_support(support)}".strip() for support in part.supports)
            yield " ".join(filter(None, (name, "held by"))), "; ".join(supports)
    for (count, pad_text), names in alike.items():
        of = ", ".join(filter(None, names))
        yield f"pads of {of}" if of else "pads", f"{count}{' each' if len(names) > 1 else ''}, {pad_text}"


def _describe_support(support: Support) -> str:
    """Describe a support: its kind or the directions it holds, its position and its stiffness."""
    where = f"on its {support.on}" if isinstance(support.on, str) else f"at {format_input(support.on, 'm')}"
    along = support.kind if support.directions is None else f"along {', '.join(support.directions)}"
    turns = all(direction.startswith("r") for direction in support.held_directions)
    return f"{along} {where}, {format_stiffness(support.stiffness, turns)}"


def _describe_weight(result: RunResult) -> str:
    """Say whether weight acts, with the gravitational acceleration in m/s²."""
    gravity = result.scene.gravity
    return "left out" if gravity is None else f"included, {significant(gravity.acceleration)}{SPACE}m/s²"


def _describe_mass(mass: PointMass) -> str:
    """Describe a point mass by its mass in kg and the part of the body that it is attached to."""
    return f"{format_input(mass.mass, 'kg')} on {mass.on}"


def _format_mass(mass: float) -> str:
    """Format a mass in kg, rounded to 0.1 kg."""
    return format_input(round(mass, 1), "kg")


def body_tables(result: RunResult) -> list[Table]:
    """Build a table for each body with its model, dimensions, mesh, masses and supports, and a table for the damping.

    For a body alone, which is no boom, there is one table for both.
    """
    scene, damping = result.scene, tuple(_damping_rows(result.scene))
    tables_of_bodies = {
        name: tuple(_structure_rows(of, choose_model(member_at(scene, number)).model))
        for number, (name, of) in enumerate(scene.bodies.items())
    }
    if is_alone(result):
        return [Table("Body and mesh", (*tables_of_bodies[ALONE], *damping))]
    return [*(Table(name, rows) for name, rows in tables_of_bodies.items()), Table("All sections", damping)]


def motion_table(result: RunResult) -> Table:
    """Build the table of joints and loads; for a body alone it has the body's slider or pads in place of joints."""
    what, moving = "Joints", _joint_rows(result)
    if is_alone(result):
        what, moving = "Pads" if result.scene.pads else "Slider", _slider_rows(result)
    return Table(f"{what} and loads", (*moving, *_ring_rows(result), *_load_rows(result)))


def method_table(result: RunResult) -> Table:
    """Build the table of simulated time, time stepping and reduction."""
    time = result.scene.time
    rows = [
        ("simulated time", format_input(time.end, "s")),
        ("step", f"{format_input(1e3 * time.step, 'ms')}, {format_input(time.steps)} steps"),
        ("integrator", f"generalised-α, ρ∞ = {format_input(time.rho_inf)}"),
    ]
    released = "sliders released" if is_alone(result) else "joints released"
    for name, of in result.scene.bodies.items():
        rows += [(qualified_name(name, key), value) for key, value in _reduction_rows(of.reduction, released)]
    if "ancf" in result.scene.compare.against:
        rows.append(("ANCF elements", str(result.scene.compare.ancf_elements)))
    return Table("Time stepping and reduction", tuple(rows))


def describe_signal(signal: SignalBase, unit: str) -> str:
    """Describe a signal in words: its kind and those of its parameters that are not 0.

    `unit` is the unit of the signal's values.
    """
    data = signal.model_dump(exclude={"kind"})
    kind = str(getattr(signal, "kind", "signal")).replace("_", " ")
    if kind == "constant":
        return f"constant, {_format_with_unit(data['amount'], unit)}"
    if "terms" in data:
        return "; plus ".join(describe_signal(term, unit) for term in getattr(signal, "terms", ()))
    parts = [
        f"{name} {_format_with_unit(value, _SIGNAL_UNITS.get(name, unit))}"
        for name, value in data.items()
        if isinstance(value, (int, float, tuple, list)) and value != 0.0
    ]
    return ", ".join([kind, *parts])


def _structure_rows(part: OneBody, model: str) -> Rows:
    """Yield rows about a body: structural model `model`, dimensions, mesh, point masses and supports."""
    body, mesh = part.body, part.mesh
    yield "model", f"{structural_model_words(model).split(' ', 1)[1]}{' (chosen)' if body.model == 'auto' else ''}"
    if body.profile is not None:
        yield from _profile_rows(body.profile)
    else:
        yield from _section_rows(body)
    if mesh.file is not None:
        yield "mesh", PurePath(mesh.file).name
    elif model.startswith("beam"):
        graded = f", last over first {format_input(mesh.grading)}" if mesh.grading != 1.0 else ""
        yield "elements", f"{format_input(mesh.elements)}{graded}"
    else:
        yield (
            "edges",
            f"{format_input(mesh.size, 'm')}, along the axis {format_input(mesh.along or mesh.size, 'm')}",
        )
    for mass in part.masses:
        yield f"mass {mass.name}", _describe_mass(mass)
    for support in part.supports:
        yield f"support {support.name}".strip(), _describe_support(support)


def _profile_rows(profile: Profile) -> Rows:
    """Yield rows with length, stiffness and mass of a beam whose sections are described by a profile."""
    yield "length", format_input(profile.length, "m")
    yield "stiffness EI", f"{format_input(profile.bending_stiffness)}{SPACE}N{SPACE}m²"
    if profile.axial_stiffness is not None:
        yield "stiffness EA", format_input(profile.axial_stiffness, "N")
    yield "mass per length", f"{format_input(profile.mass_per_length)}{SPACE}kg/m"
    yield "axial coordinates", "yes" if profile.axial else "no"


def _section_rows(body: Body) -> Rows:
    """Yield rows with the box or the thickness of a body, and its material."""
    box, material = body.box, body.material
    if box is not None:
        yield "box", f"{format_input(box.length)} × {format_input(box.width)} × {format_input(box.height, 'm')}"
        yield from _box_parts(box)
    elif body.thickness is not None:
        yield "thickness", format_input(1e3 * body.thickness, "mm")
    yield "Young's modulus", format_input(1e-9 * material.young, "GPa")
    yield "Poisson's ratio", format_input(material.poisson)
    yield "density", format_input(material.density, "kg/m³")


def format_lengths(lengths: Lengths) -> str:
    """Format a length given in m as mm; for a dictionary (by face or direction) or a tuple, each of its lengths."""
    if isinstance(lengths, Mapping):
        return ", ".join(f"{name} {format_lengths(length)}" for name, length in lengths.items())
    return (
        " × ".join(format_input(1e3 * length) for length in lengths)
        if isinstance(lengths, tuple)
        else format_input(1e3 * lengths)
    )


def _damping_rows(scene: Scene) -> Rows:
    """Yield a row with Rayleigh's damping factors of mass (1/s) and stiffness (s); yield nothing if both are 0."""
    mass, stiffness = (float(f"{share:.4g}") for share in (scene.damping.mass, scene.damping.stiffness))
    if mass or stiffness:  # these factors were computed from a damping ratio
        yield "Rayleigh damping", f"{format_input(mass, '1/s')} · M + {format_input(stiffness, 's')} · K"


def _slider_rows(result: RunResult) -> Rows:
    """Yield rows with the path coordinate s of a body alone, and with the distances of its sliders from s.

    s is the position of its slider or of its mouth.
    """
    scene = result.scene
    yield f"{moving_part(result)} path s", describe_signal(scene.slider.path, "m")
    if any(scene.points):
        yield "sliders at", ", ".join(f"s {with_sign(offset)}{SPACE}m" for offset in scene.points)


def _joint_rows(result: RunResult) -> Rows:
    """Yield rows with the extension or overlap of each section, and with its pads in the next outer section."""
    for name, of in result.scene.bodies.items():
        if (joint := of.joint) is None:
            continue
        if joint.follows is not None:
            plus = f" {with_sign(joint.offset)}{SPACE}m" if joint.offset else ""
            yield f"extension of {name}", f"{format_input(joint.ratio)} times that of {joint.follows}{plus}"
        else:
            for kind, path in (("extension", joint.extension), ("overlap", joint.overlap)):
                if path is not None:
                    yield f"{kind} of {name}", describe_signal(path, "m")
        for end, rings in (("tail", joint.tail), ("mouth", joint.mouth)):
            for ring in rings:
                faces = ", ".join(f"{len(at)} {face}" for face, at in ring.faces.items()) if ring.faces else "a point"
                way = "only pushing" if ring.unilateral else "holding both ways"
                gap = f", play {format_lengths(ring.clearance)}{SPACE}mm" if ring.clearance else ""
                rubs = f", friction {format_input(ring.friction)}" if ring.friction else ""
                called = " ".join(filter(None, (f"pads of {name} at the {end}", ring.name)))
                what = f"at {format_input(ring.at, 'm')}, {faces}; {format_stiffness(ring.stiffness)}, {way}{gap}{rubs}"
                yield called, what


def format_stiffness(stiffness: str | float, turns: bool = False) -> str:
    """Format a stiffness: N/m as kN/mm or, if `turns`, N m/rad as MN m/rad; a text such as ``rigid`` is unchanged."""
    unit = f"MN{SPACE}m/rad" if turns else "kN/mm"
    return stiffness if isinstance(stiffness, str) else f"{format_input(1e-6 * stiffness)}{SPACE}{unit}"


def _ring_rows(result: RunResult) -> Rows:
    """Yield a row for each ring of pads on the ground: position, pads on each face, their size and stiffness."""
    for body, of in result.scene.bodies.items():
        for ring in of.pads:
            where = (f"s {with_sign(ring.at)}" if ring.at else "s") if ring.moving else format_input(ring.at)
            faces = ", ".join(f"{len(places)} {face}" for face, places in ring.faces.items())
            size = f"{format_input(ring.length)} × {format_input(ring.width, 'm')}"
            called = qualified_name(body, f"pads at the {ring.name}")
            yield called, f"at {where}{SPACE}m, {faces}; {size}, {format_stiffness(ring.stiffness)}"


def _load_rows(result: RunResult) -> Rows:
    """Yield a row for each load with its signal and its position, and a row for gravity."""
    for load in scene_loads(result):
        unit = load.unit.replace(" ", SPACE)
        yield qualified_name(load.body, f"load {load.name}"), f"{describe_signal(load.signal, unit)}; {load.where}"
    if (gravity := result.scene.gravity) is not None:
        along = ", ".join(format_input(round(c, 3) + 0.0) for c in gravity.direction)
        raised = (
            f", raised by {format_input(round(gravity.inclination, 2))}°" if abs(gravity.inclination) >= 0.01 else ""
        )
        yield "gravity", f"{format_input(gravity.acceleration)}{SPACE}m/s² along ({along}){raised}"


def _reduction_rows(reduction: Reduction, released: str) -> Rows:
    """Yield rows about a body's basis; `released` names what is free in eigenmodes, such as ``joints released``."""
    if reduction.file is not None:
        yield "basis", f"{reduction.coordinates} vectors of {PurePath(reduction.file).name}"
    elif not reduction.uses_pod:
        yield "basis", f"{reduction.coordinates} eigenmodes on the fixed supports, {released}"
    else:
        positions = reduction.positions
        where = positions if isinstance(positions, str) else f"{', '.join(format_input(s) for s in positions)}{SPACE}m"
        yield "snapshots", f"{reduction.modes} modes at {reduction.snapshots} positions ({where})"
        yield "basis", f"POD, {reduction.coordinates} vectors, {reduction.product} product"
        if reduction.basis == "paper":
            yield "rows of supports", "each takes a coordinate, as published"
    if reduction.ports:
        yield "attachment modes", f"of {', '.join(map(str, reduction.ports))}, as ports"
    if reduction.flexibility:
        yield "residual flexibility", "added, quasi-static"


def _format_with_unit(value: float | Sequence[float], unit: str) -> str:
    """Format a number or a sequence of numbers with its unit.

    A sequence of more than `_MOST_KNOTS` numbers is described by their count and their range.
    """
    if isinstance(value, Sequence):
        if len(value) > _MOST_KNOTS:
            return f"({len(value)} values, {format_input(min(value))} to {format_input(max(value))}){SPACE}{unit}"
        return f"({', '.join(format_input(v) for v in value)}){SPACE}{unit}"
    return f"{format_input(value)}{SPACE}{unit}".rstrip(SPACE)
