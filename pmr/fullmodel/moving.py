r"""Static solves, and what a moving frame, its luffing cylinder and axial forces add to a structural model.

u and v are the displacements of trial and test function, rho is the density.  S (3, 3) is one of the tensors in
`pmr.system.body_matrices`, R_c are the model's coordinates under the unit rigid motion along or about direction c,
which every model represents exactly, and sigma are the stresses of a unit state (docs/moving_frame_theory.md).  On the
model's own coordinates the matrices and loads are

.. math::
    A_S = \int \rho\, v \cdot S u \, dV, \qquad f_S = A_S R_c, \qquad
    K_g = \int \sigma_{jk}\, u_{i,j} v_{i,k} \, dV

Static solves take one factor: by MUMPS of the distributed stiffness, or by LAPACK on rank 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.interpolate import BPoly, PPoly

from pmr.errors import InputError
from pmr.fem.compat import MPI, PETSc, compiled_form, constant
from pmr.fem.distributed import free_objects, gather, share, sparse, times
from pmr.fem.factor import NotDefiniteError, factor_for_columns
from pmr.files.arrays import Array
from pmr.fullmodel.eigensolvers import DENSE_UP_TO, Elimination, eliminate, is_dense
from pmr.fullmodel.model import FullModel
from pmr.models import StructuralModel, UnitState, is_assembled
from pmr.models.meshed import Assembler
from pmr.scene.cylinder import LuffingCylinder
from pmr.scene.keys import LUFFING_CYLINDER
from pmr.scene.structures import PointMass
from pmr.system.body_matrices import CONSTANT, LINEAR, STATES
from pmr.system.rows import Row, Rows

if TYPE_CHECKING:
    from pmr.fem.compat import Expr, Function


class SingularError(InputError):
    """A stiffness does not resist some motion although all rigid motions are held, or has a negative eigenvalue."""

    def __init__(self) -> None:
        """Compose the message, which needs no arguments."""
        allowed = (
            "a stiffness that resists all but rigid motions is allowed: on the supports, which hold these, it is "
            "singular; parts of the body are loose, or its matrix has negative eigenvalues, by rounding or by itself"
        )
        super().__init__("scene", "body", None, allowed)


def static_solver(model: FullModel, held_rows: Sequence[Row], choice: str) -> StaticSolver:
    """Static solver of a model with the rows `held_rows` held, which must leave no rigid motion free; collective.

    The rows are held rigidly, at the first path coordinate at which all of them are defined, even if they have a
    compliance.  `choice` is ``"dense"``, ``"slepc"`` (MUMPS) or ``"auto"``, as for the eigenmodes.

    Raises
    ------
    SingularError
        If the held rows leave a rigid motion free, or the stiffness does not resist another motion.
    DependentRowsError
        If the held rows depend on each other.
    InputError
        If the factor takes more memory than is free.
    """
    rows = Rows(tuple(held_rows), model.size)
    elimination = eliminate(rows.at(rows.domain[0]) if held_rows else rows.at(0.0), rows.names)
    return solver_of(model.K, elimination, is_dense(model, choice))


def solver_of(K: PETSc.Mat, elimination: Elimination, dense: bool) -> StaticSolver:
    """Static solver of a stiffness K (n, n): by LAPACK if `dense`, else by a sparse factor; collective.

    `elimination` says which coordinates remain after the held ones are eliminated.  Raises a `SingularError` if the
    stiffness on the remaining coordinates is not positive definite.
    """
    return (_DenseSolver if dense else _SparseSolver)(K, elimination)


class _DenseSolver:
    """Static solver with a dense factor by LAPACK on rank 0."""

    def __init__(self, stiffness: PETSc.Mat, elimination: Elimination) -> None:
        """Factorise the `stiffness` (n, n) on rank 0, on the coordinates that `elimination` leaves free; collective.

        Raises a `SingularError` on all ranks if the matrix is not positive definite.
        """
        self._comm, self._share = stiffness.comm.tompi4py(), slice(*stiffness.getOwnershipRange())
        self._T = elimination.to_scipy()
        K, failed = gather(stiffness), False
        if K is not None:
            try:
                self._factor = scipy.linalg.cho_factor((self._T.T @ K @ self._T).toarray(), lower=True)
            except np.linalg.LinAlgError:
                failed = True
        if self._comm.bcast(failed):
            raise SingularError()

    def solve(self, g: Array) -> Array:
        """This rank's rows (n_local, k) of k solutions x, for its rows `g` (n_local, k) of the loads; collective."""
        shares, x = self._comm.gather(g), None
        if shares is not None:
            free = self._T.T @ np.concatenate(shares)  # no row of a body that the held rows hold altogether
            x = self._T @ (scipy.linalg.cho_solve(self._factor, free) if len(free) else free)
        return np.ascontiguousarray(self._comm.bcast(x)[self._share])

    def destroy(self) -> None:
        """Free the factor's memory."""
        self.__dict__.pop("_factor", None)


