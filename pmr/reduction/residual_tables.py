r"""Residual flexibility: applied as an operator, and tabulated over the path.

Residual flexibility as exact piecewise polynomials in s: products of the rows' polynomials with R on the path.

The flexibility that a basis leaves out, applied and never formed.

With rigid-body modes Z (Z^T M Z = I) and the rest of the basis W, turned so that W^T M W = I and W^T K W = diag(theta),

.. math::
    R = P\, K^+ P^T, \qquad P = I - Z (M Z)^T - W (K W\, \mathrm{diag}(\theta)^{-1})^T

P^T takes from a load what the basis answers and makes it self-equilibrated, so K^+ may be a solve with the rigid-body
modes held at any statically determinate set of coordinates; P takes the basis out of the answer.  For eigenmodes R is
the sum of phi phi^T / omega^2 over the modes left out; for any other basis K^-1 - V (V^T K V)^-1 V^T.  The basis and
what R answers are K-orthogonal in any case; eigenmodes make them M-orthogonal too.

On soft supports K w = theta M w is small beside its own terms, and little but round-off is left of it.  With theta of
2e-5 rad^2/s^2 beside 2e3 of the first mode that bends three digits were; the error of that shell was 0.7, 2.0 or 3.5 %
by the processor's kernel of BLAS.  Where K w is theta M w but for round-off, M w stands for K w / theta: it has all its
digits.

Projecting on both sides keeps what a difference loses: with 6 and 20 modes of a cantilever on 50 elements R is off by
2e-10 and 6e-10 (scaled to a unit diagonal), K^-1 less the modal part by 1e-5 and 1e-4.  Projecting again gains nothing.
MacNeal: A hybrid method of component mode synthesis, Computers & Structures 1, 1971, pp. 581-601; Craig and Kurdila:
Fundamentals of Structural Dynamics, 2nd ed., 2006, section 17.6 (inertia relief).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.constraints.polynomials import transpose
from pmr.constraints.rows import RowPolynomials, SharedCarriers
from pmr.errors import InputError, environment
from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import free_objects, inner, local_csr, sparse, subtract, times
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.structural import Orbits, images_of
from pmr.reduced.carriers import CarrierFlexibility, Flexibility
from pmr.reduction.free_body import FreeBody, fixed_rows

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
_log = logging.getLogger(__name__)


#: What a mirror image of a basis may have beside it, over its largest entry.  Modes know their span to 3e-11, 4e-10 and
#: some 3e-9 at 70,000, 280,000 and a million coordinates; one that cuts two equal modes apart is off by all of it.
KEPT = 1e-8
#: K w is an eigenmode's theta M w where they differ by no more than so many times the round-off of its terms.
ROUND_OFF = 100.0


class ResidualFlexibility:
    """R of a model on its fixed rows for the basis V, given by this rank's rows (n_local, r); collective.

    V holds those rigid-body modes that loads or rows excite.
    """

    def __init__(self, body: FreeBody, V: Array) -> None:
        self.model = model = body.model
        self._body, self._comm = body, model.comm
        Z, MZ = body.Z, body.MZ
        self.rigid = body.rigid(V)  # (r,): which columns of the basis are motions of a rigid body
        W = V[:, ~self.rigid]
        W = W - Z @ inner(MZ, W, self._comm)
        W, dual = _diagonalise(model, W)
        self._basis = np.asfortranarray(np.hstack([Z, W]))
        self._dual = np.asfortranarray(np.hstack([MZ, dual]))

    def keeps(self, P: sp.csr_matrix) -> bool:
        """Whether basis and fixed rows are their own images by P of the body, so that R P = P R; collective."""
        M, held = self.model.M, [row.at(row.breaks[0]) for row in fixed_rows(self.model)]
        if held and np.any(images_of(sp.vstack(held, format="csr"), [P])[0].partners < 0):
            return False
        first, last = M.getOwnershipRange()
        mirror = sparse(P[first:last], M, columns=last - first)
        image = times(mirror, self._basis)
        free_objects(mirror)
        apart = image - self._basis @ inner(self._dual, image, self._comm)
        far, size = (np.max(self._comm.allgather(np.abs(x).max(axis=0, initial=0.0)), axis=0) for x in (apart, image))
        return bool(np.all(far <= KEPT * size))

    def apply(self, g: Array) -> Array:
        """R g, this rank's rows (n_local, k) in m, of loads in N given likewise, which may be overwritten."""
        g = np.asfortranarray(g)
        subtract(g, self._dual, inner(self._basis, g, self._comm))
        x = np.asfortranarray(self._body.solve(g))
        subtract(x, self._basis, inner(self._dual, x, self._comm))
        return x

    def powers(self, c: Array, count: int) -> Array:
        """R c, R M R c, ..., (n_local, count), of one load by this rank's rows c (n_local,); collective."""
        columns = [self.apply(np.array(c)[:, None])]
        while len(columns) < count:
            columns.append(self.apply(times(self.model.M, columns[-1])))
        return np.asfortranarray(np.hstack(columns))


