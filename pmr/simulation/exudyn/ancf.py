r"""An independent reference in Exudyn: a cable of ANCF elements with a sliding joint.

The cable has large displacements and axial strain, and shares only the material data with the linear beams.  The joint
is on a mass point, which coordinate constraints hold at (s(t), 0) with the path s.  Pieber, Ntarladima, Winkler,
Gerstmayr: A Hybrid Arbitrary Lagrangian Eulerian Formulation for the Investigation of the Stability of Pipes Conveying
Fluid and Axially Moving Beams, Journal of Computational and Nonlinear Dynamics 17, 2022.

Position and curvature of a uniform cable at a material point x follow from its ANCF coordinates q by

.. math::
    r(x) = \sum_j S_j(\xi)\, q_j, \qquad K = e_3^T \frac{r' \times r''}{|r'|^2}

with the cubic shapes S of position and slope at both ends of an element, the coordinate :math:`\xi` in the element, and
the axis :math:`e_3` across the plane.  Coordinates of a node are its displacement (x, y) and the change of its slope r'
(x, y), relative to the straight cable.  Gerstmayr, Irschik: On the correct representation of bending and axial
deformation in the absolute nodal coordinate formulation with an elastic line approach, Journal of Sound and Vibration
318, 2008.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import scipy.integrate

from pmr.errors import InputError
from pmr.files.arrays import Array, Indices
from pmr.results import Energy
from pmr.simulation.excitation import Excitation
from pmr.simulation.exudyn.items import add_force_sensor, add_node_sensors, add_pre_step_function
from pmr.simulation.exudyn.solver import read_sensor, solve, solver_settings
from pmr.simulation.stepping import Progress, TimeStepping

#: Shapes S of position and of slope times length h, at an element's left and then right end, as polynomials in xi / h.
_SHAPES = np.array([[2.0, -3.0, 0.0, 1.0], [1.0, -2.0, 1.0, 0.0], [-2.0, 3.0, 0.0, 0.0], [1.0, -1.0, 0.0, 0.0]])
#: Distance in element lengths below which a point counts as lying on a node.
_ON_NODE = 1e-9


@dataclass(frozen=True)
class Cable:
    """A uniform cable along x from 0 to `length`, pinned at 0."""

    length: float  # m
    axial_stiffness: float  # EA, N
    bending_stiffness: float  # EI, N m^2
    mass_per_length: float  # rho A, kg/m
    elements: int  # all of the same length

    @property
    def element_length(self) -> float:
        """Length in m of each element."""
        return self.length / self.elements

    def left_elements(self, x: Array) -> Indices:
        """Numbers of the elements in which the material points x (any shape) in m are, in the shape of x.

        A point at a node is in the element to the left; a point beyond an end of the cable, in the element there.
        """
        return np.clip(np.ceil(x / self.element_length - _ON_NODE).astype(int) - 1, 0, self.elements - 1)

    def right_elements(self, x: Array) -> Indices:
        """Numbers of the elements in which the material points x (any shape) in m are, in the shape of x.

        A point at a node is in the element to the right; a point beyond an end of the cable, in the element there.
        """
        return np.clip(np.floor(x / self.element_length + _ON_NODE).astype(int), 0, self.elements - 1)


def values(cable: Cable, q: Array, x: Array) -> Array:
    """Displacements (T, o, 2) in m of a cable at the material points x (o,) in m.

    q (T, N, 4) are the coordinates of all N nodes.  With the nodes' velocities as q, the result is velocities in m/s.
    """
    return _apply(_interpolation(cable, x, cable.left_elements(x), derivative=0), q)


def curvature(cable: Cable, q: Array, x: Array) -> Array:
    """Material curvature K (T, o) in 1/m of a cable at the material points x (o,) in m.

    At a node, the result is the mean of both elements.  q (T, N, 4) are the coordinates of all N nodes.
    """
    before, after = (_curvature(cable, q, x, e) for e in (cable.left_elements(x), cable.right_elements(x)))
    return (before + after) / 2.0


def _curvature(cable: Cable, q: Array, x: Array, elements: Indices) -> Array:
    """Material curvature (T, o) in 1/m of a `cable` at points x (o,) in m, by the coordinates q (T, N, 4) of its nodes.

    `elements` (o,) are the numbers of the elements whose shape functions are used, one for each point.
    """
    slope = np.array([1.0, 0.0]) + _apply(_interpolation(cable, x, elements, derivative=1), q)
    bend = _apply(_interpolation(cable, x, elements, derivative=2), q)
    cross = slope[..., 0] * bend[..., 1] - slope[..., 1] * bend[..., 0]
    return np.asarray(cross / np.sum(slope**2, axis=-1))


def _interpolation(cable: Cable, x: Array, elements: Indices, derivative: int) -> Array:
    """Matrix (o, 2 N) that maps values and slopes at the N nodes of a `cable` to a derivative at o material points.

    The points are x (o,) in m.  `derivative` is the order of the derivative, 0 for the value.  `elements` (o,) are the
    numbers of the elements whose shape functions are used, one for each point.
    """
    h = cable.element_length
    matrix = np.zeros((len(x), 2 * (cable.elements + 1)))
    for j, shape in enumerate(_SHAPES):
        weights = np.polyval(np.polyder(shape, derivative), x / h - elements) / h**derivative
        matrix[np.arange(len(x)), 2 * elements + j] = weights * (h if j % 2 else 1.0)
    return matrix


def _apply(matrix: Array, q: Array) -> Array:
    """Values (T, o, 2) from a matrix (o, 2 N) and nodal coordinates q (T, N, 4)."""
    steps, nodes, _ = q.shape
    return np.einsum("on,tnc->toc", matrix, q.reshape(steps, 2 * nodes, 2), optimize=True)


__all__ = ["Cable", "CableMotion", "energy", "simulate"]


@dataclass(frozen=True)
class CableMotion:
    """Motion of a cable at chosen material points."""

    t: Array  # (T,) s
    x: Array  # (o,) m: material points, positions in the undeformed cable
    displacement: Array  # (T, o) m: transverse
    velocity: Array  # (T, o, 2) m/s: along x and y
    curvature: Array  # (T, o) 1/m: where two elements meet, the mean of both sides
    # (T, i) in N and m: forces, and the transverse displacements where they act
    loads: Array
    load_displacement: Array
    # (T,) N: multiplier lambda of the joint; the slider pushes with -lambda on the cable, normal to it
    slider_force: Array
    s: Array  # (T,) m: position of the slider in space
    seconds: float  # wall time of the solver alone


def simulate(
    cable: Cable, places: Mapping[str, float], excitation: Excitation, x: Array, progress: Progress | None = None
) -> CableMotion:
    """Simulate from the straight cable at rest, and return its motion at the material points x (o,) in m.

    Loads act along y at the material points `places` in m, by the loads' names.  Raises InputError if the path, a place
    or a point x is not on the cable, or if a place has no load; raises SimulationError if a step fails or a result is
    not finite.  `progress`, if not None, is called with the share of the run that is done.
    """
    x, at = np.asarray(x, dtype=float), np.array(list(places.values()))
    for key, points in (("x", x), ("loads.at", at)):
        _check_on_cable(cable, key, points)
    s, forces = excitation.path_within((0.0, cable.length)), excitation.forces(list(places))
    stepping = excitation.stepping

    container = exu.SystemContainer()  # owns the mbs: must stay alive
    mbs = container.AddSystem()
    items = add_sliding_cable(mbs, cable, s[0])
    numbers = [add_force(mbs, cable, items, point, force) for point, force in zip(at, forces[0], strict=True)]

    def update(mbs: exu.MainSystem, t: float) -> bool:
        """Pre-step function: set slider and loads to those at t."""
        k = round(t / stepping.step)
        mbs.SetObjectParameter(items.oHold, "offset", s[k] - s[0])
        for number, force in zip(numbers, forces[k], strict=True):
            mbs.SetLoadParameter(number, "loadVector", [0.0, force, 0.0])
        return True

    add_pre_step_function(mbs, update)
    kind = exu.OutputVariableType
    sensors = [add_node_sensors(mbs, items.nNodes, which) for which in (kind.Coordinates, kind.Coordinates_t)]
    sensors.append([add_force_sensor(mbs, items.oJoint)])

    def place(t: float) -> str:
        """Text with the slider's position at t s, to append to a message."""
        return f", slider at {s[round(t / stepping.step)]:g} m"

    seconds = solve(mbs, _settings(cable, stepping), place, progress)
    stored_values = [[read_sensor(mbs, sensor, stepping, place) for sensor in group] for group in sensors]
    q, v, joint = (np.stack(group, axis=1) for group in stored_values)
    return CableMotion(
        t=excitation.times,
        x=x,
        displacement=values(cable, q, x)[:, :, 1],
        velocity=values(cable, v, x),
        curvature=curvature(cable, q, x),
        loads=forces,
        load_displacement=values(cable, q, at)[:, :, 1],
        slider_force=joint[:, 0, 1],
        s=s,
        seconds=seconds,
    )


