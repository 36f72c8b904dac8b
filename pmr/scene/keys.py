"""Basis of all tables of a scene: frozen models, numbers with units and bounds, names, and error messages in one line.

A number has bounds within which double precision can compute; they are far from the numbers of all that is built.  So
models in any consistent units pass, and a slip of the pen beyond the bounds is refused before it leads to meaningless
results.

An error of pydantic is reported with key, value and what is allowed, or with the key that was probably meant.

Some keys take one of pmr's own words or the name of an object that an installed package offers (`or_plugin_name`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from os.path import isfile
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PlainSerializer,
    ValidationError,
    ValidationInfo,
    WrapValidator,
)
from pydantic_core import CoreSchema, PydanticCustomError
from pydantic_core.core_schema import no_info_after_validator_function

from pmr.errors import NAMED, environment, escape_controls, is_name, missing_file_reason, similar_name_hint

Entry = TypeVar("Entry")
Location = Sequence[str | int]
Schema = dict[str, Any]
#: What is allowed in place of a value that is neither table nor list, by pydantic's kind of error.
_INSTEAD = dict.fromkeys(("model_type", "dict_type"), "a table of keys") | {
    "tuple_type": "a list",
    "model_attributes_type": "a number or a table of keys",
}
_OF_A_KEY = "of_a_key"
#: For an unknown key, all keys of a table are named up to this number of keys; this many keys of a larger table.
_FEW, _NAMED = 12, 8


def key_error(key: str, value: object, allowed: str) -> PydanticCustomError:
    """Return the error that a validator of a table raises about the value of a key; `allowed` says what is allowed."""
    return PydanticCustomError(_OF_A_KEY, "{allowed}", {"key": key, "value": value, "allowed": allowed})


#: Branch of an extension whose signal is given; beside its kinds, ``free`` is allowed.
OVER_TIME = "over time"


@dataclass(frozen=True)
class Refusal:
    """A value that is refused: its location, the value (None: not shown) and what is allowed instead."""

    location: Location
    value: object
    allowed: str

    @classmethod
    def from_validation(cls, error: ValidationError, model: type[BaseModel], data: object) -> Refusal:
        """Return the refusal of the first error that pydantic found in `data`; unknown keys come before others.

        `model` is the class that `data` was validated with.  The refusal of an unknown key names keys of `model` that
        may be meant, and those that are allowed in the table.
        """
        errors = error.errors()
        of_table = isinstance(errors[0]["input"], (dict, list)) and errors[0]["type"] == "float_type"
        within = [
            e for e in errors if of_table and e["input"] is not errors[0]["input"]
        ]  # a number, or a table of them
        first = next((e for e in errors if e["type"] == "extra_forbidden"), [*within, errors[0]][0])
        spelled = {key for _, _, key, _ in iterate_keys(data)} | {""}  # without branches of unions
        location: list[str | int] = [part for part in first["loc"] if isinstance(part, int) or part in spelled]
        value, allowed, about = first["input"], first["msg"].removeprefix("Value error, "), first.get("ctx", {})
        match first["type"]:
            case "missing" if isinstance(first["loc"][-1], int):  # an entry of a list
                entries = [e["loc"][-1] for e in errors if e["loc"][:-1] == first["loc"][:-1]]
                location, allowed = location[:-1], f"a list of {1 + max(map(int, entries))} is allowed"
            case "too_short" if isinstance(value, list):
                allowed = f"a list of at least {about['min_length']} is allowed"
            case "too_long" if about["field_type"] == "Tuple":
                allowed = f"a list of {about['max_length']} is allowed"
            case "missing":
                location += [part for part in first["loc"][-1:] if part not in location]
                value = None
            case "extra_forbidden":
                allowed = _explain_unknown_key(
                    str(first["loc"][-1]), value, model.model_json_schema(), first["loc"][:-1]
                )
                value = None if isinstance(value, (Mapping, list)) else value
            case "union_tag_invalid":
                tags = re.findall(r"'(\w+)'", about["expected_tags"]) + ["free"] * (OVER_TIME in first["loc"])
                location, value = [*location, "kind"], about["tag"]
                allowed = f"{similar_name_hint(value, tags)}{', '.join(tags)} are allowed"
            case "literal_error":
                close = similar_name_hint(value, re.findall(r"'([\w-]+)'", about["expected"]))
                allowed = f"{close}{about['expected']} is allowed"
            case "value_error" if isinstance(value, (dict, list)):
                value = None
            case kind if kind == _OF_A_KEY:
                location, value = [*location, about["key"]], about["value"]
            case kind if kind in _INSTEAD:
                words = [e for e in errors if e["type"] == "literal_error" and e["input"] is value]
                instead = [*(e["ctx"]["expected"] for e in words), _INSTEAD[kind]]
                allowed = f"{', '.join(instead)} is allowed"
        return cls(location, value, allowed[:1].lower() + allowed[1:])


def iterate_keys(data: object, location: str = "", name: str = "") -> Iterator[tuple[str, str, str, Any]]:
    """Yield location, name, key and value of each key of nested tables.

    The location has the indices of lists (``loads[0].signal``), the name has none (``loads.signal``); the key is the
    last word of both.  The value is None for tables and lists.  The arguments `location` and `name` are those of `data`
    itself.
    """
    if isinstance(data, list):
        for i, part in enumerate(data):
            yield from iterate_keys(part, f"{location}[{i}]", name)
    elif isinstance(data, Mapping):
        for key, value in data.items():
            place, dotted_name = (f"{prefix}.{key}" if prefix else str(key) for prefix in (location, name))
            yield place, dotted_name, key, None if isinstance(value, (Mapping, list)) else value
            yield from iterate_keys(value, place, dotted_name)


def dotted_key(location: Location) -> str:
    """Return a location as a dotted key, such as ``loads[0].signal``."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location).removeprefix(".")


