r"""Stresses and section forces as matrices on a model's coordinates, and their largest values over time.

Let q be the coordinates of a model and S a sparse matrix of stress per unit of a coordinate.  Let A be the matrix of
von Mises' stress for the stress components that the model has.  The stresses :math:`\sigma` and von Mises' stress
:math:`\sigma_v` are

.. math:: \sigma = S q, \qquad \sigma_v = \sqrt{\sigma^T A\, \sigma}

Section forces of beams are integrals over the face of a section that looks along x, with the element of area dA.  Let
:math:`\sigma` now be the normal stress, and y and z the principal axes of the section.  The normal force N, the bending
moments M and the shear forces V are

.. math::
    N = \int \sigma\, dA, \quad M_y = \int z\, \sigma\, dA, \quad M_z = -\int y\, \sigma\, dA, \quad
    V_z = M_y', \quad V_y = -M_z'

where ' is the derivative along x.  Section forces that follow from strains alone are those of loads on nodes;
`pmr.reduction.section_forces` adds the part of loads between nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np
import scipy.sparse as sp

from pmr.files.arrays import Array, Indices
from pmr.results.field_series import Grid
from pmr.results.response import ROUND_OFF

Position = tuple[float, float, float]  # x, y and z in m

#: Relative difference of stress up to which two points share the largest stress.  Points that are symmetric to each
#: other have equal stresses only up to the round-off of states.
SHARED = 1e-6
#: Largest number of points that may share the largest stress.
MOST_SHARED = 100
#: Matrix A of von Mises' stress for plane stress (11, 22, 12), stress in space (xx, yy, zz, yz, xz, xy) and a fibre
#: (normal stress, shear stress).
PLANE = np.array([[1.0, -0.5, 0.0], [-0.5, 1.0, 0.0], [0.0, 0.0, 3.0]])
SPATIAL = np.block([[1.5 * np.eye(3) - 0.5, np.zeros((3, 3))], [np.zeros((3, 3)), 3.0 * np.eye(3)]])
FIBRE = np.diag([1.0, 3.0])


def von_mises(stresses: Array, form: Array) -> Array:
    """Return von Mises' stress (...) in Pa from the components `stresses` (..., c) in Pa.

    Von Mises' stress is the square root of s^T A s for components s, and `form` (c, c) is the matrix A.
    """
    return np.asarray(np.sqrt(np.maximum(np.sum((stresses @ form) * stresses, axis=-1), 0.0)))


@dataclass(frozen=True)
class StressRows:
    """Matrix from n coordinates to the stresses at P points of a body, with c stress components at each point.

    Attributes
    ----------
    rows : (P c, n) sparse matrix, Pa per unit of a coordinate
        Stress per unit of each coordinate: rows for the c components at the first point, then at the second one, and
        so on.
    mises : (c, c) array
        Matrix A of the module's docstring.
    components : tuple of str
        Names of the c components.
    points : (P, 3) array, m
    cell : (P,) integer array
        Number of the cell of the model's grid that each point belongs to.
    faces : tuple of str
        Names of positions in a cell: outer or inner face of a wall, middle of a wall, or a corner of a section.
    face : (P,) integer array
        Index in `faces` of the position of each point.
    """

    rows: sp.csr_matrix
    mises: Array
    components: tuple[str, ...]
    points: Array
    cell: Indices
    faces: tuple[str, ...]
    face: Indices

    def evaluate(self, q: Array) -> Array:
        """Return the stresses (S, P, c) in Pa of the coordinates q (S, n) at S times."""
        return self.split_by_point((self.rows @ q.T).T)

    def split_by_point(self, stresses: Array) -> Array:
        """Return stresses (S, P c), ordered as the rows of the matrix, in the shape (S, P, c)."""
        return np.asarray(stresses).reshape(len(stresses), len(self.points), len(self.components))

    def von_mises(self, stresses: Array) -> Array:
        """Return von Mises' stress (S, P) in Pa at P points from the components `stresses` (S, P, c) in Pa."""
        return von_mises(stresses, self.mises)

    def points_on(self, face: str) -> Indices:
        """Return the indices (k,) of the points on the face called `face`, one of `faces`; others raise ValueError."""
        return np.flatnonzero(self.face == self.faces.index(face))

    def by_cell(self, values: Array, cells: int) -> dict[str, Array]:
        """Return the largest of values (S, P) at P points in each of `cells` cells, (S, cells), by name of the face.

        If a cell has no point on a face, its largest value on any face is taken; a cell without points has minus
        infinity.
        """
        largest_anywhere = _largest_by_cell(values, self.cell, cells)
        largest = {}
        for face in self.faces:
            on = self.points_on(face)
            largest[face] = _largest_by_cell(values[:, on], self.cell[on], cells)
            absent = np.setdiff1d(np.arange(cells), self.cell[on])
            largest[face][:, absent] = largest_anywhere[:, absent]
        return largest

    def components_by_cell(self, stresses: Array, cells: int) -> dict[str, Array]:
        """Return stress components (S, cells) in Pa at the point of each cell at which the von Mises stress is largest.

        The arrays have the keys ``"FACE COMPONENT"``; `stresses` are (S, P, c) in Pa.  If a cell has no point on a
        face, the point of its largest von Mises stress on any face is taken.  Each of the `cells` needs a point.
        """
        mises, components = self.von_mises(stresses), dict[str, Array]()
        largest_anywhere = _largest_indices(mises, self.cell, cells)
        for face in self.faces:
            on = self.points_on(face)
            at = on[_largest_indices(mises[:, on], self.cell[on], cells)]
            absent = np.setdiff1d(np.arange(cells), self.cell[on])
            at[:, absent] = largest_anywhere[:, absent]
            for k, component in enumerate(self.components):
                components[f"{face} {component}"] = np.take_along_axis(stresses[:, :, k], at, axis=1)
        return components


