"""Amplitudes of a frame that moves, from its drivers: an oracle that adds up all products one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.kernel.further import ANGLES, AXES
from pmr.simulation.frame_motion import FrameRotation
from pmr.simulation.moving import GRAVITY, OF_BASE, MovingFrame

Array = NDArray[np.float64]


def find(frame: MovingFrame, drivers: Array) -> tuple[Array, Array]:
    """Amplitudes of the inputs (i,) and of the terms (K,) from the drivers (3, n): values, rates and second rates."""
    products = frame.factors * _quantities(frame, drivers)[frame.numbers].prod(axis=1)
    values = np.add.reduceat(products, frame.first[:-1])
    return values[: len(frame.inputs)], values[len(frame.inputs) :]


def _quantities(frame: MovingFrame, drivers: Array) -> Array:
    """Values (q,) of the frame's quantities, in its order, from the drivers (3, n)."""
    at, none = dict(zip(frame.drivers, drivers.T, strict=True)), np.zeros(3)
    angles = [tuple(at.get(name, none)[:, None]) for name in ANGLES]
    turning = FrameRotation.from_angles(angles[0], angles[1], angles[2:] if OF_BASE[0] in frame.angles else ())
    tables = {
        "turned": turning.rotation[0],
        "velocity": turning.velocity[0],
        "turning": turning.acceleration[0],
        "gradient": turning.gradient[0],
        "shaken": np.array([at.get(axis, none)[0] for axis in AXES]),
    }
    reach = np.cumsum([none, *(at[path] for path in frame.paths)], axis=0)
    values = np.empty(len(frame.quantities))
    for k, (kind, *of) in enumerate(frame.quantities):
        if kind == "one":
            values[k] = 1.0
        elif kind == "gravity":
            values[k] = at.get(GRAVITY, none)[0]
        elif kind == "load":
            values[k] = at[str(of[0])][0]
        elif kind == "over":
            values[k] = 1.0 / at[frame.paths[int(of[0]) - 1]][0]
        else:
            values[k] = reach[tuple(of)] if kind == "reach" else tables[str(kind)][tuple(of)]
    return values
