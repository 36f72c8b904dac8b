"""Tables that repeat a run's input: machine, motion and loads, each body, time stepping and reduction."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.report.blocks import Table
from pmr.report.columns import body_axes, lines, spread
from pmr.report.numbers import MINUS, SPACE, plain, quantity, significant, with_sign
from pmr.report.subject import Acting, is_alone, is_raised, length, loads_as_asked, moving_part, rings_of, spoken
from pmr.results import RunResult
from pmr.scene import Body, Reduction, Scene
from pmr.scene.box import Box
from pmr.scene.built import Support
from pmr.scene.choice import choose, model_of
from pmr.scene.frame import Frame
from pmr.scene.joints import OneBody
from pmr.scene.keys import ALONE, named
from pmr.scene.members import member_at, members
from pmr.scene.signals import SignalBase
from pmr.scene.structures import PointMass, Profile

Array = NDArray[np.float64]
PLACES = 400  # times at which the position of the tip is looked at
_SIGNAL_UNITS = {"time": "s", "times": "s", "frequency": "Hz", "frequencies": "Hz", "phase": "rad", "degree": ""}
_MOST_KNOTS = 6  # values of a sequence that are listed one by one
Rows = Iterator[tuple[str, str]]


def rows(result: RunResult) -> Rows:
    """Yield rows (name, text) about bodies, point masses, pads, loads, weight, angles, reach, tip and time."""
    yield from _bodies(result)
    yield from _masses(result)
    yield from _pad_rows(result)
    for load in loads_as_asked(result):
        yield named(load.body, load.name), _load_text(load)
    scene = result.scene
    yield "weight of the boom", _weight(result)
    if scene.frame is not None:
        yield from _below(scene.frame, scene.time.end)
        for name, angle in zip(("luffing", "slewing"), scene.frame.angles, strict=True):
            low, high = np.rad2deg(angle.bounds(0.0, scene.time.end))
            if low or high:
                yield name, extent(low, high, "°")
    elif scene.gravity is not None:
        yield "raised by", f"{plain(round(scene.gravity.raised, 1))}°" if is_raised(result) else "0°, it lies level"
    if result.reach is not None:
        yield "reach along the boom", extent(float(result.reach.min()), float(result.reach.max()), f"{SPACE}m")
    elif moving_part(result) == "mouth":
        low, high = scene.path_bounds
        yield "out of its mouth", extent(length(result) - high, length(result) - low, f"{SPACE}m")
    yield from _tip(result)
    yield "time", f"{plain(scene.time.end)}{SPACE}s"


def _tip(result: RunResult) -> Rows:
    """Yield a row with the range of the tip's position from the pivot in m, if frame or weight raises the boom."""
    response = result.responses["reduced"]
    if lines(result, response) and (result.scene.frame is not None or is_raised(result)):
        out, up = body_axes(result, spread(len(response.t), PLACES))[-1].side[:, -1].T
        far, high = (extent(float(coordinate.min()), float(coordinate.max()), f"{SPACE}m") for coordinate in (out, up))
        yield "tip from the pivot", f"{far} out, {high} up"


def _load_text(load: Acting) -> str:
    """Describe a load by its values, where it acts and its axis.

    A load that is never positive is described as a positive one along minus this axis.
    """
    where, _, axis = load.where.rpartition(" along ")
    if load.values.min(initial=0.0) < 0.0 and load.values.max(initial=0.0) <= 0.0:
        return f"{_range(-load.values, load.unit)} {where} along {MINUS}{axis}"
    return f"{_range(load.values, load.unit)} {load.where}"


def _range(values: Array, unit: str) -> str:
    """Format a load as ``up to`` its value farthest from zero, or as its least to its largest if it changes sign.

    `unit` is that of `values`, without a prefix.
    """
    low, high = float(values.min(initial=0.0)), float(values.max(initial=0.0))
    if low < 0.0 < high:
        return f"{quantity(low, unit)} to {quantity(high, unit)}"
    return f"up to {quantity(high or low, unit)}"


