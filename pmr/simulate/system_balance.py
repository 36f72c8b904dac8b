"""Energy of a system of bodies and the work done on it, from a trajectory (docs/system_of_bodies.md, section 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.simulate.balance import dot, half_form, mean
from pmr.system.assembly import Assembly, ContactTables

Array = NDArray[np.float64]


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


def balanced(assembly: Assembly, rows: ContactTables, motion: SystemMotion) -> SystemBalance:
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
