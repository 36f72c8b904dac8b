"""How motions begin, by one key for any number of bodies: at rest, or in equilibrium with the loads at t = 0."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmr import scene as scenes
from pmr.pipeline import run
from pmr.results import RunResult
from tests.scene.test_dialects import WHOLE, written

STILL = "slider.path=2.2"
STATIC = ("start=equilibrium", "gravity={}")


def result(folder: Path, *changes: str) -> RunResult:
    outcome = run(scenes.load(written(folder, False, WHOLE), ["simulation.repeats=1", *changes]))
    assert outcome is not None
    return outcome.result


@pytest.mark.slow
@pytest.mark.parametrize("full", ["march", "petsc"])
def test_a_body_alone_in_equilibrium_stays_where_it_is(tmp_path: Path, full: str) -> None:
    """Under constant loads and on a path that stands still nothing moves, in full order and reduced."""
    found = result(tmp_path, *STATIC, STILL, "time.end=0.05", f"simulation.full={full}")
    statics = found.responses["full"].displacement[0]
    assert np.abs(statics).max() > 1e-4
    for model, response in found.responses.items():
        moved = np.abs(response.displacement - response.displacement[0]).max()
        assert moved < 1e-8 * np.abs(statics).max(), model
    assert found.responses["reduced"].tip[0] == pytest.approx(found.responses["full"].tip[0], rel=1e-6)


@pytest.mark.slow
def test_at_rest_it_begins_undeformed_and_swings_about_that_equilibrium(tmp_path: Path) -> None:
    changes = STILL, "compare.against=[]", "gravity={rise=0.0}"
    still = result(tmp_path, "start=equilibrium", *changes).responses["reduced"].tip[0]
    swinging = result(tmp_path, *changes).responses["reduced"].tip
    # what modes leave out answers the loads at once, and so does a little of the tip
    assert np.abs(swinging[0]) < 0.01 * np.abs(still) and np.abs(swinging).max() > 1.5 * np.abs(still)


@pytest.mark.slow
def test_sections_begin_at_rest_where_that_is_asked_for() -> None:
    hold = [f"section.joint.{end}.0.unilateral=false" for end in ("tail", "mouth")]
    quick = ["section.mesh.elements=12", "time.end=0.02", "simulation.repeats=1", *hold]
    begun = {}
    for start in ("rest", "equilibrium"):
        outcome = run(scenes.load_any("boom_two", [*quick, f"start={start}"]))
        assert outcome is not None
        begun[start] = {name: np.abs(one.displacement[0]).max() for name, one in outcome.result.responses.items()}
    assert set(begun["rest"]) == {"reduced", "full"} and begun["rest"]["full"] == 0.0
    assert min(begun["equilibrium"].values()) > 1e-3 > 100.0 * begun["rest"]["reduced"]
