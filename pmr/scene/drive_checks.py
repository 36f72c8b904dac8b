"""Checks of cylinders that move a boom, and of what they hold, which raise InputError.

A luffing cylinder without an arm about the pivot is refused, and so is whatever does not go with a luffing angle or an
extension that is computed with the boom.
"""

from __future__ import annotations

import numpy as np

from pmr.scene.choice import has_driven_tail, traits_of
from pmr.scene.frame import Frame
from pmr.scene.keys import LUFFING
from pmr.scene.mechanism import NEAR, supports_at_lug
from pmr.scene.members import member_at, members
from pmr.scene.scene import Scene
from pmr.scene.structure_checks import refuse, scene_error

#: Key and value of a luffing angle that is computed, for messages.
FREE = "frame.luffing = 'free'"
#: Least arm of a luffing cylinder as a share of the lug's distance from the pivot; number of times that are checked.
IN_LINE, SAMPLES = 0.01, 1001


def check_luffing(scene: Scene, frame: Frame) -> None:
    """Refuse a luffing cylinder that can't carry the boom, and what does not go with a free luffing angle."""
    _check_cylinder(scene, frame)
    _check_drive(scene, frame)
    if frame.luffing == "free":
        _check_supports(scene, frame)


def misplaced_supports(scene: Scene) -> dict[int, float]:
    """Places of supports that hold the boom across, but neither at its pivot nor at the luffing cylinder's lug.

    The result maps the index of such a support to its place in m from the base's tail.  Only supports that hold z, and
    neither x nor ry, are looked at.  The result is empty without a cylinder, or if the cylinder holds the base by its
    own stiffness.
    """
    cylinder = None if scene.frame is None else scene.frame.cylinder
    if scene.frame is None or cylinder is None or cylinder.stiffness is not None:
        return {}
    part, pivot, misplaced = members(scene)[0].part, -scene.frame.tail_position[0], dict[int, float]()
    for k, support in enumerate(part.supports):
        place, held = part.position_of(support.on), support.held_directions
        if place is None or "z" not in held or {"x", "ry"} & set(held):
            continue
        if min(abs(place - pivot), abs(place - pivot - cylinder.lug[0])) > NEAR:
            misplaced[k] = place
    return misplaced


def _check_supports(scene: Scene, frame: Frame) -> None:
    """Refuse supports of the base that do not go with a free luffing angle.

    A support that keeps the base from turning about the pivot has to be rigid.  On a spring the whole boom would turn
    by the angle and by the spring alike, and the steps of a heavy boom would not converge.  A support across the boom
    has to be at the cylinder's lug.
    """
    part = members(scene)[0].part
    for k, support in enumerate(part.supports):
        place, held = part.position_of(support.on), support.held_directions
        is_at_pivot = place is not None and abs(place + frame.tail_position[0]) <= NEAR
        if support.stiffness != "rigid" and ("ry" in held or ("z" in held and not is_at_pivot)):
            key = scene.section_key(0, f"supports[{k}].stiffness")
            allowed = f"'rigid' is allowed beside {FREE} where a support keeps the base from turning about the pivot"
            raise scene_error(key, support.stiffness, allowed)
    for k in misplaced_supports(scene):
        assert frame.cylinder is not None  # else no support is misplaced
        lug = frame.cylinder.lug[0] - frame.tail_position[0]
        allowed = f"{lug:g} m from the tail, where frame.cylinder.lug is, is allowed for a support across the boom"
        raise scene_error(scene.section_key(0, f"supports[{k}].on"), part.supports[k].on, f"{allowed} beside {FREE}")


