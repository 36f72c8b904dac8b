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
from pmr.system.terms import added

Array = NDArray[np.float64]

#: (rad/s)^2: what nothing holds is not singular with it.
SHIFT = 1.0


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

    def unit(self, K: Any) -> float:
        """Of forces, the size of the stiffness K (n, n) or, of rigid motions alone, of contacts: rows of one size."""
        flexibility = abs(self.F).max(initial=0.0)
        return float(abs(K).max() or (abs(self.C).max() ** 2 / flexibility if flexibility else 1.0))

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
        numbers, count = dict[str, NDArray[np.int64]](), 0
        for name, body in system.bodies.items():
            numbers[name] = np.full(body.size, -1, np.int64)
            numbers[name][self.free[name]] = count + np.arange(len(self.free[name]))
            count += len(self.free[name])
        self.terms = [term.among(numbers, count) for term in system.terms]  # sparse, on the same coordinates
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

    def stiffness(self, c: Sequence[float] | Array = ()) -> sp.csr_matrix:
        """K + sum_k c_k G_k with amplitudes c (k,) of the system's terms, in their order; none leave K alone."""
        return added(self.K, self.terms, "stiffness", c)

    def damping(self, c: Sequence[float] | Array = ()) -> sp.csr_matrix:
        """D + sum_k c_k V_k, likewise."""
        return added(self.D, self.terms, "damping", c)

    def term_forces(self, q: Array, v: Array, c: Array) -> Array:
        """-sum_k c_k (V_k v + G_k q), (T, n) N, of coordinates and rates (T, n) and amplitudes c (T, k)."""
        found = np.zeros_like(q)
        for term, amplitude in zip(self.terms, c.T, strict=True):
            for A, moved in ((term.stiffness, q), (term.damping, v)):
                if A is not None:
                    found -= amplitude[:, None] * (A @ moved.T).T
        return found

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

    def answers(self, rows: ContactRows, omega: Array, c: Sequence[float] | Array = ()) -> NDArray[np.complex128]:
        r"""What outputs and forces of contacts (W, o + m, i) answer to a unit of each input at omega (W,) in rad/s.

        .. math::
            (-\omega^2 M + i \omega D + K)\, q + C^T \lambda = B f, \qquad C q + H f - F \lambda = 0, \qquad
            y = O q + W f - X \lambda

        with every contact closed, amplitudes c (k,) of the terms in K and D.  A LinAlgError is raised where they do not
        hold the bodies at rest.
        """
        M, D, K, B = (A.toarray() for A in (self.M, self.damping(c), self.stiffness(c), self.B))
        n, scale = len(K), rows.unit(K)
        held = np.block([[K, scale * rows.C.T], [scale * rows.C, -(scale**2) * rows.F]]).astype(complex)
        right, O, found = np.vstack([B, -scale * rows.H]), self.outputs.toarray(), list[Array]()
        for w in omega:
            matrix = held.copy()
            matrix[:n, :n] += 1j * w * D - w**2 * M
            q, forces = np.vsplit(np.linalg.solve(matrix, right), [n])
            found.append(np.vstack([O @ q + self.direct - rows.X @ (scale * forces), scale * forces]))
        return np.array(found)

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

    def frequencies(self, x: Array, count: int, c: Array | None = None) -> Array:
        """The lowest natural frequencies, ([S,] count) Hz, every contact closed, its places at x ([S,] sides) in m.

        Terms have amplitudes c ([S,] k), zero by default.  Of their matrices the symmetric stiffness counts and the
        gyroscopic, antisymmetric part of what acts on rates: the rest damps, or turns faster and faster.  At the
        buckling load and beyond the lowest is 0 Hz.
        """
        if x.ndim == 1:
            return np.asarray(self.frequencies(x[None], count, None if c is None else c[None])[0])
        rows, found = self.along(x), np.full((len(x), count), np.nan)
        amplitudes = np.zeros((len(x), len(self.terms))) if c is None else c
        for k in range(len(x)):
            K = self.stiffness(amplitudes[k]).toarray()
            V = self.damping(amplitudes[k]) - self.D
            M, V, (K, Z) = self.M.toarray(), (V - V.T).toarray() / 2.0, _closed((K + K.T) / 2.0, rows.at(k))
            if Z is not None:
                M, K, V = (Z.T @ A @ Z for A in (M, K, V))
            if not len(K):
                continue  # the contacts hold all coordinates
            omega = oscillations(M, V, K)[:count]
            found[k, : len(omega)] = omega / (2.0 * np.pi)
        return found

    def modes(self, x: Array, count: int, c: Array | Sequence[float] = ()) -> tuple[Array, Array]:
        """The lowest modes, every contact closed, its places at x (sides,) m: omega (f,) and phi (n, f).

        Omega in rad/s, ascending; phi^T M phi = 1, phi in 1/sqrt(kg).  Fewer than `count` where there are no more.
        Of terms with amplitudes c (k,) the symmetric stiffness counts; at the buckling load and beyond omega is 0.
        """
        M, stiffness = self.M.toarray(), self.stiffness(c).toarray()
        K, Z = _closed((stiffness + stiffness.T) / 2.0, self.at(x))
        K = K + SHIFT * M
        if Z is not None:
            M, K = Z.T @ M @ Z, Z.T @ K @ Z
        if len(c) and scipy.linalg.eigvalsh(K, subset_by_index=(0, 0))[0] <= 0.0:  # nothing holds it
            omega2, phi = scipy.linalg.eigh(K, M, subset_by_index=(0, min(count, len(K)) - 1))
            return np.sqrt(np.maximum(omega2 - SHIFT, 0.0)), phi if Z is None else Z @ phi
        # the largest of the inverse: low modes to full relative accuracy
        inverse, z = scipy.linalg.eigh(M, K, subset_by_index=(max(len(K) - count, 0), len(K) - 1))
        phi = z[:, ::-1] / np.sqrt(inverse[::-1])
        return np.sqrt(np.maximum(1.0 / inverse[::-1] - SHIFT, 0.0)), phi if Z is None else Z @ phi


