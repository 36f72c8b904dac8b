"""Checks of a moving frame, its luffing cylinder and a hoist, which raise InputError.

Refused are motions of a frame that jump, and a luffing cylinder without an arm about the pivot.  So are models that
can't follow the frame: matrices without a mesh, and planar ones if the boom leaves its vertical plane.  With second
order, supports and loads are refused at places for which it has no terms.  Beside a luffing angle that is computed, the
cylinder needs a drive, and supports may neither hold the angle nor give way to it.  Places of head and winch of a hoist
on the boom stand here too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pmr.files.arrays import Array
from pmr.scene.built import Gravity
from pmr.scene.choice import has_axial_motion, input_directions, is_planar, model_of, traits_of
from pmr.scene.frame import Frame, Machine
from pmr.scene.joints import JointPads
from pmr.scene.keys import ALONE, LUFFING
from pmr.scene.mechanism import AT_GROUND, AT_PIVOT, MACHINE, NEAR, supports_at_lug
from pmr.scene.members import member_at, members
from pmr.scene.scene import Scene
from pmr.scene.signals import SignalBase, Table
from pmr.scene.signals.base import ROUND_OFF
from pmr.scene.structure_checks import refuse, scene_error

#: Key and value of a luffing angle that is computed, for messages.
FREE = "frame.luffing = 'free'"
#: Least arm of a luffing cylinder as a share of the lug's distance from the pivot; number of times that are checked.
IN_LINE, SAMPLES = 0.01, 1001


def _check_machine(scene: Scene, frame: Frame, machine: Machine) -> None:
    """Refuse a machine that is free in a direction in which its base moves, without a spring or damper between both.

    Where the scene starts in equilibrium, the start of a direction with a spring follows from the equilibrium, so that
    a given start is refused.
    """
    for direction, value in machine.start.nonzero.items() if scene.start == "equilibrium" else ():
        allowed = f"start = 'rest' is needed with it: in equilibrium {direction} begins where its spring holds it"
        refuse(getattr(machine.stiffness, direction), f"frame.machine.start.{direction}", value, allowed)
    motions = {} if frame.base is None else frame.base.motions
    sprung = {*machine.stiffness.nonzero, *machine.damping.nonzero}
    for direction in machine.free:
        allowed = f"a spring or a damper in {direction} is allowed on what moves: the machine is free there"
        refuse(direction in motions and direction not in sprung, f"frame.base.{direction}", None, allowed)


def _check_computed(scene: Scene, frame: Frame, computed: str) -> None:
    """Refuse settings that do not go with a computed motion.

    The settings are an automatic choice of second order, planar models, and pads that only push or rub.  `computed` is
    the motion's key with its value, for the message.
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


def _check_ground(scene: Scene) -> None:
    """Refuse a ground without gravity, and one under a base section whose forces at the pivot are not known.

    The forces are not known with supports of "all" points, and with a model that has no motion along the boom.
    """
    if scene.gravity is None:
        raise scene_error("gravity", None, "a table is needed with frame.ground, as the weight presses on the ground")
    for i, support in enumerate(scene.sections[0].supports):
        allowed = "'mean' is allowed with frame.ground, as forces of 'all' points are not known"
        refuse(support.points == "all", scene.section_key(0, f"supports[{i}].points"), "all", allowed)
    allowed = "true is allowed with frame.ground, as forces along the boom have a moment about the ground"
    refuse(not has_axial_motion(member_at(scene, 0)), scene.section_key(0, "body.profile.axial"), False, allowed)


#: An angle may jump by this share of its range, which is round-off.
JUMP = 1e-9


