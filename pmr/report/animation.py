"""The motion as data for the page: thinned, scaled to 16 bits, base64."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.report.decimation import onto, spread
from pmr.report.figures.canvas import PENS
from pmr.report.figures.timeline import drawn
from pmr.report.numbers import plain, quantity, round_number
from pmr.results import RunResult

Array = NDArray[np.float64]
FRAMES = 1500
POINTS = 26
REACH = 0.1  # largest deflection as drawn, over the length of the beam
PLAYING = 30.0  # s that the whole motion plays at the speed set first
_FULL_SCALE = 32767


def animation(result: RunResult) -> dict[str, Any]:
    """What the player needs, ready for JSON.

    Series are little-endian 16-bit integers in base64, with the value of one count beside them: displacements
    (frames, points) for each simulator, slider position and loads (frames,).
    """
    t = result.responses["reduced"].t
    frames = spread(len(t), FRAMES)
    beams = []
    for name, response in drawn(result).items():
        points = spread(len(response.x), POINTS)
        motion = onto(t, response.t, response.displacement[:, points])[frames]
        pen = PENS[name]
        beams.append(
            {
                "label": pen.label,
                "colour": pen.colour,
                "width": pen.width,
                "dash": pen.dash,
                "x": response.x[points].round(6).tolist(),
                "w": packed(motion),
            }
        )
    motions = [response.displacement for response in result.responses.values()]
    largest = max(float(np.abs(motion).max()) for motion in motions)
    length = result.beam.body.length
    scale = round_number(REACH * length / largest) if largest > 0.0 else 1.0
    return {
        "length": length,
        "largest": largest,
        "reach": [float(min(w.min() for w in motions)), float(max(w.max() for w in motions))],
        "scale": scale,
        "times": [float(t[0]), float(t[-1])],
        "frames": len(frames),
        "beams": beams,
        "s": packed(result.path[frames]),
        "offsets": result.scene.slider.offsets,
        "supports": [{"at": support.at, "kind": support.kind} for support in result.beam.supports],
        "loads": [
            {
                "name": load.name,
                "at": load.at,
                "direction": load.direction,
                "values": packed(result.loads[frames, i]),
            }
            for i, load in enumerate(result.beam.loads)
        ],
        "speeds": speeds(float(t[-1] - t[0])),
    }


def scale_text(data: dict[str, Any]) -> str:
    """The exaggeration in words."""
    if data["largest"] == 0.0:
        return "The beam does not move."
    factor = data["scale"]
    drawn_as = "at its true size" if factor == 1.0 else f"{plain(factor)} times its size"
    return f"Deflection is drawn {drawn_as}; it reaches {quantity(data['largest'], 'm')}."


def packed(values: Array) -> dict[str, Any]:
    """Little-endian 16-bit integers in base64, and the value of one count."""
    largest = float(np.abs(values).max(initial=0.0)) or 1.0
    counts = np.round(values / largest * _FULL_SCALE).astype("<i2")
    return {"count": largest / _FULL_SCALE, "data": base64.b64encode(counts.tobytes()).decode()}


def speeds(duration: float) -> dict[str, Any]:
    """Playback speeds as multiples of real time; the one set first is round and plays for about `PLAYING`."""
    first = round_number(max(duration / PLAYING, 1e-6))
    choices = [first / 5.0, first / 2.0, first, 2.0 * first, 4.0 * first]
    return {"first": first, "choices": [float(f"{choice:.3g}") for choice in choices]}
