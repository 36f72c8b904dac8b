from __future__ import annotations

import numpy as np
import pytest

from pmr.errors import InputError
from pmr.scene.signals import Constant, Ramp
from pmr.simulate import TimeStepping
from pmr.simulate.stepping import loads_at, one_for_each, path_at


def test_times_are_all_steps() -> None:
    stepping = TimeStepping(end=0.3, step=0.1)
    assert stepping.steps == 3
    np.testing.assert_allclose(stepping.times, [0.0, 0.1, 0.2, 0.3], atol=1e-15)


@pytest.mark.parametrize(
    ("values", "key"),
    [
        ((1.0, 0.3), "time.step"),
        ((1.0, 0.0), "time.step"),
        ((1.0, 2.0), "time.step"),
        ((1.0, 0.1, 1.5), "time.rho_inf"),
    ],
)
def test_what_is_no_time_grid_is_refused(values: tuple[float, ...], key: str) -> None:
    with pytest.raises(InputError) as error:
        TimeStepping(*values)
    assert error.value.key == key


def test_path_outside_its_domain_is_refused_with_the_time() -> None:
    path, t = Ramp(times=(0.0, 1.0), values=(1.0, 3.0)), np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(path_at(path, (0.0, 5.0), t), 1.0 + 2.0 * t)
    with pytest.raises(InputError, match=r"slider\.path = 2\.6: 0 to 2\.5 m is allowed; left at t = 0\.8 s"):
        path_at(path, (0.0, 2.5), t)


def test_round_off_at_the_end_of_the_domain_is_allowed() -> None:
    path = Constant(amount=5.0 + 1e-12)
    np.testing.assert_array_equal(path_at(path, (0.0, 5.0), np.zeros(1)), [5.0])


def test_one_column_a_load() -> None:
    loads, t = [Constant(amount=2.0), Ramp(times=(0.0, 1.0), values=(0.0, 1.0))], np.array([0.0, 0.5])
    np.testing.assert_array_equal(loads_at(loads, t), [[2.0, 0.0], [2.0, 0.5]])
    assert loads_at([], t).shape == (2, 0)


def test_each_input_needs_a_load() -> None:
    one_for_each([Constant(amount=1.0)], ["F"])
    with pytest.raises(InputError, match="1 given, one for each input is allowed: F, T"):
        one_for_each([Constant(amount=1.0)], ["F", "T"])
