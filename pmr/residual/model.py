"""A reduced model with the residual flexibility of its basis."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.basis import Basis
from pmr.dependence import of_flexibility
from pmr.errors import InputError
from pmr.operators import FullModel
from pmr.parallel import free_dropped
from pmr.projection import RANK_CHECKS, galerkin, without_rows
from pmr.reduced import ReducedModel, satisfied_rows
from pmr.residual.inertia import with_inertia
from pmr.residual.operator import ResidualFlexibility
from pmr.residual.tables import quadratic, tables
from pmr.sliding import Row
from pmr.snapshots.free_modes import rigid_bodies
from pmr.truncation import is_modal, truncated

Array = NDArray[np.float64]

#: What a basis may leave of a fixed row, over the largest row.
SATISFIED = 1e-6
#: Rows whose flexibilities, scaled to a unit diagonal, have a smaller eigenvalue depend on each other.
INDEPENDENT = 1e-9
#: Least flexibility of a row over the one that the basis itself has there; see `_with_floor`.
FLOOR = float(np.sqrt(np.finfo(float).eps))


def flexible_model(model: FullModel, basis: Basis, provenance: dict[str, Any], solver: str = "auto") -> ReducedModel:
    """Galerkin projection on `basis` with tables of the flexibility that it leaves out; the same on every rank.

    Parameters
    ----------
    model : FullModel
    basis : Basis
        Holds all rigid-body modes that the fixed rows leave free: `pmr.basis.modal_basis` of free modes, or
        `pmr.basis.with_rigid_modes`.
    provenance : dict
    solver : ``"auto"``, ``"dense"`` or ``"slepc"``
        LAPACK, or MUMPS on the distributed stiffness.

    Raises
    ------
    InputError
        If rows depend on each other.
    ValueError
        If the basis violates a fixed row.

    Notes
    -----
    Statics are exact with any basis.  Eigenmodes and what they leave out have no inertia in common; for any other basis
    that coupling is neglected, at a price while it lacks low modes: the paper's basis, evolved case, is off by 87 % of
    the beam with 10 coordinates, by 0.17 % with 12 and by 0.020 % with 20.
    """
    flexible = _flexible(model, basis, provenance, solver)
    free_dropped(model.comm)
    return flexible


def modal_model(
    model: FullModel, basis: Basis, provenance: dict[str, Any], coordinates: int, solver: str = "auto"
) -> ReducedModel:
    """The same for eigenmodes, with tables of the residual part's inertia; modes beyond `coordinates` are companions.

    Raises
    ------
    InputError, ValueError
        As `flexible_model`, and if the basis holds anything but eigenmodes.
    """
    answers: list[Array] = []
    flexible = _flexible(model, basis, provenance, solver, answers)
    assert flexible.flexibility is not None
    if not is_modal(flexible):
        raise ValueError("the inertia of the residual part is that of truncated eigenmodes: the basis must hold these")
    inertial = replace(flexible, flexibility=with_inertia(flexible.flexibility, model, answers, _released(model)))
    free_dropped(model.comm)
    return inertial if coordinates == basis.size else truncated(inertial, coordinates)


def _flexible(
    model: FullModel, basis: Basis, provenance: dict[str, Any], solver: str, answers: list[Array] | None = None
) -> ReducedModel:
    whole = galerkin(model, basis, provenance)
    fixed = [i for i, row in enumerate(model.rows.rows) if row.fixed]
    violated = set(fixed) - set(satisfied_rows(whole.rows, SATISFIED))
    if violated:
        raise ValueError(f"the basis violates {', '.join(model.rows.names[i] for i in sorted(violated))}")
    V = np.array(basis.V.getDenseArray())
    reduced = _without_round_off(without_rows(whole, fixed), rigid_bodies(model, V))
    residual = ResidualFlexibility(model, V, solver, basis.rigid)
    flexibility = tables(model, residual, _released(model), reduced.rows.x, answers)
    residual.destroy()
    flexible = _with_floor(replace(reduced, flexibility=flexibility))
    _check_independence(flexible)
    return flexible


def _released(model: FullModel) -> list[Row]:
    """The rows of sliders and pads."""
    return [row for row in model.rows.rows if not row.fixed]


def _without_round_off(model: ReducedModel, rigid: NDArray[np.bool_]) -> ReducedModel:
    """No stiffness for rigid-body modes: what round-off leaves of it is a spring, or a negative one, to ground."""
    K = model.K.copy()
    K[rigid] = K[:, rigid] = 0.0
    return replace(model, K=K)


def _with_floor(model: ReducedModel) -> ReducedModel:
    """Where a row's flexibility falls short of `FLOOR`, G + FLOOR C K^+ C^T over the whole path.

    A basis of modes with the slider held answers a force at those positions itself and leaves nothing out there.  The
    stiffness C^T G^-1 C of such a row would drown the body's own in round-off; with the floor, both round-off and what
    the row gives way by are some 1e-8 of the displacement.
    """
    assert model.flexibility is not None
    G, C = model.flexibility.rows, model.rows
    own = quadratic(C.c, np.linalg.pinv(model.K, rcond=1e-12, hermitian=True))
    s = np.sort(np.concatenate([C.x, _spread(model)]))
    left, held = (np.einsum("tmm->tm", table(s)) for table in (G, PPoly(own, C.x)))
    if np.all(left >= FLOOR * held):
        return model
    return replace(model, flexibility=replace(model.flexibility, rows=PPoly(G.c + FLOOR * own, G.x)))


def _check_independence(model: ReducedModel) -> None:
    """G + 1/k must be positive definite over the path, ends excepted: there a slider may sit on a support."""
    assert model.flexibility is not None
    for s in _spread(model):
        F = model.flexibility.rows(s) + np.diag(model.row_compliance)
        found = of_flexibility(F, model.row_names)
        if found.measure < INDEPENDENT:
            names = ", ".join(found.names)
            allowed = f"the rows {names} depend on each other at s = {s:.4g} m; other sliders or supports are allowed"
            raise InputError("scene", "slider.offsets", None, allowed)


def _spread(model: ReducedModel) -> Array:
    """Path coordinates within the domain."""
    low, high = model.domain
    return low + (high - low) * (np.arange(RANK_CHECKS) + 0.5) / RANK_CHECKS
