r"""A structure at rest under a load that grows: everything as a rational function of the load P.

.. math::
    (K + G_0 + P\, G_1)\, q + C^T \lambda = b_0 + P\, b_1, \qquad C q - F \lambda = g_0 + P\, g_1

with the geometric stiffness G_0 of what is there without the load, and G_1 of a unit of it.  With closed contacts that
do not change, A the flexibility under :math:`K + G_0`, :math:`A = L L^T`, :math:`L^T G_1 L = V \eta V^T` and U = L V,

.. math::
    q(P) = \bar q(P) - P\, U\, (I + P \eta)^{-1} U^T G_1\, \bar q(P), \qquad \bar q(P) = q_0 + P\, q_1

(Woodbury), where q_0 and q_1 are the linear answers.  So one factorisation gives all loads, and the structure buckles
where the first :math:`1 + P \eta_i` vanishes.  Contacts that only push open and close with the load: each set of closed
ones has a `Form` of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Share of the largest flexibility below which one is round-off; share of that of contacts below which a load's own
#: place gives way to nothing but round-off.
ROUND_OFF, RIGID = 1e-9, 1e-4
#: Pull or overlap that is round-off, over the largest force or displacement.
WRONG = 1e-9
#: Sets of closed contacts that are tried at one load.
MOST_SETS = 200


@dataclass(frozen=True)
class Equations:
    """What acts at one place, without the load and by a unit of it."""

    M: Array  # (n, n)
    K: Array  # (n, n)
    G: tuple[Array, Array]  # (n, n): geometric stiffness, of what is there and of a unit of the load
    b: tuple[Array, Array]  # (n,): loads on coordinates
    g: tuple[Array, Array]  # (m,): gaps minus what loads move at contacts by themselves
    C: Array  # (m, n)
    F: Array  # (m, m)
    outputs: Array  # (o, n)
    X: Array  # (o, m): what contact forces take from outputs by themselves
    direct: tuple[Array, Array]  # (o,): what loads add to them
    pushes: Mask  # (m,): contacts that only push
    # the load's inputs in its d directions: loads on coordinates (n, d), what they move at contacts (m, d) and at
    # their own place (d, d)
    on: tuple[Array, Array, Array]


@dataclass(frozen=True)
class State:
    """What a load makes: outputs (o,), contact forces (m,), and the form that it has; not finite past buckling."""

    load: float
    outputs: Array
    forces: Array
    form: Form

    @cached_property
    def stands(self) -> bool:
        return bool(np.isfinite(self.forces).all() and np.isfinite(self.outputs).all())


@dataclass(frozen=True)
class Condensed:
    """Matrices (r, r) on what rigid contacts leave free."""

    M: Array
    K: Array  # under what is there without the load
    G: tuple[Array, Array]  # geometric stiffness, of what is there and of a unit of the load
    place: Array  # (d, r): how the place of the load moves along its directions, m
    own: Array  # (n, r): coordinates of the structure
    gaps: Array  # (r, closed): what gaps at contacts that give way press with, of those that are closed


class Form:
    """Equilibria with a set of contacts closed (m,)."""

    def __init__(self, equations: Equations, closed: Mask) -> None:
        self.equations, self.closed = equations, closed
        e, n, m = equations, len(equations.K), int(closed.sum())
        C, F = e.C[closed], e.F[np.ix_(closed, closed)]
        K = e.K + e.G[0]
        scale = float(np.abs(K).max()) or 1.0
        units = np.concatenate([np.ones(n), np.full(m, scale)])
        matrix = np.block([[K, scale * C.T], [scale * C, -(scale**2) * F]])
        self.held, self.critical = False, 0.0
        try:
            Z = units[:, None] * np.linalg.inv(matrix) * units
        except np.linalg.LinAlgError:
            return
        flexibility = (Z[:n, :n] + Z[:n, :n].T) / 2.0
        if not np.isfinite(flexibility).all():
            return
        size, Q = np.linalg.eigh(flexibility)
        if size[0] < -ROUND_OFF * size[-1] or size[-1] * np.abs(K).max() > 1.0 / np.finfo(float).eps:
            return  # past buckling by what is there without the load, or nothing but round-off holds it
        L = _root(size, Q)
        self.eta, V = np.linalg.eigh(L.T @ e.G[1] @ L)
        least = float(self.eta[0]) if len(self.eta) else 0.0
        some = -least > ROUND_OFF * np.abs(self.eta).max(initial=0.0) and least < 0.0
        self.held, self.critical = True, -1.0 / least if some else np.inf
        self._answers(Z, L @ V)

    def _answers(self, Z: Array, U: Array) -> None:
        """Responses, which are outputs, forces and what contacts move, to both parts of the load and to U."""
        e, n, closed = self.equations, len(self.equations.K), self.closed
        m, o = len(closed), len(e.outputs)
        R = np.zeros((o + 2 * m, n + int(closed.sum())))
        R[:o, :n], R[:o, n:] = e.outputs, -e.X[:, closed]
        R[o : o + m][np.ix_(closed, np.arange(n, R.shape[1]))] = np.eye(int(closed.sum()))
        R[o + m :, :n], R[o + m :, n:] = e.C, -e.F[:, closed]
        z = [Z @ np.concatenate([b, g[closed]]) for b, g in zip(e.b, e.g, strict=True)]
        # contacts are closed where C q - F lambda = g: what is beyond that is told by the rest
        rest = [np.concatenate([d, np.zeros(m), -g]) for d, g in zip(e.direct, e.g, strict=True)]
        self._linear = [R @ one + more for one, more in zip(z, rest, strict=True)]
        Y = R @ (Z[:, :n] @ e.G[1])
        self._bent = [Y @ one[:n] for one in z]
        self._modal = Y @ U
        self._on_modes = [U.T @ (e.G[1] @ one[:n]) for one in z]

    def responses(self, load: float) -> Array:
        """Outputs, forces, and what contacts move beyond their gaps, (o + 2 m,); not finite where nothing stands."""
        if not self.held or load >= self.critical:
            return np.full(len(self.equations.outputs) + 2 * len(self.closed), np.nan)
        P, (r0, r1), (y0, y1), (u0, u1) = load, self._linear, self._bent, self._on_modes
        amplitudes = P * (u0 + P * u1) / (1.0 + P * self.eta)
        return np.asarray(r0 + P * r1 - P * (y0 + P * y1) + P * (self._modal @ amplitudes))

    @cached_property
    def _unstressed(self) -> tuple[Array, Array, Array, Array]:
        """Geometric stiffness on the root L of the unstressed flexibility, both parts; L; what loads press contacts."""
        e, closed, n = self.equations, self.closed, len(self.equations.K)
        scale, C, F = float(np.abs(e.K).max()) or 1.0, e.C[closed], e.F[np.ix_(closed, closed)]
        Z = np.linalg.inv(np.block([[e.K, scale * C.T], [scale * C, -(scale**2) * F]]))
        size, Q = np.linalg.eigh((Z[:n, :n] + Z[:n, :n].T) / 2.0)
        L = _root(size, Q)
        return L.T @ e.G[0] @ L, L.T @ e.G[1] @ L, L, scale * Z[n:, :n]

    def inverse_factor(self, load: float) -> float:
        """1 over the factor by which all axial forces would have to grow until it buckles; 0 where none presses."""
        N0, N1, *_ = self._unstressed
        return max(0.0, -float(np.linalg.eigvalsh(N0 + load * N1)[0]))

    def load_of_factor(self, factor: float) -> float:
        r"""The load in kg at which all axial forces may grow by no more than a factor; infinite where none is.

        :math:`(K + \Lambda G_0 + P \Lambda G_1) q = 0` on what rigid contacts leave free.
        """
        condensed = self.condensed
        return _first_singular(condensed.K + (factor - 1.0) * condensed.G[0], factor * condensed.G[1])

    def buckled(self, load: float, count: int = 1) -> Array:
        """Contact forces (count, m) of the shapes in which it buckles first, the largest of each 1."""
        N0, N1, L, on_contacts = self._unstressed
        _, Y = np.linalg.eigh(N0 + load * N1)
        G = self.equations.G[0] + load * self.equations.G[1]
        found = np.zeros((count, len(self.closed)))
        found[:, self.closed] = (on_contacts @ (G @ (L @ Y[:, :count]))).T
        return np.asarray(found / np.maximum(np.abs(found).max(axis=1, keepdims=True), np.finfo(float).tiny))

    @cached_property
    def condensed(self) -> Condensed:
        """On what rigid contacts leave free, with the place of the load; contacts that give way are in K."""
        e, closed = self.equations, self.closed
        T, H, E = e.on
        n, d = T.shape
        C = np.block([[e.C[closed], np.zeros((int(closed.sum()), d))], [T.T, -np.eye(d)]])
        F = np.block([[e.F[np.ix_(closed, closed)], H[closed]], [H[closed].T, E]])
        diagonal = np.diagonal(F)
        rigid = diagonal == 0.0
        rigid[len(rigid) - d :] |= diagonal[len(rigid) - d :] <= RIGID * diagonal.max(initial=0.0)
        soft = ~rigid
        K = np.zeros((n + d, n + d))
        K[:n, :n] = e.K + e.G[0]
        pressing = np.zeros((n + d, len(F)))
        pressing[:, soft] = np.linalg.solve(F[np.ix_(soft, soft)], C[soft]).T
        K += pressing @ C
        Z = scipy.linalg.null_space(C[rigid]) if rigid.any() else np.eye(n + d)
        own = Z[:n]
        G0, G1 = (own.T @ G @ own for G in e.G)
        gaps = (Z.T @ pressing)[:, : len(F) - d]
        return Condensed(own.T @ e.M @ own, Z.T @ K @ Z, (G0, G1), Z[n:], own, gaps)

    @property
    def against(self) -> Array:
        """The direction (d,) against which a load pulls, among those of its inputs."""
        pull = np.linalg.lstsq(self.equations.on[0], self.equations.b[1], rcond=None)[0]
        return np.asarray(-pull / np.linalg.norm(pull))

    def frequency(self, load: float) -> float:
        """The lowest in Hz, with the load as a mass in kg that moves along its own directions; 0 past buckling."""
        if load >= self.critical:
            return 0.0
        M, place = self.condensed.M, self.condensed.place
        K = self.condensed.K + load * self.condensed.G[1]
        last = len(K) - 1
        try:
            largest = scipy.linalg.eigh(
                M + load * place.T @ place, (K + K.T) / 2.0, eigvals_only=True, subset_by_index=(last, last)
            )
        except np.linalg.LinAlgError:
            return 0.0
        return float(1.0 / np.sqrt(largest[0]) / (2.0 * np.pi)) if largest[0] > 0.0 else np.inf

    def load_of_frequency(self, frequency: float) -> float:
        r"""The load in kg, as a mass, at which the lowest frequency falls to one in Hz; infinite where none does.

        :math:`(K - \omega^2 M + P (G - \omega^2 c^T c)) q = 0`, c how its place moves.
        """
        on, square = self.condensed, (2.0 * np.pi * frequency) ** 2
        return _first_singular(on.K - square * on.M, on.G[1] - square * on.place.T @ on.place)


def _first_singular(A: Array, B: Array) -> float:
    """The least P > 0 at which A + P B is not positive definite any more; 0 where A is not."""
    try:
        least = float(scipy.linalg.eigh((B + B.T) / 2.0, (A + A.T) / 2.0, eigvals_only=True, subset_by_index=(0, 0))[0])
    except np.linalg.LinAlgError:
        return 0.0
    return -1.0 / least if least < 0.0 else np.inf


def _root(size: Array, Q: Array) -> Array:
    """L of the flexibility L L^T with these eigenvalues (n,) and eigenvectors (n, n), without what is round-off."""
    some = size > len(size) * np.finfo(float).eps * size[-1]
    return np.asarray(Q[:, some] * np.sqrt(size[some]))


class Loaded:
    """Equilibria at one place, by the load; forms of contacts that have been closed are kept."""

    def __init__(self, equations: Equations) -> None:
        self.equations = equations
        self._forms, self._states = dict[bytes, Form](), dict[float, State]()
        self._last = np.ones(len(equations.pushes), dtype=bool)

    @cached_property
    def both_ways(self) -> bool:
        """Whether no contact may open."""
        return not self.equations.pushes.any()

    def state(self, load: float) -> State:
        """The equilibrium under a load; one that does not stand where none is found."""
        if load not in self._states:
            self._states[load] = self._found(load)
        return self._states[load]

    @cached_property
    def _closed(self) -> Form:
        return self._form(self._last)

    def _form(self, closed: Mask) -> Form:
        key = closed.tobytes()
        if key not in self._forms:
            self._forms[key] = Form(self.equations, closed.copy())
        return self._forms[key]

    def _found(self, load: float) -> State:
        o, m = len(self.equations.outputs), len(self.equations.pushes)
        if self.both_ways:
            form = self._closed
            found = form.responses(load)
            return State(load, found[:o], found[o : o + m], form)
        closed, tried = self._last.copy(), set[bytes]()
        fewest, chances = m + 1, 3
        for _ in range(MOST_SETS):
            form = self._form(closed)
            found = form.responses(load)
            state = State(load, found[:o], found[o : o + m], form)
            if not state.stands:
                if closed.all():
                    return state
                closed = np.ones(m, dtype=bool)  # what open contacts leave free for the moment
                if closed.tobytes() in tried:
                    return state
                continue
            wrong = self._wrong(state, found[o + m :])
            if not wrong.any():
                self._last = closed
                return state
            tried.add(closed.tobytes())
            chances = 3 if wrong.sum() < fewest else chances - 1
            fewest = min(fewest, int(wrong.sum()))
            closed = closed ^ (wrong if chances >= 0 else np.arange(m) == np.argmax(wrong))
        return State(load, np.full(o, np.nan), np.full(m, np.nan), form)

    def _wrong(self, state: State, beyond: Array) -> Mask:
        pushes, closed = self.equations.pushes, state.form.closed
        pulls = closed & pushes & (state.forces < -WRONG * np.abs(state.forces).max(initial=0.0))
        return np.asarray(pulls | ~closed & (beyond > WRONG * np.abs(beyond).max(initial=0.0)))