class _SparseSolver:
    """Static solver by a sparse factor that is spread over the ranks, or complete on each of them."""

    def __init__(self, stiffness: PETSc.Mat, elimination: Elimination) -> None:
        """Factorise the `stiffness` (n, n) on the coordinates that `elimination` leaves free; collective.

        Raises a `SingularError` if the matrix is not positive definite.
        """
        self._T = elimination.to_petsc(stiffness)
        K, rows = stiffness.PtAP(self._T), elimination.to_scipy().T.tocsr()
        self._T_transposed = sparse(rows[slice(*K.getOwnershipRange())], K, columns=stiffness.getLocalSize()[0])
        try:
            self._factor = factor_for_columns(K, "stiffness")
        except NotDefiniteError:
            raise SingularError() from None
        finally:
            free_objects(K)

    def solve(self, g: Array) -> Array:
        """This rank's rows (n_local, k) of k solutions x, for its rows `g` (n_local, k) of the loads; collective."""
        return times(self._T, self._factor.solve_columns(times(self._T_transposed, g)))

    def destroy(self) -> None:
        """Free the memory of the factor and of T; collective."""
        self._factor.destroy()
        free_objects(self._T, self._T_transposed)


#: Solves x = T (T^T K T)^-1 T^T g for loads g with the stiffness K; T spans the motions that held rows allow.
StaticSolver = _DenseSolver | _SparseSolver


