"""Every key of a scene says what it is, and every number its unit and what can be computed with."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from pmr.scene import Scene
from pmr.scene.keys import SceneTable, quantity_of
from pmr.scene.scene import BodyFile


def parts(annotation: Any) -> Iterator[Any]:
    """Everything that an annotation is made of."""
    yield annotation
    for inner in get_args(annotation):
        yield from parts(inner)


def sections(root: type[SceneTable]) -> dict[str, type[SceneTable]]:
    """A section and all within it."""
    found = {root.__name__: root}
    for field in root.model_fields.values():
        for part in parts(field.annotation):
            if isinstance(part, type) and issubclass(part, SceneTable) and part.__name__ not in found:
                found |= sections(part)
    return found


KEYS = [(section, key) for section in sections(Scene).values() for key in section.model_fields]


@pytest.mark.parametrize(("section", "key"), KEYS, ids=[f"{section.__name__}.{key}" for section, key in KEYS])
def test_a_key_has_a_description_and_its_numbers_a_unit(section: type[SceneTable], key: str) -> None:
    field = section.model_fields[key]
    assert field.description
    numbers = {float, int} & {part for part in parts(field.annotation) if isinstance(part, type)}
    free = (section.__name__, key) == ("Simulation", "newton")  # names and values are Exudyn's
    signal = any(isinstance(part, type) and issubclass(part, BaseModel) for part in parts(field.annotation))
    if numbers and not free and not signal:
        quantity = quantity_of(section, key)
        assert quantity is not None and quantity.unit and quantity.low < quantity.high


def test_the_schema_tells_units() -> None:
    known = BodyFile.model_json_schema()["$defs"]
    assert known["Box"]["properties"]["length"]["unit"] == "m"
    assert known["Profile"]["properties"]["bending_stiffness"]["unit"] == "N m^2"
    assert known["Box"]["properties"]["length"]["description"] == "Length along x"
