"""Where the compiled simulator's limits lie: the most telling points of docs/validation.md, "At the extremes"."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import on_pads
import one_body
import pytest
import scipy.linalg
from generalized_alpha import GeneralizedAlpha
from on_pads import beam_on_pads, flexible_on_pads
from one_body import displacement, energy
from oracle import LENGTH, TIP_LOAD, flexible, full_body, nrms_error

from pmr import ReducedModel, reduce
from pmr.compare.errors import relative_error
from pmr.files.arrays import Array
from pmr.fullmodel.build import full_model
from pmr.scene.signals import Constant, SignalBase, SmoothRamp, Table
from pmr.simulation import Excitation, InitialState, TimeStepping
from pmr.simulation.modal import modal_form
from pmr.system.body import FullBody, SlidingBody, Trajectory
from pmr.system.polynomials import evaluate

FULL = full_body(20)
MODEL = flexible(FULL, 6)
ACROSS, WITHIN = (SmoothRamp(times=(0.1, 0.9), values=values) for values in ((1.5, 3.0), (2.01, 2.24)))
FIXED = Constant(amount=2.1)
LOAD = SmoothRamp(times=(0.0, 0.4, 0.8), values=(0.0, 100.0, 0.0))
NOTHING = Constant(amount=0.0)


def driven(path: SignalBase, load: SignalBase, end: float, step: float, rho_inf: float = 0.9) -> Excitation:
    return Excitation({"slider": path}, {TIP_LOAD: load}, TimeStepping(end, step, rho_inf))


def moved(body: SlidingBody, excitation: Excitation, run: Trajectory) -> Array:
    return displacement(body, run.q, run.s, run.multipliers, excitation.forces(body.input_names))


def motion(body: SlidingBody, excitation: Excitation) -> Array:
    return moved(body, excitation, one_body.simulate(body, excitation))


BODIES = {"index 1": MODEL, "index 3": FULL}


@pytest.mark.slow
@pytest.mark.parametrize("rho_inf", [0.0, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("path", [FIXED, WITHIN, ACROSS], ids=["fixed", "within an element", "across elements"])
@pytest.mark.parametrize("name", BODIES)
def test_displacements_converge_with_second_order(name: str, path: SignalBase, rho_inf: float) -> None:
    if name == "index 3" and rho_inf == 1.0 and path is not FIXED:
        pytest.skip("rigid rows that move are refused with rho_inf = 1")
    ys = [motion(BODIES[name], driven(path, LOAD, 1.0, h, rho_inf))[:: round(4e-3 / h)] for h in (2e-3, 1e-3, 6.25e-5)]
    errors = [nrms_error(y, ys[-1]) for y in ys[:-1]]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def constrained_mode(model: ReducedModel, s: float) -> tuple[float, Array]:
    """Lowest circular frequency in rad/s with the slider at s, and the mode."""
    assert model.flexibility is not None
    C = model.C(s)
    K = model.K + C.T @ np.linalg.solve(evaluate(model.flexibility.rows, np.array([s]))[0], C)
    squares, modes = scipy.linalg.eigh(K, model.M)
    return float(np.sqrt(squares[0])), modes[:, 0]


@pytest.mark.parametrize("theta", [0.02, 0.05, 0.1])
@pytest.mark.parametrize("rho_inf", [0.0, 0.5, 0.9])
def test_numerical_dissipation(rho_inf: float, theta: float) -> None:
    r"""Energy lost in a period: :math:`2 \pi ((1 - \rho) / (1 + \rho))^3 \Theta^3` with Theta = omega h."""
    omega, mode = constrained_mode(MODEL, 2.5)
    step, period = theta / omega, 2.0 * np.pi / theta
    excitation = driven(Constant(amount=2.5), NOTHING, round(20 * period) * step, step, rho_inf)
    run = one_body.simulate(MODEL, excitation, InitialState(0.01 * mode, np.zeros(6)))
    p, v = run.q @ MODEL.M @ mode, run.v @ MODEL.M @ mode
    stored = v**2 + omega**2 * p**2
    first, last = round(5 * period), round(15 * period)
    loss = -np.log(stored[last] / stored[first]) * period / (last - first)
    assert loss == pytest.approx(2.0 * np.pi * ((1.0 - rho_inf) / (1.0 + rho_inf)) ** 3 * theta**3, rel=0.05)


def smoother(begin: float, end: float) -> Table:
    """x^5 (126 - 420 x + 540 x^2 - 315 x^3 + 70 x^4) from 0.5 s on: four derivatives vanish at its ends."""
    x = np.linspace(0.0, 1.0, 101)
    shape = x**5 * (126.0 + x * (-420.0 + x * (540.0 + x * (-315.0 + x * 70.0))))
    return Table(times=tuple(0.5 + 5.0 * x), values=tuple(begin + (end - begin) * shape))


def test_a_slow_slide_keeps_energy_over_frequency() -> None:
    r"""Adiabatic: from L/4 to 3 L/4 in 5 s both grow by omega_1 / omega_0 = 2.9600321, whatever the phase at the start.

    Energy is a quadratic form of the start, so :math:`E_1 / E_0 = m + a \cos 2 \varphi + b \sin 2 \varphi`, and three
    phases tell all.  What a and b are is decided by the smoothness of the path's ends.
    """
    low, high, h = LENGTH / 4.0, 3.0 * LENGTH / 4.0, 2e-4
    omega, mode = constrained_mode(MODEL, low)

    def furthest_off(path: SignalBase) -> float:
        excitation, grown = driven(path, NOTHING, 6.0, h, 1.0), []
        for phase in (0.0, np.pi / 2.0, np.pi / 4.0):
            start = InitialState(0.01 * np.cos(phase) * mode, 0.01 * np.sin(phase) * omega * mode)
            run = one_body.simulate(MODEL, excitation, start)
            stored = energy(MODEL, run, excitation.forces(MODEL.input_names)).total
            grown.append(stored[-2000:].mean() / stored[:2000].mean() / 2.9600321)
        mean = (grown[0] + grown[1]) / 2.0
        return float(abs(mean - 1.0) + np.hypot((grown[0] - grown[1]) / 2.0, grown[2] - mean))

    smoothest, quintic = (
        furthest_off(path) for path in (smoother(low, high), SmoothRamp(times=(0.5, 5.5), values=(low, high)))
    )
    assert smoothest < 1e-4 and smoothest < quintic / 2.0


@pytest.mark.slow
@pytest.mark.parametrize("offsets", [[0.0, 0.5], [0.0, 0.5, 1.0]])
def test_the_matrix_of_a_step_tends_to_one_that_is_well_conditioned(load_scene, offsets: list[float]) -> None:
    """dq C S^-1 C^T + G, scaled to a diagonal of ones: for h = 1e-4, 1e-5 and 1e-6 s, full and reduced."""
    scene = load_scene("residual/steel_boom", [f"slider.offsets={offsets}"])
    full = full_model(scene).gather()
    assert full is not None
    for body in (full, reduce(scene).reduced):
        found = [condition(modal_form(body).body, scene.path_bounds, h) for h in (1e-4, 1e-5, 1e-6)]
        assert max(found) < 1e3 and found[2] == pytest.approx(found[1], rel=0.2)


def condition(body: ReducedModel, bounds: tuple[float, float], h: float) -> float:
    """Largest condition number of the multipliers' matrix along a path, of a body in modal coordinates."""
    z_gain, v_gain = GeneralizedAlpha(h, 0.9).gains
    S = 1.0 + np.diagonal(body.D) * v_gain + np.diagonal(body.K) * z_gain
    found = []
    for s in np.linspace(*bounds, 13):
        C = body.C(s)
        A = z_gain * (C / S) @ C.T
        if body.flexibility is not None:
            A = A + evaluate(body.flexibility.rows, np.array([s]))[0]
        scale = 1.0 / np.sqrt(np.diagonal(A))
        found.append(np.linalg.cond(scale[:, None] * A * scale))
    return float(max(found))


