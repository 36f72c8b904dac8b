"""Evaluation of motions of systems: displacements, forces, energies, residuals and round-off of their responses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pmr.compare.errors import refuse_infinite
from pmr.compare.motion import force_round_off, round_off
from pmr.compare.outputs import Outputs, outputs_of_run, run_from_start
from pmr.files.arrays import Array
from pmr.results import Energy, Response
from pmr.results.response import LUFFING_ANGLE, Output
from pmr.scene import Scene
from pmr.scene.built import friction_name, reaction_name
from pmr.scene.hoist import KINDS, OUTPUTS
from pmr.scene.keys import ALONE, LUFFING_CYLINDER
from pmr.scene.mechanism import MACHINE
from pmr.simulation import Excitation
from pmr.simulation.frame_motion import ComputedMotion, MotionSamples
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.free_motion import ACCELERATION, CYLINDER_UNITS, STOP, column_name
from pmr.simulation.reactions import response_to_motion, with_row_multipliers, with_support_reactions
from pmr.simulation.stepping import BLOCK, SimulationEnd, load_potential
from pmr.system.body import SlidingBody, Trajectory, clear_rates_without_inertia
from pmr.system.contacts import Contact, Friction
from pmr.system.states import SystemTrajectory, displacements
from pmr.system.system import BodySystem, System

#: Fields of a response that have a value for each step; energies are not among them.
RESPONSE_HISTORIES = (
    "t", "displacement", "slider_force", "residual_position", "residual_velocity", "force_peaks", "others",
)  # fmt: skip


def evaluate_motion(system: System, trajectory: SystemTrajectory) -> Response:
    """Response to a motion: displacements of all bodies, forces of contacts, springs and supports, and energies.

    Raises SimulationError if outputs, forces or energies overflow.
    """
    evaluation = Evaluation(system, trajectory.t, trajectory.loads)
    for first in range(0, max(1, len(trajectory.t) - 1), BLOCK):  # each block begins with the last step of that before
        evaluation(first, trajectory.select(slice(first, first + BLOCK + 1)))
    return evaluation.response(SimulationEnd(trajectory.seconds, trajectory.surplus))


@dataclass(frozen=True)
class SimulatedSystem:
    """A system under an excitation; its motion, the response to it and its outputs are computed when they are needed.

    A motion or response that is known already is passed and not computed again.
    """

    system: System
    excitation: Excitation
    recorded_run: SystemTrajectory | None = None  # at all steps
    recorded_response: Response | None = None
    form: SystemForm | None = None  # whose kernel further simulations share

    @cached_property
    def run(self) -> SystemTrajectory:
        """Motion of the system at all steps, by the compiled simulator."""
        return self.recorded_run or run_from_start(self.form or self.system, self.excitation)

    @cached_property
    def response(self) -> Response:
        """Response to the motion."""
        return self.recorded_response or evaluate_motion(self.system, self.run)

    @cached_property
    def outputs(self) -> Outputs:
        """Outputs at all steps, with velocities."""
        return outputs_of_run(self.system, self.run, self.excitation)


class Evaluation:
    """Evaluates a system's motion block by block, without keeping its states, and returns the response to all of it.

    The evaluation is called once for each block, in any order; then `response` returns the result.
    """

    def __init__(self, system: System, t: Array, loads: Array) -> None:
        """Begin with no blocks; `t` (T,) are the times of all steps in s, `loads` (T, i) in N those on all inputs."""
        self._system, self._t, self._loads = system, t, loads
        self._columns: dict[str, Array] = {}
        self._frame: Response | None = None  # of all steps, without histories

    def __call__(self, first: int, part: SystemTrajectory) -> None:
        """Evaluate a block of the motion, `part`, and store its columns; its first step has the number `first`.

        Raises SimulationError as `evaluate_motion` does.
        """
        response, rows = _evaluate(self._system, part), slice(first, first + len(part.t))
        arrays = {name: getattr(response, name) for name in RESPONSE_HISTORIES}
        for name, values in (arrays | vars(response.energy)).items():
            if values is not None:
                if name not in self._columns:
                    self._columns[name] = np.empty((len(self._t), *values.shape[1:]))
                self._columns[name][rows] = values
        self._frame = self._frame or self._with_round_off(response, part)

    def response(self, ended: SimulationEnd) -> Response:
        """Response at all steps, after the last block; `ended` has the solver's seconds and the surplus of energy."""
        assert self._frame is not None  # every simulation has a block
        columns: dict[str, Any] = {name: self._columns.get(name) for name in RESPONSE_HISTORIES}
        energy = Energy(*(self._columns[name] for name in vars(self._frame.energy)))
        return replace(self._frame, **columns, energy=energy, seconds=ended.seconds, surplus=ended.surplus)

    def _with_round_off(self, response: Response, part: SystemTrajectory) -> Response:
        """Return the `response` with bounds of its round-off, and with None in place of its histories.

        The histories are stored in `_columns`.  Forces have a bound only for a single body without terms.
        """
        system, end = self._system, float(np.ptp(self._t))
        nothing: dict[str, Any] = dict.fromkeys(RESPONSE_HISTORIES)  # `_columns` holds the histories
        response = replace(response, **nothing, round_off=round_off(system.bodies, self._loads, end))
        if ALONE not in system.bodies or system.terms:
            return response
        body = system.bodies[ALONE]
        start = float(with_row_multipliers(system, body, part.bodies[ALONE]).s[0])
        return replace(response, force_round_off=force_round_off(body, self._loads, end, start))