def _below(frame: Frame, end: float) -> Rows:
    """Yield rows about the machine below the pivot: mass, springs, loads and initial state, and the ground's motion.

    `end` is the end of the simulated time in s.
    """
    if (machine := frame.machine) is not None:
        place = ", ".join(map(plain, machine.center))
        free = f"free along {', '.join(machine.free)}" if machine.free else "held"
        yield "machine", f"{plain(machine.mass)}{SPACE}kg with its centre at ({place}){SPACE}m, {free}"
        if springs := [f"{key} {stiff(value, key.startswith('r'))}" for key, value in machine.stiffness.given.items()]:
            yield "machine on springs", ", ".join(springs)
        for what, base, acting in (("force", "N", machine.force), ("moment", "N m", machine.moment)):
            for axis, signal in acting.given.items():
                bounds = np.array(signal.bounds(0.0, end))
                yield f"{what} on the machine", f"{_range(bounds, base)} {'along' if base == 'N' else 'about'} {axis}"
        for what, values_by_key, per in (("displaced", machine.start.given, ""), ("moving", machine.rate.given, "/s")):
            if values_by_key:
                texts = (f"{key} {plain(value)}{_unit(key, frame.unit)}{per}" for key, value in values_by_key.items())
                yield f"machine {what} at the start", ", ".join(texts)
    if frame.base is not None:
        called = "ground" if frame.machine is not None else "machine"
        ranges = {key: signal.bounds(0.0, end) for key, signal in frame.base.motions.items()}
        parts = [f"{key} {extent(*bounds, _unit(key, frame.unit))}" for key, bounds in ranges.items()]
        parts += [f"accelerated along {key}" for key, signal in frame.base.accelerations.items() if signal is not None]
        yield f"motion of the {called}", ", ".join(parts)


def _unit(key: str, angles: str) -> str:
    """Unit of a coordinate, a space before it: m, or ° or rad (by `angles`) if its key begins with r, for rotations."""
    if not key.startswith("r"):
        return f"{SPACE}m"
    return "°" if angles == "degrees" else f"{SPACE}rad"


def extent(low: float, high: float, unit: str) -> str:
    """Format the range `low` to `high`, rounded to 0.01, or one value if both are equal then.

    `unit` is appended without a space, so it has to begin with one where one is needed.
    """
    low, high = (round(float(end), 2) for end in (low, high))
    return f"{plain(low)} to {plain(high)}{unit}" if high > low else f"{plain(low)}{unit}"


def _bodies(result: RunResult) -> Rows:
    """Yield rows with dimensions and mass of each body, with all structural models, and with all yield stresses."""
    masses = {mass["name"]: mass["mass"] for mass in result.summary.get("masses", ())}
    models, limits = dict[str, None](), dict[str, None]()
    for member, (name, part) in zip(members(result.scene), result.scene.bodies.items(), strict=True):
        called = name or "structure"
        properties = [_size(box)] if (box := part.body.box) is not None else []
        properties += [_kg(masses[name])] if name in masses else []
        if properties:
            yield called, ", ".join(properties)
        models[spoken(model_of(member), part.body.walls)] = None
        if (limit := part.body.material.yield_stress) is not None:
            limits[quantity(limit, "Pa")] = None
    yield "modelled as", "; ".join(models)
    if limits:
        yield "yield stress", "; ".join(limits)


def _size(box: Box) -> str:
    """Describe a box: length in m, width and height in mm, then its walls and all that is on them."""
    parts = ", ".join(f"{name} {text}" for name, text in _box_parts(box))
    return f"box of {plain(box.length)}{SPACE}m, {plain(1e3 * box.width)} × {plain(1e3 * box.height)}{SPACE}mm, {parts}"


def _box_parts(box: Box) -> Rows:
    """Yield (name, text) of a box's walls, cut corners, doublers, frames and tapers."""
    yield "wall", f"{by_face(box.wall)}{SPACE}mm"
    for cut, cut_length in (("radius", box.radius), ("chamfer", box.chamfer)):
        if cut_length:
            yield cut, f"{by_face(cut_length)}{SPACE}mm"
    for doubler in box.doublers:
        faces = "all around" if doubler.faces is None else f"on {', '.join(doubler.faces)}"
        place = f"from {plain(doubler.start)} to {plain(doubler.end)}{SPACE}m"
        yield "doubler", f"{plain(1e3 * doubler.thickness)}{SPACE}mm {place}, {faces}"
    if box.frames:
        deep = "closed" if box.frame_depth == "full" else f"{by_face(box.frame_depth)}{SPACE}mm deep"
        places = ", ".join(map(plain, box.frames))
        yield "frames", f"{len(box.frames)}, {plain(1e3 * box.plate)}{SPACE}mm thick, {deep}, at {places}{SPACE}m"
    for name, taper in (("tail taper", box.tail_taper), ("tip taper", box.tip_taper)):
        if taper is not None:
            dimensions = taper.model_dump(exclude={"length"}, exclude_none=True)
            ends = ", ".join(f"{of} {by_face(size)}{SPACE}mm" for of, size in dimensions.items())
            yield name, f"over {plain(taper.length)}{SPACE}m to {ends}"


