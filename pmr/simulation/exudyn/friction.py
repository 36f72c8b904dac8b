r"""Friction of pads (`pmr.system.friction`) in Exudyn: forces of contacts that give way, found together with it.

Exudyn asks for them at coordinates q in every iteration; then

.. math:: F \lambda = C q + H f - g, \qquad g = \sum f_j / k - A\, m, \qquad w = C'^T m

with the moments m of friction and what they move in the contacts by residual flexibility, A m.  Newton's method is
given the stiffness of pads that stick.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError, SimulationError
from pmr.simulation.exudyn.contacts import Contacts, Motion
from pmr.simulation.exudyn.equations import Equations
from pmr.simulation.grip import Grip, slid
from pmr.system.contact_rows import ContactRows
from pmr.system.friction import Friction

Array = NDArray[np.float64]

#: Times that friction is found at most, and what of a gap is round-off, over that of pads that slide.
LIMIT, CONVERGED = 200, 1e-12


@dataclass(frozen=True)
class Rows:
    """Contacts (m,) at one place x (sides,) m, where joints are at s (J,) m; of contacts that give way (m',) apart."""

    giving: ContactRows
    slopes: Array  # (m, n) 1/m: C'
    answers: Array  # (m, m) 1/N: A
    s: Array


@dataclass(frozen=True)
class Found:
    """Multipliers (m,) N, zero of rigid contacts; what pads hold; forces w (n,) N of moments, gaps (m,) m."""

    multipliers: Array
    grip: Grip
    w: Array
    gap: Array


class Rubbing:
    """A system's friction from step to step; an InputError is raised where a pad that rubs does not give way."""

    def __init__(self, equations: Equations, contacts: Contacts, known: Friction) -> None:
        system = equations.system
        for pad in known.pads:
            if contacts.rigid[pad]:
                allowed = (
                    "more than 0 m/N, or residual flexibility, is allowed: Exudyn finds friction by what gives way"
                )
                raise InputError("system", f"contacts.{system.contact_names[pad]}.compliance", 0.0, allowed)
        self._equations, self._contacts, self.known = equations, contacts, known
        #: Of loads at t s, what the motion of the base makes of them, (i,) N: nothing on the ground.
        self.inertia: Callable[[float], Array] = lambda t: np.zeros(equations.B.shape[1])
        self._joints = [
            next((k, side.place) for k, side in enumerate(system.sides) if side.place.path == joint)
            for joint in known.joints
        ]
        self.grip = Grip()

    @property
    def gives(self) -> NDArray[np.bool_]:
        """Which contacts (m,) give way."""
        return self._contacts.gives

    def rows(self, x: Array) -> Rows:
        """At x (1, sides) m."""
        assembly = self._equations.assembly
        s = np.array([(x[0, k] - place.at) / place.rate for k, place in self._joints])
        return Rows(self._contacts.rows(x).at(0), assembly.slopes(x[0]), assembly.turned_rows(x[0]), s)

    def answers(self, rows: Rows, f: Array) -> Array:
        """F^-1 H f (m',) N of contacts that give way, to loads f (i,)."""
        given = rows.giving.H @ f
        return np.asarray(np.linalg.solve(rows.giving.F, given)) if f.any() else given

    def begin(self, rows: Rows, q: Array, f: Array) -> None:
        """Stand at rest without friction, at coordinates q (n,) under loads f (i,) N."""
        self.grip = Grip.begun(self._equations.system.contacts, rows.s, self._multipliers(rows, q, f, 0.0))

    def found(self, rows: Rows, q: Array, f: Array) -> Found:
        """At the end of the present step, with coordinates q (n,) under loads f (i,) N.

        A SimulationError is raised where friction does not settle.
        """
        known, grip, gap = self.known, self.grip, np.zeros(len(self._contacts.gives))
        diagonal = np.zeros(len(gap))
        diagonal[self._contacts.gives] = np.diag(rows.giving.F)
        for _ in range(LIMIT):
            multipliers, given = self._multipliers(rows, q, f, gap), grip
            grip = slid(known, self.grip, known.totals(given.forces), rows.s, multipliers, np.diag(diagonal))
            moments = known.moments(grip.forces, multipliers)
            old, gap = gap, known.gaps(grip.forces) - rows.answers @ moments
            limits = known.coefficients * np.abs(multipliers[known.pads])
            most = known.gaps(limits) + np.abs(rows.answers) @ np.abs(known.moments(limits, multipliers))
            if np.abs(gap - old).max() <= CONVERGED * most.max():
                return Found(multipliers, grip, rows.slopes.T @ moments, gap)
        raise SimulationError(f"friction of the pads along {', '.join(known.joints)} does not settle")

    def followed(self, motion: Motion) -> Motion:
        """With what friction does, and the forces of contacts that give way, from step to step."""
        rows = self.rows(motion.x[:1])
        self.begin(rows, motion.q[0], motion.f[0])
        begun = self._multipliers(rows, motion.q[0], motion.f[0], 0.0)
        kept = [Found(begun, self.grip, np.zeros(motion.q.shape[1]), np.zeros(len(begun)))]
        for k in range(1, len(motion.q)):
            if np.any(motion.x[k] != motion.x[k - 1]):
                rows = self.rows(motion.x[k : k + 1])
            kept.append(self.found(rows, motion.q[k], motion.f[k]))
            self.grip = kept[-1].grip
        forces = motion.forces.copy()
        forces[:, self.gives] = np.array([one.multipliers[self.gives] for one in kept])
        return replace(
            motion,
            forces=forces,
            friction=np.array([one.grip.forces for one in kept]),
            w=np.array([one.w for one in kept]),
            gap=np.array([one.gap for one in kept]),
        )

    def stiffness(self, rows: Rows, found: Found) -> Array:
        """What all of these forces change by with q, (n, n) N/m: of closed contacts, of pads that stick and slide."""
        known, multipliers, m = self.known, found.multipliers, len(self.gives)
        f, F, C, M = found.grip.forces, np.zeros((m, m)), np.zeros((m, rows.slopes.shape[1])), np.zeros((m, m))
        F[np.ix_(self.gives, self.gives)], C[self.gives] = rows.giving.F, rows.giving.C
        slides = np.abs(f) >= known.coefficients * np.abs(multipliers[known.pads])
        way = known.coefficients * np.sign(f) * slides
        M[known.pads, known.pads] = known.arms * way  # dm / dlambda
        for j, (c, gives) in enumerate(zip(known.cylinders, known.gives, strict=True)):
            if gives > 0.0:
                own = slice(known.first[j], known.first[j + 1])
                pads, grip = known.pads[own], known.stiffness[own] * ~slides[own]
                softened = gives / (1.0 + gives * grip.sum())
                F[c, c] += softened - gives
                F[c, pads] += softened * way[own] * np.sign(multipliers[pads])
                M[pads, c] = -known.arms[own] * np.sign(multipliers[pads]) * grip * softened
        F -= rows.answers @ M
        closed = np.flatnonzero(self.gives)[self._contacts.closed]
        answers = np.linalg.solve(F[np.ix_(closed, closed)], C[closed])
        return np.asarray((C - M.T @ rows.slopes)[closed].T @ answers)

    def _multipliers(self, rows: Rows, q: Array, f: Array, gap: Array | float) -> Array:
        found, gives = np.zeros(len(self._contacts.gives)), self._contacts.gives
        gaps = np.broadcast_to(gap, found.shape)[gives]
        found[gives] = self._contacts.pressed(rows.giving, rows.giving.C @ q + rows.giving.H @ f - gaps)
        return found
