"""Pads as boxes in the frame of the section that a body slides in: its mouth stays at x = 0, the body moves by -s."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.fields.series import Boxes, Fields
from pmr.results.run import RunResult
from pmr.results.tables import FORCE_OF
from pmr.scene.box import Box
from pmr.scene.built import Face, PadRing
from pmr.scene.keys import ALONE

Array = NDArray[np.float64]

THICK = 0.025  # of a pad as drawn, m: the gap between both sections
#: Corners of the unit cube in VTK's order of a hexahedron.
CUBE = np.array([(x, y, z) for z in (0.0, 1.0) for x, y in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))])


def pad_corners(ring: PadRing, place: tuple[str, Face, float], body: Array, box: Box | None, cube: Array) -> Array:
    """Corners of a unit cube (k, 3) that becomes a pad at s = 0, (k, 3) m: a plate on a face of a body.

    Faces are bottom and top (z), right and left (y) of a body that reaches from least to largest coordinates `body`
    (2, 3) m, or slanted ones of its `box`.
    """
    _, face, across = place
    size, local = np.array([ring.length, ring.width, THICK]), cube - [0.5, 0.5, 0.0]
    if box is not None and " " in face:  # it is slanted
        side = box.faces[face]
        along, out = ([0.0, *pair] for pair in (side.across, side.normal))
        reach = float(side.normal @ side.start) + side.thickness / 2.0
        centre = np.array([ring.at, *(across * side.across + reach * side.normal)])
    else:
        normal, tangent = (2, 1) if face in ("bottom", "top") else (1, 2)
        outwards = -1.0 if face in ("bottom", "right") else 1.0
        along, out = np.eye(3)[tangent], outwards * np.eye(3)[normal]
        centre = body.mean(axis=0) + across * along
        centre[0], centre[normal] = ring.at, (body[0] if outwards < 0.0 else body[1])[normal]
    return np.asarray(centre + (local * size) @ np.array([[1.0, 0.0, 0.0], along, out]))


def pads_over_time(result: RunResult) -> Boxes | None:
    """All pads of a body alone at the times of its recovered fields, with their forces in N, NaN if unknown.

    In a frame that moves they are where they are in space.
    None without pads, and of a boom of sections.
    """
    if ALONE not in (travelling := result.travelling):
        return None
    scene, (fields, along) = result.scene.bodies[ALONE], travelling[ALONE]
    places = [(ring, *place) for ring in scene.pads for place in ring.places]
    if not places:
        return None
    t, response, body = fields.t, result.responses["reduced"], _extent(fields, scene.body.box)
    corners = np.empty((len(t), len(places), 8, 3))
    force = np.full((len(t), len(places)), np.nan)
    for k, (ring, name, face, across) in enumerate(places):
        corners[:, k] = pad_corners(ring, (name, face, across), body, scene.body.box, CUBE)
        if not ring.moving:
            corners[:, k, :, 0] += along[:, None]
        if FORCE_OF + name in response.force_names:
            force[:, k] = np.interp(t, response.t, response.force(FORCE_OF + name, 0))
    if (pose := result.pose(t)) is not None:
        corners = pose.places(corners.reshape(len(t), -1, 3)).reshape(corners.shape)
    return Boxes(tuple(name for _, name, _, _ in places), corners, {"force": force})


def _extent(fields: Fields, box: Box | None) -> Array:
    """Extent of the body at rest, (2, 3) m: that of a beam is its box's."""
    extent = np.array([fields.points.min(axis=0), fields.points.max(axis=0)])
    if fields.kind == "line" and box is not None:
        outside = np.array([corner.at for corner in box.corners])
        extent += [[0.0, *outside.min(axis=0)], [0.0, *outside.max(axis=0)]]
    return extent
