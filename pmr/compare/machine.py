"""Where a machine is that moves by itself, how fast, and what it presses on the ground with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.built import reaction_of
from pmr.simulation.frame_motion import Found, Samples

MACHINE = "machine"


def with_machine(scene: Scene, response: Response) -> Response:
    """Append places (m, rad), rates and forces (N, N m) of the machine, where the scene has its motion.

    Forces are those of springs, dampers and of what holds it, positive along the axes, by the directions of
    ``[frame.base]``; free directions without a spring have none.
    """
    motions = {} if scene.frame is None or scene.frame.base is None else scene.frame.base.motions
    free_motions: dict[str, Samples] = {
        key: motion.samples for key, motion in motions.items() if isinstance(motion, Found)
    }
    if not free_motions:
        return response
    places, rates = (np.stack([motion.values[order] for motion in free_motions.values()], axis=1) for order in (0, 1))
    pressing = {key: motion.force for key, motion in free_motions.items() if motion.force.any()}
    forces = np.stack(list(pressing.values()), axis=1) if pressing else places[:, :0]
    names = [f"{MACHINE} {key}" for key in free_motions]
    units = ["rad" if key.startswith("r") else "m" for key in free_motions]
    held = [reaction_of(f"{MACHINE} {key}") for key in pressing]
    turned = ["N m" if key.startswith("r") else "N" for key in pressing]
    count = 2 * len(names) + len(held)
    before = places[:, :0] if response.others is None else response.others
    return replace(
        response,
        others=np.hstack([before, places, rates, forces]),
        other_names=(*response.other_names, *names, *(f"rate of {motion}" for motion in names), *held),
        other_units=(*response.other_units, *units, *(f"{motion}/s" for motion in units), *turned),
        kinds=(*response.kinds, *[MACHINE] * (2 * len(names)), *["reaction"] * len(held)),
        bodies=(*response.bodies, *[scene.names[0]] * count),
    )
