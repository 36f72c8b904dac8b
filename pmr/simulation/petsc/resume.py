"""A simulation on any number of ranks to and from a file: its state and what was recorded."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import on_first
from pmr.fem.factor import product
from pmr.fullmodel.system import FullSystem
from pmr.simulation.excitation import Excitation
from pmr.simulation.grip import Grip
from pmr.simulation.petsc.checkpoint import Checkpoint, Saved, load, save
from pmr.simulation.petsc.recorder import Recorder, Sampled
from pmr.simulation.petsc.start import State, whole_start
from pmr.simulation.start import InitialState
from pmr.system.friction import Friction

_SPREAD = tuple(field.name for field in fields(State) if field.name not in ("multipliers", "share", "grip"))


def identity(
    system: FullSystem, excitation: Excitation, at: Sampled, recorder: Recorder, initial: Mapping[str, InitialState]
) -> dict[str, Any]:
    """Digests that distinguish this simulation from others, one product of each matrix; collective.

    Path and loads count in the middle of steps, too, which may be made in parts.
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
    start, compliance = whole_start(system, initial), system.compliance
    varying = [term.value(between) for term in excitation.terms.values()]
    of_terms = {"terms": _digest(repr(system.term_names).encode(), at.c, *varying)} if at.c.size else {}
    return {
        **of_terms,
        "path": [_digest(at.x), _digest(*(path.value(between) for path in excitation.paths.values()))],
        "loads": [_digest(at.f), _digest(*(load.value(between) for load in excitation.loads.values()))],
        "time grid": [stepping.end, stepping.step, stepping.rho_inf],
        "recording": _digest(repr(sorted(recording.items())).encode()),
        "initial state": _digest(start.q, start.v),
        "rows": [float(value) for value in rows],
        "contacts": _digest(compliance.constant, compliance.slopes, system.clearance, *_of_friction(system)),
        "matrices": [float(value) for value in system.comm.allreduce(np.array(forms))],
    }


@dataclass(frozen=True)
class Reached:
    """State of a simulation after `step` steps, which took `seconds` of wall time.

    A reduced model that is made again may ask for other `parts` (T,) of the steps: those of the start are kept.
    """

    step: int
    seconds: float
    state: State
    parts: NDArray[np.int64]


class Keeper:
    """Checkpoints of one simulation; collective but for `due`."""

    def __init__(self, checkpoint: Checkpoint, system: FullSystem, identity: Mapping[str, Any]) -> None:
        self._checkpoint, self._identity = checkpoint, identity
        self._comm, self._system = system.comm, system
        self._last = time.monotonic()

    def due(self) -> bool:
        """True on rank 0 when it is time to save."""
        return self._comm.rank == 0 and time.monotonic() - self._last >= self._checkpoint.seconds

    def save(self, reached: Reached, recorder: Recorder) -> None:
        """Save everything after a step."""
        gathered, state = self._system.gathered, reached.state
        arrays = {name: gathered(getattr(state, name)[None])[0] for name in _SPREAD}
        arrays |= {"states.q": gathered(recorder.q), "states.v": gathered(recorder.v)}
        arrays["sums"] = self._comm.reduce(recorder.sums)
        if self._comm.rank == 0:
            arrays |= {"multipliers": state.multipliers, "share": state.share, "parts": reached.parts}
            arrays |= {"recorded.multipliers": recorder.multipliers, "recorded.peaks": recorder.peaks}
            arrays |= {"recorded.friction": recorder.friction}
            arrays |= {f"grip.{name}": array for name, array in vars(state.grip).items()}
            save(self._checkpoint, Saved(reached.step, reached.seconds, self._identity, arrays))
        self._last = time.monotonic()

    def load(self, recorder: Recorder, parts: NDArray[np.int64]) -> Reached | None:
        """The last checkpoint, the recorder filled; None if there is none.  Where it knows none, `parts` are those.

        Raises
        ------
        InputError
            If the file is damaged or belongs to another simulation.
        """
        checkpoint = self._comm.bcast(on_first(self._comm, lambda: load(self._checkpoint, self._identity)))
        if checkpoint is None:
            return None
        arrays, mine = checkpoint.arrays, self._system.mine
        recorder.q[:], recorder.v[:] = mine(arrays["states.q"]), mine(arrays["states.v"])
        recorder.multipliers[:], recorder.peaks[:] = arrays["recorded.multipliers"], arrays["recorded.peaks"]
        recorder.friction[:] = arrays.get("recorded.friction", recorder.friction)
        grip = Grip(**{field.name: arrays.get(f"grip.{field.name}", np.zeros(0)) for field in fields(Grip)})
        recorder.sums[:] = arrays["sums"] if self._comm.rank == 0 else 0.0
        spread = {name: mine(arrays[name]) for name in _SPREAD}
        state = State(**spread, multipliers=arrays["multipliers"], share=arrays["share"], grip=grip)
        return Reached(checkpoint.step, checkpoint.seconds, state, arrays.get("parts", parts))


def _of_friction(system: FullSystem) -> list[Any]:
    """Arrays that define the friction of a system's pads; empty without friction."""
    friction = Friction.of(system.contacts)
    return [] if friction is None else [friction.pads, friction.coefficients, friction.stiffness, friction.arms]


def _digest(*parts: Any) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part if isinstance(part, bytes) else np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()
