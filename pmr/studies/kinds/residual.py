"""Residual flexibility beside other ways to reduce a sliding beam: error over the number of coordinates.

Bases, each with the same numbers of coordinates, all against the full model's motion with the same step:

pod
    POD of eigenmodes with the slider held at several positions (Weyrer et al.), supports' rows left out.
modes
    Eigenmodes on the supports with the slider released.
harmonic
    POD of harmonic responses with the slider held along the visited stretch, up to `band`; M-orthonormal.
flexibility
    The same eigenmodes with the flexibility of those left out (docs/moving_residual_flexibility.md).
inertia
    These with the inertia of what is left out as well.
trajectory
    POD of the full model's own motion, M-orthonormal: no basis of fixed vectors holds more of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pmr import scene as scenes
from pmr.compare import errors as compare
from pmr.compare import estimate
from pmr.errors import InputError, SimulationError
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extended, truncated, with_kept_inertia
from pmr.scene import Reduction, Scene
from pmr.simulate import Excitation
from pmr.simulate.modal import modal_form
from pmr.simulate.native import simulator as march
from pmr.studies import shared
from pmr.studies.engine.task import Plan, Scalar, Task, TaskResult, key_of
from pmr.studies.results import StudyResults
from pmr.studies.study import Count, StudyBase
from pmr.system.body import Trajectory, displacement
from pmr.system.projection import projected

Array = NDArray[np.float64]
BASES = ("pod", "modes", "harmonic", "flexibility", "inertia", "trajectory")
#: Slider positions and frequencies of the harmonic responses, and their structural loss factor.
POSITIONS, FREQUENCIES, LOSS = 41, 81, 0.02
#: Every so many steps of the full motion are snapshots of it.
EVERY = 5
#: Simulations of which the fastest counts.
REPEATS = 5


class Study(StudyBase):
    """Each of `scenes` (two sliders or pads are fine, axial coordinates too) with each basis.

    Figures: ``<scene>.<basis>.<r>``, e_NRMS of the beam, and ``ratio.least`` and ``ratio.largest`` of the estimate to
    the true error, over all scenes and models with residual flexibility whose error is above `round_off`.
    """

    kind: Literal["residual"]
    scenes: Annotated[tuple[Path, ...], Field(min_length=1)]
    coordinates: Annotated[tuple[Count, ...], Field(min_length=1)] = (4, 5, 6, 8, 10, 12, 16, 20)
    band: Annotated[float, Field(gt=0.0)] = 20.0
    round_off: float = 3e-8

    def plan(self) -> Plan:
        if list(self.coordinates) != sorted(set(self.coordinates)):
            raise InputError("study", "coordinates", list(self.coordinates), "increasing numbers are allowed")
        runs = []
        for file in self.scenes:
            scene = scenes.vary_beam(file)
            for basis in BASES:
                update = {"reduction": _reduction(scene, basis, max(self.coordinates))}
                arguments = shared.scene_arguments(scene.model_copy(update=update))
                arguments |= {"basis": basis, "coordinates": list(self.coordinates), "band": self.band}
                parameters = {"scene": file.stem, "basis": basis}
                runs.append(Task(key_of(f"{file.stem},{basis}"), errors, arguments, {}, parameters, cost=2.0))
        return Plan(tuple(runs))

    def figures(self, results: StudyResults) -> dict[str, Scalar]:
        found: dict[str, Scalar] = {}
        ratios = []
        for run in results.runs:
            for r in self.coordinates:
                true, said = run.figures.get(f"beam.{r}"), run.figures.get(f"estimate.{r}")
                found[f"{run.parameters['scene']}.{run.parameters['basis']}.{r}"] = true
                if isinstance(true, float) and isinstance(said, float) and true > self.round_off and r >= 5:
                    ratios.append(said / true)
        return found | {"ratio.least": min(ratios, default=None), "ratio.largest": max(ratios, default=None)}


def errors(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``beam.<r>`` and ``force.<r>`` (e_NRMS), ``estimate.<r>`` where there is one; None where there is no model.

    Seconds: ``simulate.<r>``, of the solver alone, and ``full``.
    """
    scene = shared.scene_of(arguments)
    case = _Case.of(scene, arguments["band"])
    model = _MODELS[arguments["basis"]](case)
    record: dict[str, Scalar] = {}
    seconds = {"full": case.run.seconds}
    for r in arguments["coordinates"]:
        names = (f"beam.{r}", f"force.{r}", f"estimate.{r}")
        record |= dict.fromkeys(names)
        if r > model.largest:
            continue
        try:
            one = model.of(r)
            run, y = case.simulated(one)
            seconds[f"simulate.{r}"] = min(case.simulated(one)[0].seconds for _ in range(REPEATS))
        except (SimulationError, InputError):
            continue
        record[names[0]] = compare.nrms(y, case.displacement)
        record[names[1]] = compare.nrms(run.multipliers, case.run.multipliers)
        if estimate.no_estimate(one) is None:
            record[names[2]] = estimate.estimate(one, case.excitation).beam
    return TaskResult(record, seconds=seconds)


