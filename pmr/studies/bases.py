"""Models of a sliding body on several bases, of every size, beside the motion of its full model, simulated alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import MODAL, extend, truncate
from pmr.scene import Reduction, Scene
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.modal import ModalForm, modal_form
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.studies import shared
from pmr.system.body import length_outputs, projected
from pmr.system.contacts import ALONE
from pmr.system.states import SystemTrajectory
from pmr.system.system import System

Array = NDArray[np.float64]

#: Every so many steps of the full motion are snapshots of it.
EVERY = 5


@dataclass(frozen=True)
class Case:
    """A scene, its full model in modal coordinates, and the motion of that."""

    scene: Scene
    excitation: Excitation
    full: ReducedModel
    run: SystemTrajectory
    displacement: Array

    @classmethod
    def of(cls, scene: Scene) -> Case:
        form, excitation = modal_form(shared.body_of(scene)), Excitation.of(scene)
        run = _simulate(form, excitation)
        return cls(scene, excitation, form.body, run, _outputs(form.body, run))


@dataclass(frozen=True)
class Motion:
    """Displacements (T, o) in m, energy (T,) in J, and wall seconds of the steps alone."""

    displacement: Array
    energy: Array
    seconds: float


@dataclass(frozen=True)
class Models:
    """Models by their number of coordinates, from the smallest to the largest."""

    of: Callable[[int], ReducedModel]
    largest: int
    smallest: int = 1


def simulator(model: ReducedModel) -> Callable[[Excitation, int], Motion]:
    """Simulate a model from rest or equilibrium under an excitation, and record each so many steps."""
    form = modal_form(model)

    def simulate(excitation: Excitation, every: int) -> Motion:
        run = _simulate(form, excitation, every)
        y = _outputs(form.body, run)[:, length_outputs(form.body)]
        return Motion(y, run.energy, run.seconds)

    return simulate


def _simulate(form: ModalForm, excitation: Excitation, every: int = 1) -> SystemTrajectory:
    """From rest or equilibrium, in modal coordinates."""
    alone = SystemForm.alone(form)
    return systems.simulate_form(alone, excitation, every=every)


def _outputs(body: ReducedModel, run: SystemTrajectory) -> Array:
    return systems.displacements(System.of(body), run)[ALONE]


def reduction(scene: Scene, basis: str, largest: int) -> Reduction:
    """Reduction of a scene for models of a basis with up to `largest` coordinates."""
    solver = scene.reduction.solver
    if basis == "visited":
        return Reduction(basis="eigenmodes", snapshots=9, modes=4, coordinates=min(largest, 36), solver=solver)
    if basis == "pod":
        return Reduction(basis="eigenmodes", positions="nodes", coordinates=min(largest, 30), solver=solver)
    return Reduction(basis="free_modes", flexibility=True, coordinates=largest, solver=solver)


def _built(case: Case) -> ReducedModel:
    from pmr.fullmodel.build import full_model
    from pmr.reduction.bodies import reduce_body

    return reduce_body(case.scene, full_model(case.scene)).model


def pod(case: Case) -> Models:
    """POD of eigenmodes with the sliders held."""
    longest = _built(case)
    return Models(longest.leading, longest.size)


def modes(case: Case) -> Models:
    """Free modes, and nothing of those left out."""
    longest = replace(_built(case), flexibility=None, enrichment=None)
    return Models(longest.leading, longest.size)


def flexible(case: Case) -> Models:
    """Free modes with the flexibility of those left out."""
    longest = _built(case)
    every = extend(longest) if longest.enrichment else longest
    more = every.size - longest.size

    def of(r: int) -> ReducedModel:
        """Model of r coordinates, with as many enrichment modes as the longest model has."""
        model = every if r + more == every.size else replace(truncate(every, r + more), enrichment=None)
        return truncate(model, r) if more else model

    omega2 = np.diagonal(longest.K)
    rigid = int(np.sum(omega2 <= MODAL * np.finfo(float).eps * omega2[-1]))  # which have no flexibility
    return Models(of, longest.size, max(rigid, 1))


def trajectory(case: Case) -> Models:
    """POD of the full model's own motion."""
    return _span_models(case.full, case.run.bodies[ALONE].q[::EVERY].T)


def _span_models(body: ReducedModel, pool: Array) -> Models:
    """Models on the POD of a pool of modal coordinates (n, k)."""
    U, sigma, _ = np.linalg.svd(pool, full_matrices=False)
    rank = int(np.sum(sigma > sigma[0] * 1e-13))
    return Models(lambda r: projected(body, U[:, :r]), rank)


MODELS: dict[str, Callable[[Case], Models]] = {
    "pod": pod,
    "visited": pod,
    "modes": modes,
    "flexibility": flexible,
    "trajectory": trajectory,
}


def scale_step(excitation: Excitation, factor: float) -> Excitation:
    """Excitation with a step that is `factor` times as long."""
    grid = excitation.stepping
    return excitation.with_stepping(TimeStepping(grid.end, grid.step * factor, grid.rho_inf))


def observe(form: ModalForm, excitation: Excitation, every: int) -> Array:
    """Displacements (T, o) in m at each `every`-th step."""
    chosen = np.flatnonzero(length_outputs(form.body)).tolist()
    return systems.observe(SystemForm.alone(form), excitation, chosen, every).y
