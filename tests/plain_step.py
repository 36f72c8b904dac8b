"""Laws of the kernel in NumPy, slow and plain: its oracle, on coordinates q of the bodies and with dense matrices.

It shares with the kernel only what a system says of itself (`pmr.system.assembly`), uses neither modes nor tables, and
finds the closed contacts by trying all sets.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pmr import System
from pmr.files.arrays import Array
from pmr.system.assembly import Assembly
from pmr.system.contacts import Friction
from pmr.system.states import ContactRows


def complementary(A: Array, b: Array, pushes: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """Solve A lambda = b + w, with lambda, w >= 0 and lambda w = 0 at contacts that push and w = 0 at others.

    Return lambda (m,) and whether each contact is closed (m,), for A (m, m) and b (m,); raise AssertionError if no set
    of closed contacts solves it.
    """
    free = np.flatnonzero(pushes)
    for states in product([True, False], repeat=len(free)):
        closed = np.ones(len(b), np.bool_)
        closed[free] = states
        forces = np.zeros(len(b))
        forces[closed] = np.linalg.solve(A[np.ix_(closed, closed)], b[closed])
        gaps, size = A @ forces - b, np.abs(A) @ np.abs(forces) + np.abs(b)
        if np.all(forces[free] >= -1e-12 * np.abs(forces).max(initial=0.0)) and np.all(
            gaps[free] >= -1e-12 * size[free]
        ):
            return forces, closed
    raise AssertionError("no complementary solution")


@dataclass
class Plain:
    """Generalized-alpha of constant step, with contacts at position level, friction, and terms that vary in time.

    The system has n coordinates, m contacts, J joints, i inputs and o outputs.
    """

    system: System
    step: float
    rho_inf: float
    pushed_once: float = 0.0  # J: work of terms and friction

    def __post_init__(self) -> None:
        """Assemble dense matrices, and set the parameters of generalized-alpha."""
        self.assembly = a = Assembly(self.system)
        self.M, self.D, self.K, self.B = (A.toarray() for A in (a.M, a.D, a.K, a.B))
        rho = self.rho_inf
        self.alpha_m, self.alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        self.gamma = 0.5 + self.alpha_f - self.alpha_m
        self.beta = (self.gamma + 0.5) ** 2 / 4.0
        self.pushes = ~np.isnan(self.system.clearance)
        self.clearance = np.where(self.pushes, self.system.clearance, 0.0)
        self.friction = Friction.from_contacts(self.system.contacts)
        self.rubbed = np.zeros(0 if self.friction is None else len(self.friction.pads))
        self.energy = np.zeros(2)

    def begin(self, x: Array, f: Array, q: Array, v: Array, a: Array, forces: Array, s: Array | None = None) -> None:
        """Start at coordinates q, rates v, accelerations a (n,) and contact forces (m,), with joints at s (J,) in m.

        The contacts have their sides at x in m, and the loads are f (i,).
        """
        self.x, self.f, self.q, self.v, self.a, self.alike = x, f, q, v, a, a.copy()
        self.forces, self.shares = forces.copy(), [forces.copy(), forces.copy()]  # and what they leave: force, share
        self.travelled, self.rows = s, self.assembly.contact_rows(x)
        self.w = np.zeros(len(q))
        if self.friction is not None:
            drives = np.where(self.friction.cylinders >= 0, forces[self.friction.cylinders], 0.0)
            self.drives, self.gap = drives, np.zeros(len(forces))
        self.energy = np.array([self.stored(), 0.0])

    def stored(self) -> float:
        """Stored energy in J: kinetic energy, and strain energy of bodies, contacts and residual flexibility."""
        rows, q, v, f, forces = self.rows, self.q, self.v, self.f, self.forces
        return float(
            0.5 * (v @ self.M @ v + q @ self.K @ q + forces @ rows.F @ forces + f @ self.assembly.energy @ f)
            - forces @ rows.H @ f
        )

    def left_by(self, force: Array, share: Array) -> tuple[Array, Array, Array]:
        """Multiples (m,) of -M^-1 C^T by which the last step's contacts change a prediction of q, v and a.

        `force` (m,) are their forces and `share` (m,) those in the weighted acceleration.
        """
        h, am, af, beta, gamma = self.step, self.alpha_m, self.alpha_f, self.beta, self.gamma
        a = af / (1.0 - am) * force - am / (1.0 - am) * share
        v = h * (1.0 - gamma) * share + h * gamma * a
        q = h**2 * (0.5 - beta) * share + h**2 * beta * a
        return q, v, a

    def predict(self) -> tuple[Array, Array, Array]:
        """Prediction of q, v and a (n,) at the end of the step, without the step's own acceleration."""
        h, am, af = self.step, self.alpha_m, self.alpha_f
        a = (af * self.a - am * self.alike) / (1.0 - am)
        q = self.q + h * self.v + h**2 * ((0.5 - self.beta) * self.alike + self.beta * a)
        return q, self.v + h * ((1.0 - self.gamma) * self.alike + self.gamma * a), a

    def take(self, x: Array, f: Array, c: Sequence[float] = (), s: Array | None = None) -> None:
        """Take one step, to sides at x, loads f (i,), amplitudes c of the terms and joints at s (J,) at its end."""
        h, gain = self.step, (1.0 - self.alpha_f) / (1.0 - self.alpha_m)
        dq, dv = self.beta * h**2 * gain, self.gamma * h * gain
        old, rows = self.rows, self.assembly.contact_rows(x)
        K_t = self.assembly.stiffness(c).toarray() - self.K
        D_t = self.assembly.damping(c).toarray() - self.D
        S = self.M + dv * (self.D + D_t) + dq * (self.K + K_t)
        A = dq * rows.C @ np.linalg.solve(S, rows.C.T) + rows.F
        q0, v0, a0 = self.predict()
        kept = self.shares
        released = np.zeros(len(self.forces), np.bool_)
        w, gap, rubbed = np.zeros(len(q0)), np.zeros(len(self.forces)), self.rubbed
        for _ in range(200):
            push = self.B @ f + w - (self.K + K_t) @ q0 - (self.D + D_t) @ v0
            b = rows.C @ (q0 + dq * np.linalg.solve(S, push)) + rows.H @ f - gap - self.clearance
            forces, closed = complementary(A, b, self.pushes)
            opened = ~closed & ~released & ((kept[0] != 0.0) | (kept[1] != 0.0))
            if opened.any() and self.pushes.any():
                back = self.left_by(np.where(opened, kept[0], 0.0), np.where(opened, kept[1], 0.0))
                q0, v0, a0 = (
                    one + np.linalg.solve(self.M, rows.C.T @ of) for one, of in zip((q0, v0, a0), back, strict=True)
                )
                kept = [np.where(opened, 0.0, one) for one in kept]
                released |= opened
                continue
            if self.friction is None:
                break
            assert s is not None
            w_new, gap_new, rubbed_new = self.rub(rows, A, forces, rubbed, x, s)
            settled = np.abs(rubbed_new - rubbed).max() <= 1e-13 * np.abs(rubbed_new).max(initial=0.0)
            w, gap, rubbed = w_new, gap_new, rubbed_new
            if settled:
                break
        acceleration = np.linalg.solve(S, push - rows.C.T @ forces)
        q, v, alike = q0 + dq * acceleration, v0 + dv * acceleration, a0 + gain * acceleration
        w = w - K_t @ q - D_t @ v
        self.account(old, rows, q, f, forces, w, gap)
        _, ahead, left = self.left_by(*kept)
        self.impulses = dv * forces + ahead
        self.x, self.q, self.v, self.a, self.alike, self.f = x, q, v, acceleration, alike, f
        self.shares, self.forces, self.closed = [forces, gain * forces + left], forces, closed
        self.rows, self.w, self.energy[0] = rows, w, self.stored_at(rows, f)
        if self.friction is not None:
            self.rubbed, self.gap, self.travelled = rubbed, gap, s
            driven = np.where(self.friction.cylinders >= 0, forces[self.friction.cylinders], 0.0)
            self.drives = driven + self.friction.joint_totals(rubbed) * (self.friction.cylinders >= 0)

    def stored_at(self, rows: ContactRows, f: Array) -> float:
        """Set rows and loads, and return the stored energy in J."""
        self.rows, self.f = rows, f
        return self.stored()

    def account(
        self, old: ContactRows, rows: ContactRows, q: Array, f: Array, forces: Array, w: Array, gap: Array
    ) -> None:
        """Add the work of the step in J: that of loads, of rows that moved, of terms, and of friction's gaps."""
        f_mean, mean, moved = (f + self.f) / 2.0, (forces + self.forces) / 2.0, q - self.q
        energy = self.assembly.energy
        work = (self.B @ f_mean) @ moved + 0.5 * (f @ energy @ f - self.f @ energy @ self.f)
        work -= ((rows.H + old.H) / 2.0 @ f_mean) @ (forces - self.forces)
        work += mean @ (rows.C - old.C) @ (q + self.q) / 2.0 - 0.5 * mean @ (rows.F - old.F) @ mean
        work += (w + self.w) / 2.0 @ moved
        if self.friction is not None:
            work -= mean @ (gap - self.gap)
        self.energy[1] += float(work)

    def rub(
        self, rows: ContactRows, A: Array, forces: Array, rubbed: Array, x: Array, s: Array
    ) -> tuple[Array, Array, Array]:
        """Friction that follows from contact forces (m,): its forces (n,), its gaps (m,), and its values by pad.

        `rubbed` are its values in the iteration before; at joints that give way they change by a fifth of the
        difference only.
        """
        known = self.friction
        assert known is not None and self.travelled is not None
        new = rubbed.copy()
        for i, cylinder in enumerate(known.cylinders):
            own = slice(known.first_pads[i], known.first_pads[i + 1])
            sliding, at_rest, falls_by = known.laws[own].T
            speed = abs(s[i] - self.travelled[i]) / self.step
            mu = sliding + np.maximum(at_rest - sliding, 0.0) * np.exp(-speed / falls_by)
            limits = mu * np.abs(forces[known.pads[own]])
            moved, gives, before = s[i] - self.travelled[i], known.cylinder_compliance[i], rubbed[own].sum()
            if gives > 0.0:
                moved -= gives * (forces[cylinder] + before - self.drives[i])
            slid = np.clip(self.rubbed[own] + known.stiffness[own] * moved, -limits, limits)
            new[own] = slid if gives == 0.0 else rubbed[own] + 0.2 * (slid - rubbed[own])  # under-relaxed
        moments = known.moments(new, forces)
        gap = known.compressions(new) - self.assembly.contact_motions_by_moments(x) @ moments
        return self.assembly.row_rates(x, np.ones(len(x))).T @ moments, gap, new

    def outputs(self) -> Array:
        """Outputs y (o,) in the current state."""
        y = self.assembly.outputs @ self.q + self.assembly.direct @ self.f - self.rows.X @ self.forces
        if self.friction is not None:
            y = y + self.assembly.outputs_by_moments(self.x) @ self.friction.moments(self.rubbed, self.forces)
        return np.asarray(y)
