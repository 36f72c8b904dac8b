"""Starts: at rest, as given, in equilibrium, beside the package's statics and the equations of motion."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from kernels import kernel_of, motions_of
from nested import Nested, full, reduced, with_round_off
from rods import bar_between_pads, bent_chain, chain_on_a_stop, stable_equilibria

from pmr import SimulationError, System
from pmr.kernel._native import ffi, lib
from pmr.kernel.state import Settings, State
from pmr.simulation import InitialState
from pmr.simulation.native.form import SystemForm
from pmr.simulation.start import consistent_start
from pmr.simulation.statics.equilibrium import equilibrium
from pmr.system.assembly import Assembly
from pmr.system.terms import Term


@pytest.mark.parametrize("how", [{}, {"clearance": 2e-4, "compliance": 1e-7}, {"clearance": 0.0}])
@pytest.mark.parametrize("up", [1.0, -1.0])
def test_equilibrium_is_that_of_statics_and_nothing_moves_from_it(how: dict[str, Any], up: float) -> None:
    system = reduced(Nested(3, elements=8, **how), 3)
    kernel, forms = kernel_of(system)
    s = {path: 2.5 for path in kernel.names("drivers")[: kernel.paths]}
    f = np.array([3e3 * up if name.endswith(".F") else 9.81 for name in system.input_names])
    state = State(kernel, Settings(1e-3))
    state.start("equilibrium", [*s.values(), *f])
    found = equilibrium(Assembly(system), system.side_coordinates(s), f, np.zeros(0))
    q = motions_of(system, forms, kernel) @ state.z
    np.testing.assert_allclose(q, found.q, atol=1e-9 * np.abs(found.q).max())
    _, forces = state.outputs()
    np.testing.assert_allclose(forces, found.forces, atol=1e-8 * np.abs(found.forces).max())
    before = state.z.copy()
    for _ in range(50):
        state.step([*s.values(), *f])
    np.testing.assert_allclose(state.z, before, atol=1e-8 * np.abs(before).max())


@pytest.mark.parametrize("count", [1, 2])
def test_multipliers_of_a_given_start_follow_from_the_position(count: int) -> None:
    system = reduced(Nested(2, elements=8), 3)
    system = replace(system, contacts=system.contacts[:count])
    kernel, forms = kernel_of(system)
    rng, state = np.random.default_rng(4), State(kernel, Settings(1e-3))
    z, v, f = np.zeros(kernel.modes), np.zeros(kernel.modes), rng.normal(size=kernel.inputs)
    used = SystemForm(system, forms).mode_columns
    z[used] = 1e-3 * rng.normal(size=len(used))
    v[used] = rng.normal(size=len(used))
    state.start("given", [2.5, *f], z, v)
    rows = Assembly(system).contact_rows(system.side_coordinates({"1": 2.5}))
    expected = np.linalg.solve(rows.F, rows.C @ motions_of(system, forms, kernel) @ z + rows.H @ f)
    np.testing.assert_allclose(state.multipliers, expected, rtol=1e-9)
    np.testing.assert_array_equal(state.v, v)


def test_forces_of_a_given_rest_are_sharp_where_contacts_hardly_give_way() -> None:
    """By 1e-16 m/N: what round-off leaves of the motion would be some 10 N."""
    system = full(Nested(2, elements=8, compliance=1e-16))
    kernel, forms = kernel_of(system)
    f = np.array([5e3 if name.endswith(".F") else 9.81 for name in system.input_names])
    x = system.side_coordinates({"1": 2.5})
    at_rest = equilibrium(Assembly(system), x, f, np.zeros(0))
    z, state = in_modes(system, forms, kernel, at_rest.q), State(kernel, Settings(1e-3))
    state.start("given", [2.5, *f], z, np.zeros(kernel.modes))
    np.testing.assert_allclose(state.outputs()[1], at_rest.forces, atol=1e-9 * np.abs(at_rest.forces).max())


@pytest.mark.parametrize("kind", ["given", "equilibrium"])
def test_rates_that_violate_rigid_contacts_are_corrected_as_by_an_impulse(kind: Any) -> None:
    """By the change of least kinetic energy, beside the package's start in the bodies' own coordinates."""
    system = full(Nested(2, elements=6, compliance=0.0))
    assembly, (kernel, forms) = Assembly(system), kernel_of(system)
    f = np.array([5e3 if name.endswith(".F") else 9.81 for name in system.input_names])
    x, d = system.side_coordinates({"1": 2.3}), 1e-5
    x_rate = 0.7 * (system.side_coordinates({"1": 2.3 + d}) - system.side_coordinates({"1": 2.3 - d})) / (2.0 * d)
    q = equilibrium(assembly, x, f, np.zeros(0)).q
    v = np.random.default_rng(5).normal(size=len(q)) if kind == "given" else np.zeros(len(q))
    initial = dict[str, InitialState]()
    for name, body in system.bodies.items():
        initial[name] = InitialState(np.zeros(body.size), np.zeros(body.size))
        for all_of_body, of_system in ((initial[name].q, q), (initial[name].v, v)):
            all_of_body[assembly.free_coordinates[name]] = of_system[assembly.coordinate_slices[name]]
    expected = np.zeros(len(q))
    for name, start in consistent_start(assembly, x, x_rate, initial).items():
        expected[assembly.coordinate_slices[name]] = start.v[assembly.free_coordinates[name]]
    state = State(kernel, Settings(1e-3))
    state.start(kind, [2.3, *f], *(in_modes(system, forms, kernel, one) for one in (q, v)), rates=[0.7])
    found = motions_of(system, forms, kernel) @ state.v
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    assert np.abs(expected - v).max() > 1e-3 * np.abs(expected).max()


def in_modes(system: System, forms: Any, kernel: Any, q: np.ndarray) -> np.ndarray:
    """Modal coordinates (modes,) of the assembled bodies' q (n,)."""
    motions = motions_of(system, forms, kernel)
    return np.asarray(motions.T @ (Assembly(system).M @ q))


