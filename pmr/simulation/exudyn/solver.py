"""Exudyn at work on an mbs (its multibody system): the implicit solver, sensors, and the drawing of a boom.

The solver prints nothing, and its failures are errors.  Sensors return the outputs of a system and the forces of its
contacts.  In Exudyn's renderer a boom that bends is drawn as a tube for each section, along its outputs across the
boom, with the section's profile at each point where the scene observes it; between two of these it changes linearly.
"""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from typing import NamedTuple

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from exudyn import graphics

from pmr.errors import InputError, SimulationError
from pmr.files.arrays import Array, Indices
from pmr.scene import Scene
from pmr.scene.members import member_at
from pmr.simulation.contact_step import StepParts
from pmr.simulation.exudyn.contacts import Contacts
from pmr.simulation.exudyn.equations import SignalInputs
from pmr.simulation.exudyn.items import SystemItems, add_pre_step_function
from pmr.simulation.stepping import Progress, TimeStepping
from pmr.system.body import kinds_of, units_of
from pmr.system.states import ContactRows
from pmr.system.system import System

_log = logging.getLogger(__name__)

_NO_CONVERGENCE = (
    "Newton's method does not converge (constraint rows that depend on each other, or that move with rho_inf near 1?)"
)


def solver_settings(stepping: TimeStepping, linear_solver: exu.LinearSolverType) -> exu.SimulationSettings:
    """Exudyn's settings for generalized-alpha with a constant step and index-3 constraints.

    The step is that of `stepping`, and `linear_solver` solves the equations.  Sensors store every step; no file is
    written.
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
        Function of a time in s that returns a text with the path coordinates to append to a message, such as ``, boom
        at 1.5 m``.
    progress : callable, optional
        Called about a hundred times, with the share of all steps that is done.
    times : (N,) array, s, optional
        Ends of the steps, t = 0 first; by default equal steps.

    Raises
    ------
    SimulationError
        If a step fails; the message has its time and path coordinates.
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
        raise SimulationError(f"{_describe_failed_step(solver.it.currentTime, place)}: {reason}")
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
        """Pre-step function: count the steps, and report progress; True, so that Exudyn goes on."""
        nonlocal steps_done
        steps_done += 1
        if steps_done % every == 0:
            progress(steps_done / integration.numberOfSteps)
        return True

    add_pre_step_function(mbs, count)


def read_sensor(
    mbs: exu.MainSystem, sensor: exu.SensorIndex, stepping: TimeStepping | StepParts, place: Callable[[float], str]
) -> Array:
    """Values (N, c) that a sensor stored, a row of c for each step or part of a step, t = 0 included.

    Raises SimulationError if steps are missing or a value is not finite.  In the second case the message has the time,
    and the text that `place` returns for this time.
    """
    values = mbs.GetSensorStoredData(sensor)[:, 1:]
    if len(values) != stepping.steps + 1:
        raise SimulationError(f"Exudyn stored {len(values)} of {stepping.steps + 1} steps")
    finite = np.isfinite(values).all(axis=1)
    if not finite.all():
        t = float(stepping.times[np.argmin(finite)])
        raise SimulationError(f"{_describe_failed_step(t, place)}: not finite")
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


def _describe_failed_step(t: float, place: Callable[[float], str]) -> str:
    """Text about the step to t s, which failed, with the path coordinates: the text that `place` returns for t."""
    return f"Exudyn failed at t = {t:g} s{place(t)}"


@dataclass(frozen=True)
class SystemSensors:
    """Numbers of the sensors of a system, and the names of the sensors' values in order."""

    sOutputs: exu.SensorIndex
    output_names: tuple[str, ...]
    sForces: exu.SensorIndex  # N, positive where contacts push
    contact_names: tuple[str, ...]


class ContactState(NamedTuple):
    """Contacts of a system at one time."""

    multipliers: Array  # (m,) N: forces without friction
    rows: ContactRows
    friction: Array | None  # (n,) N: of the pads; None if no pad rubs


