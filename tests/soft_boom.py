"""Soft beam that extends through a pad while it is raised, and a cantilever, as ANCF cables of Exudyn.

Positions are those in the plane of the ground, and displacements may have any size: no frame, no geometric stiffness,
nothing of pmr.  Gerstmayr, Irschik: On the correct representation of bending and axial deformation in the absolute
nodal coordinate formulation with an elastic line approach, Journal of Sound and Vibration 318, 2008.
"""

from collections.abc import Callable
from dataclasses import dataclass

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    LoadForceVector,
    LoadMassProportional,
    MarkerBodyCable2DCoordinates,
    MarkerBodyMass,
    MarkerNodeCoordinate,
    MarkerNodePosition,
    NodeGenericData,
    NodePoint2D,
    NodePoint2DSlope1,
    NodePointGround,
    ObjectANCFCable2D,
    ObjectConnectorCoordinate,
    ObjectJointRevolute2D,
    ObjectJointSliding2D,
    ObjectMassPoint2D,
    SensorNode,
)

from pmr.files.arrays import Array

OfTime = Callable[[float], float]


@dataclass(frozen=True)
class Beam:
    """Uniform beam with weight, and with a mass at its tip."""

    length: float  # m
    EA: float  # N
    EI: float  # N m^2
    mass_per_length: float  # kg/m
    mass: float  # kg
    gravity: float = 9.81  # m/s^2
    elements: int = 20

    def add(self, mbs: exu.MainSystem, tail: Array, along: Array) -> tuple[list, list]:
        """Add the beam, straight from its tail (2,) in m along a unit vector (2,); return its nodes and elements."""
        h = self.length / self.elements
        nodes = [
            mbs.AddNode(NodePoint2DSlope1(referenceCoordinates=[*(tail + k * h * along), *along]))
            for k in range(self.elements + 1)
        ]
        elements = [
            mbs.AddObject(
                ObjectANCFCable2D(
                    length=h,
                    massPerLength=self.mass_per_length,
                    bendingStiffness=self.EI,
                    axialStiffness=self.EA,
                    nodeNumbers=[left, right],
                )
            )
            for left, right in zip(nodes[:-1], nodes[1:], strict=True)
        ]
        weight = [0.0, -self.gravity, 0.0]
        for element in elements:
            marker = mbs.AddMarker(MarkerBodyMass(bodyNumber=element))
            mbs.AddLoad(LoadMassProportional(markerNumber=marker, loadVector=weight))
        if self.mass:
            place = mbs.AddNode(NodePoint2D(referenceCoordinates=(tail + self.length * along).tolist()))
            payload = mbs.AddObject(ObjectMassPoint2D(mass=self.mass, nodeNumber=place))
            marker = mbs.AddMarker(MarkerBodyMass(bodyNumber=payload))
            mbs.AddLoad(LoadMassProportional(markerNumber=marker, loadVector=weight))
            both = [mbs.AddMarker(MarkerNodePosition(nodeNumber=node)) for node in (nodes[-1], place)]
            mbs.AddObject(ObjectJointRevolute2D(markerNumbers=both))
        return nodes, elements


class Held:
    """Constraints that move the coordinates of a node along curves over time."""

    def __init__(self, mbs: exu.MainSystem, ground: int, node: int, place: Callable[[float], Array]) -> None:
        self._place, self._constraints = place, []
        for k in range(len(place(0.0))):
            marker = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=k))
            self._constraints.append(mbs.AddObject(ObjectConnectorCoordinate(markerNumbers=[ground, marker])))

    def set(self, mbs: exu.MainSystem, t: float) -> None:
        """Move the constraints to their positions at t s."""
        for constraint, offset in zip(self._constraints, self._place(t) - self._place(0.0), strict=True):
            mbs.SetObjectParameter(constraint, "offset", float(offset))


def _ground(mbs: exu.MainSystem) -> int:
    """Add a ground and return its marker."""
    return mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0))


def _of(angle: float) -> Array:
    """Unit vector (2,) at an angle in rad."""
    return np.array([np.cos(angle), np.sin(angle)])


