from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from finished import finished, short_scene
from oracle import CASES, full_body, generalized_alpha

from pmr.errors import InputError
from pmr.scene import load
from pmr.simulation import InitialState, TimeStepping
from pmr.studies import files
from pmr.studies.results import StudyResults
from pmr.studies.tasks import cell_number

SMALL = """
kind = "convergence"
title = "Small meshes"
scene = "short.toml"
full = [4, 8, 20]
ancf = [4, 8]
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> StudyResults:
    folder = tmp_path_factory.mktemp("small")
    short_scene(folder)
    return finished(folder, SMALL)


def test_coordinates_are_those_of_beams_and_cables(small: StudyResults) -> None:
    assert {run.key: run.figures["coordinates"] for run in small.runs} == {
        "ancf-4": 20, "ancf-8": 36, "full-4": 15, "full-8": 27, "full-20": 63,
    }  # fmt: skip


def test_errors_fall_and_the_finest_has_none(small: StudyResults) -> None:
    errors = {run.key: run.figures["e_abs"] for run in small.runs}
    assert errors["full-20"] is None and errors["ancf-8"] is None
    assert cell_number(errors["full-4"]) > 3.0 * cell_number(errors["full-8"]) > 0.0


@pytest.mark.slow
def test_the_error_is_that_of_an_integrator_elsewhere(small: StudyResults) -> None:
    stepping = TimeStepping(0.5, 1e-3, 0.9)
    s = load(small.folder / "short.toml").slider.path.value(stepping.times)
    f = CASES["evolved"].load.value(stepping.times)[:, None]
    tips = []
    for elements in (4, 20):
        body = full_body(elements)
        q, _, _ = generalized_alpha(body, s, f, stepping, InitialState.at_rest(body.size))
        tips.append(q[:, -2])
    found = next(run for run in small.runs if run.key == "full-4")
    assert found.figures["e_abs"] == pytest.approx(np.linalg.norm(tips[0] - tips[1]), rel=1e-6)


def test_figures_are_errors_with_as_many_elements_as_asked_for(small: StudyResults) -> None:
    figures = json.loads((small.folder / "summary.json").read_text())["figures"]
    errors = {run.key: run.figures["e_abs"] for run in small.runs}
    assert figures["chosen.ancf"] is None and figures["chosen.full"] is None  # these are the finest
    assert figures["least.full"] == errors["full-8"] and figures["least.ancf"] == errors["ancf-4"]


@pytest.mark.parametrize(
    "line", ["full = [8, 4]", "full = [8]", "ancf = [0, 4]", "full = [4, 8]\nscene = '../graded_mesh.toml'"]
)
def test_what_has_no_finest_mesh_is_refused(tmp_path: Path, line: str) -> None:
    short_scene(tmp_path)
    given = line.split(" = ")[0]
    kept = [row for row in SMALL.splitlines() if not row.startswith(f"{given} ")]
    (tmp_path / "study.toml").write_text(
        "\n".join([*(row for row in kept if "scene" not in row or "scene" not in line), line])
    )
    with pytest.raises(InputError):
        files.load(tmp_path / "study.toml")
