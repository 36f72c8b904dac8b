"""Terms that vary in time in full order, beside bodies that are diagonalised, on one rank and two."""

from dataclasses import replace

import numpy as np
import pytest
from distributed import distributed
from nested import Nested, full
from terms import axial, excitation

from pmr import SimulationError, System
from pmr.fem.compat import MPI
from pmr.fullmodel.model import FullSystem
from pmr.scene.signals import Constant, Sine
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.native import systems
from pmr.simulation.petsc import Checkpoint, observe, static_start
from pmr.simulation.petsc.start import LIMIT, PadFriction, Terms
from pmr.system.terms import Term


def varying(boom: Nested) -> tuple[System, FullSystem]:
    """With axial forces on each body and between two, one as PETSc has it, and what turns with a frame."""
    system, comm = full(boom), MPI.COMM_WORLD
    spread = {name: distributed(body, comm) for name, body in system.bodies.items()}
    terms = list(axial(system))
    for name, body in system.bodies.items():
        V = np.triu(np.ones((body.size, body.size)), 1)
        terms.append(Term(f"turning {name}", (name,), damping=V - V.T))
    own = [replace(terms[0], stiffness=_scaled(spread[terms[0].bodies[0]].K, 0.3)), *terms[1:]]
    return replace(system, terms=tuple(terms)), FullSystem(spread, system.contacts, terms=tuple(own))


def _scaled(A: object, factor: float) -> object:
    found = A.copy()  # type: ignore[attr-defined]
    found.scale(factor)
    return found


def driven(system: System, start: str = "rest", amplitude: float = 0.9) -> Excitation:
    terms = {
        name: Sine(amplitude=amplitude, frequency=4.0 + 0.3 * k, phase=0.5 * k)
        for k, name in enumerate(system.term_names)
    }
    return excitation(system, TimeStepping(0.05, 1e-3, 0.9), terms)


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.mpi
def test_full_order_follows_terms_as_march_does() -> None:
    """From equilibrium; coordinates, forces and the energy balance."""
    system, spread = varying(Nested(2, elements=6))
    given = driven(system)
    history = observe(spread, given, (0.05,), static_start(spread, given))
    expected = systems.simulate(system, given, systems.static_start(system, given))
    np.testing.assert_allclose(history.contacts.forces, expected.forces, atol=1e-8 * np.abs(expected.forces).max())
    stored = history.energy.kinetic + history.energy.strain
    np.testing.assert_allclose(stored, expected.energy, atol=1e-8 * expected.energy.max())
    assert history.errors.surplus == pytest.approx(expected.surplus, abs=1e-8)


@pytest.mark.slow
@pytest.mark.numerical
def test_a_simulation_that_was_cut_off_goes_on_with_its_terms(tmp_path: object) -> None:
    """To the last digit."""
    system, spread = varying(Nested(2, elements=4))
    given = driven(system).with_stepping(TimeStepping(0.03, 1e-3, 0.9))
    file = Checkpoint(tmp_path / "checkpoint.npz", seconds=0.0)  # type: ignore[operator]
    whole = observe(spread, given)

    def stop(done: float) -> None:
        if done >= 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        observe(spread, given, progress=stop, checkpoint=file)
    again = observe(spread, given, checkpoint=file)
    np.testing.assert_array_equal(again.contacts.forces, whole.contacts.forces)


@pytest.mark.mpi
def test_tensions_far_above_the_stiffness_of_a_step_are_followed_as_march_does() -> None:
    """Without extrapolation of their forces no step converges."""
    system, spread = varying(Nested(2, elements=4))
    given = driven(system).with_stepping(TimeStepping(0.02, 2e-3, 0.9))
    given = replace(given, terms={name: Constant(amount=100.0) for name in system.term_names})
    history = observe(spread, given)
    expected = systems.simulate(system, given)
    np.testing.assert_allclose(history.contacts.forces, expected.forces, atol=1e-7 * np.abs(expected.forces).max())


def test_terms_beyond_buckling_do_not_converge_in_silence() -> None:
    system, spread = varying(Nested(2, elements=4))
    terms = {name: Constant(amount=-1e4) for name in system.term_names}
    given = replace(driven(system), terms=terms)
    with pytest.raises(SimulationError, match="forces of .* do not converge|not finite|grows"):
        observe(spread, given)


def test_gaps_that_go_on_changing_end_a_step_as_forces_do() -> None:
    """Else a step whose forces have settled would never end."""
    terms, w = Terms(varying(Nested(2, elements=4))[1]), np.ones(5)
    old, new = (PadFriction(0.0, np.zeros(0), np.full(2, gap)) for gap in (0.0, 1e-3))
    assert terms.have_converged(w, new, w, new, LIMIT) and not terms.have_converged(w, old, w, new, 2)
    with pytest.raises(SimulationError, match="do not converge"):
        terms.have_converged(w, old, w, new, LIMIT)
