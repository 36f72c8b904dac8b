"""The observer beside least squares over the whole motion, and what it says of bad measurements.

Then one of the random motions by which the manual judges bands, of a boom whose truth is another model
(`workflows/observe_boom.py` judges 30 others, on other beams too), and the roller's position on measured series that
settings were not tuned on, where there is a folder with them.
"""

import os
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oscillator import OUTPUTS, H, history, measured, oscillator, weight

from pmr import InputError, Observer, PositionObserver
from pmr.files.arrays import Array
from pmr.observe.budget import output_errors
from pmr.observe.linear import LinearMotion
from pmr.observe.observer import Parameter, Payload, Sensor, UnknownLoad


def outputs_of_unknowns(model: LinearMotion, deviation: float, time: float, disturbance: float) -> Array:
    """Outputs (T, q, u) for each of u unknowns with unit variance.

    They are the first load, and for each step but the first the change of the load, the acceleration of the mode, and
    the load's mean within the step.
    """
    T, decay = len(model.t), np.exp(-H / time)
    with_end = time / H * (1.0 - decay)  # covariance of the mean with the load at an end, over deviation^2
    of_mean = 2.0 * time / H * (1.0 - with_end)
    ends = np.array([[1.0, decay], [decay, 1.0]])
    within = deviation * np.sqrt(of_mean - with_end**2 * np.linalg.inv(ends).sum())
    x, f, outputs = np.zeros((3, 1 + 3 * (T - 1))), np.zeros(1 + 3 * (T - 1)), []
    f[0] = deviation
    x += np.outer(model.start[:, 0], f)
    for k in range(T):
        outputs.append(model.C[k] @ x + np.outer(model.D[k, :, 0], f))
        if k < T - 1:
            x = model.A[k] @ x + np.outer(model.B[k, :, 0], f)
            x[1, 2 + 3 * k] += disturbance * H
            x[:, 3 + 3 * k] += within * model.B[k, :, 0]
            f = decay * f
            f[1 + 3 * k] += deviation * np.sqrt(1.0 - decay**2)
    return np.array(outputs)


def test_estimates_are_least_squares_over_the_whole_motion() -> None:
    """All unknowns at once from a stacked system: load, bias, random accelerations of the mode, loads within steps."""
    steps, model, rng = 12, oscillator(12), np.random.default_rng(1)
    sensors = [Sensor(OUTPUTS[0], 0.05, bias=0.2), Sensor(OUTPUTS[2], 3.0)]
    observer = Observer(model, sensors, [UnknownLoad("push", 40.0, 0.05)], disturbance=0.5)
    y = history(model, 40.0 * rng.standard_normal(steps)) + np.array([0.1, 0.0, 0.0])
    data = measured(model, y, np.array([0.05, 0.0, 3.0]), rng, (OUTPUTS[0], OUTPUTS[2]))
    estimates = observer.run(data)
    outputs = outputs_of_unknowns(model, 40.0, 0.05, 0.5)
    bias = np.concatenate([np.zeros(outputs.shape[2]), [0.2]])
    outputs = np.concatenate([outputs, np.zeros((steps, 3, 1))], axis=2)
    rows = np.vstack([(outputs[:, 0] + bias) / 0.05, outputs[:, 2] / 3.0])
    rights = np.concatenate([data[OUTPUTS[0]][1] / 0.05, data[OUTPUTS[2]][1] / 3.0])
    covariance = np.linalg.inv(np.eye(len(bias)) + rows.T @ rows)
    solution = covariance @ rows.T @ rights
    for name, row in (("bias of acceleration of tip", bias), ("tip", outputs[-1, 1])):
        mean, deviation = estimates.of(name)
        np.testing.assert_allclose(mean[-1], row @ solution, rtol=1e-8)
        np.testing.assert_allclose(deviation[-1], np.sqrt(row @ covariance @ row), rtol=1e-8)