class PeakSummary(TypedDict, total=False):
    """Entry of summary.json about a largest von Mises stress, as `StressPeak.summary` returns it.

    The entries are the fields of `StressPeak`, with values in Pa, times in s and positions in m.  In the summary of a
    boom, `section` is the name of the section with this stress.
    """

    value: float
    t: float
    position: list[float]
    face: str
    cell: int
    region: str
    shared: list[list[float]]
    section: str


@dataclass(frozen=True)
class StressPeak:
    """Largest von Mises stress `value` in Pa, its time t in s, its position (3,) in m, and its face, cell and region.

    `shared` are the positions (3,) in m of other points with the same stress at that time.
    """

    value: float
    t: float
    position: Position
    face: str
    cell: int
    region: str
    shared: tuple[Position, ...] = ()

    def summary(self) -> PeakSummary:
        """Return the peak as a mapping for summary.json."""
        return {"value": self.value, "t": self.t, "position": list(self.position), "face": self.face,
                "cell": self.cell, "region": self.region,
                "shared": [list(place) for place in self.shared]}  # fmt: skip


@dataclass(frozen=True)
class StressHistory:
    """Largest von Mises stress of a body over time.

    Attributes
    ----------
    t : (S,) array, s
    largest : (S,) array, Pa
    point : (S,) integer array
        Index of the point of the stress rows where the stress is largest.
    peak : StressPeak
        Largest stress of all times.
    """

    t: Array
    largest: Array
    point: Indices
    peak: StressPeak


def stress_history(
    rows: StressRows, grid: Grid, t: Array, largest: Array, point: Indices, at_peak: Array | None = None
) -> StressHistory:
    """Return the history of the largest stress (S,) in Pa at times t (S,) in s, and its peak of all times.

    The largest stress occurs at the points `point` (S,), which are indices of points of `rows`.  `at_peak` is von
    Mises' stress (P,) in Pa at all P points of `rows` at the time of the peak.  With `at_peak`, the first of all points
    that share the largest stress is taken as the peak, so that round-off does not decide.  If `at_peak` is None, the
    peak is at its entry of `point`.
    """
    k = int(largest.argmax())
    like = np.array([point[k]])
    if at_peak is not None and largest[k] > 0.0:
        like = np.flatnonzero(at_peak >= (1.0 - SHARED) * largest[k])[:MOST_SHARED]
    p = int(like[0])
    cell, place = int(rows.cell[p]), _point_tuple(rows.points[p])
    near = 1e-6 * float(np.ptp(rows.points, axis=0).max())
    shared: list[Position] = []
    for q in like[1:]:
        earlier = np.array([place, *shared])
        if np.linalg.norm(earlier - rows.points[q], axis=1).min() > near:  # neighbouring cells have points in common
            shared.append(_point_tuple(rows.points[q]))
    on = rows.faces[rows.face[p]]
    peak = StressPeak(float(largest[k]), float(t[k]), place, on, cell, grid.region_names(cell), tuple(shared))
    return StressHistory(np.asarray(t), largest, point, peak)


