"""Walls of a beam that give way: under each ring of pads, and at its ends."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from pmr.errors import on_first
from pmr.fem.compat import MPI
from pmr.fullmodel.pads import Pad
from pmr.fullmodel.walls import EndWall, RingWall, Walls
from pmr.scene.built import Box
from pmr.scene.choice import directions
from pmr.scene.members import Member
from pmr.scene.parts import Part
from pmr.scene.structures import BoxProfile

ENDS = ("tail", "tip")


def walls_of(member: Member, profile: BoxProfile, pads: Sequence[Pad], comm: MPI.Comm) -> Walls:
    """Those of a box that is a beam, under the pads that it feels; collective.

    The shell that tells their compliance has the cells that a shell in its place would have.
    """
    from pmr.fullmodel.wall_compliance import AT_AN_END, Plates, WallCompliance, wall_compliance  # needs FEniCSx

    part = member.part
    box, mesh, body = part.body.box, part.mesh, part.body
    assert box is not None  # the scene's check
    along = box.length / max(1, round(box.length / (mesh.along or mesh.size)))
    plates = Plates(profile, body.material, body.shear_correction, mesh.size, along)
    names = [{name for name, _, _ in ring.places} for ring in member.pads]
    felt = [own for ring in names if (own := [pad for pad in pads if pad.name in ring])]
    bare = tuple(tuple(replace(pad, name="", at=0.0) for pad in ring) for ring in felt)
    found: WallCompliance = comm.bcast(on_first(comm, lambda: wall_compliance(plates, bare)))
    kept, sheet = _kept(part), body.material.density * box.wall
    rings = [
        RingWall(
            pads=tuple(pad.name for pad in ring),
            length=box.length,
            free=("tail" not in kept, "tip" not in kept),
            places=found.places,
            compliance=C,
            mass=sheet * ring[0].length * ring[0].width,
        )
        for ring, C in zip(felt, found.rings, strict=True)
    ]
    known, give = directions(member), dict(zip(AT_AN_END, found.end, strict=True))
    give = {direction: float(c) for direction, c in give.items() if direction in known and c > 0.0}
    return Walls(tuple(rings), tuple(_ends(part, box, sheet, give)))


def _ends(part: Part, box: Box, sheet: float, compliance: dict[str, float]) -> Iterator[EndWall]:
    """Of the free ends that carry something; what moves with them are the walls of a quarter of the box's size."""
    carry = {one.on for kind in (part.masses, part.loads, part.supports) for one in kind} - _kept(part)
    mass = sheet * 2.0 * (box.width + box.height) * max(box.width, box.height) / 4.0
    for end in ENDS:
        for direction, c in compliance.items() if end in carry else ():
            arm = (box.width**2 + box.height**2) / 4.0 if direction == "rx" else 1.0
            yield EndWall(end, direction, 1.0 / c, mass * arm)


def _kept(part: Part) -> set[str | float]:
    """Ends whose every point something rigid holds: they stay in shape."""
    clamped = {one.on for one in part.supports if one.points == "all"}
    return clamped | {mass.on for mass in part.masses if mass.coupling == "rigid"}
