"""Equilibria as functions of a load: a stepped column, and contacts that open."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from pmr.studies.allowed import first_load
from pmr.system.loaded import Equations, Form, Loaded

Array = np.ndarray


def equations(K: Array, G: Array, b: Array, C: Array, F: Array, pushes: bool, gap: float = 0.0) -> Equations:
    """Of a structure without what is there before the load; outputs are its coordinates."""
    n, m = len(K), len(C)
    nothing = np.zeros((n, n))
    return Equations(
        M=np.eye(n),
        K=K,
        G=(nothing, G),
        b=(np.zeros(n), b),
        g=(np.full(m, gap), np.zeros(m)),
        C=C,
        F=F,
        outputs=np.eye(n),
        X=np.zeros((n, m)),
        direct=(np.zeros(n), np.zeros(n)),
        pushes=np.full(m, pushes),
        on=(np.zeros((n, 0)), np.zeros((m, 0)), np.zeros((0, 0))),
    )


def stepped(elements: int) -> tuple[Array, Array]:
    """Stiffness of a column of two halves, EI = 1 and 1/2, L = 1, held at its foot, and that of a unit end load."""
    n, h = 2 * elements, 1.0 / elements
    K, G = np.zeros((n + 2, n + 2)), np.zeros((n + 2, n + 2))
    bent = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2]])
    bent = np.vstack([bent, -bent[0], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]) / h**3
    pressed = np.array([[36, 3 * h, -36, 3 * h], [3 * h, 4 * h**2, -3 * h, -(h**2)]])
    pressed = np.vstack([pressed, -pressed[0], [3 * h, -(h**2), -3 * h, 4 * h**2]]) / (30 * h)
    for e in range(elements):
        at = np.ix_(range(2 * e, 2 * e + 4), range(2 * e, 2 * e + 4))
        K[at] += bent * (1.0 if e < elements // 2 else 0.5)
        G[at] -= pressed
    return K[2:, 2:], G[2:, 2:]


def test_a_stepped_column_buckles_where_its_halves_say() -> None:
    """k_1 tan(k_1 a) tan(k_2 a) = k_2, P = k^2 EI, over halves of the length a: 2.0672 EI / L^2."""
    K, G = stepped(40)
    form = Form(equations(K, G, np.zeros(len(K)), np.zeros((0, len(K))), np.zeros((0, 0)), False), np.zeros(0, bool))

    def halves(P: float) -> float:
        k1, k2 = np.sqrt(P), np.sqrt(2.0 * P)
        return float(np.tan(k1 / 2.0) * np.tan(k2 / 2.0) - k2 / k1)

    exact = float(brentq(halves, 1.0, 2.4))
    assert exact == pytest.approx(2.0672, rel=1e-4)
    assert form.critical == pytest.approx(exact, rel=1e-6)
    assert form.inverse_factor(1.0) == pytest.approx(1.0 / form.critical, rel=1e-9)


def test_a_pad_with_a_gap_carries_from_the_load_on_that_closes_it() -> None:
    """A spring of 100 N/m on which the load pulls, and a pad of 300 N/m 0.1 m away: force and motion have a kink."""
    loaded = Loaded(
        equations(
            np.array([[100.0]]), np.zeros((1, 1)), np.ones(1), np.ones((1, 1)), np.full((1, 1), 1 / 300.0), True, 0.1
        )
    )
    for load, moved, force in ((5.0, 0.05, 0.0), (20.0, 0.125, 7.5), (8.0, 0.08, 0.0)):
        state = loaded.state(load)
        assert state.outputs[0] == pytest.approx(moved, rel=1e-12)
        assert state.forces[0] == pytest.approx(force, rel=1e-12)
    assert first_load(lambda P: loaded.state(P).forces[0] / 30.0, 1e3) == pytest.approx(50.0, rel=1e-9)


def test_the_first_load_at_which_a_limit_is_met_is_found_or_said_not_to_be() -> None:
    assert first_load(lambda P: P / 7.0, 10.0) == pytest.approx(7.0)
    assert first_load(lambda P: P / 7.0, 10.0, grows=True, near=7.01) == pytest.approx(7.0)
    assert first_load(lambda P: P / 70.0, 10.0) is None
    assert first_load(lambda P: 1.0 + P, 10.0) == 0.0
    assert first_load(lambda P: 1.0 / (10.0 - P) if P < 10.0 else np.inf, 20.0) == pytest.approx(9.0)
