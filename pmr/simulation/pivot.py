r"""What a boom presses on its machine with: three forces and three moments about the pivot, in the boom's own axes.

.. math::
    F = \sum_k \lambda_k n_k, \qquad \mathfrak M = \sum_k (p + r_k) \times \lambda_k n_k

over all that stands between the base and the ground: pads, supports, and cylinders that are supports, with their places
r_k from the base's tail, which is p from the pivot.  As supports they are positive along the axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.built import reaction_of
from pmr.scene.choice import directions
from pmr.scene.members import members
from pmr.scene.pivot import AT_PIVOT, CYLINDER, MOMENT, pin_and_cylinder, pressed_on_ground

Array = NDArray[np.float64]


def at_pivot(scene: Scene, response: Response) -> Response:
    """Add force and moment at the pivot, where the scene has a frame and all of their parts are known."""
    if scene.frame is None:
        return response
    total, parts = np.zeros((len(response.t), 6)), dict(zip(response.force_names, response.slider_force.T, strict=True))
    parts |= {} if response.others is None else dict(zip(response.other_names, response.others.T, strict=True))
    for reaction in pressed_on_ground(scene, {name: path.value(response.t) for name, path in scene.paths.items()}):
        name = next((name for name in reaction.names if name in parts), None)
        if name is None:
            return response
        total += parts[name][:, None] * reaction.wrench
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


def with_luffing_cylinder(scene: Scene, response: Response) -> Response:
    """Add the luffing cylinder's force in N, positive where it presses, if hinges and moment are known."""
    if scene.frame is None or scene.frame.cylinder is None or MOMENT not in response.other_names:
        return response
    assert response.others is not None  # where there are names
    _, arm = scene.frame.cylinder.length(scene.frame.angles[0].value(response.t))
    force = response.other(MOMENT) / arm
    return replace(
        response,
        others=np.hstack([response.others, force[:, None]]),
        other_names=(*response.other_names, CYLINDER),
        other_units=(*response.other_units, "N"),
        kinds=(*response.kinds, "reaction"),
        bodies=(*response.bodies, scene.names[0]),
    )


def with_force_of_pin(scene: Scene, response: Response) -> Response:
    r"""Add forces of a pin at the pivot that bears what the luffing cylinder F along d does not.

    .. math:: F_{pin} = \sum_k \lambda_k n_k + F d

    over pin and support across the boom, which stands for the cylinder in the model: so the pin bears its thrust along
    the boom, and what a lug beside the axis takes across it.  Any other base stays as it is.
    """
    held = pin_and_cylinder(scene)
    if held is None or CYLINDER not in response.other_names or not set(held.pin) <= set(response.other_names):
        return response
    assert scene.frame is not None and scene.frame.cylinder is not None and response.others is not None
    force = response.other(CYLINDER)
    along, across = (force[:, None] * scene.frame.cylinder.direction(scene.frame.angles[0].value(response.t))).T
    other_outputs = response.others.copy()
    other_outputs[:, response.other_names.index(held.pin[0])] += along
    other_outputs[:, response.other_names.index(held.pin[1])] += across + _force(response, held.across)
    return replace(response, others=other_outputs)


def _force(response: Response, names: Sequence[str]) -> Array:
    """A force (T,) that a response has under one of some names."""
    name = next(label for label in names if label in response.force_names or label in response.other_names)
    if name in response.force_names:
        return response.slider_force[:, response.force_names.index(name)]
    return response.other(name)


def with_forces_on_machine(scene: Scene, response: Response) -> Response:
    """Add force and moment at the pivot, and forces of luffing cylinder and pin, where the scene has them."""
    return with_force_of_pin(scene, with_luffing_cylinder(scene, at_pivot(scene, response)))
