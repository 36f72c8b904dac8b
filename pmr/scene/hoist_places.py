"""Places of a hoist's head and winch on a scene's boom, and checks of a hoist, which raise InputError."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pmr.files.arrays import Array
from pmr.scene.choice import is_planar, model_of
from pmr.scene.members import members
from pmr.scene.scene import Scene
from pmr.scene.structure_checks import scene_error

#: Number of times at which the length of the rope is checked.
SAMPLES = 1001


def still_rotation(scene: Scene) -> Array:
    """Rotation (3, 3) from axes of a boom without a frame into those of the ground, whose Z is against the weight."""
    assert scene.gravity is not None  # as the checks say
    up, ahead = -np.array(scene.gravity.direction), np.eye(3)[0]
    ahead = ahead - (ahead @ up) * up
    ahead = ahead / np.linalg.norm(ahead) if np.linalg.norm(ahead) > 1e-9 else np.eye(3)[2]
    return np.array([ahead, np.cross(up, ahead), up])


class PlaceOnBoom(NamedTuple):
    """Place in m of head or winch where no section is extended, and the number of the section around it.

    It is along axes of the boom, from the pivot of its frame or from the base's tail without one; on the machine along
    axes that do not luff.
    """

    at: tuple[float, float, float]
    number: int


def rope_places(scene: Scene) -> tuple[PlaceOnBoom, PlaceOnBoom]:
    """Places of the head and of the winch of a scene's hoist."""
    assert scene.hoist is not None
    tail = np.zeros(3) if scene.frame is None else np.array(scene.frame.tail_position)
    places = {name: (m.number, place) for m in members(scene) for name, place in m.rope_places.items()}
    on_boom = {name: PlaceOnBoom((*(tail + place.at).tolist(),), number) for name, (number, place) in places.items()}
    return on_boom["head"], on_boom.get("winch", PlaceOnBoom(scene.hoist.winch.at, 0))


def distance_along(scene: Scene, t: float) -> float:
    """Distance in m from the winch to the head of a scene's undeformed boom at the time t in s."""
    assert scene.hoist is not None
    head, winch = (np.array(place.at) for place in rope_places(scene))
    numbers = [place.number for place in rope_places(scene)]
    for at, number in zip((head, winch), numbers, strict=True):
        at[0] += sum(float(scene.extension(k).value(t)) for k in range(1, number + 1))
    if not scene.hoist.winch.section:
        up = still_rotation(scene)[2] if scene.frame is None else scene.frame.rotation_to_ground(t)[2]
        winch = np.array([winch[0] * up[2] + winch[2] * up[0], winch[1], winch[2] * up[2] - winch[0] * up[0]])
    return float(np.linalg.norm(head - winch))


def check_hoist(scene: Scene) -> None:
    """Refuse a hoist that the scene's boom does not fit, or whose rope gets too short; a scene without one passes."""
    hoist, frame = scene.hoist, scene.frame
    if hoist is None:
        return
    if scene.gravity is None:
        raise scene_error("gravity", None, "a table [gravity] is needed with [hoist], whose payload has a weight")
    if frame is not None and frame.ground is not None and hoist.pivot_height not in (0.0, frame.ground.height):
        allowed = f"frame.ground.height, {frame.ground.height:g}, is the pivot's height, and none beside it is allowed"
        raise scene_error("hoist.pivot_height", hoist.pivot_height, allowed)
    for key, name in (("section", hoist.section), ("winch.section", hoist.winch.section)):
        if name and name not in scene.names:
            raise scene_error(f"hoist.{key}", name, f"{', '.join(scene.names)} are allowed")
    if frame is not None and frame.base_angles and not hoist.winch.section:
        raise scene_error("hoist.winch.section", None, "a section is allowed where the base rolls, pitches or yaws")
    is_lifted = frame is not None and frame.base is not None and "z" in frame.base.motions
    if hoist.pivot_height and is_lifted:
        allowed = "0 is allowed where frame.base.z moves the pivot: the height of the hook is measured from it"
        raise scene_error("hoist.pivot_height", hoist.pivot_height, allowed)
    for member in members(scene):
        if hoist.lateral_key and is_planar(member):
            key = scene.section_key(member.number, "body.model")
            allowed = (
                f"a model in space is allowed beside hoist.{hoist.lateral_key}, which is not in the vertical plane"
            )
            raise scene_error(key, model_of(member), allowed)
        if model_of(member) == "matrices":
            key = scene.section_key(member.number, "body.model")
            raise scene_error(key, "matrices", "models with a mesh are allowed with [hoist]")
        for place, (on, (x, _, _)) in member.rope_places.items():
            key = "hoist.on" if place == "head" else "hoist.winch.at"
            if not 0.0 <= x <= member.part.length:
                raise scene_error(key, x, f"0 to {member.part.length:g} m is allowed")
            if frame is not None and frame.second_order and on != "tip" and x != member.part.length:
                allowed = "a section's tip is allowed with frame.second_order, which takes forces along the boom there"
                raise scene_error(key, on, allowed)
    t = np.linspace(0.0, scene.time.end, SAMPLES)
    if frame is not None and frame.luffing == "free" and not hoist.winch.section:
        t = t[:1]  # later the angle, and with it the distance from winch to head, is computed
    along = np.array([distance_along(scene, float(at)) for at in t])
    hanging = (hoist.free_length(t, along[0]) - along) / hoist.falls
    if not hanging.min() > 0.0:
        k = int(np.argmax(hanging <= 0.0))
        allowed = f"a longer rope is allowed: without force its hook is at the head at {t[k]:.4g} s"
        raise scene_error(f"hoist.{'speed' if hoist.is_wound else 'length'}", None, allowed)
