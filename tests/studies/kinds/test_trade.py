from __future__ import annotations

from pathlib import Path

import numpy as np
import one_body
import pytest
from finished import finished, short_scene

from pmr.compare.errors import nrms
from pmr.errors import InputError
from pmr.report.studies.finished import FinishedStudy
from pmr.report.studies.trade import NAMES, build_chapter, error_front
from pmr.scene import load
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.modal import modal_form
from pmr.studies import files, shared
from pmr.studies.kinds import trade
from pmr.studies.results import StudyResults
from pmr.studies.tasks import cell_number

pytestmark = pytest.mark.slow

SMALL = """
kind = "trade"
title = "Two sizes"
scenes = ["short.toml"]
coordinates = [4, 8]
steps = [2.0, 1.0, 0.5]
elements = [4, 8]
radii = [0.5, 0.9]
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> StudyResults:
    folder = tmp_path_factory.mktemp("small")
    short_scene(folder, "evolved_residual")
    return finished(folder, SMALL)


def figures(small: StudyResults) -> dict[str, dict]:
    return {str(run.parameters["method"]): dict(run.figures) for run in small.runs}


def test_methods_differ_as_they_should(small: StudyResults) -> None:
    found = {method: cell_number(figures(small)[method]["reduction.4"]) for method in trade.METHODS}
    assert found["flexibility"] < 0.5 * found["modes"]
    assert found["flexibility"] < found["visited"]


def test_the_reference_is_the_full_model_with_a_far_shorter_step(small: StudyResults) -> None:
    scene = trade.without_axial(load(small.folder / "short.toml"))
    body, driven = shared.model_of(scene).gather(), Excitation.from_scene(scene)
    end, step, rho = driven.stepping.end, driven.stepping.step, driven.stepping.rho_inf
    assert body is not None
    runs = [
        one_body.observe(
            modal_form(body), driven.with_stepping(TimeStepping(end, h * step, rho)), every=round(2.0 / h)
        ).y
        for h in (0.125, 1 / 32)
    ]
    assert cell_number(figures(small)["pod"]["reference"]) == pytest.approx(nrms(*runs), rel=0.5)


def test_errors_of_many_modes_are_those_of_the_step(small: StudyResults) -> None:
    steps = [cell_number(figures(small)["radii"][f"rho.0.9.{h:g}"]) for h in (2.0, 1.0, 0.5)]
    assert np.all(np.diff(steps) < 0.0)
    assert cell_number(figures(small)["radii"]["rho.0.5.1"]) > steps[1]
    errors = [cell_number(figures(small)["elements"][f"tip.{n}"]) for n in (4, 8)]
    assert errors[0] > errors[1]


def test_what_holds_a_tolerance_holds_it_with_shorter_steps_too() -> None:
    found = {
        "total.4.2": 0.5,
        "total.4.1": 0.009,
        "total.4.0.5": 0.02,
        "total.8.2": 0.1,
        "total.8.1": 0.02,
        "total.8.0.5": 0.004,
    }
    assert trade.coarsest_within(found, 0.01) == (8, 0.5)
    assert trade.coarsest_within(found, 0.02) == (4, 1.0)
    assert trade.coarsest_within(found, 0.001) is None


def test_steps_that_do_not_meet_are_refused(tmp_path: Path) -> None:
    short_scene(tmp_path, "evolved_residual")
    (tmp_path / "study.toml").write_text(SMALL.replace("[2.0, 1.0, 0.5]", "[3.0, 1.0]"))
    with pytest.raises(InputError, match="factors that divide"):
        files.load(tmp_path / "study.toml")


def test_fronts_hold_what_nothing_beats() -> None:
    assert error_front([(1.0, 0.5), (2.0, 0.6), (3.0, 0.1), (0.5, 0.9)]) == [(0.5, 0.9), (1.0, 0.5), (3.0, 0.1)]


def test_the_report_shows_fronts_tolerances_and_energies(small: StudyResults) -> None:
    chapter = build_chapter(FinishedStudy.load(small.folder), "small")
    fronts, holding, energies = chapter.blocks
    assert fronts.drawings and [row[0] for row in holding.grids[0].rows] == list(NAMES.values())
    assert [row[0] for row in energies.grids[0].rows] == list(NAMES.values())
    said = {row[0]: row[1:] for row in holding.grids[0].rows}
    assert said["residual flexibility"][1].startswith("4 ×") and said["residual flexibility"][3] == "–"
