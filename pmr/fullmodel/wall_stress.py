r"""Largest stress in the walls of sections at rings of pads, and forces of pads at which walls begin to yield.

The local stress :math:`\sigma_k` of pad k is that of a shell of a piece of the section, which its inertia holds, under
1 N that pulls outwards at the pad, less the stress of a beam of the same piece.  Pads push inwards with the forces
:math:`f_k`.  With the section forces F of the whole section and the beam's law S, the stress at a point p of a wall is

.. math:: \sigma(p) = S(p)\, F(x_p) - \sum_k f_k\, \sigma_k(p)

Left out are the shear of transverse forces, which is small in walls that bend, and rings of pads nearby.  The pressure
of a pad is taken to be largest in its middle, as that of all pads of `pmr` is; all stresses are stated a second time
for an even one (`pmr.fullmodel.pads.under_even_pad`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple, TypeVar

import numpy as np

from pmr.errors import InputError, environment
from pmr.files import npz
from pmr.files.arrays import Array
from pmr.fullmodel.pads import Pad
from pmr.fullmodel.wall_compliance import HeldModel, PlateBody, beam_of, shell_of
from pmr.models.meshed import node_fits
from pmr.models.profile_section import section_of
from pmr.models.sections_along import axial_stress_factors, torsion_stress_factors
from pmr.models.shell import boom_of_box
from pmr.results.field_series import mean_by_place
from pmr.results.field_stress import FORCES, PLANE, von_mises
from pmr.scene.built import PadRing
from pmr.scene.choice import traits_of
from pmr.scene.joints import BoomSection
from pmr.scene.members import Member, body_ring, member_at, members, name_in_scene, seats
from pmr.scene.scene import Scene
from pmr.scene.signals.base import Interval

#: Length of the piece of a section that is looked at, less that of the pads, over the larger of width and height.
PIECE = 3.0
#: Cells along and across a pad, which are taken times the fineness of each mesh, the coarser one first.
ALONG, ACROSS = 4, 2
FINENESS = (1.0, 2.0)
#: Order with which the largest stress converges as cells get smaller.
ORDER = 2
#: Shares of the stress that its error bar has on top, within a wall and at an edge where two walls meet: for where pads
#: lie among the cells, and for what turns the corners of the section beyond the piece.
MARGIN, EDGE_MARGIN = 0.01, 0.08
#: Points are stored at which the stress of a pad alone is at least this share of its largest one.
STORED = 0.3


class Estimate(NamedTuple):
    r"""Value that is extrapolated from two meshes, and its error bar, both in the same unit.

    With cells of the sizes :math:`h_1` and :math:`h_2 < h_1`, a stress converges with their square; m is its `margin`:

    .. math:: \sigma_v = \sigma_2 + d,\; e = |d| + m \sigma_v,\; d = (\sigma_2 - \sigma_1) / (h_1^2 / h_2^2 - 1)
    """

    value: float
    error: float

    @classmethod
    def from_meshes(cls, coarse: float, fine: float, margin: float) -> Estimate:
        """Extrapolate from the values on a `coarse` and a `fine` mesh.

        The error bar is the change from the fine mesh to the extrapolated value, plus the share `margin` of this value.
        """
        change = (fine - coarse) / ((FINENESS[1] / FINENESS[0]) ** ORDER - 1.0)
        return cls(fine + change, abs(change) + margin * abs(fine + change))


class ByPressure(NamedTuple):
    """One quantity under two distributions of the pressure under a pad, which have the same resultant force."""

    middle: Estimate  # with the pressure largest in the middle of the pad
    even: Estimate


@dataclass(frozen=True)
class RingStress:
    """Local stresses of k pads at P points on both faces of the walls around them.

    Each pad acts alone, with 1 N outwards.
    """

    points: Array  # (P, 3) m: x from the middle of the pads, y and z
    thickness: Array  # (P,) m
    unit: Array  # (2, k, P, 3) Pa/N: along, across and shear, by the pressure in the order of `ByPressure`
    on_edge: Array  # (P,): 1 where two walls meet, else 0

    def margin(self, point: int) -> float:
        """Share of the largest stress that is added to the error bar, if the largest stress is at this `point` number.

        The share is larger at an edge where two walls meet.
        """
        return EDGE_MARGIN if self.on_edge[point] else MARGIN


def estimates_of_pads(coarse: RingStress, fine: RingStress) -> list[ByPressure]:
    """Largest von Mises stress in Pa/N of each of k pads alone, from the stresses on two meshes."""
    on_coarse, on_fine = (von_mises(stress.unit, PLANE) for stress in (coarse, fine))
    return [
        ByPressure(*(_largest(first, second, fine) for first, second in zip(*of_pad, strict=True)))
        for of_pad in zip(on_coarse.swapaxes(0, 1), on_fine.swapaxes(0, 1), strict=True)
    ]


def _largest(on_coarse: Array, on_fine: Array, fine: RingStress) -> Estimate:
    """Largest stress, extrapolated from the stresses at the points of a coarse mesh and at those (P,) of a fine one.

    `fine` has the points of the fine mesh.  The point with the largest stress decides the margin of the error bar.
    """
    point = int(on_fine.argmax())
    return Estimate.from_meshes(float(on_coarse.max()), float(on_fine[point]), fine.margin(point))


class SectionPiece:
    """A piece of a section around pads of one size, as a shell on two meshes, and the local stresses of pads on it."""

    def __init__(self, part: BoomSection, length: float, width: float) -> None:
        """Choose the meshes for pads of this `length` and `width` in m.

        Raises an `InputError` if the walls change along the section, or the cells would be too many.
        """
        box = part.body.box
        if box is None or not part.has_even_walls:
            raise InputError("scene", "body.box", None, "walls that stay the same along the section are allowed")
        self._code = environment.computing_digest()
        self.section, self.length = box, min(box.length, length + PIECE * max(box.width, box.height))
        piece = box.model_copy(update={"length": self.length})
        meshes = [boom_of_box(piece, width / (f * ACROSS), length / (f * ALONG)) for f in FINENESS]
        self.bodies = [PlateBody(mesh, piece, part.body.material, part.body.shear_correction) for mesh in meshes]

    @cached_property
    def beam(self) -> PieceBeam:
        """Beam of the piece, which both meshes are compared with."""
        return PieceBeam(self.bodies[0])

    @cached_property
    def meshes(self) -> list[PieceMesh]:
        """Models of the piece on the coarser and the finer mesh."""
        return [PieceMesh(body, self.beam) for body in self.bodies]

    def place(self, x: Array) -> Array:
        """Return the places (...) in m on the piece that stand for places x (...) in m on the section.

        They are as far from the nearer end as x is, or in the middle of the piece if both ends are farther away.
        """
        middle, ahead = self.length / 2.0, self.section.length - x
        return np.where(x < middle, x, np.where(ahead < middle, self.length - ahead, middle)).round(9)

    def stresses(self, pads: Sequence[Pad], place: float) -> list[RingStress]:
        """Return the local stresses of pads at a `place` in m on the piece, on the coarser and the finer mesh.

        The pads' own places `at` are not used.  Stresses are stored in the user's cache folder, and read from there if
        they were computed before.  Raises an `InputError` if a pad leaves its face.
        """
        ring = [
            Pad("pad", pad.on, place, pad.across, length=pad.length, width=pad.width, stiffness=1.0) for pad in pads
        ]

        def compute(number: int) -> dict[str, Array]:
            return npz.record_arrays(self.meshes[number].stress(ring), "")

        result = []
        for number, body in enumerate(self.bodies):
            request = repr((body, ring, self._code))
            arrays = npz.stored_or_computed("wall-stress", request, partial(compute, number))
            result.append(npz.record_from_arrays(RingStress, arrays, ""))
        return result

    def factors(self, stress: RingStress) -> Array:
        """Return the stresses (P, 3, 6) in Pa at the points of `stress` per unit of each section force.

        Section forces are in the order of `FORCES`.  The three stresses are the stress along the axis, the stress
        across it in the wall (zero), and the shear stress.  Their signs are those of `RingStress`.
        """
        box, factors = self.section, np.zeros((len(stress.points), 3, len(FORCES)))
        section = section_of(box, self.bodies[0].material.poisson)
        factors[:, 0] = axial_stress_factors(section, stress.points[:, 1:])
        factors[:, 2] = -torsion_stress_factors(box, stress.thickness)  # along x and clockwise
        return factors

    def destroy(self) -> None:
        """Free the memory of the models, if they were made."""
        if "meshes" in self.__dict__:
            self.beam.destroy()
            for mesh in self.meshes:
                mesh.destroy()


class PieceBeam:
    """Beam of a piece of a section, and its section forces under pads."""

    def __init__(self, body: PlateBody) -> None:
        line = beam_of(body)
        self._held, self._rows = HeldModel(line, body), line.section_forces()

    def section_forces(self, pads: Sequence[Pad], x: Array) -> Array:
        """Section forces (2 k, 6, P) in N and N m at the places x (P,) in m, under 1 N outwards on each of k pads.

        They are in the order of `FORCES`, first with the pressure largest in the middle of pads, then with an even one.
        """
        forces, names = self._rows.rows @ self._held.under_pads(pads), np.array(self._rows.names)
        result = np.zeros((2 * len(pads), len(FORCES), len(x)))
        for number, name in enumerate(FORCES):
            if np.any(of := names == name):
                at, values = mean_by_place(self._rows.x[of], forces[of].T)
                result[:, number] = [np.interp(x, at, value) for value in values]
        return result

    def destroy(self) -> None:
        """Free the memory of the model."""
        self._held.destroy()


class PieceMesh:
    """Shell of a piece of a section, its beam, and the shell's stresses at the nodes of its walls."""

    def __init__(self, body: PlateBody, beam: PieceBeam) -> None:
        shell = shell_of(body)
        self._body, self._beam, self._held = body, beam, HeldModel(shell, body)
        self._rows, self._thickness = shell.stresses(), shell.thickness
        self._fits, self._on_edge = node_fits(shell.mesh)

    def stress(self, pads: Sequence[Pad]) -> RingStress:
        """Return the local stresses of pads, at points near the pads.

        At each point, the stress of at least one pad is no less than the share `STORED` of this pad's largest stress.
        All `pads` are at one place along the piece.  Raises an `InputError` if a pad leaves its face.
        """
        rows, fits = self._rows, self._fits
        stress = rows.evaluate(self._held.under_pads(pads).T)
        faces = [rows.points_on(face) for face in (rows.faces[0], rows.faces[-1])]
        points = np.concatenate([fits @ rows.points[on] for on in faces])
        unit = np.array([np.concatenate([fits @ of_pad[on] for on in faces]) for of_pad in stress])
        thickness = np.tile(fits @ self._thickness, 2)
        section = section_of(self._body.profile, self._body.material.poisson)
        forces = self._beam.section_forces(pads, points[:, 0])
        unit[..., 0] -= np.einsum("pc,kcp->kp", axial_stress_factors(section, points[:, 1:]), forces)
        unit[..., 2] += np.einsum("pc,kcp->kp", torsion_stress_factors(self._body.profile, thickness), forces)
        size = von_mises(unit, PLANE)
        near = np.any(size >= STORED * size.max(axis=1)[:, None], axis=0)
        points[:, 0] -= pads[0].at
        by_pressure = unit[:, near].reshape(2, len(pads), -1, 3)
        return RingStress(points[near], thickness[near], by_pressure, np.tile(self._on_edge, 2)[near])

    def destroy(self) -> None:
        """Free the memory of the model."""
        self._held.destroy()