def energy(cable: Cable, motion: CableMotion) -> Energy:
    r"""Energies of a cable's motion by the trapezoidal rule over its material points.

    .. math::
        \tfrac12 \rho A \int |\dot r|^2 dx, \qquad \tfrac12 EI \int K^2 dx, \qquad - \sum_i F_i\, y_i

    The energies are kinetic energy, bending energy and potential of the forces F_i at displacements y_i.  The material
    points should span the cable.  The energy of axial strain is left out, as in Weyrer et al. (equation for H^ANCF).
    """
    speed = np.sum(motion.velocity**2, axis=2)
    return Energy(
        kinetic=0.5 * cable.mass_per_length * scipy.integrate.trapezoid(speed, motion.x),
        strain=0.5 * cable.bending_stiffness * scipy.integrate.trapezoid(motion.curvature**2, motion.x),
        external=-np.sum(motion.loads * motion.load_displacement, axis=1),
    )


def _settings(cable: Cable, stepping: TimeStepping) -> exu.SimulationSettings:
    """Solver settings for a cable: modified Newton, which rarely needs a new Jacobian, and a tolerance above round-off.

    The tolerance is above the round-off eps EA L / h in N of axial forces, with the machine precision eps.  Axial
    forces follow from differences of positions over the length h of an element, and positions are as large as the
    cable's length L.
    """
    chosen = solver_settings(stepping, exu.LinearSolverType.EigenSparse)
    newton = chosen.timeIntegration.newton
    newton.useModifiedNewton = True
    newton.absoluteTolerance = 10.0 * np.finfo(float).eps * cable.axial_stiffness * cable.elements
    return chosen


