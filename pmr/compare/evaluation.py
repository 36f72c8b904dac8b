"""What simulated motions mean: outputs, forces, energies and residuals of a system, block by block."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.booms import output_contacts
from pmr.compare.errors import force_round_off, refuse_infinite, round_off
from pmr.results import Energy, Response
from pmr.scene.built import force_of, friction_of
from pmr.scene.keys import ALONE
from pmr.simulation.balance import blocks, potential
from pmr.simulation.native import systems
from pmr.simulation.reactions import column_names, on_rows, with_support_reactions
from pmr.simulation.stepping import Ended
from pmr.system.body import SlidingBody, Trajectory, force_outputs, length_outputs, with_inertia
from pmr.system.contacts import Friction, named
from pmr.system.states import SystemTrajectory
from pmr.system.system import Joined, System

Array = NDArray[np.float64]

#: What a response has of each step beside its energies.
HISTORIES = (
    "t", "displacement", "slider_force", "residual_position", "residual_velocity", "force_peaks", "others",
)  # fmt: skip


def respond(system: System, trajectory: SystemTrajectory) -> Response:
    """Displacements of all bodies, one after the other, forces of contacts, springs and supports, and energies.

    Raises SimulationError if outputs, forces or energies overflow.
    """
    evaluation = Evaluation(system, trajectory.t, trajectory.loads)
    for block in blocks(len(trajectory.t)):
        evaluation(block.start, trajectory.at(block))
    return evaluation.response(Ended(trajectory.seconds, trajectory.surplus))


class Evaluation:
    """Takes blocks of a system's motion at times t (T,) in s and makes the response of them: no state is kept.

    Loads are (T, i) in N.
    """

    def __init__(self, system: System, t: Array, loads: Array) -> None:
        self._system, self._t, self._loads = system, t, loads
        self._columns: dict[str, Array] = {}
        self._found: Response | None = None

    def __call__(self, first: int, part: SystemTrajectory) -> None:
        """Evaluate the steps from number `first` on; raises SimulationError as `respond`."""
        response, rows = _evaluate(self._system, part), slice(first, first + len(part.t))
        arrays = {name: getattr(response, name) for name in HISTORIES}
        for name, values in (arrays | vars(response.energy)).items():
            if values is not None:
                if name not in self._columns:
                    self._columns[name] = np.empty((len(self._t), *values.shape[1:]))
                self._columns[name][rows] = values
        self._found = self._found or self._with_round_off(response, part)

    def response(self, ended: Ended) -> Response:
        """The response, when all blocks are taken."""
        assert self._found is not None  # as every simulation has a block
        columns: dict[str, Any] = {name: self._columns.get(name) for name in HISTORIES}
        energy = Energy(*(self._columns[name] for name in vars(self._found.energy)))
        return replace(self._found, **columns, energy=energy, seconds=ended.seconds, surplus=ended.surplus)

    def _with_round_off(self, response: Response, part: SystemTrajectory) -> Response:
        """Bounds of round-off in a response without histories; of forces too, for a body alone."""
        system, end = self._system, float(np.ptp(self._t))
        nothing: dict[str, Any] = dict.fromkeys(HISTORIES)  # of these the columns have all
        response = replace(response, **nothing, round_off=round_off(system.bodies, self._loads, end))
        if ALONE not in system.bodies or system.terms:
            return response
        body = system.bodies[ALONE]
        start = float(on_rows(system, body, part.bodies[ALONE]).s[0])
        return replace(response, force_round_off=force_round_off(body, self._loads, end, start))


def _evaluate(system: System, part: SystemTrajectory) -> Response:
    """Response of the system over some steps of a motion."""
    with np.errstate(over="ignore", invalid="ignore"):
        kinetic = np.zeros(len(part.t))
        for name, body in system.bodies.items():
            v = with_inertia(body, part.bodies[name].v)
            kinetic += 0.5 * np.einsum("tn,tn->t", v, (body.M @ v.T).T)
        outputs, external = systems.displacements(system, part), -part.work
        violation = drift = np.full((len(part.t), 1), np.nan)
        if ALONE in system.bodies and not system.terms:
            body, motion = system.bodies[ALONE], on_rows(system, system.bodies[ALONE], part.bodies[ALONE])
            external = potential(body, motion, part.loads)
            violation, drift = _residuals(body, motion, part)
        energy = Energy(kinetic, part.energy - kinetic, external)
    refuse_infinite(*outputs.values(), part.forces, energy.kinetic, energy.strain, energy.external)
    peaks = part.peaks if ALONE not in system.bodies or not np.isnan(system.clearance).all() else None
    response = response_of(system, part.t, Motion(outputs, part.forces, peaks, energy))
    position, velocity = (np.abs(values).max(axis=1, initial=0.0) for values in (violation, drift))
    response = replace(response, residual_position=position, residual_velocity=velocity)
    return with_friction(with_support_reactions(response, system, part), system, part.friction)


def _residuals(body: SlidingBody, motion: Trajectory, part: SystemTrajectory) -> tuple[Array, Array]:
    """Violation (T, m) in m of each row, and its rate in m/s; NaN where rows have no rate equation."""
    q, v, s, multipliers = motion.q, motion.v, motion.s, motion.multipliers
    violation = body.apply_rows(s, q) - body.row_compliance * multipliers
    if body.flexibility is not None:
        violation = violation + body.flexibility.row_motion(s, multipliers, part.loads)
    excess = violation - body.row_clearance  # where rows push any gap, elsewhere a negative one
    overlap = np.where(multipliers > 0.0, excess, np.maximum(excess, 0.0))
    violation = np.where(np.isnan(body.row_clearance), violation, overlap)
    if body.flexibility is not None or np.any(body.row_compliance) or part.rates is None:
        return violation, np.full_like(violation, np.nan)  # rows that give way have no equation at velocity level
    path_rate = part.rates.sum(axis=1)[:, None]  # of the only path, if there is one
    return violation, body.apply_rows(s, v) + path_rate * body.apply_rows(s, q, derivative=1)


@dataclass(frozen=True)
class Motion:
    """Simulated outputs (T, o) of each body, contact forces and their peaks (T, m) in N, and energies."""

    outputs: Mapping[str, Array]
    forces: Array
    peaks: Array | None
    energy: Energy


def with_friction(response: Response, system: Joined[Any], friction: Array | None) -> Response:
    """Append each joint's total friction force to the other outputs, from that of each pad (T, n) in N."""
    joint_friction = Friction.of(system.contacts)
    if joint_friction is None or friction is None:
        return response
    return replace(
        response,
        others=np.hstack([*([] if response.others is None else [response.others]), joint_friction.totals(friction)]),
        other_names=(*response.other_names, *map(friction_of, joint_friction.joints)),
        other_units=(*response.other_units, *("N" for _ in joint_friction.joints)),
        kinds=(*response.kinds, *("friction" for _ in joint_friction.joints)),
        bodies=(*response.bodies, *joint_friction.joints),
    )