def _evaluate(system: System, part: SystemTrajectory) -> Response:
    """Response of the system over the steps of one block of a motion."""
    with np.errstate(over="ignore", invalid="ignore"):
        kinetic = np.zeros(len(part.t))
        for name, body in system.bodies.items():
            v = clear_rates_without_inertia(body, part.bodies[name].v)
            kinetic += 0.5 * np.einsum("tn,tn->t", v, (body.M @ v.T).T)
        outputs, external = displacements(system, part), -part.work
        residuals = np.full((2, len(part.t), 1), np.nan)
        if ALONE in system.bodies and not system.terms:
            body, motion = system.bodies[ALONE], with_row_multipliers(system, system.bodies[ALONE], part.bodies[ALONE])
            if not system.hoist:  # the pulls of a rope have no potential
                external = load_potential(body, motion, part.loads)
            residuals = _residuals(body, motion, part)
        energy = Energy(kinetic, part.energy - kinetic, external)
    refuse_infinite(*outputs.values(), part.forces, energy.kinetic, energy.strain, energy.external)
    peaks = part.peaks if ALONE not in system.bodies or not np.isnan(system.clearance).all() else None
    response = response_to_motion(system, part.t, outputs, part.forces, peaks, energy)
    position, velocity = np.abs(residuals).max(axis=2, initial=0.0)
    response = replace(response, residual_position=position, residual_velocity=velocity)
    response = append_friction(with_support_reactions(response, system, part), system.contacts, part.friction)
    return response if part.hoist is None else response.with_others(part.hoist, hoist_outputs(system))


def _residuals(body: SlidingBody, motion: Trajectory, part: SystemTrajectory) -> Array:
    """Violation in m of the equation of each of m rows at T steps, and its rate in m/s, as one array (2, T, m).

    The violation of a row that only pushes is its difference to the clearance while it presses, and the overlap while
    it does not.  The rates of all rows are NaN if any row gives way: such a row has no equation at velocity level.
    They are also NaN if path rates are not known.
    """
    q, v, s, multipliers = motion.q, motion.v, motion.s, motion.multipliers
    violation = body.apply_rows(s, q) - body.row_compliance * multipliers
    if body.flexibility is not None:
        violation = violation + body.flexibility.row_motion(s, multipliers, part.loads)
    excess = violation - body.row_clearance  # rows that press: any gap; open rows: negative gaps only
    overlap = np.where(multipliers > 0.0, excess, np.maximum(excess, 0.0))
    violation = np.where(np.isnan(body.row_clearance), violation, overlap)
    if body.flexibility is not None or np.any(body.row_compliance) or part.rates is None:
        return np.array([violation, np.full_like(violation, np.nan)])
    path_rate = part.rates.sum(axis=1)[:, None]  # of the only path, if there is one
    return np.array([violation, body.apply_rows(s, v) + path_rate * body.apply_rows(s, q, derivative=1)])


