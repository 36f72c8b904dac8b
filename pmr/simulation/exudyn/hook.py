r"""A hook on a boom that a body carries in Exudyn: a point with a mass, to which ropes and more can be attached.

The hook is at a point where three loads of the model act along x, y and z.  By coordinates q and loads, the point of
the boom is displaced by :math:`B^T q + E f`, which includes the immediate response to forces, and gets closer by
:math:`q^T G q / 2` if the system has second order.  So the hook at x, with its force f on the boom in the boom's axes
and the model's loads f_w, the weight included, fulfils

.. math:: g = R^T (x - x_O) - d - r - B_h^T q + \tfrac12 e_x\, q^T G q - E_{hw} f_w - E_h f = 0

a constraint with the multiplier f.  The index h marks the three inputs of the hook; R and x_O are axes and pivot of the
boom, d is the position of the section's tail, r that of the point from the tail.  By virtual work f acts on the base
too, at the position of the hook, so that momentum is conserved.  Coordinates w in m without mass represent :math:`E_h w
= e E_h f`, with e the largest eigenvalue of E_h; in directions without flexibility w is held at zero.  They store
:math:`w^T E_h w / 2 e^2`, which changes with an extension s that is a coordinate: together with the change of this
energy, the derivative of the constraint by s results in the force :math:`f^T E_h' f / 2` along the path.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.scene.rotation import skew
from pmr.simulation.exudyn.free_base import Base, ForcesAndStiffness
from pmr.simulation.exudyn.items import SystemItems, add_coordinates
from pmr.simulation.start import InitialState
from pmr.system.changing_rows import InputResponse

#: Share of the largest flexibility below which a flexibility is zero; least value in m/N of the largest flexibility.
ROUND_OFF, TINY = 1e-9, 1e-20
#: Names of the initial rates in the dictionaries of nodes.
RATES = ("initialCoordinates_t", "initialVelocities")


@dataclass(frozen=True)
class Hook:
    """Numbers of the items of a hook in an mbs."""

    nHook: exu.NodeIndex  # NodePoint
    oHook: exu.ObjectIndex  # ObjectMassPoint on it
    mHook: exu.MarkerIndex  # MarkerNodePosition
    # ObjectConnectorCoordinateVector that joins it to the boom; its Force is that on the boom, in the boom's axes
    oJoint: exu.ObjectIndex


def add_hook(mbs: exu.MainSystem, items: SystemItems, loads: tuple[str, str, str], mass: float) -> Hook:
    """Add a point of mass `mass` in kg at the point where three of the boom's loads act.

    The hook starts at the place that this point has while the hook does not pull on it, and with the point's velocity.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    items : SystemItems
        The items that `simulator.add_system` returned, with its argument `on`.
    loads : three str
        Names of inputs along x, y and z of the boom at one point, ``fly.hook x`` and so on.  The loads' own signals
        still act, besides the force of the hook.
    mass : float
        Mass of the hook itself in kg.  Its weight, by the gravity of the scene in the argument `on` of
        `simulator.add_system`, acts along -Z of the mbs.

    Raises
    ------
    InputError
        If the boom stands on the ground or has friction, the model has no such inputs at one point, or the mass is
        negative or not finite.
    """
    if not 0.0 <= mass < np.inf:
        raise InputError("Exudyn", "mass", mass, "0 kg or more is allowed for a hook")
    base = items.parts.base
    if base is None:
        raise InputError("Exudyn", "on", None, "a boom on a rigid body is allowed to carry a hook")
    items.parts.equations.system.ensure_frictionless("Exudyn, a boom with a hook")
    nodes = [base.node, *items.nBodies.values(), *base.paths.nodes]
    node_data = [mbs.GetNode(node) for node in nodes]
    start = np.concatenate([node["initialCoordinates"] for node in node_data])
    rates = np.concatenate([node[next(key for key in RATES if key in node)] for node in node_data])
    joint = _Joint(base, items, loads, start)
    place, velocity = joint.start(start, rates)
    name = items.component_name(mbs, f" {loads[2]}")
    node = mbs.AddNode(eii.NodePoint(name=name, referenceCoordinates=place, initialVelocities=velocity))
    nForce = add_coordinates(mbs, f"{name} force", InitialState.at_rest(3))
    oGiven = mbs.AddObject(
        eii.ObjectGenericODE2(
            name=f"{name} gives",
            nodeNumbers=[nForce, node, *nodes],
            massMatrix=joint.mass,
            forceUserFunction=lambda mbs, t, item, q, q_t: joint.forces_and_stiffness(t, np.array(q)).forces,
            jacobianUserFunction=lambda mbs, t, item, q, q_t, factor, factor_t: exu.MatrixContainer(
                factor * joint.forces_and_stiffness(t, np.array(q)).stiffness
            ),
        )
    )
    oJoint = mbs.AddObject(
        eii.ObjectConnectorCoordinateVector(
            name=name,
            markerNumbers=[items.mGround, mbs.AddMarker(eii.MarkerObjectODE2Coordinates(objectNumber=oGiven))],
            scalingMarker0=np.zeros((3, 1)),  # its number of rows is that of the constraint
            constraintUserFunction=lambda mbs, t, item, q, q_t, velocity: joint.gap(t, np.array(q)),
            jacobianUserFunction=lambda mbs, t, item, q, q_t, velocity: joint.gap_derivative(t, np.array(q)),
        )
    )
    oHook = mbs.AddObject(eii.ObjectMassPoint(name=f"{name} mass", mass=mass, nodeNumber=node))
    mHook = mbs.AddMarker(eii.MarkerNodePosition(name=name, nodeNumber=node))
    mbs.AddLoad(
        eii.LoadForceVector(
            name=f"{name} weight",
            markerNumber=mHook,
            loadVector=[0.0, 0.0, -mass * base.weight(0.0)],
            loadVectorUserFunction=lambda mbs, t, load: [0.0, 0.0, -mass * base.weight(t)],
        )
    )
    return Hook(node, oHook, mHook, oJoint)


class UnloadedPoint(NamedTuple):
    """Position of a point in m along the boom's axes, and its derivatives by coordinates of the boom and paths."""

    at: Array  # (3,)
    by_boom: Array  # (3, n)
    by_paths: Array  # (3, P)


