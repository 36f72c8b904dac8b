r"""Forces between a boom and the ground, terms of a moving frame, and ropes that move sections.

Contacts with the ground: force and moment about the frame's pivot per unit of the force of each contact.

A moving frame has the angular velocity :math:`\omega` and the angular acceleration :math:`\alpha`, with components
along the axes j, k.  To the equations of small motions with the coordinates q and the mass M it adds the terms

.. math::
    2 \omega_k T_k \dot q + \alpha_k T_k q + (\omega_j \omega_k N_{jk} - |\omega|^2 M)\, q + \sum_j P_j(t)\, K_{g,j}\, q

with :math:`M = N_{xx} + N_{yy} + N_{zz}` and the matrices T, N and :math:`K_g` of `pmr.system.body_matrices`.  Each
term is named here with its bodies and its matrix.  The axial forces :math:`P_j` come from a section's own acceleration
along the boom, :math:`a_x + A_{xx} x` at the distance x from its tail, from a load along x at its tip, and from
cylinders between two tails.  A cylinder of length l that pushes with F has the potential :math:`-F/(2 l)\, (w_i -
w_o)^2` with the transverse displacements :math:`w_i` and :math:`w_o` of the inner and the outer tail.  F accelerates
everything that the cylinder carries, against the loads along x on it.

Ropes or chains: a rope from the head of section k - 2 over a sheave at the head of section k - 1 to the tail of section
k has the length l and the stiffness c

.. math:: l = (s_{k-1} + L_{k-1} - L_{k-2}) + (L_{k-1} - s_k), \qquad c = z\, EA / l

with the extensions s, the sections' lengths L and z strands of the stiffness EA.  Section k goes as far as section k -
1 does, apart from a constant :math:`s_k - s_{k-1}`, so that l and the stiffness are constant.  Any other rope, from a
winch for example, has the length :math:`l = l_0 + l' s_k` with :math:`l_0` and :math:`l'` from its keys.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pmr.files.arrays import Array
from pmr.scene.built import Support, force_name, reaction_name
from pmr.scene.choice import axis_loads, has_axial_motion, has_driven_tail, motion_directions, transverse_axes
from pmr.scene.cylinder import LuffingCylinder
from pmr.scene.keys import LUFFING, LUFFING_CYLINDER, SLIDER, cylinder_name, qualified_name
from pmr.scene.members import Member, member_at, members
from pmr.scene.scene import Scene

#: Prefixes of the names of force and moment at the pivot and on the ground; names of the luffing moment and of the
#: cylinder's force.
AT_PIVOT, AT_GROUND, MACHINE = "pivot", "ground", "machine"
#: Prefix of the names of margins against tipping over an edge of the support polygon.
TIPPING_MARGIN = "tipping margin over "
MOMENT, CYLINDER = reaction_name(f"{AT_PIVOT} ry"), reaction_name(f"{AT_PIVOT} cylinder")
#: Greatest distance in m between a support and the lug of the cylinder it stands for, and between a pin and the pivot.
NEAR = 1e-6
#: Axis and sign of the outward normal of the faces that every body has.
OUTWARDS = {"bottom": ("z", -1.0), "top": ("z", 1.0), "left": ("y", 1.0), "right": ("y", -1.0)}


@dataclass(frozen=True)
class ContactWrench:
    """Force and moment (T, 6) on the ground per unit of the force of a contact between a body and the ground.

    Force and moment are along the boom's axes and about the frame's pivot, at T times.  In the results of a run the
    force has one of the `names`.  If `names` is empty, only a mesh file knows where the contact is, and `wrench` has no
    meaning.
    """

    names: tuple[str, ...]
    wrench: Array


def ground_contact_wrenches(scene: Scene, along: Mapping[str, Array]) -> list[ContactWrench]:
    """Return force and moment on the ground for each contact between a body and the ground.

    `along` are the scene's paths by name at T times: (T,) m, and the luffing angle (T,) rad if a cylinder has a
    stiffness.
    """
    return [pressed for member in members(scene) for pressed in _body_wrenches(scene, member, along)]


@dataclass(frozen=True)
class PinAndCylinder:
    """The rigid pin of a base, and the support across the boom that stands for the luffing cylinder.

    `pin` are the names of the pin's forces along x and z.  `stand_in` is the support across the boom, and `across` are
    the names that its force may have.  `offset` is the place of the pin in m, x and z from the pivot.
    """

    pin: tuple[str, str]
    across: tuple[str, ...]
    stand_in: Support
    offset: tuple[float, float]


def supports_at_lug(scene: Scene) -> tuple[Support, ...]:
    """Return the base's supports along z alone at the luffing cylinder's lug; empty without a cylinder."""
    if scene.frame is None or scene.frame.cylinder is None:
        return ()
    part, lug = members(scene)[0].part, scene.frame.cylinder.lug[0] - scene.frame.tail_position[0]
    places = {k: part.position_of(of.on) for k, of in enumerate(part.supports) if of.held_directions == ("z",)}
    return tuple(part.supports[k] for k, x in places.items() if x is not None and abs(x - lug) <= NEAR)


def cylinder_force_names(scene: Scene) -> tuple[str, ...]:
    """Return the names under which results may store the force of a luffing cylinder with a stiffness."""
    return _force_names(scene.names[0], LUFFING_CYLINDER)


def pin_and_cylinder(scene: Scene) -> PinAndCylinder | None:
    """Return a base's pin and the support that stands for the luffing cylinder; None unless these two alone hold it.

    The pin consists of rigid supports along x and along z at one place of the base.  The other support is the only
    further one that holds z; it is at the cylinder's lug, or else holds z alone.  The result is None if the base has a
    further support along x or z or about y, a pad or a sliding point.  It is None, too, for a scene without a luffing
    cylinder, or with one that holds the base by its own stiffness.  The model may have its pin away from the pivot,
    about which a real boom turns.
    """
    base, at_lug = members(scene)[0], supports_at_lug(scene)
    if scene.frame is None or scene.frame.cylinder is None or scene.holding_cylinder is not None:
        return None
    if base.part.pads or (base.points and not base.has_joint):
        return None
    rows = {d: [of for of in base.part.supports if d in of.held_directions] for d in ("x", "z", "ry")}
    if [len(rows[d]) for d in ("x", "z", "ry")] != [1, 2, 0]:
        return None
    stand_ins = [of for of in rows["z"] if of in at_lug] or [of for of in rows["z"] if of.held_directions == ("z",)]
    if len(stand_ins) != 1:
        return None
    along, across = rows["x"][0], next(of for of in rows["z"] if of != stand_ins[0])
    places = [base.part.position_of(of.on) for of in (along, across)]
    if places[0] is None or places[0] != places[1] or {along.stiffness, across.stiffness} != {"rigid"}:
        return None
    name, tail = scene.names[0], scene.frame.tail_position
    x, z = (reaction_name(qualified_name(name, of.row_name(d))) for of, d in ((along, "x"), (across, "z")))
    names = _force_names(name, stand_ins[0].row_name("z"))
    return PinAndCylinder((x, z), names, stand_ins[0], (places[0] + tail[0], tail[2]))


def _body_wrenches(scene: Scene, member: Member, along: Mapping[str, Array]) -> Iterator[ContactWrench]:
    """Yield force and moment on the ground for each contact of one body with the ground.

    `along` are the coordinates (T,) of paths by name at T times, as in `ground_contact_wrenches`.
    """
    body, moves = scene.names[member.number], motion_directions(member)
    count = len(next(iter(along.values())))
    travelled = np.zeros(count) if member.has_joint else along[SLIDER]
    tail = np.array(scene.frame.tail_position if scene.frame else (0.0, 0.0, 0.0)) + np.zeros((count, 3))
    for name in scene.names[1 : member.number + 1]:
        tail[:, 0] += along[name]
    if member.cylinder is not None:
        yield _cylinder_wrench(body, member.cylinder, along[LUFFING])
    for support in member.part.supports:
        at = member.part.position_of(support.on)
        for held in support.held_directions:
            if at is None:
                yield ContactWrench((), tail)  # a position that only a mesh file defines
            elif held in moves:
                place = tail + [at, 0.0, 0.0]
                yield ContactWrench(_force_names(body, support.row_name(held)), _wrench(place, held))
    for ring in member.part.pads:
        for name, face, across in ring.named_pads:
            place = tail + [ring.at, 0.0, 0.0]
            place[:, 0] += travelled * ring.moving
            if face in OUTWARDS:
                direction, sign = OUTWARDS[face]
                place[:, 1 if direction == "z" else 2] += across
                if direction in moves:
                    yield ContactWrench(_force_names(body, name), sign * _wrench(place, direction))
                continue
            box = member.part.body.box
            if box is None:
                yield ContactWrench((), tail)  # a face that only a mesh file defines
                continue
            side = box.faces[face]
            place[:, 1:] += across * side.across_direction
            yield ContactWrench(
                _force_names(body, name), sum(n * _wrench(place, d) for n, d in zip(side.normal, "yz", strict=True))
            )
    for name, ahead in zip(member.point_names, member.points, strict=True) if not member.has_joint else ():
        place = tail + np.outer(travelled + ahead, [1.0, 0.0, 0.0])
        yield ContactWrench(_force_names(body, name), _wrench(place, "z"))


def _cylinder_wrench(body: str, cylinder: LuffingCylinder, angle: Array) -> ContactWrench:
    """Return force and moment on the ground per unit of a luffing cylinder's force, at luffing angles (T,) in rad.

    `body` is the name of the base, `angle` are the angles.  The force on the ground points from lug to foot: a cylinder
    that pushes the boom up pushes the ground down.
    """
    wrench = np.zeros((len(angle), 6))
    wrench[:, [0, 2]] = -cylinder.direction(angle)
    wrench[:, 3:] = np.cross(np.array([cylinder.lug[0], 0.0, cylinder.lug[1]]), wrench[:, :3])
    return ContactWrench(_force_names(body, LUFFING_CYLINDER), wrench)


def _force_names(body: str, what: str) -> tuple[str, ...]:
    """Return the names that a force between a body and the ground may have; `what` is the force's name at the body.

    They are its names as an output of the body, as a contact of the system, and as the reaction of a rigid support.
    """
    return (
        qualified_name(body, force_name(what)),
        force_name(f"{body} {what}"),
        reaction_name(qualified_name(body, what)),
    )


def _wrench(place: Array, direction: str) -> Array:
    """Return force and moment (T, 6) about the pivot by a unit force or moment at `place`.

    `place` (T, 3) in m is relative to the pivot.  The unit force is along ``x``, ``y`` or ``z``, and the unit moment
    about the axis of ``rx``, ``ry`` or ``rz``, as `direction` says.
    """
    axis, wrench = np.eye(3)["xyz".index(direction[-1])], np.zeros((len(place), 6))
    if direction.startswith("r"):
        wrench[:, 3:] = axis
    else:
        wrench[:, :3], wrench[:, 3:] = axis, np.cross(place, axis)
    return wrench


#: Matrix of axial forces per unit of a section's acceleration, by the field of the acceleration.
FIELD_MATRICES = {"x": "axial uniform", "xx": "axial linear"}


@dataclass(frozen=True)
class FrameTerm:
    """A term of the moving frame's equations: its name, the bodies on which it acts, and its matrix."""

    name: str
    bodies: tuple[str, ...]  # one body, or the inner and the outer body of a cylinder
    matrix: str  # name of a matrix of the body; of a cylinder: of the body `carried_section`
    kind: str  # `rotation`, `turning`, `carried`, `field`, `load`, `cylinder` (inertia) or `cylinder load`
    component: str  # axis of a rotation; axes ``xz`` of `carried`; a field; the name of a load
    number: int = 0  # index of the section that is accelerated
    carried_section: str = ""  # name of the section that a cylinder carries


