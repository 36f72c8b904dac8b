"""The error of the time step, against runs with far smaller steps, closed forms, and another simulator.
The error of the time step on random scenes with steps ten times as long, against runs with far smaller ones.

Eight scenes as a rule; ``PMR_SWEEP=full`` takes 60.
"""

import os
from dataclasses import replace
from warnings import catch_warnings, simplefilter

import numpy as np
import one_body
import pytest
from alone import step_error
from driving import Loads, driven, loads_at
from one_body import displacement
from oracle import flexible, full_body, paper_basis, project, rich_body
from random_scenes import random_scene

from pmr import ReducedModel, SimulationError, reduce, run, simulate
from pmr import scene as scenes
from pmr.compare import step_error as step_errors
from pmr.compare.error_parts import step_summary, step_warnings
from pmr.compare.errors import relative_error
from pmr.compare.outputs import run_from_start
from pmr.compare.step_error import NEGLIGIBLE, SETTLED, STEP_LIMIT, ConvergenceSeries, StepError
from pmr.compare.stepped_runs import SteppedSystem
from pmr.report import trust
from pmr.report.blocks import Chapter
from pmr.report.sections import chapter
from pmr.scene import Scene
from pmr.scene.signals import Chirp, Constant, SignalBase, Sine, SmoothRamp, Sum
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.contact_step import contact_frequency, count_parts
from pmr.simulation.native import systems

PATH = SmoothRamp(times=(0.1, 0.8), values=(1.5, 3.0))
SLOW = Sine(amplitude=50.0, frequency=2.0)
REST = Constant(amount=2.0)


def outputs(model: ReducedModel, path: SignalBase, loads: Loads, stepping: TimeStepping, simulate=one_body.simulate):
    run_ = simulate(model, driven(path, loads, stepping))
    f = loads_at(loads, run_.t)
    return displacement(model, run_.q, run_.s, run_.multipliers, f)


def true_error(model: ReducedModel, path: SignalBase, loads: Loads, stepping: TimeStepping, finer: int) -> float:
    fine = TimeStepping(stepping.end, stepping.step / finer, stepping.rho_inf)
    y, reference = (outputs(model, path, loads, one) for one in (stepping, fine))
    return relative_error(y, reference[::finer])


FULL = full_body(12)
MODELS = {
    "residual flexibility": (flexible(FULL, 5), SLOW),
    "rigid rows": (project(FULL, paper_basis(FULL, 3, 4, 9)), SLOW),
    "two sliders, damped": (flexible(rich_body(), 6), (SLOW, Constant(amount=20.0))),
}


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("step", [1e-3, 1e-2])
@pytest.mark.parametrize("name", MODELS)
def test_it_is_the_error_against_far_smaller_steps(name: str, step: float) -> None:
    model, loads = MODELS[name]
    stepping = TimeStepping(1.0, step)
    found = step_error(model, driven(PATH, loads, stepping))
    assert found.settled and found.by == "motion" and found.finest <= step / 4
    # what settles is known to a quarter, and what is left out beyond the finest run is as small
    assert found.errors["beam"] == pytest.approx(
        true_error(model, PATH, loads, stepping, round(2e-2 / 1e-3) * 8), rel=0.3
    )
    assert found.seconds > 0.0 and found.largest is not None and found.largest > 0.0


def test_exudyn_makes_the_same_error(load_scene) -> None:
    model, stepping = MODELS["residual flexibility"][0], TimeStepping(0.4, 1e-2)
    by_exudyn = outputs(model, PATH, SLOW, stepping, one_body.in_exudyn)
    fine = outputs(model, PATH, SLOW, TimeStepping(0.4, 1e-2 / 64))[::64]
    assert step_error(model, driven(PATH, SLOW, stepping)).errors["beam"] == pytest.approx(
        relative_error(by_exudyn, fine), rel=0.3
    )


