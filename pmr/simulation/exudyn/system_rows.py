"""The contacts of a system of bodies step by step: forces of those that give way, energy and work.

docs/system_of_bodies.md, section 3, has the balance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.simulation.balance import dot, half_form, mean
from pmr.simulation.exudyn.inputs import ENTRIES_AHEAD
from pmr.simulation.native import contact as native
from pmr.simulation.native.scheme import GeneralizedAlpha
from pmr.system.assembly import Assembly, ContactRows
from pmr.system.system import System

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Tables:
    """The contacts at all steps, a block of steps ahead."""

    def __init__(self, assembly: Assembly, x: Array) -> None:
        self._assembly, self._x, self._first = assembly, x, 0
        m, (n, i), o = x.shape[1], assembly.B.shape, assembly.outputs.shape[0]
        self.block = max(2, ENTRIES_AHEAD // max(1, m * (n + m + i + o)))
        self._found: ContactRows | None = None

    def at(self, k: int) -> ContactRows:
        """At step k."""
        if self._found is None or not self._first <= k < self._first + len(self._found.C):
            self._first, self._found = k, self.of(k, k + self.block)
        return self._found.at(k - self._first)

    def of(self, first: int, last: int) -> ContactRows:
        """At steps `first` to `last`, the latter excluded."""
        return self._assembly.along(self._x[first:last])


class Giving:
    """Forces of contacts that give way, some of which only push."""

    def __init__(self, system: System, which: Mask, method: GeneralizedAlpha) -> None:
        self.which = which
        self.pushing = native.contact(system.clearance[which], method.memory())
        self._names, self._room = system.contact_names, np.zeros((which.sum(),) * 2)
        self._rows: ContactRows | None = None

    def forces(self, rows: ContactRows, q: Array, f: Array) -> Array:
        """Lambda (m',) in N at coordinates q under loads f; a SimulationError if which are closed is not settled."""
        if self.pushing is None:
            return np.asarray(rows.answers @ np.concatenate([q, f]))
        if rows is not self._rows:
            self._rows, self.pushing.factored[0] = rows, native.STALE
        found = rows.C @ q + rows.H @ f
        if native.settle(self.pushing, rows.F, self._room, found):
            raise SimulationError(f"which of the contacts {', '.join(self._names)} are closed was not settled")
        return np.asarray(found)

    def stiffness(self, rows: ContactRows) -> Array:
        """C^T F^-1 C of those that are closed."""
        if self.pushing is None:
            return np.asarray(rows.C.T @ rows.answers[:, : rows.C.shape[1]])
        closed = rows.of(self.pushing.closed)
        return np.asarray(closed.C.T @ np.linalg.solve(closed.F, closed.C))


@dataclass(frozen=True)
class SystemMotion:
    """Coordinates and rates (T, n) as an `Assembly` numbers them, loads f (T, i) N and contact forces (T, m) N."""

    q: Array
    v: Array
    f: Array
    forces: Array

    def part(self, steps: slice) -> SystemMotion:
        """Some steps of it."""
        return SystemMotion(self.q[steps], self.v[steps], self.f[steps], self.forces[steps])


@dataclass(frozen=True)
class SystemBalance:
    """Of a system of bodies: what is stored, (T,) J, and the work done on it in each step, (T - 1,) J."""

    stored: Array
    work: Array


def balanced(assembly: Assembly, rows: ContactRows, motion: SystemMotion) -> SystemBalance:
    """With the contacts at T places."""
    q, f, forces = motion.q, motion.f, motion.forces
    given, bent = np.einsum("tmi,ti->tm", rows.H, f), np.einsum("tmn,tn->tm", rows.F, forces)
    stored = half_form(assembly.M, motion.v) + half_form(assembly.K, q) + dot(forces, bent / 2.0 - given)
    moved = np.asarray(q @ assembly.B) + f @ assembly.energy - np.einsum("tmi,tm->ti", rows.H, forces)
    C, H, F = (np.diff(part, axis=0) for part in (rows.C, rows.H, rows.F))
    turned = np.einsum("tmn,tn->tm", C, mean(q)) + np.einsum("tmi,ti->tm", H, mean(f))
    turned -= np.einsum("tmn,tn->tm", F, mean(forces)) / 2.0
    work = dot(mean(f), np.diff(moved, axis=0)) + dot(mean(forces), turned)
    return SystemBalance(stored + dot(f, f @ assembly.energy) / 2.0, work)
