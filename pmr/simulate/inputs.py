"""What drives a sliding body, as a simulator asks for it at a time t: path, loads and constraint rows.

`SignalInputs` evaluates at any time; `TabulatedInputs` looks up what it evaluated beforehand at the steps.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pmr.body import SlidingBody
from pmr.signals import SignalBase
from pmr.simulate.stepping import Loads, TimeStepping, loads_at, one_for_each, path_at

Array = NDArray[np.float64]

#: Entries of C(s) that are held at once; bounds the memory of a long simulation.
ENTRIES_AHEAD = 1_000_000


class Inputs(Protocol):
    """Path, loads and rows over time."""

    def position(self, t: float) -> float:
        """Path coordinate s(t) in m."""
        ...

    def rows(self, t: float) -> Array:
        """The rows of C(s(t)) that are no mere supports (`moving_rows`), as a dense array (m', n)."""
        ...

    def loads(self, t: float) -> tuple[float, ...]:
        """One value an input, in N (or N m)."""
        ...


def moving_rows(body: SlidingBody) -> list[int]:
    """Numbers of the rows that do more than hold one coordinate."""
    return [i for i in range(len(body.row_names)) if i not in body.held]


class SignalInputs:
    """Evaluates the signals whenever asked; the rows only where s has changed since the last time.

    Raises
    ------
    InputError
        If there are not as many loads as inputs.
    """

    def __init__(self, body: SlidingBody, path: SignalBase, loads: Loads) -> None:
        self._body, self._path, self._loads = body, path, one_for_each(loads, body.input_names)
        self._moving = moving_rows(body)
        self._last: tuple[float, Array] | None = None

    def position(self, t: float) -> float:
        return float(self._path.value(t))

    def rows(self, t: float) -> Array:
        s = self.position(t)
        if self._last is None or s != self._last[0]:
            self._last = s, self._body.dense_rows(np.array([s]))[0, self._moving]
        return self._last[1]

    def loads(self, t: float) -> tuple[float, ...]:
        return tuple(float(load.value(t)) for load in self._loads)


class TabulatedInputs:
    """Path and loads at all steps, the rows a block of steps ahead: for a simulation with a known time grid.

    Raises
    ------
    InputError
        If the path leaves the body's domain or there are not as many loads as inputs.
    """

    def __init__(self, body: SlidingBody, path: SignalBase, loads: Loads, stepping: TimeStepping) -> None:
        signals = one_for_each(loads, body.input_names)
        self.s = path_at(path, body.domain, stepping.times)
        self._positions = self.s.tolist()
        self._loads = [tuple(f) for f in loads_at(signals, stepping.times).tolist()]
        self._step = stepping.step
        self._body, self._moving = body, moving_rows(body)
        self._block = max(1, ENTRIES_AHEAD // (len(body.row_names) * body.size))
        self._first, self._rows, self._index = 0, np.empty(0), np.empty(0, int)

    def position(self, t: float) -> float:
        return self._positions[round(t / self._step)]

    def loads(self, t: float) -> tuple[float, ...]:
        return self._loads[round(t / self._step)]

    def rows(self, t: float) -> Array:
        k = round(t / self._step)
        if not self._first <= k < self._first + len(self._index):
            self._first = k
            visited, self._index = np.unique(self.s[k : k + self._block], return_inverse=True)
            self._rows = self._body.dense_rows(visited)[:, self._moving]
        return self._rows[self._index[k - self._first]]
