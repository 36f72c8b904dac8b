r"""Pads: patches of finite length and width that hold the normal displacement of a face, or of a beam's line.

The row C(s) of a pad acts on the coordinates q of a body at the path coordinate s.  With the pad centred at x it is a
weighted mean over stations :math:`x_k`, a lattice of spacing :math:`\Delta`,

.. math::
    C(s)\, q = \sum_k b(x_k - x)\, U_k q, \qquad
    U_k q = \int \varphi(\xi - x_k)\, v(\eta)\, u \cdot n \, d\xi\, d\eta \Big/ \int \varphi\, v \, d\xi\, d\eta

with the coordinates :math:`\xi` along the body's axis and :math:`\eta` across the face, the displacement u and the
face's outward normal n.  The weight b is a cubic B-spline over all but :math:`2 \Delta` of the pad's length,
:math:`\varphi` a hat, and v a cubic B-spline over the width.  Between two breaks a row is a cubic in s, on any mesh,
and twice continuously differentiable throughout: its third derivative jumps at every :math:`\Delta`.  So the
acceleration of a sliding body has no jumps.  For every s the weights add up to one, their centroid is the pad's centre
and their spread does not change.  A rigid motion is therefore measured exactly, and the measure of a displacement that
is a parabola along the axis does not ripple as the pad slides.

The multiplier of the row is the force of the pad in N, positive if it pushes the body inwards; the pad's stiffness is k
and its compliance 1/k.  A pad that does not move, holds both ways and is not rigid is a spring, a contribution to the
stiffness.  It needs no row, eliminates no motion of the body, and contributes to its Rayleigh damping; its force is
an output.

A unilateral pad only pushes, once the body has moved outwards by the pad's clearance c.  With its force :math:`\lambda`
and its gap g

.. math::
    \lambda \ge 0, \qquad g = c - (C q + H f - (G + 1/k) \lambda) \ge 0, \qquad \lambda\, g = 0

The terms H f and :math:`G \lambda` are the static corrections of a reduced model for its loads f and for the forces; a
full model has none.  A unilateral pad always has a row, even if it does not move, because it holds at some times only.

Supports, and points that slide on a planar beam, are rows or springs too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from pmr.errors import InputError
from pmr.files.arrays import Array, Indices, Mask
from pmr.fullmodel.moving import cylinder_row
from pmr.fullmodel.walls import Walls
from pmr.models import StructuralModel
from pmr.models.mover import Mover
from pmr.models.trace import Extent, Window
from pmr.scene.cylinder import LuffingCylinder
from pmr.system.polynomials import cardinal_spline, refine_table, value_or_zero
from pmr.system.rows import Row, StraightRows, fixed_row, row_on_coordinates

if TYPE_CHECKING:
    from pmr.models.beam2d import Beam2D


def slider_row(beam: Beam2D, offset: float = 0.0, name: str = "slider") -> Row:
    """Row of a point that slides along a beam and holds its deflection w: w(s + `offset`) = 0.

    The row is an exact piecewise cubic in the path coordinate s. s and `offset` are in m along the axis; the multiplier
    of the row is a force in N. The row gets the given name.
    """
    return row_on_coordinates(name, np.unique(beam.nodes) - offset, beam.bending_dofs, beam.deflection, beam.size)


#: Stations for each knot of the weight along the pad: its length is (4 STATIONS + 2) Delta.
STATIONS = 2
#: Largest number of stations along the path: each costs a static solve and an interval of all tables.
MOST_STATIONS = 10_000
#: Points of quadrature are this share of Delta, or of the knots across, apart.
SPACING = 0.5
#: Largest error of a station's weight, relative, and of its centroid, in Delta; beyond, the pad leaves its face.
MISSING = 0.02
#: Share of a face's length or breadth by which a pad may reach beyond it: the path of a fixed pad has some length.
SLACK = 2e-3


@dataclass(frozen=True)
class Pad:
    """A pad on a named face of a body."""

    name: str
    on: str  # a flat face of a mesh; on beams ``bottom``, ``top``, ``left`` (+y) or ``right``
    at: float = 0.0  # m: its centre along the body's axis; of a moving pad the distance ahead of s
    across: float = 0.0  # m: its centre across, y on bottom and top, z on the sides
    length: float = 0.3  # m, along the body's axis
    width: float = 0.08  # m, across the face
    stiffness: float = 3e8  # N/m; infinite for a rigid one
    unilateral: bool = False  # whether it only pushes
    clearance: float = 0.0  # m: gap between a unilateral pad and the undeformed body
    travel: tuple[float, float] | None = None  # m: smallest and largest s of this moving pad; None: of `Pads`

    @property
    def gap(self) -> float | None:
        """Clearance in m of a pad that only pushes; None for a pad that holds both ways."""
        return self.clearance if self.unilateral else None


@dataclass(frozen=True)
class Support:
    """A support of the mean motion of a place along or about a direction, rigid by default.

    The stiffness is in N/m, or in N m/rad about a direction.
    """

    name: str
    on: str | float  # a named place of the body, or a coordinate in m along its axis
    direction: str = "x"  # x, y or z, or rx, ry or rz
    stiffness: float = np.inf
    point: tuple[float, float, float] | None = None  # m: moves rigidly with the place; None: the place's centroid


@dataclass(frozen=True)
class Slider:
    """A point that slides along a planar beam and holds its transverse displacement at s + `offset` (m)."""

    name: str = "slider"
    offset: float = 0.0


@dataclass(frozen=True)
class Pads:
    """All pads, supports, sliding points and other rows that hold a body."""

    fixed: tuple[Pad, ...] = ()
    moving: tuple[Pad, ...] = ()  # centred at s + `at`
    supports: tuple[Support, ...] = ()
    sliders: tuple[Slider, ...] = ()
    travel: tuple[float, float] = (0.0, 1.0)  # m: smallest and largest s
    # supports of places that another body holds, not the ground
    ends: tuple[Support, ...] = ()
    straight: tuple[StraightRows, ...] = ()  # stretches of a planar beam that another body keeps straight
    walls: Walls = Walls()  # walls of a beam that give way under its pads
    luffing: LuffingCylinder | None = None  # cylinder that holds a base; None: there is none
    tail: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m: position of a base's tail relative to the luffing pivot

    def wall_compliance(self, pad: str, s: float) -> float:
        """Compliance in m/N of the wall under a pad for the pad's own force, at the path coordinate s (m).

        The result is 0 if the wall is rigid.  For a fixed pad s does not matter.
        """
        centre = next((moving.at for moving in self.moving if moving.name == pad), 0.0)
        return self.walls.compliance_under(pad, s + centre)


@dataclass(frozen=True)
class Restraints:
    """Constraint rows and springs by which pads and supports act on a structure with n coordinates.

    A spring is a row c (1, n) that measures its elongation, with a stiffness k.
    """

    rows: tuple[Row, ...]  # rows of pads and supports that move, are rigid or only push
    springs: tuple[Row, ...]  # rows of all other pads and supports; k c^T c is part of K

    def stiffness(self, size: int) -> sp.csr_matrix:
        """Stiffness (n, n) in N/m of all springs: the sum of k c^T c over their rows c (1, n); `size` is n."""
        total = sp.csr_matrix((size, size))
        for c, spring in zip(self.spring_rows(size), self.springs, strict=True):
            total += c.T @ c / spring.compliance
        return total.tocsr()

    def force(self, name: str, size: int) -> sp.csr_matrix:
        """Row (1, n) in N per coordinate that measures the force of the spring called `name`.

        The force is stiffness times elongation; `size` is n.  Raises an `InputError` if no spring has this name.
        """
        for c, spring in zip(self.spring_rows(size), self.springs, strict=True):
            if spring.name == name:
                return c / spring.compliance
        names = ", ".join(spring.name for spring in self.springs) or "none"
        allowed = f"pads that neither move nor are rigid or unilateral are allowed: {names}"
        raise InputError("scene", "outputs.pad", name, f"{allowed}; the forces of others are multipliers")

    def spring_rows(self, size: int) -> list[sp.csr_matrix]:
        """Row c (1, n) of each spring, which measures its elongation; `size` is n."""
        return [spring.at(spring.breaks[0]) for spring in self.springs]


def restrain(pads: Pads, model: StructuralModel, T: sp.csr_matrix) -> Restraints:
    """Rows and springs of all pads, supports and sliders on the coordinates z of a structure, with q = T z.

    Springs are the pads and supports that do not move, have a stiffness and hold both ways; all others are rows.  The
    order of rows is: fixed pads, supports, sliding points, moving pads, places that another body holds, the luffing
    cylinder, straight stretches.  The coordinates of walls that give way are the last ones of z.

    Raises an `InputError` if a face does not exist, or if a pad leaves its face somewhere on its travel.  An
    `InputError` is also raised if the model lacks the direction of a support, or a clamp holds its place already.
    """
    staying = [
        *(pads.walls.pad_row(fixed_pad(pad, model, T, pads.travel), pad.at) for pad in pads.fixed),
        *(_support_row(support, model, T, pads) for support in pads.supports),
    ]
    moving = [
        *(_point_row(slider, model, T) for slider in pads.sliders),
        *(pads.walls.pad_row(moving_pad(pad, model, T, pad.travel or pads.travel), pad.at) for pad in pads.moving),
        *(_end_row(end, model, T, pads) for end in pads.ends),
        *([cylinder_row(pads.luffing, pads.tail, model, T, pads.travel)] if pads.luffing is not None else []),
        *(row for straight in pads.straight for row in straight.rows(_point_row(Slider(), model, T))),
    ]
    springs = [row.compliance > 0.0 and row.clearance is None for row in staying]
    rows = [row for row, spring in zip(staying, springs, strict=True) if not spring]
    return Restraints((*rows, *moving), tuple(row for row, spring in zip(staying, springs, strict=True) if spring))


def moving_pad(pad: Pad, model: StructuralModel, T: sp.csr_matrix, travel: tuple[float, float]) -> Row:
    """Row of a pad centred at s + `pad.at` on the body's axis, for path coordinates s in `travel` (m).

    The row acts on the coordinates z of a structure, with q = T z.  Raises an `InputError` if the pad is too short for
    its travel, or leaves its face.
    """
    low, high = travel
    step, reach = _station_spacing(pad), 2 * STATIONS  # stations with a weight on either side of the pad's centre
    if high - low > MOST_STATIONS * step:
        least = (high - low) * (4 * STATIONS + 2) / MOST_STATIONS
        allowed = f"at least {least:.3g} m are allowed on a path of {high - low:.4g} m"
        raise InputError("scene", f"pads.{pad.name}.length", pad.length, allowed)
    count = max(1, int(np.ceil((high - low) / step - 1e-9)))
    breaks = np.append(low + step * np.arange(count), high)
    places = low + pad.at + step * np.arange(1 - reach, count + reach)
    U = sp.csr_matrix(_station_means(pad, model, places) @ T)
    # The bump's pieces on the lattice, first the last one: stations ahead of the pad are farther left on it.
    pieces = (
        refine_table(cardinal_spline(3, STATIONS * step), step * np.arange(-reach, reach + 1)).c[:, ::-1] / STATIONS
    )
    touched = np.arange(count)[:, None] + np.arange(2 * reach)
    coefficients = np.repeat(pieces[:, None, :], count, axis=1)
    return Row(pad.name, breaks, U, touched, coefficients, 1.0 / pad.stiffness, pad.gap)


def fixed_pad(pad: Pad, model: StructuralModel, T: sp.csr_matrix, travel: tuple[float, float]) -> Row:
    """Row of a pad that stays at `pad.at`, constant over `travel` (m), on the coordinates z with q = T z.

    It is the row that a moving pad has when a station is at its centre.  Raises an `InputError` if the pad leaves its
    face.
    """
    mean = sp.csr_matrix(under_pad(pad, model, np.array([pad.at])) @ T)
    return replace(fixed_row(pad.name, mean, travel), compliance=1.0 / pad.stiffness, clearance=pad.gap)


def under_pad(pad: Pad, model: StructuralModel, positions: Array) -> sp.csr_matrix:
    """Rows (p, n) of the mean normal displacement under a pad, outwards positive, for p positions of its centre.

    The rows act on the n coordinates of `model`; the `positions` (p,) are in m along the axis.  Raises an `InputError`
    if the pad leaves its face at one of them.
    """
    step, reach = _station_spacing(pad), 2 * STATIONS  # stations with a weight on either side
    offsets = step * np.arange(1 - reach, reach)
    weights = value_or_zero(cardinal_spline(3, STATIONS * step), offsets) / STATIONS
    places = (positions[:, None] + offsets).ravel()
    order = np.argsort(places)
    columns = np.empty_like(order)
    columns[order] = np.arange(len(order))
    ends = len(offsets) * np.arange(len(positions) + 1)
    means = sp.csr_matrix((np.tile(weights, len(positions)), columns, ends), (len(positions), len(places)))
    return sp.csr_matrix(means @ _station_means(pad, model, places[order]))


def under_even_pad(pad: Pad, model: StructuralModel) -> sp.csr_matrix:
    r"""Row (1, n) of the mean normal displacement over a pad's area, in which each part has the same weight.

    .. math:: \frac{1}{L W} \int u \cdot n \, d\xi\, d\eta

    L and W are length and width of the pad, which is centred at `pad.at`.  A force on this row is an even pressure.  A
    force on the row of `under_pad` is a pressure that is largest in the middle.  The row acts on the n coordinates of
    `model`; a beam's row is a mean along its line.

    The weights of the quadrature points fall to zero over one step at the sides of the pad.  Sum, centroid and spread
    (second moment) along the axis have no error but round-off.  The spread across has an error of 0.2 %, or of 8 % if
    sides of the pad are on edges of the face.

    Raises an `InputError` if the pad leaves its face by more than `under_pad` allows.
    """
    centre, size = np.array([pad.at, pad.across]), np.array([pad.length, pad.width])
    rim = _station_spacing(pad)
    step = SPACING * np.array([rim, pad.width / 4.0])
    (low, high) = centre - (size + step) / 2.0, centre + (size + step) / 2.0
    strip = model.strip(pad.on, Window((low[0], high[0]), (low[1], high[1]), (step[0], step[1])))
    half = pad.length / 2.0 - 2.0 * rim
    _check_extent(pad, (pad.at - half, pad.at + half), strip.extent)
    offsets = np.stack([strip.along, strip.across]) - centre[:, None]
    half_size = np.sqrt(size**2 - step**2) / 2.0  # so that ramps at the sides don't spread the weight
    inside = np.clip((half_size[:, None] - np.abs(offsets)) / step[:, None] + 0.5, 0.0, 1.0)
    weights, ends = strip.weights * inside.prod(axis=0), np.array([0, len(strip.weights)])
    if weights.sum() < (1.0 - MISSING) * (pad.length - rim) * (1.0 if strip.line else pad.width):
        raise _off_face_error(pad, f"around {pad.at:.4g} m", strip.extent)
    offsets *= np.sqrt(2.0) / pad.length  # in this unit the spread along the axis is 1/6, too
    weights = _correct_weights(weights, offsets, ends, _moments(weights, offsets, ends))
    return sp.csr_matrix(weights[None] @ strip.normal)


def _support_row(support: Support, model: StructuralModel, T: sp.csr_matrix, pads: Pads) -> Row:
    """Row of a support on the coordinates z of a structure, with q = T z; constant over the path of `pads`.

    Raises an `InputError` if the model lacks the direction, or a clamp already holds the place along it.
    """
    if support.direction not in model.directions:
        allowed = f"{', '.join(model.directions)} are allowed"
        raise InputError("scene", f"supports.{support.name}.directions", support.direction, allowed)
    at = None if support.point is None else np.array(support.point)
    turns = support.direction.startswith("r") or at is not None  # a group of one point has no rotation
    motion = model.motion(support.on, at) if turns else model.displacement(support.on)
    measured = motion[model.directions.index(support.direction)]
    row = pads.walls.add_end_motion(sp.csr_matrix(measured @ T), support.on, (support.direction,))
    if np.abs(row.data).max(initial=0.0) <= 1e-12 * np.abs(measured.data).max(initial=0.0):
        allowed = f"a support of all points holds {support.on} along it already; one of the two is allowed"
        raise InputError("scene", f"supports.{support.name}.directions", support.direction, allowed)
    unit = "N m" if support.direction.startswith("r") else "N"
    return replace(fixed_row(support.name, row, pads.travel), compliance=1.0 / support.stiffness, unit=unit)


def _end_row(end: Support, model: StructuralModel, T: sp.csr_matrix, pads: Pads) -> Row:
    """Row of the place `end`, which another body holds, on the coordinates z of a structure, with q = T z.

    The row is that of a support, cut into two intervals of the path coordinate of `pads`.  A row with one interval
    counts as a support of the ground, which always holds; two intervals avoid this.  Raises the errors of
    `_support_row`.
    """
    travel = pads.travel
    return _support_row(end, model, T, pads).refine(np.array([travel[0], sum(travel) / 2.0, travel[1]]))


def _point_row(slider: Slider, model: StructuralModel, T: sp.csr_matrix) -> Row:
    """Row of the sliding point `slider` on the coordinates z of a structure, with q = T z.

    On a mover the row is the coordinate of its wheel, wherever the point is, and T is not used.  Raises an `InputError`
    if the model is neither a planar beam nor a mover.
    """
    if isinstance(model, Mover):
        weights = np.array([0.0, 1.0]).reshape(2, 1, 1)  # linear with a slope of 0, as a row that travels
        wheel = [[model.wheel]]
        return row_on_coordinates(slider.name, model.node_stations - slider.offset, wheel, weights, model.size)
    from pmr.models.beam2d import Beam2D  # its forms need FEniCSx, which given matrices do without

    if not isinstance(model, Beam2D):
        raise InputError("scene", "slider", slider.name, "a point slides on beam2d only; pads slide on any body")
    row = slider_row(model, slider.offset, slider.name)
    return replace(row, carriers=sp.csr_matrix(row.carriers @ T))


def _station_spacing(pad: Pad) -> float:
    """Spacing in m of the stations, the places at which a pad's row is a mean of displacements (module docstring)."""
    return pad.length / (4 * STATIONS + 2)


