"""Outputs that steppers and FMUs warn of: displacements too large for the theory, and a machine that tips."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from pmr.files.arrays import Array
from pmr.kernel.further import ground_outputs
from pmr.scene import Scene
from pmr.scene.mechanism import TIPPING_MARGIN
from pmr.system.system import System

#: Number of steps of a stepper after which it looks at the watched outputs.
WATCHED_EVERY = 16
#: Share of the boom's length: a tip that moves this far comes closer by half a per cent of the length.
SMALL = 0.1
DISPLACEMENT, MARGIN = 0, 1


@dataclass(frozen=True)
class WatchedOutputs:
    """Outputs w with the limits between which no warning is needed; one warning is given for each kind of them."""

    names: tuple[str, ...]  # of outputs
    kinds: tuple[int, ...]  # DISPLACEMENT or MARGIN
    limits: Array  # (w, 2): smallest and largest value without a warning
    messages: tuple[str, ...]  # what a value beyond its limits means


def _greatest_length(system: System, scene: Scene) -> float:
    """Length in m of the boom with all sections as far out as paths of the system may lead them."""
    ranges = system.ranges
    return scene.sections[-1].length + sum(ranges[name][1] for name in scene.names[1:])


def watched_outputs(system: System, scene: Scene | None, names: Collection[str]) -> WatchedOutputs:
    """Displacements in m and margins against tipping, as far as they are among `names`; empty without a frame."""
    limits, kinds, messages = dict[str, tuple[float, float]](), list[int](), list[str]()
    if scene is not None and scene.frame is not None:
        length = _greatest_length(system, scene)
        for name, unit in zip(system.output_names, system.output_units, strict=True):
            if unit == "m":
                limits[name] = -SMALL * length, SMALL * length
                kinds.append(DISPLACEMENT)
                beyond = f"{name} is more than {SMALL:g} times the greatest length of the boom, {length:.3g} m"
                messages.append(f"{beyond}: the theory of small motions does not hold")
        for name in ground_outputs(scene):
            if name in names and name.startswith(TIPPING_MARGIN):
                limits[name] = 0.0, float(np.finfo(float).max)
                kinds.append(MARGIN)
                messages.append(f"the {name} is below 0: the machine tips, no forces of outriggers hold it")
    return WatchedOutputs(tuple(limits), tuple(kinds), np.reshape([*limits.values()], (-1, 2)), tuple(messages))
