"""What simulators say of a boom of several sections, in the quantities of any run, and the friction along it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.errors import RELATIVE_FLOOR, Quantity, round_off
from pmr.reduced.model import ReducedModel
from pmr.results import Energy, Response
from pmr.scene import Scene
from pmr.scene.built import force_of, reaction_of
from pmr.scene.names import ALONE, cylinder_of
from pmr.simulation import Excitation
from pmr.simulation.columns import called
from pmr.simulation.modal import inertia_share, support_forces, unpressed
from pmr.simulation.native import systems
from pmr.system.body import FullBody, Trajectory, force_outputs, length_outputs, with_inertia
from pmr.system.contacts import Contact, named
from pmr.system.system import Joined, System, SystemTrajectory

Array = NDArray[np.float64]
Supports = Sequence[tuple[str, str]]  # names and units of rigid supports

#: Kind of contacts that hold an overlap straight: moments, no forces of pads.
STRAIGHT = "straight"
#: Steps beside a kink whose forces are left out.
BESIDE_KINK = 2.0


@dataclass(frozen=True)
class Motion:
    """What a simulator says: outputs (T, o) of every body, forces and peaks (T, m) in N of contacts, energies."""

    outputs: Mapping[str, Array]
    forces: Array
    peaks: Array | None
    energy: Energy


def respond(system: System, trajectory: SystemTrajectory) -> Response:
    """Displacements of all sections, one after the other, and the forces of all contacts and springs."""
    kinetic = np.zeros(len(trajectory.t))
    for name, body in system.bodies.items():
        v = with_inertia(body, trajectory.bodies[name].v)
        kinetic += 0.5 * np.einsum("tn,tn->t", v, (body.M @ v.T).T)
    energy = Energy(kinetic, trajectory.energy - kinetic, -trajectory.work)
    outputs = systems.displacements(system, trajectory)
    found = response_of(system, trajectory.t, Motion(outputs, trajectory.forces, trajectory.peaks, energy))
    least = round_off(system.bodies, trajectory.loads, float(np.ptp(trajectory.t)))
    found = replace(found, seconds=trajectory.seconds, surplus=trajectory.surplus, round_off=least)
    return _with_reactions(found, system, trajectory)


def _with_reactions(response: Response, system: System, trajectory: SystemTrajectory) -> Response:
    """With what reduced sections press on their rigid supports with; full ones where these are contacts."""
    of_bodies, found, first = dict[str, Supports](), dict[str, Array](), 0
    for name, body in system.bodies.items():
        loads = trajectory.loads[:, first : first + len(body.input_names)]
        first += len(body.input_names)
        known, motion = body.reactions, trajectory.bodies[name]
        held = [k for k, one in enumerate(system.contacts) if one.inner.body == name and is_reaction(one)]
        if isinstance(body, FullBody) and held:
            rows = [body.rows.rows[body.row_names.index(system.contacts[k].inner.row)] for k in held]
            of_bodies[name], found[name] = [(row.name, row.unit) for row in rows], trajectory.forces[:, held]
        if not isinstance(body, ReducedModel) or known is None:
            continue
        if name == ALONE:
            forces = support_forces(body, _on_rows(system, body, motion), loads)
        elif body.carriers is None or known.carried is None:
            continue
        else:
            carried = known.carried - body.carriers.values @ inertia_share(body, known).T
            forces = unpressed(body, known, motion, loads)
            own = [side for side in system.sides if side.place.body == name]
            for side, x, force in zip(own, motion.s.T, motion.multipliers.T, strict=True):
                forces -= force[:, None] * (system.row(side.place).weights(x) @ carried)
        forces = forces - _of_terms(system, name, inertia_share(body, known), trajectory)
        of_bodies[name], found[name] = known.supports, forces
    return with_reactions(response, of_bodies, found)


def _on_rows(system: System, body: ReducedModel, motion: Trajectory) -> Trajectory:
    """The motion of a body alone with the path coordinate (T,), and multipliers of all of its rows."""
    multipliers = np.zeros((len(motion.t), len(body.row_names)))
    moving = 0
    for k, side in enumerate(system.sides):
        multipliers[:, body.row_names.index(side.place.row)] = motion.multipliers[:, k]
        moving = k if side.place.path is not None else moving
    s = motion.s[:, moving] if motion.s.shape[1] else np.full(len(motion.t), body.domain[0])
    return replace(motion, s=s, multipliers=multipliers)


def _of_terms(system: System, name: str, P: Array, trajectory: SystemTrajectory) -> Array | float:
    """What terms that vary in time take from the forces on a body's rigid supports, (T, h)."""
    found: Array | float = 0.0
    if trajectory.amplitudes is None:
        return found
    for term, c in zip(system.terms, trajectory.amplitudes.T, strict=True):
        if (work := term.supports.get(name)) is not None:
            motions = [trajectory.bodies[one] for one in term.bodies]
            before = term.bodies.index(name) and system.bodies[term.bodies[0]].size
            for key, A in term.arrays.items():
                own = A[before : before + system.bodies[name].size]
                moved = np.hstack([one.q if key == "stiffness" else one.v for one in motions])
                found = found + c[:, None] * (moved @ (work - P @ own).T)
    return found


