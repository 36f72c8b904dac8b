"""The observer beside least squares over the whole motion, and what it says of bad measurements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from oscillator import OUTPUTS, H, history, measured, oscillator, weight

from pmr.errors import InputError
from pmr.observe.budget import output_errors
from pmr.observe.observer import Observer, Parameter, Payload, Sensor, UnknownLoad

Array = NDArray[np.float64]


def test_estimates_are_least_squares_over_the_whole_motion() -> None:
    """All unknowns at once from a stacked system: load process, bias, and random accelerations of the mode."""
    steps, model, rng = 12, oscillator(12), np.random.default_rng(1)
    sensors = [Sensor(OUTPUTS[0], 0.05, bias=0.2), Sensor(OUTPUTS[2], 3.0)]
    observer = Observer(model, sensors, [UnknownLoad("push", 40.0, 0.05)], disturbance=0.5)
    y = history(model, 40.0 * rng.standard_normal(steps)) + np.array([0.1, 0.0, 0.0])
    data = measured(model, y, np.array([0.05, 0.0, 3.0]), rng, (OUTPUTS[0], OUTPUTS[2]))
    estimates = observer.run(data)
    # unknowns: f_0, bias, f_1 ... f_T-1 noises, mode noises; all with unit variance
    decay = np.exp(-H / 0.05)
    count = 2 + 2 * (steps - 1)
    x, f, bias = np.zeros((3, count)), np.zeros(count), np.zeros(count)
    f[0], bias[1] = 40.0, 0.2
    x += np.outer(model.start[:, 0], f)
    rows, rights = list[Array](), list[float]()
    for k in range(steps):
        outputs = model.C[k] @ x + np.outer(model.D[k, :, 0], f)
        for name, noise, off in ((OUTPUTS[0], 0.05, bias), (OUTPUTS[2], 3.0, 0.0)):
            rows.append((outputs[OUTPUTS.index(name)] + off) / noise)
            rights.append(data[name][1][k] / noise)
        if k < steps - 1:
            x = model.A[k] @ x + np.outer(model.B[k, :, 0], f)
            x[1, 2 + steps - 1 + k] += 0.5 * H
            f = decay * f
            f[2 + k] += 40.0 * np.sqrt(1.0 - decay**2)
    normal = np.eye(count) + np.array(rows).T @ np.array(rows)
    solution, covariance = np.linalg.solve(normal, np.array(rows).T @ np.array(rights)), np.linalg.inv(normal)
    for name, row in (("push", f), ("bias of acceleration of tip", bias), ("tip", outputs[1])):
        mean, deviation = estimates.of(name)
        np.testing.assert_allclose(mean[-1], row @ solution, rtol=1e-8)
        np.testing.assert_allclose(deviation[-1], np.sqrt(row @ covariance @ row), rtol=1e-8)


def test_a_payload_is_told_and_its_band_holds() -> None:
    model, rng = oscillator(700), np.random.default_rng(2)
    noise = np.array([0.02, 0.0, 20.0])
    y = weight(model, 12.0, rng, 15.0)
    sensors = [Sensor(OUTPUTS[0], 0.02), Sensor(OUTPUTS[2], 20.0)]
    payload = Payload("push", OUTPUTS[0], 20.0)
    observer = Observer(model, sensors, [UnknownLoad("push", 15.0, -H / np.log(0.9))], payload)
    estimates = observer.run(measured(model, y, noise, rng, (OUTPUTS[0], OUTPUTS[2])))
    mean, deviation = estimates.of("payload")
    assert abs(mean[-1] - 12.0) < 3.0 * deviation[-1] < 1.0
    assert estimates.coverage("tip", y[:, 1]) > 0.8
    assert not estimates.alarms[100:].any()


@pytest.mark.slow
def test_a_payload_has_no_bias_where_innovations_are_not_white() -> None:
    """An accelerometer whose noise is overstated 50 times tells next to nothing, and does not move the payload."""
    model, apart = oscillator(400), list[float]()
    payload, loads = Payload("push", OUTPUTS[0], 20.0), [UnknownLoad("push", 60.0, -H / np.log(0.9))]
    for seed in range(6):
        rng = np.random.default_rng(seed)
        y = weight(model, 4.0, rng, 60.0)
        data = measured(model, y, np.array([0.02, 0.0, 20.0]), rng, (OUTPUTS[0], OUTPUTS[2]))
        sensors = [Sensor(OUTPUTS[2], 20.0), Sensor(OUTPUTS[0], 1.0)]
        alone, both = (
            Observer(model, used, loads, payload).run({sensor.output: data[sensor.output] for sensor in used})
            for used in (sensors[:1], sensors)
        )
        apart.append(float(np.mean((both.of("payload")[0] - alone.of("payload")[0])[100:])))
    assert abs(np.mean(apart)) < 0.05  # 0.2 kg where gains have the estimated acceleration


def test_accelerometers_alone_cannot_tell_a_payload() -> None:
    model = oscillator(400)
    payload, loads = Payload("push", OUTPUTS[0], 20.0), [UnknownLoad("push", 15.0, 0.1)]
    acceleration = Sensor(OUTPUTS[0], 0.02, bias=0.5)
    alone = Observer(model, [acceleration], loads, payload).observability()
    both = Observer(model, [acceleration, Sensor(OUTPUTS[2], 20.0)], loads, payload).observability()
    assert alone["payload"] > 0.9 and both["payload"] < 0.2


@pytest.mark.parametrize("kind", ["missing", "gap", "stuck", "unit", "swapped"])
def test_bad_measurements_are_told_and_nothing_diverges(kind: str) -> None:
    model, rng = oscillator(800), np.random.default_rng(3)
    y = history(model, 60.0 * rng.standard_normal(800))
    sensors = [Sensor(OUTPUTS[0], 0.05), Sensor(OUTPUTS[1], 1e-3), Sensor(OUTPUTS[2], 3.0)]
    data = measured(model, y, np.array([0.05, 1e-3, 3.0]), rng)
    bad, at = OUTPUTS[2], 400
    t, values = data[bad][0], data[bad][1].copy()
    if kind == "missing":
        values[at::2] = np.nan
    elif kind == "gap":
        values[at:600] = np.nan
    elif kind == "stuck":
        values[at:] = values[at]
    elif kind == "unit":
        values[at:] *= 1e3
    else:
        data[OUTPUTS[1]], values = (t, values), data[OUTPUTS[1]][1]
        at = 0
    data[bad] = (t, values)
    estimates = Observer(model, sensors, [UnknownLoad("push", 60.0, 1e-3)]).run(data)
    for array in (estimates.mean, estimates.deviation, estimates.unknown_mean):
        assert np.isfinite(array).all()
    assert np.abs(estimates.of("tip")[0]).max() < 100.0 * np.abs(y[:, 1]).max()
    told = estimates.alarms[at : at + round(1.0 / H)].any()
    assert told == (kind not in ("missing", "gap"))
    assert not estimates.alarms[:at].any()


def test_sensors_have_rates_of_their_own() -> None:
    model = oscillator(60)
    observer = Observer(model, [Sensor(OUTPUTS[1], 1e-3), Sensor(OUTPUTS[2], 1.0)])
    values = observer.grid({OUTPUTS[1]: (model.t[::3] + 0.2 * H, np.ones(20)), OUTPUTS[2]: (model.t, np.ones(60))})
    assert np.isfinite(values).sum(axis=0).tolist() == [20, 60]


def test_errors_of_the_run_widen_bands_and_parameters_narrow_them() -> None:
    model, rng = oscillator(300), np.random.default_rng(4)
    model = replace(model, reference=np.tile([0.0, -0.3, 1080.0], (300, 1)))
    summary = {"estimate": {"tip": 0.02, "velocity": 0.01, "support_force": 0.01}, "step": {"tip": 0.01},
               "budget": {"model": {"beside": None}}}  # fmt: skip
    errors = output_errors(summary, model)
    assert errors["reduction"]["tip"] == 0.02 and "model" not in errors
    sensors = [Sensor(OUTPUTS[2], 3.0)]
    data = {OUTPUTS[2]: (model.t, model.reference[:, 2] * 1.05 + 3.0 * rng.standard_normal(300))}
    plain, wide = (Observer(model, sensors, errors=of).run(data) for of in ({}, errors))
    assert plain.of("tip")[1][-1] < 1e-3
    np.testing.assert_allclose(wide.of("tip")[1][-1], 0.3 * np.hypot(0.02, 0.01), rtol=0.05)
    softer = Parameter("stiffness", np.tile([0.0, -0.03, 108.0], (300, 1)))
    mean, deviation = Observer(model, sensors, parameters=[softer]).run(data).of("stiffness")
    assert abs(mean[-1] - 0.5) < 0.01 and deviation[-1] < 0.01


def test_what_the_model_lacks_is_refused() -> None:
    model, sensor = oscillator(5), Sensor(OUTPUTS[1], 1e-3)
    wrong: list[dict[str, object]] = [
        {"sensors": []},
        {"sensors": [Sensor("nothing", 1.0)]},
        {"sensors": [Sensor(OUTPUTS[1], 0.0)]},
        {"sensors": [sensor], "loads": [UnknownLoad("nothing", 1.0, 1.0)]},
        {"sensors": [sensor], "loads": [UnknownLoad("push", 1.0, 0.0)]},
        {"sensors": [sensor], "payload": Payload("push", "nothing", 1.0)},
        {"sensors": [sensor], "parameters": [Parameter("E", np.zeros((2, 2)))]},
    ]
    for arguments in wrong:
        with pytest.raises(InputError, match="observe"):
            Observer(model, **arguments)  # type: ignore[arg-type]
    observer = Observer(model, [sensor])
    for data in ({"nothing": (model.t, model.t)}, {OUTPUTS[1]: (model.t, model.t[:2])}):
        with pytest.raises(InputError, match="measured"):
            observer.grid(data)
