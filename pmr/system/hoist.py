r"""Hoist of a system: which inputs its rope pulls, and what it is driven by (pmr/kernel/src/hoist.c has the equations).

Drivers of a hoist are the length of its rope or the speed of its winch, and the wind on its payload.  In a frame that
moves they are followed by gravity, accelerations of the pivot if it has any, and the entries of the rotation R from
axes of the boom into those of the ground.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pmr.files.arrays import Array
from pmr.scene.built import WEIGHT
from pmr.scene.choice import rope_pulls
from pmr.scene.files import stored_scene
from pmr.scene.frame_checks import distance_along, rope_places, still_rotation
from pmr.scene.hoist import HOIST, OUTPUTS, ROPE, WIND
from pmr.scene.keys import RECORDED, input_name
from pmr.scene.members import members
from pmr.scene.scene import Scene


class Slot(NamedTuple):
    """A number that the kernel asks for: a constant, plus a factor times the driver or input called `name`.

    With an empty `name` it is the constant alone.
    """

    constant: float = 0.0
    factor: float = 0.0
    name: str = ""


@dataclass(frozen=True)
class Hoist:
    """A hoist whose rope pulls k inputs of a system's bodies, in the kernel's terms.

    Without arguments there is no hoist; as a truth value the object is then false.
    """

    inputs: tuple[str, ...] = ()  # (k,): names of the system's inputs
    # (k, 6): how far a unit of what each input works along moves the head and the winch, along the boom
    levers: Array = field(default_factory=lambda: np.zeros((0, 6)))
    numbers: Array = field(default_factory=lambda: np.zeros(0))  # (19,), as `HOIST_MASS` and what follows it in hoist.c
    reach: tuple[tuple[str, ...], ...] = ()  # paths along which the head moves, and those along which the winch does
    drivers: tuple[str, ...] = ()
    is_wound: bool = False  # whether the speed of the winch drives the rope, and not the rope's length
    slots: tuple[Slot, ...] = ()  # (17,), as `SLOT_LENGTH` and what follows it in hoist.c

    def __bool__(self) -> bool:
        return bool(self.drivers)

    @property
    def outputs(self) -> Mapping[str, str]:
        """Units of the hoist's outputs by their names."""
        return OUTPUTS if self else {}

    def in_frame(self, scene: Scene) -> Hoist:
        """Return the hoist driven by the frame of another `scene` of the same boom."""
        of_frame = frame_quantities(scene)
        slots = (*self.slots[: 1 + len(WIND)], *_ground_slots(scene, tuple(of_frame)))
        return replace(self, drivers=(ROPE, *WIND, *of_frame), slots=slots)


def frame_quantities(scene: Scene) -> dict[str, tuple[str | int, ...]]:
    """Quantities of a moving frame that drive a scene's hoist, by their names as drivers; empty without a frame."""
    if scene.frame is None or scene.hoist is None:
        return {}
    quantities: dict[str, tuple[str | int, ...]] = {f"{HOIST}gravity": ("gravity",)}
    base = scene.frame.base
    if base is not None and {"x", "y", "z"} & {*base.motions, *base.accelerations}:
        quantities |= {f"{HOIST}shaken {axis}": ("shaken", k) for k, axis in enumerate("xyz")}
    return quantities | {f"{HOIST}turned {3 * i + j}": ("turned", i, j) for i in range(3) for j in range(3)}


def hoist_of(scene: Scene) -> Hoist:
    """Hoist of a scene's system; an empty one if the scene has none."""
    hoist = scene.hoist
    if hoist is None:
        return Hoist()
    pulls = [
        (input_name(scene.names[m.number], pull.load.name), pull) for m in members(scene) for pull in rope_pulls(m)
    ]
    levers = np.zeros((len(pulls), 6))
    for row, (_, pull) in zip(levers, pulls, strict=True):
        row[slice(0, 3) if pull.place == "head" else slice(3, 6)] = pull.lever
    head, winch = rope_places(scene)
    on_machine = not hoist.winch.section
    first = 0.0 if hoist.length is not None else float(hoist.free_length(np.zeros(1), distance_along(scene, 0.0))[0])
    of_rope = [hoist.mass, hoist.EA, hoist.damping, hoist.falls, *head.at, *winch.at, on_machine, hoist.is_wound, first]
    reach = tuple(scene.names[1 : place.number + 1] for place in (head, winch))
    of_frame = frame_quantities(scene)
    return Hoist(
        tuple(name for name, _ in pulls),
        levers,
        np.array([*of_rope, *hoist.swing, *hoist.velocity, scene.pivot_height], float),
        reach,
        (ROPE, *WIND, *of_frame),
        hoist.is_wound,
        (Slot(0.0, 1.0, ROPE), *(Slot(0.0, 1.0, wind) for wind in WIND), *_ground_slots(scene, tuple(of_frame))),
    )


def recorded_hoist(provenance: Mapping[str, object]) -> Hoist:
    """Hoist of the scene in a system's provenance; an empty one if there is none."""
    scene = provenance.get("scene")
    if not (isinstance(scene, Mapping) and scene.get("hoist")):
        return Hoist()
    return hoist_of(stored_scene(scene, "provenance.scene", RECORDED))


def _ground_slots(scene: Scene, of_frame: tuple[str, ...]) -> list[Slot]:
    """Slots of gravity, then of accelerations of the pivot, then of the entries of the rotation R.

    `of_frame` are the names of the frame's inputs to the hoist; empty if nothing moves the frame.
    """
    shaken = [f"{HOIST}shaken {axis}" for axis in "xyz"]
    if of_frame:
        turned = [Slot(0.0, 1.0, name) for name in of_frame[-9:]]
        return [Slot(0.0, 1.0, of_frame[0]), *(Slot(0.0, 1.0, s) if s in of_frame else Slot() for s in shaken), *turned]
    gravity = Slot(0.0, 1.0, input_name(scene.names[0], WEIGHT))
    return [gravity, *[Slot()] * 3, *(Slot(entry) for entry in still_rotation(scene).ravel().tolist())]
