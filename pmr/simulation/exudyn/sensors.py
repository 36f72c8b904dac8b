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


def add_sensors(mbs: Any, items: SystemItems) -> SystemSensors:
    """Sensors of a system that `add_system` added: y = O q + W f - X lambda, and lambda, whenever they are written."""
    equations, inputs = items.equations, items.inputs
    contacts = Contacts(equations, inputs)
    held, rest = list(items.contacts), np.array([k not in items.contacts for k in range(len(contacts.gives))])

    def forces(q: Array, t: float) -> tuple[Array, ContactRows]:
        rows, f, found = equations.rows(inputs.at(t)), np.array(inputs.loads(t)), np.zeros(len(rest))
        if held:
            found[held] = mbs.GetObjectOutput(items.oContacts, exu.OutputVariableType.Force)
        if rest.any():
            found[rest] = contacts.forces(contacts.rows(inputs.at(t)), q[None], f[None])[0]
        return found, rows.at(0)

    def coordinates(configuration: Any) -> Array:
        kind = exu.OutputVariableType.Coordinates
        return np.concatenate([mbs.GetNodeOutput(node, kind, configuration) for node in items.nBodies.values()])

    def pushed(mbs: Any, t: float, sensors: Any, factors: Any, configuration: Any) -> Any:
        return forces(coordinates(configuration), t)[0]

    def moved(mbs: Any, t: float, sensors: Any, factors: Any, configuration: Any) -> Any:
        q = coordinates(configuration)
        found, rows = forces(q, t)
        return equations.outputs @ q + equations.assembly.direct @ np.array(inputs.loads(t)) - rows.X @ found

    both = [
        mbs.AddSensor(SensorUserFunction(sensorNumbers=[], factors=[], sensorUserFunction=one, storeInternal=True))
        for one in (moved, pushed)
    ]
    return SystemSensors(both[0], equations.system.output_names, both[1], equations.system.contact_names)
