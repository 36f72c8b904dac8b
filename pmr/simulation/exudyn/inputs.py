"""What drives a sliding body, as a simulator asks for it at a time t: path, loads, and what depends on the path.

`SignalInputs` evaluates at any time; `TabulatedInputs` looks up what it evaluated beforehand at the steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pmr.scene.signals import SignalBase
from pmr.simulation.excitation import Excitation, in_order
from pmr.system.body import SlidingBody

Array = NDArray[np.float64]

#: Entries of what depends on s that are held at once; bounds the memory of a long simulation.
ENTRIES_AHEAD = 1_000_000


#: Something of s that a simulator needs at every step: ``evaluate(s (T,)) -> (T, ...)``.
OfPath = Callable[[Array], Array]


def moving_rows(body: SlidingBody) -> list[int]:
    """Numbers of the rows that do more than hold one coordinate."""
    return [i for i in range(len(body.row_names)) if i not in body.held]


class SignalInputs:
    """Evaluates the signals whenever asked; what depends on s only where s has changed since the last time.

    Errors as for `pmr.simulation.excitation.in_order`.
    """

    def __init__(self, body: SlidingBody, path: SignalBase, loads: Mapping[str, SignalBase]) -> None:
        self._path, self._loads = path, in_order(loads, body.input_names)

    def position(self, t: float) -> float:
        """Path coordinate s(t) in m."""
        return float(self._path.value(t))

    def loads(self, t: float) -> tuple[float, ...]:
        """One value an input, in N (or N m)."""
        return tuple(float(load.value(t)) for load in self._loads)

    def along(self, evaluate: OfPath, entries: int) -> Callable[[float], Array]:
        """`evaluate` at s(t) as a function of t; `entries` is how many numbers it gives for each s."""
        last: tuple[float, Array] | None = None

        def value(t: float) -> Array:
            nonlocal last
            s = self.position(t)
            if last is None or s != last[0]:
                last = s, evaluate(np.array([s]))[0]
            return last[1]

        return value


class TabulatedInputs:
    """Path and loads at all steps, what depends on s a block of steps ahead: where the time grid is known.

    Errors as for `Excitation.along` and `Excitation.forces`.
    """

    def __init__(self, body: SlidingBody, excitation: Excitation) -> None:
        self.s, self.f = excitation.along(body.domain), excitation.forces(body.input_names)
        self._positions = self.s.tolist()
        self._loads = [tuple(f) for f in self.f.tolist()]
        self._step = excitation.stepping.step

    def position(self, t: float) -> float:
        return self._positions[round(t / self._step)]

    def loads(self, t: float) -> tuple[float, ...]:
        return self._loads[round(t / self._step)]

    def along(self, evaluate: OfPath, entries: int) -> Callable[[float], Array]:
        block = max(1, ENTRIES_AHEAD // max(entries, 1))
        first, values, index = 0, np.empty(0), np.empty(0, int)

        def value(t: float) -> Array:
            nonlocal first, values, index
            k = round(t / self._step)
            if not first <= k < first + len(index):
                first = k
                visited, index = np.unique(self.s[k : k + block], return_inverse=True)
                values = evaluate(visited)
            return np.asarray(values[index[k - first]])

        return value


Inputs: TypeAlias = SignalInputs | TabulatedInputs
