r"""Forces of outriggers or wheels on rigid ground, and the margin against tipping of the machine that they carry.

The force F and the moment :math:`\mathfrak M` about the pivot, along the axes of the machine, by which boom and machine
press on the ground, are those of the boom (`pmr.simulation.reactions`), of a hoist's rope on a winch on the machine,
and, of each mass m of the machine at r with the inertia I, whose part of the machine turns with the angular velocity
:math:`\omega`,

.. math::
    F_m = -m\, (g\, e_Z + \ddot u + A r), \qquad
    \mathfrak M_m = r \times F_m - I \dot\omega - \omega \times I \omega, \qquad
    A = \tilde{\dot\omega} + \tilde\omega \tilde\omega

with the acceleration u'' of the pivot and the vertical e_Z.  With the moment :math:`\mathfrak M'` about the point of
the ground below the pivot, the forces N of n outriggers at (x, y) with the stiffness k are those with

.. math::
    N_i = k_i\, w_i \ge 0 \ \text{or}\ w_i \le 0,\ N_i = 0, \qquad
    \sum N_i = -F_z, \quad \sum y_i N_i = -\mathfrak M'_x, \quad \sum x_i N_i = \mathfrak M'_y

where :math:`w = G u` are the displacements of the outriggers into the ground by a rigid motion u of the machine.  With
:math:`Q = k^{1/2} G (G^T k G)^{-1/2}` and the pulls :math:`k^{1/2} z` that lifted outriggers would have, this is the
complementarity problem :math:`(1 - Q Q^T) z = b + v` with z, v at least 0 and :math:`z v = 0`, :math:`k^{1/2} v` the
forces and :math:`-k^{1/2} b` those of outriggers that also pull.  The kernel's contact law solves it.

The margin against tipping over an edge of the support polygon is minus the moment of F and :math:`\mathfrak M` about
the edge.  The use of the polygon is the largest of 1 less the margin over the margin of the same vertical force in the
polygon's centre: 0 where the resultant is in the centre, 1 where it is on an edge.  Beyond an edge the machine tips,
and no forces hold it.  Those that are returned then hold the vertical force at the nearest point of the polygon.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pmr.files.arrays import Array, Indices
from pmr.kernel.laws import solve_contact
from pmr.results import Response
from pmr.results.response import Output
from pmr.scene import Scene
from pmr.scene.built import force_name, reaction_name
from pmr.scene.frame import boom_rotation
from pmr.scene.ground import Ground, edge_rows
from pmr.scene.hoist import WINCH_PULLS
from pmr.scene.keys import Direction
from pmr.scene.mechanism import AT_GROUND, AT_PIVOT, TIPPING_MARGIN
from pmr.scene.signals import Constant
from pmr.simulation.frame import base_accelerations
from pmr.simulation.frame_motion import FrameRotation

AXES: tuple[Direction, ...] = ("x", "y", "z", "rx", "ry", "rz")
#: Added to the diagonal of the complementarity problem, which decides which outriggers lift off, but not their forces.
REGULAR = 1e-10
#: Share of the way to the centre of the polygon by which a resultant beyond an edge is held inside of the edge.
INSIDE = 1e-9
#: A vertical force below this share of the largest one does not say where the resultant is.
NO_LOAD = 1e-9


@dataclass(frozen=True)
class Stand:
    """Outriggers on which a machine stands: n places, of which e are the corners of the support polygon."""

    names: tuple[str, ...]  # (n,)
    places: Array  # (n, 2) m: X, Y from the pivot, along the axes of the machine
    stiffness: Array  # (n,) N/m
    corners: Indices  # (e,): numbers of the outriggers at the corners, anticlockwise
    height: float  # m: of the pivot above the ground

    @classmethod
    def of_ground(cls, ground: Ground) -> Stand:
        """Return the outriggers of a scene's ground."""
        names = tuple(outrigger.name for outrigger in ground.outriggers)
        return cls(
            names,
            np.array([outrigger.at for outrigger in ground.outriggers]),
            np.array([outrigger.stiffness for outrigger in ground.outriggers]),
            np.array([names.index(corner.name) for corner in ground.corners]),
            ground.height,
        )

    @property
    def polygon(self) -> Array:
        """Corners (e, 2) of the support polygon in m, anticlockwise."""
        return np.asarray(self.places[self.corners])

    def outputs(self, body: str) -> tuple[Output, ...]:
        """Return name, kind and unit of each of the `columns`, in order; `body` is the name of the base section."""
        at_corners = [self.names[k] for k in self.corners]
        units = dict.fromkeys(AXES[:3], "N") | dict.fromkeys(AXES[3:], "N m")
        return (
            *(Output(reaction_name(f"{AT_GROUND} {d}"), "reaction", body, unit=unit) for d, unit in units.items()),
            *(Output(force_name(f"outrigger {name}"), "outrigger", body, unit="N") for name in self.names),
            *(
                Output(f"{TIPPING_MARGIN}{first} to {second}", "margin", body, unit="N m")
                for first, second in zip(at_corners, (*at_corners[1:], at_corners[0]), strict=True)
            ),
            Output("use of the support polygon", "tipping", body, unit="1"),
        )

    def columns(self, wrench: Array) -> Array:
        """Return force and moment on the ground, forces of outriggers, margins over edges and use of the polygon.

        They are side by side, (T, 6 + n + e + 1), under the force and the moment about the pivot `wrench` (T, 6), along
        the axes of the machine, by which boom and machine press on the ground.
        """
        rows, corners, center = edge_rows(self.polygon, self.height), self.polygon, self.polygon.mean(axis=0)
        pressing = np.maximum(-wrench[:, 2], 0.0)
        pressed = np.maximum(pressing, NO_LOAD * np.abs(wrench[:, 2]).max(initial=1e-200))
        margins, in_center = -wrench @ rows.T, rows @ [0.0, 0.0, 1.0, center[1], -center[0], 0.0]
        use = 1.0 - (margins / (pressed[:, None] * in_center)).min(axis=1)
        use[np.abs(wrench[:, 2]) < pressed] = 0.0  # nothing presses yet
        along_x = wrench[:, 4] + self.height * wrench[:, 0]
        along_y = self.height * wrench[:, 1] - wrench[:, 3]
        place = np.stack([along_x, along_y], axis=1) / pressed[:, None]
        outside = np.flatnonzero(margins.min(axis=1) < 0.0)
        place[outside] = np.array([_nearest_inside(corners, point) for point in place[outside]]).reshape(-1, 2)
        forces = self.forces(pressing[:, None] * np.insert(place, 0, 1.0, axis=1))
        return np.hstack([wrench, forces, margins, use[:, None]])

    def forces(self, loads: Array) -> Array:
        """Return the forces (T, n) in N whose sums, and sums with x and y, are `loads` (T, 3) in N and N m.

        The loads act within the support polygon.
        """
        G, k = np.insert(self.places, 0, 1.0, axis=1), self.stiffness / self.stiffness.max()
        forces, root = loads @ _shares(G, k), np.sqrt(k)
        Q, _ = np.linalg.qr(root[:, None] * G)
        A, pushes, none = np.eye(len(k)) * (1.0 + REGULAR) - Q @ Q.T, np.ones(len(k), bool), np.zeros(len(k), bool)
        for t in np.flatnonzero(forces.min(axis=1) < 0.0):
            stands = ~solve_contact(A, -forces[t] / root, pushes, none).closed
            forces[t] = 0.0
            forces[t, stands] = loads[t] @ _shares(G[stands], k[stands])
        return forces