def _station_means(pad: Pad, model: StructuralModel, places: Array) -> sp.csr_matrix:
    """Rows (K, n), each the weighted mean of the normal displacement around one of the `places` (K,) in m on the axis.

    The places ascend.  Raises an `InputError` if the pad leaves its face.
    """
    step, knot = _station_spacing(pad), pad.width / 4.0
    window = Window(
        along=(places[0] - step, places[-1] + step),
        across=(pad.across - 2.0 * knot, pad.across + 2.0 * knot),
        spacing=(SPACING * step, SPACING * knot),
    )
    strip = model.strip(pad.on, window)
    _check_extent(pad, (places[0], places[-1]), strip.extent)
    area_of_mean = step * float(value_or_zero(cardinal_spline(3, knot), np.zeros(()))) if strip.line else step * knot
    across_weights = strip.weights * value_or_zero(cardinal_spline(3, knot), strip.across - pad.across)
    which = _nearby_points(strip.along, places, step)
    near, ends = which.indices, which.indptr
    offsets = np.stack([strip.along[near] - np.repeat(places, np.diff(ends)), strip.across[near] - pad.across])
    weights = across_weights[near] * value_or_zero(cardinal_spline(1, step), offsets[0])
    offsets /= step
    moments = _moments(weights, offsets, ends)
    sums, aside = moments[0], np.abs(moments[1:3])
    off = (sums < (1.0 - MISSING) * area_of_mean) | np.any(
        aside > MISSING * np.array([[1.0], [knot / step]]) * sums, axis=0
    )
    if off.any():
        raise _off_face_error(pad, f"around {places[off][0]:.4g} m", _free_places(pad, places, off) or strip.extent)
    weights = _correct_weights(weights, offsets, ends, moments)
    means = sp.csr_matrix((weights, near, ends), (len(places), len(strip.along)))
    return sp.csr_matrix(means @ strip.normal)


