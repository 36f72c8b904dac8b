"""The compiled simulator of any system: generalized-alpha in the modal coordinates of each body.

The bodies' M, K and D never change, so each body is diagonalised once; only the multipliers of the m contacts couple
the bodies, by one m x m solve in each step (`pmr.kernel`, docs/system_of_bodies.md).  A body may be reduced or of full
order, up to some thousand coordinates: the same loop is the reference for the error of a reduction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from pmr.simulation.stepping import Block, Progress, Recorder, SimulationEnd, Take
from pmr.system.body import Trajectory
from pmr.system.contacts import Friction
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

    Arguments and errors as `pmr.simulation.SystemSimulator`; without `initial` bodies start at rest.  The trajectory's
    `seconds` are the wall time of the steps in modal coordinates, without diagonalisation and transformation to q.
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


def follow(march: March, take: Take, progress: Progress | None = None) -> SimulationEnd:
    """Take all steps of `march`, and call `take` with a block of some thousand steps at a time; nothing is stored.

    If contacts only push, a step may be divided (`pmr.simulation.contact_step`); a block holds the states at the ends
    of steps.  Errors as `pmr.simulation.SystemSimulator`; the error of a growing motion is raised at the end.
    """
    form, excitation, system = march.form, march.excitation, march.form.system
    rubbing = Friction.from_contacts(system.contacts)
    pushing, P, i = ~np.isnan(system.clearance), form.kernel.paths, form.kernel.inputs

    def hand_over(first: int, steps: Steps) -> None:
        """Pass `steps` to `take` as a block that makes trajectories on request.

        `first` is the number of the first of these steps.
        """
        count = len(steps.z)

        def trajectory_at(rows: Indices | slice) -> SystemTrajectory:
            """Trajectory of rows of the block."""
            some, chosen = steps.at(rows), np.arange(first, first + count)[rows]
            numbers = slice(first, first + count) if len(chosen) == count else chosen
            f, motions, pressed, energy = some.friction, {}, some.multipliers, some.energy
            t, forces, moments, x = march.t[numbers], pressed, None, march.x[numbers].T
            if rubbing is not None and f is not None:
                forces = pressed + rubbing.cylinder_forces(f)
                moments, energy = rubbing.moments(f, forces), energy + rubbing.stored_energy(f, forces)[:, None]
            for name, modal in form.forms.items():
                q, v = (motion[:, form.columns[name]] @ modal.X.T for motion in (some.z, some.v))
                sides = system.sides_of(name)
                motions[name] = Trajectory(t, q, v, system.side_multipliers(name, pressed), x[sides].T, seconds=0.0)
            return SystemTrajectory(
                t=t,
                bodies=motions,
                forces=forces,
                peaks=forces if some.peaks is None else np.where(pushing, some.peaks, forces),
                loads=some.drivers[:, P : P + i],
                energy=energy[:, 0],
                work=energy[:, 1],
                seconds=0.0,
                surplus=np.nan,
                parts=np.ones(len(t), np.int64) if some.parts is None else some.parts.astype(np.int64),
                impulses=None if some.impulses is None else some.impulses,
                amplitudes=some.drivers[:, P + i : P + i + len(system.terms)] if system.terms else None,
                friction=f,
                moments=moments,
                rates=excitation.rates[numbers],
                hoist=some.hoist,
            )

        take(Block(first, count, trajectory_at, whole=count == len(march.t)))

    return march.run(hand_over, progress)


def observe(
    form: SystemForm, excitation: Excitation, outputs: Sequence[int] | None = None, every: int = 1
) -> Observation:
    """Simulate from the excitation's start, and record the outputs and contact forces of each `every`-th step alone.

    `outputs` are ascending indices among the outputs of all bodies, one body after the other; None records all.  A long
    simulation of a large body needs little memory, as no coordinates are stored.  The energy balance of `simulate` is
    not checked: rigid rows that move may grow unnoticed with rho_inf near 1 (docs/time_integration.md).  Errors as
    `pmr.simulation.SystemSimulator`.
    """
    march, system = March(form, excitation), form.system
    count, chosen = excitation.stepping.steps // every + 1, outputs_by_body(system, outputs)
    sizes = {name: len(np.arange(system.bodies[name].outputs.shape[0])[which]) for name, which in chosen.items()}
    y, forces, evaluated = np.empty((count, sum(sizes.values()))), np.empty((count, len(system.contacts))), 0.0
    rubbing, P = Friction.from_contacts(system.contacts), form.kernel.paths

    def record_outputs(first: int, steps: Steps) -> None:
        """Compute and store outputs and contact forces of the records `steps`, from the record number `first` on."""
        nonlocal evaluated
        begun, rows = perf_counter(), slice(first, first + len(steps.z))
        numbers, column, load = np.arange(rows.start, rows.stop) * every, 0, P
        forces[rows] = form.forces(steps.multipliers, steps.friction)
        pressed, f = steps.multipliers, steps.friction
        moments = None if rubbing is None or f is None else rubbing.moments(f, pressed)
        for name, which in chosen.items():
            inputs = slice(load, load + len(system.bodies[name].input_names))
            x, acting = march.x[numbers][:, system.sides_of(name)], steps.drivers[:, inputs]
            turned = None if moments is None else system.side_multipliers(name, moments)
            deformed = deformation(system, name, x, system.side_multipliers(name, pressed), acting, which, turned)
            columns = slice(column, column + sizes[name])
            y[rows, columns] = steps.z[:, form.columns[name]] @ form.forms[name].body.outputs[which].T
            if deformed is not None:
                y[rows, columns] += deformed
            column, load = columns.stop, inputs.stop
        evaluated += perf_counter() - begun

    seconds = march.observe(every, record_outputs)
    return Observation(march.t[::every], y, forces, seconds + evaluated)


def displacements(
    system: System, trajectory: SystemTrajectory, outputs: Sequence[int] | None = None
) -> dict[str, Array]:
    """Outputs O q + W f - X lambda (T, o) of each body by name, with the effect of the moments of friction.

    q are a body's coordinates, f its loads, lambda the contact forces on it.  `outputs` are ascending indices among the
    outputs of all bodies, one body after the other; None returns all.
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
    """By body's name, the indices of `outputs` among the outputs of this body alone.

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