def _explain_unknown_key(key: str, value: object, schema: Schema, location: Location) -> str:
    """Return an explanation of an unknown key: which key may be meant, and which keys are allowed in its table.

    `location` is that of the table in the file, whose schema is `schema`.  A key may be meant that is spelled alike, in
    the table or elsewhere in the file.  If the value is a table, a key of the same name in an inner table may be meant,
    too.
    """
    parts, tables = schema.get("$defs", {}), [schema]
    for part in location:
        of_kind = [table for table in tables if table["properties"].get("kind", {}).get("const") == part]
        within = [inner for table in tables for inner in _table_schemas(table["properties"].get(part, {}), parts)]
        tables = of_kind or within or tables  # a name in a table of names leads to no other table
    allowed_keys = [*dict.fromkeys(key for table in tables for key in table["properties"])]
    allowed_keys += ["extends"] * (tables[0] is schema)
    paths = _unique_key_paths(schema) | {name: name for name in allowed_keys}
    near = [*get_close_matches(key, allowed_keys, cutoff=0.8), *get_close_matches(key, paths, cutoff=0.81)]
    holds = isinstance(value, (Mapping, list))
    below = {
        f"{name}.{key}"
        for name, table in _nested_tables(tables, parts)
        if any(_table_schemas(table["properties"].get(key), parts))
    }
    only = below if holds and len(below) == 1 else ()
    guesses = [*(paths[name] for name in near), *only, *get_close_matches(key, allowed_keys, cutoff=0.65)]
    meant = f"did you mean {guesses[0]!r}? " if guesses else ""
    if len(allowed_keys) <= _FEW:
        return f"unknown key; {meant}allowed: {', '.join(allowed_keys)}"
    named = [*dict.fromkeys([*get_close_matches(key, allowed_keys), *allowed_keys])][:_NAMED]
    return f"unknown key; {meant}allowed: {', '.join(named)} and {len(allowed_keys) - len(named)} more"