def peaks_by_region(rows: StressRows, grid: Grid, most: Array, when: Array) -> dict[str, StressPeak]:
    """Return the stress peak in each region of a grid that has points of `rows`, by the region's name.

    `most` (P,) in Pa is the largest stress over time at each of P points of `rows`, and `when` (P,) in s the time at
    which it occurs.
    """
    peaks = {}
    for name, cells in sorted(grid.regions.items()):
        points = np.flatnonzero(np.isin(rows.cell, cells))
        if not len(points):
            continue
        p = int(points[most[points].argmax()])
        place, face = _point_tuple(rows.points[p]), rows.faces[rows.face[p]]
        peaks[name] = StressPeak(float(most[p]), float(when[p]), place, face, int(rows.cell[p]), name)
    return peaks


def _point_tuple(point: Array) -> Position:
    """Return a point (3,) as a tuple of three floats."""
    x, y, z = (float(c) for c in point)
    return x, y, z


def _largest_by_cell(values: Array, cell: Indices, cells: int) -> Array:
    """Return the largest value in each of `cells` cells, (S, cells), of values (S, p) at p points.

    `cell` (p,) is the number of the cell of each point.  A cell without points has minus infinity.
    """
    result = np.full((cells, len(values)), -np.inf)
    np.maximum.at(result, cell, values.T)
    return result.T


def _largest_indices(values: Array, cell: Indices, cells: int) -> Indices:
    """Return the index, from 0 to p - 1, of the point with the largest of values (S, p) in each cell, (S, cells).

    `cell` (p,) is the number of the cell of each of the p points.  A cell without points has the index 0.
    """
    order = np.argsort(values, axis=1, kind="stable")
    result = np.zeros((len(values), cells), np.int64)
    rows = np.arange(len(values))[:, None]
    result[rows, cell[order]] = order  # the last index written to a cell is that of its largest value
    return result


#: Units of section forces, by the names of the forces.
FORCES = {
    "normal force": "N",
    "shear force y": "N",
    "shear force z": "N",
    "torque": "N m",
    "bending moment y": "N m",
    "bending moment z": "N m",
}
#: For each shear force, the bending moment that has it as derivative along x, and the sign of the derivative.
SHEAR = {"shear force y": ("bending moment z", -1.0), "shear force z": ("bending moment y", 1.0)}


@dataclass(frozen=True)
class ForceRows:
    """Matrix `rows` (P, n) from n coordinates to P section forces of a beam, in N or N m per unit of a coordinate.

    `names` (P,) are the names of the forces, keys of `FORCES`, and `x` (P,) are their positions along the beam in m.
    """

    rows: sp.csr_matrix
    names: tuple[str, ...]
    x: Array


def force_rows(x: Array, strains: Array, stiffness: dict[str, Array], coordinates: Indices, size: int) -> ForceRows:
    """Return the matrix of the section forces at both ends of each of E elements.

    Its rows are ordered by force, as in `FORCES`, then by element, then by end.

    Parameters
    ----------
    x : (E, 2) array, m
        Positions of the two ends of each element.
    strains : (E, 2, v, d) array
        v strains at both ends of each element, per unit of each of the element's d coordinates.
    stiffness : dict of str to (v,) or (E, v) array
        Normal force, torque and bending moments by name, per unit of each of the v strains: one row for all elements,
        or one for each element.  Shear forces are computed as derivatives of the moments along the element.
    coordinates : (E, d) integer array
        Numbers of each element's coordinates.
    size : int
        Number n of coordinates of the model.
    """
    each = (len(strains), strains.shape[2])
    forces = {name: np.einsum("eavd,ev->ead", strains, np.broadcast_to(unit, each)) for name, unit in stiffness.items()}
    for name, (moment, sign) in SHEAR.items():
        if moment in forces:
            slope = sign * (forces[moment][:, 1] - forces[moment][:, 0]) / np.diff(x)
            forces[name] = np.stack([slope, slope], axis=1)
    names = [name for name in FORCES if name in forces]
    entries = np.concatenate([forces[name].reshape(x.size, -1) for name in names])
    columns = np.tile(np.repeat(coordinates, 2, axis=0), (len(names), 1))
    ends = np.arange(0, entries.size + 1, entries.shape[1])
    rows = sp.csr_matrix((entries.ravel(), columns.ravel(), ends), (len(entries), size))
    return ForceRows(rows, tuple(np.repeat(names, x.size).tolist()), np.tile(x.ravel(), len(names)))


