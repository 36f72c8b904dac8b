r"""State of a full-order system, at t = 0, and the forces of terms and friction in it.

State of a full-order system at t = 0: velocities, accelerations and multipliers, as march and Exudyn find them.

.. math::
    \lambda_y = k\, C_y q_0, \qquad
    \begin{bmatrix} M & C_r^T \\ C_r & 0 \end{bmatrix} \begin{bmatrix} \ddot q_0 \\ \lambda_r \end{bmatrix}
    = \begin{bmatrix} B f - D v_0 - K q_0 - C_y^T \lambda_y \\ 0 \end{bmatrix}

with the contacts that give way (y) and the rigid ones (r), whose own motion is left out.  One that only pushes has
lambda_y = k (C_y q_0 - c) where that is positive, and none elsewhere.

Terms that vary in time (`pmr.system.terms`) in full order: forces on a step's right-hand side, iterated.

The factor of S = M + dv D + dq K stays: the forces w of the terms begin with those of the predicted end of the step,
and with multipliers and motion they are found anew until they no longer change, one more solve a time.  How fast is
said in pmr/kernel/src/terms.c; two to four times are the rule: such a step costs as many of the others.  Where that is
not enough, iterates are extrapolated (pmr/kernel/src/extrapolation.c).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.errors import SimulationError, on_first
from pmr.fem.compat import MPI
from pmr.fem.distributed import local_csr
from pmr.fem.factor import product
from pmr.fullmodel.model import FullModel, FullSystem
from pmr.kernel.laws import FixedPoint, solve_contact
from pmr.simulation.excitation import Excitation
from pmr.simulation.native import systems
from pmr.simulation.petsc.rows import BlockFactor, PathRows, contact_rows
from pmr.simulation.refusals import describe_divergence
from pmr.simulation.start import Grip, InitialState, check_impulse, check_position, check_state, row_drift, slide
from pmr.system.contacts import Friction

Array = NDArray[np.float64]
Product = Callable[[Array], Array]

#: Change of forces that counts as none, and the one that is accepted after the last iteration, over the largest so far.
CONVERGED, ACCEPTED = 1e-11, 1e-8
#: Iterations of a step at most; a change so many times the largest force, or the first one of the step, diverges.
LIMIT, DIVERGED = 100, 1e6
#: Directions that are stored for the extrapolation of forces: two vectors each.
MOST_DIRECTIONS = 16


@dataclass(frozen=True)
class Rubbed:
    """Friction: forces on this rank's coordinates (n_local,) N, sums (J,) N of joints, gaps (m,) m."""

    force: Array | float
    sums: Array
    gap: Array  # of cylinders, that give way to the sums
    at_limits: float = 0.0  # square of the force with all pads at their limits, this rank's share