def check_frame(scene: Scene) -> None:
    """Refuse a moving frame whose motions jump or have kinks, or that contradicts other settings of the scene.

    A scene without a frame passes.  Contradictions are:

    - angles of more than a turn without a unit,
    - gravity with a direction of its own,
    - given matrices,
    - planar models, if the boom leaves its vertical plane.

    With second order, an extension has to be above 0, the base held along x at its tail, and each load along the boom
    at a tip.  What a luffing cylinder, a machine, a computed motion and a ground need is checked, too.
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
    _check_names_of_supports(scene)
    _check_cylinder(scene, frame)
    _check_drive(scene, frame)
    if frame.luffing == "free":
        _check_supports(scene, frame)
    if frame.machine is not None:
        _check_machine(scene, frame, frame.machine)
        _check_computed(scene, frame, "frame.machine")
    elif frame.computed_key is not None:
        _check_computed(scene, frame, FREE)
    if frame.ground is not None:
        _check_ground(scene)
    for axis, motion in (frame.base.motions if frame.base else {}).items():
        if axis in ("x", "y", "z"):
            _check_smooth(scene, f"base.{axis}", "a motion", motion)
    allowed = (
        "neither direction nor inclination is allowed in a scene with a frame, "
        "as frame.luffing says how the boom is inclined"
    )
    refuse(scene.gravity is not None and scene.gravity.direction != Gravity().direction, "gravity", None, allowed)
    for member in members(scene):
        if traits_of(member).kind == "matrices":
            allowed = "models with a mesh are allowed in a frame, as matrices do not say where their mass is"
            raise scene_error(scene.section_key(member.number, "body.model"), "matrices", allowed)
        if is_planar(member) and (frame.out_of_plane_key or frame.tail_position[1] != 0.0):
            key = frame.out_of_plane_key or "pivot"
            allowed = "only models in space are allowed with this key, as beam2d has no lateral motion"
            raise scene_error(f"frame.{key}", None, allowed)
    for number in range(1, len(scene.sections) if frame.second_order else 1):
        least = scene.extension(number).bounds(0.0, scene.time.end)[0]
        allowed = f"with frame.second_order, an extension above 0 is allowed; here it is {least:g} m"
        refuse(least <= 0.0, f"sections[{number}].joint", None, allowed)
    for i, support in enumerate(scene.sections[0].supports if frame.second_order else ()):
        if "x" in support.held_directions and scene.sections[0].position_of(support.on) not in (0.0, None):
            allowed = "with frame.second_order, the support that holds the base along x has to be on its tail, "
            allowed += "as axial forces are counted from the tail on"
            raise scene_error(scene.section_key(0, f"supports[{i}].on"), support.on, allowed)
    for member in members(scene) if frame.second_order else ():
        for i, load in enumerate(member.part.loads):
            if load.on != "tip" and "x" in input_directions(member, load).values():
                allowed = "with frame.second_order, a load along the boom has to act on the tip"
                raise scene_error(scene.section_key(member.number, f"loads[{i}].on"), load.on, allowed)


def _check_smooth(scene: Scene, key: str, what: str, motion: SignalBase) -> None:
    """Refuse a motion of the frame without a second rate, or whose value or rate jumps in the simulated time.

    `key` is the motion's key in the frame's table, and `what` names it in messages.
    """
    try:
        motion.second_rate(0.0)
    except NotImplementedError as error:  # of a signal of another package
        allowed = f"{what} whose signal has a second_rate is allowed, as accelerations follow from it; {error}"
        raise scene_error(f"frame.{key}", None, allowed) from None
    kinks = motion.kinks(scene.time.end)
    jumps = [t for t in motion.breaks if 0.0 < t <= scene.time.end and _has_jump(motion, t)]
    if jumps or kinks:
        at, defect = (jumps[0], "a jump") if jumps else (min(kinks), "a kink")
        allowed = f"{what} without jumps and kinks is allowed, such as a smooth_ramp; this one has {defect} at {at:g} s"
        if isinstance(motion, Table) and motion.interpolation == "akima" and at == motion.times[-1]:
            allowed += ": its table has to end at rest or after time.end"
        raise scene_error(f"frame.{key}", None, allowed)


def _has_jump(angle: SignalBase, t: float) -> bool:
    """Whether a signal jumps at t (s) by more than the share `JUMP` of its range from 0 to t.

    The jump must also be larger than round-off.  Before a computed angle moves, its range is round-off alone, of which
    any change would be a large share.
    """
    low, high = angle.bounds(0.0, t)
    before, after = angle.value(np.array([np.nextafter(t, -np.inf), t]))
    return bool(abs(after - before) > JUMP * (high - low) + ROUND_OFF * max(abs(low), abs(high)))


def still_rotation(scene: Scene) -> Array:
    """Rotation (3, 3) from the axes of a boom without a frame into the axes X, Y, Z of the ground.

    Z is opposite to the weight, and X is the boom's x projected to the horizontal.  For a vertical boom, X is the
    boom's z.
    """
    assert scene.gravity is not None  # as the checks say
    up, ahead = -np.array(scene.gravity.direction), np.eye(3)[0]
    ahead = ahead - (ahead @ up) * up
    ahead = ahead / np.linalg.norm(ahead) if np.linalg.norm(ahead) > 1e-9 else np.eye(3)[2]
    return np.array([ahead, np.cross(up, ahead), up])


class PlaceOnBoom(NamedTuple):
    """Place in m of head or winch with all sections retracted, and the number of the section around it.

    A place on the boom is along the boom's axes, from the pivot of its frame, or from the base's tail if it has no
    frame.  A place on the machine is along axes that do not luff; its `number` is 0.
    """

    at: tuple[float, float, float]
    number: int


def rope_places(scene: Scene) -> list[PlaceOnBoom]:
    """Places of a scene's hoist on boom or machine: that of the head, then that of the winch."""
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
        up = still_rotation(scene)[2] if scene.frame is None else scene.frame.rotation(t)[0, 2]
        winch = np.array([winch[0] * up[2] + winch[2] * up[0], winch[1], winch[2] * up[2] - winch[0] * up[0]])
    return float(np.linalg.norm(head - winch))


