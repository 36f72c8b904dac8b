r"""Properties of a beam's section from its profile, and the mass of transverse plates inside a box.

Area and second moments are those of the plates with their thickness, exactly: plates that meet at a sharp corner are
mitred there, rounded corners are sectors of a ring.  All other properties follow from the shear flow q in thin walls
under a transverse force V.  With the arc length s, the thickness t, the vector p from the walls' centroid to a point of
the mid-line, the outward normal n, the area :math:`A_m` that the mid-line encloses, and the flow :math:`q_0` at s = 0:

.. math::
    q = q_0 - V^T I^{-1} Q(s), \qquad Q(s) = \int_0^s t\, p\, ds, \qquad I = \oint t\, p\, p^T ds, \qquad
    \oint \frac{q}{t} ds = 0

The shear centre is where V has the moment of q, :math:`\oint q\, (p \cdot n)\, ds`.  The torsion constant is Bredt's,
:math:`4 A_m^2 / \oint ds / t` (Young, Budynas, Sadegh: Roark's Formulas for Stress and Strain, 8th ed., 2012, section
10.3).  The shear areas are :math:`V^2 / \oint (q^2 / t) ds`, from the energy of the flow, times a factor for Poisson's
ratio :math:`\nu`.  The factor is that by which :math:`\nu` changes Cowper's coefficient :math:`\kappa` of the box of
the same width and height: with :math:`m = b / h`, h along the force and b across it,

.. math::
    \kappa = \frac{10 (1 + \nu) (1 + 3 m)^2}{12 + 72 m + 150 m^2 + 90 m^3 + \nu (11 + 66 m + 135 m^2 + 90 m^3)
             + 10 m^2 ((3 + \nu) m + 3 m^2)}

For :math:`\nu = 0` this is the coefficient from the energy.  Cowper: The shear coefficient in Timoshenko's beam theory,
Journal of Applied Mechanics 33, 1966, 335-340, table 1.  For a circular tube the shear area is exact within 2 %.  Left
out: warping, which is free, and the shear that a force along one principal axis makes along the other.

The mass of transverse plates within a box is spread over the elements of its beam.  With the outline of a plane figure
counter-clockwise, its normal n outwards, the vector p from the beam's axis and the area A,

.. math:: A = \frac12 \oint p \cdot n\, ds, \qquad \int p\, dA = \frac13 \oint p\, (p \cdot n)\, ds, \qquad
    \int p\, p^T dA = \frac14 \oint p\, p^T (p \cdot n)\, ds

A ring is the figure within the walls' mid-line less the figure within the mid-line moved inwards by the ring's depth.
A plate's mass is shared by the two elements between whose middles the plate is, so that the sum of the masses and their
centre are exact.  The mass of a plate before the first middle goes to the first element alone, that of a plate behind
the last middle to the last element.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pmr.files.arrays import Array
from pmr.models.box_mesh import shifted_ends
from pmr.scene.box import Box
from pmr.scene.profile import BoxProfile, Side
from pmr.scene.structures import BeamSection

#: Gauss' points and weights on (0, 1): exact for straight plates, and to round-off for arcs.
_X, _W = np.polynomial.legendre.leggauss(16)
POINTS, WEIGHTS = (_X + 1.0) / 2.0, _W / 2.0
#: Centroids and products of inertia below this share of the section's size count as round-off of symmetry.
ROUND_OFF = 1e-12


@dataclass(frozen=True)
class MidLine:
    """The mid-line of a profile's walls, with k sides and q Gauss points on each side."""

    profile: BoxProfile

    @cached_property
    def sides(self) -> tuple[Side, ...]:
        """Sides of the profile, counter-clockwise."""
        return self.profile.sides

    @cached_property
    def lengths(self) -> Array:
        """Lengths (k,) in m of the sides."""
        return np.array([side.length for side in self.sides])

    @cached_property
    def thickness(self) -> Array:
        """Thicknesses (k,) in m of the sides."""
        return np.array([side.thickness for side in self.sides])

    @cached_property
    def points(self) -> Array:
        """Coordinates y and z (k, q, 2) in m of the Gauss points."""
        return np.array([points_along(side, POINTS) for side in self.sides])

    @cached_property
    def lever(self) -> Array:
        """Products p . n of the Gauss points p with the outward normals n, (k, q) m."""
        return np.einsum("kqi,kqi->kq", self.points, np.array([normals(side, POINTS) for side in self.sides]))

    @property
    def enclosed_area(self) -> float:
        """Area that the line encloses, m^2."""
        return float(np.einsum("k,kq,q", self.lengths, self.lever, WEIGHTS)) / 2.0

    @property
    def middle(self) -> Array:
        """Centroid (2,) in m of the line, without regard to thickness: the mean position over the end of a shell."""
        return _zero_round_off(
            np.einsum("k,kqi,q", self.lengths, self.points, WEIGHTS) / self.lengths.sum(), self._size
        )

    @property
    def torsion_constant(self) -> float:
        """Bredt's torsion constant, m^4."""
        return float(4.0 * self.enclosed_area**2 / (self.lengths / self.thickness).sum())

    @cached_property
    def centroid(self) -> Array:
        """Centroid of the thin walls, (2,) m."""
        weights = self.lengths * self.thickness
        return np.einsum("k,kqi,q", weights, self.points, WEIGHTS) / weights.sum()

    @cached_property
    def second_moments(self) -> Array:
        """Second moments of the thin walls about their centroid, (2, 2) m^4: integrals of y^2, y z and z^2."""
        p = self.points - self.centroid
        return np.einsum("k,kqi,kqj,q", self.lengths * self.thickness, p, p, WEIGHTS)

    @cached_property
    def flow(self) -> Array:
        """Shear flow (k, q, 2) in 1/m at q Gauss points on each of k sides, under unit forces along y and z."""
        first = np.zeros(2)
        moments = []
        for side in self.sides:
            moments.append(first + _first_moments(side, POINTS, self.centroid))
            first = first + _first_moments(side, np.ones(1), self.centroid)[0]
        flow = -np.array(moments) @ np.linalg.inv(self.second_moments)
        compliance = self.lengths / self.thickness
        return np.asarray(flow - np.einsum("k,kqi,q", compliance, flow, WEIGHTS) / compliance.sum())

    @property
    def shear_compliance(self) -> Array:
        """Inverse shear areas (2, 2) in 1/m^2: the integrals of q_i q_j / t along the line.

        q_1 and q_2 are the shear flows of unit forces along y and z, and t is the thickness.
        """
        return np.einsum("k,kqi,kqj,q", self.lengths / self.thickness, self.flow, self.flow, WEIGHTS)

    @property
    def shear_centre(self) -> Array:
        """Shear centre, (2,) m."""
        moments = np.einsum("k,kq,kqi,q", self.lengths, self.lever, self.flow, WEIGHTS)
        return _zero_round_off(np.array([moments[1], -moments[0]]), self._size)

    @property
    def _size(self) -> float:
        """The larger of width and height, m, by which round-off is judged."""
        return max(self.profile.width, self.profile.height)


