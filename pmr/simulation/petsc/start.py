r"""State of a full-order system at t = 0; also the forces of terms and friction in a step.

Velocities, accelerations and multipliers at t = 0 are those of the compiled simulator and of Exudyn:

.. math::
    \lambda_y = k\, C_y q_0, \qquad
    \begin{bmatrix} M & C_r^T \\ C_r & 0 \end{bmatrix} \begin{bmatrix} \ddot q_0 \\ \lambda_r \end{bmatrix}
    = \begin{bmatrix} B f - D v_0 - K q_0 - C_y^T \lambda_y \\ 0 \end{bmatrix}

The index y marks contacts that give way, with the stiffness k, and r marks rigid contacts; C are rows, :math:`\lambda`
multipliers, q_0 and v_0 coordinates and velocities at t = 0, and B f the loads.  The accelerations that the motion of
rigid rows itself causes are neglected.  A contact that only pushes, with the clearance c, has lambda_y = k (C_y q_0 -
c) if this is positive, and 0 otherwise.

Terms that vary in time (`pmr.system.terms`) are forces on a step's right-hand side, found by iteration with the
unchanged factor of S = M + dv D + dq K.  The first forces w of the terms are those at the predicted end of the step;
they are computed again from multipliers and motion until they no longer change, with one more solve each time.  The
file pmr/kernel/src/terms.c says how fast they converge; two to four iterations are the rule, and such a step costs as
much as this many others.  If that is not enough, iterates are extrapolated (pmr/kernel/src/extrapolation.c).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import compress
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from pmr.errors import SimulationError, call_on_first_rank
from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import local_csr
from pmr.fem.factor import product
from pmr.files.arrays import Array
from pmr.fullmodel.model import FullModel, FullSystem
from pmr.kernel.laws import FixedPoint, solve_contact
from pmr.simulation.excitation import Excitation
from pmr.simulation.native import systems
from pmr.simulation.petsc.rows import BlockFactor, PathRows, contact_rows
from pmr.simulation.start import (
    Grip,
    InitialState,
    complete_states,
    describe_divergence,
    slide,
    start_drift,
    start_impulses,
)
from pmr.system.contacts import Friction

Product = Callable[[Array], Array]

#: Change of forces that counts as zero, and change accepted after the last iteration, over the largest force so far.
CONVERGED, ACCEPTED = 1e-11, 1e-8
#: Most iterations of a step; a change this many times the largest force so far, or the step's first, means divergence.
LIMIT, DIVERGED = 100, 1e6
#: Number of directions, of two vectors each, that are stored for the extrapolation of forces.
MOST_DIRECTIONS = 16


@dataclass(frozen=True)
class PadFriction:
    """Friction of pads: forces (n_local,) in N on this rank's coordinates, sums (J,) in N of J joints, gaps (m,)."""

    force: Array | float
    sums: Array
    gap: Array  # (m,) m: displacements of cylinders by the sums
    at_limits: float = 0.0  # square of the force with all pads at their limits, this rank's share


