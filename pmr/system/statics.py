r"""Equilibrium of a system of bodies under constant loads, at given places.

.. math::
    \Bigl(K + \sum_k c_k G_k\Bigr) q + C^T \lambda = B f, \qquad
    C q + H f - F \lambda = g \text{ where a contact is closed}, \quad \lambda = 0 \text{ where it is open}

with the clearances g and the system's terms at their amplitudes c.
Contacts that only push are closed where they push and open where a gap is left; the ones that are wrong change sides,
all at once as long as that leaves fewer wrong ones, then the first one alone (docs/pads.md has the proof that this
ends).  A body that open contacts leave free for the moment is held by its mass times a frequency far below all others;
the last solve has none of that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from pmr.errors import InputError
from pmr.system.assembly import Assembly
from pmr.system.contact_rows import ContactRows

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Share of the lowest omega^2 that holds bodies which nothing else holds; what it may change of an equilibrium.
ALMOST_FREE, UNCHANGED = 1e-8, 1e-3
#: Solves in which all wrong contacts may change sides without leaving fewer wrong ones, and solves in all.
CHANCES, LIMIT = 3, 1000
#: Pull or overlap that is round-off, over the largest force or displacement.
ROUND_OFF = 1e-9
#: Equations up to which a dense factor is quicker than a sparse one.
DENSE = 300
#: An equilibrium whose strain energy is a smaller share of what its entries cancel is held by round-off alone.
ROUND_OFF_OF_K = 1e2 * float(np.finfo(float).eps)


@dataclass(frozen=True)
class Equilibrium:
    """Coordinates q (n,) as `Assembly` numbers them, contact forces (m,) in N, and which contacts are closed (m,)."""

    q: Array
    forces: Array
    closed: Mask


def equilibrium(assembly: Assembly, x: Array, f: Array, c: Array | None = None) -> Equilibrium:
    """At places x (sides,) m, under loads f (i,) and with amplitudes c (k,) of the system's terms, zero by default.

    An InputError is raised where contacts do not hold the bodies against these loads, or can't tell their forces apart.
    """
    rows, clearance = assembly.at(x), assembly.system.clearance
    pushes = ~np.isnan(clearance)
    gap = np.where(pushes, clearance, 0.0)
    closed = np.ones(len(gap), dtype=bool)
    K = assembly.stiffness(() if c is None else c)
    floor = ALMOST_FREE * _lowest(assembly, rows) * assembly.M
    fewest, chances = len(gap) + 1, CHANCES
    for _ in range(LIMIT):
        almost = _solved(assembly, rows, closed, gap, f, K + floor)
        wrong = _wrong(rows, almost, pushes, gap, f)
        if not wrong.any():
            break
        if wrong.sum() < fewest:
            fewest, chances = int(wrong.sum()), CHANCES
        else:
            chances -= 1
        changing = wrong if chances >= 0 else np.arange(len(wrong)) == np.argmax(wrong)
        closed = closed ^ changing
    found = _solved(assembly, rows, closed, gap, f, K)
    q, forces = found.q, found.forces
    unchanged = np.abs(q - almost.q).max(initial=0.0) <= UNCHANGED * np.abs(q).max(initial=0.0)
    stored = q @ (K @ q) + forces @ rows.F @ forces
    stiff = stored >= ROUND_OFF_OF_K * np.abs(q) @ (abs(K) @ np.abs(q))
    if not (unchanged and stiff) or _wrong(rows, found, pushes, gap, f).any():
        allowed = (
            "contacts that hold the bodies against the loads at the start, each in a way of its own, are allowed "
            "(pads in the middle of faces hold no roll; pads with a clearance hold nothing until a load closes them)"
        )
        if assembly.terms:
            allowed += "; with second order nothing holds a boom that is past its buckling load"
        raise InputError("system", "contacts", None, allowed)
    return found


def _solved(assembly: Assembly, rows: ContactRows, closed: Mask, gap: Array, f: Array, K: sp.csr_matrix) -> Equilibrium:
    """With the given contacts closed; not finite where these hold nothing or depend on each other."""
    forces = np.zeros(len(gap))
    right = np.concatenate([assembly.B @ f, (gap - rows.H @ f)[closed]])
    solution = saddle_point_solver(K, rows.of(closed))(right)
    forces[closed] = solution[assembly.size :]
    return Equilibrium(solution[: assembly.size], forces, closed)


def saddle_point_solver(K: sp.csr_matrix, rows: ContactRows) -> Callable[[Array], Array]:
    """Solutions of ((K, C^T), (C, -F)) for right sides (n + m, ...); not finite where it is singular."""
    n, scale = K.shape[0], rows.unit(K)
    units = np.concatenate([np.ones(n), np.full(len(rows.C), scale)])
    if 0 < len(units) <= DENSE:
        C = scale * rows.C
        matrix = np.block([[K.toarray(), C.T], [C, -(scale**2) * rows.F]])
        once = _dense_factor(matrix)
    else:
        C, F = sp.csr_matrix(rows.C), sp.csr_matrix(rows.F)
        matrix = sp.bmat([[K, scale * C.T], [scale * C, -(scale**2) * F]], format="csc")
        once = _sparse_factor(matrix)
    if once is None:
        return lambda right: np.full(right.shape, np.nan)

    def solve(right: Array) -> Array:
        scaled = (units * right.T).T
        solution = once(scaled)
        solution += once(scaled - matrix @ solution)
        return np.asarray((units * solution.T).T)

    return solve


def _sparse_factor(matrix: sp.csc_matrix) -> Callable[[Array], Array] | None:
    """What solves for right sides; None where it is singular."""
    try:
        return spla.splu(matrix).solve
    except RuntimeError:
        return None


def _dense_factor(matrix: Array) -> Callable[[Array], Array] | None:
    """The same; a sparse factor of a few equations takes as long as one of a hundred."""
    factor, pivots, singular = dgetrf(matrix)
    return None if singular else lambda right: dgetrs(factor, pivots, right)[0]


def _lowest(assembly: Assembly, rows: ContactRows) -> float:
    """About the lowest omega^2 in (rad/s)^2 with all contacts closed: Rayleigh's quotient of what inertia bends."""
    g = assembly.M.diagonal()
    q = saddle_point_solver(assembly.K, rows)(np.concatenate([g, np.zeros(len(rows.F))]))[: assembly.size]
    return abs(float(g @ q / (q @ (assembly.M @ q))))


def _wrong(rows: ContactRows, found: Equilibrium, pushes: Mask, gap: Array, f: Array) -> Mask:
    """Contacts that pull although they only push, or would have to push although they are open."""
    q, forces = found.q, found.forces
    motion = rows.C @ q + rows.H @ f - rows.F @ forces
    size = np.abs(rows.C) @ np.abs(q) + gap
    pulls = found.closed & pushes & (forces < -ROUND_OFF * np.abs(forces).max(initial=0.0))
    return np.asarray(pulls | ~found.closed & (motion - gap > ROUND_OFF * size))
