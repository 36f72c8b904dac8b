"""Full-order simulations: run the integrator, record selected quantities, and store checkpoints from which it resumes.

A checkpoint is a file that is complete or does not exist, npz with a JSON header.  It holds the state of a simulation
on any number of ranks, and the records so far.
"""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError, SimulationError, call_on_first_rank
from pmr.fem.distributed import local_csr
from pmr.fem.factor import factor_of, product
from pmr.files import npz
from pmr.files.arrays import Array, Indices
from pmr.files.whole import NotWrittenError
from pmr.fullmodel.model import FullSystem
from pmr.scene.choice import REFERENCE, refuse_unsupported
from pmr.simulation.contact_step import StepParts
from pmr.simulation.excitation import Excitation, side_positions
from pmr.simulation.native.form import path_text
from pmr.simulation.petsc.integrate import ContactState, DividedSteps, Stepped
from pmr.simulation.petsc.recorder import History, Recorder, WallTimes
from pmr.simulation.petsc.rows import BlockFactor, contact_frequency
from pmr.simulation.petsc.start import (
    SampledExcitation,
    State,
    stacked_start,
    starting_state,
    starts_moving,
    static_start,
)
from pmr.simulation.start import Grip, InitialState, needs_of
from pmr.simulation.stepping import Progress, refuse_growth
from pmr.system.contacts import Friction, friction_joints

#: How many times progress is reported.
REPORTS = 1000


def observe(
    system: FullSystem,
    excitation: Excitation,
    states: Sequence[float] = (),
    initial: Mapping[str, InitialState] | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
) -> History:
    """Simulate full models and return the history of their outputs, forces and energies; collective.

    Parameters
    ----------
    system : FullSystem
        System with a positive definite M; `FullSystem.of` makes one of a single model.
    excitation : Excitation
        The system's paths by name, a load for each ``body.input``, and an amplitude for each term, a stiffness or
        damping that varies in time.
    states : sequence of float, s
        Times at which whole states are recorded, at the nearest steps: each step once, in ascending order.
    initial : mapping of str to InitialState, optional
        Initial state of each body, with all its n coordinates, on every rank; bodies that are missing start at rest,
        undeformed.  By default all start as ``excitation.start`` says: at rest or in equilibrium.
    progress : callable, optional
        As for `pmr.simulation.SystemSimulator`.
    checkpoint : Checkpoint, optional
        If its file exists, the simulation resumes from it and divides its steps into the same parts.  On one rank the
        result is the same to the last digit as without interruption; on several ranks it differs by round-off,
        since MUMPS adds up messages in the order of their arrival.

    Raises
    ------
    InputError
        If a path leaves the range of a row, a load is missing, the initial position violates a row, rigid rows move
        and the time integration damps nothing (rho_inf = 1), a rigid row only pushes, or the checkpoint belongs to
        another simulation.
    SimulationError
        If a step fails; with step, time, path coordinates and, where rows depend on each other, their names.  Also if
        the motion grows without bound.
    """
    if initial is None:
        initial = {} if excitation.start == "rest" else static_start(system, excitation)
    return _Run(system, excitation, states, initial).history(progress, checkpoint)