def _nearest_inside(corners: Array, point: Array) -> Array:
    """Point (2,) of a convex polygon with `corners` (e, 2) that is nearest to a `point` beyond it, just inside."""
    edges = np.roll(corners, -1, axis=0) - corners
    along = np.clip(np.sum((point - corners) * edges, axis=1) / np.sum(edges**2, axis=1), 0.0, 1.0)
    nearest = corners + along[:, None] * edges
    best = nearest[int(np.argmin(np.linalg.norm(nearest - point, axis=1)))]
    return np.asarray(best + INSIDE * (corners.mean(axis=0) - best))


def _shares(G: Array, k: Array) -> Array:
    """Matrix (3, n) by which loads (3,) go into n outriggers at G (n, 3) with the stiffness k (n,) that also pull."""
    root = np.sqrt(k)
    return np.asarray(np.linalg.pinv(root[:, None] * G) * root)


def machine_wrench(scene: Scene, t: Array) -> Array:
    """Force and moment about the pivot (T, 6), in N and N m, of weight and inertia of the machine's masses.

    They are at times t (T,), along the axes of the machine; `scene` has a frame with a ground.
    """
    frame = scene.frame
    assert frame is not None and frame.ground is not None  # the caller has checked it
    still, total = Constant(amount=0.0), np.zeros((len(t), 6))
    standing = FrameRotation.from_signals(still, still, t, frame.base_angles)
    slewing = FrameRotation.from_signals(still, frame.angles[1], t, frame.base_angles)
    shaken = np.array([signal.value(t) for signal in base_accelerations(scene)]).T if base_accelerations(scene) else 0.0
    weight = np.zeros(len(t)) if scene.gravity is None else scene.gravity.signal.value(t)
    falling = np.eye(3)[2] * weight[:, None] + shaken  # along the axes of the ground
    to_machine = np.swapaxes(standing.rotation, 1, 2) @ slewing.rotation
    for mass in frame.ground.masses:
        turning, inertia, place = slewing if mass.slews else standing, np.array(mass.inertia), np.array(mass.at)
        field = np.einsum("tji,tj->ti", turning.rotation, falling) + turning.gradient @ place
        force = -mass.mass * field
        moment = np.cross(place, force) - inertia * turning.acceleration
        moment -= np.cross(turning.velocity, inertia * turning.velocity)
        wrench = np.stack([force, moment], axis=1)
        total += (wrench @ np.swapaxes(to_machine, 1, 2) if mass.slews else wrench).reshape(-1, 6)
    return total


