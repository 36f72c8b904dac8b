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
    """Friction of n pads in J joints at the end of a step; empty without any."""

    forces: Array = field(default_factory=lambda: np.zeros(0))  # (n,) N
    s: Array = field(default_factory=lambda: np.zeros(0))  # (J,) m: where the paths lead
    drives: Array = field(default_factory=lambda: np.zeros(0))  # (J,) N: of the cylinders

    @classmethod
    def at_start(cls, contacts: Sequence[Contact], s: Array, multipliers: Array) -> Grip:
        """Grip at the start, at s (J,) m, without friction."""
        law = Friction.of(contacts)
        if law is None:
            return cls()
        return cls(np.zeros(len(law.pads)), s.copy(), np.where(law.cylinders < 0, 0.0, multipliers[law.cylinders]))


def slide(law: Friction, old: Grip, sums: Array, s: Array, multipliers: Array, matrix: Array) -> Grip:
    """Grip after a step to s (J,) m with multipliers (m,) N, solved under joints' friction `sums` (J,) N.

    `matrix` (m, m) is that of the multipliers, of which the diagonal counts.
    """
    forces = np.zeros(len(old.forces))
    driven = np.where(law.cylinders < 0, 0.0, multipliers[law.cylinders])
    for joint, (c, gives) in enumerate(zip(law.cylinders, law.gives, strict=True)):
        of_joint = slice(law.first[joint], law.first[joint + 1])
        cylinder = JointCylinder(gives, matrix[c, c], driven[joint], sums[joint], old.drives[joint])
        pads, travel = law.pads[of_joint], s[joint] - old.s[joint]
        forces[of_joint] = slide_pads(
            law.stiffness[of_joint],
            law.coefficients[of_joint],
            multipliers[pads],
            old.forces[of_joint],
            travel,
            cylinder,
        )
    return Grip(forces, s, driven + law.totals(forces))
