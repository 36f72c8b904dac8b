r"""Sections of a beam along its axis, the bending of an element, and stresses in the profile's outer corners.

Stresses follow from section forces: Navier's from the normal force and bending, Bredt's from the torque, in the thinner
of the two plates that meet in a corner.  Left out are the shear stresses of transverse forces, largest in the middle of
a wall; warping; and all that a beam does not represent, such as walls that bend under pads.  Outer corners that are
rounded get the stresses of sharp ones, which are larger.

Bending in one plane, with cubic Hermite elements of length h and the bending stiffness EI, has the stiffness k.  w is
the cubic deflection, and :math:`\kappa G A` is the shear stiffness:

.. math::
    k = \int EI \Bigl( w'' \delta w'' - \frac{h^2}{12} \frac{\Phi}{1 + \Phi} w''' \delta w''' \Bigr) dx, \qquad
    \Phi = \frac{12 EI}{\kappa G A h^2}

Without shear :math:`\Phi = 0` and the last term vanishes: Euler and Bernoulli's beam.  With shear, nodal slopes are
rotations :math:`\psi` of the section.  The shear strain of an element, :math:`\gamma = -\frac{h^2}{12} \frac{\Phi}{1 +
\Phi} w'''`, is the one with the least energy.  It gives the term above and the interpolations :math:`w + \gamma h (X -
3 X^2 + 2 X^3)` of the deflection and :math:`\psi = w' - \gamma` of the rotation, with X in [0, 1] along the element.
Nodal values are exact in statics; frequencies converge with order 2 (4 without shear).  Przemieniecki: Theory of Matrix
Structural Analysis, 1968, section 5.6 (stiffness), 11.3 (mass).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from pmr.files.arrays import Array, Indices
from pmr.models.profile_section import MidLine, section_of
from pmr.results.field_stress import FIBRE, FORCES, ForceRows, StressRows
from pmr.scene.box import Box, Stretch
from pmr.scene.profile import BoxProfile
from pmr.scene.structures import Beam3DBody, BeamSection

if TYPE_CHECKING:
    from pmr.fem.compat import Expr


@dataclass(frozen=True)
class SectionsAlong:
    """K sections of a beam, one after the other along its axis, and their properties.

    Second moments and shear areas are along the principal axes of each section.
    """

    ends: Array  # (K + 1,) m: start of each section, and end of the last one
    each: tuple[BeamSection, ...]
    stretches: tuple[Stretch | None, ...]  # the stretch of each section, with its profiles; None if unknown
    poisson: float = 0.3  # Poisson's ratio, on which shear areas depend

    def section_numbers(self, places: Array | float) -> Indices:
        """Numbers (k,) of the sections at coordinates `places` (k,) m along the axis.

        A place where one section ends and the next begins belongs to the next.  Places beyond an end of the beam belong
        to the first or the last section.
        """
        return np.clip(np.searchsorted(self.ends, places, side="right") - 1, 0, len(self.each) - 1)

    def profile_at(self, x: float) -> BoxProfile | None:
        """Profile at the coordinate x (m) along the axis; None where the section is given by its properties alone."""
        stretch = self.stretches[int(self.section_numbers(x))]
        return None if stretch is None else stretch.profile_at(x)

    def middle_at(self, x: float) -> Array:
        """Centroid (2,) in m of the walls' mid-line at x (m), which is also the mean position over the end of a shell.

        The centroid is (0, 0) if there is no profile.
        """
        number = int(self.section_numbers(x))
        middle, stretch = self._middles[number], self.stretches[number]
        if middle is None:
            assert stretch is not None
            return MidLine(stretch.profile_at(x)).middle
        return middle

    @cached_property
    def _middles(self) -> tuple[Array | None, ...]:
        """Centroid (2,) in m of the walls' mid-line of each section.

        The centroid is zero for a section without walls of its own, and None where it varies along the section.
        """
        return tuple(
            np.zeros(2) if stretch is None else MidLine(stretch.first).middle if stretch.first is stretch.last else None
            for stretch in self.stretches
        )

    @cached_property
    def area(self) -> Array:
        """Areas (K,) m^2."""
        return np.array([section.area for section in self.each])

    @cached_property
    def torsion_constant(self) -> Array:
        """Torsion constants (K,) m^4."""
        return np.array([section.torsion_constant for section in self.each])

    @cached_property
    def polar_moment(self) -> Array:
        """Polar second moments (K,) m^4."""
        return np.array([section.polar_moment for section in self.each])

    @cached_property
    def centroid(self) -> Array:
        """Centroids (K, 2) in m: distances from the axis along y and z."""
        return np.array([section.centroid for section in self.each])

    @cached_property
    def shear_centre(self) -> Array:
        """Shear centres (K, 2) in m: distances from the axis along y and z."""
        return np.array([section.shear_centre for section in self.each])

    @property
    def is_turned(self) -> bool:
        """Whether the principal axes of any section are turned against y and z."""
        return any(section.product_of_inertia != 0.0 for section in self.each)

    @cached_property
    def principal(self) -> Array:
        """Matrices R (K, 2, 2) whose rows are the principal axes, turned by at most 45 degrees against y and z."""
        return np.array([_principal_axes(section) for section in self.each])

    @cached_property
    def second_moments(self) -> Array:
        """Second moments (K, 2) m^4 about the centroid, for bending along each principal axis."""
        tensors = np.array([_second_moment_matrix(section) for section in self.each])
        return np.einsum("kij,kjl,kil->ki", self.principal, tensors, self.principal)

    @cached_property
    def shear_areas(self) -> Array | None:
        """Shear areas along the principal axes, (K, 2) m^2; None if one is unknown."""
        areas = [(section.shear_area_y, section.shear_area_z) for section in self.each]
        if any(None in pair for pair in areas):
            return None
        return 1.0 / np.einsum("kij,kj,kij->ki", self.principal, 1.0 / np.array(areas, float), self.principal)

    @cached_property
    def centre_motions(self) -> Array:
        """Matrices (K, 6, 6), one per section, that give the motion of its centres from the motion of the axis.

        The motion of the centres is u_c, v_s, w_s, phi and the rotations about the principal axes.  u_c is the
        centroid's displacement along x; v_s and w_s are the shear centre's displacements along the principal axes.
        """
        motion = centre_motion_matrices(self)
        motion[:, 1:3], motion[:, 4:] = self.principal @ motion[:, 1:3], self.principal @ motion[:, 4:]
        return motion


def centre_motion_matrices(sections: SectionsAlong) -> Array:
    """Matrices (K, 6, 6), one for each of `sections`, that turn the motion of the axis into the motion of its centres.

    The motion of the centres is u of the centroid, v and w of the shear centre, and the rotations.  Unlike in
    `SectionsAlong.centre_motions`, all components are along and about x, y and z, not the principal axes.
    """
    motion = np.tile(np.eye(6), (len(sections.each), 1, 1))
    motion[:, 0, 4], motion[:, 0, 5] = sections.centroid[:, 1], -sections.centroid[:, 0]
    motion[:, 1, 3], motion[:, 2, 3] = -sections.shear_centre[:, 1], sections.shear_centre[:, 0]
    return motion


def sections_of(body: Beam3DBody, stations: Array, box: Box | None = None) -> SectionsAlong:
    """Sections of a beam with nodes at `stations` (N,) m, from its section, its profile or a varying `box`.

    `box` is None if nothing varies.  A stretch of constant profile is one section.  Where the profile changes along a
    stretch, each element is a section.
    """
    poisson = body.material.poisson
    if body.profile is None:
        assert body.section is not None  # one of the two is given
        return SectionsAlong(np.array([0.0, body.length]), (body.section,), (None,), poisson)
    stretch_of_all = [Stretch(0.0, body.length, body.profile, body.profile)]
    parts = [
        stretch.sub_range(a, b)
        for stretch in (stretch_of_all if box is None else box.stretches)
        for a, b in pairwise([stretch.start, *_inner_nodes(stretch, stations), stretch.end])
    ]
    ends = np.array([0.0, *(part.end for part in parts)])
    return SectionsAlong(ends, tuple(mean_section(part, poisson) for part in parts), tuple(parts), poisson)


def mean_section(stretch: Stretch, poisson: float) -> BeamSection:
    """Mean properties of the section over a stretch by Gauss' rule; exact for the area, which is quadratic in x.

    `poisson` is Poisson's ratio.
    """
    if stretch.first is stretch.last:
        return section_of(stretch.first, poisson)
    x, w = np.polynomial.legendre.leggauss(3)
    places = stretch.start + (stretch.end - stretch.start) * (x + 1.0) / 2.0
    sections = [section_of(stretch.profile_at(float(at)), poisson).model_dump() for at in places]
    mean = {key: w / 2.0 @ np.array([section[key] for section in sections]) for key in sections[0]}
    return BeamSection(**{key: tuple(value.tolist()) if value.ndim else float(value) for key, value in mean.items()})


def _inner_nodes(stretch: Stretch, stations: Array) -> list[float]:
    """List the `stations` (N,) in m strictly inside a stretch whose profile changes along it; empty for others."""
    inside = (stations > stretch.start) & (stations < stretch.end) & (stretch.first is not stretch.last)
    return [float(at) for at in stations[inside]]


def stations_of(breaks: Sequence[float], elements: int) -> Array:
    """Coordinates (N,) in m of the nodes of a beam of about `elements` elements.

    There is a node at each of the `breaks` (m), and the nodes between two breaks are evenly spaced.
    """
    parts = [np.array(breaks[:1])]
    for a, b in zip(breaks[:-1], breaks[1:], strict=True):
        count = max(1, round(elements * (b - a) / (breaks[-1] - breaks[0])))
        parts.append(a + (b - a) * (np.arange(1, count + 1) / count))
    return np.concatenate(parts)


def _second_moment_matrix(section: BeamSection) -> Array:
    """Integrals (2, 2) in m^4 of y y, y z and z z over a section, with y and z from its centroid."""
    product = section.product_of_inertia
    return np.array([[section.second_moment_z, product], [product, section.second_moment_y]])


def _principal_axes(section: BeamSection) -> Array:
    """Principal axes of a section, unit vectors in y and z, as the rows of a matrix (2, 2)."""
    if section.product_of_inertia == 0.0:
        return np.eye(2)
    difference = section.second_moment_z - section.second_moment_y
    angle = np.arctan2(np.copysign(2.0, difference) * section.product_of_inertia, abs(difference)) / 2.0
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


#: Points (2,) m of a profile by their names, and c stresses in each of the k points per unit section force, (k, c, 6).
Corners = tuple[dict[str, Array], Array]


def axial_stress_factors(section: BeamSection, points: Array) -> Array:
    r"""Axial stress at k points (k, 2) in m of a section, per unit section force, (k, 6).

    Section forces are in the order of `FORCES`.  The axial stress :math:`\sigma` at the point p follows from the normal
    force N and the bending moments :math:`M_y` and :math:`M_z`.  With the centroid c, the area A and the second moments
    I it is

    .. math:: \sigma = \frac{N}{A} + \begin{pmatrix} -M_z & M_y \end{pmatrix} I^{-1} (p - c)
    """
    of_z, of_y = np.linalg.solve(_second_moment_matrix(section), np.subtract(points, section.centroid).T)
    factors = np.zeros((len(points), len(FORCES)))
    factors[:, 0], factors[:, 4], factors[:, 5] = 1.0 / section.area, of_y, -of_z
    return factors


def torsion_stress_factors(profile: BoxProfile, thickness: Array) -> Array:
    r"""Shear stress in k walls of the given `thickness` (k,) in m, counter-clockwise, per unit section force, (k, 6).

    Section forces are in the order of `FORCES`; all but the torque's column are zero.  With the torque T, the area
    :math:`A_m` within the mid-line of the `profile` and the thickness t

    .. math:: \tau = \frac{T}{2 A_m t}
    """
    factors = np.zeros((len(thickness), len(FORCES)))
    factors[:, 3] = 1.0 / (2.0 * MidLine(profile).enclosed_area * thickness)
    return factors


def corner_stress_factors(profile: BoxProfile, section: BeamSection) -> Corners:
    """Corners of a profile, and axial and torsion stress in each of the k corners per unit section force: (k, 2, 6)."""
    points = np.array([corner.position for corner in profile.corners])
    thickness = np.array([corner.thickness for corner in profile.corners])
    factors = np.stack([axial_stress_factors(section, points), torsion_stress_factors(profile, thickness)], axis=1)
    return {corner.name: np.array(corner.position) for corner in profile.corners}, factors


def fibre_stress_factors(profile: BoxProfile, section: BeamSection) -> Corners:
    """Lowest and highest fibre of a profile, and the axial stress in each per unit section force: (2, 1, 6)."""
    heights, stresses = [corner.position[1] for corner in profile.corners], np.zeros((2, 1, len(FORCES)))
    places = {"bottom": np.array([0.0, min(heights)]), "top": np.array([0.0, max(heights)])}
    stresses[:, 0, 0] = 1.0 / section.area
    stresses[:, 0, 4] = [(z - section.centroid[1]) / section.second_moment_y for _, z in places.values()]
    return places, stresses


def stresses_along(
    sections: SectionsAlong,
    number: Indices,
    forces: ForceRows,
    element: Indices,
    corners: Callable[[BoxProfile, BeamSection], Corners],
) -> StressRows | None:
    """Stresses from section forces at P points along a beam; None if one of the sections has no profile.

    Parameters
    ----------
    number, element : (P,) integer arrays
        Section of each point, and the number of its element in the result.
    forces : ForceRows
        Section forces: one kind of force at all P points, then the next kind at all P points, and so on.
    corners : callable
        `corner_stress_factors` or `fibre_stress_factors`.  Where a profile varies along its section, it is called with
        the profile at the point.
    """
    corners_of, keys = dict[tuple[int, float], Corners](), []
    for k, x in zip(number.tolist(), forces.x[: len(number)].tolist(), strict=True):
        stretch = sections.stretches[k]
        if stretch is None:
            return None
        same = stretch.first is stretch.last
        keys.append((k, 0.0 if same else x))
        if keys[-1] not in corners_of:
            profile = stretch.profile_at(x)
            corners_of[keys[-1]] = corners(profile, sections.each[k] if same else section_of(profile, sections.poisson))
    at = {name: np.array([corners_of[key][0][name] for key in keys]) for name in corners_of[keys[0]][0]}
    return stress_rows(forces, element, at, np.array([corners_of[key][1] for key in keys]))


def stress_rows(forces: ForceRows, element: Indices, corners: Mapping[str, Array], factors: Array) -> StressRows:
    """Stress rows in the corners of sections at P points along a beam, from the section forces there.

    Parameters
    ----------
    forces : ForceRows
        Section forces: one kind of force at all P points, then the next kind at all P points, and so on.
    element : (P,) array
        Number of the element of each point.
    corners : dict of str to (P, 2) array, m
        y and z of each of the k corners at each point, by the corner's name.
    factors : (P, k, c, 6) array
        c stress components in the corners per unit section force: axial, then torsion if c = 2.
    """
    count, components = len(element), factors.shape[2]
    names = forces.names[::count]
    factors = factors[..., [list(FORCES).index(name) for name in names]]
    ends = np.arange(count * components + 1)
    local = [
        sp.hstack(
            [sp.csr_matrix((of_corner[..., n].ravel(), ends[:-1] // components, ends)) for n in range(len(names))]
        )
        for of_corner in np.moveaxis(factors, 1, 0)
    ]
    rows = sp.csr_matrix(sp.vstack(local) @ forces.rows)
    rows.eliminate_zeros()
    x = forces.x[:count, None]
    return StressRows(
        rows=rows,
        mises=FIBRE[:components, :components],
        components=("axial", "torsion")[:components],
        points=np.concatenate([np.hstack([x, at]) for at in corners.values()]),
        cell=np.tile(element, len(corners)),
        faces=tuple(corners),
        face=np.repeat(np.arange(len(corners)), count),
    )


#: N2, N3 / h, N5, N6 / h as polynomials in xi in [0, 1], highest power first.
HERMITE = np.array([[2.0, -3.0, 0.0, 1.0], [1.0, -2.0, 1.0, 0.0], [-2.0, 3.0, 0.0, 0.0], [1.0, -1.0, 0.0, 0.0]])
#: Their first and third derivatives.
FIRST, THIRD = (np.array([np.polyder(p, k) for p in HERMITE]) for k in (1, 3))


@dataclass(frozen=True)
class Deflection:
    """Bending of a beam in one plane, in UFL.  The deflection is an interpolated cubic, with a part that shear adds.

    `second` in 1/m and `third` in 1/m^2 are derivatives of the cubic alone.  `shear` is the shear strain, None for a
    beam that is rigid in shear.  `value` is the whole deflection in m, `rotation` the rotation of the section in rad,
    and `curvature` the derivative of the rotation in 1/m.
    """

    second: Expr
    third: Expr
    shear: Expr | None
    value: Expr
    rotation: Expr
    curvature: Expr


@dataclass(frozen=True)
class Bending:
    """Bending of K sections in one plane.

    `stiffness` is EI in N m^2, `shear_stiffness` kappa G A in N; None: rigid in shear.
    """

    stiffness: Array  # (K,)
    shear_stiffness: Array | None = None  # (K,)

    def shape_weights(self, h: Array, X: Array, number: Indices) -> Array:
        """Deflection and rotation of the section at a point in each of q elements, by unit values at the nodes.

        The result (2, 4, q) has first the deflection, then the rotation.  Its second axis has the values w_1, psi_1,
        w_2 and psi_2: deflection and rotation at the element's first node, then at its second node.  Point i is at the
        share X[i] in [0, 1] of an element of length h[i] in m with section number[i]; h, X and number are (q,).
        """
        scale = np.stack([np.ones_like(h), h, np.ones_like(h), h])
        value, slope = _evaluate(HERMITE, X) * scale, _evaluate(FIRST, X) * scale / h
        if self.shear_stiffness is None:
            return np.array([value, slope])
        third = _evaluate(THIRD, X) * scale / h**3
        gamma = _shear_strain(third, h, self.stiffness[number], self.shear_stiffness[number])
        return np.array([value + gamma * h * (X - 3 * X**2 + 2 * X**3), slope + gamma * (-6 * X + 6 * X**2)])

    def deflection(self, w: Expr, h: Expr, X: Expr, of_elements: Callable[[Array], Expr]) -> Deflection:
        """Deflection in UFL: the cubic w with the part that shear adds, and its derivatives.

        The elements have the length h; X in [0, 1] is the share along each of them.  Without shear stiffness, value and
        rotation are w and its derivative.  `of_elements` turns a property (K,) of the K sections into UFL.
        """
        first = w.dx(0)  # UFL looks through the whole expression for each derivative
        second = first.dx(0)
        third = second.dx(0)
        if self.shear_stiffness is None:
            return Deflection(second, third, None, w, first, second)
        EI, kGA = of_elements(self.stiffness), of_elements(self.shear_stiffness)
        bulge = h * (X - 3 * X**2 + 2 * X**3)
        gamma, steeper = _shear_strain(third, h, EI, kGA), bulge.dx(0)
        rotation, curvature = first + gamma * (steeper - 1), second + gamma * steeper.dx(0)
        return Deflection(second, third, gamma, w + gamma * bulge, rotation, curvature)

    def energy(self, trial: Deflection, test: Deflection, of_elements: Callable[[Array], Expr]) -> Expr:
        """Integrand of the bending stiffness in UFL, for the deflections of the `trial` and of the `test` function.

        `of_elements` turns a property (K,) of the K sections into UFL.
        """
        EI = of_elements(self.stiffness)
        integrand = EI * trial.second * test.second
        return integrand if trial.shear is None else integrand + EI * trial.shear * test.third


def _shear_strain(third: Expr, h: Expr, EI: Expr, kGA: Expr) -> Expr:
    """Shear strain of elements of length h in m, whose cubic deflection has the third derivative `third` in 1/m^2.

    EI in N m^2 and kGA in N are the stiffnesses in bending and shear.  All arguments and the result are in UFL, or all
    are arrays.
    """
    return -(h**2) / 12 / (1 + kGA * h**2 / (12 * EI)) * third


def _evaluate(polynomials: Array, X: Array) -> Array:
    """Values (p, q) of p polynomials (p, d), highest power first, at the arguments X (q,)."""
    values = np.zeros((len(polynomials), len(X)))
    for c in polynomials.T:
        values = values * X + c[:, None]
    return values
