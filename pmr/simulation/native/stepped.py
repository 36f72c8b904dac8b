"""One step of a stepper that is made in parts, as a run makes it (`pmr.simulation.native.parts`)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.compilation import compiled
from pmr.simulation.native.contact import begin_impulses
from pmr.simulation.native.part import Loop, observe_all
from pmr.simulation.native.parts import step_in_parts

Array = NDArray[np.float64]


@compiled
def step_in_parts_observed(loop: Loop, outputs: Any, s: Array, f: Array, c: Any, peaks: Array, y: Array) -> int:
    """One step with s (n + 1, P), f (n + 1, i), c (n + 1, K) or None at n equal parts of it, and its outputs y (o,).

    Returned is what `step_in_parts` returns; `peaks` (m,) are the largest multipliers within it.
    """
    begin_impulses(loop.state.contact)
    failed = step_in_parts(loop, -1, s, f, c, peaks)
    if failed == 0:
        observe_all(loop, outputs, f[len(f) - 1], y)
    return failed
