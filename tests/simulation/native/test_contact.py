"""Rows that only push: the complementarity problem by itself, then statics, impacts and energy of a beam on pads."""

from dataclasses import replace

import numpy as np
import one_body
import pytest
from on_pads import LENGTH, NAMES, TAIL, WEIGHT, beam_on_pads, driven, flexible_on_pads, modes_on_pads
from one_body import displacement, energy, respond
from oracle import couples_modes
from scipy.integrate import solve_ivp
from scipy.interpolate import PPoly

from pmr import InputError, ReducedModel, Stepper, System
from pmr.files.arrays import Array
from pmr.kernel._native import lib
from pmr.kernel.state import StepError
from pmr.scene.signals import Constant, Ramp, SignalBase, Sine, SmoothRamp
from pmr.simulation import InitialState, TimeStepping
from pmr.simulation.modal import modal_form
from pmr.simulation.native.form import SystemForm, step_failure
from pmr.simulation.native.systems import remove_pull
from pmr.system.body import Trajectory, pushing_rows

CLEARANCE = 1e-3
REST = (Constant(amount=0.0), Constant(amount=0.0))
#: Falls on the lower pads, is pulled up and down so that it meets all four, and slides.
PATH = SmoothRamp(times=(0.0, 0.5), values=(3.0, 3.5))
LOADS = (SmoothRamp(times=(0.0, 0.1), values=(0.0, 9.81)), Sine(amplitude=4000.0, frequency=5.0))
#: One part a step: what is tested here is the scheme, whatever the step resolves.
STEPPING = TimeStepping(end=0.5, step=1e-3, rho_inf=0.9, parts=1)


BODIES = {"modes": modes_on_pads, "flexible": flexible_on_pads}


@pytest.fixture(params=BODIES)
def body(request: pytest.FixtureRequest) -> ReducedModel:
    return BODIES[request.param](beam_on_pads(CLEARANCE), 6)


@pytest.fixture(scope="module")
def few() -> ReducedModel:
    return modes_on_pads(beam_on_pads(CLEARANCE), 4)


def test_only_the_pads_below_carry_and_as_statics_says(body: ReducedModel) -> None:
    """Then weight turns round: across the clearance, and those above carry."""
    gravity = SmoothRamp(times=(0.0, 1.0, 10.0, 11.0), values=(0.0, 9.81, 9.81, -9.81))
    loads, s = (gravity, REST[1]), 3.5
    body = replace(body, D=10.0 * body.M)
    found = one_body.simulate(body, driven(Constant(amount=s), loads, TimeStepping(20.0, 1e-2, rho_inf=0.0)))
    mouth = 9.81 * WEIGHT * (LENGTH / 2.0 - TAIL) / (s - TAIL)
    below, above = found.multipliers[1000], found.multipliers[-1]
    assert below == pytest.approx([9.81 * WEIGHT - mouth, 0.0, mouth, 0.0], rel=1e-6)
    assert above == pytest.approx([0.0, 9.81 * WEIGHT - mouth, 0.0, mouth], rel=1e-6)
    assert below[1] == below[3] == above[0] == above[2] == 0.0  # exactly
    f = np.stack([f.value(found.t) for f in loads], axis=1)
    w = displacement(body, found.q, found.s, found.multipliers, f)[:, 7]  # the node at s
    assert w[1000] == pytest.approx(-CLEARANCE - mouth / 1e6) and w[-1] == pytest.approx(CLEARANCE + mouth / 1e6)


def gaps(body: ReducedModel, found: Trajectory, loads: tuple[SignalBase, ...]) -> Array:
    """c - (C q + H f - (G + 1/k) lambda), (T, m) in m."""
    came_out = body.apply_rows(found.s, found.q) - body.row_compliance * found.multipliers
    if body.flexibility is not None:
        f = np.stack([f.value(found.t) for f in loads], axis=1)
        came_out += body.flexibility.row_motion(found.s, found.multipliers, f)
    return body.row_clearance - came_out


