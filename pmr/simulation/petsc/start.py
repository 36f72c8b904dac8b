r"""State of a full-order system at t = 0: velocities, accelerations and multipliers, as march and Exudyn find them.

.. math::
    \lambda_y = k\, C_y q_0, \qquad
    \begin{bmatrix} M & C_r^T \\ C_r & 0 \end{bmatrix} \begin{bmatrix} \ddot q_0 \\ \lambda_r \end{bmatrix}
    = \begin{bmatrix} B f - D v_0 - K q_0 - C_y^T \lambda_y \\ 0 \end{bmatrix}

with the contacts that give way (y) and the rigid ones (r), whose own motion is left out.  One that only pushes has
lambda_y = k (C_y q_0 - c) where that is positive, and none elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pmr.errors import on_first
from pmr.fem.factor import product
from pmr.fem.matrices import local_csr
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.system import FullSystem
from pmr.kernel.laws import solve_contact
from pmr.simulation.excitation import Excitation
from pmr.simulation.grip import Grip
from pmr.simulation.native.systems import static_start as equilibrium
from pmr.simulation.petsc.effective import BlockFactor
from pmr.simulation.petsc.rows import contact_rows
from pmr.simulation.petsc.terms import Terms
from pmr.simulation.start import InitialState, check_impulse, check_position, check_state, row_drift

Array = NDArray[np.float64]


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
class Onset:
    """Places x (q,) m of the sides, their rates, loads f (i,) N and amplitudes c (K,) of terms at t = 0."""

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
        return dict(equilibrium(gathered, excitation))

    return dict(system.comm.bcast(on_first(system.comm, make)))


def starting_state(
    system: FullSystem, onset: Onset, initial: Mapping[str, InitialState], mass: BlockFactor | None
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
            q, v, nothing, nothing.copy(), multipliers, multipliers.copy(), _initial_grip(system, onset, multipliers)
        )
    C, soft, pushes = contact_rows(system, onset.x), ~system.compliance.rigid, ~np.isnan(system.clearance)
    excess = C @ start.q - np.nan_to_num(system.clearance)
    F = system.gives(onset.x)[np.ix_(soft, soft)]
    multipliers[soft] = solve_contact(F, excess[soft], pushes[soft], excess[soft] > 0.0)[0]
    held = _Held(system, onset, mass)
    v -= held.impulse(start)
    force = _forces(system, onset.f, q, v) + Terms(system).forces(q, v, onset.c)
    force -= system.mine((C.T @ multipliers)[None])[0]
    acceleration, multipliers[~soft] = held.acceleration(force)
    share, grip = np.where(pushes, multipliers, 0.0), _initial_grip(system, onset, multipliers)
    return State(q, v, acceleration.copy(), acceleration, multipliers, share, grip)


def _initial_grip(system: FullSystem, onset: Onset, multipliers: Array) -> Grip:
    return Grip.at_start(system.contacts, onset.c[len(system.term_names) :], multipliers)


def moves_at_once(system: FullSystem, onset: Onset, initial: Mapping[str, InitialState]) -> bool:
    """Whether anything acts or moves at t = 0; the same on every rank."""
    load = any(np.any(local_csr(model.inputs) @ onset.f[at]) for model, at in _inputs(system))
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

    def __init__(self, system: FullSystem, onset: Onset, mass: BlockFactor) -> None:
        rigid = system.compliance.rigid
        self._comm, self._factor = system.comm, mass
        self._names = tuple(name for name, stiff in zip(system.contact_names, rigid, strict=True) if stiff)
        self._C = contact_rows(system, onset.x)[rigid].toarray()
        self._turning = contact_rows(system, onset.x, onset.rates)[rigid].toarray()
        self._mine = system.mine(self._C)
        self._answers = mass.solve_columns(np.ascontiguousarray(self._mine.T))  # M^-1 C^T
        self._G = self._comm.allreduce(self._mine @ self._answers)

    def impulse(self, start: InitialState) -> Array:
        """This rank's rows of what a velocity has too much, of least kinetic energy."""
        check_position(self._C, start.q, self._names)
        drift = row_drift(self._C, self._turning, 1.0, start)
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
