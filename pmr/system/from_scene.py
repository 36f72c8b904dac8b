"""Systems of a boom's sections: contacts between them and with the ground.

A cylinder or rope holds the tail of a section along the boom against the tail of the next outer section, so the forces
along the boom of all sections add up to what the base carries.  The cylinder's compliance acts under the forces of all
sections beyond it.  If the outer section has no coordinates along the boom, the cylinder's contact is with the ground.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pmr.scene import Scene
from pmr.scene.built import force_name
from pmr.scene.choice import has_driven_tail, motion_directions, pad_faces
from pmr.scene.joints import BoomSection, JointPads, RingFriction
from pmr.scene.keys import ALONE, LUFFING, LUFFING_CYLINDER, cylinder_name, qualified_name
from pmr.scene.mechanism import Drive, rope_shares
from pmr.scene.members import AROUND, POINT, TAIL, WITHIN, body_ring, footprint, member_at, members
from pmr.system.body import SlidingBody
from pmr.system.contacts import Contact, Place, pad_at_mouth, pad_at_tail
from pmr.system.hoist import hoist_of
from pmr.system.system import Body, System, ground_contacts
from pmr.system.terms import terms_of


def system_of(scene: Scene, bodies: Mapping[str, SlidingBody]) -> System:
    """System of a scene's bodies with their contacts and terms; errors are raised as by `System`.

    `bodies` maps the names of the sections to their reduced or full models.
    """
    terms = partial(terms_of, scene)
    hoist = hoist_of(scene)
    if ALONE in bodies:
        return replace(System.of(bodies[ALONE]), terms=terms(bodies), terms_of=terms, hoist=hoist)
    return System(bodies, contacts_of(scene, bodies), terms=terms(bodies), terms_of=terms, hoist=hoist)


def with_terms_of(scene: Scene, system: System) -> System:
    """Return a system read from a file with the scene's function `terms_of`, which makes terms for other bodies.

    A file contains only the terms for its own bodies.
    """
    return replace(system, terms_of=partial(terms_of, scene))


def contacts_of(scene: Scene, bodies: Mapping[str, Body]) -> tuple[Contact, ...]:
    """All contacts between sections, then all contacts with the ground; for a single body those of `System.of`."""
    if ALONE in bodies:
        return ground_contacts(bodies[ALONE])
    contacts = [contact for number in range(1, len(scene.sections)) for contact in _contacts(scene, number, bodies)]
    places = [place for contact in contacts for place in (contact.inner, contact.outer) if place is not None]
    joined = {(place.body, place.row) for place in places}
    ground = [
        contact for name, body in bodies.items() for contact in _ground_contacts(name, body, joined, scene.bodies[name])
    ]
    return (*contacts, *ground)


def force_names(scene: Scene) -> Mapping[str, Sequence[str]]:
    """Names of a scene's forces, by kind (``pad``, ``cylinder`` and ``support``), without building any model.

    They go from the base to the tip.  Rigid supports count too; the list of a kind without forces is empty.
    """
    names: dict[str, list[str]] = {"pad": [], "cylinder": [], "support": []}
    for number, (name, member) in enumerate(zip(scene.names, members(scene), strict=True)):
        if number:
            joint, felt = member.part.joint, set(pad_faces(member)) & set(pad_faces(member_at(scene, number - 1)))
            assert joint is not None  # as the scene's checks say
            for at in ("tail", "mouth"):
                for ring in getattr(joint, at):
                    faces = body_ring(ring, footprint(scene, ring)).named_pads if ring.faces else ()
                    rows = {row for row, face, _ in faces if face in felt}
                    names["pad"] += [pad.name for pad in _pads(scene, number, ring, f"{name} {at}", rows)]
            if has_driven_tail(member):
                names["cylinder"].append(cylinder_name(name))
        body_pads = [(pad, face) for ring in member.part.pads for pad, face, _ in ring.named_pads]
        prefix = name if name == ALONE else f"{name} "
        names["pad"] += [f"{prefix}{pad}" for pad, face in body_pads if face in pad_faces(member)]
        if name == ALONE:
            names["pad"] += member.point_names
        for support in member.part.supports:
            rows_of = [support.row_name(d) for d in support.held_directions if d in motion_directions(member)]
            names["support"] += [f"{prefix}{row}" for row in rows_of]
            if support.stiffness != "rigid":
                names["support"] += [qualified_name(name, force_name(row)) for row in rows_of]
        if member.cylinder is not None:
            names["support"].append(f"{prefix}{LUFFING_CYLINDER}")
    return names


def _contacts(scene: Scene, number: int, bodies: Mapping[str, Body]) -> Iterator[Contact]:
    """Contacts of the joint in which the section with the given `number` slides.

    The pads at the tail and at the mouth come first, then rows that keep a rigid overlap straight, then the cylinder;
    the last two only if the joint has them.
    """
    joint, inner, outer = scene.sections[number].joint, scene.names[number], scene.names[number - 1]
    assert joint is not None  # as the scene's checks say
    rows = set(bodies[inner].row_names) & set(bodies[outer].row_names)
    length = scene.sections[number - 1].length
    for ring in joint.tail:
        yield from (pad_at_tail(pad, outer, inner) for pad in _pads(scene, number, ring, f"{inner} tail", rows))
    for ring in joint.mouth:
        yield from (
            pad_at_mouth(pad, outer, inner, length) for pad in _pads(scene, number, ring, f"{inner} mouth", rows)
        )
    if joint.rigid_overlap:
        within = Place(inner, "", length - min(ring.at for ring in joint.mouth), inner, -1.0)
        around = Place(outer, "", min(ring.at for ring in joint.tail), inner)
        for place, names in ((within, WITHIN), (around, AROUND)):
            yield from (Contact(f"{place.body} {name}", replace(place, row=name), kind="straight") for name in names)
    if TAIL in bodies[inner].row_names:
        at = _first_break(bodies[inner], TAIL)
        held = Place(outer, TAIL, _first_break(bodies[outer], TAIL)) if TAIL in bodies[outer].row_names else None
        drive, shares = Drive.of_section(scene, number), rope_shares(scene).get(inner, {})
        yield Contact(
            cylinder_name(inner),
            Place(inner, TAIL, at),
            held,
            -1.0,
            drive.compliance,
            kind="cylinder",
            lengthening=drive.changes_length,
            path=inner if drive.changes_length else None,
            bears=tuple(
                (cylinder_name(name), share)
                for name, share in shares.items()
                if name != inner and TAIL in bodies[name].row_names
            ),
        )


def _pads(scene: Scene, number: int, ring: JointPads, prefix: str, rows: set[str]) -> Iterator[Contact]:
    """Pads of one ring in the joint of section `number`, without those that have none of the `rows` of both sections.

    Their inner places are their distances from the tail or the mouth.

    A planar beam has no rows for sideways motion.  A ring without faces is one pad, or two, above and below, if it only
    pushes; a carriage's wheel without clearance is one pad that lifts off.  The names of the pads begin with `prefix`.
    """
    prefix = " ".join(filter(None, (prefix, ring.name)))
    compliance = 0.0 if ring.stiffness == "rigid" else 1.0 / ring.stiffness
    law, section = {key: getattr(ring, key) for key in RingFriction.model_fields}, scene.names[number]
    if ring.faces is None:
        clearance, runs = ring.clearance_on("") if ring.unilateral else None, not scene.joint(number).mouth
        ways = {" above": 1.0, " below": -1.0}
        if not ring.unilateral or (runs and not clearance):
            ways = {"": -1.0 if runs else 1.0}  # a carriage presses down on what it runs on
        for way, direction in ways.items():
            arm = _arm(scene.sections[number], "top") if ring.friction else 0.0
            place = Place(section, POINT, ring.at)
            yield Contact(prefix + way, place, None, direction, compliance, clearance, arm=arm, **law)
        return
    pads = body_ring(ring, footprint(scene, ring))
    named = pads.model_copy(update={"name": prefix})  # contacts have these names too
    for (row, *_), (name, face, _) in zip(pads.named_pads, named.named_pads, strict=True):
        if row in rows:
            clearance = ring.clearance_on(face) if ring.unilateral else None
            arm = _arm(scene.sections[number], face) if ring.friction else 0.0
            yield Contact(name, Place(section, row, ring.at), None, 1.0, compliance, clearance, arm=arm, **law)


def _arm(part: BoomSection, face: str) -> float:
    """Distance in m of a face from the section's axis; 0 for a section that has no faces in the scene."""
    side = None if part.body.box is None else part.body.box.faces.get(face)
    return 0.0 if side is None else float(side.normal @ side.start)


