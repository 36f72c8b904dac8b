r"""Buckling of a system under axial forces: by which factors they grow until something stands still bent.

.. math::
    \Bigl(K + \Lambda \sum_k c_k G_k\Bigr) q + C^T \lambda = 0, \qquad C q - F \lambda = 0

with the geometric stiffness :math:`c_k G_k` of terms (`pmr.system.terms`) under the loads that are looked at.  With the
flexibility A of the bodies and their contacts, symmetric and at least semi-definite, 1/Lambda are the eigenvalues of
:math:`-L^T \sum c_k G_k\, L`, :math:`A = L L^T`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.simulation.statics.equilibrium import ROUND_OFF_OF_K, saddle_point_solver
from pmr.system.assembly import Assembly
from pmr.system.contact_rows import ContactRows
from pmr.system.terms import add_terms

Array = NDArray[np.float64]
Solve = Callable[[Array], Array]

#: Coordinates up to which all factors are found at once, dense.
DENSE_UP_TO = 600
#: Share of the largest eigenvalue below which a factor is none: what round-off leaves of zero.
ROUND_OFF = 1e-10


def buckling_factors(assembly: Assembly, x: Array, coefficients: Mapping[str, float], count: int = 1) -> Array:
    """The lowest positive factors (count,) by which the terms' coefficients buckle the system, every contact closed.

    Where there are fewer, because nothing is compressed, the others are infinite.

    Parameters
    ----------
    assembly : Assembly
    x : (sides,) array, m
        Places of contacts, as `pmr.system.system.System.coordinates` has them.
    coefficients : mapping of str to float
        c_k of the system's terms by name; others have none.
    count : int

    Raises
    ------
    InputError
        If there is no term of such a name, or contacts do not hold the bodies.
    """
    return Held(assembly, assembly.at(x)).factors(coefficients, count)


class Held:
    """A system at one place with every contact closed: its flexibility serves all loads that are looked at there."""

    def __init__(self, assembly: Assembly, rows: ContactRows) -> None:
        self._assembly, self._rows = assembly, rows

    def factors(self, coefficients: Mapping[str, float], count: int = 1) -> Array:
        """Buckling factors (count,), as `buckling_factors` has them."""
        G = geometric_stiffness(self._assembly, coefficients)
        values = np.full(count, np.inf)
        if G.nnz:
            if self._assembly.size <= DENSE_UP_TO:
                shares = np.linalg.eigvalsh(-(self._root.T @ (G @ self._root)))
            else:
                shares = _largest(self._solve, self._rows, G, self._answer, count)
            shares = np.sort(shares[shares > ROUND_OFF * np.abs(shares).max()])[::-1][:count]
            values[: len(shares)] = 1.0 / shares
        return values

    @cached_property
    def _solve(self) -> Solve:
        return saddle_point_solver(self._assembly.K, self._rows)

    @cached_property
    def _answer(self) -> Array:
        """Response (n,) to a load without symmetry; an InputError is raised where round-off alone resists it."""
        K, load = self._assembly.K, np.random.default_rng(3).standard_normal(self._assembly.size)
        q = self._solve(np.concatenate([load, np.zeros(len(self._rows.F))]))[: len(load)]
        if not q @ load >= ROUND_OFF_OF_K * np.abs(q) @ (abs(K) @ np.abs(q)):  # NaN too
            allowed = "contacts that hold the bodies are allowed: without, nothing is there to buckle"
            raise InputError("system", "contacts", None, allowed)
        return q

    @cached_property
    def _root(self) -> Array:
        """L of the flexibility A = L L^T, (n, n)."""
        n = len(self._answer)
        A = self._solve(np.vstack([np.eye(n), np.zeros((len(self._rows.F), n))]))[:n]
        size, Q = np.linalg.eigh((A + A.T) / 2.0)
        return np.asarray(Q * np.sqrt(np.maximum(size, 0.0)))


def geometric_stiffness(assembly: Assembly, coefficients: Mapping[str, float]) -> sp.csr_matrix:
    """The sum of c_k G_k on the assembly's coordinates (n, n); an InputError is raised for a name that no term has."""
    terms = {term.name: term for term in assembly.terms}
    for name in coefficients:
        if name not in terms:
            raise InputError("system", "terms", name, f"{', '.join(terms) or 'no names'} are allowed")
    some = [terms[name] for name in coefficients]
    return add_terms(sp.csr_matrix((assembly.size,) * 2), some, "stiffness", [*coefficients.values()])


def _largest(solve: Solve, rows: ContactRows, G: sp.csr_matrix, start: Array, count: int) -> Array:
    """The largest 1/Lambda, by Arnoldi's method on -A sum c_k G_k, whose eigenvalues are real."""
    n, nothing = len(start), np.zeros(len(rows.F))
    operator = spla.LinearOperator(
        (n, n), matvec=lambda q: solve(np.concatenate([-(G @ q.ravel()), nothing]))[:n], dtype=float
    )
    values = spla.eigs(operator, k=count + 2, which="LR", v0=start, return_eigenvectors=False)
    return np.asarray(values.real)
