r"""Equilibrium of a system of bodies under constant loads, with its paths held, and buckling factors.

.. math::
    \Bigl(K + \sum_k c_k G_k\Bigr) q + C^T \lambda = B f, \qquad
    C q + H f - F \lambda = g \text{ where a contact is closed}, \quad \lambda = 0 \text{ where it is open}

with coordinates q, stiffness K, contact forces :math:`\lambda`, loads f on inputs B, rows C, H and flexibility F of the
contacts, their clearances g, and the stiffness :math:`G_k` of the system's terms at their amplitudes :math:`c_k`.
Contacts that only push are closed where they push and open where a gap is left; if some are on the wrong side, the
kernel decides which of these change sides (`pmr.kernel.laws.ContactSearch`; docs/pads_theory.md proves that this
ends).
A body that open contacts leave free for the moment is held by a small stiffness, its mass matrix times the square of a
frequency far below all others; the last solve is without this stiffness.  If the closed contacts alone do not hold the
bodies, those that touch without a force are closed with them.

Terms may make K indefinite while contacts are open; then changing sides need not end, or ends in an unstable
equilibrium.  So an equilibrium with terms and contacts that only push is valid only if the stiffness is positive
definite in all motions that the closed contacts leave free.  If the first equilibrium is not valid, the energy is
minimised in steps, each with a share of omega^2 M added and its force at the last q subtracted (Rockafellar: Monotone
operators and the proximal point algorithm, SIAM Journal on Control and Optimization 14, 1976).  A step has one solution
if its share is large enough, and moves the further the smaller the share is: so the share falls after a step that has a
solution, and grows after one that has none.

A system under axial forces buckles at the factors :math:`\Lambda` on these forces at which it is in equilibrium in a
bent shape, too,

.. math::
    \Bigl(K + \Lambda \sum_k c_k G_k\Bigr) q + C^T \lambda = 0, \qquad C q - F \lambda = 0

with the geometric stiffness :math:`c_k G_k` of terms (`pmr.system.terms`) under the given loads.  With the flexibility
:math:`A = L L^T` of the bodies and their contacts, which is symmetric and positive semi-definite, :math:`1 / \Lambda`
are the eigenvalues of :math:`-L^T \sum c_k G_k\, L`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from pmr.errors import InputError
from pmr.files.arrays import Array, Mask
from pmr.kernel.laws import ContactSearch
from pmr.system.assembly import Assembly
from pmr.system.states import ContactRows

#: Share of the lowest omega^2 with which M holds otherwise free bodies; relative change of q that this may cause.
ALMOST_FREE, UNCHANGED = 1e-8, 1e-3
#: Most solves of one search for the closed contacts.
LIMIT = 1000
#: Most steps towards an equilibrium with terms, most solves in each, and factors on the share of the lowest omega^2
#: after a step that has a solution and after a step that has none.
STEPS, FEW, SMALLER, LARGER = 100, 50, 0.5, 4.0
#: In a check of stability: flexibility of a rigid contact over that of the stiffest coordinate, and the share by which
#: the flexibility of all other contacts is increased, as it may be singular.
SPRING_OF_RIGID, SOFTER = 1e-3, 1e-6
#: Pull or overlap that is round-off, over the largest force or displacement.
ROUND_OFF = 1e-9
#: Gap of a contact that touches, over the largest one.
TOUCH = 1e-6
#: An equilibrium with a strain energy below this share of the sum of its terms' sizes is held by round-off alone.
ROUND_OFF_OF_K = 1e2 * float(np.finfo(float).eps)


@dataclass(frozen=True)
class Equilibrium:
    """Equilibrium of a system: coordinates q (n,) in the order of `Assembly`, and the forces (m,) in N of its contacts.

    The mask `closed` (m,) is true for closed contacts; the force of an open contact is zero.
    """

    q: Array
    forces: Array
    closed: Mask


def equilibrium(assembly: Assembly, x: Array, f: Array, c: Array | None = None) -> Equilibrium:
    """Compute the equilibrium of all bodies under constant loads.

    Parameters
    ----------
    assembly : Assembly
        System with n coordinates, m contacts, i inputs and k terms.
    x : (sides,) array, m
        Positions of the sides of all contacts (`System.side_coordinates`).
    f : (i,) array
        Loads, one for each input.
    c : (k,) array, optional
        Amplitudes of the system's terms (`pmr.system.terms`); zero by default.

    Raises
    ------
    InputError
        If the contacts do not hold the bodies against the loads, if the contact forces are not determined, or if no
        stable equilibrium is found with the terms (the boom buckles).
    """
    contacts = _Contacts(assembly, x, f)
    K, softest = assembly.stiffness(() if c is None else c), _lowest_eigenvalue(assembly, contacts.rows)
    push, neutral = assembly.B @ f, ALMOST_FREE * softest * assembly.M
    with_terms = bool(assembly.terms) and c is not None and bool(np.any(c))

    def stand(almost: Equilibrium) -> Equilibrium | None:
        """Equilibrium by the stiffness K alone, near the state `almost`; None if there is none.

        The closed contacts are those of `almost`; if that gives no equilibrium, contacts that touch are closed, too.
        """
        may_tip = with_terms and contacts.push
        for closed in (almost.closed, almost.closed | contacts.touching(almost)):
            if not may_tip or contacts.is_stable(K + neutral, closed):
                state = contacts.solve_closed(K, push, closed)
                if contacts.is_confirmed(state, almost, K, stable=may_tip):
                    return state
        return None

    almost = contacts.solve(K + neutral, push)
    if (state := stand(almost)) is not None:
        return state
    if with_terms:
        almost, share = Equilibrium(np.zeros(assembly.size), almost.forces, contacts.all_closed), 1.0
        for _ in range(STEPS):
            floor = share * softest * assembly.M
            step = contacts.solve(K + floor, push + floor @ almost.q, almost.closed, FEW)
            if contacts.wrong_contacts(step).any() or not contacts.is_stable(K + floor, step.closed):
                share *= LARGER
                continue
            almost, share = step, SMALLER * share
            if (state := stand(almost)) is not None:
                return state
        equilibrium(assembly, x, f)  # raises if the contacts do not hold the bodies without terms either
        allowed = "axial forces below those that buckle the boom on the pads that are closed at the start are allowed"
        raise InputError("system", "contacts", None, f"{allowed} with second order; without it these pads hold it")
    allowed = (
        "contacts are allowed that together hold every motion of the bodies against the loads at the start "
        "(pads in the middle of faces hold no roll; pads with a clearance hold nothing until a load closes them)"
    )
    raise InputError("system", "contacts", None, allowed)


class _Contacts:
    """Contacts of a system with their sides at x (sides,) m, under loads f (i,); finds which contacts are closed.

    Only contacts with a clearance can open; all others are always closed.
    """

    def __init__(self, assembly: Assembly, x: Array, f: Array) -> None:
        """Compute the contact rows of `assembly` at x (sides,) in m, and the contacts' motion by loads f (i,) in N."""
        self._assembly, self.rows, clearance = assembly, assembly.contact_rows(x), assembly.system.clearance
        self._pushes = ~np.isnan(clearance)
        self.push = bool(self._pushes.any())
        self._clearance, self._motion = np.where(self._pushes, clearance, 0.0), self.rows.H @ f
        self.all_closed = np.ones(len(clearance), dtype=bool)

    def solve(self, K: sp.csr_matrix, push: Array, closed: Mask | None = None, limit: int = LIMIT) -> Equilibrium:
        """Equilibrium with a stiffness K (n, n) under forces `push` (n,), with a search for the closed contacts.

        K has to be positive definite even with all contacts open.  The search starts from the mask `closed` (m,), by
        default all contacts.  The search stops after `limit` solves at the latest, when some contacts may still be on
        the wrong side.
        """
        closed = self.all_closed if closed is None else closed
        search = ContactSearch()
        for _ in range(limit):
            state = self.solve_closed(K, push, closed)
            wrong = self.wrong_contacts(state)
            if not wrong.any():
                break
            closed = search.change(closed, wrong)
        return state

    def solve_closed(self, K: sp.csr_matrix, push: Array, closed: Mask) -> Equilibrium:
        """Equilibrium with stiffness K (n, n) under forces `push` (n,), with the contacts of the mask `closed` closed.

        The mask is (m,); all other contacts are open.  The result is not finite if the closed contacts do not hold the
        bodies or depend on each other.
        """
        forces, n = np.zeros(len(closed)), self._assembly.size
        right = np.concatenate([push, (self._clearance - self._motion)[closed]])
        solution = saddle_point_solver(K, self.rows.select(closed))(right)
        forces[closed] = solution[n:]
        return Equilibrium(solution[:n], forces, closed)

    def is_confirmed(self, state: Equilibrium, almost: Equilibrium, K: sp.csr_matrix, stable: bool) -> bool:
        """Return whether `state`, solved with the stiffness K (n, n) alone, is a valid equilibrium.

        The conditions are:

        - the state agrees to `UNCHANGED` with `almost`, which is solved with K plus a multiple of the mass matrix;
        - its strain energy exceeds round-off;
        - no contact is on the wrong side.

        The energy may be negative if `stable` is true: the caller then knows that the equilibrium is stable, and rigid
        contacts with a clearance add work of their own.
        """
        q, closed, forces = state.q, state.closed, state.forces.copy()
        if self._clearance[closed].any():  # energy as if these contacts had been closed from the start
            F = self.rows.F[np.ix_(closed, closed)]
            forces[closed] += np.linalg.lstsq(F, self._clearance[closed], rcond=None)[0]
        unchanged = np.abs(q - almost.q).max(initial=0.0) <= UNCHANGED * np.abs(q).max(initial=0.0)
        stored = q @ (K @ q) + forces @ self.rows.F @ forces
        stiff = (abs(stored) if stable else stored) >= ROUND_OFF_OF_K * np.abs(q) @ (abs(K) @ np.abs(q))
        return bool(unchanged and stiff and not self.wrong_contacts(state).any())

    def is_stable(self, K: sp.csr_matrix, closed: Mask) -> bool:
        """Return whether K (n, n) is positive definite in all motions that the contacts of a mask `closed` (m,) allow.

        Contacts with a flexibility act as springs, a rigid one as a spring much stiffer than K is anywhere.
        """
        rows = self.rows.select(closed)
        rigid = SPRING_OF_RIGID * (rows.C**2).sum(axis=1).max(initial=0.0) / rows.force_scale(K)
        more = np.where(self.rows.rigid[closed], rigid, SOFTER * np.diagonal(rows.F))
        C, springs = sp.csr_matrix(rows.C), sp.csr_matrix(np.linalg.inv(rows.F + np.diag(more)))
        return _is_definite((K + K.T) / 2.0 + C.T @ springs @ C)

    def wrong_contacts(self, state: Equilibrium) -> Mask:
        """Mask (m,) of closed contacts that pull in a `state` though they only push, and of open ones that overlap."""
        forces, size = state.forces, np.abs(self.rows.C) @ np.abs(state.q) + self._clearance
        pulls = state.closed & self._pushes & (forces < -ROUND_OFF * np.abs(forces).max(initial=0.0))
        return np.asarray(pulls | ~state.closed & (-self._gaps(state) > ROUND_OFF * size))

    def touching(self, state: Equilibrium) -> Mask:
        """Mask (m,) of contacts that only push and have no gap but round-off in a `state`."""
        gaps = self._gaps(state)
        return np.asarray(self._pushes & (gaps <= TOUCH * np.abs(gaps).max(initial=0.0)))

    def _gaps(self, state: Equilibrium) -> Array:
        """Gaps (m,) in m between the sides of all contacts in a `state`; negative where bodies overlap."""
        return np.asarray(self._clearance - self._motion - self.rows.C @ state.q + self.rows.F @ state.forces)


