r"""Systems of a boom's sections: contacts between them and with the ground, and rings of pads as fewer contacts.

A cylinder or rope holds the tail of a section along the boom against the tail of the next outer section, so the forces
along the boom of all sections add up to what the base carries.  The cylinder's compliance acts under the forces of all
sections beyond it.  If the outer section has no coordinates along the boom, the cylinder's contact is with the ground.

Rings of pads become fewer contacts, as six pads hold the stiff cross-section of a beam in three directions only.  Pads
rho that hold both ways, have the stiffnesses k, and are at the same place of the same bodies, have the rows

.. math:: c_\rho(x) = \sum_\kappa S_{\rho\kappa}\, \hat c_\kappa(x), \qquad
    S^T \mathrm{diag}(k)\, S = \bar k\, 1, \quad \bar k \text{ the mean of } k

with a matrix S and rows :math:`\hat c_\kappa`, fewer than the pads if the cross-section does not deform between the
pads.  Gap and force of each pad are proportional, so contacts :math:`\hat c` of stiffness :math:`\bar k` have the same
effect on both bodies, whatever these are.  From the forces :math:`\mu` of these contacts, the forces of the pads follow
exactly, :math:`\lambda = \mathrm{diag}(k / \bar k)\, S \mu`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import scipy.sparse as sp

from pmr.files.arrays import Array, Indices
from pmr.scene import Scene
from pmr.scene.built import force_name
from pmr.scene.choice import has_driven_tail, motion_directions, pad_faces
from pmr.scene.joints import BoomSection, JointPads, RingFriction
from pmr.scene.keys import ALONE, LUFFING, LUFFING_CYLINDER, cylinder_name, qualified_name
from pmr.scene.mechanism import Drive, rope_shares
from pmr.scene.members import AROUND, NEXT_TAIL, POINT, TAIL, WITHIN, body_ring, member_at, members, ring_name
from pmr.system.body import SlidingBody
from pmr.system.carriers import CarrierFlexibility, CarrierRows
from pmr.system.contacts import STRAIGHT, Contact, Place, pad_at_mouth, pad_at_tail
from pmr.system.reduced_model import ReducedModel
from pmr.system.rows import Row, dense_entries
from pmr.system.system import Body, System, ground_contacts
from pmr.system.terms import hoist_of, terms_of


def system_of(scene: Scene, bodies: Mapping[str, SlidingBody]) -> System:
    """System of a scene's bodies with their contacts, terms and hoist; errors are raised as by `System`.

    `bodies` maps the names of the sections to their reduced or full models.
    """
    system = System.of(bodies[ALONE]) if ALONE in bodies else System(bodies, contacts_of(scene, bodies))
    terms = partial(terms_of, scene)
    return replace(system, terms=terms(bodies), terms_of=terms, hoist=hoist_of(scene))


def with_hoist_of(scene: Scene, system: System) -> System:
    """Return the system with the hoist of another `scene` of the same boom; unchanged if the system has no hoist."""
    return replace(system, hoist=hoist_of(scene)) if system.hoist else system


def contacts_of(scene: Scene, bodies: Mapping[str, Body]) -> tuple[Contact, ...]:
    """All contacts between sections, then all contacts with the ground; for a single body those of `System.of`.

    `bodies` are the sections' bodies by name.
    """
    if ALONE in bodies:
        return ground_contacts(bodies[ALONE])
    contacts = [
        contact for number in range(1, len(scene.sections)) for contact in _joint_contacts(scene, number, bodies)
    ]
    places = [place for contact in contacts for place in (contact.inner, contact.outer) if place is not None]
    joined = {(place.body, place.row) for place in places}
    ground = [
        contact for name, body in bodies.items() for contact in _ground_contacts(name, body, joined, scene.bodies[name])
    ]
    return (*contacts, *ground)


def force_names(scene: Scene) -> Mapping[str, Sequence[str]]:
    """Names of a scene's forces, by kind (``pad``, ``cylinder`` and ``support``), without building any model.

    The names go from the base to the tip.  Rigid supports count too; the list of a kind without forces is empty.
    """
    names: dict[str, list[str]] = {"pad": [], "cylinder": [], "support": []}
    for number, (name, member) in enumerate(zip(scene.names, members(scene), strict=True)):
        if number:
            joint, felt = member.part.joint, set(pad_faces(member)) & set(pad_faces(member_at(scene, number - 1)))
            assert joint is not None  # as the scene's checks say
            for at in ("tail", "mouth"):
                for ring in getattr(joint, at):
                    faces = body_ring(ring, ring_name(scene, ring)).named_pads if ring.faces else ()
                    rows = {row for row, face, _ in faces if face in felt}
                    names["pad"] += [pad.name for pad in _pad_contacts(scene, number, ring, f"{name} {at}", rows)]
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


def _joint_contacts(scene: Scene, number: int, bodies: Mapping[str, Body]) -> Iterator[Contact]:
    """Yield the contacts of the joint in which section `number` slides; `bodies` are all bodies by name.

    The pads at the tail and at the mouth come first, then rows that keep a rigid overlap straight, then the cylinder.
    A joint without a rigid overlap has no such rows, and a joint without a cylinder has no such contact.
    """
    joint, inner, outer = scene.sections[number].joint, scene.names[number], scene.names[number - 1]
    assert joint is not None  # as the scene's checks say
    rows = set(bodies[inner].row_names) & set(bodies[outer].row_names)
    length = scene.sections[number - 1].length
    for ring in joint.tail:
        yield from (pad_at_tail(pad, outer, inner) for pad in _pad_contacts(scene, number, ring, f"{inner} tail", rows))
    for ring in joint.mouth:
        yield from (
            pad_at_mouth(pad, outer, inner, length)
            for pad in _pad_contacts(scene, number, ring, f"{inner} mouth", rows)
        )
    if joint.rigid_overlap:
        within = Place(inner, "", length - min(ring.at for ring in joint.mouth), inner, -1.0)
        around = Place(outer, "", min(ring.at for ring in joint.tail), inner)
        for place, names in ((within, WITHIN), (around, AROUND)):
            yield from (Contact(f"{place.body} {name}", replace(place, row=name), kind=STRAIGHT) for name in names)
    if TAIL in bodies[inner].row_names:
        at = _first_break(bodies[inner], TAIL)
        *_, row = member_at(scene, number - 1).tail_points
        held = Place(outer, row, _first_break(bodies[outer], row)) if row in bodies[outer].row_names else None
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


def _pad_contacts(scene: Scene, number: int, ring: JointPads, prefix: str, rows: set[str]) -> Iterator[Contact]:
    """Yield the pads of one ring in the joint of section `number`, as contacts whose outer place is not set yet.

    `rows` are the names of the rows that both sections have.  A pad on a face is left out if its row is not among them:
    a planar beam has no rows for sideways motion.  The inner places of the pads are their distances from the tail or
    the mouth.

    A ring without faces is one pad if it pushes and pulls.  If it only pushes, it is two pads, one above and one below.
    A carriage's wheel that only pushes and has no clearance is one pad, which can lift off.  The names of the pads
    begin with `prefix`.
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
    pads = body_ring(ring, ring_name(scene, ring))
    named = pads.model_copy(update={"name": prefix})  # contacts have these names too
    for (row, *_), (name, face, _) in zip(pads.named_pads, named.named_pads, strict=True):
        if row in rows:
            clearance = ring.clearance_on(face) if ring.unilateral else None
            arm = _arm(scene.sections[number], face) if ring.friction else 0.0
            yield Contact(name, Place(section, row, ring.at), None, 1.0, compliance, clearance, arm=arm, **law)


