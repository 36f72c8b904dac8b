"""Steps of systems in as few parts as the error in the forces of pads that push allows."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from nested import Nested, reduced

from pmr.scene.signals import Constant, SmoothRamp
from pmr.simulation import contact_step
from pmr.simulation.contact_step import contact_frequency
from pmr.simulation.excitation import Excitation
from pmr.simulation.native import systems
from pmr.simulation.stepping import TimeStepping
from pmr.system.states import SystemTrajectory
from pmr.system.system import System

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
