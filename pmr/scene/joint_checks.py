"""Checks of neighbouring sections of a boom, which raise InputError: their fit, drives, pads and extensions."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import product

import numpy as np

from pmr.errors import BEYOND_ENDS, InputError
from pmr.scene.box import SLACK, Box, ShiftedProfile
from pmr.scene.choice import SimulatorNeeds, has_axial_motion, has_driven_tail, is_planar, refuse_unsupported
from pmr.scene.joints import BoomSection, JointPads, ScaledSignal
from pmr.scene.mechanism import Drive, longest_rope, rope_length, rope_shares
from pmr.scene.members import EXTENSION, Seat, member_at, members, name_in_scene, ring_name, seats
from pmr.scene.profile import gaps
from pmr.scene.rotation import wind_direction
from pmr.scene.scene import Scene
from pmr.scene.structure_checks import (
    check_loads,
    check_names,
    check_proportions,
    check_reserved,
    check_structure,
    check_wheel,
    describe_jump,
    refuse,
    scene_error,
)

#: Least cosine of the angle between the two faces that a pad touches.
PARALLEL = 1.0 - 1e-6
#: Largest distance of a line of action from the axis, over the larger side of the outer section.
FAR_OUT = 2.0


def _check_fit(scene: Scene, number: int) -> None:
    """Refuse section `number` unless its box fits into the box of the section before, and its pads into the gap.

    A play of pads to compare with (`compare.play`) is refused if the gap has no room for it in a direction in which
    pads only push.  Sections without boxes pass.
    """
    inner, outer = scene.sections[number].body.box, scene.sections[number - 1].body.box
    if inner is None or outer is None:
        return
    name, around = scene.names[number], scene.names[number - 1]
    pushing = [face for ring in scene.joint(number).rings if ring.unilateral for face in ring.faces or ()]
    play, pressed = np.inf, {word for face in pushing for word in face.split()}  # a slanted face has two words
    for side, walls in (("width", ("left", "right")), ("height", ("bottom", "top"))):
        has = getattr(inner, side) + sum(map(inner.thickness, walls)) / 2.0
        room = getattr(outer, side) - sum(map(outer.thickness, walls)) / 2.0
        if has >= room:
            sizes = f"the outside of {name} is {has:.6g} m, the inside of {around} is {room:.6g} m"
            allowed = f"{name} has to fit into {around}, but {sizes}"
            raise scene_error(f"sections[{number}].body.box.{side}", None, allowed)  # the scene may have outer sizes
        if pressed & set(walls):
            play = min(play, room - has)
    allowed = f"at most {play:.6g} m is allowed: this is how far {name} can move in {around}, from wall to wall"
    is_set = "play" in scene.compare.model_fields_set  # the default is for all booms
    refuse(is_set and scene.compare.play > play * (1.0 + SLACK), "compare.play", scene.compare.play, allowed)
    beyond, face = min((room, face) for face, room in gaps(inner.sides, outer.sides).items())
    allowed = f"{name} has to fit into {around}, but passes its {face} by {-beyond:.3g} m"
    refuse(beyond <= 0.0, f"sections[{number}].body.box", None, allowed)
    joint, most = scene.joint(number), FAR_OUT * max(outer.width, outer.height)
    allowed = f"at most {most:g} m off the axis along y and z is allowed, twice the larger side of {around}"
    is_far = joint.line is not None and max(map(abs, joint.line)) > most
    refuse(is_far, f"sections[{number}].joint.{joint.driver}.offset", joint.line and [*joint.line], allowed)
    _check_tail(scene, number, inner, outer)
    _check_doublers(scene, number, inner, outer)
    _check_frames(scene, number, inner, outer)
    for seat in seats(scene, number):
        if seat.joint == number:
            _check_clearance(seat, f"sections[{number}].joint.{seat.key}", (name, inner), (around, outer))


def _check_tail(scene: Scene, number: int, inner: Box, outer: Box) -> None:
    """Refuse section `number` if its tail, of the box `inner`, does not fit into the outer box's taper at the tail."""
    first, _ = scene.extension(number).bounds(0.0, scene.time.end)
    low, _ = outer.parallel_range
    if first >= low:
        return
    ends = inner.profile_at(0.0), outer.profile_at(max(first, 0.0))
    beyond = min(gaps(*(profile.sides for profile in ends)).values())
    allowed = (
        f"{scene.names[number]} comes to {first:.6g} m from the tail of {scene.names[number - 1]}, where the taper "
        f"leaves {-beyond:.3g} m too little room; a shorter taper or a larger extension is allowed"
    )
    refuse(beyond <= 0.0, f"sections[{number - 1}].body.box.tail_taper.length", low, allowed)