#: Places along its range at which a ring that slides on a section is looked at.
PLACES = 3


@dataclass(frozen=True)
class SectionStates:
    """Section forces along a section at S times."""

    x: Array  # (X,) m: places along the section, ascending
    forces: Array  # (S, 6, X) N and N m, in the order of `FORCES`

    def at(self, state: int, x: Array) -> Array:
        """Return the section forces (6, P) at time number `state` and at the places x (P,) in m.

        They are linear between the places `self.x`, and constant beyond the first and the last one.
        """
        return np.array([np.interp(x, self.x, values) for values in self.forces[state]])


@dataclass(frozen=True)
class LoadedRing:
    """Pads that are on a section at one place along it, and move together."""

    pads: tuple[Pad, ...]  # k
    x: Array  # (S,) m: their place along the section at S times
    forces: Array  # (S, k) N, positive where they push the wall inwards


class SeatedRing(NamedTuple):
    """Ring of pads that slides or rests on a section."""

    joint: int  # number of the section whose joint it is; 0: the pads are on the ground
    pads: tuple[Pad, ...]  # at 0 m
    positions: Interval  # m along the section


AnyRing = TypeVar("AnyRing", LoadedRing, SeatedRing)


@dataclass(frozen=True)
class WallPeak:
    """Largest von Mises stress in the walls of a section at a ring of pads."""

    stress: ByPressure  # Pa
    state: int  # number of the time
    position: Array  # (3,) m on the section


