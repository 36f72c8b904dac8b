"""A system of bodies as one set of equations: block matrices, and the rows of contacts at given coordinates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.files.arrays import Array, Indices, Mask
from pmr.system.body import SlidingBody, clear_rows, is_round_off
from pmr.system.body_matrices import natural_frequencies
from pmr.system.polynomials import evaluate
from pmr.system.states import ContactRows, add_springs, free_motions
from pmr.system.system import System, consecutive
from pmr.system.terms import Term, TermSum

#: Shift in (rad/s)^2: `Assembly.modes` adds this many times M to K, which is singular if nothing holds a body.
SHIFT = 1.0


class ClosedModes(NamedTuple):
    """Modes of a system with all contacts closed."""

    omega: Array  # (f,) rad/s
    phi: Array  # (n, f) 1/sqrt(kg)


class SideWeights(NamedTuple):
    """Weights of the rows of m contacts on the d carriers that the sides on one body touch.

    A carrier that several sides touch counts once for each of them.
    """

    touched: Indices  # (d,): numbers of the carriers; a carrier that several sides touch is there several times
    owners: Indices  # (d,): number of the side that touches each of them
    # (3, m, d): with the sides' signs; then their first and second derivatives by the places of the sides
    weights: Array


class Assembly:
    """Equations of all bodies as sparse matrices, on the n coordinates of the bodies that no support holds at zero.

    The system has m contacts, i inputs, o outputs and k terms that vary in time.  The rows C (m, n) of the contacts,
    with their flexibility and the effect of inputs (`ContactRows`), depend on coordinates x (sides,) in m.  A side is
    one of the two places that a contact joins; x has the coordinate of each side's place along its body, in the order
    of `System.sides`.
    """

    def __init__(self, system: System) -> None:
        """Prepare the equations of `system`, on the coordinates that no support holds at zero."""
        self.system, bodies = system, system.bodies
        # numbers of the coordinates of each body that its supports leave free
        self.free_coordinates = {
            name: np.setdiff1d(np.arange(body.size), list(body.held.values())) for name, body in bodies.items()
        }
        # slices of each body's free coordinates, inputs and outputs among those of all bodies
        sizes = (
            [len(free) for free in self.free_coordinates.values()],
            [len(body.input_names) for body in bodies.values()],
            [body.outputs.shape[0] for body in bodies.values()],
        )
        self.coordinate_slices, self.input_slices, self.output_slices = (
            dict(zip(bodies, consecutive(of_bodies), strict=True)) for of_bodies in sizes
        )
        # numbers of coordinates without inertia in simulators (M has their inertia)
        still = [np.isin(self.free_coordinates[name], body.quasi_static) for name, body in bodies.items()]
        self.quasi_static = np.flatnonzero(np.concatenate(still))

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return sum(map(len, self.free_coordinates.values()))

    def body_coordinates(self, name: str, q: Array) -> Array:
        """All coordinates (T, n') of the body `name`, from the free coordinates q (T, n) of all bodies.

        Coordinates that supports hold are zero.
        """
        coordinates = np.zeros((len(q), self.system.bodies[name].size))
        coordinates[:, self.free_coordinates[name]] = q[:, self.coordinate_slices[name]]
        return coordinates

    @cached_property
    def M(self) -> sp.csr_matrix:
        """Mass matrix (n, n)."""
        return self._blocks(lambda body, free: body.M[np.ix_(free, free)])

    @cached_property
    def D(self) -> sp.csr_matrix:
        """Damping matrix (n, n), without terms that vary in time."""
        return self._blocks(lambda body, free: body.D[np.ix_(free, free)])

    @cached_property
    def K(self) -> sp.csr_matrix:
        """Stiffness matrix (n, n), without contacts and without terms."""
        return self._blocks(lambda body, free: body.K[np.ix_(free, free)])

    @cached_property
    def B(self) -> sp.csr_matrix:
        """Forces (n, i) of unit inputs."""
        return self._blocks(lambda body, free: body.B[free])

    @cached_property
    def outputs(self) -> sp.csr_matrix:
        """Matrix O (o, n): the outputs by the free coordinates q (n,) of all bodies are O q."""
        return self._blocks(lambda body, free: body.outputs[:, free])

    def _blocks(self, block_of: Callable[[SlidingBody, Indices], sp.csr_matrix | Array]) -> sp.csr_matrix:
        """Sparse block-diagonal matrix with a block for each body, in the order of the bodies.

        The block of a body is ``block_of(body, numbers)`` with the numbers of the body's free coordinates.
        """
        bodies = zip(self.system.bodies.values(), self.free_coordinates.values(), strict=True)
        blocks = [block_of(body, free) for body, free in bodies]
        if any(map(sp.issparse, blocks)):
            return sp.block_diag([sp.csr_matrix(block) for block in blocks], format="csr")
        return sp.csr_matrix(scipy.linalg.block_diag(*blocks))  # in a third of the time

    @cached_property
    def terms(self) -> list[Term]:
        """Terms of the system, with sparse matrices on the same n coordinates as the equations."""
        numbers = dict[str, Indices]()
        for name, body in self.system.bodies.items():
            numbers[name] = np.full(body.size, -1, np.int64)
            numbers[name][self.free_coordinates[name]] = np.arange(self.size)[self.coordinate_slices[name]]
        return [term.scatter(numbers, self.size) for term in self.system.terms]

    @cached_property
    def direct(self) -> Array:
        """Outputs W = O R B (o, i) in m/N of unit inputs B by the residual flexibility R, with the output matrix O.

        The entries of bodies without residual flexibility are zero.
        """
        W = np.zeros((_count(self.output_slices), _count(self.input_slices)))
        for name, flexibility in self._flexibility.items():
            W[self.output_slices[name], self.input_slices[name]] = flexibility.direct
        return W

    @cached_property
    def energy(self) -> Array:
        """Product B^T R B (i, i) in m/N of inputs B and residual flexibility R: twice the energy under unit inputs."""
        of_loads = np.zeros((_count(self.input_slices),) * 2)
        for name, flexibility in self._flexibility.items():
            of_loads[self.input_slices[name], self.input_slices[name]] = flexibility.energy
        return of_loads

    @property
    def _flexibility(self) -> dict[str, Any]:
        """Residual flexibility of the bodies, by their names: on carriers if a body has carriers, else as tables.

        Bodies without residual flexibility are left out.
        """
        of_bodies = {
            name: (body if body.carriers is None else body.carriers).flexibility
            for name, body in self.system.bodies.items()
        }
        return {name: flexibility for name, flexibility in of_bodies.items() if flexibility is not None}

    def stiffness(self, c: Sequence[float] | Array = ()) -> sp.csr_matrix:
        """Stiffness K + sum_k c_k G_k (n, n) with amplitudes c (k,) of the terms and G_k of term k; K if c is empty."""
        return self.stiffness_sum.matrix(c)

    def damping(self, c: Sequence[float] | Array = ()) -> sp.csr_matrix:
        """Damping D + sum_k c_k V_k (n, n) with amplitudes c (k,) of the terms and V_k of term k; D if c is empty."""
        return self._damping_sum.matrix(c)

    @cached_property
    def stiffness_sum(self) -> TermSum:
        """Stiffness of bodies and terms, for any amplitudes of the terms."""
        return TermSum(self.K, self.terms, "stiffness")

    @cached_property
    def _damping_sum(self) -> TermSum:
        """Damping of bodies and terms, for any amplitudes of the terms."""
        return TermSum(self.D, self.terms, "damping")

    def term_forces(self, q: Array, v: Array, c: Array) -> Array:
        """Forces -sum_k c_k (V_k v + G_k q) (T, n) in N of the terms, with damping V_k and stiffness G_k of term k.

        The coordinates are q (T, n), their rates v (T, n), and the amplitudes of the terms c (T, k).
        """
        forces = np.zeros_like(q)
        for term, amplitude in zip(self.terms, c.T, strict=True):
            for A, motion in ((term.stiffness, q), (term.damping, v)):
                if A is not None:
                    forces -= amplitude[:, None] * (A @ motion.T).T
        return forces

    def contact_rows(self, x: Array, effects: bool = True) -> ContactRows:
        """Rows of the contacts with their places at x (sides,) in m, as `System.side_coordinates` returns them.

        H and X of the result are the effects of inputs on contacts, and of contacts on outputs, by the residual
        flexibility.  They are empty if `effects` is false.
        """
        return self.contact_rows_over_time(x[None], effects).at_time(0)

    def contact_rows_over_time(self, x: Array, effects: bool = True) -> ContactRows:
        """Rows of the contacts with their places at x (T, sides) in m, at T times.

        Entries of the flexibility that are only round-off are zero, which marks rigid contacts.  If `effects` is false,
        H and X are empty, which takes a fraction of the time.
        """
        system, T, m = self.system, len(x), len(self.system.contacts)
        i, o = (_count(self.input_slices), _count(self.output_slices)) if effects else (0, 0)
        C, H, X = np.zeros((T, m, self.size)), np.zeros((T, m, i)), np.zeros((T, o, m))
        F = np.array(np.broadcast_to(system.contact_compliance(x), (T, m, m)))
        rows = ContactRows(C, F, H, X)
        for name, body in system.bodies.items():
            if on := system.sides_of(name):
                (self._add_table_rows if body.carriers is None else self._add_carrier_rows)(name, on, x.T[on], rows)
        F = (F + F.transpose(0, 2, 1)) / 2.0
        clear_rows(F, is_round_off(F, system.largest_flexibility))
        return ContactRows(C, F, H, X)

    def contact_motions_by_moments(self, x: Array) -> Array:
        """Motions (m, m) in 1/N of all contacts under unit moments: entry (j, k) is that of contact j by one at k.

        A moment acts on both sides of its contact.  The places are at x (sides,) in m.  Only the residual flexibility
        of the bodies gives way to the moments.
        """
        moved_by_moments = np.zeros((len(self.system.contacts),) * 2)
        for name, flexibility in self._flexibility.items():
            touched, _, b = self.side_weights(name, x)
            moved_by_moments += b[0] @ flexibility.rows[touched[:, None], touched].T @ b[1].T
        return moved_by_moments

    def side_weights(self, name: str, x: Array) -> SideWeights:
        """Weights of the contacts' rows on the carriers of the body `name`, which has at least one side of a contact.

        The sides of all bodies are at x (sides,) in m.
        """
        numbers = self.system.sides_of(name)
        sides = [self.system.sides[number] for number in numbers]
        each = [self.system.row(side.place).derivatives(x[number]) for number, side in zip(numbers, sides, strict=True)]
        counts = [len(of_side.touched) for of_side in each]
        owners, weights = np.repeat(numbers, counts), np.zeros((3, len(self.system.contacts), sum(counts)))
        for side, of_side, at in zip(sides, each, consecutive(counts), strict=True):
            weights[:, side.contact, at] = side.sign * of_side.weights
        return SideWeights(np.concatenate([of_side.touched for of_side in each]), owners, weights)

    def outputs_by_moments(self, x: Array) -> Array:
        """Outputs (o, m) in 1/N under a unit moment on the sides of each contact, whose places are at x (sides,) in m.

        Only the residual flexibility of the bodies gives way to the moments.
        """
        moved_outputs = np.zeros((_count(self.output_slices), len(self.system.contacts)))
        for name, flexibility in self._flexibility.items():
            touched, _, b = self.side_weights(name, x)
            moved_outputs[self.output_slices[name]] = flexibility.outputs[:, touched] @ b[1].T
        return moved_outputs

    def _add_carrier_rows(self, name: str, side_numbers: Sequence[int], x: Array, rows: ContactRows) -> None:
        """Add to `rows`, in place, the contributions of the body `name`, whose rows are on carriers.

        `side_numbers` are the numbers of the body's sides, and the places of these are at x (sides, T) in m.
        """
        sides, carriers = [self.system.sides[a] for a in side_numbers], self.system.bodies[name].carriers
        assert carriers is not None
        contacts, flexibility = [side.contact for side in sides], carriers.flexibility
        # of some thousand carriers the sides touch a few: a product with all would copy tables of 100 MB each time
        places = [self.system.row(side.place).touched_weights(at, 0) for side, at in zip(sides, x, strict=True)]
        touched = np.hstack([at for at, _ in places])  # (T, d)
        weights = np.hstack([side.sign * b for side, (_, b) in zip(sides, places, strict=True)])
        ends, among = np.cumsum([0, *(at.shape[1] for at, _ in places)]), np.zeros((len(touched), *[len(sides)] * 2))
        for number, (k, first, last) in enumerate(zip(contacts, ends, ends[1:], strict=False)):
            at, b = touched[:, first:last], weights[:, None, first:last]
            rows.C[:, k, self.coordinate_slices[name]] += (b @ carriers.values[at])[:, 0, self.free_coordinates[name]]
            if flexibility is None:
                continue
            pairs = at[:, :, None] * len(flexibility.rows) + touched[:, None, first:]
            between = (b @ flexibility.rows.take(pairs))[:, 0] * weights[:, first:]
            among[:, number, number:] = np.add.reduceat(between, ends[number:-1] - first, axis=1)
            if rows.H.size + rows.X.size:
                rows.H[:, k, self.input_slices[name]] += (b @ flexibility.inputs[at])[:, 0]
                rows.X[:, self.output_slices[name], k] += (b @ flexibility.outputs.T[at])[:, 0]
        rows.F[:, np.array(contacts)[:, None], contacts] += among + np.triu(among, 1).transpose(0, 2, 1)

    def _add_table_rows(self, name: str, side_numbers: Sequence[int], x: Array, contact_rows: ContactRows) -> None:
        """Add to `contact_rows`, in place, what the only body, `name`, contributes from its tables over the path.

        `side_numbers` are the numbers of the body's sides, whose places are at x (sides, T) in m.  The tables are taken
        at the place of the first side that travels, or of the first side if none travels.
        """
        body, sides = self.system.reduced[name], [self.system.sides[a] for a in side_numbers]
        s = next((at for side, at in zip(sides, x, strict=True) if side.place.path is not None), x[0])
        rows, contacts = [body.row_names.index(side.place.row) for side in sides], [side.contact for side in sides]
        contact_rows.C[:, contacts] = body.C(s)[:, rows]
        if (flexibility := body.flexibility) is not None:
            contact_rows.F[:, np.array(contacts)[:, None], contacts] += evaluate(flexibility.rows, s)[:, rows][
                :, :, rows
            ]
            if contact_rows.H.size + contact_rows.X.size:
                contact_rows.H[:, contacts] = evaluate(flexibility.inputs, s)[:, rows]
                contact_rows.X[:, :, contacts] = evaluate(flexibility.outputs, s)[:, :, rows]

    def frequency_responses(
        self, rows: ContactRows, omega: Array, c: Sequence[float] | Array = ()
    ) -> NDArray[np.complex128]:
        r"""Frequency responses (W, o + m, i) to unit inputs at omega (W,) in rad/s: of outputs, then of contact forces.

        .. math::
            (-\omega^2 M + i \omega D + K)\, q + C^T \lambda = B f, \qquad C q + H f - F \lambda = 0, \qquad
            y = O q + W f - X \lambda

        with every contact closed.  The contacts have `rows` C, F, H and X at given places, and K and D contain the
        terms with amplitudes c (k,).  A LinAlgError is raised where the equations are singular, as at 0 rad/s if the
        contacts do not hold the bodies.
        """
        M, D, K, B = (A.toarray() for A in (self.M, self.damping(c), self.stiffness(c), self.B))
        n, scale = len(K), rows.force_scale(K)
        held = np.block([[K, scale * rows.C.T], [scale * rows.C, -(scale**2) * rows.F]]).astype(complex)
        right, O, answers = np.vstack([B, -scale * rows.H]), self.outputs.toarray(), list[Array]()
        for w in omega:
            matrix = held.copy()
            matrix[:n, :n] += 1j * w * D - w**2 * M
            q, forces = np.vsplit(np.linalg.solve(matrix, right), [n])
            answers.append(np.vstack([O @ q + self.direct - rows.X @ (scale * forces), scale * forces]))
        return np.array(answers)

    def row_rates(self, x: Array, x_rate: Array) -> Array:
        """Rates dC/dt (m, n) of the contacts' rows: places at x (sides,) in m move with x_rate (sides,) in m/s.

        If all rates are 1, the result is the derivative of the rows by a displacement that all places have in common.
        Raises ValueError if a place that moves is outside its path.
        """
        rates = np.zeros((len(self.system.contacts), self.size))
        for side, at, rate in zip(self.system.sides, x, x_rate, strict=True):
            if rate != 0.0:
                body, name = self.system.bodies[side.place.body], side.place.body
                if body.carriers is None:
                    row = np.asarray(body.C(float(at), 1))[body.row_names.index(side.place.row)]
                else:
                    row = self.system.row(side.place).weights(at, 1).toarray()[0] @ body.carriers.values
                rates[side.contact, self.coordinate_slices[name]] += side.sign * rate * row[self.free_coordinates[name]]
        return rates

    def frequencies(self, x: Array, count: int, c: Array | None = None, closed: Mask | None = None) -> Array:
        """Lowest natural frequencies (count,) or (S, count) in Hz at one or S places.

        The places of all contacts are at x (sides,) or (S, sides) in m, and the terms have amplitudes c (k,) or (S, k);
        None stands for zero amplitudes.  At S places the mask `closed` (S, m) says which of m contacts are closed; None
        stands for all.  If there are fewer than `count` frequencies, the remaining entries are NaN.
        Of the matrices of terms, only the symmetric part of the stiffness and the antisymmetric (gyroscopic) part of
        the damping count.  At the buckling load and beyond, the lowest frequency is 0 Hz.
        """
        if x.ndim == 1:
            return np.asarray(self.frequencies(x[None], count, None if c is None else c[None])[0])
        rows, hertz = self.contact_rows_over_time(x, effects=False), np.full((len(x), count), np.nan)
        amplitudes = np.zeros((len(x), len(self.terms))) if c is None else c
        C: Array | None = None  # of rigid contacts
        M, Z = self.M.toarray(), None
        for k in range(len(x)):
            K, V, at = self.stiffness(amplitudes[k]).toarray(), self.damping(amplitudes[k]) - self.D, rows.at_time(k)
            at = at if closed is None or closed[k].all() else at.select(closed[k])
            K, turning = add_springs((K + K.T) / 2.0, at), (V - V.T).toarray() / 2.0 if V.count_nonzero() else None
            if C is None or not np.array_equal(C, at.C[at.rigid]):  # a cylinder's row is the same everywhere
                C = at.C[at.rigid]
                Z = free_motions(C)
                M = self.M.toarray() if Z is None else Z.T @ self.M.toarray() @ Z
            if Z is not None:
                K, turning = Z.T @ K @ Z, None if turning is None else Z.T @ turning @ Z
            if not len(K):
                continue  # the contacts hold all coordinates
            omega = natural_frequencies(M, turning, K)[:count]
            hertz[k, : len(omega)] = omega / (2.0 * np.pi)
        return hertz

    def modes(self, rows: ContactRows, count: int, c: Array | Sequence[float] = ()) -> ClosedModes:
        """Lowest modes with every contact closed, omega ascending.

        The modes are normalised to phi^T M phi = 1.  `rows` are the contacts' rows at one time.  The number f of modes
        is `count`, or less if the assembly has fewer.  The terms have amplitudes c (k,), and only the symmetric part of
        their stiffness counts.  At the buckling load and beyond, the lowest omega is 0.
        """
        M, stiffness, Z = self.M.toarray(), self.stiffness(c).toarray(), free_motions(rows.C[rows.rigid])
        K = add_springs((stiffness + stiffness.T) / 2.0, rows) + SHIFT * M
        if Z is not None:
            M, K = Z.T @ M @ Z, Z.T @ K @ Z
        if len(c) and scipy.linalg.eigvalsh(K, subset_by_index=(0, 0))[0] <= 0.0:  # buckled: K is not positive definite
            omega2, phi = scipy.linalg.eigh(K, M, subset_by_index=(0, min(count, len(K)) - 1))
            return ClosedModes(np.sqrt(np.maximum(omega2 - SHIFT, 0.0)), phi if Z is None else Z @ phi)
        # the largest of the inverse: low modes to full relative accuracy
        inverse, z = scipy.linalg.eigh(M, K, subset_by_index=(max(len(K) - count, 0), len(K) - 1))
        phi = z[:, ::-1] / np.sqrt(inverse[::-1])
        return ClosedModes(np.sqrt(np.maximum(1.0 / inverse[::-1] - SHIFT, 0.0)), phi if Z is None else Z @ phi)

    def damping_ratios(self, x: Array, count: int) -> Array:
        r"""Damping ratios (S, count) of the lowest modes with every contact closed, at x (S, sides) in m.

        .. math::
            \zeta_k = \phi_k^T D \phi_k / (2 \omega_k), \qquad \phi_k^T M \phi_k = 1

        D is without terms that vary in time.  Columns are in the order of ascending frequencies, and NaN beyond the
        last mode.  A mode without stiffness, whose omega is zero, has the ratio infinity, or NaN without damping.  If a
        ratio is small, it agrees with what a logarithmic decrement or a half-power width gives.
        """
        ratios, D = np.full((len(x), count), np.nan), self.damping()
        for of_place, at in zip(ratios, x, strict=True):
            omega, phi = self.modes(self.contact_rows(at, effects=False), count)
            of_place[: len(omega)] = np.sum(phi * (D @ phi), axis=0) / (2.0 * omega)
        return ratios


def _count(slices: Mapping[str, slice]) -> int:
    """Number of entries that the `slices` of all bodies, by the body's name, select together."""
    return max((entries.stop for entries in slices.values()), default=0)
