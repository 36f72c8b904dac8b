"""``pmr info``: installed packages, or the content of a file.

The functions that describe return lines as a mapping from name to description.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table
from typer import Argument

from pmr.cli.console import is_study, out, scene_file, study_file
from pmr.errors import environment, escape_controls
from pmr.files.whole import finish_swap

if TYPE_CHECKING:
    from pmr import ReducedModel
    from pmr.scene import Scene
    from pmr.system.system import System


#: Largest number of names of one kind that are all listed; of more names, only the first and the last are.
LISTED = 8
#: Number of lowest frequencies that are listed.
FREQUENCIES = 4
_TABLES = ("versions", "scene")  # of a model's provenance


def describe_file(file: Path) -> dict[str, str]:
    """Return lines, by name, about a file with a reduced model or with a system of bodies."""
    from pmr import ReducedModel
    from pmr.system.saved import read
    from pmr.system.system import System

    content = read(file)
    if not isinstance(content, ReducedModel):
        return describe_system(System.load(file))
    rows = describe_model(content)
    return rows if content.section is not None else rows | _frequencies(System.of(content))


def describe_system(system: System) -> dict[str, str]:
    """Return lines, by name, about a system of several bodies: its bodies, paths, inputs, outputs and frequencies."""
    from pmr.scene.keys import path_unit

    scene = system.provenance.get("scene")
    title = scene.get("title", "unknown") if isinstance(scene, dict) else "unknown"
    rows = {
        "system": f"{len(system.bodies)} bodies, {sum(body.size for body in system.reduced.values())} coordinates",
        "scene": f"{title} ({system.provenance.get('scene_hash', 'no hash')})",
    }
    for name, body in system.reduced.items():
        rows[f"body {name}"] = f"{body.size} coordinates; outputs: {_describe_outputs(body)}"
    pushing = {True: "holds both ways", False: "only pushes"}
    contacts = [f"{contact.name} ({pushing[contact.clearance is None]})" for contact in system.contacts]
    ranges = [f"{path} from {low:.4g} to {high:.4g} {path_unit(path)}" for path, (low, high) in system.ranges.items()]
    return rows | {
        **_describe_inputs(system.input_names, system.input_units),
        "contacts": f"{len(contacts)}: {_list_names(contacts)}",
        "paths": ", ".join(ranges) or "none",
        **_frequencies(system),
    }


def _frequencies(system: System) -> dict[str, str]:
    """Return lines, by name, with the lowest frequencies in Hz at both ends of all paths, with all contacts closed.

    An end at which they can't be computed is left out.
    """
    import numpy as np

    from pmr.errors import InputError, SimulationError
    from pmr.scene.keys import path_unit
    from pmr.simulation.moving import path_ranges
    from pmr.system.assembly import Assembly

    rows, ranges = dict[str, str](), path_ranges(system)
    for end in (0, 1):
        s = {path: ends[end] for path, ends in ranges.items()}
        where = ", ".join(f"{path} at {at:.4g} {path_unit(path)}" for path, at in s.items()) or "at rest"
        try:
            hertz = Assembly(system).frequencies(system.side_coordinates(s), FREQUENCIES)
        except (InputError, SimulationError, np.linalg.LinAlgError):
            continue  # two rigid pads meet at this end
        without = ", without second order" if system.terms else ""
        rows[f"frequencies, {where}{without}"] = f"{', '.join(f'{f:.4g}' for f in hertz if np.isfinite(f))} Hz"
    return rows


def _list_names(names: list[str]) -> str:
    """Return names joined by commas; for more than `LISTED` names, the first and the last one only."""
    return ", ".join(names if len(names) <= LISTED else [names[0], "...", names[-1]])


def describe_scene(scene: Scene) -> dict[str, str]:
    """Return lines about a scene by name: its title, its hash and the rows of its tables (`input_tables`)."""
    from pmr.report.scene_tables import input_tables

    rows = {"title": scene.title, "hash": scene.hash}
    for table in input_tables(scene):
        of = f"{table.title} " if table.title in scene.names else ""
        for name, text in table.rows:
            rows[f"{of}{name}"] = f"{rows[f'{of}{name}']}; {text}" if f"{of}{name}" in rows else text
    return {name: " ".join(text.split()) for name, text in rows.items()}  # a terminal needs no spaces that do not break


def describe_study(file: Path) -> dict[str, str]:
    """Return lines, by name, about a study that is not computed yet: title, kind, number of runs, varied values.

    Each part of a collection has a line with its title and runs.  Of more than `LISTED` values of a key, the first ones
    are listed.  Raises InputError for a study that can't be planned.
    """
    from pmr.studies import call

    project = call.load(file)
    rows = {"title": project.title, "kind": project.kind, "runs": str(len(project.runs))}
    for part in project.parts:
        of = f"{part.name} " if part.name else ""
        if of:
            rows[part.name] = f"{part.study.title}: {len(part.plan.runs)} runs"
        for key in dict.fromkeys(key for run in part.plan.runs for key in run.parameters):
            values = list(dict.fromkeys(run.parameters[key] for run in part.plan.runs if key in run.parameters))
            texts = [f"{value:.6g}" if isinstance(value, float) else str(value) for value in values]
            rows[f"{of}{key}"] = ", ".join(texts if len(texts) <= LISTED else [*texts[:LISTED], "..."])
    return rows | {"computed by": f"pmr study {file}"}


def describe_model(model: ReducedModel) -> dict[str, str]:
    """Return lines, by name, about a reduced model."""
    import numpy as np

    low, high = model.domain
    made_with, scene = ({} if not isinstance(table := model.provenance.get(key), dict) else table for key in _TABLES)
    holds = np.isnan(model.row_clearance)
    rows = [
        name if holds_both_ways else f"{name} (only pushes)"
        for name, holds_both_ways in zip(model.row_names, holds, strict=True)
    ]
    of = "" if model.section is None else f" of section {model.section.name}, without what joins it to the others"
    return {
        "reduced model": f"{model.size} coordinates{of}",
        "scene": f"{scene.get('title', 'unknown')} ({model.provenance.get('scene_hash', 'no hash')})",
        "basis": str(model.provenance.get("basis", "unknown")),
        **_describe_inputs(model.input_names, model.input_units),
        "outputs": _describe_outputs(model),
        "rows": f"{', '.join(rows)}; s from {low:g} to {high:g} m" if rows else "none: nothing slides",
        "rows left out": ", ".join(model.left_out) or "none",
        **({"ports": ", ".join(model.ports)} if model.ports else {}),
        "made with": ", ".join(
            f"{name} {made_with[name]}" for name in ("pmr", "dolfinx", "PETSc", "SLEPc") if name in made_with
        ),
    }


def _describe_inputs(names: Sequence[str], units: Sequence[str]) -> dict[str, str]:
    """Return lines about the inputs `names` by name: their units, and what inputs for a frame's accelerations mean."""
    from pmr.scene.frame import INERTIA, MINUS_THE_ACCELERATION

    sign = {"inertia inputs": MINUS_THE_ACCELERATION} if any(INERTIA in name for name in names) else {}
    return {"inputs": ", ".join(f"{name} in {unit}" for name, unit in zip(names, units, strict=True)), **sign}


