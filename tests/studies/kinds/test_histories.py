from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from finished import WORKFLOWS, compute, finished, short_scene

from pmr.compare import errors as compare
from pmr.compare.simulated import simulate
from pmr.errors import InputError
from pmr.fullmodel.build import models_of
from pmr.pipeline import reduce
from pmr.pipeline.full_order import FullOrder
from pmr.scene import load
from pmr.studies import files
from pmr.studies.results import StudyResults

SMALL = """
kind = "histories"
title = "Short history"
scenes = ["short.toml"]
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> StudyResults:
    folder = tmp_path_factory.mktemp("small")
    short_scene(folder)
    return finished(folder, SMALL)


@pytest.mark.slow
def test_errors_are_those_of_single_runs(small: StudyResults) -> None:
    """With the pin's rows holding coordinates, as the paper's scenes say, and with them dropped."""
    found = small.runs[0].figures
    for basis, tip, beam in (
        ("paper", "errors.reduced_vs_full.tip", "errors.reduced_vs_full.beam"),
        ("eigenmodes", "dropped.tip", "dropped.beam"),
    ):
        scene = load(small.folder / "short.toml", [f"reduction.basis={basis}", "simulation.simulators=['exudyn']"])
        reduction = reduce(scene)
        full = FullOrder.of(scene, models_of(reduction.built)).reference("full")
        assert full is not None
        responses = {"reduced": simulate(scene, reduction.reduced), "full": full}
        expected = compare.errors(responses)["reduced_vs_full"]
        assert (found[tip], found[beam]) == pytest.approx((expected["tip"], expected["beam"]), rel=1e-6)


@pytest.mark.slow
def test_tips_and_energies_are_kept(small: StudyResults) -> None:
    arrays = small.arrays("short")
    assert arrays["full.displacement"].shape == (501, 1) == arrays["ancf.displacement"].shape
    tips = (arrays["reduced.displacement"][:, 0], arrays["full.displacement"][:, 0])
    error = np.linalg.norm(tips[0] - tips[1])
    assert small.runs[0].figures["absolute_errors.reduced_vs_full.tip"] == pytest.approx(error)
    assert arrays["full.energy.strain"].max() > 0.0


def test_a_scene_without_ancf_is_refused(tmp_path: Path) -> None:
    scene = short_scene(tmp_path)
    kept = [line for line in scene.read_text().splitlines() if "ancf" not in line]
    scene.write_text("\n".join([*kept, 'compare.against = ["full"]']))
    (tmp_path / "study.toml").write_text(SMALL)
    with pytest.raises(InputError, match="compared with ancf"):
        files.load(tmp_path / "study.toml")


@pytest.mark.slow
@pytest.mark.numerical
def test_the_table_of_the_paper(tmp_path: Path) -> None:
    found = compute(tmp_path, files.load(WORKFLOWS / "studies" / "histories.toml"))
    simple, evolved = (run.figures for run in found.runs)
    pairs = [f"errors.{pair}.{place}" for pair in ("full_vs_ancf", "reduced_vs_full") for place in ("tip", "beam")]
    assert [simple[pair] for pair in pairs] == pytest.approx([0.00074, 0.00142, 0.00196, 0.00396], abs=1e-5)
    assert [evolved[pair] for pair in pairs] == pytest.approx([0.00464, 0.00667, 0.01114, 0.01788], abs=1e-5)
    assert evolved["max_displacement"] == pytest.approx(47.8586e-3, abs=1e-7)
    assert evolved["max_error"] == pytest.approx(0.713e-3, abs=1e-6)
    published = json.loads((tmp_path / "summary.json").read_text())["published"]
    assert len(published) == 14 and {statement["quantity"] for statement in published} == {"share", "length"}
