"""Draw surfaces in space as pictures, face by face from the farthest to the nearest."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize, to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from pmr.files.arrays import Array

Vector = Array | tuple[float, float, float]

EDGE = "#1c2733"
RAMP = ("#e3ebf0", "#a9cbdf", "#edb84c", "#d55e00", "#7a1b0c")  # from no stress to the largest
COLOURS = 128  # number of colours of a picture; few colours keep files small
#: Shares of ambient and diffuse light.  Most light is ambient, as colours are compared with a colour scale; diffuse
#: light shows walls of different directions in different brightness.
AMBIENT, DIFFUSE = 0.68, 0.34
DOTS = 128.0  # px per inch; a power of two, so that a size in px is the same again after division
EDGE_OPACITY = 0.35


@dataclass(frozen=True)
class Piece:
    """Surface in a picture, with P points and S faces.

    Attributes
    ----------
    points : (P, 3) array, m
    faces : (S, 3 or 4) integer array
        Indices of points.
    values : (S,) array or None
        Values that colour the faces; None if all have the same `colour`.
    layer : float or (S,) array
        Faces of a lower layer are drawn before those of a higher one, and those of one layer from the farthest to the
        nearest.
    """

    points: Array
    faces: NDArray[np.int64]
    values: Array | None = None
    colour: str = "#c3ccd4"
    opacity: float = 1.0
    edges: float = 0.0  # width of the faces' edges, px
    layer: Array | float = 0.0

    def faces_towards(self, direction: Vector) -> NDArray[np.bool_]:
        """Mask (S,): faces whose outside can be seen from `direction`; seen from outside, corners run anticlockwise."""
        return self.normals @ np.asarray(direction) > 0.0

    @property
    def normals(self) -> Array:
        """Unit vectors (S, 3) at right angles to the faces, outwards."""
        first, second, third = (self.points[self.faces[:, k]] for k in range(3))
        across = np.cross(second - first, third - first)
        return np.asarray(across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30))


@dataclass(frozen=True)
class Shot:
    """Picture to be rendered: pieces, camera, size in px, and the range of values `limits` that colours span.

    The colours are those of `RAMP`.  The camera looks from `direction` at the point `centre`, without perspective, and
    sees `height` m from bottom to top.  `up` is the direction that points upwards in the picture.
    """

    pieces: tuple[Piece, ...]
    direction: Vector
    limits: tuple[float, float] = (0.0, 1.0)
    centre: Vector = (0.0, 0.0, 0.0)
    height: float = 1.0
    size: tuple[int, int] = (400, 300)
    up: Vector = (0.0, 0.0, 1.0)

    @property
    def view(self) -> Array:
        """Directions (3, 3) to the right and upwards in the picture, and from the picture to the camera, as rows."""
        towards = np.array(self.direction) / np.linalg.norm(self.direction)
        right = np.cross(self.up, towards)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(towards, right), towards])


def frame_shots(shots: Sequence[Shot], width: int, margin: float = 0.12) -> list[Shot]:
    """Return the shots with centre, height and size set so that all pictures have one scale.

    All shots are seen in the direction of the first one.  Each picture is `width` px wide, enough for the widest shot,
    and as high as its own shot needs.  Width and height include `margin` on each side, in m.
    """
    axes = shots[0].view
    projected = [np.concatenate([piece.points for piece in shot.pieces]) @ axes.T for shot in shots]
    low, high = (
        np.min([s.min(axis=0) for s in projected], axis=0) - margin,
        np.max([s.max(axis=0) for s in projected], axis=0) + margin,
    )
    metre = width / float(high[0] - low[0])  # px per m
    framed_shots = []
    for shot, points in zip(shots, projected, strict=True):
        bottom, height = float(points[:, 1].min()) - margin, float(np.ptp(points[:, 1])) + 2.0 * margin
        centre = np.array([(low[0] + high[0]) / 2.0, bottom + height / 2.0, 0.0]) @ axes
        framed_shots.append(replace(shot, centre=centre, height=height, size=(width, max(round(metre * height), 1))))
    return framed_shots


def render_shot(shot: Shot) -> bytes:
    """Draw a shot and return it as PNG."""
    view, pieces, light = shot.view, shot.pieces, np.array([-0.5, 0.7, 1.0])
    if np.dot(shot.direction, shot.up) < 0.0:
        light[1] *= -1.0  # if the camera is below the body, the light is below too
    corners = [piece.points[np.pad(piece.faces, ((0, 0), (0, 4 - piece.faces.shape[1])), "edge")] for piece in pieces]
    polygons = np.concatenate(corners) @ view.T  # the last corner of a triangle twice
    layers = np.concatenate([np.broadcast_to(piece.layer, len(piece.faces)) for piece in pieces])
    order = np.lexsort((polygons[:, :, 2].mean(axis=1), layers))
    looks = [_face_looks(piece, view, light / np.linalg.norm(light), shot.limits) for piece in pieces]
    faces, edges, widths = (np.concatenate(of)[order] for of in zip(*looks, strict=True))
    (wide, tall), (x, y, _) = shot.size, view @ np.array(shot.centre)
    figure, half = Figure((wide / DOTS, tall / DOTS), DOTS, facecolor="white"), shot.height / 2.0
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set_axis_off()
    ax.set(xlim=(x - half * wide / tall, x + half * wide / tall), ylim=(y - half, y + half))
    look = {"facecolors": faces, "edgecolors": edges, "linewidths": widths, "joinstyle": "round"}
    ax.add_collection(PolyCollection(polygons[order, :, :2], **look), autolim=False)
    canvas, file = FigureCanvasAgg(figure), io.BytesIO()
    canvas.draw()
    Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB").quantize(COLOURS).save(file, "PNG", optimize=True)
    return file.getvalue()


class Looks(NamedTuple):
    """Colours (S, 4) of faces and of their edges, and widths (S,) of the edges in points."""

    faces: Array
    edges: Array
    widths: Array


def _face_looks(piece: Piece, view: Array, light: Array, limits: tuple[float, float]) -> Looks:
    """Return colours and edges of a piece's faces.

    `view` is that of the shot, `light` the direction to the light in the picture's axes, and `limits` is the range of
    values that the colours span.  Light falls on both sides of a face.
    """
    normals = piece.normals @ view.T
    bright = AMBIENT + DIFFUSE * np.maximum(np.where(normals[:, 2:] < 0.0, -normals, normals) @ light, 0.0)
    colours = np.tile(to_rgb(piece.colour), (len(bright), 1))
    if piece.values is not None:
        colours = LinearSegmentedColormap.from_list("stress", RAMP)(Normalize(*limits)(piece.values))[:, :3]
    faces = np.hstack([np.clip(colours * bright[:, None], 0.0, 1.0), np.full((len(bright), 1), piece.opacity)])
    edges = faces.copy()  # they close the gaps between faces
    if piece.edges:
        edges[:, :3] += EDGE_OPACITY * (np.array(to_rgb(EDGE)) - edges[:, :3])
    elif piece.opacity < 1.0:
        edges[:, 3] = 0.0
    return Looks(faces, edges, np.full(len(bright), (piece.edges or 0.5) * 72.0 / DOTS))
