"""What simulators say of a boom of several sections, in the quantities of any run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.errors import RELATIVE_FLOOR, Quantity
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.keys import ALONE
from pmr.simulation import Excitation
from pmr.simulation.reactions import column_names, is_reaction
from pmr.system.contacts import named
from pmr.system.system import Joined

Array = NDArray[np.float64]
Supports = Sequence[tuple[str, str]]  # names and units of rigid supports

#: Kind of contacts that hold an overlap straight: moments, no forces of pads.
STRAIGHT = "straight"
#: Steps beside a kink whose forces are left out.
BESIDE_KINK = 2.0


def quantities(excitation: Excitation, response: Response) -> Mapping[str, Quantity]:
    """Quantities that are compared: the last section's tip, all lines, forces of each kind, and these between kinks.

    At a kink of an extension a force is as high as its step is short or its cylinder stiff: such steps are left out
    ``_between_kinks``, where there are any.
    """
    last, t, stepping = response.outputs[len(response.output_names) - 1].body, response.t, excitation.stepping
    at = [kink for path in excitation.paths.values() for kink in path.kinks(stepping.end)]
    away = np.all([np.abs(t - kink) > BESIDE_KINK * stepping.step for kink in at], axis=0)
    measures: dict[str, Quantity] = {
        "tip": lambda response: response.of("tip", body=last),
        "beam": lambda response: response.displacement,
    }
    for kind in dict.fromkeys(force_kinds(response)):
        measures[kind] = partial(_forces, kind, slice(None))
        if at:
            measures[f"{kind}_between_kinks"] = partial(_forces, kind, away)
    return measures


def _forces(kind: str, steps: slice | NDArray[np.bool_], response: Response) -> Array:
    """Zero where a force is nothing beside the largest one of any kind, as that of a cylinder that holds still."""
    which = np.array(force_kinds(response)) == kind
    size = np.abs(response.slider_force).max(axis=0)
    counts = size > RELATIVE_FLOOR * size.max()
    return np.where(counts, response.slider_force, 0.0)[steps][:, which]


def force_kinds(response: Response) -> list[str]:
    """Kind of each force: ``pad_force``, ``cylinder_force`` or, of supports that give way, ``support_force``."""
    return [f"{output.kind}_force" for output in response.outputs if output.is_force]


def output_contacts(system: Joined[Any]) -> list[int]:
    """Numbers of the contacts whose forces are outputs; of a body alone they are those that move or only push.

    Forces of rigid supports are reactions.
    """
    bearing_contacts = [
        (k, contact)
        for k, contact in enumerate(system.contacts)
        if contact.kind != STRAIGHT and not is_reaction(contact)
    ]
    alone = ALONE in system.bodies
    return [
        k
        for k, contact in bearing_contacts
        if not alone or contact.inner.path is not None or contact.clearance is not None
    ]


def force_kinds_of(system: Joined[Any]) -> tuple[str, ...]:
    """Kinds of forces of the springs of all bodies and of the contacts that bear; of a body alone all are of pads."""
    springs = [kind for body in system.bodies.values() for kind in column_names(body).kinds[1]]
    kinds = [*springs, *(system.contacts[k].kind for k in output_contacts(system))]
    return tuple("pad_force" if ALONE in system.bodies else f"{kind}_force" for kind in kinds)


def tip_columns(system: Joined[Any]) -> list[int]:
    """Which of the displacements are those of the last body's tip."""
    last = list(system.bodies)[-1]
    kinds = [(name, kind) for name, body in system.bodies.items() for kind in column_names(body).kinds[0]]
    return [k for k, (name, kind) in enumerate(kinds) if name == last and kind.split(" ")[0] == "tip"]


def tip_names(boom: Scene) -> set[str]:
    """Names of displacements of the last section's tip."""
    last = boom.sections[-1]
    return {named(last.name, last.observe.tip_along(direction)) for direction in "yz"}


def columns_of(section: str, response: Response) -> list[int]:
    """Columns of the displacements of a section."""
    return [k for k, output in enumerate(response.outputs) if output.body == section and output.kind in ("beam", "tip")]
