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
from pmr.simulate.exudyn_items import (
    SlidingBodyItems,
    add_called_body,
    add_pre_step_function,
    add_sliding_body,
    add_sliding_body_with_callbacks,
    add_updated_body,
)
from pmr.simulate.exudyn_solver import settings, solve, stored
from pmr.simulate.inputs import Inputs, TabulatedInputs, moving_rows
from pmr.simulate.start import InitialState, consistent_start
from pmr.simulate.stepping import Loads, Progress, TimeStepping

__all__ = [
    "SlidingBodyItems",
    "add_pre_step_function",
    "add_sliding_body",
    "add_sliding_body_with_callbacks",
    "simulate",
    "simulate_with_callbacks",
]


AddItems = Callable[[Any, SlidingBody, Inputs, InitialState], SlidingBodyItems]


def simulate(
    body: SlidingBody,
    path: SignalBase,
    loads: Loads,
    stepping: TimeStepping,
    initial: InitialState | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Simulate a reduced (dense) or full (sparse) body; rows and loads are set once a step.

    Arguments and errors as for `pmr.simulate.Simulator`.  The initial accelerations are Exudyn's, which leave
    out what moving rows add to them (2 s' C' v and more): exact where the slider starts at rest, or the body
    undeformed and still; the method stays of second order elsewhere.
    """
    inputs = TabulatedInputs(body, path, loads, stepping)
    return _simulate(add_updated_body, body, inputs, path, stepping, initial, progress)


def simulate_with_callbacks(
    body: SlidingBody,
    path: SignalBase,
    loads: Loads,
    stepping: TimeStepping,
    initial: InitialState | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Simulate as the paper does: Exudyn calls Python for rows, their Jacobian and loads in every iteration.

    Arguments, errors and trajectory as for `simulate`; for comparison.
    """
    inputs = TabulatedInputs(body, path, loads, stepping)
    return _simulate(add_called_body, body, inputs, path, stepping, initial, progress)


def _simulate(
    add_items: AddItems,
    body: SlidingBody,
    inputs: TabulatedInputs,
    path: SignalBase,
    stepping: TimeStepping,
    initial: InitialState | None,
    progress: Progress | None,
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
    of_forces = [
        SensorObject(objectNumber=connector, outputVariableType=kept.Force, storeInternal=True)
        for connector in (items.oSlider, *items.oSupports)
    ]
    sensors = [mbs.AddSensor(sensor) for sensor in (*of_coordinates, *of_forces)]
    linear_solver = exu.LinearSolverType.EigenSparse if sp.issparse(body.K) else exu.LinearSolverType.EigenDense
    seconds = solve(mbs, settings(stepping, linear_solver), inputs.position, progress)
    q, v, *forces = (stored(mbs, sensor, stepping, inputs.position) for sensor in sensors)
    multipliers = np.hstack(forces)[:, np.argsort([*moving_rows(body), *body.held])]
    return Trajectory(t=stepping.times, q=q, v=v, multipliers=multipliers, s=inputs.s, seconds=seconds)