def test_gap_and_force_are_complementary_at_every_step(body: ReducedModel) -> None:
    found = one_body.simulate(body, driven(PATH, LOADS, STEPPING))
    gap, force = gaps(body, found, LOADS), found.multipliers
    assert np.abs(np.minimum(gap / CLEARANCE, force / force.max())).max() < 1e-12
    assert np.all(force[gap > 1e-12] == 0.0) and np.all((force > 0.0).any(axis=0)) and np.all((gap > 1e-6).any(axis=0))
    f = np.stack([f.value(found.t) for f in LOADS], axis=1)
    assert respond(body, found, PATH.rate(found.t), f).residual_position.max() < 1e-14


def on_the_lower_pads(bilateral: bool) -> tuple[ReducedModel, InitialState]:
    """Without pads above, in equilibrium under its weight."""
    whole = flexible_on_pads(beam_on_pads(None if bilateral else 0.0), 6)
    below, flexibility = [0, 2], whole.flexibility
    assert flexibility is not None
    tables = replace(
        flexibility,
        rows=type(whole.rows)(flexibility.rows.c[:, :, below][:, :, :, below], flexibility.rows.x),
        inputs=type(whole.rows)(flexibility.inputs.c[:, :, below], flexibility.inputs.x),
        outputs=type(whole.rows)(flexibility.outputs.c[..., below], flexibility.outputs.x),
    )
    body = replace(
        whole,
        rows=type(whole.rows)(whole.rows.c[:, :, below], whole.rows.x),
        row_names=tuple(whole.row_names[i] for i in below),
        pads=whole.row_compliance[below],
        clearance=None if bilateral else whole.row_clearance[below],
        flexibility=tables,
    )
    C, F = body.C(3.0), tables.rows(3.0) + np.diag(body.row_compliance)
    f = np.array([9.81, 0.0])
    answer = np.linalg.solve(np.block([[body.K, C.T], [C, -F]]), np.concatenate([body.B @ f, -tables.inputs(3.0) @ f]))
    return body, InitialState(answer[: body.size], np.zeros(body.size))


def test_pads_that_stay_closed_are_bilateral_ones() -> None:
    (pushing, start), (holding, _) = on_the_lower_pads(bilateral=False), on_the_lower_pads(bilateral=True)
    loads = (Constant(amount=9.81), Sine(amplitude=200.0, frequency=5.0))
    found, expected = (one_body.simulate(body, driven(PATH, loads, STEPPING), start) for body in (pushing, holding))
    assert found.multipliers.min() > 100.0 and np.ptp(found.multipliers[:, 1]) > 500.0
    for name in ("q", "v", "multipliers"):
        a, b = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-13 * np.abs(b).max())


def by_penalty(body: ReducedModel, t: Array) -> tuple[Array, Array, Array]:
    """q, v (T, n) and lambda (T, m) with lambda = k max(0, C q - c), by Dormand and Prince of order 8."""
    k, n = 1.0 / body.row_compliance, body.size

    def forces(at: float, q: Array) -> tuple[Array, Array]:
        C = body.C(float(PATH.value(at)))
        return C, k * np.maximum(C @ q - body.row_clearance, 0.0)

    def rates(at: float, y: Array) -> Array:
        C, force = forces(at, y[:n])
        f = np.array([float(load.value(at)) for load in LOADS])
        right = body.B @ f - body.K @ y[:n] - body.D @ y[n:] - C.T @ force
        return np.concatenate([y[n:], np.linalg.solve(body.M, right)])

    y = solve_ivp(rates, (0.0, t[-1]), np.zeros(2 * n), "DOP853", t, rtol=1e-10, atol=1e-12, max_step=2e-3).y.T
    return y[:, :n], y[:, n:], np.array([forces(at, q)[1] for at, q in zip(t, y[:, :n], strict=True)])