def _arm(part: BoomSection, face: str) -> float:
    """Distance in m of a `face` of the section `part` from its axis; 0 if the section has no such face in the scene."""
    side = None if part.body.box is None else part.body.box.faces.get(face)
    return 0.0 if side is None else float(side.normal @ side.start)


def _ground_contacts(name: str, body: Body, joined_rows: set[tuple[str, str]], part: BoomSection) -> Iterator[Contact]:
    """Yield contacts of the body `name` with the ground: pads, supports on several coordinates, luffing cylinder.

    Each contact belongs to a constraint row of the body, which measures the body's motion there.  These rows have no
    contact with the ground: a support on a single coordinate, because the model fixes this coordinate; rows in
    `joined_rows`, pairs (body, row), which have contacts with other bodies; and rows of tails and of sliding points.
    `part` is the section of the scene that the body models; it says which rows are pads.
    """
    pads = {pad for ring in part.pads for pad, _, _ in ring.named_pads}
    for number, row in enumerate(body.row_names):
        if (name, row) not in joined_rows and number not in body.held and row not in (TAIL, NEXT_TAIL, POINT):
            compliance, clearance = float(body.row_compliance[number]), float(body.row_clearance[number])
            place, kind = Place(name, row, _first_break(body, row)), "pad" if row in pads else "support"
            gap, direction = None if np.isnan(clearance) else clearance, 1.0
            if row == LUFFING_CYLINDER:
                place, direction = _luffing_place(name, body), -1.0
            yield Contact(f"{name} {row}", place, None, direction, compliance, gap, kind=kind)


