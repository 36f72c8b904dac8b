"""Where a result comes from: parameters, software, machine and the time that each part took."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

from pmr.report.numbers import SPACE, plain, quantity, signed
from pmr.results import RunResult
from pmr.scene import Scene, SceneBase
from pmr.scene.signals import SignalBase

_STEPS = {
    "assemble": "full model",
    "snapshots": "snapshots",
    "pod": "basis, projection",
    "exudyn": "simulation, Exudyn",
    "estimate": "error estimate",
    "march": "simulation, compiled",
    "reduced": "simulation, reduced",
    "full": "simulation, full",
    "ancf": "simulation, ANCF",
}
_SIGNAL_UNITS = {"time": "s", "times": "s", "frequency": "Hz", "frequencies": "Hz", "phase": "rad"}
_MOST_KNOTS = 6


@dataclass(frozen=True)
class Table:
    """A table of two columns with a title."""

    title: str
    rows: tuple[tuple[str, str], ...]


def tables(result: RunResult) -> list[list[Table]]:
    """Parameters, times and circumstances of a run, in the columns in which they fill a page."""
    summary, scene = result.summary, result.beam
    columns = (
        (Table("Beam and mesh", tuple(_beam(scene))), Table("Run", tuple(run(summary, scene)))),
        (
            Table("Slider and loads", tuple(_motion(scene))),
            Table("Wall time", tuple(times(summary.get("seconds", {})))),
        ),
        (Table("Time stepping and reduction", tuple(method(scene))),),
    )
    return [[table for table in column if table.rows] for column in columns]


def software(result: RunResult) -> list[str]:
    """Names and versions."""
    return [f"{name}{SPACE}{version}" for name, version in _flat(result.summary.get("versions", {}))]


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


def _beam(scene: Scene) -> Iterator[tuple[str, str]]:
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
    yield from damping(scene)


def damping(scene: SceneBase) -> Iterator[tuple[str, str]]:
    """Rayleigh damping, if there is any."""
    rayleigh = scene.damping
    if rayleigh.mass or rayleigh.stiffness:
        yield (
            "Rayleigh damping",
            f"{plain(_rounded(rayleigh.mass))}{SPACE}1/s · M + {plain(_rounded(rayleigh.stiffness))}{SPACE}s · K",
        )


def _motion(scene: Scene) -> Iterator[tuple[str, str]]:
    yield "slider path s", described(scene.slider.path, "m")
    if scene.slider.offsets != (0.0,):
        yield (
            "sliders at",
            ", ".join(f"s {signed(offset)}{SPACE}m" for offset in scene.slider.offsets),
        )
    for load in scene.loads:
        unit = f"N{SPACE}m" if load.direction == "rotation" else "N"
        where = f"at {plain(load.at)}{SPACE}m, direction {load.direction}"
        yield f"load {load.name}", f"{described(load.signal, unit)}; {where}"


def method(scene: SceneBase) -> Iterator[tuple[str, str]]:
    """Time stepping and reduction."""
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


def times(seconds: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Wall times of the parts of a run."""
    for name, value in seconds.items():
        if isinstance(value, Mapping):
            yield from times(value)
        else:
            yield _STEPS.get(name, name), quantity(float(value), "s")


def run(summary: Mapping[str, Any], scene: SceneBase) -> Iterator[tuple[str, str]]:
    """What ran where."""
    yield "scene", str(summary.get("scene_hash") or scene.hash)
    if summary.get("commit"):
        yield "commit", str(summary["commit"])
    yield from _flat(summary.get("machine", {}))


def _flat(values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from ((f"{name} {key}", text) for key, text in _flat(value))
        elif value is not None:
            yield str(name), str(value)


def _rounded(value: float) -> float:
    """To what is read, where the value was computed from a damping ratio."""
    return float(f"{value:.4g}")


def _with_unit(value: Any, unit: str) -> str:
    if isinstance(value, (tuple, list)):
        if len(value) > _MOST_KNOTS:
            return f"({len(value)} values, {plain(min(value))} to {plain(max(value))}){SPACE}{unit}"
        return f"({', '.join(plain(v) for v in value)}){SPACE}{unit}"
    return f"{plain(value)}{SPACE}{unit}"
