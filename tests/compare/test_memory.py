from __future__ import annotations

import logging
import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest

from pmr.compare.responses import BYTES, NUMBERS_BESIDE, check_memory, needed_bytes, simulate_by
from pmr.errors import InputError, environment
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.simulation.native import march as marching
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.stepping import Recorder
from pmr.system.body import FullBody
from pmr.system.system import System

LONG = ["time.step=1.5e-5", "compare.against=['full']"]


def test_a_run_that_does_not_fit_is_refused_before_it_begins(load_scene) -> None:
    scene = load_scene("paper_evolved", LONG)
    with pytest.raises(InputError, match=r"1,000,000 steps take about 3.\d GB .*, 2.0 GB are free; at most") as caught:
        check_memory(scene, 153, 51, 2 * 10**9)
    assert caught.value.key == "time.step"


def test_a_large_one_is_told_of_and_a_small_one_is_not(load_scene, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        check_memory(load_scene("paper_evolved"), 153, 51, 2 * 10**9)
        assert not caplog.records
        check_memory(load_scene("paper_evolved", LONG), 153, 51, None)
    assert "1,000,000 steps take about" in caplog.text


def test_memory_grows_with_steps_and_with_the_model_that_keeps_its_states(load_scene) -> None:
    small, large = (load_scene("paper_evolved", [f"time.step={step}", *LONG[1:]]) for step in ("1e-3", "5e-4"))
    assert needed_bytes(large, 153, 51) / needed_bytes(small, 153, 51) == pytest.approx(2.0, rel=1e-3)
    assert needed_bytes(small, 350, 51) == needed_bytes(small, 153, 51)
    in_exudyn = load_scene("paper_evolved", [*LONG[1:], "simulation.full=exudyn"])
    more = needed_bytes(in_exudyn, 350, 51) - needed_bytes(in_exudyn, 153, 51)
    assert more >= 2 * BYTES * in_exudyn.time.steps * (350 - 153)  # coordinates and their rates at least


def test_the_machine_says_what_is_free() -> None:
    free = environment.available_memory()
    assert free is None if not environment.MEMINFO.exists() else free > 2**20


@pytest.fixture
def short_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs are longer than what is evaluated at once, so the room for that is in none of their difference."""
    monkeypatch.setattr(marching, "BLOCK", 1024)


def _a_step(load_scene, run: Callable[[object], object]) -> float:
    """Bytes that each step adds to what a run has allocated at its peak."""
    peaks, steps = [], []
    for step in ("2e-3", "1e-3"):
        scene = load_scene("paper_evolved", [f"time.step={step}", *LONG[1:]])
        run(scene)  # compiles and loads what is used for the first time
        tracemalloc.start()
        try:
            run(scene)
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
        steps.append(scene.time.steps)
    return (peaks[1] - peaks[0]) / (steps[1] - steps[0])


@pytest.mark.slow
@pytest.mark.usefixtures("short_blocks")
def test_a_response_is_made_without_the_states_of_all_steps(load_scene, full: FullBody) -> None:
    found = _a_step(
        load_scene, lambda scene: simulate_by(scene, System.of(full), Excitation.from_scene(scene), "march")
    )
    states = BYTES * 2 * full.size
    outputs = BYTES * len(full.output_positions)
    assert outputs < found < min(states, 2.0 * outputs)
    scene = load_scene("paper_evolved", LONG)
    assert found < needed_bytes(scene, full.size, len(full.output_positions)) / scene.time.steps


@pytest.mark.slow
@pytest.mark.usefixtures("short_blocks")
def test_states_at_a_few_steps_don_t_take_those_of_all(load_scene, full: FullBody) -> None:
    def run(scene: Scene) -> None:
        recorder = Recorder(np.arange(0, 7001, 1000))
        form = SystemForm.of(System.of(full))
        recorder.trajectory(systems.follow(marching.March(form, Excitation.from_scene(scene), {}), recorder))

    found = _a_step(load_scene, run)
    assert found < BYTES * NUMBERS_BESIDE
