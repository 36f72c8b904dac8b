"""Forces of the contacts in a step of full order: their multipliers, and their effect on the bodies.

The multipliers follow from the Schur complement of the effective matrix.  If some contacts only push, the kernel solves
the complementarity problem (`pmr.kernel.laws`) on the first rank, and all ranks use this solution.  The force of a
contact that opens is removed from the next step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from pmr.errors import SimulationError, call_on_first_rank
from pmr.fem.compat import MPI
from pmr.fem.factor import BLOCK, MatrixFactor
from pmr.files.arrays import Array
from pmr.fullmodel.model import FullSystem
from pmr.kernel.laws import ContactError, ContactForces, SchemeFactors, solve_contact
from pmr.simulation.petsc.rows import (
    BlockFactor,
    Course,
    PathCompliance,
    PathRows,
    StoredAnswers,
    VisitedCarriers,
    contact_rows,
)
from pmr.simulation.petsc.start import State
from pmr.simulation.start import describe_dependence, describe_unsettled


@dataclass(frozen=True)
class Prediction:
    """State q*, v*, a* at a step's end, as it is without the step's own acceleration: this rank's rows (n_local,).

    a* is the acceleration-like variable of generalized-alpha.
    """

    q: Array
    v: Array
    a: Array

    @classmethod
    def from_shares(cls, factors: SchemeFactors, share: Array, force: Array) -> Prediction:
        """Contributions (n,) to the prediction of the next state by the last acceleration or by past contact forces.

        `force` (n,) is this acceleration or the acceleration by these forces, and `share` (n,) is its part in the
        variable a of the scheme.  Both enter the predicted coordinates, velocities and a with factors of the scheme,
        from `factors`.
        """
        return cls(
            q=factors.z_from_share * share + factors.z_from_force * force,
            v=factors.v_from_share * share + factors.v_from_force * force,
            a=factors.a_from_share * share + factors.a_from_force * force,
        )


class ContactState:
    """State of a system's contacts: which are closed, and their forces at the end of the last step.

    `mass` is a factor of the mass matrix M, None if no contact only pushes.
    """

    def __init__(self, system: FullSystem, mass: BlockFactor | None, state: State) -> None:
        """Begin with the contact forces of `state`; contacts of `system` that have a clearance only push.

        `mass` is a factor of the mass matrix M, or None if no contact only pushes.
        """
        self.mass, self.pushes, self._comm = mass, ~np.isnan(system.clearance), system.comm
        self._clearance = np.nan_to_num(system.clearance)
        self.begin(state)

    def begin(self, state: State) -> None:
        """Set the contacts to the forces that `state` holds."""
        self._force, self.share = np.where(self.pushes, state.multipliers, 0.0), state.share.copy()
        self._closed = ~self.pushes | (state.multipliers > 0.0)

    def forces(self, matrix: Array, motion: Array) -> Array:
        """Compute the forces (m,) in N of the m contacts, and store which contacts are closed with these forces.

        `motion` (m,) in m are the displacements of the contacts that there would be without contact forces, not yet
        reduced by the clearances.  Column j of `matrix` (m, m) in m/N is how far a force of 1 N at contact j moves all
        contacts back.  The force of an open contact is zero.

        Collective, as all ranks take the same result.  Raises ContactError if contacts depend on each other, or if it
        can't be settled which contacts are closed.
        """

        def solution() -> ContactForces:
            """Forces (m,) in N of all contacts, and the mask (m,) of closed ones."""
            return solve_contact(matrix, motion - self._clearance, self.pushes, self._closed)

        if self._comm.size == 1 or not self.pushes.any():
            forces, self._closed = solution()
        else:
            forces, self._closed = self._comm.bcast(call_on_first_rank(self._comm, solution))
        return forces

    def release(self, rows: PathRows, factors: SchemeFactors) -> Prediction | None:
        """Remove the stored forces of contacts that are now open; return what that changes in the prediction.

        None is returned if the stored forces of all open contacts are zero already.
        """
        opened = ~self._closed & ((self._force != 0.0) | (self.share != 0.0))
        if not opened.any():
            return None
        assert self.mass is not None
        right = [rows.apply_transposed(np.where(opened, forces, 0.0)) for forces in (self._force, self.share)]
        self._force, self.share = (np.where(opened, 0.0, forces) for forces in (self._force, self.share))
        force, share = self.mass.solve_columns(np.stack(right, axis=1)).T
        return Prediction.from_shares(factors, share, force)

    def end_step(self, multipliers: Array, factors: SchemeFactors) -> None:
        """Store the contributions of a step's contact forces `multipliers` (m,) to the next step."""
        share = factors.gain * multipliers + Prediction.from_shares(factors, self.share, self._force).a
        self.share = np.where(self.pushes, share, 0.0)
        self._force = np.where(self.pushes, multipliers, 0.0)


#: Bytes that a rank may use for S^{-1} E, which saves the second solve of a step; enough for 560 carriers of pads at up
#: to 240,000 coordinates on a rank.
STORED_BYTES = 2**30


