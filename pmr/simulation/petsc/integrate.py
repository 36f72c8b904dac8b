r"""Generalized-alpha on full models, with one solve for each body and step, with a constant matrix.

Let q* and v* be position and velocity at the step's end without the new acceleration, dq and dv the derivatives of
position and velocity by this acceleration, and S = M + dv D + dq K the effective matrix (Arnold, Bruels: Convergence of
the generalized-alpha scheme for constrained mechanical systems, Multibody System Dynamics 18, 2007, equations 5 to 7).
With loads f and the rows C and forces :math:`\lambda` of contacts, the step's end is

.. math::
    S b = B f + M q^* / dq + D (q^* dv / dq - v^*) - C^T \lambda, \qquad
    q = dq\, b, \quad \ddot q = b - q^* / dq, \quad v = v^* + dv\, \ddot q

in which K is not needed.  The contact forces follow from the solution b_free without them, with the contacts' stiffness
k:

.. math::
    (dq\, C S^{-1} C^T + 1/k)\, \lambda = dq\, C b_{free}

Rayleigh damping needs no product with D either: with D = alpha M + beta K and w = q^* dv / dq - v^*,

.. math::
    S^{-1} D w = S^{-1} M \bigl(\alpha - g (1 + dv\, \alpha)\bigr) w + g w, \qquad
    g = \beta / (dq + dv\, \beta)

Steps may be divided into equal parts, as a schedule says or as pads that only push need it; then S has a factor for
each length of a part.  The number of parts of each step is the one that an estimate from the forces of a reduced model
chose (src/substeps.c of `pmr.kernel`).  In full order the same estimate would choose more parts and be less reliable:
the walls under pads are light, so that they vibrate after every impact.

If some contacts only push, the kernel solves the complementarity problem (`pmr.kernel.laws`) on the first rank, and all
ranks use this solution.  The force of a contact that opens is removed from the next step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from pmr.errors import SimulationError, call_on_first_rank
from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import without_zeros
from pmr.fem.factor import MatrixFactor, factor_for_steps
from pmr.files.arrays import Array
from pmr.fullmodel.model import FullModel, FullSystem
from pmr.kernel.laws import ContactError, SchemeFactors, solve_contact
from pmr.simulation.contact_step import StepParts
from pmr.simulation.petsc.recorder import Recorder
from pmr.simulation.petsc.rows import (
    BlockFactor,
    BodyStep,
    PathCompliance,
    PathRows,
    StoredAnswers,
    contact_rows,
    rows_on_paths,
    solve_for_carriers,
)
from pmr.simulation.petsc.start import SampledExcitation, State, Terms
from pmr.simulation.start import describe_dependence, describe_unsettled


class Stepped(NamedTuple):
    """State after a step, and whether a flag is set on any rank."""

    state: State
    flag: bool


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
        """Contributions to the prediction of the next state by the last acceleration or by past contact forces.

        `force` is the last acceleration, or the past contact forces, or their part of the acceleration.  `share` is the
        part of `force` in the scheme's variable a.  Both are (n_local,) or (m,), and so are the arrays of the result.
        The scheme's `factors` say how much of both enters the predicted coordinates, velocities and a.
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
        """Set the contacts to the forces of `state`; those that only push are closed if their force is positive."""
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
        solution = partial(solve_contact, matrix, motion - self._clearance, self.pushes, self._closed)
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
        """Store what a step's contact forces `multipliers` (m,) contribute to the next step.

        The contributions of contacts that hold both ways are not stored.
        """
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
        shared: int,
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
        """Set the rows to a step of the course, and their matrix, which is computed only if a side has moved."""
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


