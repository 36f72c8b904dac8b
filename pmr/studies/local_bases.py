r"""Local bases: modes with the slider held, one set for each of several positions, interpolated along the path.

.. math::
    u = V(s)\, p, \qquad V^T M V \ddot p + (V^T D V + 2 \dot s V^T M V')\, \dot p
    + \big(V^T K V + \ddot s V^T M V' + \dot s^2 V^T M V'' + \dot s V^T D V'\big)\, p = V^T B f

No row is left: the modes hold the slider where they were computed, and nearly so between.  Modes at neighbouring
positions are rotated onto each other (Procrustes) before cubic splines go through them.  Matrices interpolated without
the terms in V' and V'' are what parametric model reduction has for parameters that don't change while it simulates, and
what is also used for those that do.

Amsallem, Farhat: An online method for interpolating linear parametric reduced-order models, SIAM Journal on Scientific
Computing 33, 2011 (alignment); Panzer, Mohring, Eid, Lohmann: Parametric model order reduction by matrix
interpolation, at - Automatisierungstechnik 58, 2010; Fischer, Eberhard: Application of parametric model reduction with
matrix interpolation for simulation of moving loads in elastic multibody systems, Advances in Computational Mathematics
41, 2015.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from pmr.errors import SimulationError
from pmr.reduced.model import ReducedModel
from pmr.simulation import Excitation
from pmr.simulation.native.compilation import compiled
from pmr.simulation.native.scheme import GeneralizedAlpha

Array = NDArray[np.float64]

#: Positions of the modes on a length of the body, and intervals of the tables between two of them.
POSITIONS, BETWEEN = 200, 2


@dataclass(frozen=True)
class LocalMotion:
    """Outputs (T, o) in m, energy (T,) in J, and wall seconds of the steps alone."""

    displacement: Array
    energy: Array
    seconds: float


@dataclass(frozen=True)
class LocalModel:
    """Tables along the path of one model with local bases."""

    vectors: CubicSpline  # V(s) (n, r) in the modal coordinates of the full model
    tables: Array  # (g, 4, w): polynomials of M, D + ..., flattened, between equally spaced places, see `_march`
    body: ReducedModel  # the full model in modal coordinates

    def simulate(self, excitation: Excitation, every: int = 1) -> LocalMotion:
        """From rest, each `every`-th step of it; raises SimulationError if the motion isn't finite."""
        stepping = excitation.stepping
        around = np.arange(-1, stepping.steps + 2) * stepping.step
        s = np.asarray(excitation.path.value(around), float)
        bounds = self.vectors.x[[0, -1]]
        course, f = _central_differences(np.clip(s, *bounds), stepping.step), excitation.forces(self.body.input_names)
        r = self.vectors.c.shape[-1]
        q, v, work = np.zeros((len(f), r)), np.zeros((len(f), r)), np.zeros((6 * r + len(f[0]) + 8, r))
        one = GeneralizedAlpha(stepping.step, stepping.rho_inf)
        scheme = np.array([one.step, one.alpha_m, one.alpha_f, one.gamma, one.beta])
        grid = np.array([bounds[0], np.ptp(bounds) / len(self.tables)])
        arguments = self.tables, grid, course, np.ascontiguousarray(f), scheme, work, q, v
        _march(*arguments, 1)  # none: what is compiled or loaded is not the solver's time
        begin = time.perf_counter()
        _march(*arguments, len(f))
        seconds = time.perf_counter() - begin
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise SimulationError("the motion of local bases grows without bound")
        return LocalMotion(*self._recovered(course[:, ::every], q[::every], v[::every]), seconds)

    def _recovered(self, course: Array, q: Array, v: Array) -> tuple[Array, Array]:
        omega2, outputs = np.diagonal(self.body.K), np.empty((len(q), len(self.body.outputs)))
        energy = np.empty(len(q))
        for first in range(0, len(q), 512):
            part = slice(first, first + 512)
            V, V1 = self.vectors(course[0, part]), self.vectors(course[0, part], 1)
            u = np.einsum("tnr,tr->tn", V, q[part])
            rate = np.einsum("tnr,tr->tn", V, v[part])
            rate += course[1, part, None] * np.einsum("tnr,tr->tn", V1, q[part])
            outputs[part] = u @ self.body.outputs.T
            energy[part] = (rate**2).sum(axis=1) / 2.0 + u**2 @ omega2 / 2.0
        return outputs, energy


def positions(body: ReducedModel, bounds: tuple[float, float]) -> Array:
    """Where modes are taken on a path within `bounds`, in m."""
    count = round(POSITIONS * (bounds[1] - bounds[0]) / np.ptp(body.output_positions))
    return np.linspace(*bounds, max(5, count) + 1)


def held_modes(body: ReducedModel, s: float, r: int) -> Array:
    """The r lowest modes (n, r) of a body in modal coordinates with its rows held at s in m, M-orthonormal."""
    C = body.C(s)
    free = scipy.linalg.qr(C.T)[0][:, len(C) :]
    _, modes = scipy.linalg.eigh(free.T @ (np.diagonal(body.K)[:, None] * free), subset_by_index=[0, r - 1])
    return np.asarray(free @ modes)


