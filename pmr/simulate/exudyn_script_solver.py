"""Exudyn's time integration of a system with one body, without pmr: its source text is copied into scripts."""

# mypy: allow-untyped-defs, allow-untyped-calls
from __future__ import annotations

import exudyn as exu
from exudyn.itemInterface import SensorNode


def solve(mbs, nBody, end, step, rho_inf):
    """Assemble and integrate; times (T,) in s and the coordinates (T, r) of node `nBody`."""
    sBody = mbs.AddSensor(
        SensorNode(nodeNumber=nBody, outputVariableType=exu.OutputVariableType.Coordinates, storeInternal=True)
    )
    mbs.Assemble()

    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = step
    settings.linearSolver.solverType = exu.LinearSolverType.EigenDense
    settings.timeIntegration.endTime = end
    settings.timeIntegration.numberOfSteps = round(end / step)
    settings.timeIntegration.adaptiveStep = False
    settings.timeIntegration.automaticStepSize = False
    settings.timeIntegration.generalizedAlpha.spectralRadius = rho_inf
    settings.timeIntegration.newton.useModifiedNewton = False
    mbs.SolveDynamic(settings)

    stored = mbs.GetSensorStoredData(sBody)
    return stored[:, 0], stored[:, 1:]
