"""What pads hold by friction (`pmr.system.friction`) from step to step, by the law of the compiled loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pmr.kernel.laws import JointCylinder, slide_pads
from pmr.system.contacts import Contact
from pmr.system.friction import Friction

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Grip:
    """What n pads in J joints hold at the end of a step; empty without any."""

    forces: Array = field(default_factory=lambda: np.zeros(0))  # (n,) N
    s: Array = field(default_factory=lambda: np.zeros(0))  # (J,) m: where the paths lead
    drives: Array = field(default_factory=lambda: np.zeros(0))  # (J,) N: of the cylinders

    @classmethod
    def begun(cls, contacts: Sequence[Contact], s: Array, multipliers: Array) -> Grip:
        """At the start, at s (J,) m, without friction."""
        known = Friction.of(contacts)
        if known is None:
            return cls()
        return cls(
            np.zeros(len(known.pads)), s.copy(), np.where(known.cylinders < 0, 0.0, multipliers[known.cylinders])
        )


def slid(known: Friction, old: Grip, given: Array, s: Array, multipliers: Array, matrix: Array) -> Grip:
    """After a step to s (J,) m that ends with multipliers (m,) N, found under joints' friction `given` (J,) N.

    `matrix` (m, m) is that of the multipliers, of which the diagonal counts.
    """
    forces = np.zeros(len(old.forces))
    driven = np.where(known.cylinders < 0, 0.0, multipliers[known.cylinders])
    for joint, (c, gives) in enumerate(zip(known.cylinders, known.gives, strict=True)):
        own = slice(known.first[joint], known.first[joint + 1])
        cylinder = JointCylinder(gives, matrix[c, c], driven[joint], given[joint], old.drives[joint])
        pads, moved = known.pads[own], s[joint] - old.s[joint]
        forces[own] = slide_pads(
            known.stiffness[own], known.coefficients[own], multipliers[pads], old.forces[own], moved, cylinder
        )
    return Grip(forces, s, driven + known.totals(forces))
