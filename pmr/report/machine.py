"""What was asked for as tables: the machine with its motion and loads, each body, time stepping and reduction."""

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
PLACES = 400  # at which the way of a tip is looked at
_SIGNAL_UNITS = {"time": "s", "times": "s", "frequency": "Hz", "frequencies": "Hz", "phase": "rad", "degree": ""}
_MOST_KNOTS = 6  # of a signal that are listed
Rows = Iterator[tuple[str, str]]


def rows(result: RunResult) -> Rows:
    """Rows about the machine, its motion and its loads."""
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
    """Range of the tip of a boom that is raised, from the pivot."""
    response = result.responses["reduced"]
    if lines(result, response) and (result.scene.frame is not None or is_raised(result)):
        out, up = body_axes(result, spread(len(response.t), PLACES))[-1].side[:, -1].T
        far, high = (extent(float(coordinate.min()), float(coordinate.max()), f"{SPACE}m") for coordinate in (out, up))
        yield "tip from the pivot", f"{far} out, {high} up"


def _load_text(load: Acting) -> str:
    """How large a load is at most, where, and along which axis, against which where it acts against it alone."""
    where, _, axis = load.where.rpartition(" along ")
    if load.values.min(initial=0.0) < 0.0 and load.values.max(initial=0.0) <= 0.0:
        return f"{_range(-load.values, load.unit)} {where} along {MINUS}{axis}"
    return f"{_range(load.values, load.unit)} {load.where}"


def _range(values: Array, unit: str) -> str:
    """The largest of a load, or both ends where it acts both ways."""
    low, high = float(values.min(initial=0.0)), float(values.max(initial=0.0))
    if low < 0.0 < high:
        return f"{quantity(low, unit)} to {quantity(high, unit)}"
    return f"up to {quantity(high or low, unit)}"


def _below(frame: Frame, end: float) -> Rows:
    """The machine below the pivot: what it is, what it stands on, what acts on it, and how the ground moves."""
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
    if not key.startswith("r"):
        return f"{SPACE}m"
    return "°" if angles == "degrees" else f"{SPACE}rad"


def extent(low: float, high: float, unit: str) -> str:
    """From a value to another one; one value where they don't differ as printed."""
    low, high = (round(float(end), 2) for end in (low, high))
    return f"{plain(low)} to {plain(high)}{unit}" if high > low else f"{plain(low)}{unit}"


def _bodies(result: RunResult) -> Rows:
    """Size and weight of each section; what all of them are modelled as, and their yield stress."""
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
    parts = ", ".join(f"{name} {text}" for name, text in _box_parts(box))
    return f"box of {plain(box.length)}{SPACE}m, {plain(1e3 * box.width)} × {plain(1e3 * box.height)}{SPACE}mm, {parts}"


def _box_parts(box: Box) -> Rows:
    """Wall, cut corners, doublers, frames and tapers of a box."""
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
    for name, part in result.scene.bodies.items():
        for mass in part.masses:
            yield named(name, mass.name), _mass(mass)
    if masses := result.summary.get("masses"):
        attached = ", ".join(mass.name for part in result.scene.bodies.values() for mass in part.masses)
        of = f" with {attached}" if attached else ""
        yield "total mass", _kg(sum(mass_of_body["mass"] + mass_of_body["attached"] for mass_of_body in masses)) + of


def _pad_rows(result: RunResult) -> Rows:
    """Pads between sections, those that are alike in one row, and what holds the base."""
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
    """Directions, place and stiffness of a support."""
    where = f"on its {support.on}" if isinstance(support.on, str) else f"at {plain(support.on)}{SPACE}m"
    along = support.kind if support.directions is None else f"along {', '.join(support.directions)}"
    turns = all(direction.startswith("r") for direction in support.held)
    return f"{along} {where}, {stiff(support.stiffness, turns)}"


def _weight(result: RunResult) -> str:
    gravity = result.scene.gravity
    return "left out" if gravity is None else f"included, {significant(gravity.acceleration)}{SPACE}m/s²"


def _mass(mass: PointMass) -> str:
    return f"{plain(mass.mass)}{SPACE}kg on {mass.on}"


def _kg(mass: float) -> str:
    return f"{plain(round(mass, 1))}{SPACE}kg"