def _check_doublers(scene: Scene, number: int, inner: Box, outer: Box) -> None:
    """Refuse doublers that leave no room between section `number` and the outer box, where the section slides in it.

    Profiles are compared that meet on the way, tapered ones where the gap can be smallest.  Two are passed over if
    neither has a doubler on one side of a wall.
    """
    first, last = scene.extension(number).bounds(0.0, scene.time.end)
    for a, b in product(inner.stretches, outer.stretches):
        k, part = (number, a) if isinstance(a.first, ShiftedProfile) else (number - 1, b)
        if not isinstance(part.first, ShiftedProfile) or a.start + first >= b.end or a.end + last <= b.start:
            continue
        places = [(x, min(max(x + s, b.start), b.end)) for x in (a.start, a.end) for s in (first, last)]
        places += [(min(max(y - s, a.start), a.end), y) for y in (b.start, b.end) for s in (first, last)]
        slack = SLACK * outer.length
        pairs = [(a.profile_at(x), b.profile_at(y)) for x, y in {*places} if first - slack <= y - x <= last + slack]
        pairs = pairs[:1] if a.first is a.last and b.first is b.last else pairs
        beyond, face = min((room, face) for p, q in pairs for face, room in gaps(p.sides, q.sides).items())
        allowed = (
            f"the plates from {part.start:g} to {part.end:g} m leave {beyond:.3g} m between {scene.names[number]} and "
            f"{scene.names[number - 1]} at the {face}; more than 0 is allowed, or plates on the other side of the wall"
        )
        refuse(beyond <= 0.0, f"sections[{k}].body.box.doublers", None, allowed)


def _check_frames(scene: Scene, number: int, inner: Box, outer: Box) -> None:
    """Refuse frames of the outer box if section `number`, with the inner box, has too little room to slide past."""
    first, _ = scene.extension(number).bounds(0.0, scene.time.end)
    reached = [x for x in outer.frames if x >= first]
    if not reached:
        return
    gap = gaps(inner.sides, outer.sides)
    room = min(gap[side.name] + side.thickness / 2.0 for side in outer.sides)
    if outer.frame_depth == "full" or outer.frame_depth >= room:
        allowed = (
            f"{scene.names[number]} slides past the frame at {reached[0]:g} m; frames at less than {first:.6g} m, "
            f"or a frame_depth of less than {room:.6g} m, are allowed"
        )
        raise scene_error(f"sections[{number - 1}].body.box.frames", list(outer.frames), allowed)


def _check_clearance(seat: Seat, key: str, inner: tuple[str, Box], outer: tuple[str, Box]) -> None:
    """Refuse pads on faces that a box lacks or that are not parallel, and clearances that exceed the gap.

    Faces are parallel if the cosine of the angle between their normals is at least `PARALLEL`.  A clearance may exceed
    the gap by the share `SLACK` of it.  `inner` and `outer` are the name and the box of the two sections; `key` is the
    key of the ring of pads.
    """
    (name, section), (around, tube) = inner, outer
    inner_faces, outer_faces = section.faces, tube.faces
    for face in seat.ring.faces or ():
        for body, faces in ((name, inner_faces), (around, outer_faces)):
            allowed = f"faces that {body} has are allowed: {', '.join(faces) or 'none'}"
            refuse(face not in faces, f"{key}.faces", face, allowed)
        allowed = f"only parallel faces are allowed, but the {face} of {name} is not parallel to that of {around}"
        refuse(inner_faces[face].normal @ outer_faces[face].normal < PARALLEL, f"{key}.faces", face, allowed)
    room = gaps(section.sides, tube.sides)
    for face in seat.ring.faces or ("bottom", "top"):  # points stand above and below
        clearance, gap = seat.ring.clearance_on(face), room.get(face, np.inf)
        allowed = f"at most {gap:.6g} m is allowed, the width of the gap between {name} and {around} on this face"
        refuse(clearance > gap * (1.0 + SLACK), f"{key}.clearance", clearance, allowed)


