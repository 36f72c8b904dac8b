"""The bank of models beside a plain mixture of Kalman filters in NumPy, and the place of a beam's slider."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from pmr import InputError, PositionObserver
from pmr.export.state_space import StateSpace
from pmr.files.arrays import Array
from pmr.kernel.kernel import Bank
from pmr.observe.position import SCALE, PlaceModels, PositionSettings, SlidingNoise, place_models, sensor_modes

STEP, GRID = 1e-3, np.linspace(0.0, 0.1, 9)


def string_space() -> StateSpace:
    """Two modes whose first frequency grows from 20 Hz at s = 0 to 40 Hz at s = 0.1 m; one load, two outputs."""
    S, r = len(GRID), 2
    A, B = np.zeros((S, 4, 4)), np.zeros((S, 4, 1))
    A[:, :r, r:] = np.eye(r)
    for k, s in enumerate(GRID):
        turn = np.array([[np.cos(s), -np.sin(s)], [np.sin(s), np.cos(s)]])
        A[k, r:, :r] = -turn @ np.diag((2 * np.pi * np.array([20.0 + 200.0 * s, 110.0])) ** 2) @ turn.T
        B[k, r:, 0] = [1.0, 0.7]
    C = np.tile(np.array([[1.0, 0.7, 0.0, 0.0], [0.3, -0.2, 0.0, 0.0]]), (S, 1, 1))
    names = (("s",), GRID[:, None], A, B, C, np.zeros((S, 2, 1)), ("push",), ("at the sensor", "beyond"), ("m", "m"))
    return StateSpace(*names, tuple("abcd"))


def string_models() -> PlaceModels:
    return place_models(string_space(), "push", STEP, (0.01, 0.01), rows=[[0.0, 1.0]])


def moved(models: PlaceModels, places: NDArray[np.int64], rng: np.random.Generator) -> tuple[Array, Array]:
    """Accelerations (T,) of a slider at the numbers `places` (T,), under random pushes, and the further output."""
    x, y, beyond = np.zeros(4), np.zeros(len(places)), np.zeros(len(places))
    for k, i in enumerate(places):
        x = models.F[i] @ x
        x[2:] += 0.02 * np.array([1.0, 0.7]) * rng.standard_normal()
        y[k], beyond[k] = models.H[i] @ x + 0.05 * rng.standard_normal(), models.rows[i, 0] @ x
    return y, beyond


def test_models_are_those_of_the_state_space() -> None:
    """A discrete model's powers are the exponential of A; the mass of a sensor lowers frequencies as Rayleigh says."""
    space, models = string_space(), string_models()
    np.testing.assert_allclose(models.frequencies[:, 0], 20.0 + 200.0 * GRID, rtol=1e-12)
    eigenvalues = np.log(np.linalg.eigvals(models.F[3])) / STEP
    np.testing.assert_allclose(np.sort(np.abs(eigenvalues.imag))[::2] / (2 * np.pi), models.frequencies[3], rtol=1e-3)
    heavy, _, _ = sensor_modes(space, "push", 0.1)
    M = np.eye(2) + 0.1 * np.outer([1.0, 0.7], [1.0, 0.7])
    expected = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(M, -space.A[5, 2:, :2])).real)) / (2 * np.pi)
    np.testing.assert_allclose(heavy[5], expected, rtol=1e-10)
    corrected = place_models(space, "push", STEP, (0.01, 0.01), measured={0.0: [21.0], 0.1: [40.0]})
    np.testing.assert_allclose(corrected.frequencies[[0, 4, 8], 0], [21.0, 30.0 * 1.025, 40.0], rtol=1e-12)
    further = place_models(space, "push", STEP, (0.01, 0.01), rows=[[0.0, 1.0]], fixed={24.0: 0.02})
    body, omega = np.ix_([0, 1, 3, 4], [0, 1, 3, 4]), 2.0 * np.pi * 24.0
    np.testing.assert_allclose(further.F[3][body], models.F[3], atol=1e-13)
    np.testing.assert_allclose(further.H[3, [2, 5]], [-(omega**2) / SCALE, -2.0 * 0.02 * omega], rtol=1e-13)
    pair = np.log(np.linalg.eigvals(further.F[3][np.ix_([2, 5], [2, 5])])) / STEP
    np.testing.assert_allclose([abs(pair[0]), pair[0].real], [omega, -0.02 * omega], rtol=1e-9)
    assert further.noise.shape == (9, 3, 6, 6) and not further.rows[:, :, [2, 5]].any()
    undamped = place_models(space, "push", STEP, 0.0)
    A = np.block([[np.zeros((2, 2)), 200 * np.pi * np.eye(2)], [space.A[2, 2:, :2] / (200 * np.pi), np.zeros((2, 2))]])
    np.testing.assert_allclose(undamped.F[2], expm(A * STEP), atol=1e-12)


def chances(bank: Bank, activity: float) -> Array:
    """Chances (D S, D S) to change in a step from one pair of speed and place to another."""
    D, S = len(bank.up), len(GRID)
    speeds = np.kron((1.0 - activity) * bank.rest + activity * bank.active, np.eye(S))
    places = np.zeros((D * S, D * S))
    for d in range(D):
        for i in range(S):
            up, down = bank.up[d] * (i < S - 1), bank.down[d] * (i > 0)
            places[d * S + i, d * S + i] = 1.0 - up - down
            if i < S - 1:
                places[d * S + i, d * S + i + 1] = up
            if i > 0:
                places[d * S + i, d * S + i - 1] = down
    return np.asarray(speeds @ places)