def response_of(system: Joined[Any], t: Array, motion: Motion) -> Response:
    """Response of any simulator's motion at the times t (T,) in s."""
    displacements, springs, other_outputs = list[Array](), list[Array](), list[Array]()
    other_names, other_units = list[str](), list[str]()
    x, names, force_names = list[Array](), list[str](), list[str]()
    kinds: tuple[list[str], list[str], list[str]] = ([], [], [])  # of displacements, forces and others
    of_bodies: tuple[list[str], list[str], list[str]] = ([], [], [])
    for name, body in system.bodies.items():
        of, y = column_names(body), motion.outputs[name]
        displacements.append(y[:, length_outputs(body)])
        springs.append(y[:, force_outputs(body)])
        other_outputs.append(y[:, ~(length_outputs(body) | force_outputs(body))])
        other_names += [named(name, output) for output in of.others]
        other_units += of.other_units
        x.append(body.output_positions[length_outputs(body)])
        names += [named(name, output) for output in of.moved]
        force_names += [named(name, output) for output in of.forces]
        for columns, bodies, output_kinds in zip(kinds, of_bodies, of.kinds, strict=True):
            columns += output_kinds
            bodies += [name] * len(output_kinds)
    contacts = output_contacts(system)
    kinds[1].extend(system.contacts[k].kind for k in contacts)
    of_bodies[1].extend(system.contacts[k].inner.body for k in contacts)
    not_known = np.full(len(t), np.nan)
    return Response(
        t=t,
        x=np.concatenate(x),
        displacement=np.hstack(displacements),
        energy=motion.energy,
        slider_force=np.hstack([*springs, motion.forces[:, contacts]]),
        residual_position=not_known,
        residual_velocity=not_known,
        seconds=np.nan,
        output_names=tuple(names),
        output_units=("m",) * len(names),
        force_names=(*force_names, *(force_of(system.contact_names[k]) for k in contacts)),
        force_peaks=None if motion.peaks is None else np.hstack([*springs, motion.peaks[:, contacts]]),
        others=np.hstack(other_outputs) if other_names else None,
        other_names=tuple(other_names),
        other_units=tuple(other_units),
        kinds=tuple(kind for group in kinds for kind in group),
        bodies=tuple(body for group in of_bodies for body in group),
    )
