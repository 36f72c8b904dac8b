from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import exudyn as exu
import numpy as np
import one_body
import pytest
from driving import driven, named
from one_body import LOADS, PATH, STEPPING, Simulate, some_state
from oracle import flexible, full_body, generalized_alpha, project, started
from own_mbs import OwnSystem

from pmr import InputError, ReducedModel, SimulationError
from pmr.files.arrays import Array
from pmr.scene import Simulation
from pmr.scene.signals import Constant, Ramp, Step
from pmr.simulation import TimeStepping
from pmr.simulation.exudyn import Formulation, contacts, items, simulator
from pmr.simulation.exudyn.solver import read_sensor
from pmr.system.assembly import Assembly
from pmr.system.body import FullBody, SlidingBody, Trajectory
from pmr.system.rows import Rows
from pmr.system.states import ContactRows

#: Against an integrator of the test's own, relative.
TOLERANCES = {"springs": 1e-11, "callbacks": 5e-8}


@pytest.fixture(params=TOLERANCES)
def simulate(request: pytest.FixtureRequest) -> Simulate:
    """Both ways of having Exudyn know rows and loads."""
    return partial(one_body.in_exudyn, formulation=request.param)


@pytest.fixture(params=["sparse", "dense"])
def body(rich: FullBody, request: pytest.FixtureRequest) -> SlidingBody:
    return rich if request.param == "sparse" else project(rich, np.eye(rich.size)[:, 2:])


def assert_same(found: Trajectory, q: Array, v: Array, multipliers: Array, tolerance: float) -> None:
    for a, b in ((found.q, q), (found.v, v), (found.multipliers, multipliers)):
        np.testing.assert_allclose(a, b, rtol=0.0, atol=tolerance * np.abs(b).max())


def test_same_as_an_integrator_written_for_the_test(body: SlidingBody, simulate: Simulate) -> None:
    """Two sliders, two inputs, damping, a start that must be corrected, and rows that move from the start."""
    initial = some_state(body)
    found = simulate(body, driven(PATH, LOADS, STEPPING), initial)
    t = STEPPING.times
    f = np.stack([load.value(t) for load in LOADS], axis=1)
    start = started(body, float(PATH.value(0.0)), float(PATH.rate(0.0)), initial)
    tolerance = TOLERANCES[simulate.keywords["formulation"]]
    assert_same(found, *generalized_alpha(body, PATH.value(t), f, STEPPING, start), tolerance)
    np.testing.assert_array_equal(found.t, t)
    np.testing.assert_allclose(found.s, PATH.value(t))
    assert found.seconds > 0.0


def test_rows_hold_at_every_step(body: SlidingBody) -> None:
    found = one_body.in_exudyn(body, driven(PATH, LOADS, STEPPING))
    assert np.abs(body.apply_rows(found.s, found.q)).max() < 1e-14
    assert np.abs(found.q).max() > 1e-4


def test_modified_newton_finds_the_same_beam(case: Any, reduced: ReducedModel) -> None:
    stepping, path = TimeStepping(0.3, 1e-3), Ramp(times=(0.0, 0.3), values=(1.25, 2.0))
    once, called = (
        one_body.in_exudyn(reduced, driven(path, [case.load], stepping), formulation=way)
        for way in ("springs", "callbacks-modified-newton")
    )
    w = once.q @ reduced.outputs.T
    assert np.abs(w - called.q @ reduced.outputs.T).max() < 1e-9
    assert np.abs(w).max() > 1e-4


@pytest.mark.slow
def test_second_order_from_a_moving_start(rich: FullBody) -> None:
    """Although the initial acceleration leaves out the rows' own motion."""
    body = project(rich, np.linalg.qr(np.vander(rich.output_positions.repeat(3), 8)[:, ::-1])[0])
    fine, *coarse = (
        one_body.in_exudyn(body, driven(PATH, LOADS[:1] * 2, TimeStepping(0.2, h)), some_state(body))
        for h in (1e-5, 1e-3, 5e-4)
    )
    errors = [np.abs(c.q - fine.q[:: round(c.t[1] / 1e-5)]).max() for c in coarse]
    assert 3.5 < errors[0] / errors[1] < 4.5