def _is_definite(A: sp.csr_matrix) -> bool:
    """Whether a symmetric matrix A (n, n) is positive definite: it has an LU factor whose pivots are positive."""
    try:
        factor = spla.splu(A.tocsc(), "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:
        return False
    return bool((factor.perm_r == factor.perm_c).all() and (factor.U.diagonal() > 0.0).all())


class BorderedMatrix:
    """Matrix ((K, C^T), (C, -F)) of a held structure; a LinAlgError of NumPy is raised where it is singular.

    K (n, n) is the stiffness, C (m, n) and F (m, m) are rows and flexibility of the contacts.  The matrix is scaled by
    1 for the n coordinates and by the largest entry of K for the m contact forces, so that all blocks are of similar
    size.
    """

    def __init__(self, K: Array, C: Array, F: Array) -> None:
        """Join K (n, n), C (m, n) and F (m, m), scaled to similar size, to one matrix."""
        n, scale = len(K), float(np.abs(K).max()) or 1.0
        self._scaled, self._units = np.empty((n + len(C), n + len(C))), np.ones(n + len(C))
        self._units[n:] = scale
        self._scaled[:n, :n], self._scaled[:n, n:] = K, scale * C.T
        self._scaled[n:, :n], self._scaled[n:, n:] = scale * C, -(scale**2) * F

    def inverse(self) -> Array:
        """Inverse (n + m, n + m)."""
        return np.asarray(self._units[:, None] * np.linalg.inv(self._scaled) * self._units)

    def solve(self, right: Array) -> Array:
        """Coordinates and contact forces (n + m, k) for k right sides (n + m, k)."""
        return np.asarray(self._units[:, None] * np.linalg.solve(self._scaled, self._units[:, None] * right))


def saddle_point_solver(K: sp.csr_matrix, rows: ContactRows) -> Callable[[Array], Array]:
    """Return a function that solves ((K, C^T), (C, -F)) z = r for right sides r (n + m, ...), with one refinement.

    K (n, n) is the stiffness, C (m, n) and F (m, m) are those of the contact `rows`.  The function returns z (n + m,
    ...): coordinates, then contact forces; NaN where the matrix is singular.
    """
    scale, C, F = rows.force_scale(K), sp.csr_matrix(rows.C), sp.csr_matrix(rows.F)
    units = np.concatenate([np.ones(K.shape[0]), np.full(len(rows.C), scale)])
    matrix = sp.bmat([[K, scale * C.T], [scale * C, -(scale**2) * F]], format="csc")
    try:
        once = spla.splu(matrix).solve
    except RuntimeError:
        return lambda right: np.full(right.shape, np.nan)

    def solve(right: Array) -> Array:
        """Solution (n + m, ...) for right sides (n + m, ...), with one refinement."""
        scaled = (units * right.T).T
        solution = once(scaled)
        solution += once(scaled - matrix @ solution)
        return np.asarray((units * solution.T).T)

    return solve


def _lowest_eigenvalue(assembly: Assembly, rows: ContactRows) -> float:
    """Estimate of the lowest omega^2 in (rad/s)^2 of `assembly` with all contacts closed.

    The estimate is Rayleigh's quotient g . q / (q . M q) of the displacements q under the forces g = diag(M).
    """
    g = assembly.M.diagonal()
    q = saddle_point_solver(assembly.K, rows)(np.concatenate([g, np.zeros(len(rows.F))]))[: assembly.size]
    return abs(float(g @ q / (q @ (assembly.M @ q))))


Solve = Callable[[Array], Array]

#: Number of coordinates up to which all buckling factors are computed at once, from dense matrices.
DENSE_UP_TO = 600
#: Share of the largest eigenvalue below which an eigenvalue is round-off of zero.
EIGEN_ROUND_OFF = 1e-10


def buckling_factors(assembly: Assembly, x: Array, coefficients: Mapping[str, float], count: int = 1) -> Array:
    """Lowest positive buckling factors Lambda (count,), ascending, with every contact closed.

    The system buckles with the coefficients c_k multiplied by Lambda.  If there are fewer than `count` factors, as
    where nothing is compressed, the last entries are infinite.

    Parameters
    ----------
    assembly : Assembly
    x : (sides,) array, m
        Positions of the sides of all contacts, as `System.side_coordinates` returns them.
    coefficients : mapping of str to float
        Amplitude c_k of each term of the system, by the term's name; zero for terms that are not named.
    count : int
        Number of factors.

    Raises
    ------
    InputError
        If the system has no term of such a name, or the contacts do not hold the bodies.
    """
    return HeldSystem(assembly, assembly.contact_rows(x)).factors(coefficients, count)


class HeldSystem:
    """A system at fixed side positions with every contact closed; its flexibility is factored once for all loads.

    `rows` are the contact rows at these positions (`Assembly.contact_rows`).
    """

    def __init__(self, assembly: Assembly, rows: ContactRows) -> None:
        """Hold the system of `assembly` by the contact `rows`; nothing is factored yet."""
        self._assembly, self._rows = assembly, rows

    def factors(self, coefficients: Mapping[str, float], count: int = 1) -> Array:
        """Lowest positive buckling factors Lambda (count,), ascending; infinite where there are fewer than `count`.

        `coefficients` are the amplitudes c_k of the geometric stiffness G_k by the names of the terms, zero for others.
        Raises InputError for a name that no term has, or if the contacts do not hold the bodies.  Whether they do is
        not checked if the sum of c_k G_k has no entries.
        """
        G = geometric_stiffness(self._assembly, coefficients)
        values = np.full(count, np.inf)
        if G.nnz:
            if self._assembly.size <= DENSE_UP_TO:
                shares = np.linalg.eigvalsh(-(self._flexibility_root.T @ (G @ self._flexibility_root)))
            else:
                shares = _largest_eigenvalues(self._solve, self._rows, G, self._random_response, count)
            shares = np.sort(shares[shares > EIGEN_ROUND_OFF * np.abs(shares).max()])[::-1][:count]
            values[: len(shares)] = 1.0 / shares
        return values

    @cached_property
    def _solve(self) -> Solve:
        """Function from forces and gaps (n + m, ...) to displacements and contact forces, by `saddle_point_solver`."""
        return saddle_point_solver(self._assembly.K, self._rows)

    @cached_property
    def _random_response(self) -> Array:
        """Displacements (n,) under a random load, which excites all shapes.

        Raises InputError if only round-off resists the load, which means that the contacts do not hold the bodies.
        """
        K, load = self._assembly.K, np.random.default_rng(3).standard_normal(self._assembly.size)
        q = self._solve(np.concatenate([load, np.zeros(len(self._rows.F))]))[: len(load)]
        if not q @ load >= ROUND_OFF_OF_K * np.abs(q) @ (abs(K) @ np.abs(q)):  # also true for NaN
            allowed = "contacts that hold the bodies are allowed: without, there is nothing that could buckle"
            raise InputError("system", "contacts", None, allowed)
        return q

    @cached_property
    def _flexibility_root(self) -> Array:
        """Root L (n, n) of the flexibility A = L L^T of the bodies' n coordinates, with all contacts closed."""
        n = len(self._random_response)
        A = self._solve(np.vstack([np.eye(n), np.zeros((len(self._rows.F), n))]))[:n]
        size, Q = np.linalg.eigh((A + A.T) / 2.0)
        return np.asarray(Q * np.sqrt(np.maximum(size, 0.0)))


def geometric_stiffness(assembly: Assembly, coefficients: Mapping[str, float]) -> sp.csr_matrix:
    """Sum of c_k G_k (n, n) over the terms of `assembly` that `coefficients` names, a mapping to amplitudes c_k.

    Raises InputError for a name that no term has.
    """
    names = [term.name for term in assembly.terms]
    for name in coefficients:
        if name not in names:
            raise InputError("system", "terms", name, f"{', '.join(names) or 'no names'} are allowed")
    return assembly.stiffness_sum.of_terms([coefficients.get(name, 0.0) for name in names])


def _largest_eigenvalues(solve: Solve, rows: ContactRows, G: sp.csr_matrix, start: Array, count: int) -> Array:
    """Largest eigenvalues 1/Lambda (`count` + 2,) of -A G, unsorted, by Arnoldi's method.

    G (n, n) is the sum of c_k G_k, A (n, n) the flexibility of the structure with its contact `rows`, which `solve`
    applies to a vector, and `start` (n,) the first vector of the method.
    """
    n, nothing = len(start), np.zeros(len(rows.F))
    operator = spla.LinearOperator(
        (n, n), matvec=lambda q: solve(np.concatenate([-(G @ q.ravel()), nothing]))[:n], dtype=float
    )
    values = spla.eigs(operator, k=count + 2, which="LR", v0=start, return_eigenvectors=False)
    return np.asarray(values.real)
