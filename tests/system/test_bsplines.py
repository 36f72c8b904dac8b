from __future__ import annotations

import numpy as np
import pytest

from pmr.system.polynomials import cardinal_spline, value_or_zero


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_bump_has_its_knots_its_integral_and_is_even(degree: int) -> None:
    b = cardinal_spline(degree, 0.5)
    half = (degree + 1) / 4.0
    assert (b.x[0], b.x[-1], len(b.x)) == (-half, half, degree + 2)
    assert b.integrate(-half, half) == pytest.approx(0.5, rel=1e-14)
    x = np.linspace(0.0, half, 33)
    assert value_or_zero(b, x) == pytest.approx(value_or_zero(b, -x), abs=1e-14)
    assert np.all(value_or_zero(b, np.array([-half - 0.1, half, half + 3.0])) == 0.0)


@pytest.mark.parametrize("parts", [1, 2, 3])
def test_sums_over_a_lattice_move_as_a_rigid_body(parts: int) -> None:
    b, lattice = cardinal_spline(3, 0.6), 0.6 / parts * np.arange(-40, 41)
    for s in (0.0, 0.123, -1.7, 2.9999):
        weights = value_or_zero(b, lattice - s) / parts
        assert weights.sum() == pytest.approx(1.0, rel=1e-13)
        assert weights @ lattice == pytest.approx(s, abs=1e-13)
        # The spread about s stays what it is too: a parabola is measured without a ripple.
        assert weights @ (lattice - s) ** 2 == pytest.approx(0.6**2 / 3.0, rel=1e-12)


def test_a_cubic_bump_is_twice_continuously_differentiable() -> None:
    b = cardinal_spline(3, 1.0)
    for order in range(3):
        left, right = (b(b.x[1:-1] + side, nu=order) for side in (-1e-9, 1e-9))
        assert left == pytest.approx(right, abs=1e-7)
    assert np.all(np.abs(np.diff(b(b.x[:-1] + 0.5, nu=3))) > 1.0)
