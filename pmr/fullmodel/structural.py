r"""The full model of a structure: its matrices, rows, loads and outputs, and its planes of symmetry.

In a symmetric body, mirrored loads have mirrored responses.  P is a signed permutation that turns a motion q into its
mirror image P q in a plane across y or z.  For the mass M and the stiffness K

.. math::
    P M P^T = M, \quad P K P^T = K \quad \Rightarrow \quad R\, (P g) = P\, (R\, g)

for any operator R on loads g that is made from M and K.  Whether a body is symmetric, with its supports and attached
masses, is decided by these equations, on two random vectors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import columns, free_objects, sparse, times
from pmr.files.arrays import Array, Indices
from pmr.fullmodel.assembly import Operators, operators_of, pad_pattern, project_matrix, rayleigh, share
from pmr.fullmodel.model import FullModel, RigidMotions, masses_of
from pmr.fullmodel.moving import FrameAssembler
from pmr.fullmodel.pads import Restraints, restrain
from pmr.fullmodel.probes import Gauge
from pmr.fullmodel.structure import Action, Coupling, PadForce, Structure, couple
from pmr.models import StructuralModel
from pmr.models.matrices import Matrices
from pmr.models.mesh_nodes import Nodes, mirrors_of
from pmr.system.body_matrices import CARRIED, DAMPING, ROTATING, Rayleigh
from pmr.system.rows import Rows

#: K and its image may be apart by this share of K x: meshes that are read have some 11 digits.
OPERATORS = 1e-10
#: Loads on carriers and their images may be apart by this share of their largest entry.
SAME = 1e-9


def mirror_images(model: StructuralModel, T: sp.csr_matrix, M: PETSc.Mat, K: PETSc.Mat) -> tuple[sp.csr_matrix, ...]:
    """Mirror images P (n, n) in the planes of symmetry across y or z, on a structure's coordinates z; collective.

    P is a signed permutation; P z is the mirror image of a motion z.

    Parameters
    ----------
    T : (n_model, n) sparse matrix
        Gives the model's coordinates q = T z.
    M, K : PETSc.Mat
        Mass and stiffness (n, n), by which symmetry is decided.

    Returns
    -------
    tuple of (n, n) sparse matrices
        The same on every rank; empty without symmetry, or if the model has no nodes or is coupled rigidly to masses.
    """
    nodes = getattr(model, "nodes", None)
    if not isinstance(nodes, Nodes) or T.nnz != T.shape[1]:  # with rigid couplings, some coordinates belong to no node
        return ()
    T_transposed = T.T.tocsr()
    on_free = [sp.csr_matrix(T_transposed @ mirror.P @ T) for mirror in mirrors_of(nodes)]
    mirrors = [P for P in on_free if P.nnz == len(P.indptr) - 1]
    for A in (M, K):
        mirrors = _commuting_images(mirrors, A)
    return tuple(mirrors)


def _commuting_images(mirrors: Sequence[sp.csr_matrix], A: PETSc.Mat) -> list[sp.csr_matrix]:
    """List the mirror images P for which A P x = P A x on random vectors x, maybe none; collective."""
    if not mirrors:
        return []
    comm, share = A.comm.tompi4py(), slice(*A.getOwnershipRange())
    x = np.random.default_rng(5).uniform(-1.0, 1.0, (A.getSize()[0], 2))
    products = times(A, np.asfortranarray(np.hstack([x, *(P @ x for P in mirrors)])[share]))
    image_of = np.concatenate(comm.allgather(products[:, :2]))
    apart = [
        np.abs(products[:, 2 * k + 2 : 2 * k + 4] - P[share] @ image_of).max(initial=0.0) for k, P in enumerate(mirrors)
    ]
    largest = np.max(comm.allgather(apart), axis=0)
    return [P for P, off in zip(mirrors, largest, strict=True) if off <= OPERATORS * np.abs(image_of).max()]


@dataclass(frozen=True)
class MirrorImage:
    """A mirror image or a product of several: the matrix P, and the number of each carrier row's image.

    Carrier rows are K rows (K, n) of which all constraint rows are combinations.
    """

    P: sp.csr_matrix  # (n, n)
    partners: Indices  # (K,): for each carrier row the number of its image; -1: none


@dataclass(frozen=True)
class LoadResponses:
    """Responses to k loads: the loads' numbers (k,), and this rank's rows (n_local, k) of the responses."""

    numbers: Indices
    columns: Array


def images_of(carriers: sp.csr_matrix, mirrors: Sequence[sp.csr_matrix]) -> list[MirrorImage]:
    """Mirror images of all `mirrors` P (n, n) and of all their products, for K carrier rows (K, n)."""
    products: list[sp.csr_matrix] = []
    for P in mirrors:
        products += [P, *(sp.csr_matrix(P @ other) for other in products)]
    return [MirrorImage(P, _partners(carriers, P)) for P in products]


def _partners(U: sp.csr_matrix, P: sp.csr_matrix) -> Indices:
    """For each row of U (K, n) the number of its image under P among the rows, or -1 if it has none."""
    V, partner_of = sp.csr_matrix(U @ P.T), np.full(U.shape[0], -1)
    size = np.asarray(U.multiply(U).sum(axis=1)).ravel()
    shared = sp.coo_matrix(V @ U.T)
    apart = size[shared.row] + size[shared.col] - 2.0 * shared.data
    order = np.lexsort((apart, shared.row))
    nearest = order[np.unique(shared.row[order], return_index=True)[1]]
    rows, partners = shared.row[nearest], shared.col[nearest]
    difference, largest = (abs(A).max(axis=1).toarray().ravel() for A in (V[rows] - U[partners], U[partners]))
    same = difference <= SAME * largest
    partner_of[rows[same]] = partners[same]
    return partner_of


class MirroredLoads:
    """Chooses loads to solve for, their `representatives`, and gives the responses to mirrored loads without a solve.

    Parameters
    ----------
    order : integer array
        Numbers of all loads.  A load that is the image of an earlier one does not become one of `representatives`.
    images : sequence of MirrorImage
        Loads with numbers below K act on the K carrier rows; other loads have no image.
    like : PETSc.Mat
        The rows of the images are spread over ranks as the rows of this matrix.
    """

    def __init__(self, order: Indices, images: Sequence[MirrorImage], like: PETSc.Mat) -> None:
        first, last = like.getOwnershipRange()
        self._mirrors = [sparse(image.P[first:last], like, columns=last - first) for image in images]
        covered, representatives = np.zeros(len(order), bool), []
        self._partners = [dict[int, int]() for _ in images]
        for load in order.tolist():
            if covered[load]:
                continue
            representatives.append(load)
            covered[load] = True
            for image, of in zip(images, self._partners, strict=True):
                partner = int(image.partners[load]) if load < len(image.partners) else -1
                if partner >= 0 and not covered[partner]:
                    covered[partner] = True
                    of[load] = partner
        self.representatives = np.array(representatives, np.int64)

    def responses(self, numbers: Indices, columns: Array) -> Iterator[LoadResponses]:
        """Yield the responses to the given loads, then the responses to each mirror image of them; collective.

        `numbers` (k,) are some of `representatives`; `columns` (n_local, k) are this rank's rows of the responses.
        """
        yield LoadResponses(numbers, columns)
        for P, of in zip(self._mirrors, self._partners, strict=True):
            at = [k for k, load in enumerate(numbers.tolist()) if load in of]
            if at:
                yield LoadResponses(np.array([of[load] for load in numbers[at].tolist()]), times(P, columns[:, at]))

    def free_images(self) -> None:
        """Free the images' memory; collective."""
        free_objects(*self._mirrors)


