from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from pmr.system.rows import Row, RowPolynomials

RNG = np.random.default_rng(3)
BREAKS = np.array([0.0, 0.4, 1.0, 1.5])
U = sp.identity(7, format="csr")


def rows() -> list[Row]:
    """Two rows of different degree on seven carriers, some of which both touch."""
    touched = np.array([[0, 1, 2], [2, 3, 3], [5, 4, 0]])
    first = Row("a", BREAKS, U, touched, RNG.normal(size=(4, 3, 3)))
    return [first, Row("b", BREAKS, U, touched[::-1, :2], RNG.normal(size=(2, 3, 2)))]


@pytest.mark.parametrize("sparse", [False, True])
def test_tables_are_products_of_weights_and_what_carriers_measure(sparse: bool) -> None:
    both, X, half = rows(), RNG.normal(size=(7, 5)), RNG.normal(size=(7, 7))
    R, C = half @ half.T, RowPolynomials.from_rows(both)
    table, squared = C.times(X), C.quadratic_form(sp.csr_matrix(R) if sparse else R)
    for s in (0.0, 0.2, 0.7, 1.2, 1.5):
        b = np.vstack([row.weights(s).toarray() for row in both])
        assert table(s) == pytest.approx(b @ X, abs=1e-12)
        assert squared(s) == pytest.approx(b @ R @ b.T, abs=1e-12)
    assert np.array_equal(squared.c, squared.c.swapaxes(2, 3))