class Terms:
    """Forces of a system's terms on this rank's coordinates; collective."""

    def __init__(self, system: FullSystem) -> None:
        self._comm, self._names = system.comm, system.term_names
        self._unconverged = describe_divergence(system.term_names, system.contacts, LIMIT)
        self._parts = list[tuple[int, Any, Product | None, Product | None]]()
        names = list(system.bodies)
        for number, term in enumerate(system.terms):
            rows = [np.arange(at.start, at.stop) for at in (system.local[names.index(name)] for name in term.bodies)]
            stiffness, damping = (_product(system, term.bodies, A) for A in (term.stiffness, term.damping))
            self._parts.append((number, np.concatenate(rows), stiffness, damping))
        self._largest = self._first = self._widest = 0.0
        self._friction = Friction.of(system.contacts)
        self._iteration: FixedPoint | None = None

    def __bool__(self) -> bool:
        return bool(self._parts) or self._friction is not None

    def forces(self, q: Array, v: Array, c: Array) -> Array:
        """W = -sum_k c_k (V_k v + G_k q), this rank's rows (n_local,), of q and v given likewise."""
        forces = np.zeros_like(q)
        for number, at, stiffness, damping in self._parts:
            for multiplied, state in ((stiffness, q), (damping, v)):
                if multiplied is not None:
                    forces[at] -= c[number] * multiplied(state[at])
        return forces

    def rubbed(self, rows: PathRows, multipliers: Array, grip: Grip) -> Rubbed:
        """Friction with the rows where they stand, under multipliers (m,)."""
        if self._friction is None:
            return Rubbed(0.0, np.zeros(0), np.zeros(len(multipliers)))
        friction, limits = self._friction, grip.limits
        moments, most = friction.moments(grip.forces, multipliers), np.abs(friction.moments(limits, multipliers))
        self._widest = max(self._widest, float(friction.gaps(limits).max(initial=0.0)))
        at_limits = float(np.sum(rows.transposed_slopes(most) ** 2))
        force, sums = rows.transposed_slopes(moments), friction.totals(grip.forces)
        return Rubbed(force, sums, friction.gaps_of(sums), at_limits)

    def slide(self, old: Grip, rubbed: Rubbed, c: Array, h: float, multipliers: Array, matrix: Array) -> Grip:
        """Friction of the pads after a step of h s, at the joints' places, which stand behind the amplitudes c."""
        if self._friction is None:
            return old
        return slide(self._friction, old, rubbed.sums, c[len(self._names) :], h, multipliers, matrix)

    def begin_step(self) -> None:
        """Begin an iteration anew: at a step, and where contacts that open change what it leads to."""
        if self._iteration is not None:
            self._iteration.restart()

    def extrapolate(self, w: Array, old: Rubbed, new_w: Array, new: Rubbed) -> tuple[Array, Rubbed]:
        """The forces and the friction of the next iteration, from those of this one and what follows from them."""
        size, first = len(w), self._comm.rank == 0  # sums of joints count once
        if self._iteration is None:
            self._iteration = FixedPoint(size + len(new.sums), MOST_DIRECTIONS, self._comm.allreduce)
        x, phi = (np.append(force, first * rubbed.sums) for force, rubbed in ((w, old), (new_w, new)))
        following = self._iteration.next(x, phi)
        if self._friction is None:
            return following, new
        sums = self._comm.bcast(following[size:])
        return following[:size], replace(new, sums=sums, gap=self._friction.gaps_of(sums))

    def at_rest(self, old: Rubbed, new: Rubbed) -> bool:
        """Whether the gaps no longer change."""
        self._widest = max(self._widest, float(np.abs(new.gap).max(initial=0.0)))
        return bool(np.abs(new.gap - old.gap).max(initial=0.0) <= CONVERGED * self._widest)

    def settled(self, old: Array, new: Array, times: int, rubbed: Rubbed) -> bool:
        """Whether the forces no longer change; a SimulationError is raised where they diverge or never settle."""
        sums = self._comm.allreduce(np.array([np.sum((new - old) ** 2), np.sum(new**2), rubbed.at_limits]), MPI.SUM)
        change, size, at_limits = (float(np.sqrt(total)) for total in sums)
        largest = max(self._largest, size, at_limits)
        if not change > (ACCEPTED if times >= LIMIT else CONVERGED) * largest:
            self._largest = largest
            return True
        if times == 1:
            self._first = size
        if times >= LIMIT or change > DIVERGED * max(self._largest, self._first) > 0.0:
            raise SimulationError(self._unconverged)
        return False


def _product(system: FullSystem, bodies: tuple[str, ...], A: Any) -> Product | None:
    """This rank's rows of A x from its rows of x, of stacked bodies."""
    if A is None:
        return None
    if not (sp.issparse(A) or isinstance(A, np.ndarray)):
        return lambda x: np.asarray(product(A, x))
    models = [system.bodies[name] for name in bodies]
    first = np.cumsum([0, *(model.size for model in models)])
    mine = np.concatenate([at + np.arange(model.size)[model.share] for at, model in zip(first, models, strict=False)])
    rows = sp.csr_matrix(A)
    moving = np.unique(rows.indices)
    is_local, positions = np.isin(mine, moving), np.searchsorted(moving, mine)
    of_mine = rows[mine][:, moving]

    def multiply(x: Array) -> Array:
        vector = np.zeros(len(moving))
        vector[positions[is_local]] = x[is_local]
        return np.asarray(of_mine @ system.comm.allreduce(vector, MPI.SUM))

    return multiply


@dataclass(frozen=True)
class State:
    """This rank's rows (n_local,) of position, velocity, acceleration-like variable and acceleration.

    The multipliers lambda (m,), their `share` (m,) in the acceleration-like variable where contacts only push, and the
    `grip` of pads that rub are the same on every rank.
    """

    q: Array
    v: Array
    a: Array
    acceleration: Array
    multipliers: Array
    share: Array
    grip: Grip = field(default_factory=Grip)


@dataclass(frozen=True)
class Sampled:
    """An excitation on a time grid: paths s (T, P) m, places x (T, q) m of the sides, their rates, loads f (T, i) N.

    Amplitudes of terms are c (T, K), the paths of joints with friction behind them.
    """

    t: Array
    s: Array
    x: Array
    rates: Array
    f: Array
    c: Array


def static_start(system: FullSystem, excitation: Excitation) -> dict[str, InitialState]:
    """Every body at rest in equilibrium with the loads at t = 0, whole, on every rank; collective.

    Raises
    ------
    InputError
        If the contacts do not hold the bodies.
    """
    gathered = system.gather()

    def make() -> dict[str, InitialState]:
        assert gathered is not None
        return dict(systems.static_start(gathered, excitation))

    return dict(system.comm.bcast(on_first(system.comm, make)))