#: Kinds of terms that change the stiffness by axial forces, and all that change it.
AXIAL = ("field", "load", "cylinder", "cylinder load")
STRESSES = (*AXIAL, "carried")


def frame_terms(scene: Scene) -> Iterator[FrameTerm]:
    """Yield all terms of a scene's moving frame; none without a frame or without second order."""
    if scene.frame is not None and scene.frame.second_order:
        yield from _all_terms(scene)


def stress_terms(scene: Scene) -> Iterator[FrameTerm]:
    """Yield the terms that change the stiffness, whether the frame has second order or not; none without a frame."""
    if scene.frame is not None:
        yield from (term for term in _all_terms(scene) if term.kind in STRESSES)


def _all_terms(scene: Scene) -> Iterator[FrameTerm]:
    """Yield the terms of each section, then the terms of cylinders between the tails of sections."""
    for member in members(scene):
        yield from _section_terms(scene, member)
    for number, member in enumerate(members(scene)):
        if number and has_driven_tail(member):
            for beyond in range(number, len(scene.sections)):
                for field in _field_matrices(scene):
                    yield _cylinder_term(scene, number, beyond, field)
                axial = [load.name for load in axis_loads(member_at(scene, beyond)) if load.direction == "x"]
                for load in axial:
                    yield replace(_cylinder_term(scene, number, beyond, load), kind="cylinder load")