def terms(A: PETSc.Mat, X: Array) -> Array:
    """|A| |X| (n_local, k): the size of what is summed in A X, by which its round-off is known; collective."""
    sizes = sparse(abs(local_csr(A)), A, columns=A.getLocalSize()[1])
    sums = times(sizes, np.abs(X))
    free_objects(sizes)
    return sums


def _diagonalise(model: FullModel, W: Array) -> tuple[Array, Array]:
    """Columns that span those of W (n_local, k), with W^T M W = I and W^T K W diagonal, and K W over the diagonal."""
    if W.shape[1] == 0:
        return W, W
    comm = model.comm
    theta, Q = scipy.linalg.eigh(inner(W, times(model.K, W), comm), inner(W, times(model.M, W), comm))
    W = np.ascontiguousarray(W @ Q)
    KW, MW, of_K = times(model.K, W), times(model.M, W), terms(model.K, W)
    differs, size = (np.diagonal(inner(x, x, comm)) for x in (KW - theta * MW, of_K))
    return W, np.where(differs <= (ROUND_OFF * np.finfo(float).eps) ** 2 * size, MW, KW / theta)


Pattern: TypeAlias = sp.csr_matrix | None

#: Loads answered at a time for each rank: a few times as many vectors of full length are in memory.  A column costs a
#: tenth of what it costs alone, and more at a time would not make it cheaper (70,000 coordinates of a shell).
BLOCK = 64
#: Bytes from which on the log says what is taken of memory.
NOTICED = 2**30


class Measured:
    """Measures of tall columns by sparse rows (m, n_local), which touch a few coordinates."""

    def __init__(self, rows: sp.spmatrix) -> None:
        rows = sp.csr_matrix(rows)
        self._touched = np.unique(rows.indices)
        self._rows = rows[:, self._touched]

    def of(self, x: Array) -> Array:
        """This rank's part (m, k) of rows times x (n_local, k)."""
        return np.asarray(self._rows @ x[self._touched])


@dataclass(frozen=True)
class LoadFlexibility:
    """R between loads, those on K carriers first and the inputs behind them, and outputs."""

    pairs: sp.csr_matrix | Array  # (L, L) m/N, between loads, sparse for the pairs that were asked for, or of any two
    outputs: Array  # (o, L) m/N
    carriers: int  # K

    @property
    def inputs(self) -> Array:
        """(L, i), m/N."""
        return _dense(self.pairs[:, self.carriers :])

    def between_any_two(self) -> CarrierFlexibility:
        """Flexibility between any two loads, where all pairs were computed."""
        dense, K = _dense(self.pairs), self.carriers
        return CarrierFlexibility(dense[:K, :K], dense[:K, K:], self.outputs[:, :K], self.outputs[:, K:], dense[K:, K:])


