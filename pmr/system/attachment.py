r"""Responses to given loads as coordinates: residual attachment modes of a body whose rows are on carriers.

Let R be the flexibility that the modes Phi of a model with the stiffness K and the mass M leave out.  Loads G on
carriers and inputs have the static response X = R G.  As coordinates, these responses have inertia too.  Since R K R =
R, the relations

.. math::
    X^T K X = G^T R G, \qquad X^T M X = G^T (R M R)\, G, \qquad X^T M \Phi = X^T K \Phi = 0

follow from R and R M R between the carriers.  What is then left out is R - X (X^T K X)^{-1} X^T.  So the inertia of the
residual part in the directions of known loads needs no full model.  Craig and Chang: On the use of attachment modes in
substructure coupling for dynamic analysis, AIAA paper 77-405, 1977.

The force of a cylinder, with the row c, oscillates if an extension has kinks.  So it has modes of its own in every
simulation of a boom, made from the responses

.. math:: x_1 = R c^T, \qquad x_{k+1} = R M x_k

(Ritz vectors: Wilson, Yuan, Dickens: Dynamic analysis by direct superposition of Ritz vectors, Earthquake Engineering
and Structural Dynamics 10, 1982).  They have the section's frequencies and damping along the boom.  Residual
flexibility has neither inertia nor damping: a section would oscillate on it for ever.  The residual flexibility that is
left besides these modes does not give way to a cylinder's force.

Modes without inertia follow loads at once.  They are needed for terms that vary in time and act on the residual part.

The flexibility R that a basis leaves out responds to contacts and loads, but not to the forces of terms, which depend
on the motion of every point.  With geometric stiffness these forces bend the residual part: a rigid motion of a section
that is inclined and compressed causes bending.  So the first residual modes are coordinates of the model whose inertia
simulators leave out,

.. math::
    2 \zeta \omega\, \dot\eta + \omega^2 \eta + \sum_k c_k\, \varphi^T A_k\, q = \varphi^T (B f - C^T \lambda)

with the coordinate :math:`\eta` of a mode :math:`\varphi`, its frequency :math:`\omega` and damping ratio
:math:`\zeta`, and the matrices :math:`A_k` and amplitudes :math:`c_k` of the terms.  They follow the forces on them at
once, as R does, and have the damping that R lacks.  To first order in c, in the space of these modes, R becomes
:math:`R_A = R - c\, R A R` and the basis V becomes :math:`V_A = V - c\, R A V`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from pmr.files.arrays import Array
from pmr.system.body_matrices import DAMPING, Reactions, pivoted_cholesky, symmetric_part
from pmr.system.carriers import CarrierFlexibility, CylinderResponses, EnrichmentModes
from pmr.system.reduced_model import ReducedModel
from pmr.system.truncation import extend

#: Share of the inertia of all responses that may be left out, and largest number of attachment modes.
LEFT_OUT, MOST = 1e-8, 128
#: Share of the loads below which responses are round-off, as of a load and the equal force of a slider at one point.
CANCELLED = 1e-11
#: Number of cylinder modes in a model, and in the richer model by which its error is estimated.
CYLINDER, RICHER = 2, 3
#: Eigenvalue of the scaled inertia up to which a direction is a combination of the others.
DEPENDENT = 1e-9


def with_cylinder_modes(model: ReducedModel) -> ReducedModel:
    """Return the model with `CYLINDER` modes of its cylinder as its last coordinates.

    A model without a cylinder is returned unchanged.  If the responses to the cylinder's force have no inertia, no
    modes are added, and the residual flexibility under this force, which is only round-off, is set to zero.
    """
    carriers, count = model.carriers, CYLINDER
    if carriers is None or carriers.answers is None:
        return model
    answers = carriers.answers
    if not answers.inertia.any():
        return _clear_cylinder_flexibility(model, answers)
    turned, stiffness = _diagonalise(answers.stiffness[:count, :count], answers.inertia[:count, :count])
    measured = np.vstack([answers.rows[:, :count], answers.inputs[:, :count]]) @ turned
    with_modes = _append_vectors(model, stiffness, measured, answers.outputs[:, :count] @ turned)
    assert with_modes.carriers is not None
    reactions = None
    if model.reactions is not None:
        reactions = _extend_reactions(model, _cylinder_inertia(model, model.reactions, answers)[:, :count] @ turned)
    on_modes = replace(with_modes.carriers, answers=replace(answers, turned=turned))
    loads = np.zeros((len(answers.rows) + len(answers.inputs), turned.shape[1]))
    return _extend_frame_matrices(replace(with_modes, carriers=on_modes, reactions=reactions), model, loads, turned)


def has_frame_matrices(model: ReducedModel) -> bool:
    """Whether attachment modes can be added to a model without a loss of its matrices of a frame and of second order.

    This is so if the model has these matrices on vectors that span the attachment modes, or if it has no such matrices.
    """
    carriers = model.carriers
    if carriers is None or not carriers.matrices:
        return not model.matrices
    return len(carriers.spanned) > 0


def _extend_frame_matrices(
    extended_model: ReducedModel, model: ReducedModel, loads: Array, combinations: Array
) -> ReducedModel:
    """Return `extended_model` with matrices of a moving frame, ports and reactions on all of its r + a coordinates.

    `model` has r coordinates.  `extended_model` has the same coordinates, and `a` further ones after them.  Each
    further coordinate is a response to `loads` (K + i, a) on K carriers and i inputs, plus `combinations` (k, a) of the
    first k responses to the cylinder's force.

    The damping matrix D is extended, too, if `model` has D on all vectors.  `loads` are ignored if the carriers have no
    vectors that span responses to loads (`CarrierRows.spanned` is empty).  If the carriers have no `matrices`,
    `extended_model` is returned unchanged.
    """
    carriers, modes, r, (count, a) = model.carriers, model.enrichment, model.size, combinations.shape
    assert carriers is not None
    if not carriers.matrices:
        return extended_model
    answers, K = carriers.answers, len(carriers.values)
    n, c = 0 if answers is None else answers.rows.shape[1], 0 if modes is None else modes.count
    size, p = len(next(iter(carriers.matrices.values()))), len(carriers.spanned)
    row_loads, X = loads if p else np.zeros_like(loads), np.zeros((size, r + a))
    X[:r, :r], X[size - n : size - n + count, r:] = np.eye(r), combinations
    if modes is not None:  # the responses `answers` contain the enrichment modes
        on_modes = (carriers.enrichment.T @ row_loads[:K] + modes.B @ row_loads[K:]) / modes.stiffness[:, None]
        shares = 0.0 if answers is None else answers.mode_shares(carriers.enrichment, modes)[:, :count] @ combinations
        X[r : r + c, r:] = on_modes + shares
    if p:
        X[r + c : r + c + p, r:] = carriers.spanned @ loads
    matrices = {name: X.T @ A @ X for name, A in carriers.matrices.items()}
    ports = {name: row @ X for name, row in carriers.ports.items()}
    reactions = extended_model.reactions
    if reactions is not None:  # reactions in files of earlier versions are not known on these vectors
        worked = {name: A @ X[: A.shape[1]] for name, A in reactions.matrices.items()}
        reactions = replace(reactions, matrices=worked, damping=worked.get(DAMPING, reactions.damping))
    return replace(
        extended_model,
        D=symmetric_part(matrices[DAMPING]) if DAMPING in matrices else extended_model.D,
        matrices={**extended_model.matrices, **matrices},
        ports={**extended_model.ports, **ports},
        reactions=reactions,
    )


def _cylinder_inertia(model: ReducedModel, reactions: Reactions, answers: CylinderResponses) -> Array:
    """Work (h, n) of the inertia of the n `answers` to the cylinder's force on the motions of h rigid supports.

    `reactions` are those of the `model`.
    """
    assert model.carriers is not None
    if model.enrichment is None:
        return answers.supports
    joined = reactions.inertia[:, model.size : model.size + model.enrichment.count]
    return answers.supports + joined @ answers.mode_shares(model.carriers.enrichment, model.enrichment)


def _residual_inertia(model: ReducedModel, reactions: Reactions, of_largest: Array) -> Array:
    """Work (h, K + i) on the motions of h supports, by the inertia of responses to unit loads.

    The unit loads are those on K carriers, then on i inputs.  `of_largest` (h, K + i) is this work if all modes of the
    largest basis are coordinates.  The enrichment modes of the `model` are no coordinates, so their responses are added
    here.  `reactions` are those of the `model`.
    """
    modes = model.enrichment
    if modes is None or model.carriers is None:
        return of_largest
    joined = reactions.inertia[:, model.size : model.size + modes.count]
    return of_largest + joined / modes.stiffness @ np.hstack([model.carriers.enrichment.T, modes.B])


def _extend_reactions(model: ReducedModel, inertia: Array) -> Reactions:
    """Reactions of a model with `a` further coordinates at the end, which no support moves.

    `model` is the model without these coordinates.  `inertia` (h, a) is the work of their inertia on the motions of the
    h supports.
    """
    reactions, r = model.reactions, model.size
    assert reactions is not None
    damping = (0.0 if model.rayleigh is None else model.rayleigh.alpha) * inertia
    return replace(
        reactions,
        inertia=np.hstack([reactions.inertia[:, :r], inertia]),
        damping=np.hstack([reactions.damping[:, :r], damping]),
        stiffness=np.hstack([reactions.stiffness[:, :r], np.zeros_like(inertia)]),
    )


def with_attachment_modes(
    model: ReducedModel, loads: Array | sp.csr_matrix, left_out: float = LEFT_OUT
) -> ReducedModel:
    """Return the model with principal responses to loads (T, K + i) in N, on K carriers and i inputs, as coordinates.

    The principal responses are those with the most inertia, at most `MOST`, that together have all but a share
    `left_out` of the inertia of all responses.  If the section has a cylinder, `RICHER` modes of the cylinder are
    included, and the result has no enrichment modes.

    If nothing moves the residual part, no modes are added and the model is returned unchanged.  A model with a cylinder
    then loses its residual flexibility under the cylinder's force, as in `with_cylinder_modes`.

    The result has no reactions of rigid supports if the model lacks ``carriers.support_inertia``, as models of earlier
    versions do.  A ValueError is raised if the model lacks flexibility or inertia of its residual part on carriers.
    """
    carriers = model.carriers
    if carriers is None or carriers.flexibility is None or carriers.inertia is None:
        raise ValueError("attachment modes need flexibility and inertia on carriers, as section_model gives them")
    R, S, answers = _load_matrix(carriers.flexibility), _load_matrix(carriers.inertia), carriers.answers
    G = _principal_loads(S, sp.csr_matrix(loads), left_out)
    measured, inertia_measured = R @ G, S @ G  # values of the responses, and of the responses to their inertia
    outputs = np.hstack([carriers.flexibility.outputs, carriers.flexibility.direct]) @ G
    K, M = G.T @ measured, G.T @ inertia_measured
    if answers is not None and answers.inertia.any():
        x, n = np.vstack([answers.rows, answers.inputs]), RICHER
        K = np.block([[K, G.T @ x[:, :n]], [x[:, :n].T @ G, answers.stiffness[:n, :n]]])
        M = np.block([[M, G.T @ x[:, 1 : n + 1]], [x[:, 1 : n + 1].T @ G, answers.inertia[:n, :n]]])
        measured, outputs = np.hstack([measured, x[:, :n]]), np.hstack([outputs, answers.outputs[:, :n]])
    turned, stiffness = _diagonalise(K, M)
    if not len(stiffness):
        return model if answers is None else _clear_cylinder_flexibility(model, answers)
    with_modes, g = _append_vectors(model, stiffness, measured @ turned, outputs @ turned), G.shape[1]
    if model.reactions is not None and carriers.support_inertia is not None:
        inertia = _residual_inertia(model, model.reactions, carriers.support_inertia) @ G @ turned[:g]
        if len(turned) > g and answers is not None:
            inertia += _cylinder_inertia(model, model.reactions, answers)[:, : len(turned) - g] @ turned[g:]
        with_modes = replace(with_modes, reactions=_extend_reactions(model, inertia))
    return _extend_frame_matrices(with_modes, model, G @ turned[:g], turned[g:])


class _DiagonalForm(NamedTuple):
    """Combinations X (k, a) with X^T M X = I and X^T K X = diag(omega^2), and omega^2 (a,) in (rad/s)^2, ascending."""

    combinations: Array
    stiffness: Array


def _diagonalise(K: Array, M: Array) -> _DiagonalForm:
    """Combinations of k vectors that are M-orthonormal and have a diagonal stiffness.

    K and M (k, k) are the stiffness and the mass of the vectors.  Directions without stiffness or inertia are left out:
    such directions are round-off in a model that has nearly all modes of its mesh.
    """
    count = len(K)
    sound = np.flatnonzero((np.diagonal(K) > 0.0) & (np.diagonal(M) > 0.0))
    K, M = (A[np.ix_(sound, sound)] for A in (K, M))
    scale = 1.0 / np.sqrt(np.diagonal(M))
    size, Q = np.linalg.eigh(scale[:, None] * M * scale)
    is_independent = size > DEPENDENT
    apart = scale[:, None] * Q[:, is_independent] / np.sqrt(size[is_independent])
    stiffness, turned = np.linalg.eigh(apart.T @ K @ apart)
    stiff = stiffness > 0.0
    X = np.zeros((count, int(np.count_nonzero(stiff))))
    X[sound] = apart @ turned[:, stiff]
    return _DiagonalForm(X, stiffness[stiff])


def _append_vectors(model: ReducedModel, stiffness: Array, measures: Array, outputs: Array) -> ReducedModel:
    """Return the model with M-orthonormal vectors as further coordinates at the end, out of its residual flexibility.

    The vectors have the stiffnesses omega^2 `stiffness` (a,), and the outputs `outputs` (o, a).  Their values on K
    carriers and at i inputs are `measures` (K + i, a).  The result has no enrichment modes and no reactions, and its
    carriers have neither `inertia` nor `answers`.
    """
    carriers = model.carriers
    assert carriers is not None
    K = len(carriers.values)
    modes = EnrichmentModes(
        stiffness=stiffness,
        damping=np.zeros_like(stiffness) if model.rayleigh is None else model.rayleigh.modal_damping(stiffness),
        B=measures[K:].T,
        outputs=outputs,
    )
    on_modes = replace(carriers, enrichment=measures[:K], inertia=None, answers=None)
    without = replace(model, enrichment=modes, carriers=on_modes, reactions=None)  # which lack the new coordinates
    with_modes = extend(without)
    return with_modes if carriers.answers is None else _clear_cylinder_flexibility(with_modes, carriers.answers)


def _clear_cylinder_flexibility(model: ReducedModel, answers: CylinderResponses) -> ReducedModel:
    """Return the model without the residual flexibility under the cylinder's force, which is only round-off.

    Only to be called for a model whose coordinates contain the responses `answers` to this force.
    """
    carriers, load = model.carriers, answers.load
    assert carriers is not None and carriers.flexibility is not None

    def rigid(A: Array) -> Array:
        return A - np.outer(load, load @ A) / (load @ load)

    flexibility = carriers.flexibility
    residual = replace(
        flexibility,
        rows=symmetric_part(rigid(rigid(flexibility.rows).T)),
        inputs=rigid(flexibility.inputs),
        outputs=rigid(flexibility.outputs.T).T,
    )
    return model.with_carriers(replace(carriers, flexibility=residual))


def _load_matrix(part: CarrierFlexibility) -> Array:
    """Matrix (K + i, K + i) of R, or of R M R, between K carriers and i inputs, joined from the arrays of `part`."""
    return np.block([[part.rows, part.inputs], [part.inputs.T, part.energy]])


def _principal_loads(S: Array, loads: sp.csr_matrix, left_out: float) -> Array:
    """Combinations G (K + i, k) of loads on K carriers and i inputs, whose responses have the most inertia.

    `loads` (T, K + i) are T loads.  S (K + i, K + i) is the inertia of the residual responses to unit loads, and G^T S
    G = I.  Combinations with the most inertia come first.  Enough of them are returned to leave out at most a share
    `left_out` of the inertia, but not more than `MOST`.  Loads whose responses are round-off are not used.
    """
    mass = np.trace(S)
    half = pivoted_cholesky(S)  # on a coarse mesh S has a low rank
    gathered = loads.T @ (loads @ half)  # squares of the loads would lose small sums of large loads
    energy, V = np.linalg.eigh(half.T @ gathered)
    energy, V = energy[::-1], V[:, ::-1]
    energy_so_far = np.cumsum(np.maximum(energy, 0.0))
    enough = 1 + int(np.searchsorted(energy_so_far, (1.0 - left_out) * np.max(energy_so_far, initial=0.0)))
    some = energy > CANCELLED**2 * mass * loads.power(2).sum()
    chosen = slice(min(MOST, enough, int(np.count_nonzero(some))))
    return np.asarray(gathered @ V[:, chosen] / energy[chosen])


#: Number of modes without inertia of each body: its first bending mode in each plane (docs/moving_frame_theory.md).
QUASI_STATIC = 2


def simulated_model(model: ReducedModel, stressed: bool) -> ReducedModel:
    """Return the model with the modes of its cylinder as coordinates, as simulations need them.

    If the model is `stressed` by terms that vary in time, modes without inertia are added too.
    """
    return with_cylinder_modes(with_quasi_static_modes(model) if stressed else model)


def with_quasi_static_modes(model: ReducedModel, count: int = QUASI_STATIC) -> ReducedModel:
    """Return the model with up to `count` of its first enrichment modes as last coordinates, marked as without inertia.

    A model without enrichment modes, or without residual flexibility, is returned unchanged.
    """
    if model.enrichment is None or model.flexibility is None:
        return model
    with_modes = extend(model, min(count, model.enrichment.count))
    return replace(with_modes, quasi_static=np.arange(model.size, with_modes.size))