def _nested_tables(tables: Sequence[Schema], parts: Schema) -> Iterator[tuple[str, Schema]]:
    """Yield key and schema of each table that may stand directly in `tables`; `parts` are schemas by name."""
    for table in tables:
        for name, node in table["properties"].items():
            yield from ((name, inner) for inner in _table_schemas(node, parts))


def _unique_key_paths(schema: Schema) -> dict[str, str]:
    """Return the dotted path of each key that only one table in a file's schema has, by the key."""
    prefixes_of, visited, ahead = dict[str, list[str]](), list[Schema](), [("", schema)]
    for prefix, node in ahead:  # the list grows in the loop
        for table in _table_schemas(node, schema.get("$defs", {})):
            if not any(table is visited_table for visited_table in visited):
                visited.append(table)
                for key, inner in table["properties"].items():
                    prefixes_of.setdefault(key, []).append(f"{prefix}{key}")
                    ahead.append((f"{prefix}{key}.", inner))
    return {key: paths[0] for key, paths in prefixes_of.items() if len(paths) == 1}


def _table_schemas(node: object, parts: Schema) -> Iterator[Schema]:
    """Yield the schema of each table that `node` allows: itself, or as an entry of a list or of a table of names.

    `parts` are the schemas by name to which a node may refer.
    """
    if isinstance(node, dict):
        if "properties" in node:
            yield node
        within = [parts[node["$ref"].rpartition("/")[2]]] if "$ref" in node else []
        for key in ("anyOf", "oneOf", "allOf", "prefixItems"):
            within += node.get(key, [])
        for inner in (*within, node.get("items"), node.get("additionalProperties")):
            yield from _table_schemas(inner, parts)


@dataclass(frozen=True)
class Usual:
    """Smallest and largest usual magnitude of a number that is not 0, in its unit or in multiples of a scale.

    Scales have names. "length", "mass" and "weight" are those of the section, or of the whole boom for keys outside of
    sections. "reach" and "boom" are the length and the mass of the whole boom, and "time" is the simulated time.
    `Hinted.hint_scales` of a table adds further names.  A signal is judged by its largest magnitude; `unit` is then the
    unit of its values.
    """

    low: float
    high: float
    scale: str = ""
    unit: str = ""


class Hinted(BaseModel):
    """A table whose numbers may have usual ranges that depend on its content, and not on their fields alone."""

    def hint_scales(self, scales: Mapping[str, float]) -> dict[str, float]:
        """Return further scales, by name, for the usual ranges of the table's numbers.

        The result is empty unless a table overrides the method.  `scales` are the scales outside of the table, by name.
        """
        return {}

    @property
    def hint_numbers(self) -> dict[str, tuple[float, Usual]]:
        """Further numbers with their usual ranges, by key; empty unless a table overrides this method.

        An example are numbers that a file may set instead of a field.
        """
        return {}


