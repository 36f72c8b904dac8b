r"""The full model of a body and the system of several: matrices, constraint rows, masses, and slices of coordinates.

`Operators` are mass, stiffness and damping of a structural model.  The full model holds them with inputs, outputs and
constraint rows, spread over MPI ranks.  The system of full models says where the coordinates of each body are in
vectors of all coordinates.

The mass m and the centre of gravity :math:`(\bar x, \bar y, \bar z)` of a body follow from its mass matrix M and the
coordinates of its rigid motions: r_x, r_y, r_z under unit translations along the axes, and :math:`r_{\theta x}`,
:math:`r_{\theta y}`, :math:`r_{\theta z}` under unit rotations about them:

.. math:: m = r_x^T M r_x, \qquad m\, \bar x = r_y^T M r_{\theta z}, \quad m\, \bar y = r_z^T M r_{\theta x}, \quad
    m\, \bar z = r_x^T M r_{\theta y}
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, reduce
from typing import Any

import numpy as np
import scipy.sparse as sp

from pmr.fem.compat import MPI, PETSc, comm_of
from pmr.fem.distributed import free_dropped, free_objects, gather, share
from pmr.files.arrays import Array
from pmr.models import FiniteElementModel, StructuralModel, is_assembled
from pmr.models.matrices import Matrices
from pmr.models.meshed import Assembler
from pmr.models.mover import Mover
from pmr.scene import Damping
from pmr.scene.keys import ALONE, input_name
from pmr.scene.structures import PointMass
from pmr.system.body import FullBody, FullOrderBody
from pmr.system.body_matrices import Rayleigh
from pmr.system.contacts import Contact, Place
from pmr.system.rows import Row, SharedCarriers
from pmr.system.system import BodySystem, System, consecutive, ground_contacts
from pmr.system.terms import Term

#: Share of the largest coordinate of a centre of gravity up to which another one is round-off.
ROUND_OFF = 1e-12
#: For each first moment along x, y and z: translation and rotation whose product contains it, and its sign there.
MOMENTS = ((("y", "rz", 1.0), ("z", "ry", -1.0)), (("z", "rx", 1.0),), (("x", "ry", 1.0),))


@dataclass(frozen=True)
class Masses:
    """Mass of a body, mass of what is attached to the body, and the centre of gravity of both together."""

    body: float  # kg
    attached: float  # kg
    centre: Array  # (3,) m: centre of gravity of both, in the body's axes

    def summary(self) -> dict[str, Any]:
        """Entry for summary.json: ``mass`` of the body and ``attached`` mass in kg, ``centre`` of gravity in m."""
        return {"mass": self.body, "attached": self.attached, "centre": self.centre.tolist()}


def masses_of(model: StructuralModel, point_masses: Sequence[PointMass], M: PETSc.Mat) -> Masses | None:
    """Mass and centre of gravity of a `model` with the mass matrix M, and of its `point_masses`; collective.

    M has neither the `point_masses` nor any clamps.  None is returned for given matrices: supports inside them would
    falsify the mass.  The model's own centre of gravity counts as 0 in a direction that its motions do not show, such
    as y for a planar beam.
    """
    if not is_assembled(model) and not isinstance(model, Mover):
        return None
    directions, G = model.directions, _gram_matrix(model.rigid_motions(), M)
    mass_of_model = max(float(G[k, k]) for k, direction in enumerate(directions) if direction in "xyz")
    moments = np.zeros(3)
    for axis, options in enumerate(MOMENTS):
        for along, about, sign in options:
            if along in directions and about in directions:
                moments[axis] = sign * G[directions.index(along), directions.index(about)]
                break
    for mass in point_masses:
        moments += mass.mass * np.array(model.centroid(mass.on) if mass.at is None else mass.at)
    carried = float(sum(mass.mass for mass in point_masses))
    centre = moments / (mass_of_model + carried)
    centre[np.abs(centre) <= ROUND_OFF * np.abs(centre).max()] = 0.0
    return Masses(mass_of_model, carried, centre)


def _gram_matrix(R: Array, M: PETSc.Mat) -> Array:
    """Product R^T M R (k, k) for k motions R (n, k); every rank passes all rows of R.  Collective."""
    x, f = M.createVecRight(), M.createVecLeft()
    mine, columns = R[slice(*M.getOwnershipRange())], []
    for motion in mine.T:
        x.getArray()[:] = motion
        M.mult(x, f)
        columns.append(mine.T @ f.getArray())
    free_objects(x, f)
    product = np.column_stack(columns)
    M.comm.tompi4py().Allreduce(MPI.IN_PLACE, product)
    return product


@dataclass(frozen=True)
class RigidMotions:
    """Rigid motions of a body, from its geometry alone, and the values that its clamps and springs take under them."""

    # (n_local, k): this rank's free coordinates under each of k unit motions, translations first
    coordinates: Array
    # (h, k) m or rad: what clamps and springs measure of each motion, which is free if its column is zero
    held_measures: Array
    complete: bool = True  # False with clamped coordinates, on which the model has no loads, or with inner supports


@dataclass(frozen=True)
class FullModel(FullOrderBody):
    r"""Full model of a body, with operators distributed over `comm`, in SI units.

    The coordinates q (n,) follow the inputs f (i,) and the path coordinate s by

    .. math:: M \ddot q + D \dot q + K q + C(s)^T \lambda = B f, \qquad C(s)\, q = 0, \qquad y = O q

    with the mass M, damping D and stiffness K, the constraint rows C(s) and their multipliers :math:`\lambda`, the
    input matrix B, and the outputs y (o,).  Coordinates are numbered from the mesh alone, in serial and parallel runs
    alike.
    """

    M: PETSc.Mat  # (n, n), without boundary conditions; each rank owns consecutive rows
    damping: PETSc.Mat | Rayleigh  # D (n, n), or the factors from which `D` is made at first use
    K: PETSc.Mat  # (n, n); its pattern contains that of M
    B: PETSc.Mat  # (n, i): one column for each load
    outputs: PETSc.Mat  # O^T (n, o): one column for each output
    reference_frequency: float  # rad/s: scale of the lowest frequencies, by which eigensolvers shift
    # None: unknown; such a model can be simulated, but not be reduced to free modes
    rigid: RigidMotions | None = None
    # (n, n): matrices of a moving frame and of axial forces, by the names of `pmr.system.body_matrices`; zero ones
    # are left out.  D is one of them if it is not Rayleigh's
    matrices: Mapping[str, PETSc.Mat] = field(default_factory=dict)
    masses: Masses | None = None  # None for given matrices

    @property
    def rayleigh(self) -> Rayleigh | None:
        """Factors of Rayleigh damping; None if the damping is given as a matrix."""
        return self.damping if isinstance(self.damping, Rayleigh) else None

    @cached_property
    def D(self) -> PETSc.Mat:
        """Damping matrix (n, n); collective.

        Rayleigh damping is assembled when it is first used, with entries where K has them.  A damping matrix that was
        passed in is returned as it is.
        """
        if self.rayleigh is None:
            return self.damping
        D = self.K.duplicate(copy=True)
        D.scale(self.rayleigh.beta)
        D.axpy(self.rayleigh.alpha, self.M, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        return D

    @property
    def comm(self) -> Any:
        """MPI communicator (mpi4py) over which the model is distributed."""
        return self.M.comm.tompi4py()

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return int(self.M.getSize()[0])

    @property
    def carriers(self) -> SharedCarriers:
        """Constraint rows of the body, as weights on carrier rows that they share (`pmr.system.carriers`)."""
        return self.rows.shared_carriers

    @property
    def share(self) -> slice:
        """Slice of the coordinates, and so of the rows of the matrices, that this rank owns."""
        return slice(*self.M.getOwnershipRange())

    def gather(self) -> FullBody | None:
        """Return this model with matrices of SciPy on rank 0, and None on other ranks; collective.

        B is an array of NumPy, and the outputs are the matrix O (o, n).
        """
        parts = [gather(A) for A in (self.M, self.D, self.K, self.B, self.outputs)]
        matrices = {name: gather(A) for name, A in self.matrices.items()}
        if self.comm.rank != 0:
            return None
        M, D, K, B, outputs = parts
        assert M is not None and D is not None and K is not None and B is not None and outputs is not None
        common = {of.name: getattr(self, of.name) for of in fields(FullOrderBody)}
        on_first_rank = {name: A for name, A in matrices.items() if A is not None}
        return FullBody(M, D, K, B.toarray(), outputs.T.tocsr(), self.rayleigh, on_first_rank, **common)


@dataclass(frozen=True)
class FullSystem(BodySystem[FullModel]):
    """Full models of several bodies on one communicator, and the contacts between the bodies.

    A local vector holds this rank's coordinates of the first body, then those of the second, and so on.  A whole vector
    holds all coordinates of the bodies in the same order.  Supports that hold a single coordinate are not among the
    contacts (see `with_supports`).
    """

    @classmethod
    def of(cls, model: FullModel) -> FullSystem:
        """System of a single body, with the rows of its model as contacts with the ground.

        Rows of supports that hold a single coordinate are left out.
        """
        return cls({ALONE: model}, ground_contacts(model))

    @property
    def models(self) -> tuple[FullModel, ...]:
        """Full models of the bodies, in their order."""
        return tuple(self.bodies.values())

    @property
    def comm(self) -> Any:
        """MPI communicator of all bodies."""
        return self.models[0].comm

    @property
    def size(self) -> int:
        """Number n of coordinates of all bodies, with the coordinates that supports hold."""
        return sum(model.size for model in self.models)

    @cached_property
    def local_slices(self) -> tuple[slice, ...]:
        """Slice of each body's coordinates in a local vector."""
        return consecutive([model.M.getLocalSize()[0] for model in self.models])

    @cached_property
    def whole_slices(self) -> tuple[slice, ...]:
        """Slice of each body's coordinates in a whole vector."""
        return consecutive([model.size for model in self.models])

    @cached_property
    def input_slices(self) -> tuple[slice, ...]:
        """Slice of each body's inputs among the `input_names` of the system."""
        return consecutive([len(model.input_names) for model in self.models])

    @cached_property
    def output_slices(self) -> tuple[slice, ...]:
        """Slice of each body's outputs among the outputs of the system."""
        return consecutive([model.outputs.getSize()[1] for model in self.models])

    def local_part(self, complete: Array) -> Array:
        """This rank's coordinates (..., n_local) of the whole vectors `complete` (..., n)."""
        parts = zip(self.whole_slices, self.models, strict=True)
        return np.concatenate([complete[..., at][..., model.share] for at, model in parts], axis=-1)

    def gather_vectors(self, local: Array) -> Any:
        """Whole vectors (k, n) on rank 0 from k local vectors `local` (k, n_local); collective.

        Other ranks get their own `local` back.
        """
        parts = [self.comm.gather(local[:, at]) for at in self.local_slices]
        return np.concatenate([np.concatenate(part, 1) for part in parts], 1) if self.comm.rank == 0 else local

    def with_supports(self) -> FullSystem:
        """System in which each support of a single coordinate is also a contact with the ground.

        The added contacts come after all others.  A support is skipped if a contact uses its row already.
        """
        used = {(side.place.body, side.place.row) for side in self.sides}
        held = [
            Contact(input_name(name, row), Place(name, row, model.rows.rows[number].breaks[0]))
            for name, model in self.bodies.items()
            for number, row in ((number, model.row_names[number]) for number in model.held)
            if (name, row) not in used
        ]
        return replace(self, contacts=(*self.contacts, *held))

    def gather(self) -> System | None:
        """Return this system with matrices of SciPy on rank 0, and None on other ranks; collective.

        Bodies that share one full model share its result.
        """
        gathered: dict[int, FullBody | None] = {}
        for model in self.models:
            if id(model) not in gathered:
                gathered[id(model)] = model.gather()
        bodies = {name: body for name, model in self.bodies.items() if (body := gathered[id(model)]) is not None}
        terms = tuple(self._gather_term(term) for term in self.terms)
        return System(bodies, self.contacts, terms=terms, hoist=self.hoist) if bodies else None

    def _gather_term(self, term: Term) -> Term:
        """Return the `term` with SciPy matrices on rank 0, and unchanged on other ranks; collective."""
        on_first_rank: dict[str, Any] = {
            key: A if sp.issparse(A) or isinstance(A, np.ndarray) else gather(A) for key, A in term.matrices.items()
        }
        return replace(term, **on_first_rank) if self.comm.rank == 0 else term

    @cached_property
    def side_rows(self) -> tuple[Row, ...]:
        """Constraint row of each side of the contacts (`sides`), on the carrier rows of the side's body."""
        return tuple(self.row(side.place) for side in self.sides)