def _ground_contacts(name: str, body: Body, joined_rows: set[tuple[str, str]], part: BoomSection) -> Iterator[Contact]:
    """Contacts of the body `name` with the ground: pads, supports that combine several coordinates, luffing cylinder.

    Supports on a single coordinate are no contacts, because the model fixes that coordinate.  The pairs (body, row) in
    `joined_rows`, and the rows of tails and points, are no contacts with the ground either.
    """
    pads = {pad for ring in part.pads for pad, _, _ in ring.named_pads}
    for number, row in enumerate(body.row_names):
        if (name, row) not in joined_rows and number not in body.held and row not in (TAIL, POINT):
            compliance, clearance = float(body.row_compliance[number]), float(body.row_clearance[number])
            place, kind = Place(name, row, _first_break(body, row)), "pad" if row in pads else "support"
            gap, direction = None if np.isnan(clearance) else clearance, 1.0
            if row == LUFFING_CYLINDER:
                place, direction = _luffing_place(name, body), -1.0
            yield Contact(f"{name} {row}", place, None, direction, compliance, gap, kind=kind)


def _luffing_place(name: str, body: Body) -> Place:
    """Place of the luffing cylinder's row of the body `name`; its domain spans a turn of the angle.

    See `pmr.fullmodel.moving`.
    """
    assert body.carriers is not None
    breaks = body.carriers.row(body.row_names.index(LUFFING_CYLINDER), LUFFING_CYLINDER).breaks
    low, high = float(breaks[0]), float(breaks[-1])
    return Place(name, LUFFING_CYLINDER, (low + high) / 2.0, LUFFING, (high - low) / (2.0 * np.pi))


def _first_break(body: Body, row: str) -> float:
    """Lowest coordinate in m at which a row that does not travel is defined: its first break."""
    assert body.carriers is not None
    return float(body.carriers.row(body.row_names.index(row), row).breaks[0])
