"""A boom that stands still in its frame: at given extensions and angles, how its axial forces stress it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.scene import Scene
from pmr.scene.frame import BaseMotion
from pmr.scene.frame_terms import frame_terms
from pmr.scene.names import SLIDER
from pmr.scene.signals import Constant, SignalBase
from pmr.simulation.frame import term_signals

Array = NDArray[np.float64]
#: Angles among which the steepest is looked for.
ANGLES = 1001


class Listed(SignalBase):
    """Values by their numbers, 0, 1, 2 ..., in place of times: at rest at each of them."""

    values: tuple[float, ...]
    acceleration: float = 0.0  # as it would be if it were turned there

    def value(self, t: ArrayLike) -> Array:
        last = len(self.values) - 1
        return np.array(self.values)[np.clip(np.asarray(t, float).astype(int), 0, last)]

    def rate(self, t: ArrayLike) -> Array:
        return np.zeros(np.shape(t))

    def second_rate(self, t: ArrayLike) -> Array:
        return np.full(np.shape(t), self.acceleration)


def steepest(scene: Scene) -> float:
    """The angle in rad by which the boom is raised on its way at which its weight presses most along it."""
    assert scene.frame is not None  # of a scene that has angles
    angles = np.linspace(*scene.frame.angles[0].bounds(0.0, scene.time.end), ANGLES)
    return float(angles[np.argmax(np.sin(angles))])


def rest_scene(
    scene: Scene,
    extensions: Mapping[str, Array],
    luffing: Array | float,
    slewing: Array | float,
    loads: Mapping[str, float],
) -> Scene:
    """The scene as it stands at places that are numbered in place of times, each with its extensions (P,) m of joints.

    Angles in rad are one each, or one for each place; loads, by their names, are constant, and its weight is all there.
    The base is inclined as far as its motions are constant.
    """
    assert scene.frame is not None  # of a scene that has angles
    changed = []
    for part in scene.sections:
        steady = tuple(load.model_copy(update={"signal": Constant(amount=loads[load.name])}) for load in part.loads)
        joint = part.joint
        if joint is not None and part.name in extensions:
            stays = _signal_of(extensions[part.name])
            joint = joint.model_copy(update={"extension": stays, "overlap": None, "follows": None})
        slider = part.slider
        if slider is not None and SLIDER in extensions:
            slider = slider.model_copy(update={"path": _signal_of(extensions[SLIDER])})
        changed.append(part.model_copy(update={"loads": steady, "joint": joint, "slider": slider}))
    still = {"luffing": _signal_of(luffing), "unit": "rad"}
    still |= {"base": level_or_inclined(scene.frame.base, np.pi / 180.0 if scene.frame.unit == "degrees" else 1.0)}
    still |= {"slewing": _signal_of(slewing)} if scene.frame.slewing is not None else {}
    frame = scene.frame.model_copy(update=still)
    gravity = scene.gravity.model_copy(update={"rise": 0.0}) if scene.gravity else None
    return scene.model_copy(update={"sections": tuple(changed), "frame": frame, "gravity": gravity})


def level_or_inclined(base: BaseMotion | None, unit: float = 1.0) -> BaseMotion | None:
    """A base with those of its angles that are constant, times `unit`; None where it is level."""
    angles = {} if base is None else {key: base.motions.get(key) for key in ("rx", "ry", "rz")}
    constant = {
        key: Constant(amount=unit * angle.amount) for key, angle in angles.items() if isinstance(angle, Constant)
    }
    return BaseMotion(**constant) if constant else None


def accelerate_angle(still: Scene, angle: str) -> Scene:
    """Scene of `rest_scene` at a moment of rest, turned by a unit of the acceleration of an angle."""
    assert still.frame is not None
    turned = {angle: getattr(still.frame, angle).model_copy(update={"acceleration": 1.0})}
    return still.model_copy(update={"frame": still.frame.model_copy(update=turned)})


def amplitudes_at_rest(scene: Scene, extensions: Mapping[str, Array], luffing: float) -> Array:
    """Amplitudes c (P, k) of the scene's terms, raised by an angle in rad, with extensions (P,) m of each joint.

    The weight is all there, and loads along the boom press as they do most.
    """
    if not list(frame_terms(scene)):
        return np.empty((len(next(iter(extensions.values()))), 0))
    end = scene.time.end
    pressing = {
        load.name: load.signal.bounds(0.0, end)[0 if load.direction == "x" else 1]
        for part in scene.sections
        for load in part.loads
    }
    still = rest_scene(scene, extensions, luffing, 0.0, pressing)
    numbers = np.arange(max(len(values) for values in extensions.values()), dtype=float)
    return np.column_stack([signal.value(numbers) for signal in term_signals(still, frame_terms(scene)).values()])


def _signal_of(values: Array | float) -> SignalBase:
    return Constant(amount=float(values)) if np.ndim(values) == 0 else Listed(values=tuple(np.asarray(values).tolist()))
