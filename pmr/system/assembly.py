"""A system of bodies as one set of equations: block matrices, and the contacts' rows at given places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.constraints.polynomials import evaluate
from pmr.system.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ContactRows:
    """The m contacts of a system at given places, T of them each or one, with n coordinates of all bodies."""

    C: Array  # ([T,] m, n)
    F: Array  # ([T,] m, m) m/N: residual flexibility and compliance, G + 1/k
    H: Array  # ([T,] m, i) m/N: what the i inputs move by themselves
    X: Array  # ([T,] o, m) m/N: what forces of contacts take from the o outputs by themselves

    def at(self, k: int) -> ContactRows:
        """At one of the places, by its number."""
        return ContactRows(self.C[k], self.F[k], self.H[k], self.X[k])

    def of(self, which: NDArray[np.bool_]) -> ContactRows:
        """None but some of the contacts (m,), at one place."""
        return ContactRows(self.C[which], self.F[np.ix_(which, which)], self.H[which], self.X[:, which])

    @cached_property
    def answers(self) -> Array:
        """F^-1 C and F^-1 H side by side, at one place."""
        return np.asarray(np.linalg.solve(self.F, np.hstack([self.C, self.H])))


class Assembly:
    """All bodies' equations, on the n coordinates that no support holds; M, D, K, B and outputs are sparse."""

    def __init__(self, system: System) -> None:
        self.system, bodies = system, list(system.bodies.values())
        free = [np.setdiff1d(np.arange(body.size), list(body.held.values())) for body in bodies]
        of_bodies = list(zip(bodies, free, strict=True))
        # numbers of the coordinates of each body that its supports leave free
        self.free = dict(zip(system.bodies, free, strict=True))
        self.M, self.D, self.K = (_blocks([getattr(body, A)[np.ix_(i, i)] for body, i in of_bodies]) for A in "MDK")
        self.B = _blocks([body.B[i] for body, i in of_bodies])
        O = [body.outputs[:, i] for body, i in of_bodies]
        self.outputs = _blocks(O)
        # where those of each body, its inputs and its outputs stand among all
        self.coordinates = _slices(system, [len(i) for i in free])
        self.inputs = _slices(system, [len(body.input_names) for body in bodies])
        self.observed = _slices(system, [o.shape[0] for o in O])
        self.direct = np.zeros((self.outputs.shape[0], self.B.shape[1]))  # W = O R B (o, i) m/N
        self.energy = np.zeros((self.B.shape[1],) * 2)  # B^T R B (i, i) m/N
        for name, body in system.bodies.items():
            known = (body if body.carriers is None else body.carriers).flexibility
            if known is not None:
                self.direct[self.observed[name], self.inputs[name]] = known.direct
                self.energy[self.inputs[name], self.inputs[name]] = known.energy

    @property
    def size(self) -> int:
        return int(self.M.shape[0])

    def at(self, x: Array) -> ContactRows:
        """The contacts with their places at x (sides,) m, as `System.coordinates` has them."""
        return self.along(x[None]).at(0)

    def along(self, x: Array) -> ContactRows:
        """The contacts with their places at x (T, sides) m."""
        system = self.system
        T, m, i, o = len(x), len(system.contacts), self.B.shape[1], self.outputs.shape[0]
        C, H, X = np.zeros((T, m, self.size)), np.zeros((T, m, i)), np.zeros((T, o, m))
        F = np.zeros((T, m, m))
        F[:] = np.diag(system.compliance)
        found = ContactRows(C, F, H, X)
        for name, body in system.bodies.items():
            if on := system.sides_of(name):
                (self._add_tables if body.carriers is None else self._add_carried)(name, on, x.T[on], found)
        return ContactRows(C, (F + F.transpose(0, 2, 1)) / 2.0, H, X)

    def _add_carried(self, name: str, on: Sequence[int], x: Array, found: ContactRows) -> None:
        """What a body contributes with its sides, the `on`-th of all, at x (k, T) m."""
        sides, T, carriers = [self.system.sides[a] for a in on], x.shape[1], self.system.bodies[name].carriers
        assert carriers is not None
        weights = [side.sign * self.system.row(side.place).weights(at) for side, at in zip(sides, x, strict=True)]
        stacked, contacts = sp.vstack(weights, format="coo"), [side.contact for side in sides]
        for k, b in zip(contacts, weights, strict=True):
            found.C[:, k, self.coordinates[name]] += (b @ carriers.values)[:, self.free[name]]
            if carriers.flexibility is None:
                continue
            found.H[:, k, self.inputs[name]] += b @ carriers.flexibility.inputs
            found.X[:, self.observed[name], k] += b @ carriers.flexibility.outputs.T
            moved = stacked.data * (b @ carriers.flexibility.rows)[stacked.row % T, stacked.col]
            found.F[:, k, contacts] += np.bincount(stacked.row, moved, len(on) * T).reshape(-1, T).T

    def _add_tables(self, name: str, on: Sequence[int], x: Array, found: ContactRows) -> None:
        """The same of a body alone that has tables over its path, at one of whose places all its rows are."""
        body, sides = self.system.bodies[name], [self.system.sides[a] for a in on]
        s = next((at for side, at in zip(sides, x, strict=True) if side.place.path is not None), x[0])
        rows, contacts = [body.row_names.index(side.place.row) for side in sides], [side.contact for side in sides]
        found.C[:, contacts] = body.dense_rows(s)[:, rows][:, :, self.free[name]]
        if (known := body.flexibility) is not None:
            found.F[:, np.array(contacts)[:, None], contacts] += evaluate(known.rows, s)[:, rows][:, :, rows]
            found.H[:, contacts] = evaluate(known.inputs, s)[:, rows]
            found.X[:, :, contacts] = evaluate(known.outputs, s)[:, :, rows]

    def rates(self, x: Array, x_rate: Array) -> Array:
        """dC/dt (m, n) of the contacts with their places at x (sides,) m, which move by x_rate (sides,) m/s."""
        found = np.zeros((len(self.system.contacts), self.size))
        for side, at, rate in zip(self.system.sides, x, x_rate, strict=True):
            if rate != 0.0:
                body, name = self.system.bodies[side.place.body], side.place.body
                if body.carriers is None:
                    row = np.asarray(body.C(float(at), 1))[body.row_names.index(side.place.row)]
                else:
                    row = self.system.row(side.place).weights(at, 1).toarray()[0] @ body.carriers.values
                found[side.contact, self.coordinates[name]] += side.sign * rate * row[self.free[name]]
        return found

    def frequencies(self, x: Array, count: int) -> Array:
        """The lowest natural frequencies, ([S,] count) Hz, every contact closed, its places at x ([S,] sides) in m."""
        if x.ndim == 1:
            return np.asarray(self.frequencies(x[None], count)[0])
        M, K, rows, found = self.M.toarray(), self.K.toarray(), self.along(x), np.full((len(x), count), np.nan)
        for k, F_k in enumerate(rows.F):
            rigid = np.all(F_k == 0.0, axis=1)
            C, F = rows.C[k, ~rigid], F_k[np.ix_(~rigid, ~rigid)]
            held, free = K + C.T @ np.linalg.solve(F, C), M
            if rigid.any():
                Z = scipy.linalg.null_space(rows.C[k, rigid])
                held, free = Z.T @ held @ Z, Z.T @ M @ Z
            if not len(held):
                continue  # the contacts hold all coordinates
            omega2 = scipy.linalg.eigh(held, free, eigvals_only=True)[:count]
            found[k, : len(omega2)] = np.sqrt(np.maximum(omega2, 0.0)) / (2.0 * np.pi)
        return found


def _blocks(matrices: Sequence[Any]) -> sp.csr_matrix:
    return sp.block_diag([sp.csr_matrix(A) for A in matrices], format="csr")


def _slices(system: System, sizes: Any) -> dict[str, slice]:
    ends = np.cumsum([0, *sizes])
    return {name: slice(int(a), int(b)) for name, a, b in zip(system.bodies, ends[:-1], ends[1:], strict=True)}
