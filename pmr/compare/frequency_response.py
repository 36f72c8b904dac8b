"""The tip's response to each load in frequency, along the path: what a drive or a controller meets."""

from __future__ import annotations

from typing import Any

import numpy as np

from pmr.compare.summary import Part
from pmr.reduced.model import ReducedModel
from pmr.results import FrequencyResponse
from pmr.scene import Scene
from pmr.scene.choice import transverse
from pmr.simulate.state_space import state_space

#: Places along the path, and frequencies.
POSITIONS, FREQUENCIES = 5, 400
_UNITS = {"N": "m/N", "m/s^2": "m/(m/s²)"}


def frequency_response(scene: Scene, reduced: ReducedModel) -> FrequencyResponse | None:
    """With the sliders at rest, from a tenth of the lowest natural frequency to the highest; None unless asked for.

    Raises InputError if rows are rigid or only push, or the model keeps residual inertia.
    """
    if not scene.observe.frequency_response:
        return None
    s = np.unique(np.linspace(*scene.path_bounds, POSITIONS))
    space = state_space(reduced, s, "scene")
    natural = space.natural / (2.0 * np.pi)
    f = np.geomspace(0.1 * natural.min(), 1.2 * natural.max(), FREQUENCIES)
    tips = [
        k for k, name in enumerate(space.outputs) if name in {scene.observe.tip_along(d) for d in transverse(scene)}
    ]
    static = space.frequency_response(np.zeros(1))[:, 0, tips].real
    furthest = np.abs(static).max(axis=0).argmax(axis=0)  # of each load, the direction in which it moves the tip
    inputs = np.arange(len(space.inputs))
    gain = np.abs(space.frequency_response(2.0 * np.pi * f)[:, :, tips])[:, :, furthest, inputs]
    return FrequencyResponse(
        s,
        f,
        gain,
        static[:, furthest, inputs],
        damped=bool(np.any(reduced.D)),
        outputs=tuple(space.outputs[tips[k]] for k in furthest),
        inputs=space.inputs,
        units=tuple(_UNITS.get(unit, f"m/({unit})") for unit in reduced.input_units),
    )


def part(found: FrequencyResponse | None) -> Part:
    """``frequency_response``: of each load static and largest gain, and where that is, at each place."""
    if found is None:
        return Part()
    figures: dict[str, Any] = {"s": found.s.tolist(), "damped": found.damped, "gain": {}}
    for k, name in enumerate(found.inputs):
        peak = found.gain[:, :, k].argmax(axis=1)
        figures["gain"][name] = {
            "output": found.outputs[k],
            "unit": found.units[k],
            "static": found.static[:, k].tolist(),
            "largest": found.gain[np.arange(len(peak)), peak, k].tolist() if found.damped else None,
            "at": found.f[peak].tolist(),
        }
    return Part({"frequency_response": figures})