def test_a_parameter_that_is_not_estimated_widens_bands_by_what_it_does_to_errors() -> None:
    """Estimates are linear in measurements, and their errors follow from this and from what is unknown."""
    steps, model, rng = 10, oscillator(10), np.random.default_rng(5)
    softer = Parameter("stiffness", 0.01 * rng.standard_normal((steps, 3)) * (1.0, 0.1, 600.0), 2.0, estimated=False)
    loads = [UnknownLoad("push", 40.0, 0.05)]
    observer = Observer(model, [Sensor(OUTPUTS[2], 3.0)], loads, parameters=[softer], disturbance=0.5)
    plain = observer.run({OUTPUTS[2]: (model.t, np.zeros(steps))})
    weights = np.array([observer.run({OUTPUTS[2]: (model.t, row)}).of("tip")[0][-1] for row in np.eye(steps)])
    outputs = outputs_of_unknowns(model, 40.0, 0.05, 0.5)
    outputs = np.concatenate([outputs, 2.0 * softer.sensitivity[:, :, None]], axis=2)
    error = outputs[-1, 1] - weights @ outputs[:, 2]
    deviation = np.sqrt(error @ error + 9.0 * weights @ weights)
    np.testing.assert_allclose(plain.of("tip")[1][-1], deviation, rtol=1e-8)
    assert np.all(plain.of("stiffness")[0] == 0.0) and np.all(plain.of("stiffness")[1] == 2.0)


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


def test_a_payload_is_told_by_specific_force_as_by_acceleration() -> None:
    """The sensor feels gravity beside the acceleration; with it the payload's weight acts from the start."""
    model, rng, felt = oscillator(200), np.random.default_rng(5), "specific force of tip"
    y = weight(model, 12.0, rng, 15.0)
    offset = np.array([9.80665, 0.0, 0.0])
    feeling = replace(model, outputs=(felt, *OUTPUTS[1:]), reference=model.reference + offset)
    data = measured(model, y, np.array([0.02, 0.0, 20.0]), rng, (OUTPUTS[0], OUTPUTS[2]))
    t, acceleration = data[OUTPUTS[0]]
    loads, force = [UnknownLoad("push", 15.0, 0.1)], Sensor(OUTPUTS[2], 20.0)
    by_acceleration = Observer(model, [Sensor(OUTPUTS[0], 0.02), force], loads, Payload("push", OUTPUTS[0], 20.0))
    by_force = Observer(feeling, [Sensor(felt, 0.02), force], loads, Payload("push", felt, 20.0, gravity=0.0))
    ours = by_force.run({felt: (t, acceleration + 9.80665), OUTPUTS[2]: data[OUTPUTS[2]]}).of("payload")
    np.testing.assert_allclose(ours, by_acceleration.run(data).of("payload"), rtol=1e-9, atol=1e-9)
    with pytest.raises(InputError, match="payload.gravity = 9.80665: 0 is allowed"):
        Observer(feeling, [force], payload=Payload("push", felt, 20.0))


def test_a_parameter_with_a_mean_grows_with_the_estimated_payload() -> None:
    """It changes the tip alone, which is not measured: mean and variance are those without it, and its own."""
    model, rng = oscillator(60), np.random.default_rng(2)
    data = measured(model, weight(model, 12.0, rng), np.array([0.02, 0.0, 20.0]), rng, (OUTPUTS[0], OUTPUTS[2]))
    sensors, payload = [Sensor(OUTPUTS[0], 0.02), Sensor(OUTPUTS[2], 20.0)], Payload("push", OUTPUTS[0], 20.0)
    change, growth = np.zeros((2, 60, 3))
    change[:, 1], growth[:, 1] = 1e-3 * rng.standard_normal((2, 60))
    softer = Parameter("friction", change, 0.3, estimated=False, mean=0.5, per_kilogram=growth)
    plain, ours = (Observer(model, sensors, (), payload, of).run(data) for of in ((), [softer]))
    change_of_tip = change[1:, 1] + plain.of("payload")[0][:-1] * growth[1:, 1]  # by the payload before the step
    (mean, deviation), (plain_mean, plain_deviation) = (each.of("tip") for each in (ours, plain))
    np.testing.assert_allclose((mean - plain_mean)[1:], 0.5 * change_of_tip, rtol=1e-8, atol=1e-15)
    np.testing.assert_allclose(deviation[1:] ** 2, plain_deviation[1:] ** 2 + (0.3 * change_of_tip) ** 2, rtol=1e-8)


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