def _masses(result: RunResult) -> Rows:
    """Yield a row for each point mass, and a row with the total mass of the bodies and of what is attached to them."""
    for name, part in result.scene.bodies.items():
        for mass in part.masses:
            yield named(name, mass.name), _mass(mass)
    if masses := result.summary.get("masses"):
        attached = ", ".join(mass.name for part in result.scene.bodies.values() for mass in part.masses)
        of = f" with {attached}" if attached else ""
        yield "total mass", _kg(sum(mass_of_body["mass"] + mass_of_body["attached"] for mass_of_body in masses)) + of


def _pad_rows(result: RunResult) -> Rows:
    """Yield a row for all bodies whose pads are alike, with their names, and a row for each body's supports."""
    alike = dict[tuple[int, str], list[str]]()
    for name, part in result.scene.bodies.items():
        if rings := rings_of(part):
            count = sum(sum(len(places) for places in ring.faces.values()) if ring.faces else 1 for ring in rings)
            stiffness = dict.fromkeys(stiff(ring.stiffness) for ring in rings)
            ways = dict.fromkeys("only pushing" if ring.unilateral else "holding both ways" for ring in rings)
            alike.setdefault((count, ", ".join((*stiffness, *ways))), []).append(name)
        if part.supports:
            supports = (f"{support.name} {_support(support)}".strip() for support in part.supports)
            yield " ".join(filter(None, (name, "held by"))), "; ".join(supports)
    for (count, pad_text), names in alike.items():
        of = ", ".join(filter(None, names))
        yield f"pads of {of}" if of else "pads", f"{count}{' each' if len(names) > 1 else ''}, {pad_text}"


def _support(support: Support) -> str:
    """Describe a support: its kind or the directions it holds, its position and its stiffness."""
    where = f"on its {support.on}" if isinstance(support.on, str) else f"at {plain(support.on)}{SPACE}m"
    along = support.kind if support.directions is None else f"along {', '.join(support.directions)}"
    turns = all(direction.startswith("r") for direction in support.held)
    return f"{along} {where}, {stiff(support.stiffness, turns)}"


def _weight(result: RunResult) -> str:
    """Say whether weight acts, with the gravitational acceleration in m/s²."""
    gravity = result.scene.gravity
    return "left out" if gravity is None else f"included, {significant(gravity.acceleration)}{SPACE}m/s²"


def _mass(mass: PointMass) -> str:
    """Describe a point mass by its mass in kg and the part of the body it is on."""
    return f"{plain(mass.mass)}{SPACE}kg on {mass.on}"


def _kg(mass: float) -> str:
    """Format a mass in kg, rounded to 0.1 kg."""
    return f"{plain(round(mass, 1))}{SPACE}kg"


def bodies(result: RunResult) -> list[Table]:
    """Build a table for each body with its model, dimensions, mesh, masses and supports, and one for the damping.

    Of a single body that is no boom, both are one table.
    """
    scene, damping = result.scene, tuple(_damping(result.scene))
    tables_of_bodies = {
        name: tuple(_structure(of, choose(member_at(scene, number)).model))
        for number, (name, of) in enumerate(scene.bodies.items())
    }
    if is_alone(result):
        return [Table("Body and mesh", (*tables_of_bodies[ALONE], *damping))]
    return [*(Table(name, rows) for name, rows in tables_of_bodies.items()), Table("All sections", damping)]


def motion(result: RunResult) -> Table:
    """Build the table of joints (of a single body: its slider or pads) and loads."""
    what, moving = "Joints", _joints(result)
    if is_alone(result):
        what, moving = "Pads" if result.scene.pads else "Slider", _slider(result)
    return Table(f"{what} and loads", (*moving, *_pads(result), *_load_rows(result)))


def method(result: RunResult) -> Table:
    """Build the table of simulated time, time stepping and reduction."""
    time = result.scene.time
    rows = [
        ("simulated time", f"{plain(time.end)}{SPACE}s"),
        ("step", f"{plain(1e3 * time.step)}{SPACE}ms, {plain(time.steps)} steps"),
        ("integrator", f"generalised-α, ρ∞ = {plain(time.rho_inf)}"),
    ]
    released = "sliders released" if is_alone(result) else "joints released"
    for name, of in result.scene.bodies.items():
        rows += [(named(name, key), value) for key, value in _reduction(of.reduction, released)]
    if "ancf" in result.scene.compare.against:
        rows.append(("ANCF elements", str(result.scene.compare.ancf_elements)))
    return Table("Time stepping and reduction", tuple(rows))


