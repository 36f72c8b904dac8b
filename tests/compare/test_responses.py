from __future__ import annotations

from pathlib import Path

import numpy as np
import one_body
import pytest

from pmr import scene as scenes
from pmr.compare import evaluation
from pmr.compare.responses import simulate
from pmr.pipeline import reduce
from pmr.scene.keys import ALONE
from pmr.simulation import Excitation
from pmr.simulation.native.march import March

WORKFLOWS = Path(__file__).parents[2] / "workflows"
SMALL = ("mesh.elements=12", "time.end=0.2", "reduction.coordinates=6", "slider.path=2.0", "simulation.repeats=1")


@pytest.mark.slow
@pytest.mark.parametrize("workflow", ["boom_beam", "boom_two"])
def test_repeats_time_the_solver_and_evaluate_nothing(workflow: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scenes.load_any(WORKFLOWS / f"{workflow}.toml", ["time.end=0.05"])
    system, evaluated, taken = reduce(scene).system, [], []
    whole, once_more = evaluation.response_to_motion, March.rerun
    monkeypatch.setattr(evaluation, "response_to_motion", lambda *of: evaluated.extend(of[1]) or whole(*of))
    monkeypatch.setattr(March, "rerun", lambda march: taken.append(march) or once_more(march))
    made = simulate(scene, system, Excitation.from_scene(scene))
    assert not taken
    found = made.with_least_seconds().first
    assert len(taken) == scene.simulation.repeats - 1
    assert len(set(evaluated)) == scene.time.steps + 1 and min(np.diff(evaluated)) >= 0.0  # block by block, and once
    assert found.response.seconds > 0.0
    march = taken[-1]  # from the same start to the same end
    repeated, number = march.state.z.copy(), march.state.step_number
    march.rerun()
    assert np.allclose(march.state.z, repeated, rtol=1e-9, atol=0.0) and march.state.step_number == number


@pytest.mark.slow
@pytest.mark.parametrize(("simulator", "bound"), [("march", 1e-12), ("exudyn", 1e-6)])
def test_states_are_those_of_the_simulation_that_made_the_response(simulator: str, bound: float) -> None:
    scene = scenes.load(WORKFLOWS / "boom_beam.toml", [*SMALL, f"simulation.simulators=['{simulator}']"])
    reduction, steps, excitation = reduce(scene), np.array([0, 50, 200]), Excitation.from_scene(scene)
    found = simulate(scene, reduction.system, excitation, steps=steps.tolist()).first.states[ALONE]
    expected = one_body.simulate(reduction.reduced, excitation).at(steps)
    states = {"t": found.t, "s": found.s[:, 0], "q": found.p, "v": found.v, "multipliers": found.multipliers}
    for name, here in states.items():
        there = getattr(expected, name)
        assert here.shape == there.shape and np.abs(here - there).max() <= bound * np.abs(there).max(), name