def _check_drive(scene: Scene, frame: Frame) -> None:
    """Refuse what a free luffing angle does not go with, and a free angle's keys if the angle is prescribed.

    With a free angle these are refused: a cylinder without a drive, valve openings outside of -1 to 1, and an unfit
    stroke.  A stroke has to contain the cylinder's first length and to lie between its dead centres.  A free angle
    without a cylinder is allowed.
    """
    cylinder = frame.cylinder
    if frame.luffing != "free":
        for key in ("luffing_start", "luffing_rate"):
            refuse(getattr(frame, key), f"frame.{key}", getattr(frame, key), f"{FREE} is needed with it")
        keys = () if cylinder is None else (*cylinder.drives, *(k for k in ("damping",) if cylinder.damping))
        if keys:
            raise scene_error(f"frame.cylinder.{keys[0]}", None, f"{FREE} is needed with it: the angle is prescribed")
        return
    if cylinder is None:
        return
    allowed = f"force, length or oil is needed beside {FREE}; without frame.cylinder the boom swings by itself"
    refuse(not cylinder.drives, "frame.cylinder", None, allowed)
    if (opening := cylinder.worst_opening(scene.time.end)) is not None:
        raise scene_error("frame.cylinder.oil.valve.opening", opening, "openings from -1 to 1 are allowed")
    length = float(cylinder.length_and_arm(frame.angles.luffing.value(np.zeros(1))).length[0])
    if cylinder.stroke is not None and not cylinder.stroke[0] <= length <= cylinder.stroke[1]:
        allowed = f"the length at luffing_start, {length:.4g} m, is needed within the stroke"
        raise scene_error("frame.cylinder.stroke", list(cylinder.stroke), allowed)
    reach = [float(np.hypot(*hinge)) for hinge in (cylinder.foot, cylinder.lug)]
    dead = abs(reach[0] - reach[1]), sum(reach)
    if cylinder.stroke is not None and not dead[0] < cylinder.stroke[0] < cylinder.stroke[1] < dead[1]:
        allowed = (
            f"lengths between {dead[0]:.4g} and {dead[1]:.4g} m are allowed: foot, lug and pivot are in line there"
        )
        raise scene_error("frame.cylinder.stroke", list(cylinder.stroke), allowed)


def _check_cylinder(scene: Scene, frame: Frame) -> None:
    """Refuse a luffing cylinder whose arm about the pivot is zero, or nearly so, at some time.

    Such a cylinder carries no moment.
    """
    if frame.cylinder is None:
        return
    if frame.cylinder.stiffness is not None:
        _check_holding_cylinder(scene, frame)
    t = np.linspace(0.0, scene.time.end, SAMPLES)
    angle = frame.angles.luffing.value(t)
    length, arm = frame.cylinder.length_and_arm(angle)
    reach = float(np.hypot(*frame.cylinder.lug))
    k = int(np.argmin(np.abs(arm)))
    if np.abs(arm[k]) < IN_LINE * reach or arm.min() < 0.0 < arm.max() or reach == 0.0:
        at = f"at {t[k]:.4g} s, {np.rad2deg(angle[k]):.3g} degrees, a cylinder of {length[k]:.3g} m has {arm[k]:.2g} m"
        raise scene_error("frame.cylinder", None, f"hinges with an arm about the pivot are allowed: {at}")


