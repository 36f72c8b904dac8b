"""Equilibria as solutions of one symmetric system for coordinates and forces."""

import numpy as np
import pytest
import scipy.sparse as sp
from rods import bar_between_pads, bent_chain, chain_on_a_stop, stable_equilibria
from scipy.interpolate import PPoly

from pmr import InputError, ReducedModel, System
from pmr.simulation.statics.equilibrium import equilibrium, saddle_point_solver
from pmr.system.assembly import Assembly
from pmr.system.contacts import Contact, Place
from pmr.system.states import ContactRows
from pmr.system.terms import Term


@pytest.mark.parametrize("K", [0.0, 1e6])
def test_a_rigid_motion_on_springs_has_an_answer(K: float) -> None:
    """(K + C^2 / F) q = f: where there is no stiffness but the springs', too."""
    rows = ContactRows(np.array([[0.1]]), np.array([[3e-8]]), np.zeros((1, 1)), np.zeros((1, 1)))
    q, force = saddle_point_solver(sp.csr_matrix([[K]]), rows)(np.array([1.0, 0.0]))
    assert q == pytest.approx(1.0 / (K + 0.01 / 3e-8)) and force == pytest.approx(0.1 * q / 3e-8)


@pytest.mark.parametrize("force", [3.0, -3.0, 1e4, 0.1, -1e-3])
def test_a_mass_that_a_term_tips_comes_to_rest_on_the_pad_on_its_side(force: float) -> None:
    """Between two pads with clearance, where a term has taken away more than the spring's stiffness.

    With both pads open nothing holds it; on the pad it is k (q - c) = f + (N - K) q.  Under small forces it has a place
    between the pads, too, where it stands unstably and against the force.
    """
    K, N, k, c = 100.0, 250.0, 1e6, 1e-3
    one, none = np.ones((1, 1)), np.zeros((1, 1))
    rows, names = PPoly(np.array([1.0, -1.0]).reshape(1, 1, 2, 1), [0.0, 1.0]), ("right", "left")
    body = ReducedModel(one, none, K * one, one, one, rows, ("F",), names, np.zeros(1))
    pads = tuple(Contact(name, Place("mass", name, 0.0), compliance=1.0 / k, clearance=c) for name in names)
    system = System({"mass": body}, pads, terms=(Term("pressed", ("mass",), stiffness=one),))
    found = equilibrium(Assembly(system), system.side_coordinates({}), np.array([force]), np.array([-N]))
    expected = (force + np.sign(force) * k * c) / (k - (N - K))
    assert found.q == pytest.approx(expected) and np.sign(force) * expected > c
    np.testing.assert_allclose(found.forces, [max(0.0, k * (expected - c)), max(0.0, k * (-expected - c))])
    np.testing.assert_array_equal(found.closed, [force > 0.0, force < 0.0])


@pytest.mark.parametrize("load", [1.0, 0.05, 1e-3])
@pytest.mark.parametrize(("seed", "softer"), [(0, 5.0), (4, 20.0), (11, 2.0), (13, 20.0)])
def test_a_bar_between_pads_with_play_comes_to_rest_where_it_stands_stably(
    seed: int, softer: float, load: float
) -> None:
    """Beside all sets of closed pads.  Under small loads it has unstable equilibria with pads open, too."""
    system = bar_between_pads(seed)
    state = equilibrium(Assembly(system), system.side_coordinates({}), np.array([load]), np.array([-softer]))
    stable = stable_equilibria(system, load, -softer)
    assert np.abs(stable - state.q).max(axis=1).min() < 1e-9 * np.abs(state.q).max()


def test_what_no_load_presses_sideways_lies_on_the_pad_without_play() -> None:
    """It hangs on a spring and has no stiffness sideways; with play on both sides nothing says where it is."""
    rows = PPoly(np.array([[0.0, 1.0], [0.0, -1.0]]).reshape(1, 1, 2, 2), [0.0, 1.0])
    body = ReducedModel(np.eye(2), np.zeros((2, 2)), np.diag([100.0, 0.0]), np.array([[1.0], [0.0]]), np.eye(2), rows,
                        ("F",), ("left", "right"), np.zeros(2))  # fmt: skip
    for clearance in ((0.0, 1e-3), (1e-3, 1e-3)):
        pads = tuple(
            Contact(name, Place("mass", name, 0.0), compliance=1e-6, clearance=gap)
            for name, gap in zip(("left", "right"), clearance, strict=True)
        )
        system = System({"mass": body}, pads)
        if all(clearance):
            with pytest.raises(InputError, match="pads with a clearance hold nothing"):
                equilibrium(Assembly(system), system.side_coordinates({}), np.array([3.0]))
            continue
        state = equilibrium(Assembly(system), system.side_coordinates({}), np.array([3.0]))
        assert state.q == pytest.approx([0.03, 0.0]) and state.closed.tolist() == [True, False]
        assert state.forces == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize("n", [20, pytest.param(320, marks=pytest.mark.slow)])
def test_a_rigid_stop_holds_what_a_term_tips_until_that_buckles_between_its_ends(n: int) -> None:
    """Small and large matrices are factored in different ways."""
    system, free, fixed = chain_on_a_stop(n)
    load = np.array([0.01 * free])
    for softer in (1.5 * free, 0.99 * fixed):
        state = equilibrium(Assembly(system), system.side_coordinates({}), load, np.array([-softer]))
        np.testing.assert_allclose(state.q, bent_chain(system, softer), rtol=1e-6)
        assert state.closed.all()
    with pytest.raises(InputError, match="second order"):
        equilibrium(Assembly(system), system.side_coordinates({}), load, np.array([-1.01 * fixed]))


def test_what_second_order_alone_lets_go_is_said_to_be_so() -> None:
    """Held without terms, and by nothing with them; without terms either it is the contacts that hold nothing."""
    one, none, rows = np.ones((1, 1)), np.zeros((1, 1)), PPoly(np.zeros((1, 1, 0, 1)), [0.0, 1.0])
    for K, said in (
        (100.0, "second order; without it these pads hold it"),
        (0.0, "together hold every motion of the bodies"),
    ):
        body = ReducedModel(one, none, K * one, one, one, rows, ("F",), (), np.zeros(1))
        system = System({"mass": body}, (), terms=(Term("pressed", ("mass",), stiffness=one),))
        with pytest.raises(InputError, match=said):
            equilibrium(Assembly(system), system.side_coordinates({}), np.array([3.0]), np.array([-250.0]))
