"""Checks of one body, which raise InputError: model, loads, supports, pads and sliding points, and proportions.

Each check raises an InputError for the first key that contradicts another key of the body.  Proportions have to be such
that double precision can compute with them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from pmr.errors import BEYOND_ENDS, InputError
from pmr.scene.box import SLACK, Box
from pmr.scene.built import ENDS, WEIGHT, Face, PadRing
from pmr.scene.choice import axis_loads, inertia_fields, model_of, motion_directions, observed_places, traits_of
from pmr.scene.frame import INERTIA
from pmr.scene.joints import Joint, OneBody
from pmr.scene.members import Member
from pmr.scene.model_traits import MODELS, model_traits
from pmr.scene.signals import SignalBase
from pmr.scene.structures import ALLOWED_INERTIA, is_inertia

#: Most elements of a beam in space: round-off in its stiffness grows with the fourth power of their number, and these
#: leave two digits of the lowest frequency.
MOST_ELEMENTS = 5000


def check_structure(member: Member) -> None:
    """Raise an InputError for the first key of a body, or of something on the body, that contradicts another key."""
    _check_body(member)
    check_names("pads", (name for ring in member.pads for name, _, _ in ring.named_pads))
    for key in ("loads", "masses", "probes"):
        check_names(key, (part.name for part in getattr(member.part, key)))
    # masses on planar beams turn about y alone
    for i, mass in enumerate(() if traits_of(member).is_planar else member.part.masses):
        refuse(not is_inertia(mass.inertia), f"masses[{i}].inertia", list(mass.inertia), ALLOWED_INERTIA)
    fields = (INERTIA + field for field in inertia_fields(member))
    check_reserved("loads", (load.name for load in member.part.loads), (WEIGHT, *fields))
    _check_ground_loads(member)
    _check_points_wind_and_temperatures(member)
    check_names("loads", (load.name for load in axis_loads(member)))
    check_names("supports", (support.row_name(d) for support in member.part.supports for d in support.held_directions))
    for i, ring in enumerate(member.pads):
        refuse(ring.clearance_fault, f"pads[{i}].clearance", ring.clearance, ring.clearance_fault)
    _check_travel(member)
    _check_pads(member)
    _check_places(member)
    _check_sliding_points(member)
    _check_probe_faces(member)
    if not (member.signals or member.frame):
        raise scene_error("loads", None, "a load or [gravity] is allowed: nothing moves the structure")


def _check_ground_loads(member: Member) -> None:
    """Refuse loads along axes of the ground without a frame, or on a body that does not move along x.

    Moments about axes of the ground are refused, too.
    """
    for i, load in enumerate(member.part.loads):
        if load.axes == "body":
            continue
        refuse(member.frame is None, f"loads[{i}].axes", load.axes, "'body' is allowed without a frame that moves")
        if load.direction.startswith("r"):
            raise scene_error(f"loads[{i}].direction", load.direction, "x, y and z are allowed with axes = 'ground'")
        if "x" not in motion_directions(member):
            raise scene_error(f"loads[{i}].axes", load.axes, "'body' is allowed without body.profile.axial = true")


def _check_points_wind_and_temperatures(member: Member) -> None:
    """Check points of loads, wind and temperatures of a section; raise InputError with the key of the first fault.

    A load's point is refused on a planar beam.  Wind and temperatures are refused without `depth` if the body has no
    box or one that varies along it.  Wind is also refused on matrices, without [frame], and from the side on a planar
    beam; a temperature is refused on a body that is no beam, and together with probes that measure more than
    displacements.
    """
    box, traits, frame = member.part.body.box, traits_of(member), member.frame
    varies = box is not None and bool(box.varying_keys)
    for i, load in enumerate(member.part.loads):
        if load.point is not None and traits.is_planar:
            allowed = "a model in space is allowed with a point beside it"
            raise scene_error(f"loads[{i}].point", list(load.point), allowed)
        if load.acts == "force":
            continue
        bears = traits.is_beam or load.acts == "wind" and traits.has_cells
        refuse(not bears, f"loads[{i}].acts", load.acts, f"'force' is allowed on {traits.words}")
        if load.acts == "wind" and frame is None:
            raise scene_error(f"loads[{i}].acts", "wind", "'force' is allowed without [frame], which says where up is")
        if frame is not None and traits.is_planar and load.blows_sideways(frame.unit):
            allowed = "0 or half a turn is allowed on a planar beam, which side wind does not move"
            raise scene_error(f"loads[{i}].azimuth", load.azimuth, allowed)
        allowed = "the distance of the faces is needed on a body without a box, or with one that varies along it"
        refuse(load.depth is None and (box is None or varies), f"loads[{i}].depth", None, allowed)
        for k, probe in enumerate(member.part.probes if load.acts == "temperature" else ()):
            allowed = (
                "displacement is allowed beside a temperature: [recovery] has stresses of beams without its strain"
            )
            refuse(set(probe.measures) - {"displacement"}, f"probes[{k}].measures", list(probe.measures), allowed)


def _check_places(member: Member) -> None:
    """Raise an InputError if a load, support, mass or observed place is not on the body, or can't be on its model.

    A model other than a beam also needs observed places, and ``observe.end`` must not be less than ``observe.start``.
    """
    observe, length = member.part.observe, member.part.body.length
    observed_places(member)  # refuses models whose places are not known
    places = [(f"loads[{i}].on", load.on) for i, load in enumerate(member.part.loads)]
    places += [(f"supports[{i}].on", of.on) for i, of in enumerate(member.part.supports) if of.points == "mean"]
    places += [(f"masses[{i}].on", mass.on) for i, mass in enumerate(member.part.masses)]
    if observe.start is not None and observe.end is not None:
        if observe.end < observe.start:
            raise scene_error("observe.end", observe.end, f"observe.start = {observe.start:g} m or more is allowed")
        places += [("observe.start", observe.start), ("observe.end", observe.end)]
    for i, mass in enumerate(member.part.masses):
        if mass.at is not None and traits_of(member).is_planar:
            allowed = (
                "none is allowed on a planar beam, whose masses are at `on`, on its axis; a model in space has one"
            )
            raise scene_error(f"masses[{i}].at", list(mass.at), allowed)
        if not isinstance(mass.on, str) and mass.coupling == "rigid":
            raise scene_error(f"masses[{i}].coupling", "rigid", "'average' is allowed at a place along the body")
    for key, at in places:
        if traits_of(member).is_beam and isinstance(at, str) and at not in ENDS:
            raise scene_error(key, at, f"tail, tip or a number from 0 to {length or 0.0:g} m is allowed on a beam")
        if length is not None and not isinstance(at, str) and not -1e-9 * length <= at <= (1.0 + 1e-9) * length:
            raise scene_error(key, at, f"on the body, 0 to {length:g} m, is allowed")


def _check_sliding_points(member: Member) -> None:
    """Refuse sliding points on a model other than a planar beam, beside moving pads, off the body, or at a support.

    Two points with the same offset are refused, too.  A body without sliding points passes.
    """
    length = member.part.body.length
    if not member.points:
        return
    allowed = "leave it out, as each ring of pads has its place in `at`"
    refuse(any(ring.moving for ring in member.pads), "slider.offsets", list(member.points), allowed)
    if not traits_of(member).is_planar or length is None:
        raise scene_error("pads", None, "at least one ring of pads with moving = true is needed, as nothing slides")
    if len(set(member.points)) != len(member.points):
        raise scene_error("slider.offsets", list(member.points), "sliders must not share an offset")
    (low, high), slack = member.bounds, SLACK * length
    supports = () if member.carries_carriages else member.part.supports  # a carriage's wheel has a row of its own there
    held = [member.part.position_of(support.on) for support in supports if "z" in support.held_directions]
    for offset in member.points:
        which = f" (offset {offset:g} m)" if offset else ""
        for s in (low + offset, high + offset):
            allowed = f"the slider reaches {s:g} m{which}; on the beam, 0 to {length:g} m, is allowed"
            refuse(not -BEYOND_ENDS * length <= s <= (1.0 + BEYOND_ENDS) * length, "slider.path", None, allowed)
        for at in held:
            if at is not None and low + offset - slack <= at <= high + offset + slack:
                allowed = (
                    f"the slider reaches the support at {at:g} m{which}; "
                    "a path is allowed that keeps clear of supports, as both would hold the same point"
                )
                raise scene_error("slider.path", None, allowed)


def _check_travel(member: Member) -> None:
    """Refuse a travel of sliding points, or one that does not contain the slider's path."""
    slider = member.part.slider
    if slider is None or slider.travel is None:
        return
    (low, high), (first, last) = slider.travel, member.bounds
    refuse(member.points, "slider.travel", [low, high], "leave it out, as points may slide along the whole beam")
    slack = BEYOND_ENDS * (high - low)
    allowed = f"two places in m, the smaller one first, around the path's {first:.6g} to {last:.6g} are allowed"
    refuse(not low < high or first < low - slack or last > high + slack, "slider.travel", [low, high], allowed)