def held_by_a_rigid_row() -> System:
    system = reduced(Nested(2, elements=8), 3)
    return replace(system, contacts=(system.contacts[0],))


@pytest.mark.parametrize("step", [1e-2, 1e-6])
@pytest.mark.parametrize("noise", [1e-27, 1e-24])
def test_a_contact_that_gives_way_by_round_off_is_rigid_at_any_step(noise: float, step: float) -> None:
    """Its force follows from the accelerations, and its rate is corrected, as those of one that is rigid."""
    states = list[State]()
    for system in (with_round_off(noise), with_round_off(0.0)):
        kernel, forms = kernel_of(system)
        state = State(kernel, Settings(step))
        z, v = (np.zeros(kernel.modes) for _ in range(2))
        used = SystemForm(system, forms).mode_columns
        v[used] = 1e-3 * np.random.default_rng(2).normal(size=len(used))
        state.start("given", [2.5, *np.full(kernel.inputs, 9.81)], z, v, rates=[0.0])
        assert np.abs(state.v - v).max() > 1e-5
        states.append(state)
    noisy, clean = states
    np.testing.assert_allclose(noisy.multipliers, clean.multipliers, rtol=1e-9)
    np.testing.assert_allclose(noisy.v, clean.v, atol=1e-12 * np.abs(clean.v).max())


def test_a_start_of_what_is_not_finite_is_refused_and_leaves_the_state() -> None:
    """By the interface in C, as hosts in C call it."""
    kernel, _ = kernel_of(reduced(Nested(2, elements=8), 3))
    state = State(kernel, Settings(1e-3))
    u, z, v, rates = np.array([2.5, *np.ones(kernel.inputs)]), *np.zeros((2, kernel.modes)), np.zeros(1)
    state.start("rest", u)
    state.step(u)
    before, infinite = state.save(), np.full(kernel.modes, np.inf)
    drivers, given = (lib.PMR_AT_REST, lib.PMR_GIVEN, lib.PMR_IN_EQUILIBRIUM), (lib.PMR_GIVEN,)
    wrong = [(drivers, np.full_like(u, np.nan), rates, z, v), (drivers, u, np.array([np.nan]), z, v)]
    for kinds, *arrays in (*wrong, (given, u, rates, infinite, v), (given, u, rates, z, infinite)):
        for kind in kinds:
            pointers = [ffi.cast("double *", array.ctypes.data) for array in arrays]
            assert lib.pmr_start_moving(state.pointer, kind, *pointers) == lib.PMR_REFUSED
            assert state.save() == before
    why = ffi.new(f"char[{lib.PMR_MESSAGE}]")
    at, *others = (ffi.cast("double *", array.ctypes.data) for array in (wrong[0][1], rates, z, v))
    assert lib.pmr_check_start(state.pointer, at, *others, why) == lib.PMR_REFUSED
    assert ffi.string(why) == b"start as given: what drives the system is not finite"
    assert lib.pmr_evaluate(state.pointer, ffi.cast("double *", u.ctypes.data), 1, ffi.new("pmr_values *")) == (
        lib.PMR_REFUSED
    )


