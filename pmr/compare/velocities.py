"""Velocities of outputs, with the rates of the residual part, which follows its forces at once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pmr.files.arrays import Array
from pmr.simulation import Excitation
from pmr.simulation.excitation import signals_in_order
from pmr.simulation.start import dense
from pmr.system.body import SlidingBody, Trajectory, length_outputs
from pmr.system.polynomials import apply_table, evaluate
from pmr.system.reduced_model import ReducedModel
from pmr.system.states import SystemTrajectory
from pmr.system.system import System


@dataclass(frozen=True)
class Rates:
    """Values of k signals at T times, and their rates, each (T, k)."""

    value: Array
    rate: Array


def load_rates(model: ReducedModel, excitation: Excitation) -> Rates:
    """Loads (T, i) in N at all steps and their rates (T, i) in N/s, in the order of the model's inputs."""
    t, signals = excitation.times, signals_in_order(excitation.loads, model.input_names)
    rates = np.column_stack([np.empty((len(t), 0)), *(load.rate(t) for load in signals)])
    return Rates(excitation.forces(model.input_names), rates)


def force_rates(model: ReducedModel, trajectory: Trajectory, path_rate: Array, loads: Rates) -> Rates:
    """Contact forces z (T, m) in N of a trajectory, and their rates (T, m) in N/s by the equations of `output_rates`.

    `path_rate` (T,) is the rate of the path coordinate in m/s, and `loads` are the loads (T, i) with their rates.  Open
    contacts have the rate 0.  Raises ValueError if the model has no residual
    flexibility.
    """
    tables, s = model.flexibility, trajectory.s
    if tables is None:
        raise ValueError("without residual flexibility no force follows from the positions")
    z, ds = trajectory.multipliers, path_rate[:, None]
    right = model.apply_rows(s, trajectory.v) + ds * model.apply_rows(s, trajectory.q, derivative=1)
    right += apply_table(tables.inputs, s, loads.rate) + ds * apply_table(tables.inputs, s, loads.value, 1)
    right -= ds * apply_table(tables.rows, s, z, 1)
    G = evaluate(tables.rows, s) + np.diag(model.row_compliance)
    is_open = ~np.isnan(model.row_clearance) & (z == 0.0)  # force and rate are zero
    apart = is_open[:, :, None] | is_open[:, None, :]
    G, right = np.where(apart, np.eye(z.shape[1]), G), np.where(is_open, 0.0, right)
    return Rates(z, np.linalg.solve(G, right[:, :, None])[:, :, 0])


def output_rates(model: ReducedModel, trajectory: Trajectory, excitation: Excitation) -> Array:
    r"""Rates (T, o) of a model's outputs in m/s, for a trajectory of its coordinates at all steps of the excitation.

    .. math::
        \dot y = O \dot p + W \dot f - X \dot z - \dot s X' z, \qquad
        (G + 1/k)\, \dot z = C \dot p + \dot s C' p + H \dot f + \dot s H' f - \dot s G' z

    The outputs are y, the coordinates p, the loads f, the path coordinate s, and z are the contact forces, under which
    the residual part (what the modes leave out) deforms at once.  The rows C(s) have the stiffnesses k, and O is the
    output matrix.  Tables of the residual flexibility are W (`direct`), X(s) (`outputs`), H(s) (`inputs`) and G(s)
    (`rows`).  A prime is the derivative with respect to s (docs/moving_residual_flexibility.md, section 5).  Without
    residual flexibility only :math:`O \dot p` is left.

    At a kink of s or f, z and the deformation under the slider have kinks too: their rates jump, which is possible only
    without mass.  On smooth paths the rates of the residual part make velocities more accurate, on paths of straight
    ramps less so (section 5 has numbers).

    The damping of the residual part acts on the coordinates through the forces of the rows, but the outputs contain
    only the static deformation of the residual part.  With damping D = beta K the deformation x = R (B f - C^T z), with
    the residual flexibility R, lags behind its forces, and the forces are shared differently between rows that give
    way.  The outputs leave out

    .. math::
        \Delta y = -\beta\,(O \dot x - X \bar G^{-1} C \dot x), \qquad \bar G = G + 1/k

    With rigid rows, only the part of this difference that comes from the loads is not zero.  Stresses are affected
    most, since the residual part has a large share in them; more modes do not remove the difference.
    """
    result, tables = trajectory.v @ model.outputs.T, model.flexibility
    if tables is None:
        return np.asarray(result)
    f = load_rates(model, excitation)
    z, ds = force_rates(model, trajectory, excitation.path_rate, f), excitation.path_rate[:, None]
    result += f.rate @ tables.direct.T - apply_table(tables.outputs, trajectory.s, z.rate)
    return np.asarray(result - ds * apply_table(tables.outputs, trajectory.s, z.value, 1))


def displacement_rates(system: System, run: SystemTrajectory, excitation: Excitation, displacement: Array) -> Array:
    r"""Rates (T, o) in m/s of the displacements `displacement` (T, o) in m, at all steps of the excitation.

    For a body on one path with tables of residual flexibility they are `output_rates`.  In all other cases (several
    bodies, attachment modes, or a hoist, whose rope's pulls have no rates) they are :math:`O \dot q` plus central
    differences of y - O q, with the displacements y, the output matrix O and the coordinates q.
    """
    tables = not system.hoist and all(map(_has_rate_tables, system.bodies.values()))
    if system.on_one_path and tables:
        body, motion = only_body_motion(system, run, excitation)
        return output_rates(body, motion, excitation.on_slider)[:, length_outputs(body)]
    rates, first = list[Array](), 0
    for name, model in system.bodies.items():
        O, trajectory = dense(model.outputs)[length_outputs(model)], run.bodies[name]
        last = first + len(O)
        residual = displacement[:, first:last] - trajectory.q @ O.T
        rates.append(trajectory.v @ O.T + np.gradient(residual, run.t, axis=0))
        first = last
    return np.hstack(rates)


def _has_rate_tables(body: SlidingBody) -> bool:
    """Whether rates of a body's outputs follow from tables: the body has flexibility and no attachment modes."""
    attached = body.carriers is not None and getattr(body.carriers, "inertia", None) is None
    return body.flexibility is not None and not attached


class BodyMotion(NamedTuple):
    """A single body with the rows of its contacts, and its motion."""

    body: ReducedModel
    motion: Trajectory


def only_body_motion(system: System, run: SystemTrajectory, excitation: Excitation) -> BodyMotion:
    """Single body of a system, with the rows of its contacts, and its motion with one path coordinate s (T,) in m."""
    (body,), (motion,) = system.reduced.values(), run.bodies.values()
    rows = [body.row_names.index(contact.inner.row) for contact in system.contacts]
    s = excitation.on_slider.path_within(body.domain) if excitation.paths else np.full(len(run.t), body.domain[0])
    return BodyMotion(body.with_rows(rows), replace(motion, s=s))
