r"""Generalized-alpha on the full model, one solve with a constant matrix a step.

With q*, v* what position and velocity become without the new acceleration, dq and dv what that adds to them, and
S = M + dv D + dq K (Arnold, Bruels: Convergence of the generalized-alpha scheme for constrained mechanical systems,
Multibody System Dynamics 18, 2007, equations 5 to 7), the step's end is

.. math::
    S b = B f + M q^* / dq + D (q^* dv / dq - v^*) - C^T \lambda, \qquad
    q = dq\, b, \quad \ddot q = b - q^* / dq, \quad v = v^* + dv\, \ddot q

in which K is not needed, and lambda follows from the b that it would be without it:

.. math::
    (dq\, C S^{-1} C^T + 1/k)\, \lambda = dq\, C b_{free}

Rayleigh damping does without the product with D too: with D = alpha M + beta K and w = q^* dv / dq - v^*,

.. math::
    S^{-1} D w = S^{-1} M \bigl(\alpha - g (1 + dv\, \alpha)\bigr) w + g w, \qquad
    g = \beta / (dq + dv\, \beta)
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.fem.compat import MPI
from pmr.fem.factor import factor_for_steps
from pmr.fem.matrices import local_csr
from pmr.fullmodel.model import FullModel
from pmr.reduced.damping import Rayleigh
from pmr.scene.simulators import REFERENCE, refuse
from pmr.simulate.balance import refuse_growth
from pmr.simulate.excitation import Excitation
from pmr.simulate.native.scheme import GeneralizedAlpha
from pmr.simulate.needs import needs_of_rows
from pmr.simulate.petsc.checkpoint import Checkpoint
from pmr.simulate.petsc.constraint import Constraint
from pmr.simulate.petsc.effective import effective_matrix
from pmr.simulate.petsc.history import History, Recorder, Recording
from pmr.simulate.petsc.resume import Keeper, identity
from pmr.simulate.petsc.rows import Course
from pmr.simulate.petsc.start import State, starting_state
from pmr.simulate.start import InitialState
from pmr.simulate.stepping import Progress

Array = NDArray[np.float64]

#: How often progress is told.
TOLD = 1000


def observe(
    model: FullModel,
    excitation: Excitation,
    recording: Recording | None = None,
    initial: InitialState | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
) -> History:
    """Simulate a full model and keep what is recorded; collective.

    Parameters
    ----------
    model : FullModel
        M positive definite.
    excitation, initial, progress
        As for `pmr.simulate.Simulator`; the initial state is whole, (n,), on every rank.
    recording : Recording, optional
        By default all outputs at all steps.
    checkpoint : Checkpoint, optional
        If its file exists, the simulation goes on from there.  On one rank the result is the same to the last digit
        as without interruption; on several as far as MUMPS adds up messages in the order of their arrival.

    Raises
    ------
    InputError
        If the path leaves the rows' domain, a load is missing, the initial position violates a row, rigid rows move
        with rho_inf = 1, rows only push, or the checkpoint is not of this simulation.
    SimulationError
        If a step fails; with step, time, slider position and, where rows depend on each other, their names.  Where
        energies are recorded at every step, also if the motion grows without bound.
    """
    begin = time.perf_counter()
    s = excitation.along(model.rows.domain if model.rows.rows else (-np.inf, np.inf))
    f, stepping = excitation.forces(model.input_names), excitation.stepping
    needs = needs_of_rows(model.rows, excitation)
    refuse("petsc", needs, REFERENCE)
    recorder = Recorder(model, stepping, recording or Recording())
    s_rate = excitation.path_rate
    keeper = Keeper(checkpoint, model, identity(model, s, f, stepping, recorder, initial)) if checkpoint else None
    found = keeper.load(recorder) if keeper else None
    first, earlier, state = found or (0, 0.0, starting_state(model, s[0], float(s_rate[0]), f[0], initial))
    method = GeneralizedAlpha(stepping.step, stepping.rho_inf)
    integrator = Integrator(model, method, Course.along(model.rows.rows, s), first)
    if not found:
        recorder.record(0, state, integrator.constraint.rows, s_rate[0])
    preparation, begin = time.perf_counter() - begin, time.perf_counter()
    stride = max(1, stepping.steps // TOLD)
    for step in range(first + 1, stepping.steps + 1):
        due = keeper is not None and keeper.due()
        try:
            state, due = integrator.step(step, state, f[step], due)
        except SimulationError as error:
            where = f"step {step}, t = {step * stepping.step:g} s, slider at {s[step]:g} m"
            raise SimulationError(f"full-order simulation failed at {where}: {error}") from None
        recorder.record(step, state, integrator.constraint.rows, s_rate[step])
        if keeper and (due or step == stepping.steps):
            keeper.save(step, earlier + time.perf_counter() - begin, state, recorder)
        if progress is not None and (step % stride == 0 or step == stepping.steps):
            progress(step / stepping.steps)
    seconds = earlier + time.perf_counter() - begin
    integrator.destroy()
    history = recorder.history(s, f, seconds, preparation)
    refuse_growth(history.surplus, "full order", list(needs.rigid_moving))
    return history


class Integrator:
    """Takes the steps of one course; everything that does not change is made here."""

    def __init__(self, model: FullModel, method: GeneralizedAlpha, course: Course, step: int) -> None:
        self._comm, self._method = model.comm, method
        self._q_gain, self._v_gain = method.scheme().z_gain, method.scheme().v_gain
        S = effective_matrix(model, self._v_gain, self._q_gain)
        self._factor = factor_for_steps(S, "M + dv D + dq K")
        S.destroy()
        self._M = model.M
        self._D = model.D if model.rayleigh is None else None
        self._damped = _Damped.by(model.rayleigh or Rayleigh(0.0, 0.0), self._v_gain, self._q_gain)
        self._B = local_csr(model.inputs)
        self._x, self._right = model.M.createVecs()
        self._b = self._right.duplicate()
        self.constraint = Constraint(model, self._factor, self._q_gain, course, step)

    def step(self, step: int, state: State, f: Array, flag: bool) -> tuple[State, bool]:
        """The state after one more step, under the loads f (i,) at its end; whether any rank raises its flag.

        Raises
        ------
        SimulationError
            If rows depend on each other or the state is not finite.
        """
        self.constraint.move(step)
        q, v, a = self._predict(state)
        scaled = q / self._q_gain
        b = self._free(scaled, v, f)
        motion = self._q_gain * self.constraint.rows.apply(b)
        motion, total, flags = _summed(self._comm, motion, float(b.sum()), flag)
        if not np.isfinite(total):
            raise SimulationError("not finite")
        multipliers = self.constraint.multipliers(motion)
        b = b - self.constraint.correction(multipliers) if len(multipliers) else b.copy()
        acceleration = b - scaled
        a += (1.0 - self._method.alpha_f) / (1.0 - self._method.alpha_m) * acceleration
        v += self._v_gain * acceleration
        return State(self._q_gain * b, v, a, acceleration, multipliers), flags

    def _predict(self, state: State) -> tuple[Array, Array, Array]:
        """q*, v* and a without the new acceleration."""
        method, h = self._method, self._method.step
        a = (method.alpha_f * state.acceleration - method.alpha_m * state.a) / (1.0 - method.alpha_m)
        q = state.q + h * state.v + h**2 * ((0.5 - method.beta) * state.a + method.beta * a)
        return q, state.v + h * ((1.0 - method.gamma) * state.a + method.gamma * a), a

    def _free(self, scaled: Array, v: Array, f: Array) -> Array:
        """Free of the rows' forces: b_free; this rank's rows, overwritten by the next call."""
        w = self._v_gain * scaled - v
        self._x.getArray()[:] = scaled + self._damped.of_mass * w
        self._M.mult(self._x, self._right)
        if self._D is not None:
            self._x.getArray()[:] = w
            self._D.multAdd(self._x, self._right, self._right)
        self._right.getArray()[:] += self._B @ f
        self._factor.solve(self._right, self._b)
        b = self._b.getArray()
        b += self._damped.at_once * w
        return np.asarray(b)

    def destroy(self) -> None:
        """Give the factor's memory back."""
        self._factor.destroy()


@dataclass(frozen=True)
class _Damped:
    """S^-1 D w = S^-1 M (of_mass w) + at_once w of Rayleigh damping."""

    of_mass: float
    at_once: float

    @classmethod
    def by(cls, rayleigh: Rayleigh, v_gain: float, q_gain: float) -> _Damped:
        at_once = rayleigh.beta / (q_gain + v_gain * rayleigh.beta)
        return cls(rayleigh.alpha - at_once * (1.0 + v_gain * rayleigh.alpha), at_once)


def _summed(comm: MPI.Comm, motion: Array, total: float, flag: bool) -> tuple[Array, float, bool]:
    """Sums over the ranks, in one message."""
    summed = np.concatenate([motion, [total, float(flag)]])
    comm.Allreduce(MPI.IN_PLACE, summed)
    return summed[:-2], float(summed[-2]), bool(summed[-1] > 0.0)
