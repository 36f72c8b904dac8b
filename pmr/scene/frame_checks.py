"""Checks of a moving frame and a hoist, and of what excludes them or a part of them, which raise InputError.

`EXCLUSIONS` lists parts of a scene that do not go together.  The other checks refuse angles that jump, and
whatever the motion of the frame or its terms of second order do not cover.  Places of head and winch of a hoist on the
boom stand here too.  Checks of the luffing cylinder are in `pmr.scene.drive_checks`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pmr.files.arrays import Array
from pmr.scene.built import Gravity
from pmr.scene.choice import has_axial_motion, input_directions, is_planar, model_of, traits_of
from pmr.scene.drive_checks import FREE, check_luffing
from pmr.scene.frame import Frame, Machine
from pmr.scene.joints import JointPads
from pmr.scene.members import member_at, members
from pmr.scene.scene import Scene
from pmr.scene.signals import SignalBase, Table
from pmr.scene.signals.base import ROUND_OFF
from pmr.scene.structure_checks import refuse, scene_error


class Exclusion(NamedTuple):
    """A part of a scene, by its key, that is refused together with another part, and the reason."""

    key: str
    excluded_by: str
    why: str


#: A frequency response, and an extension that is computed, as parts of a scene.
RESPONSE, FREE_EXTENSION = "observe.frequency_response", "joint.extension.kind = 'free'"
#: Parts of a scene that exclude each other.
EXCLUSIONS = (
    Exclusion(RESPONSE, "hoist", "a payload that swings has a part in it"),
    Exclusion("hoist", "frame.machine", "the rope's pull on it is not known"),
    Exclusion("frame.machine", FREE, "the cylinder stands on what does not move by itself"),
    Exclusion("frame.ground", "frame.machine", "its masses belong to frame.ground, which does not move"),
    Exclusion("frame.ground.slope", FREE, "its motion is computed on level ground"),
    Exclusion("frame.cylinder.stiffness", FREE, "oil or spring gives way, a support of the base is at the lug"),
    *(Exclusion(f"frame.base.{key}", FREE, "its motion is that on a level base") for key in ("rx", "ry", "rz")),
    *(Exclusion(f"frame.base.{key}", "frame.ground.slope", "which inclines the machine") for key in ("rx", "ry")),
    *(
        Exclusion("frame.base.acceleration", part, "it does not say where the ground is: x, y and z do")
        for part in ("frame.machine", FREE)
    ),
    Exclusion("hoist", FREE_EXTENSION, "a rope's path is known for a prescribed extension alone"),
    *(Exclusion(part, FREE_EXTENSION, "one motion is computed at a time") for part in ("frame.machine", FREE)),
    *(
        Exclusion(key, part, why)
        for part in ("frame.machine", FREE, FREE_EXTENSION)
        for key, why in (
            ("accuracy", "whose motion depends on model and step"),
            (RESPONSE, "what is computed there has a part in it"),
            ("budget", "whose motion depends on model and step"),
        )
    ),
)


def check_exclusions(scene: Scene) -> None:
    """Refuse the first of `EXCLUSIONS` both of whose parts the scene has."""
    frame = scene.frame or Frame.model_construct()
    ground, base = frame.ground, frame.base
    parts = {
        RESPONSE: any(part.observe.frequency_response for part in scene.sections),
        "hoist": scene.hoist,
        "accuracy": scene.accuracy,
        "budget": scene.budget,
        "frame.machine": frame.machine,
        FREE: frame.luffing == "free",
        FREE_EXTENSION: scene.free_extensions,
        "frame.ground": ground,
        "frame.ground.slope": ground is not None and any(ground.slope),
        "frame.cylinder.stiffness": frame.cylinder and frame.cylinder.stiffness,
        "frame.base.acceleration": base and base.accelerations,
    } | {f"frame.base.{key}": True for key in (base.motions if base else {})}
    for key, other, why in EXCLUSIONS:
        if parts.get(key) and parts.get(other):
            key = scene.section_key(len(scene.sections) - 1, key) if key == RESPONSE else key
            key, value = ("frame.luffing", "free") if key == FREE else (key, None)
            raise scene_error(key, value, f"none is allowed beside {other}: {why}")


def check_machine(scene: Scene, frame: Frame, machine: Machine) -> None:
    """Refuse a machine that is free in a direction in which its base moves, without a spring between both.

    Where the scene starts in equilibrium, the start of a direction with a spring follows from the equilibrium, so that
    a given start is refused.
    """
    for direction, value in machine.start.nonzero.items() if scene.start == "equilibrium" else ():
        allowed = f"start = 'rest' is needed with it: in equilibrium {direction} begins where its spring holds it"
        refuse(getattr(machine.stiffness, direction), f"frame.machine.start.{direction}", value, allowed)
    motions = {} if frame.base is None else frame.base.motions
    for direction in machine.free:
        allowed = f"a spring or a damper in {direction} is allowed on what moves: the machine is free there"
        refuse(direction in motions and not machine.is_sprung(direction), f"frame.base.{direction}", None, allowed)


def _check_computed(scene: Scene, frame: Frame, computed: str) -> None:
    """Refuse settings that do not go with a computed motion.

    `computed` is the motion's key with its value, for the message.
    """
    refuse(frame.second_order == "auto", "frame.second_order", "auto", f"true or false is allowed beside {computed}")
    for member in members(scene):
        key = scene.section_key(member.number, "body.model")
        refuse(is_planar(member), key, model_of(member), f"a model in space is allowed beside {computed}")
    keyed = [(k, key, ring) for k, part in enumerate(scene.sections) for key, ring in part.keyed_rings.items()]
    for number, ring_key, ring in keyed:
        key = f"sections[{number}].{ring_key}"
        allowed = f"false is allowed beside {computed}: pads that hold both ways"
        refuse(ring.unilateral, f"{key}.unilateral", True, allowed)
        if isinstance(ring, JointPads) and ring.friction:
            raise scene_error(f"{key}.friction", ring.friction, f"0 is allowed beside {computed}")


def check_wind(scene: Scene) -> None:
    """Refuse wind together with a motion that is computed."""
    for member in members(scene) if scene.computed_key is not None else ():
        for k, load in enumerate(member.part.loads):
            if load.acts == "wind":
                allowed = f"'force' is allowed beside {scene.computed_key}, which is computed: the pressure of wind "
                allowed += "follows motions that are prescribed"
                raise scene_error(scene.section_key(member.number, f"loads[{k}].acts"), "wind", allowed)


def _check_ground(scene: Scene) -> None:
    """Refuse a ground without gravity, and a ground under a base whose forces at the pivot are not known."""
    if scene.gravity is None:
        raise scene_error("gravity", None, "a table is needed beside frame.ground: the weight presses on the ground")
    for support in scene.sections[0].supports:
        allowed = "'mean' is allowed beside frame.ground, as forces of 'all' points are not known"
        refuse(support.points == "all", scene.section_key(0, "supports"), "all", allowed)
    allowed = "true is allowed beside frame.ground, as forces along the boom have a moment about the ground"
    refuse(not has_axial_motion(member_at(scene, 0)), scene.section_key(0, "body.profile.axial"), False, allowed)


#: An angle may jump by this share of its range, which is round-off.
JUMP = 1e-9


def check_frame(scene: Scene) -> None:
    """Refuse a moving frame whose angles jump or have kinks, or that does not go with the scene's settings.

    Such settings are gravity with a direction of its own, models that can't follow the frame's motion, whatever the
    terms of second order do not cover, and the ANCF reference.  A scene without a frame passes.
    """
    frame = scene.frame
    if frame is None:
        return
    angles = dict(zip(("luffing", "slewing"), frame.angles, strict=True))
    keys = ("base.rx", "base.ry", "base.rz")
    if frame.ground is not None and any(frame.ground.slope):
        keys = ("ground.slope[1]", "ground.slope[0]", "base.rz")
    angles |= dict(zip(keys, frame.base_angles, strict=False))
    for key, angle in angles.items():
        frame.refuse_without_unit(f"frame.{key}", angle.bounds(0.0, scene.time.end))
        _check_smooth(scene, key, "an angle", angle)
    for number, part in enumerate(scene.sections):
        prefix = f"sections[{number}]." if scene.sections[0].name else ""
        for k, load in enumerate(part.loads):
            frame.refuse_without_unit(f"{prefix}loads[{k}].azimuth", load.azimuth)
    check_luffing(scene, frame)
    if frame.machine is not None:
        check_machine(scene, frame, frame.machine)
        _check_computed(scene, frame, "frame.machine")
    elif frame.computed_key is not None:
        _check_computed(scene, frame, FREE)
    if frame.ground is not None:
        _check_ground(scene)
    for axis, motion in (frame.base.motions if frame.base else {}).items():
        if axis in ("x", "y", "z"):
            _check_smooth(scene, f"base.{axis}", "a motion", motion)
    allowed = (
        "neither direction nor inclination is allowed beside a frame: "
        "frame.luffing already says how the boom is inclined"
    )
    refuse(scene.gravity is not None and scene.gravity.direction != Gravity().direction, "gravity", None, allowed)
    for member in members(scene):
        if traits_of(member).kind == "matrices":
            allowed = "models with a mesh are allowed in a frame: matrices do not say where their mass is"
            raise scene_error(scene.section_key(member.number, "body.model"), "matrices", allowed)
        if is_planar(member) and (frame.out_of_plane_key or frame.tail_position[1] != 0.0):
            key = frame.out_of_plane_key or "pivot"
            raise scene_error(f"frame.{key}", None, "models in space are allowed with it: beam2d has no lateral motion")
    for number in range(1, len(scene.sections) if frame.second_order else 1):
        least = scene.extension(number).bounds(0.0, scene.time.end)[0]
        allowed = f"an extension above 0 is allowed with frame.second_order: here it is {least:g} m"
        refuse(least <= 0.0, f"sections[{number}].joint", None, allowed)
    for support in scene.sections[0].supports if frame.second_order else ():
        if "x" in support.held_directions and scene.sections[0].position_of(support.on) not in (0.0, None):
            allowed = "the tail is allowed as the place that holds the base along with frame.second_order"
            allowed += ": axial forces are those from there on"
            raise scene_error(scene.section_key(0, "supports"), support.on, allowed)
    for member in members(scene) if frame.second_order else ():
        for load in member.part.loads:
            if load.on != "tip" and "x" in input_directions(member, load).values():
                allowed = "the tip is allowed with frame.second_order as the place of a load along the boom"
                raise scene_error(scene.section_key(member.number, "loads"), load.on, allowed)


def _check_smooth(scene: Scene, key: str, what: str, motion: SignalBase) -> None:
    """Refuse a motion of the frame whose value or rate jumps in the simulated time.

    `key` is the motion's key in the frame's table, and `what` names it in messages.
    """
    kinks = motion.kinks(scene.time.end)
    jumps = [t for t in motion.breaks if 0.0 < t <= scene.time.end and _has_jump(motion, t)]
    if jumps or kinks:
        at, defect = (jumps[0], "a jump") if jumps else (min(kinks), "a kink")
        allowed = f"{what} without jumps and kinks is allowed, such as a smooth_ramp; this one has {defect} at {at:g} s"
        if isinstance(motion, Table) and motion.interpolation == "akima" and at == motion.times[-1]:
            allowed += ": its table has to end at rest or after time.end"
        raise scene_error(f"frame.{key}", None, allowed)


def _has_jump(angle: SignalBase, t: float) -> bool:
    """Whether a signal jumps at t (s) by more than the share `JUMP` of its range from 0 to t and more than round-off.

    The range of a computed angle is no more than round-off before the angle moves.
    """
    low, high = angle.bounds(0.0, t)
    before, after = angle.value(np.array([np.nextafter(t, -np.inf), t]))
    return bool(abs(after - before) > JUMP * (high - low) + ROUND_OFF * max(abs(low), abs(high)))


#: Number of times at which the length of the rope is checked.
HOIST_SAMPLES = 1001


def still_rotation(scene: Scene) -> Array:
    """Rotation (3, 3) from axes of a boom without a frame into those of the ground; Z is opposite to the weight."""
    assert scene.gravity is not None  # as the checks say
    up, ahead = -np.array(scene.gravity.direction), np.eye(3)[0]
    ahead = ahead - (ahead @ up) * up
    ahead = ahead / np.linalg.norm(ahead) if np.linalg.norm(ahead) > 1e-9 else np.eye(3)[2]
    return np.array([ahead, np.cross(up, ahead), up])


class PlaceOnBoom(NamedTuple):
    """Place in m of head or winch with all sections retracted, and the number of the section around it.

    A place on the boom is along the boom's axes, from the pivot of its frame, or from the base's tail if it has no
    frame.  A place on the machine is along axes that do not luff.
    """

    at: tuple[float, float, float]
    number: int


def rope_places(scene: Scene) -> list[PlaceOnBoom]:
    """Places of the head and of the winch of a scene's hoist."""
    assert scene.hoist is not None
    tail = np.zeros(3) if scene.frame is None else np.array(scene.frame.tail_position)
    places = {name: (m.number, place) for m in members(scene) for name, place in m.rope_places.items()}
    on_boom = {name: PlaceOnBoom((*(tail + place.at).tolist(),), number) for name, (number, place) in places.items()}
    return [on_boom["head"], on_boom.get("winch", PlaceOnBoom(scene.hoist.winch.at, 0))]


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
    """Refuse a hoist that the scene's boom does not fit, or whose rope gets too short.

    A scene without a hoist passes.
    """
    hoist, frame = scene.hoist, scene.frame
    if hoist is None:
        return
    if scene.gravity is None:
        raise scene_error("gravity", None, "a table [gravity] is needed with [hoist], whose payload has a weight")
    if frame is not None and frame.ground is not None and hoist.pivot_height not in (0.0, frame.ground.height):
        allowed = f"frame.ground.height, {frame.ground.height:g}, is the pivot's height, and none beside it is allowed"
        raise scene_error("hoist.pivot_height", hoist.pivot_height, allowed)
    for key, name in (("section", hoist.section), ("winch.section", hoist.winch.section)):
        refuse(name and name not in scene.names, f"hoist.{key}", name, f"{', '.join(scene.names)} are allowed")
    if frame is not None and frame.base_angles and not hoist.winch.section:
        raise scene_error("hoist.winch.section", None, "a section is allowed where the base rolls, pitches or yaws")
    is_lifted = frame is not None and frame.base is not None and "z" in frame.base.motions
    ground_height = 0.0 if frame is None or frame.ground is None else frame.ground.height
    for key, height in (("hoist.pivot_height", hoist.pivot_height), ("frame.ground.height", ground_height)):
        allowed = "0 is allowed where frame.base.z moves the pivot: the height of the hook is measured from it"
        refuse(height and is_lifted, key, height, allowed)
    for member in members(scene):
        if hoist.lateral_key and is_planar(member):
            key = scene.section_key(member.number, "body.model")
            allowed = (
                f"a model in space is allowed beside hoist.{hoist.lateral_key}, which is not in the vertical plane"
            )
            raise scene_error(key, model_of(member), allowed)
        key = scene.section_key(member.number, "body.model")
        refuse(traits_of(member).kind == "matrices", key, "matrices", "models with a mesh are allowed with [hoist]")
        for place, (on, (x, _, _)) in member.rope_places.items():
            key = "hoist.on" if place == "head" else "hoist.winch.at"
            refuse(not 0.0 <= x <= member.part.length, key, x, f"0 to {member.part.length:g} m is allowed")
            if frame is not None and frame.second_order and on != "tip" and x != member.part.length:
                allowed = "a section's tip is allowed with frame.second_order, which takes forces along the boom there"
                raise scene_error(key, on, allowed)
    t = np.linspace(0.0, scene.time.end, HOIST_SAMPLES)
    if frame is not None and frame.luffing == "free" and not hoist.winch.section:
        t = t[:1]  # later the angle, and with it the distance from winch to head, is computed
    along = np.array([distance_along(scene, float(at)) for at in t])
    hanging = (hoist.free_length(t, along[0]) - along) / hoist.falls
    if not hanging.min() > 0.0:
        k = int(np.argmax(hanging <= 0.0))
        allowed = f"a longer rope is allowed: without force its hook is at the head at {t[k]:.4g} s"
        raise scene_error(f"hoist.{'speed' if hoist.is_wound else 'length'}", None, allowed)