class SceneTable(Hinted):
    """A table of a scene file: frozen, without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    def with_keys(self, **keys: object) -> Self:
        """Return a copy with these values of `keys`, which are not checked.

        If a key holds a table and its new value is a dict, the dict changes this table: other keys of the table stay.
        """
        tables = {key: table for key in keys if isinstance(table := getattr(self, key), SceneTable)}
        of_tables = {key: table.with_keys(**of) for key, table in tables.items() if isinstance(of := keys[key], dict)}
        return self.model_copy(update=keys | of_tables)


class ShorthandTable(SceneTable):
    """A table with shorthand keys, whose values are turned into values of other keys when the table is validated.

    Dumps leave the shorthand keys out.  Two tables are equal if their dumps are equal.
    """

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SceneTable) and type(self) is type(other) and self.model_dump() == other.model_dump()

    def __hash__(self) -> int:
        return hash(self.model_dump_json())


@dataclass(frozen=True)
class Quantity:
    """Unit of a number ("1" if it has none), and the smallest and largest value that is allowed.

    As an annotation of a field's type it lets numbers within these bounds pass, and neither texts nor truth values.
    """

    unit: str
    low: float
    high: float

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        least = {} if self.low < 0.0 else {"gt": 0.0} if 0.0 < self.low < 1.0 else {"ge": self.low}
        schema: Any = {**handler(source), "strict": True, **least}
        return no_info_after_validator_function(self._check, schema)

    def _check(self, value: float) -> float:
        """Return `value` if it is within the bounds of the quantity; raise a ValueError otherwise."""
        if not self.low <= value <= self.high:
            unit = "" if self.unit == "1" else f", in {self.unit}"
            raise ValueError(f"a number from {self.low:g} to {self.high:g} is allowed{unit}")
        return value

    def __get_pydantic_json_schema__(self, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {**handler(core_schema), "unit": self.unit}


Length = Annotated[float, Quantity("m", 1e-6, 1e6), Usual(1e-5, 300.0)]
Thickness = Annotated[Length, Usual(5e-5, 0.3)]  # of a plate
Size = Annotated[float, Quantity("m", 1e-12, 1e6), Usual(0.0, 300.0)]  # the mesher says how small it may be
Distance = Annotated[float, Quantity("m", 0.0, 1e6), Usual(0.0, 300.0)]
Place = Annotated[float, Quantity("m", -1e6, 1e6), Usual(0.0, 300.0)]
Area = Annotated[float, Quantity("m^2", 1e-14, 1e10), Usual(1e-6, 2.0)]
SecondMoment = Annotated[float, Quantity("m^4", 1e-26, 1e20), Usual(1e-12, 0.5)]
#: A larger stiffness is "rigid".
Stiffness = Annotated[float, Quantity("N/m", 1e-6, 1e15), Usual(2e5, 1e14)]
PadStiffness = Annotated[Stiffness, Usual(2e6, 1e14)]
SupportStiffness = Annotated[
    float,
    Quantity("N/m, of angles N m/rad", 1e-6, 1e15),
    Usual(2e5, 1e14, "straight", "N/m"),
    Usual(2e3, 1e14, "turning", "N m/rad"),
]
AxialStiffness = Annotated[float, Quantity("N", 1e-3, 1e15)]
AllowedForce = Annotated[float, Quantity("N", 1e-3, 1e15), Usual(1e3, 1e8)]
Pressure = Annotated[float, Quantity("Pa", 1e-3, 1e18)]
AllowedPressure = Annotated[Pressure, Usual(1e5, 1e9)]
Density = Annotated[float, Quantity("kg/m^3", 1e-9, 1e9)]
Mass = Annotated[float, Quantity("kg", 0.0, 1e12), Usual(0.05, 1e8)]
Inertia = Annotated[float, Quantity("kg m^2", 0.0, 1e15)]
Frequency = Annotated[float, Quantity("Hz", 1e-9, 1e12)]
Speed = Annotated[float, Quantity("m/s", 1e-12, 1e9)]
Time = Annotated[float, Quantity("s", 1e-12, 1e9)]
Share = Annotated[float, Quantity("1", 0.0, 1e9)]
Friction = Annotated[float, Quantity("1", 0.0, 1.0)]  # dry steel on steel has 0.8
Positive = Annotated[float, Quantity("1", 1e-12, 1e18)]
Count = Annotated[int, Quantity("1", 1, 1_000_000)]
Component = Annotated[float, Quantity("1", -1e300, 1e300)]


def _check_repeated(values: tuple[Entry, ...]) -> tuple[Entry, ...]:
    """Return the `values` of a list if all of these differ; raise an error that shows the list otherwise."""
    if len(set(values)) < len(values):
        raise PydanticCustomError("repeated", "each once is allowed")
    return values


#: Annotation of a list whose entries have to differ.
Once = AfterValidator(_check_repeated)


def _check_name(text: str) -> str:
    """Return `text` if it is a name; raises ValueError for a text that other programs would not read as a name."""
    if not is_name(text):
        raise ValueError(NAMED)
    return text


#: A name, in files that other programs read too.
Name = Annotated[str, AfterValidator(_check_name)]
#: A name, or an empty text.
NameOrNone = Annotated[str, AfterValidator(lambda text: _check_name(text) if text else text)]
#: Free text for people; control characters of terminals are escaped.
Text = Annotated[str, AfterValidator(escape_controls)]

Vector = tuple[Component, Component, Component]
Point = tuple[Place, Place, Place]
Direction = Literal["x", "y", "z", "rx", "ry", "rz"]
Switch = Annotated[bool, Field(strict=True)]


#: Context of the validation of a scene in a saved model: names of files are taken as they are.
RECORDED = {"files": "names"}


def _check_file(file: Path, info: ValidationInfo) -> Path:
    """Return the path `file` if the file can be read; raises ValueError otherwise.

    Paths in a recorded scene (`RECORDED`) are returned unchecked.
    """
    if info.context == RECORDED:
        return file
    if not isfile(file):
        raise ValueError(f"{missing_file_reason(file)}: {file}")
    try:
        with file.open("rb") as stream:
            stream.read(1)  # a file may open and still not be read
    except OSError as error:
        raise ValueError(f"can't be read: {error.strerror}") from None
    return file


ExistingFile = Annotated[Path, AfterValidator(_check_file)]


@cache
def quantity_of(table: type[BaseModel], key: str) -> Quantity | None:
    """Return unit and bounds of the numbers in a key of the class `table`; None if it holds no numbers with a unit."""
    return next((part for part in _declarations(table, key) if isinstance(part, Quantity)), None)


@cache
def usual_ranges(table: type[BaseModel], key: str) -> tuple[Usual, ...]:
    """Return the usual ranges of the numbers in a key of the class `table`; a usual number is within all of them."""
    return tuple(part for part in _declarations(table, key) if isinstance(part, Usual))


def _declarations(table: type[BaseModel], key: str) -> Iterator[Any]:
    """Yield all annotations of a key of the class `table`."""
    field = table.model_fields[key]
    yield from _annotations((*field.metadata, field.annotation))


def _annotations(parts: tuple[object, ...]) -> Iterator[Any]:
    """Yield `parts`, the items of a field's metadata and types, and all items nested in them."""
    for part in parts:
        yield part
        yield from _annotations((*getattr(part, "__metadata__", ()), *get_args(part)))


