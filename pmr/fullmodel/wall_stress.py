"""Largest stress in the walls of a box under a unit force of a pad, on a shell whose cells are short beside the pad.

A pad presses on its area evenly, so the stress at its edge is finite.  Cells as long as the pad miss a part of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pmr.errors import InputError, environment
from pmr.files import npz
from pmr.files.arrays import Array
from pmr.fullmodel.pads import Pad
from pmr.fullmodel.wall_compliance import MOST_PLACES, HeldModel, PlateBody, shell_of
from pmr.models.shell import draw_box
from pmr.scene.box import Box
from pmr.scene.joints import BoomSection
from pmr.scene.members import body_ring, seats
from pmr.scene.scene import Scene

#: Length of the piece of a section that is looked at, less that of the pad, over the larger of width and height.
PIECE = 2.0
#: Cells along and across a pad: on three boxes the stress is 2 to 4 % below that of cells half as long.
ALONG, ACROSS = 8, 4
#: Places along its range at which a pad that slides on a section is looked at.
PLACES = 3


def pad_stress(part: BoomSection, pads: Sequence[Pad]) -> Array:
    """Return the largest von Mises stress (k,) in Pa/N in the walls of a box under the force of each of k pads alone.

    It is computed on a piece of the section around the pad, which the piece's inertia holds against the force.  Results
    are stored in the user's cache folder.  Not collective.

    Raises an `InputError` if a pad leaves its face or the walls change along the section.
    """
    box = part.body.box
    if box is None or not has_even_walls(part):
        raise InputError("scene", "body.box", None, "walls that stay the same along the section are allowed")
    if len(sizes := {(pad.length, pad.width) for pad in pads}) != 1:
        return np.concatenate([pad_stress(part, [pad]) for pad in pads])
    ((long, wide),) = sizes
    piece = box.model_copy(update={"length": min(box.length, long + PIECE * max(box.width, box.height))})
    body = _shell_body(part, piece, long / ALONG, wide / ACROSS)
    at = np.array([min(pad.at, box.length - pad.at, piece.length / 2.0) for pad in pads])
    placed = [replace(pad, name="pad", at=float(x), stiffness=1.0) for pad, x in zip(pads, at.round(9), strict=True)]
    distinct = tuple(dict.fromkeys(placed))
    request = repr((body, distinct, environment.computing_digest()))
    stored = npz.stored_or_computed("wall-stress", request, lambda: {"stress": _largest_stress(body, distinct)})
    return np.asarray(stored["stress"][[distinct.index(pad) for pad in placed]])


def has_even_walls(part: BoomSection) -> bool:
    """Return whether a section is a box whose walls stay the same along it, without frames and regions."""
    box = part.body.box
    return box is not None and not box.varying_keys and not box.frames and not part.body.regions


def _shell_body(part: BoomSection, box: Box, along: float, size: float) -> PlateBody:
    """Return the shell of a section with another box, whose cells are `along` m long and `size` m wide."""
    return PlateBody(draw_box(box, size, along), box, part.body.material, part.body.shear_correction)


def _largest_stress(body: PlateBody, pads: Sequence[Pad]) -> Array:
    """Return the largest von Mises stress (k,) in Pa/N on the shell of a body under 1 N of each of k pads."""
    shell = shell_of(body)
    model, stress = HeldModel(shell, body), shell.stresses()
    largest = stress.von_mises(stress.evaluate(model.under_pads(pads).T)).max(axis=1)
    model.destroy()
    return np.asarray(largest)


@dataclass(frozen=True)
class JointPad:
    """Pad of a joint on a section that it touches, at one place, and the number of the section whose joint it is of."""

    joint: int
    pad: Pad


def joint_pads(scene: Scene, number: int, places: int = PLACES) -> list[JointPad]:
    """Return the pads of joints on section `number`, each at up to `places` places along its range.

    Of two pads that are mirror images of each other in the boom's vertical plane, one is returned.
    """
    pads, part = list[JointPad](), scene.sections[number]
    for seat in seats(scene, number):
        if (faces := seat.ring.faces) is None:
            continue
        ring, half = body_ring(seat.ring, seat.key.partition("[")[0]), seat.ring.length / 2.0
        x = np.unique(np.clip(np.linspace(*seat.positions, places), half, part.length - half)).tolist()
        for name, face, across in ring.named_pads:
            mirrored = face == "right" and across in faces.get("left", ())
            mirrored |= face in ("bottom", "top") and across < 0.0 and -across in faces[face]
            if not mirrored:
                pads += [JointPad(seat.joint, Pad(name, face, at, across, ring.length, ring.width)) for at in x]
    return pads


@dataclass(frozen=True)
class YieldForce:
    """Force of a joint's pad at which walls reach their yield stress, and the section and pad of which this is so."""

    force: float  # N
    section: str
    pad: str


def yield_forces(scene: Scene) -> dict[str, YieldForce]:
    """Return for each section with a joint the smallest force of a pad at which the walls it touches begin to yield.

    Each pad acts alone: bending of the whole section comes on top.  Left out are joints that touch a section without
    even walls (`has_even_walls`) or without a yield stress.

    Raises an `InputError` as `pad_stress` does.
    """
    least, lacking = dict[int, YieldForce](), set[int]()
    for number, part in enumerate(scene.sections):
        pads, material = joint_pads(scene, number), part.body.material
        if not has_even_walls(part) or material is None or material.yield_stress is None:
            lacking |= {number, number + 1}
        elif pads:
            allowed = material.yield_stress / pad_stress(part, [each.pad for each in pads])
            for each, force in zip(pads, allowed.tolist(), strict=True):
                if each.joint not in least or force < least[each.joint].force:
                    least[each.joint] = YieldForce(force, part.name, each.pad.name)
    return {scene.sections[k].name: least[k] for k in sorted(least) if k not in lacking}


def stress_growth(scene: Scene, number: int, place: Array) -> float | None:
    """Return by what factor the stress of the pad that is nearest to a place grows with cells that are short beside it.

    `place` (3,) in m is on section `number`, from its tail.  The result is None if no pad's edge comes within the
    length of a pad of the place, or if the section has no even walls (`has_even_walls`).

    Raises an `InputError` as `pad_stress` does.
    """
    part = scene.sections[number]
    box = part.body.box
    if box is None or not has_even_walls(part):
        return None
    width, height = box.width / 2.0, box.height / 2.0
    sides = {"left": width, "right": -width, "top": height, "bottom": -height}
    nearest, least = None, np.inf
    for pad in (each.pad for each in joint_pads(scene, number, MOST_PLACES)):
        if pad.on in sides and abs(pad.at - place[0]) <= pad.length:
            across, up = (sides[pad.on], pad.across) if pad.on in ("left", "right") else (pad.across, sides[pad.on])
            aside = min(abs(across - place[1]), abs(across + place[1]))  # one of two mirror images stands for both
            distance = float(np.linalg.norm([pad.at - place[0], aside, up - place[2]]))
            nearest, least = (pad, distance) if distance < least else (nearest, least)
    if nearest is None:
        return None
    body = _shell_body(part, box, part.mesh.along or part.mesh.size, part.mesh.size)
    return float(pad_stress(part, [nearest])[0] / _largest_stress(body, [nearest])[0])