def append_friction(response: Response, contacts: Sequence[Contact], friction: Array | None) -> Response:
    """Append the total friction force in N of each joint to the other outputs of a response.

    `friction` (T, n) in N is that of the n pads with friction among the `contacts`, in the order of `Friction`.  If
    `friction` is None or no contact has friction, the response is returned unchanged.
    """
    joint_friction = Friction.from_contacts(contacts)
    if joint_friction is None or friction is None:
        return response
    added = [Output(friction_name(joint), "friction", joint, unit="N") for joint in joint_friction.joints]
    return response.with_others(joint_friction.joint_totals(friction), added)


def hoist_outputs(system: BodySystem[Any]) -> list[Output]:
    """Descriptions of the outputs of a system's hoist, which belong to the section with the hoist's head."""
    section = [*system.bodies][len(system.hoist.reach[0])]  # each section before it travels along a path but the first
    return [Output(name, KINDS[name], section, unit=unit) for name, unit in OUTPUTS.items()]


def append_machine(scene: Scene, response: Response) -> Response:
    """Append to a scene's response the displacements, rates and forces of a machine with a computed motion.

    Displacements are in m or rad, rates in m/s or rad/s.  Forces in N or N m are those of springs, dampers and
    constraints, positive along the axes, by the directions of ``[frame.base]``.  A direction that has no spring, damper
    or constraint has no force.  If a luffing angle or an extension is computed, only this motion and its cylinder's
    quantities are appended.  Without a computed motion, the response is returned unchanged.
    """
    luffing = None if scene.frame is None else scene.frame.luffing_signal
    if isinstance(luffing, ComputedMotion):
        return _append_luffing(scene.names[0], luffing.samples, response)
    for section, path in scene.paths.items():
        if isinstance(path, ComputedMotion):
            of: Mapping[str, Array] = path.samples.cylinder
            extended = {_driven_column(column_name(section, name), name, section): of[name] for name in of}
            return response.with_others(np.stack(list(extended.values()), axis=1), extended)
    motions = {} if scene.frame is None or scene.frame.base is None else scene.frame.base.motions
    free_motions: dict[str, MotionSamples] = {
        key: motion.samples for key, motion in motions.items() if isinstance(motion, ComputedMotion)
    }
    if not free_motions:
        return response
    base, columns = scene.names[0], dict[Output, Array]()
    for order, prefix, per_second in ((0, "", ""), (1, "rate of ", "/s")):
        for key, motion in free_motions.items():
            unit = ("rad" if key.startswith("r") else "m") + per_second
            columns[Output(f"{prefix}{MACHINE} {key}", MACHINE, base, unit=unit)] = motion.values[order]
    for key, motion in free_motions.items():
        if motion.force.any():
            unit = "N m" if key.startswith("r") else "N"
            columns[Output(reaction_name(f"{MACHINE} {key}"), "reaction", base, unit=unit)] = motion.force
    return response.with_others(np.stack(list(columns.values()), axis=1), columns)


def _append_luffing(base: str, luffing: MotionSamples, response: Response) -> Response:
    """Append to a response the luffing angle in rad, its rate and the columns of its cylinder.

    `base` is the name of the base section, to which the columns belong.
    """
    columns = {
        Output(LUFFING_ANGLE, MACHINE, base, unit="rad"): luffing.values[0],
        Output(f"rate of {LUFFING_ANGLE}", MACHINE, base, unit="rad/s"): luffing.values[1],
    }
    for name, values in luffing.cylinder.items():
        columns[_driven_column(f"{LUFFING_CYLINDER} {name}", name, base)] = values
    return response.with_others(np.stack(list(columns.values()), axis=1), columns)


def _driven_column(name: str, of: str, body: str) -> Output:
    """Description of the output called `name` of a cylinder that drives a computed motion of the body `body`.

    `of` is the column's name in `CYLINDER_UNITS`, `ACCELERATION` or `STOP`; unit and kind of the column follow from it.
    """
    unit = (CYLINDER_UNITS | {ACCELERATION: "m/s^2", STOP: "m"})[of]
    kind = {"Pa": "pressure", "m^3/s": "flow", "W": "power"}.get(unit, MACHINE)
    return Output(name, kind, body, unit=unit)
