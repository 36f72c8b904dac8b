"""The motion of a boom of several sections as data for the page."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from pmr.report.booms.figures import exaggeration
from pmr.report.booms.lines import SectionLine, lines
from pmr.report.decimation import packed, speeds, spread
from pmr.report.numbers import plain, quantity
from pmr.results import RunResult

FRAMES, POINTS = 1000, 16


def motion(result: RunResult) -> dict[str, Any]:
    """What the player needs, ready for JSON.

    Of each section its places in m, displacements (frames, points) and its tail (frames,); of each pad above or below
    an axis where it is along the boom, and its force over the largest of all.
    """
    response = result.responses["reduced"]
    frames, found = spread(len(response.t), FRAMES), lines(result, response)
    pads = list(_pads(result, found, frames))
    largest = max((float(np.abs(pad["force"]).max()) for pad in pads), default=0.0) or 1.0
    moved = [line.moved[frames][:, spread(len(line.x), POINTS)] for line in found]
    return {
        "length": float(result.along.max()),
        "largest": max(float(np.abs(line.moved).max(initial=0.0)) for line in found),
        "reach": [min(float(w.min()) for w in moved), max(float(w.max()) for w in moved)],
        "scale": exaggeration(result),
        "times": [float(response.t[0]), float(response.t[-1])],
        "frames": len(frames),
        "beams": [
            {
                "label": line.name,
                "colour": line.colour,
                "width": 3 + 3 * (len(found) - 1 - k),
                "x": line.x[spread(len(line.x), POINTS)].round(6).tolist(),
                "w": packed(moved[k]),
                "tail": packed(line.tail[frames]),
            }
            for k, line in enumerate(found)
        ],
        "pads": [pad | {"at": packed(pad["at"]), "force": packed(pad["force"] / largest)} for pad in pads],
        "speeds": speeds(float(response.t[-1] - response.t[0])),
    }


def said(data: dict[str, Any]) -> str:
    """The exaggeration in words."""
    if data["largest"] == 0.0:
        return "The boom does not move across its axis."
    drawn = "at its true size" if data["scale"] == 1.0 else f"{plain(data['scale'])} times its size"
    bars = " Bars are the forces of pads above and below." if data["pads"] else ""
    return f"Deflection is drawn {drawn}; it reaches {quantity(data['largest'], 'm')}.{bars}"


def _pads(result: RunResult, found: list[SectionLine], frames: Any) -> Iterator[dict[str, Any]]:
    """Rings above and below, one for all pads of a ring on one face; `section` is the inner one."""
    response, boom = result.responses["reduced"], result.scene
    for number, part in enumerate(boom.sections[1:], start=1):
        assert part.joint is not None
        for end, rings in (("tail", part.joint.tail), ("mouth", part.joint.mouth)):
            for ring in rings:
                called = " ".join(filter(None, (f"force of {part.name} {end}", ring.name)))
                mouth = found[number - 1].tail + boom.sections[number - 1].length - ring.at
                at = found[number].tail + ring.at if end == "tail" else mouth
                for sides, way in ((("bottom", "below"), -1), (("top", "above"), 1)):
                    columns = [
                        k
                        for k, name in enumerate(response.force_names)
                        if name.removeprefix(called).split()[:1] in ([sides[0]], [sides[1]]) and name.startswith(called)
                    ]
                    if columns:
                        force = response.slider_force[frames][:, columns].sum(axis=1)
                        yield {"section": number, "way": way, "at": at[frames], "force": force}
