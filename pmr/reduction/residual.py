"""Reduced models with the residual flexibility that their basis leaves out."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.interpolate import PPoly

from pmr.errors import InputError
from pmr.fem.compat import PETSc
from pmr.fem.distributed import free_dropped, inner, local_csr, times
from pmr.files.arrays import Array
from pmr.fullmodel.model import FullModel
from pmr.reduction.basis import RANK_CHECKS, Basis, galerkin, without_rows
from pmr.reduction.free_body import FreeBody, released_rows
from pmr.reduction.residual_tables import ResidualFlexibility, carrier_loads, load_powers, tables, terms
from pmr.scene.members import TAIL
from pmr.system.attachment import RICHER
from pmr.system.body_matrices import dependence_of_flexibility
from pmr.system.carriers import CarrierFlexibility, CarrierRows, CylinderResponses, Flexibility
from pmr.system.polynomials import add_tables, multiply_tables
from pmr.system.reduced_model import ReducedModel, satisfied_rows
from pmr.system.rows import SharedCarriers
from pmr.system.truncation import is_modal, truncate, with_tables

#: Largest coefficient of a fixed row on a basis that satisfies this row, over the largest coefficient of all rows.
SATISFIED = 1e-6
#: Lowest eigenvalue of the flexibility of rows, scaled to a unit diagonal, below which the rows are dependent.
INDEPENDENT = 1e-9
#: Couplings of the basis in K and D, relative to the terms they are sums of, are round-off up to this many times the
#: machine precision; between eigenmodes, up to 30 times was seen.
ROUND_OFF = 100.0
#: Least flexibility of a row, over the flexibility C K^+ C^T of the basis at this row; see `_with_floor`.
FLOOR = float(np.sqrt(np.finfo(float).eps))
#: Flexibility of a row and value of this row on the basis, each over the largest of all, up to which supports hold it.
HELD = 1e-12
#: Most entries of all responses to loads together with which matrices of a moving frame are computed between them.
MOST_ENTRIES = 20_000_000
#: Eigenvalue of the products of responses of unit size, over the largest one, up to which a direction is left out.
SPANNED = 1e-13


def flexible_model(body: FreeBody, basis: Basis, provenance: dict[str, object]) -> ReducedModel:
    """Galerkin projection on `basis`, with tables of the flexibility that it leaves out; the same on every rank.

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
    flexible = _with_flexibility(reduced, tables(flexibility, shared, model.rows.domain))
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
    model's coordinates, the others are its enrichment modes.  If there are enrichment modes and the model is to be
    `estimable`, it has the inertia of the residual part on the carriers, with which errors are estimated; this doubles
    the number of solves.  If a cylinder holds the section's tail, the model has the responses to the cylinder's force,
    and the work of these responses on the `motions` (n_local, h) of rigid supports, None if there are none
    (`pmr.reduction.free_body.support_motions`).

    An InputError is raised as by `flexible_model`, and a ValueError if the basis has vectors that are not eigenmodes.
    """
    model, shared, V = body.model, _rows_on_path(body.model), np.array(basis.V.getDenseArray())
    residual = ResidualFlexibility(body, V)
    reduced = _project(residual, basis, provenance)
    powers = 2 if estimable and coordinates < basis.size else 1  # R, and R M R
    flexibility, *inertia = load_powers(residual, shared.carriers, powers)
    x = _cylinder_responses(residual, shared, flexibility)
    answers = None if x is None else _cylinder_values(residual, shared, x, motions)
    loads = carrier_loads(model, shared.carriers)
    has_span = inertia and model.matrices
    span, spanned = _spanning_vectors(residual, loads) if has_span else _Span(None, np.zeros((0, loads.shape[1])))
    body.free_factor()
    free_dropped(model.comm)
    values = _carrier_measures(model, shared, basis)
    carriers = CarrierRows.from_rows(released_rows(model).shared_carriers.rows, values, flexibility)
    flexible = _with_flexibility(reduced, tables(flexibility, shared, model.rows.domain))
    if basis.size < model.size:  # all motions of a body leave no flexibility out
        check_independence(flexible, _yielding_rows(flexible))
    carriers = replace(carriers, inertia=inertia[0] if inertia else None, answers=answers, spanned=spanned)
    of_carriers = _with_matrices(carriers, model, [V, span, x], motions)
    return _with_coordinates(replace(flexible, carriers=of_carriers), coordinates)


def _carrier_measures(model: FullModel, shared_carriers: SharedCarriers, basis: Basis) -> Array:
    """Values U V (K, r) of a basis V on the K carriers U of `shared_carriers`; collective."""
    measured = shared_carriers.carriers[:, model.share] @ np.array(basis.V.getDenseArray())
    return np.asarray(model.comm.allreduce(measured))


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

    The n = `RICHER` + 1 responses are R c, R M R c and so on, with the row c of the cylinder.  The responses are zero
    if supports hold the body where the cylinder acts.
    """
    load = _tail_weights(shared_carriers)
    if load is None:
        return None
    x = residual.powers(load @ shared_carriers.carriers[:, residual.model.share], RICHER + 1)
    return x * 0.0 if load @ flexibility.rows @ load <= HELD * np.diagonal(flexibility.rows).max() else x


