"""Mutated scenes: accepted ones are run on a coarse mesh over few steps."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from fuzz import toml
from fuzz.bases import BASES, BEAM, BOOM, FLEXIBLE, PUSHING
from fuzz.mutations import STRANGE, Random, mutated, scratched, somewhere, strange
from fuzz.verdict import NonsenseError, ensure_finite, strictly_read

from pmr import scene as scenes
from pmr.scene import Scene
from pmr.scene.checks import check_scene

MOST_STEPS, MOST_ELEMENTS, MOST_CELLS = 200, 24, 40
DRAWN = 12  # of that many one has its report drawn


def case(number: int, rng: Random, folder: Path) -> str:
    """Read a mutated scene and run it if it is accepted; return the outcome in a few words."""
    base = BASES[int(rng.integers(len(BASES)))]
    overrides: list[str] = []
    how = rng.random()
    if how < 0.12:
        content = scratched(toml.written(base).encode(), rng)
    elif how < 0.22:
        content, overrides = toml.written(base).encode(), [_override(base, rng) for _ in range(rng.integers(1, 4))]
    else:
        content = toml.written(mutated(base, rng)).encode()
    file = folder / "scene.toml"
    file.write_bytes(content)
    scene = coarse(scenes.load(file, overrides))
    return ran(scene, folder, drawn=number % DRAWN == 0)


def prepare() -> None:
    """Compile what scenes need, so that no mutation is charged for it."""
    with tempfile.TemporaryDirectory() as folder:
        for number, base in enumerate((BEAM, FLEXIBLE, BOOM, PUSHING)):
            Path(folder, "scene.toml").write_text(toml.written(base))
            ran(coarse(scenes.load(Path(folder, "scene.toml"))), Path(folder), drawn=number == 0)


def coarse(scene: Scene) -> Scene:
    """Scene with few elements and few steps."""
    time, mesh = scene.time, scene.mesh
    changes: dict[str, Any] = {"simulation": scene.simulation.model_copy(update={"repeats": 1})}
    if time.steps > MOST_STEPS:
        changes["time"] = time = time.model_copy(update={"end": MOST_STEPS * time.step})
    if mesh.elements > MOST_ELEMENTS:
        changes["mesh"] = mesh.model_copy(update={"elements": MOST_ELEMENTS})
    box = scene.body.box
    if box is not None and scene.body.model in ("auto", "shell", "solid"):
        around, along = (2.0 * (box.width + box.height)) / 4.0, box.length / MOST_CELLS
        update = {"size": max(mesh.size, around / 6.0), "along": max(mesh.along or mesh.size, along)}
        changes["mesh"] = mesh.model_copy(update=update)
    if scene.recovery is not None:
        update = {"every": time.step * max(1, time.steps // 2), "frames": 2}
        changes["recovery"] = scene.recovery.model_copy(update=update)
    changes["observe"] = scene.observe.model_copy(update={"count": min(scene.observe.count, 29)})
    small = scene.model_copy(update=changes)
    check_scene(small)
    return small


def ran(scene: Scene, folder: Path, drawn: bool) -> str:
    """Run a scene to the end; fail unless results are finite and plausible and files valid."""
    from pmr import ReducedModel, run
    from pmr.fem.compat import MPI
    from pmr.report.document import render_runs as render
    from pmr.report.sections import chapter as report_case

    outcome = run(scene, MPI.COMM_SELF)
    assert outcome is not None
    result = outcome.result
    for name, response in result.responses.items():
        for part in ("displacement", "slider_force"):
            ensure_finite(f"{name}.{part}", getattr(response, part))
        for part in ("kinetic", "strain", "external"):
            ensure_finite(f"{name}.energy.{part}", getattr(response.energy, part))
    plausible(scene, result)
    result.save(folder / "results")
    summary = strictly_read((folder / "results" / "summary.json").read_text())
    if any("is not finite; in summary.json" in line for line in summary["warnings"]):
        raise NonsenseError(f"not finite: {summary['warnings']}")
    ReducedModel.load(outcome.reduced.save(folder / "reduced.npz"))
    if drawn:
        render([report_case(result, "case-1")])
    return f"{summary['max_displacement']:.2e} m, {len(summary['warnings'])} warnings"


def plausible(scene: Scene, result: Any) -> None:
    """Fail if a displacement is larger than the body and no warning says so."""
    length = scene.body.length or 2.0  # m, of the meshes that are read
    largest = max(float(np.abs(response.displacement).max()) for response in result.responses.values())
    if largest > length and not result.summary["warnings"]:
        raise NonsenseError(f"{largest:.2e} m of displacement of a body of {length:g} m, without a warning")


def _override(base: dict[str, Any], rng: Random) -> str:
    """Random argument of ``--set``."""
    kind = rng.random()
    if kind < 0.2:
        return STRANGE[int(rng.integers(len(STRANGE)))]
    sections = list(base)
    section = sections[int(rng.integers(len(sections)))]
    held = base[section]
    key = section
    if isinstance(held, dict) and held:
        place = somewhere(held, rng)
        key = f"{section}.{place[1]}" if place else section
    value = strange(rng)
    return f"{key}={toml.value(value) if kind < 0.8 else value}"