def describe_signal(signal: SignalBase, unit: str) -> str:
    """Describe a signal in words: its kind and its parameters other than 0; `unit` is that of its values."""
    data = signal.model_dump(exclude={"kind"})
    kind = str(getattr(signal, "kind", "signal")).replace("_", " ")
    if kind == "constant":
        return f"constant, {_with_unit(data['amount'], unit)}"
    if "terms" in data:
        return "; plus ".join(describe_signal(term, unit) for term in getattr(signal, "terms", ()))
    parts = [
        f"{name} {_with_unit(value, _SIGNAL_UNITS.get(name, unit))}"
        for name, value in data.items()
        if isinstance(value, (int, float, tuple, list)) and value != 0.0
    ]
    return ", ".join([kind, *parts])


def _structure(of: OneBody, chosen: str) -> Rows:
    """Yield rows about a body: model, dimensions, mesh, point masses, supports; `chosen` names its structural model."""
    body, mesh = of.body, of.mesh
    yield "model", f"{spoken(chosen).split(' ', 1)[1]}{' (chosen)' if body.model == 'auto' else ''}"
    if body.profile is not None:
        yield from _profile(body.profile)
    else:
        yield from _section(body)
    if mesh.file is not None:
        yield "mesh", PurePath(mesh.file).name
    elif chosen.startswith("beam"):
        graded = f", last over first {plain(mesh.grading)}" if mesh.grading != 1.0 else ""
        yield "elements", f"{plain(mesh.elements)}{graded}"
    else:
        yield "edges", f"{plain(mesh.size)}{SPACE}m, along the axis {plain(mesh.along or mesh.size)}{SPACE}m"
    for mass in of.masses:
        yield f"mass {mass.name}", _mass(mass)
    for support in of.supports:
        yield f"support {support.name}".strip(), _support(support)


def _profile(profile: Profile) -> Rows:
    """Yield rows with length, stiffness and mass of a beam that is described by a profile."""
    yield "length", f"{plain(profile.length)}{SPACE}m"
    yield "stiffness EI", f"{plain(profile.bending_stiffness)}{SPACE}N{SPACE}m²"
    if profile.axial_stiffness is not None:
        yield "stiffness EA", f"{plain(profile.axial_stiffness)}{SPACE}N"
    yield "mass per length", f"{plain(profile.mass_per_length)}{SPACE}kg/m"
    yield "axial coordinates", "yes" if profile.axial else "no"


def _section(body: Body) -> Rows:
    """Yield rows with the box or the thickness of a body, and its material."""
    box, material = body.box, body.material
    if box is not None:
        yield "box", f"{plain(box.length)} × {plain(box.width)} × {plain(box.height)}{SPACE}m"
        yield from _box_parts(box)
    elif body.thickness is not None:
        yield "thickness", f"{plain(1e3 * body.thickness)}{SPACE}mm"
    yield "Young's modulus", f"{plain(1e-9 * material.young)}{SPACE}GPa"
    yield "Poisson's ratio", plain(material.poisson)
    yield "density", f"{plain(material.density)}{SPACE}kg/m³"


def by_face(lengths: Any) -> str:
    """Format a length given in m as mm; of a dictionary (by face or direction) or a tuple each of its lengths."""
    if isinstance(lengths, dict):
        return ", ".join(f"{name} {by_face(length)}" for name, length in lengths.items())
    return " × ".join(plain(1e3 * length) for length in lengths) if isinstance(lengths, tuple) else plain(1e3 * lengths)


def _damping(scene: Scene) -> Rows:
    """Yield a row with Rayleigh's factors of mass (1/s) and stiffness (s), unless both are 0."""
    mass, stiffness = (float(f"{share:.4g}") for share in (scene.damping.mass, scene.damping.stiffness))
    if mass or stiffness:  # computed from a damping ratio
        yield "Rayleigh damping", f"{plain(mass)}{SPACE}1/s · M + {plain(stiffness)}{SPACE}s · K"


def _slider(result: RunResult) -> Rows:
    """Yield rows with the path s of the slider or mouth of a single body, and with its sliders' offsets from s."""
    scene = result.scene
    yield f"{moving_part(result)} path s", describe_signal(scene.slider.path, "m")
    if any(scene.points):
        yield "sliders at", ", ".join(f"s {with_sign(offset)}{SPACE}m" for offset in scene.points)