class SystemObserver:
    """Outputs and contact forces of a system in one of Exudyn's configurations, and at the configuration's time."""

    def __init__(self, mbs: exu.MainSystem, items: SystemItems) -> None:
        """Observe the system in the mbs to which the `items` belong."""
        self._mbs, self._items, self._contacts = mbs, items, Contacts(items.parts.equations, items.parts.inputs)
        self._held = list(items.contacts)
        self._rest = np.array([k not in items.contacts for k in range(len(self._contacts.gives))])

    def forces(self, t: float, configuration: exu.ConfigurationType) -> Array:
        """Contact forces (m,) in N with friction at t s in a `configuration`.

        Rigid contacts always have their forces in the current configuration, whichever is asked for.
        """
        at = self._contact_state(t, self._items.coordinates(self._mbs, configuration))
        if at.friction is None:
            return at.multipliers
        return np.asarray(at.multipliers + self._items.parts.rubbing.law.cylinder_forces(at.friction))

    def outputs(self, t: float, configuration: exu.ConfigurationType) -> Array:
        """Outputs y = O q + W f - X lambda (o,) at t s in a `configuration`, with the effect of friction's moments."""
        equations, q = self._items.parts.equations, self._items.coordinates(self._mbs, configuration)
        at = self._contact_state(t, q)
        y = equations.outputs @ q + equations.assembly.direct @ self._acting_loads(t) - at.rows.X @ at.multipliers
        if at.friction is not None:
            turned = equations.assembly.outputs_by_moments(self._items.parts.inputs.positions(t)[0])
            y = y + turned @ self._items.parts.rubbing.law.moments(at.friction, at.multipliers)
        return np.asarray(y)

    def _acting_loads(self, t: float) -> Array:
        """Loads (i,) at t s, with the inertia of the boom by the motion of its base."""
        loads, base = self._items.parts.inputs.values_at(t).loads, self._items.parts.base
        return loads if base is None else loads + base.inertia(self._mbs, t)

    def _contact_state(self, t: float, q: Array) -> ContactState:
        """Forces and rows of the contacts, and the friction of pads, at t s with the coordinates q (n,).

        Rigid contacts have the forces of Exudyn's last solution.
        """
        equations, inputs = self._items.parts.equations, self._items.parts.inputs
        multipliers = np.zeros(len(self._rest))
        x, f, rubbing, grip = inputs.positions(t), self._acting_loads(t), self._items.parts.rubbing, None
        if self._held:
            multipliers[self._held] = self._mbs.GetObjectOutput(self._items.oContacts, exu.OutputVariableType.Force)
        if rubbing is not None:
            at = rubbing.state(rubbing.rows(x), q, f, t)
            multipliers[self._rest], grip = at.multipliers[self._rest], at.grip.forces
        elif self._rest.any():
            multipliers[self._rest] = self._contacts.forces(self._contacts.rows(x), q[None], f[None])[0]
        return ContactState(multipliers, equations.rows(x).at_time(0), grip)


def add_sensors(mbs: exu.MainSystem, items: SystemItems) -> SystemSensors:
    """Add sensors of the outputs y and the contact forces lambda of a system, one from `simulator.add_system`."""
    watched, equations = SystemObserver(mbs, items), items.parts.equations
    functions = (
        lambda mbs, t, sensors, factors, configuration: watched.outputs(t, configuration),
        lambda mbs, t, sensors, factors, configuration: watched.forces(t, configuration),
    )
    added = [
        mbs.AddSensor(
            eii.SensorUserFunction(sensorNumbers=[], factors=[], sensorUserFunction=function, storeInternal=True)
        )
        for function in functions
    ]
    return SystemSensors(added[0], equations.system.output_names, added[1], equations.system.contact_names)


#: Width in m with which a section without a known profile is drawn.
THIN = 0.02
#: RGBA of the sections; repeated if there are more.
COLORS = ((0.95, 0.75, 0.15, 1.0), (0.75, 0.55, 0.1, 1.0), (0.9, 0.85, 0.5, 1.0))


@dataclass(frozen=True)
class Tube:
    """A section as drawn, in coordinates from its tail, at k points along it."""

    x: Array  # (k,) m: points at which it is observed
    across: dict[int, Indices]  # indices of outputs (k,) along y (key 1) and z (key 2), if any
    outline: Array  # (k, c, 2) m: y and z of the profile's c corners at these points


def add_drawing(mbs: exu.MainSystem, items: SystemItems, scene: Scene, scale: float = 1.0) -> exu.ObjectIndex:
    """Draw a boom that was added by `simulator.add_system`, with deflections `scale` times as large.

    Returns the number of the ObjectGround that draws the boom, in the mbs' axes: on the body that carries the boom, or
    where the scene's frame puts it.  The object's user function is called whenever the picture changes.

    Raises InputError if a section is observed at less than two points along it.
    """
    drawn = BoomDrawing(mbs, items, scene, scale)
    looks = eii.VObjectGround(graphicsDataUserFunction=lambda mbs, item: drawn.graphics())
    name = items.component_name(mbs, "Drawing")
    return mbs.AddObject(eii.ObjectGround(name=name, visualization=looks))


class Posture(NamedTuple):
    """Position and axes of a boom, and its extensions."""

    pivot: Array  # (3,) m
    axes: Array  # (3, 3): columns are the axes of the boom
    extensions: Array  # m: of the sections, first the base's 0


