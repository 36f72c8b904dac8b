"""The complementarity problem and the friction of a joint alone, beside all sets of closed contacts and bisection."""

from __future__ import annotations

import numpy as np
import pytest
from plain_step import complementary

from pmr.errors import SimulationError
from pmr.kernel.kernel import slide_pads, solve_contact


@pytest.mark.parametrize("seed", range(60))
def test_forces_are_those_of_the_only_complementary_set(seed: int) -> None:
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 9))
    R = rng.normal(size=(m, m + 1)) * 10.0 ** rng.uniform(-2.0, 2.0, (m, 1))
    A, b, pushes = R @ R.T, rng.normal(size=m), rng.random(m) < 0.8
    forces, closed = solve_contact(A, b, pushes, rng.random(m) < 0.5)
    expected, which = complementary(A, b, pushes)
    np.testing.assert_allclose(forces, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max(initial=1e-300))
    np.testing.assert_array_equal(closed, which)


def test_many_contacts_are_settled() -> None:
    """Of a chain of blocks on soft ground, half of them lifted."""
    m = 60
    A = np.diag(np.full(m, 2.0)) - np.diag(np.ones(m - 1), 1) - np.diag(np.ones(m - 1), -1) + 0.01 * np.eye(m)
    b = np.sin(np.arange(m))
    forces, _ = solve_contact(np.linalg.inv(A), b, np.ones(m, bool), np.zeros(m, bool))
    gaps = np.linalg.inv(A) @ forces - b
    assert forces.min() >= 0.0 and gaps.min() > -1e-10 and abs(forces @ gaps) < 1e-9 and 5 < (forces > 0.0).sum() < 55


def test_contacts_that_depend_on_each_other_are_refused() -> None:
    with pytest.raises(SimulationError, match="complementarity"):
        solve_contact(np.ones((2, 2)), np.ones(2), np.zeros(2, bool), np.ones(2, bool))


@pytest.mark.parametrize("seed", range(40))
def test_friction_of_a_joint_solves_its_equation(seed: int) -> None:
    """x + softness (sum f - given) = moved with f = clip(old + kappa x, -limit, limit), x by bisection."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))
    kappa, limits = 10.0 ** rng.uniform(4.0, 9.0, n), 10.0 ** rng.uniform(0.0, 5.0, n) * (rng.random(n) < 0.8)
    old = limits * rng.uniform(-1.0, 1.0, n)
    moved, given = float(rng.normal() * 1e-3), float(rng.normal() * 1e3)
    softness = 0.0 if seed % 3 == 0 else float(10.0 ** rng.uniform(-9.0, -6.0))

    def friction(x: float) -> np.ndarray:
        return np.clip(old + kappa * x, -limits, limits)

    low, high = -1.0, 1.0
    for _ in range(200):
        x = (low + high) / 2.0
        low, high = (low, x) if x + softness * (friction(x).sum() - given) > moved else (x, high)
    found = slide_pads(kappa, old, limits, moved, softness, given)
    np.testing.assert_allclose(found, friction(low), rtol=1e-9, atol=1e-9 * limits.max() + 1e-12 * kappa.max() * 1e-3)