def test_a_coarse_step_is_said_with_the_band_of_load_and_motion() -> None:
    model, stepping = MODELS["residual flexibility"][0], TimeStepping(10.0, 0.5)
    load = Chirp(amplitude=50.0, times=(0.0, 10.0), frequencies=(0.5, 5.0))
    found = step_error(model, driven(REST, load, stepping))
    assert found.errors["beam"] > 0.3 and found.settled and 2.0 < found.band < 20.0
    natural = np.array([[2.0, 60.0], [1.0, 50.0]])
    (line,) = step_warnings(found, stepping, [("load F", load)], natural)
    for words in ("step of 0.5 s is too coarse", "load F goes up to 5 Hz, 0.4 steps a period", "the motion goes up to",
                  "number 1, 1 Hz and above", "bring the error below 2 %"):  # fmt: skip
        assert words in line
    with catch_warnings():  # of modes that a reduced model hasn't at any place
        simplefilter("error")
        fewer = np.column_stack([natural, [np.nan, np.nan]])
        assert step_warnings(found, stepping, [("load F", load)], fewer) == [line]
    assert found.enough is not None and true_error(model, REST, load, TimeStepping(10.0, found.enough), 16) < STEP_LIMIT
    fine = TimeStepping(10.0, found.enough)
    assert step_warnings(step_error(model, driven(REST, load, fine)), fine, [("load F", load)], natural) == []


def test_two_runs_that_both_miss_a_tone_are_not_believed() -> None:
    """8 Hz are nothing at steps of 1/2, 1/4 and 1/8 s: three runs in which nothing moves."""
    model, load = MODELS["residual flexibility"][0], Sine(amplitude=50.0, frequency=8.0)
    found = step_error(model, driven(REST, load, TimeStepping(4.0, 0.5)))
    assert found.settled and found.finest < 1 / 16 and found.errors["beam"] > 0.9


def test_a_tone_beyond_all_steps_leaves_the_error_unknown() -> None:
    model, stepping = MODELS["residual flexibility"][0], TimeStepping(1.0, 1e-3)
    load = Sine(amplitude=50.0, frequency=1.024e9)
    found = step_error(model, driven(PATH, load, stepping))
    assert not found.settled and found.enough is None
    (line,) = step_warnings(found, stepping, [("load F", load)], np.empty((0, 0)))
    assert "at least" in line and "don't settle it" in line


PUSHED = {  # the beam swings about its pin, and bounces on the slider under it
    "motion": Sine(amplitude=2000.0, frequency=7.0),
    "mean": Sum(terms=(Constant(amount=300.0), Sine(amplitude=2000.0, frequency=3.3))),
}


@pytest.mark.slow
@pytest.mark.parametrize("by", PUSHED)
def test_where_rows_only_push_and_runs_part_the_mean_is_compared(by: str) -> None:
    model = replace(flexible(FULL, 5), clearance=np.zeros(1))
    stepping = TimeStepping(10.0, 1e-3, parts=1)
    found = step_error(model, driven(REST, PUSHED[by], stepping))
    assert found.by == by and (found.largest is None) == (by == "mean") and found.errors["beam"] > 1e-3
    if by == "mean":
        (line,) = step_warnings(found, stepping, [], np.empty((0, 0)))
        assert "in the mean (motions part after an impact" in line
    else:  # a run that chooses the parts of its steps, against shorter steps in as many parts throughout
        given = TimeStepping(10.0, 1e-3)
        said, loads = step_error(model, driven(REST, PUSHED[by], given)), (PUSHED[by],)
        y, fine = (outputs(model, REST, loads, one) for one in (given, TimeStepping(10.0, 2.5e-4, parts=32)))
        assert 0.8 <= said.errors["beam"] / relative_error(y, fine[::4]) <= 2.0


def test_what_is_round_off_has_no_error() -> None:
    """A load on top of the slider moves nothing but the last digits."""
    model = flexible(full_body(20), 6)
    found = step_error(
        model, driven(Constant(amount=5.0), Sine(amplitude=50.0, frequency=5.0), TimeStepping(2.0, 1e-2))
    )
    assert (found.errors["beam"], found.errors["tip"], found.settled) == (0.0, 0.0, True)


def test_where_the_tip_rests_the_band_is_that_of_the_beam() -> None:
    """The slider stands below the tip; what moves is the span between it and the pin."""
    full = full_body(20)
    B = np.zeros((full.size, 1))
    B[31, 0] = 1.0  # in the middle
    load = SmoothRamp(times=(0.0, 0.05, 0.1, 4.0), values=(0.0, 50.0, 0.0, 0.0))
    found = step_error(flexible(replace(full, B=B), 6), driven(Constant(amount=5.0), load, TimeStepping(4.0, 1e-3)))
    assert found.errors["tip"] == 0.0 and 1.0 < found.band < 100.0


