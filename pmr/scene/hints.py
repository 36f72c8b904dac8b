"""Hints at unusual numbers of a scene, and JSON schemas of scene and study files for editors.

The usual range of a key is declared on its field (`pmr.scene.keys.Usual`): a range of magnitudes, in the key's unit or
in multiples of a scale, such as the length of the section.  A table may add scales (`hint_scales`), and numbers that
are not fields of it (`hint_numbers`).  Hints refuse nothing: a number may be possible and yet be in another unit.

The schemas are those of pydantic, extended by what files may contain besides: a file that `extends` another one may
leave out keys, a number stands for a constant signal, and entries of lists may be changed by their names.  The dialect
is JSON Schema's draft 7, which editors of TOML know.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from pmr.scene.built import GRAVITY
from pmr.scene.choice import traits_of
from pmr.scene.joints import BoomSection
from pmr.scene.keys import Hinted, Schema, Usual, quantity_of, usual_ranges
from pmr.scene.left_out import hung_force_remark
from pmr.scene.members import members
from pmr.scene.scene import BodyFile, Scene
from pmr.scene.signals import SignalBase

Scales = Mapping[str, float]

#: Other units in which a number may be meant, by the unit of its key, likely ones first, and their size in this unit.
OTHER_UNITS: Mapping[str, Mapping[str, float]] = {
    "m": {"mm": 1e-3, "cm": 1e-2},
    "m^2": {"mm^2": 1e-6, "cm^2": 1e-4},
    "m^4": {"mm^4": 1e-12, "cm^4": 1e-8},
    "m/s": {"m/min": 1.0 / 60.0, "km/h": 1.0 / 3.6, "mm/s": 1e-3},
    "m/s^2": {"mm/s^2": 1e-3, "cm/s^2": 1e-2, "g": GRAVITY},
    "s": {"ms": 1e-3},
    "kg": {"t": 1e3, "g": 1e-3},
    "kg/m": {"t/m": 1e3, "kg/mm": 1e3, "g/m": 1e-3},
    "kg/m^3": {"t/m^3": 1e3, "kg/mm^3": 1e9, "t/mm^3": 1e12, "g/m^3": 1e-3},
    "kg m^2": {"t m^2": 1e3, "kg mm^2": 1e-6},
    "N": {"kN": 1e3, "MN": 1e6},
    "N m": {"kN m": 1e3, "N mm": 1e-3},
    "N m/rad": {"kN m/rad": 1e3, "N mm/rad": 1e-3},
    "N/m": {"N/mm": 1e3, "kN/mm": 1e6, "MN/mm": 1e9},
    "N m^2": {"N mm^2": 1e-6, "kN m^2": 1e3},
    "Pa": {"MPa": 1e6, "GPa": 1e9, "kPa": 1e3},
    "rad": {"degrees": math.pi / 180.0},
    "degrees": {"rad": 180.0 / math.pi},
    "1": {"%": 0.01},
}

#: Share of a section's length up to which a probe is at the place of a force.
AT_JUMP = 1e-6


@dataclass(frozen=True)
class _UnusualNumber:
    """A number outside of its usual range from `low` to `high`; all three are in the same unit."""

    key: str
    value: float
    unit: str
    low: float
    high: float

    @property
    def distance(self) -> float:
        """Factor by which the magnitude is below `low` or above `high`."""
        return max(self.low / abs(self.value), abs(self.value) / self.high)

    @property
    def sentence(self) -> str:
        """Sentence with the key, the number, its usual range, and other units in which it may be meant."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        usual = f"{self.low:.3g} to {self.high:.3g}{unit}" if self.low else f"up to {self.high:.3g}{unit}"
        if math.isinf(self.high):
            usual = f"{self.low:.3g}{unit} and more"
        likely = OTHER_UNITS.get(self.unit, {}).items()
        likely_units = {other: factor for other, factor in likely if self.low <= abs(self.value) * factor <= self.high}
        meant = [f"{other} ({self.value * factor:.3g}{unit})" for other, factor in likely_units.items()]
        question = f"is it in {' or '.join(meant[:2])}?" if meant else "is the unit right?"
        return f"{self.key} = {self.value:.6g}{unit} is unusual: {usual} is usual here; {question}"


def hints(scene: Scene) -> list[str]:
    """Return a sentence for each key of a scene whose number is unusual, and one on hung forces without a mass."""
    numbers = list(_unusual_in_table(scene, "", boom_scales(scene)))
    for number, part in enumerate(scene.sections):
        key = f"sections[{number}]." if scene.sections[0].name else ""
        numbers += _unusual_in_table(part, key, boom_scales(scene) | _section_scales(part))
    return [*_sentences(numbers), *filter(None, [hung_force_remark(scene)]), *_probe_remarks(scene)]


