"""A frame that moves as the arrays that the kernel finds loads and amplitudes of terms from (src/frame.c)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.kernel.block_file import lines
from pmr.scene.scene import Scene

#: Kinds of quantities in the order in which src/internal.h numbers them.
KINDS = ("one", "turned", "velocity", "turning", "gradient", "motion", "reach", "over")
ANGLES = ("luffing", "slewing", "base.rx", "base.ry", "base.rz")
AXES = ("base.x", "base.y", "base.z")


class Frame(Protocol):
    """Loads and amplitudes as sums of products of quantities (`pmr.simulation.moving.MovingFrame`)."""

    @property
    def scene(self) -> Scene:
        """Scene that the frame is of."""

    @property
    def drivers(self) -> tuple[str, ...]:
        """Names of the n motions, paths first."""

    @property
    def quantities(self) -> tuple[tuple[str | int, ...], ...]:
        """All that the products have, (q,)."""

    @property
    def factors(self) -> NDArray[np.float64]:
        """Factors (p,) of all products."""

    @property
    def numbers(self) -> NDArray[np.int64]:
        """Numbers (p, 3) of the quantities in each product."""

    @property
    def first(self) -> NDArray[np.int64]:
        """First product of each input and term, (i + K + 1,)."""


def frame_arrays(frame: Frame | None, paths: Sequence[str]) -> dict[str, NDArray[Any] | str]:
    """Arrays of a frame whose system travels on these paths; an InputError is raised where it knows one of them not."""
    nothing = np.zeros(0, np.int64)
    if frame is None:
        integers = ("frame_angles", "frame_paths", "quantity_list", "products", "first_product")
        return {**dict.fromkeys(integers, nothing), "factors": np.zeros(0)}
    numbers = {name: k for k, name in enumerate(frame.drivers)}
    if missing := [path for path in paths if path not in numbers]:
        raise InputError("system", "paths", missing[0], f"{', '.join(frame.drivers)} are allowed")
    return {
        "frame_angles": np.array([numbers.get(name, -1) for name in ANGLES]),
        "frame_paths": np.array([numbers[path] for path in paths], np.int64),
        "quantity_list": np.array([_quantity(quantity, numbers) for quantity in frame.quantities]),
        "products": frame.numbers,
        "first_product": frame.first,
        "factors": frame.factors,
        "names_motions": lines(frame.drivers),
    }


def _quantity(quantity: tuple[str | int, ...], numbers: dict[str, int]) -> list[int]:
    """Kind and two numbers; what is a motion by its name is one by its number."""
    kind, *of = quantity
    if kind in ("gravity", "load", "shaken"):
        name = "gravity" if kind == "gravity" else AXES[int(of[0])] if kind == "shaken" else str(of[0])
        if name not in numbers and kind != "load":  # weight and a base that moves are there only where a scene has them
            return [KINDS.index("reach"), 0, 0]  # a sum of no paths
        return [KINDS.index("motion"), numbers[name], 0]
    return [KINDS.index(str(kind)), *map(int, of), *[0] * (2 - len(of))]
