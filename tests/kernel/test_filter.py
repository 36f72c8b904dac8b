"""The kernel's Kalman filter beside the textbook's formulas in NumPy (Joseph's form of the update)."""

import numpy as np
import pytest

from pmr import SimulationError
from pmr.files.arrays import Array
from pmr.kernel.filter import (
    AS_EXPECTED,
    IF_NEAR,
    IF_POSSIBLE,
    NOT_USED,
    FilterData,
    FilterSteps,
    KalmanFilter,
    StepMatrices,
)

N, n, r, q, p, i = 12, 6, 2, 3, 2, 2  # states X = (xi, load, payload, parameter, bias, gain, error): 6 + 6


def made(rng: np.random.Generator, considered: int) -> tuple[FilterData, FilterSteps]:
    """Random filter of two sensors, of the outputs 2 and 0, with everything that one can have."""
    shapes = ((2, q), (2, r, 2 * r), (2, r, i), (2, q, 2 * r), (2, q, i))
    reference, *matrices = (rng.standard_normal(shape) for shape in shapes)
    sensitivity, growth = rng.standard_normal((2, 2, q, 1))
    root = rng.standard_normal((N, N))
    sizes = {"states": n, "outputs": q, "sensors": p, "inputs": i, "loads": 1, "parameters": 1, "biased": 1,
             "scaled": 1, "off": 1, "payload": 1, "acceleration": 1}  # fmt: skip
    numbers = {"gravity": 9.81, "gate": 5.0, "refused": 50.0, "alarm": 12.0, "share": 0.1, "following": 0.2}
    indices = {"sensor_outputs": [2, 0], "load_inputs": [0], "considered": [considered], "biased_sensors": [0],
               "scaled_sensors": [1], "off_sensors": [1]}  # fmt: skip
    arrays = {"noise": rng.uniform(1.0, 2.0, p), "errors": rng.uniform(0.1, 0.2, q), "decay": rng.uniform(0.5, 1.0, N),
              "added": rng.uniform(0.0, 1.0, N), "rough": rng.uniform(0.5, 1.0, 1),
              "courses": rng.standard_normal((5, 4, r))}  # fmt: skip
    data = FilterData(
        sizes, numbers, {name: np.array(of, np.int32) for name, of in indices.items()}, arrays,
        x=rng.standard_normal(N), P=root @ root.T, square=rng.uniform(1.0, 2.0, q),
    )  # fmt: skip
    return data, FilterSteps(reference, StepMatrices(arrays["courses"], *matrices), sensitivity, growth)


def rows_of(data: FilterData, steps: FilterSteps, x: Array) -> tuple[Array, Array]:
    """Rows R (q, N) and offsets (q,) of the outputs R X + offset of the first step."""
    lift = -(9.81 + steps.reference[0, 1])
    of_parameter = steps.sensitivity[0] + x[n + 1] * steps.per_kilogram[0]
    C = np.hstack([steps.matrices.C[0], np.zeros((q, r))])
    R = np.hstack([C, steps.matrices.D[0][:, :1], lift * steps.matrices.D[0][:, 1:], of_parameter, np.zeros((q, 3))])
    return R, steps.reference[0] - steps.matrices.D[0][:, 1] * (R[1] @ x) * x[n + 1]