def test_a_small_error_that_is_not_settled_is_not_called_too_coarse() -> None:
    found = StepError({"beam": 1e-2, "tip": 2e-2}, None, 1e-4, False, "mean", None, 5.0, 0.1)
    (line,) = step_warnings(found, TimeStepping(1.0, 1e-3), [], np.empty((0, 0)))
    assert "has an error that is not settled: it is at least 1 %" in line and "too coarse" not in line
    assert step_warnings(replace(found, settled=True), TimeStepping(1.0, 1e-3), [], np.empty((0, 0))) == []


def test_a_run_too_long_to_be_repeated_is_said(monkeypatch) -> None:
    monkeypatch.setattr("pmr.compare.stepped_runs.LONGEST", 1000)
    with pytest.raises(SimulationError, match="half the step is too long"):
        step_error(MODELS["residual flexibility"][0], driven(PATH, SLOW, TimeStepping(1.0, 1e-3)))


def test_nothing_moves_and_nothing_is_wrong() -> None:
    found = step_error(MODELS["rigid rows"][0], driven(PATH, Constant(amount=0.0), TimeStepping(1.0, 1e-2)))
    assert (found.errors["beam"], found.errors["tip"], found.largest, found.band, found.settled) == (
        0.0,
        0.0,
        0.0,
        0.0,
        True,
    )


def test_second_order_is_summed_to_its_end() -> None:
    """y_h = y (1 + h^2): the error of h = 1 is one, and that of h = 1/8 below 2 %."""
    y = np.random.default_rng(3).normal(size=(50, 4))
    ladder = ConvergenceSeries(relative_error, 2.0 * y)
    for k in (1, 2):
        ladder.add(y * (1.0 + 4.0**-k))
    assert ladder.is_settled and ladder.error() == pytest.approx(1.0, rel=0.1)
    assert ladder.halvings_needed(0.02) is None
    ladder.add(y * (1.0 + 4.0**-3))
    assert ladder.halvings_needed(0.02) == 3 and ladder.halvings_needed(0.3) == 1
    grows = ConvergenceSeries(relative_error, y)
    for k in (2.0, 4.0, 8.0):
        grows.add(k * y)
    assert not grows.is_settled and grows.halvings_needed(0.5) is None
    assert not grows.is_decreasing and grows.error_bound == pytest.approx(
        7.0 / 8.0 + 4.0 / 8.0
    )  # of the finest, and the last one
    noise = ConvergenceSeries(relative_error, y)
    for k in (1.0, -2.0, 3.0):
        noise.add(y * (1.0 + k * 1e-5))
    assert noise.is_settled and noise.is_decreasing and noise.error() == pytest.approx(3e-5, rel=0.01)


def test_what_the_summary_holds() -> None:
    found = StepError({"beam": 0.3, "tip": 0.2}, None, 1e-4, False, "mean", None, 5.0, 0.1)
    figures = step_summary(found)
    assert figures["beam"] == 0.3 and figures["limit"] == STEP_LIMIT and figures["reason"] is None
    without = step_summary(None, "stopped")
    assert without["beam"] is None and without["reason"] == "stopped" and set(without) == set(figures)
    with_forces = step_summary(
        replace(found, errors={**found.errors, "reaction": 0.4}, unsettled=("reaction",)), not_covered=["stresses"]
    )
    assert with_forces == {**figures, "reaction": 0.4, "not_covered": ["stresses"], "unsettled": ["reaction"]}


def test_a_step_that_is_far_off_in_another_kind_alone_is_a_warning() -> None:
    errors = {"beam": 1e-3, "tip": 1e-3, "pad_force": 0.05, "velocity": 0.3}
    found = StepError(errors, None, 1e-4, True, "motion", 1e-3, 5.0, 0.1)
    (said,) = step_warnings(found, TimeStepping(1.0, 1e-3), [], np.empty((1, 0)))
    assert said == "the time step of 0.001 s is off by 30 % in velocities, as steps of 0.0001 s show"
    small = replace(found, errors=errors | {"velocity": 0.05})
    assert step_warnings(small, TimeStepping(1.0, 1e-3), [], np.empty((1, 0))) == []


