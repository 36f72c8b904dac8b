"""What simulators say of a boom of several sections, in the quantities of any run, and the friction along it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.errors import RELATIVE_FLOOR, Quantity
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.built import force_of
from pmr.scene.names import ALONE, cylinder_of
from pmr.simulation import Excitation
from pmr.simulation.columns import called
from pmr.system.contacts import Contact, named
from pmr.system.system import Joined

Array = NDArray[np.float64]
Supports = Sequence[tuple[str, str]]  # names and units of rigid supports

#: Kind of contacts that hold an overlap straight: moments, no forces of pads.
STRAIGHT = "straight"
#: Steps beside a kink whose forces are left out.
BESIDE_KINK = 2.0


def friction(contacts: Sequence[Contact], excitation: Excitation, t: Array, forces: Array) -> dict[str, Array]:
    r"""What a section's pads resist sliding with, (T,) N by section, positive while it slides out.

    .. math:: \tanh(\dot s / v) \sum_k \mu_k |N_k|

    Coulomb's law with the `forces` N (T, m) of the contacts at times t (T,) s; v is the joint's `friction_speed`.  What
    it does beside adding to the force of a cylinder is in the equations (`pmr.system.friction`).
    """
    found = {}
    for name, speed in excitation.friction_speeds.items():
        own = [k for k, one in enumerate(contacts) if one.inner.body == name and one.friction]
        if own:
            resisting = np.abs(forces[:, own]) @ [contacts[k].friction for k in own]
            found[name] = np.tanh(excitation.paths[name].rate(t) / speed) * resisting
    return found


def rubbing(contacts: Sequence[Contact], excitation: Excitation, t: Array, forces: Array, more: Array) -> Array:
    """More forces (T, m) of the contacts, with those of cylinders that overcome the friction beside the `forces`.

    Sections hardly give way along the boom, and a joint's friction acts between the two sections that its cylinder
    joins: it adds to that cylinder's force, and to no other one's.
    """
    found, names = more.copy(), [one.name for one in contacts]
    for name, resisting in friction(contacts, excitation, t, forces).items():
        found[:, names.index(cylinder_of(name))] += resisting
    return found


def with_friction(excitation: Excitation, contacts: Sequence[Contact], response: Response) -> Response:
    """With the forces of cylinders that overcome the friction of the pads, too."""
    own, columns = in_response(contacts, response)
    forces = response.slider_force[:, columns]

    def rubbed(of_all: Array) -> Array:
        found = of_all.copy()
        found[:, columns] = rubbing(own, excitation, response.t, forces, of_all[:, columns])
        return found

    peaks = None if response.force_peaks is None else rubbed(response.force_peaks)
    return replace(response, slider_force=rubbed(response.slider_force), force_peaks=peaks)


def in_response(contacts: Sequence[Contact], response: Response) -> tuple[list[Contact], list[int]]:
    """The contacts whose forces a response holds, and their columns."""
    own = [one for one in contacts if force_of(one.name) in response.force_names]
    return own, [response.force_names.index(force_of(one.name)) for one in own]


def quantities(excitation: Excitation, response: Response) -> Mapping[str, Quantity]:
    """What is compared: the last section's tip, all lines, the forces of each kind, and these between kinks.

    At a kink of an extension a force is as high as its step is short or its cylinder stiff: such steps are left out
    ``_between_kinks``, where there are any.
    """
    last, t, stepping = response.outputs[len(response.output_names) - 1].body, response.t, excitation.stepping
    at = [kink for path in excitation.paths.values() for kink in path.kinks(stepping.end)]
    away = np.all([np.abs(t - kink) > BESIDE_KINK * stepping.step for kink in at], axis=0)
    found: dict[str, Quantity] = {
        "tip": lambda one: one.of("tip", body=last),
        "beam": lambda one: one.displacement,
    }
    for kind in dict.fromkeys(force_kinds(response)):
        found[kind] = partial(_forces, kind, slice(None))
        if at:
            found[f"{kind}_between_kinks"] = partial(_forces, kind, away)
    return found


def _forces(kind: str, steps: slice | NDArray[np.bool_], response: Response) -> Array:
    """Zero where a force is nothing beside the largest one of any kind, as that of a cylinder that holds still."""
    which = np.array(force_kinds(response)) == kind
    size = np.abs(response.slider_force).max(axis=0)
    counts = size > RELATIVE_FLOOR * size.max()
    return np.where(counts, response.slider_force, 0.0)[steps][:, which]


def force_kinds(response: Response) -> list[str]:
    """Of each force: ``pad_force``, ``cylinder_force`` or, of supports that give way, ``support_force``."""
    return [f"{one.kind}_force" for one in response.outputs if one.is_force]


def bearing(system: Joined[Any]) -> list[int]:
    """Numbers of the contacts whose forces are outputs; of a body alone they are those that move or only push.

    Forces of rigid supports are reactions.
    """
    kept = [(k, one) for k, one in enumerate(system.contacts) if one.kind != STRAIGHT and not is_reaction(one)]
    alone = ALONE in system.bodies
    return [k for k, one in kept if not alone or one.inner.path is not None or one.clearance is not None]


def is_reaction(contact: Contact) -> bool:
    """Whether a contact is a rigid support of a section, as one of a full body that holds several coordinates."""
    return contact.kind == "support" and contact.compliance == 0.0 and contact.clearance is None


def force_kinds_of(system: Joined[Any]) -> tuple[str, ...]:
    """Of the springs of all bodies and the contacts that bear; all forces of a body alone count as those of pads."""
    springs = [kind for body in system.bodies.values() for kind in called(body).kinds[1]]
    kinds = [*springs, *(system.contacts[k].kind for k in bearing(system))]
    return tuple("pad_force" if ALONE in system.bodies else f"{kind}_force" for kind in kinds)


def tip_columns(system: Joined[Any]) -> list[int]:
    """Which of the displacements are those of the last body's tip."""
    last = list(system.bodies)[-1]
    kinds = [(name, kind) for name, body in system.bodies.items() for kind in called(body).kinds[0]]
    return [k for k, (name, kind) in enumerate(kinds) if name == last and kind.split(" ")[0] == "tip"]


def tip_names(boom: Scene) -> set[str]:
    """What displacements of the last section's tip are called."""
    last = boom.sections[-1]
    return {named(last.name, last.observe.tip_along(direction)) for direction in "yz"}


def columns_of(section: str, response: Response) -> list[int]:
    """Columns of the displacements of a section."""
    return [k for k, one in enumerate(response.outputs) if one.body == section and one.kind in ("beam", "tip")]