def bodies(result: RunResult) -> list[Table]:
    """Tables of the bodies, their supports and damping; of a boom of each section."""
    scene, damping = result.scene, tuple(_damping(result.scene))
    tables_of_bodies = {
        name: tuple(_structure(of, choose(member_at(scene, number)).model))
        for number, (name, of) in enumerate(scene.bodies.items())
    }
    if is_alone(result):
        return [Table("Body and mesh", (*tables_of_bodies[ALONE], *damping))]
    return [*(Table(name, rows) for name, rows in tables_of_bodies.items()), Table("All sections", damping)]


def motion(result: RunResult) -> Table:
    """Table of paths and loads."""
    what, moving = "Joints", _joints(result)
    if is_alone(result):
        what, moving = "Pads" if result.scene.pads else "Slider", _slider(result)
    return Table(f"{what} and loads", (*moving, *_pads(result), *_load_rows(result)))


def method(result: RunResult) -> Table:
    """Time stepping and reduction."""
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
    """A signal in words: its kind and its parameters with units."""
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
    yield "length", f"{plain(profile.length)}{SPACE}m"
    yield "stiffness EI", f"{plain(profile.bending_stiffness)}{SPACE}N{SPACE}m²"
    if profile.axial_stiffness is not None:
        yield "stiffness EA", f"{plain(profile.axial_stiffness)}{SPACE}N"
    yield "mass per length", f"{plain(profile.mass_per_length)}{SPACE}kg/m"
    yield "axial coordinates", "yes" if profile.axial else "no"


def _section(body: Body) -> Rows:
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
    """A length in mm, or several by face or direction."""
    if isinstance(lengths, dict):
        return ", ".join(f"{name} {by_face(length)}" for name, length in lengths.items())
    return " × ".join(plain(1e3 * length) for length in lengths) if isinstance(lengths, tuple) else plain(1e3 * lengths)


def _damping(scene: Scene) -> Rows:
    mass, stiffness = (float(f"{share:.4g}") for share in (scene.damping.mass, scene.damping.stiffness))
    if mass or stiffness:  # computed from a damping ratio
        yield "Rayleigh damping", f"{plain(mass)}{SPACE}1/s · M + {plain(stiffness)}{SPACE}s · K"


def _slider(result: RunResult) -> Rows:
    scene = result.scene
    yield f"{moving_part(result)} path s", describe_signal(scene.slider.path, "m")
    if any(scene.points):
        yield "sliders at", ", ".join(f"s {with_sign(offset)}{SPACE}m" for offset in scene.points)


def _joints(result: RunResult) -> Rows:
    """How each section slides in the next outer one."""
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
    """A stiffness in kN/mm, or in MN m/rad of what `turns`; ``rigid`` as it is."""
    unit = f"MN{SPACE}m/rad" if turns else "kN/mm"
    return stiffness if isinstance(stiffness, str) else f"{plain(1e-6 * stiffness)}{SPACE}{unit}"


def _pads(result: RunResult) -> Rows:
    for body, of in result.scene.bodies.items():
        for ring in of.pads:
            where = (f"s {with_sign(ring.at)}" if ring.at else "s") if ring.moving else plain(ring.at)
            faces = ", ".join(f"{len(places)} {face}" for face, places in ring.faces.items())
            size = f"{plain(ring.length)} × {plain(ring.width)}{SPACE}m"
            called = named(body, f"pads at the {ring.name}")
            yield called, f"at {where}{SPACE}m, {faces}; {size}, {stiff(ring.stiffness)}"


def _load_rows(result: RunResult) -> Rows:
    for load in loads_as_asked(result):
        unit = load.unit.replace(" ", SPACE)
        yield named(load.body, f"load {load.name}"), f"{describe_signal(load.signal, unit)}; {load.where}"
    if (gravity := result.scene.gravity) is not None:
        along = ", ".join(plain(round(c, 3) + 0.0) for c in gravity.direction)
        raised = f", raised by {plain(round(gravity.raised, 2))}°" if abs(gravity.raised) >= 0.01 else ""
        yield "gravity", f"{plain(gravity.acceleration)}{SPACE}m/s² along ({along}){raised}"


def _reduction(reduction: Reduction, released: str) -> Rows:
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
    if isinstance(value, (tuple, list)):
        if len(value) > _MOST_KNOTS:
            return f"({len(value)} values, {plain(min(value))} to {plain(max(value))}){SPACE}{unit}"
        return f"({', '.join(plain(v) for v in value)}){SPACE}{unit}"
    return f"{plain(value)}{SPACE}{unit}".rstrip(SPACE)
