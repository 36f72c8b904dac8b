"""What drives a system, as Exudyn asks for it at a time t: places on paths, loads, and what depends on the places."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.scene.signals import SignalBase
from pmr.simulation.excitation import Excitation, in_order
from pmr.simulation.exudyn.equations import Equations
from pmr.simulation.exudyn.paths import NodeCoordinate
from pmr.simulation.lengths import Lengths

Array = NDArray[np.float64]

#: Entries of what depends on places that are held at once; bounds the memory of a long simulation.
ENTRIES_AHEAD = 1_000_000

#: Something of the places that a simulator needs at every step: ``evaluate(x (T, k)) -> (T, ...)``.
OfPlaces = Callable[[Array], Array]
#: A path in m or a load in N: a signal, whose `value` and `rate` are asked for, or a function of the mbs and the time
#: in s, which may read ``mbs.variables``.
Driving: TypeAlias = SignalBase | Callable[[Any, float], float]


class Inputs(ABC):
    """Places and loads at a time, and what depends on the places, a block of them ahead as far as they are known."""

    @abstractmethod
    def begin(self, t: float) -> None:
        """The step that ends at t s begins."""

    @abstractmethod
    def number(self, t: float) -> int:
        """Number of the places at t s; it stays as long as they do."""

    @abstractmethod
    def places(self, first: int, count: int) -> Array:
        """X (T, sides) m from a number on, `count` of them or as many as are known."""

    @abstractmethod
    def loads(self, t: float) -> tuple[float, ...]:
        """One value an input, in N (or N m)."""

    @abstractmethod
    def amplitudes(self, t: float) -> tuple[float, ...]:
        """One value a term."""

    def at(self, t: float) -> Array:
        """X (1, sides) m at t s."""
        return self.places(self.number(t), 1)

    def along(self, evaluate: OfPlaces, entries: int) -> Callable[[float], Array]:
        """`evaluate` at x(t) as a function of t; `entries` is how many numbers it gives for each place."""
        block = max(1, ENTRIES_AHEAD // max(entries, 1))
        first, values, index = 0, np.empty(0), np.empty(0, int)

        def value(t: float) -> Array:
            nonlocal first, values, index
            k = self.number(t)
            if not first <= k < first + len(index):
                first = k
                visited, index = np.unique(self.places(k, block), axis=0, return_inverse=True)
                values, index = evaluate(visited), index.ravel()
            return np.asarray(values[index[k - first]])

        return value


class SignalInputs(Inputs):
    """Evaluates signals and functions where the time has changed, or a step begins.

    An InputError is raised if a path, load or amplitude of a term is missing, or one has no input or term.
    """

    def __init__(
        self,
        mbs: Any,
        equations: Equations,
        paths: Mapping[str, Driving],
        loads: Mapping[str, Driving],
        terms: Mapping[str, Driving],
    ) -> None:
        if missing := set(equations.system.paths) - set(paths):
            allowed = f"{', '.join(paths) or 'none'} given, one for each path is allowed: {', '.join(sorted(missing))}"
            raise InputError("system", "paths", None, allowed)
        self._mbs, self._equations, self._paths, self._k = mbs, equations, dict(paths), 0
        # m/s at t = 0, where a function counts as at rest
        self.rates = {name: float(path.rate(0.0)) if hasattr(path, "rate") else 0.0 for name, path in paths.items()}
        self._loads = in_order(loads, equations.system.input_names)
        self._terms = in_order(terms, equations.system.term_names, "term")
        # coordinates of nodes, which move within a step
        self._moving = [name for name, path in self._paths.items() if isinstance(path, NodeCoordinate)]
        self._x = np.empty(0)
        self.begin(0.0)

    def at(self, t: float) -> Array:
        self.number(t)
        if not self._moving:
            return self._x
        return self._equations.at(self.s | {name: self._value(self._paths[name], t) for name in self._moving})

    def begin(self, t: float) -> None:
        self.s = {name: self._value(path, t) for name, path in self._paths.items()}  # m
        before, self._t, self._x = self._x, t, self._equations.at(self.s)
        self._k += int(not np.array_equal(before, self._x))
        self._f = tuple(self._value(load, t) for load in self._loads)
        self._c = tuple(self._value(term, t) for term in self._terms)

    def number(self, t: float) -> int:
        if t != self._t:
            self.begin(t)
        return self._k

    def places(self, first: int, count: int) -> Array:
        return self._x

    def loads(self, t: float) -> tuple[float, ...]:
        self.number(t)
        return self._f

    def amplitudes(self, t: float) -> tuple[float, ...]:
        self.number(t)
        return self._c

    def paths(self, t: float) -> dict[str, float]:
        """Coordinate of each path at t s, in m."""
        self.number(t)
        return self.s

    def _value(self, driving: Driving, t: float) -> float:
        return float(driving.value(t) if hasattr(driving, "value") else driving(self._mbs, t))


class TabulatedInputs(Inputs):
    """Looks up what was evaluated beforehand, at all parts of all steps.

    Errors as for `Equations.visited`, `Excitation.forces` and `Excitation.amplitudes`.
    """

    def __init__(self, equations: Equations, excitation: Excitation, lengths: Lengths) -> None:
        stepping, numbers = excitation.stepping.divide(lengths.finest), lengths.numbers
        fine = excitation.with_stepping(stepping)
        self.x, self.f = equations.visited(fine)[numbers], fine.forces(equations.system.input_names)[numbers]
        self.c = fine.amplitudes(equations.system.term_names)[numbers]
        changes = np.append(True, np.any(self.x[1:] != self.x[:-1], axis=1))
        at = (np.cumsum(changes) - 1).tolist()
        loads, terms = map(tuple, self.f.tolist()), map(tuple, self.c.tolist())
        self._places, self._step = self.x[changes], stepping.step
        self._known = dict(zip(numbers.tolist(), zip(at, loads, terms, strict=True), strict=True))

    def begin(self, t: float) -> None:
        """All is known."""

    def number(self, t: float) -> int:
        return self._known[round(t / self._step)][0]

    def places(self, first: int, count: int) -> Array:
        return self._places[first : first + count]

    def loads(self, t: float) -> tuple[float, ...]:
        return self._known[round(t / self._step)][1]

    def amplitudes(self, t: float) -> tuple[float, ...]:
        return self._known[round(t / self._step)][2]
