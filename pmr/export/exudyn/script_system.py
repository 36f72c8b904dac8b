"""Reduced bodies and their contacts in Exudyn without pmr: the source text of these is copied into exported scripts."""

# mypy: allow-untyped-defs, allow-untyped-calls
from __future__ import annotations

import warnings
from types import SimpleNamespace

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    MarkerNodeCoordinates,
    MarkerObjectODE2Coordinates,
    NodeGenericODE2,
    NodePointGround,
    ObjectConnectorCoordinateVector,
    ObjectGenericODE2,
    SensorNode,
    SensorObject,
)


def forces_of(model, rows, motion):
    """Forces (m,) in N of contacts that give way, of which some only push, and which of them are closed."""
    pushes, gap = ~np.isnan(model.clearance), np.nan_to_num(model.clearance)
    rigid = ~np.any(rows.F, axis=1)
    closed, fewest, chances = ~rigid, len(rigid) + 1, 3
    for _ in range(1000):
        forces = np.zeros(len(rigid))
        forces[closed] = np.linalg.solve(rows.F[closed][:, closed], (motion - gap)[closed])
        wrong = pushes & ~rigid & np.where(closed, forces < 0.0, motion - gap - rows.F @ forces > 1e-15)
        if not wrong.any():
            return forces, closed
        # All wrong ones change sides as long as that leaves fewer of them, then the first one alone.
        fewest, chances = (wrong.sum(), 3) if wrong.sum() < fewest else (fewest, chances - 1)
        closed = closed ^ (wrong if chances >= 0 else np.arange(len(wrong)) == np.argmax(wrong))
    raise ValueError("which of the contacts are closed was not settled")


def add_system(mbs, model, paths, loads, start):
    """Add the bodies to an mbs; numbers of their nodes, their common object, and the connector of rigid contacts.

    Contacts that give way are springs that travel, K + C^T F^-1 C; rigid ones have multipliers.  Where some only push,
    their forces are found in every iteration.
    """
    n, rigid = len(model.M), ~np.any(model.rows([path(0.0) for path in paths]).F, axis=1)
    pushing, last = bool(np.any(~np.isnan(model.clearance))), SimpleNamespace(t=None)

    def at(t):
        """Stiffness, forces, and rows of the contacts, at t = 0 and at the end of a step."""
        if last.t != t:
            rows, f = model.rows([path(t) for path in paths]), np.array([load(t) for load in loads])
            C, F, H = rows.C[~rigid], rows.F[~rigid][:, ~rigid], rows.H[~rigid]
            springs = np.zeros((len(C), n + len(f))) if pushing else np.linalg.solve(F, np.hstack([C, H]))
            last.t, last.f, last.rows = t, f, rows
            last.K, last.force = model.K + C.T @ springs[:, :n], model.B @ f - C.T @ (springs[:, n:] @ f)
        return last

    def push(mbs, t, item, q, q_t):
        now = at(t)
        return -now.rows.C.T @ forces_of(model, now.rows, now.rows.C @ q + now.rows.H @ now.f)[0]

    q = np.zeros(n) if start is None else np.array(start)
    nBodies = [
        mbs.AddNode(
            NodeGenericODE2(
                numberOfODE2Coordinates=len(q[body]),
                referenceCoordinates=np.zeros(len(q[body])),
                initialCoordinates=q[body],
                initialCoordinates_t=np.zeros(len(q[body])),
            )
        )
        for body in model.bodies
    ]

    def beyond_matrices(mbs, t, item, q, q_t, factor, factor_t):
        # Exudyn adds K and D to the Jacobian itself; given the rest, it needs no differences.
        if t > mbs.variables.get(item, 0.0):
            raise ValueError("another SetPreStepUserFunction took the place of `update`: call both from one function")
        if not pushing:
            return exu.MatrixContainer(np.zeros((n, n)))
        now = at(t)
        closed = forces_of(model, now.rows, now.rows.C @ q + now.rows.H @ now.f)[1]
        C, F = now.rows.C[closed], now.rows.F[closed][:, closed]
        return exu.MatrixContainer(factor * C.T @ np.linalg.solve(F, C))

    oSystem = mbs.AddObject(
        ObjectGenericODE2(
            nodeNumbers=nBodies,
            massMatrix=model.M,
            dampingMatrix=model.D,
            stiffnessMatrix=at(0.0).K,
            forceVector=at(0.0).force,
            jacobianUserFunction=beyond_matrices,
            **({"forceUserFunction": push} if pushing else {}),
        )
    )
    oRigid = None
    if rigid.any():
        ground = mbs.AddMarker(MarkerNodeCoordinates(nodeNumber=mbs.AddNode(NodePointGround())))
        bodies = mbs.AddMarker(MarkerObjectODE2Coordinates(objectNumber=oSystem))
        both = {"markerNumbers": [ground, bodies], "scalingMarker1": at(0.0).rows.C[rigid]}
        oRigid = mbs.AddObject(ObjectConnectorCoordinateVector(**both))

    def update(mbs, t):
        # Called once before each step, with the time at its end: there the equations have to hold.
        now = at(t)
        mbs.SetObjectParameter(oSystem, "stiffnessMatrix", now.K)
        mbs.SetObjectParameter(oSystem, "forceVector", now.force)
        if oRigid is not None:
            mbs.SetObjectParameter(oRigid, "scalingMarker1", now.rows.C[rigid])
        mbs.variables[int(oSystem)] = t
        return True

    mbs.SetPreStepUserFunction(update)
    return SimpleNamespace(update=update, nBodies=nBodies, oSystem=oSystem, oRigid=oRigid, rigid=rigid)