class Constraint:
    r"""All contacts over a course of side positions, with a factor of S; collective.

    .. math:: (dq\, C S^{-1} C^T + 1/k)\, \lambda = C q_{free}

    holds for the closed contacts with multipliers :math:`\lambda`, stiffness k and rows C; `pushing` decides which
    contacts are closed.  S is the effective matrix of `pmr.simulation.petsc.integrate`, dq (`q_gain`) the derivative of
    positions by accelerations, and :math:`q_{free}` the coordinates without multipliers.  S^{-1} E, the response to the
    carriers E^T, is stored if the responses of all `shared` integrators fit into `STORED_BYTES`.
    """

    def __init__(
        self,
        system: FullSystem,
        factor: BlockFactor,
        q_gain: float,
        rows: PathRows,
        pushing: ContactState,
        shared: int = 1,
    ) -> None:
        """Prepare contact forces on the course in `rows`, with the `factor` of the effective matrices S; collective.

        `shared` is the number of integrators that share the memory for responses; the class describes the other
        arguments.
        """
        self._q_gain, self._factor, self._system, self.pushing = q_gain, factor, system, pushing
        self.rows = rows
        carriers, comm, least = rows.visited.of_bodies, system.comm, 0
        for E in carriers:
            least += E.shape[0] * comm.allreduce(E.shape[1], op=MPI.MAX)
        stored = 8 * least * shared <= STORED_BYTES
        answers = [solve_for_carriers(S, E, comm, stored) for S, E in zip(factor.of_bodies, carriers, strict=True)]
        self._compliance = PathCompliance([answer.compliance for answer in answers], rows)
        self._stored = (
            [StoredAnswers(answer.motion, body, rows) for body, answer in enumerate(answers)] if stored else None
        )
        self._at = np.full(len(rows.course.rows), np.nan)
        self.matrix = np.zeros((0, 0))

    def move(self, step: int) -> None:
        """Set the rows and their matrix to a step of the course."""
        self.rows.move(step)
        x = self.rows.course.x[step]
        if not np.array_equal(x, self._at):
            self.matrix = self._q_gain * self._compliance.of_rows(self.rows) + self._system.contact_compliance(x)
            self._at = x

    def multipliers(self, motion: Array) -> Array:
        """Contact forces (m,) in N from the displacements `motion` = C q_free (m,) in m of contacts without forces.

        Raises
        ------
        SimulationError
            If closed contacts depend on each other, or if it can't be settled which contacts are closed.
        """
        try:
            return self.pushing.forces(self.matrix, motion)
        except ContactError as error:
            names = self._system.contact_names
            if error.row is None:
                raise SimulationError(describe_unsettled(names, self.pushing.pushes)) from None
            C = contact_rows(self._system, self._at)[: error.row + 1]
            raise SimulationError(describe_dependence(C[:, np.unique(C.indices)].toarray(), names)) from None

    def correction(self, multipliers: Array) -> Array:
        """Rows of this rank (n_local,) of S^{-1} C^T lambda, with the contact forces lambda = `multipliers` (m,)."""
        if self._stored is not None:
            return np.concatenate([stored.correction(self.rows, multipliers) for stored in self._stored])
        return self._factor.solve(self.rows.apply_transposed(multipliers))


class CarrierAnswers(NamedTuple):
    """Response of a body to unit forces on its p carriers."""

    compliance: Array  # P = E^T S^{-1} E (p, p), the same on every rank
    motion: Array  # this rank's rows (n_local, p) of S^{-1} E; (n_local, 0) if they are not stored


def solve_for_carriers(factor: MatrixFactor, E: sp.csr_matrix, comm: MPI.Comm, stored: bool) -> CarrierAnswers:
    """Response to unit forces on p carriers, by a `factor` of S; collective.

    `E` (p, n_local) are the rows of the carriers, with the columns of this rank.  Displacements are part of the result
    only if `stored` is true.
    """
    p, n = E.shape
    P, stored_rows = np.zeros((p, p)), np.zeros((n, p if stored else 0), order="F")
    for k in range(0, p, BLOCK):
        block = factor.solve_columns(E[k : k + BLOCK].toarray().T)
        P[:, k : k + BLOCK] = E @ block
        if stored:
            stored_rows[:, k : k + BLOCK] = block
    comm.Allreduce(MPI.IN_PLACE, P)
    return CarrierAnswers((P + P.T) / 2.0, stored_rows)


def compliances(system: FullSystem, factor: BlockFactor, visited: VisitedCarriers) -> Sequence[Array]:
    """Matrices P = E^T S^{-1} E (p, p) of all bodies, for p `visited` carriers E each, from factors of matrices S."""
    parts = zip(factor.of_bodies, visited.of_bodies, strict=True)
    return [solve_for_carriers(S, E, system.comm, False).compliance for S, E in parts]


def rows_on_paths(system: FullSystem, x: Array, step: int = 0) -> PathRows:
    """The system's rows with its q sides at x (T, q) in m, set to number `step` of the T steps."""
    course = Course(system, x)
    return PathRows(course, VisitedCarriers(system, course), step)
