"""Rows of contacts as functions of paths, beside those at places, and their derivatives beside differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from nested import Nested, full, reduced

from pmr.errors import InputError
from pmr.system.assembly import Assembly
from pmr.system.changing_rows import ChangingRows
from pmr.system.system import System

STEP = 1e-4  # m: of cubics, differences leave their third derivative times its square


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("make", [reduced, lambda nested, modes: full(nested)])
def test_rows_and_derivatives(count: int, make) -> None:
    assembly = Assembly(make(Nested(count, elements=6, compliance=1e-7), 3))
    names = ("0", *assembly.system.paths)
    changing, s = ChangingRows(assembly, names), np.array([0.0, *(1.03 + 0.2 * k for k in range(len(names) - 1))])
    found, expected = (
        changing.evaluate(s),
        assembly.contact_rows(assembly.system.side_coordinates(dict(zip(names, s, strict=True)))),
    )
    for what in "CFH":
        exact = getattr(expected, what)
        np.testing.assert_allclose(getattr(found.rows, what), exact, rtol=0.0, atol=1e-13 * np.abs(exact).max())
    for p, moved in enumerate(STEP * np.eye(len(names))):
        before, after = changing.evaluate(s - moved), changing.evaluate(s + moved)
        for what in "CFH":
            for of, by in (("rows", "slopes"), ("slopes", "curves")):
                difference = (getattr(getattr(after, of), what) - getattr(getattr(before, of), what)) / (2.0 * STEP)
                exact = getattr(getattr(found, by), what)[p]
                np.testing.assert_allclose(exact, difference, rtol=0.0, atol=1e-6 * np.abs(exact).max(initial=0.0))
    assert np.abs(found.slopes.C[1]).max() > 0.0 and not found.slopes.C[0].any()


def test_rates_of_paths_that_move_together() -> None:
    assembly = Assembly(reduced(Nested(3, elements=6), 3))
    changing, s, rates = ChangingRows(assembly, assembly.system.paths), np.array([1.03, 1.23]), np.array([0.3, -0.7])
    at = [changing.evaluate(s + k * STEP * rates).rows for k in (-1, 0, 1)]
    first, second = changing.evaluate(s).time_derivatives(rates)
    for what in "CFH":
        before, now, after = (getattr(one, what) for one in at)
        for exact, difference in (
            (getattr(first, what), (after - before) / (2.0 * STEP)),
            (getattr(second, what), (after - 2.0 * now + before) / STEP**2),
        ):
            np.testing.assert_allclose(exact, difference, rtol=0.0, atol=1e-5 * np.abs(exact).max())


def test_what_is_refused() -> None:
    system = reduced(Nested(2, elements=6), 3)
    with pytest.raises(InputError, match="tail 1.place = 20.15"):
        ChangingRows(Assembly(system), system.paths).evaluate(np.array([20.0]))
    tables = System.of(replace(system.bodies["0"], carriers=None))
    with pytest.raises(InputError, match="free_modes"):
        ChangingRows(Assembly(tables), tables.paths)
