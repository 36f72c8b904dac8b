from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from nested import Nested, full
from numpy.typing import NDArray
from oracle import project, started

from pmr.errors import InputError
from pmr.simulation import InitialState
from pmr.simulation.start import consistent_start
from pmr.system.assembly import Assembly
from pmr.system.body import FullBody, SlidingBody
from pmr.system.rows import Rows

Array = NDArray[np.float64]
S, S_RATE = 2.1, 1.7  # m, m/s


@pytest.fixture(params=["sparse", "dense"])
def body(rich: FullBody, request: pytest.FixtureRequest) -> SlidingBody:
    return rich if request.param == "sparse" else project(rich, np.eye(rich.size)[:, 2:])


def rows_at(body: SlidingBody, derivative: int = 0) -> Array:
    return np.asarray(body.C(S, derivative) @ np.eye(body.size))


def any_state(body: SlidingBody) -> InitialState:
    """On the rows, with a velocity that is not."""
    random = np.random.default_rng(1)
    q, v = random.standard_normal((2, body.size))
    C = rows_at(body)
    return InitialState(q - np.linalg.pinv(C) @ (C @ q), v)


def test_without_initial_state_the_body_is_at_rest(body: SlidingBody) -> None:
    start = started(body, S, S_RATE, None)
    np.testing.assert_array_equal([start.q, start.v], np.zeros((2, body.size)))


def test_velocity_is_corrected_by_an_impulse_of_the_rows(body: SlidingBody) -> None:
    initial = any_state(body)
    start = started(body, S, S_RATE, initial)
    C, C_s = rows_at(body), rows_at(body, 1)
    np.testing.assert_allclose(C @ start.v, -S_RATE * C_s @ initial.q, atol=1e-12)
    np.testing.assert_array_equal(start.q, initial.q)
    impulse = body.M @ (start.v - initial.v)  # least kinetic energy: M dv lies in the range of C^T
    np.testing.assert_allclose(C.T @ np.linalg.lstsq(C.T, impulse, rcond=None)[0], impulse, atol=1e-12)


def test_a_consistent_velocity_is_kept(body: SlidingBody) -> None:
    once = started(body, S, S_RATE, any_state(body))
    np.testing.assert_array_equal(started(body, S, S_RATE, once).v, once.v)


def test_a_position_off_the_rows_is_refused_by_name(body: SlidingBody) -> None:
    initial = any_state(body)
    off = initial.q + 1e-3 * np.linalg.pinv(rows_at(body))[:, -1]
    with pytest.raises(InputError, match=r"row 'slider 0\.8' is violated by 0\.001"):
        started(body, S, S_RATE, InitialState(off, initial.v))


@pytest.mark.parametrize("wrong", [np.zeros(3), np.full(21, np.nan)])
def test_wrong_vectors_are_refused(rich: FullBody, wrong: Array) -> None:
    with pytest.raises(InputError, match="21 finite values are allowed"):
        started(rich, S, S_RATE, InitialState(np.zeros(21), wrong))


def test_contradicting_rows_are_refused(rich: FullBody) -> None:
    slider = rich.rows.rows[2]
    other = replace(slider, name="again", coefficients=2.0 * slider.coefficients)
    twice = replace(rich, rows=Rows((*rich.rows.rows, other), 21))
    with pytest.raises(InputError, match="depend on each other"):
        started(twice, S, S_RATE, any_state(rich))


def test_velocities_of_a_boom_are_corrected_on_all_its_rigid_contacts() -> None:
    """Of both bodies at once, with the least kinetic energy, while the inner one moves out."""
    system = full(Nested(2, elements=6, compliance=0.0))
    a, x, x_rate = Assembly(system), system.side_coordinates({"1": 2.0}), np.array([0.0, S_RATE, -S_RATE, 0.0])
    rows, rates = a.contact_rows(x).C, a.row_rates(x, x_rate)
    np.testing.assert_allclose(
        rates, (a.contact_rows(x + 1e-6 * x_rate).C - a.contact_rows(x - 1e-6 * x_rate).C) / 2e-6, atol=1e-5
    )
    q, v = np.random.default_rng(2).standard_normal((2, a.size))
    q -= np.linalg.pinv(rows) @ (rows @ q)
    initial = {}
    for name, body in system.bodies.items():
        state = InitialState.at_rest(body.size)
        state.q[a.free_coordinates[name]], state.v[a.free_coordinates[name]] = (
            q[a.coordinate_slices[name]],
            v[a.coordinate_slices[name]],
        )
        initial[name] = state
    found = consistent_start(a, x, x_rate, initial)
    after = np.concatenate([found[name].v[a.free_coordinates[name]] for name in system.bodies])
    assert np.abs(rows @ after + rates @ q).max() < 1e-9 * np.abs(rates @ q).max()
    impulse = a.M @ (after - v)
    residual = rows.T @ np.linalg.lstsq(rows.T, impulse, rcond=None)[0] - impulse
    assert np.abs(residual).max() < 1e-9 * np.abs(impulse).max()
