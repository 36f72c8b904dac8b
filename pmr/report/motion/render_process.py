"""The process that makes pictures: shots come in, PNG files go out (`pmr.report.motion.renderer`)."""

from __future__ import annotations

import io
import pickle
import sys
from typing import Any

import numpy as np
import pyvista
from matplotlib.colors import LinearSegmentedColormap
from PIL import Image

from pmr.report.figures.canvas import RAMP
from pmr.report.motion.renderer import Piece, Shot

EDGE = "#1c2733"
FINER = 2  # drawn so many times as large and scaled down, edges are smooth with any driver
COLOURS = 128  # of a picture, which keeps files small
#: Colours are read against a scale, so most of the light comes from everywhere; the rest tells walls apart.
AMBIENT, DIFFUSE = 0.68, 0.34


def develop(shot: Shot) -> bytes:
    """A picture as PNG."""
    plotter = pyvista.Plotter(off_screen=True, window_size=[FINER * pixels for pixels in shot.size], lighting="none")
    plotter.disable_anti_aliasing()  # what is scaled down is smooth, and this costs a software renderer as much again
    plotter.set_background("white")
    below = float(np.dot(shot.direction, shot.up)) < 0.0
    side = -0.7 if below else 0.7  # who looks from below has the light below
    plotter.add_light(pyvista.Light(light_type="camera light", position=(-0.5, side, 1.0)))
    for piece in shot.pieces:
        _add(plotter, piece, shot.limits)
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


def _add(plotter: pyvista.Plotter, piece: Piece, limits: tuple[float, float]) -> None:
    mesh = pyvista.PolyData.from_regular_faces(piece.points, piece.faces)
    look: dict[str, Any] = {"color": piece.colour}
    if piece.values is not None:
        mesh.cell_data["values"] = piece.values
        look = {"scalars": "values", "cmap": LinearSegmentedColormap.from_list("stress", RAMP), "clim": limits}
    if piece.edges:
        look |= {"show_edges": True, "edge_color": EDGE, "line_width": FINER * piece.edges, "edge_opacity": 0.35}
    plotter.add_mesh(mesh, **look, opacity=piece.opacity, show_scalar_bar=False, ambient=AMBIENT, diffuse=DIFFUSE)


if __name__ == "__main__":
    asked = pickle.loads(sys.stdin.buffer.read())
    sys.stdout.buffer.write(pickle.dumps([develop(shot) for shot in asked]))