def test_what_nothing_holds_is_refused() -> None:
    system = held_by_a_rigid_row()
    kernel, _ = kernel_of(system)
    with pytest.raises(SimulationError, match="holds"):
        State(kernel, Settings(1e-3)).start("equilibrium", [2.5, *np.full(kernel.inputs, 9.81)])


@pytest.mark.parametrize("share", [0.3, 0.8])
def test_terms_that_soften_what_open_pads_hold_stand_as_statics_has_it(share: float) -> None:
    """Sections that topple while pads are open which close later: there changing sides need not end."""
    boom = reduced(Nested(3, elements=8, clearance=2e-4, compliance=1e-7), 3)
    topples = [Term(f"topples {name}", (name,), stiffness=np.asarray(body.M)) for name, body in boom.bodies.items()]
    system = replace(boom, terms=tuple(topples))
    kernel, forms = kernel_of(system)
    s, assembly = {path: 2.5 for path in kernel.names("drivers")[: kernel.paths]}, Assembly(system)
    f = np.array([3e3 if name.endswith(".F") else 9.81 for name in system.input_names])
    rows = assembly.contact_rows(system.side_coordinates(s))
    held = assembly.K.toarray() + rows.C.T @ np.linalg.solve(rows.F, rows.C)
    c = np.full(kernel.terms, -share * np.linalg.eigvals(np.linalg.solve(assembly.M.toarray(), held)).real.min())
    found = equilibrium(assembly, system.side_coordinates(s), f, c)
    state = State(kernel, Settings(1e-3))
    state.start("equilibrium", [*s.values(), *f, *c])
    q = motions_of(system, forms, kernel) @ state.z
    np.testing.assert_allclose(q, found.q, atol=1e-11 * np.abs(found.q).max())
    np.testing.assert_array_equal(state.outputs()[1] > 0.0, found.closed & ~np.isnan(system.clearance))


@pytest.mark.parametrize("load", [1.0, 0.05, 1e-3])
@pytest.mark.parametrize(("seed", "softer"), [(0, 5.0), (4, 20.0), (11, 2.0), (13, 20.0)])
def test_a_bar_between_pads_with_play_begins_where_it_stands_stably(seed: int, softer: float, load: float) -> None:
    """Beside all sets of closed pads.  Under small loads it has unstable equilibria with pads open, too."""
    system = bar_between_pads(seed)
    kernel, forms = kernel_of(system)
    state = State(kernel, Settings(1e-3))
    state.start("equilibrium", [0.0, load, -softer])
    q = motions_of(system, forms, kernel) @ state.z
    stable = stable_equilibria(system, load, -softer)
    assert np.abs(stable - q).max(axis=1).min() < 1e-9 * np.abs(q).max()


def test_a_rigid_stop_holds_what_a_term_tips_until_that_buckles_between_its_ends() -> None:
    system, free, fixed = chain_on_a_stop(20)
    kernel, forms = kernel_of(system)
    state = State(kernel, Settings(1e-3))
    for softer in (1.5 * free, 0.99 * fixed):
        state.start("equilibrium", [0.0, 0.01 * free, -softer])
        q = motions_of(system, forms, kernel) @ state.z
        np.testing.assert_allclose(q, bent_chain(system, softer), rtol=1e-6)
    with pytest.raises(SimulationError):
        state.start("equilibrium", [0.0, 0.01 * free, -1.01 * fixed])
