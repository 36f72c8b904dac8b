from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.interpolate import PPoly

from pmr.fullmodel.pads import slider_row
from pmr.models.beam2d import Beam2D
from pmr.scene.signals.base import Interval
from pmr.scene.structures import Profile
from pmr.system.polynomials import evaluate, stack_tables
from pmr.system.rows import (
    Row,
    RowPolynomials,
    Rows,
    StraightRows,
    dense_entries,
    fixed_row,
    row_on_coordinates,
    sparse_row,
)

RNG = np.random.default_rng(1)


def random_row(name: str = "slider", breaks=(0.0, 0.4, 1.0, 2.0), size: int = 12) -> Row:
    k = len(breaks) - 1
    dofs = np.array([RNG.choice(size, 4, replace=False) for _ in range(k)])
    return row_on_coordinates(name, np.array(breaks), dofs, RNG.standard_normal((4, k, 4)), size)


def carried_row(name: str = "pad", compliance: float = 0.0, factor: float = 1.0) -> Row:
    """Over five carriers of one to four of twelve coordinates, three of them on each interval."""
    U = np.zeros((5, 12))
    for k, touched in enumerate(([0, 1], [1], [1, 3, 4, 7], [7, 8], [11])):
        U[k, touched] = factor * (np.arange(1, len(touched) + 1) + 0.5 * k)
    touched = np.array([[0, 1, 2], [1, 2, 3], [2, 3, 4]])
    coefficients = np.random.default_rng(1).normal(size=(3, 3, 3))
    return Row(name, np.array([0.0, 0.4, 1.0, 1.5]), sp.csr_matrix(U), touched, coefficients, compliance)


def dense(row: Row, s: float, derivative: int = 0) -> np.ndarray:
    return row.at(s, derivative).toarray()[0]


def test_entries_are_the_polynomial_of_their_interval() -> None:
    row = random_row()
    x = 0.7 - 0.4
    expected = sum(row.coefficients[p, 1] * x ** (3 - p) for p in range(4))
    dofs = row.carriers.indices[row.touched[1]]
    assert dense(row, 0.7)[dofs] == pytest.approx(expected) and np.count_nonzero(dense(row, 0.7)) == 4
    slope = sum((3 - p) * row.coefficients[p, 1] * x ** (2 - p) for p in range(3))
    assert dense(row, 0.7, derivative=1)[dofs] == pytest.approx(slope)


def test_a_row_within_ranges_is_zero_elsewhere_and_touches_no_carriers_there() -> None:
    row = carried_row()
    within = row.restrict_to([Interval(0.1, 0.2), Interval(0.0, 0.4 - 1e-12)])  # up to a break, but for round-off
    for s in (0.0, 0.3, 0.7):
        assert np.array_equal(dense(within, s), dense(row, s))
    assert not dense(within, 1.2).any() and not np.isin(4, within.touched)
    last = row.restrict_to([Interval(1.2, 1.5)])
    assert np.array_equal(dense(last, 1.3), dense(row, 1.3)) and not dense(last, 0.7).any()
    assert not np.isin([0, 1], last.touched).any()


@pytest.mark.parametrize("s", [0.0, 0.2, 0.4, 0.77, 1.3, 1.5])
@pytest.mark.parametrize("derivative", [0, 1])
def test_a_row_is_its_weights_times_its_carriers(s: float, derivative: int) -> None:
    row = carried_row()
    j = min(np.searchsorted(row.breaks, s, side="right") - 1, 2)
    powers = np.poly1d([1.0, 0.0, 0.0]), np.poly1d([1.0, 0.0]), np.poly1d([1.0])
    b = sum(c * p.deriv(derivative)(s - row.breaks[j]) for c, p in zip(row.coefficients[:, j], powers, strict=True))
    assert dense(row, s, derivative) == pytest.approx(b @ row.carriers.toarray()[row.touched[j]], abs=1e-13)


def test_the_slope_of_a_row_is_a_row() -> None:
    """Of a cubic its derivative, of a row that stays nothing, on the same carriers."""
    for row in (random_row(), carried_row(), fixed_row("w", sparse_row(3, 1.0, 12), (0.0, 1.5))):
        for s in (0.3, 1.2):
            assert dense(row.slope, s) == pytest.approx(dense(row, s, derivative=1), abs=1e-13)


