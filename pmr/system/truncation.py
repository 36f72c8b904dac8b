r"""Tables of the residual flexibility: modes that move into them and back, and whether they determine the rows' forces.

.. math::
    G_r = G_{r+c} + \sum_{j=r+1}^{r+c} \frac{(C \varphi_j)(C \varphi_j)^T}{\omega_j^2},
    \qquad \text{and in the same way } H, X, W, B^T R B

with the flexibility table G_r of a model with r modes and the rows C (`pmr.system.carriers`).  So a model with r + c
modes contains every smaller one (docs/moving_residual_flexibility.md, section 12).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import PPoly
from scipy.linalg import block_diag

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.system.body_matrices import DAMPING, dependence_of_flexibility, symmetric_part
from pmr.system.carriers import EnrichmentModes
from pmr.system.polynomials import add_tables, multiply_tables
from pmr.system.reduced_model import ReducedModel

#: Largest entry that couples two modes, relative to their diagonal entries, in a modal form.
MODAL = 1e-6


#: Number of path coordinates at which the rank of the reduced rows is checked.
RANK_CHECKS = 64


def truncate(model: ReducedModel, r: int) -> ReducedModel:
    """Return the model on its first r modes; the static response of the other modes joins its residual flexibility.

    The other modes themselves become the model's first enrichment modes, from which `extend` takes them back.

    A ValueError is raised in these cases: the coordinates are no eigenmodes in ascending order; there is no residual
    flexibility on carriers; r is not between 1 and one less than the model's size; a mode without stiffness would be
    truncated.
    """
    if model.carriers is None or model.carriers.flexibility is None:
        raise ValueError("a model without residual flexibility has no tables that its modes could join: leading() cuts")
    if not is_modal(model):
        raise ValueError("only eigenmodes in ascending order can join the residual flexibility")
    if not 0 < r < model.size:
        raise ValueError(f"{r} modes of {model.size}: at least one has to stay and one to go")
    stiffness = np.diagonal(model.K)
    if not np.all(stiffness[r:] > MODAL * stiffness[-1] * np.finfo(float).eps):
        raise ValueError("a rigid-body motion has no flexibility: rigid-body modes have to stay")
    modes = EnrichmentModes(
        stiffness=stiffness[r:],
        damping=np.diagonal(model.D)[r:],
        B=model.B[r:],
        outputs=model.outputs[:, r:],
        matrices=model.matrices,
    )
    return replace(
        replace(model, flexibility=None, carriers=None).leading(r),
        enrichment=modes if model.enrichment is None else _join_modes(modes, model.enrichment),
    ).with_carriers(model.carriers.truncate(r, modes))


def extend(model: ReducedModel, count: int | None = None) -> ReducedModel:
    """Return the model with its first `count` enrichment modes (None: all) as last coordinates, undoing `truncate`.

    A ValueError is raised if the model has fewer enrichment modes or none at all, or if `count` is less than 1.
    """
    available = 0 if model.enrichment is None else model.enrichment.count
    count = available if count is None else count
    if model.enrichment is None or model.carriers is None or not 0 < count <= available:
        raise ValueError(f"{count} enrichment modes of {available}: the model has no more")
    back = _select_modes(model.enrichment, slice(count))
    matrices = {name: _extend_matrix(A, back.matrices.get(name), count) for name, A in model.matrices.items()}
    D = matrices[DAMPING] if DAMPING in matrices else block_diag(model.D, np.diag(back.damping))
    return replace(
        model,
        M=block_diag(model.M, np.eye(count)),
        D=symmetric_part(D),
        K=block_diag(model.K, np.diag(back.stiffness)),
        B=np.concatenate([model.B, back.B]),
        outputs=np.hstack([model.outputs, back.outputs]),
        matrices=matrices,
        ports={name: _extend_port(model, name, count) for name in model.ports},
        enrichment=_select_modes(model.enrichment, slice(count, None)) if count < available else None,
    ).with_carriers(model.carriers.extend(back))


def is_modal(model: ReducedModel) -> bool:
    """Whether the coordinates are M-orthonormal modes in ascending order, with K diagonal.

    D has to be diagonal too, unless the model's `matrices` contain D on all modes.
    """
    if np.any(np.abs(model.M - np.eye(model.size)) > MODAL):
        return False
    # round-off decides on the order of equal frequencies, such as those of rigid motions
    ascending = np.all(np.diff(np.diagonal(model.K)) >= -_round_off(model.K))
    return bool(ascending) and _is_diagonal(model.K) and (DAMPING in model.matrices or _is_diagonal(model.D))


def _is_diagonal(A: Array) -> bool:
    """Whether off-diagonal entries of A (n, n) are small relative to the diagonal ones (`MODAL`)."""
    scale = np.sqrt(np.abs(np.outer(np.diagonal(A), np.diagonal(A))))
    coupling = np.abs(A - np.diag(np.diagonal(A)))
    return bool(np.all(coupling <= MODAL * scale + _round_off(A)))


def _round_off(A: Array) -> float:
    """Absolute round-off to expect in entries of A (any shape), in the unit of A."""
    return 1e-9 * float(np.abs(A).max(initial=0.0))


def _extend_matrix(A: Array, on_all_modes: Array | None, count: int) -> Array:
    """Matrix A (r, r) extended to `count` more modes.

    `on_all_modes` is the same matrix on at least r + `count` modes, from which the entries are taken.  If it is None,
    zeros are appended.
    """
    r = len(A) + count
    return np.pad(A, (0, count)) if on_all_modes is None else np.ascontiguousarray(on_all_modes[:r, :r])


def _extend_port(model: ReducedModel, name: str, count: int) -> Array:
    """Port (r + count,) called `name` on the r coordinates and `count` more modes.

    If the carriers do not have the port's values on the modes, these values are zero.
    """
    port_of_carriers = None if model.carriers is None else model.carriers.ports.get(name)
    beyond = np.zeros(count) if port_of_carriers is None else port_of_carriers[model.size : model.size + count]
    return np.append(model.ports[name], beyond)


def _join_modes(first: EnrichmentModes, second: EnrichmentModes) -> EnrichmentModes:
    """Enrichment modes of `first`, followed by those of `second`, with the `matrices` of `second`.

    The `matrices` of `second` are those on the coordinates of the model and on the modes of both.
    """
    return EnrichmentModes(
        stiffness=np.concatenate([first.stiffness, second.stiffness]),
        damping=np.concatenate([first.damping, second.damping]),
        B=np.concatenate([first.B, second.B]),
        outputs=np.hstack([first.outputs, second.outputs]),
        matrices=second.matrices,
    )


def _select_modes(modes: EnrichmentModes, numbers: slice) -> EnrichmentModes:
    """Enrichment modes with the numbers in a slice; `matrices` of the result are still those on all modes."""
    return replace(
        modes,
        stiffness=modes.stiffness[numbers],
        damping=modes.damping[numbers],
        B=modes.B[numbers],
        outputs=modes.outputs[:, numbers],
    )


#: Lowest eigenvalue of the flexibility of rows, scaled to a unit diagonal, below which the rows are dependent.
INDEPENDENT = 1e-9


#: Least flexibility of a row, over the flexibility C K^+ C^T of the basis at this row; see `with_floor`.
FLOOR = float(np.sqrt(np.finfo(float).eps))
#: Flexibility of a row and value of this row on the basis, each over the largest of all, up to which supports hold it.
HELD = 1e-12


def yielding_rows(model: ReducedModel) -> list[int]:
    """Numbers of the rows at which the body can move or give way somewhere on the path.

    All other rows are held everywhere by the body's supports.  At such a row the contact can give way only on its other
    body.
    """
    s = checked_positions(model)
    G = np.einsum("tmm->tm", model.residual.rows(s)).max(axis=0, initial=0.0)
    C = np.abs(model.rows(s)).max(axis=(0, 2), initial=0.0)
    still = (G <= HELD * G.max(initial=0.0)) & (C <= HELD * C.max(initial=0.0))
    return np.flatnonzero(~still).tolist()


def with_floor(model: ReducedModel) -> ReducedModel:
    """Return the model with more residual flexibility G at rows C whose flexibility G + 1/k is nearly zero somewhere.

    Here k is the stiffness of the row's pad.  G + 1/k is nearly zero if, anywhere on the path, it is less than `FLOOR`
    times the flexibility C K^+ C^T of the model's coordinates.  Then `FLOOR` times this flexibility is added to G on
    the whole path.  If there is no such row, the model is returned unchanged.

    Not to be called for free modes.  They leave out some flexibility everywhere.  On soft supports C K^+ C^T is the
    flexibility of the supports, far more than that of bending.

    A basis of modes with the slider held responds by itself to a force at the held positions, and leaves nothing out
    there.  The stiffness C^T G^-1 C of such a row would drown the body's own stiffness in round-off.  With the floor,
    both round-off and the additional displacement of the row are about 1e-8 of the displacement.
    """
    residual, C = model.residual, model.rows
    of_modes = multiply_tables(C, C, np.linalg.pinv(model.K, rcond=1e-12, hermitian=True))
    s = np.sort(np.concatenate([C.x, checked_positions(model)]))
    G, held = (np.einsum("tmm->tm", table(s)) for table in (residual.rows, of_modes))
    lacking = np.any(G + model.row_compliance < FLOOR * held, axis=0)
    if not lacking.any():
        return model
    floor = PPoly(of_modes.c * np.outer(lacking, lacking), of_modes.x)
    return replace(model, flexibility=replace(residual, rows=add_tables(residual.rows, floor, FLOOR)))


def check_independence(model: ReducedModel, numbers: list[int] | None = None) -> None:
    """Raise an InputError if the forces on some rows are not determined at one of `RANK_CHECKS` path coordinates.

    The forces are not determined if the rows' flexibility G + 1/k, with the residual flexibility G and the stiffnesses
    k of the pads, is not positive definite.  The rows have the given `numbers`; None stands for all rows.  The ends of
    the path are not checked: there a slider may be on a support.
    """
    numbers = list(range(len(model.row_names))) if numbers is None else numbers
    names = [model.row_names[k] for k in numbers]
    for s in checked_positions(model) if numbers else ():
        F = model.residual.rows(s) + np.diag(model.row_compliance)
        dependence = dependence_of_flexibility(F[np.ix_(numbers, numbers)], names)
        if dependence.measure < INDEPENDENT:
            dependent = ", ".join(dependence.names)
            allowed = (
                f"the rows {dependent} depend on each other at s = {s:.4g} m, so their forces are not "
                "determined; sliders, supports and pads that hold different motions are allowed, or a stiffness"
            )
            raise InputError("scene", "", None, allowed)


def checked_positions(model: ReducedModel) -> Array:
    """Path coordinates (RANK_CHECKS,) in m, spread evenly over the domain without its ends."""
    low, high = model.domain
    return low + (high - low) * (np.arange(RANK_CHECKS) + 0.5) / RANK_CHECKS
