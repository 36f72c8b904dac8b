"""The command line: its commands, those to begin with (``new``, ``schema``), what keys are, exit codes of errors."""

from __future__ import annotations

import json
import logging
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib import resources
from os.path import lexists
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from pmr.cli import console
from pmr.cli.console import err, out
from pmr.cli.export import export, flexible, matrices, simulate
from pmr.cli.info import info
from pmr.cli.observe import identify, observe
from pmr.cli.run import run
from pmr.cli.study import chart, study
from pmr.errors import ConvergenceError, InputError, SimulationError, environment, escape_controls, similar_name_hint
from pmr.files.whole import FULL, NotWrittenError

#: JSON schema of a file, of a table in it, or of a value.
Schema = dict[str, Any]

BOUNDS = {"minimum": "at least", "exclusiveMinimum": "above", "maximum": "at most", "exclusiveMaximum": "below"}
PLAIN = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true or false", "null": "nothing"}
CHOICES = ("anyOf", "oneOf", "allOf")


def describe_key(schema: Schema, key: str) -> list[tuple[str, str]]:
    """Return lines (name, text) about a key such as ``frame.cylinder.stiffness``; empty if the file has no such key.

    Numbers and names of the members of lists may stand in the key: ``sections.fly.masses.mass`` and
    ``sections.masses.mass`` are the same.  A table has a line for each of its keys.
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
    """Yield the tables that a value may be; of a list, those that a member may be.

    `definitions` are the schema's definitions, to which values refer by name.
    """
    if "$ref" in value:
        yield from _tables_of(definitions[value["$ref"].rpartition("/")[2]], definitions)
    if "properties" in value:
        yield value
    choices = [choice for word in CHOICES for choice in value.get(word, ())]
    for part in (*choices, *filter(None, (value.get("items"),))):
        yield from _tables_of(part, definitions)


def _is_list(value: Schema) -> bool:
    """Whether a value may be a list."""
    return value.get("type") == "array" or any(_is_list(part) for word in CHOICES for part in value.get(word, ()))


def _key_line(value: Schema, name: str, table: Schema) -> str:
    """Return a line about the key `name` of a table: what it is, what it allows and its default."""
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
    """Return what a value may be, with its unit."""
    words = allowed(value).replace("`", "").replace("*", "")
    return words + "".join(f", in {unit}" for unit in units(value))


def allowed(value: Schema) -> str:
    """Return what a value may be, in words: constants in backquotes, names of tables in asterisks."""
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
    """Print the schema of a scene or study file, or what a key is.

    An editor that knows TOML (Even Better TOML, Taplo) reads it from the first line of a file:

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
    rows = next(filter(None, (describe_key(of_file, kind) for of_file in files)), [])
    if not rows:
        allowed = f"one of {', '.join(makers)}, or a key of a scene or study such as hoist.falls, is allowed"
        raise InputError("command line", "KIND", kind, f"{similar_name_hint(kind, makers)}{allowed}")
    out.rows(rows)


SCHEMA = "scene.schema.json"
TEMPLATES = resources.files("pmr.cli") / "templates"


def scene_kinds() -> list[str]:
    """Return the names of the scenes that ``pmr new`` offers."""
    return sorted(file.name.removesuffix(".toml") for file in TEMPLATES.iterdir() if file.name.endswith(".toml"))


def new(
    kind: Annotated[
        str, Argument(metavar="KIND", help="beam, boom, telescope, crane or platform.", autocompletion=scene_kinds)
    ],
    name: Annotated[Path, Argument(metavar="NAME", help="New folder, whose name is the title of the scene.")],
) -> None:
    """Write a scene with comments into a new folder.

    For one body there is also a script that draws a mesh.

    Example:

        pmr new boom mine && pmr run mine
    """
    if kind not in scene_kinds():
        raise InputError(
            "command line",
            "KIND",
            kind,
            f"{similar_name_hint(kind, scene_kinds())}{', '.join(scene_kinds())} are allowed",
        )
    if lexists(name):
        raise InputError("command line", "NAME", str(name), "the name of a folder that is not there yet is allowed")
    console.prepare_folder(name)
    title = escape_controls(name.name).replace("\\", "").replace('"', "")
    scene = (TEMPLATES / f"{kind}.toml").read_text(encoding="utf-8").replace('title = "NAME"', f'title = "{title}"')
    (name / "scene.toml").write_text(f"#:schema {SCHEMA}\n{scene}", encoding="utf-8")
    (name / SCHEMA).write_text(scene_schema(), encoding="utf-8")
    about = {
        "scene.toml": f"the scene: the structure and what is computed, with comments; `pmr run {name}` computes it",
        SCHEMA: "from which an editor completes and checks keys",
    }
    if "[[sections]]" not in scene:
        mesh = TEMPLATES / f"mesh_of_a_{'box' if '[body.box]' in scene else 'beam'}.py"
        (name / "mesh.py").write_text(mesh.read_text(encoding="utf-8"), encoding="utf-8")
        about["mesh.py"] = "draws a mesh, as a start for one of your own"
    for file, what in about.items():
        out.text(f"{name / file}  {what}")


