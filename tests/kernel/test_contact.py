"""The complementarity problem and the friction of a joint alone, beside all sets of closed contacts and bisection."""

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields

import numpy as np
import pytest
from plain_step import complementary

from pmr.kernel._native import lib
from pmr.kernel.laws import (
    ContactError,
    ContactSearch,
    FixedPoint,
    JointCylinder,
    SchemeFactors,
    slide_pads,
    solve_contact,
)
from pmr.scene.joints import FrictionLaw


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
    with pytest.raises(ContactError, match="contact 1 depends") as error:
        solve_contact(np.ones((2, 2)), np.ones(2), np.zeros(2, bool), np.ones(2, bool))
    assert error.value.row == 1


@pytest.mark.parametrize("seed", range(20))
def test_a_search_whose_forces_the_caller_solves_for_ends_with_the_same_contacts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 12))
    R = rng.normal(size=(m, m + 1))
    A, b, pushes = R @ R.T, rng.normal(size=m), np.ones(m, bool)
    search, closed = ContactSearch(), rng.random(m) < 0.5
    for _ in range(1000):
        forces = np.zeros(m)
        forces[closed] = np.linalg.solve(A[np.ix_(closed, closed)], b[closed])
        wrong = np.where(closed, forces < -1e-12, A @ forces - b < -1e-12)
        if not wrong.any():
            break
        closed = search.change(closed, wrong)
    expected, which = solve_contact(A, b, pushes, pushes)
    np.testing.assert_allclose(forces, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max(initial=1e-300))
    np.testing.assert_array_equal(closed, which)


def test_wrong_contacts_change_sides_together_three_times_at_most_without_progress() -> None:
    """Then the first of them alone, until there are fewer."""
    search, closed, wrong = ContactSearch(), np.zeros(3, bool), np.array([False, True, True])
    changed = [search.change(closed, wrong).tolist() for _ in range(6)]
    assert changed == [[False, True, True]] * 4 + [[False, True, False]] * 2
    assert search.change(closed, np.array([True, False, False])).tolist() == [True, False, False]
    assert search.change(closed, np.array([True, False, True])).tolist() == [True, False, True]


@pytest.mark.parametrize("ranks", [1, 3])
def test_a_linear_fixed_point_takes_as_many_iterates_as_it_has_eigenvalues(ranks: int) -> None:
    """phi(x) = b - 50 x in one direction, -3 x in another, 0.5 x elsewhere, which diverges by itself."""
    rng = np.random.default_rng(1)
    Q, _ = np.linalg.qr(rng.normal(size=(9, 9)))
    A, b = Q @ np.diag([-50.0, -3.0, *(7 * [0.5])]) @ Q.T, rng.normal(size=9)
    own = np.array_split(np.arange(9), ranks)
    parts = [FixedPoint(len(at), add_up=lambda value, k=k: totals(k, value)) for k, at in enumerate(own)]
    if ranks == 1:
        parts = [FixedPoint(9)]
    barrier, values = threading.Barrier(ranks), np.zeros(ranks)

    def totals(k: int, value: float) -> float:
        values[k] = value
        barrier.wait()
        total = float(values.sum())
        barrier.wait()
        return total

    x = np.zeros(9)
    with ThreadPoolExecutor(ranks) as pool:
        for _ in range(4):
            phi = b + A @ x
            x = np.concatenate(list(pool.map(lambda part, at: part.next(x[at], phi[at]), parts, own)))  # noqa: B023
    np.testing.assert_allclose(x, np.linalg.solve(np.eye(9) - A, b), rtol=1e-10)


def test_an_error_while_ranks_add_up_is_raised() -> None:
    def fail(value: float) -> float:
        raise ValueError(f"no total of {value:g}")

    iteration = FixedPoint(2, add_up=fail)
    iteration.next(np.zeros(2), np.array([1.0, 2.0]))
    with pytest.raises(ValueError, match="no total of 5"):
        iteration.next(np.zeros(2), np.array([2.0, 4.0]))


