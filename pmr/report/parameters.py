"""What was asked for: the body, what moves along it, loads, time stepping, reduction, as tables."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePath
from typing import Any

from pmr.report.blocks import Table
from pmr.report.numbers import SPACE, plain, signed
from pmr.report.subject import loads, moving, spoken
from pmr.results import RunResult
from pmr.scene import Body, Scene
from pmr.scene.choice import choose
from pmr.scene.members import member_at
from pmr.scene.signals import SignalBase
from pmr.scene.structures import Profile

Rows = Iterator[tuple[str, str]]
_SIGNAL_UNITS = {"time": "s", "times": "s", "frequency": "Hz", "frequencies": "Hz", "phase": "rad"}
_MOST_KNOTS = 6


def body(result: RunResult) -> Table:
    """What slides, what holds it, how it is damped."""
    scene = result.scene
    return Table("Body and mesh", (*_structure(scene), *_damping(scene)))


def motion(result: RunResult) -> Table:
    """What moves along it, and what acts on it."""
    return Table(f"{'Pads' if result.scene.pads else 'Slider'} and loads", tuple(_motion(result)))


def method(result: RunResult) -> Table:
    """Time stepping and reduction."""
    return Table("Time stepping and reduction", tuple(_method(result.scene)))


def described(signal: SignalBase, unit: str) -> str:
    """A signal in words: its kind and its parameters with units."""
    data = signal.model_dump(exclude={"kind"})
    kind = str(getattr(signal, "kind", "signal")).replace("_", " ")
    if kind == "constant":
        return f"constant, {_with_unit(data['amount'], unit)}"
    if "terms" in data:
        return "; plus ".join(described(term, unit) for term in getattr(signal, "terms", ()))
    parts = [
        f"{name} {_with_unit(value, _SIGNAL_UNITS.get(name, unit))}"
        for name, value in data.items()
        if isinstance(value, (int, float, tuple, list)) and value != 0.0
    ]
    return ", ".join([kind, *parts])


def _structure(scene: Scene) -> Rows:
    body, mesh, chosen = scene.body, scene.mesh, choose(member_at(scene))
    yield "model", f"{spoken(chosen.model).split(' ', 1)[1]}{' (chosen)' if body.model == 'auto' else ''}"
    if body.profile is not None:
        yield from _profile(body.profile)
    else:
        yield from _section(body)
    if mesh.file is not None:
        yield "mesh", PurePath(mesh.file).name
    elif chosen.model.startswith("beam"):
        graded = f", last over first {plain(mesh.grading)}" if mesh.grading != 1.0 else ""
        yield "elements", f"{plain(mesh.elements)}{graded}"
    else:
        yield "edges", f"{plain(mesh.size)}{SPACE}m, along the axis {plain(mesh.along or mesh.size)}{SPACE}m"
    for mass in scene.masses:
        yield f"mass {mass.name}", f"{plain(mass.mass)}{SPACE}kg on {mass.on}"
    for support in scene.supports:
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
        yield "wall", f"{plain(1e3 * box.wall)}{SPACE}mm"
    elif body.thickness is not None:
        yield "thickness", f"{plain(1e3 * body.thickness)}{SPACE}mm"
    yield "Young's modulus", f"{plain(1e-9 * material.young)}{SPACE}GPa"
    yield "Poisson's ratio", plain(material.poisson)
    yield "density", f"{plain(material.density)}{SPACE}kg/m³"


def _damping(scene: Scene) -> Rows:
    rayleigh = scene.damping
    if rayleigh.mass or rayleigh.stiffness:
        yield (
            "Rayleigh damping",
            f"{plain(_rounded(rayleigh.mass))}{SPACE}1/s · M + {plain(_rounded(rayleigh.stiffness))}{SPACE}s · K",
        )


def _motion(result: RunResult) -> Rows:
    scene = result.scene
    yield f"{moving(result)} path s", described(scene.slider.path, "m")
    if any(scene.points):
        yield "sliders at", ", ".join(f"s {signed(offset)}{SPACE}m" for offset in scene.points)
    for ring in result.scene.pads:
        where = (f"s {signed(ring.at)}" if ring.at else "s") if ring.moving else plain(ring.at)
        faces = ", ".join(f"{len(places)} {face}" for face, places in ring.faces.items())
        stiffness = ring.stiffness if isinstance(ring.stiffness, str) else f"{plain(1e-6 * ring.stiffness)}{SPACE}kN/mm"
        size = f"{plain(ring.length)} × {plain(ring.width)}{SPACE}m"
        yield f"pads at the {ring.name}", f"at {where}{SPACE}m, {faces}; {size}, {stiffness}"
    for load in loads(result):
        unit = load.unit.replace(" ", SPACE)
        yield f"load {load.name}", f"{described(load.signal, unit)}; {load.where}"
    if (gravity := result.scene.gravity) is not None:
        along = ", ".join(plain(round(c, 3) + 0.0) for c in gravity.direction)
        raised = f", raised by {plain(round(gravity.raised, 2))}°" if abs(gravity.raised) >= 0.01 else ""
        yield "gravity", f"{plain(gravity.acceleration)}{SPACE}m/s² along ({along}){raised}"


def _method(scene: Scene) -> Rows:
    time, reduction = scene.time, scene.reduction
    yield "simulated time", f"{plain(time.end)}{SPACE}s"
    yield "step", f"{plain(1e3 * time.step)}{SPACE}ms, {plain(time.steps)} steps"
    yield "integrator", f"generalised-α, ρ∞ = {plain(time.rho_inf)}"
    if reduction.file is not None:
        yield "basis", f"{reduction.coordinates} vectors of {PurePath(reduction.file).name}"
    elif not reduction.pooled:
        yield "basis", f"{reduction.coordinates} eigenmodes on the fixed supports, sliders released"
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
        yield "residual flexibility", "added, with its inertia" if reduction.residual_inertia else "added, quasi-static"
    if "ancf" in scene.compare.against:
        yield "ANCF elements", str(scene.compare.ancf_elements)


def _rounded(value: float) -> float:
    """To what is read, where the value was computed from a damping ratio."""
    return float(f"{value:.4g}")


def _with_unit(value: Any, unit: str) -> str:
    if isinstance(value, (tuple, list)):
        if len(value) > _MOST_KNOTS:
            return f"({len(value)} values, {plain(min(value))} to {plain(max(value))}){SPACE}{unit}"
        return f"({', '.join(plain(v) for v in value)}){SPACE}{unit}"
    return f"{plain(value)}{SPACE}{unit}"