class _Joint:
    """Constraint between the hook and the point of the boom where three loads act.

    Its coordinates z (N,) are w (3), the position of the hook (3), and the coordinates of the base, of the boom and of
    the nodes of extensions.  The coordinates w have no mass, and represent the displacement of the boom's point by
    immediate flexibility, as the module describes.
    """

    def __init__(self, base: Base, items: SystemItems, loads: tuple[str, str, str], start: Array) -> None:
        """Find the point of the boom on `base` where the three `loads`, names of inputs, act along x, y and z.

        `items` are those of the boom.  `start` (N - 6,) are the coordinates at t = 0 of the base, the boom and nodes of
        extensions.  Raises InputError if the loads are no forces along x, y and z at one point.
        """
        names = items.parts.equations.system.input_names
        if unknown := [name for name in loads if name not in names]:
            raise InputError("system", "loads", ", ".join(unknown), f"{', '.join(names)} are allowed")
        self._base, self._inputs, self._on = base, items.parts.inputs, [names.index(name) for name in loads]
        of_sections = base.boom.boom.loads[:, :, self._on]
        owner = next(k for k, work in enumerate(of_sections) if work.any())
        work = of_sections[owner]
        turned = work[3:]  # r x e_j
        self._r, self._section = np.array([turned[2, 1], turned[0, 2], turned[1, 0]]), owner
        expected = skew(self._r)
        if not (np.allclose(work[:3], np.eye(3)) and np.allclose(turned, expected, atol=1e-9)):
            allowed = "forces along x, y and z at one place are allowed"
            raise InputError("system", "loads", ", ".join(loads), allowed)
        response = base.answering.response(base.split_displacements(0.0, start).s)
        values, vectors = np.linalg.eigh(response.select(self._on).E)
        stiff = vectors[:, values <= ROUND_OFF * max(response.E.max(), TINY)]
        self._firm = stiff @ stiff.T  # projection onto the directions without immediate flexibility
        self._scale = float(values[-1]) if values[-1] > 0.0 else 1.0
        self._shortened = list(base.boom.load_shortenings(loads[0]))
        self.mass = np.zeros((6 + len(start),) * 2)  # kg: of w in directions without flexibility
        self.mass[:3, :3] = self._firm

    def _responses(self, s: Array) -> InputResponse:
        """Response of the hook's point to the three loads alone, with P paths at s (P,) in m."""
        return self._base.answering.response(s).select(self._on)

    def forces_and_stiffness(self, t: float, z: Array) -> ForcesAndStiffness:
        """Force (N,) on the coordinates z (N,) at t s, and stiffness (N, N); z begins with the node's displacement w.

        The force is minus the derivative of the elastic energy of w, which depends on the extensions, too.  In
        directions in which the boom has no flexibility, a stiff spring holds w.  The stiffness leaves out the second
        derivatives of the energy by the extensions.
        """
        w, along, e, K = z[:3], self._base.paths.along, self._scale, np.zeros((len(z),) * 2)
        response = self._responses(self._base.split_displacements(t, z[6:]).s)
        first = len(z) - along.shape[1]
        K[:3, :3] = (response.E / e + self._firm) / e
        K[:3, first:] = (response.E_slope @ w).T @ along / e**2
        K[first:, :3] = K[:3, first:].T
        force = -K[:, :3] @ w
        force[first:] /= 2.0
        return ForcesAndStiffness(force, K)

    def _unloaded_point(self, t: float, q: Array, s: Array, R: Array) -> UnloadedPoint:
        """Point of the boom to which the hook is joined, at t s and without the hook's force, from the pivot O.

        The boom has the coordinates q (n,), the P extensions s (P,) in m, and the axes R (3, 3) in space.
        """
        answers, e = self._base.answering.response(s), np.array([1.0, 0.0, 0.0])
        rows, bent, by = answers.B[:, self._on].T, np.zeros_like(q), np.zeros_like(s)
        for k, G in self._shortened:  # the boom is shorter by q^T G q / 2 at the hook's load along x
            l, Gq = (1.0 if k is None else s[k]), G @ q
            bent += Gq / l
            if k is not None:
                by[k] -= q @ Gq / l**2 / 2.0
        loads = self._base.boom.weight(self._base.weight(t) * R[2], len(answers.E)) + self._inputs.values_at(t).loads
        carried = np.arange(len(s)) <= self._section
        at = self._base.boom.boom.place + e * (s @ carried - bent @ q / 2.0) + self._r + rows @ q
        sliding = (answers.B_slope[:, :, self._on].transpose(0, 2, 1) @ q + answers.E_slope[:, self._on] @ loads).T
        by_paths = sliding + np.outer(e, carried - by)
        return UnloadedPoint(at + answers.E[self._on] @ loads, rows - np.outer(e, bent), by_paths)

    def start(self, z: Array, z_t: Array) -> Array:
        """Position in m and velocity in m/s, (2, 3), that the boom's point has in space at t = 0 without the hook.

        z and z_t (N - 6,) are coordinates and rates of base, boom and nodes of extensions, in this order.  Coordinates
        of the hook, and w, by which the boom's point gives way to the hook, are left out.
        """
        base, k, n = self._base, self._base.count, self._base.boom.size
        x, q, s = base.split_displacements(0.0, z)
        of_body = base.kinematics(x, z_t[:k])
        at, by_q, by_s = self._unloaded_point(0.0, q, s, of_body.axes)
        relative = by_q @ z_t[k : k + n] + by_s @ base.paths.extensions(0.0, z[k + n :], z_t[k + n :]).rate
        velocity = of_body.by_rates[:3] @ z_t[:k] + skew(of_body.omega) @ at + relative
        return np.array([base.origin(x) + of_body.axes @ at, of_body.axes @ velocity])

    def gap(self, t: float, z: Array) -> Array:
        """Gap g (3,) in m of the constraint at t s, at the coordinates z (N,) that a marker returns."""
        x, q, s = self._base.split(t, z[6:])
        R = self._base.kinematics(x, 0.0 * x).axes
        at = R.T @ (z[3:6] - self._base.origin(x))
        return np.asarray(at - self._unloaded_point(t, q, s, R).at - self._responses(s).E @ z[:3] / self._scale)

    def gap_derivative(self, t: float, z: Array) -> Array:
        """Derivative (3, N) of the gap by all coordinates, at t s and at the coordinates z (N,)."""
        x, q, s = self._base.split(t, z[6:])
        turned, _, _, R = self._base.kinematics(x, 0.0 * x)
        at = R.T @ (z[3:6] - self._base.origin(x))
        on_base = skew(at) @ turned[3:] - turned[:3]
        response, (_, by_q, by_s) = self._responses(s), self._unloaded_point(t, q, s, R)
        along = -(by_s + (response.E_slope @ z[:3]).T / self._scale) @ self._base.paths.along
        return np.hstack([-response.E / self._scale, R.T, on_base, -by_q, along])
