"""Terms that vary in time in Exudyn, beside the compiled loop."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from nested import Nested, full, reduced
from terms import axial, excitation

from pmr import System
from pmr.scene.signals import Sine
from pmr.simulation import Excitation, TimeStepping, exudyn
from pmr.simulation.native import systems
from pmr.system.terms import Term


def turning(system: System) -> System:
    """With axial forces, and with antisymmetric terms as of a frame that turns."""
    found = list(axial(system))
    for name, body in system.bodies.items():
        V = np.triu(np.ones((body.size, body.size)), 1)
        found.append(Term(f"turning {name}", (name,), damping=V - V.T))
    return replace(system, terms=tuple(found))


def varied(system: System, stepping: TimeStepping) -> Excitation:
    terms = {
        name: Sine(amplitude=0.9, frequency=2.0 + 0.3 * k, phase=0.5 * k) for k, name in enumerate(system.term_names)
    }
    return excitation(system, stepping, terms)


def quasi_static(system: System) -> System:
    """The last coordinate of each body without inertia, and without what acts on its rate."""
    bodies = {name: replace(body, quasi_static=np.array([body.size - 1])) for name, body in system.bodies.items()}
    terms = []
    for term in system.terms:
        V = term.damping
        if V is not None:
            V = np.pad(V[:-1, :-1], (0, 1))
        terms.append(replace(term, damping=V))
    return replace(system, bodies=bodies, terms=tuple(terms))


@pytest.mark.slow
@pytest.mark.parametrize("made", [lambda system: system, quasi_static], ids=["inertia", "quasi-static"])
@pytest.mark.parametrize("formulation", ["springs", "multipliers"])
def test_exudyn_follows_terms_as_march_does(formulation: exudyn.Formulation, made: Callable[[System], System]) -> None:
    """Coordinates, forces, and what the energy balance leaves open."""
    system = made(turning(reduced(Nested(2, elements=10), 3)))
    driven = varied(system, TimeStepping(0.3, 1e-3, 0.9))
    found = exudyn.simulate_system(system, driven, formulation=formulation)
    expected = systems.simulate(system, driven)
    for name, motion in expected.bodies.items():
        np.testing.assert_allclose(found.bodies[name].q, motion.q, atol=1e-8 * np.abs(motion.q).max())
    np.testing.assert_allclose(found.forces, expected.forces, atol=1e-7 * np.abs(expected.forces).max())
    left = [one.energy - one.work for one in (found, expected)]
    np.testing.assert_allclose(left[0], left[1], atol=1e-7 * expected.energy.max())


def test_exudyn_follows_terms_of_full_bodies() -> None:
    """Whose matrices are sparse."""
    system = full(Nested(2, elements=4))
    system = replace(system, terms=axial(system))
    driven = varied(system, TimeStepping(0.1, 1e-3, 0.9))
    found, expected = exudyn.simulate_system(system, driven), systems.simulate(system, driven)
    np.testing.assert_allclose(
        found.bodies["1"].q, expected.bodies["1"].q, atol=1e-7 * np.abs(expected.bodies["1"].q).max()
    )