@dataclass(frozen=True)
class _Case:
    """A scene, its full model in modal coordinates, and the motion of that."""

    scene: Scene
    excitation: Excitation
    band: float
    full: ReducedModel
    run: Trajectory
    displacement: Array

    @classmethod
    def of(cls, scene: Scene, band: float) -> _Case:
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
class _Models:
    """Models of one basis by their number of coordinates, up to the largest."""

    of: Callable[[int], ReducedModel]
    largest: int


def _outputs(body: ReducedModel, run: Trajectory, excitation: Excitation) -> Array:
    return displacement(body, run.q, run.s, run.deforming, excitation.forces(body.input_names))


def _reduction(scene: Scene, basis: str, largest: int) -> Reduction:
    solver = scene.reduction.solver
    if basis == "pod":
        return Reduction(basis="eigenmodes", positions="nodes", coordinates=min(largest, 30), solver=solver)
    return Reduction(basis="free_modes", flexibility=True, coordinates=largest, solver=solver)


def _built(case: _Case) -> ReducedModel:
    from pmr.run import reduce

    return reduce(case.scene).reduced


def _pod(case: _Case) -> _Models:
    longest = _built(case)
    return _Models(longest.leading, longest.size)


def _modes(case: _Case) -> _Models:
    longest = replace(_built(case), flexibility=None, enrichment=None)
    return _Models(longest.leading, longest.size)


def _flexible(case: _Case) -> _Models:
    longest = _built(case)
    every = extended(longest) if longest.enrichment else longest
    more = every.size - longest.size

    def of(r: int) -> ReducedModel:
        """With as many enrichment modes as the longest model has."""
        found = every if r + more == every.size else replace(truncated(every, r + more), enrichment=None)
        return truncated(found, r) if more else found

    return _Models(of, longest.size)


def _inertial(case: _Case) -> _Models:
    plain = _flexible(case)
    return _Models(lambda r: with_kept_inertia(plain.of(r)), plain.largest)


def _harmonic(case: _Case) -> _Models:
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


def _trajectory(case: _Case) -> _Models:
    return _spanned(case.full, case.run.q[::EVERY].T)


def _spanned(body: ReducedModel, pool: Array) -> _Models:
    """Models on the POD of a pool of modal coordinates (n, k)."""
    U, sigma, _ = np.linalg.svd(pool, full_matrices=False)
    rank = int(np.sum(sigma > sigma[0] * 1e-13))
    return _Models(lambda r: projected(body, U[:, :r]), rank)


_MODELS: dict[str, Callable[[_Case], _Models]] = {
    "pod": _pod,
    "modes": _modes,
    "harmonic": _harmonic,
    "flexibility": _flexible,
    "inertia": _inertial,
    "trajectory": _trajectory,
}