def _field_matrices(scene: Scene) -> dict[str, str]:
    """Return the name of a body's matrix for each field of axial acceleration in a frame, by the field's name.

    A frame without an angle has only the uniform field ``x``.
    """
    return FIELD_MATRICES if scene.frame is not None and scene.frame.has_angles else {"x": FIELD_MATRICES["x"]}


def _section_terms(scene: Scene, member: Member) -> Iterator[FrameTerm]:
    """Yield the terms of one section: rotation, inertia, acceleration along the boom and loads at the tip."""
    body, frame = scene.names[member.number], scene.present_frame
    slews, turns = frame.out_of_plane_key is not None, frame.has_angles
    turning = "xyz" if slews else "y"
    for axis in turning if has_axial_motion(member) and turns else ():
        matrix = f"rotating {axis}"
        yield FrameTerm(qualified_name(body, matrix), (body,), matrix, "rotation", axis)
        yield FrameTerm(qualified_name(body, f"turning {axis}"), (body,), matrix, "turning", axis)
    pairs = ("xx", "yy", "zz", "xy", "xz", "yz") if slews else ("xx", "zz")
    for pair in pairs if turns else ():
        if set(pair) <= set(motion_directions(member)):
            yield FrameTerm(qualified_name(body, f"carried {pair}"), (body,), f"carried {pair}", "carried", pair)
    for field, matrix in _field_matrices(scene).items():
        yield FrameTerm(qualified_name(body, matrix), (body,), matrix, "field", field, member.number)
    for load in axis_loads(member):
        if load.direction == "x" and load.on == "tip":
            yield FrameTerm(
                qualified_name(body, f"axial {load.name}"), (body,), "axial tip", "load", load.name, member.number
            )


