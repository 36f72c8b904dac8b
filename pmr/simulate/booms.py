r"""A boom of several sections as a system: what joins them, and what drives them.

Along the boom the frame of a section moves with its tail, :math:`X_i = s_1 + \dots + s_i`, so that a load
:math:`-M_i e_x X_i''` acts on it.  A cylinder or rope holds its tail against that of the next outer section, the first
one against the ground; what it pushes with follows from the equations of motion like the force of a pad.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import accumulate

import numpy as np
from numpy.typing import ArrayLike

from pmr.scene import Boom
from pmr.scene.boom import JointPads
from pmr.scene.boom_parts import AROUND, DRIVEN, POINT, TAIL, WITHIN, as_pads, footprint
from pmr.scene.signals import SignalBase
from pmr.scene.signals.base import Array, Floats
from pmr.simulate.excitation import Excitation
from pmr.simulate.stepping import TimeStepping
from pmr.system.body import SlidingBody
from pmr.system.contacts import Contact, Joint, JointPad, Place
from pmr.system.system import Body, Joined, System


def cylinder(section: str) -> str:
    """What the contact is called that drives a section along the boom."""
    return f"cylinder of {section}"


def system_of(boom: Boom, bodies: Mapping[str, SlidingBody]) -> System:
    """The sections, reduced or full, by their names, and what joins them; errors as for `System`."""
    return System(bodies, contacts_of(boom, bodies))


def contacts_of(boom: Boom, bodies: Mapping[str, Body]) -> tuple[Contact, ...]:
    """All contacts between the sections, and with the ground."""
    contacts = [contact for number in range(1, len(boom.sections)) for contact in _between(boom, number, bodies)]
    places = [place for one in contacts for place in (one.inner, one.outer) if place is not None]
    joined = {(place.body, place.row) for place in places}
    ground = [contact for name, body in bodies.items() for contact in _on_ground(name, body, joined)]
    return (*contacts, *ground)


def excitation_of(boom: Boom, system: Joined[Body]) -> Excitation:
    """Extensions by the sections' names, and a load for each ``section.input``."""
    stepping = TimeStepping(boom.time.end, boom.time.step, boom.time.rho_inf)
    loads: dict[str, SignalBase] = {}
    tails = list(accumulate(((path,) for path in boom.paths.values()), initial=()))
    for part, paths in zip(boom.sections, tails, strict=True):
        known: dict[str, SignalBase] = {load.name: load.signal for load in part.loads}
        known |= {"gravity": boom.gravity.signal, DRIVEN: Acceleration(paths=paths, step=stepping.step)}
        loads |= {f"{part.name}.{name}": known[name] for name in system.bodies[part.name].input_names}
    return Excitation(boom.paths, loads, stepping, boom.simulation)


class Acceleration(SignalBase):
    r"""The sum of some paths twice differentiated, m/s^2, as a step of h sees it: a kink is spread over one.

    .. math:: a(t) = \big(\dot s(t + h/2) - \dot s(t - h/2)\big) / h
    """

    paths: tuple[SignalBase, ...]
    step: float

    def value(self, t: ArrayLike) -> Array:
        t, half = np.asarray(t, float), self.step / 2.0
        changes = [path.rate(t + half) - path.rate(t - half) for path in self.paths]
        return np.asarray(np.sum(changes, axis=0) / self.step)

    def rate(self, t: ArrayLike) -> Array:
        t, half = np.asarray(t, float), self.step / 2.0
        return (self.value(t + half) - self.value(t - half)) / self.step

    @property
    def breaks(self) -> Floats:
        return tuple(sorted({b for path in self.paths for b in path.breaks}))


def _between(boom: Boom, number: int, bodies: Mapping[str, Body]) -> Iterator[Contact]:
    """Contacts of the joint in which a section slides, its cylinder last."""
    joint, inner, outer = boom.sections[number].joint, boom.names[number], boom.names[number - 1]
    assert joint is not None  # as the scene's checks say
    rows = set(bodies[inner].row_names) & set(bodies[outer].row_names)
    yield from Joint(
        inner,
        outer,
        boom.length(number),
        boom.length(number - 1),
        inner,
        tuple(pad for ring in joint.tail for pad in _pads(boom, ring, f"{inner} tail", rows)),
        tuple(pad for ring in joint.mouth for pad in _pads(boom, ring, f"{inner} mouth", rows)),
    ).contacts
    if joint.rigid_overlap:
        within = Place(inner, "", boom.length(number - 1) - joint.first_at(joint.mouth), inner, -1.0)
        around = Place(outer, "", joint.first_at(joint.tail), inner)
        for place, names in ((within, WITHIN), (around, AROUND)):
            yield from (Contact(f"{place.body} {name}", replace(place, row=name)) for name in names)
    if TAIL in bodies[inner].row_names:
        at = _somewhere(bodies[inner], TAIL)
        held = Place(outer, TAIL, _somewhere(bodies[outer], TAIL)) if TAIL in bodies[outer].row_names else None
        stiffness = joint.cylinder.stiffness
        compliance = 0.0 if stiffness == "rigid" else 1.0 / stiffness
        yield Contact(cylinder(inner), Place(inner, TAIL, at), held, direction=-1.0, compliance=compliance)


def _pads(boom: Boom, ring: JointPads, called: str, rows: set[str]) -> Iterator[JointPad]:
    """Those of a ring that both sections can feel: nothing moves a planar beam sideways."""
    called = " ".join(filter(None, (called, ring.name)))
    compliance = 0.0 if ring.stiffness == "rigid" else 1.0 / ring.stiffness
    clearance = ring.clearance if ring.unilateral else None
    if ring.faces is None:
        for way, direction in {" above": 1.0, " below": -1.0}.items() if ring.unilateral else {"": 1.0}.items():
            yield JointPad(called + way, POINT, ring.at, direction, compliance, clearance, ring.friction)
        return
    name = footprint(boom, ring)
    for row, _, _ in as_pads(ring, name).places:
        if row in rows:
            yield JointPad(called + row.removeprefix(name), row, ring.at, 1.0, compliance, clearance, ring.friction)


def _on_ground(name: str, body: Body, joined: set[tuple[str, str]]) -> Iterator[Contact]:
    """Pads between a section and the ground, and supports that hold more than one coordinate of a full one."""
    for number, row in enumerate(body.row_names):
        if (name, row) not in joined and number not in body.held and row not in (TAIL, POINT):
            compliance, clearance = float(body.row_compliance[number]), float(body.row_clearance[number])
            place = Place(name, row, _somewhere(body, row))
            yield Contact(
                f"{name} {row}", place, compliance=compliance, clearance=None if np.isnan(clearance) else clearance
            )


def _somewhere(body: Body, row: str) -> float:
    """A place in m at which a row that stays is defined."""
    assert body.carriers is not None
    return float(body.carriers.row(body.row_names.index(row), row).breaks[0])