def slides_out(beam: Beam, pad: float, out: OfTime, raised: OfTime, end: float, steps: int, rho_inf: float) -> Array:
    """Deflection (T,) in m of the tip from the axis; the beam's tail is pinned to the axis, `out` m from the pivot.

    The axis turns about the pivot by `raised` rad; a pad on it, `pad` m from the pivot, lets the beam slide.  The
    motion starts at rest, in equilibrium, and takes `end` s in so many steps.
    """
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    nodes, elements = beam.add(mbs, out(0.0) * _of(raised(0.0)), _of(raised(0.0)))
    ground = _ground(mbs)
    slider = mbs.AddNode(NodePoint2D(referenceCoordinates=(pad * _of(raised(0.0))).tolist()))
    mbs.AddObject(ObjectMassPoint2D(mass=1.0, nodeNumber=slider))
    places = ((slider, lambda t: pad * _of(raised(t))), (nodes[0], lambda t: out(t) * _of(raised(t))))
    held = [Held(mbs, ground, node, place) for node, place in places]
    markers = [mbs.AddMarker(MarkerBodyCable2DCoordinates(bodyNumber=element)) for element in elements]
    h, at = beam.length / beam.elements, pad - out(0.0)
    first = int(at / h)
    mbs.AddObject(
        ObjectJointSliding2D(
            markerNumbers=[mbs.AddMarker(MarkerNodePosition(nodeNumber=slider)), markers[first]],
            slidingMarkerNumbers=markers,
            slidingMarkerOffsets=np.arange(beam.elements) * h,
            nodeNumber=mbs.AddNode(NodeGenericData(initialCoordinates=[first, at], numberOfDataCoordinates=2)),
            useClassicalFormulation=False,
        )
    )

    def update(mbs: exu.MainSystem, t: float) -> bool:
        """Move all held nodes to their positions at t s, before each step."""
        for one in held:
            one.set(mbs, t)
        return True

    sensor = _position(mbs, nodes[-1])
    mbs.Assemble()
    chosen = settings(beam)
    mbs.SolveStatic(chosen)
    data = mbs.systemData
    data.SetSystemState(data.GetSystemState(exu.ConfigurationType.Current), exu.ConfigurationType.Initial)
    mbs.SetPreStepUserFunction(update)
    chosen.timeIntegration.endTime, chosen.timeIntegration.numberOfSteps = end, steps
    chosen.timeIntegration.generalizedAlpha.spectralRadius = rho_inf
    chosen.timeIntegration.newton.useModifiedNewton = True
    chosen.solution.sensors.writePeriod = end / steps
    mbs.SolveDynamic(chosen)
    found = mbs.GetSensorStoredData(sensor)
    found = found[-steps - 1 :]  # the static step stands before
    angles = np.array([raised(t) for t in found[:, 0]])
    return np.asarray(found[:, 2] * np.cos(angles) - found[:, 1] * np.sin(angles))


def hangs(beam: Beam, raised: float, force: float = 0.0) -> float:
    """Deflection in m of a clamped beam's tip from its axis in equilibrium, under a force in N downwards at the tip."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    nodes, _ = beam.add(mbs, np.zeros(2), _of(raised))
    Held(mbs, _ground(mbs), nodes[0], lambda t: np.zeros(4))
    marker = mbs.AddMarker(MarkerNodePosition(nodeNumber=nodes[-1]))
    mbs.AddLoad(LoadForceVector(markerNumber=marker, loadVector=[0.0, -force, 0.0]))
    mbs.Assemble()
    chosen = settings(beam)
    chosen.staticSolver.numberOfLoadSteps = 10
    mbs.SolveStatic(chosen)
    x, y, _ = mbs.GetNodeOutput(nodes[-1], exu.OutputVariableType.Position)
    return float(y * np.cos(raised) - x * np.sin(raised))


def _position(mbs: exu.MainSystem, node: int) -> int:
    """Add a sensor of a node's position."""
    kind = exu.OutputVariableType.Position
    return mbs.AddSensor(SensorNode(nodeNumber=node, outputVariableType=kind, storeInternal=True))


def settings(beam: Beam) -> exu.SimulationSettings:
    """Settings without files, with a tolerance above the round-off of axial forces."""
    chosen = exu.SimulationSettings()
    chosen.solution.file.write = False
    chosen.staticSolver.verboseMode = chosen.timeIntegration.verboseMode = 0
    chosen.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    round_off = 10.0 * np.finfo(float).eps * beam.EA * beam.elements  # of axial forces, from places
    for newton in (chosen.staticSolver.newton, chosen.timeIntegration.newton):
        newton.absoluteTolerance = round_off
    return chosen
