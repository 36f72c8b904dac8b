"""Signals, a body and its time integration in Exudyn, without pmr: the source text of these is copied into scripts.

A signal is a function of one time t in s and takes the fields of the signal of the same kind in `pmr.scene.signals`.
"""

# mypy: allow-untyped-defs, allow-untyped-calls
from __future__ import annotations

import warnings
from functools import lru_cache

import exudyn as exu
import numpy as np
from exudyn.itemInterface import NodeGenericODE2, ObjectGenericODE2, SensorNode
from scipy.interpolate import Akima1DInterpolator


def add_body(mbs, model, stiffness, force):
    """Add a body at rest, with its stiffness and generalised forces (r,) at t = 0; numbers of its node and object."""
    r = len(model.M)
    nBody = mbs.AddNode(
        NodeGenericODE2(
            numberOfODE2Coordinates=r,
            referenceCoordinates=np.zeros(r),
            initialCoordinates=np.zeros(r),
            initialCoordinates_t=np.zeros(r),
        )
    )
    # Exudyn adds K and D to the Jacobian itself; told that there is nothing else, it needs no differences.
    zero = exu.MatrixContainer(np.zeros((r, r)))

    def nothing_else(mbs, t, item, *others):
        if t > mbs.variables.get(item, 0.0):
            raise ValueError("another SetPreStepUserFunction took the place of `update`: call both from one function")
        return zero

    oBody = mbs.AddObject(
        ObjectGenericODE2(
            nodeNumbers=[nBody],
            massMatrix=model.M,
            dampingMatrix=model.D,
            stiffnessMatrix=stiffness,
            forceVector=force,
            jacobianUserFunction=nothing_else,
        )
    )
    return nBody, oBody


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
    t, p = stored[:, 0], stored[:, 1:]
    rest = p  # what changes its sign with every step: its eighth differences
    for _ in range(4):
        rest = (rest[:-2] - 2.0 * rest[1:-1] + rest[2:]) / 4.0
    if not (rest**2).sum() <= 1e-6 * (p**2).sum():
        warnings.warn(
            "The motion changes its sign with every step: a constraint that moves (index 3) grows where RHO_INF is "
            "near 1, or STEP is too long for the motion. These results can't be trusted.",
            stacklevel=2,
        )
    return t, p


def ramp(t, times, values):
    """Straight lines between the knots, held before the first and after the last."""
    return np.interp(t, times, values)


def smooth_ramp(t, times, values):
    """Quintic transitions between the knots: rate and acceleration vanish at each of them."""
    k = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
    x = np.clip((t - times[k]) / (times[k + 1] - times[k]), 0.0, 1.0)
    return values[k] + (values[k + 1] - values[k]) * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


@lru_cache
def akima(times, values):
    """Akima's interpolation, kept for the next call."""
    return Akima1DInterpolator(times, values)


def table(t, times, values, interpolation):
    """Measured values between the knots, held before the first and after the last."""
    if interpolation == "linear" or len(times) == 2:
        return np.interp(t, times, values)
    return akima(times, values)(np.clip(t, times[0], times[-1]))


def step(t, time, before, after):
    """A jump at `time`."""
    return before if t < time else after


def sine(t, amplitude, frequency, phase, offset):
    """Frequency in Hz, phase in rad."""
    return offset + amplitude * np.sin(2.0 * np.pi * frequency * t + phase)


def chirp(t, amplitude, times, frequencies, phase):
    """A sine whose frequency (Hz) runs linearly from knot to knot; its phase is continuous."""
    knots = np.append(np.clip(times, None, max(t, times[0])), t)
    mean = (np.interp(knots[1:], times, frequencies) + np.interp(knots[:-1], times, frequencies)) / 2.0
    return amplitude * np.sin(phase + 2.0 * np.pi * np.sum(mean * np.diff(knots)))
