r"""What acts on a structure, and what is measured on it: loads, displacements, forces of pads, and probes.

Probes are stresses, strains and displacements of a place as rows on a model's coordinates.  The normal strains
:math:`\varepsilon` and shear strains :math:`\gamma` follow from the stresses :math:`\sigma` and :math:`\tau` by
Hooke's law, on a shell for plane stress, with Young's modulus E, Poisson's ratio :math:`\nu` and the shear modulus G of
the cell's material:

.. math:: \varepsilon = \frac{(1 + \nu)\, \sigma - \nu \operatorname{tr}(\sigma)\, 1}{E}, \qquad \gamma = \frac{\tau}{G}

The mean over a group gives each of its stress points the same weight.  At a point of a beam stresses are linear between
the two ends of the element, as moments of loads on nodes are, so that they don't depend on where nodes are.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from pmr.errors import InputError
from pmr.files.arrays import Array, Indices
from pmr.models import FiniteElementModel, StructuralModel, is_assembled, is_beam
from pmr.results.field_stress import StressRows
from pmr.scene.built import WEIGHT, force_name
from pmr.scene.frame import INERTIA
from pmr.scene.joints import OneBody
from pmr.scene.keys import Point, qualified_name
from pmr.scene.structures import Material, Probe

#: Directions of displacements.
ALONG = ("x", "y", "z")


@dataclass(frozen=True)
class Action:
    """A force (N) or moment (N m) along or about `direction` on a place.

    As an output, it is the displacement or rotation of the place along or about this direction.
    """

    name: str
    on: str | float  # a named place of the body, or a coordinate in m along its axis
    direction: str  # x, y or z of a force and a displacement; rx, ry or rz of a moment and a rotation
    point: tuple[float, float, float] | None = None  # m: moves rigidly with the place; None: the place's centroid
    measures: str = "beam"  # kind of output: ``beam`` for a place along the body, ``tip`` for its tip

    @property
    def kind(self) -> str:
        """Kind of the output and its direction, such as ``tip z`` or ``probe ry`` (`pmr.results.response`)."""
        return f"{self.measures if self.direction in ALONG else 'probe'} {self.direction}"

    @property
    def is_displacement(self) -> bool:
        """Whether the action is a force on the centroid of its place, and measures the displacement there."""
        return self.direction in ALONG and self.point is None

    @property
    def unit(self) -> str:
        """Unit of the measured displacement or rotation."""
        return "m" if self.direction in ALONG else "rad"


@dataclass(frozen=True)
class Warmth:
    """A load by a difference of temperature across a beam; its input is the difference in K.

    `gradient` is the gradient along `direction` (y or z) of the strain of a free beam, in 1/m for a difference of 1 K.
    """

    name: str
    direction: str
    gradient: float


@dataclass(frozen=True)
class LineLoad:
    """A force per length along `direction`, distributed over the body's length; its input is in N/m.

    The distribution is the Legendre polynomial of this `degree`, whose argument is -1 at x = 0 and 1 at the tip.
    """

    name: str
    direction: str
    degree: int


@dataclass(frozen=True)
class PadForce:
    """An output: the force in N of a pad or support that does not move, has a stiffness and holds both ways."""

    pad: str  # name of the pad or the support
    kind: str = "pad"  # or ``support``

    @property
    def name(self) -> str:
        """Name of the output."""
        return force_name(self.pad)

    @property
    def unit(self) -> str:
        """Unit of the force, N."""
        return "N"


@dataclass(frozen=True)
class Weight:
    """A load of mass times acceleration along `direction` (3,), on the structure and its attached masses, as gravity.

    Its input is the acceleration in m/s^2.  The length of `direction` is not used.
    """

    direction: tuple[float, float, float] = (0.0, 0.0, -1.0)
    name: str = WEIGHT


@dataclass(frozen=True)
class Inertia:
    """A load by a field of acceleration at the points r: uniform along axis j, or along j and proportional to r_k.

    `field` is ``j`` for the uniform field :math:`e_j` or ``jk`` for the linear field :math:`r_k e_j`, with the letters
    x, y or z for j and k.  The input of the load is minus the amplitude of the field, so that it has the sign of a
    force.  Its unit is m/s^2 for a uniform and 1/s^2 for a linear field.
    """

    field: str

    @property
    def name(self) -> str:
        """Name of the input."""
        return INERTIA + self.field


#: Units of measures.  Displacements are in mm, as errors and estimates are computed for all outputs in m.
UNITS = {"stress": "Pa", "strain": "1", "displacement": "mm"}
#: Share of a body's length up to which a probe beyond an end is at the end: round-off of a user's arithmetic.
BEYOND_END = 1e-6


@dataclass(frozen=True)
class Gauge:
    """An output of a probe: a row (1, n) that measures it from a model's n coordinates, at the point `at` (3,) in m.

    `face` names the face of a wall, or the corner of a beam's section, and is empty for displacements.
    """

    name: str
    unit: str
    row: sp.csr_matrix
    at: Array
    face: str = ""

    @property
    def kind(self) -> str:
        """Kind of the output, ``probe``."""
        return "probe"


def gauges(part: OneBody, model: StructuralModel) -> list[Gauge]:
    """Gauges of all probes of a body, in their order, one for each component that a probe measures.

    The list is empty if the body has no probes.  Raises an `InputError` in these cases:

    - a probe's point is off the body;
    - a group or face does not exist;
    - a probe measures stresses, and the model has none;
    - the body is given by matrices.
    """
    if not part.probes:
        return []
    if not is_assembled(model):
        raise InputError("scene", "probes", None, "given matrices have no cells and no stresses: leave them out")
    measured, stresses = list[Gauge](), None
    for i, probe in enumerate(part.probes):
        if probe.at is not None:
            _check_on_body(f"probes[{i}].at", probe.at, part, model)
        for measure in probe.measures:
            if measure == "displacement":
                measured += _displacements(probe, model)
                continue
            stresses = stresses or _Stresses.from_model(part, model)
            if stresses is None:
                allowed = "displacement is allowed: this model has no stresses"
                raise InputError("scene", f"probes[{i}].measures", measure, allowed)
            measured += stresses.gauges(i, measure)
    return measured


def _check_on_body(key: str, at: Point, part: OneBody, model: FiniteElementModel) -> None:
    """Raise an `InputError` with `key` if a point `at` in m is off the body: beyond an end, or far from its axis.

    Across the axis, a point outside may have a distance of up to the width or the height of the body, whichever is
    more: the nearest wall stands for such a point.  If a beam has no extent in a direction, such as a planar beam along
    y, any distance in this direction is accepted.  The axis is x, or the longest direction of a mesh from a file.
    """
    points = model.grid.points
    rows = model.stresses() if is_beam(model) else None
    if rows is not None:
        points = np.concatenate([points, rows.points])
    low, high = points.min(axis=0), points.max(axis=0)
    extent = high - low
    axis = 0 if is_beam(model) or part.body.box is not None else int(extent.argmax())
    slack = np.full(3, np.delete(extent, axis).max())
    if is_beam(model):
        slack[extent == 0.0] = np.inf
    slack[axis] = BEYOND_END * extent[axis]
    if np.any((np.array(at) < low - slack) | (np.array(at) > high + slack)):
        sizes = ", ".join(
            f"{name} from {a:.4g} to {b:.4g} m" for name, a, b in zip("xyz", low + 0.0, high + 0.0, strict=True)
        )
        raise InputError("scene", key, list(at), f"a point on the body is allowed, which has {sizes}")


def probe_summary(outputs: Mapping[str, Iterable[object]]) -> dict[str, list[dict[str, Any]]]:
    """Return a dict of one key, ``probes``, for summary.json: name, unit, position in m and face of each gauge.

    `outputs` has the outputs of each body by the body's name; outputs that are no gauges are ignored.  The name of a
    gauge begins with the body's name, unless the body's name is empty.  Without gauges the dict is empty.
    """
    probes = [
        {"name": qualified_name(body, gauge.name), "unit": gauge.unit, "at": gauge.at.tolist(), "face": gauge.face}
        for body, gauges in outputs.items()
        for gauge in gauges
        if isinstance(gauge, Gauge)
    ]
    return {"probes": probes} if probes else {}


def _displacements(probe: Probe, model: FiniteElementModel) -> Iterator[Gauge]:
    """Yield gauges in mm of a probe's displacement along x, y and z: of the nearest grid point, or the mean of a group.

    On a beam, a point moves with its cross-section, which may be between nodes.  Directions along which the model can't
    move are left out.
    """
    if probe.at is not None and is_beam(model):
        x = float(np.clip(probe.at[0], *model.node_stations[[0, -1]]))
        where, names = np.array([x, *probe.at[1:]]), [d for d in model.directions if d in ("x", "y", "z")]
        rows = model.motion(x, where)[[model.directions.index(d) for d in names]]
    elif probe.at is not None:
        point = int(np.linalg.norm(model.grid.points - probe.at, axis=1).argmin())
        rows, names = model.point_displacements()[3 * point : 3 * point + 3], list("xyz")
        where = model.grid.points[point]
    else:
        on = str(probe.on)
        rows, names = model.displacement(on), [d for d in model.directions if d in ("x", "y", "z")]
        where = model.centroid(on)
    for k, name in enumerate(names):
        if rows[k].nnz:  # a planar beam has no displacement along y
            yield Gauge(f"{probe.name} displacement {name}", UNITS["displacement"], 1e3 * sp.csr_matrix(rows[k]), where)


class _Points(NamedTuple):
    """Stress points of a probe, and the weight of each in the mean that the probe measures."""

    numbers: Indices  # (k,)
    weights: Array  # (k,): their sum is 1


@dataclass(frozen=True)
class _Stresses:
    """Stress rows of a model, and the body with the probes and materials to which they are applied."""

    part: OneBody
    model: FiniteElementModel
    rows: StressRows

    @classmethod
    def from_model(cls, part: OneBody, model: FiniteElementModel) -> _Stresses | None:
        """Stress rows of `model` for the probes of `part`; None if the model has no stresses."""
        rows = model.stresses()
        return None if rows is None else cls(part, model, rows)

    def gauges(self, number: int, measure: str) -> Iterator[Gauge]:
        """Yield gauges of the components of ``stress`` or ``strain`` (`measure`) that probe `number` measures.

        Raises the errors of `_probe_points`.
        """
        stress_rows, probe, (points, weights) = self.rows, self.part.probes[number], self._probe_points(number)
        mean = self._mean(points, weights)
        if measure == "strain":
            by_material = self._by_material(points, weights)
            strains = [_hooke(material, mean.shape[0]) @ self._mean(points, shares) for material, shares in by_material]
            mean = sp.csr_matrix(sum(strains))
        where, face = weights @ stress_rows.points[points], stress_rows.faces[stress_rows.face[points[0]]]
        for k, component in enumerate(stress_rows.components):
            yield Gauge(f"{probe.name} {measure} {component}", UNITS[measure], mean[k], where, face)

    def _probe_points(self, number: int) -> _Points:
        """Stress points that probe `number` measures, and their weights.

        A probe at a point takes the nearest stress point; on a beam, it takes the stress points at both ends of the
        element.  A probe on a group takes all stress points in the group, with equal weights.  Only stress points on
        the probe's face count.  If the probe names no face, a point may take any face, and a group takes the model's
        first face.  Raises an `InputError` if the probe's face or group does not exist, or if the group has no stress
        point on the face.
        """
        stress_rows, probe, key = self.rows, self.part.probes[number], f"probes[{number}]"
        if probe.face and probe.face not in stress_rows.faces:
            raise InputError("scene", f"{key}.face", probe.face, f"{', '.join(stress_rows.faces)} are allowed")
        at = stress_rows.points_on(probe.face) if probe.face else np.arange(len(stress_rows.points))
        if probe.at is not None:
            nearest = at[[int(np.linalg.norm(stress_rows.points[at] - probe.at, axis=1).argmin())]]
            return self._ends(nearest, probe.at[0]) if is_beam(self.model) else _Points(nearest, np.ones(1))
        regions = self.model.grid.regions
        if probe.on not in regions:
            names = ", ".join(sorted(regions)) or "none"
            raise InputError("scene", f"{key}.on", probe.on, f"groups of cells are allowed: {names}; or a point, at")
        at = at if probe.face else stress_rows.points_on(stress_rows.faces[0])
        inside = at[np.isin(stress_rows.cell[at], regions[str(probe.on)])]
        if not len(inside):
            raise InputError("scene", f"{key}.face", probe.face, f"no cell of {probe.on} is there")
        return _Points(inside, np.full(len(inside), 1.0 / len(inside)))

    def _ends(self, nearest: Indices, x: float) -> _Points:
        """Stress points at both ends of the beam's element at `x` m, with weights that interpolate linearly to `x`.

        The points are in the corner of the section in which the stress point `nearest` (1,) is.
        """
        corner = np.flatnonzero(self.rows.face == self.rows.face[nearest]).reshape(-1, 2)
        first, last = self.rows.points[corner, 0].T
        element = int(np.maximum(first - x, x - last).argmin())
        share = np.clip((x - first[element]) / (last[element] - first[element]), 0.0, 1.0)
        return _Points(corner[element], np.array([1.0 - share, share]))

    def _mean(self, points: Indices, weights: Array) -> sp.csr_matrix:
        """Rows (c, n) of the sum of stresses at `points` (k,) times `weights` (k,), for each of c components."""
        count, shares = len(self.rows.components), sp.csr_matrix(weights)
        return sp.vstack([shares @ self.rows.rows[count * points + k] for k in range(count)], format="csr")

    def _by_material(self, points: Indices, weights: Array) -> Iterator[tuple[Material, Array]]:
        """Yield each material at the stress points `points` (k,), with weights (k,) for this material alone.

        Points of the material have their weight in `weights` (k,), all other points have 0.  A cell has the material of
        its region, or that of the body if the region has none.
        """
        cells, is_in_body = self.rows.cell[points], np.ones(len(points), bool)
        for name, region in self.part.body.regions.items():
            if region.material is not None:
                inside = np.isin(cells, self.model.grid.regions[name])
                is_in_body &= ~inside
                if inside.any():
                    yield region.material, np.where(inside, weights, 0.0)
        if is_in_body.any():
            yield self.part.body.material, np.where(is_in_body, weights, 0.0)


def _hooke(material: Material, components: int) -> sp.csr_matrix:
    """Strains (c, c) of `material` under unit stresses, for c `components`.

    c is 1 for a fibre, 2 with shear, 3 in a plane and 6 in space.  Shear strains are changes of angles in rad.
    """
    normal = {1: 1, 2: 1, 3: 2, 6: 3}[components]
    matrix = np.eye(components) / material.shear_modulus
    matrix[:normal, :normal] = ((1.0 + material.poisson) * np.eye(normal) - material.poisson) / material.young
    return sp.csr_matrix(matrix)
