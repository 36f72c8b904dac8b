"""A system's contacts where extensions stand, and how they change as these move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.exudyn.equations import Equations
from pmr.simulation.exudyn.paths import Paths
from pmr.system.contact_rows import ContactRows

Array = NDArray[np.float64]

#: m, to either side, for derivatives, once and twice: rows are piecewise polynomials of a few metres' length, known to
#: 1e-16 of their size.
SLOPE, CURVE = 1e-5, 1e-3


@dataclass(frozen=True)
class Near:
    """All contacts at extensions s (S,) m, their derivatives by each, and at three places `CURVE` apart on a line."""

    rows: ContactRows
    slopes: ContactRows  # (S, ...)
    line: ContactRows  # (3, ...)


class Along:
    """Contacts at extensions; the last are kept, for what needs them is asked one after the other."""

    def __init__(self, equations: Equations, paths: Paths) -> None:
        self._equations, self._paths = equations, paths
        count = len(paths.low)
        self._direction = np.ones(count) / np.sqrt(count)
        self._key, self._near = b"", self._at(np.clip(np.zeros(count), paths.low + CURVE, paths.high - CURVE))

    def at(self, s: Array, rate: Array | None = None) -> Near:
        """At s (S,) m, with a line along rates (S,) m/s if they are given."""
        if rate is not None and rate.any():
            direction = rate / np.linalg.norm(rate)
            direction *= np.sign(direction[np.argmax(np.abs(direction))])
            if np.abs(direction - self._direction).max() > 1e-9:
                self._key, self._direction = b"", direction
        if (key := s.tobytes()) != self._key:
            self._key, self._near = key, self._at(s)
        return self._near

    def _at(self, s: Array) -> Near:
        S, low, high = len(s), self._paths.low, self._paths.high
        after, before = np.minimum(s + SLOPE * np.eye(S), high), np.maximum(s - SLOPE * np.eye(S), low)
        aside = CURVE * self._direction
        middle = np.clip(s, low + CURVE, high - CURVE)
        places = np.vstack([s, after, before, middle - aside, middle, middle + aside])
        found = self._equations.rows(self._equations.system.coordinates(self._paths.named(places)))
        apart = np.maximum(np.diagonal(after - before), SLOPE)[:, None, None]
        slopes = ((A[1 : 1 + S] - A[1 + S : 1 + 2 * S]) / apart for A in vars(found).values())
        return Near(found.at(0), ContactRows(*slopes), found.part(slice(1 + 2 * S, None)))
