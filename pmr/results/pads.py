"""Pads as boxes, in axes fixed to the section that a body slides in.

The mouth of this section stays at x = 0, and the body moves by -s, where s is the path coordinate in m.
"""

from __future__ import annotations

import numpy as np

from pmr.files.arrays import Array
from pmr.results.field_series import Boxes, Fields
from pmr.results.run import RunResult
from pmr.results.tables import FORCE_OF
from pmr.scene.box import Box
from pmr.scene.built import Face, PadRing
from pmr.scene.keys import ALONE

THICK = 0.025  # m, thickness of a pad in drawings: the gap between both sections
#: Corners of the unit cube in VTK's order of a hexahedron.
CUBE = np.array([(x, y, z) for z in (0.0, 1.0) for x, y in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))])


def pad_corners(ring: PadRing, place: tuple[str, Face, float], body: Array, box: Box | None, cube: Array) -> Array:
    """Return the k corners (k, 3) in m of a pad of `ring` at s = 0: a plate on a face of a body.

    `cube` (k, 3) are the corners of a unit cube, which is moved and scaled to become the pad.  `place` has the pad's
    name, its face and its position in m across the face.  `body` (2, 3) are the least and the largest coordinates of
    the body in m.  The faces bottom and top are normal to z, right and left are normal to y; all other faces are
    slanted faces of `box`, which is None for a body without such faces.
    """
    _, face, across = place
    size, local = np.array([ring.length, ring.width, THICK]), cube - [0.5, 0.5, 0.0]
    if box is not None and " " in face:  # the face is slanted
        side = box.faces[face]
        along, out = ([0.0, *pair] for pair in (side.across_direction, side.normal))
        reach = float(side.normal @ side.start) + side.thickness / 2.0
        centre = np.array([ring.at, *(across * side.across_direction + reach * side.normal)])
    else:
        normal, tangent = (2, 1) if face in ("bottom", "top") else (1, 2)
        outwards = -1.0 if face in ("bottom", "right") else 1.0
        along, out = np.eye(3)[tangent], outwards * np.eye(3)[normal]
        centre = body.mean(axis=0) + across * along
        centre[0], centre[normal] = ring.at, (body[0] if outwards < 0.0 else body[1])[normal]
    return np.asarray(centre + (local * size) @ np.array([[1.0, 0.0, 0.0], along, out]))


def pads_over_time(result: RunResult) -> Boxes | None:
    """Return all pads of a body alone at the times of its recovered fields, with their forces in N.

    A force is NaN if it is not known.  If the scene has a moving frame, the corners are positions in space.  None is
    returned for a body without pads or fields, and for a boom of sections.
    """
    if ALONE not in (travelling := result.moving_fields):
        return None
    scene, (fields, along) = result.scene.bodies[ALONE], travelling[ALONE]
    places = [(ring, *place) for ring in scene.pads for place in ring.named_pads]
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
        corners = pose.positions(corners.reshape(len(t), -1, 3)).reshape(corners.shape)
    return Boxes(tuple(name for _, name, _, _ in places), corners, {"force": force})


def _extent(fields: Fields, box: Box | None) -> Array:
    """Return the least and the largest coordinates (2, 3) in m of an undeformed body.

    A beam has the width and height of its `box`; if that is None, it is a line.
    """
    extent = np.array([fields.points.min(axis=0), fields.points.max(axis=0)])
    if fields.kind == "line" and box is not None:
        outside = np.array([corner.position for corner in box.corners])
        extent += [[0.0, *outside.min(axis=0)], [0.0, *outside.max(axis=0)]]
    return extent