class Pairs:
    """Numbers for pairs of loads, block by block, where a symmetric `pattern` (L, L) has an entry."""

    def __init__(self, pattern: sp.csr_matrix) -> None:
        self._pattern = pattern
        self._found: list[tuple[Indices, Indices, Array]] = [(np.empty(0, int), np.empty(0, int), np.empty(0))]

    def beside(self, numbers: Indices) -> Indices:
        """Loads that make a pair with one of these."""
        return np.unique(self._pattern[numbers].indices)

    def put(self, rows: Indices, columns: Indices, values: Array) -> None:
        """Values (rows, columns), this rank's part."""
        block = self._pattern[rows][:, columns].tocoo()
        self._found.append((rows[block.row], columns[block.col], values[block.row, block.col]))

    def total(self, comm: Any) -> sp.csr_matrix:
        """All of them (L, L), made symmetric; collective."""
        rows, columns, values = (np.concatenate(parts) for parts in zip(*self._found, strict=True))
        summed = sp.csr_matrix((comm.allreduce(values), (rows, columns)), self._pattern.shape)
        return (summed + summed.T) / 2.0


class AnyTwo:
    """Pattern of all pairs of `count` loads."""

    def __init__(self, count: int) -> None:
        self._found, self._all = np.zeros((count, count)), np.arange(count)

    def beside(self, numbers: Indices) -> Indices:
        """All of them."""
        return self._all

    def put(self, rows: Indices, columns: Indices, values: Array) -> None:
        """Values (L, columns), this rank's part; `rows` are all."""
        self._found[:, columns] = values

    def total(self, comm: Any) -> Array:
        """All of them (L, L), made symmetric; collective."""
        comm.Allreduce(MPI.IN_PLACE, self._found)
        self._found += self._found.T.copy()
        self._found /= 2.0
        return self._found


def _dense(A: sp.csr_matrix | Array) -> Array:
    return A if isinstance(A, np.ndarray) else np.asarray(A.toarray())


def load_pairs(shared: SharedCarriers, inputs: int) -> sp.csr_matrix:
    """Pairs (L, L) of loads on carriers that rows touch at the same place, and of inputs with all.

    All that tables at one path coordinate take: on the path of a beam each load meets a few others, however fine the
    mesh.
    """
    k = len(shared.rows[0].breaks) - 1
    at = np.concatenate([np.broadcast_to(np.arange(k)[:, None], row.touched.shape).ravel() for row in shared.rows])
    touched = np.concatenate([row.touched.ravel() for row in shared.rows])
    of_carriers = sp.csr_matrix((np.ones(len(at)), (at, touched)), (k, shared.carriers.shape[0]))
    of_all = sp.hstack([of_carriers, np.ones((k, inputs))], format="csr")
    return sp.csr_matrix(of_all.T @ of_all)


class OnCarriers:
    """Measures of answers to loads on carriers, inputs and outputs: of pairs in a pattern, or of any."""

    def __init__(self, model: FullModel, carriers: sp.csr_matrix, pattern: Pattern) -> None:
        self._rows, self._outputs = carrier_loads(model, carriers).T.tocsr(), Measured(local_csr(model.outputs).T)
        self._comm, self._carriers, loads = model.comm, carriers.shape[0], self._rows.shape[0]
        self._pairs = AnyTwo(loads) if pattern is None else Pairs(pattern)
        self._found = np.empty((model.outputs.getSize()[1], loads))

    def take(self, numbers: Indices, answers: Array) -> None:
        """This rank's rows (n_local, k) of the answers to the loads with these numbers."""
        partners = self._pairs.beside(numbers)
        self._pairs.put(partners, numbers, Measured(self._rows[partners]).of(answers))
        self._found[:, numbers] = self._outputs.of(answers)

    def result(self) -> LoadFlexibility:
        """Flexibility of all loads, once their answers are there; collective."""
        outputs = np.asarray(self._comm.allreduce(self._found))
        return LoadFlexibility(self._pairs.total(self._comm), outputs, self._carriers)


