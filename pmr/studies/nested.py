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

Of a boom of sections snapshots are eigenmodes of the whole boom, held at extensions, evenly from its shortest reach to
its longest; each section has a basis of its share in them, and coordinates are those of each section.  The supports of
a section are no rows of the boom's equations, so they are `dropped`, and nothing else.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.boom_figures import on_the_way
from pmr.errors import InputError, SimulationError
from pmr.reduced.model import ReducedModel, satisfied_rows
from pmr.scene import Scene
from pmr.scene.choice import directions, fewest_rows, model_of
from pmr.scene.members import members
from pmr.scene.names import ALONE
from pmr.simulation import Excitation
from pmr.studies import shared
from pmr.studies.engine.task import Task, TaskResult
from pmr.studies.marching import Motion, motion, resting
from pmr.system.assembly import Assembly
from pmr.system.from_scene import system_of
from pmr.system.projection import projected

if TYPE_CHECKING:
    from pmr.fullmodel.model import FullModel
    from pmr.reduction.basis import Basis
    from pmr.reduction.snapshots import Snapshots

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)
#: Share of a mode's largest entry below which entries are round-off of what does not move.
STILL = 1e-10
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

    # by treatment of the supports' rows, of each body
    models: Mapping[str, Mapping[str, NestedModels]]
    sigma: Mapping[str, Array]  # (k,) singular values of the pool of each body
    rank: int  # its numerical rank, the largest of all bodies


def treatments(scene: Scene) -> tuple[str, ...]:
    """What may become of the supports' rows of a scene."""
    return TREATMENTS if ALONE in scene.bodies else ("dropped",)


def check(scene: Scene, snapshots: Sequence[int], modes: Sequence[int], key: str) -> None:
    """Refuse scenes whose snapshots can't be varied, and what the mesh has too few nodes for, as far as is known.

    Raises InputError with source ``"study"``; the given key where numbers are too large.
    """
    if ALONE not in scene.bodies:
        if any(part.joint is not None and part.joint.rigid_overlap for part in scene.sections):
            allowed = "joints without rigid_overlap are allowed: its rigid rows take all of so few coordinates"
            raise InputError("study", "scene", scene.title, allowed)
        if any(model_of(member) not in ("beam2d", "beam3d") for member in members(scene)):
            allowed = "sections that are beams are allowed: modes of the whole boom are found by dense matrices"
            raise InputError("study", "scene", scene.title, allowed)
        if len(on_the_way(scene, Excitation.of(scene).times, max(snapshots))) < max(snapshots):
            allowed = "as many snapshots as a boom has extensions on its way are allowed"
            raise InputError("study", key, max(snapshots), allowed)
    elif not scene.reduction.pooled or scene.reduction.flexibility or not isinstance(scene.reduction.positions, str):
        allowed = "a scene whose basis is the plain POD of eigenmodes at positions that are not listed is allowed"
        raise InputError("study", "scene", scene.title, allowed)
    if any(
        part.mesh.file is not None or part.body.profile is None and part.body.box is None for part in scene.sections
    ):
        return
    elements = [part.mesh.elements for part in scene.sections]
    free = sum(
        len(directions(one)) * (count + 1) - fewest_rows(one)
        for one, count in zip(members(scene), elements, strict=True)
    )
    most = elements[0] if ALONE in scene.bodies else max(snapshots)
    if max(snapshots) > most or max(modes) > free:
        value = max(snapshots) if max(snapshots) > most else max(modes)
        allowed = f"{sum(elements)} elements allow up to {most} snapshots and {free} modes"
        raise InputError("study", key, value, allowed)


def simulated(
    scene: Scene, models: Mapping[str, ReducedModel | None], treatment: str, excitation: Excitation, full: Motion
) -> Motion | None:
    """Motion of the bodies' models over the steps of the full ones; where one has none all coordinates are at rest.

    None where they can't be simulated: why is stored with the result, for the report.
    """
    given = {name: model for name, model in models.items() if model is not None}
    if len(given) < len(models):
        return Motion(0.0 * full.displacement, lambda: 0.0 * full.strain)
    if ALONE not in given:  # modes that bend do not move along the boom: a cylinder holds nothing of theirs
        given = {name: _felt(model) for name, model in given.items()}
    try:
        return motion(system_of(scene, given), excitation)
    except (SimulationError, InputError) as error:
        logger.warning("support rows %s: %s", treatment, error)
        return None


def _felt(model: ReducedModel) -> ReducedModel:
    """The model without rows that its basis satisfies."""
    return model.with_rows(np.setdiff1d(np.arange(len(model.row_names)), satisfied_rows(model.rows)).tolist())


