"""What is recorded of a full-order simulation: chosen outputs at every so many steps, whole states at a few times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.fem.compat import PETSc
from pmr.fem.matrices import local_csr, without_zeros
from pmr.fullmodel.model import FullModel
from pmr.results import Energy, Response
from pmr.simulate import balance
from pmr.simulate.petsc.rows import PathRows
from pmr.simulate.petsc.start import State
from pmr.simulate.stepping import TimeStepping
from pmr.system.body import called, force_outputs, length_outputs

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Recording:
    """What to keep.  Memory is of its order, and that of a few vectors.

    Attributes
    ----------
    outputs : sequence of int, optional
        Numbers of the model's outputs; all by default.
    every : int
        Keep each `every`-th step, the first one included.
    energies : bool
        Two products with a matrix at each of these steps.
    states : sequence of float, s
        Times at which the whole state is recorded; the nearest step counts.
    """

    outputs: Sequence[int] | None = None
    every: int = 1
    energies: bool = False
    states: Sequence[float] = ()


@dataclass(frozen=True)
class States:
    """Whole states at t (S,) s: this rank's rows of q and v, (S, n_local), and the path coordinate s (S,) m."""

    t: Array
    s: Array
    q: Array
    v: Array


@dataclass(frozen=True)
class History:
    """Outputs of a full-order simulation; the same on every rank, but for `states`.

    Attributes
    ----------
    t, s : (T,) arrays, s and m
    y : (T, o) array, m
    multipliers : (T, m) array, N
    residual_position : (T,) array, m
        Largest violation of a row, max |C q - lambda / k|.
    residual_velocity : (T,) array, m/s
        Largest violation of a rigid row's time derivative, max |C v + s' C' q|; NaN where a row gives way.
    energy : Energy or None
        As asked; strain energy includes that of the pads.
    surplus : float
        Share of the largest energy that neither loads nor moving rows put in (`pmr.simulate.balance`); NaN where
        energies were not asked for at every step.
    states : States
    seconds : float
        Wall time of the steps, those before an interruption included.
    preparation : float, s
        Wall time of the factorisation and the compliance of the path.
    """

    t: Array
    s: Array
    y: Array
    multipliers: Array
    residual_position: Array
    residual_velocity: Array
    energy: Energy | None
    states: States
    seconds: float
    preparation: float
    surplus: float = np.nan


