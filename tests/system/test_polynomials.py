import numpy as np
import pytest
from scipy.interpolate import PPoly

from pmr.system.polynomials import (
    add_tables,
    cardinal_spline,
    multiply_matrix,
    multiply_tables,
    select_columns,
    select_rows,
    transpose,
    value_or_zero,
)

RNG = np.random.default_rng(3)
S = np.linspace(0.0, 5.0, 41)


def table(powers: int, *shape: int, breaks: tuple[float, ...] = (0.0, 2.0, 5.0)) -> PPoly:
    return PPoly(RNG.standard_normal((powers, len(breaks) - 1, *shape)), breaks)


def test_products_of_tables_are_those_of_their_values() -> None:
    A, B, weights, X = table(4, 2, 5), table(3, 3, 5), RNG.standard_normal(5), RNG.standard_normal((5, 2))
    found = multiply_tables(A, B, np.diag(weights))
    assert found.c.shape == (6, 2, 2, 3)
    assert found(S) == pytest.approx(A(S) * weights @ B(S).swapaxes(1, 2), abs=1e-9)
    assert multiply_matrix(A, X)(S) == pytest.approx(A(S) @ X, abs=1e-10)
    assert np.array_equal(transpose(A)(S), A(S).swapaxes(1, 2))


@pytest.mark.parametrize("breaks", [(0.0, 2.0, 5.0), (0.0, 1.0, 3.0, 5.0)])
@pytest.mark.parametrize("powers", [2, 4, 5])
def test_sums_take_any_degrees_and_breaks(powers: int, breaks: tuple[float, ...]) -> None:
    A, B = table(4, 2, 2), table(powers, 2, 2, breaks=breaks)
    before = A(S), B(S)
    assert add_tables(A, B, -0.3)(S) == pytest.approx(A(S) - 0.3 * B(S), abs=1e-9)
    assert np.array_equal(A(S), before[0]) and np.array_equal(B(S), before[1])


def test_a_product_has_a_matrix_between() -> None:
    A, B, W = table(4, 2, 5), table(3, 3, 4), RNG.standard_normal((5, 4))
    assert multiply_tables(A, B, W)(S) == pytest.approx(A(S) @ W @ B(S).swapaxes(1, 2), abs=1e-9)


def test_parts_of_a_table() -> None:
    A = table(4, 2, 5)
    assert select_columns(A, slice(3, None))(S) == pytest.approx(A(S)[:, :, 3:], abs=1e-9)
    assert select_rows(A, [1])(S) == pytest.approx(A(S)[:, 1:], abs=1e-9)


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