def section_of(profile: BoxProfile, poisson: float) -> BeamSection:
    """Section properties of a profile, for the material's Poisson ratio `poisson`."""
    line, total = MidLine(profile), FigureMoments()
    for k, side in enumerate(line.sides):
        neighbours = line.sides[k - 1], line.sides[(k + 1) % len(line.sides)]
        total = total.plus(_sector(side) if side.centre is not None else _strip(side, *neighbours))
    centroid = _zero_round_off(total.first / total.area, max(profile.width, profile.height))
    second = total.second - total.area * np.outer(centroid, centroid)
    (b, h), shear = np.ptp([edge.start for edge in profile.edges], axis=0), np.diag(line.shear_compliance)
    (y, z), (y_s, z_s) = centroid, line.shear_centre
    return BeamSection(
        area=total.area,
        second_moment_y=float(second[1, 1]),
        second_moment_z=float(second[0, 0]),
        product_of_inertia=float(_zero_round_off(second[:1, 1], second.trace())[0]),
        torsion_constant=line.torsion_constant,
        shear_area_y=float(_poisson_factor(h, b, poisson) / shear[0]),
        shear_area_z=float(_poisson_factor(b, h, poisson) / shear[1]),
        centroid=(float(y), float(z)),
        shear_centre=(float(y_s), float(z_s)),
    )


def _zero_round_off(values: Array, size: float) -> Array:
    """Copy of `values` (any shape), with zeros for values that are round-off compared with `size`."""
    return np.asarray(np.where(np.abs(values) > ROUND_OFF * size, values, 0.0))


def _arc_angles(side: Side, x: Array) -> Array:
    """Angles (q,) in rad of points at the shares x (q,) in [0, 1] along the arc of a `side`."""
    y, z = np.subtract(side.start, side.centre or (0.0, 0.0))
    return np.asarray(np.arctan2(z, y) + side.angle * x)


