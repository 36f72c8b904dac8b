"""Start of a simulation: coordinates, accelerations and multipliers at t = 0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pmr.constraints.dependence import of_rows
from pmr.errors import SimulationError
from pmr.simulation.native import contact as contact_rows
from pmr.simulation.native import friction, quasi_static, terms
from pmr.simulation.native.arrays import A_NEXT, DAMPING, STIFFNESS, V_NEXT, Z_FREE, Z_NEXT, Contact, V, Z
from pmr.simulation.native.form import SystemForm, reach_of_all
from pmr.simulation.native.handles import handle
from pmr.simulation.native.part import Loop
from pmr.simulation.native.scheme import GeneralizedAlpha
from pmr.simulation.start import InitialState, consistent_start
from pmr.system.assembly import Assembly
from pmr.system.contact_rows import ContactRows
from pmr.system.contacts import Contact as SystemContact
from pmr.system.friction import joints_of
from pmr.system.system import System
from pmr.system.terms import first_few

Array = NDArray[np.float64]
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Onset:
    """What drives a system at t = 0, and what it starts with."""

    paths: Sequence[str]
    s: Array  # (P,) m: where they lead
    # of the contacts' sides as `System.sides` has them (sides,): places in m and their rates in m/s
    x: Array
    x_rate: Array
    rows: ContactRows  # of the loop's contacts, `SystemForm.modal`, there
    f: Array  # (i,) N
    initial: Mapping[str, InitialState]  # of each body; those that are missing start at rest, undeformed
    c: Array = field(default_factory=lambda: np.zeros(0))  # (K,): amplitudes of terms


def begin(loop: Loop, form: SystemForm, method: GeneralizedAlpha, onset: Onset) -> None:
    """Bring a loop whose first step is one of `method` to t = 0.

    Where contacts give way, the multipliers follow from the position, and which of those that only push are closed;
    rigid ones hold the acceleration, their own motion left out as in Exudyn.  An initial velocity that violates these
    is corrected by the change of least kinetic energy (`pmr.simulation.start`).

    An InputError is raised where the initial position violates a rigid contact or a size is wrong; a SimulationError
    where contacts that give way depend on each other, and some of them only push.
    """
    rows, state, stiffness = onset.rows, loop.state, loop.modes.stiffness
    C = np.zeros((len(rows.C), len(stiffness)))
    C[:, form.used] = rows.C
    z, v = np.zeros((2, len(stiffness)))
    if onset.initial:
        states = consistent_start(Assembly(form.system), onset.x, onset.x_rate, onset.initial)
        for name, one in form.forms.items():
            start = one.start(states[name])
            z[form.columns[name]], v[form.columns[name]] = start.q, start.v
    D = loop.modes.damping
    free = loop.modes.B.T @ onset.f - (D[0] * v if len(D) == 1 else D @ v) - stiffness * z
    state.modes[Z], state.modes[V] = z, v
    if loop.terms is not None and len(loop.terms.force):
        terms.begin(handle(loop.terms), handle(state), onset.c)
        free += loop.terms.force
    round_off = EPS * C.shape[1] * (np.abs(C) @ np.abs(z) + np.abs(rows.H) @ np.abs(onset.f))
    try:
        state.multipliers[:] = multipliers_of(C, rows.F, free, C @ z + rows.H @ onset.f, round_off, state.contact)
    except NotSettledError as error:
        why = reason(form.modal, C, error.number)
        raise SimulationError(f"march failed at t = 0 s{places_of(onset.paths, onset.s)}: {why}") from None
    if loop.terms is not None and loop.terms.rubbing is not None and len(loop.terms.rubbing.pads):
        friction.start(loop.terms.rubbing, onset.s, state.multipliers)
    if state.contact is not None and len(state.contact.pushes):
        state.contact.force[:] = state.contact.share[:] = state.multipliers
    modes, a = state.modes, free - C.T @ state.multipliers
    modes[Z_NEXT], modes[V_NEXT], modes[A_NEXT] = method.predict(z, v, a)
    held = modes[STIFFNESS] * modes[Z_NEXT] + modes[DAMPING] * modes[V_NEXT]
    modes[Z_FREE] = modes[Z_NEXT] - method.scheme().z_gain * held
    if loop.quasi_static is not None and len(loop.quasi_static.numbers):
        quasi_static.follow(handle(loop.quasi_static), handle(method.scheme()), modes)
    if loop.control is not None:
        loop.control.acceleration[0] = a
    if loop.sides is not None:
        loop.sides.energy[:] = np.nan, 0.0  # the loop takes them to their places


class NotSettledError(Exception):
    """Which rows hold at the start is not settled; `number` is what `pmr.simulation.native.contact.settle` returned."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def multipliers_of(C: Array, F: Array, free: Array, motion: Array, round_off: Array, contact: Contact | None) -> Array:
    """Multipliers (m,) in N of M-orthonormal modes at the start, from F = G + 1/k (m, m); zero in rigid rows.

    Those of rows that give way follow from their `motion` C z + H f (m,) m, which closes those that push; those of
    rigid ones from the accelerations `free` (r,) that the modes would have without any.  Of rows that hardly give way
    the motion is `round_off` (m,) m: where forces explain it that let nothing accelerate, they are those of a body at
    rest, and known sharply.
    A NotSettledError is raised where rows that give way depend on each other, and some of them only push.
    """
    rigid, multipliers = np.all(F == 0.0, axis=1), np.zeros(len(motion))
    if contact is not None and len(contact.pushes):
        multipliers = _closed(contact, F, motion)
    elif not rigid.all():
        resting = np.linalg.lstsq(C.T, free, rcond=None)[0]
        explained = np.all(np.abs(F @ resting - motion)[~rigid] <= round_off[~rigid])
        found = np.linalg.lstsq(F[np.ix_(~rigid, ~rigid)], motion[~rigid], rcond=None)[0]
        multipliers[~rigid] = resting[~rigid] if explained else found
    # Apart: 1/kg beside m/N in one matrix would leave round-off of the first in forces of rows that hardly give way.
    A = C @ C.T
    right = C @ free - A @ multipliers
    multipliers[rigid] = np.linalg.lstsq(A[np.ix_(rigid, rigid)], right[rigid], rcond=None)[0]
    return multipliers


