"""Why a simulation is refused or fails: what a system requires of a simulator, and texts about failures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pmr.files.arrays import Array, Mask
from pmr.scene.choice import SimulatorNeeds
from pmr.system.body import Body
from pmr.system.contacts import Contact, Friction, friction_joints
from pmr.system.soundness import dependence_of_rows
from pmr.system.system import BodySystem

#: Most names in a message, which gives the number of all further ones.
MOST_NAMES = 3


def describe_dependence(C: Array, names: Sequence[str]) -> str:
    """Text with the names of those rows of C (m, n) that depend on each other; `names` begins with the rows' names."""
    involved = dependence_of_rows(C, names[: len(C)]).names
    if len(involved) == 1:
        return f"the row {involved[0]} vanishes"
    return f"the rows {', '.join(involved)} depend on each other"


def describe_unsettled(names: Sequence[str], pushes: Mask) -> str:
    """Text with the names of the one-sided contacts, which did not settle as open or closed within the kernel's limit.

    `names` are the names of all m contacts, and the mask `pushes` (m,) is true for those that only push.
    """
    pushing = ", ".join(name for name, only_pushes in zip(names, pushes, strict=True) if only_pushes)
    return f"which of the rows {pushing} are closed was not settled in 1000 solves"


def describe_divergence(term_names: Sequence[str], contacts: Sequence[Contact]) -> str:
    """Text about forces of terms, friction or a hoist rope that have not converged in a step or at the start.

    They are called by `term_names` and by the joints of `contacts` with friction; without any, it is the hoist rope.
    """
    causes = [*term_names, *(f"friction of {joint}" for joint in friction_joints(contacts))] or ["the hoist rope"]
    further = len(causes) - MOST_NAMES
    names = ", ".join(causes[:MOST_NAMES]) + (f" and {further} more" if further > 0 else "")
    return (
        f"the forces of {names} do not converge; after the start, shorter steps help where terms change the stiffness "
        "of a step by some hundred times, or pads stick and slide, close and open again and again"
    )


def needs_of(system: BodySystem[Body], rigid: Mask, x: Array, rho_inf: float) -> SimulatorNeeds:
    """Properties of a system that a simulator has to support: contacts that push, are rigid, give way, move or rub.

    Parameters
    ----------
    rigid : (m,) mask
        True for rigid contacts.
    x : (T, sides) array, m
        Positions of the sides of all contacts.
    rho_inf : float
        Spectral radius at infinite frequency.
    """
    pushing, moving = ~np.isnan(system.clearance), np.zeros(len(rigid), bool)
    moving[[system.sides[k].contact for k in np.flatnonzero((x != x[0]).any(axis=0))]] = True

    rubs = Friction.from_contacts(system.contacts)

    def names(which: Mask) -> tuple[str, ...]:
        """Names of the contacts of the mask `which` (m,)."""
        return tuple(name for name, chosen in zip(system.contact_names, which, strict=True) if chosen)

    return SimulatorNeeds(
        pushing_rows=names(pushing),
        rigid_pushing_rows=names(pushing & rigid),
        flexible_rows=names(~rigid),
        rigid_moving_rows=names(rigid & moving),
        friction_rows=() if rubs is None else tuple(system.contact_names[k] for k in rubs.pads),
        hoist=bool(system.hoist),
        rho_inf=rho_inf,
    )
