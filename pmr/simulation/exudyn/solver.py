"""Exudyn's implicit solver without printed output, with its failures as errors; for all simulators that use Exudyn."""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from io import StringIO

import exudyn as exu
import numpy as np
from exudyn.itemInterface import SensorNode, SensorObject

from pmr.errors import InputError, SimulationError
from pmr.files.arrays import Array
from pmr.simulation.contact_step import StepParts
from pmr.simulation.exudyn.items import add_pre_step_function
from pmr.simulation.stepping import Progress, TimeStepping

_log = logging.getLogger(__name__)

_NO_CONVERGENCE = (
    "Newton's method does not converge (constraint rows that depend on each other, or that move with rho_inf near 1?)"
)


def solver_settings(stepping: TimeStepping, linear_solver: exu.LinearSolverType) -> exu.SimulationSettings:
    """Exudyn's settings for generalized-alpha with a constant step and index-3 constraints.

    The step is that of `stepping`.  Sensors store every step; no file is written.
    """
    chosen = exu.SimulationSettings()
    chosen.solution.file.write = False
    chosen.solution.sensors.writePeriod = stepping.step
    chosen.linearSolver.solverType = linear_solver
    integration = chosen.timeIntegration
    integration.endTime = stepping.end
    integration.numberOfSteps = stepping.steps
    integration.adaptiveStep = False
    integration.automaticStepSize = False
    integration.generalizedAlpha.spectralRadius = stepping.rho_inf
    integration.newton.useModifiedNewton = False
    integration.verboseMode = 0
    return chosen


def override_newton(newton: exu.NewtonSettings, settings: Mapping[str, bool | float]) -> None:
    """Overwrite Exudyn's settings `newton` of Newton's method by the `settings` of the same names, in place.

    Raises InputError if Exudyn has no such setting, or refuses the value.
    """
    names = [name for name, value in newton.GetDictionary().items() if not isinstance(value, Mapping)]
    for name, value in settings.items():
        if name not in names:
            raise InputError("scene", f"simulation.newton.{name}", value, f"one of {', '.join(names)} is allowed")
        try:
            setattr(newton, name, value)
        except exu.ExudynError as error:
            raise InputError("scene", f"simulation.newton.{name}", value, str(error).splitlines()[0]) from None


def solve(
    mbs: exu.MainSystem,
    chosen: exu.SimulationSettings,
    place: Callable[[float], str],
    progress: Progress | None = None,
    times: Array | None = None,
) -> float:
    """Assemble and integrate; return the solver's wall time in s.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    chosen : exudyn.SimulationSettings
    place : callable
        Function of a time in s that returns a text with the path coordinates, for messages.
    progress : callable, optional
        Called about a hundred times, with the share of all steps that is done.
    times : (N,) array, s, optional
        Ends of the steps, t = 0 first; by default equal steps.

    Raises
    ------
    SimulationError
        If a step fails; with its number, time and path coordinates.
    """
    if progress is not None:
        _report(mbs, chosen.timeIntegration, progress)
    mbs.Assemble()
    solver = exu.MainSolverImplicitSecondOrder()  # mbs.SolveDynamic would print its failures
    if times is not None:
        solver.SetUserFunctionUpdateCurrentTime(mbs, _step_function(times))
    begin = time.perf_counter()
    try:
        with _warnings_logged():
            succeeded, reason = solver.SolveSystem(mbs, chosen), _NO_CONVERGENCE
    except exu.ExudynError as error:
        succeeded, reason = False, str(error).strip()
    seconds = time.perf_counter() - begin
    if not succeeded:
        if solver.conv.linearSolverFailed:
            reason = "singular equations (constraint rows that depend on each other?)"
        t = solver.it.currentTime
        number = round(t * chosen.timeIntegration.numberOfSteps / chosen.timeIntegration.endTime)
        raise SimulationError(f"{_describe_failed_step(number, t, place)}: {reason}")
    return seconds


def _step_function(times: Array) -> Callable[..., None]:
    """User function of the solver: sets time and length of each step, for ends of steps at `times` (N,) in s."""
    ends = iter(zip(times[1:].tolist(), np.diff(times).tolist(), strict=True))

    def update(
        solver: exu.MainSolverImplicitSecondOrder, system: exu.MainSystem, settings: exu.SimulationSettings
    ) -> None:
        """Set the solver's time and step length to the time and length of the next step."""
        solver.it.currentTime, solver.it.currentStepSize = next(ends)

    return update


def _report(mbs: exu.MainSystem, integration: exu.TimeIntegrationSettings, progress: Progress) -> None:
    """Have `progress` called about a hundred times during the time integration."""
    every, steps_done = max(1, integration.numberOfSteps // 100), 0

    def count(mbs: exu.MainSystem, t: float) -> bool:
        """Pre-step function: count the steps, and report progress."""
        nonlocal steps_done
        steps_done += 1
        if steps_done % every == 0:
            progress(steps_done / integration.numberOfSteps)
        return True

    add_pre_step_function(mbs, count)


def add_node_sensors(
    mbs: exu.MainSystem, nodes: Iterable[exu.NodeIndex], kind: exu.OutputVariableType
) -> list[exu.SensorIndex]:
    """Add sensors that store an output variable `kind` of nodes at every step; return their numbers."""
    return [mbs.AddSensor(SensorNode(nodeNumber=node, outputVariableType=kind, storeInternal=True)) for node in nodes]


def add_force_sensor(mbs: exu.MainSystem, connector: exu.ObjectIndex) -> exu.SensorIndex:
    """Add a sensor that stores a connector's force at every step; return its number."""
    kind = exu.OutputVariableType.Force
    return mbs.AddSensor(SensorObject(objectNumber=connector, outputVariableType=kind, storeInternal=True))


def read_sensor(
    mbs: exu.MainSystem, sensor: exu.SensorIndex, stepping: TimeStepping | StepParts, place: Callable[[float], str]
) -> Array:
    """Values (N, c) that a sensor stored, a row of c for each step or part of a step, t = 0 included.

    Raises SimulationError if steps are missing or a value is not finite; `place` returns the text about the path at a
    time.
    """
    values = mbs.GetSensorStoredData(sensor)[:, 1:]
    if len(values) != stepping.steps + 1:
        raise SimulationError(f"Exudyn stored {len(values)} of {stepping.steps + 1} steps")
    finite = np.isfinite(values).all(axis=1)
    if not finite.all():
        number = int(np.argmin(finite))
        raise SimulationError(f"{_describe_failed_step(number, float(stepping.times[number]), place)}: not finite")
    return np.asarray(values)


@contextmanager
def _warnings_logged() -> Iterator[None]:
    """Context in which Exudyn's warnings are logged instead of printed."""
    printed = StringIO()
    try:
        with redirect_stdout(printed):
            yield
    finally:
        message = re.sub(r"Python WARNING \[file.*?\]:", "", printed.getvalue(), flags=re.S)  # without file
        if text := " ".join(message.replace("*", "").split()):
            _log.warning("Exudyn: %s", text.removeprefix("WARNING: "))


def describe_slider(position: Callable[[float], float]) -> Callable[[float], str]:
    """Function of t in s that returns a text with a slider's position, from its path coordinate in m."""
    return lambda t: f"slider at {position(t):g} m"


def _describe_failed_step(number: int, t: float, place: Callable[[float], str]) -> str:
    """Text about the failed step `number`, with its time and the path coordinates.

    `place` returns the path coordinates at a time as text.
    """
    return f"Exudyn failed at step {number}, t = {t:g} s, {place(t)}"