def load_flexibility(residual: ResidualFlexibility, carriers: sp.csr_matrix, pattern: Pattern) -> LoadFlexibility:
    """R on carriers (K, n) and on the inputs, as `load_powers`."""
    return load_powers(residual, carriers, pattern, 1)[0]


def check_memory(model: FullModel, carriers: int, powers: int) -> None:
    """Refuse so many carriers of pads along their paths that what they measure of each other does not fit; collective.

    Their number grows with the length of the path over that of the shortest pad.  Raises an InputError; of what takes
    more than `NOTICED` the log says so before it is done.
    """
    needed = 8 * carriers**2 * (powers + 2)  # bytes; as long as one of them is made symmetric there are two more
    free = model.comm.bcast(environment.available_memory() if model.comm.rank == 0 else None)
    message = f"pads have {carriers:,} stations along their paths, which takes about {needed / 1e9:.1f} GB of memory"
    if free is not None and needed > free:
        allowed = f"{message}, {free / 1e9:.1f} GB are free; longer pads, or a shorter path, are allowed"
        raise InputError("scene", "pads.length", None, allowed)
    if needed > NOTICED and model.comm.rank == 0:
        _log.warning("%s; longer pads take less", message)


def load_powers(
    residual: ResidualFlexibility, carriers: sp.csr_matrix, pattern: Pattern, count: int
) -> list[LoadFlexibility]:
    """The first `count` of R, R M R, ... on carriers (K, n) and inputs, in s^2 m/N from the second on; collective.

    For each a load takes a static solve, but for those that are mirror images of others.

    Kept for the pairs of loads of a `pattern` (L, L), as `load_pairs` gives it, or, without one, of any two.
    """
    model = residual.model
    if pattern is None:
        check_memory(model, carriers.shape[0], count)
    loads, tables = carrier_loads(model, carriers), [OnCarriers(model, carriers, pattern) for _ in range(count)]
    images = images_of(carriers, [P for P in model.mirrors if residual.keeps(P)])
    orbits = Orbits(np.arange(loads.shape[1]), images, model.M)
    _log.info(
        "%d static solves answer loads on %d carriers and %d inputs",
        count * len(orbits.own),
        carriers.shape[0],
        loads.shape[1] - carriers.shape[0],
    )
    many = min(BLOCK, 2 * BLOCK // (1 + len(images))) * model.comm.size
    for k in range(0, len(orbits.own), many):
        representatives = orbits.own[k : k + many]
        columns = loads[:, representatives].toarray(order="F")
        for power, table in enumerate(tables):
            columns = residual.apply(times(model.M, columns) if power else columns)
            for answers in orbits.answers(representatives, columns):
                table.take(answers.numbers, answers.columns)
    orbits.drop()
    return [table.result() for table in tables]


def tables(flexibility: LoadFlexibility, shared: SharedCarriers) -> Flexibility:
    """Tables of rows on common carriers and breaks, all of them at the same path coordinate."""
    C, K, inputs = RowPolynomials.of(shared.rows), flexibility.carriers, flexibility.inputs
    return Flexibility(
        rows=C.quadratic_form(flexibility.pairs[:K, :K]),
        inputs=C.times(inputs[:K]),
        outputs=transpose(C.times(flexibility.outputs[:, :K].T)),
        direct=flexibility.outputs[:, K:],
        energy=inputs[K:],
    )


def carrier_loads(model: FullModel, carriers: sp.csr_matrix) -> sp.csc_matrix:
    """Unit loads on the carriers, then the inputs: this rank's rows."""
    share = slice(*model.M.getOwnershipRange())
    return sp.hstack([carriers[:, share].T, local_csr(model.inputs)], format="csc")
