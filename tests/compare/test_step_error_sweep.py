"""The error of the time step on random scenes with steps ten times as long, against runs with far smaller ones.

Eight scenes as a rule; ``PMR_SWEEP=full`` takes 60.
"""

from __future__ import annotations

import os

import pytest
from alone import step_error
from random_scenes import random_scene

from pmr.compare.errors import relative_error
from pmr.compare.simulated import simulate
from pmr.compare.step_error import NEGLIGIBLE, SETTLED
from pmr.pipeline import reduce
from pmr.scene import Scene
from pmr.simulation import Excitation

SEEDS = range(60) if os.environ.get("PMR_SWEEP") == "full" else range(8)
COARSE, FURTHER = 10, 4


def with_step(scene: Scene, step: float) -> Scene:
    return scene.model_copy(update={"time": scene.time.model_copy(update={"step": step})})


@pytest.mark.slow
def test_what_settles_is_the_error() -> None:
    """Known to a quarter of itself by the scheme's order, and to what the reference run is off by in turn."""
    lines, settled = [], 0
    for seed in SEEDS:
        given = random_scene(seed)
        scene, model = with_step(given, COARSE * given.time.step), reduce(given).reduced
        found = step_error(model, Excitation.from_scene(scene))
        halved = round(scene.time.step / found.finest) * FURTHER
        fine = simulate(with_step(scene, scene.time.step / halved), model).displacement[::halved]
        true = relative_error(simulate(scene, model).displacement, fine)
        lines.append(
            f"{seed}: {found.errors['beam']:.2e} said, {true:.2e} true, settled {found.settled},"
            f" by {found.finest:.1e} s"
        )
        settled += found.settled
        if found.settled:
            assert found.errors["beam"] == pytest.approx(true, rel=2.0 * SETTLED, abs=NEGLIGIBLE), "\n".join(lines)
    assert settled >= 0.8 * len(lines), "\n".join(lines)
