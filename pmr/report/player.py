r"""Draw bodies in space: as pictures, face by face from the farthest to the nearest, and as data for animations.

The values X (frames, n) of a motion, those of one frame in each row, are factorised approximately:

.. math:: X \approx A\,(A^T X)

The columns of A (frames, k) are the leading eigenvectors of X X^T.  The page gets A and the k shapes A^T X (k, n),
which are a fraction of the size of X, and computes each picture as a sum of shapes.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize, to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from pmr.files.arrays import Array
from pmr.report.moving_bodies import Block, MovingBodies, Surface
from pmr.report.numbers import format_input, format_percent, round_number
from pmr.report.subject import is_alone, reach

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
    low = np.min([s.min(axis=0) for s in projected], axis=0) - margin
    high = np.max([s.max(axis=0) for s in projected], axis=0) + margin
    metre = width / float(high[0] - low[0])  # px per m
    framed_shots = []
    for shot, points in zip(shots, projected, strict=True):
        bottom, height = float(points[:, 1].min()) - margin, float(np.ptp(points[:, 1])) + 2.0 * margin
        centre = np.array([(low[0] + high[0]) / 2.0, bottom + height / 2.0, 0.0]) @ axes
        framed_shots.append(replace(shot, centre=centre, height=height, size=(width, max(round(metre * height), 1))))
    return framed_shots


def render_shot(shot: Shot) -> bytes:
    """Draw a shot and return it as PNG of `COLOURS` colours."""
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

    `view` (3, 3) is the view of the shot, and `light` (3,) is the unit vector to the light in the picture's axes.
    `limits` is the range of values that the colours span.  Light falls on both sides of a face.
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


PLAYING = 30.0  # s in which the whole motion plays at the first speed
_FULL_SCALE = 32767
EXACT = 1e-4  # size of a shape, as a share of the size of the largest one, below which the shape is left out
MOST_SHAPES = 32
MOST_FACES = 60_000  # bodies with more faces have pictures but no animation, so that a page stays below 5 MB
MOST_VALUES = 400_000  # most values in all shapes of a quantity: two bytes each, and a third more in base64


def body_motion(bodies: MovingBodies) -> dict[str, Any]:
    """Data of the animation of bodies, ready for JSON.

    The result is empty if there is nothing to animate: without bodies, for a single time, and for more than
    `MOST_FACES` faces.  The keys are:

    - ``frames``, ``times`` and ``moments``: the number of stored times, the first and the last one, and all of them in
      s.
    - ``first`` and ``speeds``: the frame that is shown first, that of the peak, and the speeds of playback.
    - ``alone``, ``length``, ``back`` and ``path``: whether a body alone is drawn; its length (or the reach) and the
      least x that is seen, in m; and the way of its mouth.
    - ``scale``, ``ramp`` and ``lost``: the factor of displacements, the colours, and the largest share that the shapes
      of a motion leave out.
    - ``bodies``, and the blocks ``section``, ``near`` and ``tail`` around a body alone.
    - ``pose``: the motion of the frame, which moves all bodies; None if the scene has no frame.

    Each body has its P points in m, its triangles, and its shift along x in m.  Its displacement in m is the product of
    k coefficients (frames, k) and k shapes (k, 3 P).  The stress of its S faces, divided by the stress of the last
    colour, is a product of other coefficients (frames, k) and shapes (k, S).  Triangles j and S + j are the two halves
    of quadrilateral j.
    """
    surfaces, result = bodies.surfaces, bodies.result
    if not surfaces or len(bodies.t) < 2 or sum(len(surface.faces) for surface in surfaces.values()) > MOST_FACES:
        return {}
    t, around = bodies.t, bodies.surroundings
    shown = [_body_data(bodies, name, surface, MOST_VALUES // len(surfaces)) for name, surface in surfaces.items()]
    back = min([0.0, *(float(block.corners[:, 0].min()) for block in around.section)])
    if is_alone(result) and not around.section:
        back = float(next(iter(surfaces.values())).points[:, 0].min() - bodies.mouth.max())
    return {
        "frames": len(t),
        "times": [float(t[0]), float(t[-1])],
        "moments": t.round(6).tolist(),
        "speeds": playback_speeds(float(t[-1] - t[0])),
        "first": bodies.moment_of_peak().frame,
        "length": reach(result),
        "alone": is_alone(result),
        "path": encode_array(bodies.mouth),
        "scale": bodies.scale,
        "bodies": shown,
        "back": back,
        "ramp": RAMP,
        **{name: [_block_data(block) for block in blocks] for name, blocks in vars(around).items()},
        "lost": max(body["motion"]["lost"] for body in shown),
        "pose": _frame_motion(bodies),
    }


def _frame_motion(bodies: MovingBodies) -> dict[str, Any] | None:
    """Motion of a frame for the player; None if the scene has no frame.

    For each frame of the animation it has a rotation (9,), an origin (3,) in m, and the angles of luffing and slewing
    in degrees.  It also has the centre (3,) and the size in m of what is seen.
    """
    frame, pose = bodies.result.frame, bodies.result.pose(bodies.t)
    if frame is None or pose is None:
        return None
    ends = [
        pose.positions(
            np.array([surface.points.min(axis=0), surface.points.max(axis=0)])
            + np.multiply.outer(bodies.shifts[name], [[1.0, 0.0, 0.0]])
        )
        for name, surface in bodies.surfaces.items()
    ]
    every = np.concatenate([np.zeros((1, 3)), *(places.reshape(-1, 3) for places in ends)])
    low, high = every.min(axis=0), every.max(axis=0)
    return {
        "rotation": encode_array(pose.rotation.ravel()),
        "origin": encode_array(pose.origin.ravel()),
        "centre": ((low + high) / 2.0).tolist(),
        "size": float(np.linalg.norm(high - low)),
        "angles": [encode_array(np.rad2deg(angle.value(bodies.t))) for angle in frame.angles],
    }


def _body_data(bodies: MovingBodies, name: str, surface: Surface, most_values: int) -> dict[str, Any]:
    """Data of the body `name` for the player.

    The keys are ``points``, ``triangles``, ``edges`` and ``faces`` of the surface, its ``along`` shifts, and the shapes
    of its ``motion`` and ``stress`` with the share that they leave out; ``stress`` is None without stresses.
    `most_values` limits the number of values in all shapes of a quantity.
    """
    fields, stress = bodies.fields[name], None
    motion = compress(surface.point_displacements(fields, fields.displacement).reshape(len(fields.t), -1), most_values)
    if name in bodies.cell_stresses:
        stress = compress(bodies.cell_stresses[name][:, surface.cell] / bodies.colour_limit, most_values)
    return {
        "points": encode_array(surface.points.ravel()),
        "triangles": _encode_indices(surface.triangles),
        "edges": _encode_indices(surface.edges),
        "faces": len(surface.faces),
        "along": encode_array(bodies.shifts[name]),
        "motion": motion,
        "stress": stress,
    }


def drawing_sentence(data: dict[str, Any]) -> str:
    """Sentence on how the motion of bodies is drawn; empty if `data` is empty, as then there is no animation."""
    if not data:
        return ""
    drawn = f"Displacements are drawn {format_input(data['scale'])} times their size"
    return f"{drawn}, with an error of {format_percent(data['lost'], 1)} of the motion."


def compress(frames: NDArray[np.float32], most_values: int) -> dict[str, Any]:
    """Factorise frames (F, n) into coefficients (F, k) and shapes (k, n), and encode both for a page.

    The entries are the ``count`` k, the k columns of ``coefficients``, the k rows of ``shapes``, and the error
    ``lost``: the RMS difference between the product and the frames, divided by the RMS value of the frames.  There is
    at least one shape, and at most `MOST_SHAPES`; shapes below the share `EXACT` of the largest one are left out.  The
    number k n of values in the shapes is at most `most_values`, unless one shape has more.
    """
    X = frames.astype(float)
    squares, vectors = np.linalg.eigh(X @ X.T)
    squares, vectors = np.maximum(squares[::-1], 0.0), vectors[:, ::-1]
    most = max(1, min(MOST_SHAPES, most_values // X.shape[1]))
    count = max(1, int(np.count_nonzero(squares[:most] > EXACT**2 * squares[0])))
    A = vectors[:, :count]
    A = A * np.sign(A[np.abs(A).argmax(axis=0), np.arange(count)])  # the sign of an eigenvector is arbitrary
    shapes = A.T @ X
    lost = float(np.sqrt(squares[count:].sum() / squares.sum())) if squares[0] > 0.0 else 0.0
    each = [encode_array(shape) for shape in shapes]
    return {"count": count, "coefficients": [encode_array(column) for column in A.T], "shapes": each, "lost": lost}


def _encode_indices(values: NDArray[np.int64]) -> str:
    """Encode the indices `values` (any shape) as little-endian 32-bit integers in base64."""
    return base64.b64encode(np.ascontiguousarray(values, "<u4").tobytes()).decode()


def _block_data(block: Block) -> dict[str, Any]:
    """Data of a cuboid for the player: its ``corners`` in m as a list of coordinates, and its ``sides``."""
    return {"corners": block.corners.round(4).ravel().tolist(), "sides": block.sides.tolist()}


def encode_array(values: Array) -> dict[str, Any]:
    """Encode `values`, an array of any shape, for a page as whole numbers, rounded to 1/32767 of the largest value.

    In the result ``data`` are these numbers as little-endian 16-bit integers in base64, one row after the other, and
    ``count`` is the value that the number 1 stands for.  The shape is not stored.
    """
    largest = float(np.abs(values).max(initial=0.0)) or 1.0
    counts = np.round(values / largest * _FULL_SCALE).astype("<i2")
    return {"count": largest / _FULL_SCALE, "data": base64.b64encode(counts.tobytes()).decode()}


def playback_speeds(duration: float) -> dict[str, Any]:
    """Playback speeds of a motion of `duration` s, as multiples of real time.

    ``first`` is the largest round speed at which the motion plays for at least `PLAYING` s.  ``choices`` are 0.2, 0.5,
    1, 2 and 4 times this speed, and real time, in ascending order.
    """
    first = round_number(max(duration / PLAYING, 1e-6))
    choices = {float(f"{choice * first:.3g}") for choice in (0.2, 0.5, 1.0, 2.0, 4.0)}
    return {"first": first, "choices": sorted({*choices, 1.0})}
