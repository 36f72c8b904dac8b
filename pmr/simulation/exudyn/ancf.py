r"""An independent reference: a cable of ANCF elements with a sliding joint, in Exudyn.

Large displacements, axial strain and all: it shares nothing but the material data with the linear beams.  A
mass point that coordinate constraints hold at (s(t), 0) carries the joint.  Pieber, Ntarladima, Winkler,
Gerstmayr: A Hybrid Arbitrary Lagrangian Eulerian Formulation for the Investigation of the Stability of Pipes
Conveying Fluid and Axially Moving Beams, Journal of Computational and Nonlinear Dynamics 17, 2022.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.results import Energy
from pmr.simulation.excitation import Excitation
from pmr.simulation.exudyn.ancf_items import add_force, add_sliding_cable
from pmr.simulation.exudyn.cable import Cable, curvature, values
from pmr.simulation.exudyn.items import add_pre_step_function
from pmr.simulation.exudyn.solver import of_connector, of_nodes, read_sensor, slider_at, solve, solver_settings
from pmr.simulation.stepping import Progress, TimeStepping

__all__ = ["Cable", "CableMotion", "energy", "simulate"]
Array = NDArray[np.float64]


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
    cable: Cable,
    places: Mapping[str, float],
    excitation: Excitation,
    x: Array,
    progress: Progress | None = None,
) -> CableMotion:
    """Simulate from the straight cable at rest; material points x (o,) m are reported.

    The loads act along y at `places`, material points in m by the loads' names.  An InputError is raised where the
    path, places or x leave the cable, or a place has no load; a SimulationError where a step fails or a result is not
    finite.
    """
    x, at = np.asarray(x, dtype=float), np.array(list(places.values()))
    for key, points in (("x", x), ("loads.at", at)):
        _check_on_cable(cable, key, points)
    s, forces = excitation.along((0.0, cable.length)), excitation.forces(list(places))
    stepping = excitation.stepping

    container = exu.SystemContainer()  # owns the mbs: must stay alive
    mbs = container.AddSystem()
    items = add_sliding_cable(mbs, cable, s[0])
    numbers = [add_force(mbs, cable, items, point, force) for point, force in zip(at, forces[0], strict=True)]

    def update(mbs: Any, t: float) -> bool:
        k = round(t / stepping.step)
        mbs.SetObjectParameter(items.oHold, "offset", s[k] - s[0])
        for number, force in zip(numbers, forces[k], strict=True):
            mbs.SetLoadParameter(number, "loadVector", [0.0, force, 0.0])
        return True

    add_pre_step_function(mbs, update)
    kind = exu.OutputVariableType
    sensors = [of_nodes(mbs, items.nNodes, which) for which in (kind.Coordinates, kind.Coordinates_t)]
    sensors.append([of_connector(mbs, items.oJoint)])
    place = slider_at(lambda t: s[round(t / stepping.step)])
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
    r"""Energies by the trapezoidal rule over the reported points, which should span the cable.

    .. math::
        \tfrac12 \rho A \int |\dot r|^2 dx, \qquad \tfrac12 EI \int K^2 dx, \qquad - \sum_i F_i\, y_i

    Axial strain is left out, as the paper has it (equation for H^ANCF).
    """
    speed = np.sum(motion.velocity**2, axis=2)
    return Energy(
        kinetic=0.5 * cable.mass_per_length * _trapezoid(speed, motion.x),
        strain=0.5 * cable.bending_stiffness * _trapezoid(motion.curvature**2, motion.x),
        external=-np.sum(motion.loads * motion.load_displacement, axis=1),
    )


def _trapezoid(y: Array, x: Array) -> Array:
    """Integrals (T,) of y (T, o) over x (o,)."""
    return np.asarray((y[:, 1:] + y[:, :-1]) @ np.diff(x) / 2.0)


def _settings(cable: Cable, stepping: TimeStepping) -> Any:
    """Modified Newton, which needs a new Jacobian once in tens of steps, and a tolerance above round-off.

    Axial forces come from differences of positions of the order of the length L, over elements of length h:
    their round-off is eps EA L / h, in N.
    """
    chosen = solver_settings(stepping, exu.LinearSolverType.EigenSparse)
    newton = chosen.timeIntegration.newton
    newton.useModifiedNewton = True
    newton.absoluteTolerance = 10.0 * np.finfo(float).eps * cable.axial_stiffness * cable.elements
    return chosen


def _check_on_cable(cable: Cable, key: str, points: Array) -> None:
    outside = (points < 0.0) | (points > cable.length * (1.0 + 1e-12))
    if outside.any():
        raise InputError("scene", key, float(points[outside][0]), f"0 to {cable.length:g} m is allowed")
