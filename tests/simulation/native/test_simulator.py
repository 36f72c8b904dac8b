"""The compiled simulator against an integrator of the test's own, against closed solutions and against Exudyn."""

from dataclasses import replace

import numpy as np
import one_body
import pytest
from driving import driven
from one_body import LOADS, PATH, STEPPING, displacement, energy, some_state
from oracle import CASES, Case, couples_modes, generalized_alpha, project, started
from scipy.interpolate import PPoly

from pmr import InputError, ReducedModel, SimulationError
from pmr.files.arrays import Array
from pmr.scene.signals import Constant, Ramp, Sine, SmoothRamp, Step
from pmr.simulation import InitialState, TimeStepping
from pmr.simulation.modal import modal_form
from pmr.simulation.native import systems as marching
from pmr.system.body import FullBody, SlidingBody, Trajectory
from pmr.system.carriers import Flexibility
from pmr.system.rows import Rows, fixed_row, sparse_row


@pytest.fixture(params=["sparse", "dense"])
def body(rich: FullBody, request: pytest.FixtureRequest) -> SlidingBody:
    return rich if request.param == "sparse" else project(rich, np.eye(rich.size)[:, 2:])


def reference(body: SlidingBody, initial: InitialState | None = None) -> tuple[Array, Array, Array]:
    t = STEPPING.times
    start = started(body, float(PATH.value(0.0)), float(PATH.rate(0.0)), initial or some_state(body))
    return generalized_alpha(body, PATH.value(t), np.stack([f.value(t) for f in LOADS], axis=1), STEPPING, start)


def assert_same(found: Trajectory, expected: tuple[Array, Array, Array], tolerance: float) -> None:
    for a, b in zip((found.q, found.v, found.multipliers), expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=0.0, atol=tolerance * np.abs(b).max())


def test_same_as_an_integrator_written_for_the_test(body: SlidingBody) -> None:
    """Two sliders, two inputs, Rayleigh damping, a start that must be corrected; multipliers of supports as well."""
    found = one_body.simulate(body, driven(PATH, LOADS, STEPPING), some_state(body))
    assert_same(found, reference(body), 1e-11)
    np.testing.assert_array_equal(found.t, STEPPING.times)
    np.testing.assert_allclose(found.s, PATH.value(found.t))
    assert found.seconds > 0.0


def test_damping_that_couples_the_modes(body: SlidingBody) -> None:
    D = body.D.toarray() if isinstance(body, FullBody) else body.D.copy()
    D[-2, -2] += 300.0  # a damper at the tip
    damped = replace(body, D=type(body.D)(D) if isinstance(body, FullBody) else D)
    assert couples_modes(modal_form(damped))
    assert_same(one_body.simulate(damped, driven(PATH, LOADS, STEPPING), some_state(damped)), reference(damped), 1e-11)


def test_rows_that_never_move_stand_before_those_that_do(rich: FullBody) -> None:
    """With pads and three rows."""
    held = fixed_row("fixed", sparse_row([4, 5, 7, 8], [0.3, 0.1, 0.6, -0.2], rich.size), rich.rows.domain)
    more = replace(rich, rows=Rows((held, *rich.rows.rows[2:]), rich.size))
    body = project(more, np.eye(rich.size)[:, 2:])
    assert_same(one_body.simulate(body, driven(PATH, LOADS, STEPPING), some_state(body)), reference(body), 1e-11)


@pytest.mark.parametrize("degree", [1, 5])
def test_rows_of_any_degree(rich: FullBody, degree: int) -> None:
    """A row of its own making, with G and H of residual flexibility left out."""
    body = project(rich, np.eye(rich.size)[:, 2:])
    c = np.random.default_rng(3).standard_normal((degree + 1, 3, 2, body.size))
    body = replace(body, rows=PPoly(c, np.array([0.0, 1.5, 2.5, 4.2])))
    assert_same(
        one_body.simulate(body, driven(PATH, LOADS, STEPPING)), reference(body, InitialState.at_rest(body.size)), 1e-10
    )


