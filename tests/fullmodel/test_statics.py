"""Static solves under held rows against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

from pmr.errors import InputError
from pmr.fem.factor import refusal
from pmr.fullmodel import moving
from pmr.fullmodel.build import full_model
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.moving import static_solver
from pmr.system.rows import fixed_row, sparse_row

pytestmark = pytest.mark.mpi


def held(full: FullModel) -> tuple[list, np.ndarray]:
    """A coordinate, and two rows that couple others; and the dense inverse on what they leave free."""
    n = full.size
    mixed = np.random.default_rng(2).normal(size=(2, 6))
    at = np.array([[1, 4, 7, 10, 13, 40], [2, 4, 10, 20, 30, 43]])
    rows = [fixed_row("one", sparse_row(0, 1.0, n), (0.0, 5.0))]
    rows += [fixed_row(f"mixed {i}", sparse_row(at[i], mixed[i], n), (0.0, 5.0)) for i in range(2)]
    C = np.vstack([row.carriers.toarray() for row in rows])
    T = np.linalg.svd(C)[2][3:].T
    body = full.comm.bcast(full.gather())
    return rows, T @ np.linalg.solve(T.T @ body.K.toarray() @ T, T.T)


@pytest.mark.parametrize("solver", ["dense", "slepc"])
def test_answers_are_those_of_the_motions_that_the_rows_leave(load_scene, solver: str) -> None:
    full = full_model(load_scene("paper_simple", ["mesh.elements=20", "compare.against=[]"]))
    rows, inverse = held(full)
    g = np.random.default_rng(4).normal(size=(full.size, 3))
    share = slice(*full.M.getOwnershipRange())
    solve = static_solver(full, rows, solver)
    x = solve.solve(np.asfortranarray(g[share]))
    assert x == pytest.approx((inverse @ g)[share], abs=1e-8 * np.abs(inverse @ g).max())
    solve.destroy()


@pytest.mark.parametrize(("code", "said"), [(-13, "no memory"), (-10, "scene: body: .* singular")])
def test_no_memory_is_not_called_a_singular_stiffness(
    load_scene, monkeypatch: pytest.MonkeyPatch, code: int, said: str
) -> None:
    full = full_model(load_scene("paper_simple", ["mesh.elements=20", "compare.against=[]"]))

    def refused(A: object, name: str) -> None:
        raise refusal(name, code)

    monkeypatch.setattr(moving, "factor_for_columns", refused)
    with pytest.raises(InputError, match=said):
        static_solver(full, held(full)[0], "slepc")
