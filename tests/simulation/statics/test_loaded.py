"""Equilibria as functions of a load: a stepped column, and contacts that open."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from pmr import InputError
from pmr.simulation.statics.loaded import Equations, Form, LoadedStructure, LoadEffects
from pmr.studies.allowed import first_load
from pmr.system.body_matrices import cholesky_root, first_singular
from pmr.system.states import ContactRows

Array = np.ndarray


def equations(K: Array, G: Array, b: Array, C: Array, F: Array, pushes: bool, gap: float = 0.0) -> Equations:
    """Of a structure without what is there before the load; outputs are its coordinates."""
    n, m = len(K), len(C)
    nothing = np.zeros((n, n))
    return Equations(
        M=np.eye(n),
        K=K,
        outputs=np.eye(n),
        rows=ContactRows(C, F, np.zeros((m, 0)), np.zeros((n, m))),
        fixed=LoadEffects(np.zeros(n), np.full(m, gap), np.zeros(n), nothing),
        growing=LoadEffects(b, np.zeros(m), np.zeros(n), G),
        pushes=np.full(m, pushes),
        load_inputs=np.zeros((n, 0)),
        load_flexibility=np.zeros((0, 0)),
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
    loaded = LoadedStructure(
        equations(
            np.array([[100.0]]), np.zeros((1, 1)), np.ones(1), np.ones((1, 1)), np.full((1, 1), 1 / 300.0), True, 0.1
        )
    )
    for load, moved, force in ((5.0, 0.05, 0.0), (20.0, 0.125, 7.5), (8.0, 0.08, 0.0)):
        state = loaded.state(load)
        assert state.outputs[0] == pytest.approx(moved, rel=1e-12)
        assert state.forces[0] == pytest.approx(force, rel=1e-12)
    reached = first_load(lambda loads: (loaded.states(loads).forces[:, 0] / 30.0).tolist(), 1e3, at_once=False)
    assert reached == pytest.approx(50.0, rel=1e-12)


def sideways(gaps: list[float], load: float = 0.0) -> Equations:
    """A mass on a vertical spring, and sideways between two pads with these gaps, where `load` in N pushes it."""
    e = equations(np.diag([100.0, 0.0]), np.diag([0.0, -1.0]), np.array([1.0, 0.0]),
                  np.array([[0.0, 1.0], [0.0, -1.0]]), np.eye(2) / 300.0, True)  # fmt: skip
    fixed = replace(e.fixed, b=np.array([0.0, load]), g=np.array(gaps))
    return replace(e, fixed=fixed, names=("left", "right"))


def test_what_no_load_presses_sideways_lies_on_the_pad_without_play() -> None:
    """It stays there without a force and gets the spring's travel; a load off that pad moves it to the other one."""
    for gaps, closed in (([0.0, 0.1], [True, False]), ([0.1, 0.0], [False, True])):
        state = LoadedStructure(sideways(gaps)).state(7.0)
        assert state.outputs == pytest.approx([0.07, 0.0]) and state.forces == pytest.approx([0.0, 0.0])
        assert state.form.closed.tolist() == closed and state.form.critical == pytest.approx(300.0)
    walls = np.array([[-1.0, 1.0], [0.0, -1.0]])  # give way as far as the spring
    first_order = sideways([0.0, 0.1]).unstressed
    state = LoadedStructure(replace(first_order, rows=replace(first_order.rows, C=walls))).state(7.0)
    assert state.outputs == pytest.approx([0.07, 0.07]) and state.form.closed.tolist() == [True, False]
    state = LoadedStructure(sideways([0.0, 0.1], load=-6.0)).state(7.0)
    assert state.forces == pytest.approx([0.0, 6.0 + 7.0 * 0.1 + 7.0 * state.forces[1] / 300.0])


def test_what_second_order_tips_within_its_play_leans_on_pads_of_both_sides() -> None:
    """Ends y1, y2 of a rod under thrust, P (y2 - y1) apart, between pads of 300 N/m; y2 lies 1e-3 m to the left.

    The left pad at y1 touches without a force, and thrust pulls y1 off it: d = 0.101 + 2 P d / 300, d = y2 - y1.
    """
    rows, tipping = np.vstack([np.eye(2), -np.eye(2)]), -np.array([[1.0, -1.0], [-1.0, 1.0]])
    e = equations(np.zeros((2, 2)), tipping, np.zeros(2), rows, np.eye(4) / 300.0, True)
    fixed = replace(e.fixed, b=np.array([0.0, 1e-6]), g=np.array([0.0, 1e-3, 0.1, 0.1]))
    loaded = LoadedStructure(replace(e, fixed=fixed))
    thrust = 7.0 * 0.101 / (1.0 - 14.0 / 300.0)
    assert loaded.state(7.0).forces == pytest.approx([0.0, thrust, thrust, 0.0], rel=1e-3)


def test_what_floats_within_its_play_is_refused_by_the_names_of_its_pads() -> None:
    with pytest.raises(InputError, match=r"'left, right': no load presses these pads.*clearance = 0 on one of two"):
        LoadedStructure(sideways([0.1, 0.2])).state(7.0)
    floating = LoadedStructure(sideways([0.1, 0.2]), may_float=True).state(7.0)
    assert not floating.in_equilibrium and not floating.form.buckling_forces(7.0).any()
    lost = sideways([0.0, 0.1], load=5.0)
    lost = replace(lost, rows=replace(lost.rows, C=-np.abs(lost.rows.C)))  # both pads are behind it
    assert not LoadedStructure(lost).state(7.0).in_equilibrium


