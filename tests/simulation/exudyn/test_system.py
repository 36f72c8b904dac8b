"""A system of bodies in Exudyn, against the compiled simulator.
Exudyn beside `march` where models, steps and loads are extreme: docs/validation.md, "At the extremes".
"""

from dataclasses import replace

import numpy as np
import one_body
import pytest
from nested import Nested, full, reduced
from one_body import displacement
from oracle import TIP_LOAD, flexible, full_body

from pmr import InputError, System
from pmr.scene.signals import Chirp, Constant, SmoothRamp
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.exudyn import simulate_system
from pmr.simulation.native import systems
from pmr.system.states import SystemTrajectory


def driven(system: System, rho_inf: float = 0.8, parts: int = 0, lift: float = 2e3) -> Excitation:
    """Every section out by 0.15 m within 0.1 s, under weight and a chirp at the tip."""
    chirp = Chirp(amplitude=lift, times=(0.0, 0.1), frequencies=(5.0, 30.0), phase=1.0)
    loads = {name: chirp if name.endswith("F") else Constant(amount=9.81) for name in system.input_names}
    paths = {
        name: SmoothRamp(times=(0.0, 0.1), values=(1.0 + 0.2 * int(name), 1.15 + 0.2 * int(name)))
        for name in system.paths
    }
    return Excitation(paths, loads, TimeStepping(0.1, 1e-3, rho_inf, parts))


def assert_same(found: SystemTrajectory, expected: SystemTrajectory, tolerance: float) -> None:
    for name, motion in expected.bodies.items():
        for part in ("q", "v", "multipliers"):
            a, b = getattr(found.bodies[name], part), getattr(motion, part)
            assert np.abs(a - b).max() <= tolerance * np.abs(b).max()
        np.testing.assert_array_equal(found.bodies[name].s, motion.s)
    for part in ("forces", "peaks", "energy"):
        a, b = getattr(found, part), getattr(expected, part)
        assert np.abs(a - b).max() <= tolerance * np.abs(b).max()
    np.testing.assert_allclose(found.loads, expected.loads, rtol=1e-12)  # the kernel evaluates signals itself
    assert found.surplus == pytest.approx(expected.surplus, abs=1e-6)


@pytest.mark.parametrize("count", [2, 3])
def test_reduced_sections_with_residual_flexibility(count: int) -> None:
    system = reduced(Nested(count, elements=12), 3)
    given = driven(system)
    start = systems.static_start(system, given)
    assert_same(simulate_system(system, given, start), systems.simulate(system, given, start), 1e-10)


def test_without_initial_states_it_starts_as_the_excitation_says() -> None:
    system = reduced(Nested(2, elements=12), 3)
    given = replace(driven(system), start="equilibrium")
    found, expected = (
        simulate_system(system, given),
        simulate_system(system, given, systems.static_start(system, given)),
    )
    assert_same(found, expected, 1e-14)


def test_rigid_contacts_and_one_that_gives_way() -> None:
    """Full sections, so that nothing but a pad's stiffness gives way; a support holds two coordinates of the first."""
    system = full(Nested(2, elements=6, compliance=0.0))
    first, *others = system.contacts
    system = System(system.bodies, (replace(first, compliance=1e-7), *others))
    given = driven(system)
    start = systems.static_start(system, given)
    assert_same(simulate_system(system, given, start), systems.simulate(system, given, start), 1e-8)


@pytest.mark.slow
def test_pads_that_only_push() -> None:
    """They lift off and land; Exudyn takes nothing back where one lets go, so the two meet as steps get smaller."""
    system, off = reduced(Nested(2, elements=12, clearance=2e-4, compliance=1e-6), 3), []
    for parts in (2, 8):
        given = driven(system, parts=parts, lift=4e4)
        start = systems.static_start(system, given)
        found, expected = simulate_system(system, given, start), systems.simulate(system, given, start)
        y, line = (systems.displacements(system, one)["1"] for one in (found, expected))
        off.append(np.abs(y - line).max() / np.abs(line).max())
        assert found.forces.min() >= 0.0 and np.all(found.peaks >= found.forces)
    changes = np.diff((expected.forces > 0.0).astype(int), axis=0)
    assert (changes > 0).any() and (changes < 0).any()
    assert off[1] < 0.5 * off[0] and off[1] < 1e-3


@pytest.mark.slow
def test_by_itself_it_makes_each_step_in_the_parts_that_march_does() -> None:
    """So that the two meet within what a part may err."""
    system = reduced(Nested(2, elements=12, clearance=2e-4, compliance=1e-6), 3)
    given = driven(system, lift=4e4)
    start = systems.static_start(system, given)
    found, expected = simulate_system(system, given, start), systems.simulate(system, given, start)
    np.testing.assert_array_equal(found.parts, expected.parts)
    assert len(set(expected.parts)) > 2
    y, line = (systems.displacements(system, one)["1"] for one in (found, expected))
    assert np.abs(y - line).max() < 1e-3 * np.abs(line).max()


def test_what_is_refused() -> None:
    rigid = full(Nested(2, elements=6, compliance=0.0, clearance=0.0))
    with pytest.raises(InputError, match="only push and are rigid"):
        simulate_system(rigid, driven(rigid))
    travelling = full(Nested(2, elements=6, compliance=0.0))
    with pytest.raises(InputError, match="rho_inf"):
        simulate_system(travelling, driven(travelling, rho_inf=1.0))


FULL = full_body(20)
MODEL = flexible(FULL, 6)
#: A slide that nothing is extreme of: largest force in N, step and end in s, place at the end in m.
PLAIN = {"force": 100.0, "step": 1e-3, "seconds": 0.5, "end": 3.0}


@pytest.mark.parametrize(
    ("model", "change"),
    [
        (MODEL, {"step": 1e-2}), (MODEL, {"step": 1e-4, "seconds": 0.2}), (MODEL, {"force": 1e-12}),
        (MODEL, {"force": 1e9}), (MODEL, {"seconds": 0.02, "end": 4.5}), (replace(MODEL, pads=np.array([1e-3])), {}),
        (replace(MODEL, pads=np.array([1e-15])), {}), (flexible(FULL, 1), {}), (flexible(FULL, 40), {}),
    ],
    ids=["long step", "short step", "no force", "huge force", "fast", "soft pad", "stiff pad", "one mode", "all modes"],
)  # fmt: skip
def test_both_simulators_agree(model, change: dict[str, float]) -> None:
    asked = PLAIN | change
    end = asked["seconds"]
    path = SmoothRamp(times=(0.1 * end, 0.9 * end), values=(1.5, asked["end"]))
    load = SmoothRamp(times=(0.0, 0.4 * end, 0.8 * end), values=(0.0, asked["force"], 0.0))
    excitation = Excitation({"slider": path}, {TIP_LOAD: load}, TimeStepping(end, asked["step"], 0.9))
    f = excitation.forces(model.input_names)
    runs = [one_body.simulate(model, excitation), one_body.in_exudyn(model, excitation, formulation="multipliers")]
    one, other = (displacement(model, run.q, run.s, run.multipliers, f) for run in runs)
    assert np.abs(one - other).max() < 1e-9 * np.abs(one).max()