class _Span(NamedTuple):
    """Vectors (n_local, p) that span L responses, and coefficients (p, L): each response is a sum of the vectors.

    If the vectors are None, p is 0.
    """

    vectors: Array | None
    coefficients: Array


def _spanning_vectors(residual: ResidualFlexibility, loads: sp.csc_matrix) -> _Span:
    """Vectors (n_local, p) that span the responses R g to loads g (n_local, L), and the responses' coefficients (p, L).

    Collective.  R is the `residual` flexibility.  If there are too many loads, the vectors are None and p is 0.  For a
    beam, p is at most its number of coordinates; for a shell, at most L.
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
    """Return `carriers` with the model's `matrices` between all `vectors`, and with values of ports on these vectors.

    `vectors` are blocks of columns (n_local, any), or None for an empty block.  `motions` (n_local, h) belong to h
    rigid supports, None if there are none; the work of the matrices on them, (h, number of vectors), is added too.
    Nothing is added for a model without matrices.  Collective.
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
        inputs=comm.allreduce(local_csr(model.inputs).T @ x),
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
    return with_tables(model) if coordinates == model.size else truncate(model, coordinates)


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


def _with_flexibility(reduced: ReducedModel, flexibility: Flexibility) -> ReducedModel:
    """Return the model `reduced` with the residual flexibility `flexibility`.

    Unless the basis consists of eigenmodes, `_with_floor` raises the flexibility where it is too small.
    """
    flexible = replace(reduced, flexibility=flexibility)
    return flexible if is_modal(flexible) else _with_floor(flexible)


def _yielding_rows(model: ReducedModel) -> list[int]:
    """Numbers of the rows at which the body can move or give way; its supports hold all other rows everywhere.

    A row that the supports hold may have no flexibility on this body, because the contact gives way on its other body.
    """
    assert model.flexibility is not None
    s = _checked_positions(model)
    G = np.einsum("tmm->tm", model.flexibility.rows(s)).max(axis=0, initial=0.0)
    C = np.abs(model.rows(s)).max(axis=(0, 2), initial=0.0)
    still = (G <= HELD * G.max(initial=0.0)) & (C <= HELD * C.max(initial=0.0))
    return np.flatnonzero(~still).tolist()


def _rows_on_path(model: FullModel) -> SharedCarriers:
    """Rows of a model's sliders and pads, on common carriers and with common breaks over the path."""
    return released_rows(model).shared_carriers.align_breaks(model.rows.domain)


