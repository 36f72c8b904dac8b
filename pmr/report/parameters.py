"""What was asked for: bodies, what moves along them, loads, time stepping, reduction, as tables."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePath
from typing import Any

from pmr.report.blocks import Table
from pmr.report.numbers import SPACE, plain, with_sign
from pmr.report.subject import is_alone, loads_as_asked, moving_part, spoken
from pmr.results import RunResult
from pmr.scene import Body, Reduction
from pmr.scene.box import Box, Doubler, Taper
from pmr.scene.choice import choose
from pmr.scene.joints import OneBody
from pmr.scene.keys import ALONE, named
from pmr.scene.members import member_at
from pmr.scene.signals import SignalBase
from pmr.scene.structures import Profile

Rows = Iterator[tuple[str, str]]
_SIGNAL_UNITS = {"time": "s", "times": "s", "frequency": "Hz", "frequencies": "Hz", "phase": "rad", "degree": ""}
_MOST_KNOTS = 6


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
    if not is_alone(result):
        return Table("Joints and loads", (*_joints(result), *_pads(result), *_load_rows(result)))
    return Table(
        f"{'Pads' if result.scene.pads else 'Slider'} and loads",
        (*_slider(result), *_pads(result), *_load_rows(result)),
    )


def method(result: RunResult) -> Table:
    """Time stepping and reduction."""
    rows = [*_time_rows(result.scene)]
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
        yield f"mass {mass.name}", f"{plain(mass.mass)}{SPACE}kg on {mass.on}"
    for support in of.supports:
        where = f"on {support.on}" if isinstance(support.on, str) else f"at {plain(support.on)}{SPACE}m"
        along = support.kind if support.directions is None else f"along {', '.join(support.directions)}"
        stiffness = support.stiffness if isinstance(support.stiffness, str) else f"{plain(support.stiffness)}{SPACE}N/m"
        yield f"support {support.name}".strip(), f"{along} {where}, {stiffness}"


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
        yield "wall", f"{by_face(box.wall)}{SPACE}mm"
        for cut, cut_length in (("radius", box.radius), ("chamfer", box.chamfer)):
            if cut_length:
                yield cut, f"{by_face(cut_length)}{SPACE}mm"
        for doubler in box.doublers:
            yield "doubler", doubler_words(doubler)
        if box.frames:
            yield "frames", frame_words(box)
        for name, taper in (("tail taper", box.tail_taper), ("tip taper", box.tip_taper)):
            if taper is not None:
                yield name, taper_words(taper)
    elif body.thickness is not None:
        yield "thickness", f"{plain(1e3 * body.thickness)}{SPACE}mm"
    yield "Young's modulus", f"{plain(1e-9 * material.young)}{SPACE}GPa"
    yield "Poisson's ratio", plain(material.poisson)
    yield "density", f"{plain(material.density)}{SPACE}kg/m³"


def doubler_words(doubler: Doubler) -> str:
    """How thick, where, and on which faces."""
    faces = "all around" if doubler.faces is None else f"on {', '.join(doubler.faces)}"
    thick, (start, end) = plain(1e3 * doubler.thickness), (plain(at) for at in (doubler.start, doubler.end))
    return f"{thick}{SPACE}mm from {start} to {end}{SPACE}m, {faces}"


def frame_words(box: Box) -> str:
    """How many, how thick and deep, and where."""
    deep = "closed" if box.frame_depth == "full" else f"{by_face(box.frame_depth)}{SPACE}mm deep"
    places = ", ".join(map(plain, box.frames))
    return f"{len(box.frames)}, {plain(1e3 * box.plate)}{SPACE}mm thick, {deep}, at {places}{SPACE}m"


def taper_words(taper: Taper) -> str:
    """Over which length, and what it is at the end."""
    dimensions = taper.model_dump(exclude={"length"}, exclude_none=True)
    ends = ", ".join(f"{name} {by_face(size)}{SPACE}mm" for name, size in dimensions.items())
    return f"over {plain(taper.length)}{SPACE}m to {ends}"


def by_face(lengths: Any) -> str:
    """A length in mm, or several by face or direction."""
    if isinstance(lengths, dict):
        return ", ".join(f"{name} {by_face(length)}" for name, length in lengths.items())
    return " × ".join(plain(1e3 * length) for length in lengths) if isinstance(lengths, tuple) else plain(1e3 * lengths)


def _damping(scene: Any) -> Rows:
    rayleigh = scene.damping
    if rayleigh.mass or rayleigh.stiffness:
        yield (
            "Rayleigh damping",
            f"{plain(_round(rayleigh.mass))}{SPACE}1/s · M + {plain(_round(rayleigh.stiffness))}{SPACE}s · K",
        )


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


def stiff(stiffness: str | float) -> str:
    """The stiffness of a pad or a support, in kN/mm where it is a number."""
    return stiffness if isinstance(stiffness, str) else f"{plain(1e-6 * stiffness)}{SPACE}kN/mm"


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


def _time_rows(scene: Any) -> Rows:
    time = scene.time
    yield "simulated time", f"{plain(time.end)}{SPACE}s"
    yield "step", f"{plain(1e3 * time.step)}{SPACE}ms, {plain(time.steps)} steps"
    yield "integrator", f"generalised-α, ρ∞ = {plain(time.rho_inf)}"


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


def _round(value: float) -> float:
    """To what is read, where the value was computed from a damping ratio."""
    return float(f"{value:.4g}")


def _with_unit(value: Any, unit: str) -> str:
    if isinstance(value, (tuple, list)):
        if len(value) > _MOST_KNOTS:
            return f"({len(value)} values, {plain(min(value))} to {plain(max(value))}){SPACE}{unit}"
        return f"({', '.join(plain(v) for v in value)}){SPACE}{unit}"
    return f"{plain(value)}{SPACE}{unit}".rstrip(SPACE)
