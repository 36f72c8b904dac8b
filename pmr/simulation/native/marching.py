"""The loop around the compiled steps of `march`, and the room from which they are taken."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.scene.simulators import refuse
from pmr.simulation import contact_step
from pmr.simulation.excitation import Excitation
from pmr.simulation.modal import ModalForm
from pmr.simulation.native import step as kernel
from pmr.simulation.native import system as march_system
from pmr.simulation.native.arrays import V, Z
from pmr.simulation.native.scheme import GeneralizedAlpha
from pmr.simulation.native.start import reason, starting_state
from pmr.simulation.needs import needs_on
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import Progress
from pmr.system.body import Trajectory, pushing_rows

Array = NDArray[np.float64]
#: Steps between two looks at the clock, the keyboard and the progress.
BLOCK = 4096


class Loop:
    """Compiled steps on a time grid, in blocks: the solver's clock, and where and why they failed, in words.

    `s` (T,) m is the path at the ends of `step`s, of which so many `parts` make one of the excitation's.  `reason`
    tells from s and from what a step returned why it failed.
    """

    def __init__(self, s: Array, step: float, parts: int, reason: Callable[[float, int], str]) -> None:
        self.s, self.step, self.parts, self._reason = s, step, parts, reason

    def advance(
        self,
        steps: Callable[[int, int], tuple[int, int]],
        multiple: int,
        progress: Progress | None,
        passed: Callable[[int], None] | None = None,
    ) -> float:
        """Take all steps, in blocks of a whole number of `multiple`; `passed` is told of each. The solver's seconds."""
        T, seconds = len(self.s), 0.0
        block = max(1, BLOCK // multiple) * multiple
        steps(1, 1)  # none: what is compiled or loaded for the first time is not the solver's time
        for first in range(1, T, block):
            last = min(first + block, T)
            begin = time.perf_counter()
            taken, failed = steps(first, last)
            seconds += time.perf_counter() - begin
            self.check(first + taken, failed)
            if passed is not None:
                passed(last)
            if progress is not None:
                progress((last - 1) / (T - 1))
        return seconds

    def check(self, k: int, failed: int) -> None:
        """Raise SimulationError if step k failed."""
        if failed:
            raise SimulationError(f"march failed at {self._where(k)}: {self._reason(float(self.s[k]), failed)}")

    def check_finite(self, recorded: Array, every: int, first: int = 0) -> None:
        """Raise SimulationError at the first row that is not finite; row 0 is step `first` times `every`."""
        finite = np.isfinite(recorded).all(axis=1)
        if not finite.all():
            k = (first + int(np.argmin(finite))) * every
            raise SimulationError(f"march failed at {self._where(k)}: not finite")

    def _where(self, k: int) -> str:
        return f"step {-(-k // self.parts)}, t = {k * self.step:g} s, slider at {self.s[k]:g} m"


class March(Loop):
    """One simulation: system, state, path and loads on the time grid."""

    def __init__(self, form: ModalForm, excitation: Excitation, initial: InitialState | None) -> None:
        body = form.body
        refuse("march", needs_on(body, excitation))
        parts, s = 1, excitation.along(body.domain)
        if pushing_rows(body):
            parts = contact_step.parts(contact_step.contact_frequency(body, s), excitation.stepping)
            excitation = excitation.with_stepping(excitation.stepping.divided(parts))
            s = excitation.along(body.domain)
        stepping = excitation.stepping
        super().__init__(s, stepping.step, parts, partial(reason, body))
        self.body = body
        self.f = excitation.forces(body.input_names)
        method = GeneralizedAlpha(stepping.step, stepping.rho_inf)
        self.scheme = method.scheme()
        self.system = march_system.system(form, self.scheme)
        self.state = starting_state(form, method, self.s[0], float(excitation.path_rate[0]), self.f[0], initial)

    @property
    def start(self) -> Array:
        """Where the march stands: z and v (2, r)."""
        return self.state.modes[[Z, V], : self.body.size]


class Room:
    """Room for some thousand steps: whenever it is full, and at the end, they are taken from it.

    Where steps are made in parts, the state at their ends, at t (T,) s, is recorded, and the largest force of rows that
    only push.  `take` is told the number of the first step, a trajectory and its loads, as
    `pmr.simulation.blocks.Block`.
    """

    def __init__(self, march: March, t: Array, take: Callable[[int, Trajectory, Array], None]) -> None:
        self._march, self._t, self._take = march, t, take
        self._pushing, self._s, self._f = pushing_rows(march.body), march.s[:: march.parts], march.f[:: march.parts]
        self._block = max(1, BLOCK // march.parts)
        size = 1 + min(BLOCK // self._block * self._block, len(t) - 1)
        r, m = march.body.size, len(march.body.row_names)
        self._record = tuple(np.empty((size, width)) for width in (r, r, m))
        for array, start in zip(self._record, (*march.start, march.state.multipliers), strict=True):
            array[0] = start
        self._peaks = None if march.parts == 1 else self._record[2].copy()
        of_parts = 0 if march.parts == 1 else self._block * march.parts
        self._of_parts = [np.empty((of_parts, array.shape[1])) for array in self._record]
        self._first, self._filled = 0, 1

    def steps(self, first: int, last: int) -> tuple[int, int]:
        """Take these steps; how many it were and 0, or what stopped the march."""
        march = self._march
        rows = slice(self._filled, self._filled + (last - first) // march.parts)
        given = march.s[first:last], march.f[first:last]
        if self._peaks is None:
            return kernel.run(march.system, march.scheme, march.state, *given, *(array[rows] for array in self._record))
        parts = [array[: last - first] for array in self._of_parts]
        taken, failed = kernel.run(march.system, march.scheme, march.state, *given, *parts)
        if not failed and taken:
            for array, part in zip(self._record, parts, strict=True):
                array[rows] = part[march.parts - 1 :: march.parts]
            within = parts[2].reshape(-1, march.parts, parts[2].shape[1]).max(axis=1)
            self._peaks[rows] = self._record[2][rows]
            self._peaks[rows, self._pushing] = within[:, self._pushing]
        return taken, failed

    def passed(self, last: int) -> None:
        """All steps before number `last`, parts counted, are made."""
        self._filled = (last - 1) // self._march.parts + 1 - self._first
        if last < len(self._march.s) and self._filled + self._block <= len(self._record[0]):
            return
        rows = slice(self._first, self._first + self._filled)
        z, v, multipliers = (array[: self._filled] for array in self._record)
        self._march.check_finite(z, self._march.parts, self._first)
        peaks = None if self._peaks is None else self._peaks[: self._filled]
        for forces in (multipliers, *([] if peaks is None else [peaks])):
            without_pull(forces, self._pushing)
        part = Trajectory(self._t[rows], z, v, multipliers, self._s[rows], seconds=0.0, peaks=peaks)
        self._take(self._first, part, self._f[rows])
        for array in (*self._record, *([] if self._peaks is None else [self._peaks])):
            array[0] = array[self._filled - 1]
        self._first, self._filled = self._first + self._filled - 1, 1


def without_pull(multipliers: Array, pushing: Sequence[int]) -> None:
    """Rows that only push, by their numbers, have round-off of the others' forces at most where they let go: none."""
    multipliers[:, pushing] = np.maximum(multipliers[:, pushing], 0.0)