def spoil(data: dict[str, tuple[Array, Array]], kind: str, bad: str, at: int) -> dict[str, tuple[Array, Array]]:
    """Measurements of which those of the sensor `bad` are wrong from the step `at` on."""
    t, values = data[bad][0], data[bad][1].copy()
    spoiled = dict(data)
    if kind == "missing":
        values[at::2] = np.nan
    elif kind == "infinite":
        values[at::3] = np.inf
    elif kind == "gap":
        values[at:600] = np.nan
    elif kind == "stuck":
        values[at:] = values[at]
    elif kind == "slow and stuck":
        values[np.arange(len(values)) % 8 != 0] = np.nan
        values[at::8] = values[at]
    elif kind == "dead":
        values[at:] = 0.0
    elif kind == "swapped":
        other = OUTPUTS[OUTPUTS.index(bad) - 1]
        spoiled[other] = (t, np.concatenate([data[other][1][:at], values[at:]]))
        values[at:] = data[other][1][at:]
    else:
        values[at:] *= float(kind)
    return {**spoiled, bad: (t, values)}


KINDS = ("missing", "infinite", "gap", "stuck", "slow and stuck", "dead", "swapped", "1000.0", "0.001", "-1.0")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bad", OUTPUTS)
def test_bad_measurements_are_told_within_a_second_and_nothing_diverges(kind: str, bad: str) -> None:
    model, rng, at = oscillator(800), np.random.default_rng(3), 400
    y = history(model, 60.0 * rng.standard_normal(800))
    sensors = [Sensor(OUTPUTS[0], 0.05), Sensor(OUTPUTS[1], 1e-3), Sensor(OUTPUTS[2], 3.0)]
    data = spoil(measured(model, y, np.array([0.05, 1e-3, 3.0]), rng), kind, bad, at)
    estimates = Observer(model, sensors, [UnknownLoad("push", 60.0, 1e-3)]).run(data)
    assert np.isfinite(estimates.means).all() and np.isfinite(estimates.deviations).all()
    assert np.abs(estimates.of("tip")[0] - y[:, 1]).max() < 3.0 * np.abs(y[:, 1]).max()
    told = estimates.alarms[at : at + round(1.0 / H)]
    assert told.any() == (kind not in ("missing", "infinite"))
    assert not estimates.alarms[:at].any()
    if kind in ("gap", "stuck", "slow and stuck", "dead"):
        assert told[:, OUTPUTS.index(bad)].any()


def test_a_wrong_unit_does_not_move_the_payload() -> None:
    """A force in kN from 3 s on: the payload is as well known as where the force is not measured any more."""
    model, rng, at = oscillator(700), np.random.default_rng(2), 300
    data = measured(model, weight(model, 12.0, rng, 15.0), np.array([0.02, 0.0, 20.0]), rng, (OUTPUTS[0], OUTPUTS[2]))
    sensors, loads = [Sensor(OUTPUTS[0], 0.02), Sensor(OUTPUTS[2], 1.0)], [UnknownLoad("push", 15.0, -H / np.log(0.9))]
    observer = Observer(replace(model, reference=model.reference + (0.0, 0.0, 5e3)), sensors, loads,
                        Payload("push", OUTPUTS[0], 20.0))  # fmt: skip
    t, force = data[OUTPUTS[2]]
    gone, wrong = force + 5e3, force + 5e3
    gone[at:] = np.nan
    wrong[at:] *= 1e-3
    without, estimates = (observer.run({**data, OUTPUTS[2]: (t, values)}) for values in (gone, wrong))
    assert estimates.alarms[at + 5 :, 1].all()
    np.testing.assert_allclose(estimates.of("payload")[0], without.of("payload")[0], rtol=1e-12)


