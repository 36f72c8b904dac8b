"""Starts: at rest, as given, in equilibrium, beside the package's statics and the equations of motion."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernels import kernel_of, motions_of
from nested import Nested, reduced

from pmr.errors import SimulationError
from pmr.kernel.kernel import Settings, State
from pmr.simulation.statics.equilibrium import equilibrium
from pmr.system.assembly import Assembly
from pmr.system.system import System


@pytest.mark.parametrize("how", [{}, {"clearance": 2e-4, "compliance": 1e-7}, {"clearance": 0.0}])
@pytest.mark.parametrize("up", [1.0, -1.0])
def test_equilibrium_is_that_of_statics_and_nothing_moves_from_it(how: dict[str, Any], up: float) -> None:
    system = reduced(Nested(3, elements=8, **how), 3)
    kernel, forms = kernel_of(system)
    s = {path: 2.5 for path in kernel.names("drivers")[: kernel.paths]}
    f = np.array([3e3 * up if name.endswith(".F") else 9.81 for name in system.input_names])
    state = State(kernel, Settings(1e-3))
    state.start("equilibrium", [*s.values(), *f])
    found = equilibrium(Assembly(system), system.coordinates(s), f, np.zeros(0))
    q = motions_of(system, forms, kernel) @ state.z
    np.testing.assert_allclose(q, found.q, atol=1e-9 * np.abs(found.q).max())
    _, forces = state.outputs()
    np.testing.assert_allclose(forces, found.forces, atol=1e-8 * np.abs(found.forces).max())
    before = state.z.copy()
    for _ in range(50):
        state.step([*s.values(), *f])
    np.testing.assert_allclose(state.z, before, atol=1e-8 * np.abs(before).max())


def test_multipliers_of_a_given_start_follow_from_the_position() -> None:
    system = reduced(Nested(2, elements=8), 3)
    kernel, forms = kernel_of(system)
    rng, state = np.random.default_rng(4), State(kernel, Settings(1e-3))
    z, v, f = np.zeros(kernel.modes), np.zeros(kernel.modes), rng.normal(size=kernel.inputs)
    assert kernel.used_modes is not None
    z[kernel.used_modes] = 1e-3 * rng.normal(size=len(kernel.used_modes))
    v[kernel.used_modes] = rng.normal(size=len(kernel.used_modes))
    state.start("given", [2.5, *f], z, v)
    rows = Assembly(system).at(system.coordinates({"1": 2.5}))
    expected = np.linalg.solve(rows.F, rows.C @ motions_of(system, forms, kernel) @ z + rows.H @ f)
    np.testing.assert_allclose(state.multipliers, expected, rtol=1e-9)
    np.testing.assert_array_equal(state.v, v)


def held_by_a_rigid_row() -> System:
    from dataclasses import replace

    system = reduced(Nested(2, elements=8), 3)
    return replace(system, contacts=(system.contacts[0],))


def test_what_nothing_holds_is_refused() -> None:
    system = held_by_a_rigid_row()
    kernel, _ = kernel_of(system)
    with pytest.raises(SimulationError, match="holds"):
        State(kernel, Settings(1e-3)).start("equilibrium", [2.5, *np.full(kernel.inputs, 9.81)])