def aligned(modes: Array) -> Array:
    """Sets of modes (k, n, r), each rotated onto the one before: the polar factor of V_k^T V_{k-1}."""
    found = [modes[0]]
    for one in modes[1:]:
        U, _, Wt = np.linalg.svd(one.T @ found[-1])
        found.append(one @ (U @ Wt))
    return np.array(found)


def local_model(body: ReducedModel, s: Array, r: int, moving: bool) -> LocalModel:
    """A model of a body in modal coordinates with r modes at each of the equally spaced positions s, in m.

    `moving` keeps the terms in V' and V''.  Raises ValueError if rows give way: modes with the slider held don't let
    it.
    """
    if np.any(body.row_compliance > 0.0):
        raise ValueError("local bases hold rigid rows")
    vectors = CubicSpline(s, aligned(np.array([held_modes(body, float(x), r) for x in s])))
    omega2, D = np.diagonal(body.K), body.D
    rows = []
    places = np.linspace(s[0], s[-1], (len(s) - 1) * (BETWEEN if moving else 1) + 1)
    for x in places:
        V, V1, V2 = (vectors(x, order) for order in range(3))
        still = [V.T @ V, V.T @ D @ V, V.T @ (omega2[:, None] * V)]
        convected = [V.T @ V1, V.T @ V2, V.T @ D @ V1] if moving else [np.zeros((r, r))] * 3
        rows.append(np.concatenate([np.ravel(one) for one in (*still, *convected, (V.T @ body.B).T)]))
    tables = CubicSpline(places, np.array(rows))
    return LocalModel(vectors, np.ascontiguousarray(np.moveaxis(tables.c, 1, 0)), body)


@compiled
def _march(
    tables: Array, grid: Array, course: Array, f: Array, scheme: Array, work: Array, q: Array, v: Array, count: int
) -> None:
    """Steps 1 to `count` - 1 from rest: q and v (T, r) under loads f (T, i), along s, s' and s'' in `course` (3, T).

    Generalized-alpha, O(r^3) a step.  A table's rows at a place are M, D, K, V^T M V', V^T M V'', V^T D V' (each r x r)
    and (V^T B)^T, flattened.  `tables` (g, 4, w) hold from `grid[0]` on in pieces
    of length `grid[1]`; `scheme` is h, alpha_m, alpha_f, gamma, beta; `work` has 6 r + i + 8 rows of length r.
    """
    r, h, a_m, a_f, gamma, beta = q.shape[1], scheme[0], scheme[1], scheme[2], scheme[3], scheme[4]
    gain = (1.0 - a_f) / (1.0 - a_m)
    dv, dq, loads = h * gamma * gain, h * h * beta * gain, f.shape[1]
    at, a, acceleration, side = work[: 6 * r + loads], work[-1], work[-2], work[-3]
    for i in range(r):
        a[i] = 0.0
        acceleration[i] = 0.0
    for k in range(0, count):
        x = (course[0, k] - grid[0]) / grid[1]
        piece = min(max(int(x), 0), tables.shape[0] - 1)
        z, rate, second = (x - piece) * grid[1], course[1, k], course[2, k]
        for row in range(at.shape[0]):
            for j in range(r):
                n = row * r + j
                c0, c1, c2, c3 = tables[piece, 0, n], tables[piece, 1, n], tables[piece, 2, n], tables[piece, 3, n]
                at[row, j] = ((c0 * z + c1) * z + c2) * z + c3
        first = k == 0
        for i in range(r):
            following = 0.0 if first else (a_f * acceleration[i] - a_m * a[i]) / (1.0 - a_m)
            if not first:
                q[k, i] = q[k - 1, i] + h * v[k - 1, i] + h * h * ((0.5 - beta) * a[i] + beta * following)
                v[k, i] = v[k - 1, i] + h * ((1.0 - gamma) * a[i] + gamma * following)
            a[i] = following
        for i in range(r):
            side[i] = 0.0
            for j in range(loads):
                side[i] += at[6 * r + j, i] * f[k, j]
            for j in range(r):
                damping = at[r + i, j] + 2.0 * rate * at[3 * r + i, j]
                stiffness = (
                    at[2 * r + i, j]
                    + second * at[3 * r + i, j]
                    + rate * rate * at[4 * r + i, j]
                    + rate * at[5 * r + i, j]
                )
                side[i] -= damping * v[k, j] + stiffness * q[k, j]
                if not first:
                    at[i, j] += dv * damping + dq * stiffness
        for i in range(r):  # elimination without pivots: nearly symmetric, and M dominates
            for row in range(i + 1, r):
                share = at[row, i] / at[i, i]
                for j in range(i + 1, r):
                    at[row, j] -= share * at[i, j]
                side[row] -= share * side[i]
        for i in range(r - 1, -1, -1):
            for j in range(i + 1, r):
                side[i] -= at[i, j] * side[j]
            side[i] /= at[i, i]
        for i in range(r):
            acceleration[i] = side[i]
            if first:
                a[i] = side[i]
            else:
                a[i] += gain * side[i]
                v[k, i] += dv * side[i]
                q[k, i] += dq * side[i]


def _central_differences(values: Array, step: float) -> Array:
    """Values, first and second differences, (3, T, ...), of samples (T + 2, ...) that begin and end a step outside."""
    first = (values[2:] - values[:-2]) / (2.0 * step)
    second = (values[2:] - 2.0 * values[1:-1] + values[:-2]) / step**2
    return np.stack([values[1:-1], first, second])
