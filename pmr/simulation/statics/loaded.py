r"""A structure at rest under a load that grows: the response as a rational function of the load P.

.. math::
    (K + G_0 + P\, G_1)\, q + C^T \lambda = b_0 + P\, b_1, \qquad C q - F \lambda = g_0 + P\, g_1

for coordinates q and contact forces :math:`\lambda`, with the stiffness K, rows C and flexibility F of the contacts,
forces b and gaps g.  G is the geometric stiffness; the index 0 marks what the fixed loads cause, 1 what a unit of the
load that grows causes.  For a fixed set of closed contacts, let :math:`A = L L^T` be the flexibility of the structure
with the stiffness :math:`K + G_0`.  With :math:`L^T G_1 L = V \eta V^T`, where :math:`\eta` holds the eigenvalues and V
the eigenvectors, and with :math:`U = L V`,

.. math::
    q(P) = \bar q(P) - P\, U\, (I + P \eta)^{-1} U^T G_1\, \bar q(P), \qquad \bar q(P) = q_0 + P\, q_1

(Woodbury's formula), where q_0 and q_1 are the linear responses to the fixed loads and to a unit of P.  So one
factorisation serves all loads, and the structure buckles at the smallest P with a vanishing :math:`1 + P \eta_i`.
Contacts that only push open and close as the load grows: each set of closed contacts has a `Form` of its own.  A search
that meets a set of contacts that do not hold the structure starts again from the contacts that are closed without
geometric stiffness but with a small multiple of the mass matrix added to the stiffness.  This stiffness is positive
definite, so the search for these contacts ends (docs/pads_theory.md).  If these contacts do not hold the structure
either, those that touch without a force are closed with them: a body that no load presses sideways lies on pads without
clearance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import compress
from typing import NamedTuple

import numpy as np
import scipy.linalg

from pmr.errors import InputError
from pmr.files.arrays import Array, Mask
from pmr.kernel.laws import ContactSearch
from pmr.simulation.statics.equilibrium import LARGER, SMALLER, BorderedMatrix
from pmr.system.body_matrices import cholesky_root, first_singular
from pmr.system.states import ContactRows

#: Share of the largest eigenvalue of the geometric stiffness below which an eigenvalue is round-off; share of the
#: contacts' largest flexibility below which the flexibility at the load's own position is round-off.
ROUND_OFF, RIGID = 1e-9, 1e-4
#: Pull or overlap that is round-off, over the largest force or displacement.
WRONG = 1e-9
#: Clearance of a contact without play and gap of a body that is lost, over the largest clearance; share of the largest
#: loose motion that counts as loose.
TOUCH, FAR, LOOSE = 0.1, 1e3, 1e-3
#: Most sets of closed contacts tried at one load; share of the lowest omega^2 with which M holds free bodies.
MOST_SETS, ALMOST_FREE = 200, 1e-8
#: Most steps downhill to an equilibrium.
STEPS = 40


@dataclass(frozen=True)
class LoadEffects:
    """Effects of loads on a structure with n coordinates, m contacts and o outputs."""

    b: Array  # (n,): forces on coordinates
    g: Array  # (m,): gaps minus direct displacements of contacts
    direct: Array  # (o,): direct outputs
    G: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (n, n): geometric stiffness
    outputs: Array = field(default_factory=lambda: np.zeros((0, 1)))  # (r, n): added to the last r rows of the outputs


@dataclass(frozen=True)
class Equations:
    """Matrices of a structure in one posture, and the effects of its loads.

    Sizes: n coordinates, m contacts, o outputs, d directions of the load that grows.
    """

    M: Array  # (n, n)
    K: Array  # (n, n)
    outputs: Array  # (o, n): outputs are `outputs` q - X lambda, and direct ones by the loads
    rows: ContactRows  # C (m, n), F (m, m), X (o, m), and H (m, d) by a unit of the load's force in its directions
    fixed: LoadEffects  # of the fixed loads
    growing: LoadEffects  # of a unit of the load that grows
    pushes: Mask  # (m,): contacts that only push
    # by a unit of the load's force in its directions: forces on coordinates, displacement of the load's position
    load_inputs: Array  # (n, d)
    load_flexibility: Array  # (d, d)
    names: tuple[str, ...] = ()  # (m,): of the contacts, for errors

    @cached_property
    def all_closed(self) -> Form:
        """Equilibria with all contacts closed, also those that only push; computed once."""
        return Form(self, np.ones(len(self.pushes), dtype=bool))

    @property
    def unstressed(self) -> Equations:
        """Equations without geometric stiffness."""
        fixed, growing = (replace(of, G=np.zeros_like(self.K)) for of in (self.fixed, self.growing))
        return replace(self, fixed=fixed, growing=growing)


@dataclass(frozen=True)
class LoadedState:
    """Equilibrium under a load: outputs (o,), contact forces (m,) in N and form; NaN where no equilibrium exists."""

    load: float  # kg
    outputs: Array
    forces: Array
    form: Form
    wrong: Mask  # (m,): contacts that only push and are closed although they pull, or open although they overlap

    @cached_property
    def in_equilibrium(self) -> bool:
        """Whether an equilibrium exists: all outputs and contact forces are finite."""
        return bool(np.isfinite(self.forces).all() and np.isfinite(self.outputs).all())


@dataclass(frozen=True)
class LoadedStates:
    """Equilibria under p loads."""

    load: Array  # (p,) kg
    outputs: Array  # (p, o)
    forces: Array  # (p, m)
    in_equilibrium: Mask  # (p,)
    forms: tuple[Form, ...]  # (p,)

    @classmethod
    def from_states(cls, states: Sequence[LoadedState]) -> LoadedStates:
        """Equilibria of a list of states, in its order."""
        load, outputs, forces = (
            np.array([getattr(state, of) for state in states]) for of in ("load", "outputs", "forces")
        )
        stands = np.array([state.in_equilibrium for state in states], dtype=bool)
        return cls(load, outputs, forces, stands, tuple(state.form for state in states))

    @classmethod
    def with_outputs(cls, state: LoadedState, outputs: Array, forces: Array) -> LoadedStates:
        """Valid equilibria with outputs (p, o) and forces (p, m), all under the load and with the form of `state`."""
        count = len(outputs)
        return cls(np.full(count, state.load), outputs, forces, np.ones(count, dtype=bool), (state.form,) * count)

    def select(self, mask: Mask) -> LoadedStates:
        """Equilibria selected by a mask (p,)."""
        forms = tuple(compress(self.forms, mask))
        return LoadedStates(self.load[mask], self.outputs[mask], self.forces[mask], self.in_equilibrium[mask], forms)


@dataclass(frozen=True)
class Condensed:
    """Matrices of a structure on r coordinates z: its motions within rigid contacts."""

    M: Array  # (r, r)
    K: Array  # (r, r), with the geometric stiffness of the fixed loads
    G: tuple[Array, Array]  # (r, r) each: geometric stiffness of the fixed loads, of a unit of the load
    load_position: Array  # (d, r): displacement of the load's position along its directions
    coordinates: Array  # (n, r): coordinates of the structure are q = `coordinates` z
    gap_forces: Array  # (r, closed contacts): forces on z by gaps of closed contacts


class UnstressedFlexibility(NamedTuple):
    """Flexibility A = L L^T (n, n) of a structure without geometric stiffness, and related matrices."""

    root: Array  # L (n, r)
    # L^T G_0 L and L^T G_1 L (r, r): geometric stiffness of the fixed loads, of a unit of the load
    G: tuple[Array, Array]
    contact_forces: Array  # (closed contacts, n): by unit forces on coordinates


class Form:
    """Equilibria with a fixed set of closed contacts, a mask (m,), for any load.

    `held` says whether these contacts hold the structure without the load that grows.  The structure buckles at the
    load `critical` in kg, which is infinite if it never buckles.
    """

    def __init__(self, equations: Equations, closed: Mask) -> None:
        """Invert the matrix of the `equations` with the contacts in the mask `closed` (m,), and find the buckling load.

        If these contacts do not hold the structure, only `held`, which is false, and `critical`, which is 0, are set.
        """
        self.equations, self.closed = equations, closed
        e, n = equations, len(equations.K)
        K, self._rows = e.K + e.fixed.G, e.rows if closed.all() else e.rows.select(closed)
        self.held, self.critical = False, 0.0
        try:
            Z = BorderedMatrix(K, self._rows.C, self._rows.F).inverse()
        except np.linalg.LinAlgError:
            return
        flexibility = (Z[:n, :n] + Z[:n, :n].T) / 2.0
        if not np.isfinite(size := float(np.linalg.norm(flexibility))):
            return
        if size * np.abs(K).max() > 1.0 / np.finfo(float).eps or (L := cholesky_root(flexibility)) is None:
            return  # round-off alone holds the structure, or the fixed loads alone make it buckle
        self.eta, V = np.linalg.eigh(L.T @ e.growing.G @ L)
        least = float(self.eta[0]) if len(self.eta) else 0.0
        some = -least > ROUND_OFF * np.abs(self.eta).max(initial=0.0) and least < 0.0
        self.held, self.critical = True, -1.0 / least if some else np.inf
        self._compute_responses(Z, L @ V)

    def _compute_responses(self, Z: Array, U: Array) -> None:
        """Compute the responses of the boom from which `responses` puts together those to any load.

        - The linear responses are those to the fixed loads, and to a unit of the load that grows.
        - Further responses are those to forces G x of the geometric stiffness G of the load that grows: with the
          displacements x of the linear responses, and with the modes U (n, k) as x.
        - The forces G x of the linear responses are also projected on the modes.

        A response consists of outputs, contact forces, overlaps of contacts that only push, and the part of the outputs
        that grows with the load.  `Z` (n + c, n + c) is the inverse of the bordered matrix of n coordinates and c
        closed contacts.
        """
        e, n, closed, pushes = self.equations, len(self.equations.K), self.closed, self.equations.pushes
        o, m, d = len(e.outputs), len(closed), int(pushes.sum())
        R = np.zeros((o + m + d + len(e.growing.outputs), n + int(closed.sum())))
        R[o + m + d :, :n] = e.growing.outputs
        R[:o, :n], R[:o, n:] = e.outputs, -self._rows.X
        R[o + np.flatnonzero(closed), np.arange(n, R.shape[1])] = 1.0
        if d:
            pushing = slice(o + m, o + m + d)
            R[pushing, :n], R[pushing, n:] = e.rows.C[pushes], -e.rows.F[pushes][:, closed]
        z = [Z @ np.concatenate([of.b, of.g[closed]]) for of in (e.fixed, e.growing)]
        # closed contacts fulfil C q - F lambda = g: an overlap is the difference
        none = np.zeros(len(e.growing.outputs))
        remainders = [np.concatenate([of.direct, np.zeros(m), -of.g[pushes], none]) for of in (e.fixed, e.growing)]
        self._linear = [R @ response + more for response, more in zip(z, remainders, strict=True)]
        Y = (R @ Z[:, :n]) @ e.growing.G
        self._bent = [Y @ response[:n] for response in z]
        self._modal = np.ascontiguousarray((Y @ U).T)
        self._on_modes = [U.T @ (e.growing.G @ response[:n]) for response in z]

    def responses(self, loads: Array) -> Array:
        """Responses to `loads` (p,) in kg, a row for each: o outputs, m contact forces, then overlaps.

        Each contact that only pushes has an overlap C q - F lambda - g: how far its sides move towards each other
        beyond its gap.  A row is NaN if no equilibrium exists under the load.
        """
        if not self.held:
            e = self.equations
            return np.full((len(loads), len(e.outputs) + len(e.pushes) + int(e.pushes.sum())), np.nan)
        (r0, r1), (y0, y1), (u0, u1) = self._linear, self._bent, self._on_modes
        stands = self.is_stable(loads)
        P = np.where(stands, loads, 0.0)[:, None]
        amplitudes = P * (u0 + P * u1) / (1.0 + P * self.eta)
        values = r0 + P * (r1 - y0 - P * y1 + amplitudes @ self._modal)
        values[~stands] = np.nan
        o, count = len(self.equations.outputs), len(self.equations.growing.outputs)
        last = values.shape[1] - count
        values[:, o - count : o] += P * values[:, last:]
        return np.asarray(values[:, :last])

    def is_stable(self, loads: Array) -> Mask:
        """Mask (p,), true for each of the `loads` (p,) in kg under which the structure is held and does not buckle."""
        return np.asarray(loads < self.critical)

    @cached_property
    def _unstressed(self) -> UnstressedFlexibility:
        """Flexibility L L^T (n, n) without geometric stiffness: displacements by unit forces on coordinates.

        The closed contacts hold the structure.  Besides L, the result contains L^T G L for the geometric stiffness G of
        the fixed loads, and for that of a unit of the load that grows.  It also contains the contact forces by unit
        forces on coordinates.
        """
        e, n = self.equations, len(self.equations.K)
        Z = BorderedMatrix(e.K, self._rows.C, self._rows.F).inverse()
        size, Q = np.linalg.eigh((Z[:n, :n] + Z[:n, :n].T) / 2.0)
        some = size > len(size) * np.finfo(float).eps * size[-1]
        L = Q[:, some] * np.sqrt(size[some])
        return UnstressedFlexibility(L, (L.T @ e.fixed.G @ L, L.T @ e.growing.G @ L), Z[n:, :n])

    def inverse_factor(self, load: float) -> float:
        """Inverse 1 / Lambda of the buckling factor: Lambda times all axial forces under `load` cause buckling.

        The result is zero if nothing is compressed, and infinite if the structure is unstable even without axial
        forces.
        """
        on = self.condensed
        factor = first_singular(on.K - on.G[0], on.G[0] + load * on.G[1])
        return 1.0 / factor if factor > 0.0 else np.inf

    def load_of_factor(self, factor: float) -> float:
        r"""Smallest load P in kg at which `factor` times all axial forces cause buckling; infinite if there is none.

        The load fulfils :math:`(K + \Lambda G_0 + P \Lambda G_1) q = 0` with `factor` as :math:`\Lambda`, for
        coordinates q that rigid contacts leave free.
        """
        on = self.condensed
        return first_singular(on.K + (factor - 1.0) * on.G[0], factor * on.G[1])

    def buckling_forces(self, load: float) -> Array:
        """Contact forces (m,) of the first buckling shape under `load`, scaled to a largest absolute value of 1.

        The sign that all forces have in common has no meaning.  Forces of open contacts are zero.  All forces are zero
        if the structure is not `held`.
        """
        if not self.held:
            return np.zeros(len(self.closed))
        L, (fixed, growing), on_contacts = self._unstressed
        _, Y = np.linalg.eigh(fixed + load * growing)
        G = self.equations.fixed.G + load * self.equations.growing.G
        forces = np.zeros(len(self.closed))
        forces[self.closed] = on_contacts @ (G @ (L @ Y[:, 0]))
        return np.asarray(forces / max(np.abs(forces).max(initial=0.0), np.finfo(float).tiny))

    @cached_property
    def condensed(self) -> Condensed:
        """Mass, stiffness and geometric stiffness on those motions that rigid closed contacts permit.

        The motions are those of the structure and of the load's position along its d directions.  The stiffness
        includes the compliant closed contacts and the geometric stiffness of the fixed loads.
        """
        e, closed = self.equations, self.closed
        T, H, E = e.load_inputs, e.rows.H, e.load_flexibility
        n, d = T.shape
        m = int(closed.sum())
        C, F, K = np.zeros((m + d, n + d)), np.empty((m + d, m + d)), np.zeros((n + d, n + d))
        C[:m, :n], C[m:, :n], C[m:, n:] = self._rows.C, T.T, -np.eye(d)
        F[:m, :m], F[:m, m:], F[m:, :m], F[m:, m:] = self._rows.F, H[closed], H[closed].T, E
        diagonal = np.diagonal(F)
        rigid = diagonal == 0.0
        rigid[m:] |= diagonal[m:] <= RIGID * diagonal.max(initial=0.0)
        soft = ~rigid
        K[:n, :n] = e.K + e.fixed.G
        pressing = np.zeros((n + d, m + d))
        pressing[:, soft] = np.linalg.solve(F[np.ix_(soft, soft)], C[soft]).T
        K += pressing @ C
        M, G0, G1 = (np.zeros_like(K) for _ in range(3))
        M[:n, :n], G0[:n, :n], G1[:n, :n] = e.M, e.fixed.G, e.growing.G
        Z = scipy.linalg.null_space(C[rigid]) if rigid.any() else np.eye(len(K))
        M, K, G0, G1 = (Z.T @ matrix @ Z for matrix in (M, K, G0, G1))
        return Condensed(M, K, (G0, G1), Z[n:], Z[:n], (Z.T @ pressing)[:, :m])

    @property
    def pull(self) -> Array:
        """Forces (d,) in N along the load's d inputs by 1 kg of the load."""
        return np.asarray(np.linalg.lstsq(self.equations.load_inputs, self.equations.growing.b, rcond=None)[0])

    @property
    def lifting_direction(self) -> Array:
        """Unit vector (d,) opposite to the pull of the load, with a component for each of the load's d inputs."""
        return np.asarray(-self.pull / np.linalg.norm(self.pull))

    def frequency(self, load: float) -> float:
        """Lowest natural frequency in Hz with `load` in kg, a mass that moves along the load's d directions.

        The frequency is 0 if the structure is not `held` or buckles under the load, and infinite if no coordinate has a
        mass.
        """
        if load >= self.critical:
            return 0.0
        M, place = self.condensed.M, self.condensed.load_position
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
        r"""Smallest load P in kg, as a mass, that lowers a natural frequency to `frequency` in Hz; infinite if none.

        The load fulfils :math:`(K - \omega^2 M + P (G_1 - \omega^2 c^T c)) q = 0` with :math:`\omega = 2 \pi` times
        `frequency` and the displacement c q of the load's position.
        """
        on, square = self.condensed, (2.0 * np.pi * frequency) ** 2
        return first_singular(on.K - square * on.M, on.G[1] - square * on.load_position.T @ on.load_position)