class Recorder:
    """Keeps what is recorded: this rank's share of sums over coordinates, which are only added up at the end.

    Raises
    ------
    InputError
        If an output or a time does not exist.
    """

    def __init__(self, model: FullModel, stepping: TimeStepping, recording: Recording) -> None:
        count, times = model.outputs.getSize()[1], stepping.times
        self.chosen = np.arange(count) if recording.outputs is None else np.asarray(recording.outputs, np.int64)
        if np.any((self.chosen < 0) | (self.chosen >= count)):
            raise InputError("recording", "outputs", list(self.chosen), f"0 to {count - 1} are allowed")
        if not 1 <= recording.every <= stepping.steps:
            raise InputError("recording", "every", recording.every, f"1 to {stepping.steps} are allowed")
        wanted = np.asarray(recording.states, float).reshape(-1)
        if np.any(~((wanted >= 0.0) & (wanted <= stepping.end * (1.0 + 1e-12)))):
            raise InputError("recording", "states", list(wanted), f"0 to {stepping.end:g} s are allowed")
        self.recording, self.times = recording, times
        self.state_steps = np.unique(np.rint(wanted / stepping.step).astype(np.int64))
        self._model = model
        self._outputs: sp.csr_matrix = local_csr(model.outputs).T.tocsr()[self.chosen]
        self._inputs = local_csr(model.inputs)
        self._K = without_zeros(model.K.copy())  # of the plane walls of a shell half
        self._x, self._Ax = model.K.createVecs()
        T, m, i = stepping.steps // recording.every + 1, len(model.rows.rows), len(model.input_names)
        self.multipliers = np.zeros((T, m))
        self._ends = np.cumsum([len(self.chosen), m, m, m, i])
        self.sums = np.zeros((T, self._ends[-1] + 2))
        n = model.M.getLocalSize()[0]
        self.q, self.v = np.zeros((len(self.state_steps), n)), np.zeros((len(self.state_steps), n))

    def record(self, step: int, state: State, rows: PathRows, s_rate: float) -> None:
        """Keep what is asked of the state after a step."""
        k = np.searchsorted(self.state_steps, step)
        if k < len(self.state_steps) and self.state_steps[k] == step:
            self.q[k], self.v[k] = state.q, state.v
        if step % self.recording.every:
            return
        at = step // self.recording.every
        self.multipliers[at] = state.multipliers
        slope = rows.apply_derivative(state.q)
        drift, motion = rows.apply(state.v) + s_rate * slope, self._inputs.T @ state.q
        energy = self._energy(state) if self.recording.energies else np.zeros(2)
        self.sums[at] = np.concatenate([self._outputs @ state.q, rows.apply(state.q), drift, slope, motion, energy])

    def _energy(self, state: State) -> Array:
        def half_form(A: PETSc.Mat, x: Array) -> float:
            self._x.getArray()[:] = x
            A.mult(self._x, self._Ax)
            return float(x @ self._Ax.getArray()) / 2.0

        return np.array([half_form(self._model.M, state.v), half_form(self._K, state.q)])

    def history(self, s: Array, f: Array, seconds: float, preparation: float) -> History:
        """All of it, after steps to s (T,) m under f (T, i) N; collective."""
        every = self.recording.every
        t, s_kept = self.times[::every][: len(self.sums)], s[::every][: len(self.sums)]
        sums = self._model.comm.allreduce(self.sums)
        y, motion, drift, slope, of_loads, energy = np.split(sums, self._ends, axis=1)
        compliance = self._model.rows.compliance
        if np.any(compliance):
            drift = np.full_like(drift, np.nan)
        energies, found = None, np.nan
        if self.recording.energies:
            f = f[::every][: len(self.sums)]
            strain = energy[:, 1] + self.multipliers**2 @ compliance / 2.0
            energies = Energy(energy[:, 0], strain, -np.einsum("ti,ti->t", of_loads, f))
            if every == 1:
                work = balance.step_work(f, of_loads, self.multipliers, slope, s_kept)
                least = balance.round_off(self._mobility(), f, float(self.times[1]))
                found = balance.surplus(energies.kinetic + strain, work, least)
        return History(
            t=t,
            s=s_kept,
            y=y,
            multipliers=self.multipliers,
            residual_position=np.abs(motion - compliance * self.multipliers).max(axis=1, initial=0.0),
            residual_velocity=np.abs(drift).max(axis=1, initial=0.0),
            energy=energies,
            states=States(self.times[self.state_steps], s[self.state_steps], self.q, self.v),
            seconds=seconds,
            preparation=preparation,
            surplus=found,
        )

    def _mobility(self) -> Array:
        """B^T diag(M)^-1 B, (i, i) in 1/kg; collective."""
        M = self._model.M
        B = self._inputs.toarray()
        return np.asarray(self._model.comm.allreduce(B.T @ (B / M.getDiagonal().getArray()[:, None])))


def respond(model: FullModel, history: History) -> Response:
    """What `pmr.compare.errors` and the report ask of a simulator; of all outputs, with energies."""
    assert history.energy is not None
    force, length, moving = force_outputs(model), length_outputs(model), model.rows.moving
    names = called(model, [model.rows.names[k] for k in moving])
    return Response(
        t=history.t,
        x=model.output_positions[length],
        displacement=history.y[:, length],
        energy=history.energy,
        slider_force=np.hstack([history.y[:, force], history.multipliers[:, moving]]),
        residual_position=history.residual_position,
        residual_velocity=history.residual_velocity,
        seconds=history.preparation + history.seconds,
        surplus=history.surplus,
        output_names=names.moved,
        output_units=("m",) * len(names.moved),
        force_names=names.forces,
        others=None if np.all(force | length) else history.y[:, ~(force | length)],
        other_names=names.others,
        other_units=names.other_units,
    )
