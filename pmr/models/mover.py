r"""Mass that crosses another section on a wheel: one or two vertical displacements, and one along the section.

.. math::
    m\, \ddot z + d\, (\dot z - \dot u) + k\, (z - u) = f, \qquad
    m_w\, \ddot u + d\, (\dot u - \dot z) + k\, (u - z) = -\lambda

z is the displacement of the mass m, on which loads f act; u is that of the wheel :math:`m_w`, which presses on the
section under it with the force :math:`-\lambda`; k and d are the spring and the damper between them.  Without a
stiffness there is one displacement, of mass and wheel together.  Along a section that has displacements along its axis
mass and wheel have one together, which the drive holds.  L. Fryba: Vibration of Solids and Structures under
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
from pmr.scene.choice import motion_directions
from pmr.scene.members import Member
from pmr.scene.structures import MoverBody


@dataclass(frozen=True)
class Mover:
    """Structural model of a mover with the displacements z of its mass and u of its wheel as coordinates.

    If no spring is between mass and wheel, z is the displacement of both, and u is left out.  If the mover also moves
    along the section, the displacement x along it is the last coordinate.
    """

    body: MoverBody
    directions: tuple[str, ...] = ("z",)  # or x, z

    @property
    def wheel(self) -> int:
        """Number of the wheel's coordinate along z: 0 if it moves with the mass, 1 if a spring is between them."""
        return 0 if self.body.stiffness == "rigid" else 1

    @property
    def size(self) -> int:
        """Number of coordinates, 1 to 3."""
        return self.wheel + len(self.directions)

    @property
    def M(self) -> sp.csr_matrix:
        """Mass (n, n) in kg."""
        mass, wheel = self.body.mass, self.body.wheel_mass
        along = [mass + wheel] * (len(self.directions) - 1)
        return sp.csr_matrix(np.diag([*([mass, wheel] if self.wheel else [mass + wheel]), *along]))

    @property
    def K(self) -> sp.csr_matrix:
        """Stiffness (n, n) in N/m."""
        K = np.zeros((self.size, self.size))
        if self.body.stiffness != "rigid":
            K[:2, :2] = self.body.stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]])
        return sp.csr_matrix(K)

    @property
    def reference_frequency(self) -> float:
        """Frequency in rad/s of the mass on its spring; 1 without a spring."""
        return 1.0 if self.body.stiffness == "rigid" else float(np.sqrt(self.body.stiffness / self.body.mass))

    @property
    def node_stations(self) -> Array:
        """Both ends (2,) in m of the stretch that stands for the mover."""
        return np.array([0.0, self.body.length])

    def displacement(self, *places: str | float) -> sp.csr_matrix:
        """Rows (p t, n) of the displacements of p places along the t `directions`; every place moves as the mass.

        Raises the InputError of `centroid`.
        """
        for place in places:
            self.centroid(place)
        return sp.csr_matrix(np.tile(np.eye(self.size)[self._of_mass], (len(places), 1)))

    @property
    def _of_mass(self) -> list[int]:
        """Numbers of the coordinates of the mass along its `directions`."""
        return [0 if axis == "z" else self.size - 1 for axis in self.directions]

    def motion(self, place: str | float, about: Array | None = None) -> sp.csr_matrix:
        """Rows (t, n) of the displacements along the t directions, the same for every `place`; `about` is not used.

        Raises the InputError of `centroid`.
        """
        return self.displacement(place)

    def centroid(self, place: str | float) -> Array:
        """Position (3,) in m of a place on the axis: ``tail``, ``tip`` or a distance in m.

        Raises an `InputError` for another name.
        """
        ends = {"tail": 0.0, "tip": self.body.length}
        if isinstance(place, str) and place not in ends:
            raise InputError("scene", "place", place, "tail, tip or a number is allowed on a mover")
        return np.array([ends[place] if isinstance(place, str) else place, 0.0, 0.0])

    def strip(self, face: str, window: Window) -> Strip:
        """Raise an `InputError` about the `face`, as a mover has no faces; `window` is not used."""
        raise InputError("scene", "pads.on", face, "a point, without faces, is allowed on a mover")

    def coordinates_on(self, place: str, directions: Sequence[str]) -> Indices:
        """Numbers (k,) of the mass's coordinates along the given `directions`, without directions that the mover lacks.

        The numbers are the same for every `place`.
        """
        return np.array([k for k, axis in zip(self._of_mass, self.directions, strict=True) if axis in directions], int)

    def rigid_motions(self) -> Array:
        """Coordinates (n, t) under unit translations along the t `directions`."""
        along = np.arange(self.size) > self.wheel
        return np.stack([along if axis == "x" else ~along for axis in self.directions], axis=1).astype(float)


def from_member(member: Member) -> Mover:
    """Structural model of a mass that crosses another section of a scene."""
    assert member.part.body.mover is not None  # the scene's check
    return Mover(member.part.body.mover, motion_directions(member))