def check_joints(scene: Scene) -> None:
    """Raise an InputError for the first key of a boom of several sections that contradicts another key."""
    _check_section_names(scene)
    for number in range(len(scene.sections)):
        _check_reduction(scene, number)
        if number:
            _check_drive(scene, number)
    for number in range(1, len(scene.sections)):
        _check_fit(scene, number)
        check_extension(scene, number)
        _check_flexible_drive(scene, number)
    for number in range(len(scene.sections)):
        _check_ground_supports(scene, number)
        _check_pads(scene, number)
        check_section(scene, number)
    for number in range(1, len(scene.sections)) if scene.start == "equilibrium" else ():
        _check_equilibrium_start(scene, number)
    planar = [is_planar(member) for member in members(scene)]
    if len(set(planar)) > 1:
        names = ", ".join(name for name, flat in zip(scene.names, planar, strict=True) if flat)
        allowed = f"sections are allowed that are all planar beams, or none of them; planar beams are {names}"
        raise scene_error("sections", None, allowed)
    _check_overlaps_and_friction(scene)
    _check_simulators(scene)


def _check_section_names(scene: Scene) -> None:
    """Refuse equal names of sections, a base with a joint, and a further section without a joint.

    Rings of pads with equal names in the whole scene, such as ``fly tail``, are refused.  A mover is refused unless its
    joint is a wheel.
    """
    check_names("sections", scene.names)
    allowed = "the base does not slide in another section: supports or pads hold it"
    refuse(scene.sections[0].joint is not None, "sections[0].joint", None, allowed)
    for number, part in enumerate(scene.sections[1:], start=1):
        if part.joint is None:
            raise scene_error(f"sections[{number}].joint", None, f"a joint in which {part.name} slides is needed")
        if part.body.mover is not None:
            check_wheel(part.joint, f"sections[{number}].")
    keys = dict[str, str]()
    for number, part in enumerate(scene.sections):
        for key, ring in part.keyed_rings.items():
            name = name_in_scene(part.name, key, ring)
            if name in keys:
                allowed = f"another name is allowed, as the pads of {keys[name]} are called {name!r}, too"
                raise scene_error(f"sections[{number}].{key}.name", ring.name, allowed)
            keys[name] = f"sections[{number}].{key}"


def _check_reduction(scene: Scene, number: int) -> None:
    """Refuse settings of the reduction, slider and length of section `number` that no section of a boom can have."""
    choice, key = scene.sections[number].reduction, f"sections[{number}].reduction"
    allowed = "'free_modes' without a file is allowed for sections of a boom, which have no common path"
    refuse(choice.basis != "free_modes" or choice.file is not None, f"{key}.basis", choice.basis, allowed)
    refuse(choice.ports, f"{key}.ports", list(choice.ports), "no ports are allowed for sections of a boom")
    allowed = "leave it out, as joints move the sections of a boom"
    refuse(scene.sections[number].slider is not None, f"sections[{number}].slider", None, allowed)
    allowed = "observe.start and observe.end are needed where a mesh that is read says how long a section is"
    refuse(scene.sections[number].length <= 0.0, f"sections[{number}].observe", None, allowed)


def _check_drive(scene: Scene, number: int) -> None:
    """Refuse an extension that jumps, a circle of followers, and a rope whose length is unknown or not always positive.

    `number` is the number of the section that the joint moves.
    """
    joint, key = scene.joint(number), f"sections[{number}].joint"
    chain = [scene.names[number]]
    while (follows := scene.joint(scene.names.index(chain[-1])).follows) is not None:
        allowed_names = [name for name in scene.names[1:] if name not in chain]
        if follows not in allowed_names:
            listed = f"sections that do not follow it are allowed: {', '.join(allowed_names)}"
            allowed = listed if allowed_names else "extension or overlap is needed in its place"
            if follows == scene.names[0]:
                allowed += f"; the base, {follows}, does not extend"
            raise scene_error(f"{key}.follows", joint.follows, allowed)
        chain.append(follows)
    allowed = (
        "a length is needed: it is computed only for a rope from the head of the section before the one that "
        f"{scene.names[number]} slides in, over the head of that one, which it follows with a ratio of 1"
    )
    refuse(joint.rope is not None and rope_length(scene, number) is None, f"{key}.rope.length", None, allowed)
    line = joint.line
    allowed = "0 along y is allowed: planar beams move in the vertical plane, a beam in space moves out of it"
    refuse(
        line and line[0] and is_planar(member_at(scene, number)),
        f"{key}.{joint.driver}.offset",
        line and [*line],
        allowed,
    )
    path = scene.extension(number)
    if joint.rope is not None and longest_rope(scene, number) <= 0.0:
        least = min(joint.rope.lengthens * s for s in path.bounds(0.0, scene.time.end))
        allowed = f"more than {-least:g} m is allowed: on the way it gets {-least:g} m shorter than where s = 0"
        raise scene_error(f"{key}.rope.length", joint.rope.length, allowed)
    jump = describe_jump(path, 1e-9 * max(1.0, *map(abs, path.bounds(0.0, scene.time.end))))
    refuse(jump is not None, f"{key}.extension", None, f"{scene.names[number]} {jump}")


