r"""Contacts of a system step by step: forces of those that give way, and their energy and work.

docs/system_of_bodies.md, section 3, has the balance.

With friction of pads (`pmr.system.contacts`), the forces of contacts that give way are computed together with it.  In
every iteration Exudyn calls for these forces :math:`\lambda` at coordinates q.  With loads f and the contacts' rows C,
displacements H by loads and flexibility F, they fulfil

.. math:: F \lambda = C q + H f - g, \qquad g = \sum f_j / k - A\, m, \qquad w = C'^T m

with the gaps g, the displacements f_j / k of cylinders by the friction f_j of joints, the moments m of friction, the
displacements A m that these moments cause in the contacts by residual flexibility, and the forces w of the moments on
q.  Newton's method uses the stiffness of the pads that stick.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from pmr.errors import InputError, SimulationError
from pmr.files.arrays import Array
from pmr.kernel.laws import ContactError, solve_contact
from pmr.simulation.exudyn.equations import Equations, Inputs
from pmr.simulation.start import Grip, slide
from pmr.simulation.stepping import half_form, row_products, step_means
from pmr.system.contacts import Friction
from pmr.system.states import ContactRows

#: Most values that are computed at once, which bounds the memory of a long simulation.
ENTRIES = 1_000_000


class Contacts:
    """Contacts of a system, and the forces of those that give way, some of which may only push.

    Sizes: n coordinates, i inputs, m contacts, of which m' give way.  A contact has one or two sides; x (sides,) are
    positions of sides on bodies.
    """

    def __init__(self, equations: Equations, inputs: Inputs) -> None:
        """Find which contacts of `equations` are rigid and which give way, at the positions of `inputs` at t = 0."""
        self._equations = equations
        self.rigid = equations.rows(inputs.positions(0.0)).rigid[0]
        self.gives = ~self.rigid
        self._names = list(compress(equations.system.contact_names, self.gives))
        clearance = equations.system.clearance[self.gives]
        self._pushes, self._clearance = ~np.isnan(clearance), np.nan_to_num(clearance)
        #: (m',) mask: contacts that were closed when forces were computed last.
        self.closed = ~self._pushes

    @property
    def any_pushes(self) -> bool:
        """Whether any contact only pushes."""
        return bool(self._pushes.any())

    def springs(self, x: Array) -> Array:
        """Matrices K + C^T F^-1 C and B - C^T F^-1 H as one array (T, n, n + i), at side positions x (T, sides) m.

        C, F and H are the matrices of contacts that give way.  Not to be called if any of these contacts only pushes.
        Raises SimulationError if F is singular.
        """
        rows, K, B = self.rows(x), self._equations.K, self._equations.B
        answers = self._solve_flexibility(rows, np.concatenate([rows.C, -rows.H], axis=2))
        return np.asarray(np.hstack([K, B]) + rows.C.transpose(0, 2, 1) @ answers)

    def rows(self, x: Array) -> ContactRows:
        """Rows of the contacts that give way, with the sides of all contacts at x (T, sides) m."""
        return self._equations.rows(x).select(self.gives)

    def forces(self, rows: ContactRows, q: Array, f: Array) -> Array:
        """Forces (T, m') in N of contacts that give way, by `rows` at T times, coordinates q (T, n) and loads f (T, i).

        If some contacts only push, the closed contacts are searched at each time.  The search begins with the contacts
        that were closed at the time before.  Raises SimulationError if contacts depend on each other, or if it can't be
        settled which contacts are closed.
        """
        motion = np.einsum("tmn,tn->tm", rows.C, q) + np.einsum("tmi,ti->tm", rows.H, f)
        if not self.any_pushes:
            return np.asarray(self._solve_flexibility(rows, motion[:, :, None])[:, :, 0])
        return np.array([self.forces_by_motion(rows.at_time(k), gaps) for k, gaps in enumerate(motion)])

    def forces_by_motion(self, rows: ContactRows, motion: Array) -> Array:
        """Forces (m',) in N of contacts that give way with `rows` at one time, by `motion` = C q + H f (m',) in m.

        The closed contacts are stored for the next call.  Raises SimulationError as `forces`.
        """
        try:
            forces, self.closed = solve_contact(rows.F, motion - self._clearance, self._pushes, self.closed)
        except ContactError as error:
            raise SimulationError(f"the contacts {', '.join(self._names)}: {error}") from None
        return forces

    def _solve_flexibility(self, rows: ContactRows, right: Array) -> Array:
        """Matrices F^-1 `right` (T, m', k), from `right` (T, m', k), with the flexibility F of the `rows` at T times.

        Raises SimulationError, with the contacts' names, if F is singular.
        """
        try:
            return np.asarray(np.linalg.solve(rows.F, right))
        except np.linalg.LinAlgError:
            raise SimulationError(f"the contacts {', '.join(self._names)} depend on each other") from None


@dataclass(frozen=True)
class Motion:
    """Motion of a system at N times: side positions x (N, sides) m, coordinates q and rates v (N, n), loads f (N, i).

    `forces` (N, m) in N are the contact forces, c (N, K) the amplitudes of terms.
    """

    x: Array
    q: Array
    v: Array
    f: Array
    forces: Array
    c: Array
    # friction of n' pads (N, n') in N, forces w of its moments (N, n) in N, gaps g (N, m) in m; (N, 0) without friction
    friction: Array
    w: Array
    gap: Array

    def part(self, steps: slice) -> Motion:
        """Motion at the times that the slice `steps` selects."""
        return Motion(*(array[steps] for array in vars(self).values()))


@dataclass(frozen=True)
class Balance:
    """Stored energy (N,) in J at N times, and work (N,) in J done since the first one."""

    stored: Array
    work: Array


def balance_energy(equations: Equations, contacts: Contacts, motion: Motion) -> Balance:
    """Compute stored energy and work of a motion, and write the forces of contacts that give way into `motion`.

    If pads rub, `motion` has these forces already, and they are not computed again.  Times are evaluated in blocks of
    some thousand, which limits the memory.
    """
    m, (n, i) = len(equations.system.contacts), equations.B.shape
    N, block = len(motion.q), max(2, ENTRIES // max(1, m * (n + m + i)))
    stored, work = np.zeros(N), np.zeros(N)
    for first in range(0, max(1, N - 1), block - 1):
        steps = slice(first, min(first + block, N))
        part, rows = motion.part(steps), equations.rows(motion.x[steps])
        g = contacts.gives
        if not part.friction.shape[1]:
            part.forces[:, g] = contacts.forces(rows.select(g), part.q, part.f)
        with np.errstate(over="ignore", invalid="ignore"):
            of_part = _energy_and_work(equations, rows, part)
        stored[steps], work[steps] = of_part.stored, work[first] + of_part.work
    return Balance(stored, work)


def _energy_and_work(equations: Equations, rows: ContactRows, motion: Motion) -> Balance:
    """Energy (T,) in J of the whole system with its contacts, kinetic and elastic, and work (T,) in J done on it.

    The work is counted from the first of the T times of `motion` on; `rows` are the contacts' rows at these times.
    """
    q, f, forces = motion.q, motion.f, motion.forces
    load_gaps, bent = np.einsum("tmi,ti->tm", rows.H, f), np.einsum("tmn,tn->tm", rows.F, forces)
    stored = half_form(equations.M, motion.v) + half_form(equations.K, q) + row_products(forces, bent / 2.0 - load_gaps)
    at_loads = np.asarray(q @ equations.B) + f @ equations.assembly.energy - np.einsum("tmi,tm->ti", rows.H, forces)
    C, H, F = (np.diff(part, axis=0) for part in (rows.C, rows.H, rows.F))
    turned = np.einsum("tmn,tn->tm", C, step_means(q)) + np.einsum("tmi,ti->tm", H, step_means(f))
    turned -= np.einsum("tmn,tn->tm", F, step_means(forces)) / 2.0
    work = row_products(step_means(f), np.diff(at_loads, axis=0)) + row_products(step_means(forces), turned)
    if equations.system.terms:
        work += row_products(step_means(equations.assembly.term_forces(q, motion.v, motion.c)), np.diff(q, axis=0))
    if motion.friction.shape[1]:
        work += row_products(step_means(motion.w), np.diff(q, axis=0)) - row_products(
            step_means(forces), np.diff(motion.gap, axis=0)
        )
    stored += row_products(f, f @ equations.assembly.energy) / 2.0
    return Balance(stored, np.append(0.0, np.cumsum(work)))


#: Most iterations for friction; change of a gap, over the gap of pads that slide, that is round-off.
LIMIT, CONVERGED = 200, 1e-12


@dataclass(frozen=True)
class PadRows:
    """Contact rows at one time: rows of the m' contacts that give way, and matrices of all m contacts for friction."""

    giving: ContactRows
    slopes: Array  # (m, n) 1/m: C', derivatives of the rows by the side positions
    answers: Array  # (m, m) 1/N: displacements A of contacts by unit moments
    s: Array  # (J,) m: path coordinates of the joints with friction


@dataclass(frozen=True)
class PadState:
    """State of contacts and pads: contact forces (m,) in N, friction, forces w (n,) in N and gaps g (m,) in m.

    Friction exerts moments on the bodies; w are the forces of these moments on the coordinates.  The contact forces of
    rigid contacts are zero.
    """

    multipliers: Array
    grip: Grip
    w: Array
    gap: Array


class Pads:
    """Contacts that only push or rub, from step to step.

    Raises InputError if a pad that rubs does not give way.
    """

    def __init__(self, equations: Equations, contacts: Contacts, law: Friction | None) -> None:
        """Prepare the steps of the contacts in `contacts`; `law` is the friction of pads, None without friction.

        `equations` are those of the system.  Raises InputError if a pad that rubs does not give way.
        """
        system = equations.system
        for pad in () if law is None else law.pads:
            if contacts.rigid[pad]:
                allowed = (
                    "more than 0 m/N, or residual flexibility, is allowed: Exudyn finds friction by what gives way"
                )
                raise InputError("system", f"contacts.{system.contact_names[pad]}.compliance", 0.0, allowed)
        self._equations, self._contacts, self.law, self.gives = equations, contacts, law, contacts.gives
        #: Function of t in s that returns loads (i,) in N by the motion of the base; zero on the ground.
        self.inertia: Callable[[float], Array] = lambda t: np.zeros(equations.B.shape[1])
        self._joints = [
            next((k, side.place) for k, side in enumerate(system.sides) if side.place.path == joint)
            for joint in (() if law is None else law.joints)
        ]
        self.grip = Grip()
        self.t = 0.0  # s: end of the last step

    def rows(self, x: Array) -> PadRows:
        """Rows of the contacts with their sides at x (1, sides) in m, with the slopes that friction needs."""
        assembly, giving, m = self._equations.assembly, self._contacts.rows(x).at_time(0), len(self.gives)
        if self.law is None:
            return PadRows(giving, np.zeros((m, giving.C.shape[1])), np.zeros((m, m)), np.zeros(0))
        s = np.array([(x[0, k] - place.at) / place.rate for k, place in self._joints])
        return PadRows(
            giving, assembly.row_rates(x[0], np.ones(x.shape[1])), assembly.contact_motions_by_moments(x[0]), s
        )

    def answers(self, rows: PadRows, f: Array) -> Array:
        """Forces F^-1 H f (m',) in N that the loads f (i,) cause in the m' contacts that give way, in bodies at q = 0.

        `rows` has the flexibility F (m', m') of these contacts, and H (m', i), their displacements by unit loads.
        """
        displacements = rows.giving.H @ f
        return np.asarray(np.linalg.solve(rows.giving.F, displacements)) if f.any() else displacements

    def begin(self, rows: PadRows, q: Array, f: Array) -> None:
        """Set the state at t = 0, at rest without friction, with coordinates q (n,) and loads f (i,) in N.

        `rows` are the contact rows at t = 0.
        """
        self.t = 0.0
        self.grip = Grip.at_start(self._equations.system.contacts, rows.s, self._multipliers(rows, q, f, 0.0))

    def end(self, rows: PadRows, q: Array, f: Array, t: float) -> PadState:
        """End the step at t s with `rows`, coordinates q (n,) and loads f (i,), and return the state of the contacts.

        The next step starts from the friction in this state.  Arguments and errors are those of `state`.
        """
        ended = self.state(rows, q, f, t)
        self.grip, self.t = ended.grip, t
        return ended

    def state(self, rows: PadRows, q: Array, f: Array, t: float) -> PadState:
        """State at the end of the present step at t s, with coordinates q (n,) under loads f (i,) in N.

        `rows` are the contact rows at t.  The next step still starts from the friction that `end` stored last.  Raises
        SimulationError if friction does not settle.
        """
        law, grip, gap = self.law, self.grip, np.zeros(len(self.gives))
        if law is None:
            return PadState(self._multipliers(rows, q, f, 0.0), grip, np.zeros(len(q)), gap)
        diagonal = np.zeros(len(gap))
        diagonal[self.gives] = np.diag(rows.giving.F)
        for _ in range(LIMIT):
            multipliers, last = self._multipliers(rows, q, f, gap), grip
            sums = law.joint_totals(last.forces)
            grip = slide(law, self.grip, sums, rows.s, t - self.t, multipliers, np.diag(diagonal))
            moments = law.moments(grip.forces, multipliers)
            old, gap = gap, law.compressions(grip.forces) - rows.answers @ moments
            most = law.compressions(grip.limits) + np.abs(rows.answers) @ np.abs(law.moments(grip.limits, multipliers))
            if np.abs(gap - old).max() <= CONVERGED * most.max():
                return PadState(multipliers, grip, rows.slopes.T @ moments, gap)
        raise SimulationError(f"friction of the pads along {', '.join(law.joints)} does not settle")

    def add_friction(self, motion: Motion, t: Array) -> Motion:
        """Return `motion` at the times t (N,) in s, completed by friction and the forces of contacts that give way.

        The gaps (N, m) in m of the contacts and the forces w (N, n) by which friction acts on the coordinates are added
        too.  All are computed step by step from the coordinates and loads of `motion`.
        """
        rows = self.rows(motion.x[:1])
        self.begin(rows, motion.q[0], motion.f[0])
        begun = self._multipliers(rows, motion.q[0], motion.f[0], 0.0)
        steps = [PadState(begun, self.grip, np.zeros(motion.q.shape[1]), np.zeros(len(begun)))]
        for k in range(1, len(motion.q)):
            if np.any(motion.x[k] != motion.x[k - 1]):
                rows = self.rows(motion.x[k : k + 1])
            steps.append(self.end(rows, motion.q[k], motion.f[k], float(t[k])))
        forces = motion.forces.copy()
        forces[:, self.gives] = np.array([step.multipliers[self.gives] for step in steps])
        return replace(
            motion,
            forces=forces,
            friction=np.array([step.grip.forces for step in steps]),
            w=np.array([step.w for step in steps]),
            gap=np.array([step.gap for step in steps]),
        )

    def stiffness(self, rows: PadRows, state: PadState) -> Array:
        """Stiffness (n, n) in N/m of closed contacts and of pads in a `state`: the derivative by q of C^T lambda - w.

        C are the contact `rows`, lambda the contact forces and w the generalised forces of friction.  `state` has to be
        the state computed last, because only its closed contacts are stored.
        """
        law, multipliers, m = self.law, state.multipliers, len(self.gives)
        F, C, M = np.zeros((m, m)), np.zeros_like(rows.slopes), np.zeros((m, m))
        F[np.ix_(self.gives, self.gives)], C[self.gives] = rows.giving.F, rows.giving.C
        if law is not None:
            f, limits, pressed = state.grip.forces, state.grip.limits, np.abs(multipliers[law.pads])
            slides = np.abs(f) >= limits
            way = np.divide(limits, pressed, out=np.zeros(len(f)), where=pressed > 0.0) * np.sign(f) * slides
            M[law.pads, law.pads] = law.arms * way  # dm / dlambda
            for j, (c, gives) in enumerate(zip(law.cylinders, law.cylinder_compliance, strict=True)):
                if gives > 0.0:
                    of_joint = slice(law.first_pads[j], law.first_pads[j + 1])
                    pads, grip = law.pads[of_joint], law.stiffness[of_joint] * ~slides[of_joint]
                    softened = gives / (1.0 + gives * grip.sum())
                    F[c, c] += softened - gives
                    F[c, pads] += softened * way[of_joint] * np.sign(multipliers[pads])
                    M[pads, c] = -law.arms[of_joint] * np.sign(multipliers[pads]) * grip * softened
            F -= rows.answers @ M
        closed = np.flatnonzero(self.gives)[self._contacts.closed]
        answers = np.linalg.solve(F[np.ix_(closed, closed)], C[closed])
        return np.asarray((C - M.T @ rows.slopes)[closed].T @ answers)

    def _multipliers(self, rows: PadRows, q: Array, f: Array, gap: Array | float) -> Array:
        """Contact forces (m,) in N at coordinates q (n,) under loads f (i,), with gaps `gap` (m,) in m by friction.

        The forces are zero for rigid contacts.  `gap` may be one number for all contacts.  Raises SimulationError as
        `Contacts.forces_by_motion`.
        """
        multipliers = np.zeros(len(self.gives))
        gaps = np.broadcast_to(gap, multipliers.shape)[self.gives]
        multipliers[self.gives] = self._contacts.forces_by_motion(
            rows.giving, rows.giving.C @ q + rows.giving.H @ f - gaps
        )
        return multipliers