@pytest.mark.parametrize("kind", ["bias", "gain", "noise"])
def test_a_faulty_accelerometer_drags_nothing(kind: str) -> None:
    """From the alarm on, estimates are those without its last 0.8 s, which began before the fault."""
    model, rng, at = oscillator(330), np.random.default_rng(3), 200
    noise, sensors = (
        np.array([0.05, 1e-3, 3.0]),
        [Sensor(OUTPUTS[0], 0.05), Sensor(OUTPUTS[1], 1e-3), Sensor(OUTPUTS[2], 3.0)],
    )
    data = measured(model, history(model, 60.0 * rng.standard_normal(330)), noise, rng)
    observer, (t, good) = Observer(model, sensors, [UnknownLoad("push", 60.0, 1e-3)]), data[OUTPUTS[0]]
    gone, wrong = good.copy(), good.copy()
    size = 5.0 * np.std(good)
    wrong[at:] = {"bias": good + 0.3 * size, "gain": 6.0 * good, "noise": good + size * rng.standard_normal(330)}[kind][
        at:
    ]
    estimates = observer.run({**data, OUTPUTS[0]: (t, wrong)})
    told = at + int(np.argmax(estimates.alarms[at:, 0]))
    gone[told + 1 - round(0.8 / H) :] = np.nan
    without = observer.run({**data, OUTPUTS[0]: (t, gone)})
    assert told < at + 20 and estimates.alarms[told:, 0].all() and not estimates.alarms[told + 1 :, 1:].any()
    np.testing.assert_allclose(estimates.of("tip")[0][told:], without.of("tip")[0][told:], rtol=1e-8, atol=1e-12)


def test_a_sensor_that_is_good_again_returns() -> None:
    """Stuck or off for 2 s, then good: used again a second later, and estimates are those of all sensors again."""
    model, rng = oscillator(700), np.random.default_rng(3)
    sensors = [Sensor(OUTPUTS[0], 0.05), Sensor(OUTPUTS[1], 1e-3), Sensor(OUTPUTS[2], 3.0)]
    y = history(model, 60.0 * rng.standard_normal(700))
    data = measured(model, y, np.array([0.05, 1e-3, 3.0]), rng)
    observer, (t, good) = Observer(model, sensors, [UnknownLoad("push", 60.0, 1e-3)]), data[OUTPUTS[0]]
    stuck, off = good.copy(), good.copy()
    stuck[200:400] = good[200]
    off[200:400] += 1.5 * np.std(good)
    all_good = observer.run(data)
    for wrong in (stuck, off):
        estimates = observer.run({**data, OUTPUTS[0]: (t, wrong)})
        assert estimates.alarms[240:400, 0].all() and not estimates.excluded[:200].any()
        returned = 1 + int(np.max(np.nonzero(estimates.excluded[:, 0])[0], initial=0))
        assert returned < 400 + round(1.5 / H) and not estimates.alarms[550:].any()
        for name in ("tip", OUTPUTS[0]):
            np.testing.assert_allclose(estimates.of(name)[0][-50:], all_good.of(name)[0][-50:], rtol=0.0, atol=1e-9)
    assert estimates.excluded[300, 0] and 400 + round(0.9 / H) < returned