def _joints(result: RunResult) -> Rows:
    """Yield rows with the extension or overlap of each section, and with its pads in the next outer section."""
    for name, of in result.scene.bodies.items():
        if (joint := of.joint) is None:
            continue
        if joint.follows is not None:
            plus = f" {with_sign(joint.offset)}{SPACE}m" if joint.offset else ""
            yield f"extension of {name}", f"{plain(joint.ratio)} times that of {joint.follows}{plus}"
        else:
            for kind, path in (("extension", joint.extension), ("overlap", joint.overlap)):
                if path is not None:
                    yield f"{kind} of {name}", describe_signal(path, "m")
        for end, rings in (("tail", joint.tail), ("mouth", joint.mouth)):
            for ring in rings:
                faces = ", ".join(f"{len(at)} {face}" for face, at in ring.faces.items()) if ring.faces else "a point"
                way = "only pushing" if ring.unilateral else "holding both ways"
                gap = f", play {by_face(ring.clearance)}{SPACE}mm" if ring.clearance else ""
                rubs = f", friction {plain(ring.friction)}" if ring.friction else ""
                called = " ".join(filter(None, (f"pads of {name} at the {end}", ring.name)))
                what = f"at {plain(ring.at)}{SPACE}m, {faces}; {stiff(ring.stiffness)}, {way}{gap}{rubs}"
                yield called, what


def stiff(stiffness: str | float, turns: bool = False) -> str:
    """Format a stiffness: N/m as kN/mm, or if `turns` N m/rad as MN m/rad; text such as ``rigid`` stays as it is."""
    unit = f"MN{SPACE}m/rad" if turns else "kN/mm"
    return stiffness if isinstance(stiffness, str) else f"{plain(1e-6 * stiffness)}{SPACE}{unit}"


def _pads(result: RunResult) -> Rows:
    """Yield a row for each ring of pads on the ground: position, pads on each face, their size and stiffness."""
    for body, of in result.scene.bodies.items():
        for ring in of.pads:
            where = (f"s {with_sign(ring.at)}" if ring.at else "s") if ring.moving else plain(ring.at)
            faces = ", ".join(f"{len(places)} {face}" for face, places in ring.faces.items())
            size = f"{plain(ring.length)} × {plain(ring.width)}{SPACE}m"
            called = named(body, f"pads at the {ring.name}")
            yield called, f"at {where}{SPACE}m, {faces}; {size}, {stiff(ring.stiffness)}"


def _load_rows(result: RunResult) -> Rows:
    """Yield a row for each load with its signal and where it acts, and a row for gravity."""
    for load in loads_as_asked(result):
        unit = load.unit.replace(" ", SPACE)
        yield named(load.body, f"load {load.name}"), f"{describe_signal(load.signal, unit)}; {load.where}"
    if (gravity := result.scene.gravity) is not None:
        along = ", ".join(plain(round(c, 3) + 0.0) for c in gravity.direction)
        raised = f", raised by {plain(round(gravity.raised, 2))}°" if abs(gravity.raised) >= 0.01 else ""
        yield "gravity", f"{plain(gravity.acceleration)}{SPACE}m/s² along ({along}){raised}"


def _reduction(reduction: Reduction, released: str) -> Rows:
    """Yield rows about a body's basis; `released` is a clause on what eigenmodes leave free, as ``joints released``."""
    if reduction.file is not None:
        yield "basis", f"{reduction.coordinates} vectors of {PurePath(reduction.file).name}"
    elif not reduction.uses_pod:
        yield "basis", f"{reduction.coordinates} eigenmodes on the fixed supports, {released}"
    else:
        positions = reduction.positions
        where = positions if isinstance(positions, str) else f"{', '.join(plain(s) for s in positions)}{SPACE}m"
        yield "snapshots", f"{reduction.modes} modes at {reduction.snapshots} positions ({where})"
        yield "basis", f"POD, {reduction.coordinates} vectors, {reduction.product} product"
        if reduction.basis == "paper":
            yield "rows of supports", "each takes a coordinate, as published"
    if reduction.ports:
        yield "attachment modes", f"of {', '.join(map(str, reduction.ports))}, as ports"
    if reduction.flexibility:
        yield "residual flexibility", "added, quasi-static"


def _with_unit(value: Any, unit: str) -> str:
    """Format a number or a sequence with its unit; a sequence of more than `_MOST_KNOTS` by its count and its range."""
    if isinstance(value, (tuple, list)):
        if len(value) > _MOST_KNOTS:
            return f"({len(value)} values, {plain(min(value))} to {plain(max(value))}){SPACE}{unit}"
        return f"({', '.join(plain(v) for v in value)}){SPACE}{unit}"
    return f"{plain(value)}{SPACE}{unit}".rstrip(SPACE)