class BoomDrawing:
    """Drawing of a boom in the state that Exudyn shows."""

    def __init__(self, mbs: exu.MainSystem, items: SystemItems, scene: Scene, scale: float = 1.0) -> None:
        """Draw the boom of `scene`, with the `items` in the mbs, with deflections `scale` times as large.

        Errors as `section_tubes`.
        """
        self._mbs, self._items, self._scene, self._scale = mbs, items, scene, scale
        self._watched, self.tubes = SystemObserver(mbs, items), section_tubes(scene, items.parts.equations.system)
        place = (0.0, 0.0, 0.0) if scene.frame is None else scene.frame.tail_position
        self._place = np.array(place)

    def axes(self) -> list[Array]:
        """Points (k, 3) in m of each section's axis, k for each section, in the axes of the mbs."""
        return [rings[:, 0] for rings in self._rings([np.zeros((1, 1, 2))] * len(self.tubes))]

    def graphics(self) -> list[dict[str, object]]:
        """Exudyn's graphics data of the boom in the state that is shown: one dict for each section."""
        triangulated = []
        for number, rings in enumerate(self._rings([tube.outline for tube in self.tubes])):
            k, c, _ = rings.shape
            a = (c * np.arange(k - 1)[:, None] + np.arange(c)).ravel()
            b = (c * np.arange(k - 1)[:, None] + (np.arange(c) + 1) % c).ravel()
            triangles = np.vstack([np.column_stack([a, b, b + c]), np.column_stack([a, b + c, a + c])])
            color = list(COLORS[number % len(COLORS)])
            triangulated.append(graphics.FromPointsAndTrigs(rings.reshape(-1, 3), triangles, color))
        return triangulated

    def _rings(self, outlines: list[Array]) -> list[Array]:
        """Outlines (k, c, 3) in m at the k points of each section, in the axes of the mbs.

        `outlines` are (k or 1, c, 2) in m, the y and z of c corners across each section.
        """
        shown = exu.ConfigurationType.Visualization
        t = self._mbs.systemData.GetTime(shown)
        outputs, posture = self._watched.outputs(t, shown), self._posture(t, shown)
        rings_of_sections, observed = list[Array](), self._items.parts.equations.assembly.output_slices.values()
        for tube, outline, X, at in zip(self.tubes, outlines, np.cumsum(posture.extensions), observed, strict=True):
            rings = np.zeros((len(tube.x), outline.shape[1], 3))
            rings[:, :, 0] = X + tube.x[:, None]
            rings[:, :, 1:] = outline
            for axis, numbers in tube.across.items():
                rings[:, :, axis] += self._scale * outputs[at][numbers][:, None]
            rings_of_sections.append(posture.pivot + (rings + self._place) @ posture.axes.T)
        return rings_of_sections

    def _posture(self, t: float, shown: exu.ConfigurationType) -> Posture:
        """Posture of the boom at t s in the configuration that is `shown`."""
        base, kind, names = self._items.parts.base, exu.OutputVariableType.Coordinates, self._scene.names
        if base is None:
            assert isinstance(self._items.parts.inputs, SignalInputs)  # of a user's own mbs
            s = self._items.parts.inputs.paths(t)
            R = np.eye(3) if self._scene.frame is None else self._scene.frame.rotation(np.array([t]))[0]
            return Posture(np.zeros(3), R, np.array([0.0, *(s[name] for name in names[1:])]))
        x = np.array(self._mbs.GetNodeOutput(base.node, kind, shown))
        z = np.array(
            [value for n in base.paths.nodes for value in np.atleast_1d(self._mbs.GetNodeOutput(n, kind, shown))]
        )
        return Posture(
            base.origin(x), base.kinematics(x, 0.0 * x).axes, base.paths.extensions(t, z, 0.0 * z).value[: len(names)]
        )


def section_tubes(scene: Scene, system: System) -> list[Tube]:
    """One tube for each section, from the base section on; a section without a box is a thin square one.

    Raises InputError if a section is observed at less than two points along it.
    """
    sections = []
    for number, body in enumerate(system.bodies.values()):
        kinds, units = kinds_of(body), units_of(body)
        along = {
            axis: {
                float(body.output_positions[k]): k
                for k, (kind, unit) in enumerate(zip(kinds, units, strict=True))
                if unit == "m" and kind in (f"beam {direction}", f"tip {direction}")
            }
            for axis, direction in ((1, "y"), (2, "z"))
        }
        at = [set(numbers) for numbers in along.values() if numbers]
        x = sorted(set.intersection(*at)) if at else []
        if len(x) < 2:
            allowed = "stations along it are allowed, with a drawing"
            raise InputError("scene", scene.section_key(number, "observe.stations"), len(x), allowed)
        box = member_at(scene, number).part.body.box
        thin = THIN * np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
        outline = [thin if box is None else [side.start for side in box.profile_at(at).sides] for at in x]
        across = {axis: np.array([numbers[place] for place in x]) for axis, numbers in along.items() if numbers}
        sections.append(Tube(np.array(x), across, np.array(outline)))
    return sections
