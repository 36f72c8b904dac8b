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
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.files.arrays import Array, Mask
from pmr.system.assembly import Assembly
from pmr.system.body import clear_rows, is_round_off
from pmr.system.rows import TouchedWeights
from pmr.system.states import ContactRows
from pmr.system.system import Side

Number = TypeVar("Number", bound=np.generic)


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
        self._inputs, self._size = assembly.B.shape[1], assembly.size
        self._rope_paths = [names.index(path) for path in system.compliance.paths]
        self._bodies = [_BodyRows(assembly, name, names) for name in system.bodies if system.sides_of(name)]
        self._system, self._names, everywhere = system, names, (-np.inf, np.inf)
        self._ends = np.array([system.ranges.get(name, everywhere) for name in names]).T
        self._key, self._derivatives = b"", self._evaluate(np.clip(np.zeros(len(names)), *self._ends))

    def evaluate(self, s: Array) -> RowDerivatives:
        """Rows and their derivatives with the paths at s (P,) in m.

        The result is stored, and returned again if the next call has the same s.  An InputError is raised if a path
        leads a place to where its row is not defined.
        """
        if (key := s.tobytes()) != self._key:
            if np.any((s < self._ends[0]) | (s > self._ends[1])):
                self._system.side_coordinates(dict(zip(self._names, s, strict=True)))
            self._key, self._derivatives = key, self._evaluate(s)
        return self._derivatives

    def _evaluate(self, s: Array) -> RowDerivatives:
        """Rows and their derivatives with the paths at s (P,) in m, always computed anew."""
        compliance, n, i, P = self._system.compliance, self._size, self._inputs, len(self._names)
        m = len(compliance.constant)
        rows = _zero_rows(m, n, i)
        slopes, curves = _zero_rows(m, n, i, P), _zero_rows(m, n, i, P, P)
        rows.F[:] = compliance.matrix(s[self._rope_paths])
        np.add.at(slopes.F, self._rope_paths, compliance.slopes)
        for body in self._bodies:
            body.add(s, rows, slopes, curves)
        rigid = is_round_off(rows.F, self._system.largest_flexibility)
        for part in (rows, slopes, curves):
            clear_rows(part.F, rigid)
        return RowDerivatives(rows, slopes, curves)


@dataclass(frozen=True)
class RowDerivatives:
    """Rows of m contacts at given coordinates of P paths, with their derivatives; effects on outputs are left empty."""

    rows: ContactRows
    slopes: ContactRows  # (P, ...): first derivatives by each path coordinate
    curves: ContactRows  # (P, P, ...): second derivatives by two path coordinates

    def time_derivatives(self, rates: Array) -> list[ContactRows]:
        """List the first and second derivatives of the rows by time, for P paths with constant `rates` (P,) in m/s."""
        first = (np.tensordot(rates, A, 1) for A in vars(self.slopes).values())
        second = (np.tensordot(rates, np.tensordot(rates, A, 1), 1) for A in vars(self.curves).values())
        return [ContactRows(*first), ContactRows(*second)]


def _zero_rows(m: int, n: int, i: int, *paths: int) -> ContactRows:
    """Zeros for the rows of m contacts on n coordinates and i inputs.

    `paths` are the sizes of further axes in front of those of the rows.
    """
    shapes = ((m, n), (m, m), (m, i), (0, m))
    return ContactRows(*(np.zeros((*paths, *shape)) for shape in shapes))