def _check_flexible_drive(scene: Scene, number: int) -> None:
    """Refuse a rigid drive of section `number` if this section follows one with a flexible drive.

    Friction of the section's pads is refused in three cases: the section's drive changes its length; the drive is
    flexible and other sections follow this section; or this section follows one with a flexible drive.
    """
    if not has_driven_tail(member_at(scene, number)):
        return  # no drive holds the section along the boom
    key, drive, name = f"sections[{number}].joint", Drive.of_section(scene, number), scene.names[number]
    carried = rope_shares(scene)
    leads = [other for other, shares in carried.items() if name in shares and other != name]
    soft = next((leader for leader in leads if Drive.of_section(scene, scene.names.index(leader)).compliance), None)
    if soft and not drive.compliance:
        needed = "a rope with its EA, or cylinder.stiffness, is needed"
        raise scene_error(f"{key}.rope", None, f"{needed}: the rope or cylinder of {soft}, which it follows, gives way")
    rings = scene.sections[number].keyed_rings.items()
    rubs = next((ring_key for ring_key, ring in rings if isinstance(ring, JointPads) and ring.friction), "")
    hangs = soft or drive.changes_length or (drive.compliance and len(carried.get(name, ())) > 1)
    if rubs and hangs:
        allowed = f"0 is allowed: the rope or cylinder that moves {name} changes its length, "
        allowed += "or shares its flexibility with those of other sections"
        raise scene_error(f"sections[{number}].{rubs}.friction", None, allowed)


def _check_equilibrium_start(scene: Scene, number: int) -> None:
    """Refuse play of the pads of section `number` that no load takes up at t = 0.

    Only to be called for a start in equilibrium.
    """
    joint, beyond = scene.joint(number), scene.sections[number:]
    for axis, turn, faces in (("y", "rz", {"left", "right"}), ("z", "ry", {"bottom", "top"})):
        if _is_loaded_at_start(scene, beyond, axis, turn) or (axis == "y" and is_planar(member_at(scene, number))):
            continue
        for end in ("tail", "mouth"):
            rings = {k: ring for k, ring in enumerate(getattr(joint, end)) if faces & set(ring.faces or ("top",))}
            if any(" " in face for ring in getattr(joint, end) for face in ring.faces or ()):
                continue  # a load along one axis takes up the play of slanted pads along the other
            on_faces = [(ring, face) for ring in rings.values() for face in ring.faces or ("top",) if face in faces]
            if rings and all(ring.clearance_on(face) for ring, face in on_faces):
                k, ring = next(iter(rings.items()))
                allowed = (
                    f"the motion begins in equilibrium, but at t = 0 no load along {axis} takes up the play of "
                    f"{scene.names[number]}; a clearance of 0, here or in another ring, is allowed"
                )
                raise scene_error(f"sections[{number}].joint.{end}[{k}].clearance", ring.clearance, allowed)


