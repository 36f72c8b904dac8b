from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from finished import WORKFLOWS, finished, short_scene
from numpy.typing import NDArray

from pmr import scene
from pmr.compare import errors as compare
from pmr.compare.simulated import simulate
from pmr.errors import InputError
from pmr.fullmodel.build import models_of
from pmr.pipeline import reduce
from pmr.pipeline.full_order import FullOrder
from pmr.reduced.model import ReducedModel
from pmr.report.studies.finished import FinishedStudy
from pmr.report.studies.sections.residual import content
from pmr.studies import bases, files
from pmr.studies.engine.task import number
from pmr.studies.kinds import residual
from pmr.studies.results import StudyResults

pytestmark = pytest.mark.slow

SMALL = """
kind = "residual"
title = "Two sizes"
scenes = ["short.toml"]
coordinates = [5, 8]
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> StudyResults:
    folder = tmp_path_factory.mktemp("small")
    short_scene(folder, "evolved_residual")
    return finished(folder, SMALL)


def figures(small: StudyResults) -> dict[str, dict]:
    return {str(run.parameters["basis"]): dict(run.figures) for run in small.runs}


def test_each_basis_is_a_row_with_every_size(small: StudyResults) -> None:
    assert [run.key for run in small.runs] == [f"short,{basis}" for basis in residual.BASES]
    for basis, found in figures(small).items():
        assert set(found) == {f"{name}.{r}" for name in ("beam", "force", "estimate") for r in (5, 8)}
        assert (found["estimate.5"] is not None) == (basis == "flexibility")
        assert {"full", "simulate.8"} <= set(next(r for r in small.runs if r.parameters["basis"] == basis).seconds)


def test_errors_are_those_of_a_run(small: StudyResults) -> None:
    choice = ["reduction.coordinates=5", "simulation.simulators=['march']"]
    short = scene.load(small.folder / "short.toml", choice)
    reduction = reduce(short)
    full = FullOrder.of(short, models_of(reduction.built)).reference("full")
    reduced = simulate(short, reduction.reduced)
    assert full is not None
    found = figures(small)["flexibility"]["beam.5"]
    assert found == pytest.approx(compare.nrms(reduced.displacement, full.displacement), rel=1e-3)


def test_what_is_left_out_counts(small: StudyResults) -> None:
    found = {basis: number(figures(small)[basis]["beam.8"]) for basis in residual.BASES}
    assert found["flexibility"] < 0.5 * found["modes"] < found["pod"]
    assert 1.0 < number(figures(small)["flexibility"]["estimate.8"]) / found["flexibility"] < 2.0


def test_the_motions_own_basis_is_exact_with_all_it_spans(small: StudyResults) -> None:
    short = scene.load(small.folder / "short.toml")
    case = bases.Case.of(short, 20.0)
    models = bases.trajectory(case)
    assert 20 <= models.largest < case.full.size
    error = compare.nrms(case.simulated(models.of(models.largest))[1], case.displacement)
    assert error < 1e-2 * number(figures(small)["trajectory"]["beam.8"])


def test_harmonic_responses_are_those_of_the_held_beam(small: StudyResults) -> None:
    """At one of its frequencies and positions the basis holds the constrained response: Galerkin's is the same."""
    short = scene.load(small.folder / "short.toml")
    case = bases.Case.of(short, 20.0)
    model = bases.harmonic(case)
    s, omega = short.path_bounds[0], 2.0 * np.pi * 20.0 / (bases.FREQUENCIES - 1)

    def response(body: ReducedModel) -> NDArray[np.complex128]:
        C, A = body.C(s), body.K * (1.0 + 1j * bases.LOSS) - omega**2 * body.M
        kkt = np.block([[A, C.T], [C, np.zeros((1, 1))]])
        return body.outputs @ np.linalg.solve(kkt, np.concatenate([body.B, np.zeros((1, 1))]))[:-1, 0]

    whole, beside = response(case.full), response(model.of(6))
    np.testing.assert_allclose(response(model.of(model.largest)), whole, atol=1e-6 * np.abs(whole).max())
    assert np.abs(beside - whole).max() > 1e-4 * np.abs(whole).max()  # six of its vectors do not do


def test_it_is_reported(small: StudyResults) -> None:
    study = FinishedStudy.load(small.folder)
    assert 1.0 < study.figure("ratio.least") < study.figure("ratio.largest") < 2.0
    said = content(study, "study-1")
    assert "8 free modes" in said.headline and "scene short" in said.headline
    of_errors, ratios = said.blocks[0].grids
    assert [row[0] for row in of_errors.rows] == ["short"] and len(of_errors.rows[0]) == 1 + len(residual.BASES)
    assert [row[0] for row in ratios.rows] == ["short, residual flexibility"]
    assert all(1.0 < float(cell) < 2.0 for row in ratios.rows for cell in row[1:])
    assert all("<svg" in drawing.svg for block in said.blocks for row in block.rows for drawing in row)


def test_sizes_that_do_not_increase_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    file.write_text(SMALL.replace("[5, 8]", "[8, 5]").replace("short.toml", str(WORKFLOWS / "evolved_residual.toml")))
    with pytest.raises(InputError, match="coordinates = .8, 5.: increasing numbers are allowed"):
        files.load(file)