class _BodyRows:
    """Contributions of one body to the rows of contacts: k sides that touch d carriers each, as polynomials."""

    def __init__(self, assembly: Assembly, name: str, names: Sequence[str]) -> None:
        """Collect the rows of the body `name` of the assembly as functions of the P paths called `names`."""
        system = assembly.system
        self._carriers = system.bodies[name].carriers
        assert self._carriers is not None
        self._values = self._carriers.values[:, assembly.free_coordinates[name]]
        self._coordinates, self._inputs = assembly.coordinate_slices[name], assembly.input_slices[name]
        sides: list[Side] = [system.sides[number] for number in system.sides_of(name)]
        rows = [system.row(side.place) for side in sides]
        self._contacts, k = np.array([side.contact for side in sides]), len(sides)
        self._path = np.array([-1 if (path := side.place.path) is None else names.index(path) for side in sides])
        self._start, self._rate = (
            np.array([getattr(side.place, what) for side in sides], float) for what in ("at", "rate")
        )
        self._signs = np.array([side.sign for side in sides], float)
        self._breaks = [row.breaks for row in rows]
        self._ends = np.array([[row.breaks[0], row.breaks[-1]] for row in rows]).T
        self._powers, d = (max(row.coefficients.shape[axis] for row in rows) for axis in (0, 2))
        self._touched = [_pad_to_shape(row.touched, row.touched.shape[0], d) for row in rows]
        self._coefficients = [
            _pad_to_shape(row.coefficients, self._powers, row.coefficients.shape[1], d) for row in rows
        ]
        # shape of the weights of all sides (contacts, k d), and the indices of each side's weights in it
        self._weights_shape = (len(system.contacts), k * d)
        self._at = self._contacts[:, None], np.arange(k * d).reshape(k, d)

    def _weights(self, s: Array) -> TouchedWeights:
        """Numbers (k d,) of the carriers that the sides touch, and their weights with two derivatives by s (3, k, d).

        The paths are at s (P,) in m.  The weights have the signs of their sides.  A side beyond an end of its row
        counts as at this end.
        """
        travelling = self._path >= 0
        x = np.clip(self._start + np.where(travelling, self._rate * s[self._path], 0.0), *self._ends)
        number = [
            min(max(int(breaks.searchsorted(at, side="right")) - 1, 0), len(breaks) - 2)
            for breaks, at in zip(self._breaks, x, strict=True)
        ]
        touched = np.concatenate([of_side[j] for of_side, j in zip(self._touched, number, strict=True)])
        c = np.array([of_side[:, j] for of_side, j in zip(self._coefficients, number, strict=True)])  # (k, powers, d)
        beyond = x - [breaks[j] for breaks, j in zip(self._breaks, number, strict=True)]
        exponents, powers = np.arange(self._powers - 1, -1, -1), np.zeros((3, len(x), self._powers))
        factor, rate = np.ones(len(exponents)), np.where(travelling, self._rate, 0.0)
        for order in range(3):
            exponent = np.maximum(exponents - order, 0)
            powers[order] = factor * beyond[:, None] ** exponent * (self._signs * rate**order)[:, None]
            factor = factor * (exponents - order)
        return TouchedWeights(touched, np.einsum("jkp,kpd->jkd", powers, c))

    def add(self, s: Array, rows: ContactRows, slopes: ContactRows, curves: ContactRows) -> None:
        """Add to `rows`, `slopes` and `curves`, in place, what this body contributes with the paths at s (P,) in m.

        `rows` are those of all contacts, `slopes` their first and `curves` their second derivatives by s.
        """
        assert self._carriers is not None
        touched, weights = self._weights(s)
        flexibility, P = self._carriers.flexibility, len(s)
        b, b_s, b_ss = (
            np.zeros(self._weights_shape),
            np.zeros((P, *self._weights_shape)),
            np.zeros((P, *self._weights_shape)),
        )
        b[self._at] = weights[0]
        for path in set(self._path.tolist()) - {-1}:
            for by_path, derivative in ((b_s, weights[1]), (b_ss, weights[2])):
                by_path[path][self._at] = np.where((self._path == path)[:, None], derivative, 0.0)
        each, measures = np.arange(P), [(("C", self._coordinates), self._values)]
        if flexibility is not None:
            measures.append((("H", self._inputs), flexibility.inputs))
        for (what, columns), values in measures:
            on = values[touched]
            getattr(rows, what)[:, columns] += b @ on
            getattr(slopes, what)[:, :, columns] += b_s @ on
            getattr(curves, what)[each, each, :, columns] += b_ss @ on
        if flexibility is None:
            return
        R = flexibility.rows[touched[:, None], touched]
        Rb = (R + R.T) / 2.0 @ b.T
        rows.F[:] += b @ Rb
        slope, curve, mixed = b_s @ Rb, b_ss @ Rb, b_s @ ((R + R.T) / 2.0)
        slopes.F[:] += slope + slope.transpose(0, 2, 1)
        curves.F[each, each] += curve + curve.transpose(0, 2, 1)
        crossed = np.einsum("pma,qna->pqmn", mixed, b_s)
        curves.F[:] += crossed + crossed.transpose(0, 1, 3, 2)


def _pad_to_shape(values: NDArray[Number], *shape: int) -> NDArray[Number]:
    """Pad `values` with zeros to `shape`, the shape of the result.

    The zeros are added at the start of the first axis (powers) and at the end of the last axis (carriers).
    """
    first = shape[0] - values.shape[0]
    wide = np.zeros(shape, values.dtype)
    wide[first:, ..., : values.shape[-1]] = values
    return wide


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

        The last few responses are stored, and returned again for the same s.
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
        near, gives = self._along.evaluate(s), self._gives
        rows, (first, second) = near.rows.select(gives), (part.select(gives) for part in near.time_derivatives(rate))
        bent, answer = np.split(rows.force_coefficients, [rows.C.shape[1]], axis=1)
        answer_rate = np.linalg.solve(rows.F, first.H - first.F @ answer)
        curve = -second.C.T @ answer - 2.0 * first.C.T @ answer_rate
        return np.asarray(curve - bent.T @ (second.H - second.F @ answer - 2.0 * first.F @ answer_rate))
