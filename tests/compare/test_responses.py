from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmr import scene as scenes
from pmr.compare.responses import simulate
from pmr.pipeline import reduce
from pmr.scene.names import ALONE
from pmr.simulation import Excitation
from pmr.simulation.native import simulator as march

WORKFLOWS = Path(__file__).parents[2] / "workflows"
SMALL = ("mesh.elements=12", "time.end=0.2", "reduction.coordinates=6", "slider.path=2.0", "simulation.repeats=1")


@pytest.mark.slow
@pytest.mark.parametrize(("simulator", "bound"), [("march", 1e-12), ("exudyn", 1e-6)])
def test_states_are_those_of_the_simulation_that_made_the_response(simulator: str, bound: float) -> None:
    scene = scenes.load(WORKFLOWS / "boom_beam.toml", [*SMALL, f"simulation.simulators=['{simulator}']"])
    reduction, steps, excitation = reduce(scene), np.array([0, 50, 200]), Excitation.of(scene)
    found = simulate(scene, reduction.system, excitation, steps=steps.tolist()).first.states[ALONE]
    expected = march.simulate(reduction.reduced, excitation).at(steps)
    states = {"t": found.t, "s": found.s[:, 0], "q": found.p, "v": found.v, "multipliers": found.multipliers}
    for name, here in states.items():
        there = getattr(expected, name)
        assert here.shape == there.shape and np.abs(here - there).max() <= bound * np.abs(there).max(), name
