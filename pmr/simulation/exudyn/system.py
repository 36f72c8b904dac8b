r"""A system of bodies in Exudyn: a node for each body, and one object with the matrices and contacts of all.

.. math::
    M \ddot q + D \dot q + K q + C^T \lambda = B f, \qquad C q + H f - F \lambda = 0

Contacts that give way are springs that travel, set once a step: stiffness :math:`K + C^T F^{-1} C`, inputs
:math:`B - C^T F^{-1} H`.  Rigid ones are a connector with their multipliers.  Where contacts only push, Python is
called in every iteration for the forces of all that give way, those of the closed ones found by pivoting
(`pmr.simulation.native.contact`); Newton's method takes the stiffness of those that are closed.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    MarkerNodeCoordinates,
    MarkerObjectODE2Coordinates,
    NodePointGround,
    ObjectConnectorCoordinateVector,
    ObjectGenericODE2,
)
from numpy.typing import NDArray

from pmr.scene.simulators import Needs, refuse
from pmr.simulation import balance, contact_step
from pmr.simulation.excitation import Excitation
from pmr.simulation.exudyn.items import add_coordinates, add_pre_step_function, matrix
from pmr.simulation.exudyn.solver import change, of_connector, of_nodes, solve, solver_settings, stored
from pmr.simulation.exudyn.system_rows import Giving, SystemBalance, SystemMotion, Tables, balanced
from pmr.simulation.native.multibody_march import contact_frequency, places
from pmr.simulation.native.scheme import GeneralizedAlpha
from pmr.simulation.start import InitialState, check_position, checked
from pmr.simulation.stepping import Progress
from pmr.system.assembly import Assembly, ContactRows
from pmr.system.body import Trajectory
from pmr.system.system import System, SystemTrajectory

Array = NDArray[np.float64]


def simulate_system(
    system: System,
    excitation: Excitation,
    initial: Mapping[str, InitialState] | None = None,
    progress: Progress | None = None,
) -> SystemTrajectory:
    """Simulate reduced bodies that contacts join; arguments and errors as `pmr.simulation.SystemSimulator`.

    The option `newton` of the excitation holds Exudyn's settings of Newton's method by their own names.  A contact that
    only pushes lets go as Exudyn's generalized-alpha has it: what its force leaves in the next step is not taken back,
    so that the motion is the compiled one's in the limit of small steps.
    """
    run = _Run(system, excitation, initial or {})
    stepping = run.excitation.stepping
    chosen = solver_settings(stepping, exu.LinearSolverType.EigenDense)
    change(chosen.timeIntegration.newton, excitation.options.newton)
    seconds = solve(run.mbs, chosen, run.describe, progress)
    return run.trajectory(run.motion(), seconds)


class _Run:
    """One simulation: items in Exudyn and what they are told at each step."""

    def __init__(self, system: System, excitation: Excitation, initial: Mapping[str, InitialState]) -> None:
        self._system, self._parts = system, 1
        pushes = ~np.isnan(system.clearance)
        if pushes.any():
            self._parts = contact_step.parts(contact_frequency(system, excitation), excitation.stepping)
        self.excitation = excitation.with_stepping(excitation.stepping.divided(self._parts))
        stepping = self.excitation.stepping
        self._assembly = a = Assembly(system)
        self._x, self._f = places(system, self.excitation), self.excitation.forces(system.input_names)
        self._tables = Tables(a, self._x)
        rows = self._tables.at(0)
        self._firm = np.all(rows.F == 0.0, axis=1)
        self._check(stepping.rho_inf)
        self._giving = Giving(system, ~self._firm, GeneralizedAlpha(stepping.step, stepping.rho_inf))
        self._container = exu.SystemContainer()  # owns the mbs: must stay alive
        self.mbs = self._container.AddSystem()
        starts = self._starts(initial)
        firm = zip(system.contact_names, self._firm, strict=True)
        whole = np.concatenate([start.q for start in starts])
        check_position(rows.C[self._firm], whole, tuple(name for name, rigid in firm if rigid))
        self._step, self._present = 0, self._rows(0)
        nodes = [add_coordinates(self.mbs, name, start) for name, start in zip(system.bodies, starts, strict=True)]
        self._add_object(nodes)
        kind = exu.OutputVariableType
        self._of_nodes = [of_nodes(self.mbs, nodes, which) for which in (kind.Coordinates, kind.Coordinates_t)]
        self._of_connector = self._add_connector(rows)
        add_pre_step_function(self.mbs, self._update)

    def _check(self, rho_inf: float) -> None:
        system, x = self._system, self._x
        travelling = {side.contact for side, at in zip(system.sides, x.T, strict=True) if np.any(at != at[0])}
        firm = [(k, contact) for k, contact in enumerate(system.contacts) if self._firm[k]]
        moving = tuple(contact.name for k, contact in firm if k in travelling)
        pushing = tuple(contact.name for _, contact in firm if contact.clearance is not None)
        self._moving = list(moving)
        refuse("exudyn", Needs(rigid_pushing=pushing, rigid_moving=moving, rho_inf=rho_inf))

    def _starts(self, initial: Mapping[str, InitialState]) -> list[InitialState]:
        found = []
        for name, body in self._system.bodies.items():
            start = checked(initial[name], body.size) if name in initial else InitialState.at_rest(body.size)
            free = self._assembly.free[name]
            found.append(InitialState(start.q[free], start.v[free]))
        return found

    def _rows(self, step: int) -> ContactRows:
        """Of those that give way."""
        return self._tables.at(step).of(self._giving.which)

    def _add_object(self, nodes: list[Any]) -> None:
        a = self._assembly
        D = a.D.toarray()
        given: dict[str, Any] = {"dampingMatrix": matrix(D)} if np.any(D) else {}
        if self._giving.pushing is not None:
            given |= {"forceUserFunction": self._force}
        self._object = self.mbs.AddObject(
            ObjectGenericODE2(
                name="system",
                nodeNumbers=nodes,
                massMatrix=matrix(a.M.toarray()),
                stiffnessMatrix=self._stiffness(),
                forceVector=self._inputs(),
                jacobianUserFunction=self._jacobian,
                **given,
            )
        )

    def _add_connector(self, rows: ContactRows) -> Any:
        if not self._firm.any():
            return None
        ground = self.mbs.AddMarker(MarkerNodeCoordinates(nodeNumber=self.mbs.AddNode(NodePointGround())))
        bodies = self.mbs.AddMarker(MarkerObjectODE2Coordinates(objectNumber=self._object))
        C = rows.C[self._firm]
        self._connector = self.mbs.AddObject(
            ObjectConnectorCoordinateVector(markerNumbers=[ground, bodies], scalingMarker1=C)
        )
        return of_connector(self.mbs, self._connector)

    def _stiffness(self) -> Any:
        K = self._assembly.K.toarray()
        return matrix(K if self._giving.pushing is not None else K + self._giving.stiffness(self._present))

    def _inputs(self) -> Array:
        f, rows = self._f[self._step], self._present
        B = self._assembly.B @ f
        n = self._assembly.size
        return B if self._giving.pushing is not None else np.asarray(B - rows.C.T @ (rows.answers[:, n:] @ f))

    def _update(self, mbs: Any, t: float) -> bool:
        self._step = round(t / self.excitation.stepping.step)
        moved = np.any(self._x[self._step] != self._x[self._step - 1])
        if moved:
            self._present = self._rows(self._step)
            if self._giving.pushing is None:
                mbs.SetObjectParameter(self._object, "stiffnessMatrix", self._stiffness())
            if self._of_connector is not None:
                C = self._tables.at(self._step).C[self._firm]
                mbs.SetObjectParameter(self._connector, "scalingMarker1", C)
        mbs.SetObjectParameter(self._object, "forceVector", self._inputs())
        return True

    def _force(self, mbs: Any, t: float, item: int, q: Any, q_t: Any) -> Any:
        return -self._present.C.T @ self._giving.forces(self._present, np.asarray(q), self._f[self._step])

    def _jacobian(self, mbs: Any, t: float, item: int, q: Any, q_t: Any, factor: float, factor_t: float) -> Any:
        """Beyond K and D."""
        if self._giving.pushing is None:
            return self._nothing
        self._giving.forces(self._present, np.asarray(q), self._f[self._step])
        return exu.MatrixContainer(factor * self._giving.stiffness(self._present))

    @cached_property
    def _nothing(self) -> Any:
        return exu.MatrixContainer(np.zeros((self._assembly.size,) * 2))

    def describe(self, t: float) -> str:
        """Where the paths lead at a time in s."""
        at = self.excitation.s[round(t / self.excitation.stepping.step)]
        return ", ".join(f"{name} at {s:g} m" for name, s in zip(self.excitation.paths, at, strict=True))

    def motion(self) -> SystemMotion:
        """What the sensors stored; forces of contacts that give way are still zero."""
        stepping = self.excitation.stepping
        q, v = (
            np.hstack([stored(self.mbs, sensor, stepping, self.describe) for sensor in sensors])
            for sensors in self._of_nodes
        )
        forces = np.zeros((len(q), len(self._system.contacts)))
        if self._of_connector is not None:
            forces[:, self._firm] = stored(self.mbs, self._of_connector, stepping, self.describe)
        return SystemMotion(q, v, self._f, forces)

    def trajectory(self, motion: SystemMotion, seconds: float) -> SystemTrajectory:
        """From all parts of all steps, the forces of rigid contacts among them."""
        system, parts, m = self._system, self._parts, motion.forces.shape[1]
        found, pushes = self._balanced(motion), ~np.isnan(system.clearance)
        B, inertia = self._assembly.B.toarray(), self._assembly.M.diagonal()
        least = balance.round_off(B.T @ (B / inertia[:, None]), self._f, float(self.excitation.times[1]))
        surplus = balance.surplus(found.stored, found.work, least, since_start=bool(pushes.any()))
        balance.refuse_growth(surplus, "Exudyn", self._moving)
        steps = slice(None, None, parts)
        t, x, forces = self.excitation.times[steps], self._x[steps], motion.forces[steps]
        within = motion.forces[1:].reshape(len(t) - 1, parts, m).max(axis=1)
        bodies = {
            name: Trajectory(
                t,
                self._whole(name, motion.q[steps]),
                self._whole(name, motion.v[steps]),
                system.pressed(name, forces),
                x[:, system.sides_of(name)],
                seconds,
                surplus=surplus,
            )
            for name in system.bodies
        }
        peaks = np.where(pushes, np.vstack([forces[:1], within]), forces)
        energy, work = found.stored[steps], found.work[steps]
        return SystemTrajectory(t, bodies, forces, peaks, self._f[steps], energy, work, seconds, surplus)

    def _balanced(self, motion: SystemMotion) -> SystemBalance:
        """Energy and work since the start; fills in the forces of contacts that give way."""
        T, which = len(motion.q), self._giving.which
        stored, work = np.zeros(T), np.zeros(T)
        for first in range(0, max(1, T - 1), self._tables.block - 1):
            steps = slice(first, min(first + self._tables.block, T))
            tables = self._tables.of(steps.start, steps.stop)
            for k in range(first, steps.stop):
                rows = tables.at(k - first).of(which)
                motion.forces[k, which] = self._giving.forces(rows, motion.q[k], self._f[k])
            found = balanced(self._assembly, tables, motion.part(steps))
            stored[steps], work[steps][1:] = found.stored, work[first] + np.cumsum(found.work)
        return SystemBalance(stored, work)

    def _whole(self, name: str, values: Array) -> Array:
        """Coordinates of one body out of all that are free, those that supports hold among them."""
        found = np.zeros((len(values), self._system.bodies[name].size))
        found[:, self._assembly.free[name]] = values[:, self._assembly.coordinates[name]]
        return found
