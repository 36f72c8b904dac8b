"""Forces on the rigid supports of a system's bodies, from their motion (`pmr.reduced.reactions` has the equations)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmr.reduced.model import ReducedModel
from pmr.results import Response
from pmr.scene.built import reaction_of
from pmr.scene.names import ALONE
from pmr.simulation.modal import forces_without_rows, inertia_share, support_forces
from pmr.system.body import FullBody, SlidingBody, Trajectory
from pmr.system.contacts import Contact, named
from pmr.system.system import System, SystemTrajectory

Array = NDArray[np.float64]
Supports = Sequence[tuple[str, str]]  # names and units of rigid supports


def is_reaction(contact: Contact) -> bool:
    """Whether a contact is a rigid support of a section, as one of a full body that holds several coordinates."""
    return contact.kind == "support" and contact.compliance == 0.0 and contact.clearance is None


def with_support_reactions(response: Response, system: System, trajectory: SystemTrajectory) -> Response:
    """Add forces on rigid supports; of full bodies of several, or with terms, where supports are contacts."""
    of_bodies, reactions, first = dict[str, Supports](), dict[str, Array](), 0
    for name, body in system.bodies.items():
        loads = trajectory.loads[:, first : first + len(body.input_names)]
        first += len(body.input_names)
        body_reactions, motion = body.reactions, trajectory.bodies[name]
        held = [k for k, contact in enumerate(system.contacts) if contact.inner.body == name and is_reaction(contact)]
        alone = name == ALONE and not system.terms
        if isinstance(body, FullBody) and held and not alone:
            rows = [body.rows.rows[body.row_names.index(system.contacts[k].inner.row)] for k in held]
            of_bodies[name], reactions[name] = [(row.name, row.unit) for row in rows], trajectory.forces[:, held]
        if body_reactions is None or not (alone or isinstance(body, ReducedModel)):
            continue
        if name == ALONE:
            forces = support_forces(body, on_rows(system, body, motion), loads)
        elif body.carriers is None or body_reactions.carried is None:
            continue
        else:
            carried = body_reactions.carried - body.carriers.values @ inertia_share(body, body_reactions).T
            forces = forces_without_rows(body, body_reactions, motion, loads)
            body_sides = [side for side in system.sides if side.place.body == name]
            for side, x, force in zip(body_sides, motion.s.T, motion.multipliers.T, strict=True):
                forces -= force[:, None] * (system.row(side.place).weights(x) @ carried)
                if trajectory.moments is not None:
                    turned = system.row(side.place).weights(x, 1) @ carried
                    forces += side.sign * trajectory.moments[:, side.contact, None] * turned
        forces = forces - _of_terms(system, name, inertia_share(body, body_reactions), trajectory)
        of_bodies[name], reactions[name] = body_reactions.supports, forces
    return with_reactions(response, of_bodies, reactions)


def on_rows(system: System, body: SlidingBody, motion: Trajectory) -> Trajectory:
    """The motion of a body alone with the path coordinate (T,), and multipliers of all of its rows."""
    multipliers = np.zeros((len(motion.t), len(body.row_names)))
    moving = 0
    for k, side in enumerate(system.sides):
        multipliers[:, body.row_names.index(side.place.row)] = motion.multipliers[:, k]
        moving = k if side.place.path is not None else moving
    s = motion.s[:, moving] if motion.s.shape[1] else np.full(len(motion.t), body.domain[0])
    return replace(motion, s=s, multipliers=multipliers)


def _of_terms(system: System, name: str, P: Array, trajectory: SystemTrajectory) -> Array | float:
    """Part of the forces (T, h) on a body's rigid supports that terms that vary in time carry."""
    total: Array | float = 0.0
    if trajectory.amplitudes is None:
        return total
    for term, c in zip(system.terms, trajectory.amplitudes.T, strict=True):
        if (work := term.supports.get(name)) is not None:
            motions = [trajectory.bodies[member] for member in term.bodies]
            before = term.bodies.index(name) and system.bodies[term.bodies[0]].size
            for key, A in term.arrays.items():
                inertia_part = A[before : before + system.bodies[name].size]
                states = np.hstack([motion.q if key == "stiffness" else motion.v for motion in motions])
                total = total + c[:, None] * (states @ (work - P @ inertia_part).T)
    return total


def with_reactions(response: Response, of_bodies: Mapping[str, Supports], forces: Mapping[str, Array]) -> Response:
    """Add the forces (T, h) of rigid supports, by body, after all other outputs."""
    if not forces:
        return response
    supports = [(body, name, unit) for body, of in of_bodies.items() for name, unit in of]
    return replace(
        response,
        others=np.hstack([*([] if response.others is None else [response.others]), *forces.values()]),
        other_names=(*response.other_names, *(reaction_of(named(body, name)) for body, name, _ in supports)),
        other_units=(*response.other_units, *(unit for *_, unit in supports)),
        kinds=(*response.kinds, *("reaction" for _ in supports)),
        bodies=(*response.bodies, *(body for body, *_ in supports)),
    )
