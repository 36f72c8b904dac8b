"""What a run says of its mesh and its structural model without being asked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pmr
from pmr.compare.accuracy import mesh
from pmr.pipeline import model_part
from pmr.pipeline import scenes as pipeline
from pmr.report import model_error
from pmr.scene.richer import coarsely

pytest.importorskip("gmsh")
WORKFLOWS = Path(__file__).parents[2] / "workflows"
CHANGES = ["compare.against=[]", "time.step=0.01", "time.end=3.0"]


def scene(*changes: str) -> pmr.scene.Scene:
    return pmr.load_scene(WORKFLOWS / "boom_beam.toml", [*CHANGES, *changes])


@pytest.mark.slow
def test_a_run_measures_its_model_the_next_one_its_mesh_and_then_both_are_found(tmp_path: Path, monkeypatch) -> None:
    result = pmr.run(scene(), measures=tmp_path).result
    first = result.summary["budget"]
    assert 'body.walls = "give" adds it to a beam.' in model_error.model(result)
    assert first["model"]["beside"] == "coarse shell" and 0.1 < first["model"]["beam"] < 0.5
    assert first["mesh"] is None and first["mesh_reason"] == model_part.LATER
    second = pmr.run(scene(), measures=tmp_path).result.summary["budget"]
    assert 0.0 < second["mesh"]["beam"] < 1e-3 and second["mesh_reason"] is None
    monkeypatch.setattr(pipeline, "_reduced", lambda *_: pytest.fail("what was measured is made again"))
    third = pmr.run(scene(), measures=tmp_path).result.summary["budget"]
    assert third["model"]["frequency"] == pytest.approx(first["model"]["frequency"], rel=1e-9)


@pytest.mark.slow
def test_a_shell_is_compared_with_one_on_cells_twice_as_long(tmp_path: Path) -> None:
    """Their difference is what it is taken to be off by: of first order, as under pads."""
    cells = ["mesh.size=0.15", "mesh.along=0.3", "recovery.stress=false", "reduction.estimate=false"]
    shell = pmr.load_scene(WORKFLOWS / "boom_shell.toml", [*CHANGES, *cells])
    coarse = mesh.coarser_walls(shell)
    assert (coarse.mesh.size, coarse.mesh.along) == (0.3, 0.6) and coarse.alone.reduction.estimate is False
    result = pmr.run(shell, measures=tmp_path).result
    summary = result.summary["budget"]
    assert summary["model"]["beside"] is None and summary["mesh_reason"] is None
    moved = [one.responses["reduced"].displacement for one in (result, pmr.run(coarse).result)]
    apart = np.linalg.norm(moved[0] - moved[1]) / np.linalg.norm(moved[1])
    assert summary["mesh"]["beam"] == pytest.approx(apart, rel=0.1) and 0.03 < apart < 0.3


def test_walls_that_give_way_are_compared_with_those_of_coarser_cells_if_these_are_few() -> None:
    give = scene("body.walls='give'", "mesh.size=0.1", "mesh.along=0.2")
    coarse = mesh.coarser_walls(give)
    assert (coarse.mesh.size, coarse.mesh.along, coarse.mesh.elements) == (0.2, 0.4, give.mesh.elements // 2)
    asked = []
    found = mesh.unasked(give, lambda make, called: asked.append((make, called)) or {"beam": 0.25, "tip": None})
    assert asked == [(mesh.coarser_walls, "coarser mesh")] and found == {"mesh": {"beam": 0.25}, "mesh_reason": None}
    with pytest.raises(pmr.InputError, match=r"not measured: it would take some \d+ s; \[accuracy\] measures it"):
        mesh.coarser_walls(scene("body.walls='give'", "mesh.size=0.02", "mesh.along=0.04"))


@pytest.mark.slow
def test_what_costs_more_has_to_be_asked_for(tmp_path: Path) -> None:
    asked = scene("compare.richer='shell'", "mesh.size=0.05", "mesh.along=0.1")
    with pytest.raises(pmr.InputError, match=r"compare.richer = 'shell' measures it, in some \d+ s"):
        coarsely(asked)
    with pytest.raises(pmr.InputError, match="walls give way"):
        coarsely(scene("body.walls='give'"))
    assert "budget" not in pmr.run(scene()).result.summary
