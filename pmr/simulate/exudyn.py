"""Exudyn as a simulator, and sliding bodies in Exudyn systems of one's own.

In an mbs of one's own::

    items = add_sliding_body(mbs, ReducedModel.load("reduced.npz"), path, loads)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import exudyn as exu
import numpy as np
import scipy.sparse as sp
from exudyn.itemInterface import SensorNode, SensorObject

from pmr.body import SlidingBody, Trajectory
from pmr.signals import SignalBase
from pmr.simulate.exudyn_bodies import add_called_body, add_kept_body, add_updated_body
from pmr.simulate.exudyn_items import SlidingBodyItems, add_pre_step_function
from pmr.simulate.exudyn_solver import settings, solve, stored
from pmr.simulate.inputs import Inputs, SignalInputs, TabulatedInputs
from pmr.simulate.start import InitialState, consistent_start
from pmr.simulate.stepping import Loads, Progress, TimeStepping, path_at
from pmr.yielding import Yielding

__all__ = [
    "SlidingBodyItems",
    "add_pre_step_function",
    "add_sliding_body",
    "add_sliding_body_with_callbacks",
    "add_sliding_body_with_multipliers",
    "simulate",
    "simulate_with_callbacks",
    "simulate_with_callbacks_and_modified_newton",
    "simulate_with_multipliers",
]


AddItems = Callable[[Any, SlidingBody, Inputs, InitialState], SlidingBodyItems]


def add_sliding_body(
    mbs: Any,
    body: SlidingBody,
    path: SignalBase,
    loads: Loads,
    initial: InitialState | None = None,
) -> SlidingBodyItems:
    """Add a sliding body whose rows and loads are set once a step.

    Rows that give way, at a pad or by the residual flexibility of a reduced model, become springs that travel with the
    slider: stiffness and force vector are set once a step, and there is no constraint (`pmr.yielding`, which also
    recovers their multipliers).

    Exudyn calls the pre-step function with the time at the *end* of the step, where its generalized-alpha
    (Arnold and Bruels 2007) fulfils both equations: setting C(s) and B f once a step is exact, and no Python
    is called within it.  The time integration must start at t = 0; before solving the same mbs a second time,
    call ``update(mbs, 0.0)``.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        A pre-step function that is already set stays in place and is called first.  Setting one later with
        ``mbs.SetPreStepUserFunction`` would replace the update: use `add_pre_step_function`.
    body, path, loads, initial
        As for `pmr.simulate.Simulator`.  A velocity that violates the rows is corrected M-orthogonally.

    Raises
    ------
    InputError
        If a load is missing, a size is wrong, the path begins off the body or the initial position violates the rows.
    """
    return add_updated_body(mbs, body, SignalInputs(body, path, loads), _start(body, path, initial))


def add_sliding_body_with_multipliers(
    mbs: Any,
    body: SlidingBody,
    path: SignalBase,
    loads: Loads,
    initial: InitialState | None = None,
) -> SlidingBodyItems:
    """Add a sliding body that keeps a constraint and its multiplier for rows that give way too.

    The same trajectory as `add_sliding_body` at a higher cost, for comparison, or where other connectors are to see
    the multiplier: the output variable Force of ``oSlider``.  Arguments and errors are the same.
    """
    return add_kept_body(mbs, body, SignalInputs(body, path, loads), _start(body, path, initial))


def add_sliding_body_with_callbacks(
    mbs: Any,
    body: SlidingBody,
    path: SignalBase,
    loads: Loads,
    initial: InitialState | None = None,
) -> SlidingBodyItems:
    """Add a sliding body as the paper does: Exudyn calls Python for rows, their Jacobian and loads.

    The same trajectory as `add_sliding_body` at ten times its cost, for comparison.  Arguments and errors are
    the same; bodies with rows that give way are refused.
    """
    return add_called_body(mbs, body, SignalInputs(body, path, loads), _start(body, path, initial))


def simulate(
    body: SlidingBody,
    path: SignalBase,
    loads: Loads,
    stepping: TimeStepping,
    initial: InitialState | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Simulate a reduced (dense) or full (sparse) body; rows and loads are set once a step.

    Rows that give way, at a pad or by a residual flexibility, are no constraints but springs that travel with the
    slider (`pmr.yielding`); of a sparse body they keep their multiplier.

    Arguments and errors as for `pmr.simulate.Simulator`.  The initial accelerations are Exudyn's, which leave
    out what moving rows add to them (2 s' C' v and more): exact where the slider starts at rest, or the body
    undeformed and still; the method stays of second order elsewhere.
    """
    inputs = TabulatedInputs(body, path, loads, stepping)
    return _simulate(add_updated_body, body, inputs, path, stepping, initial, progress)


