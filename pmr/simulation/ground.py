r"""Forces of outriggers or wheels on rigid ground, and the margin against tipping of the machine that they carry.

The force F and the moment :math:`\mathfrak M` about the pivot, along the axes of the machine, by which boom and machine
press on the ground, are those of the boom (`pmr.simulation.reactions`), of a hoist's rope on a winch on the machine,
and, of each mass m of the machine at r with the inertia I, whose part of the machine turns with the angular velocity
:math:`\omega`,

.. math::
    F_m = -m\, (g\, e_Z + \ddot u + A r), \qquad
    \mathfrak M_m = r \times F_m - I \dot\omega - \omega \times I \omega, \qquad
    A = \tilde{\dot\omega} + \tilde\omega \tilde\omega

with the acceleration u'' of the pivot and the vertical e_Z.  The kernel has the forces of outriggers and the margins
that follow from F and :math:`\mathfrak M` (src/ground.c).
"""

from __future__ import annotations

import numpy as np

from pmr.files.arrays import Array
from pmr.kernel.further import DIRECTIONS, ground_outputs
from pmr.kernel.laws import Stand, masses_wrench
from pmr.results import Response
from pmr.results.response import Output
from pmr.scene import Scene
from pmr.scene.built import reaction_name
from pmr.scene.frame import boom_rotation
from pmr.scene.hoist import WINCH_PULLS
from pmr.scene.mechanism import AT_PIVOT
from pmr.scene.signals import Constant
from pmr.simulation.frame import base_accelerations


def outputs_of_ground(scene: Scene) -> tuple[Output, ...]:
    """Return name, kind and unit of each of the `Stand.columns`, in order, of a scene with a ground."""
    units = ground_outputs(scene)
    legs = 0 if scene.frame is None or scene.frame.ground is None else len(scene.frame.ground.outriggers)
    kinds = ["reaction"] * len(DIRECTIONS) + ["outrigger"] * legs
    kinds += ["margin"] * (len(units) - len(kinds) - 1) + ["tipping"]
    return tuple(
        Output(name, kind, scene.names[0], unit=unit) for (name, unit), kind in zip(units.items(), kinds, strict=True)
    )


def machine_wrench(scene: Scene, t: Array) -> Array:
    """Force and moment about the pivot (T, 6), in N and N m, of weight and inertia of the machine's masses.

    They are at times t (T,), along the axes of the machine; `scene` has a frame with a ground.
    """
    frame = scene.frame
    assert frame is not None and frame.ground is not None  # the caller has checked it
    still = Constant(amount=0.0)
    signals = (frame.angles[1], *(frame.base_angles or (still,) * 3))
    angles = np.array(
        [[getattr(angle, of)(t) + 0.0 * t for angle in signals] for of in ("value", "rate", "second_rate")]
    )
    falling = np.zeros((len(t), 3))
    for axis, signal in enumerate(base_accelerations(scene)):
        falling[:, axis] = signal.value(t)
    if scene.gravity is not None:
        falling[:, 2] += scene.gravity.signal.value(t)
    return masses_wrench(frame.ground.masses, np.moveaxis(angles, -1, 0), falling)


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
    columns = {axis: reaction_name(f"{AT_PIVOT} {axis}") for axis in DIRECTIONS}
    planar = not {columns[axis] for axis in ("y", "rx", "rz")} & set(response.other_names)
    wrench = np.zeros((len(response.t), 6))
    for k, (axis, name) in enumerate(columns.items()):
        if name in response.other_names:
            wrench[:, k] = response.other(name)
        elif not (planar and axis in ("y", "rx", "rz")):
            return response
    turned = np.stack([wrench[:, :3], wrench[:, 3:]], axis=1) @ np.swapaxes(scene.frame.rotation(response.t), 1, 2)
    total = turned.reshape(-1, 6) + machine_wrench(scene, response.t) + _winch_wrench(scene, response)
    return response.with_others(Stand.of_ground(scene.frame.ground).columns(total), outputs_of_ground(scene))
