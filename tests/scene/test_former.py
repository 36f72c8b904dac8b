"""Scenes that earlier versions wrote into results and models are read; a file with their keys is refused in a line."""

import json
from pathlib import Path
from typing import Any

import pytest

from pmr import InputError
from pmr.scene import Scene, load_any
from pmr.scene.files import GONE, stored_scene

BOOM = load_any("boom_three", ["time.end=0.1"])


def written() -> dict[str, Any]:
    return json.loads(BOOM.model_dump_json())


def with_key(data: dict[str, Any], name: str) -> dict[str, Any]:
    """A stored scene of several sections, each of which has a key."""
    first, *keys = name.split(".")
    for part in data["sections"] if first in ("section", "sections") else [data]:
        for key in keys[:-1]:
            part = part[key] if part is not None else None
        if part is not None:
            part[keys[-1]] = 0.25
    return data


@pytest.mark.parametrize("name", [name for name in GONE if name.startswith("sections.")])
def test_a_stored_scene_may_have_keys_that_are_gone(name: str) -> None:
    former = with_key(written(), name)
    assert former != written() and stored_scene(former, "scene.json") == stored_scene(written(), "scene.json") == BOOM
    with pytest.raises(ValueError, match=r"(?i)extra"):
        Scene.model_validate(former)


def test_a_key_of_a_later_version_is_refused_in_one_line() -> None:
    later = written() | {"hologram": 1}
    with pytest.raises(
        InputError, match=r"^scene.json: hologram = 1: a scene of this version of pmr or an earlier one"
    ):
        stored_scene(later, "scene.json")


@pytest.mark.parametrize("name", GONE)
def test_a_file_with_a_key_that_is_gone_is_refused_with_what_does_its_work(name: str, tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(f"extends = '{'boom_three' if name.startswith('section') else 'boom_beam'}'\n")
    asked = name.replace("sections.", "sections.fly.")
    with pytest.raises(InputError) as caught:
        load_any(file, [f"{asked}=0.25"])
    assert caught.value.allowed == GONE[name] and "\n" not in str(caught.value)