def _winch_wrench(scene: Scene, response: Response) -> Array:
    """Force and moment about the pivot (T, 6) by which the hoist's rope pulls a winch on the machine; else zeros."""
    hoist, frame = scene.hoist, scene.frame
    if hoist is None or hoist.winch.section or frame is None:
        return np.zeros((len(response.t), 6))
    pull = np.stack([response.other(name) for name in WINCH_PULLS], axis=1)
    still = np.zeros(len(response.t))
    place = boom_rotation(still, np.atleast_1d(frame.angles[1].value(response.t)) + still) @ np.array(hoist.winch.at)
    return np.hstack([pull, np.cross(place, pull)])


def with_ground_forces(scene: Scene, response: Response) -> Response:
    """Return the response with forces on the ground, of outriggers, and margins against tipping.

    It is unchanged without a ground, or if force and moment at the pivot are not known.
    """
    if scene.frame is None or scene.frame.ground is None:
        return response
    columns = {axis: reaction_name(f"{AT_PIVOT} {axis}") for axis in AXES}
    planar = not {columns[axis] for axis in ("y", "rx", "rz")} & set(response.other_names)
    wrench = np.zeros((len(response.t), 6))
    for k, (axis, name) in enumerate(columns.items()):
        if name in response.other_names:
            wrench[:, k] = response.other(name)
        elif not (planar and axis in ("y", "rx", "rz")):
            return response
    turned = np.stack([wrench[:, :3], wrench[:, 3:]], axis=1) @ np.swapaxes(scene.frame.rotation(response.t), 1, 2)
    total = turned.reshape(-1, 6) + machine_wrench(scene, response.t) + _winch_wrench(scene, response)
    stand = Stand.of_ground(scene.frame.ground)
    return response.with_others(stand.columns(total), stand.outputs(scene.names[0]))