@dataclass(frozen=True)
class Operators:
    """Mass M, stiffness K and damping D (n, n) of a model with n coordinates; each rank owns consecutive rows of all.

    K has an entry wherever M or D has one.  M lacks some entries of K: in a shell five of six entries of K.
    """

    M: PETSc.Mat
    K: PETSc.Mat
    D: PETSc.Mat | None = None  # None: the model has no damping of its own


def rayleigh(damping: Damping) -> Rayleigh:
    """Rayleigh damping D = a M + b K with the factors of a scene's table: a in 1/s is `mass`, b in s is `stiffness`."""
    return Rayleigh(damping.mass, damping.stiffness)


def operators_of(model: StructuralModel, comm: MPI.Comm) -> Operators:
    """Mass, stiffness and damping of a model, assembled from its weak forms or as given by matrices; collective.

    Only given matrices may have a damping here; Rayleigh's is added later.
    """
    if is_assembled(model):
        return assemble_model(model, model.domain(comm))
    assert isinstance(model, Matrices | Mover)
    body_matrices = model if isinstance(model, Mover) else model.body_matrices
    damping = [model.body_matrices.D] if isinstance(model, Matrices) and model.body_matrices.D is not None else []
    first, last = share(model.size, comm)
    sizes = (int(last - first), model.size)
    matrices = []
    for A in (body_matrices.M, reduce(pad_pattern, (body_matrices.M, *damping), body_matrices.K), *damping):
        share_of_rank = A[first:last].sorted_indices()
        parts = (
            share_of_rank.indptr.astype(PETSc.IntType),
            share_of_rank.indices.astype(PETSc.IntType),
            share_of_rank.data,
        )
        matrices.append(PETSc.Mat().createAIJ((sizes, sizes), csr=parts, comm=comm))
        matrices[-1].assemble()
    return Operators(*matrices)


def pad_pattern(A: sp.csr_matrix, other: sp.csr_matrix) -> sp.csr_matrix:
    """Copy (n, n) of A with stored zeros where only `other` (n, n) has entries; the copy has the patterns of both."""
    A, other = A.tocoo(), other.tocoo()
    entries = np.concatenate([A.data, np.zeros(other.nnz)])
    places = np.concatenate([A.row, other.row]), np.concatenate([A.col, other.col])
    return sp.csr_matrix((entries, places), shape=A.shape)


def assemble_model(model: FiniteElementModel, domain: object) -> Operators:
    """Assemble mass and stiffness of a model on its distributed mesh `domain`, without boundary conditions; collective.

    The function also frees the PETSc objects of earlier models that Python has dropped, which PETSc keeps until it is
    asked to free them.
    """
    free_dropped(comm_of(domain), cycles=False)
    assembler = Assembler(model, domain)
    forms = model.forms(assembler.space)
    return Operators(assembler.matrix(forms.mass, zeros=False), assembler.matrix(forms.stiffness))
