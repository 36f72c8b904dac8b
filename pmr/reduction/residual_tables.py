r"""Residual flexibility R that a basis leaves out: applied as an operator, never formed, and tabulated over the path.

The tables are exact piecewise polynomials in s: products of the rows' polynomials with R between carriers.

With rigid-body modes Z (Z^T M Z = I) and the rest of the basis W, combined so that W^T M W = I and W^T K W =
diag(theta),

.. math::
    R = P\, K^+ P^T, \qquad P = I - Z (M Z)^T - W (K W\, \mathrm{diag}(\theta)^{-1})^T

P^T removes from a load what the basis responds to and makes it self-equilibrated, so K^+ may be a solve with the
rigid-body modes held at any statically determinate set of coordinates; P removes the basis from the response.  For
eigenmodes R is the sum of phi phi^T / omega^2 over the modes left out; for any other basis it is K^-1 - V (V^T K V)^-1
V^T.  The basis and the responses of R are K-orthogonal in any case, and M-orthogonal too for eigenmodes.

On soft supports, K w = theta M w for a low mode w is small compared with the terms that it is the sum of, and is little
but round-off.  For a shell with theta = 2e-5 rad^2/s^2 for its lowest mode, and 2e3 for the first mode that bends,
three digits remained; its error was 0.7, 2.0 or 3.5 %, depending on which BLAS kernel the processor used.  If K w is
theta M w up to round-off, M w replaces K w / theta, since M w has all its digits.

Projecting on both sides avoids the cancellation of a difference: with 6 and 20 modes of a cantilever on 50 elements R
is off by 2e-10 and 6e-10 (scaled to a unit diagonal), K^-1 less the modal part by 1e-5 and 1e-4.  Projecting again
gains nothing.  MacNeal: A hybrid method of component mode synthesis, Computers & Structures 1, 1971, pp. 581-601; Craig
and Kurdila: Fundamentals of Structural Dynamics, 2nd ed., 2006, section 17.6 (inertia relief).
"""

from __future__ import annotations

import logging

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from pmr.errors import InputError, environment
from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import free_objects, inner, local_csr, sparse, subtract, times
from pmr.files.arrays import Array, Indices
from pmr.fullmodel.model import FullModel
from pmr.reduction.free_body import FreeBody
from pmr.system.carriers import CarrierFlexibility, Flexibility
from pmr.system.rows import RowPolynomials, SharedCarriers

_log = logging.getLogger(__name__)


#: K w counts as theta M w of an eigenmode w if they differ by at most this many times the round-off in the terms of K
#: w.
ROUND_OFF = 100.0


class ResidualFlexibility:
    """Residual flexibility R, an operator in m/N, that a basis V (n_local, r) of a model leaves out; collective.

    V is this rank's part of the basis.  It has to contain the rigid-body modes that loads or rows excite.  The model is
    held by its fixed rows alone.
    """

    def __init__(self, body: FreeBody, V: Array) -> None:
        """Prepare solves for the responses of `body` that the basis V (n_local, r) leaves out; collective."""
        self.model = model = body.model
        self._body, self._comm = body, model.comm
        Z, MZ = body.Z, body.MZ
        self.rigid = body.are_rigid(V)  # (r,): which columns of the basis are motions of a rigid body
        W = V[:, ~self.rigid]
        W = W - Z @ inner(MZ, W, self._comm)
        W, dual = _diagonalise(model, W)
        self._basis = np.asfortranarray(np.hstack([Z, W]))
        self._dual = np.asfortranarray(np.hstack([MZ, dual]))

    def apply(self, g: Array) -> Array:
        """Product R g (n_local, k) in m, this rank's part, for loads g (n_local, k) in N; collective.

        The array g may be overwritten.
        """
        g = np.asfortranarray(g)
        subtract(g, self._dual, inner(self._basis, g, self._comm))
        x = np.asfortranarray(self._body.solve(g))
        subtract(x, self._basis, inner(self._dual, x, self._comm))
        return x

    def powers(self, c: Array, count: int) -> Array:
        """Vectors R c, R M R c, ... (n_local, `count`), this rank's part, for one load c (n_local,).

        Collective.
        """
        columns = [self.apply(np.array(c)[:, None])]
        while len(columns) < count:
            columns.append(self.apply(times(self.model.M, columns[-1])))
        return np.asfortranarray(np.hstack(columns))


def terms(A: PETSc.Mat, X: Array) -> Array:
    """Product |A| |X| (n_local, k) of absolute values, which bounds the terms of A X and so its round-off; collective.

    X (n_local, k) and the result are this rank's parts.
    """
    sizes = sparse(abs(local_csr(A)), A, columns=A.getLocalSize()[1])
    sums = times(sizes, np.abs(X))
    free_objects(sizes)
    return sums


def _diagonalise(model: FullModel, W: Array) -> Array:
    """Combinations U of the columns W, and K U over the diagonal of U^T K U, as one array (2, n_local, k); collective.

    The combinations satisfy U^T M U = I, and U^T K U is diagonal.  For a column that is an eigenvector up to round-off,
    the second result is M U, which is more accurate.  Collective.
    """
    if W.shape[1] == 0:
        return np.array([W, W])
    comm = model.comm
    theta, Q = scipy.linalg.eigh(inner(W, times(model.K, W), comm), inner(W, times(model.M, W), comm))
    W = np.ascontiguousarray(W @ Q)
    KW, MW, of_K = times(model.K, W), times(model.M, W), terms(model.K, W)
    differs, size = (np.diagonal(inner(x, x, comm)) for x in (KW - theta * MW, of_K))
    return np.array([W, np.where(differs <= (ROUND_OFF * np.finfo(float).eps) ** 2 * size, MW, KW / theta)])


