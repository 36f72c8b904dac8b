"""Checks of a scene with a free extension, and which sections move with it."""

from __future__ import annotations

from pmr.scene.choice import has_driven_tail
from pmr.scene.members import member_at
from pmr.scene.scene import Scene
from pmr.scene.structure_checks import scene_error


def check_free_extension(scene: Scene) -> None:
    """Refuse a second free extension, and all settings that a free extension does not go with.

    A scene without a free extension passes.
    """
    for number, extension in scene.free_extensions.items():
        free = f"the free extension of {scene.names[number]}"
        key = f"sections[{number}].joint"
        if number != min(scene.free_extensions):
            raise scene_error(f"{key}.extension.kind", "free", "one free extension is allowed")
        if scene.frame is None:
            allowed = f"a table is needed beside {free}: luffing = 0 is a level boom"
            raise scene_error("frame", None, allowed)
        if scene.frame.second_order is not False:
            allowed = f"false is allowed beside {free}: what a boom shortens by bending is not in its equation"
            raise scene_error("frame.second_order", scene.frame.second_order, allowed)
        if scene.start != "equilibrium":
            allowed = f"'equilibrium' is allowed beside {free}, which its cylinder holds then"
            raise scene_error("start", scene.start, allowed)
        if (opening := extension.worst_opening(scene.time.end)) is not None:
            raise scene_error(f"{key}.extension.oil.valve.opening", opening, "openings from -1 to 1 are allowed")
        _check_sections(scene, number, free)


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


def _check_sections(scene: Scene, number: int, free: str) -> None:
    """Refuse drives that give way, and models without displacements along the boom.

    `free` names the free extension of section `number` in messages.
    """
    for k in moved_sections(scene, number):
        joint, key = scene.joint(k), f"sections[{k}].joint"
        if joint.rope is not None:
            raise scene_error(f"{key}.rope", None, f"none is allowed beside {free}: its cylinder moves the section")
        if joint.cylinder.stiffness != "rigid":
            allowed = f"'rigid' is allowed beside {free}: oil or a spring gives way"
            raise scene_error(f"{key}.cylinder.stiffness", joint.cylinder.stiffness, allowed)
        if not has_driven_tail(member_at(scene, k)):
            allowed = f"a model with displacements along the boom is allowed beside {free}"
            raise scene_error(scene.section_key(k, "body.model"), None, allowed)