def _check_body(member: Member) -> None:
    """Refuse a body whose keys, with those of its mesh, contradict each other or its model."""
    body, file, model = member.part.body, member.part.mesh.file, model_of(member)
    traits = model_traits(model)
    if body.mover is not None or traits.kind == "mass":
        return _check_mover(member)
    if body.profile is not None and model != "beam2d":
        raise scene_error("body.model", model, "auto or beam2d is allowed with body.profile")
    if body.profile is None and (body.box is None) == (file is None):
        raise scene_error("body.box", None, "a box, a profile or mesh.file, one of them is allowed")
    if file is not None and traits.is_beam and body.profile is None:
        raise scene_error("mesh.file", str(file), "a beam of a box is divided into mesh.elements; others read files")
    if file is not None and body.model == "auto" and body.profile is None:
        raise scene_error("body.model", "auto", "shell or solid is allowed for a mesh that is read")
    if traits.kind == "matrices" and file is None:
        raise scene_error("mesh.file", None, "body.model = 'matrices' needs a file that pmr matrices wrote")
    if traits.kind == "matrices" and member.scene.recovery is not None:
        raise scene_error("recovery", None, "given matrices have no cells and no stresses: leave it out")
    if file is not None and model == "shell" and body.thickness is None:
        raise scene_error("body.thickness", None, "a thickness in m is needed for a shell that is read")
    if body.section is not None and body.model != "beam3d":
        raise scene_error("body.section", None, "a section goes with body.model = 'beam3d'")
    if body.section is not None and body.shear and None in (body.section.shear_area_y, body.section.shear_area_z):
        allowed = "shear_area_y and shear_area_z in m^2 are needed, or body.shear = false"
        raise scene_error("body.section", None, allowed)
    if body.walls == "give":
        _check_flexible_walls(member)
    if body.box is not None:
        _check_box_variation(member, body.box)
    for name, region in body.regions.items():
        refuse(traits.is_beam, f"body.regions.{name}", None, "leave it out, as only shells and solids have regions")
        if model == "solid" and region.thickness is not None:
            raise scene_error(f"body.regions.{name}.thickness", region.thickness, "a solid has none")
    if traits.is_beam and not traits.is_planar and member.part.mesh.elements > MOST_ELEMENTS:
        allowed = f"at most {MOST_ELEMENTS} are allowed for {model}"
        raise scene_error("mesh.elements", member.part.mesh.elements, allowed)
    allowed = "1 is allowed: elements of beam2d alone can be graded"
    refuse(member.part.mesh.grading != 1.0 and model != "beam2d", "mesh.grading", member.part.mesh.grading, allowed)
    if member.part.reduction.positions == "nodes" and member.part.reduction.uses_pod and not traits.is_beam:
        allowed = "'path' or a list of places in m is allowed, as only beams have nodes along their axis"
        raise scene_error("reduction.positions", "nodes", allowed)
    if traits.is_planar:
        _check_planar_beam(member)


