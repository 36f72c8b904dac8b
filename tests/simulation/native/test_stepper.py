"""One step at a time: the same as the simulation, without an allocation."""

import gc
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import one_body
import pytest
from driving import driven
from oracle import Case, full_body, paper_basis, project

from pmr import InputError, ReducedModel, SimulationError, Stepper
from pmr.errors import BEYOND_ENDS
from pmr.simulation import InitialState, TimeStepping
from pmr.simulation.native.driving import Values

STEPPING = TimeStepping(end=0.4, step=1e-3, rho_inf=0.7)


@pytest.fixture(scope="module")
def small() -> ReducedModel:
    full = full_body(elements=8)
    return project(full, paper_basis(full, 3, 3, 7))


def test_steps_are_those_of_the_simulation(reduced: ReducedModel, case: Case) -> None:
    expected = one_body.simulate(reduced, driven(case.path, case.load, STEPPING))
    s, f = case.path.value(STEPPING.times), case.load.value(STEPPING.times)
    stepper = Stepper(reduced, step=1e-3, s=float(s[0]), F=f[0], rho_inf=0.7)
    y = np.array([stepper.step(*now).copy() for now in zip(s[1:], f[1:], strict=True)])
    np.testing.assert_allclose(y, expected.q[1:] @ reduced.outputs.T, atol=1e-15)
    np.testing.assert_allclose(stepper.q, expected.q[-1], atol=1e-15)
    np.testing.assert_allclose(stepper.v, expected.v[-1], atol=1e-13)
    np.testing.assert_allclose(stepper.multipliers, expected.multipliers[-1], rtol=1e-9)
    assert stepper.time == pytest.approx(0.4)


def test_a_start_in_motion_goes_on(small: ReducedModel) -> None:
    C = small.C(2.0)
    q = 1e-3 * np.arange(7.0)
    initial = InitialState(q - np.linalg.pinv(C) @ (C @ q), np.ones(7))
    stepper = Stepper(small, step=1e-3, s=2.0, initial=initial)
    np.testing.assert_allclose(stepper.q, initial.q, atol=1e-14)
    assert np.abs(C @ stepper.v).max() < 1e-12 < np.abs(C @ initial.v).max()


def test_only_the_chosen_outputs_are_returned_always_in_the_same_memory(small: ReducedModel) -> None:
    every, tip = (Stepper(small, step=1e-3, s=2.0, outputs=chosen) for chosen in (None, [8]))
    first = tip.step(2.0, 50.0)
    again = tip.step(2.0, 50.0)
    assert again is first and first.shape == (1,)
    for _ in range(2):
        w = every.step(2.0, 50.0)
    np.testing.assert_allclose(w[8], first[0], rtol=1e-12)


def test_names_forces_and_states_are_those_of_a_system_of_one(small: ReducedModel) -> None:
    """A force among the outputs is found by the loop of all systems, outputs alone by the step on tables."""
    every = Stepper(small, step=1e-3, s=2.0)
    names = every.output_names
    chosen = Stepper(small, step=1e-3, s={"slider": 2.0}, outputs=[names[-1], names[3], 8])
    for s in (2.0, 2.001, 2.003):
        y, found = every.step(s, 50.0), chosen.step({"slider": s}, {"F": 50.0})
    force = every.forces["slider 0"]
    assert names[-1] == "force of slider 0" and every.multipliers.tolist() == [force] and force != 0.0
    np.testing.assert_allclose(found, [force, y[3], y[8]], rtol=1e-9)
    np.testing.assert_allclose(every.outputs, [*y, force], rtol=1e-9)
    again = Stepper(small, step=1e-3, s=2.003, F=50.0, initial=every.states)
    np.testing.assert_allclose(again.q, every.q, rtol=0.0, atol=1e-12 * np.abs(every.q).max())


def test_a_body_alone_starts_as_its_scene_says(small: ReducedModel) -> None:
    """In equilibrium under its weight, where the scene says so: it stays there."""
    body = with_weight(small, 1.0)
    still = replace(body, provenance={"scene": body.provenance["scene"] | {"start": "equilibrium"}})
    stepper = Stepper(still, 1e-3, 2.0)
    start = stepper.outputs[:-1]
    assert np.abs(start).max() > 0.0 and not Stepper(body, 1e-3, 2.0).q.any()
    for _ in range(10):
        stepper.step(2.0)
    np.testing.assert_allclose(stepper.outputs[:-1], start, rtol=0.0, atol=1e-8 * np.abs(start).max())


def test_steps_take_no_memory(small: ReducedModel) -> None:
    stepper = Stepper(small, step=1e-3, s=2.0, outputs=[8])
    F = np.zeros(1)
    stepper.step(2.0, F)
    tracemalloc.start()
    for _ in range(10):
        stepper.step(2.0, F)
    gc.collect()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(1000):
        stepper.step(2.0, F)
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 1000  # less than a byte a step: what is kept of each takes more


