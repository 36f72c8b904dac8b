r"""Whether a motion reaches the first mode that a model leaves out.

.. math::
    \chi = \frac{\mathrm{rms}(\eta - \varphi_{r+1}^T g / \omega_{r+1}^2)}{\mathrm{rms}(\eta)}, \quad \eta = p_{r+1}

docs/moving_residual_flexibility.md, sections 10 and 12.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.compare.errors import ROUND_OFF
from pmr.constraints.polynomials import columns, evaluate
from pmr.reduced.model import ReducedModel
from pmr.system.body import Trajectory

Array = NDArray[np.float64]


def chi(body: ReducedModel, run: Trajectory, f: Array, mode: int) -> float:
    """Share of a mode's motion that is not quasi-static, in a run of a body on its modes under loads f (T, i) in N.

    It is 0 where the mode stands still but for round-off, as torsion does under loads in a plane of symmetry.
    """
    force = f @ body.B[mode] - np.einsum(
        "tm,tm->t", evaluate(columns(body.rows, [mode]), run.s)[:, :, 0], run.multipliers
    )
    motion, most = _rms(run.q[:, mode]), float(np.abs(run.q).max(initial=0.0))
    return _rms(run.q[:, mode] - force / body.K[mode, mode]) / motion if motion > ROUND_OFF * most else 0.0


def _rms(x: Array) -> float:
    unit = float(np.abs(x).max(initial=0.0))  # squares of tiny values would vanish
    return unit * float(np.sqrt(np.mean((x / unit) ** 2))) if unit > 0.0 else 0.0
