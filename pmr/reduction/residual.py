"""Reduced models with the residual flexibility that their basis leaves out, tabulated over the path.

The tables are exact piecewise polynomials in s: products of the rows' polynomials with the residual flexibility R
between carriers, the vectors of which all rows are combinations (`pmr.system.rows`).
"""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from pmr.errors import InputError, environment
from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import SparseProduct, free_dropped, inner, local_csr, times
from pmr.files.arrays import Array, Indices
from pmr.fullmodel.model import FullModel
from pmr.reduction.basis import Basis, galerkin, without_rows
from pmr.reduction.free_body import FreeBody, ResidualFlexibility, absolute_product, released_rows
from pmr.scene.members import TAIL
from pmr.system.attachment import RICHER
from pmr.system.carriers import CarrierFlexibility, CarrierRows, CylinderResponses, Flexibility
from pmr.system.reduced_model import ReducedModel, satisfied_rows
from pmr.system.rows import RowPolynomials, SharedCarriers
from pmr.system.truncation import (
    HELD,
    check_independence,
    is_modal,
    truncate,
    with_floor,
    yielding_rows,
)

#: Largest coefficient of a fixed row on a basis that satisfies this row, over the largest coefficient of all rows.
SATISFIED = 1e-6


#: Couplings of the basis in K and D, relative to the terms they are sums of, are round-off up to this many times the
#: machine precision; between eigenmodes, up to 30 times was seen.
ROUND_OFF = 100.0


#: Most entries of the responses to all loads together; if they have more, the vectors that span them are left out.
MOST_ENTRIES = 20_000_000
#: Eigenvalue of the products of responses of unit size, over the largest one, up to which a direction is left out.
SPANNED = 1e-13


def flexible_model(body: FreeBody, basis: Basis, provenance: dict[str, object]) -> ReducedModel:
    """Galerkin projection on `basis`, with tables of the flexibility that it leaves out; the same on every rank.

    Collective.

    Parameters
    ----------
    body : FreeBody
        Full model with its factor, which may exist from making the basis; the memory of the factor is freed at the end.
    basis : Basis
        Basis that contains all rigid-body modes that the fixed rows leave free: `pmr.reduction.basis.modal_basis` of
        free modes, or `pmr.reduction.basis.with_rigid_modes`.
    provenance : dict
        How the reduced model is made; it is stored with the model.

    Raises
    ------
    InputError
        If rows depend on each other, or the basis violates a fixed row.

    Notes
    -----
    Statics are exact with any basis.  Eigenmodes have no inertia in common with what they leave out; for any other
    basis this coupling is neglected, which matters as long as low modes are missing.  With the POD basis of the evolved
    case of Weyrer, Gerstmayr, Mikkola, Orzechowski (`pmr.reduction.snapshots`), the error relative to the full beam is
    87 % with 10 coordinates, 0.17 % with 12 and 0.020 % with 20.
    """
    model, shared, V = body.model, _rows_on_path(body.model), np.array(basis.V.getDenseArray())
    residual = ResidualFlexibility(body, V)
    reduced = _project(residual, basis, provenance)
    (flexibility,) = load_powers(residual, shared.carriers, 1)
    body.free_factor()
    free_dropped(model.comm)
    flexible = replace(reduced, flexibility=tables(flexibility, shared, model.rows.domain))
    flexible = flexible if is_modal(flexible) else with_floor(flexible)
    check_independence(flexible)
    return flexible


def section_model(
    body: FreeBody,
    basis: Basis,
    provenance: dict[str, object],
    coordinates: int,
    motions: Array | None = None,
    estimable: bool = True,
) -> ReducedModel:
    """Reduced model of a section on free modes, with its rows on carriers (`pmr.system.carriers`); collective.

    The result keeps `provenance`, which says how it was made.  The first `coordinates` modes of the basis are the
    model's coordinates, the others are its enrichment modes.

    If there are enrichment modes and `estimable` is true, the model has the inertia of the residual part on the
    carriers.  With this inertia errors are estimated; it doubles the number of solves.  If a cylinder holds the
    section's tail, the model has the responses to the cylinder's force.  `motions` (n_local, h) are unit motions of
    rigid supports, None if there are none (`pmr.reduction.free_body.support_motions`).  The model then has the work
    that the inertia of the residual responses, to the cylinder and on the carriers, does on these motions.

    The factor of `body` is freed.  An InputError is raised as by `flexible_model`, and a ValueError if the basis has
    vectors that are not eigenmodes.
    """
    model, shared, V = body.model, _rows_on_path(body.model), np.array(basis.V.getDenseArray())
    residual = ResidualFlexibility(body, V)
    reduced = _project(residual, basis, provenance)
    powers = 2 if estimable and coordinates < basis.size else 1  # R, and R M R
    flexibility, *inertia = load_powers(residual, shared.carriers, powers)
    x = _cylinder_responses(residual, shared, flexibility)
    answers = None if x is None else _cylinder_values(residual, shared, x, motions)
    loads = carrier_loads(model, shared.carriers)
    moved = None if motions is None or not inertia else residual.apply(times(model.M, motions))
    has_span = inertia and model.matrices
    span, spanned = _spanning_vectors(residual, loads) if has_span else _Span(None, np.zeros((0, loads.shape[1])))
    body.free_factor()
    free_dropped(model.comm)
    values = np.asarray(model.comm.allreduce(shared.carriers[:, model.share] @ V))  # U V (K, r) of the carriers U
    carriers = CarrierRows.from_rows(released_rows(model).shared_carriers.rows, values, flexibility)
    flexible = reduced.with_carriers(carriers)
    if basis.size < model.size:  # all motions of a body leave no flexibility out
        check_independence(flexible, yielding_rows(flexible))
    carriers = replace(carriers, inertia=inertia[0] if inertia else None, answers=answers, spanned=spanned)
    if moved is not None:
        carriers = replace(carriers, support_inertia=np.asarray(model.comm.allreduce(moved.T @ loads)))
    of_carriers = _with_matrices(carriers, model, [V, span, x], motions)
    return _with_coordinates(replace(flexible, carriers=of_carriers), coordinates)


