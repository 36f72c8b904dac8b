"""The compiled simulator of any system: generalized-alpha in the modal coordinates of each body.

The bodies' M, K and D never change, so each body is diagonalised once; only the multipliers of the m contacts couple
the bodies, by one m x m solve in each step (`pmr.kernel`, docs/system_of_bodies.md).  A body may be reduced or of full
order, up to some thousand coordinates: the same loop is the reference for the error of a reduction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np
import scipy.sparse as sp

from pmr.files.arrays import Array, Indices
from pmr.simulation.excitation import Excitation
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.form import start_of as start_of
from pmr.simulation.native.form import static_start as static_start
from pmr.simulation.native.march import March, Steps
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import Progress, Recorder, SimulationEnd
from pmr.system.polynomials import apply_table, select_columns, select_rows
from pmr.system.states import SystemTrajectory
from pmr.system.system import System


@dataclass(frozen=True)
class Observation:
    """Selected outputs and contact forces of a simulation, at T recorded steps."""

    t: Array  # (T,) s
    y: Array  # (T, o) m
    multipliers: Array  # (T, m) N
    seconds: float  # wall time of solver and outputs


def simulate(
    system: System,
    excitation: Excitation,
    initial: Mapping[str, InitialState] | None = None,
    progress: Progress | None = None,
    every: int = 1,
) -> SystemTrajectory:
    """Simulate all bodies from t = 0 on, and return the trajectory of each `every`-th step.

    Arguments and errors as `pmr.simulation.SystemSimulator`; without `initial` bodies start at rest.  `progress`, if
    not None, is called with the share of the run that is done.  The trajectory's `seconds` are the wall time of the
    steps in modal coordinates, without diagonalisation and transformation to q.
    """
    return simulate_form(SystemForm.of(system), excitation, initial or {}, progress, every)


def simulate_form(
    form: SystemForm,
    excitation: Excitation,
    initial: Mapping[str, InitialState] | None = None,
    progress: Progress | None = None,
    every: int = 1,
) -> SystemTrajectory:
    """Simulate a system in modal form, and record every `every`-th step; simulations can share the kernel of `form`.

    If `initial` is None, the simulation starts as ``excitation.start`` says.  Otherwise as `simulate`.
    """
    recorder = Recorder(np.arange(0, excitation.stepping.steps + 1, every))
    return recorder.trajectory(follow(March(form, excitation, initial), recorder, progress))


def follow(
    march: March, take: Callable[[int, SystemTrajectory], None], progress: Progress | None = None
) -> SimulationEnd:
    """Take all steps of `march`, some thousand at a time; nothing is stored.

    `take` is called with the number of the first of consecutive steps, which is the last one of the call before or the
    start, and with their trajectory, whose arrays are valid until the next call.  If contacts only push, a step may be
    divided (`pmr.simulation.contact_step`); the trajectory holds the states at the ends of steps.  Errors as
    `pmr.simulation.SystemSimulator`; the error of a growing motion is raised at the end.
    """
    return march.run(lambda first, steps: take(first, _trajectory(march, first, steps)), progress)


def _trajectory(march: March, first: int, steps: Steps, every: int = 1, modal: bool = False) -> SystemTrajectory:
    """Trajectory of recorded `steps`, each `every`-th one of `march`; `first` is the number of the first record.

    The coordinates are those of the bodies, or the kernel's if `modal`.
    """
    form, P, i = march.form, march.form.kernel.paths, march.form.kernel.inputs
    to_original = form.combined.original_forces
    rows = slice(first * every, (first + len(steps.z) - 1) * every + 1, every)
    states = {
        name: (z, v) if modal else (z @ form.forms[name].X.T, v @ form.forms[name].X.T)
        for name, at in form.columns.items()
        for z, v in [(steps.z[:, at], steps.v[:, at])]
    }
    return SystemTrajectory.from_states(
        form.system,
        march.t[rows],
        states,
        march.x[rows],
        to_original(steps.multipliers),
        None if steps.peaks is None else to_original(steps.peaks),
        steps.energy.T,
        steps.friction,
        loads=steps.drivers[:, P : P + i],
        seconds=0.0,
        surplus=np.nan,
        parts=np.ones(len(steps.z), np.int64) if steps.parts is None else steps.parts.astype(np.int64),
        impulses=None if steps.impulses is None else to_original(steps.impulses),
        amplitudes=steps.drivers[:, P + i : P + i + len(form.system.terms)] if form.system.terms else None,
        rates=march.excitation.rates[rows],
        hoist=steps.hoist,
    )


def observe(
    form: SystemForm, excitation: Excitation, outputs: Sequence[int] | None = None, every: int = 1
) -> Observation:
    """Simulate `form` from the excitation's start; record outputs and contact forces of each `every`-th step alone.

    `outputs` are ascending indices among the outputs of all bodies, one body after the other; None records all.  A long
    simulation of a large body needs little memory, as no coordinates are stored.  The energy balance of `simulate` is
    not checked: rigid rows that move may grow unnoticed with rho_inf near 1 (docs/time_integration.md).  Errors as
    `pmr.simulation.SystemSimulator`.
    """
    march, count = March(form, excitation), excitation.stepping.steps // every + 1
    y = np.empty((count, len(form.system.output_names if outputs is None else outputs)))
    forces, evaluated = np.empty((count, len(form.system.contacts))), 0.0

    def record_outputs(first: int, steps: Steps) -> None:
        """Compute and store outputs and contact forces of the records `steps`, from the record number `first` on."""
        nonlocal evaluated
        begun, rows = perf_counter(), slice(first, first + len(steps.z))
        part = _trajectory(march, first, steps, every, modal=True)
        y[rows], forces[rows] = np.hstack([*displacements(form.in_modes, part, outputs).values()]), part.forces
        evaluated += perf_counter() - begun

    seconds = march.observe(every, record_outputs)
    return Observation(march.t[::every], y, forces, seconds + evaluated)


def displacements(
    system: System, trajectory: SystemTrajectory, outputs: Sequence[int] | None = None
) -> dict[str, Array]:
    """Outputs O q + W f - X lambda (T, o) of each body by name, with the effect of the moments of friction.

    `trajectory` has a body's coordinates q, its loads f and the contact forces lambda on the body.  `outputs` are
    ascending indices among the outputs of all bodies, one body after the other; None returns all.
    """
    outputs_of_bodies, first = {}, 0
    for name, chosen in outputs_by_body(system, outputs).items():
        body, motion = system.bodies[name], trajectory.bodies[name]
        last = first + len(body.input_names)
        turned = None if trajectory.moments is None else system.side_multipliers(name, trajectory.moments)
        loads = trajectory.loads[:, first:last]
        deformed = deformation(system, name, motion.s, motion.multipliers, loads, chosen, turned)
        O = body.outputs[chosen]
        from_modes = np.asarray((O @ motion.q.T).T) if sp.issparse(O) else motion.q @ O.T
        outputs_of_bodies[name], first = from_modes if deformed is None else from_modes + deformed, last
    return outputs_of_bodies


def outputs_by_body(system: System, outputs: Sequence[int] | None) -> dict[str, Indices | slice]:
    """Indices (k,) of the chosen `outputs` among the outputs of each body alone, or a slice, by the body's name.

    `outputs` are ascending indices among the outputs of all bodies, one body after the other; None selects all.
    """
    ends = np.cumsum([0, *(body.outputs.shape[0] for body in system.bodies.values())])
    if outputs is None:
        return dict.fromkeys(system.bodies, slice(None))
    split = np.split(np.asarray(outputs, np.int64), np.searchsorted(outputs, ends[1:-1]))
    return {name: numbers - first for name, numbers, first in zip(system.bodies, split, ends, strict=False)}


def deformation(
    system: System,
    name: str,
    x: Array,
    multipliers: Array,
    loads: Array,
    chosen: Indices | slice = slice(None),
    moments: Array | None = None,
) -> Array | None:
    """Outputs W f - X lambda (T, o) by one body's residual flexibility, under loads f and contact forces lambda.

    None is returned if the body has no residual flexibility.

    Parameters
    ----------
    name : str
        Name of the body.
    x : (T, sides) array, m
        Positions of the contact sides on the body.
    multipliers : (T, sides) array, N
        Contact forces on these sides.
    loads : (T, i) array
        Loads on the body.
    chosen : (o,) array of int, or slice
        Numbers of outputs.
    moments : (T, sides) array, N m, optional
        Moments of friction at the sides (`pmr.system.contacts`); they add X' times the moments to the outputs, with the
        derivative X' of X by the position.
    """
    body = system.bodies[name]
    points = [side.place for side in system.sides if side.place.body == name]
    if system.on_one_path:  # all rows are at the position of the one that moves
        if body.flexibility is None:
            return None
        rows, moving = (
            [body.row_names.index(place.row) for place in points],
            [place.path is not None for place in points],
        )
        X = select_rows(select_columns(body.flexibility.outputs, rows), chosen)
        s = x[:, moving.index(True)] if any(moving) else np.full(len(x), body.domain[0])
        return np.asarray(loads @ body.flexibility.direct[chosen].T - apply_table(X, s, multipliers))
    residual = None if body.carriers is None else body.carriers.flexibility
    if residual is None:
        return None
    direct, X = np.asarray(loads @ residual.direct[chosen].T), residual.outputs.T[:, chosen]
    if not X.shape[1]:
        return direct
    shares, touched = list[Array](), list[Indices]()
    for derivative, acting in ((0, multipliers), *([] if moments is None else [(1, -moments)])):
        staying = np.zeros((len(points), X.shape[1]))
        for k, (place, at) in enumerate(zip(points, x.T, strict=True)):
            stays = bool((at == at[0]).all())
            on, weights = system.row(place).touched_weights(at[:1] if stays else at, derivative)
            if stays:
                staying[k] = weights[0] @ X[on[0]]
            else:
                shares.append(weights * acting[:, k, None])
                touched.append(on)
        direct -= acting @ staying
    return direct - _weighted_sum(np.hstack(shares), np.hstack(touched), X) if shares else direct


def _weighted_sum(weights: Array, touched: Indices, X: Array) -> Array:
    """Sums (T, o) over d of the rows of X (K, o) with indices `touched` (T, d), times `weights` (T, d)."""
    ends = np.arange(len(weights) + 1) * weights.shape[1]
    return np.asarray(sp.csr_matrix((weights.ravel(), touched.ravel(), ends), (len(weights), len(X))) @ X)
