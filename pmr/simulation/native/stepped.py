"""One step of a stepper, whole or in parts, as a run makes it (`pmr.simulation.native.loop`)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import Drive
from pmr.simulation.native.compilation import compiled
from pmr.simulation.native.contact import begin_impulses
from pmr.simulation.native.handles import Handle, handle
from pmr.simulation.native.loop import step
from pmr.simulation.native.part import Loop, observe_all, start_sides

Array = NDArray[np.float64]


class Stepped(NamedTuple):
    """A simulation, how it is driven in the step, and what comes of it."""

    loop: Loop
    drive: Drive  # of one step, or of its start alone, before the first one
    outputs: Any  # `SideOutputs`, or `Outputs`
    y: Array  # (o,): outputs at its end
    peaks: Array  # (1, m): largest multipliers within it


def step_of(loop: Loop, outputs: Any, y: Array, parts: int, sizes: tuple[int, int, int | None]) -> Handle:
    """One that is known at so many parts, or at the start alone with none; what drives it is to be filled in.

    The `sizes` are the numbers of paths, inputs, and amplitudes of terms or None.
    """
    paths, inputs, amplitudes = sizes
    drive = Drive(
        s=np.empty((parts + 1, paths)),
        f=np.empty((parts + 1, inputs)),
        given=None if loop.levels is None else np.full(1, -1),
        c=None if amplitudes is None else np.empty((parts + 1, amplitudes)),
        per=max(parts, 1),
    )
    return handle(Stepped(loop, drive, outputs, y, np.zeros((1, len(loop.state.multipliers)))))


@compiled
def step_observed(stepped: Stepped) -> int:
    """One step; as `pmr.simulation.native.step.advance` and `pmr.simulation.native.parts.step_in_parts` return."""
    loop, drive = stepped.loop, stepped.drive
    last = len(drive.s) - 1
    failed = start_sides(loop.sides, loop, drive.s[0], drive.f[0])
    if failed == 0 and last > 0:
        begin_impulses(loop.state.contact)
        failed = step(loop.levels, loop, drive, 0, stepped.peaks, 0)
        if failed == 0:
            observe_all(loop, stepped.outputs, drive.f[last], stepped.y)
    return failed