def test_finer_breaks_keep_the_row_and_its_carriers() -> None:
    row = carried_row()
    finer = row.refine(np.array([0.0, 0.1, 0.4, 0.5, 1.0, 1.25, 1.5]))
    assert finer.carriers is row.carriers and len(finer.breaks) == 7
    for s in (0.05, 0.3, 1.1, 1.4):
        assert dense(finer, s) == pytest.approx(dense(row, s), abs=1e-13)


def test_rows_share_each_carrier_that_they_touch() -> None:
    """Carriers of many coordinates each: those of one row are its double's and another's too."""
    U = sp.csr_matrix(np.random.default_rng(4).normal(size=(5, 40)))
    first = replace(carried_row("a"), carriers=U)
    rows = [first, replace(first, name="b", carriers=2.0 * U), replace(first, name="c")]
    shared = Rows(tuple(rows), 40).shared_carriers
    assert shared.carriers.shape == (5 + 5, 40)
    for s in (0.1, 0.6, 1.45):
        for row, on_shared in zip(rows, shared.rows, strict=True):
            assert on_shared.carriers is shared.carriers and on_shared.name == row.name
            assert dense(on_shared, s) == pytest.approx(dense(row, s), abs=1e-12)


def test_rows_that_touch_few_coordinates_share_these() -> None:
    """Of seven rows with 25 carriers and more that lie on twelve coordinates."""
    pads = [carried_row(f"pad {factor}", factor=factor) for factor in (1.0, 2.0, 3.0, 5.0, 7.0)]
    rows = [random_row("a"), *pads, random_row("b")]
    touched = np.unique(np.concatenate([(abs(row.carriers)).indices[row.carriers.data != 0.0] for row in rows]))
    shared = Rows(tuple(rows), 12).shared_carriers
    assert np.array_equal(shared.carriers.toarray(), np.eye(12)[touched])
    for s in (0.1, 0.6, 1.45):
        for row, on_shared in zip(rows, shared.rows, strict=True):
            assert on_shared.name == row.name
            for derivative in (0, 1):
                assert dense(on_shared, s, derivative) == pytest.approx(dense(row, s, derivative), abs=1e-13)


def test_entries_of_a_row_and_back() -> None:
    row = replace(carried_row(), touched=np.array([[0, 1, 2], [1, 2, 2], [4, 4, 4]]))
    touched, coefficients = dense_entries(row.entries, 3)
    again = replace(row, touched=touched, coefficients=coefficients)
    assert touched.shape == (3, 3) and coefficients.shape == (3, 3, 3)
    for s in (0.1, 0.6, 1.45):
        assert dense(again, s) == pytest.approx(dense(row, s), abs=1e-13)


def test_carriers_that_no_interval_touches_are_left_out() -> None:
    row = carried_row()
    first = Row("first", row.breaks[:2], row.carriers, row.touched[:1], row.coefficients[:, :1])
    assert Rows((first,), 12).shared_carriers.carriers.shape == (
        3,
        12,
    )  # as many carriers of coordinates 0, 1, 3, 4 and 7
    assert Rows((), 12).shared_carriers.carriers.shape == (0, 12)


def test_apply_is_the_row_times_each_state() -> None:
    row, s = random_row(), np.array([0.0, 0.4, 0.9, 2.0])
    q = RNG.standard_normal((4, 12))
    for derivative in (0, 1):
        expected = [dense(row, at, derivative) @ state for at, state in zip(s, q, strict=True)]
        assert row.apply(s, q, derivative) == pytest.approx(expected)


def test_projection_is_the_row_times_the_basis_whole_or_in_shares() -> None:
    row, V = random_row(), RNG.standard_normal((12, 5))
    whole = row.project(V)
    shares = [row.project(V[:5], 0), row.project(V[5:5], 5), row.project(V[5:], 5)]
    for s in np.linspace(0.0, 2.0, 21):
        assert whole(s) == pytest.approx(dense(row, s, 0) @ V)
        assert sum(share(s) for share in shares) == pytest.approx(whole(s))


def test_stacked_rows_keep_their_values_on_common_breaks() -> None:
    V = RNG.standard_normal((12, 3))
    first, second = random_row("a"), random_row("b", (-0.5, 0.3, 1.4, 1.9))
    fixed = fixed_row("c", sparse_row([4, 7], [1.0, -2.0], 12), (0.0, 3.0))
    table = stack_tables([row.project(V) for row in (first, second, fixed)], Rows((first, second, fixed), 12).domain)
    assert (table.x[0], table.x[-1]) == (0.0, 1.9) and set(np.round(table.x, 9)) == {0.0, 0.3, 0.4, 1.0, 1.4, 1.9}
    for s in np.linspace(0.0, 1.9, 39):
        for i, row in enumerate((first, second, fixed)):
            for derivative in range(3):
                expected = dense(row, s, derivative) @ V
                assert evaluate(table, s, derivative)[i] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_breaks_that_differ_by_round_off_are_one() -> None:
    rows = [PPoly(np.ones((2, 2, 1)), [0.0, 0.5, 1.0]), PPoly(np.ones((2, 2, 1)), [0.0, 0.5 + 1e-15, 1.0])]
    assert len(stack_tables(rows, (0.0, 1.0)).x) == 3


