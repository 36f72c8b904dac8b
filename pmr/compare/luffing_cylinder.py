r"""The cylinder that raises a boom: its force along itself, its length and its power.

.. math::
    L(\varphi) = |R(\varphi)\, r_1 - r_0|, \qquad F = \mathfrak M / \tfrac{dL}{d\varphi}, \qquad P = F\, \dot L

with the moment M of all that the boom presses on its machine with about the pivot (`pmr.simulation.reactions`):
whatever holds the base in the scene, the pivot turns freely and the cylinder alone keeps the angle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.compare.summary import Part
from pmr.results import Response
from pmr.results.extremes import Extremes
from pmr.scene import Scene
from pmr.scene.mechanism import CYLINDER

Array = NDArray[np.float64]


def part(scene: Scene, response: Response) -> Part:
    """``luffing_cylinder``: ``force`` N, ``length`` m, ``speed`` m/s, ``power`` W: extremes, when and where."""
    if scene.frame is None or scene.frame.cylinder is None or CYLINDER not in response.other_names:
        return Part()
    t, along = response.t, scene.along(response.t)
    angle, force = scene.frame.angles[0], response.other(CYLINDER)
    length, arm = scene.frame.cylinder.length(angle.value(t))
    speed = arm * angle.rate(t)
    histories = {"force": force, "length": length, "speed": speed, "power": force * speed}
    return Part(
        {"luffing_cylinder": {key: Extremes.of(history, t, along).summary() for key, history in histories.items()}}
    )