def structural_model(structure: Structure, comm: MPI.Comm = MPI.COMM_WORLD) -> FullModel:
    """Assemble the full model of a structure on `comm`; collective.

    Clamped coordinates are left out.  The constraint rows are those of the structure's pads.  Raises an `InputError` if
    a place does not exist, a rigid coupling shares coordinates with a clamp or another coupling, or a pad leaves its
    face.
    """
    model = structure.model
    base = operators_of(model, comm)
    coupling = couple(structure)
    attached = coupling.attached_mass()
    size = coupling.T.shape[1]
    restraints = restrain(structure.pads, model, coupling.T)
    springs = restraints.stiffness(size) + structure.pads.walls.stiffness(size)
    moving, masses = FrameAssembler(model, structure.masses, comm), masses_of(model, structure.masses, base.M)
    loads = [sp.csr_matrix((0, size)), *(coupling.load(load, base.M, moving) for load in structure.loads)]
    operators = Operators(
        _constrain_matrix(base.M, coupling.T, attached),
        _constrain_matrix(base.K, coupling.T, pad_pattern(springs, attached)),
        None if base.D is None else _constrain_matrix(base.D, coupling.T, sp.csr_matrix((size, size))),
    )
    damping, matrices = rayleigh(structure.damping), _frame_matrices(structure.matrices, coupling, moving)
    if operators.D is not None:
        damping = matrices[DAMPING] = _add_rayleigh(operators, damping)
    of_pads = [isinstance(output, PadForce) for output in structure.outputs]
    places = coupling.rows([output for output in structure.outputs if not isinstance(output, PadForce)])
    forces = [restraints.force(output.pad, size) for output in structure.outputs if isinstance(output, PadForce)]
    outputs = sp.vstack([places, *forces], format="csr")[np.argsort(np.argsort(of_pads, kind="stable"))]
    return FullModel(
        operators.M,
        damping,
        operators.K,
        inputs=columns(operators.M, sp.vstack(loads, format="csr")),
        outputs=columns(operators.M, outputs),
        rows=Rows(restraints.rows, size),
        input_names=tuple(load.name for load in structure.loads),
        output_positions=np.array([_position(output, structure) for output in structure.outputs]),
        output_names=tuple(output.name for output in structure.outputs),
        output_units=tuple(output.unit for output in structure.outputs),
        output_kinds=tuple(output.kind for output in structure.outputs),
        reference_frequency=model.reference_frequency,
        rigid=_rigid_motions(coupling, restraints, operators.K, _inner_supports(model)),
        node_stations=model.node_stations,
        mirrors=mirror_images(model, coupling.T, operators.M, operators.K),
        ports={port.name: coupling.rows([port]) for port in structure.ports},
        matrices=matrices,
        masses=masses,
    )