def _check_on_cable(cable: Cable, key: str, points: Array) -> None:
    """Raise InputError with the scene's key `key` if one of the points (o,) in m is not on the cable."""
    outside = (points < 0.0) | (points > cable.length * (1.0 + 1e-12))
    if outside.any():
        raise InputError("scene", key, float(points[outside][0]), f"0 to {cable.length:g} m is allowed")


@dataclass(frozen=True)
class CableItems:
    """Numbers of the items of a cable with a sliding joint in an mbs."""

    nNodes: list[exu.NodeIndex]  # of NodePoint2DSlope1, from x = 0 on
    oElements: list[exu.ObjectIndex]  # of ObjectANCFCable2D
    oHold: exu.ObjectIndex  # an ObjectConnectorCoordinate that holds the slider along x; its offset is s(t) - s(0) in m
    # an ObjectJointSliding2D; the second component of its Force is the multiplier normal to the cable
    oJoint: exu.ObjectIndex


def add_sliding_cable(mbs: exu.MainSystem, cable: Cable, s: float) -> CableItems:
    """Add a straight cable at rest, pinned at x = 0, and a slider at s (m); return their numbers."""
    h = cable.element_length
    nodes = [
        mbs.AddNode(eii.NodePoint2DSlope1(name=f"cable{i}", referenceCoordinates=[i * h, 0.0, 1.0, 0.0]))
        for i in range(cable.elements + 1)
    ]
    elements = [
        mbs.AddObject(
            eii.ObjectANCFCable2D(
                length=h,
                massPerLength=cable.mass_per_length,
                bendingStiffness=cable.bending_stiffness,
                axialStiffness=cable.axial_stiffness,
                nodeNumbers=[first, second],
            )
        )
        for first, second in zip(nodes[:-1], nodes[1:], strict=True)
    ]
    nGround = mbs.AddNode(eii.NodePointGround(name="ground"))
    mGround = mbs.AddMarker(eii.MarkerNodeCoordinate(nodeNumber=nGround, coordinate=0))
    for direction in (0, 1):
        _fix(mbs, mGround, nodes[0], direction)
    # The constraints leave the slider no freedom, so its mass and its velocity at t = 0 have no effect.
    nSlider = mbs.AddNode(eii.NodePoint2D(name="slider", referenceCoordinates=[s, 0.0]))
    mbs.AddObject(eii.ObjectMassPoint2D(mass=1.0, nodeNumber=nSlider))
    oHold = _fix(mbs, mGround, nSlider, 0)
    _fix(mbs, mGround, nSlider, 1)
    return CableItems(nodes, elements, oHold, _add_joint(mbs, cable, elements, nSlider, s))