@pytest.mark.parametrize("count", [1, 3, 4, 5, 16, 23])
def test_any_number_of_outputs(rich: FullBody, count: int) -> None:
    """Four at a time, or sixteen; what is left over counts too."""
    few = with_flexibility(rich, kept=5)[1]
    chosen = np.random.default_rng(count).integers(0, len(few.outputs), count)
    found = one_body.simulate(few, driven(PATH, LOADS, STEPPING))
    f = np.stack([f.value(found.t) for f in LOADS], axis=1)
    y = displacement(few, found.q, found.s, found.multipliers, f)
    seen = one_body.observe(modal_form(few), driven(PATH, LOADS, STEPPING), outputs=chosen)
    np.testing.assert_allclose(seen.y, y[:, chosen], atol=1e-14)


def test_pads_that_give_way_are_springs(rich: FullBody) -> None:
    """Without rows, K + k C^T C; with them, C q = lambda / k."""
    k, at = 2e5, Constant(amount=1.7)
    body = project(rich, np.eye(rich.size)[:, 2:])
    C = body.C(1.7)
    no_rows = PPoly(np.zeros((1, 1, 0, body.size)), np.array(body.domain))
    springs = replace(body, K=body.K + k * C.T @ C, rows=no_rows, row_names=())
    pads = replace(body, pads=np.full(2, 1.0 / k))
    with_springs, with_pads = (one_body.simulate(each, driven(at, LOADS, STEPPING)) for each in (springs, pads))
    np.testing.assert_allclose(with_pads.q, with_springs.q, atol=1e-11 * np.abs(with_springs.q).max())
    np.testing.assert_allclose(with_pads.multipliers, k * with_springs.q @ C.T, rtol=0.0, atol=1e-6)
    f = np.stack([f.value(STEPPING.times) for f in LOADS], axis=1)
    strain = energy(pads, with_pads, f).strain, energy(springs, with_springs, f).strain
    np.testing.assert_allclose(*strain, atol=1e-9 * strain[0].max())


def with_flexibility(rich: FullBody, kept: int) -> tuple[ReducedModel, ReducedModel]:
    """A body in its own modes, and the `kept` lowest with the rest as residual flexibility (dense R)."""
    whole = modal_form(project(rich, np.eye(rich.size)[:, 2:])).body
    first = max(kept, 2)  # R of elastic modes alone
    R = np.zeros(whole.size)
    R[first:] = 1.0 / np.diagonal(whole.K)[first:]
    c, k, m = whole.rows.c, whole.rows.c.shape[1], 2
    G = np.zeros((7, k, m, m))
    for p in range(4):
        for q in range(4):
            G[p + q] += np.einsum("kmr,r,knr->kmn", c[p], R, c[q])
    flexibility = Flexibility(
        rows=PPoly(G, whole.rows.x),
        inputs=PPoly(np.einsum("pkmr,r,ri->pkmi", c, R, whole.B), whole.rows.x),
        outputs=PPoly(np.einsum("or,r,pkmr->pkom", whole.outputs, R, c), whole.rows.x),
        direct=whole.outputs @ (R[:, None] * whole.B),
        energy=whole.B.T @ (R[:, None] * whole.B),
    )
    return whole, replace(whole.leading(kept), flexibility=flexibility)


def test_residual_flexibility_gives_the_static_answer_at_once(rich: FullBody) -> None:
    """A load that rises slowly: few modes with the flexibility of the rest follow the whole body."""
    path, loads = Ramp(times=(0.0, 10.0), values=(1.5, 2.0)), [Ramp(times=(0.0, 10.0), values=(0.0, 100.0))] * 2
    stepping = TimeStepping(10.0, 1e-2, rho_inf=0.5)
    whole, few = with_flexibility(rich, kept=4)
    expected, found = (one_body.simulate(each, driven(path, loads, stepping)) for each in (whole, few))
    f = np.stack([f.value(stepping.times) for f in loads], axis=1)
    w = displacement(whole, expected.q, expected.s, expected.multipliers, f)
    y = displacement(few, found.q, found.s, found.multipliers, f)
    plain = found.q @ few.outputs.T
    assert np.abs(y - w).max() < 1e-4 * np.abs(w).max() < 1e-2 * np.abs(plain - w).max()
    np.testing.assert_allclose(found.multipliers, expected.multipliers, atol=1e-3 * np.abs(expected.multipliers).max())
    strain = energy(few, found, f), energy(whole, expected, f)
    np.testing.assert_allclose(strain[0].total, strain[1].total, atol=1e-3 * np.abs(strain[1].total).max())
    seen = one_body.observe(modal_form(few), driven(path, loads, stepping), outputs=[6, 3], every=4)
    np.testing.assert_allclose(seen.y, y[::4, [6, 3]], atol=1e-13)