def check_wheel(joint: Joint | None, prefix: str) -> None:
    """Refuse a mover whose joint is None or no wheel; `prefix` stands before the keys of the mover.

    A wheel is a single ring without faces at the tail itself, and has no pads at a mouth.  What drives it has no
    offset.
    """
    if joint is None or joint.mouth or len(joint.tail) > 1 or joint.tail[0].at or joint.tail[0].faces:
        allowed = "a joint with one ring in `tail`, at = 0 and without faces, is needed: the wheel"
        raise scene_error(f"{prefix}body.mover", None, allowed)
    allowed = "none is allowed on a mover, which does not turn"
    refuse(joint.line, f"{prefix}joint.{joint.driver}.offset", joint.line and [*joint.line], allowed)


def _check_mover(member: Member) -> None:
    """Refuse a mover that runs on nothing, and all keys that a mover can't have.

    A table of a mover is refused beside another model, and the model ``mover`` without such a table.  Beside a mover, a
    frame and a recovery are refused, too.
    """
    part = member.part
    refuse(part.body.mover is None, "body.mover", None, "a table with the mass is needed with body.model = 'mover'")
    refuse(traits_of(member).kind != "mass", "body.model", part.body.model, "auto or mover is allowed with body.mover")
    check_wheel(part.joint, "")
    for key in ("masses", "pads", "probes", "supports"):
        refuse(getattr(part, key), key, None, "none is allowed on a mover, which has a mass and a wheel alone")
    for i, load in enumerate(part.loads):
        refuse(load.direction != "z", f"loads[{i}].direction", load.direction, "z is allowed on a mover")
    for key in ("thickness", "regions", "section"):
        refuse(getattr(part.body, key), f"body.{key}", None, "none is allowed on a mover, which has no walls")
    refuse(part.mesh.file, "mesh.file", str(part.mesh.file), "none is allowed on a mover, which has no mesh")
    refuse(part.body.walls == "give", "body.walls", "give", "'rigid' is allowed on a mover, which has no walls")
    if member.frame is not None:
        raise scene_error("frame", None, "none is allowed beside a mover, whose motion in a frame is not computed")
    if member.scene.recovery is not None:
        raise scene_error("recovery", None, "none is allowed beside a mover, which has no cells to draw")