class FrameAssembler:
    """Assembles matrices and loads of a moving frame for a model; the model's function space is made at first use.

    u and v are the displacements of trial and test function.  For a tensor S (3, 3) the matrix A_S is the integral of
    rho v . S u over the volume, and the load f_S is A_S times the coordinates of a rigid motion.  The geometric
    stiffness K_g is the integral of sigma_jk u_i,j v_i,k with the stresses sigma of a unit state.  `masses` are point
    masses attached to the model.
    """

    def __init__(self, model: StructuralModel, masses: Sequence[PointMass], comm: MPI.Comm) -> None:
        self._model, self._masses, self._comm = model, masses, comm
        self._single_inertias = dict[tuple[int, int], PETSc.Mat]()  # matrices A_jk (n, n) of `inertia`, by j and k
        self._rigid_loads = dict[bytes, Array]()  # loads A_S R (n, k) on the k rigid motions R, by the bytes of S

    @cached_property
    def _assembler(self) -> Assembler:
        """Assembler of the model's forms; collective.

        Raises an `InputError` if the model is given as matrices.
        """
        if not is_assembled(self._model):
            allowed = "a model with a mesh is allowed in a moving frame and with second order: matrices from a file "
            raise InputError("scene", "body.model", "matrices", allowed + "do not say where their mass and stress are")
        return Assembler(self._model, self._model.domain(self._comm))

    def inertia(self, S: Array) -> PETSc.Mat:
        """Matrix A_S (n, n) of the model without point masses, for a tensor S (3, 3) other than zero; collective.

        The matrix is the sum of S_jk A_jk.  A_jk belongs to the tensor whose single entry, 1, is in row j and column k.
        As A_jk is the transpose of A_kj, only matrices with j <= k are assembled, each at most once.
        """
        parts = []
        for j, k in np.argwhere(S).tolist():
            A = self._single_inertia(min(j, k), max(j, k))
            parts.append(A.copy() if j <= k else A.transpose(PETSc.Mat()))
            parts[-1].scale(S[j, k])
        for part in parts[1:]:
            parts[0].axpy(1.0, part, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        free_objects(*parts[1:])
        return parts[0]

    def _single_inertia(self, j: int, k: int) -> PETSc.Mat:
        """Matrix A_jk (n, n) of `inertia`, for j <= k; assembled at the first call and stored.  Collective."""
        if (j, k) not in self._single_inertias:
            tensor, form = self._inertia_form
            tensor.value = np.outer(np.eye(3)[j], np.eye(3)[k])
            self._single_inertias[j, k] = self._assembler.assemble_form(form, zeros=False)
        return self._single_inertias[j, k]

    @cached_property
    def _inertia_form(self) -> tuple[Expr, ...]:
        """Tensor S (3, 3) as a UFL constant with a changeable value, and the form of A_S, compiled once; collective."""
        space = self._assembler.space
        tensor = constant(space.mesh, np.zeros((3, 3)))
        return tensor, compiled_form(self._assembler.model.inertia(space, tensor))

    def acceleration_load(self, name: str) -> Array:
        """Load f_S (n,) on all n coordinates by a unit acceleration field, the input `name`; collective.

        The field is a tensor S applied to a rigid motion u, and the load is the inertia with S times u
        (`acceleration_field`).  `name` is a key of `CONSTANT` or `LINEAR`.  The load is zero if the model has no such
        motion.  Point masses are left out.  Every rank has all entries.
        """
        S, motion = acceleration_field(name, self._model)
        if not S.any():
            return np.zeros(self._model.size)
        if (key := S.tobytes()) not in self._rigid_loads:  # several inputs have the same tensor
            A = self.inertia(S)
            forces = times(A, self._model.rigid_motions()[slice(*A.getOwnershipRange())])
            free_objects(A)
            self._rigid_loads[key] = np.concatenate(self._comm.allgather(forces))
        return self._rigid_loads[key] @ motion

    def geometric_stiffness(self, name: str) -> PETSc.Mat:
        """Geometric stiffness K_g (n, n) of the model under the unit load `name` (a key of `STATES`); collective.

        The unit load is an acceleration of the frame or a force of 1 N at the tip of the model, which is held at its
        tail.  The load by an acceleration includes the inertia of the point masses.
        """
        load, x = STATES[name], np.eye(3)[0]
        forces = [(m.on, -m.mass * (load.acceleration + load.stretch * self._station(m) * x)) for m in self._masses]
        state = UnitState(load.acceleration, load.stretch, (*forces, ("tip", load.force)), self.displacement)
        form = self._assembler.model.geometric_stiffness(self._assembler.space, state)
        return self._assembler.matrix(form, zeros=False)

    def _station(self, mass: PointMass) -> float:
        """Coordinate of a point mass along the axis of the model in m."""
        return float(self._model.centroid(mass.on)[0] if mass.at is None else mass.at[0])

    def displacement(self, state: UnitState) -> Function:
        """Displacement under the loads of `state` with the tail clamped, as a function on the model's function space.

        Collective.
        """
        model, comm, load = self._model, self._comm, np.zeros(self._model.size)
        fields = dict(zip(CONSTANT, state.acceleration, strict=True)) | {"inertia xx": state.stretch}
        for name, factor in fields.items():
            if factor != 0.0:
                load -= factor * self.acceleration_load(name)
        for place, force in state.forces:
            load += model.displacement(place).T @ force
        displacement_of_rank = self._clamped_solver.solve(
            np.asfortranarray(load[slice(*share(model.size, comm)), None])
        )
        return self._assembler.displacement_function(np.concatenate(comm.allgather(displacement_of_rank[:, 0])))

    @cached_property
    def _clamped_solver(self) -> StaticSolver:
        """Static solver of the model with its tail clamped, the same for all states; collective."""
        model = self._assembler.model
        clamped = model.coordinates_on("tail", model.directions)
        elimination = Elimination(model.size, clamped, np.empty(0, np.int64), np.zeros((len(clamped), 0)))
        K = self._assembler.matrix(model.forms(self._assembler.space).stiffness)
        solver = solver_of(K, elimination, model.size <= DENSE_UP_TO)
        free_objects(K)
        return solver

    def free_memory(self) -> None:
        """Free the memory of the static solver if one was made, and of matrices; collective."""
        free_objects(*self._single_inertias.values())
        self._single_inertias.clear()
        if "_clamped_solver" in self.__dict__:
            self._clamped_solver.destroy()
            del self._clamped_solver


class AccelerationField(NamedTuple):
    """Tensor S (3, 3) and rigid motion (k,) that give an acceleration field."""

    tensor: Array
    motion: Array


def acceleration_field(name: str, model: StructuralModel) -> AccelerationField:
    """Tensor S (3, 3) and rigid motion (k,) that give the acceleration field `name`, a key of `CONSTANT` or `LINEAR`.

    The field at a point is S times the displacement vector of the rigid motion there.  S has a single entry, which is
    1.  The motion is 1 or -1 along or about one of the k directions of the model.  If the model has none of the
    directions whose rigid motion could give the field, both results are zero.
    """
    for S, along in (CONSTANT | LINEAR)[name]:
        if along in model.directions:
            return AccelerationField(np.abs(S), S.sum() * (np.array(model.directions) == along))
    return AccelerationField(np.zeros((3, 3)), np.zeros(len(model.directions)))


#: Intervals of a turn to begin with; error of a direction between two breaks; shortest interval, in rad.
INTERVALS, ACCURACY, SHORTEST = 16, 1e-9, 1e-3


def cylinder_row(
    cylinder: LuffingCylinder,
    tail: tuple[float, float, float],
    model: StructuralModel,
    T: sp.csr_matrix,
    travel: tuple[float, float],
) -> Row:
    r"""Constraint row of a luffing cylinder that holds a base, for all luffing angles from -pi to pi.

    The row measures the cylinder's elongation as a function of the luffing angle.  The cylinder goes from the foot on
    the machine to the lug on the boom.  At the luffing angle :math:`\varphi` the unit vector from foot to lug, in the
    boom's axes, is :math:`d(\varphi)`.  The section of the boom at the lug is displaced by u and turns by
    :math:`\theta`, and the lug is the height z above the boom's axis.  The cylinder gets longer by

    .. math:: c(\varphi)\, q = d_x(\varphi)\, (u_x + z\, \theta_y) + d_z(\varphi)\, u_z

    with the row c on the coordinates q of the boom.  Between two breaks d is the polynomial of fifth degree that has
    the exact values and first two derivatives at both.  A cylinder without a stiffness is rigid.

    Parameters
    ----------
    tail : (3,) m
        Position of the base's tail relative to the pivot.
    model : StructuralModel
        Model of the base, with n coordinates q.
    T : (n, n') sparse matrix
        Gives q = T z from the n' coordinates z on which the row acts.
    travel : (2,) m
        Range of the path coordinate on which the other rows of the body are defined.  The angles -pi to pi are mapped
        linearly to this range, so that the breaks of the row are path coordinates in m.
    """
    place, z = cylinder.lug[0] - tail[0], cylinder.lug[1] - tail[2]
    along = model.displacement(place)
    turned = model.motion(place)[model.directions.index("ry")]
    measured = [z * turned, along[model.directions.index("z")]]
    if "x" in model.directions:
        measured[0] = measured[0] + along[model.directions.index("x")]
    directions = direction_polynomial(cylinder)
    low, high = travel
    breaks = low + (high - low) * (directions.x + np.pi) / (2.0 * np.pi)
    scale = (2.0 * np.pi / (high - low)) ** np.arange(5, -1, -1)
    return Row(
        LUFFING_CYLINDER,
        breaks,
        sp.csr_matrix(sp.vstack(measured) @ T),
        np.tile([0, 1], (len(breaks) - 1, 1)),
        directions.c * scale[:, None, None],
        0.0 if cylinder.stiffness is None else 1.0 / cylinder.stiffness,
    )


def direction_polynomial(cylinder: LuffingCylinder) -> PPoly:
    """Piecewise polynomial of the unit vector (2,) from a cylinder's foot to its lug, along x and z in the boom's axes.

    Its argument is the luffing angle in rad from -pi to pi.  An interval is halved until the error in it is at most
    `ACCURACY`, or its length at most `SHORTEST`.
    """
    breaks = np.linspace(-np.pi, np.pi, INTERVALS + 1)
    while True:
        polynomial = BPoly.from_derivatives(breaks, _direction_derivatives(cylinder, breaks))
        halves = (breaks[1:] + breaks[:-1]) / 2.0
        quarters = (halves + breaks[:-1]) / 2.0
        off = np.maximum(*(np.abs(polynomial(x) - cylinder.direction(x)).max(axis=1) for x in (halves, quarters)))
        coarse = (off > ACCURACY) & (np.diff(breaks) > SHORTEST)
        if not coarse.any():
            return PPoly.from_bernstein_basis(polynomial)
        breaks = np.sort(np.concatenate([breaks, halves[coarse]]))


def _direction_derivatives(cylinder: LuffingCylinder, angle: Array) -> Array:
    r"""Unit vector from a cylinder's foot to its lug and its first two derivatives by the luffing angle, (n, 3, 2).

    The second axis has the vector, its first and its second derivative, the last axis their components along x and z.
    `angle` (n,) are the luffing angles in rad.  With the foot :math:`r_0` and the lug :math:`r_1` as complex numbers x
    + i z, and the luffing angle :math:`\varphi`, the unit vector is :math:`e^{i \beta}` with :math:`\beta = \arg(r_1 -
    r_0 e^{-i \varphi})`.
    """
    foot, lug = complex(*cylinder.foot), complex(*cylinder.lug)
    turned = foot * np.exp(-1j * angle)
    reach = lug - turned
    first = 1j * turned / reach
    second = (turned / reach) + (turned / reach) ** 2
    of_angle, of_second = first.imag, second.imag
    direction = reach / np.abs(reach)
    derivatives = [direction, 1j * of_angle * direction, (1j * of_second - of_angle**2) * direction]
    complete = np.stack(derivatives, axis=1)
    return np.stack([complete.real, complete.imag], axis=2)
