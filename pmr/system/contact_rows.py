r"""Rows of a system's contacts at given coordinates, and the stiffness of compliant contacts.

Compliant rows are eliminated: they are springs that travel with the slider, and no constraint is left.  With the
flexibility F(s) = G(s) + 1/k, of the residual flexibility G and the compliance 1/k of pads,

.. math::
    \lambda = F^{-1} (C q + H f), \qquad
    M \ddot q + D \dot q + \big( K + C^T F^{-1} C \big) q = \big( B - C^T F^{-1} H \big) f

which is an ordinary second-order system whose stiffness and inputs depend on s.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from pmr.errors import SimulationError
from pmr.files.arrays import Array, Mask
from pmr.system.body import SlidingBody
from pmr.system.polynomials import power_contributions

#: Flexibility of a contact below this share of the largest is round-off of a rigid one.
ROUND_OFF = 1e-14


def is_round_off(F: Array, largest: float = 0.0) -> Mask:
    """Mask (..., m) of m contacts that are rigid: their flexibility, in F (..., m, m) in m/N, is round-off.

    The diagonal entry of a rigid contact is at most `ROUND_OFF` times the largest entry, or times `largest` if that is
    more.  `largest` is the largest flexibility of the bodies in m/N, needed because all of F may be round-off.
    """
    diagonal = np.diagonal(F, axis1=-2, axis2=-1)
    most = np.maximum(diagonal.max(axis=-1, keepdims=True, initial=0.0), largest)
    return np.asarray(diagonal <= ROUND_OFF * most)


def clear_rows(F: Array, mask: Mask) -> None:
    """Set to zero, in place, the rows and columns of the contacts in a `mask` (..., m) of F (..., m, m)."""
    F[np.broadcast_to(mask[..., :, None] | mask[..., None, :], F.shape)] = 0.0


@dataclass(frozen=True)
class ContactRows:
    """Rows of m contacts at given coordinates of their places, at one time or at T times, on n coordinates."""

    C: Array  # ([T,] m, n)
    F: Array  # ([T,] m, m) m/N: G + 1/k, residual flexibility plus compliance
    H: Array  # ([T,] m, i) m/N: motion of the contacts that i unit inputs cause by the residual flexibility
    X: Array  # ([T,] o, m) m/N: reduction of o outputs that unit contact forces cause by this flexibility

    def at_time(self, k: int) -> ContactRows:
        """Rows of the contacts at the time with number k; only for rows at T times."""
        return ContactRows(self.C[k], self.F[k], self.H[k], self.X[k])

    def select(self, mask: Mask) -> ContactRows:
        """Rows of those contacts alone that are in a `mask` (m,)."""
        F = self.F[..., mask, :][..., mask]
        return ContactRows(self.C[..., mask, :], F, self.H[..., mask, :], self.X[..., mask])

    def force_scale(self, K: sp.csr_matrix | Array) -> float:
        """Factor by which contact equations are scaled: the largest entry of the stiffness K (n, n).

        If K is zero, as for rigid motions, it is the square of the largest entry of C over the largest entry of F, or 1
        if F is zero.
        """
        flexibility = abs(self.F).max(initial=0.0)
        return float(abs(K).max() or (abs(self.C).max() ** 2 / flexibility if flexibility else 1.0))

    @cached_property
    def force_coefficients(self) -> Array:
        """Contact forces (m, n + i) at one time by unit coordinates, F^-1 C, then by unit inputs, F^-1 H."""
        return np.asarray(np.linalg.solve(self.F, np.hstack([self.C, self.H])))

    @property
    def rigid(self) -> Mask:
        """Mask (m,), or (T, m) at T times, of the contacts that are rigid: their flexibility F is zero or round-off."""
        return is_round_off(self.F)


def add_springs(K: Array, rows: ContactRows) -> Array:
    """Return K (n, n) plus the stiffness C^T F^-1 C (n, n) of those contacts of `rows` that are not rigid."""
    soft = rows.select(~rows.rigid)
    return np.asarray(K + soft.C.T @ np.linalg.solve(soft.F, soft.C))


def free_motions(C: Array) -> Array | None:
    """Orthonormal basis (n, k) of the motions that rigid contacts C (m, n) leave free; None if m is 0."""
    return scipy.linalg.null_space(C) if len(C) else None


#: Smallest eigenvalue of F, after scaling to a unit diagonal, with which F can be inverted.
REGULAR = 1e-13


def compliant_rows(body: SlidingBody) -> list[int]:
    """Numbers of the rows of a body that have flexibility: residual flexibility, or the compliance of a pad."""
    F = np.diag(body.row_compliance)
    if body.flexibility is not None:
        F = F + np.abs(power_contributions(body.flexibility.rows)).max(axis=(0, 1))
    return np.flatnonzero(~is_round_off(F)).tolist()


def check_determined(F: Array, names: Sequence[str], where: Callable[[int], str]) -> None:
    """Raise a SimulationError if a flexibility F (T, m, m) in m/N of the rows `names` (m,) is singular at some time.

    The forces of the rows are then not determined, as of a slider on a support, or of two sliders at one point.
    ``where(k)`` is the beginning of the message about the time with number k.
    """
    if not len(names):
        return
    scale = np.sqrt(np.maximum(np.einsum("tmm->tm", F), np.finfo(float).tiny))
    regular = np.linalg.eigvalsh(F / (scale[:, :, None] * scale[:, None, :]))[:, 0] > REGULAR
    regular &= ~is_round_off(F).any(axis=1)
    if not regular.all():
        place = where(int(np.argmin(regular)))
        raise SimulationError(f"{place}: the forces of the rows {', '.join(names)} are not determined there")