def starting_state(
    system: FullSystem, at: Sampled, initial: Mapping[str, InitialState], mass: BlockFactor | None
) -> State:
    """State at the start; collective.  `mass` is a factor of M, needed where anything acts or moves.

    Raises
    ------
    InputError
        If the initial position violates a rigid contact, a size is wrong, or contacts depend on each other.
    """
    start = whole_start(system, initial)
    q, v = system.mine(start.q), system.mine(start.v)
    multipliers = np.zeros(len(system.contacts))
    if mass is None:
        nothing = np.zeros_like(q)
        return State(
            q, v, nothing, nothing.copy(), multipliers, multipliers.copy(), _initial_grip(system, at, multipliers)
        )
    C, soft, pushes = contact_rows(system, at.x[0]), ~system.compliance.rigid, ~np.isnan(system.clearance)
    excess = C @ start.q - np.nan_to_num(system.clearance)
    F = system.gives(at.x[0])[np.ix_(soft, soft)]
    multipliers[soft] = solve_contact(F, excess[soft], pushes[soft], excess[soft] > 0.0)[0]
    held = _Held(system, at, mass)
    v -= held.impulse(start)
    force = _forces(system, at.f[0], q, v) + Terms(system).forces(q, v, at.c[0])
    force -= system.mine((C.T @ multipliers)[None])[0]
    acceleration, multipliers[~soft] = held.acceleration(force)
    share, grip = np.where(pushes, multipliers, 0.0), _initial_grip(system, at, multipliers)
    return State(q, v, acceleration.copy(), acceleration, multipliers, share, grip)


def _initial_grip(system: FullSystem, at: Sampled, multipliers: Array) -> Grip:
    return Grip.at_start(system.contacts, at.c[0][len(system.term_names) :], multipliers)


def moves_at_once(system: FullSystem, at: Sampled, initial: Mapping[str, InitialState]) -> bool:
    """Whether anything acts or moves at t = 0; the same on every rank."""
    load = any(np.any(local_csr(model.inputs) @ at.f[0][inputs]) for model, inputs in _inputs(system))
    start = whole_start(system, initial)
    return bool(system.comm.allreduce(int(bool(load or np.any(start.q) or np.any(start.v)))))


def whole_start(system: FullSystem, initial: Mapping[str, InitialState]) -> InitialState:
    """Coordinates and velocities (n,) of all bodies; at rest, undeformed, where none are given.

    Raises
    ------
    InputError
        If a size is wrong.
    """
    parts = [
        check_state(initial[name], model.size) if name in initial else InitialState.at_rest(model.size)
        for name, model in system.bodies.items()
    ]
    return InitialState(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("q", "v")))


def _forces(system: FullSystem, f: Array, q: Array, v: Array) -> Array:
    """This rank's rows of B f - D v - K q."""
    forces = np.empty_like(q)
    for (model, inputs), at in zip(_inputs(system), system.local, strict=True):
        forces[at] = local_csr(model.inputs) @ f[inputs] - product(model.D, v[at]) - product(model.K, q[at])
    return forces


def _inputs(system: FullSystem) -> list[tuple[FullModel, slice]]:
    return list(zip(system.models, system.inputs, strict=True))


class _Held:
    """M with the rigid contacts at one place each."""

    def __init__(self, system: FullSystem, at: Sampled, mass: BlockFactor) -> None:
        rigid = system.compliance.rigid
        self._comm, self._factor = system.comm, mass
        self._names = tuple(name for name, stiff in zip(system.contact_names, rigid, strict=True) if stiff)
        self._C = contact_rows(system, at.x[0])[rigid].toarray()
        self._turning = contact_rows(system, at.x[0], at.rates[0])[rigid].toarray()
        self._mine = system.mine(self._C)
        self._answers = mass.solve_columns(np.ascontiguousarray(self._mine.T))  # M^-1 C^T
        self._G = self._comm.allreduce(self._mine @ self._answers)

    def impulse(self, start: InitialState) -> Array:
        """This rank's rows of what a velocity has too much, of least kinetic energy."""
        check_position(self._C, start.q, self._names)
        drift = row_drift(self._C, self._turning, start)
        if drift is None:
            return np.zeros(len(self._answers))
        impulse = np.linalg.lstsq(self._G, drift, rcond=None)[0]
        check_impulse(self._G @ impulse, drift, self._names)
        return np.asarray(self._answers @ impulse)

    def acceleration(self, force: Array) -> tuple[Array, Array]:
        """This rank's rows of the acceleration under a force given likewise, and the contacts' multipliers."""
        free = self._factor.solve(force)
        multipliers = np.linalg.lstsq(self._G, self._comm.allreduce(self._mine @ free), rcond=None)[0]
        return free - self._answers @ multipliers, multipliers