def _nearby_points(points: Array, places: Array, step: float) -> sp.csc_matrix:
    """Sparse matrix (q, K) with ones where a point of `points` (q,) is near a lattice point of `places` (K,).

    A point is near if the distance is less than `step`, all in m.  The places ascend, and so do row numbers in each
    column.
    """
    first, last = (np.searchsorted(places + reach, points, side="right") for reach in (step, -step))
    ends = np.concatenate([[0], np.cumsum(last - first)])
    station = np.arange(ends[-1]) + np.repeat(first - ends[:-1], last - first)
    return sp.csr_matrix((np.ones(len(station)), station, ends), (len(points), len(places))).tocsc()


def _check_extent(pad: Pad, places: tuple[float, float], extent: Extent) -> None:
    """Raise an `InputError` if a pad with stations between two `places` (m) reaches beyond the extent of its face.

    It may reach beyond by the share `SLACK` of the face's length or breadth.
    """
    step, half = _station_spacing(pad), pad.width / 2.0
    spans = [("along the axis", (places[0] - step, places[1] + step), step, extent.along)]
    if extent.across is not None:
        spans.append(("across", (pad.across - half, pad.across + half), 0.0, extent.across))
    for way, (start, end), rim, (low, high) in spans:
        slack = SLACK * (high - low)
        if start < low - slack or end > high + slack:  # a rim of Delta has no weight yet belongs to the pad
            raise _off_face_error(pad, f"{way}, where it reaches from {start - rim:.4g} to {end + rim:.4g} m", extent)