def compile_() -> None:
    """Say that nothing is left to be compiled before a first run.

    pip has compiled the step.  Version 0.2 removes this command of earlier versions.
    """
    out.text("nothing is to be compiled: the step was compiled when pmr was installed")


_UsageError: type[Exception] = typer.BadParameter.__mro__[1]  # the class of click, or of the copy of click in typer


def _usage_message(error: Any) -> str:
    """Return the message of click for a command that was used in a wrong way.

    If an argument is missing and has a help text, that text is added.
    """
    command = error.ctx.command_path if error.ctx else "pmr"
    message, about = error.format_message().rstrip("."), getattr(getattr(error, "param", None), "help", None)
    if message.startswith("Missing") and about:
        message += f": {about[:1].lower()}{about[1:].rstrip('.')}"
    return f"{message}; `{command} --help` says more"


app = typer.Typer(
    help="Simulate booms that telescope: from a scene file to a reduced model, its comparison and a report.",
    epilog="Start with: pmr new boom mine && pmr run mine",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in (new, run, study, chart, simulate, observe, identify, export, flexible, matrices, info, schema):
    app.command()(command)
app.command("compile")(compile_)


def _version(is_given: bool) -> None:
    """Print pmr's version and exit if the option is given; otherwise do nothing."""
    if is_given:
        out.text(f"pmr {environment.package_versions()['pmr']}")
        raise typer.Exit


@app.callback()
def _before_any_command(
    version: Annotated[bool, Option("--version", callback=_version, is_eager=True, help="Print the version.")] = False,
    quiet: Annotated[bool, Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Set whether only errors are printed."""
    out.quiet = quiet


def main() -> None:
    """Run the command line; errors are printed as a message in one line.

    The process exits with code 2 for wrong input, and with code 1 if a solver fails.
    """
    console.prepare_streams()
    warnings.filterwarnings("ignore", "A NumPy version")  # SciPy warns of it; errors due to it are reported below
    handler = logging.StreamHandler()
    handler.setFormatter(console.VisibleText("%(levelname)s %(message)s"))
    logging.basicConfig(level=logging.WARNING, handlers=[handler])
    try:
        sys.exit(app(standalone_mode=False))
    except SystemExit:
        if (failure := console.output_failure()) is not None:
            console.exit_with_message(f"standard output: {failure.strerror}; results that go to files are there", 1)
        raise
    except _UsageError as error:
        if not sys.argv[1:]:
            error.show()  # type: ignore[attr-defined]  # the help
            sys.exit(2)
        console.exit_with_message(f"command line: {_usage_message(error)}", 2)
    except InputError as error:
        console.exit_with_message(str(error), 2)
    except (ConvergenceError, SimulationError, NotWrittenError) as error:
        console.exit_with_message(str(error), 1)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in FULL:
            console.output_failure()
            places = "standard output, compiled code (XDG_CACHE_HOME) and temporary files (TMPDIR)"
            console.exit_with_message(f"{error.strerror}: free space is needed for {places}", 1)
        if any(kind.__name__ == "VerificationError" for kind in type(error).__mro__):  # CFFI's
            console.exit_with_message(
                "a finite-element form was not compiled: a C compiler is needed, and free "
                "space in the folder of compiled code (XDG_CACHE_HOME)",
                1,
            )
        if isinstance(error, ImportError) or "numpy.dtype size changed" in str(error):
            console.exit_with_message(environment.import_failure_message(error), 2)
        if console.rank_count() > 1:  # the other ranks would wait for this one for ever
            err.print_exception()
            console.exit_with_message("a rank failed", 1)
        raise