def _cylinder_term(scene: Scene, number: int, beyond: int, field: str) -> FrameTerm:
    """Return the term of the axial force in the cylinder of section `number` that accelerates section `beyond`.

    `field` is the field of the acceleration, or the name of the load against which the cylinder works.
    """
    inner, outer, carried = (scene.names[k] for k in (number, number - 1, beyond))
    name = f"{cylinder_name(inner)} that carries {carried}, {field}"
    return FrameTerm(name, (inner, outer), FIELD_MATRICES.get(field, "axial tip"), "cylinder", field, number, carried)


def tail_outputs(member: Member) -> tuple[str, ...]:
    """Return the names of the outputs that are displacements of the tail across the boom.

    The outputs exist in a moving frame if a cylinder acts on the tail; otherwise the result is empty.
    """
    leans = member.frame is not None and member.has_joint and has_driven_tail(member)
    return tuple(f"tail {axis}" for axis in transverse_axes(member)) if leans else ()


def rope_shares(scene: Scene) -> dict[str, dict[str, float]]:
    r"""Return the shares of sections' forces that the rope or cylinder of each section carries, by section.

    With the forces :math:`F_j` along the boom and the ratios :math:`r_k`, the rope or cylinder of section j carries
    :math:`T_j = F_j + \sum_{k\ \mathrm{follows}\ j} r_k T_k`.  The shares of section j are the factors of all F in this
    sum, by the section of F.  Only sections that follow another one, are followed or have a rope are in the result.
    """
    names = scene.names[1:]
    follows = {name: scene.joint(k).follows for k, name in enumerate(names, 1)}
    ropes = {name for k, name in enumerate(names, 1) if scene.joint(k).rope is not None}
    joined = [name for name in names if follows[name] is not None or name in {*follows.values(), *ropes}]

    def shares_of(name: str) -> dict[str, float]:
        """Return the factors of all forces F in the sum T of section `name`, by the section of F."""
        shares = {name: 1.0}
        for other in joined:
            if follows[other] == name:
                ratio = scene.joint(scene.names.index(other)).ratio
                for carried, share in shares_of(other).items():
                    shares[carried] = shares.get(carried, 0.0) + ratio * share
        return shares

    return {name: shares_of(name) for name in joined}


