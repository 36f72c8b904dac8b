"""``pmr info``: the stack in use, or what a file holds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from pmr.cli.console import out, scene_file
from pmr.errors import environment
from pmr.errors.text import visible
from pmr.files.swap import finished

if TYPE_CHECKING:
    from pmr import scene as scenes
    from pmr.reduced.model import ReducedModel

#: Names of outputs of one unit that are listed; of more the first and the last.
LISTED = 8
_TABLES = ("versions", "scene")  # of a model's provenance
_PLACES = {"tip": "at the tip", "beam": "along the beam"}


def info(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="[FILE]", help="reduced.npz, a scene or its name; without it, the stack found."),
    ] = None,
) -> None:
    """Say which stack is in use (versions, MPI, scalar type), or what a file holds.

    Examples
    --------
        pmr info

        pmr info reports/paper_simple/reduced.npz
    """
    if file is None:
        rows = environment.versions()
        try:
            from pmr.fem.compat import versions
        except ImportError as error:
            rows["FEniCSx"] = f"not found ({error}); reduced models simulate without it"
        else:
            rows |= versions()
        rows |= environment.machine()
    elif file.suffix != ".npz":
        from pmr import scene as scenes

        rows = _describe_scene(scenes.load(scene_file(file)))
    else:
        from pmr.reduced.model import ReducedModel

        finished(file.parent)
        rows = described_model(ReducedModel.load(file)) | _estimated(file.with_name("summary.json"))
    table = Table(show_header=False, box=None, pad_edge=False)
    for key, value in rows.items():
        table.add_row(key, visible(value))
    out.print(table)


def _describe_scene(scene: scenes.Scene) -> dict[str, str]:
    from pmr.scene.choice import choose
    from pmr.scene.members import member_at

    chosen, (low, high) = choose(member_at(scene)), scene.path_bounds
    pads = [f"{len(ring.places)} at the {ring.name}{' (moving)' * ring.moving}" for ring in scene.pads]
    points = [f"{len(scene.points)} row(s)"] if scene.points else []
    places = [load.on if isinstance(load.on, str) else f"{load.on:g} m" for load in scene.loads]
    loads = [f"{load.name} on {on} along {load.direction}" for load, on in zip(scene.loads, places, strict=True)]
    return {
        "title": scene.title,
        "hash": scene.hash,
        "body": f"{chosen.model}, {_size(scene.body)}",
        "model": f"{scene.body.model}: {'; '.join(chosen.reasons)}",
        "slider" if scene.points else "pads": f"{', '.join([*pads, *points])}; s from {low:g} to {high:g} m",
        "loads": ", ".join([*loads, *(["gravity"] if scene.gravity else [])]),
        "time": f"{scene.time.end:g} s in {scene.time.steps} steps, rho_inf = {scene.time.rho_inf:g}",
        "reduction": f"{scene.reduction.coordinates} coordinates: {_describe_reduction(scene.reduction)}",
        "compared with": ", ".join(scene.compare.against) or "nothing",
    }


def _size(body: scenes.Body) -> str:
    if body.profile is not None:
        return f"{body.profile.length:g} m, EI = {body.profile.bending_stiffness:g} N m^2"
    box = body.box
    return f"box of {box.length:g} x {box.width:g} x {box.height:g} m, wall {box.wall:g} m" if box else "from a file"


def _describe_reduction(reduction: scenes.Reduction) -> str:
    pool = f"POD of {reduction.snapshots} x {reduction.modes} eigenmodes"
    basis = pool if reduction.pooled else reduction.basis.replace("_", " ")
    return f"{basis} and residual flexibility" if reduction.flexibility else basis


def described_model(model: ReducedModel) -> dict[str, str]:
    """What a reduced model is, line by line."""
    import numpy as np

    low, high = model.domain
    made_with, scene = ({} if not isinstance(found := model.provenance.get(key), dict) else found for key in _TABLES)
    holds = np.isnan(model.row_clearance)
    rows = [name if both else f"{name} (only pushes)" for name, both in zip(model.row_names, holds, strict=True)]
    of = "" if model.section is None else f" of section {model.section.name}, without what joins it to the others"
    return {
        "reduced model": f"{model.size} coordinates{of}",
        "scene": f"{scene.get('title', 'unknown')} ({model.provenance.get('scene_hash', 'no hash')})",
        "basis": str(model.provenance.get("basis", "unknown")),
        "inputs": ", ".join(f"{n} in {unit}" for n, unit in zip(model.input_names, model.input_units, strict=True)),
        "outputs": _describe_outputs(model),
        "rows": f"{', '.join(rows)}; s from {low:g} to {high:g} m",
        "rows left out": ", ".join(model.left_out) or "none",
        **({"ports": ", ".join(model.ports)} if model.ports else {}),
        "made with": ", ".join(
            f"{name} {made_with[name]}" for name in ("pmr", "dolfinx", "PETSc", "SLEPc") if name in made_with
        ),
    }


def _describe_outputs(model: ReducedModel) -> str:
    """Numbers and names by unit; of many the first and the last."""
    count = len(model.outputs)
    units = model.output_units or ("m",) * count
    names = model.output_names or tuple(f"at {x:g} m" for x in model.output_positions)
    found = []
    for unit in dict.fromkeys(units):
        of = [name for name, its in zip(names, units, strict=True) if its == unit]
        listed = ", ".join(of if len(of) <= LISTED else [of[0], "...", of[-1]])
        found.append(f"{len(of)} in {unit} ({listed})")
    return "; ".join(found)


def _estimated(summary: Path) -> dict[str, str]:
    """Estimated errors of the run that left a model, where its summary stands beside it."""
    try:
        found = json.loads(summary.read_text(encoding="utf-8"))["estimate"]
        shares = {place: float(found[place]) for place in ("tip", "beam") if found[place] is not None}
    except (OSError, ValueError, LookupError, TypeError):
        return {}
    said = ", ".join(f"{100.0 * share:.2g} % {_PLACES[place]}" for place, share in shares.items())
    return {"estimated error": said or "not known"}
