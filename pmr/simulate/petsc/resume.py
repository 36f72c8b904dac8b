"""A simulation on any number of ranks to and from a file: its state and what was recorded."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.fem.factor import product
from pmr.fullmodel.model import FullModel
from pmr.simulate.petsc.checkpoint import Checkpoint, Saved, load, save
from pmr.simulate.petsc.history import Recorder
from pmr.simulate.petsc.start import State
from pmr.simulate.start import InitialState
from pmr.simulate.stepping import TimeStepping

Array = NDArray[np.float64]

_SPREAD = tuple(field.name for field in fields(State) if field.name != "multipliers")


def identity(
    model: FullModel, s: Array, f: Array, stepping: TimeStepping, recorder: Recorder, initial: InitialState | None
) -> dict[str, Any]:
    """What tells this simulation from others; collective.  Matrices are told apart by one product each."""
    first, last = model.M.getOwnershipRange()
    x = np.random.default_rng(3).standard_normal(model.size)
    forms = [x[first:last] @ product(A, x[first:last]) for A in (model.M, model.D, model.K)]
    rows = [
        value
        for row in model.rows.rows
        for value in (np.abs(row.coefficients).sum(), abs(row.carriers).sum(), row.compliance)
    ]
    recording = asdict(recorder.recording) | {
        "outputs": recorder.chosen.tolist(),
        "states": recorder.state_steps.tolist(),
    }
    start = () if initial is None else (np.asarray(initial.q, float), np.asarray(initial.v, float))
    return {
        "path": _digest(s),
        "loads": _digest(f),
        "time grid": [stepping.end, stepping.step, stepping.rho_inf],
        "recording": _digest(repr(sorted(recording.items())).encode()),
        "initial state": _digest(*start),
        "rows": [float(value) for value in rows],
        "matrices": [float(value) for value in model.comm.allreduce(np.array(forms))],
    }


class Keeper:
    """Checkpoints of one simulation; collective but for `due`."""

    def __init__(self, checkpoint: Checkpoint, model: FullModel, identity: Mapping[str, Any]) -> None:
        self._checkpoint, self._identity = checkpoint, identity
        self._comm, self._share = model.comm, model.M.getOwnershipRange()
        self._last = time.monotonic()

    def due(self) -> bool:
        """Whether it is time to save; asked on rank 0 alone."""
        return self._comm.rank == 0 and time.monotonic() - self._last >= self._checkpoint.seconds

    def save(self, step: int, seconds: float, state: State, recorder: Recorder) -> None:
        """Save everything after a step."""
        whole = {name: self._whole(getattr(state, name)[None])[0] for name in _SPREAD}
        whole |= {"states.q": self._whole(recorder.q), "states.v": self._whole(recorder.v)}
        whole["sums"] = self._comm.reduce(recorder.sums)
        if self._comm.rank == 0:
            whole |= {"multipliers": state.multipliers, "recorded.multipliers": recorder.multipliers}
            save(self._checkpoint, Saved(step, seconds, self._identity, whole))
        self._last = time.monotonic()

    def load(self, recorder: Recorder) -> tuple[int, float, State] | None:
        """Step, seconds so far and state of the last checkpoint, the recorder filled; None if there is none.

        Raises
        ------
        InputError
            If the file is damaged or belongs to another simulation.
        """
        found, refusal = None, None
        if self._comm.rank == 0:
            try:
                found = load(self._checkpoint, self._identity)
            except InputError as error:
                refusal = error.source, error.key, error.value, error.allowed
        found, refusal = self._comm.bcast((found, refusal))
        if refusal:
            raise InputError(*refusal)
        if found is None:
            return None
        arrays, mine = found.arrays, slice(*self._share)
        recorder.q[:], recorder.v[:] = arrays["states.q"][:, mine], arrays["states.v"][:, mine]
        recorder.multipliers[:] = arrays["recorded.multipliers"]
        recorder.sums[:] = arrays["sums"] if self._comm.rank == 0 else 0.0
        spread = {name: np.ascontiguousarray(arrays[name][mine]) for name in _SPREAD}
        return found.step, found.seconds, State(**spread, multipliers=arrays["multipliers"])

    def _whole(self, local: Array) -> Any:
        """Arrays (k, n) on rank 0 from the ranks' columns (k, n_local)."""
        shares = self._comm.gather(local)
        return np.concatenate(shares, axis=1) if self._comm.rank == 0 else local


def _digest(*parts: Any) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part if isinstance(part, bytes) else np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()
