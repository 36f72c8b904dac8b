r"""Largest stress in the walls of sections at rings of pads, and forces of pads at which walls begin to yield.

Pads k push inwards with the forces :math:`f_k`, and have the local stresses :math:`\sigma_k` of
`pmr.fullmodel.wall_piece`.  With the section forces F of the whole section and the beam's law S, the stress at each
point p of the wall is

.. math:: \sigma(p) = S(p)\, F(x_p) - \sum_k f_k\, \sigma_k(p)

Left out are the shear of transverse forces, which is small in walls that bend, and rings of pads nearby.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from pmr.files.arrays import Array
from pmr.fullmodel.pads import Pad
from pmr.fullmodel.wall_piece import Estimate, RingStress, SectionPiece, estimates_of_pads
from pmr.results.field_stress import PLANE, von_mises
from pmr.scene.built import PadRing
from pmr.scene.choice import traits_of
from pmr.scene.joints import BoomSection
from pmr.scene.members import Member, body_ring, member_at, members, seats
from pmr.scene.scene import Scene
from pmr.scene.signals.base import Interval

#: Places along its range at which a ring that slides on a section is looked at.
PLACES = 3
#: Share by which yield forces of pads that are mirror images of each other may differ.
ROUND_OFF = 1e-6


@dataclass(frozen=True)
class SectionStates:
    """Section forces along a section at S times."""

    x: Array  # (X,) m: places along the section, ascending
    forces: Array  # (S, 6, X) N and N m, in the order of `FORCES`

    def at(self, state: int, x: Array) -> Array:
        """Return the section forces (6, P) at time number `state` and at the places x (P,) in m, interpolated."""
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

    stress: Estimate  # Pa
    state: int  # number of the time
    position: Array  # (3,) m on the section


def wall_peak(part: BoomSection, states: SectionStates, rings: Sequence[LoadedRing]) -> WallPeak | None:
    """Return the largest von Mises stress in the walls at the pads of a section at all times.

    The time of the peak is found with each ring at the nearest of up to `PLACES` places along its way.  The stress at
    this time is then computed with the ring at its true place.  None is returned if there are no pads.  Not collective.
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
                largest[numbers] = [_combined(factors, fine, ring, states, k).max() for k in numbers.tolist()]
            state = int(largest.argmax())
            on_meshes = piece.stresses(ring.pads, float(places[state]))
            combined = [_combined(piece.factors(stress), stress, ring, states, state) for stress in on_meshes]
            at, (coarse, fine_value) = int(combined[-1].argmax()), (float(of.max()) for of in combined)
            estimate = Estimate.from_meshes(coarse, fine_value, on_meshes[-1].margin(at))
            if best is None or estimate.value > best.stress.value:
                best = WallPeak(estimate, state, on_meshes[-1].points[at] + [ring.x[state], 0.0, 0.0])
        piece.destroy()
    return best


def _by_size(rings: Iterable[AnyRing]) -> dict[tuple[float, float], list[AnyRing]]:
    """Return the rings by the length and the width in m of their pads."""
    by_size = dict[tuple[float, float], list[AnyRing]]()
    for ring in rings:
        by_size.setdefault((ring.pads[0].length, ring.pads[0].width), []).append(ring)
    return by_size


def _combined(factors: Array, stress: RingStress, ring: LoadedRing, states: SectionStates, state: int) -> Array:
    """Return the von Mises stress (P,) in Pa at the points of `stress` at the time with the number `state`.

    The stress is that of the section forces in `states`, with the `factors` of the section's piece, and the local
    stress of the pads of `ring`.
    """
    layers, layer = np.unique(stress.points[:, 0], return_inverse=True)
    forces = states.at(state, np.clip(ring.x[state] + layers, *states.x[[0, -1]]))[:, layer]
    of_section = np.einsum("psc,cp->ps", factors, forces)
    return von_mises(of_section - np.einsum("k,kps->ps", ring.forces[state], stress.unit), PLANE)


@dataclass(frozen=True)
class YieldForce:
    """Force of a joint's pad at which walls reach their yield stress, with the names of the section and the pad."""

    force: float  # N
    section: str
    pad: str
    error: float  # N: error bar of `force` by the cells of the walls


def yield_forces(scene: Scene) -> dict[str, YieldForce]:
    """Return the smallest force of a pad at which the walls that it touches begin to yield, by section with a joint.

    Each pad acts alone: the stress of the whole section, of which bending is the largest part, comes on top.  Left out
    are joints that touch a section without even walls (`BoomSection.has_even_walls`) or without a yield stress.

    Raises an `InputError` as `SectionPiece` and its method `stresses` do.
    """
    least, lacking = dict[int, YieldForce](), set[int]()
    for number, part in enumerate(scene.sections):
        material = part.body.material
        if not part.has_even_walls or material is None or material.yield_stress is None:
            lacking |= {number, number + 1}
            continue
        for largest in largest_pad_stresses(scene, number):
            allowed = material.yield_stress / largest.stress.value
            if largest.joint not in least or allowed < (1.0 - ROUND_OFF) * least[largest.joint].force:
                error = allowed * largest.stress.error / largest.stress.value
                least[largest.joint] = YieldForce(allowed, part.name, largest.pad, error)
    return {scene.sections[k].name: least[k] for k in sorted(least) if k not in lacking}


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
    """Largest local von Mises stress in Pa/N of a pad, at one place along a section."""

    joint: int  # number of the section whose joint it is; 0: the pad is between the body and the ground
    pad: str
    stress: Estimate


def largest_pad_stresses(scene: Scene, number: int) -> Iterator[PadStress]:
    """Yield the stress of each pad on section `number`, at up to `PLACES` places along its range.

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
    """Yield the rings of pads on a section: of joints if the section has one, else those on the ground."""
    for seat in seats(member.scene, member.number):
        if seat.ring.faces is not None:
            yield SeatedRing(seat.joint, _pads_of(body_ring(seat.ring, seat.key.partition("[")[0])), seat.positions)
    for ring in () if member.has_joint else member.part.pads:
        first, last = member.travel if ring.moving else (0.0, 0.0)
        yield SeatedRing(0, _pads_of(ring), Interval(ring.at + first, ring.at + last))


def _pads_of(ring: PadRing) -> tuple[Pad, ...]:
    """Return the pads of a ring, all of them at 0 m."""
    return tuple(Pad(name, face, 0.0, across, ring.length, ring.width) for name, face, across in ring.named_pads)
