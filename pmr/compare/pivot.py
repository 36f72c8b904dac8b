r"""What a boom presses on its machine with: three forces and three moments about the pivot, in the boom's own axes.

.. math::
    F = \sum_k \lambda_k n_k, \qquad \mathfrak M = \sum_k (p + r_k) \times \lambda_k n_k

over all that stands between the base and the ground: pads, supports, and cylinders that are supports, with their places
r_k from the base's tail, which is p from the pivot.  As supports they are positive along the axes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.built import reaction_of
from pmr.scene.choice import directions
from pmr.scene.members import members
from pmr.scene.pivot import AT_PIVOT, pressed_on_ground

Array = NDArray[np.float64]


def at_pivot(scene: Scene, response: Response) -> Response:
    """With what acts at the pivot, where the scene has a frame and all of its parts are known."""
    if scene.frame is None:
        return response
    total, known = np.zeros((len(response.t), 6)), dict(zip(response.force_names, response.slider_force.T, strict=True))
    known |= {} if response.others is None else dict(zip(response.other_names, response.others.T, strict=True))
    for one in pressed_on_ground(scene, {name: path.value(response.t) for name, path in scene.paths.items()}):
        name = next((name for name in one.names if name in known), None)
        if name is None:
            return response
        total += known[name][:, None] * one.wrench
    axes = directions(members(scene)[0])
    numbers = ["xyz".index(axis) if len(axis) == 1 else 3 + "xyz".index(axis[1]) for axis in axes]
    return replace(
        response,
        others=np.hstack([total[:, :0] if response.others is None else response.others, total[:, numbers]]),
        other_names=(*response.other_names, *(reaction_of(f"{AT_PIVOT} {axis}") for axis in axes)),
        other_units=(*response.other_units, *("N" if len(axis) == 1 else "N m" for axis in axes)),
        kinds=(*response.kinds, *("reaction" for _ in axes)),
        bodies=(*response.bodies, *(scene.names[0] for _ in axes)),
    )
