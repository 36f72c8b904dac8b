"""Sensors of a system in an mbs: its outputs, and the forces of its contacts."""

# ruff: noqa: N815 - items are numbered as Exudyn users do

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.itemInterface import SensorUserFunction
from numpy.typing import NDArray

from pmr.simulation.exudyn.contacts import Contacts
from pmr.simulation.exudyn.items import SystemItems
from pmr.system.contact_rows import ContactRows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SystemSensors:
    """Numbers of the sensors, and what their values are called, in their order."""

    sOutputs: Any
    output_names: tuple[str, ...]
    sForces: Any  # N, positive where contacts push
    contact_names: tuple[str, ...]


class Watched:
    """Outputs and contact forces of a system, in a configuration of Exudyn's at its time."""

    def __init__(self, mbs: Any, items: SystemItems) -> None:
        self._mbs, self._items, self._contacts = mbs, items, Contacts(items.equations, items.inputs)
        self._held = list(items.contacts)
        self._rest = np.array([k not in items.contacts for k in range(len(self._contacts.gives))])

    def forces(self, t: float, configuration: Any) -> Array:
        """Lambda (m,) N, with their friction; of rigid contacts the current ones, for there are no others."""
        multipliers, _, grip = self._contact_state(t, self._coordinates(configuration))
        return multipliers if grip is None else multipliers + self._items.rubbing.known.along(grip)

    def outputs(self, t: float, configuration: Any) -> Array:
        """Y = O q + W f - X lambda (o,), and what moments of friction move."""
        equations, q = self._items.equations, self._coordinates(configuration)
        multipliers, rows, grip = self._contact_state(t, q)
        y = equations.outputs @ q + equations.assembly.direct @ self._loads(t) - rows.X @ multipliers
        if grip is not None:
            turned = equations.assembly.turned(self._items.inputs.at(t)[0])
            y = y + turned @ self._items.rubbing.known.moments(grip, multipliers)
        return np.asarray(y)

    def _loads(self, t: float) -> Array:
        """Loads (i,), with those by which a base that moves accelerates the boom."""
        loads, base = np.array(self._items.inputs.loads(t)), self._items.base
        return loads if base is None else loads + base.inertia(self._mbs, t)

    def _contact_state(self, t: float, q: Array) -> tuple[Array, ContactRows, Array | None]:
        """Lambda without friction, the rows, and what pads hold; None where none rubs."""
        equations, inputs, multipliers = self._items.equations, self._items.inputs, np.zeros(len(self._rest))
        x, f, rubbing, grip = inputs.at(t), self._loads(t), self._items.rubbing, None
        if self._held:
            multipliers[self._held] = self._mbs.GetObjectOutput(self._items.oContacts, exu.OutputVariableType.Force)
        if rubbing is not None:
            at = rubbing.found(rubbing.rows(x), q, f)
            multipliers[self._rest], grip = at.multipliers[self._rest], at.grip.forces
        elif self._rest.any():
            multipliers[self._rest] = self._contacts.forces(self._contacts.rows(x), q[None], f[None])[0]
        return multipliers, equations.rows(x).at(0), grip

    def _coordinates(self, configuration: Any) -> Array:
        kind, nodes = exu.OutputVariableType.Coordinates, self._items.nBodies.values()
        return np.concatenate([self._mbs.GetNodeOutput(node, kind, configuration) for node in nodes])


def add_sensors(mbs: Any, items: SystemItems) -> SystemSensors:
    """Sensors of a system that `add_system` added: y = O q + W f - X lambda, and lambda, whenever they are written."""
    watched, equations = Watched(mbs, items), items.equations

    def write_forces(mbs: Any, t: float, sensors: Any, factors: Any, configuration: Any) -> Any:
        return watched.forces(t, configuration)

    def write_outputs(mbs: Any, t: float, sensors: Any, factors: Any, configuration: Any) -> Any:
        return watched.outputs(t, configuration)

    added = [
        mbs.AddSensor(SensorUserFunction(sensorNumbers=[], factors=[], sensorUserFunction=function, storeInternal=True))
        for function in (write_outputs, write_forces)
    ]
    return SystemSensors(added[0], equations.system.output_names, added[1], equations.system.contact_names)