def simulate_with_multipliers(
    body: SlidingBody,
    path: SignalBase,
    loads: Loads,
    stepping: TimeStepping,
    initial: InitialState | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Simulate with a constraint and its multiplier also for rows that give way.

    Arguments, errors and trajectory as for `simulate`; for comparison.
    """
    inputs = TabulatedInputs(body, path, loads, stepping)
    return _simulate(add_kept_body, body, inputs, path, stepping, initial, progress)


def simulate_with_callbacks(
    body: SlidingBody,
    path: SignalBase,
    loads: Loads,
    stepping: TimeStepping,
    initial: InitialState | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Simulate as the paper does: Exudyn calls Python for rows, their Jacobian and loads in every iteration.

    Arguments, errors and trajectory as for `simulate`; for comparison.  Rows that give way are refused.
    """
    inputs = TabulatedInputs(body, path, loads, stepping)
    return _simulate(add_called_body, body, inputs, path, stepping, initial, progress)


def simulate_with_callbacks_and_modified_newton(
    body: SlidingBody,
    path: SignalBase,
    loads: Loads,
    stepping: TimeStepping,
    initial: InitialState | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """As `simulate_with_callbacks`, but a Jacobian is kept as long as Newton's method converges with it.

    That saves a large dense body most of its factorisations, all of them while the slider rests.  Arguments, errors
    and trajectory, to Newton's tolerance, as for `simulate`.
    """
    inputs = TabulatedInputs(body, path, loads, stepping)
    return _simulate(add_called_body, body, inputs, path, stepping, initial, progress, _modified_newton)


def _newton(chosen: Any) -> None:
    """A new Jacobian in each iteration, as `settings` has it."""


def _modified_newton(chosen: Any) -> None:
    chosen.timeIntegration.newton.useModifiedNewton = True


def _simulate(
    add_items: AddItems,
    body: SlidingBody,
    inputs: TabulatedInputs,
    path: SignalBase,
    stepping: TimeStepping,
    initial: InitialState | None,
    progress: Progress | None,
    adjust: Callable[[Any], None] = _newton,
) -> Trajectory:
    start = consistent_start(body, inputs.position(0.0), float(path.rate(0.0)), initial)
    container = exu.SystemContainer()  # owns the mbs: must stay alive
    mbs = container.AddSystem()
    items = add_items(mbs, body, inputs, start)
    kept = exu.OutputVariableType
    of_coordinates = [
        SensorNode(nodeNumber=items.nBody, outputVariableType=kind, storeInternal=True)
        for kind in (kept.Coordinates, kept.Coordinates_t)
    ]
    connectors = ([] if items.oSlider is None else [items.oSlider]) + list(items.oSupports)
    of_forces = [
        SensorObject(objectNumber=connector, outputVariableType=kept.Force, storeInternal=True)
        for connector in connectors
    ]
    sensors = [mbs.AddSensor(sensor) for sensor in (*of_coordinates, *of_forces)]
    linear_solver = exu.LinearSolverType.EigenSparse if sp.issparse(body.K) else exu.LinearSolverType.EigenDense
    chosen = settings(stepping, linear_solver)
    adjust(chosen)
    seconds = solve(mbs, chosen, inputs.position, progress)
    q, v, *forces = (stored(mbs, sensor, stepping, inputs.position) for sensor in sensors)
    multipliers, held = np.empty((len(q), len(body.row_names))), [*items.rows, *body.held]
    if held:
        multipliers[:, held] = np.hstack(forces)
    yielding = Yielding(body)
    if rest := [i for i in yielding.numbers if i not in held]:
        multipliers[:, rest] = yielding.multipliers(inputs.s, q, inputs.f)
    return Trajectory(t=stepping.times, q=q, v=v, multipliers=multipliers, s=inputs.s, seconds=seconds)


def _start(body: SlidingBody, path: SignalBase, initial: InitialState | None) -> InitialState:
    s = float(path_at(path, body.domain, np.zeros(1))[0])
    return consistent_start(body, s, float(path.rate(0.0)), initial)
