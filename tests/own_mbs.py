"""An Exudyn user's own mbs with solver settings of their own."""

from typing import Any

import exudyn as exu
from exudyn.itemInterface import SensorNode

from pmr.files.arrays import Array
from pmr.simulation import TimeStepping


class OwnSystem:
    """A container with one mbs, solved over the steps of a time grid."""

    def __init__(self, stepping: TimeStepping) -> None:
        self.stepping, self.container = stepping, exu.SystemContainer()
        self.mbs = self.container.AddSystem()

    def coordinates(self, node: Any) -> Any:
        """Add a sensor of a node's coordinates."""
        kind = exu.OutputVariableType.Coordinates
        return self.mbs.AddSensor(SensorNode(nodeNumber=node, outputVariableType=kind, storeInternal=True))

    def solve(self, *sensors: Any) -> list[Array]:
        """Assemble the mbs and solve it; values (T, n) of each sensor."""
        self.mbs.Assemble()
        return self.solve_again(*sensors)

    def solve_again(self, *sensors: Any, solver: Any = None) -> list[Array]:
        """Solve the assembled mbs; values (T, n) of each sensor."""
        settings, stepping = exu.SimulationSettings(), self.stepping
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = stepping.step
        settings.timeIntegration.endTime = stepping.end
        settings.timeIntegration.numberOfSteps = stepping.steps
        settings.timeIntegration.generalizedAlpha.spectralRadius = stepping.rho_inf
        settings.timeIntegration.newton.useModifiedNewton = False
        self.mbs.SolveDynamic(settings, solverType=solver)
        return [self.mbs.GetSensorStoredData(sensor)[:, 1:] for sensor in sensors]