def test_rows_make_a_sparse_matrix() -> None:
    rows = Rows((fixed_row("pin", sparse_row(3, 1.0, 12), (0.0, 2.0)), random_row()), 12)
    C = rows.at(0.7)
    assert C.shape == (2, 12) and C.nnz == 5 and rows.names == ("pin", "slider")
    assert C.toarray()[1] == pytest.approx(dense(rows.rows[1], 0.7, 0))
    assert rows.at(0.7, derivative=1).toarray()[0] == pytest.approx(np.zeros(12))


@pytest.mark.parametrize("s", [-0.1, 2.1, np.nan])
def test_outside_the_path_there_is_no_row(s: float) -> None:
    row = random_row()
    with pytest.raises(ValueError, match="allowed are 0 to 2 m"):
        row.at(s)
    with pytest.raises(ValueError, match="allowed are 0 to 2 m"):
        row.apply(np.array([1.0, s]), np.zeros((2, 12)))
    assert np.array_equal(dense(row, 2.0 + 1e-12), dense(row, 2.0))


RNG_PRODUCTS = np.random.default_rng(3)
BREAKS = np.array([0.0, 0.4, 1.0, 1.5])
U = sp.identity(7, format="csr")


def rows() -> list[Row]:
    """Two rows of different degree on seven carriers, some of which both touch."""
    touched = np.array([[0, 1, 2], [2, 3, 3], [5, 4, 0]])
    first = Row("a", BREAKS, U, touched, RNG_PRODUCTS.normal(size=(4, 3, 3)))
    return [first, Row("b", BREAKS, U, touched[::-1, :2], RNG_PRODUCTS.normal(size=(2, 3, 2)))]


def test_tables_are_products_of_weights_and_what_carriers_measure() -> None:
    both, X, half = rows(), RNG_PRODUCTS.normal(size=(7, 5)), RNG_PRODUCTS.normal(size=(7, 7))
    R, C = half @ half.T, RowPolynomials.from_rows(both, both[0].breaks)
    table, squared = C.times(X), C.quadratic_form(R)
    for s in (0.0, 0.2, 0.7, 1.2, 1.5):
        b = np.vstack([row.weights(s).toarray() for row in both])
        assert table(s) == pytest.approx(b @ X, abs=1e-12)
        assert squared(s) == pytest.approx(b @ R @ b.T, abs=1e-12)
    assert np.array_equal(squared.c, squared.c.swapaxes(2, 3))


BEAM = Beam2D(
    Profile(length=3.0, bending_stiffness=1e6, mass_per_length=10.0, axial=False), np.array([0.0, 0.7, 1.6, 3.0])
)


@pytest.mark.parametrize("end", [0.0, 1.1, 1.6, 3.0])
@pytest.mark.parametrize("x", [0.2, 0.7, 2.9])
def test_rows_are_what_bends_between_two_places(end: float, x: float) -> None:
    """Of a cubic, which the elements hold exactly, on both sides of the place that stays; zero for rigid motions."""
    w = np.poly1d([0.3, -0.5, 0.2, 0.1])
    q = np.stack([w(BEAM.nodes), w.deriv()(BEAM.nodes)], axis=1).ravel()
    first, second = StraightRows(end, ("a", "b")).rows(slider_row(BEAM))
    chord = w(end) - w(x)
    assert (first.at(x) @ q).item() == pytest.approx((x - end) * w.deriv()(end) + chord, abs=1e-13)
    assert (second.at(x) @ q).item() == pytest.approx((x - end) * w.deriv()(x) + chord, abs=1e-13)
    rigid = np.stack([[1.0, 0.0]] * 4).ravel(), np.stack([BEAM.nodes, np.ones(4)], axis=1).ravel()
    assert np.abs(np.concatenate([row.at(x) @ one for row in (first, second) for one in rigid])).max() < 1e-14
    assert (first.name, second.name) == ("a", "b")
