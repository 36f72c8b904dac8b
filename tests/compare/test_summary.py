from __future__ import annotations

import numpy as np
import pytest

from pmr.compare.summary import origin_part
from pmr.fullmodel.build import build, warnings
from pmr.pipeline import run
from pmr.results.run import SummaryPart, combine_parts


def test_figures_and_warnings_of_all_parts_are_gathered_in_order() -> None:
    parts = [
        SummaryPart({"a": 1.0}, ["first"]),
        SummaryPart(),
        SummaryPart(warnings=["second"]),
        SummaryPart({"b": {"c": np.nan}}, ("third",)),
    ]
    found = combine_parts(parts)
    assert list(found) == ["a", "b", "warnings"] and found["a"] == 1.0
    assert found["warnings"] == ["b.c is not finite; in summary.json it is null", "first", "second", "third"]


def test_warnings_of_what_does_not_hold_stand_before_those_of_what_is_off() -> None:
    parts = [
        SummaryPart(warnings=["off by 2 %"]),
        SummaryPart({"a": 1.0}, ["a hint"], ["it yields"]),
        SummaryPart(grave=["it slips"]),
    ]
    assert combine_parts(parts)["warnings"] == ["it yields", "it slips", "off by 2 %", "a hint"]


def test_no_part_overwrites_what_another_one_says() -> None:
    with pytest.raises(ValueError, match="two parts of a summary have a, b"):
        combine_parts([SummaryPart({"a": 1, "b": 2}), SummaryPart({"b": 3, "a": 4})])


def test_libraries_stand_beside_the_versions(load_scene) -> None:
    scene = load_scene("paper_simple", [])
    figures = origin_part(scene, {"dolfinx": "0"}).figures
    assert figures["versions"]["dolfinx"] == "0" and "numpy" in figures["versions"]
    assert (figures["title"], figures["scene_hash"]) == (scene.title, scene.hash)


@pytest.mark.parametrize(("elements", "count"), [(50, 0), (3000, 1)])
def test_too_many_elements_are_said(load_scene, elements: int, count: int) -> None:
    said = warnings(build(load_scene("paper_simple", [f"mesh.elements={elements}"])).structure)
    assert [line.startswith("round-off in the stiffness of so short elements") for line in said] == [True] * count


@pytest.mark.slow
def test_where_a_slider_strikes_the_forces_are_judged_without_the_blows(load_scene) -> None:
    short = [
        "time.end=1.0",
        "time.rho_inf=0.5",
        "mesh.elements=20",
        "simulation.simulators=['march']",
        "compare.against=['full']",
    ]
    kinked = "slider.path={kind='ramp',times=[0.3,0.6],values=[1.25,1.6]}"
    outcome = run(load_scene("evolved_residual", [*short, kinked]))
    assert outcome is not None
    found, errors = outcome.result.summary["impacts"], outcome.result.summary["errors"]["reduced_vs_full"]
    assert 0.0 < found["pad_force"] < 0.2 * errors["pad_force"] and 1.0 < found["band"] < 100.0
    smooth = run(load_scene("evolved_residual", [*short, kinked.replace("'ramp'", "'smooth_ramp'")]))
    assert smooth is not None and "impacts" not in smooth.result.summary
