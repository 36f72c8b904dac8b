"""Rows of a system's contacts at given places, and the stiffness of those that give way."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Flexibility of a contact below this share of the largest is round-off of a rigid one.
ROUND_OFF = 1e-14


def is_round_off(F: Array, largest: float = 0.0) -> NDArray[np.bool_]:
    """Whether contacts (..., m) with flexibility F (..., m, m) in m/N are rigid, but for round-off.

    The diagonal decides, as F is semidefinite.  `largest` is the largest flexibility of the bodies in m/N, where that
    is known: that of all contacts may be round-off.
    """
    diagonal = np.diagonal(F, axis1=-2, axis2=-1)
    most = np.maximum(diagonal.max(axis=-1, keepdims=True, initial=0.0), largest)
    return np.asarray(diagonal <= ROUND_OFF * most)


def clear_rows(F: Array, which: NDArray[np.bool_]) -> None:
    """Set rows and columns of F (..., m, m) of some contacts (..., m) to zero, in place."""
    F[np.broadcast_to(which[..., :, None] | which[..., None, :], F.shape)] = 0.0


@dataclass(frozen=True)
class ContactRows:
    """The m contacts of a system at given places, T of them each or one, with n coordinates of all bodies."""

    C: Array  # ([T,] m, n)
    F: Array  # ([T,] m, m) m/N: residual flexibility and compliance, G + 1/k
    H: Array  # ([T,] m, i) m/N: what the i inputs move by themselves
    X: Array  # ([T,] o, m) m/N: what forces of contacts take from the o outputs by themselves

    def at(self, k: int) -> ContactRows:
        """Rows of the contacts at one of the places, by its number."""
        return ContactRows(self.C[k], self.F[k], self.H[k], self.X[k])

    def part(self, places: slice) -> ContactRows:
        """At some of the places."""
        return ContactRows(self.C[places], self.F[places], self.H[places], self.X[places])

    def of(self, which: NDArray[np.bool_]) -> ContactRows:
        """Rows of some of the contacts (m,) alone, at one place."""
        return ContactRows(self.C[which], self.F[np.ix_(which, which)], self.H[which], self.X[:, which])

    def unit(self, K: Any) -> float:
        """Unit of forces: the size of the stiffness K (n, n) or, of rigid motions alone, of contacts."""
        flexibility = abs(self.F).max(initial=0.0)
        return float(abs(K).max() or (abs(self.C).max() ** 2 / flexibility if flexibility else 1.0))

    @cached_property
    def answers(self) -> Array:
        """F^-1 C and F^-1 H side by side, at one place."""
        return np.asarray(np.linalg.solve(self.F, np.hstack([self.C, self.H])))

    @property
    def rigid(self) -> NDArray[np.bool_]:
        """([T,] m): which do not give way."""
        return is_round_off(self.F)


def add_springs(K: Array, rows: ContactRows) -> Array:
    """Add the stiffness of the contacts that give way to K (n, n)."""
    soft = rows.of(~rows.rigid)
    return np.asarray(K + soft.C.T @ np.linalg.solve(soft.F, soft.C))


def left_free(C: Array) -> Array | None:
    """A basis (n, k) of what rigid contacts C (m, n) leave free; None without any."""
    return scipy.linalg.null_space(C) if len(C) else None
