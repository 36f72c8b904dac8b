r"""What the enrichment modes of a model say of its coordinates: their share of what is left out, and what reaches them.

.. math::
    \kappa = \frac{\mathrm{rms}_t\, \mathrm{tr} \sum_{j=r+1}^{r+c} (C \varphi_j)(C \varphi_j)^T \omega_j^{-4}}
                  {\mathrm{rms}_t\, \mathrm{tr} A_0(s)}, \qquad
    \chi = \frac{\mathrm{rms}(\eta - \varphi_{r+1}^T g / \omega_{r+1}^2)}{\mathrm{rms}(\eta)}, \quad \eta = p_{r+1}

docs/moving_residual_flexibility.md, sections 10 and 12.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.constraints.polynomials import evaluate
from pmr.reduced.model import ReducedModel
from pmr.system.body import Trajectory

Array = NDArray[np.float64]


def kappa(model: ReducedModel, s: Array) -> float:
    """Share of the residual part's inertia that the enrichment modes carry, at the path coordinates s (T,) m.

    Where the model keeps that inertia, what is neglected is C (R M)^2 R C^T; the modes beyond the enrichment modes are
    taken to be as low as the last of these, which makes kappa a little smaller than it is.
    """
    assert model.enrichment is not None and model.flexibility is not None and model.flexibility.inertia is not None
    squares = np.einsum("tmc,tmc->tc", rows := evaluate(model.enrichment.rows, s), rows)
    stiffness = model.enrichment.stiffness
    part = squares @ stiffness**-2.0
    whole = np.einsum("tmm->t", evaluate(model.flexibility.inertia.A0, s))
    if model.flexibility.keeps_inertia:
        rest = np.maximum(whole - part, 0.0) / stiffness[-1]
        part = squares @ stiffness**-3.0
        whole = part + rest
    return min(1.0, _rms(part) / _rms(whole)) if np.any(whole > 0.0) else 1.0


def chi(body: ReducedModel, run: Trajectory, f: Array, mode: int) -> float:
    """Share of a mode's motion that is not quasi-static, in a run of a body on its modes under loads f (T, i) in N."""
    force = f @ body.B[mode] - np.einsum("tm,tm->t", body.C(run.s)[:, :, mode], run.multipliers)
    motion = _rms(run.q[:, mode])
    return _rms(run.q[:, mode] - force / body.K[mode, mode]) / motion if motion > 0.0 else 0.0


def _rms(x: Array) -> float:
    unit = float(np.abs(x).max(initial=0.0))  # squares of tiny values would vanish
    return unit * float(np.sqrt(np.mean((x / unit) ** 2))) if unit > 0.0 else 0.0
