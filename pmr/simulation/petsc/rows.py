r"""Factors of the effective matrix and what they solve, and the contacts' rows at every position of the paths.

Bodies with equal effective matrices S share one factor.  Rows act through the p carriers E^T (p, n) that they touch on
the way (`pmr.system.rows`).  A contact has one side on each of its bodies, with a coordinate x of its own.  Between two
breaks the row of a side is c(x) = sum_e x^e Gamma_e E^T, with coefficients Gamma_e of the powers e of x, which is
counted from the lower break.  With the powers of all sides in X(x), the rows of all contacts are C = X(x) Gamma E^T,
and with contact forces :math:`\lambda`

.. math::
    C S^{-1} C^T = X\, (\Gamma P \Gamma^T)\, X^T, \qquad
    S^{-1} C^T \lambda = (S^{-1} E\, \Gamma^T)\, X^T \lambda, \qquad P = E^T S^{-1} E

change from step to step in X alone.  S, E and P are block diagonal, with a block for each body.  P is stored on every
rank; S^{-1} E is stored only if memory allows, and otherwise replaced by a second solve in each step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from pmr.fem.compat import MPI
from pmr.fem.distributed import local_csr
from pmr.fem.factor import BLOCK, MatrixFactor
from pmr.files.arrays import Array, Indices
from pmr.fullmodel.model import FullModel, FullSystem
from pmr.simulation import contact_step
from pmr.system.body_matrices import Rayleigh
from pmr.system.system import consecutive


class BlockFactor:
    """Factors of one matrix for each body, by the function `factorised`; collective.

    Bodies with the same model share a factor.
    """

    def __init__(self, system: FullSystem, factorised: Callable[[FullModel], MatrixFactor]) -> None:
        """Factorise a matrix of each body of `system` by `factorised`, once for each different model; collective."""
        self._local, self._factors = system.local_slices, dict[int, MatrixFactor]()
        for model in system.models:
            if id(model) not in self._factors:
                self._factors[id(model)] = factorised(model)
        self.of_bodies = [self._factors[id(model)] for model in system.models]
        self._vectors = [model.M.createVecs() for model in system.models]

    def solve(self, right: Array) -> Array:
        """This rank's rows (n_local,) of the solution, from its rows `right` (n_local,) of one right-hand side."""
        solution = np.empty_like(right)
        for factor, at, (load, answer) in zip(self.of_bodies, self._local, self._vectors, strict=True):
            load.getArray()[:] = right[at]
            factor.solve(load, answer)
            solution[at] = answer.getArray()
        return solution

    def solve_columns(self, columns: Array) -> Array:
        """This rank's rows (n_local, k) of the solutions, from those of k right-hand sides, `columns` (n_local, k)."""
        parts = zip(self.of_bodies, self._local, strict=True)
        return np.concatenate([factor.solve_columns(np.asfortranarray(columns[at])) for factor, at in parts])

    def destroy(self) -> None:
        """Free the factors' memory."""
        for factor in self._factors.values():
            factor.destroy()


