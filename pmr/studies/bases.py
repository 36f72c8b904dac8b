"""Models of a sliding body on several bases, of every size, beside the motion of its full model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extended, truncated, with_kept_inertia
from pmr.scene import Reduction, Scene
from pmr.simulate import Excitation
from pmr.simulate.modal import modal_form
from pmr.simulate.native import simulator as march
from pmr.studies import shared
from pmr.system.body import Trajectory, displacement
from pmr.system.projection import projected

Array = NDArray[np.float64]

#: Slider positions and frequencies of the harmonic responses, and their structural loss factor.
POSITIONS, FREQUENCIES, LOSS = 41, 81, 0.02
#: Every so many steps of the full motion are snapshots of it.
EVERY = 5


@dataclass(frozen=True)
class Case:
    """A scene, its full model in modal coordinates, and the motion of that."""

    scene: Scene
    excitation: Excitation
    band: float
    full: ReducedModel
    run: Trajectory
    displacement: Array

    @classmethod
    def of(cls, scene: Scene, band: float) -> Case:
        body, excitation = shared.model_of(scene).gather(), Excitation.of(scene)
        assert body is not None
        form = modal_form(body)
        run = march.simulate_modal(form, excitation)
        return cls(scene, excitation, band, form.body, run, _outputs(form.body, run, excitation))

    def simulated(self, model: ReducedModel) -> tuple[Trajectory, Array]:
        """Trajectory in modal coordinates, and outputs (T, o)."""
        form = modal_form(model)
        run = march.simulate_modal(form, self.excitation)
        return run, _outputs(form.body, run, self.excitation)


@dataclass(frozen=True)
class Models:
    """Models of one basis by their number of coordinates, up to the largest."""

    of: Callable[[int], ReducedModel]
    largest: int


def _outputs(body: ReducedModel, run: Trajectory, excitation: Excitation) -> Array:
    return displacement(body, run.q, run.s, run.deforming, excitation.forces(body.input_names))


def reduction(scene: Scene, basis: str, largest: int) -> Reduction:
    """What a scene has to ask for to get models of a basis with up to `largest` coordinates."""
    solver = scene.reduction.solver
    if basis == "visited":
        return Reduction(basis="eigenmodes", snapshots=9, modes=4, coordinates=min(largest, 36), solver=solver)
    if basis == "pod":
        return Reduction(basis="eigenmodes", positions="nodes", coordinates=min(largest, 30), solver=solver)
    return Reduction(basis="free_modes", flexibility=True, coordinates=largest, solver=solver)


def _built(case: Case) -> ReducedModel:
    from pmr.run import reduce

    return reduce(case.scene).reduced


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
    every = extended(longest) if longest.enrichment else longest
    more = every.size - longest.size

    def of(r: int) -> ReducedModel:
        """With as many enrichment modes as the longest model has."""
        found = every if r + more == every.size else replace(truncated(every, r + more), enrichment=None)
        return truncated(found, r) if more else found

    return Models(of, longest.size)


def inertial(case: Case) -> Models:
    """The same with their inertia."""
    plain = flexible(case)
    return Models(lambda r: with_kept_inertia(plain.of(r)), plain.largest)


def harmonic(case: Case) -> Models:
    r"""Responses to unit loads, z = h (b - c^T lambda) with h = 1 / (omega_j^2 (1 + i eta) - omega^2)."""
    body = case.full
    low, high = case.scene.path_bounds
    pool = []
    for s in np.linspace(low, high, POSITIONS):
        c = body.C(s)
        for omega in 2.0 * np.pi * np.linspace(0.0, case.band, FREQUENCIES)[1:]:
            h = 1.0 / (np.diagonal(body.K) * (1.0 + 1j * LOSS) - omega**2)
            force = np.linalg.solve((c * h) @ c.T + np.diag(body.row_compliance), (c * h) @ body.B)
            z = h[:, None] * (body.B - c.T @ force)
            pool += [z.real, z.imag]
    return _spanned(body, np.hstack(pool))


def trajectory(case: Case) -> Models:
    """POD of the full model's own motion."""
    return _spanned(case.full, case.run.q[::EVERY].T)


def _spanned(body: ReducedModel, pool: Array) -> Models:
    """Models on the POD of a pool of modal coordinates (n, k)."""
    U, sigma, _ = np.linalg.svd(pool, full_matrices=False)
    rank = int(np.sum(sigma > sigma[0] * 1e-13))
    return Models(lambda r: projected(body, U[:, :r]), rank)


MODELS: dict[str, Callable[[Case], Models]] = {
    "pod": pod,
    "visited": pod,
    "modes": modes,
    "harmonic": harmonic,
    "flexibility": flexible,
    "inertia": inertial,
    "trajectory": trajectory,
}