class _Run:
    """One simulation: its excitation on the time grid, the parts of its steps, and its start; errors as `observe`."""

    def __init__(
        self, system: FullSystem, excitation: Excitation, states: Sequence[float], initial: Mapping[str, InitialState]
    ) -> None:
        """Sample the excitation of `system` on its time grid, and compute parts of steps and the start; collective.

        `states` are times in s of recorded states, `initial` the initial states of bodies by name.
        """
        self._begin, self._contacts = time.perf_counter(), len(system.contacts)
        self._system, self._initial, self._excitation = system.with_supports(), initial, excitation
        self._at = sample_excitation(self._system, excitation)
        self._needs = needs_of(self._system, self._system.compliance.rigid, self._at.x, excitation.stepping.rho_inf)
        refuse_unsupported("petsc", self._needs, REFERENCE)
        self._recorder = Recorder(self._system, excitation.stepping, states)
        self._mass, omega = None, 0.0
        if self._needs.pushing_rows or starts_moving(self._system, self._at, initial):
            self._mass = BlockFactor(self._system, lambda model: factor_of(model.M, "M"))
        if self._needs.pushing_rows and self._mass is not None:
            omega = contact_frequency(self._system, self._at.x, self._mass)
        self._lengths = StepParts.for_contacts(excitation.stepping, omega)

    def history(self, progress: Progress | None, checkpoint: Checkpoint | None) -> History:
        """Take all steps, or only those after the `checkpoint` if its file exists; return the history.

        `progress`, if not None, is called with the share of the run that is done; `checkpoint` may be None.
        """
        recorder, keeper, T = self._recorder, None, self._excitation.stepping.steps
        if checkpoint:
            run_identity = identity(self._system, self._excitation, self._at, recorder, self._initial)
            keeper = CheckpointFile(checkpoint, self._system, run_identity)
        checkpointed = keeper.load(recorder) if keeper else None
        reached = checkpointed or ReachedState(
            0, 0.0, starting_state(self._system, self._at, self._initial, self._mass), self._lengths.parts
        )
        steps = self._steps(reached, checkpointed is not None)
        preparation, begin = time.perf_counter() - self._begin, time.perf_counter()
        stride, state = max(1, T // REPORTS), reached.state
        for step in range(reached.step + 1, T + 1):
            state, due = self._step(steps, step, state, keeper is not None and keeper.due())
            recorder.record(step, state, steps.rows, self._at)
            if keeper and (due or step == T):
                seconds = reached.seconds + time.perf_counter() - begin
                keeper.save(replace(reached, step=step, seconds=seconds, state=state), recorder)
            if progress is not None and (step % stride == 0 or step == T):
                progress(step / T)
        seconds = reached.seconds + time.perf_counter() - begin
        steps.destroy()
        history = recorder.history(self._at, WallTimes(seconds, preparation))
        refuse_growth(history.errors.surplus, list(self._needs.rigid_moving_rows))
        m, contacts = self._contacts, history.contacts
        of_contacts = replace(contacts, forces=contacts.forces[:, :m], peaks=contacts.peaks[:, :m])
        return replace(history, contacts=of_contacts, supports=contacts.forces[:, m:])

    def _steps(self, reached: ReachedState, resumed: bool) -> DividedSteps:
        """Integrator of the steps from the reached state on, with the numbers of parts chosen at the beginning.

        The start is recorded, unless the run is `resumed` from a checkpoint.
        """
        system, recorder, state, mass = self._system, self._recorder, reached.state, self._mass
        lengths = replace(self._lengths, parts=reached.parts)
        fine, begun = self._at, reached.step * lengths.finest
        if lengths.finest > 1:
            fine = sample_excitation(system, self._excitation.with_stepping(lengths.stepping.divide(lengths.finest)))
        if mass is not None and not self._needs.pushing_rows:
            mass.destroy()
            mass = None
        steps = DividedSteps(system, lengths, fine, ContactState(system, mass, state), reached.step)
        recorder.follow(state, steps.rows, fine.x[begun], fine.f[begun], fine.c[begun])
        if resumed:
            recorder.forget()
        else:
            recorder.record(0, state, steps.rows, self._at)
        return steps

    def _step(self, steps: DividedSteps, step: int, state: State, due: bool) -> Stepped:
        """Take step number `step` in all parts that `steps` makes; return the state, and whether a checkpoint is due.

        A checkpoint is due on every rank if `due` is true on any rank.  If a step fails, a SimulationError is raised
        with step, time and path coordinates.
        """
        try:
            return steps.step(step, state, due, self._recorder)
        except SimulationError as error:
            at = path_text(tuple(self._excitation.paths), self._at.s[step])
            raise SimulationError(f"stopped at step {step}, t = {self._at.t[step]:g} s{at}: {error}") from None


def sample_excitation(system: FullSystem, excitation: Excitation) -> SampledExcitation:
    """Sample the excitation at t = 0 and at the end of each step.

    The result holds paths, positions and rates of sides, and loads.  Its amplitudes are those of the system's terms,
    followed by the path coordinates of joints with friction.

    Raises
    ------
    InputError
        If a path, load or amplitude of a term is missing, or a path takes a side where its row is not defined.
    """
    names, x = list(excitation.paths), side_positions(system, excitation)
    rates = np.broadcast_to(system.side_rates(dict(zip(names, excitation.rates.T, strict=True))), x.shape)
    f, c = excitation.forces(system.input_names), excitation.amplitudes(system.term_names)
    c = np.column_stack([c, *(excitation.s[:, names.index(joint)] for joint in friction_joints(system.contacts))])
    return SampledExcitation(excitation.times, excitation.s, x, rates, f, c)


_log = logging.getLogger(__name__)

FORMAT = "pmr-checkpoint"
FORMAT_VERSION = 4
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


def _entries_agree(a: object, b: object) -> bool:
    """Whether a stored entry `a` of an identity agrees with the expected entry `b`.

    Numbers in lists agree within the relative deviation `SAME`, everything else only if it is equal.
    """
    if isinstance(b, list):
        return isinstance(a, list) and len(a) == len(b) and np.allclose(a, b, rtol=SAME, atol=0.0)
    return bool(a == b)


#: Arrays of a state of which each rank has a part, and those of a recorder that are the same on every rank.
_SPREAD = tuple(field.name for field in fields(State) if field.name not in ("multipliers", "share", "grip"))
_RECORDED = ("multipliers", "peaks", "friction")


def identity(
    system: FullSystem,
    excitation: Excitation,
    at: SampledExcitation,
    recorder: Recorder,
    initial: Mapping[str, InitialState],
) -> dict[str, Any]:
    """Digests and numbers that distinguish this simulation from others, by name; collective.

    Each matrix A is represented by x^T A y with fixed random vectors x and y.  `at` are paths, loads and terms at the
    steps, `recorder` has the times of recorded states, and `initial` are the initial states of bodies by name.  As
    steps may be divided into parts, paths, loads and terms in the middle of each step count, too.
    """
    stepping, between = excitation.stepping, 0.5 * (excitation.times[:-1] + excitation.times[1:])
    forms = []
    for model in system.models:
        x, y = _random((2, model.size))[:, model.share]
        forms += [x @ product(A, y) for A in (model.M, model.D, model.K, *model.matrices.values())]
        forms.append(x @ (local_csr(model.B) @ _random((len(model.input_names),))))
    rows = list[float]()
    for side, row in zip(system.sides, system.side_rows, strict=True):
        parts = row.coefficients, row.touched, row.carriers @ _random((row.carriers.shape[1],))
        rows += [side.sign, *(float(np.sum(part * _random(part.shape))) for part in parts)]
    start, compliance = stacked_start(system, initial), system.compliance
    varying = [term.value(between) for term in excitation.terms.values()]
    of_terms = {"terms": _digest(repr(system.term_names).encode(), at.c, *varying)} if at.c.size else {}
    return {
        **of_terms,
        "path": _digest(at.x, *(path.value(between) for path in excitation.paths.values())),
        "loads": _digest(at.f, *(load.value(between) for load in excitation.loads.values())),
        "time grid": [stepping.end, stepping.step, stepping.rho_inf],
        "states": recorder.state_steps.tolist(),
        "initial state": _digest(start.q, start.v),
        "rows": rows,
        "contacts": _digest(compliance.constant, compliance.slopes, system.clearance, *_friction_arrays(system)),
        "matrices": [float(value) for value in system.comm.allreduce(np.array(forms))],
    }


@dataclass(frozen=True)
class ReachedState:
    """State of a simulation after `step` steps, which took `seconds` of wall time.

    `parts` (T,) are the numbers of parts of all steps, as chosen when the simulation began.  These numbers are kept
    even if a reduced model that is made again would choose others.
    """

    step: int
    seconds: float
    state: State
    parts: Indices


class CheckpointFile:
    """Writes and reads the checkpoints of one simulation; all methods but `due` are collective."""

    def __init__(self, checkpoint: Checkpoint, system: FullSystem, identity: Mapping[str, object]) -> None:
        """Prepare checkpoints of the simulation of `system` that has this `identity`, in the file of `checkpoint`."""
        self._checkpoint, self._identity = checkpoint, identity
        self._comm, self._system = system.comm, system
        self._last = time.monotonic()

    def due(self) -> bool:
        """Whether a checkpoint has to be written now; always False on other ranks than 0."""
        return self._comm.rank == 0 and time.monotonic() - self._last >= self._checkpoint.seconds

    def save(self, reached: ReachedState, recorder: Recorder) -> None:
        """Write a checkpoint of the state `reached` after a step, and of what `recorder` has so far; collective.

        It replaces the earlier checkpoint in one operation.  If the disk is full, a warning is logged, and the earlier
        checkpoint is kept.
        """
        gathered, state, file = self._system.gather_vectors, reached.state, self._checkpoint.file
        arrays = {name: gathered(getattr(state, name)[None])[0] for name in _SPREAD}
        arrays |= {"states.q": gathered(recorder.q), "states.v": gathered(recorder.v)}
        arrays["sums"] = self._comm.reduce(recorder.sums)
        if self._comm.rank == 0:
            arrays |= {"multipliers": state.multipliers, "share": state.share, "parts": reached.parts}
            arrays |= {f"recorded.{name}": getattr(recorder, name) for name in _RECORDED}
            arrays |= {f"grip.{name}": array for name, array in vars(state.grip).items()}
            header = {"format": FORMAT, "version": FORMAT_VERSION, "identity": dict(self._identity)}
            file.parent.mkdir(parents=True, exist_ok=True)
            try:
                npz.write(file, arrays, header | {"step": reached.step, "seconds": reached.seconds})
            except NotWrittenError as error:
                _log.warning("no checkpoint: %s", error)
        self._last = time.monotonic()

    def load(self, recorder: Recorder) -> ReachedState | None:
        """State of the last checkpoint, with the recorder filled in place; None without a checkpoint.  Collective.

        Raises
        ------
        InputError
            If the file is damaged or belongs to another simulation.
        """
        file, identity = self._checkpoint.file, self._identity
        stored = self._comm.bcast(call_on_first_rank(self._comm, lambda: read_checkpoint(file, identity)))
        if stored is None:
            return None
        arrays, mine = stored.arrays, self._system.local_part
        recorder.q[:], recorder.v[:] = mine(arrays["states.q"]), mine(arrays["states.v"])
        for name in _RECORDED:
            getattr(recorder, name)[:] = arrays[f"recorded.{name}"]
        grip = Grip(**{field.name: arrays[f"grip.{field.name}"] for field in fields(Grip)})
        recorder.sums[:] = arrays["sums"] if self._comm.rank == 0 else 0.0
        spread = {name: mine(arrays[name]) for name in _SPREAD}
        state = State(**spread, multipliers=arrays["multipliers"], share=arrays["share"], grip=grip)
        return ReachedState(stored.step, stored.seconds, state, arrays["parts"])


class StoredCheckpoint(NamedTuple):
    """Number of the last step of a checkpoint, wall time in s up to there, and arrays by name."""

    step: int
    seconds: float
    arrays: dict[str, NDArray[Any]]


def read_checkpoint(file: Path, identity: Mapping[str, object]) -> StoredCheckpoint | None:
    """Checkpoint of a simulation with this identity; None if there is no file.

    Raises InputError if the file is damaged or belongs to another simulation.
    """
    if not file.exists():
        return None
    try:
        arrays = npz.read(file)
        header = npz.pop_header(arrays)
        if (header["format"], header["version"]) != (FORMAT, FORMAT_VERSION):
            raise ValueError("another format")
        reached = StoredCheckpoint(int(header["step"]), float(header["seconds"]), arrays)
        stored = dict(header["identity"])
    except _DAMAGE as error:
        allowed = f"a checkpoint is allowed, this is none ({error}); delete it to start from t = 0"
        raise InputError(str(file), "", None, allowed) from None
    if different := [key for key, value in identity.items() if not _entries_agree(stored.get(key), value)]:
        allowed = f"another simulation's checkpoint: {', '.join(different)} differs; delete it or name another file"
        raise InputError(str(file), "", None, allowed)
    return reached


def _friction_arrays(system: FullSystem) -> list[NDArray[np.generic]]:
    """List numbers (n,), laws (n, l), stiffness (n,) and arms (n,) of n pads with friction; empty if none has any."""
    friction = Friction.from_contacts(system.contacts)
    return [] if friction is None else [friction.pads, friction.laws, friction.stiffness, friction.arms]


def _random(shape: tuple[int, ...]) -> Array:
    """Random numbers in the given `shape`, always the same."""
    return np.random.default_rng(3).standard_normal(shape)


def _digest(*parts: bytes | NDArray[np.generic]) -> str:
    """SHA-256 digest of bytes and arrays."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part if isinstance(part, bytes) else np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()