class Course:
    """Positions x (T, sides) in m of the sides of a system's contacts along its paths, at T steps.

    Attributes
    ----------
    rows : tuple of Row
        Row of each side, on its body's carriers.
    contact, body : (sides,) integer arrays
        Numbers of the contact and of the body of each side.
    sign : (sides,) array
        Sign of each side in its contact's row.
    contacts : int
        Number of contacts.
    on : list of lists of int
        Indices of the sides on each body.
    interval : (T, sides) integer array
        Number of the interval of its row in which each side is at each step.
    distance : (T, sides) array, m
        Distance of each side from the lower break of that interval.
    """

    def __init__(self, system: FullSystem, x: Array) -> None:
        """Find the interval of each side's row at each of T steps, with the sides of `system` at x (T, sides) in m."""
        names, sides = list(system.bodies), system.sides
        self.x, self.rows, self.contacts = x, system.side_rows, len(system.contacts)
        self.contact = np.array([side.contact for side in sides], np.int64)
        self.body = np.array([names.index(side.place.body) for side in sides], np.int64)
        self.sign = np.array([side.sign for side in sides], float)
        self.on = [np.flatnonzero(self.body == body).tolist() for body in range(len(names))]
        self.interval, self.distance = np.zeros(x.shape, np.int32), np.zeros(x.shape)
        for k, row in enumerate(self.rows):
            intervals = np.searchsorted(row.breaks, x[:, k], side="right") - 1
            self.interval[:, k] = np.clip(intervals, 0, len(row.breaks) - 2)
            self.distance[:, k] = x[:, k] - row.breaks[self.interval[:, k]]

    def carriers_of(self, body: int) -> Indices:
        """Numbers (p,), ascending, of the p carriers of a body that its rows touch at any step."""
        visited = [self.rows[k].touched[np.unique(self.interval[:, k])].ravel() for k in self.on[body]]
        return np.unique(np.concatenate([np.empty(0, np.int64), *visited]))


class VisitedCarriers:
    """Carriers that sides touch anywhere on a course, as rows E^T of each body.

    Attributes
    ----------
    numbers : list of (p,) integer arrays
        For each body, the ascending numbers of its p visited carriers.
    of_bodies : list of sparse (p, n_local) matrices
        This rank's columns of each body's E^T.
    first : (bodies + 1,) integer array
        Number of each body's first visited carrier among those of all bodies.
    local : sparse matrix
        All of `of_bodies` as one block-diagonal matrix.
    """

    def __init__(self, system: FullSystem, course: Course) -> None:
        """Collect the carriers of each body of `system` that sides touch anywhere on the `course`."""
        self.numbers = [course.carriers_of(body) for body in range(len(system.models))]
        self.of_bodies = [
            model.carriers.carriers[numbers][:, model.share]
            for model, numbers in zip(system.models, self.numbers, strict=True)
        ]
        self.first = np.cumsum([0, *(len(numbers) for numbers in self.numbers)])
        self.local: sp.csr_matrix = sp.block_diag(self.of_bodies, format="csr")


class Layout:
    """Numbering of the D entries and c powers of all sides, one side after the other.

    A side has one entry for each carrier that it touches in an interval, and one power for each power of its position.
    `starts` (m,) are the numbers of the first power of each of m contacts.
    """

    def __init__(self, course: Course) -> None:
        """Number the entries and powers of all sides of the `course`."""
        widths = [row.touched.shape[1] for row in course.rows]
        powers = [len(row.coefficients) for row in course.rows]
        self.side_of_entry, self.side_of_power = (
            np.repeat(np.arange(len(course.rows)), np.array(sizes, int)) for sizes in (widths, powers)
        )
        self.contact_of_entry, self.contact_of_power = (
            course.contact[sides] for sides in (self.side_of_entry, self.side_of_power)
        )
        self.exponents = np.concatenate([np.empty(0, int), *(np.arange(p)[::-1] for p in powers)])
        self.entries, self.powers = consecutive(widths), consecutive(powers)
        self.starts = np.searchsorted(self.contact_of_power, np.arange(course.contacts))