class Terms:
    """Forces of a system's terms and of friction on this rank's coordinates; collective.

    As a condition an object is true if the system has terms or friction.
    """

    def __init__(self, system: FullSystem) -> None:
        """Collect the matrices of the terms of `system` and the friction of its pads; collective."""
        self._comm, self._names = system.comm, system.term_names
        self._unconverged = describe_divergence(system.term_names, system.contacts)
        self._parts = list[tuple[int, Any, Product | None, Product | None]]()
        names = list(system.bodies)
        for number, term in enumerate(system.terms):
            rows = [
                np.arange(at.start, at.stop) for at in (system.local_slices[names.index(name)] for name in term.bodies)
            ]
            stiffness, damping = (_product(system, term.bodies, A) for A in (term.stiffness, term.damping))
            self._parts.append((number, np.concatenate(rows), stiffness, damping))
        self._largest = self._first = self._widest = 0.0
        self._friction = Friction.from_contacts(system.contacts)
        self._iteration: FixedPoint | None = None

    def __bool__(self) -> bool:
        """Whether the system has any term or any friction, so that there are forces to compute."""
        return bool(self._parts) or self._friction is not None

    def forces(self, q: Array, v: Array, c: Array) -> Array:
        """Forces w = -sum_k c_k (V_k v + G_k q) by the terms with amplitudes c (K,), this rank's part (n_local,).

        q and v are this rank's parts (n_local,) of the coordinates and rates.
        """
        forces = np.zeros_like(q)
        for number, at, stiffness, damping in self._parts:
            for multiplied, state in ((stiffness, q), (damping, v)):
                if multiplied is not None:
                    forces[at] -= c[number] * multiplied(state[at])
        return forces

    def pad_friction(self, rows: PathRows, multipliers: Array, grip: Grip) -> PadFriction:
        """Friction at the rows' current positions, by contact forces `multipliers` (m,) in N and friction `grip`.

        The friction is zero if no pad rubs.  The call also stores the largest compression of a cylinder so far with
        pads at their limits of friction, to which `have_converged` compares changes.
        """
        if self._friction is None:
            return PadFriction(0.0, np.zeros(0), np.zeros(len(multipliers)))
        friction, limits = self._friction, grip.limits
        moments, most = friction.moments(grip.forces, multipliers), np.abs(friction.moments(limits, multipliers))
        self._widest = max(self._widest, float(friction.compressions(limits).max(initial=0.0)))
        at_limits = float(np.sum(rows.transposed_slopes(most) ** 2))
        force, sums = rows.transposed_slopes(moments), friction.joint_totals(grip.forces)
        return PadFriction(force, sums, friction.compressions_by_totals(sums), at_limits)

    def slide(self, old: Grip, rubbed: PadFriction, c: Array, h: float, multipliers: Array, matrix: Array) -> Grip:
        """Friction of the pads after a step of h s, from `old` at its beginning; `old` itself if no pad rubs.

        `rubbed` is the friction of the last iteration.  c (K + J,) are the amplitudes of the K terms, followed by the
        path coordinates of the J joints at the step's end; `multipliers` (m,) and `matrix` (m, m) as in
        `pmr.simulation.start.slide`.
        """
        if self._friction is None:
            return old
        return slide(self._friction, old, rubbed.sums, c[len(self._names) :], h, multipliers, matrix)

    def begin_step(self) -> None:
        """Start a new iteration: at each step, and again if contacts that open change the step's result."""
        if self._iteration is not None:
            self._iteration.restart()

    def extrapolate(self, w: Array, old: PadFriction, new_w: Array, new: PadFriction) -> tuple[Array, PadFriction]:
        """Forces and friction with which the next iteration begins; collective.

        The last iteration began with the forces w (n_local,) and the friction `old`; its results are `new_w` (n_local,)
        and `new`.
        """
        size, first = len(w), self._comm.rank == 0  # sums of joints count once
        if self._iteration is None:
            self._iteration = FixedPoint(size + len(new.sums), MOST_DIRECTIONS, self._comm.allreduce)
        x, phi = (np.append(force, first * rubbed.sums) for force, rubbed in ((w, old), (new_w, new)))
        following = self._iteration.next(x, phi)
        if self._friction is None:
            return following, new
        sums = self._comm.bcast(following[size:])
        return following[:size], replace(new, sums=sums, gap=self._friction.compressions_by_totals(sums))

    def have_converged(self, w: Array, old: PadFriction, new_w: Array, new: PadFriction, times: int) -> bool:
        """Whether forces and gaps no longer change in the last of `times` iterations of a step; collective.

        The iteration is as in `extrapolate`.  Changes are compared with the largest forces so far, friction of pads at
        their limits included, and with the widest gap so far.  Raises SimulationError if the forces diverge, or if
        forces or gaps have not converged after `LIMIT` iterations.
        """
        sums = self._comm.allreduce(np.array([np.sum((new_w - w) ** 2), np.sum(new_w**2), new.at_limits]), MPI.SUM)
        change, size, at_limits = (float(np.sqrt(total)) for total in sums)
        largest, share = max(self._largest, size, at_limits), ACCEPTED if times >= LIMIT else CONVERGED
        if not change > share * largest:
            self._largest, self._widest = largest, max(self._widest, float(np.abs(new.gap).max(initial=0.0)))
            if np.abs(new.gap - old.gap).max(initial=0.0) <= share * self._widest:
                return True
        if times == 1:
            self._first = size
        if times >= LIMIT or change > DIVERGED * max(self._largest, self._first) > 0.0:
            raise SimulationError(self._unconverged)
        return False


