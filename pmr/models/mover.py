r"""Mass that crosses another section on a wheel: one or two vertical displacements.

.. math::
    m\, \ddot z + d\, (\dot z - \dot u) + k\, (z - u) = f, \qquad
    m_w\, \ddot u + d\, (\dot u - \dot z) + k\, (u - z) = -\lambda

z is the displacement of the mass m, on which loads f act; u is that of the wheel :math:`m_w`, which presses on the
section under it with the force :math:`-\lambda`; k and d are the spring and the damper between them.  Without a
stiffness there is one displacement, of mass and wheel together.  L. Fryba: Vibration of Solids and Structures under
Moving Loads, 3rd ed., 1999, chapters 1, 2 and 8.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from pmr.errors import InputError
from pmr.files.arrays import Array, Indices
from pmr.models.trace import Strip, Window
from pmr.scene.structures import MoverBody


@dataclass(frozen=True)
class Mover:
    """Structural model of a mover, whose coordinates are [z, u], or z alone without a stiffness."""

    body: MoverBody
    directions: tuple[str, ...] = ("z",)

    @property
    def size(self) -> int:
        """Number of coordinates, 1 or 2."""
        return 1 if self.body.stiffness == "rigid" else 2

    @property
    def M(self) -> sp.csr_matrix:
        """Mass (n, n) in kg."""
        mass, wheel = self.body.mass, self.body.wheel_mass
        return sp.csr_matrix(np.diag([mass, wheel] if self.size == 2 else [mass + wheel]))

    @property
    def K(self) -> sp.csr_matrix:
        """Stiffness (n, n) in N/m."""
        if self.body.stiffness == "rigid":
            return sp.csr_matrix((1, 1))
        return sp.csr_matrix(self.body.stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]]))

    @property
    def reference_frequency(self) -> float:
        """Frequency in rad/s of the mass on its spring; 1 without a spring."""
        return 1.0 if self.body.stiffness == "rigid" else float(np.sqrt(self.body.stiffness / self.body.mass))

    @property
    def node_stations(self) -> Array:
        """Both ends (2,) in m of the stretch that stands for the mover."""
        return np.array([0.0, self.body.length])

    def displacement(self, *places: str | float) -> sp.csr_matrix:
        """Rows (p, n) of the displacement z, which is that of all places."""
        return sp.csr_matrix(np.tile(np.eye(1, self.size), (len(places), 1)))

    def motion(self, place: str | float, about: Array | None = None) -> sp.csr_matrix:
        """Row (1, n) of the displacement z, the same for every `place`; `about` is not used."""
        return self.displacement(place)

    def centroid(self, place: str | float) -> Array:
        """Position (3,) in m of a place on the axis; InputError for a group other than tail and tip."""
        ends = {"tail": 0.0, "tip": self.body.length}
        if isinstance(place, str) and place not in ends:
            raise InputError("scene", "place", place, "tail, tip or a number is allowed on a mover")
        return np.array([ends[place] if isinstance(place, str) else place, 0.0, 0.0])

    def strip(self, face: str, window: Window) -> Strip:
        """Raise an `InputError`: a mover has no faces."""
        raise InputError("scene", "pads.on", face, "a point, without faces, is allowed on a mover")

    def coordinates_on(self, place: str, directions: Sequence[str]) -> Indices:
        """Number of the coordinate z if `directions` have z, else no number; the same for every `place`."""
        return np.arange(int("z" in directions))

    def rigid_motions(self) -> Array:
        """Coordinates (n, 1) under a unit translation along z."""
        return np.ones((self.size, 1))