def test_rows_with_flexibility_hold_at_every_step(rich: FullBody) -> None:
    few = with_flexibility(rich, kept=5)[1]
    assert few.flexibility
    found = one_body.simulate(few, driven(PATH, LOADS, STEPPING))
    f = np.stack([f.value(found.t) for f in LOADS], axis=1)
    rows = few.apply_rows(found.s, found.q) + few.flexibility.row_motion(found.s, found.multipliers, f)
    assert np.abs(rows).max() < 1e-15 < np.abs(few.apply_rows(found.s, found.q)).max()


def order(body: SlidingBody, rho_inf: float, end: float, h: float) -> dict[str, float]:
    """Factor by which errors fall when h is halved, against h / 20."""
    path = SmoothRamp(times=(0.0, end), values=(1.7, 2.3))
    load = [Sine(amplitude=100.0, frequency=2.0)] * 2
    fine, *coarse = (
        one_body.simulate(body, driven(path, load, TimeStepping(end, step, rho_inf))) for step in (h / 20, h, h / 2)
    )
    result = {}
    for name in ("q", "v", "multipliers"):
        exact = getattr(fine, name)
        a, b = (np.abs(getattr(c, name) - exact[::every]).max() for c, every in zip(coarse, (20, 10), strict=True))
        result[name] = a / b
    return result


@pytest.mark.parametrize("rho_inf", [0.0, 0.5, 0.9])
def test_second_order_in_positions_velocities_and_multipliers(rich: FullBody, rho_inf: float) -> None:
    body = project(rich, np.linalg.qr(np.vander(rich.output_positions.repeat(3), 8)[:, ::-1])[0])
    assert order(body, rho_inf, end=0.5, h=2e-4) == pytest.approx({"q": 4.0, "v": 4.0, "multipliers": 4.0}, abs=0.1)


@pytest.mark.parametrize("rho_inf", [0.5, 1.0])
def test_second_order_once_rows_give_way(rich: FullBody, rho_inf: float) -> None:
    """With rho_inf = 1 too: at index 1 there are no multipliers left that need damping."""
    few = with_flexibility(rich, kept=5)[1]
    assert order(few, rho_inf, end=0.2, h=2e-5) == pytest.approx({"q": 4.0, "v": 4.0, "multipliers": 4.0}, abs=0.1)


def test_moving_rigid_rows_without_damping_are_refused(rich: FullBody) -> None:
    with pytest.raises(
        InputError, match="rho_inf = 1.0: less than 1 is allowed while the rigid row slider 0, slider 0.8"
    ):
        one_body.simulate(rich, driven(PATH, LOADS, TimeStepping(0.2, 1e-3, rho_inf=1.0)))
    one_body.simulate(rich, driven(Constant(amount=2.0), LOADS, TimeStepping(0.2, 1e-3, rho_inf=1.0)))


def test_wrong_input_is_refused_before_anything_runs(rich: FullBody) -> None:
    with pytest.raises(InputError, match="0 to 4.2 m is allowed; left at t = 0.051 s"):
        one_body.simulate(rich, driven(Ramp(times=(0.0, 0.1), values=(4.0, 4.4 + 1e-6)), LOADS, STEPPING))
    with pytest.raises(InputError, match="loads: F given, one for each input is allowed: F, T"):
        one_body.simulate(rich, driven(PATH, LOADS[:1], STEPPING))
    with pytest.raises(InputError, match="row 'pin x' is violated"):
        one_body.simulate(rich, driven(PATH, LOADS, STEPPING), InitialState(np.eye(21)[0], np.zeros(21)))


