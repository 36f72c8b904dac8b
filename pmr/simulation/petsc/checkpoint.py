"""Checkpoints of a long simulation: a file that is complete or does not exist, npz with a JSON header, never a pickle.

A checkpoint holds the state of a simulation on any number of ranks, and the records so far.
"""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError, call_on_first_rank
from pmr.fem.factor import product
from pmr.files import npz
from pmr.files.arrays import Array, Indices
from pmr.files.whole import NotWrittenError
from pmr.fullmodel.model import FullSystem
from pmr.simulation.excitation import Excitation
from pmr.simulation.petsc.recorder import Recorder
from pmr.simulation.petsc.start import SampledExcitation, State, stacked_start
from pmr.simulation.start import Grip, InitialState
from pmr.system.contacts import Friction

_log = logging.getLogger(__name__)

FORMAT = "pmr-checkpoint"
FORMAT_VERSION = 3
#: Relative agreement of numbers that describe the same model, assembled on any number of ranks.
SAME = 1e-9
_DAMAGE = (KeyError, TypeError, ValueError, OverflowError, RecursionError)


@dataclass(frozen=True)
class Checkpoint:
    """File in which a simulation is stored from time to time, and from which it resumes.

    Attributes
    ----------
    file : Path
        File that is replaced at each checkpoint and when the simulation ends: a finished simulation that is started
        again ends at once with the same result.  It may be deleted once the result is stored.
    seconds : float
        Wall time between two checkpoints.
    """

    file: Path
    seconds: float = 60.0


@dataclass(frozen=True)
class StoredSimulation:
    """A simulation after `step` steps, which took `seconds`: arrays of all ranks by name, and its identity."""

    step: int
    seconds: float
    identity: Mapping[str, object]
    arrays: Mapping[str, Array]


def save(checkpoint: Checkpoint, saved: StoredSimulation) -> None:
    """Write a checkpoint; it replaces the checkpoint before in one operation.

    If the disk is full, a warning is logged, and the checkpoint before is kept.
    """
    header = {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "step": saved.step,
        "seconds": saved.seconds,
        "identity": dict(saved.identity),
    }
    checkpoint.file.parent.mkdir(parents=True, exist_ok=True)
    try:
        npz.write(checkpoint.file, saved.arrays, header)
    except NotWrittenError as error:
        _log.warning("no checkpoint: %s", error)


def load(checkpoint: Checkpoint, identity: Mapping[str, object]) -> StoredSimulation | None:
    """Stored simulation of the checkpoint with this identity; None if there is no file.

    Raises
    ------
    InputError
        If the file is damaged or belongs to another simulation.
    """
    name = str(checkpoint.file)
    if not checkpoint.file.exists():
        return None
    try:
        arrays = npz.read(checkpoint.file)
        header = npz.pop_header(arrays)
        if (header["format"], header["version"]) != (FORMAT, FORMAT_VERSION):
            raise ValueError("another format")
        saved = StoredSimulation(int(header["step"]), float(header["seconds"]), dict(header["identity"]), arrays)
    except _DAMAGE as error:
        allowed = f"a checkpoint is allowed, this is none ({error}); delete it to start from t = 0"
        raise InputError(name, "", None, allowed) from None
    if different := _differences(saved.identity, identity):
        allowed = f"another simulation's checkpoint: {different} differs; delete it or name another file"
        raise InputError(name, "", None, allowed)
    return saved


def _differences(stored: Mapping[str, object], expected: Mapping[str, object]) -> str:
    """Text with the names of the entries in which the stored identity differs from the expected one."""
    names = [key for key, value in expected.items() if not _entries_agree(stored.get(key), value)]
    return ", ".join(names)


def _entries_agree(a: object, b: object) -> bool:
    """Whether a stored entry of an identity agrees with the expected one, lists of numbers to `SAME`."""
    if isinstance(b, list):
        return isinstance(a, list) and len(a) == len(b) and np.allclose(a, b, rtol=SAME, atol=0.0)
    return bool(a == b)


_SPREAD = tuple(field.name for field in fields(State) if field.name not in ("multipliers", "share", "grip"))


