"""What simulated motions mean: outputs, forces, energies and residuals of a system, block by block."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.booms import bearing
from pmr.compare.errors import force_round_off, refuse_infinite, round_off
from pmr.results import Energy, Response
from pmr.scene.built import force_of, friction_of
from pmr.scene.names import ALONE
from pmr.simulation.balance import blocks, potential
from pmr.simulation.blocks import Ended
from pmr.simulation.columns import called
from pmr.simulation.native import systems
from pmr.simulation.support_reactions import on_rows, with_support_reactions
from pmr.system.body import SlidingBody, Trajectory, force_outputs, length_outputs, with_inertia
from pmr.system.contacts import named
from pmr.system.friction import Friction
from pmr.system.system import Joined, System, SystemTrajectory

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
    for kept in blocks(len(trajectory.t)):
        evaluation(kept.start, trajectory.at(kept))
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
        found, rows = _of(self._system, part), slice(first, first + len(part.t))
        arrays = {name: getattr(found, name) for name in HISTORIES}
        for name, values in (arrays | vars(found.energy)).items():
            if values is not None:
                if name not in self._columns:
                    self._columns[name] = np.empty((len(self._t), *values.shape[1:]))
                self._columns[name][rows] = values
        self._found = self._found or self._with_round_off(found, part)

    def response(self, ended: Ended) -> Response:
        """The response, when all blocks are taken."""
        assert self._found is not None  # as every simulation has a block
        columns: dict[str, Any] = {name: self._columns.get(name) for name in HISTORIES}
        energy = Energy(*(self._columns[name] for name in vars(self._found.energy)))
        return replace(self._found, **columns, energy=energy, seconds=ended.seconds, surplus=ended.surplus)

    def _with_round_off(self, found: Response, part: SystemTrajectory) -> Response:
        """Without histories, with what may be nothing but round-off, of a body alone of forces, too."""
        system, end = self._system, float(np.ptp(self._t))
        nothing: dict[str, Any] = dict.fromkeys(HISTORIES)  # of these the columns have all
        found = replace(found, **nothing, round_off=round_off(system.bodies, self._loads, end))
        if ALONE not in system.bodies or system.terms:
            return found
        body = system.bodies[ALONE]
        start = float(on_rows(system, body, part.bodies[ALONE]).s[0])
        return replace(found, force_round_off=force_round_off(body, self._loads, end, start))


def _of(system: System, part: SystemTrajectory) -> Response:
    """Of some steps."""
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
    found = response_of(system, part.t, Motion(outputs, part.forces, peaks, energy))
    position, velocity = (np.abs(one).max(axis=1, initial=0.0) for one in (violation, drift))
    found = replace(found, residual_position=position, residual_velocity=velocity)
    return with_friction(with_support_reactions(found, system, part), system, part.friction)


def _residuals(body: SlidingBody, motion: Trajectory, part: SystemTrajectory) -> tuple[Array, Array]:
    """What each row violates, (T, m) in m, and its rate in m/s; NaN where rows have no equation for the latter."""
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
    """What a simulator says: outputs (T, o) of every body, forces and peaks (T, m) in N of contacts, energies."""

    outputs: Mapping[str, Array]
    forces: Array
    peaks: Array | None
    energy: Energy


def with_friction(response: Response, system: Joined[Any], friction: Array | None) -> Response:
    """With what all pads of each joint resist sliding with, from that of each (T, n) N, after all other outputs."""
    known = Friction.of(system.contacts)
    if known is None or friction is None:
        return response
    return replace(
        response,
        others=np.hstack([*([] if response.others is None else [response.others]), known.totals(friction)]),
        other_names=(*response.other_names, *map(friction_of, known.joints)),
        other_units=(*response.other_units, *("N" for _ in known.joints)),
        kinds=(*response.kinds, *("friction" for _ in known.joints)),
        bodies=(*response.bodies, *known.joints),
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