def wall_peak(part: BoomSection, states: SectionStates, rings: Sequence[LoadedRing]) -> WallPeak | None:
    """Return the largest von Mises stress in the walls at the pads of a section at all times.

    The stress of a ring is computed in two steps.  First the time of its peak is searched for, under the pressure that
    is largest in the middle of the pads.  For this search, the ring is at the nearest of up to `PLACES` places along
    its way.  Then the stress at this time is computed with the ring at its true place, under both pressures.

    The result has the largest stress of all rings under each pressure.  Its `state` and `position` belong to the
    pressure that is largest in the middle.  None is returned if there are no rings.  Not collective.

    Raises an `InputError` as `SectionPiece` and its method `stresses` do.
    """
    best: WallPeak | None = None
    for (length, width), of_size in _by_size(rings).items():
        piece = SectionPiece(part, length, width)
        for ring in of_size:
            places = piece.place(ring.x)
            looked_at = np.unique(piece.place(np.linspace(ring.x.min(), ring.x.max(), PLACES)))
            nearest = np.abs(places[:, None] - looked_at).argmin(axis=1)
            largest = np.zeros(len(places))
            for number, place in enumerate(looked_at.tolist()):
                fine, numbers = piece.stresses(ring.pads, place)[-1], np.flatnonzero(nearest == number)
                factors = piece.factors(fine)
                largest[numbers] = [of.max() for of in _combined(factors, fine, ring, states, numbers.tolist())]
            state = int(largest.argmax())
            on_meshes = piece.stresses(ring.pads, float(places[state]))
            combined = [
                [next(_combined(piece.factors(on), on, ring, states, [state], pressure)) for on in on_meshes]
                for pressure in range(len(ByPressure._fields))
            ]
            stress = ByPressure(*(_largest(coarse, fine, on_meshes[-1]) for coarse, fine in combined))
            even = stress.even if best is None else max(stress.even, best.stress.even)
            if best is None or stress.middle.value > best.stress.middle.value:
                at = on_meshes[-1].points[combined[0][-1].argmax()]
                best = WallPeak(stress, state, at + [ring.x[state], 0.0, 0.0])
            best = replace(best, stress=best.stress._replace(even=even))
        piece.destroy()
    return best