def _closed(contact: Contact, F: Array, motion: Array) -> Array:
    """Close the rows that push where the body stands; multipliers (m,) of the rows that give way, zero for others."""
    gives = np.flatnonzero(np.any(F != 0.0, axis=1))
    clearance = np.where(contact.pushes, contact.clearance, np.nan)[gives]
    of_those = contact_rows.contact(clearance, contact.memory)
    forces, multipliers = motion[gives], np.zeros(len(motion))
    assert of_those is not None
    if contact.reach is not None:  # as in a step, so that it is compiled once
        of_those = of_those._replace(reach=reach_of_all(len(gives), 0, 0))
    failed = contact_rows.settle(handle(of_those), F[np.ix_(gives, gives)], np.zeros((len(gives), len(gives))), forces)
    if failed:
        raise NotSettledError(failed if failed < 0 else int(gives[failed - 1]) + 1)
    contact.closed[gives], multipliers[gives] = of_those.closed, forces
    return multipliers


def reason(system: System, C: Array, failed: int) -> str:
    """Why a step failed that ends with rows C (m, r), in words, from what it returned."""
    if failed == contact_rows.UNSETTLED:
        names = ", ".join(contact.name for contact in system.contacts if contact.clearance is not None)
        return f"which of the rows {names} are closed was not settled in {contact_rows.LIMIT} solves"
    if failed == terms.UNCONVERGED:
        return unconverged(system.term_names, system.contacts)
    return dependence(C[:failed], system.contact_names)


def unconverged(term_names: Sequence[str], contacts: Sequence[SystemContact]) -> str:
    """Why a step failed in which forces of terms and friction have not converged, in words."""
    names = first_few([*term_names, *(f"friction of {joint}" for joint in joints_of(contacts))])
    return (
        f"the forces of {names} do not converge in {terms.LIMIT} iterations of a step; shorter steps help where terms "
        "change the stiffness of a step by some hundred times, or pads stick and slide, close and open again and again"
    )


def places_of(paths: Sequence[str], s: Array) -> str:
    """Where the paths lead, s (P,) m, in words."""
    return "".join(f", {path} at {at:g} m" for path, at in zip(paths, s, strict=False))


def dependence(C: Array, names: Sequence[str]) -> str:
    """Which of the rows C (m, n) depend on each other, in words; `names` begin with theirs."""
    involved = of_rows(C, names[: len(C)]).names
    if len(involved) == 1:
        return f"the row {involved[0]} vanishes"
    return f"the rows {', '.join(involved)} depend on each other"
