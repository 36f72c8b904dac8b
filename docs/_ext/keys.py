"""The pages of keys, written from the schemas of scenes, signals and studies before Sphinx reads its sources."""

from __future__ import annotations

import json
from collections.abc import Container
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from pmr.cli.info import Schema, allowed, one_line, units
from pmr.scene.files import scene_form_schemas
from pmr.studies.call import schemas

INTRODUCTION = """\
# Keys of a {what}

Every key with what it allows, its unit and its default. `pmr schema {what}` prints the same as a JSON schema, from
which editors complete and check.
"""


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages when a build begins."""
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True}


def write_pages(app: Sphinx) -> None:
    """One page for scenes, one for each kind of study."""
    folder = Path(app.srcdir, "reference")
    body, several = scene_form_schemas()
    more = tables(several, 3, known=body["$defs"])
    sections = f"\n## Sections\n\nA file with `sections` lists bodies from the base out, or a body alone:\n{more}"
    write(folder / "scene_keys.md", INTRODUCTION.format(what="scene") + tables(body) + sections)
    kinds = "".join(f'\n## `kind = "{kind}"`\n\n{tables(schema, 3)}' for kind, schema in schemas().items())
    write(folder / "study_keys.md", INTRODUCTION.format(what="study") + kinds)


def write(file: Path, text: str) -> None:
    """Only what differs: Sphinx reads again what has a new time."""
    if not file.exists() or file.read_text() != text:
        file.write_text(text)


def tables(schema: Schema, level: int = 2, known: Container[str] = ()) -> str:
    """A table for the file itself, then one for each part that is not `known`, in the order in which it is met."""
    parts, found, waiting = schema.get("$defs", {}), [], [("The file itself", schema)]
    seen: set[str] = set()
    while waiting:
        title, part = waiting.pop(0)
        found.append(section(title, part, level))
        for name in references(part.get("properties", {})):
            if name not in seen and name not in known and "properties" in parts.get(name, {}):
                seen.add(name)
                waiting.append((parts[name].get("title", name), parts[name]))
    return "\n".join(found)


def section(title: str, part: Schema, level: int) -> str:
    """What a part is, and its keys."""
    lines = [
        "",
        f"{'#' * level} {title}",
        "",
        cell(part.get("description", "")),
        "",
    ]
    lines += ["| key | | allowed | default |", "|---|---|---|---|"]
    needed = part.get("required", [])
    for key, value in part.get("properties", {}).items():
        default = "must be given" if key in needed else shown(value.get("default"), allowed(value))
        unit = "".join(f", in {unit}" for unit in units(value))
        cells = [f"`{key}`", cell(value.get("description", "")), allowed(value) + unit, default]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, ""])


def references(data: Any) -> list[str]:
    """Names of all parts that are spoken of, in order."""
    if isinstance(data, dict):
        own = [data["$ref"].rpartition("/")[2]] if isinstance(data.get("$ref"), str) else []
        return own + [name for value in data.values() for name in references(value)]
    return [name for value in data for name in references(value)] if isinstance(data, list) else []


def shown(default: Any, of: str) -> str:
    """A default as it would be written; that of a table stands in the table."""
    return "" if default is None or (isinstance(default, dict) and "*" in of) else f"`{json.dumps(default)}`"


def cell(text: str) -> str:
    """A docstring on one line, as Markdown."""
    return one_line(text).replace("|", "\\|")
