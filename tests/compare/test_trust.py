"""What is no reference, what no linear model describes, and what does not fit into memory: the run says so, and why."""

import logging
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmr import InputError, Response, SimulationError, System, run
from pmr import scene as scenes
from pmr.compare.responses import BYTES, NUMBERS_BESIDE, check_memory, needed_bytes, simulate_by
from pmr.compare.trust import ALTERNATING, distrust_warnings, missing_reference_warnings, reason_for_distrust
from pmr.errors import environment
from pmr.fem.compat import MPI
from pmr.files import npz
from pmr.fullmodel.build import full_model
from pmr.pipeline.full_order import FullOrder
from pmr.report import errors
from pmr.report.sections import chapter
from pmr.results import Energy
from pmr.scene import Scene
from pmr.scene.keys import ALONE
from pmr.simulation import Excitation
from pmr.simulation.native import systems
from pmr.simulation.native import systems as marching
from pmr.simulation.native.form import SystemForm
from pmr.simulation.stepping import Recorder
from pmr.studies import tasks
from pmr.system.body import FullBody

T = np.arange(200) * 1e-3

#: 3.7 m/s on a coarse beam: with rho_inf = 0.9 all is well, with 0.999 the full model grows by tens of decades.
FAST = (
    "time.end=2.0",
    "mesh.elements=16",
    "slider.path={kind='ramp',times=[0.05,1.0,1.95],values=[0.7,4.2,0.7]}",
    "reduction.coordinates=8",
)

GROWN = (*FAST, "time.rho_inf=0.999")


def response(displacement: np.ndarray, surplus: float = np.nan) -> Response:
    nothing = np.zeros(len(displacement))
    energy = Energy(nothing, nothing, nothing)
    return Response(
        T, np.zeros(1), displacement[:, None], energy, nothing[:, None], nothing, nothing, 0.0, surplus=surplus
    )


def test_what_can_be_trusted() -> None:
    smooth = np.sin(20.0 * T)
    assert reason_for_distrust(response(smooth)) is reason_for_distrust(response(smooth, 0.05)) is None
    assert "12 % of its largest energy" in str(reason_for_distrust(response(smooth, 0.12)))
    assert "overflows" in str(reason_for_distrust(response(smooth, np.inf)))
    assert "not finite" in str(reason_for_distrust(response(np.full(200, np.nan), 0.0)))
    shaken = smooth + 3.0 * ALTERNATING * (-1.0) ** np.arange(200)
    assert "changes its sign with every step" in str(reason_for_distrust(response(shaken)))


def test_warnings() -> None:
    smooth = np.sin(20.0 * T)
    assert missing_reference_warnings({}) == distrust_warnings(response(smooth, 0.01)) == []
    [reference], [reduced] = missing_reference_warnings({"ancf": "it broke"}), distrust_warnings(response(smooth, 0.3))
    assert reference == "no reference by the ANCF cable: it broke"
    assert reduced.startswith("the reduced model's motion is not to be trusted: 30 % of its largest energy")


@pytest.mark.slow
def test_a_run_without_reference_says_so(load_scene) -> None:
    outcome = run(load_scene("evolved_residual", GROWN), MPI.COMM_SELF)
    assert outcome is not None
    result, summary = outcome.result, outcome.result.summary
    assert "grows without bound" in summary["no_reference"]["full"]
    assert summary["errors"] == {}
    assert summary["max_error"] is None
    assert summary["max_displacement"] < 0.1
    assert list(result.responses) == ["reduced"]
    [warning] = [warning for warning in summary["warnings"] if warning.startswith("no reference by the full model")]
    assert "rho_inf" in warning
    table = errors.rows(result)
    assert [row.comparison for row in table if row.value == "no reference"] == ["reduced against full"]
    shown = chapter(result, "case-1")
    assert [warning] == [line for line in shown.notices.warnings if "no reference" in line]
    assert "times the true error" not in " ".join(text for table in shown.first for row in table.rows for text in row)


