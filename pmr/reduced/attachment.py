r"""What answers to given loads as coordinates: residual attachment modes of a body whose rows are on carriers.

The part that its modes leave out answers loads G on carriers and inputs by X = R G, at rest.  As coordinates, X has
inertia too, and since R K R = R

.. math::
    X^T K X = G^T R G, \qquad X^T M X = G^T (R M R)\, G, \qquad X^T M \Phi = X^T K \Phi = 0

are known from what the carriers tell of R and R M R; what is then left out is R - X (X^T K X)^{-1} X^T.  So it takes no
full model to have the inertia of the residual part in the directions of loads that are known.  Craig and Chang: On the
use of attachment modes in substructure coupling for dynamic analysis, AIAA paper 77-405, 1977.

The force c of a cylinder, which an extension with kinks makes ring, has modes of its own in every run of a boom:

.. math:: x_1 = R c^T, \qquad x_{k+1} = R M x_k

(Ritz vectors: Wilson, Yuan, Dickens: Dynamic analysis by direct superposition of Ritz vectors, Earthquake Engineering
and Structural Dynamics 10, 1982).  They have the section's frequencies and damping along the boom.  Residual
flexibility has neither inertia nor damping: a section would ring on it for ever.  What they leave out gives way to no
cylinder.

Modes without inertia, which follow loads at once: for terms that vary in time and act on what a basis leaves out.

The flexibility R that a basis leaves out answers contacts and loads, not the forces of terms, which it would have to
know of each motion.  With geometric stiffness these bend it: rigid motions of a section that is inclined and pressed
come with a bending of their own.  So its first modes stay with the model as coordinates whose inertia simulators leave
out,

.. math::
    2 \zeta \omega\, \dot\eta + \omega^2 \eta + \sum_k c_k\, \varphi^T A_k\, q = \varphi^T (B f - C^T \lambda)

which are determined by what presses on them, as R is, and have the damping that R has not.  To first order in c that is
:math:`R_A = R - c\, R A R` in place of R and :math:`V_A = V - c\, R A V` in place of V, in the space of these modes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.constraints.polynomials import stack_tables
from pmr.reduced.carriers import Answers, CarrierFlexibility, EnrichmentModes
from pmr.reduced.matrices import Reactions
from pmr.reduced.model import ReducedModel
from pmr.reduced.soundness import pivoted_root, symmetric
from pmr.reduced.truncation import extend, with_tables

Array = NDArray[np.float64]

#: Share of the inertia of all answers that directions among the loads may leave out, and most directions.
LEFT_OUT, MOST = 1e-8, 128
#: Share of loads below which their answers are round-off: of loads that cancel, as one that a slider takes at once.
CANCELLED = 1e-11
#: Modes of a cylinder in a model, and in the richer one by which its error is estimated.
CYLINDER, RICHER = 2, 3
#: Inertia of a direction beside the others of unit inertia below which it is a combination of these.
DEPENDENT = 1e-9


def with_cylinder_modes(model: ReducedModel) -> ReducedModel:
    """The model with modes of its cylinder as coordinates, its last ones; as it is where it has no cylinder."""
    carriers, count = model.carriers, CYLINDER
    if carriers is None or carriers.answers is None:
        return model
    answers = carriers.answers
    if not answers.inertia.any():
        return _rigid_along(model, answers)
    turned, stiffness = _diagonalise(answers.stiffness[:count, :count], answers.inertia[:count, :count])
    measured = np.vstack([answers.rows[:, :count], answers.inputs[:, :count]]) @ turned
    with_modes = _append_vectors(model, stiffness, measured, answers.outputs[:, :count] @ turned)
    assert with_modes.carriers is not None
    reactions = None if model.reactions is None else _extend_reactions(model, model.reactions, answers, turned)
    on_modes = replace(with_modes.carriers, answers=replace(answers, turned=turned))
    loads = np.zeros((len(answers.rows) + len(answers.inputs), turned.shape[1]))
    return _in_a_frame(replace(with_modes, carriers=on_modes, reactions=reactions), model, loads, turned)


def knows_matrices(model: ReducedModel) -> bool:
    """Whether the matrices of a moving frame and of second order are known on attachment modes."""
    carriers = model.carriers
    if carriers is None or not carriers.matrices:
        return not model.matrices
    return len(carriers.spanned) > 0


def _in_a_frame(extended_model: ReducedModel, model: ReducedModel, loads: Array, turned: Array) -> ReducedModel:
    """The extended model with the matrices and ports of a `model` that has `a` coordinates less, as far as known.

    Those are answers to combinations `loads` (K + i, a) of loads on carriers and inputs, and combinations `turned`
    (k, a) of the first that answer the cylinder.
    """
    carriers, modes, r, (count, a) = model.carriers, model.enrichment, model.size, turned.shape
    assert carriers is not None
    if not carriers.matrices:
        return extended_model
    answers, K = carriers.answers, len(carriers.values)
    n, c = 0 if answers is None else answers.rows.shape[1], 0 if modes is None else modes.count
    size, p = len(next(iter(carriers.matrices.values()))), len(carriers.spanned)
    row_loads, X = loads if p else np.zeros_like(loads), np.zeros((size, r + a))
    X[:r, :r], X[size - n : size - n + count, r:] = np.eye(r), turned
    if modes is not None:  # which have joined the answers
        on_modes = (carriers.enrichment.T @ row_loads[:K] + modes.B @ row_loads[K:]) / modes.stiffness[:, None]
        shares = 0.0 if answers is None else answers.shares(carriers.enrichment, modes)[:, :count] @ turned
        X[r : r + c, r:] = on_modes + shares
    if p:
        X[r + c : r + c + p, r:] = carriers.spanned @ loads
    matrices = {name: X.T @ A @ X for name, A in carriers.matrices.items()}
    ports = {name: row @ X for name, row in carriers.ports.items()}
    reactions = extended_model.reactions
    if reactions is not None:  # of files of earlier versions the work on these vectors is not known
        worked = {name: A @ X[: A.shape[1]] for name, A in reactions.matrices.items()}
        reactions = replace(reactions, matrices=worked)
    return replace(
        extended_model,
        matrices={**extended_model.matrices, **matrices},
        ports={**extended_model.ports, **ports},
        reactions=reactions,
    )


def _extend_reactions(model: ReducedModel, reactions: Reactions, answers: Answers, turned: Array) -> Reactions:
    """Reactions of the model with combinations of the answers as its last coordinates."""
    assert model.carriers is not None
    r, count, of_all = model.size, len(turned), answers.supports
    if model.enrichment is not None:  # the modes that the largest basis has beside the model's
        joined = reactions.inertia[:, r : r + model.enrichment.count]
        of_all = of_all + joined @ answers.shares(model.carriers.enrichment, model.enrichment)
    inertia = of_all[:, :count] @ turned
    damping = (0.0 if model.rayleigh is None else model.rayleigh.alpha) * inertia
    return replace(
        reactions,
        inertia=np.hstack([reactions.inertia[:, :r], inertia]),
        damping=np.hstack([reactions.damping[:, :r], damping]),
        stiffness=np.hstack([reactions.stiffness[:, :r], np.zeros_like(inertia)]),
    )


def with_attachment_modes(
    model: ReducedModel, loads: Array | sp.csr_matrix, left_out: float = LEFT_OUT, at_rest: bool = False
) -> ReducedModel:
    """The model with the principal answers to loads (T, K + i) in N, on its carriers and inputs, as coordinates.

    They are those with the most inertia, all but a share `left_out` of it: at rest nothing is missing.  Where there is
    a cylinder, `RICHER` modes of it are among them.  Without either, and where none moves what is left out, the model
    stays as it is.  With `at_rest` it knows the forces of its rigid supports, of no motion else.

    A ValueError is raised where it does not know flexibility and inertia of what it leaves out on its carriers.
    """
    carriers = model.carriers
    if carriers is None or carriers.flexibility is None or carriers.inertia is None:
        raise ValueError("attachment modes need flexibility and inertia on carriers, as section_model gives them")
    R, S, answers = _on_loads(carriers.flexibility), _on_loads(carriers.inertia), carriers.answers
    G = _principal(S, sp.csr_matrix(loads), left_out)
    measured, inertia_measured = R @ G, S @ G  # of the answers, and of what their inertia moves
    outputs = np.hstack([carriers.flexibility.outputs, carriers.flexibility.direct]) @ G
    K, M = G.T @ measured, G.T @ inertia_measured
    if answers is not None and answers.inertia.any():
        x, n = np.vstack([answers.rows, answers.inputs]), RICHER
        K = np.block([[K, G.T @ x[:, :n]], [x[:, :n].T @ G, answers.stiffness[:n, :n]]])
        M = np.block([[M, G.T @ x[:, 1 : n + 1]], [x[:, 1 : n + 1].T @ G, answers.inertia[:n, :n]]])
        measured, outputs = np.hstack([measured, x[:, :n]]), np.hstack([outputs, answers.outputs[:, :n]])
    turned, stiffness = _diagonalise(K, M)
    if not len(stiffness):
        return model if answers is None else _rigid_along(model, answers)
    with_modes, g = _append_vectors(model, stiffness, measured @ turned, outputs @ turned), G.shape[1]
    if at_rest and model.reactions is not None:  # where forces do not depend on which inertia supports bear
        reactions, none = model.reactions, np.zeros((len(model.reactions.names), len(stiffness)))
        inertia, damping, stiff = (
            np.hstack([part[:, : model.size], none])
            for part in (reactions.inertia, reactions.damping, reactions.stiffness)
        )
        with_modes = replace(
            with_modes, reactions=replace(reactions, inertia=inertia, damping=damping, stiffness=stiff)
        )
    return _in_a_frame(with_modes, model, G @ turned[:g], turned[g:])


def _diagonalise(K: Array, M: Array) -> tuple[Array, Array]:
    """Combinations X (k, a) with X^T M X = I and X^T K X = diag(omega^2), and omega^2 (a,).

    Directions without stiffness or inertia are round-off, of a model that has nearly all modes of its mesh.
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
    return X, stiffness[stiff]