def _is_loaded_at_start(scene: Scene, beyond: Sequence[BoomSection], axis: str, turn: str) -> bool:
    """Whether the weight or a load acts along `axis` (y or z) or about `turn` on the sections `beyond` at t = 0."""
    number, gravity, frame = "xyz".index(axis), scene.gravity, scene.frame
    turned = (
        np.eye(3) if frame is None else frame.base_rotation(np.zeros(1))[0] @ frame.rotation(0.0)[0]
    )  # from axes of the boom into those of the ground
    if gravity is not None and gravity.rise == 0.0:
        along = gravity.direction if frame is None else turned[2]
        if abs(along[number]) > SLACK:
            return True
    for load in (load for part in beyond for load in part.loads if load.signal.value(0.0)):
        if load.acts == "wind" and frame is not None:
            slewed = float(frame.angles.slewing.value(0.0)) if load.slews else 0.0
            if abs(wind_direction(turned[None], load.azimuth / frame.radian + slewed)[0, number]) > SLACK:
                return True
        elif load.axes == "ground" and load.direction in ("x", "y", "z"):
            if abs(turned["xyz".index(load.direction), number]) > SLACK:
                return True
        elif load.direction in (axis, turn):
            return True
    return False


def _check_ground_supports(scene: Scene, number: int) -> None:
    """Refuse supports along the boom of a section that travels, and pads on the ground that move.

    `number` is that of the section.
    """
    ranges = {name: path.bounds(0.0, scene.time.end) for name, path in list(scene.paths.items())[:number]}
    least = SLACK * scene.sections[number].length
    moves = next((name for name, (low, high) in ranges.items() if high - low > least), None)
    for i, support in enumerate(scene.sections[number].supports):
        if moves and "x" in support.held_directions:
            key = f"sections[{number}].supports[{i}]"
            key, value = (f"{key}.kind", support.kind) if support.directions is None else (f"{key}.directions", None)
            allowed = (
                f"directions without x are allowed, as {scene.names[number]} travels with the extension of {moves}"
            )
            raise scene_error(key, value, allowed)
    for i, ring in enumerate(scene.sections[number].pads):
        key, allowed = f"sections[{number}].pads[{i}].moving", "false is allowed, as pads that move belong to a joint"
        refuse(ring.moving, key, True, allowed)


def check_extension(scene: Scene, number: int) -> None:
    """Refuse extensions that bring section `number` behind the tail of the next outer section, or out of that section.

    The section has to reach the pads at the mouth.  Its own pads must not leave the outer section.  Pads of tail and
    mouth must not overlap on a face.

    A carriage, without pads at a mouth, may go wherever its own pads are on the next outer section (`_check_pads`).
    """
    joint, name, outer = scene.joint(number), scene.names[number], scene.names[number - 1]
    if not joint.mouth:
        return
    path = scene.extension(number)
    (first, last), length = path.bounds(0.0, scene.time.end), scene.sections[number - 1].length
    by = "overlap" if joint.overlap is not None else "follows" if isinstance(path, ScaledSignal) else "extension"
    key, slack = f"sections[{number}].joint.{by}", SLACK * length
    behind = f"the tail of {name} gets {-first:.6g} m behind that of {outer}"
    refuse(first < -BEYOND_ENDS * length, key, None, f"{behind}; an extension of 0 m or more is allowed")
    needed = max(ring.at for ring in joint.tail) + max(ring.at for ring in joint.mouth)
    out = f"an extension of {last:.6g} m pulls {name} out of {outer}"
    refuse(last >= length - slack, key, None, f"{out}; less than {length - needed:.6g} m is allowed")
    allowed = (
        f"the overlap of {name} and {outer} shrinks to {length - last:.6g} m, but their pads take up "
        f"{needed:.6g} m of it; an extension of less than {length - needed:.6g} m is allowed"
    )
    refuse(not length - last > needed + slack, key, None, allowed)
    for (i, tail), (k, mouth) in product(enumerate(joint.tail), enumerate(joint.mouth)):
        most, face = length - tail.at - mouth.at - (tail.length + mouth.length) / 2.0, _common_face(tail, mouth)
        if face is not None and last > most + slack:
            overlap = f"pads of tail[{i}] and mouth[{k}] overlap on the {face} at an extension of {last:.6g} m"
            raise scene_error(key, None, f"{overlap}; an extension of at most {most:.6g} m is allowed")
    ends = length - min(ring.at for ring in joint.mouth) - scene.sections[number].length
    before = f"at an extension of {first:.6g} m {name} does not reach a pad at the mouth of {outer}"
    refuse(first < ends - slack, key, None, f"{before}; {ends:.6g} m or more is allowed")