def _check_box_variation(member: Member, box: Box) -> None:
    """Refuse a box that varies along x or has frames, together with models and keys that can't represent this."""
    model, traits, key = model_of(member), traits_of(member), "body.box." + " and ".join(box.varying_keys)
    if box.varying_keys and not traits.may_vary:
        *varying, last = (name for name, other in MODELS.items() if other.may_vary)
        raise scene_error("body.model", model, f"{', '.join(varying)} and {last} are allowed with {key}")
    if box.varying_keys and member.part.body.section is not None:
        raise scene_error("body.section", None, f"none is allowed with {key}, which says what the section is")
    allowed = f"1 is allowed with {key}, which says where nodes are"
    refuse(box.varying_keys and member.part.mesh.grading != 1.0, "mesh.grading", member.part.mesh.grading, allowed)
    if box.frames and traits.is_planar:  # also frames from a file that this one extends: their mass would be missing
        allowed = "beam3d and shell are allowed with body.box.frames; frames = [] removes the frames"
        raise scene_error("body.model", model, allowed)
    if box.frames:
        _check_frames(box)


def _check_frames(box: Box) -> None:
    """Refuse frames that are not in order within the box or do not fit into its profile."""
    places = (0.0, *box.frames, box.length)
    allowed = f"ascending places within 0 and {box.length:g} m are allowed"
    refuse(any(b <= a for a, b in pairwise(places)), "body.box.frames", list(box.frames), allowed)
    radii = [side.radius for side in box.sides if side.centre is not None]
    room = min(radii, default=min(box.width, box.height) / 2.0)
    if box.frame_depth != "full" and not 0.0 < box.frame_depth < room:
        what = "the radius of the corners" if radii else "half the smaller side"
        allowed = f"more than 0 and less than {room:g} m ({what}), or 'full', is allowed"
        raise scene_error("body.box.frame_depth", box.frame_depth, allowed)


def _check_flexible_walls(member: Member) -> None:
    """Refuse walls that give way on a body without a box, and on a beam without pads on faces.

    Such walls are refused, too, on a beam of a model for which their compliance is not computed.
    """
    box, key = member.part.body.box, "body.walls"
    refuse(box is None, key, "give", "'rigid' is allowed, as without body.box the thickness of the walls is not known")
    traits = traits_of(member)
    if not traits.is_beam:
        return  # the walls of these models give way anyway
    allowed = f"'rigid' is allowed, as the walls of {model_of(member)} are not computed"
    refuse(not traits.walls_may_give, key, "give", allowed)
    allowed = "'rigid' is allowed, as walls give way only under pads with faces, and there are none"
    refuse(member.points or not member.pads, key, "give", allowed)