def with_reactions(response: Response, of_bodies: Mapping[str, Supports], forces: Mapping[str, Array]) -> Response:
    """With the forces (T, h) of rigid supports, by body, after all other outputs."""
    if not forces:
        return response
    supports = [(body, one, unit) for body, of in of_bodies.items() for one, unit in of]
    return replace(
        response,
        others=np.hstack([*([] if response.others is None else [response.others]), *forces.values()]),
        other_names=(*response.other_names, *(reaction_of(named(body, one)) for body, one, _ in supports)),
        other_units=(*response.other_units, *(unit for *_, unit in supports)),
        kinds=(*response.kinds, *("reaction" for _ in supports)),
        bodies=(*response.bodies, *(body for body, *_ in supports)),
    )


def response_of(system: Joined[Any], t: Array, motion: Motion) -> Response:
    """The same of what any simulator says at the times t (T,) s."""
    moved, springs, others = list[Array](), list[Array](), list[Array]()
    other_names, other_units = list[str](), list[str]()
    x, names, force_names = list[Array](), list[str](), list[str]()
    kinds: tuple[list[str], list[str], list[str]] = ([], [], [])  # of displacements, forces and others
    of_bodies: tuple[list[str], list[str], list[str]] = ([], [], [])
    for name, body in system.bodies.items():
        of, y = called(body), motion.outputs[name]
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
    kept = bearing(system)
    kinds[1].extend(system.contacts[k].kind for k in kept)
    of_bodies[1].extend(system.contacts[k].inner.body for k in kept)
    not_known = np.full(len(t), np.nan)
    return Response(
        t=t,
        x=np.concatenate(x),
        displacement=np.hstack(moved),
        energy=motion.energy,
        slider_force=np.hstack([*springs, motion.forces[:, kept]]),
        residual_position=not_known,
        residual_velocity=not_known,
        seconds=np.nan,
        output_names=tuple(names),
        output_units=("m",) * len(names),
        force_names=(*force_names, *(force_of(system.contact_names[k]) for k in kept)),
        force_peaks=None if motion.peaks is None else np.hstack([*springs, motion.peaks[:, kept]]),
        others=np.hstack(others) if other_names else None,
        other_names=tuple(other_names),
        other_units=tuple(other_units),
        kinds=tuple(kind for one in kinds for kind in one),
        bodies=tuple(body for one in of_bodies for body in one),
    )


def friction(contacts: Sequence[Contact], excitation: Excitation, t: Array, forces: Array) -> dict[str, Array]:
    r"""What a section's pads resist sliding with, (T,) N by section, positive while it slides out.

    .. math:: \tanh(\dot s / v) \sum_k \mu_k |N_k|

    Coulomb's law with the `forces` N (T, m) of the contacts at times t (T,) s; v is the joint's `friction_speed`.  The
    pads' friction also has a moment about the axis, half the section's height times that sum's parts on its two faces:
    neglected.
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