def _product(system: FullSystem, bodies: tuple[str, ...], A: PETSc.Mat | sp.csr_matrix | None) -> Product | None:
    """Function from this rank's rows of x, of stacked bodies, to its rows of A x; None if A is None.

    A call of the function is collective.
    """
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
        """This rank's rows (n_local,) of A x, from its part x (n_local,); collective."""
        vector = np.zeros(len(moving))
        vector[positions[is_local]] = x[is_local]
        return np.asarray(of_mine @ system.comm.allreduce(vector, MPI.SUM))

    return multiply


@dataclass(frozen=True)
class State:
    """State of a full-order system: this rank's parts (n_local,) of q, v, acceleration-like a and acceleration.

    The multipliers lambda (m,) in N, their `share` (m,) in the acceleration-like variable for contacts that only push,
    and the friction `grip` of pads are the same on every rank.
    """

    q: Array
    v: Array
    a: Array
    acceleration: Array
    multipliers: Array
    share: Array
    grip: Grip = field(default_factory=Grip)


@dataclass(frozen=True)
class SampledExcitation:
    """An excitation at T times, with a row for each time: paths s (T, P) in m and loads f (T, i).

    The sides of contacts have positions x (T, sides) in m and rates in m/s.  The columns of c are the amplitudes of the
    K terms, followed by the path coordinates of joints with friction.
    """

    t: Array
    s: Array
    x: Array
    rates: Array
    f: Array
    c: Array


def static_start(system: FullSystem, excitation: Excitation) -> dict[str, InitialState]:
    """States of all bodies at rest in equilibrium with the loads at t = 0, by the body's name; collective.

    All ranks get the same states.

    Raises
    ------
    InputError
        If the contacts do not hold the bodies.
    """
    gathered = system.gather()

    def make() -> dict[str, InitialState]:
        """States of all bodies of the gathered system, by the body's name; called on the first rank alone."""
        assert gathered is not None
        return dict(systems.static_start(gathered, excitation))

    return dict(system.comm.bcast(call_on_first_rank(system.comm, make)))


def starting_state(
    system: FullSystem, at: SampledExcitation, initial: Mapping[str, InitialState], mass: BlockFactor | None
) -> State:
    """State at t = 0, under the paths, loads and terms `at`; collective.

    `mass` is a factor of M.  It may be None if nothing acts or moves and no contact only pushes, because all forces and
    accelerations are then zero.  Velocities that violate rigid contacts are changed with the least kinetic energy.

    Raises
    ------
    InputError
        If the initial position violates a rigid contact, a size is wrong, or contacts depend on each other.
    """
    start = stacked_start(system, initial)
    q, v = system.local_part(start.q), system.local_part(start.v)
    multipliers = np.zeros(len(system.contacts))
    if mass is None:
        nothing = np.zeros_like(q)
        return State(
            q, v, nothing, nothing.copy(), multipliers, multipliers.copy(), _initial_grip(system, at, multipliers)
        )
    C, soft, pushes = contact_rows(system, at.x[0]), ~system.compliance.rigid, ~np.isnan(system.clearance)
    excess = C @ start.q - np.nan_to_num(system.clearance)
    F = system.contact_compliance(at.x[0])[np.ix_(soft, soft)]
    multipliers[soft] = solve_contact(F, excess[soft], pushes[soft], excess[soft] > 0.0)[0]
    held = _HeldMass(system, at, mass)
    v -= held.impulse(start)
    force = _forces(system, at.f[0], q, v) + Terms(system).forces(q, v, at.c[0])
    force -= system.local_part((C.T @ multipliers)[None])[0]
    acceleration, multipliers[~soft] = held.acceleration(force)
    share, grip = np.where(pushes, multipliers, 0.0), _initial_grip(system, at, multipliers)
    return State(q, v, acceleration.copy(), acceleration, multipliers, share, grip)