def _check_planar_beam(member: Member) -> None:
    """Refuse loads, pads and weight that a planar beam can't feel, as its points move along x and z and about y alone.

    A tension is refused unless rigid supports hold both ends.
    """
    held = {s.on for s in member.part.supports if s.stiffness == "rigid" and "z" in s.held_directions}
    profile = member.part.body.profile
    if profile is not None and profile.tension and (not {"tail", "tip"} <= held or profile.axial):
        allowed = "0 is allowed unless rigid supports hold tail and tip along z, and axial = false"
        raise scene_error("body.profile.tension", profile.tension, allowed)
    planar_directions = motion_directions(member)
    for i, load in enumerate(member.part.loads):
        if load.direction not in planar_directions:
            allowed = f"{', '.join(planar_directions[:-1])} and {planar_directions[-1]} are allowed for beam2d, z is up"
            if load.direction == "x":
                allowed = "an axial load needs body.profile.axial = true"
            raise scene_error(f"loads[{i}].direction", load.direction, allowed)
    slanted = [f"pads[{i}].faces.{face}" for i, ring in enumerate(member.pads) for face in ring.faces if " " in face]
    if slanted:
        allowed = "bottom, top, left and right are allowed for beam2d, or body.model = 'beam3d'"
        raise scene_error(slanted[0], None, allowed)
    moving = [ring for ring in member.pads if ring.moving]
    allowed = "a ring with moving = true at bottom or top is needed, as pads on the sides do not hold a planar beam"
    refuse(moving and not any({"bottom", "top"} & set(ring.faces) for ring in moving), "pads", None, allowed)
    if member.gravity is not None and member.gravity.direction[1] != 0.0:
        raise scene_error("gravity.direction", list(member.gravity.direction), "x and z are allowed for beam2d")


def _check_pads(member: Member) -> None:
    """Refuse pads that are not on their face, or that leave the face at any time.

    Faces of a mesh file are checked with the mesh.
    """
    length, box = member.part.body.length, member.part.body.box
    for i, ring in enumerate(member.pads):
        if length is not None:
            _check_pad_range(member, length, ring, f"pads[{i}].at")
        for place in ring.named_pads:
            if box is not None:
                _check_pad_width(box, ring, place, f"pads[{i}].faces.{place[1]}")


def _check_pad_range(member: Member, length: float, ring: PadRing, key: str) -> None:
    """Refuse a ring of pads with the key `key` that leaves its faces along the axis at some position of the slider.

    `length` is that of the body in m.
    """
    low, high = member.travel if ring.moving else (0.0, 0.0)
    start, end = low + ring.at - ring.length / 2.0, high + ring.at + ring.length / 2.0
    slack, box = SLACK * length, member.part.body.box
    first, last = (0.0, length) if box is None else box.parallel_range
    if start >= first - slack and end <= last + slack:
        return
    name, face, _ = ring.named_pads[0] if ring.named_pads else (ring.name, "any", 0.0)
    while_moving = f" as s goes from {low:.6g} to {high:.6g} m" if ring.moving else ""
    allowed = (
        f"the pad {name} reaches from {start:.6g} to {end:.6g} m along the axis{while_moving}; "
        f"the whole pad has to be on the face {face}, from {first:.6g} to {last:.6g} m"
        + ("; where the box tapers, its faces are not parallel to the axis" if (first, last) != (0.0, length) else "")
    )
    slider = member.part.slider
    refuse(ring.moving, "slider.travel" if slider and slider.travel else "slider.path", None, allowed)
    raise scene_error(key, ring.at, allowed)


def _check_probe_faces(member: Member) -> None:
    """Refuse a probe of stress on a face that the model of a box lacks.

    A body without a box passes: only its model knows its faces.
    """
    box = member.part.body.box
    faces = () if box is None else traits_of(member).probe_faces(box)
    for i, probe in enumerate(member.part.probes):
        if faces and probe.face not in ("", *faces) and set(probe.measures) - {"displacement"}:
            raise scene_error(f"probes[{i}].face", probe.face, f"{', '.join(faces)} are allowed")


def _check_pad_width(box: Box, ring: PadRing, place: tuple[str, Face, float], key: str) -> None:
    """Refuse a pad with the key `key` that is not within a flat face.

    `place` is the name of the pad, its face and its coordinate across the face in m.
    """
    name, face, across = place
    faces = box.faces
    offered = f"{', '.join(faces)} are allowed, which are flat" if faces else "no pads are allowed: nothing is flat"
    refuse(face not in faces, key, None, f"this profile has no flat face {face}: {offered}")
    (low, high), slack = faces[face].span, SLACK * max(box.width, box.height)
    start, end = across - ring.width / 2.0, across + ring.width / 2.0
    if low - slack <= start and end <= high + slack:
        return
    allowed = (
        f"the pad {name} reaches from {start:.6g} to {end:.6g} m across; "
        f"the flat face {face} offers {low:.6g} to {high:.6g} m, all of a pad has to be on it"
    )
    raise scene_error(key, across, allowed)