@pytest.mark.slow
def test_the_same_run_with_a_reference_has_one(load_scene) -> None:
    outcome = run(load_scene("evolved_residual", FAST), MPI.COMM_SELF)
    assert outcome is not None
    summary = outcome.result.summary
    assert summary["no_reference"] == {}
    assert summary["errors"]["reduced_vs_full"]["beam"] < 0.01
    assert outcome.result.responses["full"].surplus < 0.01


@pytest.mark.mpi
@pytest.mark.parametrize("simulator", ["march", "petsc"])
def test_every_rank_knows_that_there_is_none(load_scene, simulator: str) -> None:
    fast = "slider.path={kind='ramp',times=[0.02,0.22,0.42],values=[0.7,4.2,0.7]}"
    few = ["time.end=0.3", "mesh.elements=8", fast, "reduction.coordinates=8", "time.rho_inf=0.999"]
    scene = load_scene("evolved_residual", [*few, f"simulation.full={simulator}"])
    full = FullOrder.join(scene, {ALONE: full_model(scene)})
    found = full.references(steps=[0, 20])
    assert found.responses == found.states == {}
    assert "grows without bound" in found.missing["full"]
    with pytest.raises(SimulationError, match="grows without bound"):
        full.reference("full")


def test_a_cable_that_fails_is_no_reference_either(load_scene) -> None:
    case = [
        *GROWN, "body.profile.axial=true", "compare.against=['ancf']", "compare.ancf_elements=8", "time.rho_inf=1.0",
    ]  # fmt: skip
    scene = load_scene("evolved_residual", case)
    found = FullOrder.join(scene, {ALONE: full_model(scene)}).references()
    assert found.responses == {}
    assert "ANCF" not in found.missing["ancf"]
    assert "rho_inf" in found.missing["ancf"]


@pytest.mark.slow
def test_a_reduced_motion_that_grows_is_no_result(load_scene) -> None:
    """The paper's basis keeps its slider rigid: index 3 here too."""
    scene = load_scene("paper_evolved", [*GROWN[:3], "compare.against=[]", "time.rho_inf=0.9999"])
    with pytest.raises(InputError, match=r"time\.rho_inf = 0\.9999: a smaller one is allowed: .*grows without bound"):
        run(scene, MPI.COMM_SELF)


def test_a_study_takes_no_such_reference(load_scene) -> None:
    scene = load_scene("evolved_residual", GROWN)
    task = tasks.reference_task(scene, "full")
    with pytest.raises(SimulationError, match="grows without bound"):
        task.function(task.arguments, {})


def test_responses_keep_their_surplus() -> None:
    found = response(np.sin(T), 0.25)
    assert npz.record_from_arrays(Response, npz.record_arrays(found)).surplus == 0.25
    older = {name: array for name, array in npz.record_arrays(found).items() if name != "surplus"}
    assert np.isnan(npz.record_from_arrays(Response, older).surplus)
    assert replace(found, surplus=np.inf).surplus == np.inf


SHORT = ["mesh.elements=8", "reduction.snapshots=3", "reduction.modes=3", "reduction.coordinates=6", "time.end=0.4"]

SHORT += ["time.step=4e-3", "slider.path=2.5", "compare.against=[]", "simulation.simulators=['march']"]


@pytest.mark.slow
@pytest.mark.parametrize(("force", "times"), [(-50.0, None), (-5e7, True), (-5e4, True)])
def test_a_motion_as_large_as_the_body_is_said(force: float, times: bool | None) -> None:
    scene = scenes.load(Path("workflows/paper_simple.toml"), [*SHORT, f"loads=[{{on=5.0,signal={force!r}}}]"])
    outcome = run(scene)
    assert outcome is not None
    said = [line for line in outcome.result.summary["warnings"] if "theory of small motions" in line]
    assert len(said) == (1 if times else 0)
    if times:
        assert outcome.result.summary["max_displacement"] > 0.5


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
