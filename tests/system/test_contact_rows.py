"""Which contacts are rigid: those whose flexibility is round-off of the largest.
Rows of contacts as functions of paths, beside those at places, and their derivatives beside differences.
"""

from dataclasses import replace

import numpy as np
import pytest
from nested import Nested, full, reduced, with_round_off
from oracle import flexible, full_body, generalized_alpha, project, rich_body, with_pads
from springs import CompliantRows

from pmr import InputError, ReducedModel, SimulationError, System
from pmr.simulation import InitialState, TimeStepping
from pmr.system.assembly import Assembly
from pmr.system.body import ROUND_OFF, compliant_rows, is_round_off
from pmr.system.body_matrices import dependence_of_flexibility, dependence_of_rows
from pmr.system.changing_rows import ChangingRows


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
    changing, s = ChangingRows(Assembly(system), system.paths), np.array([2.5])
    assert changing.evaluate(s).rows.rigid.tolist() == [True, False]
    for part in (*changing.evaluate(s), *changing.time_derivatives(s, np.ones(1))):
        assert not part.F[..., 0, :].any() and not part.F[..., :, 0].any() and part.F[..., 1, 1].all()


S = np.array([0.7, 1.9, 2.0, 3.3])


@pytest.fixture(scope="module")
def model() -> ReducedModel:
    """Two sliders, two inputs, damping."""
    return flexible(rich_body(), 8)


def test_which_rows_give_way(model: ReducedModel) -> None:
    full = full_body(elements=6)
    assert compliant_rows(model) == [0, 1] and compliant_rows(full) == []
    assert compliant_rows(with_pads(full, 0.0, 1e-6, 0.0)) == [1]
    assert compliant_rows(replace(model, flexibility=None)) == []


def test_it_solves_the_saddle_point_problem(model: ReducedModel) -> None:
    f = np.array([30.0, -7.0])
    compliant, r = CompliantRows(model), model.size
    system = compliant.system(S)
    for k, s in enumerate(S):
        assert model.flexibility
        C, F, H = model.C(s), model.flexibility.rows(s) + np.diag(model.row_compliance), model.flexibility.inputs(s)
        saddle = np.linalg.solve(np.block([[model.K + np.eye(r), C.T], [C, -F]]), np.concatenate([model.B @ f, -H @ f]))
        q = np.linalg.solve(system[k, :, :r] + np.eye(r), system[k, :, r:] @ f)
        assert q == pytest.approx(saddle[:r], rel=1e-9, abs=1e-12)
        assert compliant.multipliers(np.array([s]), q[None], f[None])[0] == pytest.approx(saddle[r:], rel=1e-8)


def test_pads_alone_are_springs() -> None:
    """K + k c^T c, whatever the residual flexibility."""
    full = with_pads(full_body(elements=6), 0.0, 0.0, 4e-6)
    model = replace(project(full, np.eye(full.size)[:, 2:]), pads=np.array([4e-6]))
    c = model.C(1.3)[0]
    found = CompliantRows(model).system(np.array([1.3]))[0]
    assert found[:, : model.size] == pytest.approx(model.K + np.outer(c, c) / 4e-6, rel=1e-12)
    assert np.array_equal(found[:, model.size :], model.B)


def test_a_slider_on_a_support_is_refused_with_its_place(model: ReducedModel) -> None:
    with pytest.raises(SimulationError, match=r"slider at 0 m: the forces of the rows slider 0, slider 0.8 are"):
        CompliantRows(model).system(np.array([0.5, 0.0]))
    assert np.isfinite(CompliantRows(model).system(np.array([1e-5]))).all()  # beside it they can


def test_the_oracles_integrator_knows_the_same_equations(model: ReducedModel) -> None:
    """At rest in the static equilibrium of constant loads the model stays there."""
    f, s = np.array([30.0, -7.0]), 1.9
    compliant = CompliantRows(model)
    system = compliant.system(np.array([s]))[0]
    q = np.linalg.solve(system[:, : model.size], system[:, model.size :] @ f)
    stepping = TimeStepping(0.05, 1e-3)
    T = len(stepping.times)
    found, v, force = generalized_alpha(model, np.full(T, s), np.tile(f, (T, 1)), stepping, InitialState(q, 0.0 * q))
    assert np.abs(found - q).max() < 1e-9 * np.abs(q).max() and np.abs(v).max() < 1e-8 * np.abs(q).max()
    assert force == pytest.approx(np.tile(compliant.multipliers(np.array([s]), q[None], f[None]), (T, 1)), rel=1e-6)


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
            difference = (getattr(after.rows, what) - getattr(before.rows, what)) / (2.0 * STEP)
            exact = getattr(found.slopes, what)[p]
            np.testing.assert_allclose(exact, difference, rtol=0.0, atol=1e-6 * np.abs(exact).max(initial=0.0))
    assert np.abs(found.slopes.C[1]).max() > 0.0 and not found.slopes.C[0].any()


def test_rates_of_paths_that_move_together() -> None:
    assembly = Assembly(reduced(Nested(3, elements=6), 3))
    changing, s, rates = ChangingRows(assembly, assembly.system.paths), np.array([1.03, 1.23]), np.array([0.3, -0.7])
    at = [changing.evaluate(s + k * STEP * rates).rows for k in (-1, 0, 1)]
    first, second = changing.time_derivatives(s, rates)
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


NAMES = ("a", "b", "c", "d")


def rows(angle: float) -> np.ndarray:
    """b deviates from twice a by the angle; c and d are independent, but not orthogonal."""
    a, e = np.array([1.0, 2.0, 0.0, 0.0, 0.0]), np.array([2.0, -1.0, 0.0, 0.0, 0.0])
    b = 2.0 * (np.cos(angle) * a + np.sin(angle) * e)
    return np.stack([a, b, [0.0, 0.0, 3.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0, 2.0]])


def test_only_rows_that_take_part_are_named() -> None:
    found = dependence_of_rows(rows(1e-5), NAMES)
    assert found.names == ("a", "b")
    assert found.measure == pytest.approx(1e-5 / np.sqrt(2.0), rel=1e-4)  # of the eigenvalue 1 - cos for unit vectors
    G = rows(1e-3) @ rows(1e-3).T
    assert dependence_of_flexibility(G, NAMES).names == ("a", "b")
    assert dependence_of_flexibility(G, NAMES).measure == pytest.approx(0.5e-6, rel=1e-3)


def test_a_row_that_vanishes_is_named() -> None:
    C = rows(0.5)
    C[2] = 0.0
    for found in (dependence_of_rows(C, NAMES), dependence_of_flexibility(C @ C.T, NAMES)):
        assert (found.measure, found.names) == (0.0, ("c",))
