"""One step of a stepper, whole or in parts, as a run makes it (`pmr.simulation.native.loop`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native import tables
from pmr.simulation.native.arrays import Drive
from pmr.simulation.native.compilation import compiled, inlined
from pmr.simulation.native.driving import GIVEN, Motions
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.handles import Handle, handle
from pmr.simulation.native.loop import start, step
from pmr.simulation.native.part import Loop, observe_all
from pmr.simulation.native.side_arrays import side_outputs

Array = NDArray[np.float64]
Sizes = tuple[int, int, int]


class Stepped(NamedTuple):
    """A simulation, how it is driven in the step, and what comes of it."""

    loop: Loop
    drive: Drive  # of one step, or of its start alone, before the first one
    motions: Motions  # of paths and loads, by which that is found; of none where it is given
    outputs: Any  # `SideOutputs`, or `Outputs`
    y: Array  # (o,): outputs at its end


def outputs_of(form: SystemForm, chosen: Sequence[int]) -> Any:
    """Constants of the `chosen` outputs (numbers), as `Stepped` takes them."""
    on_tables = form.on_tables
    return side_outputs(form, chosen) if on_tables is None else tables.outputs(on_tables, chosen)


def step_of(loop: Loop, observed: tuple[Any, Array], parts: int, sizes: Sizes, led: Motions | None = None) -> Handle:
    """One that is known at so many parts, or at the start alone with none.

    Observed are `outputs_of` a system, as y.  The `sizes` are the numbers of paths, inputs, and amplitudes of
    terms.  What drives it is to be filled in where it is not `led` by motions.
    """
    paths, inputs, amplitudes = sizes
    lean = loop.levels is None
    drive = Drive(
        s=np.empty((parts + 1, paths)),
        f=np.empty((parts + 1, inputs)),
        given=None if lean else np.full(1, -1),
        c=None if lean else np.empty((parts + 1, amplitudes)),
        per=max(parts, 1),
        peaks=None if lean else np.zeros((1, len(loop.state.multipliers))),
    )
    nothing = np.zeros((GIVEN + 1, 0))
    return handle(Stepped(loop, drive, led or Motions(nothing, nothing, 0.0), *observed))


@compiled
def step_observed(stepped: Stepped) -> int:
    """One step; as `pmr.simulation.native.step.advance` and `pmr.simulation.native.parts.step_in_parts` return."""
    loop, drive = stepped.loop, stepped.drive
    last = len(drive.s) - 1
    _lead(stepped.motions, drive, last)
    failed = start(loop.levels, loop, drive)
    if failed == 0 and last > 0:
        failed = step(loop.levels, loop, drive, 0, 0)
        if failed == 0:
            observe_all(loop, stepped.outputs, drive.f[last], stepped.y)
    if failed == 0:
        _leave(stepped.motions)
    return failed


@inlined
def _lead(motions: Motions, drive: Drive, parts: int) -> None:
    """Paths and loads at equal parts of a step: Hermite's cubics by rates at both ends, or straight lines."""
    begun, ended, paths = motions.begun, motions.ended, drive.s.shape[1]
    for k in range(begun.shape[1]):
        mean = (ended[0, k] - begun[0, k]) / motions.step
        rate, second, third = mean, 0.0, 0.0
        if begun[GIVEN, k] >= 2.0 and ended[GIVEN, k] >= 2.0:
            rate, last = begun[1, k], ended[1, k]
            second = (6.0 * mean - 4.0 * rate - 2.0 * last) / motions.step
            third = 6.0 * (rate + last - 2.0 * mean) / motions.step**2
        for part in range(parts):
            t = motions.step * part / parts
            _put(drive, paths, part, k, begun[0, k] + t * (rate + t / 2.0 * (second + t / 3.0 * third)))
        _put(drive, paths, parts, k, ended[0, k])


@inlined
def _put(drive: Drive, paths: int, part: int, k: int, value: float) -> None:
    if k < paths:
        drive.s[part, k] = value
    else:
        drive.f[part, k - paths] = value


@inlined
def _leave(motions: Motions) -> None:
    """Note where a step ended; what is not given at the next one has no rate."""
    for k in range(motions.begun.shape[1]):
        for row in range(len(motions.begun)):
            motions.begun[row, k] = motions.ended[row, k]
        motions.ended[GIVEN, k] = 1.0
