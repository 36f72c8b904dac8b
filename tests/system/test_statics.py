"""Equilibria as solutions of one symmetric system for coordinates and forces."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from pmr.system.contact_rows import ContactRows
from pmr.system.statics import saddle_point_solver


@pytest.mark.parametrize("K", [0.0, 1e6])
def test_a_rigid_motion_on_springs_has_an_answer(K: float) -> None:
    """(K + C^2 / F) q = f: where there is no stiffness but the springs', too."""
    rows = ContactRows(np.array([[0.1]]), np.array([[3e-8]]), np.zeros((1, 1)), np.zeros((1, 1)))
    q, force = saddle_point_solver(sp.csr_matrix([[K]]), rows)(np.array([1.0, 0.0]))
    assert q == pytest.approx(1.0 / (K + 0.01 / 3e-8)) and force == pytest.approx(0.1 * q / 3e-8)
