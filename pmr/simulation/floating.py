"""Momenta of a boom that bends, and the equations of its base, coordinates and paths, at one instant.

The equations and their symbols are in the docstring of `pmr.simulation.free_base`.  Sizes: S sections, P paths, n
coordinates, i inputs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pmr.files.arrays import Array
from pmr.simulation.frame_motion import skew

_E = np.eye(3)
#: Levi-Civita's symbol.
CROSS = np.array([[np.cross(_E[l], _E[j]) for j in range(3)] for l in range(3)]).transpose(2, 0, 1)


@dataclass(frozen=True)
class Extensions:
    """Extensions (P,) of P paths in m, with first and second rates in m/s and m/s^2.

    The extension of a section is the distance of its tail ahead of the tail of the section before; that of the base is
    0.  After the extensions of the S sections there may be paths that move no section, such as a single body's slider.
    """

    value: Array
    rate: Array
    second: Array


@dataclass(frozen=True)
class Moments:
    """First moments beta of the sections' displacements by coordinates, with the paths at s (P,) in m.

    `value` is (S, 4, 3, n): for each section, the integral over its mass of 1, x, y or z times the displacement along
    x, y or z, per unit of each coordinate.
    """

    value: Array
    slope: Array  # d beta / d s, (S, 4, 3, n, P)
    curve: Array  # sum over j, k of (d^2 beta / d s_j d s_k) s_j' s_k', (S, 4, 3, n)


@dataclass(frozen=True)
class FrameMotion:
    """Angular velocity `omega` (3,) in rad/s of the boom's frame, and minus the acceleration of gravity, `weight` (3,).

    Both are in the axes of the boom's frame.
    """

    omega: Array
    weight: Array  # m/s^2, directed upwards


@dataclass(frozen=True)
class Shortening:
    """Part f q^T G q / 2 of a section's first moment along x that is quadratic in q: the boom is shorter as it bends.

    It belongs to the moment over 1 (`over` = 0) or over x (`over` = 1).  The factor f is 1 without a `cylinder`; with
    the number of a cylinder's extension as `cylinder`, f is -1 over the length of this extension.
    """

    section: int
    over: int
    G: Array  # (n, n)
    cylinder: int | None = None

    def factor(self, extended: Extensions) -> list[float]:
        """Factor f with its first and second rate, at the extensions `extended`; 1, 0 and 0 without a cylinder."""
        if self.cylinder is None:
            return [1.0, 0.0, 0.0]
        l, v, a = (getattr(extended, order)[self.cylinder] for order in ("value", "rate", "second"))
        return [-1.0 / l, v / l**2, a / l**2 - 2.0 * v**2 / l**3]


@dataclass(frozen=True)
class BaseEquations:
    """Equations of base (6,), coordinates (n,) and paths (P,): `mass` . (a, alpha, q'', s'') + `forces` = outer loads.

    a and alpha are linear and angular acceleration of the frame, q the coordinates and s the paths.  `mass` does not
    contain the mass matrix M of the coordinates.
    """

    mass: Array
    forces: Array  # left sides at zero accelerations


@dataclass(frozen=True)
class Boom:
    """Properties of a boom that do not change."""

    place: Array  # p (3,) m: position of the base section's tail from the pivot
    masses: Array  # (S,) kg
    first: Array  # (S, 3) kg m: int rho r over each section, with the position r from its tail
    inertia: Array  # (S, 3, 3) kg m^2: moment of inertia of each section about its tail
    loads: Array  # (S, 6, i): forces on each section, and moments about its tail, by all i inputs
    moments: Moments  # first moments by the coordinates
    shortened: list[Shortening]
    rotating: Array  # T_k (3, n, n) of `pmr.simulation.free_base`
    carried: Array  # N_jk (3, 3, n, n) of `pmr.simulation.free_base`

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return int(self.rotating.shape[1])

    @property
    def mass(self) -> float:
        """Mass of the whole boom in kg."""
        return float(self.masses.sum())


class BoomState:
    """Momenta and inertia of the boom at one instant; `q` and `rate` (n,) are coordinates and their rates."""

    def __init__(
        self, of: Boom, motion: FrameMotion, extended: Extensions, q: Array, rate: Array, moments: Moments | None = None
    ) -> None:
        self.of, self.omega, self.weight, self.extended, self.q, self.rate = (
            of, motion.omega, motion.weight, extended, q, rate,
        )  # fmt: skip
        e, S, P = _E[0], len(of.masses), len(extended.value)
        self.X, self.X_rate = (np.cumsum(values[:S]) for values in (extended.value, extended.rate))
        self.beyond = _moving_sections(S, P)
        self.d = of.place + np.outer(self.X, e)
        beta = of.moments if moments is None else moments
        beta_rate = beta.slope @ extended.rate
        self.J, self.mu = beta.value.copy(), beta.value @ q
        self.mu_rate = beta.value @ rate + beta_rate @ q
        self.mu_second = 2.0 * beta_rate @ rate + beta.curve @ q  # without the part that accelerations cause
        self.lean = np.einsum("sljne,n->slje", beta.slope, q)  # d mu / d path, (S, 4, 3, P)
        for term in of.shortened:
            f, f1, f2 = term.factor(extended)
            at, Gq = (term.section, term.over, 0), term.G @ q
            self.J[at] += f * Gq
            self.mu[at] += f * (q @ Gq) / 2.0
            self.mu_rate[at] += f * (rate @ Gq) + f1 * (q @ Gq) / 2.0
            # f1 contains the extension's rate; its second rate is an unknown
            growth = f2 - (
                0.0 if term.cylinder is None else extended.second[term.cylinder] / extended.value[term.cylinder] ** 2
            )
            self.mu_second[at] += f * (rate @ term.G @ rate) + 2.0 * f1 * (rate @ Gq) + growth * (q @ Gq) / 2.0
            if term.cylinder is not None:
                self.lean[*at, term.cylinder] += (q @ Gq) / 2.0 / extended.value[term.cylinder] ** 2
        self.masses = masses = of.masses
        self.own = masses[:, None] * self.d + of.first + self.mu[:, 0]  # first moment of each section about O
        self.s, self.s_rate = self.own.sum(axis=0), (masses * self.X_rate).sum() * e + self.mu_rate[:, 0].sum(axis=0)
        self.tq, self.tv = of.rotating @ q, of.rotating @ rate  # (3, n)
        self.h = self._second_moments(self.X_rate, self.mu_rate) + self.tq @ rate
        self.inertia, self.inertia_rate = self._inertia()

    def _second_moments(self, X: Array, mu: Array) -> Array:
        """Angular momentum (3,) about O, int rho r x r', of sections that move along the boom and bend.

        X (S,) in m/s are the rates of the sections along the boom.  mu (S, 4, 3) are the moments of the displacements'
        rates u': int rho u', then int rho x u', int rho y u' and int rho z u'.  With second rates as X and mu, it is
        int rho r x r''.
        """
        moments = np.outer(_E[0], X @ self.own).T + self.d.T @ mu[:, 0] + mu[:, 1:].sum(axis=0)
        return _skew_part(moments)

    def _inertia(self) -> Array:
        """Moment of inertia Theta about the pivot O, and its rate, in the boom's axes, (2, 3, 3)."""
        of, d, mu, mu_rate = self.of, self.d, self.mu, self.mu_rate
        rigid, along = of.masses[:, None] * d, np.zeros((3, 3))  # sums over sections of d S^T, v S^T and the like
        A = d.T @ (rigid / 2.0 + of.first + mu[:, 0]) + mu[:, 1:].sum(axis=0)
        along[0] = self.X_rate @ (rigid + of.first + mu[:, 0])
        A_rate = along + d.T @ mu_rate[:, 0] + mu_rate[:, 1:].sum(axis=0)
        self.Nq = of.carried @ self.q
        A += self.Nq @ self.q / 2.0
        A_rate += self.Nq @ self.rate
        inertia = _inertia_of_second_moments(A + A.T) + of.inertia.sum(axis=0)
        return np.array([inertia, _inertia_of_second_moments(A_rate + A_rate.T)])

    def mass(self) -> Array:
        """Mass matrix (6 + n + P, 6 + n + P) for the accelerations (a, alpha, q'', s'') of `BaseEquations`."""
        n, e, beyond, lean = self.of.size, _E[0], self.beyond, self.lean
        matrix = np.zeros((6 + n + beyond.shape[1],) * 2)
        matrix[:3, :3] = self.of.mass * np.eye(3)
        matrix[:3, 3:6] = -skew(self.s)
        matrix[3:6, 3:6] = self.inertia
        J = self.J
        matrix[:3, 6 : 6 + n] = J[:, 0].sum(axis=0)
        matrix[3:6, 6 : 6 + n] = self._moments_of(J) + self.tq
        # a path moves sections, and changes the moments of coordinates and of leaning cylinders
        matrix[:3, 6 + n :] = np.outer(e, self.masses @ beyond) + lean[:, 0].sum(axis=0)
        matrix[3:6, 6 + n :] = skew(e).T @ self.own.T @ beyond
        matrix[3:6, 6 + n :] += self._moments_of(lean)
        matrix[6 : 6 + n, 6 + n :] = np.einsum("sn,se->ne", J[:, 0, 0], beyond)
        coupling = beyond.T @ lean[:, 0, 0]
        matrix[6 + n :, 6 + n :] = beyond.T @ (self.masses[:, None] * beyond) + coupling + coupling.T
        return np.asarray(np.triu(matrix) + np.triu(matrix, 1).T)

    def _moments_of(self, J: Array) -> Array:
        """Moments (3, k) about O of k fields of displacements u, from their first moments J (S, 4, 3, k)."""
        return _skew_part(np.tensordot(self.d, J[:, 0], (0, 0)) + J[:, 1:].sum(axis=0))

    def forces(self) -> Array:
        """Forces (6 + n + P,) of velocities and weight: left sides of the equations with accelerations of zero."""
        omega, e, S = self.omega, _E[0], len(self.masses)
        spin = skew(omega)
        A = spin @ spin
        linear = self.of.mass * self.weight + A @ self.s + 2.0 * spin @ self.s_rate + self.mu_second[:, 0].sum(axis=0)
        turned = skew(self.s) @ self.weight + spin @ (self.inertia @ omega + self.h) + self.inertia_rate @ omega
        turned += self._second_moments(np.zeros(S), self.mu_second)
        y = np.empty((S, 4, 3))  # acceleration of points at rest in the frame
        y[:, 0] = self.weight + self.d @ A.T + 2.0 * np.outer(self.X_rate, spin @ e)
        y[:, 1:] = A.T
        modal = np.einsum("slj,sljn->n", y, self.J) + 2.0 * omega @ self.tv
        squared = np.outer(omega, omega) - (omega @ omega) * np.eye(3)
        modal += np.einsum("jk,jkn->n", squared, (self.Nq + self.Nq.transpose(1, 0, 2)) / 2.0)
        each = self.masses[:, None] * y[:, 0] + self.of.first @ A.T
        each = each + self.mu_second[:, 0] + 2.0 * self.mu_rate[:, 0] @ spin.T + self.mu[:, 0] @ A.T
        path = self.beyond.T @ each[:, 0] + np.einsum("slj,slje->e", y, self.lean)
        return np.concatenate([linear, turned, modal, path])


def _inertia_of_second_moments(A: Array) -> Array:
    """Moment of inertia (3, 3), tr(A) I - A, from the second moments A (3, 3)."""
    return np.asarray(np.trace(A) * np.eye(3) - A)


@lru_cache(maxsize=8)
def _moving_sections(sections: int, paths: int) -> Array:
    """Matrix (S, P) with 1 where a path moves a section: the path's own section and all sections after that."""
    matrix = np.hstack([np.tril(np.ones((sections, sections))), np.zeros((sections, paths - sections))])
    matrix.flags.writeable = False
    return matrix


def _skew_part(A: Array) -> Array:
    """Sums (3, k) of r x u for k fields u, from the moments A (3, 3, k), sums of r_l u_j."""
    return np.array([A[1, 2] - A[2, 1], A[2, 0] - A[0, 2], A[0, 1] - A[1, 0]])