@pytest.mark.slow
def test_impacts_converge_with_second_order_to_an_independent_integrator(few: ReducedModel) -> None:
    """Ten impacts on all four pads; measured orders 1.8 to 2.1 from h = 1 ms on, in the mean 2.0."""
    expected = by_penalty(few, np.arange(251) * 2e-3)
    assert np.sum(np.diff((expected[2] > 0.0).astype(int), axis=0) > 0) == 10
    errors = []
    for halvings in (1, 3, 5):
        found = one_body.simulate(few, driven(PATH, LOADS, TimeStepping(0.5, 2e-3 / 2**halvings, 0.9, parts=1)))
        of_each = zip((found.q, found.v, found.multipliers), expected, strict=True)
        errors.append([np.abs(a[:: 2**halvings] - b).max() / np.abs(b).max() for a, b in of_each])
    orders = np.log2(np.array(errors[:-1]) / errors[1:]) / 2.0
    assert orders == pytest.approx(np.full((2, 3), 2.0), abs=0.15)
    assert max(errors[0][:2]) < 3e-3 and errors[0][2] < 1.2e-2 and max(errors[-1]) < 5e-5


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("rho_inf", [0.0, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("stiffness", [1e6, 1e8, 1e10])
@pytest.mark.parametrize("kind", BODIES)
def test_energy_never_grows_over_many_impacts(kind: str, stiffness: float, rho_inf: float) -> None:
    """Contact resolved (0.05 rad a step) or not at all (some 100 rad); pads and residual part included."""
    body = BODIES[kind](beam_on_pads(CLEARANCE, stiffness), 6)
    v = np.zeros(6)
    v[:4] = np.random.default_rng(0).standard_normal(4) * [0.6, 0.6, 1.0, 0.6]
    for h in (1e-4, 1e-3, 1e-2):
        start = InitialState(np.zeros(6), v)
        found = one_body.simulate(
            body, driven(Constant(amount=3.5), REST, TimeStepping(10000 * h, h, rho_inf, parts=1)), start
        )
        total = energy(body, found, np.zeros((10001, 2))).total
        assert np.sum(np.diff((found.multipliers > 0.0).astype(int), axis=0) > 0) > 10
        assert total.max() <= total[0] * (1.0 + 1e-12)
        if h == 1e-4 and stiffness == 1e6:
            assert total[-1] > 0.99 * total[0]  # resolved impacts are elastic


@pytest.mark.parametrize(("rate", "least", "mean"), [(0.1, 0.985, 0.994), (1.0, 0.3, 0.6), (20.0, 0.0, 0.2)])
def test_an_impact_keeps_what_the_step_resolves_and_never_adds(rate: float, least: float, mean: float) -> None:
    """One mass against one pad, h omega = `rate`, over all phases within a step."""
    one, row = np.eye(1), PPoly(np.ones((1, 1, 1, 1)), [0.0, 1.0])
    mass = ReducedModel(one, 0.0 * one, 0.0 * one, 0.0 * one, one, row, ("gravity",), ("pad",), np.zeros(1))
    start, kept = InitialState(np.zeros(1), np.ones(1)), []
    for phase in np.linspace(0.0, 1.0, 20, endpoint=False):
        body = replace(mass, pads=np.array([rate**-2.0]), clearance=np.array([5.0 + phase]))
        stepping = TimeStepping(np.ceil(20.0 + np.pi / rate), 1.0, 0.9, parts=1)
        found = one_body.simulate(body, driven(Constant(amount=0.5), REST[0], stepping), start)
        assert found.multipliers.max() > 0.0 == found.multipliers[-1, 0] and found.v[-1, 0] < 0.0
        kept.append(float(found.v[-1, 0] ** 2))
    assert least < min(kept) and mean < np.mean(kept) and max(kept) <= 1.0 + 1e-12


def test_the_start_tells_which_pads_are_closed(body: ReducedModel) -> None:
    """Pressed into the lower pads by 2 mm: forces follow from the position, and fit the motion that begins."""
    loads = (Constant(amount=9.81), REST[1])
    down = body.outputs.T @ np.linalg.solve(
        body.outputs @ body.outputs.T + 1e-12 * np.eye(len(body.outputs)), -3e-3 * np.ones(11)
    )
    found = one_body.simulate(
        body, driven(Constant(amount=3.5), loads, TimeStepping(1e-5, 1e-6, parts=1)), InitialState(down, np.zeros(6))
    )
    first = found.multipliers[0]
    assert first[1] == first[3] == 0.0 and first[0] > 0.0 < first[2]
    np.testing.assert_allclose(found.multipliers[1], first, rtol=1e-4)
    a = body.B @ [9.81, 0.0] - body.K @ down - body.C(3.5).T @ first
    np.testing.assert_allclose(found.v[1], 1e-6 * a, rtol=0.0, atol=1e-4 * np.abs(found.v[1]).max())


def test_a_damping_that_couples_the_modes_changes_nothing_else(few: ReducedModel) -> None:
    D = np.diag([0.0, 0.0, 1.0, 2.0])
    coupled = D.copy()
    coupled[2, 3] = coupled[3, 2] = 1e-8
    plain, other = replace(few, D=D), replace(few, D=coupled)
    assert couples_modes(modal_form(other)) and not couples_modes(modal_form(plain))
    found, expected = (one_body.simulate(body, driven(PATH, LOADS, STEPPING)) for body in (other, plain))
    assert np.sum(np.diff((found.multipliers > 0.0).astype(int), axis=0) < 0) >= 8
    np.testing.assert_allclose(found.q, expected.q, rtol=0.0, atol=1e-7 * np.abs(expected.q).max())


def test_a_full_body_is_marched_likewise() -> None:
    full = beam_on_pads(CLEARANCE, elements=4)
    modes = modes_on_pads(full, full.size - 1)
    assert np.isnan(full.row_clearance).tolist() == [True] + [False] * 4
    found, expected = (
        one_body.simulate(body, driven(PATH, LOADS, TimeStepping(0.1, 1e-4, parts=1))) for body in (full, modes)
    )
    scale = np.abs(expected.multipliers).max()
    assert np.all(expected.multipliers.min(axis=0) == 0.0) and scale > 0.0
    np.testing.assert_allclose(found.multipliers[:, 1:], expected.multipliers, rtol=0.0, atol=1e-6 * scale)


def test_steps_and_observations_are_those_of_the_simulation(body: ReducedModel) -> None:
    found = one_body.simulate(body, driven(PATH, LOADS, STEPPING))
    seen = one_body.observe(modal_form(body), driven(PATH, LOADS, STEPPING), outputs=[6, 3], every=5)
    np.testing.assert_allclose(seen.multipliers, found.multipliers[::5], rtol=0.0, atol=1e-9)
    s, f = PATH.value(found.t), np.stack([f.value(found.t) for f in LOADS], axis=1)
    stepper = Stepper(body, step=1e-3, s=float(s[0]), F=f[0], outputs=[6, 3])
    forces = []
    for at, load in zip(s[1:], f[1:], strict=True):
        y = stepper.step(at, load)
        forces.append(stepper.multipliers)
    np.testing.assert_allclose(forces, found.multipliers[1:], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(y, seen.y[-1], atol=1e-13)


def test_what_is_not_settled_is_named(few: ReducedModel) -> None:
    error = StepError("", lib.PMR_UNSETTLED, -1)
    failure = step_failure("step 1", SystemForm.of(System.of(few)), error, np.zeros(len(NAMES)))
    assert f"stopped at step 1: which of the rows {', '.join(NAMES)} are closed" in str(failure)


def test_pads_that_only_push_never_pull_not_even_by_round_off(few: ReducedModel) -> None:
    """Which of them hold is decided to round-off of the largest force; what they report is decided at zero."""
    found = one_body.simulate(few, driven(PATH, LOADS, STEPPING))
    seen = one_body.observe(modal_form(few), driven(PATH, LOADS, STEPPING))
    pushing = pushing_rows(few)
    assert found.multipliers[:, pushing].min() == 0.0 == seen.multipliers[:, pushing].min()
    forces = np.array([[-1e-10, -2.0, 3.0]])
    remove_pull(forces, np.array([True, False, True]))
    assert forces.tolist() == [[0.0, -2.0, 3.0]]


def test_what_does_not_fit_is_refused(few: ReducedModel) -> None:
    with pytest.raises(InputError, match=r"reduction\.flexibility = False: mouth top only push and are rigid"):
        one_body.simulate(replace(few, pads=np.array([1e-6, 1e-6, 1e-6, 0.0])), driven(PATH, LOADS, STEPPING))


def test_moving_pads_do_work_and_no_more(few: ReducedModel) -> None:
    """A slow path under weight: the march with 1 ms and the one with 0.1 ms end in the same place."""
    loads, path = (LOADS[0], REST[1]), Ramp(times=(0.5, 2.0), values=(3.0, 4.0))
    damped = replace(few, D=20.0 * few.M)
    coarse, fine = (
        one_body.simulate(damped, driven(path, loads, TimeStepping(2.0, h, 0.7, parts=1))) for h in (1e-3, 1e-4)
    )
    np.testing.assert_allclose(coarse.multipliers[-1], fine.multipliers[-1], atol=1e-3 * fine.multipliers.max())
