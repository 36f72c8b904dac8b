"""Full and reduced models of a scene, for several bases and sizes, and their motions with the same excitation.

For a boom of sections the size is the number of elastic modes of each section; rigid-body motions and modes of
cylinders are added.  Motions begin in static equilibrium or at rest, as the scene says.  Where contacts only push,
reduced models divide steps into the same parts as the full model did.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pmr.compare.accuracy.order import trials_of
from pmr.compare.evaluation import evaluate_motion
from pmr.compare.outputs import divide_steps, run_from_start
from pmr.files.arrays import Array
from pmr.results import Response
from pmr.scene import Reduction, Scene
from pmr.scene.keys import ALONE
from pmr.scene.mechanism import frame_terms
from pmr.simulation import Excitation
from pmr.simulation.modal import modal_form
from pmr.simulation.reactions import with_forces_on_machine
from pmr.studies import shared
from pmr.system.attachment import simulated_model
from pmr.system.body import projected
from pmr.system.from_scene import system_of
from pmr.system.reduced_model import ReducedModel
from pmr.system.states import SystemTrajectory
from pmr.system.system import System
from pmr.system.truncation import MODAL, extend, truncate

#: Number of steps of the full motion between two snapshots.
SNAPSHOT_INTERVAL = 5
#: Rigid-body motions of a section, at most.
RIGID_MODES = 6
#: Bases that sections may have: free modes, without the flexibility of those left out or with it.
SECTION_BASES = ("modes", "flexibility")


@dataclass(frozen=True)
class FullMotion:
    """A scene, its full models as one system, and the motion of that system."""

    scene: Scene
    full: System  # a single body is in its modal coordinates
    excitation: Excitation  # with steps divided as in the full motion
    run: SystemTrajectory
    response: Response

    @classmethod
    def simulate(cls, scene: Scene) -> FullMotion:
        """Build the full models of a scene and simulate their motion."""
        is_alone = len(scene.sections) == 1
        full = System.of(modal_form(shared.body_of(scene)).body) if is_alone else shared.full_system(scene)
        excitation = divide_steps(full, Excitation.from_scene(scene))
        run = run_from_start(full, excitation)
        return cls(scene, full, excitation, run, with_forces_on_machine(scene, evaluate_motion(full, run)))


def simulate_displacement(
    scene: Scene, system: System, step_factor: float, every: int, rho_inf: float | None = None
) -> Array:
    """Return the displacements (T, o) in m of a system at each `every`-th step of its motion.

    The time step is `step_factor` times the scene's.  The spectral radius is `rho_inf`, or the scene's if that is None.
    """
    driven = Excitation.from_scene(scene)
    grid = replace(driven.stepping, step=step_factor * driven.stepping.step)
    grid = grid if rho_inf is None else replace(grid, rho_inf=rho_inf)
    return evaluate_motion(system, run_from_start(system, driven.on_grid(grid), every)).displacement


@dataclass(frozen=True)
class ModelFamily:
    """Models of one basis as systems: `system_of_size` returns the model of a size from `smallest` to `largest`."""

    system_of_size: Callable[[int], System]
    largest: int
    smallest: int = 1


def with_basis(scene: Scene, basis: str, largest: int) -> Scene:
    """Return the scene with the reduction that a `basis` needs for models of up to the size `largest`.

    For a boom of sections, tolerance and budget of the scene are removed, so that no size is searched.
    """
    solver = scene.sections[0].reduction.solver
    if len(scene.sections) > 1:
        update = {"coordinates": RIGID_MODES + largest, "flexibility": True, "estimate": True}
        choices = [part.reduction.model_copy(update=update) for part in scene.sections]
        parts = [of.model_copy(update={"reduction": new}) for of, new in zip(scene.sections, choices, strict=True)]
        return scene.model_copy(update={"sections": tuple(parts), "accuracy": None, "budget": None})
    if basis == "visited":
        choice = Reduction(basis="eigenmodes", snapshots=9, modes=4, coordinates=min(largest, 36), solver=solver)
    elif basis == "pod":
        choice = Reduction(basis="eigenmodes", positions="nodes", coordinates=min(largest, 30), solver=solver)
    else:
        choice = Reduction(basis="free_modes", flexibility=True, coordinates=largest, solver=solver)
    return shared.with_reduction(scene, choice)


def model_family(scene: Scene, basis: str) -> ModelFamily:
    """Return the models of a `scene` that `with_basis` made for the same `basis`.

    ``pod`` and ``visited`` are POD of eigenmodes with the sliders held, at all nodes or at nine positions that the path
    visits.  ``modes`` are free modes without the flexibility of the modes that are left out, ``flexibility`` are free
    modes with this flexibility.
    """
    if len(scene.sections) > 1:
        return _section_family(scene, basis)
    from pmr.reduction.bodies import reduce_body

    longest = reduce_body(scene, shared.model_of(scene)).model
    if basis == "flexibility":
        return _flexible_family(longest)
    if basis == "modes":
        longest = replace(longest, flexibility=None, enrichment=None)
    return ModelFamily(lambda size: System.of(longest.leading(size)), longest.size)


def _flexible_family(longest: ReducedModel) -> ModelFamily:
    """Return models of free modes with flexibility, each with as many enrichment modes as the longest one has."""
    every = extend(longest) if longest.enrichment else longest
    more = every.size - longest.size

    def system_of_size(size: int) -> System:
        """Return the system of a model with `size` free modes."""
        leading = every if size + more == every.size else replace(truncate(every, size + more), enrichment=None)
        return System.of(truncate(leading, size) if more else leading)

    omega2 = np.diagonal(longest.K)
    rigid = int(np.sum(omega2 <= MODAL * np.finfo(float).eps * omega2[-1]))  # rigid-body motions have no flexibility
    return ModelFamily(system_of_size, longest.size, max(rigid, 1))


def pod_family(case: FullMotion) -> ModelFamily:
    """Return the models of a single body on the POD of its full motion's modal coordinates."""
    (body,) = case.full.reduced.values()
    U, sigma, _ = np.linalg.svd(case.run.bodies[ALONE].q[::SNAPSHOT_INTERVAL].T, full_matrices=False)
    rank = int(np.sum(sigma > sigma[0] * 1e-13))
    return ModelFamily(lambda size: System.of(projected(body, U[:, :size])), rank)


def _section_family(boom: Scene, basis: str) -> ModelFamily:
    """Return models of a boom whose size is the number of elastic modes of each section."""
    from pmr.reduction.bodies import reduce_bodies

    bodies = reduce_bodies(boom, shared.bodies_of(boom))
    trials = trials_of(boom, {name: body.modal for name, body in bodies.items()})

    def system_of_size(size: int) -> System:
        """Return the system with `size` elastic modes in each section."""
        modal = trials.models(trials.uniform_sizes(size))
        if basis == "modes":
            modal = {name: _without_flexibility(model) for name, model in modal.items()}
        stressed = any(frame_terms(boom))
        return system_of(boom, {name: simulated_model(model, stressed) for name, model in modal.items()})

    return ModelFamily(system_of_size, trials.most_elastic_modes(trials.most))


def _without_flexibility(model: ReducedModel) -> ReducedModel:
    """Return a section's model without the flexibility of the modes that are left out."""
    assert model.carriers is not None  # as section models have
    carriers = replace(model.carriers, flexibility=None, inertia=None, answers=None)
    return replace(model, flexibility=None, enrichment=None, carriers=carriers)
