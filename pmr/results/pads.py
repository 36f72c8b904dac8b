"""Pads as boxes in the frame of the section that a body slides in: its mouth stays at x = 0, the body moves by -s."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.fields.series import Boxes, Fields
from pmr.results.run import RunResult
from pmr.results.tables import FORCE_OF
from pmr.scene.built import Box, Face, PadRing
from pmr.scene.names import ALONE

Array = NDArray[np.float64]

THICK = 0.025  # of a pad as drawn, m: the gap between both sections
#: Corners of the unit cube in VTK's order of a hexahedron.
CUBE = np.array([(x, y, z) for z in (0.0, 1.0) for x, y in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))])


def pad_extent(ring: PadRing, face: Face, across: float, body: Array) -> Array:
    """Least and largest coordinates (2, 3) in m of a pad at s = 0, a plate on a face of a body that reaches so far.

    Faces are bottom and top (z), right and left (y).
    """
    low, high = body
    normal, along = (2, 1) if face in ("bottom", "top") else (1, 2)
    middle, size = (low + high) / 2.0, np.zeros(3)
    outwards = -1.0 if face in ("bottom", "right") else 1.0
    middle[0], middle[along] = ring.at, middle[along] + across
    middle[normal] = (low if outwards < 0.0 else high)[normal] + outwards * THICK / 2.0
    size[0], size[along], size[normal] = ring.length, ring.width, THICK
    return np.array([middle - size / 2.0, middle + size / 2.0])


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
        start, end = pad_extent(ring, face, across, body)
        corners[:, k] = start + CUBE * (end - start)
        if not ring.moving:
            corners[:, k, :, 0] += along[:, None]
        if FORCE_OF + name in response.force_names:
            force[:, k] = np.interp(t, response.t, response.force(FORCE_OF + name, 0))
    if (pose := result.pose(t)) is not None:
        corners = pose.places(corners.reshape(len(t), -1, 3)).reshape(corners.shape)
    return Boxes(tuple(name for _, name, _, _ in places), corners, {"force": force})


def _extent(fields: Fields, box: Box | None) -> Array:
    """Of the body at rest, (2, 3) m: that of a beam is its box's."""
    found = np.array([fields.points.min(axis=0), fields.points.max(axis=0)])
    if fields.kind == "line" and box is not None:
        half = np.array([0.0, box.width + box.wall, box.height + box.wall]) / 2.0
        found += np.array([-half, half])
    return found
