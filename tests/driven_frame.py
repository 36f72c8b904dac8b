"""Amplitudes of a frame that moves, from its drivers: an oracle that adds up all products one by one."""

from collections.abc import Callable

import numpy as np

from pmr.files.arrays import Array
from pmr.kernel.further import ANGLES, AXES, Quantity
from pmr.scene.rotation import FrameRotation
from pmr.simulation.moving import GRAVITY, OF_BASE, MovingFrame


def find(frame: MovingFrame, drivers: Array) -> tuple[Array, Array]:
    """Amplitudes of the inputs (i,) and of the terms (K,) from the drivers (3, n): values, rates and second rates."""
    value = _quantity_values(frame, drivers)
    of_products = [[p.factor * np.prod([value(of) for of in p.of]) for p in products] for products in frame.products]
    values = np.array([sum(products) for products in of_products])
    return values[: len(frame.inputs)], values[len(frame.inputs) :]


def _quantity_values(frame: MovingFrame, drivers: Array) -> Callable[[Quantity], float]:
    """Function that returns the value of a quantity of the frame, from the drivers (3, n)."""
    at, none = dict(zip(frame.drivers, drivers.T, strict=True)), np.zeros(3)
    angles = [tuple(at.get(name, none)[:, None]) for name in ANGLES]
    turning = FrameRotation.from_angles(angles[0], angles[1], angles[2:] if OF_BASE[0] in frame.angles else ())
    tables = {
        "turned": turning.rotation[0],
        "velocity": turning.velocity[0],
        "turning": turning.acceleration[0],
        "gradient": turning.gradient[0],
        "raised": np.array([np.sin(angles[0][0][0]), 0.0, np.cos(angles[0][0][0])]),
        "shaken": np.array([at.get(axis, none)[0] for axis in AXES]),
    }
    reach = np.cumsum([none, *(at[path] for path in frame.paths)], axis=0)

    def value(quantity: Quantity) -> float:
        kind, *of = quantity
        if kind == "gravity":
            return float(at.get(GRAVITY, none)[0])
        if kind == "load":
            return float(at[str(of[0])][0])
        if kind == "over":
            return float(1.0 / at[frame.paths[int(of[0]) - 1]][0])
        return float(reach[tuple(of)] if kind == "reach" else tables[str(kind)][tuple(of)])

    return value