def _probe_remarks(scene: Scene) -> Iterator[str]:
    """Yield a sentence for each probe of a beam's stress at a place where section forces jump.

    Such places are supports, masses and loads at points, and the lug of the luffing cylinder.
    """
    frame = scene.frame
    for number, member in enumerate(members(scene)):
        part = member.part
        jumps = dict[float, str]()
        for kind, group in (("support", part.supports), ("mass", part.masses), ("load", part.loads)):
            jumps |= {float(of.on): f"the {kind} {of.name}" for of in group if isinstance(of.on, float)}
        jumps |= {of.at[0]: f"the mass {of.name}" for of in part.masses if of.at is not None}
        jumps |= {of.point[0]: f"the load {of.name}" for of in part.loads if of.point is not None}
        if frame is not None and frame.cylinder is not None and not number:
            jumps[frame.cylinder.lug[0] - frame.tail_position[0]] = "the luffing cylinder"
        for probe in part.probes if traits_of(member).is_beam else ():
            if probe.at is None or not {"stress", "strain"} & set(probe.measures):
                continue
            for acting in (name for x, name in jumps.items() if abs(x - probe.at[0]) <= AT_JUMP * part.length):
                yield (
                    f"probe {probe.name} of {part.name or 'the body'} is where {acting} acts, at {probe.at[0]:.6g} m: "
                    "section forces jump there, and the probe has the stress on the side of the tail alone; a probe "
                    "beside this place on each side has both"
                )


def table_hints(table: BaseModel, scene: Scene) -> list[str]:
    """Return a sentence for each key of `table` with an unusual number, judged by the scales of the scene.

    The table, such as a study of the scene, is not part of it.
    """
    return _sentences(_unusual_in_table(table, "", boom_scales(scene)))


def _sentences(numbers: Iterable[_UnusualNumber]) -> list[str]:
    """Return one sentence for each key, about its most unusual number; keys that differ only in indices are one."""
    by_key: dict[str, list[_UnusualNumber]] = {}
    for number in numbers:
        by_key.setdefault(re.sub(r"\[\d+\]", "", number.key), []).append(number)
    lines = []
    for alike in by_key.values():
        more = f" ({len(alike) - 1} more like it)" if len(alike) > 1 else ""
        lines.append(max(alike, key=lambda number: number.distance).sentence + more)
    return lines


def _unusual_in_table(table: BaseModel, key: str, scales: Scales) -> Iterator[_UnusualNumber]:
    """Yield the unusual numbers of a table and of the tables within it; `key` is the table's key followed by a dot."""
    if isinstance(table, Hinted):
        scales = {**scales, **table.hint_scales(scales)}
        for name, (value, judged_by) in table.hint_numbers.items():
            yield from _unusual_number(value, f"{key}{name}", (judged_by,), judged_by.unit, scales)
    for name in type(table).model_fields:
        if name == "sections" and isinstance(table, Scene):
            continue  # each section has scales of its own
        quantity, usual = quantity_of(type(table), name), usual_ranges(type(table), name)
        unit = quantity.unit if quantity is not None else ""
        yield from _unusual_in_value(getattr(table, name), f"{key}{name}", usual, unit, scales)


def _unusual_in_value(
    value: object, key: str, usual: tuple[Usual, ...], unit: str, scales: Scales
) -> Iterator[_UnusualNumber]:
    """Yield the unusual numbers of a field's `value` and of all lists and tables nested in it.

    `key` is the field's key.  Numbers and signals of the field have the `usual` ranges and the `unit`.  The fields of
    tables within it have ranges of their own.
    """
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        yield from _unusual_number(float(value), key, usual, unit, scales)
    elif isinstance(value, (tuple, list)):
        for number, entry in enumerate(value):
            yield from _unusual_in_value(entry, f"{key}[{number}]", usual, unit, scales)
    elif isinstance(value, Mapping):
        for name, entry in value.items():
            yield from _unusual_in_value(entry, f"{key}.{name}", usual, unit, scales)
    elif isinstance(value, BaseModel):
        if isinstance(value, SignalBase) and usual:
            largest = max(value.bounds(0.0, scales["time"]), key=abs)
            yield from _unusual_number(largest, key, usual, unit, scales)
        yield from _unusual_in_table(value, f"{key}.", scales)


def _unusual_number(
    value: float, key: str, usual: tuple[Usual, ...], unit: str, scales: Scales
) -> Iterator[_UnusualNumber]:
    """Yield the number `value` of a key if its magnitude is outside of all that its `usual` ranges have in common.

    `unit` is its unit if the last range has none.  0 is never unusual.  A range in multiples of a scale is left out if
    `scales` lacks this scale or has it as 0.
    """
    ranges = [of for of in usual if not of.scale or scales.get(of.scale)]
    if not (value and ranges):
        return
    sizes = [scales.get(of.scale, 1.0) for of in ranges]
    low = max(of.low * size for of, size in zip(ranges, sizes, strict=True))
    high = min(of.high * size for of, size in zip(ranges, sizes, strict=True))
    if low <= high and not low <= abs(value) <= high:
        yield _UnusualNumber(key, value, ranges[-1].unit or unit, low, high)