def test_the_bank_is_a_mixture_of_filters() -> None:
    """Blom and Bar-Shalom's equations, with a transition matrix over all pairs of speed and place.

    With a delay a place has the chance of the measurements so far and, from it on, of those that follow.
    """
    models, rng = string_models(), np.random.default_rng(1)
    sliding = SlidingNoise(moving=0.05, rest=1e-3, trust=0.3)
    settings = PositionSettings(mode_noise=(0.01, 0.02), speeds=(0.2, 1.0), floor=1e-4, spread=0.02, noise=sliding)
    v = np.repeat([1.0, 0.2, 0.0, 0.2, 1.0], len(GRID))
    observer = PositionObserver(models, settings)
    y, _ = moved(models, np.full(40, 5), rng)
    y[20] = np.nan
    power = np.abs(rng.standard_normal(40)) * 0.02
    found, bank = observer.run(y, power), observer.bank()
    D, S = len(bank.up), len(GRID)
    p, x, level = np.full(D * S, 1.0 / (D * S)), np.zeros((D * S, 4)), settings.floor
    likelihoods, filtered, changes = np.ones((40, D * S)), np.zeros((40, D * S)), list[Array]()
    for k in range(40):
        changes.append(chances(bank, power[k] / (power[k] + settings.active)))
        joint = p[:, None] * changes[k]
        p = joint.sum(axis=0)
        x = (joint.T @ x) / p[:, None]
        x = np.array([models.F[j % S] @ x[j] for j in range(D * S)])
        if np.isfinite(y[k]):
            e = np.array([y[k] - models.H[j % S] @ x[j] for j in range(D * S)])
            V = np.tile(bank.variance, D)
            size = p @ (e**2 / V)
            level += (settings.attack if size > level else settings.decay) * (size - level)
        level = max(level, settings.floor, settings.share * power[k])
        weight = -0.15 * np.log((power[k] + 1e-3) / (1e-3 + 0.05 * v**3)) ** 2
        if np.isfinite(y[k]):
            x += np.tile(bank.gain, (D, 1)) * e[:, None]
            weight -= 0.5 * settings.temper * (np.log(V) + e**2 / (V * level))
        likelihoods[k] = np.exp(weight - weight.max()) + (1e-10 / p if np.isfinite(y[k]) else 0.0)
        filtered[k] = p * likelihoods[k]
        p = filtered[k] / filtered[k].sum()
        np.testing.assert_allclose(found.probability[k], p.reshape(D, S).sum(axis=0), rtol=1e-9, atol=1e-14)
        np.testing.assert_allclose(found.states[k], p @ x, rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(found.level[k], level, rtol=1e-10)
    for delay, steps in ((0.005, 5), (math.inf, 40)):
        later = observer.run(y, power, delay).probability
        for k in range(40):
            behind = np.ones(D * S)  # chance of the measurements behind step k, up to `steps` of them
            for n in range(min(k + steps, 39), k, -1):
                behind = changes[n] @ (likelihoods[n] * behind)
            p = filtered[k] * behind / (filtered[k] @ behind)
            np.testing.assert_allclose(later[k], p.reshape(D, S).sum(axis=0), rtol=1e-9, atol=1e-14)


def test_the_place_is_found_from_the_acceleration() -> None:
    models, rng = string_models(), np.random.default_rng(2)
    places = np.repeat([1, 1, 6], 1000)
    y, beyond = moved(models, places, rng)
    settings = PositionSettings(mode_noise=(0.3, 0.3), speeds=(0.5,), floor=1e-3, start=0.005, quiet=1.0)
    found = PositionObserver(models, settings).run(y)
    true = GRID[places]
    settled = np.r_[800:2000, 2800:3000]
    assert np.abs(found.mean - true)[settled].mean() < 0.01
    low, high = found.band()
    assert np.mean((low <= true) & (true <= high)) > 0.7 and np.all(low <= high)
    assert np.corrcoef(found.outputs[settled, 0], beyond[settled])[0, 1] > 0.8


def test_wrong_input_is_refused() -> None:
    space, models = string_space(), string_models()
    for arguments in (("nothing", STEP, 0.01), ("push", STEP, (0.01, 0.01, 0.01))):
        with pytest.raises(InputError, match="observe"):
            place_models(space, *arguments)
    silent = PositionSettings(mode_noise=(1.0, 1.0), noise=SlidingNoise(rest=0.0))
    at_speeds = [PositionSettings(mode_noise=(1.0, 1.0), speeds=speeds) for speeds in ((100.0,), (), (np.nan,))]
    for settings in (PositionSettings(mode_noise=(1.0,)), *at_speeds, silent):
        with pytest.raises(InputError, match="observe"):
            PositionObserver(models, settings)
    with pytest.raises(InputError, match="acceleration"):
        PositionObserver(models, PositionSettings(mode_noise=(1.0, 1.0))).run(np.zeros((2, 2)))
    with pytest.raises(InputError, match="delay"):
        PositionObserver(models, PositionSettings(mode_noise=(1.0, 1.0))).run(np.zeros(2), delay=-1.0)
    for activity in (np.nan, -0.01, np.ones(3), np.array([0.1, np.inf])):
        with pytest.raises(InputError, match="activity"):
            PositionObserver(models, PositionSettings(mode_noise=(1.0, 1.0))).run(np.zeros(2), activity)
