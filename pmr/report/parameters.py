"""What was asked for: the body, what moves along it, loads, time stepping, reduction, as tables."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePath
from typing import Any

from pmr.report.blocks import Table
from pmr.report.numbers import SPACE, plain, signed
from pmr.report.subject import MODELS, loads, moving, rings, weight
from pmr.results import RunResult
from pmr.scene import Scene, SceneBase, StructureScene
from pmr.scene.choice import choose
from pmr.scene.signals import SignalBase

Rows = Iterator[tuple[str, str]]
_SIGNAL_UNITS = {"time": "s", "times": "s", "frequency": "Hz", "frequencies": "Hz", "phase": "rad"}
_MOST_KNOTS = 6


def body(result: RunResult) -> Table:
    """What slides, what holds it, how it is damped."""
    scene = result.scene
    described = _structure(scene) if isinstance(scene, StructureScene) else _beam(result.beam)
    return Table("Body and mesh", (*described, *_damping(scene)))


def motion(result: RunResult) -> Table:
    """What moves along it, and what acts on it."""
    return Table(f"{'Pads' if rings(result) else 'Slider'} and loads", tuple(_motion(result)))


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


def _beam(scene: Scene) -> Rows:
    body = scene.body
    yield "length", f"{plain(body.length)}{SPACE}m"
    yield "stiffness EI", f"{plain(body.bending_stiffness)}{SPACE}N{SPACE}m²"
    if body.axial_stiffness is not None:
        yield "stiffness EA", f"{plain(body.axial_stiffness)}{SPACE}N"
    yield "mass per length", f"{plain(body.mass_per_length)}{SPACE}kg/m"
    yield "nodal coordinates", ", ".join(body.directions)
    for support in scene.supports:
        yield "support", f"{support.kind} at {plain(support.at)}{SPACE}m"
    if scene.mesh.file is not None:
        yield "mesh", PurePath(scene.mesh.file).name
    else:
        graded = f", last over first {plain(scene.mesh.grading)}" if scene.mesh.grading != 1.0 else ""
        yield "elements", f"{scene.mesh.elements}{graded}"


def _structure(scene: StructureScene) -> Rows:
    body, material, mesh = scene.body, scene.body.material, scene.mesh
    yield "model", f"{MODELS[choose(scene).model].split(' ', 1)[1]}{' (chosen)' if body.model == 'auto' else ''}"
    if body.box is not None:
        box = body.box
        yield "box", f"{plain(box.length)} × {plain(box.width)} × {plain(box.height)}{SPACE}m"
        yield "wall", f"{plain(1e3 * box.wall)}{SPACE}mm"
    elif body.thickness is not None:
        yield "thickness", f"{plain(1e3 * body.thickness)}{SPACE}mm"
    yield "Young's modulus", f"{plain(1e-9 * material.young)}{SPACE}GPa"
    yield "Poisson's ratio", plain(material.poisson)
    yield "density", f"{plain(material.density)}{SPACE}kg/m³"
    if mesh.file is not None:
        yield "mesh", PurePath(mesh.file).name
    elif choose(scene).model.startswith("beam"):
        yield "elements", plain(mesh.elements)
    else:
        yield "edges", f"{plain(mesh.size)}{SPACE}m, along the axis {plain(mesh.along or mesh.size)}{SPACE}m"
    for mass in scene.masses:
        yield f"mass {mass.name}", f"{plain(mass.mass)}{SPACE}kg on {mass.on}"
    for clamp in scene.clamps:
        yield "clamped", f"{clamp.on}: {', '.join(clamp.directions)}"
    for hold in scene.holds:
        yield f"held by {hold.name}", f"{hold.on} along {hold.direction}, {hold.stiffness}"


def _damping(scene: SceneBase) -> Rows:
    rayleigh = scene.damping
    if rayleigh.mass or rayleigh.stiffness:
        yield (
            "Rayleigh damping",
            f"{plain(_rounded(rayleigh.mass))}{SPACE}1/s · M + {plain(_rounded(rayleigh.stiffness))}{SPACE}s · K",
        )


def _motion(result: RunResult) -> Rows:
    scene = result.scene
    yield f"{moving(result)} path s", described(scene.slider.path, "m")
    if scene.slider.offsets != (0.0,):
        yield "sliders at", ", ".join(f"s {signed(offset)}{SPACE}m" for offset in scene.slider.offsets)
    for ring in rings(result):
        where = (f"s {signed(ring.at)}" if ring.at else "s") if ring.moving else plain(ring.at)
        faces = ", ".join(f"{len(places)} {face}" for face, places in ring.faces.items())
        stiffness = ring.stiffness if isinstance(ring.stiffness, str) else f"{plain(1e-6 * ring.stiffness)}{SPACE}kN/mm"
        size = f"{plain(ring.length)} × {plain(ring.width)}{SPACE}m"
        yield f"pads at the {ring.name}", f"at {where}{SPACE}m, {faces}; {size}, {stiffness}"
    for load in loads(result):
        unit = load.unit.replace(" ", SPACE)
        yield f"load {load.name}", f"{described(load.signal, unit)}; {load.where}"
    if (gravity := weight(result)) is not None:
        along = ", ".join(plain(round(c, 3) + 0.0) for c in gravity.direction)
        yield "gravity", f"{plain(gravity.acceleration)}{SPACE}m/s² along ({along})"


def _method(scene: SceneBase) -> Rows:
    time, reduction = scene.time, scene.reduction
    yield "simulated time", f"{plain(time.end)}{SPACE}s"
    yield "step", f"{plain(1e3 * time.step)}{SPACE}ms, {plain(time.steps)} steps"
    yield "integrator", f"generalised-α, ρ∞ = {plain(time.rho_inf)}"
    if reduction.basis == "free_modes":
        yield "basis", f"{reduction.coordinates} eigenmodes on the fixed supports, sliders released"
    else:
        positions = reduction.positions
        where = positions if isinstance(positions, str) else f"{', '.join(plain(s) for s in positions)}{SPACE}m"
        yield "snapshots", f"{reduction.modes} modes at {reduction.snapshots} positions ({where})"
        yield "basis", f"POD, {reduction.coordinates} vectors, {reduction.product} product"
        yield "satisfied rows of supports", {"drop": "dropped", "hold": "held"}.get(reduction.support_rows, "")
    if reduction.flexibility:
        yield "residual flexibility", "added, inertia kept" if reduction.residual_inertia else "added, quasi-static"
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
