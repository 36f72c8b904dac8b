"""Schemas of files for editors: what pydantic knows of keys, and what files may say beside it.

A file that `extends` another one need not be complete, a number stands for a constant signal, and entries of lists may
be changed by their names.  The dialect is JSON Schema's draft 7, which editors of TOML know.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pmr.scene.scene import BodyFile, Scene

Schema = dict[str, Any]

DRAFT = "http://json-schema.org/draft-07/schema#"
EXTENDS = {
    "type": "string",
    "description": "File that this one changes: a path relative to it, or the name of one that comes with pmr",
}
#: Behind the name of a part that need not be complete.
IN_PART = ", in part"


def dialects() -> tuple[Schema, Schema]:
    """The two ways to write a scene: a body at the top of the file, and sections."""
    return BodyFile.model_json_schema(), Scene.model_json_schema(mode="validation")


def scenes() -> Schema:
    """The schema of a scene file, of one body or of several sections."""
    body, several = dialects()
    section = {"$ref": f"#/$defs/Part{IN_PART}"}  # what sections have in common is said once
    about = several["properties"]["section"]["description"]
    several["properties"]["section"] = {"allOf": [section], "description": about}
    several["properties"]["sections"]["items"] = {"allOf": [section, {"required": ["name"]}]}
    return union_schema([body, several], "Scene of pmr")


def union_schema(schemas: Sequence[Schema], title: str) -> Schema:
    """The schema of files that fit one of several pydantic models; parts of one name are the same in all of them."""
    parts: Schema = {}
    complete, extending = [], []
    for schema in schemas:
        spelled_schema = _spoken(schema)
        parts |= spelled_schema.pop("$defs", {})
        changed = _in_part(spelled_schema)
        changed["properties"]["extends"] = EXTENDS
        complete.append(spelled_schema)
        extending.append(changed | {"required": ["extends"]})
    parts |= {f"{name}{IN_PART}": _in_part(part) for name, part in parts.items()}
    return {"$schema": DRAFT, "title": title, "$defs": parts, "anyOf": [*complete, *extending]}


def _spoken(node: Any) -> Any:
    """Rewrite a schema in draft 7, with units where an editor shows them, and numbers for signals."""
    if isinstance(node, list):
        return [_spoken(entry) for entry in node]
    if not isinstance(node, dict):
        return node
    spelled_node = {key: _spoken(value) for key, value in node.items() if key != "discriminator"}
    if "prefixItems" in spelled_node:
        spelled_node["items"] = spelled_node.pop("prefixItems")
    if "constant" in node.get("discriminator", {}).get("mapping", {}):
        spelled_node["anyOf"] = [{"type": "number"}, {"oneOf": spelled_node.pop("oneOf")}]
    if isinstance(node.get("description"), str) and isinstance(node.get("unit"), str) and node["unit"] != "1":
        spelled_node["description"] += f", in {node['unit']}"
    return spelled_node


def _in_part(node: Any) -> Any:
    """Rewrite a schema with nothing required, and with changes of single entries where there are lists of tables."""
    if isinstance(node, list):
        return [_in_part(entry) for entry in node]
    if not isinstance(node, dict):
        return node
    part = {key: _in_part(value) for key, value in node.items()}
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