def points_along(side: Side, x: Array) -> Array:
    """Points (q, 2), y and z in m, at q shares x (q,) in [0, 1] along a side."""
    if side.centre is None:
        return np.asarray(side.start + x[:, None] * np.subtract(side.end, side.start))
    angle = _arc_angles(side, x)
    return np.asarray(side.centre + side.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def normals(side: Side, x: Array) -> Array:
    """Outward unit vectors (q, 2) at q shares x (q,) in [0, 1] along a side."""
    if side.centre is None:
        return np.tile(side.normal, (len(x), 1))
    angle = _arc_angles(side, x)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _first_moments(side: Side, x: Array, centroid: Array) -> Array:
    """Integrals (q, 2) in m^3 of t p ds from a side's start to the shares x (q,) along the side.

    s is the length along the side, t the side's thickness, p the vector from `centroid` (2,) to the mid-line.
    """
    s = (side.length * x)[:, None]
    if side.centre is None:
        return np.asarray(side.thickness * ((side.start - centroid) * s + side.direction * s**2 / 2.0))
    angle, start = _arc_angles(side, x), _arc_angles(side, np.zeros(1))
    turned = np.stack([np.sin(angle) - np.sin(start), np.cos(start) - np.cos(angle)], axis=1)
    return np.asarray(side.thickness * ((side.centre - centroid) * s + side.radius**2 * turned))


def _strip(side: Side, before: Side, after: Side) -> FigureMoments:
    """Area and moments of the flat plate of a `side`, mitred at sharp corners with the sides `before` and `after`."""
    x, w = np.polynomial.legendre.leggauss(3)
    out = x * side.thickness / 2.0
    start = out * _mitre(side, before)
    length = side.length - out * _mitre(side, after) - start
    middle = np.add(side.start, np.outer(out, side.normal) + np.outer(start + length / 2.0, side.direction))
    area = w * side.thickness / 2.0 * length
    along = np.outer(side.direction, side.direction) * (area @ length**2) / 12.0
    second = np.einsum("q,qi,qj", area, middle, middle) + along
    return FigureMoments(float(area.sum()), area @ middle, second)


def _mitre(side: Side, other: Side) -> float:
    """Slope of the cut at the end of a `side`, where it meets the side `other` in a mitre.

    The slope is the length by which the side is shorter at its outer face than at its mid-line, divided by the distance
    between these two.  It is negative if the side is longer outside, and 0 next to an arc.
    """
    if other.centre is not None:
        return 0.0
    cosine = float(side.direction @ other.direction)
    return float((cosine * side.thickness - other.thickness) / np.sqrt(1.0 - cosine**2) / side.thickness)


def _sector(side: Side) -> FigureMoments:
    """Area and moments of a rounded corner `side`, a sector of a ring."""
    r, t, centre = side.radius, side.thickness, np.array(side.centre)
    a, b = _arc_angles(side, np.array([0.0, 1.0]))
    c, s, twice = np.sin(b) - np.sin(a), np.cos(a) - np.cos(b), (np.sin(2.0 * b) - np.sin(2.0 * a)) / 4.0
    area, mixed = r * t * side.angle, (np.sin(b) ** 2 - np.sin(a) ** 2) / 2.0
    first = (r**2 * t + t**3 / 12.0) * np.array([c, s])
    half = side.angle / 2.0
    second = (r**3 * t + r * t**3 / 4.0) * np.array([[half + twice, mixed], [mixed, half - twice]])
    shift = np.outer(centre, first)
    second = second + shift + shift.T + area * np.outer(centre, centre)
    return FigureMoments(float(area), area * centre + first, second)


def _poisson_factor(across: float, along: float, nu: float) -> float:
    """Factor by which Poisson's ratio `nu` changes the shear coefficient of a box.

    The box has the size `along` (m) along the force and the size `across` (m) across the force.
    """
    return _shear_coefficient(across / along, nu) / _shear_coefficient(across / along, 0.0)


def _shear_coefficient(m: float, nu: float) -> float:
    """Cowper's shear coefficient kappa of a thin-walled box with Poisson's ratio `nu`.

    m is the size of the box across the force, divided by its size along the force.
    """
    return (
        10.0 * (1.0 + nu) * (1.0 + 3.0 * m) ** 2
        / (
            12.0 + 72.0 * m + 150.0 * m**2 + 90.0 * m**3
            + nu * (11.0 + 66.0 * m + 135.0 * m**2 + 90.0 * m**3)
            + 10.0 * m**2 * ((3.0 + nu) * m + 3.0 * m**2)
        )
    )  # fmt: skip


@dataclass(frozen=True)
class FigureMoments:
    """Integrals of 1, p and p p^T over a plane figure, where p is the vector from the beam's axis."""

    area: float = 0.0  # m^2
    first: Array = field(default_factory=lambda: np.zeros(2))  # (2,) m^3
    second: Array = field(default_factory=lambda: np.zeros((2, 2)))  # (2, 2) m^4

    def plus(self, other: FigureMoments, factor: float = 1.0) -> FigureMoments:
        """Integrals over this figure plus `factor` times those over `other`; -1 cuts a figure out of this one."""
        first, second = self.first + factor * other.first, self.second + factor * other.second
        return FigureMoments(self.area + factor * other.area, first, second)


@dataclass(frozen=True)
class RingMasses:
    """Areas and moments that transverse plates add to each of E elements, spread over the element's length."""

    ends: Array  # (E + 1,) m: ends of the elements along the axis
    area: Array  # (E,) m^2
    first: Array  # (E, 2) m^3: first moments about the axis
    second: Array  # (E, 2, 2) m^4

    def at_positions(self, places: Array) -> RingMasses:
        """Areas and moments of the elements that contain the coordinates `places` (e,) m, one for each place.

        `ends` stays as it is, with the ends of all elements.
        """
        number = np.clip(np.searchsorted(self.ends, places) - 1, 0, len(self.area) - 1)
        return replace(self, area=self.area[number], first=self.first[number], second=self.second[number])

    @cached_property
    def centroid(self) -> Array:
        """Centroids (E, 2) in m of the added areas; zero where nothing is added."""
        return self.first / np.where(self.area > 0.0, self.area, 1.0)[:, None]

    @cached_property
    def about_centroid(self) -> Array:
        """Second moments of the added areas about their centroids, (E, 2, 2) m^4."""
        return self.second - self.area[:, None, None] * np.einsum("ei,ej->eij", self.centroid, self.centroid)


def ring_masses(box: Box, stations: Array) -> RingMasses:
    """Areas and moments that a box's frames add to the elements between `stations` (E + 1,) m.

    The two elements whose middles are on either side of a frame share it, so that its centre of mass stays where it is.
    """
    h, middles = np.diff(stations), (stations[1:] + stations[:-1]) / 2.0
    area, first, second = np.zeros(len(h)), np.zeros((len(h), 2)), np.zeros((len(h), 2, 2))
    for x in box.frames:
        sides = box.profile_at(x).sides
        plate = enclosed_figure(sides)
        if box.frame_depth != "full":
            plate = plate.plus(enclosed_figure(inset_sides(sides, box.frame_depth)), -1.0)
        k = int(np.clip(np.searchsorted(middles, x), 1, len(h) - 1)) if len(h) > 1 else 0
        share = np.clip((middles[k] - x) / (middles[k] - middles[k - 1]), 0.0, 1.0) if k else 0.0
        for e, share_of_element in ((k - 1, share), (k, 1.0 - share)):
            by = share_of_element * box.frame_plate_thickness / h[e]
            area[e] += by * plate.area
            first[e] += by * plate.first
            second[e] += by * plate.second
    return RingMasses(stations, area, first, second)


def inset_sides(sides: tuple[Side, ...], depth: float) -> tuple[Side, ...]:
    """Sides of a profile after all sides are moved inwards by `depth` (m)."""
    inner_sides = []
    for k, side in enumerate(sides):
        a, b = shifted_ends(sides, k, lambda _: -depth)
        inner_sides.append(replace(side, start=(float(a[0]), float(a[1])), end=(float(b[0]), float(b[1]))))
    return tuple(inner_sides)


def enclosed_figure(sides: tuple[Side, ...]) -> FigureMoments:
    """Area and moments of the figure inside the mid-line of a profile with these `sides`."""
    total = FigureMoments()
    for side in sides:
        p = points_along(side, POINTS)
        weights = WEIGHTS * side.length * np.sum(p * normals(side, POINTS), axis=1)
        second = np.einsum("q,qi,qj->ij", weights, p, p) / 4.0
        total = total.plus(FigureMoments(float(weights.sum()) / 2.0, weights @ p / 3.0, second))
    return total
