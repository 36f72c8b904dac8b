"""Loads that are hoisted off the ground, beside closed forms and a step-by-step integration."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pmr.simulation.statics.loaded import Equations, Form, LoadEffects
from pmr.simulation.statics.swings import Rope, lift_off
from pmr.system.states import ContactRows

G = 9.80665


def springs(stiffness: list[float], masses: list[float]) -> Form:
    """A chain of springs from the ground up to the point that carries the load."""
    n = len(masses)
    K = np.diag(np.add(stiffness, [*stiffness[1:], 0.0])).astype(float)
    K[np.arange(n - 1), np.arange(1, n)] = K[np.arange(1, n), np.arange(n - 1)] = -np.array(stiffness[1:])
    tip, none, rows = np.eye(n)[-1], np.zeros((n, n)), np.zeros((0, n))
    nothing = ContactRows(rows, np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((0, 0)))
    fixed, growing = (LoadEffects(b, np.zeros(0), np.zeros(0), none) for b in (np.zeros(n), -G * tip))
    equations = Equations(
        M=np.diag(masses), K=K, outputs=np.zeros((0, n)), rows=nothing, fixed=fixed, growing=growing,
        pushes=np.zeros(0, bool), load_inputs=tip[:, None], load_flexibility=np.zeros((1, 1)),
    )  # fmt: skip
    return Form(equations, np.zeros(0, bool))


@pytest.mark.parametrize("speed", [0.05, 0.3, 1.0])
def test_a_tip_that_hardly_moves(speed: float) -> None:
    factor = lift_off(springs([1e12], [1.0]), 800.0, Rope(2e6, speed), G)
    assert factor == pytest.approx(1.0 + speed * np.sqrt(2e6 / 800.0) / G, rel=1e-5)


def test_a_tip_without_mass_is_a_spring_more() -> None:
    """In series with the rope; the mass of the tip is 1e-9 of the load."""
    factor = lift_off(springs([3e5], [8e-7]), 800.0, Rope(2e6, 0.3), G)
    series = 1.0 / (1.0 / 3e5 + 1.0 / 2e6)
    assert factor == pytest.approx(1.0 + 0.3 * np.sqrt(series / 800.0) / G, rel=1e-4)


def test_two_masses_step_by_step() -> None:
    k, m, load, rope = [4e5, 2e5], [150.0, 60.0], 500.0, Rope(1e6, 0.4)

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        q, y, v, w = x[:2], x[2], x[3:5], x[5]
        force = rope.stiffness * max(q[1] - y + rope.speed * t, 0.0)
        a = np.array([-k[0] * q[0] + k[1] * (q[1] - q[0]), -k[1] * (q[1] - q[0]) - force]) / m
        up = max(force / load - G, 0.0) if y <= 0.0 and w <= 0.0 else force / load - G
        return np.concatenate([v, [w], a, [up]])

    found = solve_ivp(rates, (0.0, 0.8), np.zeros(6), rtol=1e-8, atol=1e-10, max_step=1e-3)
    force = rope.stiffness * (found.y[1] - found.y[2] + rope.speed * found.t)
    # both sample the largest force, some 1e-5 of it apart
    assert lift_off(springs(k, m), load, rope, G) == pytest.approx(force.max() / (load * G), rel=1e-4)


def test_a_load_that_nothing_carries_has_no_factor() -> None:
    assert np.isnan(lift_off(springs([1e5], [1.0]), 0.0, Rope(1e6, 0.3), G))
