"""The contacts of a system step by step: forces of those that give way, and what that means for energy and work.

docs/system_of_bodies.md, section 3, has the balance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.kernel.laws import ContactError, solve_contact
from pmr.simulation.balance import dot, half_form, mean
from pmr.simulation.exudyn import inputs as driving
from pmr.simulation.exudyn.equations import Equations
from pmr.system.contact_rows import ContactRows

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Contacts:
    """Which contacts are rigid and which give way, and the forces of the latter, of which some may only push."""

    def __init__(self, equations: Equations, inputs: driving.Inputs) -> None:
        self._equations = equations
        self.rigid = ~np.any(equations.rows(inputs.at(0.0)).F[0], axis=1)
        self.gives = ~self.rigid
        self._names = [name for name, gives in zip(equations.system.contact_names, self.gives, strict=True) if gives]
        clearance = equations.system.clearance[self.gives]
        self._pushes, self._clearance = ~np.isnan(clearance), np.nan_to_num(clearance)
        #: Contacts that give way and were closed when their forces were found last.
        self.closed = ~self._pushes

    @property
    def push(self) -> bool:
        """Whether any only pushes."""
        return bool(self._pushes.any())

    def springs(self, x: Array) -> Array:
        """K + C^T F^-1 C and B - C^T F^-1 H side by side, (T, n, n + i), of those that give way and hold both ways."""
        return self.sprung(self.rows(x))

    def sprung(self, rows: ContactRows) -> Array:
        """Stiffness by the springs of contacts that give way, of their rows (T, ...)."""
        K, B = self._equations.K, self._equations.B
        answers = self._answers(rows, np.concatenate([rows.C, -rows.H], axis=2))
        return np.asarray(np.hstack([K, B]) + rows.C.transpose(0, 2, 1) @ answers)

    def rows(self, x: Array) -> ContactRows:
        """Rows of the contacts that give way at places x (T, k) m."""
        return self.giving(self._equations.rows(x))

    def giving(self, rows: ContactRows) -> ContactRows:
        """Rows of the contacts that give way, out of those of all, at one place or several."""
        gives = self.gives
        return ContactRows(rows.C[..., gives, :], rows.F[..., gives, :][..., gives], rows.H[..., gives, :], rows.X)

    def forces(self, rows: ContactRows, q: Array, f: Array) -> Array:
        """Forces (T, m') N of contacts that give way, at T places; a SimulationError if they are not settled."""
        motion = np.einsum("tmn,tn->tm", rows.C, q) + np.einsum("tmi,ti->tm", rows.H, f)
        if not self.push:
            return np.asarray(self._answers(rows, motion[:, :, None])[:, :, 0])
        return np.array([self.pressed(rows.at(k), gaps) for k, gaps in enumerate(motion)]).reshape(motion.shape)

    def pressed(self, rows: ContactRows, motion: Array) -> Array:
        """Forces (m',) N at one place of contacts that give way and would move by C q + H f (m',) m."""
        try:
            forces, self.closed = solve_contact(rows.F, motion - self._clearance, self._pushes, self.closed)
        except ContactError as error:
            raise SimulationError(f"the contacts {', '.join(self._names)}: {error}") from None
        return forces

    def stiffness(self, rows: ContactRows) -> Array:
        """C^T F^-1 C (n, n) of those that were closed when the forces were settled last."""
        closed = rows.of(self.closed)
        return np.asarray(closed.C.T @ np.linalg.solve(closed.F, closed.C))

    def _answers(self, rows: ContactRows, right: Array) -> Array:
        try:
            return np.asarray(np.linalg.solve(rows.F, right))
        except np.linalg.LinAlgError:
            raise SimulationError(f"the contacts {', '.join(self._names)} depend on each other") from None


@dataclass(frozen=True)
class Motion:
    """At N times: places x (N, k) m, coordinates and rates (N, n), loads f (N, i) and contact forces (N, m) in N.

    Amplitudes of terms are c (N, K).
    """

    x: Array
    q: Array
    v: Array
    f: Array
    forces: Array
    c: Array
    # of friction (`pmr.simulation.exudyn.friction`): of n' pads (N, n') N, forces of its moments (N, n) N, gaps (N, m)
    # m; (N, 0) without any
    friction: Array
    w: Array
    gap: Array

    def part(self, steps: slice) -> Motion:
        """Some of its times."""
        return Motion(*(array[steps] for array in vars(self).values()))


@dataclass(frozen=True)
class Balance:
    """Energy that is stored, (N,) J, and work done since t = 0, (N,) J."""

    stored: Array
    work: Array


def balance_energy(equations: Equations, contacts: Contacts, motion: Motion) -> Balance:
    """Fills in the forces of contacts that give way, and balances the energy, some thousand times at once.

    Where pads rub these forces are known.
    """
    m, (n, i) = len(equations.system.contacts), equations.B.shape
    N, block = len(motion.q), max(2, driving.ENTRIES_AHEAD // max(1, m * (n + m + i)))
    stored, work = np.zeros(N), np.zeros(N)
    for first in range(0, max(1, N - 1), block - 1):
        steps = slice(first, min(first + block, N))
        part, rows = motion.part(steps), equations.rows(motion.x[steps])
        g = contacts.gives
        giving = ContactRows(rows.C[:, g], rows.F[:, g][:, :, g], rows.H[:, g], rows.X)
        if not part.friction.shape[1]:
            part.forces[:, g] = contacts.forces(giving, part.q, part.f)
        with np.errstate(over="ignore", invalid="ignore"):
            stored[steps], done = _energy_and_work(equations, rows, part)
        work[steps][1:] = work[first] + np.cumsum(done)
    return Balance(stored, work)


def _energy_and_work(equations: Equations, rows: ContactRows, motion: Motion) -> tuple[Array, Array]:
    """Stored energy (T,) and work of each step (T - 1,), both in J, with the contacts at T places."""
    q, f, forces = motion.q, motion.f, motion.forces
    load_gaps, bent = np.einsum("tmi,ti->tm", rows.H, f), np.einsum("tmn,tn->tm", rows.F, forces)
    stored = half_form(equations.M, motion.v) + half_form(equations.K, q) + dot(forces, bent / 2.0 - load_gaps)
    at_loads = np.asarray(q @ equations.B) + f @ equations.assembly.energy - np.einsum("tmi,tm->ti", rows.H, forces)
    C, H, F = (np.diff(part, axis=0) for part in (rows.C, rows.H, rows.F))
    turned = np.einsum("tmn,tn->tm", C, mean(q)) + np.einsum("tmi,ti->tm", H, mean(f))
    turned -= np.einsum("tmn,tn->tm", F, mean(forces)) / 2.0
    work = dot(mean(f), np.diff(at_loads, axis=0)) + dot(mean(forces), turned)
    if equations.system.terms:
        work += dot(mean(equations.assembly.term_forces(q, motion.v, motion.c)), np.diff(q, axis=0))
    if motion.friction.shape[1]:
        work += dot(mean(motion.w), np.diff(q, axis=0)) - dot(mean(forces), np.diff(motion.gap, axis=0))
    return stored + dot(f, f @ equations.assembly.energy) / 2.0, work