def _without_round_off(reduced: ReducedModel, residual: ResidualFlexibility, V: Array) -> ReducedModel:
    r"""Return the model with zeros for the stiffness of rigid-body modes and for couplings by round-off only.

    V (n_local, r) is this rank's part of the basis of the model `reduced`.  Round-off in the stiffness of a rigid-body
    mode acts as a positive or negative spring to ground.  A coupling of the basis vectors i and j with

    .. math:: |V^T K V|_{ij} \le c\, \epsilon\, (|V|^T |K|\, |V|)_{ij}

    with c = `ROUND_OFF` and the machine precision :math:`\epsilon` has no correct digit.  Between the modes of a fine
    mesh all couplings are of this kind.
    """
    model, rigid, bound = residual.model, residual.rigid, ROUND_OFF * np.finfo(float).eps

    def size(A: PETSc.Mat) -> Array:
        return inner(np.abs(V), terms(A, V), model.comm)

    def remove_round_off(A: Array, terms: Array) -> Array:
        lost = np.abs(A) <= bound * terms
        return np.where(lost & ~np.eye(len(A), dtype=bool), 0.0, A)

    of_K = size(model.K)
    of_D = size(model.D) if model.rayleigh is None else model.rayleigh.matrix(size(model.M), of_K)
    K, D = remove_round_off(reduced.K, of_K), remove_round_off(reduced.D, of_D)
    K[rigid] = K[:, rigid] = 0.0
    return replace(reduced, K=K, D=D)


def _with_floor(model: ReducedModel) -> ReducedModel:
    """Return the model with a least residual flexibility: `FLOOR` times C K^+ C^T, which is that of its coordinates.

    This least flexibility is added to the residual flexibility G of those rows C for which G + 1/k, with the row's
    stiffness k, is less anywhere on the path.  If there is no such row, the model is returned unchanged.  Not to be
    called for free modes: these leave something out everywhere, and on soft supports C K^+ C^T is the flexibility of
    the supports, far more than that of bending.

    A basis of modes with the slider held responds by itself to a force at the held positions, and leaves nothing out
    there.  The stiffness C^T G^-1 C of such a row would drown the body's own stiffness in round-off.  With the floor,
    both round-off and the additional displacement of the row are about 1e-8 of the displacement.
    """
    assert model.flexibility is not None
    G, C = model.flexibility.rows, model.rows
    of_modes = multiply_tables(C, C, np.linalg.pinv(model.K, rcond=1e-12, hermitian=True))
    s = np.sort(np.concatenate([C.x, _checked_positions(model)]))
    residual_part, held = (np.einsum("tmm->tm", table(s)) for table in (G, of_modes))
    lacking = np.any(residual_part + model.row_compliance < FLOOR * held, axis=0)
    if not lacking.any():
        return model
    floor = PPoly(of_modes.c * np.outer(lacking, lacking), of_modes.x)
    return replace(model, flexibility=replace(model.flexibility, rows=add_tables(G, floor, FLOOR)))


def check_independence(model: ReducedModel, numbers: list[int] | None = None) -> None:
    """Raise an InputError if the forces on some rows are not determined at one of `RANK_CHECKS` path coordinates.

    The forces are not determined if the rows' flexibility G + 1/k, with the residual flexibility G and the stiffnesses
    k of the pads, is not positive definite.  The rows have the given `numbers`; None stands for all rows.  The ends of
    the path are not checked: there a slider may be on a support.
    """
    assert model.flexibility is not None
    numbers = list(range(len(model.row_names))) if numbers is None else numbers
    names = [model.row_names[k] for k in numbers]
    for s in _checked_positions(model) if numbers else ():
        F = model.flexibility.rows(s) + np.diag(model.row_compliance)
        dependence = dependence_of_flexibility(F[np.ix_(numbers, numbers)], names)
        if dependence.measure < INDEPENDENT:
            dependent = ", ".join(dependence.names)
            allowed = (
                f"the rows {dependent} depend on each other at s = {s:.4g} m, so their forces are not "
                "determined; sliders, supports and pads that hold different motions are allowed, or a stiffness"
            )
            raise InputError("scene", "", None, allowed)


def _checked_positions(model: ReducedModel) -> Array:
    """Path coordinates (RANK_CHECKS,) in m, spread evenly over the domain without its ends."""
    low, high = model.domain
    return low + (high - low) * (np.arange(RANK_CHECKS) + 0.5) / RANK_CHECKS
