"""One simulation of a system in Exudyn: its times and items, and what comes of the sensors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from pmr.scene.simulators import refuse
from pmr.simulation import balance
from pmr.simulation.contact_step import as_made, contact_frequency
from pmr.simulation.excitation import Excitation
from pmr.simulation.exudyn.contacts import Balance, Contacts, Motion, balance_energy
from pmr.simulation.exudyn.equations import Equations
from pmr.simulation.exudyn.formulations import FORMULATIONS, Formulation
from pmr.simulation.exudyn.friction import Rubbing
from pmr.simulation.exudyn.inputs import TabulatedInputs
from pmr.simulation.exudyn.quasi_static import rates, with_quasi_static
from pmr.simulation.exudyn.solver import change, of_connector, of_nodes, read_sensor, solve, solver_settings
from pmr.simulation.exudyn.terms import with_terms
from pmr.simulation.lengths import Lengths
from pmr.simulation.modal import LARGEST
from pmr.simulation.native import systems
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import Progress
from pmr.system.body import Trajectory
from pmr.system.friction import Friction
from pmr.system.system import System, SystemTrajectory

Array = NDArray[np.float64]


def lengths(system: System, excitation: Excitation, initial: Mapping[str, InitialState]) -> Lengths:
    """The parts of each step: one; with contacts that only push those asked for, or those that `march` chooses.

    Of bodies too large for `march` all are as many as resolve the contacts.
    """
    if np.isnan(system.clearance).all():
        return Lengths.of(excitation.stepping, 0.0)
    omega, stepping = contact_frequency(system, excitation), excitation.stepping
    chosen = stepping.parts or stepping.schedule
    if omega and not chosen and max(body.size for body in system.bodies.values()) <= LARGEST:
        stepping = as_made(stepping, systems.simulate(system, excitation, initial).parts, omega)
    return Lengths.of(stepping, omega)


class Run:
    """Simulation of a system under an excitation, each step in the parts of its schedule or of contacts."""

    def __init__(
        self, system: System, excitation: Excitation, initial: Mapping[str, InitialState], formulation: Formulation
    ) -> None:
        self.system, self._excitation, self._formulation = system, excitation, formulation
        self._equations, self._friction = Equations(system), Friction.of(system.contacts)
        name, add = FORMULATIONS[formulation]
        self._needs = self._equations.needs(self._equations.visited(excitation), excitation.stepping.rho_inf)
        refuse(name, self._needs)
        self._lengths = lengths(system, excitation, initial)
        self._inputs = TabulatedInputs(self._equations, excitation, self._lengths)
        s, rates = (dict(zip(excitation.paths, at[0].tolist(), strict=True)) for at in (excitation.s, excitation.rates))
        start = self._equations.start(s, rates, initial)
        self._container = exu.SystemContainer()  # owns the mbs: must stay alive
        self._mbs = self._container.AddSystem()
        items = add(self._mbs, self._equations, self._inputs, start)
        items = with_quasi_static(self._mbs, items, self._equations)
        self._items = with_terms(self._mbs, items, self._equations, self._inputs)
        kind, nodes = exu.OutputVariableType, list(self._items.nBodies.values())
        self._of_nodes = [of_nodes(self._mbs, nodes, which) for which in (kind.Coordinates, kind.Coordinates_t)]
        connector = self._items.oContacts
        self._of_contacts = None if connector is None else of_connector(self._mbs, connector)

    def trajectory(self, progress: Progress | None) -> SystemTrajectory:
        """Take all steps."""
        linear = exu.LinearSolverType.EigenSparse if self._equations.sparse else exu.LinearSolverType.EigenDense
        chosen = solver_settings(self._excitation.stepping.divide(self._lengths.finest), linear)
        chosen.timeIntegration.numberOfSteps = self._lengths.steps
        chosen.timeIntegration.newton.useModifiedNewton = self._formulation == "callbacks-modified-newton"
        change(chosen.timeIntegration.newton, self._excitation.options.newton)
        times = self._lengths.times if np.ptp(self._lengths.parts) else None
        seconds = solve(self._mbs, chosen, self._describe, progress, times)
        motion, contacts = self._motion(), Contacts(self._equations, self._inputs)
        if self._friction is not None:
            motion = Rubbing(self._equations, contacts, self._friction).add_friction(motion)
        balanced = balance_energy(self._equations, contacts, motion)
        return self._trajectory(motion, balanced, seconds)

    def _describe(self, t: float) -> str:
        """Text with the coordinates of the paths at t s."""
        at = ((name, float(path.value(t))) for name, path in self._excitation.paths.items())
        return ", ".join(f"{name} at {s:g} m" for name, s in at)

    def _motion(self) -> Motion:
        """Motion as the sensors stored it; forces of contacts that give way without multipliers are zero."""
        q, v = (np.hstack([self._stored(sensor) for sensor in sensors]) for sensors in self._of_nodes)
        forces = np.zeros((len(q), len(self.system.contacts)))
        if self._of_contacts is not None:
            forces[:, self._items.contacts] = self._stored(self._of_contacts)
        v = rates(self._equations, self._lengths.times, q, v)
        none = np.zeros((len(q), 0))
        return Motion(self._inputs.x, q, v, self._inputs.f, forces, self._inputs.c, none, none, none)

    def _stored(self, sensor: Any) -> Array:
        return read_sensor(self._mbs, sensor, self._lengths, self._describe)

    def _trajectory(self, motion: Motion, balanced: Balance, seconds: float) -> SystemTrajectory:
        """From all parts of all steps."""
        system, ends, parts = self.system, self._lengths.ends, self._lengths.parts
        pushes, t = ~np.isnan(system.clearance), self._excitation.times
        B, inertia = self._equations.B, self._equations.assembly.M.diagonal()
        least = balance.round_off(B.T @ (B / inertia[:, None]), motion.f, float(t[1]))
        surplus = balance.surplus(balanced.stored, balanced.work, least, since_start=bool(pushes.any()))
        balance.refuse_growth(surplus, "Exudyn", list(self._needs.rigid_moving))
        reaching, rubbed = motion.forces[ends], {}
        forces, energy, work = reaching, balanced.stored[ends], balanced.work[ends]
        if (pads := self._friction) is not None:
            friction = motion.friction[ends]
            forces = reaching + pads.along(friction)
            of_cylinders = pads.stored(friction, forces)
            energy, work = energy + of_cylinders, work + of_cylinders
            rubbed = {"friction": friction, "moments": pads.moments(friction, forces)}
        within = np.maximum.reduceat(motion.forces[1:], ends[:-1], axis=0)
        bodies = {
            name: Trajectory(
                t,
                self._equations.whole(name, motion.q[ends]),
                self._equations.whole(name, motion.v[ends]),
                system.pressed(name, reaching),
                motion.x[ends][:, system.sides_of(name)],
                seconds,
                surplus=surplus,
            )
            for name in system.bodies
        }
        peaks = np.where(pushes, np.vstack([forces[:1], within]), forces)
        parts_of_steps = np.concatenate([[1], parts])
        c = motion.c[ends] if system.terms else None
        return SystemTrajectory(
            t, bodies, forces, peaks, motion.f[ends], energy, work, seconds, surplus, parts_of_steps, amplitudes=c,
            rates=self._excitation.rates, **rubbed,
        )  # fmt: skip
