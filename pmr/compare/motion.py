"""What follows from loads and motion of a system: velocities, loads that attachment modes answer, bounds on round-off.

Velocities have the rates of the residual part, which follows its forces at once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.compare.errors import ROUND_OFF
from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.simulation import Excitation
from pmr.simulation.excitation import signals_in_order
from pmr.simulation.start import dense
from pmr.system.attachment import with_attachment_modes
from pmr.system.body import SlidingBody, Trajectory, force_outputs, length_outputs, other_outputs, released_rows
from pmr.system.carriers import CarrierRows
from pmr.system.polynomials import apply_table, evaluate
from pmr.system.reduced_model import ReducedModel
from pmr.system.rows import Row
from pmr.system.states import SystemTrajectory
from pmr.system.system import System
from pmr.system.truncation import extend, is_modal

#: Stiffness in N/m that makes a held coordinate rigid.
HOLDS = 1e300

#: Largest number of coordinates of a body whose round-off is bounded: this takes a dense matrix.
LARGEST_COMPLIANCE = 500


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
    contacts have the rate 0.  Raises ValueError if the model has no residual flexibility.
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

    The outputs are y, the coordinates p, the loads f, the path coordinate s and the contact forces z.  Under these
    forces the residual part (what the modes leave out) deforms at once.  The rows C(s) have the stiffnesses k, and O is
    the output matrix.  Tables of the residual flexibility are W (`direct`), X(s) (`outputs`), H(s) (`inputs`) and G(s)
    (`rows`).  A prime is the derivative with respect to s (docs/moving_residual_flexibility.md, section 5).  Without
    residual flexibility only :math:`O \dot p` is left.

    At a kink of s or f, z and the deformation under the slider have kinks too: their rates jump, which is possible only
    without mass.  On smooth paths the rates of the residual part make velocities more accurate, on paths of straight
    ramps less so (section 5 has numbers).

    The residual part has damping, too.  It acts on the coordinates through the forces of the rows, but the outputs
    contain only the static deformation x = R (B f - C^T z), with the residual flexibility R.  With damping D = beta K
    this deformation lags behind its forces, and rows that give way share the forces differently.  The outputs leave out

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

    For a body on one path with tables of residual flexibility the rates are `output_rates`.  In all other cases they
    are :math:`O \dot q` plus central differences of y - O q, with the displacements y, the output matrix O and the
    coordinates q.  Such cases are several bodies, attachment modes, and a hoist, whose rope's pulls have no rates.
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
    """Single body of a system, with only the rows of its contacts, and its motion with one coordinate s (T,) in m.

    s is the coordinate of the excitation's path, or the lower end of the body's domain at all times without a path.
    """
    (body,), (motion,) = system.reduced.values(), run.bodies.values()
    rows = [body.row_names.index(contact.inner.row) for contact in system.contacts]
    s = excitation.on_slider.path_within(body.domain) if excitation.paths else np.full(len(run.t), body.domain[0])
    return BodyMotion(body.with_rows(rows), replace(motion, s=s))


Models = Mapping[str, ReducedModel]


def reason_without_estimate(models: Models) -> str | None:
    """Reason, in words, why errors of bodies with these models can't be estimated; None if they can.

    `models` maps names of bodies to models.  The reason is that of the first model that has one, behind its name.
    """
    for name, model in models.items():
        if why := _reason_without_estimate_of(model):
            return f"{name}: {why}" if name else why
    return None


def _reason_without_estimate_of(model: ReducedModel) -> str | None:
    """Reason, in words, why the error of one model can't be estimated; None if it can be."""
    if model.flexibility is None:
        return (
            "without residual flexibility the static deformation of the modes that are left out is missing, and the "
            "model does not say how large it is"
        )
    if not is_modal(model):
        return (
            "the basis is not one of eigenmodes: what it leaves out may have low frequencies and is coupled to the "
            "coordinates by inertia"
        )
    if model.enrichment is None or model.carriers is None or model.carriers.inertia is None:
        return (
            "the model holds no enrichment modes, which the estimate needs: reduction.estimate "
            "= true adds them where the mesh has more modes"
        )
    return None


#: Largest number of steps, evenly spaced among all, whose loads decide on attachment modes.
ANSWERED_STEPS = 20_000


