r"""What damping makes of the residual part's own deformation, which outputs of reduced models leave out.

Coordinates feel the damping of the residual part through the rows' forces (`pmr.reduced.inertia`), outputs are those of
its statics.  With D = beta K its deformation x = R (B f - C^T z) lags behind its forces, and rows that give way share
the rest out anew:

.. math::
    \Delta y = -\beta\,(O \dot x - X \bar G^{-1} C \dot x), \qquad \bar G = G + 1/k

Nothing of it is left of rows that are rigid but the loads' part.  Stresses feel it most, for the residual part has much
of them, and no number of modes takes it away.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.compare.velocities import force_rates, load_rates, velocity
from pmr.constraints.polynomials import evaluate
from pmr.reduced.model import ReducedModel
from pmr.simulate import Excitation
from pmr.system.body import Trajectory

Array = NDArray[np.float64]


def lag(model: ReducedModel, trajectory: Trajectory, excitation: Excitation) -> Array:
    """Of the outputs (T, o) of a model with residual flexibility and its inertia's tables; zero without such damping.

    Trajectory and excitation as for `pmr.compare.velocities.velocity`.  What is in proportion to mass is left out.
    """
    tables, known, s = model.flexibility, model.rayleigh, trajectory.s
    if known is None or known.beta == 0.0 or tables is None or tables.inertia is None:
        return np.zeros((len(s), len(model.outputs)))
    f, path_rate = load_rates(model, excitation), excitation.path_rate
    z, G = force_rates(model, trajectory, path_rate, f), evaluate(tables.rows, s)
    turned = (evaluate(tables.inertia.D1, s) - known.alpha * evaluate(tables.inertia.A1, s)) / known.beta  # C R C'^T
    of_rows = np.einsum("tmi,ti->tm", evaluate(tables.inputs, s), f.rate) - np.einsum("tmn,tn->tm", G, z.rate)
    of_rows -= path_rate[:, None] * np.einsum("tmn,tn->tm", turned, z.value)
    carried = np.linalg.solve(G + np.diag(model.row_compliance), of_rows[:, :, None])[:, :, 0]
    own = velocity(model, trajectory, excitation) - trajectory.v @ model.outputs.T
    return np.asarray(-known.beta * (own - np.einsum("tom,tm->to", evaluate(tables.outputs, s), carried)))