def add_force(mbs: exu.MainSystem, cable: Cable, items: CableItems, at: float, force: float) -> exu.LoadIndex:
    """Add a force along y (N) at the material point `at` (m), and return the number of the load."""
    e = int(cable.left_elements(np.array(at)))
    local = [at - e * cable.element_length, 0.0, 0.0]
    marker = mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=items.oElements[e], localPosition=local))
    return mbs.AddLoad(eii.LoadForceVector(markerNumber=marker, loadVector=[0.0, force, 0.0]))


def _fix(mbs: exu.MainSystem, mGround: exu.MarkerIndex, node: exu.NodeIndex, coordinate: int) -> exu.ObjectIndex:
    """Add a constraint of one coordinate of a node to the ground's marker `mGround`, and return its number."""
    marker = mbs.AddMarker(eii.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
    return mbs.AddObject(eii.ObjectConnectorCoordinate(markerNumbers=[mGround, marker]))


def _add_joint(
    mbs: exu.MainSystem, cable: Cable, elements: list[exu.ObjectIndex], nSlider: exu.NodeIndex, s: float
) -> exu.ObjectIndex:
    """Add the sliding joint between the slider's node `nSlider` at s (m) and all `elements`; return its number."""
    markers = [mbs.AddMarker(eii.MarkerBodyCable2DCoordinates(bodyNumber=element)) for element in elements]
    first = int(cable.left_elements(np.array(s)))
    return mbs.AddObject(
        eii.ObjectJointSliding2D(
            name="slidingJoint",
            markerNumbers=[mbs.AddMarker(eii.MarkerNodePosition(nodeNumber=nSlider)), markers[first]],
            slidingMarkerNumbers=markers,
            slidingMarkerOffsets=np.arange(cable.elements) * cable.element_length,
            nodeNumber=mbs.AddNode(eii.NodeGenericData(initialCoordinates=[first, s], numberOfDataCoordinates=2)),
            useClassicalFormulation=False,  # this differs by 0.07 % from a linear beam, the classical one by 0.2 %
        )
    )