def solve(mbs, end, step, rho_inf, parts=1):
    """Assemble and integrate, each step in equal parts."""
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = step
    settings.linearSolver.solverType = exu.LinearSolverType.EigenDense
    settings.timeIntegration.endTime = end
    settings.timeIntegration.numberOfSteps = round(end / step) * parts
    settings.timeIntegration.adaptiveStep = False
    settings.timeIntegration.automaticStepSize = False
    settings.timeIntegration.generalizedAlpha.spectralRadius = rho_inf
    settings.timeIntegration.newton.useModifiedNewton = False
    mbs.SolveDynamic(settings)


def simulate(model, paths, loads, end, step, rho_inf, start=None, parts=1):
    """Times (T,) in s and the outputs (T, o) of all bodies, in m but for forces and rotations."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    items, kind = add_system(mbs, model, paths, loads, start), exu.OutputVariableType
    sensors = [
        mbs.AddSensor(SensorNode(nodeNumber=node, outputVariableType=kind.Coordinates, storeInternal=True))
        for node in items.nBodies
    ]
    if items.oRigid is not None:
        of_rigid = SensorObject(objectNumber=items.oRigid, outputVariableType=kind.Force, storeInternal=True)
        sensors.append(mbs.AddSensor(of_rigid))
    solve(mbs, end, step, rho_inf, parts)
    stored = [mbs.GetSensorStoredData(sensor) for sensor in sensors]
    t, q = stored[0][:, 0], np.hstack([values[:, 1:] for values in stored[: len(items.nBodies)]])
    rest = q  # what changes its sign with every step: its eighth differences
    for _ in range(4):
        rest = (rest[:-2] - 2.0 * rest[1:-1] + rest[2:]) / 4.0
    if not (rest**2).sum() <= 1e-6 * (q**2).sum():
        warnings.warn(
            "The motion changes its sign with every step: a constraint that moves (index 3) grows where RHO_INF is "
            "near 1, or STEP is too long for the motion. These results can't be trusted.",
            stacklevel=2,
        )
    y = np.empty((len(t), len(model.outputs)))
    for k, time in enumerate(t):
        rows, f = model.rows([path(time) for path in paths]), np.array([load(time) for load in loads])
        forces = forces_of(model, rows, rows.C @ q[k] + rows.H @ f)[0]
        if items.oRigid is not None:
            forces[items.rigid] = stored[-1][k, 1:]
        y[k] = model.outputs @ q[k] + model.W @ f - rows.X @ forces
    return t, y