def check_hoist(scene: Scene) -> None:
    """Refuse a hoist without gravity, on a boom that can't carry it, or with a rope that gets too short.

    The boom has to have the sections that the hoist names, models that can move as the rope pulls, and head and winch
    on it.  The heights in the tables of hoist, ground and base must not contradict each other.  A scene without a hoist
    passes.
    """
    hoist, frame = scene.hoist, scene.frame
    if hoist is None:
        return
    if scene.gravity is None:
        raise scene_error("gravity", None, "a table [gravity] is needed with [hoist], whose payload has a weight")
    if frame is not None and frame.ground is not None and hoist.pivot_height not in (0.0, frame.ground.height):
        allowed = f"leave it out, as frame.ground.height = {frame.ground.height:g} is the height of the pivot"
        raise scene_error("hoist.pivot_height", hoist.pivot_height, allowed)
    for key, name in (("section", hoist.section), ("winch.section", hoist.winch.section)):
        refuse(name and name not in scene.names, f"hoist.{key}", name, f"{', '.join(scene.names)} are allowed")
    is_lifted = frame is not None and frame.base is not None and "z" in frame.base.motions
    ground_height = 0.0 if frame is None or frame.ground is None else frame.ground.height
    for key, height in (("hoist.pivot_height", hoist.pivot_height), ("frame.ground.height", ground_height)):
        allowed = "0 is allowed, as frame.base.z moves the pivot, and the height of the hook is measured from the pivot"
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
                allowed = "with frame.second_order, the tip of a section is allowed, as forces along the boom act there"
                raise scene_error(key, on, allowed)
    t = np.linspace(0.0, scene.time.end, SAMPLES)
    if frame is not None and frame.luffing == "free" and not hoist.winch.section:
        t = t[:1]  # later the angle, and with it the distance from winch to head, is computed
    along = np.array([distance_along(scene, float(at)) for at in t])
    hanging = (hoist.free_length(t, along[0]) - along) / hoist.falls
    if not hanging.min() > 0.0:
        k = int(np.argmax(hanging <= 0.0))
        allowed = f"a longer rope is needed, as the hook of the slack rope reaches the head at {t[k]:.4g} s"
        raise scene_error(f"hoist.{'speed' if hoist.is_wound else 'length'}", None, allowed)


def _check_names_of_supports(scene: Scene) -> None:
    """Refuse supports of a body alone whose reactions would have names as those of the pivot, ground or machine."""
    reserved = (AT_PIVOT, AT_GROUND, MACHINE)
    allowed = f"beside [frame] a name that does not begin with one of {', '.join(reserved)} is allowed"
    for k, support in enumerate(scene.bodies[ALONE].supports if ALONE in scene.bodies else ()):
        rows = [support.row_name(direction) for direction in support.held_directions]
        taken = any(row.startswith(tuple(f"{of} " for of in reserved)) for row in rows)
        refuse(taken, f"supports[{k}].name", support.name, f"{allowed}: these have reactions")


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
    """Refuse supports of the base that would hold a free luffing angle, or give way to it.

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
    """Refuse a luffing cylinder that can't drive a free angle, and a free angle's keys if the angle is prescribed.

    Beside a free angle, a cylinder needs a drive and valve openings from -1 to 1.  Its stroke has to contain the
    cylinder's first length and to lie between its dead centres.  A free angle without a cylinder is allowed.
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

    Such a cylinder carries no moment.  An arm is nearly zero below the share `IN_LINE` of the lug's distance from the
    pivot.
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
    support may be at the lug.  A pin has to be within `NEAR` of the pivot: elsewhere the cylinder would have another
    arm about the pin.
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
