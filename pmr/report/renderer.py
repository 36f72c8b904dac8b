"""Render pictures with pyvista, off-screen, in a process of their own.

A graphics driver that is missing or broken may end the process that uses it.  A run must survive that, so a failure of
the rendering process only becomes a sentence in the report, and VTK is imported in that process alone.
"""

from __future__ import annotations

import io
import pickle
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.files.arrays import Array

Vector = tuple[float, float, float]

LONGEST = 600.0  # s, longest time that all pictures of a run may take together
EDGE = "#1c2733"
RAMP = ("#e3ebf0", "#a9cbdf", "#edb84c", "#d55e00", "#7a1b0c")  # from no stress to the largest
FINER = 2  # pictures are rendered this many times as large and scaled down: smooth edges with any driver
COLOURS = 128  # number of colours of a picture; few colours keep files small
#: Shares of ambient and diffuse light.  Most light is ambient, as colours are compared with a colour scale; diffuse
#: light shows walls of different directions in different brightness.
AMBIENT, DIFFUSE = 0.68, 0.34


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
    """

    points: Array
    faces: NDArray[np.int64]
    values: Array | None = None
    colour: str = "#c3ccd4"
    opacity: float = 1.0
    edges: float = 0.0  # width of the faces' edges, px


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


def frame_shots(shots: Sequence[Shot], width: int, margin: float = 0.12) -> list[Shot]:
    """Return shots with centre, height and size set for one common scale.

    All are seen in the direction of the first shot.  Each picture is `width` px wide and shows the width that the
    largest shot needs.  Its height is the height that its own shot needs.  Both include `margin` m on each side.
    """
    towards = np.array(shots[0].direction) / np.linalg.norm(shots[0].direction)
    right = np.cross((0.0, 0.0, 1.0), towards)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(towards, right), towards])
    projected = [np.concatenate([piece.points for piece in shot.pieces]) @ axes.T for shot in shots]
    low, high = (
        np.min([s.min(axis=0) for s in projected], axis=0) - margin,
        np.max([s.max(axis=0) for s in projected], axis=0) + margin,
    )
    metre = width / float(high[0] - low[0])  # px per m
    framed_shots = []
    for shot, points in zip(shots, projected, strict=True):
        bottom, height = float(points[:, 1].min()) - margin, float(np.ptp(points[:, 1])) + 2.0 * margin
        x, y, z = (float(c) for c in np.array([(low[0] + high[0]) / 2.0, bottom + height / 2.0, 0.0]) @ axes)
        framed_shots.append(replace(shot, centre=(x, y, z), height=height, size=(width, max(round(metre * height), 1))))
    return framed_shots


class NoPictureError(Exception):
    """Pictures can't be rendered; the message gives the reason in a clause."""


def render_shots(shots: Sequence[Shot]) -> list[bytes]:
    """Render shots in another process and return each picture as PNG; blocks until all pictures are rendered.

    Raises
    ------
    NoPictureError
        If pyvista is not installed, can't render, or takes longer than `LONGEST`.
    """
    if find_spec("pyvista") is None:
        raise NoPictureError("pyvista is not installed: pip install pyvista pillow installs it")
    command = [sys.executable, "-m", "pmr.report.renderer"]
    try:
        done = subprocess.run(command, input=pickle.dumps(list(shots)), capture_output=True, timeout=LONGEST)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NoPictureError(f"{type(error).__name__} while pictures were made") from None
    if done.returncode != 0:
        last = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise NoPictureError(last if done.returncode == 1 and last else "the graphics library ended unexpectedly")
    pictures: list[bytes] = pickle.loads(done.stdout)
    return pictures


def render_shot(shot: Shot) -> bytes:
    """Render a shot as PNG; imports VTK, so it should be called only in a process of its own."""
    import pyvista
    from PIL import Image

    plotter = pyvista.Plotter(off_screen=True, window_size=[FINER * pixels for pixels in shot.size], lighting="none")
    plotter.disable_anti_aliasing()  # scaled down pictures are smooth; anti-aliasing would double the time in software
    plotter.set_background("white")
    below = float(np.dot(shot.direction, shot.up)) < 0.0
    side = -0.7 if below else 0.7  # if the camera is below the body, the light is below too
    plotter.add_light(pyvista.Light(light_type="camera light", position=(-0.5, side, 1.0)))
    for piece in shot.pieces:
        _add_piece(plotter, piece, shot.limits)
    camera = plotter.camera
    camera.focal_point = shot.centre
    camera.position = tuple(c + 20.0 * d for c, d in zip(shot.centre, shot.direction, strict=True))
    camera.up = shot.up
    camera.parallel_projection, camera.parallel_scale = True, shot.height / 2.0
    plotter.renderer.ResetCameraClippingRange()
    image = Image.fromarray(plotter.screenshot(return_img=True))
    plotter.close()
    buffer = io.BytesIO()
    image.resize(shot.size, Image.Resampling.BOX).quantize(COLOURS).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _add_piece(plotter: Any, piece: Piece, limits: tuple[float, float]) -> None:
    """Add a piece to a plotter; `limits` is the range of the piece's values that the colours span."""
    import pyvista
    from matplotlib.colors import LinearSegmentedColormap

    mesh = pyvista.PolyData.from_regular_faces(piece.points, piece.faces)
    look: dict[str, Any] = {"color": piece.colour}
    if piece.values is not None:
        mesh.cell_data["values"] = piece.values
        look = {"scalars": "values", "cmap": LinearSegmentedColormap.from_list("stress", RAMP), "clim": limits}
    if piece.edges:
        look |= {"show_edges": True, "edge_color": EDGE, "line_width": FINER * piece.edges, "edge_opacity": 0.35}
    plotter.add_mesh(mesh, **look, opacity=piece.opacity, show_scalar_bar=False, ambient=AMBIENT, diffuse=DIFFUSE)


if __name__ == "__main__":
    shots_to_draw = pickle.loads(sys.stdin.buffer.read())
    sys.stdout.buffer.write(pickle.dumps([render_shot(shot) for shot in shots_to_draw]))
