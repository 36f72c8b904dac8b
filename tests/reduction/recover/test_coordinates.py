from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import booms
import numpy as np
import one_body
import petsc_alone
import pytest
from boxes import box
from one_body import displacement

from pmr import ReducedModel
from pmr.fem.distributed import inner, local_csr, times
from pmr.fullmodel.build import full_model
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.structure import structural_model
from pmr.models.shell import Shell
from pmr.reduction.basis import Basis, modal_basis, reduced_model
from pmr.reduction.free_body import FreeBody
from pmr.reduction.recovery import Recovery
from pmr.reduction.residual import flexible_model, section_model
from pmr.reduction.snapshots import free_modes
from pmr.scene.structures import Plate, ShellBody
from pmr.simulation import Excitation, TimeStepping
from pmr.system.body import Trajectory
from pmr.system.polynomials import evaluate
from pmr.system.states import BodyStates

pytestmark = pytest.mark.mpi


@dataclass(frozen=True)
class Case:
    """A full model on its course, and times at which it is looked at."""

    full: FullModel
    excitation: Excitation

    @property
    def steps(self) -> np.ndarray:
        return np.linspace(0, self.excitation.stepping.steps, 150).astype(int)  # more than one block

    def simulated(self, body: ReducedModel) -> tuple[Trajectory, BodyStates]:
        whole = one_body.simulate(body, self.excitation)
        return whole, one_body.states(body, whole.at(self.steps), self.excitation.f[self.steps])


def planar(load_scene: Callable) -> Case:
    scene = load_scene("evolved_residual", ["compare.against=[]", "mesh.elements=12"])
    return Case(full_model(scene), Excitation.from_scene(scene).with_stepping(TimeStepping(end=0.5, step=1e-3)))


def boom(load_scene: Callable, **pads: Any) -> Case:
    model = Shell(ShellBody(plate=Plate(thickness=0.008)), box(length=6.0, along=8, around=1, skew=0.2))
    scene = booms.boom(model, span=0.5)
    moving = tuple(replace(pad, **pads) for pad in scene.structure.pads.moving)
    structure = replace(scene.structure, pads=replace(scene.structure.pads, moving=moving))
    return Case(structural_model(structure), scene.excitation)


@pytest.fixture(scope="module", params=[planar, boom])
def case(request, load_scene) -> Case:
    return request.param(load_scene)


def plain(full: FullModel, modes: Basis) -> ReducedModel:
    return reduced_model(full, modes, {})


def flexible(full: FullModel, modes: Basis) -> ReducedModel:
    return flexible_model(FreeBody(full), modes, {})


def enriched(full: FullModel, modes: Basis) -> ReducedModel:
    """Two of the modes are enrichment modes: they belong to what is left out."""
    return section_model(FreeBody(full), modes, {}, modes.size - 2)


def outputs(full: FullModel, q: np.ndarray) -> np.ndarray:
    return full.comm.allreduce(q @ local_csr(full.outputs))


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("reduce", [plain, flexible, enriched])
def test_outputs_of_recovered_states_are_those_of_the_simulation(case: Case, reduce: Callable) -> None:
    check_outputs(case, reduce)


@pytest.mark.slow
def test_pads_that_open_leave_the_outputs_right(load_scene) -> None:
    case = boom(load_scene, unilateral=True, clearance=1e-5)
    forces = check_outputs(case, flexible).multipliers
    assert np.any(forces == 0.0, axis=0).all() and np.any(forces > 0.0)


def check_outputs(case: Case, reduce: Callable) -> BodyStates:
    basis = modal_basis(free_modes(case.full, 8))
    body, V = reduce(case.full, basis), np.array(basis.V.getDenseArray())
    whole, states = case.simulated(body)
    recovery = Recovery(case.full, V, body)
    expected = displacement(body, whole.q, whole.s, whole.multipliers, case.excitation.f)[case.steps]
    found = outputs(case.full, recovery.positions(states))
    largest = largest_terms(body, states)  # on a support it is round-off of the others
    assert np.all(np.abs(found - expected).max(axis=0) <= 1e-10 * largest + np.finfo(float).eps * largest.max())
    assert np.array_equal(states.t, whole.t[case.steps]) and states.loads.shape == (150, len(body.input_names))
    return states


def largest_terms(body: ReducedModel, states: BodyStates) -> np.ndarray:
    """|O| |p| + |W| |f| + |X| |z|, (o,), at its largest: what an output is relative to, since its terms may cancel.

    They do where the path rests; there the output itself is round-off.  Each term of the residual part is known to u
    times the condition of the stiffness, some 1e6 for twelve elements of a beam (their number to the fourth).
    """
    terms = np.abs(states.p) @ np.abs(body.outputs.T)
    if body.flexibility is not None:
        X = np.abs(evaluate(body.flexibility.outputs, states.s[:, 0]))
        terms += np.abs(states.loads) @ np.abs(body.flexibility.direct.T)
        terms += np.einsum("tom,tm->to", X, np.abs(states.multipliers))
    return terms.max(axis=0)


@pytest.mark.slow
def test_recovered_states_are_nearly_those_of_the_full_model(case: Case) -> None:
    """All coordinates of all times, in the norm of strain energy; without what the modes leave out far less so."""
    basis = modal_basis(free_modes(case.full, 8))
    V = np.array(basis.V.getDenseArray())
    body = flexible(case.full, basis)
    states = case.simulated(body)[1]
    exact = petsc_alone.observe(case.full, case.excitation, states.t.tolist()).states.q

    def energy(q: np.ndarray) -> float:
        return float(np.trace(inner(q.T, times(case.full.K, np.ascontiguousarray(q.T)), case.full.comm)))

    def difference(q: np.ndarray) -> float:
        return np.sqrt(energy(q - exact) / energy(exact))

    found = difference(Recovery(case.full, V, body).positions(states)), difference(states.p @ V.T)
    assert found[0] < 2e-4 and found[1] > 100 * found[0]


def test_states_are_chosen_by_their_steps(case: Case) -> None:
    body = flexible(case.full, modal_basis(free_modes(case.full, 4)))
    whole, states = case.simulated(body)
    part = states[3:5]
    assert np.array_equal(part.p, whole.q[case.steps[3:5]]) and part.t.shape == part.s.shape[:1] == (2,)
    assert np.array_equal(part.multipliers, whole.multipliers[case.steps[3:5]])