def _luffing_place(name: str, body: Body) -> Place:
    """Place of the luffing cylinder's row of the body `name`, on the path `LUFFING`, the luffing angle in rad.

    The row's domain in m stands for one turn of the angle, with the angle 0 in its middle (`pmr.fullmodel.moving`).
    """
    assert body.carriers is not None
    breaks = body.carriers.row(body.row_names.index(LUFFING_CYLINDER), LUFFING_CYLINDER).breaks
    low, high = float(breaks[0]), float(breaks[-1])
    return Place(name, LUFFING_CYLINDER, (low + high) / 2.0, LUFFING, (high - low) / (2.0 * np.pi))


def _first_break(body: Body, row: str) -> float:
    """Lowest coordinate in m at which a row that does not travel is defined: its first break."""
    assert body.carriers is not None
    return float(body.carriers.row(body.row_names.index(row), row).breaks[0])


#: Singular value of a ring's rows, over the largest one, up to which it is round-off of modes and flexibility.
DEPENDENT = 1e-10
#: Number of random sums that show dependent rows: several times the number of pads of a ring.
SUMS = 32


@dataclass(frozen=True)
class CombinedRings:
    """System in which each ring of pads has fewer contacts: m' in all instead of m."""

    system: System
    # S (m, m'): the original contacts have the forces S mu for forces mu (m',) of this system; None: nothing is
    # combined
    shares: Array | None = None

    def original_forces(self, reduced_forces: Array) -> Array:
        """Forces (..., m) in N of the original contacts, from forces of the contacts of `system`.

        `reduced_forces` (..., m') in N are the forces of the contacts of `system`.
        """
        return reduced_forces if self.shares is None else reduced_forces @ self.shares.T


def combine_rings(system: System) -> CombinedRings:
    """Combine the pads of each ring around a section of reduced bodies into the fewest contacts with the same effect.

    The result has the system with fewer contacts, and the shares from which the forces of the original contacts follow.
    The new system keeps the terms, but has no provenance, no hoist and no `on_modes`.  If the system is on one path
    (`System.on_one_path`) or has no rings that can be combined, the result has the unchanged system and no shares.
    """
    if system.on_one_path:
        return CombinedRings(system)
    numbers, contacts, shares = np.eye(len(system.contacts)), list[Contact](), list[Array]()
    bodies = {name: _BodyRows(body) for name, body in system.reduced.items()}
    rings = _rings(system.contacts, bodies)
    if sum(len(S.T) for _, S in rings) == len(numbers):
        return CombinedRings(system)
    for ring, S in rings:
        pads = [system.contacts[k] for k in ring]
        scaled = np.sqrt(_relative_stiffness(pads))
        for n, share in enumerate(S.T):
            measured = share if len(ring) == 1 else share * scaled * [pad.direction for pad in pads]
            places = [
                replace(same[0], row=bodies[same[0].body].combine([place.row for place in same], measured))
                for same in zip(*map(_contact_places, pads), strict=True)
            ]
            contact = replace(pads[n], inner=places[0], outer=(*places, None)[1])
            if len(ring) > 1:
                mean = float(np.mean([1.0 / pad.compliance for pad in pads]))
                contact = replace(contact, direction=1.0, compliance=1.0 / mean)
            contacts.append(contact)
            shares.append((share * scaled) @ numbers[ring])
    models = {name: rows.model for name, rows in bodies.items()}
    return CombinedRings(System(models, tuple(contacts), terms=system.terms), np.array(shares).T)


