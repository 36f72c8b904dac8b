"""Start of a march: accelerations and multipliers at t = 0, as Exudyn finds them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pmr.constraints.dependence import of_rows
from pmr.errors import InputError, SimulationError
from pmr.reduced.model import ReducedModel
from pmr.scene.simulators import refuse
from pmr.simulation.modal import ModalForm
from pmr.simulation.native import contact as contact_rows
from pmr.simulation.native.arrays import A_NEXT, DAMPING, STIFFNESS, V_NEXT, Z_FREE, Z_NEXT, Contact, State, V, Z
from pmr.simulation.native.scheme import GeneralizedAlpha
from pmr.simulation.native.system import state
from pmr.simulation.needs import needs_of
from pmr.simulation.start import InitialState, consistent_start, row_flexibility
from pmr.system.body import SlidingBody, pushing_rows

Array = NDArray[np.float64]


def starting_state(
    form: ModalForm, method: GeneralizedAlpha, s: float, s_rate: float, f: Array, initial: InitialState | None
) -> State:
    """State of a body in modal form at t = 0.

    Where rows give way, the multipliers follow from the position, and which of those that only push are closed; rigid
    rows hold the acceleration, their own motion left out as in Exudyn.

    An InputError is raised where the initial position violates a rigid row or a size is wrong, a rigid row only pushes,
    the body keeps the inertia of its residual part or is but a section of a boom; a SimulationError where rows that
    give way depend on each other, and some of them only push.
    """
    form.body.ensure_whole("model")
    if form.body.flexibility is not None and form.body.flexibility.keeps_inertia:
        allowed = "false is allowed step by step, and where outputs alone are kept; march.simulate keeps it"
        raise InputError("scene", "reduction.residual_inertia", True, allowed)
    body, scheme = form.body, method.scheme()
    start = consistent_start(body, s, s_rate, initial)
    C, free = body.C(s), body.B @ f - body.D @ start.v - np.diagonal(body.K) * start.q
    begun = state(form, scheme, method.memory())
    begun.multipliers[:] = _multipliers(body, s, C, free, f, start.q, begun.contact)
    if begun.contact is not None:
        begun.contact.force[:] = begun.contact.share[:] = begun.multipliers
    modes = begun.modes[:, : body.size]
    z, v, a = method.predict(start.q, start.v, free - C.T @ begun.multipliers)
    modes[Z], modes[V], modes[Z_NEXT], modes[V_NEXT], modes[A_NEXT] = start.q, start.v, z, v, a
    modes[Z_FREE] = z - scheme.z_gain * (modes[STIFFNESS] * z + modes[DAMPING] * v)
    return begun


def _multipliers(
    body: ReducedModel, s: float, C: Array, free: Array, f: Array, z: Array, contact: Contact | None
) -> Array:
    G, rigid = row_flexibility(body, s)
    H = body.flexibility.inputs(s) if body.flexibility else np.zeros((len(C), len(f)))
    if contact is not None:
        refuse("march", needs_of(body, s))
    try:
        return multipliers_of(C, G, free, C @ z + H @ f, contact)
    except NotSettledError as error:
        why = reason(body, s, error.number)
        raise SimulationError(f"march failed at t = 0 s, slider at {s:g} m: {why}") from None


class NotSettledError(Exception):
    """Which rows hold at the start is not settled; `number` is what `pmr.simulation.native.contact.settle` returned."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def multipliers_of(C: Array, F: Array, free: Array, motion: Array, contact: Contact | None) -> Array:
    """Multipliers (m,) in N of M-orthonormal modes at the start, from F = G + 1/k (m, m); zero in rigid rows.

    Those of rows that give way follow from their `motion` C z + H f (m,) m, which closes those that push; those of
    rigid ones from the accelerations `free` (r,) that the modes would have without any.
    A NotSettledError is raised where rows that give way depend on each other, and some of them only push.
    """
    rigid = np.all(F == 0.0, axis=1)
    A, right = np.where(rigid[:, None], C @ C.T, F), np.where(rigid, C @ free, motion)
    if contact is None:
        return np.linalg.lstsq(A, right, rcond=None)[0]
    multipliers = _closed(contact, F, motion)
    multipliers[rigid] = np.linalg.lstsq(A[np.ix_(rigid, rigid)], (right - A @ multipliers)[rigid], rcond=None)[0]
    return multipliers


def _closed(contact: Contact, F: Array, motion: Array) -> Array:
    """Close the rows that push where the body stands; multipliers (m,) of the rows that give way, zero for others."""
    gives = np.flatnonzero(np.any(F != 0.0, axis=1))
    clearance = np.where(contact.pushes, contact.clearance, np.nan)[gives]
    of_those = contact_rows.contact(clearance, contact.memory)
    forces, multipliers = motion[gives], np.zeros(len(motion))
    assert of_those is not None
    failed = contact_rows.settle(of_those, F[np.ix_(gives, gives)], np.zeros((len(gives), len(gives))), forces)
    if failed:
        raise NotSettledError(failed if failed < 0 else int(gives[failed - 1]) + 1)
    contact.closed[gives], multipliers[gives] = of_those.closed, forces
    return multipliers


def reason(body: SlidingBody, s: float, failed: int) -> str:
    """Why a step to s failed, in words, from what `pmr.simulation.native.step.step` returned."""
    if failed == contact_rows.UNSETTLED:
        names = ", ".join(body.row_names[k] for k in pushing_rows(body))
        return f"which of the rows {names} are closed was not settled in {contact_rows.LIMIT} solves"
    return dependence(np.asarray(body.C(s))[:failed], body.row_names)


def dependence(C: Array, names: Sequence[str]) -> str:
    """Which of the rows C (m, n) depend on each other, in words; `names` begin with theirs."""
    involved = of_rows(C, names[: len(C)]).names
    if len(involved) == 1:
        return f"the row {involved[0]} vanishes"
    return f"the rows {', '.join(involved)} depend on each other"