class PathRows:
    """Rows of all contacts at one step of a course, for one rank.

    Attributes
    ----------
    Gamma : (c, D) array
        Coefficients with the sides' signs: one line for each power of each side, one column for each entry of a side.
    columns : (D,) integer array
        Number of each entry's carrier among its body's visited ones.
    interval : (sides,) integer array
        Number of the interval of its row in which each side is.
    """

    def __init__(self, course: Course, visited: VisitedCarriers, step: int = 0) -> None:
        """Set the rows to number `step` of the steps of the `course`, on the `visited` carriers of the bodies."""
        self.course, self.layout, self.visited = course, Layout(course), visited
        self.Gamma = np.zeros((len(self.layout.side_of_power), len(self.layout.side_of_entry)))
        self.columns = np.zeros(len(self.layout.side_of_entry), np.int64)
        self._first = visited.first[course.body[self.layout.side_of_entry]]
        self.interval = np.full(len(course.rows), -1, np.int32)
        self._E = visited.local[self.columns]
        self.move(step)

    def move(self, step: int) -> None:
        """Set the rows to their positions at the number `step` of the course."""
        course, interval = self.course, self.course.interval[step]
        changed = np.flatnonzero(interval != self.interval).tolist()
        for k in changed:
            entries, powers, j, row = self.layout.entries[k], self.layout.powers[k], interval[k], course.rows[k]
            self.columns[entries] = np.searchsorted(self.visited.numbers[course.body[k]], row.touched[j])
            self.Gamma[powers, entries] = course.sign[k] * row.coefficients[:, j]
        if changed:
            self.interval = interval
            self._E = self.visited.local[self._first + self.columns]
        self.x = course.distance[step][self.layout.side_of_power]
        self.X = self.x**self.layout.exponents

    def apply(self, q: Array) -> Array:
        """This rank's contribution (m,) to C q, from its part q (n_local,) of the coordinates."""
        values = (self.X @ self.Gamma) * (self._E @ q)
        return np.asarray(np.bincount(self.layout.contact_of_entry, values, self.course.contacts), float)

    def slopes(self, q: Array) -> Array:
        """This rank's contribution (sides,) to the slopes of the coordinates along the bodies, one for each side.

        The slope of a side is its sign times (dc/dx) q.  Here c is the side's row, x its position on the body, and `q`
        (n_local,) is this rank's part of the coordinates.  The positions are those of the step that `move` set last.
        """
        values = (self._power_derivatives @ self.Gamma) * (self._E @ q)
        return np.asarray(np.bincount(self.layout.side_of_entry, values, len(self.course.rows)), float)

    @property
    def _power_derivatives(self) -> Array:
        """Derivatives (c,) of the powers by x."""
        exponents = self.layout.exponents
        return np.asarray(exponents * self.x ** np.maximum(exponents - 1, 0))

    def apply_transposed(self, multipliers: Array) -> Array:
        """This rank's rows (n_local,) of C^T lambda with lambda = `multipliers` (m,)."""
        return np.asarray(self._E.T @ ((self.X @ self.Gamma) * multipliers[self.layout.contact_of_entry]))

    def transposed_slopes(self, moments: Array) -> Array:
        """This rank's rows (n_local,) of (dC/dx)^T `moments`, for `moments` (m,), one for each contact."""
        return np.asarray(self._E.T @ ((self._power_derivatives @ self.Gamma) * moments[self.layout.contact_of_entry]))

    def of_contacts(self, values: Array) -> Array:
        """For each contact, the sum of the `values` (sides,) of its sides; the sums are (m,)."""
        return np.asarray(np.bincount(self.course.contact, values, self.course.contacts), float)


class PathCompliance:
    """Blocks P = E^T S^{-1} E (p, p) of all bodies, multiplied with the coefficients of the sides at the current step.

    Pairs of sides are always multiplied in the same order, whichever of them moved: an interrupted simulation resumes
    with the same digits.
    """

    def __init__(self, P: Sequence[Array], rows: PathRows) -> None:
        """Store the blocks P (p, p) of all bodies, for the sides in `rows`."""
        self._P, self._interval = P, np.full_like(rows.interval, -1)
        self._of_powers = np.zeros((len(rows.layout.side_of_power),) * 2)

    def of_rows(self, rows: PathRows) -> Array:
        """Matrix C S^{-1} C^T (m, m) in m/N of the contact rows C at the current step of `rows`."""
        self._update(rows)
        if rows.course.contacts == 0:
            return np.zeros((0, 0))
        starts = rows.layout.starts
        weighted = self._of_powers * (rows.X[:, None] * rows.X)
        A = np.add.reduceat(np.add.reduceat(weighted, starts, axis=0), starts, axis=1)
        return np.asarray((A + A.T) / 2.0)

    def _update(self, rows: PathRows) -> None:
        """Compute the blocks of those sides that have entered another interval of their path in `rows`."""
        changed, self._interval = np.flatnonzero(rows.interval != self._interval).tolist(), rows.interval
        at, entries, powers, body = rows.columns, rows.layout.entries, rows.layout.powers, rows.course.body
        for k, l in {(min(i, j), max(i, j)) for i in changed for j in rows.course.on[body[i]]}:
            P = self._P[body[k]][np.ix_(at[entries[k]], at[entries[l]])]
            block = rows.Gamma[powers[k], entries[k]] @ P @ rows.Gamma[powers[l], entries[l]].T
            self._of_powers[powers[k], powers[l]], self._of_powers[powers[l], powers[k]] = block, block.T