@pytest.mark.parametrize("seed", range(4))
def test_a_rod_between_pads_with_clearances_is_found_wherever_it_rests(seed: int) -> None:
    """Pads above and below hold it alone, not all sets of them; beside all sets, of which exactly one is right."""
    rng = np.random.default_rng(seed)
    x = np.arange(4.0) - 1.5
    above = np.column_stack([np.ones(4), x, x**2 - 1.25])  # it moves, turns and bends
    e = equations(np.diag([0.0, 0.0, 50.0]), np.zeros((3, 3)), rng.normal(size=3), np.vstack([above, -above]),
                  np.diag(rng.uniform(0.005, 0.02, 8)), True)  # fmt: skip
    b = rng.normal(size=(2, 3))
    fixed = replace(e.fixed, b=b[0], g=rng.uniform(0.0, 0.02, 8), G=np.diag([0.0, -5.0, 0.0]))
    e = replace(e, fixed=fixed, growing=replace(e.growing, b=b[1]))
    states = list[Array]()
    for closed in map(np.array, product([False, True], repeat=8)):
        K, C, F = e.K + fixed.G, e.rows.C[closed], e.rows.F[closed][:, closed]
        stiffness = K + C.T @ np.linalg.solve(F, C)
        if np.linalg.eigvalsh(stiffness)[0] < 1e-6:
            continue
        pressing = np.linalg.solve(F, np.column_stack([C, fixed.g[closed]]))
        q = np.linalg.solve(stiffness, b[0] + 3.0 * b[1] + C.T @ pressing[:, -1])
        forces = pressing @ np.append(q, -1.0)
        if (forces > 0.0).all() and (e.rows.C @ q < fixed.g)[~closed].all():
            states.append(q)
    assert len(states) == 1
    state = LoadedStructure(e).state(3.0)
    assert state.in_equilibrium and state.outputs == pytest.approx(states[0], rel=1e-9)


def found(used: Callable[[float], float], top: float, **options: Any) -> tuple[float, int]:
    """What a search finds of a limit of which a load uses so much, and how many times it asks."""
    asked = list[int]()

    def shares(loads: Sequence[float]) -> list[float]:
        asked.append(len(loads))
        return [used(load) for load in loads]

    return first_load(shares, top, **options), len(asked)


def test_the_first_load_at_which_a_limit_is_met_is_found_or_said_not_to_be() -> None:
    assert found(lambda P: P / 7.0, 10.0)[0] == pytest.approx(7.0)
    assert found(lambda P: P / 7.0, 10.0, grows=True, guess=7.01)[0] == pytest.approx(7.0)
    assert found(lambda P: P / 7.0, 10.0, guess=3.0)[0] == pytest.approx(7.0)
    assert np.isnan(found(lambda P: P / 70.0, 10.0)[0])
    assert found(lambda P: 1.0 + P, 10.0)[0] == 0.0
    reached = found(lambda P: 1.0 / (10.0 - P) if P < 10.0 else np.inf, 20.0, at_once=False)
    assert reached[0] == pytest.approx(9.0)


@pytest.mark.parametrize(
    ("used", "exact"),
    [
        (lambda P: abs(2.0 * P / 5.0 - 0.9), 1.9 * 2.5),  # pushes, then pulls
        (lambda P: max(P / 9.0, (P / 6.0) ** 3), 6.0),  # another one is the largest beyond
        (lambda P: 0.5 + 1e-9 * P + 1e3 * (P > 7.3), 7.3),  # jumps: the first load beyond
        (lambda P: np.tan(P / 8.0) if P / 8.0 < np.pi / 2.0 else np.inf, 2.0 * np.pi),
        (lambda P: np.sqrt(P / 8.0), 8.0),
        (lambda P: 0.5 + 5.0 * (P / 10.0) ** 9, 10.0 * 0.1 ** (1.0 / 9.0)),
    ],
)
@pytest.mark.parametrize("near", [np.nan, 1.001])
def test_roots_lie_between_loads_that_use_less_and_more(
    used: Callable[[float], float], exact: float, near: float
) -> None:
    """To 1e-12 of the largest load; by quarters alone that takes 20 rounds, 4^-20 being 1e-12."""
    load, asked = found(used, 10.0, guess=near * exact)
    assert load == pytest.approx(exact, abs=3e-12 * 10.0)
    assert asked <= 25


def test_loads_at_which_matrices_become_singular_are_those_of_all_eigenvalues() -> None:
    rng = np.random.default_rng(4)
    Q = np.linalg.qr(rng.normal(size=(30, 30)))[0]
    singular = np.array([3.0, 3.01, *np.linspace(5.0, 40.0, 20), *-np.linspace(1.0, 9.0, 8)])  # below 0: pulled
    A, B = Q @ np.diag(rng.uniform(1.0, 100.0, 30)) @ Q.T, np.zeros((30, 30))
    L = np.linalg.cholesky(A)
    U = np.linalg.qr(rng.normal(size=(30, 30)))[0]
    B = -L @ U @ np.diag(1.0 / singular) @ U.T @ L.T
    assert first_singular(A, B) == pytest.approx(3.0, rel=1e-11)
    assert first_singular(A, 0.0 * B) == np.inf
    assert first_singular(-A, B) == 0.0
    L[:, 3:] = 0.0
    some: list[Array] = [A, L @ L.T]
    for semidefinite in some:
        of = cholesky_root(semidefinite)
        assert of is not None and of @ of.T == pytest.approx(semidefinite, abs=1e-12 * np.abs(A).max())
    assert cholesky_root(A - 1.1 * float(np.linalg.eigvalsh(A)[0]) * np.eye(30)) is None