def test_what_cannot_be_stepped_is_refused(small: ReducedModel) -> None:
    with pytest.raises(InputError, match="s.slider = 6.0: 0 to 5 m is allowed"):
        Stepper(small, step=1e-3, s=6.0)
    with pytest.raises(InputError, match="rho_inf = 1.0"):
        Stepper(small, step=1e-3, s=2.0, rho_inf=1.0)
    with pytest.raises(InputError, match="step = 0.0"):
        Stepper(small, step=0.0, s=2.0)
    with pytest.raises(InputError, match=r"outputs = 1\.5: .* are allowed"):
        Stepper(small, step=1e-3, s=2.0, outputs=[1.5])  # type: ignore[list-item]
    stepper = Stepper(small, step=1e-3, s=0.2)
    with pytest.raises(InputError, match="s.slider = -0.1: 0 to 5 m is allowed"):
        stepper.step(-0.1, 0.0)
    with pytest.raises(SimulationError, match=r"step 1, t = 0\.001 s, slider at 0 m: the row slider 0 vanishes"):
        stepper.step(0.0, 0.0)


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_refused_and_nothing_moves(small: ReducedModel, number: float) -> None:
    stepper = Stepper(small, step=1e-3, s=2.0)
    before = stepper.step(2.0, 50.0).copy()
    for F in (number, np.array([number]), {0: number}, {0: (1.0, number)}):
        with pytest.raises(InputError, match=r"F.* = .*: finite numbers are allowed"):
            stepper.step(2.0, F)
    for s in (number, {0: number}, {0: (2.0, number)}):
        with pytest.raises(InputError, match="s.* = .* allowed"):
            stepper.step(s, 50.0)
    with pytest.raises(InputError, match="step = "):
        Stepper(small, step=abs(number), s=2.0)
    other = Stepper(small, step=1e-3, s=2.0)
    np.testing.assert_array_equal(other.step(2.0, 50.0), before)
    np.testing.assert_array_equal(stepper.step(2.0, 50.0), other.step(2.0, 50.0))


@pytest.mark.parametrize("given", [lambda s: s, lambda s: {0: s}, lambda s: {0: (s, 0.0)}])
def test_a_jump_is_told_once(small: ReducedModel, given: Callable[[float], Values], caplog: Any) -> None:
    """A tenth of the range in a step; and more than all of it in one is refused as a rate."""
    stepper = Stepper(small, step=1e-3, s=2.0)
    for s in (2.001, 2.4, 2.5):
        stepper.step(given(s), 0.0)
    assert not caplog.records
    for s in (4.5, 2.0):
        stepper.step(given(s), 0.0)
    (record,) = caplog.records
    assert record.getMessage().startswith("slider jumps by 2 m in a step of 0.001 s")
    with pytest.raises(InputError, match=r"s.slider = \[2.0, 6000.0\]: 5000 m/s, its range in a step"):
        stepper.step({0: (2.0, 6000.0)}, 0.0)


def with_weight(small: ReducedModel, rise: float) -> ReducedModel:
    """With a second input, and the scene that a run would leave in the model."""
    scene = {
        "slider": {"path": 2.0},
        "loads": [{"name": "F", "signal": 70.0}],
        "gravity": {"rise": rise},
        "time": {"end": 1.0, "step": 1e-3, "rho_inf": 0.8},
    }
    B = np.column_stack([small.B, -small.M @ np.ones(small.size)])
    return replace(small, B=B, input_names=(*small.input_names, "gravity"), provenance={"scene": scene})


@pytest.mark.parametrize("rise", [0.0, 1.0])
def test_it_starts_with_the_loads_of_the_models_scene_and_its_whole_weight(small: ReducedModel, rise: float) -> None:
    """However weight rises in a run: who does not speak of it means that it is there."""
    body = with_weight(small, rise)
    silent, said, without = (Stepper(body, 1e-3, 2.0, F) for F in (None, [70.0, 9.80665], [0.0, 0.0]))
    assert np.abs(said.multipliers).max() > 1.0
    np.testing.assert_array_equal(silent.multipliers, said.multipliers)
    assert not without.multipliers.any()
    assert not Stepper(replace(body, provenance={}), 1e-3, 2.0).multipliers.any()


@pytest.mark.parametrize("F", [100.0, [100.0], [100.0, 0.0, 0.0], [[100.0, 0.0]], np.float64(1.0), []])
def test_one_load_is_never_taken_for_several(small: ReducedModel, F: object) -> None:
    """A force that is spread over all inputs would be a weight of as many m/s^2."""
    body = with_weight(small, 1.0)
    allowed = r"stepper: F = .*: one load for each input is allowed, in this order: F, gravity"
    with pytest.raises(InputError, match=allowed):
        Stepper(body, 1e-3, 2.0, F)
    stepper = Stepper(body, 1e-3, 2.0)
    with pytest.raises(InputError, match=allowed):
        stepper.step(2.0, F)
    y = stepper.step(2.0, [100.0, 9.80665]).copy()
    np.testing.assert_array_equal(Stepper(body, 1e-3, 2.0).step(2.0, (100.0, 9.80665)), y)


def test_a_measured_path_may_lie_a_little_beyond_an_end(small: ReducedModel) -> None:
    """Within the stated share of the path's length it is taken at the end; the state is that of the end itself."""
    low, high = small.domain
    beyond = high + 0.9 * BEYOND_ENDS * (high - low)
    there, almost = (Stepper(small, 1e-3, s) for s in (high, beyond))
    for F in (50.0, 80.0):
        np.testing.assert_array_equal(almost.step(beyond, F), there.step(high, F))
    with pytest.raises(InputError, match="0 to 5 m is allowed"):
        there.step(high + 1.1 * BEYOND_ENDS * (high - low), 50.0)
