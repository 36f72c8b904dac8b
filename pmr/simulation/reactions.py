r"""Forces on the supports of a boom and on its machine, as columns of a response.

Forces on the rigid supports of a system's bodies follow from their motion (equations: `pmr.system.supports`).

The force and the moment about the pivot by which a boom acts on its machine, in the boom's own axes, are

.. math::
    F = \sum_k \lambda_k n_k, \qquad \mathfrak M = \sum_k (p + r_k) \times \lambda_k n_k

over all connections k between the base section and the ground (pads, supports, and cylinders that are supports), each
with the force :math:`\lambda_k` along the unit vector n_k.  A connection is at r_k from the tail of the base section,
which is at p from the pivot.  As for supports, forces are positive along the axes.

Boom and machine press on rigid ground, through outriggers or wheels, with a force and a moment about the pivot along
the axes of the machine.  These are the sum of F and :math:`\mathfrak M`, of the pull of a hoist's rope on a winch on
the machine, and of the forces and moments of the machine's masses.  A mass m at r, with the inertia I, on a part of
the machine that turns with the angular velocity :math:`\omega`, has

.. math::
    F_m = -m\, (g\, e_Z + \ddot u + A r), \qquad
    \mathfrak M_m = r \times F_m - I \dot\omega - \omega \times I \omega, \qquad
    A = \tilde{\dot\omega} + \tilde\omega \tilde\omega

with the acceleration u'' of the pivot and the vertical e_Z.  The kernel has the forces of outriggers and the margins
against tipping that follow from force and moment (src/ground.c).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pmr.files.arrays import Array
from pmr.kernel.further import DIRECTIONS, ground_outputs
from pmr.kernel.laws import Stand, masses_wrench
from pmr.results import Energy, Response
from pmr.results.response import Output
from pmr.scene import Scene
from pmr.scene.built import force_name, reaction_name
from pmr.scene.choice import motion_directions
from pmr.scene.hoist import WINCH_PULLS
from pmr.scene.keys import ALONE
from pmr.scene.mechanism import (
    AT_PIVOT,
    CYLINDER,
    MOMENT,
    cylinder_force_names,
    ground_contact_wrenches,
    pin_and_cylinder,
)
from pmr.scene.members import members
from pmr.scene.rotation import boom_rotation, motion_of
from pmr.scene.signals import Constant
from pmr.simulation.frame import base_accelerations
from pmr.system.body import FullBody, SlidingBody, Trajectory, kinds_of, names_of, units_of
from pmr.system.contacts import STRAIGHT, Contact, qualified_name
from pmr.system.reduced_model import ReducedModel
from pmr.system.states import SystemTrajectory, outputs_by_carriers
from pmr.system.supports import SupportForces
from pmr.system.system import BodySystem, System

Supports = Sequence[tuple[str, str]]  # names and units of rigid supports


def is_reaction(contact: Contact) -> bool:
    """Whether a contact is a rigid support: its kind is ``support``, and it has neither compliance nor clearance."""
    return contact.kind == "support" and contact.compliance == 0.0 and contact.clearance is None


def with_support_reactions(response: Response, system: System, trajectory: SystemTrajectory) -> Response:
    """Return the response with forces on rigid supports added.

    For reduced bodies, these follow from matrices; supports of full bodies are contacts with forces in the trajectory.
    Bodies whose reactions are not known are left out.
    """
    of_bodies, reactions = dict[str, Supports](), dict[str, Array]()
    for name, columns in system.load_columns.items():
        body, motion, loads = system.bodies[name], trajectory.bodies[name], trajectory.loads[:, columns]
        held = [k for k, contact in enumerate(system.contacts) if contact.inner.body == name and is_reaction(contact)]
        alone = name == ALONE and not system.terms
        if isinstance(body, FullBody) and held and not alone:
            rows = [body.rows.rows[body.row_names.index(system.contacts[k].inner.row)] for k in held]
            of_bodies[name], reactions[name] = [(row.name, row.unit) for row in rows], trajectory.forces[:, held]
        supports = SupportForces.from_body(body, name == ALONE, alone or isinstance(body, ReducedModel))
        if not supports.names:
            continue
        if name == ALONE:
            forces = supports.on_one_path(with_row_multipliers(system, body, motion), loads)
        else:
            moments = None if trajectory.moments is None else system.side_multipliers(name, trajectory.moments)
            pressed = outputs_by_carriers(system, name, motion.s, motion.multipliers, supports.carrier_forces, moments)
            forces = supports.without_contacts(motion, loads) - pressed
        amplitudes = trajectory.amplitudes
        for term, c in () if amplitudes is None else zip(system.terms, amplitudes.T, strict=True):
            for key, table in supports.by_term(system, term, name).items():
                motions = [trajectory.bodies[member] for member in term.bodies]
                states = np.hstack([of.q if key == "stiffness" else of.v for of in motions])
                forces = forces - c[:, None] * (states @ table.T)
        of_bodies[name], reactions[name] = list(zip(supports.names, supports.units, strict=True)), forces
    return with_reactions(response, of_bodies, reactions)


def with_row_multipliers(system: System, body: SlidingBody, motion: Trajectory) -> Trajectory:
    """Return `motion` of a single body with one path coordinate s (T,) and the multipliers (T, m) of all its m rows.

    Multipliers of rows that are no contacts are zero.  s is the coordinate of the last contact that moves, or of the
    first one if none moves; without contacts it is the lower end of the body's range.
    """
    multipliers = np.zeros((len(motion.t), len(body.row_names)))
    moving = 0
    for k, side in enumerate(system.sides):
        multipliers[:, body.row_names.index(side.place.row)] = motion.multipliers[:, k]
        moving = k if side.place.path is not None else moving
    s = motion.s[:, moving] if motion.s.shape[1] else np.full(len(motion.t), body.domain[0])
    return replace(motion, s=s, multipliers=multipliers)


def with_reactions(response: Response, of_bodies: Mapping[str, Supports], forces: Mapping[str, Array]) -> Response:
    """Return the response with the `forces` (T, h) of rigid supports, by body, added after all other outputs.

    `of_bodies` are the names and units of the supports by body, in the order of `forces`.  Without forces the response
    is returned unchanged.
    """
    if not forces:
        return response
    supports = [
        Output(reaction_name(qualified_name(body, name)), "reaction", body, unit=unit)
        for body, of in of_bodies.items()
        for name, unit in of
    ]
    return response.with_others(np.hstack(list(forces.values())), supports)


def with_pivot_force(scene: Scene, response: Response) -> Response:
    """Return the response with the force and moment of the boom on the ground, about the frame's pivot.

    The new columns are forces in N and moments in N m along the boom's axes, one for each direction in which points of
    the base section can move in its model.  The response is returned unchanged if the scene has no frame, or if it
    lacks the force of a contact between a body and the ground.
    """
    if scene.frame is None:
        return response
    total, parts = np.zeros((len(response.t), 6)), dict(zip(response.force_names, response.slider_force.T, strict=True))
    parts |= {} if response.others is None else dict(zip(response.other_names, response.others.T, strict=True))
    for reaction in ground_contact_wrenches(
        scene, {name: path.value(response.t) for name, path in scene.driven_paths.items()}
    ):
        name = next((name for name in reaction.names if name in parts), None)
        if name is None:
            return response
        total += parts[name][:, None] * reaction.wrench
    axes = motion_directions(members(scene)[0])
    numbers = ["xyz".index(axis) if len(axis) == 1 else 3 + "xyz".index(axis[1]) for axis in axes]
    forces = [
        Output(reaction_name(f"{AT_PIVOT} {axis}"), "reaction", scene.names[0], unit="N" if len(axis) == 1 else "N m")
        for axis in axes
    ]
    return response.with_others(total[:, numbers], forces)


def with_luffing_cylinder(scene: Scene, response: Response) -> Response:
    """Return the response with the luffing cylinder's force in N, positive in compression.

    If the cylinder has a stiffness, its force is that of its contact.  Otherwise its force follows from the moment at
    the pivot.  The response is returned unchanged without a cylinder, or if this moment is not known.
    """
    if scene.frame is None or scene.frame.cylinder is None:
        return response
    if scene.holding_cylinder is not None:
        force = _first_stored_force(response, cylinder_force_names(scene))
    elif MOMENT not in response.other_names:
        return response
    else:
        arm = scene.frame.cylinder.length_and_arm(scene.frame.angles.luffing.value(response.t)).arm
        force = response.other(MOMENT) / arm
    return response.with_others(force[:, None], [Output(CYLINDER, "reaction", scene.names[0], unit="N")])


def with_force_of_pin(scene: Scene, response: Response) -> Response:
    r"""Return the response with the force of the pin at the pivot, in place of the forces of the pin's two supports.

    .. math:: F_{pin} = \sum_k \lambda_k n_k + F d

    The sum is over the pin's supports along and across the boom and the support that stands for the luffing cylinder in
    the model; :math:`\lambda_k` is the force on support k along n_k.  The cylinder's thrust F acts on the boom along d
    and on the machine along -d.  Pin and cylinder together exert the sum of the supports' forces on the machine, so the
    pin's force is this sum without the cylinder's part -F d.  The two outputs that held the forces on the pin's
    supports now hold the pin's force along and across the boom.  This is the force of a pin at the pivot, about which
    the frame turns, even if the model has its pin elsewhere.  The response is unchanged if the base is held in another
    way, or if a force is unknown.
    """
    held = pin_and_cylinder(scene)
    if held is None or CYLINDER not in response.other_names or not set(held.pin) <= set(response.other_names):
        return response
    assert scene.frame is not None and scene.frame.cylinder is not None and response.others is not None
    force = response.other(CYLINDER)
    along, across = (force[:, None] * scene.frame.cylinder.direction(scene.frame.angles.luffing.value(response.t))).T
    other_outputs = response.others.copy()
    other_outputs[:, response.other_names.index(held.pin[0])] += along
    other_outputs[:, response.other_names.index(held.pin[1])] += across + _first_stored_force(response, held.across)
    return replace(response, others=other_outputs)


def _first_stored_force(response: Response, names: Sequence[str]) -> Array:
    """Force (T,) of a response, by the first of `names` that the response has; one of them has to be there."""
    name = next(label for label in names if label in response.force_names or label in response.other_names)
    if name in response.force_names:
        return response.slider_force[:, response.force_names.index(name)]
    return response.other(name)


def with_forces_at_pivot(scene: Scene, response: Response) -> Response:
    """Return the response with force and moment at the pivot, and with the forces of luffing cylinder and pin.

    Forces that the scene does not have, or that are not known, are left out.
    """
    return with_force_of_pin(scene, with_luffing_cylinder(scene, with_pivot_force(scene, response)))


def outputs_of_ground(scene: Scene) -> tuple[Output, ...]:
    """Return name, kind and unit of each of the `Stand.columns`, in order, of a scene with a ground."""
    units = ground_outputs(scene)
    legs = 0 if scene.frame is None or scene.frame.ground is None else len(scene.frame.ground.outriggers)
    kinds = ["reaction"] * len(DIRECTIONS) + ["outrigger"] * legs
    kinds += ["margin"] * (len(units) - len(kinds) - 1) + ["tipping"]
    return tuple(
        Output(name, kind, scene.names[0], unit=unit) for (name, unit), kind in zip(units.items(), kinds, strict=True)
    )


def machine_wrench(scene: Scene, t: Array) -> Array:
    """Force and moment about the pivot (T, 6), in N and N m, by weight and inertia of the machine's masses.

    The components are along the axes of the machine, at times t (T,) in s; `scene` has a frame with a ground.
    """
    frame = scene.frame
    assert frame is not None and frame.ground is not None  # the caller has checked it
    signals = (frame.angles[1], *(frame.base_angles or (Constant(amount=0.0),) * 3))
    angles = np.array([motion_of(angle, t) for angle in signals])
    falling = np.zeros((len(t), 3))
    for axis, signal in enumerate(base_accelerations(scene)):
        falling[:, axis] = signal.value(t)
    if scene.gravity is not None:
        falling[:, 2] += scene.gravity.signal.value(t)
    return masses_wrench(frame.ground.masses, angles.transpose(2, 1, 0), falling)


def _winch_wrench(scene: Scene, response: Response) -> Array:
    """Force and moment about the pivot (T, 6), in N and N m, by which the hoist's rope pulls a winch on the machine.

    The components are along the axes of the machine.  The result is zero if no winch is on the machine.
    """
    hoist, frame = scene.hoist, scene.frame
    if hoist is None or hoist.winch.section or frame is None:
        return np.zeros((len(response.t), 6))
    on_ground = np.stack([response.other(name) for name in WINCH_PULLS], axis=1)
    pull = np.einsum("tji,tj->ti", frame.base_rotation(response.t), on_ground)
    still = np.zeros(len(response.t))
    place = boom_rotation(still, np.atleast_1d(frame.angles[1].value(response.t)) + still) @ np.array(hoist.winch.at)
    return np.hstack([pull, np.cross(place, pull)])


def with_forces_on_machine(scene: Scene, response: Response) -> Response:
    """Return the response with the forces at the pivot (`with_forces_at_pivot`), and on the ground and its outriggers.

    Margins against tipping are added, too.  A planar boom has no force along y and no moments about x and z at the
    pivot: they count as 0.  Without a ground, or if force and moment at the pivot are not known, forces on the ground
    and margins are left out.
    """
    response = with_forces_at_pivot(scene, response)
    if scene.frame is None or scene.frame.ground is None:
        return response
    columns = {axis: reaction_name(f"{AT_PIVOT} {axis}") for axis in DIRECTIONS}
    planar = not {columns[axis] for axis in ("y", "rx", "rz")} & set(response.other_names)
    wrench = np.zeros((len(response.t), 6))
    for k, (axis, name) in enumerate(columns.items()):
        if name in response.other_names:
            wrench[:, k] = response.other(name)
        elif not (planar and axis in ("y", "rx", "rz")):
            return response
    turned = np.stack([wrench[:, :3], wrench[:, 3:]], axis=1) @ np.swapaxes(scene.frame.rotation(response.t), 1, 2)
    total = turned.reshape(-1, 6) + machine_wrench(scene, response.t) + _winch_wrench(scene, response)
    return response.with_others(Stand.of_ground(scene.frame.ground).columns(total), outputs_of_ground(scene))


def outputs_of(system: BodySystem[Any]) -> list[Output]:
    """List name, kind, body and unit of each output of a system: the outputs of its first body, then of the next."""
    return [
        Output.from_text(qualified_name(name, label), kind, name, None, unit)
        for name, body in system.bodies.items()
        for label, kind, unit in zip(names_of(body), kinds_of(body), units_of(body), strict=True)
    ]


def output_contacts(system: BodySystem[Any]) -> list[int]:
    """Numbers of the contacts of `system` whose forces are outputs.

    Rigid supports are left out, since their forces are reactions, and so are contacts of the kind `STRAIGHT`.  For a
    single body, contacts that neither move nor only push are left out too.
    """
    contacts, numbers = system.contacts, range(len(system.contacts))
    bearing = [k for k in numbers if contacts[k].kind != STRAIGHT and not is_reaction(contacts[k])]
    if ALONE not in system.bodies:
        return bearing
    return [k for k in bearing if contacts[k].inner.path is not None or contacts[k].clearance is not None]


def response_to_motion(
    system: BodySystem[Any],
    t: Array,
    simulated: Mapping[str, Array],
    forces: Array,
    peaks: Array | None,
    energy: Energy,
) -> Response:
    """Response to any simulator's motion at the times t (T,) in s; its solver time and residuals are set to NaN.

    `simulated` are the outputs (T, o) of each body by name, `forces` and `peaks` (T, m) in N those of all contacts.
    `peaks` are the largest forces within each step, None if no step has parts; `energy` has the energies at all times.
    """
    outputs, contacts = outputs_of(system), output_contacts(system)
    y = np.hstack([simulated[name] for name in system.bodies])
    x = np.concatenate([body.output_positions for body in system.bodies.values()])
    lengths = [k for k, output in enumerate(outputs) if output.is_displacement]
    springs = [k for k, output in enumerate(outputs) if output.is_force]
    remaining = [k for k, output in enumerate(outputs) if not (output.is_displacement or output.is_force)]
    joined = [system.contacts[k] for k in contacts]
    shown = [outputs[k] for k in [*lengths, *springs]]
    shown += [Output(force_name(contact.name), contact.kind, contact.inner.body, unit="N") for contact in joined]
    shown += [outputs[k] for k in remaining]
    names, last = tuple(output.name for output in shown), len(lengths) + len(springs) + len(contacts)
    not_known = np.full(len(t), np.nan)
    return Response(
        t=t,
        x=x[lengths],
        displacement=y[:, lengths],
        energy=energy,
        slider_force=np.hstack([y[:, springs], forces[:, contacts]]),
        residual_position=not_known,
        residual_velocity=not_known,
        seconds=np.nan,
        output_names=names[: len(lengths)],
        output_units=("m",) * len(lengths),
        force_names=names[len(lengths) : last],
        force_peaks=None if peaks is None else np.hstack([y[:, springs], peaks[:, contacts]]),
        others=y[:, remaining] if remaining else None,
        other_names=names[last:],
        other_units=tuple(output.unit for output in shown[last:]),
        kinds=tuple(output.text for output in shown),
        bodies=tuple(output.body for output in shown),
    )