class Integrator:
    """Takes steps of one length along a course; everything that is constant is computed when the integrator is made.

    `shared` is the number of integrators, of different lengths, that share the memory for responses.
    """

    def __init__(
        self,
        system: FullSystem,
        factors: SchemeFactors,
        rows: PathRows,
        pushing: ContactState,
        terms: Terms,
        shared: int,
    ) -> None:
        """Factorise the effective matrix of steps with the scheme's `factors` for each body of `system`; collective.

        `rows` are the contact rows along the course, `pushing` is the state of contacts that only push, and `terms`
        gives the forces of the system's terms and of friction.  `shared` is the number of integrators that share the
        memory for responses.
        """
        self._terms = terms
        self._system, self._factors = system, factors
        self._q_gain, self._v_gain = factors.z_gain, factors.v_gain
        self._factor = BlockFactor(system, self._factorise)
        self._bodies = [
            BodyStep(model, factor, self._v_gain, self._q_gain)
            for model, factor in zip(system.models, self._factor.of_bodies, strict=True)
        ]
        self._b = np.empty(system.local_slices[-1].stop)
        self.constraint = Constraint(system, self._factor, self._q_gain, rows, pushing, shared)

    def _factorise(self, model: FullModel) -> MatrixFactor:
        """Factor of the effective matrix S = M + dv D + dq K of a model; errors as `factor_for_steps`.

        S is the derivative of the forces with respect to the acceleration at the end of a step.
        """
        full = model.K.copy()
        full.scale(self._q_gain)
        for gain, A in ((self._v_gain, model.D), (1.0, model.M)):
            full.axpy(gain, A, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        S = without_zeros(full)
        factor = factor_for_steps(S, "M + dv D + dq K")
        S.destroy()
        return factor

    def step(self, step: int, state: State, f: Array, c: Array, flag: bool) -> Stepped:
        """Take one step, to number `step` of the course, under loads f (i,) and amplitudes c (K,) of terms at its end.

        Returns the new state, and whether `flag` is true on any rank.

        Raises
        ------
        SimulationError
            If rows depend on each other, it can't be settled which rows are closed, forces of terms do not converge, or
            the state is not finite.
        """
        self.constraint.move(step)
        pushing, added = self.constraint.pushing, Prediction.from_shares(self._factors, state.a, state.acceleration)
        ahead = Prediction(state.q + self._factors.h * state.v + added.q, state.v + added.v, added.a)
        w, times, free = None, 0, None
        grip = state.grip
        rubbed = self._terms.pad_friction(self.constraint.rows, state.multipliers, grip)
        if self._terms:
            self._terms.begin_step()
            w = self._terms.forces(ahead.q, ahead.v, c) + rubbed.force
        while True:
            scaled = ahead.q / self._q_gain
            if free is None:
                free = self._solve_without_contacts(scaled, ahead.v, f)
            b = free if w is None else free + self._factor.solve(w)
            motion = self._q_gain * self.constraint.rows.apply(b)
            summed = np.concatenate([motion, [float(b.sum()), float(flag)]])  # over the ranks, by one message
            self._system.comm.Allreduce(MPI.IN_PLACE, summed)
            if not np.isfinite(summed[-2]):
                raise SimulationError("not finite")
            flag, multipliers = bool(summed[-1] > 0.0), self.constraint.multipliers(summed[:-2] - rubbed.gap)
            b = b - self.constraint.correction(multipliers) if len(multipliers) else b.copy()
            if w is not None:
                times += 1
                grip = self._terms.slide(state.grip, rubbed, c, self._factors.h, multipliers, self.constraint.matrix)
                new = self._terms.pad_friction(self.constraint.rows, multipliers, grip)
                new_w = self._terms.forces(self._q_gain * b, ahead.v + self._v_gain * (b - scaled), c) + new.force
                if not self._terms.have_converged(w, rubbed, new_w, new, times):
                    w, rubbed = self._terms.extrapolate(w, rubbed, new_w, new)
                    continue
                w, rubbed = new_w, new
            back = pushing.release(self.constraint.rows, self._factors)
            if back is None:
                break
            self._terms.begin_step()
            ahead, free = Prediction(ahead.q + back.q, ahead.v + back.v, ahead.a + back.a), None
        acceleration = b - scaled
        a = ahead.a + self._factors.gain * acceleration
        v = ahead.v + self._v_gain * acceleration
        pushing.end_step(multipliers, self._factors)
        return Stepped(State(self._q_gain * b, v, a, acceleration, multipliers, pushing.share, grip), flag)

    def _solve_without_contacts(self, scaled: Array, v: Array, f: Array) -> Array:
        """This rank's rows (n_local,) of the solution b_free without contact forces; overwritten by the next call.

        `scaled` (n_local,) is q* / dq: the predicted coordinates q* over dq, the derivative of the coordinates by the
        step's new acceleration.  v (n_local,) is the predicted velocity v*, f (i,) are the loads.
        """
        system = self._system
        for body, at, inputs in zip(self._bodies, system.local_slices, system.input_slices, strict=True):
            self._b[at] = body.free(scaled[at], v[at], f[inputs])
        return self._b

    def destroy(self) -> None:
        """Free the factors' memory."""
        self._factor.destroy()


class DividedSteps:
    """Takes steps, each divided into its number of parts, along a course from step `first` on; collective.

    The excitation `fine` is sampled with the largest number of parts in each step.  A step with another number of parts
    than the one before starts anew from position, velocity and equilibrium of forces.
    """

    def __init__(
        self, system: FullSystem, lengths: StepParts, fine: SampledExcitation, pushing: ContactState, first: int
    ) -> None:
        """Make an integrator for each number of parts in `lengths`, for steps of `system` from `first` on; collective.

        `fine` is the excitation sampled with the largest number of parts, and `pushing` the state of contacts that only
        push.
        """
        self._lengths, self._fine, self._pushing = lengths, fine, pushing
        terms = Terms(system)
        self.rows, sizes = rows_on_paths(system, fine.x, first * lengths.finest), np.unique(lengths.parts).tolist()
        self._integrators = {
            parts: Integrator(system, lengths.factors(parts), self.rows, pushing, terms, len(sizes)) for parts in sizes
        }

    def step(self, number: int, state: State, due: bool, recorder: Recorder) -> Stepped:
        """Take step `number` in all its parts, from the `state` before it; `recorder` follows each part.

        Returns the new state, and whether any rank is `due` for a checkpoint.

        Raises
        ------
        SimulationError
            As `Integrator.step`.
        """
        finest, parts = self._lengths.finest, int(self._lengths.parts[number - 1])
        if parts != self._lengths.parts[max(number - 2, 0)] and self._pushing.pushes.any():
            state = replace(state, a=state.acceleration, share=np.where(self._pushing.pushes, state.multipliers, 0.0))
            self._pushing.begin(state)
        for part in range(1, parts + 1):
            at = (number - 1) * finest + part * (finest // parts)
            f, c = self._fine.f[at], self._fine.c[at]
            state, due = self._integrators[parts].step(at, state, f, c, due)
            recorder.follow(state, self.rows, self._fine.x[at], f, c)
        return Stepped(state, due)

    def destroy(self) -> None:
        """Free the memory of all factors."""
        for integrator in self._integrators.values():
            integrator.destroy()
        if self._pushing.mass is not None:
            self._pushing.mass.destroy()