#: Number of loads solved for at a time on each rank: a few times as many vectors of full length are in memory.  A load
#: then costs a tenth of what it costs alone, and larger blocks would not make it cheaper (70,000 coordinates of a
#: shell).
BLOCK = 64
#: Bytes of memory above which a warning is logged.
NOTICED = 2**30


class SparseProduct:
    """Sparse rows (m, n_local) that touch few coordinates, prepared for fast products with dense columns."""

    def __init__(self, rows: sp.spmatrix) -> None:
        rows = sp.csr_matrix(rows)
        self._touched = np.unique(rows.indices)
        self._rows = rows[:, self._touched]

    def multiply(self, x: Array) -> Array:
        """Product (m, k) of the rows with x (n_local, k); this rank's contribution to the sum over ranks."""
        return np.asarray(self._rows @ x[self._touched])


class LoadValues:
    """Values on K carriers, i inputs and o outputs of the responses to unit loads on the carriers, then on the inputs.

    `loads` (n_local, K + i) are this rank's part of the loads, `carriers` is the number K.
    """

    def __init__(self, model: FullModel, loads: sp.csc_matrix, carriers: int) -> None:
        self._comm, self._carriers, count = model.comm, carriers, loads.shape[1]
        self._loads, self._outputs = SparseProduct(loads.T), SparseProduct(local_csr(model.outputs).T)
        self._on_loads, self._on_outputs = np.zeros((count, count)), np.empty((model.outputs.getSize()[1], count))

    def store(self, numbers: Indices, answers: Array) -> None:
        """Store the values of the responses `answers` (n_local, k) to the loads with these `numbers` (k,).

        The responses are this rank's part.
        """
        self._on_loads[:, numbers] = self._loads.multiply(answers)
        self._on_outputs[:, numbers] = self._outputs.multiply(answers)

    def result(self) -> CarrierFlexibility:
        """Flexibility between carriers, inputs and outputs, made symmetric; collective.

        The responses to all loads have to be stored before.
        """
        pairs, K = self._on_loads, self._carriers
        self._comm.Allreduce(MPI.IN_PLACE, pairs)
        pairs += pairs.T.copy()
        pairs /= 2.0
        outputs = np.asarray(self._comm.allreduce(self._on_outputs))
        return CarrierFlexibility(pairs[:K, :K], pairs[:K, K:], outputs[:, :K], outputs[:, K:], pairs[K:, K:])


def check_memory(model: FullModel, carriers: int, powers: int) -> None:
    """Raise an InputError if the tables of `powers` matrices (carriers, carriers) don't fit in memory; collective.

    The number of carriers grows with the ratio of the path's length to the length of the shortest pad.  If the tables
    need more than `NOTICED` bytes, a warning is logged.
    """
    needed = 8 * carriers**2 * (powers + 2)  # bytes; making one symmetric takes two more
    free = model.comm.bcast(environment.available_memory() if model.comm.rank == 0 else None)
    message = f"pads have {carriers:,} stations along their paths, which takes about {needed / 1e9:.1f} GB of memory"
    if free is not None and needed > free:
        allowed = f"{message}, {free / 1e9:.1f} GB are free; longer pads, a shorter path, or fewer elements of beams, "
        allowed += "are allowed"
        raise InputError("scene", "pads.length", None, allowed)
    if needed > NOTICED and model.comm.rank == 0:
        _log.warning("%s; longer pads take less", message)


def load_powers(residual: ResidualFlexibility, carriers: sp.csr_matrix, count: int) -> list[CarrierFlexibility]:
    """The first `count` of the flexibilities R, R M R, ... between carriers (K, n), inputs and outputs; collective.

    R is the `residual` flexibility, in m/N; R M R is in s^2 m/N, and so on.  Each of them takes one static solve per
    load.
    """
    model = residual.model
    check_memory(model, carriers.shape[0], count)
    loads = carrier_loads(model, carriers)
    tables = [LoadValues(model, loads, carriers.shape[0]) for _ in range(count)]
    _log.info(
        "%d static solves answer loads on %d carriers and %d inputs",
        count * loads.shape[1],
        carriers.shape[0],
        loads.shape[1] - carriers.shape[0],
    )
    many = BLOCK * model.comm.size
    for k in range(0, loads.shape[1], many):
        numbers = np.arange(k, min(k + many, loads.shape[1]))
        columns = loads[:, numbers].toarray(order="F")
        for power, table in enumerate(tables):
            columns = residual.apply(times(model.M, columns) if power else columns)
            table.store(numbers, columns)
    return [table.result() for table in tables]


def tables(
    flexibility: CarrierFlexibility, shared_carriers: SharedCarriers, domain: tuple[float, float]
) -> Flexibility:
    """Residual flexibility of the rows of `shared_carriers` as piecewise polynomials in s, over `domain` in m."""
    breaks = shared_carriers.rows[0].breaks if shared_carriers.rows else np.array(domain)
    return flexibility.tables(RowPolynomials.from_rows(shared_carriers.rows, breaks))


def carrier_loads(model: FullModel, carriers: sp.csr_matrix) -> sp.csc_matrix:
    """Unit loads (n_local, L), this rank's part: on each carrier (K, n), then on each input; L is their number."""
    return sp.hstack([carriers[:, model.share].T, local_csr(model.inputs)], format="csc")
