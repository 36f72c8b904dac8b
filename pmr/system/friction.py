r"""Friction of pads along the boom, in the equations of motion.

A pad that presses with N on a section which slides out at :math:`\dot s` pulls it back with F, and the outer one on,

.. math:: F = \mu |N| \tanh(\dot s / v)

on the face that it touches, a distance e from the axis.  With the pad's row c(x), and all along the boom as stiff as
sections are, these are

- a moment e F on both sections, the work of which is :math:`e F\, c'(x) q`: a pad pushes as one that sits
  :math:`e \mu \tanh(\dot s / v)` nearer to the tail does, while it measures where it is;
- a force F between both tails.  There the joint's cylinder acts, whose force is F and what it is without friction;
  where it gives way by 1/k, its gap has F/k beside all else.

The speed is that of the path: by how much faster or slower sections slide because they or the cylinder give way is left
out, and so is what friction holds at rest.
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
    """What n pads do by their friction beside pushing, among m contacts; nothing where a rigid cylinder bears it all.

    Its amplitudes tanh(s'/v) are those of `joints`, in their order.
    """

    joints: tuple[str, ...]  # names of the sections that slide
    pads: Indices  # (n,): numbers of their contacts
    drives: Indices  # (n,): numbers of their joints
    arms: Array  # (n,) m: e mu
    given_way: Array  # (m, n) m/N: mu / k in the row of a cylinder that gives way

    @classmethod
    def of(cls, contacts: Sequence[Contact]) -> Friction | None:
        """Of the contacts of a system; None without any."""
        numbers = {one.name: k for k, one in enumerate(contacts)}
        drives = {k: numbers.get(cylinder_of(one.inner.body)) for k, one in enumerate(contacts) if one.friction}
        gives = {k: 0.0 if at is None else contacts[at].compliance for k, at in drives.items()}
        pads = [k for k in drives if contacts[k].arm or gives[k]]
        joints = tuple(dict.fromkeys(contacts[k].inner.body for k in pads))
        given_way = np.zeros((len(contacts), len(pads)))
        for n, k in enumerate(pads):
            if (at := drives[k]) is not None:
                given_way[at, n] = contacts[k].friction * gives[k]
        return (
            None
            if not pads
            else cls(
                joints,
                np.array(pads, np.int64),
                np.array([joints.index(contacts[k].inner.body) for k in pads], np.int64),
                np.array([contacts[k].friction * contacts[k].arm for k in pads]),
                given_way,
            )
        )

    def moments(self, forces: Array, c: Array) -> Array:
        """Moments (..., m) in N m of the contacts' forces (..., m) N, with the joints' amplitudes c (..., J)."""
        found = np.zeros(forces.shape)
        found[..., self.pads] = self.arms * c[..., self.drives] * forces[..., self.pads]
        return found

    def gaps(self, forces: Array, c: Array) -> Array:
        """By how much (m,) m cylinders give way to friction, likewise."""
        return np.asarray(self.given_way @ (c[self.drives] * np.abs(forces[self.pads])))


def joints_of(contacts: Sequence[Contact]) -> tuple[str, ...]:
    """`Friction.joints`, none without friction."""
    found = Friction.of(contacts)
    return () if found is None else found.joints