def _initial_grip(system: FullSystem, at: SampledExcitation, multipliers: Array) -> Grip:
    """Friction of pads at t = 0, which is zero, under the contact forces `multipliers` (m,).

    `at` has the path coordinates of the pads' joints.
    """
    return Grip.at_start(system.contacts, at.c[0][len(system.term_names) :], multipliers)


def starts_moving(system: FullSystem, at: SampledExcitation, initial: Mapping[str, InitialState]) -> bool:
    """Whether a load of `at` acts, or a body is deformed or moves, at t = 0; the same on every rank.

    `initial` are the initial states of bodies by name; bodies that are missing are undeformed and at rest.  Errors as
    `stacked_start`.
    """
    load = any(np.any(local_csr(model.B) @ at.f[0][inputs]) for model, inputs in _inputs(system))
    start = stacked_start(system, initial)
    return bool(system.comm.allreduce(int(bool(load or np.any(start.q) or np.any(start.v)))))


def stacked_start(system: FullSystem, initial: Mapping[str, InitialState]) -> InitialState:
    """Coordinates and velocities (n,) of all bodies, stacked; those of bodies that `initial` does not name are zero.

    Raises
    ------
    InputError
        If `initial` has a name that no body of the system has, or a size is wrong.
    """
    states = complete_states({name: model.size for name, model in system.bodies.items()}, initial).values()
    return InitialState(*(np.concatenate([getattr(state, part) for state in states]) for part in ("q", "v")))


def _forces(system: FullSystem, f: Array, q: Array, v: Array) -> Array:
    """This rank's rows (n_local,) of B f - D v - K q, from this rank's parts of v and q and the loads f (i,)."""
    forces = np.empty_like(q)
    for (model, inputs), at in zip(_inputs(system), system.local_slices, strict=True):
        forces[at] = local_csr(model.B) @ f[inputs] - product(model.D, v[at]) - product(model.K, q[at])
    return forces


def _inputs(system: FullSystem) -> list[tuple[FullModel, slice]]:
    """Pairs of each model and the slice of its inputs."""
    return list(zip(system.models, system.input_slices, strict=True))


class HeldAcceleration(NamedTuple):
    """This rank's part of an acceleration, and the multipliers of the rigid contacts."""

    value: Array  # (n_local,)
    multipliers: Array  # (rigid contacts,) N


class _HeldMass:
    """Mass matrix with the rigid contacts at t = 0."""

    def __init__(self, system: FullSystem, at: SampledExcitation, mass: BlockFactor) -> None:
        """Compute the responses of the bodies to forces of rigid contacts, with `mass`, the factor of M; collective.

        The contacts of `system` are at their positions in the excitation `at` at t = 0.
        """
        rigid = system.compliance.rigid
        self._comm, self._factor = system.comm, mass
        self._names = tuple(compress(system.contact_names, rigid))
        self._C = contact_rows(system, at.x[0])[rigid].toarray()
        self._turning = contact_rows(system, at.x[0], at.rates[0])[rigid].toarray()
        self._mine = system.local_part(self._C)
        self._answers = mass.solve_columns(np.ascontiguousarray(self._mine.T))  # M^-1 C^T
        self._G = self._comm.allreduce(self._mine @ self._answers)

    def impulse(self, start: InitialState) -> Array:
        """This rank's rows (n_local,) of the velocity in `start` minus the consistent velocity; zero if both agree.

        Of all consistent velocities, the one is taken whose difference from the velocity in `start` has the least
        kinetic energy.  Raises InputError if the position violates a rigid contact, or if rigid contacts depend on each
        other.
        """
        drift = start_drift(self._C, self._turning, start, self._names)
        if drift is None:
            return np.zeros(len(self._answers))
        return np.asarray(self._answers @ start_impulses(self._G, drift, self._names))

    def acceleration(self, force: Array) -> HeldAcceleration:
        """Acceleration of the held bodies by a force, of which this rank has the part `force` (n_local,); collective.

        With it, the multipliers of the rigid contacts are returned.
        """
        free = self._factor.solve(force)
        multipliers = np.linalg.lstsq(self._G, self._comm.allreduce(self._mine @ free), rcond=None)[0]
        return HeldAcceleration(free - self._answers @ multipliers, multipliers)
