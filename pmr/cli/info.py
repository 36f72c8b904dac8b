"""The commands ``info``, on installed packages or the content of a file, and ``schema``, on keys of scenes and studies.

The functions that describe return lines as a mapping from name to description.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.table import Table
from typer import Argument

from pmr.cli.console import is_study, out, scene_file, study_file
from pmr.errors import InputError, SimulationError, environment, escape_controls, similar_name_hint
from pmr.files.whole import finish_swap

if TYPE_CHECKING:
    from pmr import ReducedModel
    from pmr.scene import Scene
    from pmr.system.system import System

#: Largest number of names of one kind that are all listed; of more names, only the first and the last are.
LISTED = 8
#: Number of lowest frequencies that are listed.
FREQUENCIES = 4


def describe_file(file: Path) -> dict[str, str]:
    """Return lines, by name, about the content of a file that has a reduced model or a system of bodies."""
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

    rows = {
        "system": f"{len(system.bodies)} bodies, {sum(body.size for body in system.reduced.values())} coordinates",
        "scene": _scene_words(system.provenance),
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
    """Return lines, by name, about a reduced model.

    They are its coordinates and section, scene, basis, inputs, outputs, rows with their range of s, rows left out,
    ports if there are any, and the versions of the programs that made it.
    """
    import numpy as np

    low, high = model.domain
    versions = model.provenance.get("versions")
    made_with = versions if isinstance(versions, dict) else {}
    holds = np.isnan(model.row_clearance)
    rows = [
        name if holds_both_ways else f"{name} (only pushes)"
        for name, holds_both_ways in zip(model.row_names, holds, strict=True)
    ]
    of = "" if model.section is None else f" of section {model.section.name}, without what joins it to the others"
    return {
        "reduced model": f"{model.size} coordinates{of}",
        "scene": _scene_words(model.provenance),
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


def _scene_words(provenance: Mapping[str, object]) -> str:
    """Return title and hash of the scene of which a model was made, from the model's provenance."""
    scene = provenance.get("scene")
    title = scene.get("title", "unknown") if isinstance(scene, dict) else "unknown"
    return f"{title} ({provenance.get('scene_hash', 'no hash')})"


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

    `summary` is the file; the result is empty if it is not there or states no estimate.
    """
    try:
        estimates = json.loads(summary.read_text(encoding="utf-8"))["estimate"]
        shares = {place: float(estimates[place]) for place in ("tip", "beam") if estimates[place] is not None}
    except (OSError, ValueError, LookupError, TypeError):
        return {}
    sentence = ", ".join(f"{100.0 * share:.2g} % {_PLACES[place]}" for place, share in shares.items())
    return {"estimated error": sentence or "not known"}


#: JSON schema of a file, of a table in it, or of a value.
Schema = dict[str, Any]

BOUNDS = {"minimum": "at least", "exclusiveMinimum": "above", "maximum": "at most", "exclusiveMaximum": "below"}
PLAIN = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true or false", "null": "nothing"}
CHOICES = ("anyOf", "oneOf", "allOf")


def describe_key(schema: Schema, key: str) -> list[tuple[str, str]]:
    """Return lines (name, text) about a key such as ``frame.cylinder.stiffness``; empty if `schema` has no such key.

    The number or name of a list's member may be left out of the key: ``sections.masses.mass`` and
    ``sections.fly.masses.mass`` are the same.  A table has a line for each of its keys.
    """
    definitions, values = schema.get("$defs", {}), [schema]
    parts = key.split(".")
    for number, part in enumerate(parts, 1):
        properties = [table["properties"] for table in _tables_of({"anyOf": values}, definitions)]
        following = [keys[part] for keys in properties if part in keys]
        if not following and (number == len(parts) or not any(map(_is_list, values))):
            return []
        values = following or values
    lines = [(key, " ".join(dict.fromkeys(_description(value) for value in values)))]
    lines.append(("allowed", " or ".join(dict.fromkeys(_value_words(value) for value in values))))
    defaults = [json.dumps(value["default"]) for value in values if value.get("default") is not None]
    lines += [("default", text) for text in defaults[:1]]
    for table in _tables_of({"anyOf": values}, definitions):
        lines.append((table.get("title", "table"), _description(table)))
        lines += [(f"  {name}", _key_line(value, name, table)) for name, value in table["properties"].items()]
    return lines


def _tables_of(value: Schema, definitions: dict[str, Schema]) -> Iterator[Schema]:
    """Yield the schemas of all tables that the schema `value` allows; for a list, those of its members.

    `definitions` are the definitions to which schemas refer by name.
    """
    if "$ref" in value:
        yield from _tables_of(definitions[value["$ref"].rpartition("/")[2]], definitions)
    if "properties" in value:
        yield value
    choices = [choice for word in CHOICES for choice in value.get(word, ())]
    for part in (*choices, *filter(None, (value.get("items"),))):
        yield from _tables_of(part, definitions)


def _is_list(value: Schema) -> bool:
    """Whether a value may be a list, by its schema."""
    return value.get("type") == "array" or any(_is_list(part) for word in CHOICES for part in value.get(word, ()))


def _key_line(value: Schema, name: str, table: Schema) -> str:
    """Return a line about the key `name` of a table: its description, its allowed values and its default."""
    words = f"{_description(value)} ({_value_words(value)}"
    default = value.get("default")
    if name in table.get("required", []):
        words += "; must be given"
    elif default is not None and not isinstance(default, dict):
        words += f"; default {json.dumps(default)}"
    return f"{words})".strip()


def _description(value: Schema) -> str:
    """Return the description of a value for a terminal: formulas as they are written."""
    return one_line(value.get("description", "")).replace(":math:", "")


def _value_words(value: Schema) -> str:
    """Return what a value may be, by its schema, in words with the unit."""
    words = allowed(value).replace("`", "").replace("*", "")
    return words + "".join(f", in {unit}" for unit in units(value))


def allowed(value: Schema) -> str:
    """Return what a value may be, by its schema, in words: constants in backquotes, names of tables in asterisks."""
    if "$ref" in value:
        return "*" + value["$ref"].rpartition("/")[2] + "*"
    for word in CHOICES:
        if word in value:
            return " or ".join(dict.fromkeys(allowed(each) for each in value[word] if each.get("type") != "null"))
    if "const" in value or "enum" in value:
        return ", ".join(f"`{json.dumps(each)}`" for each in value.get("enum", [value.get("const")]))
    if value.get("type") == "array":
        items = value.get("items") or {}
        return f"list of {allowed(items)}" if items else f"list of {len(value.get('prefixItems', []))}"
    if value.get("type") == "object":
        return "table"
    bounds = [f"{words} {value[name]:g}" for name, words in BOUNDS.items() if name in value]
    return ", ".join([PLAIN.get(value.get("type", ""), "anything"), *bounds])


def units(value: Schema | Sequence[Schema]) -> list[str]:
    """Return the units of the numbers that a value may hold, each once; numbers without a unit are left out."""
    parts, unit = (value.values(), value.get("unit")) if isinstance(value, dict) else (value, None)
    of_parts = [unit for part in parts if isinstance(part, dict | list) for unit in units(part)]
    return list(dict.fromkeys([unit, *of_parts] if isinstance(unit, str) and unit != "1" else of_parts))


def one_line(text: str) -> str:
    """Return a text, such as a docstring, on one line, as Markdown."""
    return " ".join(text.split()).replace("``", "`")


def scene_schema() -> str:
    """Return the JSON schema of a scene file as text."""
    from pmr.scene.files import scene_file_schema

    return json.dumps(scene_file_schema(), indent=1) + "\n"


def study_schema(*kinds: str) -> str:
    """Return as text the JSON schema of a study file of the given kinds; of all kinds if none is given."""
    from pmr.scene.files import union_schema
    from pmr.studies.call import schemas

    schemas_by_kind = schemas()
    return (
        json.dumps(union_schema([schemas_by_kind[kind] for kind in kinds or schemas_by_kind], "Study of pmr"), indent=1)
        + "\n"
    )


def schema(
    kind: Annotated[
        str,
        Argument(
            metavar="[KIND]", help="scene, study, one kind of study such as scenes, or a key such as hoist.falls."
        ),
    ] = "scene",
) -> None:
    """Print the schema of a scene or study file, or explain a key.

    An editor that knows TOML (Even Better TOML, Taplo) finds the schema by the first line of a file:

        #:schema scene.schema.json

    Example:

        pmr schema > scene.schema.json

        pmr schema frame.cylinder
    """
    from pmr.scene.files import scene_form_schemas
    from pmr.studies.call import kind_names, schemas

    makers: dict[str, Callable[[], str]] = {"scene": scene_schema, "study": study_schema}
    makers |= {name: partial(study_schema, name) for name in kind_names()}
    if kind in makers:
        out.print(makers[kind](), soft_wrap=True, end="")
        return
    files = (*scene_form_schemas(), *schemas().values())
    # keys that all sections take over stand in [section]
    key = f"sections.{kind.removeprefix('section.')}" if kind.startswith("section.") else kind
    rows = next(filter(None, (describe_key(of_file, key) for of_file in files)), [])
    if not rows:
        allowed = f"one of {', '.join(makers)}, or a key of a scene or study such as hoist.falls, is allowed"
        raise InputError("command line", "KIND", kind, f"{similar_name_hint(kind, makers)}{allowed}")
    out.rows(rows)
