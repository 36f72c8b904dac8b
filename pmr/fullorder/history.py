"""What is kept of a full-order simulation: chosen outputs at every so many steps, whole states at a few times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.body import force_outputs
from pmr.dolfinx_compat import PETSc
from pmr.errors import InputError
from pmr.fullorder.effective import product
from pmr.fullorder.rows import PathRows
from pmr.fullorder.start import State
from pmr.operators import FullModel, local_csr
from pmr.results import Energy, Response
from pmr.simulate.stepping import TimeStepping

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Watch:
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
        Times at which the whole state is kept; the nearest step counts.
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


class Recorder:
    """Keeps what is watched: this rank's share of sums over coordinates, which are only added up at the end.

    Raises
    ------
    InputError
        If an output or a time does not exist.
    """

    def __init__(self, model: FullModel, stepping: TimeStepping, watch: Watch) -> None:
        count, times = model.outputs.getSize()[1], stepping.times
        self.chosen = np.arange(count) if watch.outputs is None else np.asarray(watch.outputs, np.int64)
        if np.any((self.chosen < 0) | (self.chosen >= count)):
            raise InputError("watch", "outputs", list(self.chosen), f"0 to {count - 1} are allowed")
        if not 1 <= watch.every <= stepping.steps:
            raise InputError("watch", "every", watch.every, f"1 to {stepping.steps} are allowed")
        wanted = np.asarray(watch.states, float).reshape(-1)
        if np.any(~((wanted >= 0.0) & (wanted <= stepping.end * (1.0 + 1e-12)))):
            raise InputError("watch", "states", list(wanted), f"0 to {stepping.end:g} s are allowed")
        self.watch, self.times = watch, times
        self.state_steps = np.unique(np.rint(wanted / stepping.step).astype(np.int64))
        self._model = model
        self._outputs: sp.csr_matrix = local_csr(model.outputs).T.tocsr()[self.chosen]
        self._inputs = local_csr(model.inputs)
        T, m = stepping.steps // watch.every + 1, len(model.rows.rows)
        self.multipliers = np.zeros((T, m))
        self.sums = np.zeros((T, len(self.chosen) + 2 * m + 3))
        n = model.M.getLocalSize()[0]
        self.q, self.v = np.zeros((len(self.state_steps), n)), np.zeros((len(self.state_steps), n))

    def record(self, step: int, state: State, rows: PathRows, s_rate: float, f: Array) -> None:
        """Keep what is asked of the state after a step, under the loads f (i,)."""
        k = np.searchsorted(self.state_steps, step)
        if k < len(self.state_steps) and self.state_steps[k] == step:
            self.q[k], self.v[k] = state.q, state.v
        if step % self.watch.every:
            return
        at = step // self.watch.every
        self.multipliers[at] = state.multipliers
        drift = rows.apply(state.v) + s_rate * rows.apply_derivative(state.q)
        energy = self._energy(state, f) if self.watch.energies else np.zeros(3)
        self.sums[at] = np.concatenate([self._outputs @ state.q, rows.apply(state.q), drift, energy])

    def _energy(self, state: State, f: Array) -> Array:
        def half_form(A: PETSc.Mat, x: Array) -> float:
            return float(x @ product(A, x)) / 2.0

        work = state.q @ (self._inputs @ f)
        return np.array([half_form(self._model.M, state.v), half_form(self._model.K, state.q), -work])

    def history(self, s: Array, seconds: float, preparation: float) -> History:
        """All of it; collective."""
        every, o, m = self.watch.every, len(self.chosen), self.multipliers.shape[1]
        t, s_kept = self.times[::every][: len(self.sums)], s[::every][: len(self.sums)]
        y, motion, drift, energy = np.split(self._model.comm.allreduce(self.sums), [o, o + m, o + 2 * m], axis=1)
        compliance = self._model.rows.compliance
        if np.any(compliance):
            drift = np.full_like(drift, np.nan)
        pads = self.multipliers**2 @ compliance / 2.0
        return History(
            t=t,
            s=s_kept,
            y=y,
            multipliers=self.multipliers,
            residual_position=np.abs(motion - compliance * self.multipliers).max(axis=1, initial=0.0),
            residual_velocity=np.abs(drift).max(axis=1, initial=0.0),
            energy=Energy(energy[:, 0], energy[:, 1] + pads, energy[:, 2]) if self.watch.energies else None,
            states=States(self.times[self.state_steps], s[self.state_steps], self.q, self.v),
            seconds=seconds,
            preparation=preparation,
        )


def respond(model: FullModel, history: History) -> Response:
    """What `pmr.compare` and the report ask of a simulator; of all outputs, with energies."""
    assert history.energy is not None
    force = force_outputs(model)
    return Response(
        t=history.t,
        x=model.output_positions[~force],
        displacement=history.y[:, ~force],
        energy=history.energy,
        slider_force=np.hstack([history.y[:, force], history.multipliers[:, model.rows.moving]]),
        residual_position=history.residual_position,
        residual_velocity=history.residual_velocity,
        seconds=history.preparation + history.seconds,
    )
