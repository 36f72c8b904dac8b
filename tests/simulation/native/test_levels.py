"""Steps of systems in as few parts as the error in the forces of pads that push allows.
Modes without inertia in the compiled loop: backward Euler of their equations, whatever else a step does.
A body alone as the system of one: names without a prefix, and the motion of the loop in tables.
"""

import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import one_body
import pytest
from nested import Nested, reduced
from on_pads import beam_on_pads, driven, modes_on_pads
from one_body import displacement
from oracle import free_modes as modes_of
from terms import axial, excitation

import pmr
from pmr import System
from pmr.fullmodel.build import full_model
from pmr.reduction.basis import modal_basis
from pmr.reduction.free_body import FreeBody
from pmr.reduction.residual import section_model
from pmr.reduction.snapshots import free_modes
from pmr.scene.signals import Constant, Sine, SmoothRamp
from pmr.simulation import Excitation, TimeStepping, contact_step
from pmr.simulation.contact_step import contact_frequency
from pmr.simulation.excitation import side_positions
from pmr.simulation.native import systems
from pmr.system.assembly import Assembly
from pmr.system.carriers import CarrierRows
from pmr.system.contacts import ALONE, SLIDER
from pmr.system.states import SystemTrajectory

#: Error of a contact's largest force over the largest of all that the tolerance keeps to, where impacts are resolved.
WITHIN = 1e-3
#: Booms of the sweep: a sample in CI, all of them with PMR_SWEEP=full.
BOOMS = 40 if os.environ.get("PMR_SWEEP") == "full" else 10


def lifted(system: System, top: float, out: float, stepping: TimeStepping) -> Excitation:
    """A tip force lifts the boom off its pads and lets it fall, while all sections move out."""
    force = SmoothRamp(times=(0.0, 0.05, 0.1), values=(0.0, top, 0.0))
    loads = {name: force if name.endswith(".F") else Constant(amount=9.81) for name in system.input_names}
    paths = {name: SmoothRamp(times=(0.0, 0.4), values=(2.0, 2.0 + out)) for name in system.paths}
    return Excitation(paths, loads, stepping)


def simulated(system: System, given: Excitation, **stepping: object) -> SystemTrajectory:
    given = replace(given, stepping=replace(given.stepping, **stepping))
    return systems.simulate(system, given, systems.static_start(system, given))


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("rho_inf", [1.0, 0.8])
def test_what_the_tolerance_chose_can_be_made_again_and_misses_little(rho_inf: float) -> None:
    """Steps that are begun anew are those in other parts than the one before, so the schedule says all."""
    system = reduced(Nested(2, elements=10, clearance=2e-4, compliance=1e-7), 3)
    given = lifted(system, 2e4, 0.2, TimeStepping(0.2, 1e-3, rho_inf))
    found, finest = simulated(system, given), simulated(system, given, parts=64)
    assert found.parts is not None and set(found.parts) <= {2**k for k in range(7)}
    assert found.parts.min() <= 4 < found.parts.max() and found.parts.sum() < 0.6 * 32 * len(found.parts)
    assert off(found, finest) < WITHIN < off(simulated(system, given, parts=1), finest)
    again = simulated(system, given, schedule=tuple(found.parts[1:].tolist()))
    assert np.array_equal(again.parts, found.parts)
    assert np.abs(again.peaks - found.peaks).max() < 1e-9 * found.peaks.max()


def test_a_body_that_stays_on_its_pads_takes_a_step_in_one() -> None:
    system = reduced(Nested(2, elements=10, clearance=0.0), 2)
    found = simulated(system, lifted(system, 0.0, 0.0, TimeStepping(0.05, 1e-3, 0.9)))
    assert found.parts is not None and np.all(found.parts == 1)


@pytest.mark.slow
def test_random_impacts_are_those_of_400_parts_and_no_energy_comes_from_them() -> None:
    """Of pads over three decades of stiffness and two of play, where a step that resolves its contact says the same."""
    judged, fewer = 0, []
    for seed in range(BOOMS):
        rng = np.random.default_rng(seed)
        clearance = float(rng.choice([0.0, 10.0 ** rng.uniform(-4.0, -2.7)]))
        boom = Nested(int(rng.integers(2, 4)), 10, 10.0 ** rng.uniform(-8.5, -6.0), clearance)
        system = reduced(boom, int(rng.integers(2, 5)))
        stepping = TimeStepping(0.2, float(rng.choice([5e-4, 1e-3, 2e-3])), float(rng.choice([0.8, 0.9, 1.0])))
        out = float(rng.choice([0.0, 0.3]))
        given = lifted(system, rng.uniform(2e3, 3e4), out, stepping)
        found, reference = simulated(system, given), simulated(system, given, parts=400)
        assert found.parts is not None
        created = found.energy - found.work - found.energy[0]
        # With rho_inf < 1 what never grows is the energy and a share of the squared accelerations' change.
        assert created.max() < (1e-12 if stepping.rho_inf == 1.0 else 1e-9) * found.energy.max()
        finest = max(contact_step.part_counts(contact_frequency(system, given), stepping))
        if off(simulated(system, given, parts=finest), reference) < 0.3 * WITHIN:
            judged += 1
            fewer.append(found.parts.mean() / finest)
            assert off(found, reference) < WITHIN
    assert judged > 0.5 * BOOMS and np.mean(fewer) < 0.5


