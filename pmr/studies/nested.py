r"""Reduced models of every size on one global basis: POD bases are nested, so one decomposition serves all sizes.

Supports make the difference between three ways to count coordinates, because POD vectors of eigenmodes vanish there
(`pmr.reduction.galerkin`):

dropped
    The supports' rows say nothing and are left out; r coordinates move: ``basis = "eigenmodes"`` of a scene.
last
    Each such row holds one of the last coordinates; r - 2 move under a pin: ``basis = "paper"``.
round_off
    The rows stay in as the singular value decomposition of the whole pool leaves them, which is what the paper does.
    Their entries are round-off, eps sigma_1 / sigma_j and less, but a row holds whatever its entries say, however
    small: *some* combination of the coordinates is held.  If the singular values fall quickly it is one of the last
    ones, if they fall slowly any.  A different LAPACK, or another order of the snapshots, holds another one.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError, SimulationError
from pmr.reduced.model import ReducedModel
from pmr.scene import Scene
from pmr.scene.choice import directions, fewest_rows
from pmr.scene.members import member_at
from pmr.simulation import Excitation
from pmr.studies import shared
from pmr.studies.engine.task import Task, TaskResult
from pmr.studies.marching import Motion, motion, resting
from pmr.system.projection import projected

if TYPE_CHECKING:
    from pmr.fullmodel.model import FullModel
    from pmr.reduction.snapshots import Snapshots

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)
#: What becomes of the supports' rows.
TREATMENTS = ("round_off", "last", "dropped")


@dataclass(frozen=True)
class NestedModels:
    """The reduced models of one basis, by number of coordinates."""

    longest: ReducedModel  # on all vectors of the basis
    spent: int = 0  # coordinates that supports take and that therefore never move

    def of(self, coordinates: int) -> ReducedModel | None:
        """The model of so many coordinates; None where all of them are spent, so that nothing moves.

        A pool spans so many dimensions only: beyond its numerical rank, where further vectors would be round-off, the
        longest model is all there is.
        """
        free = min(coordinates - self.spent, self.longest.size)
        return self.longest.leading(free) if free > 0 else None


@dataclass(frozen=True)
class GlobalBasis:
    """One combination of snapshots and modes."""

    models: Mapping[str, NestedModels]  # by treatment of the supports' rows
    sigma: Array  # (k,) singular values of the pool
    rank: int  # its numerical rank


def check(scene: Scene, snapshots: Sequence[int], modes: Sequence[int], key: str) -> None:
    """Refuse scenes whose snapshots can't be varied, and what the mesh has too few nodes for, as far as is known.

    Raises InputError with source ``"study"``; the given key where numbers are too large.
    """
    choice = scene.reduction
    if not choice.pooled or choice.flexibility or not isinstance(choice.positions, str):
        allowed = "a scene whose basis is the plain POD of eigenmodes at positions that are not listed is allowed"
        raise InputError("study", "scene", scene.title, allowed)
    elements = scene.mesh.elements
    if scene.mesh.file is not None:
        return
    free = len(directions(member_at(scene))) * (elements + 1) - fewest_rows(member_at(scene))
    if max(snapshots) > elements or max(modes) > free:
        value = max(snapshots) if max(snapshots) > elements else max(modes)
        raise InputError("study", key, value, f"{elements} elements allow up to {elements} snapshots and {free} modes")


def simulated(model: ReducedModel | None, treatment: str, excitation: Excitation, full: Motion) -> Motion | None:
    """Motion of a model over the steps of the full one; without a model all coordinates are spent and at rest.

    None where it can't be simulated: why is stored with the result, for the report.
    """
    try:
        return Motion(0.0 * full.displacement, 0.0 * full.strain) if model is None else motion(model, excitation)
    except SimulationError as error:
        logger.warning("support rows %s: %s", treatment, error)
        return None


def library_task(scene: Scene, snapshots: Sequence[int], modes: int) -> Task:
    """Eigenmodes at every slider position that one of the numbers of `snapshots` asks for, each taken once."""
    arguments = shared.scene_arguments(resting(scene)) | {"snapshots": sorted(set(snapshots)), "modes": modes}
    return Task(f"library-{len(set(snapshots))}x{modes}-{arguments['hash']}", library, arguments, cost=1.0)


def library(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``s`` (p,) in m, ``phi`` (p, n, modes), ``omega`` in rad/s and ``residuals``, both (p, modes)."""
    from pmr.fullmodel.eigensolvers import eigensolver

    scene = shared.scene_of(arguments)
    model = shared.model_of(scene)
    at = np.unique(np.concatenate([_positions(scene, model, count) for count in arguments["snapshots"]]))
    solver = eigensolver(model, scene.reduction.solver)
    modes = [solver.lowest(float(s), arguments["modes"]) for s in at]
    arrays = {name: np.stack([getattr(found, name) for found in modes]) for name in ("phi", "omega", "residuals")}
    return TaskResult(arrays={"s": at} | arrays)


def global_basis(scene: Scene, library: TaskResult, snapshots: int, modes: int) -> GlobalBasis:
    """The basis of one combination, from the eigenmodes of a `library_task` for the same scene."""
    from pmr.reduction.basis import pod
    from pmr.reduction.galerkin import reduced_model

    model = shared.model_of(scene)
    pool = _pool(model, library, _positions(scene, model, snapshots), modes)
    basis = pod(model, pool, None, "euclidean", scene.reduction.solver)
    dropped = reduced_model(model, basis, {})
    body = model.gather()
    assert body is not None
    vectors = np.linalg.svd(np.array(pool.S.getDenseArray()), full_matrices=False)[0]
    models = {
        "round_off": NestedModels(projected(body, vectors)),
        "last": NestedModels(dropped, spent=len(dropped.left_out)),
        "dropped": NestedModels(dropped),
    }
    return GlobalBasis(models, basis.sigma, basis.size)


def _positions(scene: Scene, model: FullModel, count: int) -> Array:
    from pmr.reduction.snapshots.eigenmodes import positions

    choice = scene.reduction.model_copy(update={"snapshots": count})
    return positions(scene.model_copy(update={"reduction": choice}), model)


def _pool(model: FullModel, library: TaskResult, at: Array, modes: int) -> Snapshots:
    from pmr.reduction.snapshots import Snapshots

    number = np.searchsorted(library.arrays["s"], at)
    phi = np.concatenate(library.arrays["phi"][number, :, :modes], axis=1)
    omega, residuals = (library.arrays[name][number, :modes].ravel() for name in ("omega", "residuals"))
    return Snapshots.of(phi, model, omega, np.repeat(at, modes), residuals, source="eigenmodes")
