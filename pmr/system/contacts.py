r"""Contacts between bodies: the places on bodies that they join, the compliance of contacts, and their friction.

Pads, supports, cylinders and ropes have a compliance of their own.  Cylinders and ropes bear shares of the forces of
other contacts too.

The spring of a contact bears the force of this contact and shares of the forces of others, in sum :math:`T = S \lambda`
for the forces :math:`\lambda` of all contacts (`pmr.scene.mechanism`).  By virtual work it moves each of these contacts
by its share.  A rope whose length under tension grows with a path is softer the larger the path coordinate s is:

.. math::
    C q + H f = (G + A)\, \lambda, \qquad A(s) = S^T \operatorname{diag}\bigl(a + a' s\bigr)\, S, \qquad
    a + a' s = \frac{l(s)}{z\, EA}

with the coordinates q, loads f, rows C and H of the contacts, the compliance a + a' s of each spring, the length l, the
number z of parallel ropes and the stiffness EA of one rope.  A is added to the residual flexibility G in all equations.
So the ropes store :math:`\tfrac12 \lambda^T A \lambda`, and a drum that pays out rope under tension does the work
:math:`-\tfrac12 \lambda^T \dot A \lambda` on the boom.

Pads have friction along the boom.

A pad that presses with the force N, while its section slides out by :math:`\Delta y` in a step, pulls the section back
with the friction f, and pulls the outer section forward with f:

.. math:: f_{n+1} = \max(-\mu |N|, \min(\mu |N|, f_n + \kappa\, \Delta y)), \qquad
    \mu = \mu_k + (\mu_s - \mu_k)\, e^{-|\dot s| / v_s}

It sticks, as a spring of the pad's stiffness :math:`\kappa` along the boom, until f would exceed :math:`\mu |N|`, and
slides with that force: an elastic, perfectly plastic element with one state variable for each pad, f itself (Jenkins'
element; W. D. Iwan, A distributed-element model for hysteresis, Journal of Applied Mechanics 33, 1966, 893-900).  The
coefficient is Coulomb's :math:`\mu_k`, or falls to it from the coefficient at rest :math:`\mu_s` as the joint's path
moves faster (R. Stribeck 1902; L. C. Bo and D. Pavelescu, The friction-speed relation and its influence on the critical
velocity of stick-slip motion, Wear 82, 1982, 277-289).  The heat in a step is f times the sliding distance
:math:`\Delta y - \Delta f / \kappa`.

The cylinder of the joint has the stiffness k and the force :math:`\Lambda`, of which :math:`\lambda = \Lambda - \sum f`
reaches the sections.  The pads of the joint slide by y, the extension s less the compression of the cylinder,

.. math:: y = s - \Lambda / k, \qquad C q + H f - G \lambda - \lambda / k = \sum f / k

so there is also friction if a section swings on its cylinder.  Sections are taken as rigid along the boom: friction is
a force between the tails of both sections.  It acts on the face that a pad touches, at the distance e from the axis, so
it is also a moment e f on both sections.  With the pad's row c(x), the work of this moment is :math:`e f\, c'(x) q`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from pmr.errors import InputError
from pmr.files.arrays import Array, Indices, Mask
from pmr.results.response import FORCES
from pmr.scene.cylinder import SHEAR_STIFFNESS
from pmr.scene.joints import FrictionLaw, RingFriction
from pmr.scene.keys import ALONE as ALONE
from pmr.scene.keys import SLIDER as SLIDER
from pmr.scene.keys import cylinder_name, quantity_of
from pmr.scene.keys import input_name as input_name
from pmr.scene.keys import qualified_name as qualified_name

#: Kind of contacts that keep overlapping sections parallel: they bear moments, not forces of pads.
STRAIGHT = "straight"
#: All kinds of contacts.
KINDS = (*FORCES, STRAIGHT)


@dataclass(frozen=True)
class Place:
    """Point of a body at which a row measures motion; its coordinate on the body is x(t) = at + rate s(t) in m."""

    # a body of the system, and one of its rows
    body: str
    row: str
    at: float = 0.0  # m
    path: str | None = None  # name of the path s(t); None where the place does not travel
    rate: float = 1.0  # negative where the place travels towards the body's tail while the path grows

    def coordinate(self, s: Mapping[str, ArrayLike]) -> Array:
        """Coordinate x (...) in m on the body; `s` maps names of paths to their coordinates (...) in m.

        For a place that does not travel, x is a single number, even if the paths' coordinates are arrays.
        """
        travelled = np.zeros(()) if self.path is None else self.rate * np.asarray(s[self.path], float)
        return np.asarray(self.at + travelled)


@dataclass(frozen=True)
class Contact(FrictionLaw):
    """Contact, such as a pad, cylinder or support, between two places on bodies or between a place and the ground.

    A positive force pushes the inner body against `direction`.  The constants of friction along the path are those of
    `pmr.scene.joints.FrictionLaw`.  An InputError is raised for values that are not allowed.
    """

    name: str
    inner: Place
    outer: Place | None = None  # None: the contact is with the ground
    # 1 or -1: sign of the displacement of the inner row relative to the outer row by which the contact closes
    direction: float = 1.0
    compliance: float = 0.0  # 1/k in m/N; 0 for a rigid contact
    # m: displacement at which a contact that only pushes closes; None for a contact that holds both ways
    clearance: float | None = None
    _: KW_ONLY
    kind: str = "pad"  # one of `KINDS`
    arm: float = 0.0  # m: distance of friction from the axis, to the face that the contact presses on
    shear_stiffness: float = SHEAR_STIFFNESS  # N/m: stiffness along the path while the contact sticks
    # for a rope: growth a' in 1/N of its compliance with a path coordinate, and the name of this path
    lengthening: float = 0.0
    path: str | None = None
    bears: tuple[tuple[str, float], ...] = ()  # names of other contacts whose force it bears, and the shares

    def __post_init__(self) -> None:
        for place in (self.inner, *filter(None, (self.outer,))):
            if not (np.isfinite(place.at) and np.isfinite(place.rate) and place.rate):
                raise contact_error(
                    self.name, "place", (place.at, place.rate), "finite at and rate, rate not 0, are allowed"
                )
        for key in RingFriction.model_fields:
            _check_constant(self, key)
        allowed = {
            "direction": (self.direction in (1.0, -1.0), "1 or -1 is allowed"),
            "compliance": (0.0 <= self.compliance < np.inf, "0 or more, in m/N, is allowed"),
            "kind": (self.kind in KINDS, f"{', '.join(KINDS)} are allowed"),
            "bears": (bool(np.isfinite([share for _, share in self.bears]).all()), "finite shares are allowed"),
            "arm": (bool(np.isfinite(self.arm)), "a finite number, in m, is allowed"),
            "lengthening": (
                np.isfinite(self.lengthening) and (not self.lengthening or self.path is not None),
                "a finite number, with a path, is allowed",
            ),
            "clearance": (self.clearance is None or 0.0 <= self.clearance < np.inf, "a length from 0 on is allowed"),
            "static_friction": (
                not self.static_friction or self.friction <= self.static_friction < np.inf,
                f"{self.friction} or more is allowed",
            ),
        }
        for key, (is_allowed, values) in allowed.items():
            if not is_allowed:
                raise contact_error(self.name, key, getattr(self, key), values)
        if self.outer is not None and self.outer.body == self.inner.body:
            raise contact_error(
                self.name, "outer", self.outer.body, "another body than the inner one, or none, is allowed"
            )


def _check_constant(contact: Contact, key: str) -> None:
    """Raise an InputError unless the friction constant `key` of a contact is finite, and 0 or more.

    A constant for which scenes refuse 0, such as a Stribeck speed, has to be more than 0.
    """
    quantity, value = quantity_of(RingFriction, key), getattr(contact, key)
    assert quantity is not None  # every key of friction has a unit
    unit, positive = "" if quantity.unit == "1" else f" {quantity.unit}", quantity.low > 0.0
    if not 0.0 <= value < np.inf or positive and value == 0.0:
        allowed = f"more than 0{unit} is allowed" if positive else f"0{unit} or more is allowed"
        raise contact_error(contact.name, key, value, allowed)


def contact_error(contact: str, key: str, value: object, allowed: str) -> InputError:
    """InputError about the `value` of the property `key` of the contact with the name `contact`.

    `allowed` says what is allowed.
    """
    return InputError("system", f"contacts.{contact}.{key}", value, allowed)


def pad_at_tail(pad: Contact, outer: str, path: str) -> Contact:
    r"""Contact of a pad at the tail of a section that slides within the next outer section, `outer`.

    In `pad`, ``inner.at`` is the distance d in m from the inner section's tail.  This tail is at the path
    coordinate s on the section `outer`, so that the two coordinates of the contact are

    .. math:: x_{in} = d,\; x_{out} = s + d

    `path` is the name of the path s(t), in m from the outer tail.
    """
    return replace(pad, outer=Place(outer, pad.inner.row, pad.inner.at, path))


def pad_at_mouth(pad: Contact, outer: str, path: str, length: float) -> Contact:
    r"""Contact of a pad at the mouth of a telescope's section `outer`, in which the next section slides.

    In `pad`, ``inner.at`` is the distance d in m from the mouth of the section `outer`.  With the `length` L of
    this section in m, the two coordinates of the contact are

    .. math:: x_{in} = L - d - s,\; x_{out} = L - d

    `path` is the name of the path s(t), the position of the inner section's tail in m from the outer tail.
    """
    row, x = pad.inner.row, length - pad.inner.at
    return replace(pad, inner=Place(pad.inner.body, row, x, path, -1.0), outer=Place(outer, row, x))


@dataclass(frozen=True)
class Compliance:
    """Compliance A(s) = constant + sum_q s_q slopes_q (m, m) of m contacts, without that of the bodies.

    The s_q are coordinates of Q paths.
    """

    constant: Array  # (m, m) m/N: where all paths are at 0
    paths: tuple[str, ...]  # (Q,): names of the paths that lengthen ropes
    slopes: Array  # (Q, m, m) 1/N

    @classmethod
    def from_contacts(cls, contacts: Sequence[Contact]) -> Compliance:
        """Compliance of a system's contacts.

        An InputError is raised if a contact bears the force of another contact, and there is no such contact.
        """
        names = [contact.name for contact in contacts]
        S = np.eye(len(contacts))
        for k, contact in enumerate(contacts):
            for name, share in contact.bears:
                if name not in names:
                    raise contact_error(contact.name, "bears", name, f"{', '.join(names)} are allowed")
                S[k, names.index(name)] += share
        compliances, grows = (
            np.array([getattr(contact, what) for contact in contacts]) for what in ("compliance", "lengthening")
        )
        changing = np.flatnonzero(grows)
        paths = tuple(dict.fromkeys(str(contacts[k].path) for k in changing))
        slopes = np.zeros((len(paths), *S.shape))
        for k in changing:
            slopes[paths.index(str(contacts[k].path))] += grows[k] * np.outer(S[k], S[k])
        return cls(S.T @ (compliances[:, None] * S), paths, slopes)

    @property
    def rigid(self) -> Mask:
        """Mask (m,) of the contacts that have no compliance of their own while all paths are at 0."""
        return np.diagonal(self.constant) == 0.0

    def matrix(self, s: Array) -> Array:
        """A(s) (..., m, m) in m/N with the paths at s (..., Q) in m."""
        return np.asarray(self.constant + np.tensordot(s, self.slopes, 1))

    def displacements(self, forces: Array, s: Array) -> Array:
        """Displacements A(s) lambda (T, m) in m by `forces` lambda (T, m) in N, with the paths at s (T, Q) in m."""
        return np.asarray(forces @ self.constant + np.einsum("tm,qmn,tq->tn", forces, self.slopes, s))

    def drum_work(self, forces: Array, s: Array) -> Array:
        """Work (T - 1,) in J that rope drums do on the boom in each of T - 1 steps.

        The contact forces are `forces` (T, m) in N and the paths are at s (T, Q) in m.  In each step, the mean of the
        forces at the step's two ends counts.
        """
        mean = (forces[1:] + forces[:-1]) / 2.0
        return np.asarray(-np.einsum("tm,qmn,tn,tq->t", mean, self.slopes, mean, np.diff(s, axis=0)) / 2.0)


@dataclass(frozen=True)
class Friction:
    """The n pads with friction among m contacts, and the cylinders that drive the J joints with such pads.

    The pads are grouped by joint.
    """

    joints: tuple[str, ...]  # names of the sections that slide, which are the names of their paths too
    pads: Indices  # (n,): numbers of the pads' contacts
    first_pads: Indices  # (J + 1,): index in `pads` of the first pad of each joint; n at the end
    cylinders: Indices  # (J,): numbers of the cylinders' contacts; -1 for a joint without a cylinder
    cylinder_compliance: Array  # (J,) m/N: compliance 1/k of the cylinders; 0 if rigid or missing
    laws: Array  # (n, l): constants of the friction laws, as `FrictionLaw.constants` returns them
    stiffness: Array  # (n,) N/m: stiffness kappa along the boom
    arms: Array  # (n,) m: distance e from the axis
    count: int  # number m of all contacts

    @classmethod
    def from_contacts(cls, contacts: Sequence[Contact]) -> Friction | None:
        """Friction of a system's contacts; None if no contact has friction.

        The cylinder of a joint is the contact of the kind ``cylinder`` whose inner place is on the section that slides.
        If there is none, it is the contact with the name that `pmr.scene.keys.cylinder_name` returns.
        """
        driving = {contact.inner.body: k for k, contact in enumerate(contacts) if contact.kind == "cylinder"}
        numbers = {contact.name: k for k, contact in enumerate(contacts)}  # in files of earlier versions all are pads
        joints = tuple(dict.fromkeys(contact.inner.body for contact in contacts if contact.friction))
        pads_of_joints = [
            [k for k, contact in enumerate(contacts) if contact.friction and contact.inner.body == name]
            for name in joints
        ]
        if not joints:
            return None
        pads = [k for of_joint in pads_of_joints for k in of_joint]
        cylinders = [driving.get(name, numbers.get(cylinder_name(name), -1)) for name in joints]
        return cls(
            joints,
            np.array(pads, np.int64),
            np.cumsum([0, *map(len, pads_of_joints)]),
            np.array(cylinders, np.int64),
            np.array([0.0 if k < 0 else contacts[k].compliance for k in cylinders]),
            np.array([contacts[k].constants for k in pads]),
            np.array([contacts[k].shear_stiffness for k in pads]),
            np.array([contacts[k].arm for k in pads]),
            len(contacts),
        )

    def joint_totals(self, friction: Array) -> Array:
        """Sum of the friction in each joint (..., J) in N, from the `friction` (..., n) in N of all pads."""
        return np.asarray(np.add.reduceat(friction, self.first_pads[:-1], axis=-1))

    def cylinder_forces(self, friction: Array) -> Array:
        """Forces (..., m) in N by which friction loads the m contacts.

        A cylinder bears the friction of its joint's pads, other contacts bear none.  The friction of the pads is
        `friction` (..., n) in N.
        """
        return self._at_cylinders(self.joint_totals(friction))

    def _at_cylinders(self, of_joints: Array) -> Array:
        """Values (..., m) at all contacts: those `of_joints` (..., J) at the joints' cylinders, zero at all others."""
        of_contacts, driven = np.zeros((*of_joints.shape[:-1], self.count)), self.cylinders >= 0
        of_contacts[..., self.cylinders[driven]] = of_joints[..., driven]
        return of_contacts

    def moments(self, friction: Array, forces: Array) -> Array:
        """Moments (..., m) in N m of the pads' friction (..., n) in N on all contacts.

        A moment is the friction times the pad's arm, with the sign of the pad's contact force.  The moment is zero on
        contacts without friction.  `forces` (..., m) in N are those of all contacts.
        """
        pad_moments = np.zeros(forces.shape)
        pad_moments[..., self.pads] = self.arms * np.sign(forces[..., self.pads]) * friction
        return pad_moments

    def compressions(self, friction: Array) -> Array:
        """Compression (..., m) in m of the joints' cylinders by the `friction` (..., n) in N of the pads.

        For contacts that are no such cylinders the result is zero.
        """
        return self.compressions_by_totals(self.joint_totals(friction))

    def compressions_by_totals(self, totals: Array) -> Array:
        """Compression (..., m) in m of the joints' cylinders, by the friction `totals` (..., J) in N of the joints.

        For contacts that are no such cylinders the result is zero.
        """
        return self._at_cylinders(self.cylinder_compliance * totals)

    def stored_energy(self, friction: Array, forces: Array) -> Array:
        """Energy (...) in J that cylinders store because of friction, beyond lambda^2 / 2 k.

        k is a cylinder's stiffness, and lambda the part of its force that reaches the sections.  The pads have the
        `friction` (..., n) in N.  `forces` (..., m) in N are those of all contacts, in which the forces of cylinders
        include the friction.
        """
        total = self.joint_totals(friction)
        return np.asarray(
            np.sum(self.cylinder_compliance * total * (forces[..., self.cylinders] - total / 2.0), axis=-1)
        )


def friction_joints(contacts: Sequence[Contact]) -> tuple[str, ...]:
    """Names of the sections that slide with friction on `contacts`, one for each joint; empty if none has friction."""
    friction = Friction.from_contacts(contacts)
    return () if friction is None else friction.joints