def _rings(contacts: Sequence[Contact], bodies: Mapping[str, _BodyRows]) -> list[tuple[list[int], Array]]:
    """Pairs, one for each ring: the numbers of its pads' contacts, and its matrix S (pads, contacts) (`_ring_basis`).

    A ring's pads touch the same places of the same bodies, hold both ways, have a compliance and do not rub.  S is
    [[1]] for a contact that stays single.  `bodies` have the rows of the bodies by name.
    """
    groups = dict[object, list[int]]()
    for number, contact in enumerate(contacts):
        combines = contact.clearance is None and contact.compliance > 0.0 and not contact.friction
        where = tuple((place.body, place.at, place.path, place.rate) for place in _contact_places(contact))
        groups.setdefault(where if combines else number, []).append(number)
    rings = list[tuple[list[int], Array]]()
    for ring in groups.values():
        S = _ring_basis(bodies, [contacts[k] for k in ring]) if len(ring) > 1 else None
        rings.extend([([k], np.ones((1, 1))) for k in ring] if S is None else [(ring, S)])
    return rings


def _contact_places(contact: Contact) -> list[Place]:
    """Inner place of a contact, followed by the outer place unless the contact is with the ground."""
    return [contact.inner] if contact.outer is None else [contact.inner, contact.outer]


def _relative_stiffness(pads: Sequence[Contact]) -> Array:
    """Stiffness (pads,) of each pad divided by the mean stiffness; 1 for a single pad, which may be rigid."""
    if len(pads) == 1:
        return np.ones(1)
    stiffness = 1.0 / np.array([pad.compliance for pad in pads])
    return np.asarray(stiffness / np.mean(stiffness))


def _ring_basis(bodies: Mapping[str, _BodyRows], pads: Sequence[Contact]) -> Array | None:
    """Matrix S (pads, c) with orthonormal columns, by which the rows of a ring's pads are S times c combined rows.

    The row of each pad is first multiplied by the root of the pad's relative stiffness and by its direction.  `bodies`
    have the rows of the bodies by name.  None is returned if c is the number of pads, so that nothing is saved, or if
    the rows can't be combined.
    """
    measured = []
    for same in zip(*map(_contact_places, pads), strict=True):
        measures = bodies[same[0].body].measures([place.row for place in same])
        if measures is None:
            return None
        measured.append(measures)
    signed = np.sqrt(_relative_stiffness(pads)) * [pad.direction for pad in pads]
    S, size, _ = np.linalg.svd(signed[:, None] * np.hstack(measured), full_matrices=False)
    fewer = S[:, size > DEPENDENT * size[0]]
    return None if len(fewer.T) == len(pads) else fewer


