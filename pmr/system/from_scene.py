r"""A boom of several sections as a system: what joins them, and what they stand on.

A cylinder or rope holds a section's tail along the boom against that of the next outer one, and so all of them lean on
what holds the base; it gives way under all that hangs on it.  Only where the outer one has no coordinates along the
boom is it the ground.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pmr.scene import Scene
from pmr.scene.built import force_of
from pmr.scene.choice import directions, felt_faces, has_tail
from pmr.scene.joints import JointPads, Part
from pmr.scene.keys import ALONE, cylinder_of, named
from pmr.scene.mechanism import Drive, rope_shares
from pmr.scene.members import AROUND, POINT, TAIL, WITHIN, as_pads, footprint, member_at, members
from pmr.system.body import SlidingBody
from pmr.system.contacts import FRICTION, Contact, Joint, JointPad, Place
from pmr.system.system import Body, System, ground_contacts
from pmr.system.terms import terms_of


def system_of(scene: Scene, bodies: Mapping[str, SlidingBody]) -> System:
    """A scene's bodies, reduced or full, by their names, and what joins them; errors as for `System`."""
    terms = partial(terms_of, scene)
    if ALONE in bodies:
        return replace(System.of(bodies[ALONE]), terms=terms(bodies), terms_of=terms)
    return System(bodies, contacts_of(scene, bodies), terms=terms(bodies), terms_of=terms)


def with_terms_of(scene: Scene, system: System) -> System:
    """A system from a file, which has terms for its own bodies, with what makes those of other models of them."""
    return replace(system, terms_of=partial(terms_of, scene))


def contacts_of(scene: Scene, bodies: Mapping[str, Body]) -> tuple[Contact, ...]:
    """All contacts between the sections, and with the ground; of a body alone as `System.of` has them."""
    if ALONE in bodies:
        return ground_contacts(bodies[ALONE])
    contacts = [contact for number in range(1, len(scene.sections)) for contact in _contacts(scene, number, bodies)]
    places = [place for contact in contacts for place in (contact.inner, contact.outer) if place is not None]
    joined = {(place.body, place.row) for place in places}
    ground = [
        contact for name, body in bodies.items() for contact in _on_ground(name, body, joined, scene.bodies[name])
    ]
    return (*contacts, *ground)


def force_names(scene: Scene) -> Mapping[str, Sequence[str]]:
    """Names of the forces of pads, cylinders and supports, as far as no model has to be built."""
    names: dict[str, list[str]] = {"pad": [], "cylinder": [], "support": []}
    for number, (name, member) in enumerate(zip(scene.names, members(scene), strict=True)):
        if number:
            joint, felt = member.part.joint, set(felt_faces(member)) & set(felt_faces(member_at(scene, number - 1)))
            assert joint is not None  # as the scene's checks say
            for at in ("tail", "mouth"):
                for ring in getattr(joint, at):
                    faces = as_pads(ring, footprint(scene, ring)).places if ring.faces else ()
                    rows = {row for row, face, _ in faces if face in felt}
                    names["pad"] += [pad.name for pad in _pads(scene, number, ring, f"{name} {at}", rows)]
            if has_tail(member):
                names["cylinder"].append(cylinder_of(name))
        body_pads = [(pad, face) for ring in member.part.pads for pad, face, _ in ring.places]
        prefix = name if name == ALONE else f"{name} "
        names["pad"] += [f"{prefix}{pad}" for pad, face in body_pads if face in felt_faces(member)]
        if name == ALONE:
            names["pad"] += member.point_names
        for support in member.part.supports:
            rows_of = [support.row_name(d) for d in support.held if d in directions(member)]
            names["support"] += [f"{prefix}{row}" for row in rows_of]
            if support.stiffness != "rigid":
                names["support"] += [named(name, force_of(row)) for row in rows_of]
    return names