@pytest.mark.parametrize("considered", [0, 1])
def test_a_step_is_that_of_the_textbook(considered: int) -> None:
    """Update with Joseph's form, outputs with errors of the model, and prediction; one measurement is far off."""
    data, steps = made(np.random.default_rng(1), considered)
    kalman, x, P, noise = KalmanFilter(data, steps), data.x, data.P, data.arrays["noise"]
    R, offset = rows_of(data, steps, x)
    outputs = data.indices["sensor_outputs"]
    H = R[outputs].copy()
    H[0, 9] = 1.0
    H[1, 10] = (offset + R @ x)[0]
    H[1, 11] = data.arrays["errors"][0] * np.sqrt(data.square[0])
    expected, variance = offset[outputs] + H @ x, np.einsum("ij,jk,ik->i", H, P, H) + noise**2
    gap = np.array([8.0, 0.7]) * np.sqrt(variance)
    innovations = kalman.update(0, expected + gap, np.full(p, IF_NEAR))
    np.testing.assert_allclose(innovations, [8.0, 0.7], rtol=1e-12)
    np.testing.assert_allclose(kalman.level, [1.0 + 0.1 * 63.0, 1.0 + 0.1 * (0.49 - 1.0)], rtol=1e-12)
    S = H @ P @ H.T + np.diag(noise**2 + variance * [(8.0 / 5.0) ** 2 - 1.0, 0.0])
    K = np.linalg.solve(S, H @ P).T
    K[n + 2] *= 1 - considered
    rest = np.eye(N) - K @ H
    x, P = x + K @ gap, rest @ P @ rest.T + K @ (S - H @ P @ H.T) @ K.T
    np.testing.assert_allclose(kalman.x, x, rtol=1e-11)
    np.testing.assert_allclose(kalman.P, P, rtol=1e-10, atol=1e-11 * np.abs(P).max())
    mean, deviation_square = kalman.outputs(0)
    np.testing.assert_allclose(mean, offset + R @ x, rtol=1e-10)
    square = 0.8 * data.square + 0.2 * mean**2
    of_state = np.einsum("ij,jk,ik->i", R, P, R)
    np.testing.assert_allclose(deviation_square, of_state + data.arrays["errors"] ** 2 * square, rtol=1e-10)
    F = np.diag(data.arrays["decay"])
    A, B = (each[0] for each in steps.matrices.transitions())
    F[:n, :n] = A
    F[:n, n : n + 3] = np.column_stack([B[:, 0], -(9.81 + steps.reference[0, 1]) * B[:, 1], np.zeros(n)])
    swing = np.zeros(N)
    swing[:n] = -B[:, 1] * (R[1] @ x) * x[n + 1]
    rough = np.concatenate([data.arrays["rough"] * B[:, 0], np.zeros(N - n)])
    kalman.predict(0)
    np.testing.assert_allclose(kalman.x, F @ x + swing, rtol=1e-10)
    Q = np.diag(data.arrays["added"]) + np.outer(rough, rough)
    np.testing.assert_allclose(kalman.P, F @ P @ F.T + Q, rtol=1e-10, atol=1e-11 * np.abs(P).max())


def test_how_measurements_are_used() -> None:
    """A missing one, one that is not used, and one that counts as expected."""
    data, steps = made(np.random.default_rng(2), 0)
    kalman = KalmanFilter(data, steps)
    innovations = kalman.update(0, np.array([np.nan, 1e3]), np.array([IF_NEAR, NOT_USED]))
    assert np.isnan(innovations[0]) and innovations[1] != 0.0
    np.testing.assert_array_equal(kalman.x, data.x)
    np.testing.assert_array_equal(kalman.P, data.P)
    assert np.all(kalman.update(0, np.repeat(np.nan, p), np.full(p, AS_EXPECTED)) == 0.0)
    np.testing.assert_array_equal(kalman.x, data.x)
    assert np.trace(kalman.P) < np.trace(data.P)


def sensors(count: int) -> tuple[FilterData, FilterSteps]:
    """Filter of many sensors of one output, and nothing that is unknown."""
    data, steps = made(np.random.default_rng(3), 0)
    none = dict.fromkeys(("loads", "parameters", "biased", "scaled", "off"), 0) | {"payload": -1}
    arrays = (
        dict(data.arrays) | {"noise": np.ones(count)} | {name: data.arrays[name][:n] for name in ("decay", "added")}
    )
    indices = dict(data.indices) | {"sensor_outputs": np.zeros(count, np.int32)}
    few = FilterData(
        data.sizes | none | {"sensors": count}, data.numbers, indices, arrays, data.x[:n], np.eye(n), data.square
    )
    return few, steps


def test_more_sensors_than_states_stay_within_the_memory() -> None:
    kalman = KalmanFilter(*sensors(20))
    size = len(kalman.memory)
    kalman.memory = np.concatenate([kalman.memory, np.full(1000, 7.5)])
    assert np.isfinite(kalman.update(0, np.ones(20), np.full(20, IF_NEAR))).all()
    assert (kalman.memory[size:] == 7.5).all()


def test_a_covariance_without_an_inverse_is_said() -> None:
    data, steps = sensors(2)
    steps.matrices.C[0, 0, 0] = np.inf
    with pytest.raises(SimulationError, match="step 0: the covariance of the measurements"):
        KalmanFilter(data, steps).update(0, np.ones(2), np.full(2, IF_POSSIBLE))