def _free_places(pad: Pad, places: Array, off: Mask) -> str:
    """Text with the ranges in m of a pad's centre in which its face is whole under all of the pad.

    `places` (K,) are the stations in m, and `off` (K,) marks those under which the face has a hole.  The text is empty
    if there is no range.
    """
    ends = np.flatnonzero(np.diff(np.concatenate([[True], off, [True]])))
    half = pad.length / 2.0 - 2.0 * _station_spacing(pad)  # from the pad's centre to its last station
    ranges = [(places[first] + half, places[last - 1] - half) for first, last in ends.reshape(-1, 2)]
    wide = [f"{low:.4g} to {high:.4g} m" for low, high in ranges if low < high]
    return f"with its centre at {' or '.join(wide)}" if wide else ""


def _off_face_error(pad: Pad, position: str, where: Extent | str) -> InputError:
    """InputError for a pad that leaves its face at a `position`, which is in words.

    `where` are the extent of the face, or words for the places at which the pad is allowed.
    """
    allowed = f"the pad leaves the face {pad.on} {position}; places where all of it is on it are allowed: {where}"
    return InputError("scene", f"pads.{pad.name}", None, allowed)


#: Which of the moments in `_moments` the products of 1, x, y and x^2 are.
_PRODUCTS = np.array([[0, 1, 2, 3], [1, 3, 4, 6], [2, 4, 5, 7], [3, 6, 7, 8]])


