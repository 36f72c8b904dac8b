r"""Friction of pads along the boom, in the equations of motion.

A pad that presses with N, while its section slides out by :math:`\Delta y` in a step, pulls that back with f, and the
outer one on:

.. math:: f_{n+1} = \max(-\mu |N|, \min(\mu |N|, f_n + \kappa\, \Delta y))

It sticks, as a spring of the pad's stiffness :math:`\kappa` along the boom, until that would take more than Coulomb's
:math:`\mu |N|`, and slides at that: an elastic, perfectly plastic element with one state a pad, f itself, and no
speed in it (Jenkins' element; W. D. Iwan, A distributed-element model for hysteresis, Journal of Applied Mechanics 33,
1966, 893-900).  What it turns into heat is f times what it slides, :math:`\Delta y - \Delta f / \kappa`.

With :math:`\Lambda` the force of the joint's cylinder of stiffness k, of which :math:`\lambda = \Lambda - \sum f`
reaches the sections, the pads of a joint slide by the extension and by what the cylinder gives way,

.. math:: y = s - \Lambda / k, \qquad C q + H f - G \lambda - \lambda / k = \sum f / k

so a section that swings on its cylinder rubs too.  All along the boom as stiff as sections are, friction is a force
between both tails, and on the face that a pad touches, a distance e from the axis, a moment e f on both sections, the
work of which is :math:`e f\, c'(x) q` with the pad's row c(x).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.scene.names import cylinder_of
from pmr.system.contacts import Contact

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Friction:
    """The n pads that rub among m contacts, one joint after the other, and the cylinders of these J joints."""

    joints: tuple[str, ...]  # names of the sections that slide, by which their paths are called too
    pads: Indices  # (n,): numbers of their contacts
    first: Indices  # (J + 1,): where the pads of each joint begin
    cylinders: Indices  # (J,): numbers of these contacts; -1 of a joint without
    gives: Array  # (J,) m/N: 1/k of these; 0 of a rigid one or none
    coefficients: Array  # (n,): mu
    stiffness: Array  # (n,) N/m: kappa
    arms: Array  # (n,) m: e
    count: int  # m

    @classmethod
    def of(cls, contacts: Sequence[Contact]) -> Friction | None:
        """Friction of the contacts of a system; None without any."""
        numbers = {contact.name: k for k, contact in enumerate(contacts)}
        joints = tuple(dict.fromkeys(contact.inner.body for contact in contacts if contact.friction))
        pads_of_joints = [
            [k for k, contact in enumerate(contacts) if contact.friction and contact.inner.body == name]
            for name in joints
        ]
        if not joints:
            return None
        pads = [k for of_joint in pads_of_joints for k in of_joint]
        cylinders = [numbers.get(cylinder_of(name), -1) for name in joints]
        return cls(
            joints,
            np.array(pads, np.int64),
            np.cumsum([0, *map(len, pads_of_joints)]),
            np.array(cylinders, np.int64),
            np.array([0.0 if k < 0 else contacts[k].compliance for k in cylinders]),
            np.array([contacts[k].friction for k in pads]),
            np.array([contacts[k].shear_stiffness for k in pads]),
            np.array([contacts[k].arm for k in pads]),
            len(contacts),
        )

    def totals(self, friction: Array) -> Array:
        """Friction of each joint, (..., J) N, from that of its pads (..., n) N."""
        return np.asarray(np.add.reduceat(friction, self.first[:-1], axis=-1))

    def along(self, friction: Array) -> Array:
        """Friction (..., m) in N that the contacts bear of the pads' (..., n) N: cylinders, that of their joints."""
        borne, driven = np.zeros((*friction.shape[:-1], self.count)), self.cylinders >= 0
        borne[..., self.cylinders[driven]] = self.totals(friction)[..., driven]
        return borne

    def moments(self, friction: Array, forces: Array) -> Array:
        """Moments (..., m) in N m of the pads' friction (..., n) N, on the faces that the contacts' forces press on."""
        pad_moments = np.zeros(forces.shape)
        pad_moments[..., self.pads] = self.arms * np.sign(forces[..., self.pads]) * friction
        return pad_moments

    def gaps(self, friction: Array) -> Array:
        """By how much (..., m) m cylinders give way to it."""
        return self.gaps_of(self.totals(friction))

    def gaps_of(self, totals: Array) -> Array:
        """By how much (..., m) m cylinders give way to the friction of their joints (..., J) N."""
        gaps, driven = np.zeros((*totals.shape[:-1], self.count)), self.cylinders >= 0
        gaps[..., self.cylinders[driven]] = (self.gives * totals)[..., driven]
        return gaps

    def stored(self, friction: Array, forces: Array) -> Array:
        r"""Energy in J that cylinders store beyond lambda^2 / 2 k, with the forces (..., m) N of all contacts."""
        total = self.totals(friction)
        return np.asarray(np.sum(self.gives * total * (forces[..., self.cylinders] - total / 2.0), axis=-1))


def joints_of(contacts: Sequence[Contact]) -> tuple[str, ...]:
    """`Friction.joints`, none without friction."""
    friction = Friction.of(contacts)
    return () if friction is None else friction.joints
