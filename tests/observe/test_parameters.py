"""Constant parameters by observers of several models: a parabola through log-likelihoods, and a spring."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from oscillator import OUTPUTS, history, measured, oscillator

from pmr import InputError
from pmr.files.arrays import Array
from pmr.observe.linear import LinearMotion
from pmr.observe.observer import GATE, Observer, Sensor, UnknownLoad
from pmr.observe.parameters import ParameterObserver

STEPS, STIFFNESSES = 600, np.array([[1.0], [0.95], [1.05]])
NOISE = np.array([0.05, 5e-3, 3.0])


def sagged(stiffness: float) -> LinearMotion:
    """Oscillator on another spring, which its own weight extends."""
    model = oscillator(STEPS, 6.0 * stiffness**0.5)
    return replace(model, reference=np.tile([0.0, -9.81 / (36.0 * stiffness), 981.0], (STEPS, 1)))


def springs(temper: float) -> ParameterObserver:
    """Observers of oscillators whose springs have these `STIFFNESSES` over that of the usual one."""
    sensors = [Sensor(name, noise) for name, noise in zip(OUTPUTS[:2], NOISE[:2], strict=True)]
    loads = [UnknownLoad("push", 15.0, 0.05)]
    each = [Observer(sagged(stiffness), sensors, loads) for stiffness in STIFFNESSES[:, 0]]
    return ParameterObserver(["stiffness"], np.array([1.0]), np.array([0.05]), STIFFNESSES, each, temper)


def motion(stiffness: float) -> tuple[dict[str, tuple[Array, Array]], Array]:
    """Measured acceleration and place of an oscillator with another spring under random pushes; true outputs (T, q)."""
    model, rng = sagged(stiffness), np.random.default_rng(5)
    push = np.zeros(STEPS)
    for k in range(1, STEPS):
        push[k] = 0.82 * push[k - 1] + 8.6 * rng.standard_normal()
    outputs = model.reference + history(model, push)
    return measured(model, outputs, NOISE, rng, OUTPUTS[:2]), outputs


def test_the_parameter_is_the_vertex_of_a_parabola() -> None:
    """Bayes' rule with a normal distribution before and a parabola through three log-likelihoods at every time."""
    temper, observer = 0.1, springs(0.1)
    data, _ = motion(1.03)
    mean, deviation = observer.run(data).of("stiffness")
    squares = [np.minimum(each.run(data).innovations ** 2, GATE**2).sum(axis=1) for each in observer.observers]
    for k in (100, STEPS - 1):
        likelihoods = [-0.5 * temper * np.sum(square[: k + 1]) for square in squares]
        a, b, _ = np.polyfit(STIFFNESSES[:, 0] - 1.0, likelihoods, 2)
        variance = 1.0 / (0.05**-2 - 2.0 * a)
        np.testing.assert_allclose([mean[k], deviation[k]], [1.0 + variance * b, variance**0.5], rtol=1e-6)


def test_a_spring_is_estimated_and_with_it_its_force() -> None:
    """The force of the spring, which nobody measures, is nearer than with the usual spring."""
    data, outputs = motion(1.03)
    observer = springs(1.0)
    estimates, usual = observer.run(data), observer.observers[0].run(data)
    mean, deviation = estimates.of("stiffness")
    assert abs(mean[-1] - 1.03) < 3.0 * deviation[-1] and deviation[-1] < 0.015
    late = slice(STEPS // 2, None)
    errors = [np.mean((of.of("force").mean - outputs[:, 2])[late]) ** 2 for of in (estimates, usual)]
    assert errors[0] < 0.1 * errors[1]
    assert estimates.coverage("force", outputs[:, 2]) > 0.8


def test_a_sensor_at_fault_tells_nothing_of_the_parameter() -> None:
    data, _ = motion(1.03)
    t, values = data[OUTPUTS[0]]
    estimates = springs(1.0).run(data | {OUTPUTS[0]: (t, values + 20.0 * NOISE[0] * (np.arange(STEPS) > STEPS // 3))})
    assert estimates.excluded[-1].tolist() == [True, False]
    assert abs(estimates.of("stiffness").mean[-1] - 1.03) < 0.01


def test_models_that_do_not_fit_together_are_refused() -> None:
    observer = springs(0.1)
    each, (mean, deviation) = list(observer.observers), (observer.mean, observer.deviation)
    short = Observer(oscillator(5), each[0].sensors, each[0].loads)
    other = Observer(oscillator(STEPS), [Sensor(OUTPUTS[1], 1e-3)], each[0].loads)
    for observers, values in ((each[:2], STIFFNESSES[:2]), ([*each[:2], short], STIFFNESSES), (each, np.ones((3, 1))),
                              ([*each[:2], other], STIFFNESSES), (each[:2], STIFFNESSES)):  # fmt: skip
        with pytest.raises(InputError, match="observe"):
            ParameterObserver(["stiffness"], mean, deviation, values, observers)


@pytest.mark.parametrize(
    ("changes", "refusal"),
    [
        ({"deviation": np.array([-0.1])}, "deviation = [-0.1]: finite numbers above 0 are allowed"),
        ({"deviation": np.zeros(1)}, "deviation = [0.0]: finite numbers above 0 are allowed"),
        ({"mean": np.array([np.nan])}, "mean = [nan]: finite numbers are allowed"),
        ({"values": STIFFNESSES[:, 0]}, "values = 'array of the shape (3,)': an array of the shape (3, 1) is allowed"),
        ({"temper": -1.0}, "temper = -1.0: 0 to 1 is allowed"),
        ({"temper": np.nan}, "temper = nan: 0 to 1 is allowed"),
        ({"names": ["a", "a"]}, "names = ('a', 'a'): a name of its own is needed for each parameter"),
        ({"names": ["tip"]}, "names = 'tip': a name that no unknown and no output has is allowed"),
        ({"observers": []}, "observers: an observer is needed for each model"),
    ],
)
def test_numbers_that_are_no_values_of_parameters_are_refused(changes: dict[str, Any], refusal: str) -> None:
    """A negative standard deviation and any `temper` gave estimates without a word."""
    with pytest.raises(InputError, match=re.escape(refusal)):
        replace(springs(0.1), **changes)
