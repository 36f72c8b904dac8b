"""The motion of a body's axis as data for the page: thinned, scaled to 16 bits, base64."""

from __future__ import annotations

from typing import Any

import numpy as np

from pmr.report.decimation import onto, packed, speeds, spread
from pmr.report.figures.canvas import PENS
from pmr.report.figures.timeline import drawn
from pmr.report.numbers import plain, quantity, round_number
from pmr.report.subject import fixtures, length, line, loads, offsets
from pmr.results import RunResult

FRAMES = 1500
POINTS = 26
REACH = 0.1  # largest deflection as drawn, over the length of the beam


def motion(result: RunResult) -> dict[str, Any]:
    """What the player needs, ready for JSON.

    Series are little-endian 16-bit integers in base64, with the value of one count beside them: displacements
    (frames, points) for each simulator, slider position and loads (frames,).
    """
    t = result.responses["reduced"].t
    frames = spread(len(t), FRAMES)
    beams = []
    for name, response in drawn(result).items():
        of = line(result, response)
        points = spread(len(of.x), POINTS)
        moved = onto(t, response.t, response.displacement[:, of.columns[points]])[frames]
        pen = PENS[name]
        beams.append(
            {
                "label": pen.label,
                "colour": pen.colour,
                "width": pen.width,
                "dash": pen.dash,
                "x": of.x[points].round(6).tolist(),
                "w": packed(moved),
            }
        )
    motions = [one.displacement[:, line(result, one).columns] for one in result.responses.values()]
    largest, end = max(float(np.abs(motion).max()) for motion in motions), length(result)
    scale = round_number(REACH * end / largest) if largest > 0.0 else 1.0
    return {
        "length": end,
        "largest": largest,
        "reach": [float(min(w.min() for w in motions)), float(max(w.max() for w in motions))],
        "scale": scale,
        "times": [float(t[0]), float(t[-1])],
        "frames": len(frames),
        "beams": beams,
        "s": packed(result.along[frames]),
        "offsets": offsets(result),
        "supports": [{"at": fixture.at, "kind": fixture.kind} for fixture in fixtures(result)],
        "loads": [
            {
                "name": load.name,
                "at": load.at,
                "direction": load.direction,
                "values": packed(result.loads.values[frames, i]),
            }
            for i, load in enumerate(loads(result))
            if load.direction != "aside"
        ],
        "speeds": speeds(float(t[-1] - t[0])),
    }


def said(data: dict[str, Any]) -> str:
    """The exaggeration in words."""
    if data["largest"] == 0.0:
        return "The body does not move."
    factor = data["scale"]
    drawn_as = "at its true size" if factor == 1.0 else f"{plain(factor)} times its size"
    return f"Deflection is drawn {drawn_as}; it reaches {quantity(data['largest'], 'm')}."