def _append_vectors(model: ReducedModel, stiffness: Array, measured: Array, outputs: Array) -> ReducedModel:
    """Add M-orthonormal vectors that measure so much on carriers and inputs (K + i, a) and outputs (o, a)."""
    carriers = model.carriers
    assert carriers is not None
    K = len(carriers.values)
    on_rows = replace(carriers, values=measured[:K])
    rows = [on_rows.row(k, name).project(np.eye(len(stiffness))) for k, name in enumerate(model.row_names)]
    modes = EnrichmentModes(
        stiffness=stiffness,
        damping=np.zeros_like(stiffness) if model.rayleigh is None else model.rayleigh.modal(stiffness),
        B=measured[K:].T,
        outputs=outputs,
        rows=stack_tables(rows, model.domain),
    )
    on_modes = replace(carriers, enrichment=measured[:K], inertia=None, answers=None)
    with_modes = extend(
        replace(model, enrichment=modes, carriers=on_modes, reactions=None)
    )  # which know nothing of them
    return with_modes if carriers.answers is None else _rigid_along(with_modes, carriers.answers)


def _rigid_along(model: ReducedModel, answers: Answers) -> ReducedModel:
    """Remove round-off of residual flexibility under a cylinder whose answers are coordinates."""
    carriers, load = model.carriers, answers.load
    assert carriers is not None and carriers.flexibility is not None

    def rigid(A: Array) -> Array:
        return A - np.outer(load, load @ A) / (load @ load)

    flexibility = carriers.flexibility
    residual = replace(
        flexibility,
        rows=symmetric(rigid(rigid(flexibility.rows).T)),
        inputs=rigid(flexibility.inputs),
        outputs=rigid(flexibility.outputs.T).T,
    )
    return with_tables(replace(model, carriers=replace(carriers, flexibility=residual)))


