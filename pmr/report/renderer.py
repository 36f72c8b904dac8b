"""Render pictures with VTK, off-screen, in a process of their own.

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
        If VTK is not installed, can't render, or takes longer than `LONGEST`.
    """
    if find_spec("vtkmodules") is None:
        raise NoPictureError("VTK is not installed: pip install vtk pillow installs it")
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
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  # the classes below need it to render
    from PIL import Image
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkRenderingCore import vtkLight, vtkRenderer, vtkRenderWindow, vtkWindowToImageFilter

    window, renderer, light, reader = vtkRenderWindow(), vtkRenderer(), vtkLight(), vtkWindowToImageFilter()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)  # scaled down pictures are smooth; anti-aliasing would double the time in software
    window.SetSize(*(FINER * pixels for pixels in shot.size))
    window.AddRenderer(renderer)
    renderer.SetBackground(1.0, 1.0, 1.0)
    renderer.SetAutomaticLightCreation(0)
    light.SetLightTypeToCameraLight()
    below = float(np.dot(shot.direction, shot.up)) < 0.0
    light.SetPosition(-0.5, -0.7 if below else 0.7, 1.0)  # if the camera is below the body, the light is below too
    renderer.AddLight(light)
    for piece in shot.pieces:
        renderer.AddActor(_actor(piece, shot.limits))
    camera = renderer.GetActiveCamera()
    camera.SetFocalPoint(*shot.centre)
    camera.SetPosition(*(c + 20.0 * d for c, d in zip(shot.centre, shot.direction, strict=True)))
    camera.SetViewUp(*shot.up)
    camera.SetParallelProjection(1)
    camera.SetParallelScale(shot.height / 2.0)
    renderer.ResetCameraClippingRange()
    reader.SetInput(window)
    reader.ReadFrontBufferOff()
    reader.Update()
    pixels, (width, height, _) = reader.GetOutput(), reader.GetOutput().GetDimensions()
    colours = vtk_to_numpy(pixels.GetPointData().GetScalars()).reshape(height, width, 3)
    image, buffer = Image.fromarray(np.ascontiguousarray(colours[::-1])), io.BytesIO()
    image.resize(shot.size, Image.Resampling.BOX).quantize(COLOURS).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _actor(piece: Piece, limits: tuple[float, float]) -> Any:
    """Return a piece as an actor of VTK; `limits` is the range of the piece's values that the colours span."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

    mesh, points, faces, mapper, actor = vtkPolyData(), vtkPoints(), vtkCellArray(), vtkPolyDataMapper(), vtkActor()
    points.SetData(numpy_to_vtk(np.ascontiguousarray(piece.points), deep=True))
    sides = np.insert(piece.faces, 0, piece.faces.shape[1], axis=1).astype(np.int64).ravel()
    faces.ImportLegacyFormat(numpy_to_vtkIdTypeArray(sides, deep=True))
    mesh.SetPoints(points)
    mesh.SetPolys(faces)
    look = actor.GetProperty()
    look.SetColor(*_channels(piece.colour))
    if piece.values is not None:
        ramp, (low, high) = np.array([_channels(colour) for colour in RAMP]), limits
        at = (piece.values - low) / (high - low) * (len(ramp) - 1)
        colours = np.stack([np.interp(at, np.arange(len(ramp)), channel) for channel in ramp.T], axis=1)
        mesh.GetCellData().SetScalars(numpy_to_vtk((255.0 * colours + 0.5).astype(np.uint8), deep=True))
    mapper.SetInputData(mesh)
    look.SetInterpolationToFlat()
    look.SetAmbient(AMBIENT)
    look.SetDiffuse(DIFFUSE)
    look.SetOpacity(piece.opacity)
    if piece.edges:
        look.EdgeVisibilityOn()
        look.SetEdgeColor(*_channels(EDGE))
        look.SetLineWidth(FINER * piece.edges)
        look.SetEdgeOpacity(0.35)
    actor.SetMapper(mapper)
    return actor


def _channels(colour: str) -> Vector:
    """Return red, green and blue (0 to 1) of a colour such as ``#1c2733``."""
    red, green, blue = (int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    return red, green, blue


if __name__ == "__main__":
    shots_to_draw = pickle.loads(sys.stdin.buffer.read())
    sys.stdout.buffer.write(pickle.dumps([render_shot(shot) for shot in shots_to_draw]))