class _BodyRows:
    """Rows of a body and linear combinations of them, on the fewest carriers that these combinations need.

    Rows that differ only in their carriers, as on a mesh whose cross-section deforms, are combined by sums of carriers.
    Other rows on the same breaks are combined by sums of coefficients.
    """

    def __init__(self, body: ReducedModel) -> None:
        """Begin with the rows of the `body` and without combinations."""
        assert body.carriers is not None  # each body of a system with several paths has carriers
        self._body, self._carriers = body, body.carriers
        self._size = len(body.carriers.values)  # number of carriers: the body's own, then sums of them
        self._parts = list[tuple[Indices, Indices, Array]]()
        self._rows, self._own = dict[tuple[object, ...], Row](), dict[str, Row]()

    def measures(self, names: Sequence[str]) -> Array | None:
        """Values (rows, any) of the rows with these `names` on modes, flexibility and inputs, for comparing the rows.

        None is returned if the rows have different breaks or degrees.  Where there are many coefficients, the values
        are random sums of these, which show just as well whether rows depend on each other.
        """
        rows = [self._row(name) for name in names]
        if not all(np.array_equal(row.breaks, rows[0].breaks) for row in rows):
            return None
        if len({len(row.coefficients) for row in rows}) > 1:
            return None
        if (offsets := _carrier_offsets(rows)) is not None:
            used = np.unique(rows[0].touched)
            return np.array([self._carrier_measures[used + offset].ravel() for offset in offsets])
        powers = np.arange(len(rows[0].coefficients))[::-1, None]
        size = np.diff(rows[0].breaks) ** powers  # to give all coefficients the same unit
        sums = np.random.default_rng(12).standard_normal((SUMS, size.size)) * size.ravel()
        return np.array([((row.entries.T @ sums.T).T @ self._carrier_measures).ravel() for row in rows])

    @cached_property
    def _carrier_measures(self) -> Array:
        """Values (K, any) of the K carriers: on modes, and on rows, inputs and outputs of the flexibility.

        Each carrier has one row.  Each kind of values is scaled to its largest one.  A kind with more than `SUMS`
        columns is replaced by `SUMS` sums of its columns with random weights, which show dependent rows just as well.
        """
        parts, rng = [self._carriers.values], np.random.default_rng(11)
        if (flexibility := self._carriers.flexibility) is not None:
            parts += [flexibility.rows, flexibility.inputs, flexibility.outputs.T]
        for k, part in enumerate(parts):
            parts[k] = part / (np.abs(part).max(initial=0.0) or 1.0)
            if part.shape[1] > SUMS:
                parts[k] = parts[k] @ rng.standard_normal((part.shape[1], SUMS))
        return np.hstack(parts)

    def combine(self, names: Sequence[str], shares: Array) -> str:
        """Return the name of a row that is the sum of the rows with these `names` times `shares` (rows,).

        The row is added to the body unless the body has it already.
        """
        key = (*names, shares.tobytes())
        if key not in self._rows:
            rows, name = [self._row(name) for name in names], f"{names[0]}, {len(self._rows) + 1}"
            offsets = _carrier_offsets(rows)
            if offsets is None or len(rows) == 1:
                entries = sum(share * row.entries for share, row in zip(shares, rows, strict=True))
                touched, coefficients = dense_entries(sp.csr_matrix(entries), len(rows[0].coefficients))
            else:
                used, coefficients = np.unique(rows[0].touched), rows[0].coefficients
                where = used + np.array(offsets)[:, None]
                numbers = np.broadcast_to(self._size + np.arange(len(used)), where.shape)
                self._parts.append((numbers.ravel(), where.ravel(), np.repeat(shares, len(used))))
                touched = self._size + np.searchsorted(used, rows[0].touched)
                self._size += len(used)
            self._rows[key] = replace(rows[0], name=name, touched=touched, coefficients=coefficients)
        return self._rows[key].name

    @property
    def model(self) -> ReducedModel:
        """Body with the combined rows instead of its own, on their carriers.

        Its tables over the path, pads and clearance are still those of its own rows: systems do not use them.
        """
        old, rows = self._carriers, list(self._rows.values())
        each = np.arange(len(old.values))
        numbers, where, shares = map(np.concatenate, zip((each, each, np.ones(len(each))), *self._parts, strict=True))
        P = sp.csr_matrix((shares, (numbers, where)), (self._size, len(each)))
        used = np.unique(np.concatenate([row.touched.ravel() for row in rows]))
        P, old_flexibility = P[used], old.flexibility
        flexibility = old_flexibility and CarrierFlexibility(
            rows=np.asarray((P @ (P @ old_flexibility.rows).T).T),
            inputs=P @ old_flexibility.inputs,
            outputs=np.asarray((P @ old_flexibility.outputs.T).T),
            direct=old_flexibility.direct,
            energy=old_flexibility.energy,
        )
        rows = [replace(row, touched=np.searchsorted(used, row.touched)) for row in rows]
        names = tuple(row.name for row in rows)
        return replace(self._body, row_names=names, carriers=CarrierRows.from_rows(rows, P @ old.values, flexibility))

    def _row(self, name: str) -> Row:
        """Row of the body called `name`; always the same object, which computes its entries once."""
        if name not in self._own:
            self._own[name] = self._carriers.row(self._body.row_names.index(name), name)
        return self._own[name]


def _carrier_offsets(rows: Sequence[Row]) -> list[int] | None:
    """Difference of each row's carrier numbers from those of the first row; None if rows differ in anything else."""
    first, offsets = rows[0], list[int]()
    for row in rows:
        offset = int(row.touched.min() - first.touched.min())
        same = np.array_equal(row.breaks, first.breaks) and np.array_equal(row.coefficients, first.coefficients)
        if not (same and np.array_equal(row.touched - offset, first.touched)):
            return None
        offsets.append(offset)
    return offsets