def test_what_the_body_gains_while_it_slides_is_work() -> None:
    """Of loads and of the slider that is pushed along a bent beam; the rest falls with the square of the step."""
    rests = []
    for step in (1e-3, 5e-4):
        excitation = driven(ACROSS, LOAD, 1.0, step, 1.0)
        run, f = one_body.simulate(MODEL, excitation), excitation.forces(MODEL.input_names)
        tables = MODEL.flexibility
        assert tables is not None
        stored = energy(MODEL, run, f)
        points = run.q @ MODEL.B + tables.input_motion(run.s, run.multipliers, f)
        slope = MODEL.apply_rows(run.s, run.q, 1) + np.einsum("tmi,ti->tm", evaluate(tables.inputs, run.s, 1), f)
        slope -= np.einsum("tmn,tn->tm", evaluate(tables.rows, run.s, 1), run.multipliers) / 2.0
        power = excitation.path_rate * np.einsum("tm,tm->t", run.multipliers, slope)
        work = ((f[1:] + f[:-1]) / 2.0 * np.diff(points, axis=0)).sum(axis=1) + step * (power[1:] + power[:-1]) / 2.0
        held = stored.kinetic + stored.strain
        rests.append(np.abs(held - held[0] - np.concatenate([[0.0], np.cumsum(work)])).max() / held.max())
    assert rests[0] < 5e-5 and np.log2(rests[0] / rests[1]) == pytest.approx(2.0, abs=0.1)


