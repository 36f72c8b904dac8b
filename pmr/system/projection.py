r"""Galerkin projection of a body that one process holds.

.. math::
    V^T M V, \quad V^T D V, \quad V^T K V, \quad V^T B, \quad O V, \quad C(s) V

The distributed full model's is `pmr.reduction.galerkin`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.reduced.model import ReducedModel
from pmr.reduced.soundness import symmetric
from pmr.system.body import SlidingBody

Array = NDArray[np.float64]


def projected(body: SlidingBody, V: Array) -> ReducedModel:
    """The body on the columns of V (n, r), with every one of its rows and the flexibility that it may have."""
    M, D, K = (symmetric(V.T @ (A @ V)) for A in (body.M, body.D, body.K))
    clearance = body.row_clearance
    return ReducedModel(
        M=M,
        D=D,
        K=K,
        B=np.asarray(V.T @ body.B),
        outputs=np.asarray(body.outputs @ V),
        rows=body.rows_on(V),
        input_names=body.input_names,
        row_names=body.row_names,
        output_positions=body.output_positions,
        output_names=body.output_names,
        output_units=body.output_units,
        output_kinds=body.output_kinds,
        pads=body.row_compliance if body.row_compliance.any() else None,
        flexibility=body.flexibility,
        clearance=None if np.isnan(clearance).all() else clearance,
        rayleigh=body.rayleigh,
        reactions=None if body.reactions is None else body.reactions.on(V),
        section=body.section,
    )