def _closed(K: Array, rows: ContactRows) -> tuple[Array, Array | None]:
    """K (n, n) with the contacts that give way, and a basis (n, k) of what rigid ones leave free; None without any."""
    rigid = np.all(rows.F == 0.0, axis=1)
    soft = rows.of(~rigid)
    K = K + soft.C.T @ np.linalg.solve(soft.F, soft.C)
    return K, scipy.linalg.null_space(rows.C[rigid]) if rigid.any() else None


def oscillations(M: Array, V: Array, K: Array) -> Array:
    """Omega (n,) rad/s of M q'' + V q' + K q = 0 with an antisymmetric V, ascending; zero where K does not hold.

    With modes of K, of rates z' and strains omega z the equations are antisymmetric, (0, W; -W, -V): round-off stays
    that of the largest omega, not of its square.
    """
    if not np.any(V):
        return np.sqrt(np.maximum(scipy.linalg.eigh(K, M, eigvals_only=True), 0.0))
    omega2, X = scipy.linalg.eigh(K, M)
    W = np.diag(np.sqrt(np.maximum(omega2, 0.0)))
    turning = np.block([[np.zeros_like(W), W], [-W, -X.T @ V @ X]])
    return np.asarray(np.abs(scipy.linalg.eigvalsh(1j * (turning - turning.T) / 2.0)[len(W) :]))


def _blocks(matrices: Sequence[Any]) -> sp.csr_matrix:
    return sp.block_diag([sp.csr_matrix(A) for A in matrices], format="csr")


def _slices(system: System, sizes: Any) -> dict[str, slice]:
    ends = np.cumsum([0, *sizes])
    return {name: slice(int(a), int(b)) for name, a, b in zip(system.bodies, ends[:-1], ends[1:], strict=True)}
