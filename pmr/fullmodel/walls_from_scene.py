"""Walls of a beam that give way: under its pads, and at its ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pmr.errors import on_first
from pmr.fem.compat import MPI
from pmr.fullmodel.pads import Pad
from pmr.fullmodel.structure import Clamp
from pmr.fullmodel.walls import Sliding, Standing, Walls
from pmr.scene.box import Box
from pmr.scene.choice import directions
from pmr.scene.members import Member
from pmr.scene.parts import Part

ENDS = ("tail", "tip")
#: What is spread over a free end moves it along these.
AT_AN_END = ("y", "z", "rx")


def walls_of(member: Member, pads: Sequence[Pad], comm: MPI.Comm) -> Walls:
    """Walls of a box that is a beam, under the pads that it feels; collective.

    The shell that tells their compliance has the cells that a shell in its place would have.

    Raises an `InputError` if a pad leaves its face, or the box can't be drawn with these cells.
    """
    from pmr.fullmodel.wall_compliance import PlateBody, Ring, wall_compliance  # needs FEniCSx
    from pmr.models.shell import draw_box

    part = member.part
    box, mesh, body = part.body.box, part.mesh, part.body
    assert box is not None  # the scene's check
    staying, sliding = _by_their_way(member, pads)
    masses = tuple(mass for mass in part.masses if mass.coupling == "rigid")
    plates = PlateBody(
        draw_box(box, mesh.size, mesh.along or 0.0),
        box,
        body.material,
        body.shear_correction,
        tuple(Clamp(str(mass.on), mass.held) for mass in part.supports if mass.points == "all"),
        masses,
        box.plate if box.frames else 0.0,
    )
    moves = directions(member)
    ends = tuple((end, d) for end in ENDS if end in _loaded_ends(part) for d in AT_AN_END if d in moves)
    rings = tuple(Ring(tuple(sliding_pads), span) for span, sliding_pads in sliding)
    C, compliances = comm.bcast(on_first(comm, lambda: wall_compliance(plates, tuple(staying), ends, rings)))
    rho = body.material.density
    soft = np.diagonal(C) > 0.0  # an end that is stiffer than the beam's is as stiff
    soft_ends = [end for end, gives in zip(ends, soft[len(staying) :], strict=True) if gives]
    weights = [rho * _patch(pad, box) for pad in staying] + [rho * _end(box, direction) for _, direction in soft_ends]
    return Walls(
        Standing(tuple(pad.name for pad in staying), tuple(soft_ends), C[np.ix_(soft, soft)], np.array(weights)),
        tuple(
            Sliding(
                pads=tuple(pad.name for pad in sliding_pads),
                first=np.array([pad.at for pad in sliding_pads]),
                u=mass.u,
                compliance=mass.own,
                beside=mass.beside[:, :, soft],
                masses=np.array([rho * _patch(pad, box) for pad in sliding_pads]),
            )
            for (_, sliding_pads), mass in zip(sliding, compliances, strict=True)
        ),
    )


def _by_their_way(member: Member, pads: Sequence[Pad]) -> tuple[list[Pad], list[tuple[float, list[Pad]]]]:
    """Pads that stay, and those that slide together with how far; `at` where they are first along the body, m."""
    staying, sliding = list[Pad](), dict[int, tuple[float, list[Pad]]]()
    rings = {name: ring for ring in member.pads for name, _, _ in ring.places}
    for pad in pads:
        ring = rings[pad.name]
        way = member.ways.get(ring.name)
        if not ring.moving:
            staying.append(pad)
            continue
        joint, first, last = (0, *member.travel) if way is None else way
        at = replace(pad, at=first + pad.at)
        if last > first:
            sliding.setdefault(joint, (last - first, []))[1].append(at)
        else:
            staying.append(at)
    return staying, list(sliding.values())


def _patch(pad: Pad, box: Box) -> float:
    """Volume of the wall under a pad, m^3."""
    return box.thickness(pad.on) * pad.length * pad.width


def _end(box: Box, direction: str) -> float:
    """Volume of what moves with a free end, the walls of a quarter of the box's size; of a rotation times m^2."""
    arm = (box.width**2 + box.height**2) / 4.0 if direction == "rx" else 1.0
    return sum(side.thickness * side.length for side in box.sides) * max(box.width, box.height) / 4.0 * arm


def _loaded_ends(part: Part) -> set[str | float]:
    """Ends that carry something and whose points nothing rigid holds, which would keep them in shape."""
    clamped = {support.on for support in part.supports if support.points == "all"}
    held_in_shape = clamped | {mass.on for mass in part.masses if mass.coupling == "rigid"}
    return {support.on for kind in (part.masses, part.loads, part.supports) for support in kind} - held_in_shape