def _describe_outputs(model: ReducedModel) -> str:
    """Return number and names of outputs, by unit; for more than `LISTED` names, the first and the last one only."""
    units = model.output_units or ("m",) * len(model.outputs)
    names = model.output_names or tuple(f"at {x:g} m" for x in model.output_positions)
    by_unit = dict[str, list[str]]()
    for name, unit in zip(names, units, strict=True):
        by_unit.setdefault(unit, []).append(name)
    return "; ".join(f"{len(of_unit)} in {unit} ({_list_names(of_unit)})" for unit, of_unit in by_unit.items())


_PLACES = {"tip": "at the tip", "beam": "along the beam"}


def info(
    file: Annotated[
        Path | None,
        Argument(
            metavar="[FILE]",
            help="reduced.npz, system.npz, a scene or a study or its name; without it what is installed.",
        ),
    ] = None,
) -> None:
    """Print what is installed, or what a file contains.

    For example:

        pmr info

        pmr info reports/paper_simple/reduced.npz

        pmr info reports/boom_three/system.npz
    """
    if file is None:
        rows = environment.package_versions()
        try:
            from pmr.pipeline import fenicsx_versions
        except ImportError as error:
            rows["FEniCSx"] = f"not found ({error}); reduced models simulate without it"
        else:
            rows |= fenicsx_versions()
        rows |= environment.describe_machine()
    elif file.suffix != ".npz" and is_study(file):
        rows = describe_study(study_file(file))
    elif file.suffix != ".npz":
        from pmr import scene as scenes

        rows = describe_scene(scenes.load_any(scene_file(file)))
    else:
        finish_swap(file.parent)
        rows = describe_file(file) | _estimate_lines(file.with_name("summary.json"))
    table = Table(show_header=False, box=None, pad_edge=False)
    for key, value in rows.items():
        table.add_row(escape_controls(key), escape_controls(value))
    out.print(table)


def _estimate_lines(summary: Path) -> dict[str, str]:
    """Return lines with the estimated errors in the summary of a run, by name.

    `summary` is the file; the result is empty if there is no such file.
    """
    try:
        estimates = json.loads(summary.read_text(encoding="utf-8"))["estimate"]
        shares = {place: float(estimates[place]) for place in ("tip", "beam") if estimates[place] is not None}
    except (OSError, ValueError, LookupError, TypeError):
        return {}
    sentence = ", ".join(f"{100.0 * share:.2g} % {_PLACES[place]}" for place, share in shares.items())
    return {"estimated error": sentence or "not known"}