def _add_rayleigh(operators: Operators, law: Rayleigh) -> PETSc.Mat:
    """Damping D + alpha M + beta K of a structure whose model has a damping D of its own, in place of D; collective."""
    assert operators.D is not None
    for factor, A in ((law.alpha, operators.M), (law.beta, operators.K)):
        if factor:
            operators.D.axpy(factor, A, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    return operators.D


def _frame_matrices(names: Sequence[str], coupling: Coupling, moving: FrameAssembler) -> dict[str, PETSc.Mat]:
    """Matrices of a moving frame and of axial forces, by name; matrices that are zero are left out.  Collective.

    Walls that give way under pads add nothing to the matrices: their dents are small, and so is their mass.
    """
    tensors, nothing = ROTATING | CARRIED, sp.csr_matrix((coupling.T.shape[1],) * 2)
    matrices = dict[str, PETSc.Mat]()
    for name in names:
        if name in tensors:
            of_model, attached = moving.inertia(tensors[name]), coupling.attached_inertia(tensors[name])
        else:
            of_model, attached = moving.geometric_stiffness(name), nothing
        matrix = _constrain_matrix(of_model, coupling.T, attached)
        if matrix.norm(PETSc.NormType.NORM_INFINITY) > 0.0:
            matrices[name] = matrix
        else:
            free_objects(matrix)
    moving.free_factor()
    return matrices


def _inner_supports(model: StructuralModel) -> Array:
    """Measures (h, k) of the k rigid motions by supports inside given matrices; no rows for other models."""
    return model.body_matrices.held if isinstance(model, Matrices) else np.empty((0, len(model.directions)))


def _rigid_motions(coupling: Coupling, restraints: Restraints, K: PETSc.Mat, inner_supports: Array) -> RigidMotions:
    """Rigid motions of a structure, and what clamps, springs and inner supports measure of them; collective.

    `inner_supports` (h, k) are from `_inner_supports`.  A spring weaker than the round-off in K is left out.
    """
    size = coupling.T.shape[1]
    lost = size * np.finfo(float).eps * np.concatenate(K.comm.tompi4py().allgather(K.getDiagonal().getArray()))
    springs = [
        np.asarray(c @ coupling.rigid)
        for c, spring in zip(restraints.spring_rows(size), restraints.springs, strict=True)
        if np.any(c.toarray()[0] ** 2 > spring.compliance * lost)
    ]
    of_rank = coupling.rigid[slice(*K.getOwnershipRange())].copy()
    held = np.vstack([coupling.clamped, inner_supports, *springs])
    return RigidMotions(of_rank, held, complete=not len(coupling.clamped) and not len(inner_supports))


def _constrain_matrix(A: PETSc.Mat, T: sp.csr_matrix, addition: sp.csr_matrix) -> PETSc.Mat:
    """Sum T^T A T + `addition`, of which each rank owns consecutive rows; collective.

    A is freed if the sum is another matrix.  Zeros of `addition` keep their place in the pattern.  If T only leaves
    coordinates out, rows and columns are selected without a product.
    """
    first, last = A.getOwnershipRange()
    low, high = share(T.shape[1], A.comm.tompi4py())
    if not _only_selects(T):
        P = sparse(T[first:last], A, columns=int(high - low))
        result = project_matrix(A, P)
        free_objects(P)
    elif T.shape[0] > T.shape[1]:
        result = _submatrix(A, np.flatnonzero(np.diff(T.indptr))[low:high])
    else:
        result = A
    if addition.nnz:
        more = sparse(addition[low:high], result, columns=int(high - low))
        result.axpy(1.0, more, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        free_objects(more)
    return result


def _submatrix(A: PETSc.Mat, numbers: Indices) -> PETSc.Mat:
    """Matrix of some rows of A and the columns of the same numbers; frees A.  Collective.

    `numbers` are those rows that this rank will own.
    """
    chosen = PETSc.IS().createGeneral(numbers.astype(PETSc.IntType), comm=A.comm)
    result = A.createSubMatrix(chosen, chosen)
    free_objects(A, chosen)
    return result


def _only_selects(T: sp.csr_matrix) -> bool:
    """Whether T z consists of the coordinates z in their order, with zeros between them.

    The number of entries does not decide: T of a rigid mass on a single node has as many, in other places and with
    other signs.
    """
    T = T.tocoo()
    order = np.argsort(T.row, kind="stable")
    return T.nnz == T.shape[1] and bool(np.all(T.data == 1.0) and np.all(T.col[order] == np.arange(T.nnz)))


def _position(output: Action | PadForce | Gauge, structure: Structure) -> float:
    """Coordinate along the axis in m at which an output is measured."""
    if isinstance(output, Gauge):
        return float(output.at[0])
    if isinstance(output, Action):
        return float(structure.model.centroid(output.on)[0])
    places = {pad.name: pad.at for pad in structure.pads.fixed}
    places |= {support.name: float(structure.model.centroid(support.on)[0]) for support in structure.pads.supports}
    return places[output.pad]
