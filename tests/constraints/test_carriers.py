from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from pmr.constraints.carriers import RowOnCarriers, on_carriers, path_of
from pmr.constraints.rows import Row, Rows

BREAKS = np.array([0.0, 0.4, 1.0, 1.5])


def path(compliance: float = 0.0) -> Row:
    """c(s) over five carriers, three of them in each interval."""
    coefficients = np.random.default_rng(1).normal(size=(3, 3, 3))
    return Row("pad", BREAKS, np.array([[0, 1, 2], [1, 2, 3], [2, 3, 4]]), coefficients, compliance)


def carriers() -> sp.csr_matrix:
    """Carriers that touch from one to four of twelve coordinates."""
    U = np.zeros((5, 12))
    for k, touched in enumerate(([0, 1], [1], [1, 3, 4, 7], [7, 8], [11])):
        U[k, touched] = np.arange(1, len(touched) + 1) + 0.5 * k
    return sp.csr_matrix(U)


def plain() -> Row:
    return Row("slider", BREAKS[[0, 3]], np.array([[2, 7]]), np.array([[[1.0, -2.0]], [[0.5, 3.0]]]))


def dense(row: Row, s: float, size: int) -> np.ndarray:
    return Rows((row,), size).at(s).toarray()[0]


@pytest.mark.parametrize("s", [0.0, 0.2, 0.4, 0.77, 1.3, 1.5])
def test_a_carried_row_is_its_path_times_its_carriers(s: float) -> None:
    row = on_carriers(path(2e-9), carriers())
    assert dense(row, s, 12) == pytest.approx(dense(path(), s, 5) @ carriers(), abs=1e-13)
    derivative = Rows((row,), 12).at(s, derivative=1).toarray()[0]
    assert derivative == pytest.approx(Rows((path(),), 5).at(s, derivative=1).toarray()[0] @ carriers(), abs=1e-13)
    assert (row.name, row.compliance) == ("pad", 2e-9)


def test_each_interval_touches_different_coordinates() -> None:
    """A dense row is put together by assignment, so a coordinate listed twice would be lost."""
    row = on_carriers(path(), carriers())
    assert row.dofs.shape[1] < 12
    assert all(len(set(interval)) == row.dofs.shape[1] for interval in row.dofs.tolist())


def test_finer_breaks_keep_row_and_carriers() -> None:
    row = on_carriers(path(), carriers())
    finer = row.refined(np.array([0.0, 0.1, 0.4, 0.5, 1.0, 1.25, 1.5]))
    assert isinstance(finer, RowOnCarriers) and len(finer.path.breaks) == 7
    for s in (0.05, 0.3, 1.1, 1.4):
        assert dense(finer, s, 12) == pytest.approx(dense(row, s, 12), abs=1e-13)


def test_a_path_holds_all_rows_in_as_few_loads_as_there_are() -> None:
    rows = [plain(), on_carriers(path(), carriers()), plain(), on_carriers(path(), 2.0 * carriers())]
    found = path_of(rows, 12)
    assert found.loads.shape == (12, 2 + 5 + 5)
    for s in (0.1, 0.6, 1.45):
        for row, over_loads in zip(rows, found.rows, strict=True):
            assert found.loads @ dense(over_loads, s, 12) == pytest.approx(dense(row, s, 12), abs=1e-13)