def _tail_weights(shared_carriers: SharedCarriers) -> Array | None:
    """Weights (K,), on the K carriers, of the row that a section's cylinder holds.

    None is returned if the section has no cylinder.
    """
    tail = next((row for row in shared_carriers.rows if row.name == TAIL), None)
    return None if tail is None else np.asarray(tail.weights(tail.breaks[0]).toarray()[0])


def _cylinder_responses(
    residual: ResidualFlexibility, shared_carriers: SharedCarriers, flexibility: CarrierFlexibility
) -> Array | None:
    """Responses (n_local, n), this rank's part, to a unit force of a section's cylinder; None without a cylinder.

    The n = `RICHER` + 1 responses are R c, R M R c and so on, with the row c of the cylinder.  If supports hold the
    body where the cylinder acts, as the `flexibility` between carriers shows, the responses are zero.  Collective.
    """
    load = _tail_weights(shared_carriers)
    if load is None:
        return None
    x = residual.powers(load @ shared_carriers.carriers[:, residual.model.share], RICHER + 1)
    return x * 0.0 if load @ flexibility.rows @ load <= HELD * np.diagonal(flexibility.rows).max() else x


class _Span(NamedTuple):
    """Vectors (n_local, p) that span L responses, and coefficients (p, L): the product of both is the responses.

    If the vectors are None, p is 0, and the responses are not known.
    """

    vectors: Array | None
    coefficients: Array


def _spanning_vectors(residual: ResidualFlexibility, loads: sp.csc_matrix) -> _Span:
    """Vectors (n_local, p) that span the responses R g to loads g (n_local, L), and the responses' coefficients (p, L).

    Collective.  R is the `residual` flexibility.  If the responses have more than `MOST_ENTRIES` entries, the vectors
    are None and p is 0.  A small model, such as a beam, may have fewer than 2 L coordinates.  Then the vectors are unit
    vectors of its coordinates, and p is the number of coordinates.  Otherwise p is at most L.
    """
    model = residual.model
    if model.size * loads.shape[1] > MOST_ENTRIES:
        return _Span(None, np.zeros((0, loads.shape[1])))
    Z = residual.apply(loads.toarray(order="F"))
    size = np.sqrt(model.comm.allreduce(np.sum(Z**2, axis=0)))
    Z *= np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    if model.size < 2 * loads.shape[1]:  # a beam: the vectors are coordinates; matrices are sparse
        every = np.concatenate(model.comm.allgather(Z))
        noise = np.abs(every) <= ROUND_OFF * np.finfo(float).eps  # parts of a beam that bends in one plane, or twists
        return _Span(np.eye(model.size)[model.share], np.where(noise, 0.0, every) * size)
    share, Q = np.linalg.eigh(inner(Z, Z, model.comm))
    is_spanned = share > SPANNED * share[-1]
    root = np.sqrt(share[is_spanned])
    return _Span(Z @ (Q[:, is_spanned] / root), (root[:, None] * Q[:, is_spanned].T) * size)


def _with_matrices(
    carriers: CarrierRows, model: FullModel, vectors: list[Array | None], motions: Array | None
) -> CarrierRows:
    """Return `carriers` with X^T A X for each of the model's `matrices` A, and with values of ports on the v columns X.

    The columns X are those of all blocks (n_local, any) in `vectors`; None is an empty block.  `motions` (n_local, h)
    are unit motions of h rigid supports, None if there are none.  With motions Phi, the products Phi^T A X (h, v) are
    added as `supports`.  A model without matrices adds nothing.  Collective.
    """
    if not model.matrices:
        return carriers
    every = np.hstack([block for block in vectors if block is not None])
    products = {name: times(A, every) for name, A in model.matrices.items()}
    matrices = {name: inner(every, block, model.comm) for name, block in products.items()}
    supports = {} if motions is None else {name: inner(motions, block, model.comm) for name, block in products.items()}
    ports = {name: model.comm.allreduce(row[:, model.share] @ every)[0] for name, row in model.ports.items()}
    return replace(carriers, matrices=matrices, ports=ports, supports=supports)


