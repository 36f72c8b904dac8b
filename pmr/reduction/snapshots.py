r"""Vectors that bases are made from: free-interface modes, and the paper's eigenmodes with the slider held.

Free-interface modes: eigenmodes on the fixed supports with all sliders and pads released.

.. math::
    K \phi = \omega^2 M \phi, \qquad C_{fixed}\, \phi = 0

Rigid-body modes, where the fixed supports leave any, come first with omega = 0.  MacNeal: A hybrid method of component
mode synthesis, Computers & Structures 1, 1971, pp. 581-601; Rubin: Improved component-mode representation for
structural dynamic analysis, AIAA Journal 13, 1975, pp. 995-1006.

Eigenmodes with the slider held at several positions: the paper's snapshots.

Weyrer, Gerstmayr, Mikkola, Orzechowski: Model Order Reduction of a Sliding Beam using a Global Basis, section
"Snapshot Selection".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.constraints.polynomials import contributions
from pmr.constraints.rows import Rows
from pmr.errors import ConvergenceError, InputError
from pmr.fem.compat import PETSc
from pmr.fem.distributed import inner, local_csr, tall, times
from pmr.fullmodel.eigensolvers import DenseEigenSolver, DependentRowsError, eigensolver, is_dense
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.modes import Modes, finish_modes
from pmr.reduction.free_body import FreeBody, fixed_rows
from pmr.scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Snapshots:
    """The pool that a basis is made from.

    `residuals` are normwise backward errors ||K phi - omega^2 M phi|| / ((||K|| + omega^2 ||M||) ||phi||) in infinity
    norms.
    """

    S: PETSc.Mat  # dense (n, k), a column each; eigenmodes are mass-normalised, phi^T M phi = 1, and carry 1/sqrt(kg)
    omega: Array  # (k,) rad/s
    s: Array  # (k,) m: path coordinate at which each column was taken
    residuals: Array  # (k,)
    source: str  # how the columns were made

    @classmethod
    def of(cls, local: Array, model: FullModel, omega: Array, s: Array, residuals: Array, source: str) -> Snapshots:
        """Snapshots of a model, from this rank's rows (n_local, k) of the columns; collective."""
        return cls(tall(local, model.M), omega, s, residuals, source)