def test_dependent_rows_are_named_with_time_and_place(rich: FullBody) -> None:
    twice = replace(rich, rows=Rows((*rich.rows.rows, replace(rich.rows.rows[2], name="again")), rich.size))
    with pytest.raises(SimulationError) as caught:
        one_body.simulate(twice, driven(PATH, LOADS, STEPPING))
    assert str(caught.value) == ("stopped at t = 0 s, slider at 2 m: the rows slider 0, again depend on each other")


def test_a_slider_that_reaches_the_pin_is_named(rich: FullBody) -> None:
    path = Ramp(times=(0.0, 0.1), values=(0.1, 0.0))
    with pytest.raises(SimulationError, match=r"t = 0\.1 s, slider at 0 m: the row slider 0 vanishes"):
        one_body.simulate(rich, driven(path, LOADS, STEPPING))


def test_what_is_not_finite_stops_with_time_and_place(rich: FullBody) -> None:
    loads = [LOADS[0], Step(time=0.1, after=1e308)]
    with pytest.raises(SimulationError, match=r"step 100, t = 0\.1 s, slider at 2\.337\d* m: not finite"):
        one_body.simulate(rich, driven(PATH, loads, STEPPING))
    with pytest.raises(SimulationError, match=r"step 100, t = 0\.1 s, slider at 2\.337\d* m: not finite"):
        one_body.observe(modal_form(rich), driven(PATH, loads, STEPPING), every=10)


def test_observed_outputs_are_those_of_the_trajectory(rich: FullBody) -> None:
    whole = one_body.simulate(rich, driven(PATH, LOADS, STEPPING))
    seen = one_body.observe(modal_form(rich), driven(PATH, LOADS, STEPPING), outputs=[6, 2], every=7)
    np.testing.assert_allclose(seen.y, (rich.outputs @ whole.q.T).T[::7, [6, 2]], atol=1e-15)
    np.testing.assert_allclose(seen.multipliers, whole.multipliers[::7, 2:], rtol=1e-9)
    np.testing.assert_array_equal(seen.t, whole.t[::7])


@pytest.mark.parametrize("limit", ["steps", "numbers"])
def test_blocks_leave_no_trace(rich: FullBody, monkeypatch: pytest.MonkeyPatch, limit: str) -> None:
    form = modal_form(rich)
    whole = one_body.simulate_modal(form, driven(PATH, LOADS, STEPPING))
    seen = one_body.observe(form, driven(PATH, LOADS, STEPPING), every=3)
    size = form.body.size + -form.body.size % 4  # in whole registers
    monkeypatch.setattr(marching, *{"steps": ("BLOCK", 13), "numbers": ("RECORDED", 13 * 2 * size)}[limit])
    shares: list[float] = []
    again = one_body.simulate_modal(form, driven(PATH, LOADS, STEPPING), progress=shares.append)
    np.testing.assert_array_equal(again.q, whole.q)
    found = one_body.observe(form, driven(PATH, LOADS, STEPPING), every=3)
    np.testing.assert_array_equal(found.multipliers, seen.multipliers)
    np.testing.assert_allclose(found.y, seen.y, rtol=0.0, atol=1e-12 * np.abs(seen.y).max())  # BLAS sums by blocks
    assert shares == pytest.approx([*(np.arange(13, 200, 13) / 200), 1.0])


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_the_papers_trajectories_are_exudyns(full: FullBody, reduced: ReducedModel, name: str) -> None:
    case: Case = CASES[name]
    stepping = TimeStepping(end=15.0, step=4e-3, rho_inf=0.9)
    for body in (reduced, full):
        ours, theirs = (
            simulate(body, driven(case.path, case.load, stepping))
            for simulate in (one_body.simulate, one_body.in_exudyn)
        )
        assert np.abs(ours.q - theirs.q).max() < 1e-10
        assert np.abs(ours.v - theirs.v).max() < 1e-9
        assert np.abs(ours.multipliers - theirs.multipliers).max() < 1e-8 * np.abs(theirs.multipliers).max()
