from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from statistics import median
from types import SimpleNamespace

import numpy as np
import pytest
from finished import WORKFLOWS, finished, short_scene

from pmr.errors import InputError
from pmr.scene import load
from pmr.simulation import Excitation
from pmr.studies import files
from pmr.studies.kinds.speed import APPROACHES, RATIOS, Later, stretches_of, timed
from pmr.studies.results import StudyResults
from pmr.studies.shared import scene_arguments

SMALL = """
kind = "speed"
title = "Short times"
scenes = ["short.toml"]
repeats = 2
share = { full-callbacks = 0.04, reduced-callbacks = 0.16 }
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> StudyResults:
    folder = tmp_path_factory.mktemp("small")
    short_scene(folder)
    return finished(folder, SMALL)


@pytest.mark.slow
def test_sizes_and_shares(small: StudyResults) -> None:
    found = {run.parameters["approach"]: run.figures for run in small.runs}
    assert list(found) == list(APPROACHES)
    sizes = [found[name]["coordinates"] for name in ("ancf", "full-callbacks", "full-march", "reduced-updates")]
    assert sizes == [36, 63, 63, 20]
    assert [found[name]["steps"] for name in ("full-callbacks", "reduced-callbacks", "ancf")] == [16, 80, 500]


@pytest.mark.slow
def test_times_stand_apart_from_the_table(small: StudyResults) -> None:
    assert all({"repeat1", "repeat2"} <= set(run.seconds) for run in small.runs)
    assert "repeat" not in (small.folder / "runs.csv").read_text()


@pytest.mark.parametrize("share", [1.0, 0.128])
def test_a_share_is_extrapolated_to_the_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, share: float) -> None:
    """By a solver that takes 2 ms for each of the 500 steps."""

    def steady(body: object, excitation: Excitation) -> SimpleNamespace:
        return SimpleNamespace(seconds=2e-3 * excitation.stepping.steps)

    monkeypatch.setitem(APPROACHES, "full-updates", replace(APPROACHES["full-updates"], simulate=steady))
    arguments = scene_arguments(load(short_scene(tmp_path))) | {
        "approach": "full-updates",
        "repeats": 2,
        "share": share,
    }
    assert timed(arguments, {}).seconds == pytest.approx({"repeat1": 1.0, "repeat2": 1.0})


@pytest.mark.slow
def test_figures_are_ratios_of_medians(small: StudyResults) -> None:
    figures = json.loads((small.folder / "summary.json").read_text())["figures"]
    middle = {
        run.parameters["approach"]: median([run.seconds["repeat1"], run.seconds["repeat2"]]) for run in small.runs
    }
    assert figures["span"] == 0.5
    for name, (a, b) in RATIOS.items():
        assert figures[f"short.{name}"] == pytest.approx(middle[a] / middle[b])


def test_nothing_runs_beside_a_measurement(tmp_path: Path) -> None:
    short_scene(tmp_path)
    (tmp_path / "study.toml").write_text(SMALL)
    (part,) = files.load(tmp_path / "study.toml").parts
    assert all(task.alone for task in part.plan.runs) and not any(task.alone for task in part.plan.shared)


def test_a_share_is_spread_over_the_time_span() -> None:
    """Half of the stretches lie where the slider of the paper's cases moves, as half of the time does."""
    scene = load(WORKFLOWS / "paper_evolved.toml")
    (whole,) = stretches_of(scene, 1.0)
    assert (whole.begin, whole.steps) == (0.0, 15000)
    parts = stretches_of(scene, 0.08)
    assert sum(part.steps for part in parts) == 1200
    ends = [(part.begin, part.begin + part.steps * scene.time.step) for part in parts]
    assert all(0.0 <= begin < end <= 15.0 for begin, end in ends)
    assert sum(3.75 <= begin and end <= 11.25 for begin, end in ends) == len(parts) / 2
    later = Later(signal=scene.slider.path, begin=parts[2].begin)
    t = np.linspace(0.0, 0.1, 5)
    assert np.array_equal(later.value(t), scene.slider.path.value(t + parts[2].begin))
    assert np.array_equal(later.rate(t), scene.slider.path.rate(t + parts[2].begin))


def test_an_unknown_approach_is_refused(tmp_path: Path) -> None:
    short_scene(tmp_path)
    (tmp_path / "study.toml").write_text(SMALL.replace("full-callbacks", "full-callback"))
    with pytest.raises(InputError, match="full-callback"):
        files.load(tmp_path / "study.toml")
