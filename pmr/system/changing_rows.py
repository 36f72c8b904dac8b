r"""Rows of a system's contacts as functions of its path coordinates s, with their first and second derivatives.

The weights b of all sides, at x = a + v s with constants a and v, are piecewise polynomials on the carriers U of each
body (`pmr.system.rows`).  With the basis Phi of a body, its residual flexibility R, its inputs B and the compliance 1/k
of the contacts themselves,

.. math::
    C = b\, U \Phi, \quad F = b\, (U R U^T)\, b^T + k^{-1}, \quad H = b\, U R B, \qquad
    \frac{\partial b}{\partial s_p} = v\, b'(x)

for the sides that travel on path p.  All derivatives are exact except at the ends of the polynomials' intervals.

Also the response of contacts that give way to inputs, and the derivatives of this response by the paths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pmr.errors import InputError
from pmr.files.arrays import Array, Mask
from pmr.system.assembly import Assembly
from pmr.system.body import clear_rows, is_round_off
from pmr.system.body_matrices import symmetric_part
from pmr.system.states import ContactRows


class ChangingRows:
    """Rows of a system on carriers and their derivatives, as functions of P paths with the given `names`.

    An InputError is raised if a body with contacts has tables over its path instead of carriers.
    """

    def __init__(self, assembly: Assembly, names: Sequence[str]) -> None:
        """Prepare the rows of the assembly's contacts as functions of the P paths called `names`."""
        system = assembly.system
        for name, body in system.bodies.items():
            if body.carriers is None and system.sides_of(name):
                allowed = "a body whose rows are on carriers is allowed, as reduction.basis = 'free_modes' makes them"
                raise InputError("system", f"bodies.{name}.carriers", None, allowed)
        self._assembly, self._system, self._names = assembly, system, names
        self._key, self._derivatives = b"", list[ContactRows]()

    def evaluate(self, s: Array) -> RowDerivatives:
        """Rows and their derivatives by each path, with the paths at s (P,) in m.

        The result is stored, and returned again if the next call has the same s.  An InputError is raised if a path
        leads a place to where its row is not defined.
        """
        if (key := s.tobytes()) != self._key:
            self._key, self._derivatives = key, self._rows_and_rates(s, np.eye(len(s)), 1)
        return RowDerivatives(*self._derivatives)

    def time_derivatives(self, s: Array, rates: Array) -> RowDerivatives:
        """First and second derivatives of the rows by time, with the paths at s (P,) in m and constant `rates` (P,).

        The `rates` are in m/s; errors as `evaluate`.
        """
        of_time = self._rows_and_rates(s, rates[None], 2)[1:]
        return RowDerivatives(*(ContactRows(*(array[0] for array in vars(rows).values())) for rows in of_time))

    def _rows_and_rates(self, s: Array, rates: Array, highest: int) -> list[ContactRows]:
        """List of the rows with the paths at s (P,) in m, and of their derivatives by time up to the order `highest`.

        `highest` is 1 or 2.  The derivatives are those for each of Q rates in `rates` (Q, P) in m/s, along an axis of Q
        in front.
        """
        a, system = self._assembly, self._system
        x = system.side_coordinates(dict(zip(self._names, s, strict=True)))
        v = system.side_rates(dict(zip(self._names, rates.T, strict=True)))
        ropes, compliance = [self._names.index(path) for path in system.compliance.paths], system.compliance
        m, n, i = len(system.contacts), a.size, a.B.shape[1]
        orders = [_zero_rows(m, n, i, *([len(rates)] if order else [])) for order in range(highest + 1)]
        orders[0].F[:] = compliance.matrix(s[ropes])
        orders[1].F[:] = np.tensordot(rates[:, ropes], compliance.slopes, 1)
        for name in system.bodies:
            if not system.sides_of(name):
                continue
            carriers = system.bodies[name].carriers
            assert carriers is not None
            touched, owners, weights = a.side_weights(name, x)
            speeds = v[:, None, owners]
            b = [weights[0], *(weights[order] * speeds**order for order in range(1, highest + 1))]
            values = carriers.values[touched][:, a.free_coordinates[name]]
            for rows, of_order in zip(orders, b, strict=True):
                rows.C[..., a.coordinate_slices[name]] += of_order @ values
                if carriers.flexibility is not None:
                    rows.H[..., a.input_slices[name]] += of_order @ carriers.flexibility.inputs[touched]
            if carriers.flexibility is not None:
                R = symmetric_part(carriers.flexibility.rows[touched[:, None], touched])
                for rows, of_order, times in zip(orders, b, (1.0, 2.0, 2.0), strict=False):
                    rows.F[:] += times * symmetric_part(of_order @ (R @ b[0].T))
                if highest > 1:
                    orders[2].F[:] += 2.0 * b[1] @ R @ b[1].transpose(0, 2, 1)
        rigid = is_round_off(orders[0].F, system.largest_flexibility)
        for rows in orders:
            clear_rows(rows.F, rigid)
        return orders