def identity(
    system: FullSystem,
    excitation: Excitation,
    at: SampledExcitation,
    recorder: Recorder,
    initial: Mapping[str, InitialState],
) -> dict[str, Any]:
    """Digests that distinguish this simulation from others, with one product of each matrix; collective.

    `at` are paths, loads and terms at the steps; paths and loads are also evaluated in the middle of steps, which may
    be divided.
    """
    stepping, between = excitation.stepping, 0.5 * (excitation.times[:-1] + excitation.times[1:])
    forms = []
    for model in system.models:
        x = np.random.default_rng(3).standard_normal(model.size)[model.share]
        forms += [x @ product(A, x) for A in (model.M, model.D, model.K)]
    rows = [
        value
        for side, row in zip(system.sides, system.side_rows, strict=True)
        for value in (np.abs(row.coefficients).sum(), abs(row.carriers).sum(), side.sign)
    ]
    recording = asdict(recorder.recording) | {
        "outputs": recorder.chosen.tolist(),
        "states": recorder.state_steps.tolist(),
    }
    start, compliance = stacked_start(system, initial), system.compliance
    varying = [term.value(between) for term in excitation.terms.values()]
    of_terms = {"terms": _digest(repr(system.term_names).encode(), at.c, *varying)} if at.c.size else {}
    return {
        **of_terms,
        "path": _digest(at.x, *(path.value(between) for path in excitation.paths.values())),
        "loads": _digest(at.f, *(load.value(between) for load in excitation.loads.values())),
        "time grid": [stepping.end, stepping.step, stepping.rho_inf],
        "recording": _digest(repr(sorted(recording.items())).encode()),
        "initial state": _digest(start.q, start.v),
        "rows": [float(value) for value in rows],
        "contacts": _digest(compliance.constant, compliance.slopes, system.clearance, *_friction_arrays(system)),
        "matrices": [float(value) for value in system.comm.allreduce(np.array(forms))],
    }


@dataclass(frozen=True)
class ReachedState:
    """State of a simulation after `step` steps, which took `seconds` of wall time.

    `parts` (T,) are the numbers of parts of all steps, as chosen when the simulation began.  They are kept even if a
    reduced model that is made again would choose others.
    """

    step: int
    seconds: float
    state: State
    parts: Indices


class CheckpointFile:
    """Writes and reads the checkpoints of one simulation; all methods but `due` are collective."""

    def __init__(self, checkpoint: Checkpoint, system: FullSystem, identity: Mapping[str, object]) -> None:
        self._checkpoint, self._identity = checkpoint, identity
        self._comm, self._system = system.comm, system
        self._last = time.monotonic()

    def due(self) -> bool:
        """Whether a checkpoint has to be written now; always False on other ranks than 0."""
        return self._comm.rank == 0 and time.monotonic() - self._last >= self._checkpoint.seconds

    def save(self, reached: ReachedState, recorder: Recorder) -> None:
        """Write a checkpoint after a step."""
        gathered, state = self._system.gather_vectors, reached.state
        arrays = {name: gathered(getattr(state, name)[None])[0] for name in _SPREAD}
        arrays |= {"states.q": gathered(recorder.q), "states.v": gathered(recorder.v)}
        arrays["sums"] = self._comm.reduce(recorder.sums)
        if self._comm.rank == 0:
            arrays |= {"multipliers": state.multipliers, "share": state.share, "parts": reached.parts}
            arrays |= {"recorded.multipliers": recorder.multipliers, "recorded.peaks": recorder.peaks}
            arrays |= {"recorded.friction": recorder.friction}
            arrays |= {f"grip.{name}": array for name, array in vars(state.grip).items()}
            save(self._checkpoint, StoredSimulation(reached.step, reached.seconds, self._identity, arrays))
        self._last = time.monotonic()

    def load(self, recorder: Recorder) -> ReachedState | None:
        """State of the last checkpoint, with the recorder filled in place; None if there is no checkpoint.

        Raises
        ------
        InputError
            If the file is damaged or belongs to another simulation.
        """
        checkpoint = self._comm.bcast(call_on_first_rank(self._comm, lambda: load(self._checkpoint, self._identity)))
        if checkpoint is None:
            return None
        arrays, mine = checkpoint.arrays, self._system.local_part
        recorder.q[:], recorder.v[:] = mine(arrays["states.q"]), mine(arrays["states.v"])
        recorder.multipliers[:], recorder.peaks[:] = arrays["recorded.multipliers"], arrays["recorded.peaks"]
        recorder.friction[:] = arrays["recorded.friction"]
        grip = Grip(**{field.name: arrays[f"grip.{field.name}"] for field in fields(Grip)})
        recorder.sums[:] = arrays["sums"] if self._comm.rank == 0 else 0.0
        spread = {name: mine(arrays[name]) for name in _SPREAD}
        state = State(**spread, multipliers=arrays["multipliers"], share=arrays["share"], grip=grip)
        return ReachedState(checkpoint.step, checkpoint.seconds, state, arrays["parts"])


def _friction_arrays(system: FullSystem) -> list[NDArray[np.generic]]:
    """Arrays that define the friction of a system's pads; empty without friction."""
    friction = Friction.from_contacts(system.contacts)
    return [] if friction is None else [friction.pads, friction.laws, friction.stiffness, friction.arms]


def _digest(*parts: bytes | NDArray[np.generic]) -> str:
    """SHA-256 digest of bytes and arrays."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part if isinstance(part, bytes) else np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()
