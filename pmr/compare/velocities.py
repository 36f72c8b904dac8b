r"""Velocities with the part of the body that follows at once, and the lag that damping makes of its deformation.

.. math::
    \dot y = O \dot p + W \dot f - X \dot z - \dot s X' z, \qquad
    (G + 1/k)\, \dot z = C \dot p + \dot s C' p + H \dot f + \dot s H' f - \dot s G' z

with z the multipliers that deform the residual part (docs/moving_residual_flexibility.md, section 5).

Where s or f has a kink, so do z and the deformation under the slider: their rates jump, as those of a massless part can
and those of a real one can't.  On smooth paths the recovered part makes velocities more accurate, on the paper's
straight ramps less so (section 5 has figures).

Coordinates feel the damping of the residual part through the rows' forces (`Inertia`), outputs are those of
its statics.  With D = beta K its deformation x = R (B f - C^T z) lags behind its forces, and rows that give way share
the rest out anew:

.. math::
    \Delta y = -\beta\,(O \dot x - X \bar G^{-1} C \dot x), \qquad \bar G = G + 1/k

Nothing of it is left of rows that are rigid but the loads' part.  Stresses feel it most, for the residual part has much
of them, and no number of modes takes it away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.constraints.polynomials import apply_table, evaluate
from pmr.reduced.model import ReducedModel
from pmr.simulation.excitation import Excitation, in_order
from pmr.system.body import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rates:
    """Signals over time and their rates, each (T, k)."""

    value: Array
    rate: Array


def load_rates(model: ReducedModel, excitation: Excitation) -> Rates:
    """Loads (T, i) in N and their rates at the steps."""
    t, signals = excitation.times, in_order(excitation.loads, model.input_names)
    rates = np.column_stack([np.empty((len(t), 0)), *(load.rate(t) for load in signals)])
    return Rates(excitation.forces(model.input_names), rates)


def force_rates(model: ReducedModel, trajectory: Trajectory, path_rate: Array, loads: Rates) -> Rates:
    """The forces z (T, m) in N that deform the residual part, and their rates in N/s; `path_rate` (T,) is s' in m/s.

    Raises ValueError if the model has no residual flexibility.
    """
    tables, s = model.flexibility, trajectory.s
    if tables is None:
        raise ValueError("without residual flexibility no force follows from the positions")
    z, ds = trajectory.multipliers, path_rate[:, None]
    right = model.apply_rows(s, trajectory.v) + ds * model.apply_rows(s, trajectory.q, derivative=1)
    right += apply_table(tables.inputs, s, loads.rate) + ds * apply_table(tables.inputs, s, loads.value, 1)
    right -= ds * apply_table(tables.rows, s, z, 1)
    G = evaluate(tables.rows, s) + np.diag(model.row_compliance)
    is_open = ~np.isnan(model.row_clearance) & (z == 0.0)  # no force, and none that changes
    apart = is_open[:, :, None] | is_open[:, None, :]
    G, right = np.where(apart, np.eye(z.shape[1]), G), np.where(is_open, 0.0, right)
    return Rates(z, np.linalg.solve(G, right[:, :, None])[:, :, 0])


def velocity(model: ReducedModel, trajectory: Trajectory, excitation: Excitation) -> Array:
    """Rates of the outputs, (T, o) in m/s, of a trajectory in the model's coordinates, all steps of the excitation."""
    result, tables = trajectory.v @ model.outputs.T, model.flexibility
    if tables is None:
        return np.asarray(result)
    f = load_rates(model, excitation)
    z, ds = force_rates(model, trajectory, excitation.path_rate, f), excitation.path_rate[:, None]
    result += f.rate @ tables.direct.T - apply_table(tables.outputs, trajectory.s, z.rate)
    return np.asarray(result - ds * apply_table(tables.outputs, trajectory.s, z.value, 1))
