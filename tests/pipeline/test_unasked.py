"""What a run says of its mesh and its structural model without being asked."""

from __future__ import annotations

from pathlib import Path

import pytest

import pmr
from pmr.pipeline import model_part
from pmr.pipeline import scenes as pipeline
from pmr.report import model_error
from pmr.scene.richer import coarsely

pytest.importorskip("gmsh")
WORKFLOWS = Path(__file__).parents[2] / "workflows"
CHANGES = ["compare.against=[]", "time.step=0.01", "time.end=3.0"]


def scene(*changes: str) -> pmr.scene.Scene:
    return pmr.load_scene(WORKFLOWS / "boom_beam.toml", [*CHANGES, *changes])


def test_a_run_measures_its_model_the_next_one_its_mesh_and_then_both_are_found(tmp_path: Path, monkeypatch) -> None:
    result = pmr.run(scene(), measures=tmp_path).result
    first = result.summary["budget"]
    assert 'with `body.walls = "give"` a beam\'s do so, too.' in model_error.model(result)
    assert first["model"]["beside"] == "coarse shell" and 0.1 < first["model"]["beam"] < 0.5
    assert first["mesh"] is None and first["mesh_reason"] == model_part.LATER
    second = pmr.run(scene(), measures=tmp_path).result.summary["budget"]
    assert 0.0 < second["mesh"]["beam"] < 1e-3 and second["mesh_reason"] is None
    monkeypatch.setattr(pipeline, "_reduced", lambda *_: pytest.fail("what was measured is made again"))
    third = pmr.run(scene(), measures=tmp_path).result.summary["budget"]
    assert third["model"]["frequency"] == pytest.approx(first["model"]["frequency"], rel=1e-9)


def test_what_costs_more_has_to_be_asked_for(tmp_path: Path) -> None:
    asked = scene("compare.richer='shell'", "mesh.size=0.05", "mesh.along=0.1")
    with pytest.raises(pmr.InputError, match=r"compare.richer = 'shell' measures it, in some \d+ s"):
        coarsely(asked)
    with pytest.raises(pmr.InputError, match="walls give way"):
        coarsely(scene("body.walls='give'"))
    assert "budget" not in pmr.run(scene()).result.summary
