"""Friction of pads in the compiled loop: its moment, what it does to a cylinder, and who knows none."""

from dataclasses import replace

import numpy as np
import pytest
from nested import Nested, full, reduced

from pmr import InputError, Stepper, System
from pmr.scene.signals import Constant, Ramp, Sine
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.excitation import side_positions
from pmr.simulation.native import systems
from pmr.system.assembly import Assembly
from pmr.system.states import states_of

MU, ARM = 0.3, 0.18


def rubbing(system: System) -> System:
    """With pads that rub on a face, and slide at once."""
    rough = [replace(one, friction=MU, arm=ARM, shear_stiffness=1e13) for one in system.contacts]
    return replace(system, contacts=tuple(rough))


def sliding(system: System, stepping: TimeStepping, speed: float) -> Excitation:
    """Out at a steady speed, under a tip force."""
    loads = {name: Constant(amount=5e3) for name in system.input_names}
    paths = {"1": Ramp(times=(0.0, stepping.end), values=(2.0, 2.0 + speed * stepping.end))}
    return Excitation(paths, loads, stepping)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_pad_that_rubs_presses_as_one_nearer_to_the_tail(way: float) -> None:
    """By e mu while the section slides out: (C - e mu C')^T lambda, with C' by differences, in long steps at rest."""
    system = rubbing(full(Nested(2, elements=8)))
    given = sliding(system, TimeStepping(4000.0, 10.0, 0.0), way * 1e-6)
    found = systems.simulate(system, given, systems.static_start(system, given))
    assembly, x, d = Assembly(system), side_positions(system, given)[-2], 1e-6
    rows = assembly.contact_rows(x)
    low, high = (
        np.array(ends) for ends in zip(*map(system.range_of, (one.place for one in system.sides)), strict=True)
    )
    after, before = np.minimum(x + d, high), np.maximum(x - d, low)
    slope = np.zeros_like(rows.C)
    for k in range(len(x)):  # of each side by itself
        one, other = x.copy(), x.copy()
        one[k], other[k] = after[k], before[k]
        slope += (assembly.contact_rows(one).C - assembly.contact_rows(other).C) / (after[k] - before[k])
    pressed = rows.C - way * MU * ARM * slope
    held = np.block([[assembly.K.toarray(), pressed.T], [rows.C, -rows.F]])
    right = np.concatenate([assembly.B @ found.loads[-2], np.zeros(len(rows.F))])
    expected = np.linalg.solve(held, right)[-len(rows.F) :]
    without = np.linalg.solve(np.block([[assembly.K.toarray(), rows.C.T], [rows.C, -rows.F]]), right)[-len(rows.F) :]
    np.testing.assert_allclose(found.forces[-2], expected, rtol=1e-5)
    assert np.abs(expected - without).max() > 5e-3 * np.abs(expected).max()


def test_reduced_pads_rub_as_full_ones_do() -> None:
    """With what residual flexibility makes of the moments: without it forces are some per mille off."""
    boom, stepping = Nested(2, elements=10), TimeStepping(0.2, 1e-3, 0.8)
    found = []
    for system in (full(boom), reduced(boom, 4)):
        one = rubbing(system)
        loads = {name: Sine(amplitude=2e3, frequency=2.0, offset=5e3, phase=-np.pi / 2.0) for name in one.input_names}
        given = replace(sliding(one, stepping, 1.0), loads=loads)
        found.append(systems.simulate(one, given, systems.static_start(one, given)))
    true, other = found
    size = np.abs(true.forces).max()
    assert np.sqrt(np.mean((true.forces - other.forces) ** 2)) < 1e-3 * size
    assert true.surplus < 1e-3 and true.moments is not None and np.any(true.moments)


def test_without_an_arm_pads_press_as_without_friction() -> None:
    """A rigid cylinder bears all of it."""
    system, stepping = full(Nested(2, elements=6)), TimeStepping(0.02, 1e-3, 0.9)
    given = sliding(system, stepping, 0.5)
    flat = replace(system, contacts=tuple(replace(one, friction=MU) for one in system.contacts))
    smooth, other = systems.simulate(system, given), systems.simulate(flat, given)
    np.testing.assert_allclose(other.forces, smooth.forces, atol=1e-9 * np.abs(smooth.forces).max())
    assert other.friction is not None and np.any(other.friction)


def test_a_stepper_rubs_as_a_simulation_does() -> None:
    """Out and back; with what residual flexibility makes of the moments in its outputs."""
    system, stepping = reduced(Nested(2, elements=6), 2), TimeStepping(0.1, 1e-3, 0.8)
    rough = [replace(one, friction=MU, arm=ARM, shear_stiffness=1e8) for one in system.contacts]
    system = replace(system, contacts=tuple(rough))
    given = sliding(system, stepping, 0.0)
    given = replace(given, paths={"1": Sine(amplitude=0.05, frequency=8.0, offset=2.0)})
    start, load = systems.static_start(system, given), {name: 5e3 for name in system.input_names}
    found = systems.simulate(system, given, start)
    assert found.friction is not None and found.friction.min() < 0.0 < found.friction.max()
    stepper = Stepper(system, stepping.step, {"1": 2.0}, load, stepping.rho_inf, initial=start)
    moved = np.hstack([found.forces[1:], *(one[1:] for one in systems.displacements(system, found).values())])
    taken, totals = [], []
    for s in given.s[1:, 0]:
        y = stepper.step({"1": s})
        taken.append(np.concatenate([stepper.multipliers, y]))
        totals.append(stepper.friction["1"])
        np.testing.assert_allclose(stepper.outputs[: len(y)], y, rtol=1e-9, atol=1e-12 * np.abs(y).max())
    size = np.abs(moved).max(axis=0)
    size[size == 0.0] = 1.0
    np.testing.assert_allclose(np.array(taken) / size, moved / size, atol=1e-9)
    states, last = states_of(system, found, np.array([100])), found.friction[[100]]
    np.testing.assert_allclose(
        states["1"].friction_forces, last
    )  # the inner section towards its tail, the outer one outwards
    np.testing.assert_allclose(states["0"].friction_forces, -last)
    assert states["1"].friction_moments is not None and np.any(states["1"].friction_moments)
    np.testing.assert_allclose(totals, found.friction[1:].sum(axis=1), rtol=1e-9, atol=1e-9)


def test_who_follows_no_friction_refuses_it() -> None:
    system = rubbing(reduced(Nested(2, elements=6), 2))
    with pytest.raises(InputError, match=r"friction = 'tail 1, mouth 0': 0 is allowed here"):
        system.ensure_constant("system.npz")