def test_energies_come_in_blocks(rich: FullBody, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = one_body.in_exudyn(rich, driven(PATH, LOADS, STEPPING))
    blocks, along = [], Assembly.contact_rows_over_time

    def recorded(assembly: Assembly, x: Array, effects: bool = True) -> ContactRows:
        blocks.append(len(x))
        return along(assembly, x, effects)

    monkeypatch.setattr(contacts, "ENTRIES", 7 * 2 * (rich.size - len(rich.held)))  # two of its four rows move
    monkeypatch.setattr(Assembly, "contact_rows_over_time", recorded)
    found = one_body.in_exudyn(rich, driven(PATH, LOADS, STEPPING))
    np.testing.assert_array_equal(found.q, whole.q)
    assert max(blocks) < 7 and found.surplus == pytest.approx(whole.surplus, abs=1e-12)


def test_progress_is_told_about_a_hundred_times_and_ends_at_one(rich: FullBody) -> None:
    shares: list[float] = []
    stepping = TimeStepping(0.4, 1e-3)
    one_body.in_exudyn(rich, driven(PATH, LOADS, stepping), progress=shares.append)
    assert shares == pytest.approx(np.arange(1, 101) / 100)


def test_dependent_rows_fail_with_time_and_place(
    body: SlidingBody, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    if isinstance(body, FullBody):
        twice = replace(body, rows=Rows((*body.rows.rows, replace(body.rows.rows[2], name="slider again")), body.size))
    else:
        rows = type(body.rows)(np.concatenate([body.rows.c, body.rows.c[:, :, :1]], axis=2), body.rows.x)
        twice = replace(body, rows=rows, row_names=("slider 0", "slider 0.8", "slider again"))
    with pytest.raises(SimulationError, match=r"t = 0\.001 s, slider at 2\.00352 m: .*rows that depend"):
        one_body.in_exudyn(twice, driven(PATH, LOADS, STEPPING))
    assert capfd.readouterr() == ("", "")
    if isinstance(body, FullBody):  # the sparse solver sees it before the first step
        assert "System Jacobian seems to be singular" in caplog.text


def test_an_overflow_fails_with_time_and_place(rich: FullBody) -> None:
    with pytest.raises(SimulationError, match=r"t = 0\.1 s, slider at 2\.337\d* m"):
        one_body.in_exudyn(rich, driven(PATH, [LOADS[0], Step(time=0.1, after=1e308)], STEPPING))


class StoredData:
    """An mbs whose sensor stored what is given."""

    def __init__(self, values: Array) -> None:
        self.GetSensorStoredData = lambda sensor: np.column_stack([np.arange(len(values)), values])


def test_only_complete_and_finite_results_count() -> None:
    def place(t: float) -> str:
        return f", slider at {PATH.value(t):g} m"

    values = np.ones((STEPPING.steps + 1, 2))
    np.testing.assert_array_equal(read_sensor(StoredData(values), 0, STEPPING, place), values)
    with pytest.raises(SimulationError, match="200 of 201 steps"):
        read_sensor(StoredData(values[1:]), 0, STEPPING, place)
    values[7, 1] = np.nan
    with pytest.raises(SimulationError, match=r"t = 0\.007 s, slider at 2\.02\d* m: not finite"):
        read_sensor(StoredData(values), 0, STEPPING, place)


def test_nothing_is_printed_or_written(
    rich: FullBody, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    one_body.in_exudyn(rich, driven(PATH, LOADS, STEPPING))
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
@pytest.mark.parametrize("formulation", ["springs", "callbacks"])
def test_several_bodies_share_a_users_system(body: SlidingBody, formulation: Formulation) -> None:
    add = partial(simulator.add_sliding_body, formulation=formulation)
    other = project(full_body(elements=4), np.eye(15)[:, 2:])
    other_path, other_load = Constant(amount=1.0), Constant(amount=20.0)
    before, after = [], []
    own = OwnSystem(STEPPING)
    own.mbs.SetPreStepUserFunction(lambda mbs, t: not before.append(t))
    first = add(own.mbs, body, PATH, named(LOADS, body.input_names))
    second = add(own.mbs, other, other_path, {"F": other_load})
    items.add_pre_step_function(own.mbs, lambda mbs, t: not after.append(t))
    q, q_other = own.solve(own.coordinates(first.nBody), own.coordinates(second.nBody))
    np.testing.assert_allclose(before, STEPPING.times[1:])
    assert after == before
    alone = one_body.in_exudyn(body, driven(PATH, LOADS, STEPPING)).q
    alone_other = one_body.in_exudyn(other, driven(other_path, [other_load], STEPPING)).q
    free = np.setdiff1d(np.arange(body.size), list(body.held.values()))
    np.testing.assert_allclose(q, alone[:, free], rtol=0.0, atol=1e-7 * np.abs(alone).max())
    np.testing.assert_allclose(q_other, alone_other, rtol=0.0, atol=1e-7 * np.abs(alone_other).max())


def test_any_pre_step_function_stops_the_simulation(rich: FullBody) -> None:
    own = OwnSystem(STEPPING)
    own.mbs.SetPreStepUserFunction(lambda mbs, t: t < 0.05)
    body = simulator.add_sliding_body(own.mbs, rich, PATH, named(LOADS))
    (q,) = own.solve(own.coordinates(body.nBody))
    assert len(q) == 51


@pytest.mark.parametrize("formulation", ["springs", "multipliers"])
def test_a_users_own_pre_step_function_never_replaces_the_bodys_in_silence(
    rich: FullBody, formulation: Formulation
) -> None:
    """The slider would stay where it is, and the loads as they are."""
    for body in (rich, flexible(rich, 6)):
        own = OwnSystem(STEPPING)
        simulator.add_sliding_body(own.mbs, body, PATH, named(LOADS, body.input_names), formulation=formulation)
        own.mbs.SetPreStepUserFunction(lambda mbs, t: True)
        own.mbs.Assemble()
        with pytest.raises(ValueError, match=r"SetPreStepUserFunction: .* add_pre_step_function\(mbs, function\)"):
            own.solve_again()


def test_solvers_that_a_body_cannot_follow_are_refused(rich: FullBody) -> None:
    """Explicit ones evaluate within a step; velocities of index 2 know nothing of rows that move."""
    explicit = exu.DynamicSolverType.DOPRI5, flexible(rich, 6), "solverType = 'explicit': an implicit one"
    index_2 = exu.DynamicSolverType.TrapezoidalIndex2, rich, r"useIndex2Constraints = True: false \(GeneralizedAlpha\)"
    for solver, body, says in (explicit, index_2):
        own = OwnSystem(STEPPING)
        simulator.add_sliding_body(own.mbs, body, PATH, named(LOADS, body.input_names))
        own.mbs.Assemble()
        with pytest.raises(ValueError, match=says):
            own.solve_again(solver=solver)
    still = OwnSystem(STEPPING)
    simulator.add_sliding_body(still.mbs, rich, PATH, named(LOADS))
    still.mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    with pytest.raises(ValueError, match="SolveStatic: SolveDynamic is allowed"):
        still.mbs.SolveStatic(settings)
    without_rows = OwnSystem(STEPPING)
    simulator.add_sliding_body(without_rows.mbs, explicit[1], PATH, named(LOADS, explicit[1].input_names))
    without_rows.mbs.Assemble()
    without_rows.solve_again(solver=index_2[0])


@pytest.mark.slow
def test_update_rewinds_for_a_second_solve(rich: FullBody) -> None:
    own = OwnSystem(STEPPING)
    items = simulator.add_sliding_body(own.mbs, rich, PATH, named(LOADS))
    (once,) = own.solve(own.coordinates(items.nBody))
    items.update(own.mbs, 0.0)
    (again,) = own.solve_again(0)
    np.testing.assert_array_equal(again, once)


def test_newtons_method_takes_exudyns_own_settings(rich: FullBody) -> None:
    """A single iteration is too few for a tolerance that nothing meets, and enough for one that anything does."""
    excitation = driven(PATH, LOADS, TimeStepping(end=0.02, step=1e-3))
    few = {"maxIterations": 1, "relativeTolerance": 1e-300, "absoluteTolerance": 1e-300}
    with pytest.raises(SimulationError, match="Newton's method does not converge"):
        one_body.in_exudyn(rich, replace(excitation, options=Simulation(newton=few)))
    found = one_body.in_exudyn(
        rich, replace(excitation, options=Simulation(newton={"relativeTolerance": 1.0, "absoluteTolerance": 1.0}))
    )
    assert found.t[-1] == 0.02
    for wrong, said in (({"tolerance": 1e-9}, "one of .*relativeTolerance"), ({"maxIterations": 0.5}, "maxIterations")):
        with pytest.raises(InputError, match=said) as refused:
            one_body.in_exudyn(rich, replace(excitation, options=Simulation(newton=wrong)))
        assert refused.value.key == f"simulation.newton.{next(iter(wrong))}" and "\n" not in str(refused.value)