COARSE = ["time.end=1.0", "mesh.elements=20", "slider.path={kind='ramp',times=[0.1,0.9],values=[1.25,1.6]}",
          "loads=[{name='F',on=5.0,signal={kind='sine',amplitude=50.0,frequency=5.0}}]"]  # fmt: skip


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("name", ["evolved_residual", "paper_evolved"])
def test_a_run_whose_step_is_too_coarse_by_ten_says_so(load_scene, name: str) -> None:
    def with_step_of(step: float) -> tuple[dict, Chapter]:
        scene = load_scene(name, [*COARSE, f"time.step={step}", "compare.against=['full']"])
        outcome = run(scene)
        assert outcome is not None
        return outcome.result.summary, chapter(outcome.result, "case-1")

    fine, coarse = with_step_of(2e-3), with_step_of(2e-2)
    assert fine[0]["step"]["beam"] < STEP_LIMIT < coarse[0]["step"]["beam"]
    assert [sum("too coarse" in line for line in found["warnings"]) for found, _ in (fine, coarse)] == [0, 1]
    assert coarse[0]["errors"]["reduced_vs_full"]["beam"] < 0.02  # both models miss the same
    for summary_, shown in (fine, coarse):
        assert "displacements" in next(dict(table.rows)["time step"] for table in shown.first if table.bars)
        assert [line.lower() for line in shown.notices.warnings] == [line.lower() for line in summary_["warnings"]]


@pytest.mark.slow
def test_where_march_fails_the_reason_stands_in_place_of_the_figure(load_scene, monkeypatch) -> None:
    def fails(*_: object, **__: object) -> None:
        raise SimulationError("stopped at step 3")

    monkeypatch.setattr("pmr.compare.error_parts.step_error", fails)
    outcome = run(load_scene("evolved_residual", [*COARSE, "simulation.simulators=['march']", "compare.against=[]"]))
    assert outcome is not None
    summary_ = outcome.result.summary
    assert summary_["step"]["beam"] is None and summary_["step"]["reason"] == "stopped at step 3"
    assert any("stopped at step 3" in line for line in summary_["warnings"])
    assert dict(trust.trust_table(outcome.result).rows)["time step"] == "not known: stopped at step 3"


TELESCOPE = (
    "time.end=0.2",
    "section.mesh.elements=12",
    "section.reduction.coordinates=4",
    "sections.fly.loads.0.signal={kind='sine',amplitude=8000.0,frequency=8.0}",
    "section.joint.extension={kind='smooth_ramp',times=[0.0,0.2],values=[1.0,1.3]}",
)


@pytest.mark.slow
def test_of_sections_on_pads_that_push_the_tolerance_of_parts_is_in_it() -> None:
    """The run that chooses the parts of its steps, against steps a quarter as long in as many parts throughout."""
    boom = scenes.load_any("boom_two", TELESCOPE)
    system, excitation = reduce(boom).system, Excitation.from_scene(boom)
    said, given = step_errors.step_error(system, excitation), excitation.stepping
    fine = TimeStepping(
        given.end, given.step / 4.0, given.rho_inf, count_parts(contact_frequency(system, excitation), given)
    )
    y, truth = (
        np.hstack(list(systems.displacements(system, run_from_start(system, excitation.on_grid(one))).values()))
        for one in (given, fine)
    )
    assert 0.8 <= said.errors["beam"] / relative_error(y, truth[::4]) <= 2.0
    stepped = SteppedSystem(system, excitation)
    assert stepped.run is not None and stepped.run.parts is not None
    made = stepped.run.parts[1:]
    for times in (0, 1, 2):  # as many parts in half a step, an impact may come a step earlier or later, and no more
        schedule = np.reshape(stepped.halved_grid(times).schedule, (given.steps, 2**times))
        assert (schedule >= made[:, None]).all() and (schedule[1:] >= made[:-1, None]).all()
        assert (schedule[:-1] >= made[1:, None]).all()
        assert schedule.sum() <= 3 * 2**times * made.sum()


SEEDS = range(60) if os.environ.get("PMR_SWEEP") == "full" else range(8)
COARSE_SWEEP, FURTHER = 10, 4


def with_step(scene: Scene, step: float) -> Scene:
    return scene.model_copy(update={"time": scene.time.model_copy(update={"step": step})})


@pytest.mark.slow
def test_what_settles_is_the_error() -> None:
    """Known to a quarter of itself by the scheme's order, and to what the reference run is off by in turn."""
    lines, settled = [], 0
    for seed in SEEDS:
        given = random_scene(seed)
        scene, model = with_step(given, COARSE_SWEEP * given.time.step), reduce(given).reduced
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