def _check_holding_cylinder(scene: Scene, frame: Frame) -> None:
    """Refuse a luffing cylinder with a stiffness unless it can hold the base.

    The base has to be a beam of a boom of several sections with a luffing angle.  The lug has to be on the base, and no
    support may be at the lug.  A pin has to be at the pivot: elsewhere the cylinder would have another arm about the
    pin.
    """
    key, base = "frame.cylinder.stiffness", members(scene)[0]
    assert frame.cylinder is not None
    if not base.has_joint or not traits_of(base).is_beam:
        allowed = "a boom of several sections whose base is a beam is allowed with it: body.model = 'beam3d' in the "
        raise scene_error(key, None, f"{allowed}section {scene.names[0]!r} makes it one; the others may be shells")
    refuse(frame.luffing is None, "frame.luffing", None, f"the angle that the boom is raised by is needed with {key}")
    if LUFFING in scene.names:
        raise scene_error("sections.name", LUFFING, f"other names are allowed beside {key}: a path has this one")
    at = frame.cylinder.lug[0] - frame.tail_position[0]
    allowed = "with a stiffness, a place on the base is allowed"
    refuse(not 0.0 <= at <= base.part.length, "frame.cylinder.lug", frame.cylinder.lug[0], allowed)
    clamped = any("ry" in support.held_directions for support in base.part.supports)
    for k, support in enumerate(base.part.supports if not clamped else ()):
        place = base.part.position_of(support.on)
        if place is None or "x" not in support.held_directions:
            continue
        x, z = place + frame.tail_position[0], frame.tail_position[2]
        if np.hypot(x, z) > NEAR:
            allowed = f"beside {key} a pin at the pivot is allowed, about which the cylinder has its arm: this one is "
            allowed += f"{x:g} m ahead of the pivot and {z:g} m above"
            raise scene_error(scene.section_key(0, f"supports[{k}].on"), support.on, allowed)
    if twice := supports_at_lug(scene):
        at_lug = twice[0].row_name("z")
        allowed = f"the cylinder's stiffness or the support {at_lug!r} at its lug is allowed, one of both"
        raise scene_error(key, frame.cylinder.stiffness, allowed)


def check_free_extension(scene: Scene) -> None:
    """Refuse a second free extension, and all settings that a free extension does not go with.

    A scene without a free extension passes.
    """
    for number, extension in scene.free_extensions.items():
        free = f"the free extension of {scene.names[number]}"
        key = f"sections[{number}].joint"
        refuse(number != min(scene.free_extensions), f"{key}.extension.kind", "free", "one free extension is allowed")
        if scene.frame is None:
            raise scene_error("frame", None, f"a table is needed beside {free}: luffing = 0 is a level boom")
        allowed = f"false is allowed beside {free}: what a boom shortens by bending is not in its equation"
        refuse(scene.frame.second_order is not False, "frame.second_order", scene.frame.second_order, allowed)
        allowed = f"'equilibrium' is allowed beside {free}, which its cylinder holds then"
        refuse(scene.start != "equilibrium", "start", scene.start, allowed)
        if (opening := extension.worst_opening(scene.time.end)) is not None:
            raise scene_error(f"{key}.extension.oil.valve.opening", opening, "openings from -1 to 1 are allowed")
        _check_moved_sections(scene, number, free)


def moved_sections(scene: Scene, number: int) -> dict[int, tuple[float, float]]:
    """Ratio and offset in m of each section that moves with the free extension of section `number`, by its number."""
    ratios_and_offsets = {number: (1.0, 0.0)}
    for k in range(number + 1, len(scene.sections)):
        follows = scene.joint(k).follows
        leader = None if follows is None else scene.names.index(follows)
        if leader in ratios_and_offsets:
            ratio, offset = ratios_and_offsets[leader]
            joint = scene.joint(k)
            ratios_and_offsets[k] = joint.ratio * ratio, joint.ratio * offset + joint.offset
    return ratios_and_offsets


def _check_moved_sections(scene: Scene, number: int, free: str) -> None:
    """Refuse drives that give way, and models without displacements along the boom.

    `free` names the free extension of section `number` in messages.
    """
    for k in moved_sections(scene, number):
        joint, key = scene.joint(k), f"sections[{k}].joint"
        if joint.rope is not None:
            raise scene_error(f"{key}.rope", None, f"none is allowed beside {free}: its cylinder moves the section")
        allowed = f"'rigid' is allowed beside {free}: oil or a spring gives way"
        refuse(joint.cylinder.stiffness != "rigid", f"{key}.cylinder.stiffness", joint.cylinder.stiffness, allowed)
        allowed = f"a model with displacements along the boom is allowed beside {free}"
        refuse(not has_driven_tail(member_at(scene, k)), scene.section_key(k, "body.model"), None, allowed)