def off(found: SystemTrajectory, reference: SystemTrajectory) -> float:
    """Largest error of a contact's largest force, over the largest of all."""
    return float(np.abs(found.peaks.max(axis=0) - reference.peaks.max(axis=0)).max() / reference.peaks.max())


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


def on_two_paths(system: System) -> System:
    """The last contact on a path of its own: nothing but places say then what tables do otherwise."""
    *others, last = system.contacts
    return replace(system, contacts=(*others, replace(last, inner=replace(last.inner, path="other"))))


def twice(excitation: Excitation) -> Excitation:
    """The same path for both."""
    return replace(excitation, paths={SLIDER: excitation.path, "other": excitation.path})


@pytest.mark.parametrize("parts", [0, 1])
def test_pads_that_push_on_a_body_alone_are_followed_alike_in_tables_and_by_places(parts: int) -> None:
    """The same steps in the same parts, each with its own balance of energy."""
    rich = beam_on_pads(1e-3, 3e8)
    carried = CarrierRows.from_rows(rich.rows.shared_carriers.rows, rich.rows.shared_carriers.carriers.toarray())
    model = modes_on_pads(rich, 6)
    modes = modes_of(rich, 6)[0]
    model = replace(model, carriers=carried.project(modes).with_rows([1, 2, 3, 4]))
    loads = (Constant(amount=9.81), Sine(amplitude=4000.0, frequency=5.0))
    path = SmoothRamp(times=(0.0, 0.2), values=(3.0, 3.2))
    excitation, system = driven(path, loads, TimeStepping(0.2, 1e-3, 0.9, parts)), System.of(model)
    tables, sides = systems.simulate(system, excitation), systems.simulate(on_two_paths(system), twice(excitation))
    assert np.array_equal(tables.parts, sides.parts) and (parts == 1 or set(tables.parts) > {1, 2})
    largest = tables.peaks.max()
    assert largest > 0.0 and np.abs(sides.peaks - tables.peaks).max() <= 1e-8 * largest
    assert np.abs(sides.impulses - tables.impulses).max() <= 1e-8 * tables.impulses.max()
    assert np.abs(sides.energy - tables.energy).max() <= 1e-8 * tables.energy.max()


def test_a_body_alone_makes_a_step_in_as_many_parts_as_its_pads_ask_for() -> None:
    """Fewer than resolve the contact throughout, with the same largest force; the schedule makes them again."""
    model = modes_on_pads(beam_on_pads(5e-3, 3e8, 20), 4)
    given = partial(driven, Constant(amount=3.0), (Constant(amount=9.81), Constant(amount=0.0)))
    found = one_body.simulate(model, given(TimeStepping(0.2, 1e-3, 0.9)))
    finest = one_body.simulate(model, given(TimeStepping(0.2, 1e-3, 0.9, parts=128)))
    assert found.parts is not None and found.peaks is not None and finest.peaks is not None
    most = (
        contact_step.contact_frequency(System.of(model), given(TimeStepping(0.2, 1e-3))) * 1e-3 / contact_step.RESOLVED
    )
    assert found.parts.mean() < 0.5 * most <= found.parts.max()
    assert np.abs(found.peaks.max(axis=0) - finest.peaks.max(axis=0)).max() < 1e-3 * finest.peaks.max()
    schedule = tuple(found.parts[1:].tolist())
    again = one_body.simulate(model, given(TimeStepping(0.2, 1e-3, 0.9, schedule=schedule)))
    assert np.abs(again.peaks - found.peaks).max() < 1e-9 * found.peaks.max()


def test_a_body_alone_moves_as_in_tables() -> None:
    scene = pmr.load_scene("evolved_residual", ["mesh.elements=20", "time.end=0.05"])
    body = FreeBody(full_model(scene), "auto")
    model = section_model(body, modal_basis(free_modes(body.model, 8, "auto", 0, body)), {}, 8)
    excitation, system = Excitation.from_scene(scene), System.of(model)
    assert (system.paths, system.input_names, system.contact_names) == ((SLIDER,), model.input_names, model.row_names)
    found, by_tables = systems.simulate(system, excitation), one_body.simulate(model, excitation)
    assert np.array_equal(found.bodies[ALONE].q, by_tables.q)
    y = systems.displacements(system, found)[ALONE]
    expected = displacement(
        model, by_tables.q, by_tables.s, by_tables.multipliers, excitation.forces(model.input_names)
    )
    assert np.abs(y - expected).max() <= 1e-13 * np.abs(expected).max()
    (contact,) = system.contacts
    turned = replace(system, contacts=(replace(contact, direction=-1.0),))
    assert system.on_one_path and not turned.on_one_path
    by_sides = systems.simulate(turned, excitation).bodies[ALONE]
    assert np.abs(by_sides.q - by_tables.q).max() <= 1e-10 * np.abs(by_tables.q).max()
    assert np.abs(by_sides.multipliers - by_tables.multipliers).max() <= 1e-10 * np.abs(by_tables.multipliers).max()
