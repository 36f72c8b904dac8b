r"""The motion of bodies as data for the page.

.. math:: X \approx A\,(A^T X)

X holds a frame a row, A the leading eigenvectors of X X^T: the page adds a few shapes A^T X up as often as it draws,
which takes a fraction of the room of all frames.
"""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.report.decimation import pack, speeds
from pmr.report.figures.canvas import RAMP
from pmr.report.motion.instants import fields_by_body, of_the_peak, places, positions, scale, stress_of, times, top
from pmr.report.motion.surface import Surface, surfaces
from pmr.report.motion.surroundings import Block, stage
from pmr.report.numbers import percent, plain
from pmr.report.subject import length
from pmr.results import RunResult
from pmr.scene.signals import SignalBase

Array = NDArray[np.float64]

EXACT = 1e-4  # of the largest shape, which is left out
MOST_SHAPES = 32
MOST_FACES = 60_000  # of a page that stays below 5 MB; larger ones have pictures alone
MOST_VALUES = 400_000  # of all shapes of a quantity: two bytes each, and a third more in base64


def player(result: RunResult) -> dict[str, Any]:
    """Data of the page's player, ready for JSON; empty without fields of two times or with too many faces.

    Of each body points in m, where it is along x, coefficients (frames, k) with shapes (k, 3 P) of the displacement in
    m and (k, S) of the faces' stress over that of the last colour; the first face of each pair of triangles has the
    same number as the second.  In a frame that moves all of it is turned as `pose` says.
    """
    bodies = surfaces(result)
    if (
        not bodies
        or len(t := times(result)) < 2
        or sum(len(body_surface.faces) for body_surface in bodies.values()) > MOST_FACES
    ):
        return {}
    around, alongs = stage(result, next(iter(bodies.values()))), places(result)
    shown = [_body(result, name, surface, alongs[name], MOST_VALUES // len(bodies)) for name, surface in bodies.items()]
    back = min([0.0, *(float(block.corners[:, 0].min()) for block in around.section)])
    return {
        "frames": len(t),
        "times": [float(t[0]), float(t[-1])],
        "speeds": speeds(float(t[-1] - t[0])),
        "first": of_the_peak(result).frame,
        "length": length(result),
        "path": pack(positions(result)),
        "scale": scale(result),
        "bodies": shown,
        "back": back,
        "ramp": RAMP,
        "section": [_block(block) for block in around.section],
        "near": [_block(block) for block in around.near],
        "tail": [_block(block) for block in around.tail],
        "lost": max(body_surface["lost"] for body_surface in shown),
        "pose": _pose(result),
    }


def _pose(result: RunResult) -> dict[str, Any] | None:
    """Motion of a frame: rotations (frames, 9), origins (frames, 3) m, and the middle and size of the picture."""
    if (pose := result.pose(times(result))) is None:
        return None
    bodies, alongs = surfaces(result), places(result)
    ends = [
        pose.places(np.array([body_surface.points.min(axis=0), body_surface.points.max(axis=0)]) + _axial(alongs[name]))
        for name, body_surface in bodies.items()
    ]
    every = np.concatenate([np.zeros((1, 3)), *(places.reshape(-1, 3) for places in ends)])
    low, high = every.min(axis=0), every.max(axis=0)
    return {
        "rotation": pack(pose.rotation.ravel()),
        "origin": pack(pose.origin.ravel()),
        "centre": ((low + high) / 2.0).tolist(),
        "size": float(np.linalg.norm(high - low)),
        "angles": [pack(np.rad2deg(angle.value(times(result)))) for angle in _angles(result)],
    }


def _axial(along: Array) -> Array:
    """Places (F, 1, 3) m along x."""
    return np.asarray(along[:, None, None] * np.array([1.0, 0.0, 0.0]))


def _angles(result: RunResult) -> tuple[SignalBase, ...]:
    return () if result.scene.frame is None else result.scene.frame.angles


def _body(result: RunResult, name: str, surface: Surface, along: Array, most: int) -> dict[str, Any]:
    fields = fields_by_body(result)[name]
    motion, lost = compress(surface.moved(fields, fields.displacement).reshape(len(fields.t), -1), most)
    stress = stress_of(fields)[:, surface.cell] / top(result) if fields.von_mises else None
    return {
        "points": pack(surface.points.ravel()),
        "triangles": _indices(surface.triangles),
        "edges": _indices(surface.edges),
        "faces": len(surface.faces),
        "along": pack(along),
        "motion": motion,
        "stress": None if stress is None else compress(stress, most)[0],
        "lost": lost,
    }


def drawing_sentence(data: dict[str, Any]) -> str:
    """How the motion is drawn, in a sentence; empty without a player."""
    if not data:
        return ""
    count, lost = sum(body["motion"]["count"] for body in data["bodies"]), percent(data["lost"], 1)
    shapes = "one shape that leaves" if count == 1 else f"{count} shapes that leave"
    return f"Displacements are drawn {plain(data['scale'])} times their size, from {shapes} out {lost} of the motion."


def compress(frames: NDArray[np.float32], most_values: int) -> tuple[dict[str, Any], float]:
    """Coefficients and shapes of frames (F, n), and the share of them (RMS) that is left out."""
    X = frames.astype(float)
    squares, vectors = np.linalg.eigh(X @ X.T)
    squares, vectors = np.maximum(squares[::-1], 0.0), vectors[:, ::-1]
    most = max(1, min(MOST_SHAPES, most_values // X.shape[1]))
    count = max(1, int(np.count_nonzero(squares[:most] > EXACT**2 * squares[0])))
    A = vectors[:, :count]
    A = A * np.sign(A[np.abs(A).argmax(axis=0), np.arange(count)])  # of two directions the same one everywhere
    shapes = A.T @ X
    lost = float(np.sqrt(squares[count:].sum() / squares.sum())) if squares[0] > 0.0 else 0.0
    each = [pack(shape) for shape in shapes]
    return {"count": count, "coefficients": [pack(column) for column in A.T], "shapes": each}, lost


def _indices(values: NDArray[np.int64]) -> str:
    """Little-endian 32-bit integers in base64."""
    return base64.b64encode(np.ascontiguousarray(values, "<u4").tobytes()).decode()


def _block(block: Block) -> dict[str, Any]:
    return {"corners": block.corners.round(4).ravel().tolist(), "sides": block.sides.tolist()}