class RowDerivatives(NamedTuple):
    """Rows of m contacts with derivatives by P paths, or two derivatives by time; effects on outputs are left empty."""

    rows: ContactRows  # or their first derivatives by time
    slopes: ContactRows  # (P, ...): first derivatives by each path coordinate; or second derivatives by time


def _zero_rows(m: int, n: int, i: int, *axes: int) -> ContactRows:
    """Zeros for the rows of m contacts on n coordinates and i inputs.

    `axes` are the sizes of further axes in front of those of the rows.
    """
    shapes = ((m, n), (m, m), (m, i), (0, m))
    return ContactRows(*(np.zeros((*axes, *shape)) for shape in shapes))


@dataclass(frozen=True)
class InputResponse:
    """Forces B f on n coordinates by inputs f (i,), and displacements B^T q + E f (i,) at the inputs' points."""

    B: Array  # (n, i)
    E: Array  # (i, i) m/N
    B_slope: Array  # d B / d s, (P, n, i)
    E_slope: Array  # (P, i, i)

    def select(self, numbers: list[int]) -> InputResponse:
        """Response to the inputs with these `numbers`, at the points of these inputs alone."""
        E, E_slope = (of[..., numbers, :][..., numbers] for of in (self.E, self.E_slope))
        return InputResponse(self.B[:, numbers], E, self.B_slope[:, :, numbers], E_slope)


class EliminatedContacts:
    """Response of a system on n coordinates to inputs, after contacts that give way and hold both ways are eliminated.

    The mask `gives` (m,) selects these contacts, and is false for rigid contacts and for pads that only push.
    """

    def __init__(self, assembly: Assembly, along: ChangingRows, gives: Mask) -> None:
        """Prepare the response of `assembly`; `along` are the rows of its contacts as functions of P paths."""
        self._along, self._gives = along, gives
        self._B, self._E = assembly.B.toarray(), assembly.energy
        self._stored = dict[bytes, InputResponse]()

    def response(self, s: Array) -> InputResponse:
        """Response to inputs with the paths at s (P,) m: its matrices B and E, and their derivatives by s.

        If no contact gives way, B and E are those of the assembly, and the derivatives are zero.  The last few
        responses are stored, and returned again for the same s.
        """
        key = s.tobytes()
        if key not in self._stored:
            B, E = self._B, self._E
            B_slope, E_slope = np.zeros((len(s), *B.shape)), np.zeros((len(s), *E.shape))
            if self._gives.any():
                near = self._along.evaluate(s)
                rows, slopes = near.rows.select(self._gives), near.slopes.select(self._gives)
                bent, answer = np.split(rows.force_coefficients, [rows.C.shape[1]], axis=1)
                turned = slopes.H - slopes.F @ answer
                B, B_slope = B - rows.C.T @ answer, -slopes.C.transpose(0, 2, 1) @ answer - bent.T @ turned
                E, E_slope = E - rows.H.T @ answer, -answer.T @ turned - slopes.H.transpose(0, 2, 1) @ answer
            self._stored = dict(list(self._stored.items())[-4:]) | {key: InputResponse(B, E, B_slope, E_slope)}
        return self._stored[key]

    def curve(self, s: Array, rate: Array) -> Array:
        """Sum (n, i) over paths j and k of (d^2 B / d s_j d s_k) s_j' s_k', for paths at s (P,) in m.

        The rates s' of the paths are `rate` (P,) in m/s.
        """
        if not (self._gives.any() and rate.any()):
            return np.zeros_like(self._B)
        rows, derivatives = self._along.evaluate(s).rows.select(self._gives), self._along.time_derivatives(s, rate)
        first, second = (part.select(self._gives) for part in derivatives)
        bent, answer = np.split(rows.force_coefficients, [rows.C.shape[1]], axis=1)
        answer_rate = np.linalg.solve(rows.F, first.H - first.F @ answer)
        curve = -second.C.T @ answer - 2.0 * first.C.T @ answer_rate
        return np.asarray(curve - bent.T @ (second.H - second.F @ answer - 2.0 * first.F @ answer_rate))
