r"""What answers to given loads as coordinates: residual attachment modes of a body whose rows are on carriers.

The part that its modes leave out answers loads G on carriers and inputs by X = R G, at rest.  As coordinates, X has
inertia too, and since R K R = R

.. math::
    X^T K X = G^T R G, \qquad X^T M X = G^T (R M R)\, G, \qquad X^T M \Phi = X^T K \Phi = 0

are known from what the carriers tell of R and R M R; what is then left out is R - X (X^T K X)^{-1} X^T.  So it takes no
full model to have the inertia of the residual part in the directions of loads that are known.  Craig and Chang: On the
use of attachment modes in substructure coupling for dynamic analysis, AIAA paper 77-405, 1977.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmr.constraints.polynomials import stacked
from pmr.reduced.carriers import CarrierFlexibility
from pmr.reduced.flexibility import EnrichmentModes
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extended

Array = NDArray[np.float64]

#: Share of the inertia of all answers that directions among the loads may leave out, and most directions.
LEFT_OUT, MOST = 1e-5, 64


def with_attachment_modes(model: ReducedModel, loads: Array) -> ReducedModel:
    """The model with the principal answers to loads (T, K + i) in N, on its carriers and inputs, as coordinates.

    They are those with the most inertia: at rest nothing is missing.  Without loads, and where none moves what is left
    out, the model stays as it is.

    A ValueError is raised where it does not know flexibility and inertia of what it leaves out on its carriers.
    """
    carriers = model.carriers
    if carriers is None or carriers.flexibility is None or carriers.inertia is None:
        raise ValueError("attachment modes need flexibility and inertia on carriers, as section_model gives them")
    R, K = _on_loads(carriers.flexibility), len(carriers.values)
    G = _principal(_on_loads(carriers.inertia), loads)
    if not G.shape[1]:
        return model
    stiffness, turned = np.linalg.eigh(G.T @ R @ G)
    G = G @ turned
    measured = R @ G
    on_rows = replace(carriers, values=measured[:K])
    rows = [on_rows.row(k, name).project(np.eye(len(stiffness))) for k, name in enumerate(model.row_names)]
    modes = EnrichmentModes(
        stiffness=stiffness,
        damping=np.zeros_like(stiffness) if model.rayleigh is None else model.rayleigh.modal(stiffness),
        B=measured[K:].T,
        outputs=np.hstack([carriers.flexibility.outputs, carriers.flexibility.direct]) @ G,
        rows=stacked(rows, model.domain),
    )
    on_modes = replace(carriers, enrichment=measured[:K], inertia=None)
    return extended(replace(model, enrichment=modes, carriers=on_modes, reactions=None))  # which know nothing of them


def _on_loads(part: CarrierFlexibility) -> Array:
    """Between carriers and inputs, (K + i, K + i)."""
    return np.block([[part.rows, part.inputs], [part.inputs.T, part.energy]])


def _principal(S: Array, loads: Array) -> Array:
    """Combinations G (K + i, k) of the loads with G^T S G = I, those whose answers have the most inertia first."""
    mass, Q = np.linalg.eigh(S)
    half = Q * np.sqrt(np.maximum(mass, 0.0))
    gathered = loads.T @ (loads @ half)
    energy, V = np.linalg.eigh(half.T @ gathered)
    energy, V = energy[::-1], V[:, ::-1]
    known = np.cumsum(np.maximum(energy, 0.0))
    enough = 1 + int(np.searchsorted(known, (1.0 - LEFT_OUT) * known[-1]))
    chosen = slice(min(MOST, enough, int(np.count_nonzero(energy > 0.0))))
    return np.asarray(gathered @ V[:, chosen] / energy[chosen])