def scaled(mass_and_stiffness: float) -> FullBody:
    return replace(FULL, M=FULL.M * mass_and_stiffness, K=FULL.K * mass_and_stiffness)


@pytest.mark.parametrize(("size", "force"), [(1e6, 1e-12), (1e6, 1e9), (1e-6, 1e-12), (1e-6, 1e9)])
def test_errors_do_not_depend_on_units(size: float, force: float) -> None:
    """Stiffness and mass over twelve decades, forces over twenty-one."""

    def error(full: FullBody, load: float) -> float:
        pulse = SmoothRamp(times=(0.0, 0.4, 0.8), values=(0.0, load, 0.0))
        reduced, reference = (motion(body, driven(ACROSS, pulse, 1.0, 1e-3)) for body in (flexible(full, 6), full))
        return relative_error(reduced, reference)

    assert error(scaled(size), 100.0 * force) == pytest.approx(error(FULL, 100.0), rel=1e-6)


def test_stiff_pads_tend_to_the_rigid_one() -> None:
    """In proportion to their compliance, from 1e7 to 1e15 N/m."""
    excitation = driven(ACROSS, LOAD, 1.0, 1e-3)
    rigid = motion(MODEL, excitation)
    stiffness = np.array([1e9, 1e12, 1e15])
    away = [nrms_error(motion(replace(MODEL, pads=np.array([1.0 / k])), excitation), rigid) for k in stiffness]
    assert np.allclose(away * stiffness / (away[0] * stiffness[0]), 1.0, rtol=0.01)


@pytest.mark.parametrize("make", [lambda body: body, lambda body: flexible_on_pads(body, 6)], ids=["full", "reduced"])
def test_pads_farther_away_than_the_motion_are_not_there(make: Callable[[FullBody], SlidingBody]) -> None:
    body = make(beam_on_pads(clearance=10.0))
    excitation = on_pads.driven(ACROSS, (Constant(amount=9.81), NOTHING), TimeStepping(1.0, 1e-3))
    run = one_body.simulate(body, excitation)
    fallen = 9.81 * run.t[:, None] ** 2 / 2.0
    assert np.abs(moved(body, excitation, run) + fallen).max() < 1e-9 * fallen.max()
    assert np.abs(run.multipliers).max() < 1e-12 * on_pads.WEIGHT * 9.81


@pytest.mark.parametrize("r", [1, 2, 3, 6, 20, 40])
def test_any_number_of_modes_keeps_the_rows(r: int) -> None:
    model, excitation = flexible(FULL, r), driven(ACROSS, LOAD, 1.0, 1e-3)
    run = one_body.simulate(model, excitation)
    assert model.flexibility is not None
    f = excitation.forces(model.input_names)
    gap = model.apply_rows(run.s, run.q) + model.flexibility.row_motion(run.s, run.multipliers, f)
    assert np.abs(gap).max() < 1e-12 * np.abs(moved(model, excitation, run)).max()


def test_every_mode_more_is_worth_it_until_none_is_left() -> None:
    excitation = driven(ACROSS, LOAD, 1.0, 1e-3)
    truth = motion(FULL, excitation)
    errors = [nrms_error(motion(flexible(FULL, r), excitation), truth) for r in (1, 2, 3, 6, 20, 40)]
    assert np.all(np.diff(errors) < 0.0) and errors[-1] < 1e-7


def test_a_slider_beside_its_support_clamps_the_body() -> None:
    """1e-6 m of it like 1e-3 m; full and reduced model agree."""
    for s in (1e-6, 1e-3, 0.25):
        excitation = driven(Constant(amount=s), LOAD, 1.0, 1e-3)
        assert nrms_error(motion(MODEL, excitation), motion(FULL, excitation)) < 1e-4
