"""The march that keeps the residual part's inertia: its equations, its accuracy, its order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from driving import driven, loads_at
from numpy.typing import NDArray
from oracle import flexible, inertial, nrms_error

from pmr.compare.evaluation import respond
from pmr.errors import InputError, SimulationError
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import with_kept_inertia
from pmr.scene.signals import Constant, Ramp, SignalBase, Sine, SmoothRamp
from pmr.simulation import InitialState, TimeStepping
from pmr.simulation.balance import energy
from pmr.simulation.modal import modal_form
from pmr.simulation.native import march as marching
from pmr.simulation.native import simulator as march
from pmr.simulation.native.stepper import Stepper
from pmr.system.body import FullBody, Trajectory, displacement

Array = NDArray[np.float64]

#: Out and back, at rest at either end, within 0.6 s; the second slider is 0.8 m ahead.
PATH = SmoothRamp(times=(0.05, 0.35, 0.6), values=(1.5, 2.2, 1.7))
LOADS = (Sine(amplitude=200.0, frequency=3.0), SmoothRamp(times=(0.0, 0.3), values=(0.0, 80.0)))


def simulated(model: ReducedModel, h: float = 1e-4, end: float = 0.6, rho_inf: float = 0.9) -> Trajectory:
    return march.simulate(with_kept_inertia(model), driven(PATH, LOADS, TimeStepping(end, h, rho_inf)))


def outputs(model: FullBody | ReducedModel, run: Trajectory) -> Array:
    return displacement(model, run.q, run.s, run.deforming, loads_at(LOADS, run.t))


def rates(x: Array, h: float) -> tuple[Array, Array]:
    """First and second derivative of samples, fourth order, at all but two on either side."""
    first = (x[:-4] - 8 * x[1:-3] + 8 * x[3:-1] - x[4:]) / (12 * h)
    second = (-x[:-4] + 16 * x[1:-3] - 30 * x[2:-2] + 16 * x[3:-1] - x[4:]) / (12 * h**2)
    return first, second


@pytest.mark.parametrize("pads", [None, np.array([2e-6, 5e-6])])
def test_the_trajectory_solves_its_equations(rich: FullBody, pads: Array | None) -> None:
    """Two sliders, two inputs, damping, pads: derivatives of the trajectory put into the equations of section 11."""
    h, model = 2e-5, replace(inertial(rich, 5), pads=pads)
    assert model.flexibility and model.flexibility.inertia
    tables, run = model.flexibility, simulated(model, h, end=0.4, rho_inf=1.0)
    inertia, s, z = tables.inertia, run.s, run.deforming
    assert run.quasi_static is not None
    f = loads_at(LOADS, run.t)
    (dp, ddp), (dz, ddz), (ds, dds), (df, ddf) = (rates(x, h) for x in (run.q, z, s[:, None], f))
    inner = slice(2, -2)
    p, z, s, f, force = run.q[inner], z[inner], s[inner], f[inner], run.multipliers[inner]

    def times(table: object, x: Array) -> Array:
        return np.einsum("tab,tb->ta", table(s), x)  # type: ignore[operator]

    C = model.C(s)
    motion = ddp @ model.M + dp @ model.D + p @ model.K + np.einsum("tmr,tm->tr", C, force) - f @ model.B.T
    compliance = model.row_compliance
    rows = np.einsum("tmr,tr->tm", C, p) + times(tables.inputs, f) - times(tables.rows, z) - compliance * z
    gap = times(tables.rows, force - z) + compliance * (force - z)
    expected = times(inertia.A0, ddz) + 2 * ds * times(inertia.A1, dz) + dds * times(inertia.A1, z)
    expected += ds**2 * times(inertia.A2, z) - times(inertia.E0, ddf)
    expected += times(inertia.D0, dz) + ds * times(inertia.D1, z) - times(inertia.F0, df)
    late = slice(len(p) // 20, None)  # the start strikes: what rings there is not resolved by differences
    assert np.abs(rows).max() < 1e-13
    assert np.abs(motion[late]).max() < 2e-3 * np.abs(p @ model.K).max()
    assert np.sqrt(np.mean((gap - expected)[late] ** 2)) < 5e-3 * np.sqrt(np.mean(gap[late] ** 2))
    for left_out in (dds * times(inertia.A1, z), times(inertia.D0, dz), 2 * ds * times(inertia.A1, dz)):
        assert np.sqrt(np.mean(left_out[late] ** 2)) > 1e-2 * np.sqrt(np.mean(gap[late] ** 2))  # each would be missed


@pytest.mark.parametrize("pads", [None, np.array([1e-8, 2e-8])])
def test_it_follows_the_whole_body_more_closely(rich: FullBody, pads: Array | None) -> None:
    """Displacements and slider forces, against the full model with the same step.

    Softer pads leave more to loads that strike modes left out directly, which no term in the rows can follow.
    """
    if pads is not None:
        rows = [replace(row, compliance=k) for row, k in zip(rich.rows.rows[2:], pads, strict=True)]
        rich = replace(rich, rows=replace(rich.rows, rows=(*rich.rows.rows[:2], *rows)))
    stepping = TimeStepping(0.6, 1e-4, 0.9)
    full = march.simulate(rich, driven(PATH, LOADS, stepping))
    few = inertial(rich, 5)
    without = march.simulate(few, driven(PATH, LOADS, stepping))
    kept = march.simulate(with_kept_inertia(few), driven(PATH, LOADS, stepping))
    w = outputs(rich, full)
    assert nrms_error(outputs(few, kept), w) < 0.16 * nrms_error(outputs(few, without), w) < 4e-3
    force = full.multipliers[:, 2:]
    assert nrms_error(kept.multipliers, force) < 0.12 * nrms_error(without.multipliers, force)


def test_without_inertia_it_is_the_plain_march(rich: FullBody) -> None:
    model = inertial(rich, 5)
    assert model.flexibility and model.flexibility.inertia
    tables = {name: replace_table(getattr(model.flexibility.inertia, name)) for name in ("A0", "A1", "A2", "E0")}
    tables |= {name: replace_table(getattr(model.flexibility.inertia, name)) for name in ("D0", "D1", "F0")}
    light = replace(model.flexibility, inertia=replace(model.flexibility.inertia, **tables))
    stepping = TimeStepping(0.3, 1e-3, 0.8)
    start = InitialState(np.linspace(1e-4, 1e-3, 5), np.linspace(-0.1, 0.1, 5))
    plain = march.simulate(model, driven(PATH, LOADS, stepping), start)
    found = march.simulate(with_kept_inertia(replace(model, flexibility=light)), driven(PATH, LOADS, stepping), start)
    for name in ("q", "v", "multipliers"):
        a, b = getattr(found, name), getattr(plain, name)
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-10 * np.abs(b).max())
    np.testing.assert_allclose(
        found.deforming, plain.multipliers, rtol=0.0, atol=1e-10 * np.abs(plain.multipliers).max()
    )


def replace_table(table):  # noqa: ANN001, ANN201
    return type(table)(np.zeros_like(table.c), table.x)


@pytest.mark.parametrize("rho_inf", [0.0, 0.9, 1.0])
def test_second_order_with_the_slider_in_one_element(rich: FullBody, rho_inf: float) -> None:
    model, path = inertial(rich, 5), Sine(amplitude=0.15, frequency=2.0, offset=1.9)
    load = [Sine(amplitude=100.0, frequency=2.0)] * 2

    def run(h: float) -> Trajectory:
        return march.simulate(with_kept_inertia(model), driven(path, load, TimeStepping(0.2, h, rho_inf)))

    h = 4e-4
    fine, *coarse = (run(step) for step in (h / 16, h, h / 2))
    for name in ("q", "v", "multipliers"):
        exact = getattr(fine, name)
        a, b = (np.abs(getattr(c, name) - exact[::every]).max() for c, every in zip(coarse, (16, 8), strict=True))
        assert a / b == pytest.approx(4.0, abs=0.2), name


def test_a_response_takes_outputs_and_energies_from_the_quasi_static_force(rich: FullBody) -> None:
    model, stepping = inertial(rich, 5), TimeStepping(0.6, 1e-3, 0.9)
    run = march.simulate(with_kept_inertia(model), driven(PATH, LOADS, stepping))
    f = loads_at(LOADS, run.t)
    found = respond(model, run, PATH.rate(run.t), f)
    assert found.residual_position.max() < 1e-14
    assert np.array_equal(found.slider_force, run.multipliers) and np.abs(run.multipliers - run.deforming).max() > 1.0
    assert run.quasi_static is not None
    as_static = replace(run, multipliers=run.quasi_static, quasi_static=None)
    assert np.array_equal(energy(model, run, f).strain, energy(model, as_static, f).strain)


def test_what_it_cannot_simulate_is_refused(rich: FullBody) -> None:
    model, stepping = inertial(rich, 5), TimeStepping(0.1, 1e-3, 0.9)
    with pytest.raises(ValueError, match="no tables of the residual part's inertia"):
        with_kept_inertia(flexible(rich, 5))
    coupled = model.D.copy()
    coupled[1, 2] = coupled[2, 1] = 0.5 * coupled[2, 2]
    with pytest.raises(InputError, match=r"reduction\.residual_inertia = True: false .* damping couples the modes"):
        march.simulate(with_kept_inertia(replace(model, D=coupled)), driven(PATH, LOADS, stepping))

    def to(path: SignalBase) -> None:
        march.simulate(with_kept_inertia(model), driven(path, LOADS, stepping))

    with pytest.raises(InputError, match="0 to 4.2 m is allowed; left at t = 0.051 s"):
        to(Ramp(times=(0.0, 0.1), values=(4.0, 4.4 + 1e-6)))
    with pytest.raises(SimulationError, match=r"step 100, t = 0\.1 s, slider at 0 m: the rows slider 0 can't tell"):
        to(Ramp(times=(0.0, 0.1), values=(0.1, 0.0)))
    with pytest.raises(InputError, match="loads: F given, one for each input"):
        march.simulate(with_kept_inertia(model), driven(PATH, LOADS[:1], stepping))
    with pytest.raises(SimulationError, match="step 1, t = 0.001 s, slider at 1.5 m: not finite"):
        march.simulate(with_kept_inertia(model), driven(PATH, (Constant(amount=1e307), LOADS[1]), stepping))


def test_blocks_leave_no_trace(rich: FullBody, monkeypatch: pytest.MonkeyPatch) -> None:
    form, stepping, told = modal_form(with_kept_inertia(inertial(rich, 5))), TimeStepping(0.2, 1e-3, 0.9), list[float]()
    whole = march.simulate_modal(form, driven(PATH, LOADS, stepping))
    monkeypatch.setattr(marching, "BLOCK", 13)
    again = march.simulate_modal(form, driven(PATH, LOADS, stepping), progress=told.append)
    assert np.array_equal(again.q, whole.q) and np.array_equal(again.multipliers, whole.multipliers)
    assert told == pytest.approx([*(np.arange(13, 200, 13) / 200), 1.0])


def test_march_goes_there_and_nothing_else_leaves_the_inertia_out(rich: FullBody) -> None:
    model, stepping = inertial(rich, 5), TimeStepping(0.1, 1e-3, 0.9)
    found, without = (march.simulate(one, driven(PATH, LOADS, stepping)) for one in (with_kept_inertia(model), model))
    assert found.quasi_static is not None and without.quasi_static is None
    with pytest.raises(InputError, match=r"reduction\.residual_inertia = True: false is allowed step by step"):
        march.observe(modal_form(with_kept_inertia(model)), driven(PATH, LOADS, stepping))
    with pytest.raises(InputError, match=r"reduction\.residual_inertia = True: false is allowed step by step"):
        Stepper(with_kept_inertia(model), step=1e-3, s=1.5)