def _contacts(scene: Scene, number: int, bodies: Mapping[str, Body]) -> Iterator[Contact]:
    """Contacts of the joint in which a section slides, its cylinder last."""
    joint, inner, outer = scene.sections[number].joint, scene.names[number], scene.names[number - 1]
    assert joint is not None  # as the scene's checks say
    rows = set(bodies[inner].row_names) & set(bodies[outer].row_names)
    yield from Joint(
        inner,
        outer,
        scene.sections[number].length,
        scene.sections[number - 1].length,
        inner,
        tuple(pad for ring in joint.tail for pad in _pads(scene, number, ring, f"{inner} tail", rows)),
        tuple(pad for ring in joint.mouth for pad in _pads(scene, number, ring, f"{inner} mouth", rows)),
    ).contacts
    if joint.rigid_overlap:
        within = Place(inner, "", scene.sections[number - 1].length - joint.first_at(joint.mouth), inner, -1.0)
        around = Place(outer, "", joint.first_at(joint.tail), inner)
        for place, names in ((within, WITHIN), (around, AROUND)):
            yield from (Contact(f"{place.body} {name}", replace(place, row=name), kind="straight") for name in names)
    if TAIL in bodies[inner].row_names:
        at = _somewhere(bodies[inner], TAIL)
        held = Place(outer, TAIL, _somewhere(bodies[outer], TAIL)) if TAIL in bodies[outer].row_names else None
        drive, shares = Drive.of(scene, number), rope_shares(scene).get(inner, {})
        yield Contact(
            cylinder_of(inner),
            Place(inner, TAIL, at),
            held,
            -1.0,
            drive.compliance,
            kind="cylinder",
            lengthening=drive.lengthening,
            path=inner if drive.lengthening else None,
            bears=tuple(
                (cylinder_of(name), share)
                for name, share in shares.items()
                if name != inner and TAIL in bodies[name].row_names
            ),
        )


def _pads(scene: Scene, number: int, ring: JointPads, called: str, rows: set[str]) -> Iterator[JointPad]:
    """Pads of a ring of a joint whose forces both sections feel: a planar beam does not move sideways."""
    called = " ".join(filter(None, (called, ring.name)))
    compliance = 0.0 if ring.stiffness == "rigid" else 1.0 / ring.stiffness
    law = {key: getattr(ring, key) for key in FRICTION}
    if ring.faces is None:
        clearance = ring.clearance_on("") if ring.unilateral else None
        for way, direction in {" above": 1.0, " below": -1.0}.items() if ring.unilateral else {"": 1.0}.items():
            arm = _arm(scene.sections[number], "top") if ring.friction else 0.0
            yield JointPad(called + way, POINT, ring.at, direction, compliance, clearance, arm=arm, **law)
        return
    pads = as_pads(ring, footprint(scene, ring))
    named = pads.model_copy(update={"name": called})  # so are their contacts
    for (row, *_), (name, face, _) in zip(pads.places, named.places, strict=True):
        if row in rows:
            clearance = ring.clearance_on(face) if ring.unilateral else None
            arm = _arm(scene.sections[number], face) if ring.friction else 0.0
            yield JointPad(name, row, ring.at, 1.0, compliance, clearance, arm=arm, **law)


def _arm(part: Part, face: str) -> float:
    """How far a face is from the axis, m; nothing of what has no faces in the scene."""
    side = None if part.body.box is None else part.body.box.faces.get(face)
    return 0.0 if side is None else float(side.normal @ side.start)


def _on_ground(name: str, body: Body, joined: set[tuple[str, str]], part: Part) -> Iterator[Contact]:
    """Pads between a section and the ground, and supports that hold more than one coordinate of a full one."""
    pads = {pad for ring in part.pads for pad, _, _ in ring.places}
    for number, row in enumerate(body.row_names):
        if (name, row) not in joined and number not in body.held and row not in (TAIL, POINT):
            compliance, clearance = float(body.row_compliance[number]), float(body.row_clearance[number])
            place, kind = Place(name, row, _somewhere(body, row)), "pad" if row in pads else "support"
            gap = None if np.isnan(clearance) else clearance
            yield Contact(f"{name} {row}", place, compliance=compliance, clearance=gap, kind=kind)


def _somewhere(body: Body, row: str) -> float:
    """A place in m at which a row that stays is defined."""
    assert body.carriers is not None
    return float(body.carriers.row(body.row_names.index(row), row).breaks[0])
