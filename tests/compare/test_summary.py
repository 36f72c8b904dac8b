from __future__ import annotations

import numpy as np
import pytest

from pmr.compare.summary import Part, gathered, made_with
from pmr.fullmodel.build import build, warnings


def test_figures_and_warnings_of_all_parts_are_gathered_in_order() -> None:
    parts = [Part({"a": 1.0}, ["first"]), Part(), Part(warnings=["second"]), Part({"b": {"c": np.nan}}, ("third",))]
    found = gathered(parts)
    assert list(found) == ["a", "b", "warnings"] and found["a"] == 1.0
    assert found["warnings"] == ["first", "second", "third", "b.c is not finite; in summary.json it is null"]


def test_no_part_overwrites_what_another_one_says() -> None:
    with pytest.raises(ValueError, match="two parts of a summary have a, b"):
        gathered([Part({"a": 1, "b": 2}), Part({"b": 3, "a": 4})])


def test_libraries_stand_beside_the_versions(load_scene) -> None:
    scene = load_scene("paper_simple", [])
    figures = made_with(scene, {"dolfinx": "0"}).figures
    assert figures["versions"]["dolfinx"] == "0" and "numpy" in figures["versions"]
    assert (figures["title"], figures["scene_hash"]) == (scene.title, scene.hash)


@pytest.mark.parametrize(("elements", "count"), [(50, 0), (3000, 1)])
def test_too_many_elements_are_said(load_scene, elements: int, count: int) -> None:
    said = warnings(build(load_scene("paper_simple", [f"mesh.elements={elements}"])).structure)
    assert [line.startswith("round-off in the stiffness of so short elements") for line in said] == [True] * count