def library_task(scene: Scene, snapshots: Sequence[int], modes: int) -> Task:
    """Eigenmodes at every slider position that one of the numbers of `snapshots` asks for, each taken once."""
    arguments = shared.scene_arguments(resting(scene)) | {"snapshots": sorted(set(snapshots)), "modes": modes}
    return Task(f"library-{len(set(snapshots))}x{modes}-{arguments['hash']}", library, arguments, cost=1.0)


def library(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``s`` (p, paths) in m, ``phi`` (p, n, modes), ``omega`` in rad/s and ``residuals``, both (p, modes)."""
    scene = shared.scene_of(arguments)
    at = np.unique(np.concatenate([_positions(scene, count) for count in arguments["snapshots"]]), axis=0)
    phi, omega, residuals = map(np.stack, zip(*_modes(scene, at, arguments["modes"]), strict=True))
    return TaskResult(arrays={"s": at, "phi": phi, "omega": omega, "residuals": residuals})


def _modes(scene: Scene, at: Array, count: int) -> Iterator[tuple[Array, Array, Array]]:
    """Eigenmodes (n, count) of all bodies held at each place, their omega and, of a body alone, residuals."""
    from pmr.fullmodel.eigensolvers import eigensolver

    if ALONE in scene.bodies:
        solver = eigensolver(shared.model_of(scene), scene.reduction.solver)
        for (s,) in at:
            found = solver.lowest(float(s), count)
            yield found.phi, found.omega, found.residuals
        return
    system = shared.full_system(scene)
    assembly, whole = Assembly(system), np.cumsum([0, *(body.size for body in system.bodies.values())])
    free = np.concatenate([first + own for first, own in zip(whole[:-1], assembly.free.values(), strict=True)])
    for s in at:
        rows = assembly.at(system.coordinates(dict(zip(system.paths, s, strict=True))))
        omega, modes = assembly.modes(rows, count)
        phi = np.zeros((whole[-1], count))
        phi[free] = np.where(np.abs(modes) > STILL * np.abs(modes).max(), modes, 0.0)
        yield phi, omega, np.full(count, np.nan)


def global_basis(scene: Scene, library: TaskResult, snapshots: int, modes: int) -> GlobalBasis:
    """The basis of one combination, from the eigenmodes of a `library_task` for the same scene."""
    from pmr.fullmodel.build import models_of
    from pmr.reduction.basis import pod

    at = [np.flatnonzero(np.all(library.arrays["s"] == s, axis=1))[0] for s in _positions(scene, snapshots)]
    found, sigma, first, rank = dict[str, dict[str, NestedModels]](), dict[str, Array](), 0, 0
    for name, model in models_of(shared.bodies_of(scene)).items():
        pool = _pool(model, library, np.array(at), slice(first, first := first + model.size), modes)
        basis = pod(model, pool, None, "euclidean", scene.sections[0].reduction.solver)
        sigma[name], rank = basis.sigma, max(rank, basis.size)
        for treatment, models in (_alone if name == ALONE else _section)(model, basis, pool).items():
            found.setdefault(treatment, {})[name] = models
    return GlobalBasis(found, sigma, rank)


def _alone(model: FullModel, basis: Basis, pool: Snapshots) -> dict[str, NestedModels]:
    from pmr.reduction.galerkin import reduced_model

    dropped, body = reduced_model(model, basis, {}), model.gather()
    assert body is not None
    vectors = np.linalg.svd(np.array(pool.S.getDenseArray()), full_matrices=False)[0]
    return {
        "round_off": NestedModels(projected(body, vectors)),
        "last": NestedModels(dropped, spent=len(dropped.left_out)),
        "dropped": NestedModels(dropped),
    }


def _section(model: FullModel, basis: Basis, pool: Snapshots) -> dict[str, NestedModels]:
    from pmr.reduction.residual.model import stiff_model

    return {"dropped": NestedModels(stiff_model(model, basis, {}))}


def _positions(scene: Scene, count: int) -> Array:
    """Coordinates (count, paths) in m of all paths where snapshots are taken."""
    from pmr.reduction.snapshots.eigenmodes import positions

    if ALONE not in scene.bodies:
        driven = Excitation.of(scene)
        return driven.s[on_the_way(scene, driven.times, count)]
    choice = scene.reduction.model_copy(update={"snapshots": count})
    return positions(scene.model_copy(update={"reduction": choice}), shared.model_of(scene))[:, None]


def _pool(model: FullModel, library: TaskResult, number: NDArray[np.int64], rows: slice, modes: int) -> Snapshots:
    from pmr.reduction.snapshots import Snapshots

    phi = np.concatenate(library.arrays["phi"][number, rows, :modes], axis=1)
    omega, residuals = (library.arrays[name][number, :modes].ravel() for name in ("omega", "residuals"))
    s = np.repeat(library.arrays["s"][number, 0], modes)
    return Snapshots.of(phi, model, omega, s, residuals, source="eigenmodes")
