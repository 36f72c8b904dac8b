from __future__ import annotations

import numpy as np
import pytest

from pmr.errors import InputError
from pmr.simulation import TimeStepping


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