def carried_loads(system: System, run: SystemTrajectory) -> dict[str, sp.csr_matrix]:
    """Forces in a run on the K carriers of each body and loads on its i inputs: sparse (S, K + i) in N, by body.

    The forces are those of the contacts (`carrier_forces`) at S steps of the run, at most `ANSWERED_STEPS`, evenly
    spaced.  All bodies must have carriers.
    """
    forces, steps = {}, np.linspace(0, len(run.t) - 1, min(len(run.t), ANSWERED_STEPS)).astype(int)
    for name, body in system.reduced.items():
        assert body.carriers is not None
        rows = [system.row(side.place) for side in system.sides if side.place.body == name]
        motion, loads = run.bodies[name], run.loads[steps, system.load_columns[name]]
        forces[name] = carrier_forces(body.carriers, rows, motion.s[steps], motion.multipliers[steps], loads)
    return forces


def carrier_forces(
    carriers: CarrierRows, rows: Sequence[Row], x: Array, multipliers: Array, loads: Array
) -> sp.csr_matrix:
    r"""Forces of m rows on the K carriers of a body and, in i further columns, its loads: sparse (T, K + i) in N.

    A row with the multiplier :math:`\lambda` acts on its few carriers with :math:`-b(x) \lambda`, where b are its
    weights on these carriers.  The rows are at the path coordinates x (T, m) in m; their `multipliers` are (T, m) in N,
    and the `loads` (T, i) in N.
    """
    T, K = len(x), len(carriers.values)
    on, shares = [np.broadcast_to(K + np.arange(loads.shape[1]), loads.shape)], [loads]
    for row, at, force in zip(rows, x.T, multipliers.T, strict=True):
        touched, b = row.touched_weights(at, 0)
        on, shares = [*on, touched], [*shares, -b * force[:, None]]
    columns, entries = np.hstack(on), np.hstack(shares)
    ends = columns.shape[1] * np.arange(T + 1)
    forces = sp.csr_matrix((entries.ravel(), columns.ravel(), ends), (T, K + loads.shape[1]))
    forces.sum_duplicates()  # several rows may touch the same carrier
    return forces


#: Share of inertia that attachment modes for load cases at rest may leave out.
LEFT_OUT_AT_REST = 1e-4


def system_with_attachment_modes(system: System, x: Array, forces: Sequence[Array], loads: Sequence[Array]) -> System:
    """Return the system with attachment modes for the contact forces and loads of several load cases at rest.

    The residual flexibility of a model at rest is exact, except that axial forces do not change it.  Attachment modes
    for the loads on the bodies (`pmr.system.attachment`) and enrichment modes have second-order matrices and inertia,
    so they add the effect of axial forces.

    Parameters
    ----------
    system : System
        System of reduced bodies.
    x : (P, sides) array, m
        Path coordinates in P positions; each contact has a side on each body that it joins.
    forces, loads : sequences of arrays, (P, m) and (P, i) in N
        Forces of the m contacts, and loads on the i inputs, with one array for each load case.

    Raises
    ------
    InputError
        If the models lack data that attachment modes need (`reason_without_estimate`).
    """
    models = system.modal
    if why := reason_without_estimate(models):
        allowed = f"models with an estimate of their error are allowed: {why}"
        raise InputError("scene", "reduction.estimate", None, allowed)
    bodies = {}
    for name, model in models.items():
        columns, carriers = system.load_columns[name], model.carriers
        assert carriers is not None  # `reason_without_estimate` has checked this
        on = system.sides_of(name)
        rows = [system.row(system.sides[number].place) for number in on]
        pressing = [
            carrier_forces(carriers, rows, x[:, on], system.side_multipliers(name, of), acting[:, columns])
            for of, acting in zip(forces, loads, strict=True)
        ]
        bodies[name] = with_attachment_modes(extend(model), sp.vstack(pressing, "csr"), LEFT_OUT_AT_REST)
    return system.with_bodies(bodies)


def round_off(bodies: Mapping[str, SlidingBody], loads: Array, end: float) -> float:
    r"""Largest displacement in m that may be nothing but round-off, if loads (T, i) in N act for `end` seconds.

    .. math:: 10^{-11} \max_o \lVert O_o^T \rVert \sum_i \lVert B_i \rVert \max_t |f_i|, \qquad
        \lVert x \rVert^2 = x^T \big(K + (2 \pi / t_e)^2 M\big)^{-1} x

    with the row :math:`O_o` of each displacement output, the column :math:`B_i` of each of the i inputs, its load
    :math:`f_i`, stiffness K, mass M and :math:`t_e` = `end`.

    By the inequality of Cauchy and Schwarz, the product bounds the effect of the loads on an output of the bodies with
    released contacts, in any coordinates.  Round-off is a share of this effect, even if a slider cancels the
    displacement, or if loads along the axis don't bend the body at all.  The result is linear in the loads, so that no
    motion counts as round-off because the loads are small.  The result is 0 if a body has more than
    `LARGEST_COMPLIANCE` coordinates, or if `end` is not positive.
    """
    return float(ROUND_OFF * _largest_motions(bodies, loads, end, length_outputs).max(initial=0.0))