@pytest.mark.parametrize("rho", [0.0, 0.6, 0.9, 1.0])
def test_factors_solve_the_equations_of_the_scheme(rho: float) -> None:
    """Chung and Hulbert 1993, eq. 25, with the step's equations written out for one number."""
    h, (z, v, a, old, new) = 0.01, np.random.default_rng(0).normal(size=5)
    a_m, a_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    gamma, beta = 0.5 + a_f - a_m, (1.0 + a_f - a_m) ** 2 / 4.0
    a_next = ((1.0 - a_f) * new + a_f * old - a_m * a) / (1.0 - a_m)
    z_next = z + h * v + h**2 * ((0.5 - beta) * a + beta * a_next)
    v_next = v + h * ((1.0 - gamma) * a + gamma * a_next)
    c = SchemeFactors.of(h, rho)
    assert c.h == h
    ends = (
        z + h * v + c.z_from_share * a + c.z_from_force * old + c.z_gain * new,
        v + c.v_from_share * a + c.v_from_force * old + c.v_gain * new,
        c.a_from_share * a + c.a_from_force * old + c.gain * new,
    )
    np.testing.assert_allclose(ends, (z_next, v_next, a_next), rtol=1e-13)


@pytest.mark.parametrize("seed", range(40))
def test_friction_of_a_joint_solves_its_equation(seed: int) -> None:
    """Slip x of elements that stick as springs, on a cylinder that gives way less the softer what it pushes is."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))
    kappa, mu_k = 10.0 ** rng.uniform(4.0, 9.0, n), rng.uniform(0.05, 0.3, n)
    mu_s, falls_by, speed = mu_k * rng.choice([1.0, 1.5], n), rng.uniform(0.01, 0.1, n), float(rng.uniform(0.0, 0.1))
    mu = mu_k + (mu_s - mu_k) * np.exp(-speed / falls_by)
    forces = 10.0 ** rng.uniform(0.0, 6.0, n) * rng.choice([-1.0, 0.0, 1.0], n, p=[0.4, 0.2, 0.4])
    limits = mu * np.abs(forces)
    old = limits * rng.uniform(-1.0, 1.0, n)
    moved, force, given, drive = float(rng.normal() * 1e-3), *(rng.normal(size=3) * 1e3).tolist()
    gives = 0.0 if seed % 3 == 0 else float(10.0 ** rng.uniform(-9.0, -6.0))
    soft = float(10.0 ** rng.uniform(-9.0, -6.0))
    softness = gives * soft / (gives + soft)
    slides = moved - gives * (force + given - drive)

    def friction(x: float) -> np.ndarray:
        return np.clip(old + kappa * x, -limits, limits)

    low, high = -1.0, 1.0
    for _ in range(200):
        x = (low + high) / 2.0
        low, high = (low, x) if x + softness * (friction(x).sum() - given) > slides else (x, high)
    cylinder = JointCylinder(gives, gives + soft, force, given, drive)
    laws = np.stack([mu_k, mu_s * (mu_s > mu_k), falls_by], axis=1)
    found, found_limits = slide_pads(kappa, laws, forces, old, moved, speed, cylinder)
    np.testing.assert_allclose(found_limits, limits, rtol=1e-14)
    np.testing.assert_allclose(found, friction(low), rtol=1e-8, atol=1e-9 * limits.max() + 1e-12 * kappa.max() * 1e-3)


def test_constants_of_friction_have_the_kernels_names_and_order() -> None:
    declared = [getattr(lib, constant.name.upper()) for constant in fields(FrictionLaw)]
    assert declared == list(range(lib.LAW_CONSTANTS))


def test_another_number_of_constants_of_friction_is_refused():
    pads, constants = np.ones(2), FrictionLaw().constants
    laws = np.array([[*constants, 2.0]] * 2)
    with pytest.raises(ValueError, match=f"{len(constants)} constants of each of 2 pads are allowed"):
        slide_pads(pads, laws, pads, pads, 0.0, 0.0, JointCylinder(0.0, 0.0, 0.0, 0.0, 0.0))
