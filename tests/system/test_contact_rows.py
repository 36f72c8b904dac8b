"""Which contacts are rigid: those whose flexibility is round-off of the largest."""

from __future__ import annotations

import numpy as np
import pytest
from nested import with_round_off

from pmr.system.assembly import Assembly
from pmr.system.changing_rows import ChangingRows
from pmr.system.contact_rows import ROUND_OFF, is_round_off


def test_the_diagonal_decides_and_its_bound_counts() -> None:
    """|F_kl| is at most the root of F_kk F_ll where F is semidefinite: a common part may be larger than round-off."""
    below, above = 0.9 * ROUND_OFF, 1.1 * ROUND_OFF
    F = np.array([np.diag([1.0, below, above]), np.diag([0.0, 0.0, 1e-30])])
    F[0, 0, 1] = F[0, 1, 0] = 1e-8
    assert is_round_off(F).tolist() == [[False, True, False], [True, True, False]]
    assert is_round_off(F, 1e-9).tolist() == [[False, True, False], [True, True, True]]
    assert is_round_off(np.zeros((0, 0))).shape == (0,)


@pytest.mark.parametrize("noise", [0.0, 1e-27, 1e-25])
def test_a_contact_that_gives_way_by_round_off_is_rigid(noise: float) -> None:
    system = with_round_off(noise)
    at, clean = (Assembly(of).contact_rows(of.side_coordinates({"1": 2.5})) for of in (system, with_round_off(0.0)))
    assert at.rigid.tolist() == [True, False] and at.F[1, 1] > 1e-10
    np.testing.assert_allclose(at.F, clean.F, rtol=1e-12)
    assert not at.F[0].any() and not at.F[:, 0].any()
    changing = ChangingRows(Assembly(system), system.paths).evaluate(np.array([2.5]))
    assert changing.rows.rigid.tolist() == [True, False]
    for part in (changing.rows, changing.slopes, changing.curves):
        assert not part.F[..., 0, :].any() and not part.F[..., :, 0].any() and part.F[..., 1, 1].all()
