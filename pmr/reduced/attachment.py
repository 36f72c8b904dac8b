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
from pmr.reduced.enrichment import EnrichmentModes
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extended

Array = NDArray[np.float64]

#: Share of the strain energy of all loads below which a direction among them is left out, and most directions.
LEAST, MOST = 1e-8, 12


def with_attachment_modes(model: ReducedModel, loads: Array) -> ReducedModel:
    """The model with the principal answers to loads (T, K + i) in N, on its carriers and inputs, as coordinates.

    Raises
    ------
    ValueError
        If the model does not know the flexibility and inertia of what it leaves out on its carriers.
    """
    carriers = model.carriers
    if carriers is None or carriers.flexibility is None or carriers.inertia is None:
        raise ValueError("attachment modes need flexibility and inertia on carriers, as section_model gives them")
    R, K = _on_loads(carriers.flexibility), len(carriers.values)
    G = _principal(R, loads)
    mass, turned = np.linalg.eigh(G.T @ _on_loads(carriers.inertia) @ G)
    G, stiffness = (G @ (turned / np.sqrt(mass)))[:, ::-1], 1.0 / mass[::-1]
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
    return extended(replace(model, enrichment=modes, carriers=replace(carriers, enrichment=measured[:K], inertia=None)))


def _on_loads(part: CarrierFlexibility) -> Array:
    """Between carriers and inputs, (K + i, K + i)."""
    return np.block([[part.rows, part.inputs], [part.inputs.T, part.energy]])


def _principal(R: Array, loads: Array) -> Array:
    """Combinations G (K + i, k) of the loads with G^T R G = I, those that store the most energy first."""
    stiff, Q = np.linalg.eigh(R)
    half = Q * np.sqrt(np.maximum(stiff, 0.0))
    gathered = loads.T @ (loads @ half)
    energy, V = np.linalg.eigh(half.T @ gathered)
    chosen = np.flatnonzero(energy > LEAST * energy[-1])[::-1][:MOST]
    return np.asarray(gathered @ V[:, chosen] / energy[chosen])