def check_names(key: str, names: Iterable[str]) -> None:
    """Raise an InputError of the key `key` if two of the names are equal."""
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise scene_error(key, twice[0], "names that differ are allowed")


def check_reserved(key: str, names: Iterable[str], reserved: Iterable[str]) -> None:
    """Raise an InputError if one of the names in the list with the key `key` is reserved for an input that pmr adds."""
    allowed = "another name is allowed: this one is that of an input built in"
    for i, name in enumerate(names):
        refuse(name in reserved, f"{key}[{i}].name", name, allowed)


def scene_error(key: str, value: object, allowed: str) -> InputError:
    """Return the error of a key of a scene with this value (None: it is not shown); `allowed` says what is allowed.

    The reader of the file adds the file's name.
    """
    return InputError("scene", key, value, allowed)


def refuse(when: object, key: str, value: object, allowed: str) -> None:
    """Raise the `scene_error` of a key, its value and what is allowed if `when` is true."""
    if when:
        raise scene_error(key, value, allowed)


#: Allowed ratios of a box: length over smaller side, and smaller side over wall.
SLENDER, THIN = (0.01, 1e4), (0.0, 1e4)
#: Allowed ratios of a beam's length to the radius of gyration of its section.
GYRATION = (0.01, 1e6)
LARGEST_LOAD = 1e120  # N or N m; models are linear in it, their energies are its squares


def check_loads(part: OneBody, end: float) -> None:
    """Refuse loads that are too large for double precision at any time from 0 to `end` in s."""
    for i, load in enumerate(part.loads):
        with np.errstate(all="ignore"):
            largest = float(np.abs(load.signal.bounds(0.0, end)).max())
        allowed = f"at most {LARGEST_LOAD:g} N or N m are allowed, here it is {largest:.3g}"
        refuse(not largest <= LARGEST_LOAD, f"loads[{i}].signal", None, allowed)


def check_proportions(part: OneBody) -> None:
    """Refuse dimensions of a body in proportions with which double precision can't compute."""
    box, section, profile = part.body.box, part.body.section, part.body.profile
    if profile is not None and profile.axial_stiffness is not None:
        radius = float(np.sqrt(profile.bending_stiffness / profile.axial_stiffness))
        slender = profile.length / radius
        _check_ratio("body.profile.axial_stiffness", slender, GYRATION, "length over radius of gyration")
    if box is not None:
        side = min(box.width, box.height)
        _check_ratio("body.box.length", box.length / side, SLENDER, "length over the smaller side")
        _check_ratio("body.box.width", box.width / box.height, (1e-3, 1e3), "width over height")
        _check_ratio("body.box.wall", side / min(box.walls.values()), THIN, "the smaller side over the wall")
        if section is not None:
            for name in ("second_moment_y", "second_moment_z", "torsion_constant"):
                slender = box.length / float(np.sqrt(getattr(section, name) / section.area))
                _check_ratio(f"body.section.{name}", slender, GYRATION, "length over radius of gyration")


def _check_ratio(key: str, ratio: float, allowed: tuple[float, float], what: str) -> None:
    """Refuse a ratio outside of the range `allowed`, with the key `key`; `what` names the ratio in the message."""
    ratio_allowed = f"a ratio of {what} from {allowed[0]:g} to {allowed[1]:g} is allowed, here it is {ratio:.3g}"
    refuse(not allowed[0] <= ratio <= allowed[1], key, None, ratio_allowed)


def describe_jump(path: SignalBase, least: float) -> str | None:
    """Return a description of a path's first jump by more than `least`, both in m; None if there is no such jump."""
    at = np.array(path.breaks)
    # All at once: one call costs as much as the signal has knots, and a file of them has thousands.
    before, after = path.value(np.nextafter(at, -np.inf)), path.value(at)
    for k in np.flatnonzero(np.abs(after - before) > least):
        return f"jumps from {before[k]:g} m to {after[k]:g} m at {at[k]:g} s; continuous paths are allowed"
    return None
