"""Modes without inertia in the compiled loop: backward Euler of their equations, whatever else a step does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from nested import Nested, reduced
from numpy.typing import NDArray
from terms import axial, excitation

from pmr.scene.signals import Sine
from pmr.simulation.excitation import side_positions
from pmr.simulation.native import systems
from pmr.simulation.stepping import TimeStepping
from pmr.system.assembly import Assembly
from pmr.system.system import System

Array = NDArray[np.float64]


def still(system: System, coupled: bool = False) -> System:
    """The last coordinate of each body without inertia, under axial forces; others damped together if asked for."""
    found = {}
    for name, body in system.bodies.items():
        n, D = body.size, body.D
        if coupled:
            D = D.copy()
            D[: n - 1, : n - 1] += 20.0
        found[name] = replace(body, D=D, quasi_static=np.array([n - 1]))
    system = replace(system, bodies=found)
    return replace(system, terms=axial(system)[: 2 * len(found) - 1])


@pytest.mark.parametrize(("rho_inf", "tension"), [(0.8, 0.0), (1.0, 0.0), (0.8, 500.0)])
@pytest.mark.parametrize(
    "made",
    [
        pytest.param(lambda: still(reduced(Nested(2, elements=10), 3)), id="sides"),
        pytest.param(lambda: still(reduced(Nested(1, elements=10), 3)), id="tables"),
        pytest.param(lambda: still(reduced(Nested(2, elements=10), 3), coupled=True), id="coupled"),
        pytest.param(lambda: still(reduced(Nested(2, elements=10, clearance=1e-4), 3)), id="pushing"),
        pytest.param(lambda: still(reduced(Nested(2, elements=10, clearance=1e-4), 3), True), id="coupled-pushing"),
    ],
)
def test_they_are_in_balance_at_the_end_of_each_step(
    made: Callable[[], System], rho_inf: float, tension: float
) -> None:
    """D (z - z') / h + (K + sum c G) z + C^T lambda = B f, with rates that are differences."""
    system, h = made(), 1e-3
    names = enumerate(system.term_names)
    c = {name: Sine(amplitude=0.5, frequency=2.0 + k, offset=tension) for k, name in names}
    driven = excitation(system, TimeStepping(0.2, h, rho_inf, parts=1), c)
    found, assembly = systems.simulate(system, driven), Assembly(system)
    q, v = (np.hstack([getattr(one, part) for one in found.bodies.values()]) for part in "qv")
    numbers, rows = assembly.quasi_static, assembly.contact_rows_over_time(side_positions(system, driven))
    assert len(numbers) == len(system.bodies)
    np.testing.assert_allclose(v[1:, numbers], np.diff(q[:, numbers], axis=0) / h, atol=1e-9 * np.abs(v).max())
    pressed = found.loads @ assembly.B.toarray().T - np.einsum("tmn,tm->tn", rows.C, found.forces)
    assert found.amplitudes is not None
    pressed += assembly.term_forces(q, v, found.amplitudes)
    held = q @ assembly.K.toarray() + v @ assembly.D.toarray()
    size = np.abs(held[:, numbers]).max()
    np.testing.assert_allclose(held[1:, numbers], pressed[1:, numbers], atol=1e-7 * size)


def test_without_damping_energy_is_the_work_done_to_second_order() -> None:
    left = []
    for h in (2e-3, 1e-3):
        system = still(reduced(Nested(2, elements=10), 3))
        bodies = {name: replace(body, D=0.0 * body.D) for name, body in system.bodies.items()}
        system = replace(system, bodies=bodies)
        c = {name: Sine(amplitude=0.5, frequency=2.0 + k) for k, name in enumerate(system.term_names)}
        driven = replace(excitation(system, TimeStepping(0.6, h, 1.0), c), start="static")
        found = systems.simulate(system, driven, systems.static_start(system, driven))
        left.append(np.abs(found.energy - found.work - found.energy[0]).max() / np.ptp(found.energy))
    assert left[1] < 1e-3 and left[0] / left[1] > 3.0
