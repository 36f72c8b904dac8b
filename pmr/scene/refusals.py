"""What pydantic refuses, in the words of who wrote the file: key, value and what is allowed, or which key was meant."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import PydanticCustomError

from pmr.errors.text import hint

Location = Sequence[str | int]
Schema = dict[str, Any]
#: What is allowed where something else than TOML's tables and lists stands, by pydantic's kind of error.
_INSTEAD = dict.fromkeys(("model_type", "dict_type"), "a table of keys") | {"tuple_type": "a list"}
_OF_A_KEY = "of_a_key"
#: Keys up to which all of a table are named where another one is unknown; so many of a larger one.
_FEW, _NAMED = 12, 8


def of_key(key: str, value: Any, allowed: str) -> PydanticCustomError:
    """Error that a validator of a whole table raises about one of its keys."""
    return PydanticCustomError(_OF_A_KEY, "{allowed}", {"key": key, "value": value, "allowed": allowed})


@dataclass(frozen=True)
class Refusal:
    """Location of a value that is refused, the value (None: not shown) and what is allowed."""

    location: Location
    value: Any
    allowed: str

    @classmethod
    def of(cls, error: ValidationError, model: type[BaseModel], data: Any) -> Refusal:
        """The first thing that pydantic refuses of what a file says; unknown keys go first."""
        errors = error.errors()
        of_table = isinstance(errors[0]["input"], (dict, list)) and errors[0]["type"] == "float_type"
        within = [
            e for e in errors if of_table and e["input"] is not errors[0]["input"]
        ]  # a number, or a table of them
        first = next((e for e in errors if e["type"] == "extra_forbidden"), [*within, errors[0]][0])
        spelled = {key for _, _, key, _ in keys_of(data)} | {""}  # not the branches of unions
        location: list[str | int] = [part for part in first["loc"] if isinstance(part, int) or part in spelled]
        value, allowed, about = first["input"], first["msg"].removeprefix("Value error, "), first.get("ctx", {})
        match first["type"]:
            case "missing":
                location += [part for part in first["loc"][-1:] if part not in location]
                value = None
            case "extra_forbidden":
                allowed = _unknown(str(first["loc"][-1]), value, model.model_json_schema(), first["loc"][:-1])
            case "union_tag_invalid":
                tags = re.findall(r"'(\w+)'", about["expected_tags"])
                location, value = [*location, "kind"], about["tag"]
                allowed = f"{hint(value, tags)}{', '.join(tags)} are allowed"
            case "literal_error":
                close = hint(value, re.findall(r"'([\w-]+)'", about["expected"]))
                allowed = f"{close}{about['expected']} is allowed"
            case "value_error" if isinstance(value, (dict, list)):
                value = None
            case kind if kind == _OF_A_KEY:
                location, value = [*location, about["key"]], about["value"]
            case kind if kind in _INSTEAD:
                allowed = f"{_INSTEAD[kind]} is allowed"
        return cls(location, value, allowed[:1].lower() + allowed[1:])


def keys_of(data: Any, location: str = "", name: str = "") -> Iterator[tuple[str, str, str, Any]]:
    """Keys of nested tables: where each stands, the same without places in lists, the key itself, and its value."""
    if isinstance(data, list):
        for i, part in enumerate(data):
            yield from keys_of(part, f"{location}[{i}]", name)
    elif isinstance(data, Mapping):
        for key, value in data.items():
            place, dotted_name = (f"{prefix}.{key}" if prefix else str(key) for prefix in (location, name))
            yield place, dotted_name, key, None if isinstance(value, (Mapping, list)) else value
            yield from keys_of(value, place, dotted_name)


def dotted_key(location: Location) -> str:
    """A key as it is written in messages, as ``loads[0].signal``."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location).removeprefix(".")


def _unknown(key: str, value: Any, schema: Schema, location: Location) -> str:
    """Explain an unknown key: which one may be meant, and which keys its table has.

    A key may be meant that it is like, in its table or in all of the file; or, of a table, the same key further down.
    """
    parts, tables = schema.get("$defs", {}), [schema]
    for part in location:
        of_kind = [table for table in tables if table["properties"].get("kind", {}).get("const") == part]
        within = [inner for table in tables for inner in _tables(table["properties"].get(part, {}), parts)]
        tables = of_kind or within or tables  # a name in a table of names leads no further
    allowed_keys = [*dict.fromkeys(key for table in tables for key in table["properties"])]
    allowed_keys += ["extends"] * (tables[0] is schema)
    paths = _paths(schema) | {name: name for name in allowed_keys}
    near = [*get_close_matches(key, allowed_keys, cutoff=0.8), *get_close_matches(key, paths, cutoff=0.8)]
    holds = isinstance(value, (Mapping, list))
    below = {f"{name}.{key}" for name, of in _inner(tables, parts) if any(_tables(of["properties"].get(key), parts))}
    only = below if holds and len(below) == 1 else ()
    guesses = [*(paths[name] for name in near), *only, *get_close_matches(key, allowed_keys)]
    meant = f"did you mean {guesses[0]!r}? " if guesses else ""
    if len(allowed_keys) <= _FEW:
        return f"unknown key; {meant}allowed: {', '.join(allowed_keys)}"
    named = [*dict.fromkeys([*get_close_matches(key, allowed_keys), *allowed_keys])][:_NAMED]
    return f"unknown key; {meant}allowed: {', '.join(named)} and {len(allowed_keys) - len(named)} more"


def _inner(tables: Sequence[Schema], parts: Schema) -> Iterator[tuple[str, Schema]]:
    """Tables that may stand in some tables, by their names there."""
    for table in tables:
        for name, node in table["properties"].items():
            yield from ((name, of) for of in _tables(node, parts))


def _paths(schema: Schema) -> dict[str, str]:
    """Each key that a single table of a file may have, and the shortest way to it."""
    prefixes_of, visited, ahead = dict[str, list[str]](), list[Schema](), [("", schema)]
    for prefix, node in ahead:  # which grows meanwhile
        for table in _tables(node, schema.get("$defs", {})):
            if not any(table is visited_table for visited_table in visited):
                visited.append(table)
                for key, inner in table["properties"].items():
                    prefixes_of.setdefault(key, []).append(f"{prefix}{key}")
                    ahead.append((f"{prefix}{key}.", inner))
    return {key: paths[0] for key, paths in prefixes_of.items() if len(paths) == 1}


def _tables(node: Any, parts: Schema) -> Iterator[Schema]:
    """Tables with keys of their own that may stand where a node of a schema says."""
    if isinstance(node, dict):
        if "properties" in node:
            yield node
        within = [parts[node["$ref"].rpartition("/")[2]]] if "$ref" in node else []
        for key in ("anyOf", "oneOf", "allOf", "prefixItems"):
            within += node.get(key, [])
        for inner in (*within, node.get("items"), node.get("additionalProperties")):
            yield from _tables(inner, parts)
