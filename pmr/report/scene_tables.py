"""Tables of a report about what was computed: the input of a scene, sizes of models, wall times, software and machine.

A new key of a scene is shown without any change here, in the unit that the scene declares for it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np
from pydantic import BaseModel

from pmr.errors.environment import stage_words
from pmr.files.arrays import Summary
from pmr.report.blocks import Table
from pmr.report.numbers import MILLIONS, SPACE, Unit, format_input, format_quantity, unit_for
from pmr.report.subject import reduced_size
from pmr.results import RunResult
from pmr.results.quantities import unit_text
from pmr.scene import Scene
from pmr.scene.built import Load
from pmr.scene.choice import choose_model, is_undecided, traits_of
from pmr.scene.files import unused_body_keys
from pmr.scene.keys import qualified_name, quantity_of, usual_ranges
from pmr.scene.members import members
from pmr.scene.signals import SignalBase

#: Largest number of values of a list that are shown one by one; of a longer list, number and range are shown.
MOST_VALUES = 6
#: Units of numbers of a signal other than its values.
SIGNAL_UNITS = {"time": "s", "times": "s", "frequency": "Hz", "frequencies": "Hz", "phase": "rad", "degree": ""}
#: Units of the signals of forces and moments on a machine, which the scene does not declare.
UNITS = {"force": "N", "moment": "N m"}
#: Units that are shown with a prefix, stiffnesses in millions, and angles and their rates in degrees.
SCALED = ("m", "s", "N", "N m", "Pa", *MILLIONS, "rad", "rad/s", "degrees", "degrees/s")
#: Words for keys that are symbols or names of persons.
WORDS = {"young": "Young's modulus", "poisson": "Poisson's ratio", "rho_inf": "ρ∞ of generalised-α"}
#: Rows of a beam whose sizes are those of cells on a shell of its walls, beside the elements of the beam itself.
OF_WALLS = ("mesh size", "mesh along")
#: Keys that are shown even if their values are the defaults.
ALWAYS = ("stiffness", "basis", "against", "ancf_elements", "on", "direction")
#: Tables of a scene of which only those keys are shown whose values differ from their defaults.
SETTINGS = ("observe", "simulation", "compare", "recovery", "published", "fatigue", "budget", "accuracy")
Rows = Iterator[tuple[str, str]]


def input_tables(scene: Scene) -> list[Table]:
    """Build a table for each body, with a row for each of its parts, and a table of what holds for the whole run."""
    tables = list[Table]()
    words = SceneWords("rad" if scene.frame is None else scene.frame.unit)
    for member, (name, part) in zip(members(scene), scene.bodies.items(), strict=True):
        traits, choice = traits_of(member), choose_model(member)
        at_least = ", or a larger one by measurement" if is_undecided(member) else ""
        why = f": {'; '.join(choice.reasons)}{at_least}" if part.body.model == "auto" else ""
        unused = {"": ["name"], "body": ["model"]}
        if part.joint is not None and part.joint.rope is not None:
            unused["joint"] = ["cylinder"]
        for of in unused_body_keys(member):
            table, _, key = of.key.partition(".")
            unused.setdefault(table, []).append(key)
        rows = (("model", f"{traits.words}{why}"), *words.rows(part, unused))
        if traits.is_beam:
            rows = tuple((name, f"{text}, shell of walls" if name in OF_WALLS else text) for name, text in rows)
        tables.append(Table(name or "Body, pads and loads", rows))
    unneeded = {"": ("title", "section", "sections", "published"), "frame": ("unit",)}
    run = words.rows(scene, unneeded | {"compare": () if "ancf" in scene.compare.against else ("ancf_elements",)})
    return [*tables, Table("Time stepping and settings", (*run, ("steps", format_input(scene.time.steps))))]


@dataclass(frozen=True)
class SceneWords:
    """Words for the tables of a scene; `angles` is the unit of the angles of its frame, ``rad`` or ``degrees``."""

    angles: str = "rad"

    def rows(self, tables: BaseModel, unused: Mapping[str, Sequence[str]]) -> Rows:
        """Yield rows (name, text) about the tables within `tables`, which is a whole scene or a section of it.

        A table gives a row for each of its keys with a value that says something (`_telling_values`).  For example, the
        key ``step`` of ``[time]`` gives the row "time step".  Tables in `SETTINGS` give no rows for default values.  A
        list of tables gives a row for each table.  A signal, or another value that is not a table, gives one row.

        `unused` maps the key of a table to a list of keys in it that have no effect and get no row.  It must have the
        empty key: its list names whole tables (and other values) of `tables` that get no row.
        """
        for key, part in _telling_values(tables, unused[""]):
            hidden, defaults = unused.get(key, ()), key not in SETTINGS
            name = key_words(key)
            if isinstance(part, BaseModel) and not isinstance(part, SignalBase):
                for inner, value in _telling_values(part, hidden, defaults):
                    yield from self._rows_of_value(part, inner, value, f"{name} {key_words(inner)}", defaults)
            else:
                yield from self._rows_of_value(tables, key, part, name, defaults)

    def _rows_of_value(self, table: BaseModel, key: str, value: object, name: str, defaults: bool) -> Rows:
        """Yield a row with the value of a key, called `name`; for a list of tables, yield a row for each table.

        The row of a table in a list is called by the singular of `name` and the name of the table, such as "load wind".
        It is yielded even without a description.  Any other value without a description has no row.  If `defaults` is
        false, tables of a list are described without keys that have their default values.
        """
        if isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            single = name.removesuffix("es" if name.endswith("sses") else "s")
            for entry in value:
                yield f"{single} {getattr(entry, 'name', '')}".strip(), self.describe(entry, "", defaults)
        else:
            if text := self.describe_value(table, key, value):
                yield name, text.removeprefix("(").removesuffix(")") if isinstance(value, BaseModel) else text

    def describe(self, table: BaseModel, unit: str = "", defaults: bool = True) -> str:
        """Describe a table by its keys and their values, separated by commas; its name is left out.

        `unit` is the unit of numbers for which the table declares none, such as the values of a signal.  If `defaults`
        is false, keys with their default values are left out.
        """
        parts = [
            str(value).replace("_", " ") if key == "kind" else f"{key_words(key)} {text}".strip()
            for key, value in _telling_values(table, ("name",), defaults)
            if (text := self.describe_value(table, key, value, unit))
        ]
        return ", ".join(parts)

    def describe_value(self, table: BaseModel, key: str, value: object, unit: str = "") -> str:
        """Describe the value of a key of a table in words.

        `unit` is the unit of numbers if the table declares none for the key.  A value that is a table is put in
        brackets, unless it is a signal.
        """
        unit = self._unit(table, key) or (SIGNAL_UNITS.get(key, unit) if isinstance(table, SignalBase) else unit)
        if isinstance(value, BaseModel):
            text = self.describe(value, unit)
            return text if isinstance(value, SignalBase) or not text else f"({text})"
        if isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            return "; ".join(f"{getattr(part, 'name', '')} {self.describe(part, unit)}".strip() for part in value)
        return describe_plain(value, unit)

    def _unit(self, table: BaseModel, key: str) -> str:
        """Return the unit that a table declares for the numbers of a key, or for the values of its signal.

        Angles have the unit of the scene's frame.  The result is empty for pure numbers, and for a key without numbers.
        """
        if isinstance(table, Load) and key == "signal":
            return table.unit
        quantity, usual = quantity_of(type(table), key), usual_ranges(type(table), key)
        units = [quantity.unit] if quantity is not None else [limits.unit for limits in usual] or [""]
        straight, _, turning = units[0].partition(", of angles ")
        unit = (turning or units[-1]) if _is_rotation(table, key) else straight
        if unit in ("rad", "degrees") and not isinstance(table, SignalBase):
            unit = self.angles
        return "" if unit == "1" else unit.replace("frame.unit", self.angles) or UNITS.get(key, "")


def _is_rotation(table: BaseModel, key: str) -> bool:
    """Whether the numbers of a key belong to rotations alone, as its name (``rx``) or its table's directions say."""
    directions = getattr(table, "held_directions", None) or (getattr(table, "direction", None) or key,)
    return all(str(direction) in ("rx", "ry", "rz") for direction in directions)