def _common_face(ring: JointPads, other: JointPads) -> str | None:
    """Return a face on which pads of both rings overlap across the face, with their widths counted.

    The result is None if there is no such face.
    """
    width = (ring.width + other.width) / 2.0
    for face, places in (ring.faces or {}).items():
        if any(abs(a - b) < width for a, b in product(places, (other.faces or {}).get(face, ()))):
            return str(face)
    return None


def _check_pads(scene: Scene, number: int) -> None:
    """Refuse pads that at some time are not wholly on section `number`, or are where its box tapers.

    Refuses pads without faces, too, unless the section is a planar beam and all of its pads are points.
    """
    length = scene.sections[number].length
    touching = list(seats(scene, number))
    points = [seat for seat in touching if seat.ring.faces is None]
    if points:
        key = f"sections[{points[0].joint}].joint.{points[0].key}.faces"
        allowed = "faces are needed, as pads without faces are points, which only planar beams have"
        refuse(not is_planar(member_at(scene, number)), key, None, allowed)
        if len(points) < len(touching) or scene.sections[number].pads:
            some = f"faces are needed, as other pads on {scene.names[number]} have faces"
            raise scene_error(key, None, f"{some}; on one section either all pads are points, or none")
    for seat in touching:
        half = seat.ring.length / 2.0 if seat.ring.faces is not None else 0.0
        start, end = seat.positions.low - half, seat.positions.high + half
        box, name = scene.sections[number].body.box, scene.names[number]
        first, last = (0.0, length) if box is None else box.parallel_range
        slack = BEYOND_ENDS * length
        if start < first - slack or end > last + slack:
            where = f"the whole pad has to be on it, from 0 to {length:.6g} m"
            if (first, last) != (0.0, length):
                where = f"pads are allowed where its faces are parallel to the axis, from {first:.6g} to {last:.6g} m, "
                where += "and not where the box tapers"
            allowed = f"these pads reach from {start:.6g} to {end:.6g} m along {name}; {where}"
            raise scene_error(f"sections[{seat.joint}].joint.{seat.key}.at", seat.ring.at, allowed)


def check_section(scene: Scene, number: int) -> None:
    """Check section `number` as a body of its own; raise an InputError, with keys of the scene, for the first fault."""
    part, member = scene.sections[number], member_at(scene, number)
    try:
        check_proportions(part)
        check_loads(part, scene.time.end)
        check_structure(member)
        if member.has_joint:
            check_reserved("loads", (load.name for load in part.loads), (EXTENSION,))
    except InputError as error:
        key, ring = scene.section_key(number, error.key), re.match(r"pads\[(\d+)\]", error.key)
        if ring and int(ring[1]) >= len(part.pads):  # a ring of a joint
            name = member.pads[int(ring[1])].name
            seat = next(seat for seat in seats(scene, number) if ring_name(scene, seat.ring) == name)
            key = f"sections[{seat.joint}].joint.{seat.key}{error.key[ring.end() :]}"
        raise scene_error(key, error.value, error.allowed) from None


def _check_overlaps_and_friction(scene: Scene) -> None:
    """Refuse a rigid overlap of a section that is no planar beam, and friction of pads that nothing rubs on.

    Pads rub on a section only if its model has displacements along the boom.
    """
    for number in range(1, len(scene.sections)):
        member = member_at(scene, number)
        if scene.joint(number).rigid_overlap and not is_planar(member):
            allowed = "false is allowed; only planar beams may have a rigid overlap"
            raise scene_error(f"sections[{number}].joint.rigid_overlap", True, allowed)
        for seat in seats(scene, number):
            if seat.joint == number and seat.ring.friction and not has_axial_motion(member):
                allowed = (
                    f"0 is allowed, as {scene.names[number]} has no displacements along the boom, along which pads rub"
                )
                raise scene_error(f"sections[{number}].joint.{seat.key}.friction", seat.ring.friction, allowed)


def _check_simulators(scene: Scene) -> None:
    """Refuse simulators that do not support the contacts between the scene's sections."""
    pushing = [(part.name, ring.name) for part in scene.sections for ring in part.rings if ring.unilateral]
    flexible = tuple(part.name for part in scene.sections if part.reduction.flexibility)
    needs = SimulatorNeeds(tuple(" ".join(filter(None, names)) for names in pushing), flexible_rows=flexible)
    for name in scene.simulation.simulators:
        refuse_unsupported(name, needs)