class LoadedStructure:
    """Equilibria in one posture under any load; the form of each set of closed contacts is stored once it is met.

    If `may_float`, a body that floats within the play of contacts has no equilibrium; otherwise an InputError is
    raised.
    """

    def __init__(self, equations: Equations, may_float: bool = False) -> None:
        """Begin with all contacts of `equations` closed and without stored forms; the class describes `may_float`."""
        self.equations, self._may_float = equations, may_float
        self._forms, self._states = dict[bytes, Form](), dict[float, LoadedState]()
        self._last = np.ones(len(equations.pushes), dtype=bool)

    @cached_property
    def holds_both_ways(self) -> bool:
        """Whether no contact can open."""
        return not self.equations.pushes.any()

    def state(self, load: float) -> LoadedState:
        """Equilibrium under a load in kg, searched once; NaN values if none is found.

        Raises InputError, unless the structure `may_float`, if bodies float within the play of contacts because nothing
        presses them to a side.
        """
        if load not in self._states:
            self._states[load] = self._find_equilibrium(load)
        return self._states[load]

    def states(self, loads: Sequence[float]) -> LoadedStates:
        """Equilibria under several `loads` in kg, in their order; errors as `state`."""
        return LoadedStates.from_states([self.state(load) for load in loads])

    def _form(self, closed: Mask) -> Form:
        """Form of the mask `closed` (m,) of closed contacts, computed once."""
        key = closed.tobytes()
        if key not in self._forms:
            self._forms[key] = Form(self.equations, closed.copy())
        return self._forms[key]

    def _find_equilibrium(self, load: float) -> LoadedState:
        """Search the equilibrium under a load in kg.

        The search begins with the last closed contacts.  If it fails, it is repeated with the closed contacts of
        `_first_order`, then with further ones that touch, one after the other, then downhill (`_search_downhill`).
        Contacts that all hold both ways need no search.  Errors as `state`.
        """
        closed, every = self._last, np.ones_like(self._last)
        if self.holds_both_ways:
            return self._solve_closed(closed, load)
        state = self._search(closed, load)
        if not state.in_equilibrium and self._form(every).is_stable(np.array([load]))[0]:
            closed = self._first_order._search(every, load).form.closed
            state = self._search(closed, load)
            while not state.in_equilibrium and (nearest := self._nearest_loose(closed, load)) is not None:
                closed = closed | (np.arange(len(closed)) == nearest)
                state = self._search(closed, load)
            if not state.in_equilibrium and np.any(self.equations.fixed.g[self.equations.pushes] > 0.0):
                state = self._search_downhill(state)
            if not state.in_equilibrium and not self._may_float:
                self._nearest_loose(closed, load, refuse=True)
        return state

    def _search_downhill(self, state: LoadedState) -> LoadedState:
        """Search the equilibrium under the load of `state` downhill, as `pmr.simulation.statics.equilibrium` does.

        Second order may press a body with play to a side that no first-order force presses it to.  The values of
        `state` are NaN, and so are those of the result if no step ends in an equilibrium.
        """
        e, load, share, closed = self.equations, state.load, 1.0, np.ones_like(self._last)
        n, m = len(e.K), len(closed)
        K, b, g = (getattr(e.fixed, of) + load * getattr(e.growing, of) for of in ("G", "b", "g"))
        floor, q = (self._first_order.equations.K - e.K) / ALMOST_FREE, np.zeros(n)
        nothing = LoadEffects(np.zeros(n), np.zeros(m), np.zeros(n), np.zeros_like(e.K), np.zeros((0, n)))
        step = replace(e, outputs=np.eye(n), rows=replace(e.rows, X=np.zeros((n, m))), growing=nothing)
        for _ in range(STEPS):
            fixed = replace(nothing, b=b + share * floor @ q, g=g)
            held = replace(step, K=e.K + K + share * floor, fixed=fixed)
            almost = LoadedStructure(held)._search(closed, 0.0)
            if not almost.in_equilibrium:
                share *= LARGER
                continue
            closed, q, share = almost.form.closed, almost.outputs, SMALLER * share
            state = self._search(closed, load)
            if state.in_equilibrium:
                break
        return state

    def _nearest_loose(self, closed: Mask, load: float, refuse: bool = False) -> int | None:
        """Return the number of the contact to close next, if the contacts in the mask `closed` (m,) leave a body free.

        Of the free body's open contacts without play, it is the nearest one.  If all its open contacts have play, an
        InputError is raised if `refuse` is true, and None is returned otherwise.  None is also returned if no body is
        free, or if the `load` in kg moves the free body far beyond the clearance of one of its contacts.
        """
        e, o = self._first_order.equations, len(self.equations.outputs) + len(closed)
        if Form(self.equations.unstressed, closed).held:
            return None
        gap, pushes, play = np.full(len(closed), np.inf), e.pushes, np.abs(e.fixed.g).max()
        gap[pushes] = -self._first_order._form(closed).responses(np.array([load]))[0, o:]
        push = np.append(np.random.default_rng(3).standard_normal(len(e.K)), np.zeros(int(closed.sum())))
        held = BorderedMatrix(e.K, e.rows.C[closed], e.rows.F[closed][:, closed])
        motion = np.abs(e.rows.C @ held.solve(push[:, None])[: len(e.K), 0])
        loose = np.flatnonzero(~closed & pushes & (motion > LOOSE * motion.max()))
        if not len(loose) or not gap[loose].max() <= FAR * play:
            return None
        touching = loose[(e.fixed.g + load * e.growing.g)[loose] <= TOUCH * play]
        if len(touching):  # but for what walls give way there
            return int(touching[gap[touching].argmin()])
        if not refuse:
            return None
        allowed = (
            "no load presses these pads, and they have play on both sides: allowed are clearance = 0 on one of two "
            "opposite faces, or in every load case a load that presses them"
        )
        raise InputError("system", "contacts", ", ".join(np.array(e.names)[loose]), allowed)

    @cached_property
    def _first_order(self) -> LoadedStructure:
        """Structure without geometric stiffness and with a little M added to K, so that equilibria always exist."""
        e, every = self.equations, self._form(np.ones_like(self._last))
        floor = ALMOST_FREE * (2.0 * np.pi * every.frequency(0.0)) ** 2
        return LoadedStructure(replace(e.unstressed, K=e.K + floor * e.M))

    def _search(self, closed: Mask, load: float) -> LoadedState:
        """Search the equilibrium under a load, beginning with the mask `closed` (m,), through sets of closed contacts.

        The values are NaN if a set on the way has no equilibrium, or after `MOST_SETS` sets.  The set of an equilibrium
        is stored; the next call of `state` begins with it.
        """
        search = ContactSearch()
        for _ in range(MOST_SETS):
            state = self._solve_closed(closed, load)
            if not state.in_equilibrium:
                break
            if not state.wrong.any():
                self._last = closed
                return state
            closed = search.change(closed, state.wrong)
        return replace(state, outputs=np.full_like(state.outputs, np.nan), forces=np.full_like(state.forces, np.nan))

    def _solve_closed(self, closed: Mask, load: float) -> LoadedState:
        """State under `load` in kg with the contacts in the mask `closed` (m,) closed, and all others open."""
        form, o, m = self._form(closed), len(self.equations.outputs), len(closed)
        values = form.responses(np.array([load]))[0]
        forces, beyond, pushes = values[o : o + m], values[o + m :], self.equations.pushes
        wrong = closed & pushes & (forces < -WRONG * np.abs(forces).max(initial=0.0))
        wrong[pushes] |= ~closed[pushes] & (beyond > WRONG * np.abs(beyond).max(initial=0.0))
        return LoadedState(load, values[:o], forces, form, wrong)