class StoredAnswers:
    """Computes S^{-1} C^T lambda on one body from this rank's rows `answers` (n_local, p) of S^{-1} E."""

    def __init__(self, answers: Array, body: int, rows: PathRows) -> None:
        """Store this rank's rows `answers` (n_local, p) of S^{-1} E for the body with the number `body`, for `rows`."""
        self._answers, self._sides = answers, rows.course.on[body]
        widths = [rows.layout.powers[k].stop - rows.layout.powers[k].start for k in self._sides]
        self._at = dict(zip(self._sides, consecutive(widths), strict=True))
        self._powers = np.flatnonzero(rows.course.body[rows.layout.side_of_power] == body)
        self._interval = np.full_like(rows.interval, -1)
        self._of_powers = np.zeros((len(answers), len(self._powers)), order="F")

    def correction(self, rows: PathRows, multipliers: Array) -> Array:
        """This rank's rows (n_local,) of S^{-1} C^T lambda on the body, from the stored solutions S^{-1} E.

        S is the effective matrix of a step, C holds the contact rows at `rows`, and lambda is `multipliers` (m,).  The
        products of a side are computed again when the side has entered another interval of its path.
        """
        self._update(rows)
        weights = rows.X * multipliers[rows.layout.contact_of_power]
        return np.asarray(self._of_powers @ weights[self._powers])

    def _update(self, rows: PathRows) -> None:
        """Compute the columns of those sides that have entered another interval of their path in `rows`."""
        for k, at in self._at.items():
            if rows.interval[k] != self._interval[k]:
                entries, powers = rows.layout.entries[k], rows.layout.powers[k]
                answers = self._answers[:, rows.columns[entries]]
                self._of_powers[:, at] = answers @ rows.Gamma[powers, entries].T
        self._interval = rows.interval


def contact_rows(system: FullSystem, x: Array, rates: Array | None = None) -> sp.csr_matrix:
    """Contact rows C (m, n) on all n coordinates, with the sides of contacts at x (sides,) in m.

    If `rates` are given, the result is dC/dt instead, for sides that move with the `rates` (sides,) in m/s.
    """
    bodies, rows = list(system.bodies), sp.csr_matrix((len(system.contacts), system.size))
    weight = [1.0] * len(x) if rates is None else rates.tolist()
    for side, row, at, rate in zip(system.sides, system.side_rows, x, weight, strict=True):
        c = (side.sign * rate * row.at(at, int(rates is not None))).tocoo()
        columns = system.whole_slices[bodies.index(side.place.body)].start + c.col
        entries = (c.data, (np.full(len(columns), side.contact), columns))
        rows = rows + sp.csr_matrix(entries, rows.shape)
    return rows


class CarrierAnswers(NamedTuple):
    """Response of a body to unit forces on its p carriers."""

    compliance: Array  # P = E^T S^{-1} E (p, p), the same on every rank
    motion: Array  # this rank's rows (n_local, p) of S^{-1} E; (n_local, 0) if they are not stored