def _by_size(rings: Iterable[AnyRing]) -> dict[tuple[float, float], list[AnyRing]]:
    """Return the rings grouped by the length and the width in m of their pads, which are taken from the first pad."""
    by_size = dict[tuple[float, float], list[AnyRing]]()
    for ring in rings:
        by_size.setdefault((ring.pads[0].length, ring.pads[0].width), []).append(ring)
    return by_size


def _combined(
    factors: Array,
    stress: RingStress,
    ring: LoadedRing,
    states: SectionStates,
    numbers: Sequence[int],
    pressure: int = 0,
) -> Iterator[Array]:
    """Yield the von Mises stress (P,) in Pa at the points of `stress`, at each of the times with these `numbers`.

    It is computed from the sum of two stresses: that of the section forces in `states`, by `factors`, and the local
    stress under the forces of `ring`.  `pressure` is the number of the pressure under pads in `ByPressure`: 0 for
    largest in the middle, 1 for even.
    """
    layers, layer = np.unique(stress.points[:, 0], return_inverse=True)
    for state in numbers:
        forces = states.at(state, np.clip(ring.x[state] + layers, *states.x[[0, -1]]))[:, layer]
        of_section = np.einsum("psc,cp->ps", factors, forces)
        yield von_mises(of_section - np.einsum("k,kps->ps", ring.forces[state], stress.unit[pressure]), PLANE)


@dataclass(frozen=True)
class YieldForce:
    """Force of a pad at which walls reach their yield stress, with the name of the section whose walls they are."""

    force: float  # N, with the pressure largest in the middle of the pad
    error: float  # N: error bar of `force` by the cells of the walls
    even: float  # N, with an even pressure; perhaps in the walls of the other section
    section: str