#: Name of a body alone in a system, and name of the path on which its moving rows travel.
ALONE, SLIDER = "", "slider"
#: The path of the direction of a luffing cylinder, whose coordinate is the luffing angle in rad, and what its row and
#: the forces along it are called.
LUFFING, LUFFING_CYLINDER = "luffing", "luffing cylinder"


def path_unit(path: str) -> str:
    """Return the unit of the coordinate on the path of this name: rad for `LUFFING`, else m."""
    return "rad" if path == LUFFING else "m"


def input_name(body: str, what: str) -> str:
    """Return the name of a body's input in a system, ``"BODY.WHAT"``; if `body` is empty, `what` itself."""
    return what if body == ALONE else f"{body}.{what}"


def qualified_name(body: str, what: str) -> str:
    """Return the name of something of a body in a system, ``"BODY: WHAT"``; if `body` is empty, `what` itself."""
    return what if body == ALONE else f"{body}: {what}"


def cylinder_name(section: str) -> str:
    """Return the name of the contact that drives a section along the boom."""
    return f"cylinder of {section}"


#: Serializer of a value that may be one of pmr's own words or the name of a plug-in.
AS_WORD = PlainSerializer(str)


def or_plugin_name(group: str) -> WrapValidator:
    """Return a validator that allows the names of a group's entry points in addition to the values of the type itself.

    The validator is used as ``Annotated[Literal[...], or_plugin_name(group), AS_WORD]``.
    """

    def check(data: object, check_literal: Callable[[object], object]) -> object:
        return data if isinstance(data, str) and data in environment.plugin_names(group) else check_literal(data)

    return WrapValidator(check)
