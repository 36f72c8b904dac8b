"""A boom that stands still in its frame: how its axial forces stress it at given extensions and one angle."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.scene import Scene
from pmr.scene.frame_terms import frame_terms
from pmr.scene.signals import Constant, SignalBase
from pmr.simulation.frame import term_signals

Array = NDArray[np.float64]
#: Angles among which the steepest is looked for.
ANGLES = 1001


class Listed(SignalBase):
    """Values by their numbers, 0, 1, 2 ..., in place of times: at rest at each of them."""

    values: tuple[float, ...]

    def value(self, t: ArrayLike) -> Array:
        last = len(self.values) - 1
        return np.array(self.values)[np.clip(np.asarray(t, float).astype(int), 0, last)]

    def rate(self, t: ArrayLike) -> Array:
        return np.zeros(np.shape(t))

    def second_rate(self, t: ArrayLike) -> Array:
        return np.zeros(np.shape(t))


def steepest(scene: Scene) -> float:
    """The angle in rad by which the boom is raised on its way at which its weight presses most along it."""
    assert scene.frame is not None  # of a scene that has angles
    angles = np.linspace(*scene.frame.angles[0].bounds(0.0, scene.time.end), ANGLES)
    return float(angles[np.argmax(np.sin(angles))])


def amplitudes_at_rest(scene: Scene, extensions: Mapping[str, Array], luffing: float) -> Array:
    """Amplitudes c (P, k) of the scene's terms, raised by an angle in rad, with extensions (P,) m of each joint.

    The weight is all there, and loads along the boom press as they do most.
    """
    if not list(frame_terms(scene)):
        return np.empty((len(next(iter(extensions.values()))), 0))
    assert scene.frame is not None  # of a scene that has terms
    changed, end = [], scene.time.end
    for part in scene.sections:
        pressing = [load.signal.bounds(0.0, end)[0 if load.direction == "x" else 1] for load in part.loads]
        loads = tuple(
            load.model_copy(update={"signal": Constant(amount=most)})
            for load, most in zip(part.loads, pressing, strict=True)
        )
        joint = part.joint
        if joint is not None and part.name in extensions:
            stays = Listed(values=tuple(extensions[part.name].tolist()))
            joint = joint.model_copy(update={"extension": stays, "overlap": None, "follows": None})
        changed.append(part.model_copy(update={"loads": loads, "joint": joint}))
    still = {"luffing": Constant(amount=luffing), "unit": "rad", "base": None}
    still |= {"slewing": Constant(amount=0.0)} if scene.frame.slewing is not None else {}
    frame = scene.frame.model_copy(update=still)
    gravity = scene.gravity.model_copy(update={"rise": 0.0}) if scene.gravity else None
    resting = scene.model_copy(update={"sections": tuple(changed), "frame": frame, "gravity": gravity})
    numbers = np.arange(max(len(one) for one in extensions.values()), dtype=float)
    return np.column_stack([one.value(numbers) for one in term_signals(resting, frame_terms(scene)).values()])