def yield_forces(scene: Scene) -> dict[str, YieldForce]:
    """Return the force of each pad of a joint at which the walls that it touches begin to yield, by the pad's name.

    A name is, for example, ``fly tail bottom left``.  The force is computed for both sections that the pad touches and
    for up to `PLACES` places along its way; the smallest one is returned.  Each pad acts alone: the stress of the whole
    section, which is mostly bending, is not included.  Joints are left out if one of their sections has no even walls
    (`BoomSection.has_even_walls`) or no yield stress.  Pads on the ground are left out, too.

    Raises an `InputError` as `SectionPiece` and its method `stresses` do.
    """
    least, lacking = dict[str, YieldForce](), set[int]()
    joints = dict[str, int]()
    for number, part in enumerate(scene.sections):
        material = part.body.material
        if not part.has_even_walls or material is None or material.yield_stress is None:
            lacking |= {number, number + 1}
            continue
        for largest in largest_pad_stresses(scene, number):
            middle, force = largest.stress.middle, material.yield_stress / largest.stress.middle.value
            of_pad = YieldForce(
                force,
                force * middle.error / middle.value,
                material.yield_stress / largest.stress.even.value,
                part.name,
            )
            former, joints[largest.pad] = least.get(largest.pad, of_pad), largest.joint
            even = min(former.even, of_pad.even)
            least[largest.pad] = replace(min(former, of_pad, key=lambda of_place: of_place.force), even=even)
    return {pad: least[pad] for pad in sorted(least) if joints[pad] not in lacking | {0}}


def store_stresses(scene: Scene) -> None:
    """Compute the local stresses in the walls of a scene's beams at their pads and store them for later calls.

    The stresses are those that `wall_peak` and `yield_forces` use.  Not collective.  Raises an `InputError` as
    `SectionPiece` and its method `stresses` do.
    """
    for member in members(scene):
        if traits_of(member).is_beam and member.part.has_even_walls:
            deque(largest_pad_stresses(scene, member.number), maxlen=0)


@dataclass(frozen=True)
class PadStress:
    """Largest local von Mises stress of a pad that presses alone, at one place along a section."""

    joint: int  # number of the section whose joint it is; 0: the pad is between the body and the ground
    pad: str  # its name in the whole scene, such as ``fly tail bottom left``
    stress: ByPressure  # Pa/N


def largest_pad_stresses(scene: Scene, number: int) -> Iterator[PadStress]:
    """Yield the largest stress of each pad of a scene on section `number`, at each of up to `PLACES` places.

    The places are spread evenly over the range along which the pad slides on this section.  A place that is less than
    half a pad's length from an end of the section is moved to this distance.  Places that `SectionPiece.place` maps to
    the same place on the section's piece count once.

    Raises an `InputError` as `SectionPiece` and its method `stresses` do.
    """
    part = scene.sections[number]
    for (length, width), rings in _by_size(_seated_rings(member_at(scene, number))).items():
        piece = SectionPiece(part, length, width)
        for joint, pads, positions in rings:
            x = np.clip(np.linspace(*positions, PLACES), length / 2.0, part.length - length / 2.0)
            for place in np.unique(piece.place(x)).tolist():
                for pad, estimate in zip(pads, estimates_of_pads(*piece.stresses(pads, place)), strict=True):
                    yield PadStress(joint, pad.name, estimate)
        piece.destroy()


def _seated_rings(member: Member) -> Iterator[SeatedRing]:
    """Yield the rings of pads on faces of a section: rings of its joints, and rings on the ground if it has no joint.

    Rings of joints without faces are left out.
    """
    for seat in seats(member.scene, member.number):
        if seat.ring.faces is not None:
            name = name_in_scene(member.scene.names[seat.joint], seat.key, seat.ring)
            yield SeatedRing(seat.joint, _pads_of(body_ring(seat.ring, name)), seat.positions)
    for ring in () if member.has_joint else member.part.pads:
        first, last = member.travel if ring.moving else (0.0, 0.0)
        yield SeatedRing(0, _pads_of(ring), Interval(ring.at + first, ring.at + last))


def _pads_of(ring: PadRing) -> tuple[Pad, ...]:
    """Return the pads of a ring, all of them at 0 m."""
    return tuple(Pad(name, face, 0.0, across, ring.length, ring.width) for name, face, across in ring.named_pads)