def drive_rows(scene: Scene, forces: Sequence[str]) -> dict[str, Array]:
    """Return, by section, the factors (m,) by which the force that moves it along the boom follows from `forces`.

    `forces` are the names of m forces; the force that moves a section is the sum of these, times the factors.  For a
    section with a rope, or one that follows or is followed, the sum is T of `rope_shares`.  For all others it is the
    force of the section's own cylinder.  All factors of a section are NaN if the force of one of the cylinders in its
    sum is not among the names.
    """
    shares = {name: {name: 1.0} for name in scene.names[1:]} | rope_shares(scene)
    rows = {name: np.zeros(len(forces)) for name in shares}
    for name, row in rows.items():
        for section, share in shares[name].items():
            if cylinder_name(section) in forces:
                row[forces.index(cylinder_name(section))] += share
            else:
                row[:] = np.nan
    return rows


def rope_length(scene: Scene, number: int) -> float | None:
    """Return the length in m of the rope of section `number` (1 or more) where the section's extension is 0.

    The result is None without a rope, and for a rope whose length the scene does not set and the sections do not tell.
    """
    joint = scene.joint(number)
    if joint.rope is None or joint.rope.length is not None:
        return None if joint.rope is None else joint.rope.length
    if number < 2 or joint.follows != scene.names[number - 1] or joint.ratio != 1.0:
        return None
    length = 2.0 * scene.sections[number - 1].length - scene.sections[number - 2].length - joint.offset
    return length if length > 0.0 else None


def longest_rope(scene: Scene, number: int) -> float:
    """Return the greatest length in m of the rope of section `number` over the simulated time.

    If the rope runs out, the result is the least length instead, which is 0 or negative.
    """
    rope, length = scene.joint(number).rope, rope_length(scene, number)
    assert rope is not None and length is not None  # as the scene's checks say
    ends = [length + rope.lengthens * s for s in scene.extension(number).bounds(0.0, scene.time.end)]
    return max(ends) if min(ends) > 0.0 else min(ends)


@dataclass(frozen=True)
class Drive:
    """Compliance of a section's drive, the cylinder or rope by which it is held along the boom."""

    compliance: float  # m/N, where the section's extension is 0
    changes_length: float = 0.0  # 1/N: growth of the compliance per m of extension

    @classmethod
    def of_section(cls, scene: Scene, number: int) -> Drive:
        """Return the drive of section `number` (1 or more), a cylinder or rope."""
        joint = scene.joint(number)
        if joint.rope is not None:
            length, EA = rope_length(scene, number), joint.rope.strands * joint.rope.EA
            assert length is not None  # as the scene's checks say
            return cls(length / EA, joint.rope.lengthens / EA)
        return cls(0.0 if joint.cylinder.stiffness == "rigid" else 1.0 / float(joint.cylinder.stiffness))
