"""What contacts that give way answer to inputs and to a boom's own inertia, and how it changes as paths lead on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.floating import Extended, Moments
from pmr.simulation.free_base import FreeBase
from pmr.system.assembly import Assembly
from pmr.system.changing_rows import ChangingRows
from pmr.system.contact_rows import ContactRows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Answers:
    """Forces B f on coordinates (n,) by inputs f (i,), and displacements B^T q + E f (i,) where they act."""

    B: Array
    E: Array
    B_slope: Array  # d B / d s, (P, n, i)
    E_slope: Array  # (P, i, i)


class Answering:
    """Response of a boom on n coordinates to inputs, with contacts that give way and hold both ways.

    Rigid ones, and pads that only push, are left out.
    """

    def __init__(self, boom: FreeBase, assembly: Assembly, along: ChangingRows, gives: NDArray[np.bool_]) -> None:
        self._boom, self._along, self._gives = boom, along, gives
        self._B, self._E = assembly.B.toarray(), assembly.energy
        self._known, self._moments = dict[bytes, Answers](), (b"", boom.boom.moments)

    def moments(self, at: Extended) -> Moments:
        """Moments of the sections, with the response to inertia of contacts that give way."""
        key = at.value.tobytes() + at.rate.tobytes()
        if self._gives.any() and key != self._moments[0]:
            answers, of, B_curve = self.at(at.value), self._boom.moments, np.zeros_like(self._B)
            if at.rate.any():
                near, give = self._along.at(at.value), self._giving_rows
                rows, first, second = give(near.rows), *map(give, near.along(at.rate))
                answer, bent = _answers(rows)
                answer_rate = np.linalg.solve(rows.F, first.H - first.F @ answer)
                B_curve = -second.C.T @ answer - 2.0 * first.C.T @ answer_rate
                B_curve -= bent.T @ (second.H - second.F @ answer - 2.0 * first.F @ answer_rate)
            self._moments = key, Moments(of(answers.B), np.moveaxis(of(answers.B_slope), 0, -1), of(B_curve))
        return self._moments[1]

    def at(self, s: Array) -> Answers:
        """Response to inputs with the paths at s (P,) m."""
        key = s.tobytes()
        if key not in self._known:
            B, E = self._B, self._E
            B_slope, E_slope = np.zeros((len(s), *B.shape)), np.zeros((len(s), *E.shape))
            if self._gives.any():
                near = self._along.at(s)
                rows, slopes = self._giving_rows(near.rows), self._giving_rows(near.slopes)
                answer, bent = _answers(rows)
                turned = slopes.H - slopes.F @ answer
                B, B_slope = B - rows.C.T @ answer, -slopes.C.transpose(0, 2, 1) @ answer - bent.T @ turned
                E, E_slope = E - rows.H.T @ answer, -answer.T @ turned - slopes.H.transpose(0, 2, 1) @ answer
            self._known = dict(list(self._known.items())[-4:]) | {key: Answers(B, E, B_slope, E_slope)}
        return self._known[key]

    def _giving_rows(self, rows: ContactRows) -> ContactRows:
        gives = self._gives
        return ContactRows(rows.C[..., gives, :], rows.F[..., gives, :][..., gives], rows.H[..., gives, :], rows.X)


def _answers(rows: ContactRows) -> tuple[Array, Array]:
    """F^-1 H (m, i) and F^-1 C (m, n)."""
    bent, answer = np.split(rows.answers, [rows.C.shape[1]], axis=1)
    return answer, bent
