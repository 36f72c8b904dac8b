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
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pmr.errors import SimulationError
from pmr.fem.compat import MPI
from pmr.fem.distributed import local_csr
from pmr.fem.factor import MatrixFactor, factor_for_steps
from pmr.files.arrays import Array
from pmr.fullmodel.model import FullModel, FullSystem
from pmr.kernel.laws import SchemeFactors
from pmr.simulation import contact_step
from pmr.simulation.contact_step import StepParts
from pmr.simulation.petsc.constraint import Constraint, ContactState, Prediction, compliances, rows_on_paths
from pmr.simulation.petsc.recorder import Recorder
from pmr.simulation.petsc.rows import BlockFactor, PathCompliance, PathRows, effective_matrix
from pmr.simulation.petsc.start import SampledExcitation, State, Terms
from pmr.system.body_matrices import Rayleigh


class Stepped(NamedTuple):
    """State after a step, and whether a flag is set on any rank."""

    state: State
    flag: bool


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

        `rows` are the contact rows along the course, `pushing` is the state of contacts that only push, and `terms` are
        forces of terms and friction.
        """
        self._terms = terms
        self._system, self._factors = system, factors
        self._q_gain, self._v_gain = factors.z_gain, factors.v_gain
        self._factor = BlockFactor(system, self._factorise)
        self._bodies = [
            _Body(model, factor, self._v_gain, self._q_gain)
            for model, factor in zip(system.models, self._factor.of_bodies, strict=True)
        ]
        self._b = np.empty(system.local_slices[-1].stop)
        self.constraint = Constraint(system, self._factor, self._q_gain, rows, pushing, shared)

    def _factorise(self, model: FullModel) -> MatrixFactor:
        """Factor of the effective matrix S of a model."""
        S = effective_matrix(model, self._v_gain, self._q_gain)
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
        pushing, ahead = self.constraint.pushing, self._predict(state)
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
                if not (
                    self._terms.has_converged(w, new_w, times, new) and self._terms.gaps_have_converged(rubbed, new)
                ):
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

    def _predict(self, state: State) -> Prediction:
        """Prediction of the next state without the new acceleration."""
        added = Prediction.from_shares(self._factors, state.a, state.acceleration)
        return Prediction(state.q + self._factors.h * state.v + added.q, state.v + added.v, added.a)

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


class _Body:
    """Solver for the next state of one body without its contacts."""

    def __init__(self, model: FullModel, factor: MatrixFactor, v_gain: float, q_gain: float) -> None:
        """Prepare right-hand sides of the `model` for `factor`, the factor of its effective matrix.

        `v_gain` and `q_gain` are the derivatives of velocities and coordinates by a step's new acceleration.
        """
        self._M, self._D, self._factor, self._v_gain = model.M, model.D, factor, v_gain
        self._is_rayleigh = model.rayleigh is not None
        self._damped = _RayleighCoefficients.from_damping(model.rayleigh or Rayleigh(0.0, 0.0), v_gain, q_gain)
        self._B = local_csr(model.inputs)
        self._x, self._right = model.M.createVecs()
        self._b = self._right.duplicate()

    def free(self, scaled: Array, v: Array, f: Array) -> Array:
        """Rows (n_local,) of this rank of the solution b_free without contact forces.

        `scaled` (n_local,) and v (n_local,) are this rank's rows of q* / dq and v*, as in `Integrator`; f (i,) are the
        loads.
        """
        w = self._v_gain * scaled - v
        self._x.getArray()[:] = scaled + self._damped.of_mass * w
        self._M.mult(self._x, self._right)
        if not self._is_rayleigh:
            self._x.getArray()[:] = w
            self._D.multAdd(self._x, self._right, self._right)
        self._right.getArray()[:] += self._B @ f
        self._factor.solve(self._right, self._b)
        return np.asarray(self._b.getArray() + self._damped.at_once * w)


@dataclass(frozen=True)
class _RayleighCoefficients:
    """Coefficients `of_mass` and `at_once` in S^-1 D w = S^-1 M (of_mass w) + at_once w for Rayleigh damping."""

    of_mass: float
    at_once: float

    @classmethod
    def from_damping(cls, rayleigh: Rayleigh, v_gain: float, q_gain: float) -> _RayleighCoefficients:
        """Coefficients of a Rayleigh damping with the gains dv = `v_gain` and dq = `q_gain`."""
        at_once = rayleigh.beta / (q_gain + v_gain * rayleigh.beta)
        return cls(rayleigh.alpha - at_once * (1.0 + v_gain * rayleigh.alpha), at_once)


def contact_frequency(system: FullSystem, x: Array, mass: BlockFactor) -> float:
    """Largest omega in rad/s of contacts that only push, with the q sides at x (T, q) in m; collective.

    `mass` is the factor of M.
    """
    pushing, largest = np.flatnonzero(~np.isnan(system.clearance)), 0.0
    steps = np.unique(np.linspace(0, len(x) - 1, contact_step.PLACES).astype(int))
    rows = rows_on_paths(system, x[steps])
    mobility = PathCompliance(compliances(system, mass, rows.visited), rows)
    F = system.compliance.constant[np.ix_(pushing, pushing)]
    for k in range(len(steps)):
        rows.move(k)
        largest = max(
            largest, contact_step.row_frequency(F[None], mobility.of_rows(rows)[np.ix_(pushing, pushing)][None])
        )
    return float(system.comm.bcast(largest))


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
        """Take step `number` in all its parts.

        Returns the new state, and whether any rank is due for a checkpoint.

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