def probe_round_off(bodies: Mapping[str, SlidingBody], loads: Array, end: float) -> Array:
    """Round-off (k,), as in `round_off`, of each of k probes under `loads` for `end` seconds, in its own unit.

    Probes are outputs of the `bodies` that are neither in m nor in N.
    """
    return ROUND_OFF * _largest_motions(bodies, loads, end, other_outputs)


def _largest_motions(
    bodies: Mapping[str, SlidingBody], loads: Array, end: float, select: Callable[[SlidingBody], NDArray[np.bool_]]
) -> Array:
    """Bound (o,) on each of o selected outputs, in its unit, under loads (T, i) in N for `end` seconds.

    `select` returns the mask of the selected outputs of a body.  `loads` are those on the inputs of all `bodies`, in
    their order.  All bounds are 0 if one of the bodies has more than `LARGEST_COMPLIANCE` coordinates, or if `end` is
    not positive.
    """
    sizes, reach, first = list[Array](), 0.0, 0
    for body in bodies.values():
        chosen, last = select(body), first + body.B.shape[1]
        A = _dynamic_stiffness(body, end)
        reach += np.inf if A is None else _load_norm(A, body, loads[:, first:last])
        sizes.append(np.zeros(np.count_nonzero(chosen)) if A is None else _norms(A, dense(body.outputs)[chosen]))
        first = last
    sizes_of_outputs = np.concatenate(sizes)
    return sizes_of_outputs * reach if np.isfinite(reach) else np.zeros_like(sizes_of_outputs)


def force_round_off(body: SlidingBody, loads: Array, end: float, s: float) -> float:
    r"""Largest force in N that may be nothing but round-off in a body under loads (T, i) in N for `end` seconds.

    The force is bounded as in `round_off`, for the outputs that are forces and for the multipliers of the rows that
    move or only push.  With the inputs B and their loads f, the force of a row is at most

    .. math:: \lVert B \rVert |f| / \sqrt{\lVert C^T \rVert^2 + G + 1/k}

    (norms as in `round_off`).  C is the row and G its residual flexibility at the path coordinate s in m, and k is the
    row's stiffness.  `ROUND_OFF` times this bound is the result.  The result is 0 if the body has more than
    `LARGEST_COMPLIANCE` coordinates, or if `end` is not positive.
    """
    if (A := _dynamic_stiffness(body, end)) is None:
        return 0.0
    rows = released_rows(body)
    C = dense(body.C(s))[rows]
    give = _norms(A, C) ** 2 + np.asarray(body.row_compliance)[rows]
    if body.flexibility is not None:
        give = give + np.diag(body.flexibility.rows(s))[rows]
    stiff = 1.0 / np.sqrt(give[give > 0.0])
    forces = _norms(A, dense(body.outputs)[force_outputs(body)])
    return float(ROUND_OFF * np.concatenate([stiff, forces]).max(initial=0.0) * _load_norm(A, body, loads))


def _dynamic_stiffness(body: SlidingBody, end: float) -> Array | None:
    """Matrix K + (2 pi / end)^2 M (n, n) with held coordinates made rigid.

    The result is None if the body has more than `LARGEST_COMPLIANCE` coordinates, or if `end` in s is not positive.
    """
    if body.size > LARGEST_COMPLIANCE or not end > 0.0:
        return None
    stiffness = dense(body.K + (2.0 * np.pi / end) ** 2 * body.M)
    held = list(body.held.values())
    stiffness[held] = stiffness[:, held] = 0.0
    stiffness[held, held] = HOLDS
    return stiffness


def _norms(A: Array, rows: Array) -> Array:
    """Norms sqrt(x A^-1 x^T) (r,) of the rows x of `rows` (r, n), with the symmetric matrix A (n, n)."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("rn,nr->r", rows, np.linalg.solve(A, rows.T)), 0.0)))


def _load_norm(A: Array, body: SlidingBody, loads: Array) -> float:
    """Sum over the inputs of the largest absolute value of `loads` (T, i) times the norm of the input's column of B.

    The norm is that of `_norms` with the matrix A.
    """
    return float(_norms(A, np.asarray(body.B).T) @ np.abs(loads).max(axis=0, initial=0.0))