def boom_scales(scene: Scene) -> dict[str, float]:
    """Return the scales of the whole boom: reach in m, mass in kg, weight in N, time in s and gravity in m/s^2.

    Their names are ``reach``, ``boom`` (the mass), ``weight``, ``time`` and ``gravity``.  Reach, mass or weight is 0 if
    it is not known of one of the sections.
    """
    sections = [_section_scales(part) for part in scene.sections]
    lengths, masses, weights = ([scales[name] for scales in sections] for name in ("length", "mass", "weight"))
    reach, mass, weight = (sum(sizes) if all(sizes) else 0.0 for sizes in (lengths, masses, weights))
    return {"reach": reach, "boom": mass, "weight": weight, "time": scene.time.end, "gravity": GRAVITY}


def _section_scales(part: BoomSection) -> dict[str, float]:
    """Return ``length`` in m, ``mass`` in kg and ``weight`` in N of a section.

    All are 0 if a number of its body is unusual.  Mass and weight are 0 if only a mesh file describes the body.
    """
    if any(_unusual_in_table(part.body, "", {"gravity": GRAVITY})):
        return dict.fromkeys(("length", "mass", "weight"), 0.0)
    return {"length": part.length, "mass": _mass(part), "weight": GRAVITY * _mass(part)}


def _mass(part: BoomSection) -> float:
    """Return the mass of a section's beam or box in kg without frames; 0 for a mesh file."""
    body = part.body
    if body.mover is not None:
        return body.mover.mass + body.mover.wheel_mass
    if body.profile is not None:
        return body.profile.mass_per_length * body.profile.length
    if body.box is None:
        return 0.0
    volume = body.box.volume if body.section is None else body.section.area * body.box.length
    return body.material.density * volume


DRAFT = "http://json-schema.org/draft-07/schema#"
EXTENDS = {
    "type": "string",
    "description": "File that this one changes: a path relative to it, or the name of one that comes with pmr",
}
#: Suffix of the names of schemas of tables that need not be complete.
IN_PART = ", in part"


def scene_form_schemas() -> list[Schema]:
    """Return the schemas of the two forms of a scene file: with a body at the top, and with a list of sections."""
    return [BodyFile.model_json_schema(), Scene.model_json_schema(mode="validation")]


def scene_file_schema() -> Schema:
    """Return the schema of a scene file with one body or with several sections."""
    body, several = scene_form_schemas()
    section = {"$ref": f"#/$defs/BoomSection{IN_PART}"}  # the table of keys that sections share
    about = several["properties"]["section"]["description"]
    several["properties"]["section"] = {"allOf": [section], "description": about}
    several["properties"]["sections"]["items"] = {"allOf": [section, {"required": ["name"]}]}
    return union_schema([body, several], "Scene of pmr")


def union_schema(schemas: Sequence[Schema], title: str) -> Schema:
    """Return the schema, with a title, of files that fit any one of `schemas`.

    Tables with the same name are equal in all of these.
    """
    parts: Schema = {}
    complete, extending = [], []
    for schema in schemas:
        spelled_schema = _in_draft_7(schema)
        parts |= spelled_schema.pop("$defs", {})
        changed = _without_required_keys(spelled_schema)
        changed["properties"]["extends"] = EXTENDS
        complete.append(spelled_schema)
        extending.append(changed | {"required": ["extends"]})
    parts |= {f"{name}{IN_PART}": _without_required_keys(part) for name, part in parts.items()}
    return {"$schema": DRAFT, "title": title, "$defs": parts, "anyOf": [*complete, *extending]}


def _in_draft_7(node: object) -> Any:
    """Return a node of a pydantic schema in draft 7, with units in descriptions, and numbers allowed as signals."""
    if isinstance(node, list):
        return [_in_draft_7(entry) for entry in node]
    if not isinstance(node, dict):
        return node
    spelled_node = {key: _in_draft_7(value) for key, value in node.items() if key != "discriminator"}
    if "prefixItems" in spelled_node:
        spelled_node["items"] = spelled_node.pop("prefixItems")
    if "constant" in node.get("discriminator", {}).get("mapping", {}):
        spelled_node["anyOf"] = [{"type": "number"}, {"oneOf": spelled_node.pop("oneOf")}]
    if isinstance(node.get("description"), str) and isinstance(node.get("unit"), str) and node["unit"] != "1":
        spelled_node["description"] += f", in {node['unit']}"
    return spelled_node


def _without_required_keys(node: object) -> Any:
    """Return a node of a schema in which no key is required and tables may change single entries of lists of tables."""
    if isinstance(node, list):
        return [_without_required_keys(entry) for entry in node]
    if not isinstance(node, dict):
        return node
    part = {key: _without_required_keys(value) for key, value in node.items()}
    if isinstance(part.get("required"), list):
        del part["required"]
    if isinstance(node.get("$ref"), str) and not node["$ref"].endswith(IN_PART):
        part["$ref"] = f"{node['$ref']}{IN_PART}"
    if isinstance(node.get("oneOf"), list):
        part["anyOf"] = part.pop("oneOf")
    if node.get("type") == "array" and "$ref" in str(node.get("items")):
        about = {key: part.pop(key) for key in ("description", "default", "title") if key in part}
        entries = {"type": "object", "additionalProperties": part["items"]}
        part = {**about, "anyOf": [part, entries]}
    return part