def node_set(nodes: int, snapshots: int) -> NDArray[np.int64]:
    """Node numbers, counted from 1, at which the paper holds the slider: never the first node.

    floor(nodes / 2) for one snapshot, floor(2 + (nodes - 2) k / (snapshots - 1)), k = 0 ... snapshots - 1, for more.
    """
    if snapshots == 1:
        return np.array([nodes // 2])
    return 2 + (nodes - 2) * np.arange(snapshots) // (snapshots - 1)


def positions(scene: Scene, model: FullModel) -> Array:
    """Path coordinates (snapshots,) in m at which the scene asks for snapshots.

    ``nodes``: the paper's node set, with the first slider on nodes that leave all sliders on the beam; ``path``: evenly
    over the stretch that the path visits; or as listed.  Raises InputError if two snapshots fall on one node.
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
    """The scene's snapshots: `modes` mass-normalised eigenmodes at each of the positions.

    Raises InputError if the slider can't be held at one of the positions; ConvergenceError if too few modes exist or
    converge.
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
    return Snapshots.of(
        np.concatenate([m.phi for m in modes], axis=1),
        model,
        omega=np.concatenate([m.omega for m in modes]),
        s=np.repeat(at, scene.reduction.modes),
        residuals=np.concatenate([m.residuals for m in modes]),
        source=f"eigenmodes, {type(solver).__name__}",
    )


#: A load or a row that does less work on a mode than this share of its work on another one does not excite it.
UNREACHED = 1e-8

#: Axial forces that do less work on a mode than this share of that on another one do not bend it; so many that they do
#: not bend may stand among the others.
UNBENT, SPARE = 1e-6, 4

#: Least share of each rigid-body mode in the lowest modes computed; 1 - 1e-8 on a beam of 2000 elements.
HELD_BY_MODES = 0.9


def free_modes(
    model: FullModel,
    count: int,
    solver: str = "auto",
    enrichment: int = 0,
    body: FreeBody | None = None,
    stressed: bool = False,
) -> Snapshots:
    """The lowest M-orthonormal modes that a load or a slider can excite, rigid-body modes first; collective.

    There are `count` of them, at least as many as there are rigid-body modes and fewer than all, so that flexibility is
    left, and up to `enrichment` more.  These leave as many modes as there are rigid sliders and pads, whose forces
    are determined by what is left: a coarse mesh may have fewer.  Rigid-body modes come from the geometry
    (`pmr.reduction.free_body`), all others are M-orthogonal to them.

    Modes that none of them reaches stay at rest for ever: along the axis of a straight beam, say, where all loads act
    across it.  They are left out.  So are, among the `enrichment`, those that axial forces do not bend, of a section
    that is `stressed`: modes without inertia follow these forces (`pmr.reduced.attachment`).

    The solver is ``"auto"``, ``"dense"`` or ``"slepc"``; a `body` of this model and solver leaves its factor to whoever
    needs it next.  Raises InputError if `count` is out of this range; ConvergenceError if too few modes converge.
    """
    # One more tells whether flexibility is left; a mesh of which all modes are computed at once is asked for more.
    rigid = sum(not row.fixed and row.compliance == 0.0 for row in model.rows.rows)
    spare = max(1, rigid if is_dense(model, solver) else 1)
    stress = [A for name, A in model.matrices.items() if name.startswith("axial")] if stressed and enrichment else []
    more = enrichment + (SPARE if stress else 0)
    lowest = _lowest(body or FreeBody(model, solver), count + more + spare)
    modes, count_of_modes = lowest.modes, len(lowest.modes.omega)
    if lowest.rigid > count:
        allowed = f"the fixed supports leave {lowest.rigid} rigid-body modes free; at least as many are allowed"
        raise InputError("scene", "reduction.coordinates", count, allowed)
    if count_of_modes <= count:
        allowed = f"loads and sliders excite {count_of_modes} modes of this mesh; fewer than these are allowed"
        raise InputError("scene", "reduction.coordinates", count, allowed)
    beyond = np.arange(count, min(count + more, count_of_modes - spare))
    beyond = beyond[_bent(model, stress, modes, beyond)] if stress else beyond
    taken = np.concatenate([np.arange(count), beyond[:enrichment]])
    return Snapshots.of(
        np.ascontiguousarray(modes.phi[:, taken]),
        model,
        omega=modes.omega[taken],
        s=np.full(len(taken), np.nan),
        residuals=modes.residuals[taken],
        source="eigenmodes on the fixed supports, sliders released",
    )


@dataclass(frozen=True)
class _Lowest:
    """The lowest modes that are excited, and how many of them, the first ones, are rigid-body modes."""

    modes: Modes
    rigid: int


def _lowest(body: FreeBody, count: int) -> _Lowest:
    """Lowest modes with `count` that are excited, fewer if there are no more."""
    model, Z = body.model, body.Z
    held = replace(model, rows=Rows(fixed_rows(model), model.size))
    s = _anywhere(held)
    free, pairs = model.size - len(held.rows.rows), count + Z.shape[1]
    while True:
        pairs = min(pairs, free)
        elastic = _elastic(held, body, pairs)
        work = _work(model, np.hstack([Z, elastic.phi]))
        reached = _reached_motions(work[:, : Z.shape[1]])
        chosen = np.flatnonzero(np.any(np.abs(work[:, Z.shape[1] :]) > UNREACHED, axis=0))[: count - reached.shape[1]]
        if len(chosen) + reached.shape[1] == count or pairs == free:
            break
        pairs = 2 * pairs
    bodies = finish_modes(held, s, np.zeros(reached.shape[1]), Z @ reached, cut=False)
    return _Lowest(
        Modes(
            np.concatenate([bodies.omega, elastic.omega[chosen]]),
            np.hstack([bodies.phi, elastic.phi[:, chosen]]),
            np.concatenate([bodies.residuals, elastic.residuals[chosen]]),
        ),
        len(bodies.omega),
    )


def _elastic(held: FullModel, body: FreeBody, pairs: int) -> Modes:
    """The `pairs` lowest modes but for the rigid-body modes among them."""
    if is_dense(held, body.choice):
        return _remove_rigid_modes(held, body.Z, DenseEigenSolver(held).lowest(_anywhere(held), pairs))
    lowest = body.elastic(pairs - body.Z.shape[1])
    return finish_modes(held, _anywhere(held), 1.0 / lowest.theta, lowest.vectors, cut=False)


def _anywhere(held: FullModel) -> float:
    """A place, m: none of these rows moves."""
    return float(held.rows.domain[0]) if held.rows.rows else 0.0


def _remove_rigid_modes(held: FullModel, Z: Array, modes: Modes) -> Modes:
    """The modes but for the rigid-body modes Z (n_local, c), which the lowest ones hold, made M-orthogonal to these.

    Computed rigid-body modes are rigid to a few digits only, and share them with the low elastic ones: the part of the
    span beside Z is taken as a whole, and its modes are those of the frequencies that were found.  Raises
    ConvergenceError if the modes do not hold Z: what round-off makes of the stiffness of a rigid motion is then more
    than that of the lowest modes.
    """
    count = Z.shape[1]
    if count == 0:
        return modes
    share = inner(times(held.M, Z), modes.phi, held.comm)
    _, values, Vt = np.linalg.svd(share)
    if values[-1] < HELD_BY_MODES:
        raise ConvergenceError(
            f"round-off in the stiffness hides {count} rigid-body modes among the lowest of this mesh; fewer elements "
            "or stiffer supports help"
        )
    complement = Vt[count:].T
    omega2, turned = np.linalg.eigh(complement.T @ (modes.omega[:, None] ** 2 * complement))
    combined = complement @ turned
    return finish_modes(held, _anywhere(held), omega2, modes.phi @ combined - Z @ (share @ combined), cut=False)


def _bent(model: FullModel, stress: Sequence[Any], modes: Modes, which: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which modes axial forces of matrices `stress` bend: by G on the modes before them, over their own stiffness."""
    bending = np.zeros(len(which))
    for G in stress:
        work = inner(times(G, modes.phi), modes.phi, model.comm)
        for k, number in enumerate(which):
            bending[k] += np.sum(work[number, : which[0]] ** 2) / modes.omega[number] ** 2
    return np.asarray(bending > UNBENT**2 * bending.max(initial=0.0))


def _work(model: FullModel, phi: Array) -> Array:
    """The work (a, k) of loads and released rows on each mode, given by this rank's rows, over the largest of each."""
    first = model.M.getOwnershipRange()[0]
    work = [local_csr(model.inputs).T @ phi]
    work += [
        contributions(row.project(phi, first)).reshape(-1, phi.shape[1]) for row in model.rows.rows if not row.fixed
    ]
    work_of_all = np.asarray(model.comm.allreduce(np.concatenate(work)))
    largest = np.abs(work_of_all).max(axis=1, initial=0.0, keepdims=True)
    return np.divide(work_of_all, largest, out=np.zeros_like(work_of_all), where=largest > 0.0)


def _reached_motions(work: Array) -> Array:
    """Orthonormal combinations (c, k) of the rigid-body modes that cover all on which work (a, c) is done.

    The modes are any set that spans theirs: one that nothing reaches may be hidden in the others.
    """
    _, values, Vt = np.linalg.svd(work, full_matrices=False)
    reached = int(np.sum(values > UNREACHED))
    return np.eye(work.shape[1]) if reached == work.shape[1] else np.asarray(Vt[:reached].T)