def test_a_force_that_drifts_shows_in_the_payload() -> None:
    """The payload follows the drift, so innovations do not show it; its change is more than its band allows."""
    model, rng = oscillator(700), np.random.default_rng(2)
    y = weight(model, 12.0, rng, 15.0)
    sensors, payload = [Sensor(OUTPUTS[0], 0.02), Sensor(OUTPUTS[2], 20.0)], Payload("push", OUTPUTS[0], 20.0)
    observer = Observer(model, sensors, [UnknownLoad("push", 15.0, -H / np.log(0.9))], payload)
    data = measured(model, y, np.array([0.02, 0.0, 20.0]), rng, (OUTPUTS[0], OUTPUTS[2]))
    t, force = data[OUTPUTS[2]]
    plain, drifting = (
        observer.run(data),
        observer.run({**data, OUTPUTS[2]: (t, force + 10.0 * np.maximum(t - 3.0, 0.0))}),
    )
    assert not plain.drift.any() and not drifting.drift[:300].any() and drifting.drift[600:].any()
    assert not drifting.alarms[100:].any()


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
        {"sensors": [sensor, Sensor(OUTPUTS[1], 1.0, bias=1.0)]},
        {"sensors": [sensor], "loads": 2 * [UnknownLoad("push", 1.0, 1.0)]},
        {"sensors": [sensor], "loads": [UnknownLoad("nothing", 1.0, 1.0)]},
        {"sensors": [sensor], "loads": [UnknownLoad("push", 1.0, 0.0)]},
        {"sensors": [sensor], "payload": Payload("push", "nothing", 1.0)},
        {"sensors": [sensor], "payload": Payload("push", OUTPUTS[1], 1.0)},
        {"sensors": [sensor], "payload": Payload("push", OUTPUTS[0], 0.0)},
        {"sensors": [sensor], "parameters": [Parameter("E", np.zeros((2, 2)))]},
        {"sensors": [sensor], "parameters": 2 * [Parameter("E", np.zeros((5, 3)))]},  # biases had values of others then
        {"sensors": [sensor], "parameters": [Parameter(OUTPUTS[1], np.zeros((5, 3)))]},
        {"sensors": [sensor], "error_time": 0.0},
        {"sensors": [sensor], "error_time": np.inf},
        {"sensors": [sensor], "disturbance": np.nan},
        {"sensors": [Sensor(OUTPUTS[1], 1.0, bias=np.nan)]},
        {"sensors": [sensor], "loads": [UnknownLoad("push", 1.0, np.inf)]},
        {"sensors": [sensor], "payload": Payload("push", OUTPUTS[0], 1.0, wander=np.nan)},
        {"sensors": [sensor], "payload": Payload("push", OUTPUTS[0], 1.0, gravity=np.nan)},
    ]
    for arguments in wrong:
        with pytest.raises(InputError, match="observe"):
            Observer(model, **arguments)  # type: ignore[arg-type]
    turned = replace(model, input_units=("N m",))
    assert Observer(turned, [sensor], [UnknownLoad("push", 1.0, 1.0)]).units["push"] == "N m"
    with pytest.raises(InputError, match="force"):
        Observer(turned, [sensor], payload=Payload("push", OUTPUTS[0], 1.0))
    observer = Observer(model, [sensor])
    in_ms = {OUTPUTS[1]: (1e3 * (model.t + 1.0), model.t)}
    for data in ({"nothing": (model.t, model.t)}, {OUTPUTS[1]: (model.t, model.t[:2])}, in_ms):
        with pytest.raises(InputError, match="measured"):
            observer.grid(data)


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("other", [False, True])
def test_estimates_are_near_the_truth_and_bands_hold_it(other: bool) -> None:
    """On other beams the tip would be 0.8 % off without estimates of Young's modulus and of the compliance of pads."""
    script = runpy.run_path(str(Path(__file__).parents[2] / "workflows" / "observe_boom.py"))
    judged = script["judge"](0, other=other)
    for name in script["ESTIMATES"]:
        largest = {"payload": 0.04, script["TIP"]: 0.006 if other else 0.002}.get(name, 0.01)
        assert judged[name].error < largest, (name, judged)
    assert np.mean([of.share for of in judged.values()]) > 0.8, judged


#: Folder with series of Dataset-8 (CC BY-SA 4.0) as .npz files, which are not part of the project.
FOLDER = Path(os.environ.get("PMR_DROPBEAR", "none"))


@pytest.mark.slow
@pytest.mark.skipif(not (FOLDER / "rand1.npz").is_file(), reason="PMR_DROPBEAR names no folder with DROPBEAR's series")
def test_figures_of_the_manual_are_those_of_the_measurements() -> None:
    script = runpy.run_path(str(Path(__file__).parents[2] / "workflows" / "dropbear.py"))
    observer = PositionObserver(script["models"](), script["SETTINGS"])
    expected = {"rand1": {0.0: (4.9, 0.91), 0.1: (2.5, 0.87)}, "slow6": {0.0: (2.0, 0.93), 0.1: (1.1, 0.93)}}
    for name, by_delay in expected.items():
        for delay, (rms, held) in by_delay.items():
            figures = script["judge"](observer, [script["series"](FOLDER / f"{name}.npz")], delay)
            assert figures["rms"] == pytest.approx(rms, abs=0.1) and figures["held"] == pytest.approx(held, abs=0.01)
    tuned, others = ([script["series"](FOLDER / f"{name}.npz")] for name in ("rand0", "rand1"))
    figures = script["judge_strain"](observer, tuned, others, 0)
    assert figures["NRMS"] == pytest.approx(0.175, abs=0.01) and figures["correlation"] > 0.98