def _on_loads(part: CarrierFlexibility) -> Array:
    """Between carriers and inputs, (K + i, K + i)."""
    return np.block([[part.rows, part.inputs], [part.inputs.T, part.energy]])


def _principal(S: Array, loads: sp.csr_matrix, left_out: float) -> Array:
    """Combinations G (K + i, k) of the loads with G^T S G = I, those whose answers have the most inertia first."""
    mass = np.trace(S)
    half = pivoted_root(S)  # on a coarse mesh S has a low rank
    gathered = loads.T @ (loads @ half)  # not by squares of the loads, which would lose what cancels
    energy, V = np.linalg.eigh(half.T @ gathered)
    energy, V = energy[::-1], V[:, ::-1]
    energy_so_far = np.cumsum(np.maximum(energy, 0.0))
    enough = 1 + int(np.searchsorted(energy_so_far, (1.0 - left_out) * np.max(energy_so_far, initial=0.0)))
    some = energy > CANCELLED**2 * mass * loads.power(2).sum()
    chosen = slice(min(MOST, enough, int(np.count_nonzero(some))))
    return np.asarray(gathered @ V[:, chosen] / energy[chosen])


#: Modes of each body: its first bending either way (docs/moving_frame.md has what more of them give).
QUASI_STATIC = 2


def as_simulated(model: ReducedModel, stressed: bool) -> ReducedModel:
    """A model on its modes with those of its cylinder and, where terms act on it, with modes without inertia."""
    return with_cylinder_modes(with_quasi_static_modes(model) if stressed else model)


def with_quasi_static_modes(model: ReducedModel, count: int = QUASI_STATIC) -> ReducedModel:
    """Make up to `count` of a model's first enrichment modes coordinates without inertia, behind its own."""
    if model.enrichment is None or model.flexibility is None:
        return model
    with_modes = extend(model, min(count, model.enrichment.count))
    return replace(with_modes, quasi_static=np.arange(model.size, with_modes.size))
