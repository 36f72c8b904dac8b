r"""Rows of a system's contacts at given places, and the stiffness of those that give way.

Rows that give way, eliminated: springs that travel with the slider, and no constraint is left.

With F(s) = G(s) + 1/k the residual flexibility and the pads' compliance,

.. math::
    \lambda = F^{-1} (C q + H f), \qquad
    M \ddot q + D \dot q + \big( K + C^T F^{-1} C \big) q = \big( B - C^T F^{-1} H \big) f

which is an ordinary second-order system whose stiffness and inputs depend on s.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.constraints.polynomials import contributions, evaluate
from pmr.errors import SimulationError
from pmr.system.body import SlidingBody

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

    def of(self, which: NDArray[np.bool_]) -> ContactRows:
        """Rows of some of the contacts (m,) alone."""
        F = self.F[..., which, :][..., which]
        return ContactRows(self.C[..., which, :], F, self.H[..., which, :], self.X[..., which])

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


#: Smallest eigenvalue of F, scaled to a unit diagonal, with which it can be inverted.
REGULAR = 1e-13


def compliant_rows(body: SlidingBody) -> list[int]:
    """Numbers of the rows that give way: by the residual flexibility, or at a pad."""
    F = np.diag(body.row_compliance)
    if body.flexibility is not None:
        F = F + np.abs(contributions(body.flexibility.rows)).max(axis=(0, 1))
    return np.flatnonzero(~is_round_off(F)).tolist()


class CompliantRows:
    """The rows of a body that give way, at any path coordinate."""

    def __init__(self, body: SlidingBody) -> None:
        self._body, self.numbers = body, compliant_rows(body)
        self._round_off = np.zeros(len(self.numbers))
        if body.flexibility is not None:
            largest = np.abs(contributions(body.flexibility.rows)).max(axis=(0, 1))
            self._round_off = 4.0 * np.finfo(float).eps * np.diag(largest)[self.numbers]

    def check(self, s: Array) -> None:
        """Raise a SimulationError where F(s) = G(s) + 1/k is singular at one of s (T,) m.

        There a slider sits on a support, or two sit in one place.
        """
        if not self.numbers:
            return
        body, which = self._body, np.ix_(self.numbers, self.numbers)
        F = np.broadcast_to(np.diag(body.row_compliance)[which], (len(s), len(self.numbers), len(self.numbers)))
        if body.flexibility is not None:
            F = F + evaluate(body.flexibility.rows, s)[:, which[0], which[1]]
        scale = np.einsum("tmm->tm", F)
        regular = np.all(scale > self._round_off, axis=1)
        scale = np.sqrt(np.maximum(scale, 0.0))
        scaled = F[regular] / (scale[regular, :, None] * scale[regular, None, :])
        regular[regular] = np.linalg.eigvalsh(scaled)[:, 0] > REGULAR
        if not regular.all():
            names = ", ".join(body.row_names[i] for i in self.numbers)
            at = s[np.argmin(regular)]
            raise SimulationError(
                f"slider at {at:g} m: the forces of the rows {names} are not determined there (a slider on a "
                "support, or two in one place)"
            )
