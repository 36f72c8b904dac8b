"""Rows on carriers against C(x) V and C(x) R C(y)^T of the full model, at path coordinates of their own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracle import carried_rows, enriched, free_modes, rich_body
from scipy.interpolate import PPoly

from pmr import InputError, ReducedModel
from pmr.system.body_matrices import describe_misfit
from pmr.system.carriers import CarrierRows
from pmr.system.polynomials import apply_table, evaluate
from pmr.system.truncation import extend, truncate

FULL = rich_body()
PLACES = [(0.3, 2.2), (1.0, 1.0), (4.1, 0.0)]


@pytest.fixture
def model() -> ReducedModel:
    return carried(9)


def carried(count: int) -> ReducedModel:
    return replace(enriched(FULL, count), carriers=carried_rows(FULL, count))


def rows_at(carriers: CarrierRows, x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
    """b(x) of the first row and b(y) of the second one."""
    first, second = carriers.row(0, "a"), carriers.row(1, "b")
    return first.weights(x).toarray()[0], second.weights(y).toarray()[0]


@pytest.mark.parametrize(("x", "y"), PLACES)
def test_two_rows_at_places_of_their_own(model: ReducedModel, x: float, y: float) -> None:
    V, R = free_modes(FULL, 9)
    full = [FULL.rows.rows[2].at(x).toarray()[0], FULL.rows.rows[3].at(y).toarray()[0]]
    assert model.carriers is not None and model.carriers.flexibility is not None
    a, b = rows_at(model.carriers, x, y)
    flexibility, U = model.carriers.flexibility, model.carriers.values
    scale = np.sqrt(full[0] @ R @ full[0] * (full[1] @ R @ full[1]))
    assert a @ flexibility.rows @ b == pytest.approx(full[0] @ R @ full[1], abs=1e-10 * scale)
    assert a @ flexibility.inputs == pytest.approx(full[0] @ R @ FULL.B, abs=1e-12)
    assert flexibility.outputs @ b == pytest.approx(FULL.outputs @ R @ full[1], abs=1e-12)
    assert b @ U == pytest.approx(full[1] @ V, abs=1e-10)


def test_modes_move_into_the_flexibility_and_back(model: ReducedModel) -> None:
    small = carried(5).carriers
    cut = truncate(truncate(model, 7), 5)
    assert cut.carriers is not None and small is not None and cut.enrichment is not None
    assert_same(cut.carriers, small)
    assert cut.carriers.enrichment.shape[1] == cut.enrichment.count == 4
    back = extend(extend(cut, 2)).carriers
    assert back is not None and model.carriers is not None
    assert_same(back, model.carriers)


def assert_same(found: CarrierRows, expected: CarrierRows) -> None:
    assert found.flexibility is not None and expected.flexibility is not None
    for name in ("rows", "inputs", "outputs", "direct", "energy"):
        a, b = getattr(found.flexibility, name), getattr(expected.flexibility, name)
        assert np.abs(a - b).max() < 1e-9 * np.abs(b).max(), name
    assert np.abs(found.values) == pytest.approx(np.abs(expected.values), abs=1e-9)


def test_the_file_keeps_them(model: ReducedModel, tmp_path: Path) -> None:
    found = ReducedModel.load(model.save(tmp_path / "m.npz")).carriers
    assert found is not None and model.carriers is not None
    assert_same(found, model.carriers)
    for x, y in PLACES:
        for a, b in zip(rows_at(found, x, y), rows_at(model.carriers, x, y), strict=True):
            assert np.array_equal(a, b)


def test_what_contradicts_itself_is_refused(model: ReducedModel, tmp_path: Path) -> None:
    assert model.carriers is not None and model.carriers.flexibility is not None
    lame = replace(model.carriers.flexibility, inputs=np.zeros((3, 2)))
    broken = replace(model, carriers=replace(model.carriers, flexibility=lame))
    with pytest.raises(InputError, match="carriers.flexibility.inputs has shape"):
        ReducedModel.load(broken.save(tmp_path / "m.npz"))


def test_fewer_rows_and_other_coordinates(model: ReducedModel) -> None:
    X = np.random.default_rng(2).normal(size=(9, 4))
    assert model.carriers is not None
    turned = model.carriers.project(X).with_rows([1])
    sizes = {"r": 4, "i": 2, "o": len(model.outputs)}
    assert describe_misfit(turned, sizes) is turned.contradiction(1) is None
    only, second = turned.row(0, "b"), model.carriers.row(1, "b")
    assert np.array_equal(only.weights(1.3).toarray(), second.weights(1.3).toarray())
    assert turned.values == pytest.approx(model.carriers.values @ X)


LENGTH = 5.0


def table(powers: int, m: int, r: int) -> PPoly:
    rng = np.random.default_rng(7 * powers + m + r)
    breaks = np.sort(np.concatenate([[0.0, LENGTH], rng.uniform(0.0, LENGTH, 9)]))
    return PPoly(rng.standard_normal((powers, 10, m, r)), breaks)


#: Forwards, backwards, at rest, onto breaks and ends, and from one end to the other at once.
PATH = np.concatenate(
    [np.linspace(0.0, LENGTH, 40), np.linspace(LENGTH, 0.0, 23), [2.0, 2.0, 2.0, LENGTH, 0.0, LENGTH]]
)


@pytest.mark.parametrize(("powers", "m", "r"), [(4, 3, 20), (7, 1, 1), (1, 2, 3), (4, 0, 5), (4, 2, 0)])
def test_it_is_the_product_with_the_values(powers: int, m: int, r: int) -> None:
    """To u times the sum of what adds up: r terms, each a polynomial by Horner's rule."""
    one = table(powers, m, r)
    path = np.concatenate([PATH, one.x, one.x[::-1]])
    x = np.random.default_rng(0).standard_normal((len(path), r))
    limit = np.finfo(float).eps * (r + 2 * powers) * np.abs(one.c).sum(axis=(0, 3)).max(initial=0.0) * LENGTH**powers
    for derivative in (0, 1):
        values = evaluate(one, path, derivative)
        found = apply_table(one, path, x, derivative)
        np.testing.assert_allclose(found, np.einsum("tmr,tr->tm", values, x), rtol=0.0, atol=powers * limit * 3.0)


def test_nan_stays_visible() -> None:
    one, x = table(4, 2, 3), np.ones((4, 3))
    x[2, 1] = np.nan
    assert np.isnan(apply_table(one, np.full(4, 1.3), x)).any(axis=1).tolist() == [False, False, True, False]


def test_beyond_the_path_nothing_is_said() -> None:
    with pytest.raises(ValueError, match="outside the path"):
        apply_table(table(4, 1, 2), np.array([1.0, LENGTH + 0.1]), np.ones((2, 2)))
    with pytest.raises(ValueError, match="outside the path"):
        apply_table(table(4, 1, 2), np.array([np.nan, 1.0]), np.ones((2, 2)))
