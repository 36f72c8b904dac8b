"""The command ``schema``: JSON schemas of scene and study files, and what a key is."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Annotated, Any

from typer import Argument

from pmr.cli.console import out
from pmr.errors import InputError, similar_name_hint

#: JSON schema of a file, of a table in it, or of a value.
Schema = dict[str, Any]

BOUNDS = {"minimum": "at least", "exclusiveMinimum": "above", "maximum": "at most", "exclusiveMaximum": "below"}
PLAIN = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true or false", "null": "nothing"}
CHOICES = ("anyOf", "oneOf", "allOf")


def describe_key(schema: Schema, key: str) -> list[tuple[str, str]]:
    """Return lines (name, text) about a key such as ``frame.cylinder.stiffness``; empty if `schema` has no such key.

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