def key_words(key: str) -> str:
    """Return a key of a scene in words, such as ``tail taper`` for ``tail_taper``."""
    return WORDS.get(key, key.replace("_", " "))


def describe_plain(value: object, unit: str) -> str:
    """Describe a number with its `unit`, a word, a switch, a file by its name, or a list or mapping of these.

    A switch is yes or no; an empty list is none.
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return _format_numbers([value], unit)
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {describe_plain(part, unit)}" for key, part in value.items())
    if isinstance(value, tuple) and value and all(type(part) in (int, float) for part in value):
        return _format_numbers(value, unit)
    if isinstance(value, tuple):
        return ", ".join(describe_plain(part, unit) for part in value) or "none"
    return PurePath(value).name if isinstance(value, PurePath) else str(value).replace("_", " ")


def _format_numbers(values: Sequence[float], unit: str) -> str:
    """Format the numbers `values` with one unit for all; more than `MOST_VALUES` become their number and range."""
    scaled = unit_for(max(map(abs, values)), unit) if unit in SCALED else Unit(1.0, unit)
    texts = [format_input(float(f"{value / scaled.size:.7g}")) for value in values]
    text = texts[0] if len(texts) == 1 else f"({', '.join(texts)})"
    if len(values) > MOST_VALUES:
        text = f"({len(values)} values, {texts[int(np.argmin(values))]} to {texts[int(np.argmax(values))]})"
    return Unit(1.0, unit_text(scaled.name).replace(" ", SPACE)).after(text)


def _telling_values(table: BaseModel, unused: Sequence[str], defaults: bool = True) -> Iterator[tuple[str, object]]:
    """Yield key and value of those keys of a table whose values say something, the kind of the table first.

    Left out are keys that are `unused` or None, and keys with their default values.  These default values stay:

    - tables, the kind, and keys in `ALWAYS` if they are not empty,
    - numbers other than 0 and 1, if `defaults` is true.
    """
    unused = (*unused, *getattr(table, "unused_keys", ()))
    fields = type(table).model_fields
    for key in sorted(fields, key=lambda key: key != "kind"):
        value, field = getattr(table, key), fields[key]
        is_default = not field.is_required() and value == field.get_default(call_default_factory=True)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        is_kind = key == "kind" and getattr(table, "directions", None) is None
        is_number = is_number and value not in (0, 1)
        matters = is_kind or (key in ALWAYS and value) or (defaults and is_number)
        if value is not None and key not in unused and (not is_default or matters or isinstance(value, BaseModel)):
            yield key, value


CELLS = {"line": "elements", "triangle": "triangles", "tetra": "tetrahedra", "hexahedron": "hexahedra"}


def software_versions(summary: Summary) -> list[str]:
    """Names and versions of the software that computed a result with this summary."""
    return [f"{name}{SPACE}{version}" for name, version in _flatten_times(summary.get("versions", {}))]


def size_rows(result: RunResult) -> Rows:
    """Yield rows with the sizes of models, meshes and fields, and with the numbers of carriers and of pads.

    If pads only push, a row states the number of parts into which steps are divided for them.  Further rows are on the
    largest violations of constraints, and on pads and supports that no vector of the basis moves.
    """
    coordinates = result.summary.get("coordinates", {})
    if "full" in coordinates:
        yield "coordinates of the full model", format_input(coordinates["full"])
    yield "coordinates of the reduced model", format_input(reduced_size(result))
    yield from _section_size_rows(result)
    for name, body in result.bodies.items():
        if (fields := body.fields) is not None:
            cells, vertices = format_input(len(fields.cells)), format_input(len(fields.points))
            yield qualified_name(name, "mesh"), f"{cells} {CELLS[fields.kind]}, {vertices} vertices"
            yield qualified_name(name, "fields"), f"at {format_input(len(fields.t))} times"
    if pads := sum(output.kind == "pad" for output in result.responses["reduced"].outputs):
        yield "pads", format_input(pads)
    if contact := result.summary.get("contact"):
        parts_text = format_input(contact["parts"])
        if "mean_parts" in contact:
            parts_text = f"at most {parts_text}, mean {format_input(round(contact['mean_parts'], 1))}"
        yield "substeps a step", parts_text
    for name, response in result.responses.items():
        position, velocity = (np.abs(of).max() for of in (response.residual_position, response.residual_velocity))
        if np.isfinite(velocity):
            text = f"{format_quantity(position, 'm')}, {format_quantity(velocity, 'm/s')}"
            yield f"largest violation of constraints, {name}", text
    basis = result.summary.get("basis", {})
    if basis.get("carriers"):
        yield (
            "shapes that follow pads and sliders along the path",
            format_input(basis["carriers"]),
        )
    if basis.get("rows_left_out"):
        yield "pads and supports that no shape of the reduced model moves", ", ".join(basis["rows_left_out"])


def _section_size_rows(result: RunResult) -> Rows:
    """Yield a row for each section with its coordinates in full and reduced model, such as ``4 212 → 8 + 3``.

    The key ``coordinates`` of a section sets the number before the plus.  The number after it is that of further
    coordinates; a last row says what these are for.  In a run with a tolerance there is no plus, as the tolerance
    decides the number of coordinates.
    """
    more, is_sized = False, "accuracy" in result.summary  # a tolerance sizes sections without regard to their keys
    for row in result.summary.get("sections", ()):
        full, reduced = (row["coordinates"][model] for model in ("full", "reduced"))
        own = reduced if is_sized else min(result.scene.bodies[row["name"]].reduction.coordinates, reduced)
        text, more = f"{format_input(full)} → {format_input(own)}", more or own < reduced
        yield f"coordinates of {row['name']}", f"{text} + {format_input(reduced - own)}" if own < reduced else text
    second_order = (result.summary.get("frame") or {}).get("second_order", False)
    of = ["cylinders"] * any(part.joint is not None for part in result.scene.bodies.values())
    of += ["second order"] * bool(second_order)
    if more and of:
        yield "coordinates behind +", f"for {' and '.join(of)}"


def time_rows(seconds: Summary) -> Rows:
    """Yield a row with the wall time in s of each part of the run.

    `seconds` are these times, in mappings that may be nested.  A row is named by the innermost key alone.
    """
    for name, value in seconds.items():
        if isinstance(value, Mapping):
            yield from time_rows(value)
        else:
            yield stage_words(name), format_quantity(float(value), "s")


def run_rows(result: RunResult) -> Rows:
    """Yield rows about the run: hash of the scene, commit, date and machine."""
    yield "hash of the scene", str(result.summary.get("scene_hash") or result.scene.hash)
    yield from origin_rows(result.summary)


def origin_rows(summary: Summary) -> Rows:
    """Yield rows about the origin of results with this summary: commit, date and machine, as far as they are known."""
    yield from ((key, str(summary[key])) for key in ("commit", "date") if summary.get(key))
    yield from _flatten_times(summary.get("machine", {}))


def _flatten_times(values: Mapping[str, object]) -> Rows:
    """Yield (name, text) of all entries of nested mappings `values` that are not None.

    The names of the levels are joined by a space.
    """
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from ((f"{name} {key}", text) for key, text in _flatten_times(value))
        elif value is not None:
            yield str(name), str(value)