def _cylinder_values(
    residual: ResidualFlexibility, shared_carriers: SharedCarriers, x: Array, motions: Array | None
) -> CylinderResponses:
    """Values, on carriers, inputs, outputs and supports, of the responses x (n_local, n) to the cylinder's force.

    `motions` (n_local, h) are unit motions of the h rigid supports; None if there are none.  Collective.
    """
    model, load = residual.model, _tail_weights(shared_carriers)
    assert load is not None  # without a load there is no x
    U, comm = shared_carriers.carriers[:, model.share], model.comm
    return CylinderResponses(
        load=load,
        rows=comm.allreduce(U @ x),
        inputs=comm.allreduce(local_csr(model.B).T @ x),
        outputs=comm.allreduce(local_csr(model.outputs).T @ x),
        stiffness=inner(x, times(model.K, x), comm),
        inertia=inner(x, times(model.M, x), comm),
        supports=inner(x[:, :0] if motions is None else motions, times(model.M, x), comm),
    )


def _with_coordinates(model: ReducedModel, coordinates: int) -> ReducedModel:
    """Return the model with its first `coordinates` modes as coordinates, and its other modes as enrichment modes.

    A ValueError is raised unless the basis consists of eigenmodes.
    """
    if not is_modal(model):
        raise ValueError("residual inertia needs a basis of eigenmodes: it is the inertia of the truncated ones")
    return model if coordinates == model.size else truncate(model, coordinates)


def _project(residual: ResidualFlexibility, basis: Basis, provenance: dict[str, object]) -> ReducedModel:
    """Galerkin projection on a basis that satisfies the fixed rows, without these rows; collective.

    The result keeps `provenance`.  An InputError is raised if the basis violates a fixed row.
    """
    model = residual.model
    complete = galerkin(model, basis, provenance)
    fixed = [i for i, row in enumerate(model.rows.rows) if row.is_fixed]
    V = np.array(basis.V.getDenseArray())
    largest = max(model.comm.allgather(float(np.abs(V).max(initial=0.0))))
    round_off = ROUND_OFF * np.finfo(float).eps * largest  # if all rows are satisfied, the largest of them is no scale
    violated = set(fixed) - set(satisfied_rows(complete.rows, SATISFIED, round_off))
    if violated:
        moved_rows = ", ".join(model.rows.names[i] for i in sorted(violated))
        allowed = f"vectors that move no rigid support are allowed where flexibility is true; these move {moved_rows}"
        raise InputError("scene", "reduction.basis", None, allowed)
    return _without_round_off(without_rows(complete, fixed), residual, V)


def _rows_on_path(model: FullModel) -> SharedCarriers:
    """Rows of a model's sliders and pads, on common carriers and with common breaks over the path."""
    return released_rows(model).shared_carriers.align_breaks(model.rows.domain)


def _without_round_off(reduced: ReducedModel, residual: ResidualFlexibility, V: Array) -> ReducedModel:
    r"""Return the model with zeros for the stiffness of rigid-body modes and for couplings by round-off only.

    V (n_local, r) is this rank's part of the basis of the model `reduced`.  Round-off in the stiffness of a rigid-body
    mode acts as a positive or negative spring to ground.  A coupling of the basis vectors i and j with

    .. math:: |V^T K V|_{ij} \le c\, \epsilon\, (|V|^T |K|\, |V|)_{ij}

    with c = `ROUND_OFF` and the machine precision :math:`\epsilon` has no correct digit.  Between the modes of a fine
    mesh all couplings are of this kind.  Collective.
    """
    model, rigid, bound = residual.model, residual.rigid, ROUND_OFF * np.finfo(float).eps

    def sum_sizes(A: PETSc.Mat) -> Array:
        """Matrix |V|^T |A| |V| (r, r) of the sums of sizes of the terms of V^T A V."""
        return inner(np.abs(V), absolute_product(A, V), model.comm)

    def remove_round_off(A: Array, sizes: Array) -> Array:
        """Return A (r, r) with zeros off the diagonal where it is round-off in terms of these `sizes` (r, r)."""
        lost = np.abs(A) <= bound * sizes
        return np.where(lost & ~np.eye(len(A), dtype=bool), 0.0, A)

    of_K = sum_sizes(model.K)
    of_D = sum_sizes(model.D) if model.rayleigh is None else model.rayleigh.matrix(sum_sizes(model.M), of_K)
    K, D = remove_round_off(reduced.K, of_K), remove_round_off(reduced.D, of_D)
    K[rigid] = K[:, rigid] = 0.0
    return replace(reduced, K=K, D=D)


_log = logging.getLogger(__name__)


#: Number of loads solved for at a time on each rank: a few times as many vectors of full length are in memory.  A load
#: then costs a tenth of what it costs alone, and larger blocks would not make it cheaper (70,000 coordinates of a
#: shell).
BLOCK = 64
#: Bytes of memory above which a warning is logged.
NOTICED = 2**30


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
    load.  Raises the error of `check_memory`.
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
    return sp.hstack([carriers[:, model.share].T, local_csr(model.B)], format="csc")
