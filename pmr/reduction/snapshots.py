r"""Vectors from which bases are made: free-interface modes, and eigenmodes with the slider held.

Free-interface modes are eigenmodes on the fixed supports with all sliders and pads released.

.. math::
    K \phi = \omega^2 M \phi, \qquad C_{fixed}\, \phi = 0

Rigid-body modes, if the fixed supports leave any, come first with omega = 0.  MacNeal: A hybrid method of component
mode synthesis, Computers & Structures 1, 1971, pp. 581-601; Rubin: Improved component-mode representation for
structural dynamic analysis, AIAA Journal 13, 1975, pp. 995-1006.

Eigenmodes with the slider held at several positions are the snapshots of "the paper": Weyrer, Gerstmayr, Mikkola,
Orzechowski: Model Order Reduction of a Sliding Beam using a Global Basis, section "Snapshot Selection".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pmr.errors import ConvergenceError, InputError
from pmr.fem.compat import PETSc
from pmr.fem.distributed import inner, local_csr, tall, times
from pmr.files.arrays import Array, Indices, Mask
from pmr.fullmodel.eigensolvers import DenseEigenSolver, DependentRowsError, eigensolver, is_dense
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.modes import Modes, finish_modes
from pmr.reduction.free_body import FreeBody, absolute_product, fixed_rows
from pmr.scene import Scene
from pmr.system.body_matrices import DAMPING
from pmr.system.polynomials import power_contributions
from pmr.system.rows import Rows


@dataclass(frozen=True)
class Snapshots:
    """Pool of k vectors from which a basis is made.

    `residuals` are normwise backward errors ||K phi - omega^2 M phi|| / ((||K|| + omega^2 ||M||) ||phi||) in infinity
    norms.  `omega`, `s` and `residuals` are NaN if they are not known or don't apply.
    """

    S: PETSc.Mat  # dense (n, k), one vector a column; eigenmodes are mass-normalised, phi^T M phi = 1, in 1/sqrt(kg)
    omega: Array  # (k,) rad/s
    s: Array  # (k,) m: path coordinate of the slider for each column
    residuals: Array  # (k,)
    source: str  # how the columns were made, in words


def node_set(nodes: int, snapshots: int) -> Indices:
    """Numbers (snapshots,) of the nodes at which the paper of the module's docstring holds the slider, counted from 1.

    For one snapshot the node is floor(nodes / 2).  For several snapshots the nodes are
    floor(2 + (nodes - 2) k / (snapshots - 1)) with k = 0 ... snapshots - 1, so node 1 is not among them.
    """
    if snapshots == 1:
        return np.array([nodes // 2])
    return 2 + (nodes - 2) * np.arange(snapshots) // (snapshots - 1)


def positions(scene: Scene, model: FullModel) -> Array:
    """Path coordinates (snapshots,) in m at which the scene asks for snapshots.

    The scene lists the positions, or names a rule.  ``nodes`` is the node set of the paper (`node_set`), among the
    nodes at which the first slider may be while all sliders are on the beam.  ``path`` spaces the positions evenly over
    the travelled part of the path, ends included; a single position is its middle.  An InputError is raised if two
    snapshots are at the same node.
    """
    choice, count = scene.reduction.positions, scene.reduction.snapshots
    if choice == "nodes":
        assert model.node_stations is not None  # the scene's check
        low, high = model.rows.domain
        slack = 1e-9 * (high - low)
        nodes = model.node_stations - next(iter(scene.points), 0.0)
        nodes = nodes[(nodes >= low - slack) & (nodes <= high + slack)]
        numbers = node_set(len(nodes), count)
        if len(set(numbers)) != count:
            raise InputError("scene", "reduction.snapshots", count, f"at most {len(nodes) - 1} fit on the mesh's nodes")
        return nodes[numbers - 1]
    if choice == "path":
        low, high = scene.travel
        return np.linspace(low, high, count) if count > 1 else np.array([(low + high) / 2.0])
    return np.array(choice)


def eigenmode_snapshots(model: FullModel, scene: Scene) -> Snapshots:
    """Snapshots of a scene: the ``reduction.modes`` lowest eigenmodes for each position of the held slider.

    The eigenmodes are mass-normalised.  Those of the first position come first, then those of the second, and so on.
    An InputError is raised if the slider can't be held at one of the positions.  It is also raised for more modes than
    the number of coordinates minus the number of rows.  A ConvergenceError is raised if too few modes converge.
    Collective.
    """
    solver, free = eigensolver(model, scene.reduction.solver), model.size - len(model.rows.names)
    if scene.reduction.modes > free:
        allowed = f"the mesh leaves {free} free coordinates; ask for fewer modes or refine it"
        raise InputError("scene", "reduction.modes", scene.reduction.modes, allowed)
    at = positions(scene, model)
    modes = []
    for s in at:
        try:
            modes.append(solver.lowest(float(s), scene.reduction.modes))
        except DependentRowsError as error:
            raise InputError("scene", "reduction.positions", float(s), error.allowed) from None
        if model.comm.rank == 0:
            modes[-1].warn_if_cut(float(s))
    return Snapshots(
        tall(np.concatenate([m.phi for m in modes], axis=1), model.M),
        omega=np.concatenate([m.omega for m in modes]),
        s=np.repeat(at, scene.reduction.modes),
        residuals=np.concatenate([m.residuals for m in modes]),
        source=f"eigenmodes, {type(solver).__name__}",
    )


#: Work of a load or row on a mode, over its largest work on any mode, up to which it does not excite the mode.
UNREACHED = 1e-8
#: Couplings of modes by damping, relative to the terms they are sums of, are round-off up to this many times the
#: machine precision.
ROUND_OFF = 100.0

#: Square root of the measure in `_bent_modes`, over that of the most bent mode, up to which axial forces do not bend a
#: mode; and number of modes to compute in addition because some are not bent.
UNBENT, SPARE = 1e-6, 4

#: Smallest share of each rigid-body mode in the span of the computed modes; 1 - 1e-8 on a beam of 2000 elements.
HELD_BY_MODES = 0.9


def free_modes(
    model: FullModel,
    count: int,
    solver: str = "auto",
    enrichment: int = 0,
    body: FreeBody | None = None,
    stressed: bool = False,
) -> Snapshots:
    """The lowest M-orthonormal modes that a load or slider can excite, rigid-body modes first; collective.

    There are `count` modes, followed by up to `enrichment` further modes.  `count` must be at least the number of
    rigid-body modes.  It must also be less than the number of excited modes, so that flexibility is left, or equal to
    the number of all coordinates of the model.  The flexibility of the modes that are not used determines the forces at
    rigid sliders and pads.  Therefore at least one mode for each rigid slider or pad is not used, and a coarse mesh may
    give fewer enrichment modes.  Rigid-body modes come from the geometry (`pmr.reduction.free_body`); all others are
    M-orthogonal to them.

    Modes that no load and no slider can excite, and that no damping couples to such modes, stay at rest for ever.
    Examples are those along the axis of a straight beam with all loads across it.  Such modes are left out.  If axial
    forces act on the section (`stressed`), enrichment modes that such forces do not bend are left out too.  Enrichment
    modes serve as modes without inertia, which follow axial forces (`pmr.system.attachment`).

    The solver is ``"auto"``, ``"dense"`` or ``"slepc"``.  If a `body` of this model and solver is not None, its factor
    is used, and kept for further use.  An InputError is raised if `count` is out of range, a ConvergenceError if too
    few modes converge.
    """
    # one more mode shows whether flexibility is left; a dense solver has all modes, so more can be left
    rigid = sum(not row.is_fixed and row.compliance == 0.0 for row in model.rows.rows)
    spare = max(1, rigid if is_dense(model, solver) else 1)
    stress = [A for name, A in model.matrices.items() if name.startswith("axial")] if stressed and enrichment else []
    more = enrichment + (SPARE if stress else 0)
    lowest = _lowest_modes(body or FreeBody(model, solver), count + more + spare)
    modes, count_of_modes = lowest.modes, len(lowest.modes.omega)
    if lowest.rigid > count:
        allowed = f"the fixed supports leave {lowest.rigid} rigid-body modes free; at least as many are allowed"
        raise InputError("scene", "reduction.coordinates", count, allowed)
    if count > count_of_modes or count == count_of_modes < model.size:
        allowed = f"loads and sliders excite {count_of_modes} modes of this mesh; fewer than these are allowed"
        raise InputError("scene", "reduction.coordinates", count, allowed)
    beyond = np.arange(count, min(count + more, count_of_modes - spare))
    beyond = beyond[_bent_modes(model, stress, modes, beyond)] if stress else beyond
    taken = np.concatenate([np.arange(count), beyond[:enrichment]])
    return Snapshots(
        tall(np.ascontiguousarray(modes.phi[:, taken]), model.M),
        omega=modes.omega[taken],
        s=np.full(len(taken), np.nan),
        residuals=modes.residuals[taken],
        source="eigenmodes on the fixed supports, sliders released",
    )


@dataclass(frozen=True)
class _LowestModes:
    """Lowest modes of a model that loads and rows can excite; the first `rigid` of them are rigid-body modes."""

    modes: Modes
    rigid: int


def _lowest_modes(body: FreeBody, count: int) -> _LowestModes:
    """The `count` lowest modes that loads and rows can excite, or all if there are fewer; collective.

    Rigid-body modes come first and are counted among them; all of these are returned, even if they are more than
    `count`.
    """
    model, Z = body.model, body.Z
    held = replace(model, rows=Rows(fixed_rows(model), model.size))
    s = _any_position(held)
    free, pairs = model.size - len(held.rows.rows), count + Z.shape[1]
    while True:
        pairs = min(pairs, free)
        elastic = _elastic_modes(held, body, pairs)
        work = _with_coupled_modes(model, _relative_work(model, np.hstack([Z, elastic.phi])), [Z, elastic.phi])
        reached = _reached_motions(work[:, : Z.shape[1]])
        wanted = max(count - reached.shape[1], 0)
        chosen = np.flatnonzero(np.any(np.abs(work[:, Z.shape[1] :]) > UNREACHED, axis=0))[:wanted]
        if len(chosen) == wanted or pairs == free:
            break
        pairs = 2 * pairs
    bodies = finish_modes(held, s, np.zeros(reached.shape[1]), Z @ reached, cut=False)
    return _LowestModes(
        Modes(
            np.concatenate([bodies.omega, elastic.omega[chosen]]),
            np.hstack([bodies.phi, elastic.phi[:, chosen]]),
            np.concatenate([bodies.residuals, elastic.residuals[chosen]]),
        ),
        len(bodies.omega),
    )


def _elastic_modes(fixed_model: FullModel, body: FreeBody, pairs: int) -> Modes:
    """Elastic modes of `fixed_model` among its `pairs` lowest modes, rigid-body modes included; collective."""
    if is_dense(fixed_model, body.choice):
        return _remove_rigid_modes(
            fixed_model, body.Z, DenseEigenSolver(fixed_model).lowest(_any_position(fixed_model), pairs)
        )
    lowest = body.elastic_modes(pairs - body.Z.shape[1])
    return finish_modes(fixed_model, _any_position(fixed_model), 1.0 / lowest.theta, lowest.vectors, cut=False)


def _any_position(fixed_model: FullModel) -> float:
    """Lowest path coordinate in m of a model whose rows do not depend on s, so that any coordinate is right."""
    return float(fixed_model.rows.domain[0]) if fixed_model.rows.rows else 0.0


def _remove_rigid_modes(fixed_model: FullModel, Z: Array, modes: Modes) -> Modes:
    """Modes M-orthogonal to the rigid-body modes Z (n_local, c), from computed `modes` of `fixed_model` that contain Z.

    Computed rigid-body modes are rigid to a few digits only, and mix with low elastic ones.  Therefore the M-orthogonal
    complement of Z in the span of all modes is computed, and its modes follow from the frequencies of all modes.  A
    ConvergenceError is raised if the modes do not contain Z: round-off in the stiffness of a rigid motion is then more
    than the stiffness of the lowest modes.  Collective.
    """
    count = Z.shape[1]
    if count == 0:
        return modes
    share = inner(times(fixed_model.M, Z), modes.phi, fixed_model.comm)
    _, values, Vt = np.linalg.svd(share)
    if values[-1] < HELD_BY_MODES:
        raise ConvergenceError(
            f"round-off in the stiffness hides {count} rigid-body modes among the lowest of this mesh; fewer elements "
            "or stiffer supports help"
        )
    complement = Vt[count:].T
    omega2, turned = np.linalg.eigh(complement.T @ (modes.omega[:, None] ** 2 * complement))
    combined = complement @ turned
    return finish_modes(
        fixed_model, _any_position(fixed_model), omega2, modes.phi @ combined - Z @ (share @ combined), cut=False
    )


def _bent_modes(model: FullModel, stress: Sequence[PETSc.Mat], modes: Modes, numbers: Indices) -> Mask:
    """Mask (k,) that marks, among the modes with these `numbers` (k,), the modes that axial forces bend; collective.

    `stress` are the geometric stiffnesses G of the axial forces.  The measure of mode i is the sum of
    (phi_i^T G phi_j)^2 / omega_i^2 over all G and all modes j before the first of `numbers`.  A mode is bent if its
    measure is more than `UNBENT`^2 times the largest.
    """
    bending = np.zeros(len(numbers))
    for G in stress:
        work = inner(times(G, modes.phi), modes.phi, model.comm)
        for k, number in enumerate(numbers):
            bending[k] += np.sum(work[number, : numbers[0]] ** 2) / modes.omega[number] ** 2
    return np.asarray(bending > UNBENT**2 * bending.max(initial=0.0))


def _relative_work(model: FullModel, phi: Array) -> Array:
    """Work (a, k) of loads and released rows on k modes phi (n_local, k), each row divided by its largest magnitude.

    Collective.  Each of the a rows belongs to a load or to a power of a released row; a row that works on none of the
    modes is zero.
    """
    first = model.M.getOwnershipRange()[0]
    work = [local_csr(model.B).T @ phi]
    work += [
        power_contributions(row.project(phi, first)).reshape(-1, phi.shape[1])
        for row in model.rows.rows
        if not row.is_fixed
    ]
    work_of_all = np.asarray(model.comm.allreduce(np.concatenate(work)))
    largest = np.abs(work_of_all).max(axis=1, initial=0.0, keepdims=True)
    return np.divide(work_of_all, largest, out=np.zeros_like(work_of_all), where=largest > 0.0)


def _with_coupled_modes(model: FullModel, work: Array, modes: Sequence[Array]) -> Array:
    """Relative `work` (a, k) on k modes, with a further row for each mode that is excited: the work of its damping.

    The `modes` are blocks (n_local, any) of columns, k in all.  Rayleigh damping couples no modes, so nothing is added.
    With any other damping, an excited mode excites the modes to which damping couples it, and these excite further
    modes in turn.  Couplings that are round-off are left out.  Collective.
    """
    if DAMPING not in model.matrices:
        return work
    D, phi = model.matrices[DAMPING], np.hstack(modes)
    coupling = np.abs(inner(phi, times(D, phi), model.comm))
    sizes = inner(np.abs(phi), absolute_product(D, phi), model.comm)
    coupling[coupling <= ROUND_OFF * np.finfo(float).eps * sizes] = 0.0
    scale = np.sqrt(np.diagonal(coupling))
    product = np.outer(scale, scale)
    coupling = np.divide(coupling, product, out=np.zeros_like(coupling), where=product > 0.0)
    reached = np.any(np.abs(work) > UNREACHED, axis=0)
    while np.count_nonzero(more := reached | np.any(coupling[reached] > UNREACHED, axis=0)) > np.count_nonzero(reached):
        reached = more
    return np.vstack([work, coupling[reached]])


def _reached_motions(work: Array) -> Array:
    """Orthonormal combinations (k, c) of k rigid-body modes: the c motions on which loads and rows do work.

    `work` (a, k) is the work of a loads and rows on each of the k rigid-body modes.  A motion on which no work is done
    may be a combination of several of these modes.  If work is done on all motions, the unit matrix (k, k) is returned.
    """
    _, values, Vt = np.linalg.svd(work, full_matrices=False)
    reached = int(np.sum(values > UNREACHED))
    return np.eye(work.shape[1]) if reached == work.shape[1] else np.asarray(Vt[:reached].T)