def _moments(weights: Array, offsets: Array, ends: Indices) -> Array:
    """Sums (9, K) of `weights` (q,) times nine powers of x and y over the points of each of K stations.

    The powers are 1, x, y, x^2, x y, y^2, x^3, x^2 y and x^4.  The points of station k are numbered from ends[k] to
    ends[k + 1]; `ends` is (K + 1,).  `offsets` (2, q) are x and y of each point from its station, in units of the
    stations' spacing.
    """
    x, y = offsets
    wx, wy = weights * x, weights * y
    wxx = wx * x
    products = np.stack([weights, wx, wy, wxx, wx * y, wy * y, wxx * x, wxx * y, wxx * x**2])
    begin, any_there = ends[:-1], np.diff(ends) > 0
    sums = np.zeros((len(products), len(begin)))
    sums[:, any_there] = np.add.reduceat(products, begin[any_there], axis=1)
    return sums


def _correct_weights(weights: Array, offsets: Array, ends: Indices, moments: Array) -> Array:
    """Return `weights` (q,) times a parabola at each station, which gives them the moments of the exact integral.

    The parabola is a function of the offsets from the station.  At each station the result adds up to one, its centroid
    is at the station, and its second moment along the axis is 1/6, as for the exact hat.  The correction is as small as
    the error of the quadrature.  Without the correction, rows would ripple along the path for motions without a ripple.
    `weights`, `offsets` and `ends` are the arguments of `_moments`, and `moments` (9, K) is its result.
    """
    targets = np.array([1.0, 0.0, 0.0, 1.0 / 6.0])
    parabolas = np.linalg.pinv(moments.T[:, _PRODUCTS], rcond=1e-12, hermitian=True) @ targets
    of_one, of_x, of_y, of_xx = np.repeat(parabolas.T, np.diff(ends), axis=1)
    x, y = offsets
    return np.asarray(weights * (of_one + x * (of_x + x * of_xx) + y * of_y))