@dataclass(frozen=True)
class Envelope:
    """Least and largest values over time of c quantities at N positions along a body, and the times of these values."""

    names: tuple[str, ...]  # (c,)
    units: tuple[str, ...]  # (c,)
    x: Array  # (N,) m
    least: Array  # (c, N), in the quantities' units
    least_at: Array  # (c, N) s
    most: Array  # (c, N)
    most_at: Array  # (c, N) s

    def extremes(self) -> dict[str, dict[str, Any]]:
        """Return the extremes of each quantity along the body, by the quantity's name.

        The values are ``min`` and ``max`` in ``unit``, their times in s ``t_min`` and ``t_max``, and their positions in
        m ``x_min`` and ``x_max``.
        """
        extremes_of = {}
        for k, name in enumerate(self.names):
            low, high = int(self.least[k].argmin()), int(self.most[k].argmax())
            extremes_of[name] = {
                "unit": self.units[k],
                **_extreme_entries("min", self.least[k, low], self.least_at[k, low], self.x[low]),
                **_extreme_entries("max", self.most[k, high], self.most_at[k, high], self.x[high]),
            }
        return extremes_of


class RunningEnvelope:
    """Envelope of P histories, which are added in blocks of a few times each.

    History j belongs to the quantity `names[j]` at the position `x[j]` in m; a quantity may have several histories at
    the same position.
    """

    def __init__(self, names: tuple[str, ...], x: Array) -> None:
        self._names, self._x = np.array(names), x
        self._least, self._most = np.full(len(x), np.inf), np.full(len(x), -np.inf)
        self._least_at, self._most_at, self._start = np.zeros(len(x)), np.zeros(len(x)), np.inf

    def add(self, t: Array, values: Array) -> None:
        """Update the envelope with values (S, P) at the times t (S,) in s."""
        self._start = min(self._start, float(t[0]))
        low, high = values.argmin(axis=0), values.argmax(axis=0)
        on = np.arange(values.shape[1])
        lower, higher = values[low, on] < self._least, values[high, on] > self._most
        self._least_at[lower], self._most_at[higher] = t[low[lower]], t[high[higher]]
        self._least, self._most = np.minimum(self._least, values[low, on]), np.maximum(self._most, values[high, on])

    def envelope(self, units: dict[str, str]) -> Envelope:
        """Return the least and the largest value over time of each quantity in `units`, at each of its positions.

        `units` are the units of quantities, by name.  Values that are round-off compared with the largest value of the
        same unit are set to zero.  A quantity that is always zero at a position has both extremes at the first time.
        """
        names, x = [name for name in units if name in self._names], np.unique(self._x)
        shape = (len(names), len(x))
        least, least_at, most, most_at = (np.full(shape, np.nan) for _ in range(4))
        for k, name in enumerate(names):
            of_quantity = np.flatnonzero(self._names == name)
            for i, place in enumerate(x):
                at_place = of_quantity[self._x[of_quantity] == place]
                low, high = at_place[self._least[at_place].argmin()], at_place[self._most[at_place].argmax()]
                least[k, i], least_at[k, i] = self._least[low], self._least_at[low]
                most[k, i], most_at[k, i] = self._most[high], self._most_at[high]
        for unit in set(units.values()):
            of_unit = np.array([units[name] == unit for name in names])
            largest = max(np.abs(extremes[of_unit]).max(initial=0.0) for extremes in (least, most))
            for values in (least, most):
                values[of_unit[:, None] & (np.abs(values) <= ROUND_OFF * largest)] = 0.0
        nothing = (least == 0.0) & (most == 0.0)
        least_at[nothing] = most_at[nothing] = self._start
        return Envelope(tuple(names), tuple(units[name] for name in names), x, least, least_at, most, most_at)


def _extreme_entries(what: str, value: float, t: float, x: float) -> dict[str, float]:
    """Return value, time t in s and position x in m of an extreme, by three keys.

    The keys are `what`, and `what` with ``t_`` or ``x_`` before it.
    """
    return {what: float(value), f"t_{what}": float(t), f"x_{what}": float(x)}