def solve_for_carriers(factor: MatrixFactor, E: sp.csr_matrix, comm: MPI.Comm, stored: bool) -> CarrierAnswers:
    """Response to unit forces on p carriers, by a `factor` of S; collective on the ranks of `comm`.

    `E` (p, n_local) are the rows of the carriers, with the columns of this rank.  Displacements are part of the result
    only if `stored` is true.
    """
    p, n = E.shape
    P, stored_rows = np.zeros((p, p)), np.zeros((n, p if stored else 0), order="F")
    for k in range(0, p, BLOCK):
        block = factor.solve_columns(E[k : k + BLOCK].toarray().T)
        P[:, k : k + BLOCK] = E @ block
        if stored:
            stored_rows[:, k : k + BLOCK] = block
    comm.Allreduce(MPI.IN_PLACE, P)
    return CarrierAnswers((P + P.T) / 2.0, stored_rows)


def rows_on_paths(system: FullSystem, x: Array, step: int = 0) -> PathRows:
    """The system's rows with its sides at x (T, sides) in m, set to number `step` of the T steps."""
    course = Course(system, x)
    return PathRows(course, VisitedCarriers(system, course), step)


class BodyStep:
    """Solver of the equations of a step of one body without contact forces, for b_free.

    The equations are those of `pmr.simulation.petsc.integrate`.
    """

    def __init__(self, model: FullModel, factor: MatrixFactor, v_gain: float, q_gain: float) -> None:
        """Prepare right-hand sides of the `model` for `factor`, the factor of its effective matrix.

        `v_gain` and `q_gain` are the derivatives of velocities and coordinates by a step's new acceleration.
        """
        self._M, self._D, self._factor, self._v_gain = model.M, model.D, factor, v_gain
        self._is_rayleigh = model.rayleigh is not None
        rayleigh = model.rayleigh or Rayleigh(0.0, 0.0)
        # coefficients in S^-1 D w = S^-1 M (of_mass w) + at_once w for Rayleigh damping
        self._at_once = rayleigh.beta / (q_gain + v_gain * rayleigh.beta)
        self._of_mass = rayleigh.alpha - self._at_once * (1.0 + v_gain * rayleigh.alpha)
        self._B = local_csr(model.B)
        self._x, self._right = model.M.createVecs()
        self._b = self._right.duplicate()

    def free(self, scaled: Array, v: Array, f: Array) -> Array:
        """Rows (n_local,) of this rank of the solution b_free without contact forces.

        `scaled` (n_local,) and v (n_local,) are this rank's rows of q* / dq and v*: the predicted coordinates, divided
        by their derivative by the step's new acceleration, and the predicted rates.  f (i,) are the loads.
        """
        w = self._v_gain * scaled - v
        self._x.getArray()[:] = scaled + self._of_mass * w
        self._M.mult(self._x, self._right)
        if not self._is_rayleigh:
            self._x.getArray()[:] = w
            self._D.multAdd(self._x, self._right, self._right)
        self._right.getArray()[:] += self._B @ f
        self._factor.solve(self._right, self._b)
        return np.asarray(self._b.getArray() + self._at_once * w)


def contact_frequency(system: FullSystem, x: Array, mass: BlockFactor) -> float:
    """Largest omega in rad/s of contacts that only push, with the sides at x (T, sides) in m; collective.

    It is computed at about `pmr.simulation.contact_step.PLACES` of the T times.  It is 0 if all contacts that only push
    are rigid.  `mass` is the factor of M.
    """
    pushing, largest = np.flatnonzero(~np.isnan(system.clearance)), 0.0
    steps = np.unique(np.linspace(0, len(x) - 1, contact_step.PLACES).astype(int))
    rows = rows_on_paths(system, x[steps])
    parts = zip(mass.of_bodies, rows.visited.of_bodies, strict=True)
    mobility = PathCompliance([solve_for_carriers(M, E, system.comm, False).compliance for M, E in parts], rows)
    F = system.compliance.constant[np.ix_(pushing, pushing)]
    for k in range(len(steps)):
        rows.move(k)
        mobile = mobility.of_rows(rows)[np.ix_(pushing, pushing)]
        largest = max(largest, contact_step.row_frequency(F[None], mobile[None]))
    return float(system.comm.bcast(largest))
