"""What simulators say of a boom of several sections, in the quantities of any run, and the friction along it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.errors import RELATIVE_FLOOR, Quantity
from pmr.reduced.model import ReducedModel
from pmr.results import Energy, Response
from pmr.scene import Scene
from pmr.scene.built import force_of, reaction_of
from pmr.scene.names import cylinder_of
from pmr.simulation.columns import called
from pmr.simulation.modal import inertia_share, unpressed
from pmr.simulation.native import systems
from pmr.system.body import force_outputs, length_outputs
from pmr.system.contacts import Contact, named
from pmr.system.system import Joined, System, SystemTrajectory

Array = NDArray[np.float64]

#: Steps beside a kink whose forces are left out.
BESIDE_KINK = 2.0


@dataclass(frozen=True)
class Motion:
    """What a simulator says: outputs (T, o) of every body, forces and peaks (T, m) in N of contacts, energies."""

    outputs: Mapping[str, Array]
    forces: Array
    peaks: Array
    energy: Energy


def respond(system: System, trajectory: SystemTrajectory) -> Response:
    """Displacements of all sections, one after the other, and the forces of all contacts and springs."""
    kinetic = np.zeros(len(trajectory.t))
    for name, body in system.bodies.items():
        v = trajectory.bodies[name].v
        kinetic += 0.5 * np.einsum("tn,tn->t", v, (body.M @ v.T).T)
    energy = Energy(kinetic, trajectory.energy - kinetic, -trajectory.work)
    outputs = systems.displacements(system, trajectory)
    found = response_of(system, trajectory.t, Motion(outputs, trajectory.forces, trajectory.peaks, energy))
    return _with_reactions(replace(found, seconds=trajectory.seconds, surplus=trajectory.surplus), system, trajectory)


def _with_reactions(response: Response, system: System, trajectory: SystemTrajectory) -> Response:
    """With what reduced sections press on their rigid supports with."""
    names, units, columns, of_bodies, first = list[str](), list[str](), list[Array](), list[str](), 0
    for name, body in system.bodies.items():
        loads = trajectory.loads[:, first : first + len(body.input_names)]
        first += len(body.input_names)
        known, motion = body.reactions, trajectory.bodies[name]
        if not isinstance(body, ReducedModel) or body.carriers is None or known is None or known.carried is None:
            continue
        carried = known.carried - body.carriers.values @ inertia_share(body, known).T
        forces = unpressed(body, known, motion, loads)
        own = [side for side in system.sides if side.place.body == name]
        for side, x, force in zip(own, motion.s.T, motion.multipliers.T, strict=True):
            forces -= force[:, None] * (system.row(side.place).weights(x) @ carried)
        names += [reaction_of(named(name, one)) for one in known.names]
        of_bodies += [name] * len(known.names)
        units += known.units
        columns.append(forces)
    if not names:
        return response
    others = [] if response.others is None else [response.others]
    return replace(
        response,
        others=np.hstack([*others, *columns]),
        other_names=(*response.other_names, *names),
        other_units=(*response.other_units, *units),
        kinds=(*response.kinds, *("reaction" for _ in names)),
        bodies=(*response.bodies, *of_bodies),
    )


def response_of(system: Joined[Any], t: Array, motion: Motion) -> Response:
    """The same of what any simulator says at the times t (T,) s."""
    moved, springs, others = list[Array](), list[Array](), list[Array]()
    other_names, other_units = list[str](), list[str]()
    x, names, force_names = list[Array](), list[str](), list[str]()
    kinds: tuple[list[str], list[str], list[str]] = ([], [], [])  # of displacements, forces and others
    of_bodies: tuple[list[str], list[str], list[str]] = ([], [], [])
    for name, body in system.bodies.items():
        of, y = called(body, ()), motion.outputs[name]
        moved.append(y[:, length_outputs(body)])
        springs.append(y[:, force_outputs(body)])
        others.append(y[:, ~(length_outputs(body) | force_outputs(body))])
        other_names += [named(name, one) for one in of.others]
        other_units += of.other_units
        x.append(body.output_positions[length_outputs(body)])
        names += [named(name, one) for one in of.moved]
        force_names += [named(name, one) for one in of.forces]
        for columns, bodies, found in zip(kinds, of_bodies, of.kinds, strict=True):
            columns += found
            bodies += [name] * len(found)
    bearing = [k for k, contact in enumerate(system.contacts) if contact.kind != "straight"]
    kinds[1].extend(system.contacts[k].kind for k in bearing)
    of_bodies[1].extend(system.contacts[k].inner.body for k in bearing)
    not_known = np.full(len(t), np.nan)
    return Response(
        t=t,
        x=np.concatenate(x),
        displacement=np.hstack(moved),
        energy=motion.energy,
        slider_force=np.hstack([*springs, motion.forces[:, bearing]]),
        residual_position=not_known,
        residual_velocity=not_known,
        seconds=np.nan,
        output_names=tuple(names),
        output_units=("m",) * len(names),
        force_names=(*force_names, *(force_of(system.contact_names[k]) for k in bearing)),
        force_peaks=np.hstack([*springs, motion.peaks[:, bearing]]),
        others=np.hstack(others) if other_names else None,
        other_names=tuple(other_names),
        other_units=tuple(other_units),
        kinds=tuple(kind for one in kinds for kind in one),
        bodies=tuple(body for one in of_bodies for body in one),
    )


def friction(boom: Scene, contacts: Sequence[Contact], response: Response) -> dict[str, Array]:
    r"""What a section's pads resist sliding with, (T,) N by section, positive while it slides out.

    .. math:: \tanh(\dot s / v) \sum_k \mu_k |N_k|

    Coulomb's law with the forces N of the pads themselves; v is the joint's `friction_speed`.  The pads' friction also
    has a moment about the axis, half the section's height times that sum's parts on its two faces: neglected.
    """
    found = {}
    for part in boom.sections[1:]:
        assert part.joint is not None  # as the checks say
        own = [one for one in contacts if one.inner.body == part.name and one.friction]
        if own:
            columns = [response.force_names.index(force_of(one.name)) for one in own]
            resisting = np.abs(response.slider_force[:, columns]) @ [one.friction for one in own]
            found[part.name] = np.tanh(boom.paths[part.name].rate(response.t) / part.joint.friction_speed) * resisting
    return found


def with_friction(boom: Scene, contacts: Sequence[Contact], response: Response) -> Response:
    """With the forces of cylinders that overcome the friction of the pads, too.

    Sections hardly give way along the boom, and a joint's friction acts between the two sections that its cylinder
    joins: it adds to that cylinder's force, and to no other one's.
    """
    forces, peaks = response.slider_force.copy(), response.force_peaks
    peaks = None if peaks is None else peaks.copy()
    for name, resisting in friction(boom, contacts, response).items():
        column = response.force_names.index(force_of(cylinder_of(name)))
        forces[:, column] += resisting
        if peaks is not None:
            peaks[:, column] += resisting
    return replace(response, slider_force=forces, force_peaks=peaks)


def quantities(boom: Scene, response: Response) -> Mapping[str, Quantity]:
    """What is compared: the last section's tip, all lines, the forces of each kind, and these between kinks.

    At a kink of an extension a force is as high as its step is short or its cylinder stiff: such steps are left out
    ``_between_kinks``, where there are any.
    """
    last, t = boom.names[-1], response.t
    at = [kink for path in boom.paths.values() for kink in path.kinks(boom.time.end)]
    away = np.all([np.abs(t - kink) > BESIDE_KINK * boom.time.step for kink in at], axis=0)
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


def tip_columns(system: Joined[Any]) -> list[int]:
    """Which of the displacements are those of the last body's tip."""
    last = list(system.bodies)[-1]
    kinds = [(name, kind) for name, body in system.bodies.items() for kind in called(body, ()).kinds[0]]
    return [k for k, (name, kind) in enumerate(kinds) if name == last and kind.split(" ")[0] == "tip"]


def tip_names(boom: Scene) -> set[str]:
    """What displacements of the last section's tip are called."""
    last = boom.sections[-1]
    return {named(last.name, last.observe.tip_along(direction)) for direction in "yz"}


def columns_of(section: str, response: Response) -> list[int]:
    """Columns of the displacements of a section."""
    return [k for k, one in enumerate(response.outputs) if one.body == section and one.kind in ("beam", "tip")]
