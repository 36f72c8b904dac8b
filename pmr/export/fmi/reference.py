"""The reference trajectory in an FMU: inputs at every step, and outputs of the compiled simulator at some steps.

Within a step an FMU extrapolates its inputs by their rates: as cubics that agree with the run's inputs at both ends of
the step (docs/fmu.md says which error is left where a step is divided).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from pmr.export.fmi.variables import STARTS, Drivers, Variable
from pmr.files.arrays import Array
from pmr.scene.built import force_name
from pmr.scene.signals import SignalBase
from pmr.scene.signals.base import Strand
from pmr.simulation.contact_step import contact_frequency, contact_frequency_within
from pmr.simulation.excitation import Excitation, signals_in_order
from pmr.simulation.moving import DRIVE, EXTENSION_DRIVE, StoredScene, store_boom_scene
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.free_motion import with_free_motion
from pmr.simulation.stepping import TimeStepping
from pmr.system.states import displacements

#: Number of instants at which outputs are written; all steps if there are fewer.
INSTANTS = 101


@dataclass(frozen=True)
class Reference:
    """Reference trajectory: a simulation of a system with n drivers, o outputs, m contacts and r modes."""

    stepping: TimeStepping
    omega: float  #: rad/s, of contacts that only push; 0 without any
    inputs: Array  #: (T, 1 + 4 n) array: time, drivers and their rates of order one to three, at every step
    first: Array  #: (2, n) array: values of the drivers at the start, and rates of those that have no input
    static: bool  #: Whether it starts in equilibrium
    t: Array  #: (S,) array, s
    outputs: Array  #: (S, o + m) array: outputs of the bodies, and contact forces
    nominal: Array  #: (2 r,) array: largest modal coordinates, then their largest rates

    @property
    def start_values(self) -> Array:
        """Start values (4 + 4 n,) of time, drivers, the drivers' rates, and the parameters step, rho_inf, start.

        Rates of inputs are zero; the parameter start is the number of the kind of start (`STARTS`).
        """
        step = self.stepping.step
        start = STARTS["static" if self.static else "at rest"]
        return np.concatenate([[0.0], *self.first, np.zeros(self.first.size), [step, self.stepping.rho_inf, start]])


def reference(drivers: Drivers, scene: StoredScene) -> Reference:
    """Simulate the system of `drivers` under the `scene` stored with it, and return the reference trajectory.

    Without a frame, paths and loads follow the FMU's cubics between steps; with a frame that moves, they follow the
    scene's signals.  A free luffing angle or extension is computed first, as in a run; errors as
    `pmr.simulation.native.free_motion.with_free_motion`.
    """
    if scene.free_scene is not None:
        scene = store_boom_scene(with_free_motion(scene.free_scene, drivers.system)[0], drivers.system)
    system, excitation = drivers.system, scene.excitation
    inputs = input_cubics(drivers, excitation)
    reached = _cubic_excitation(drivers, excitation, inputs)
    free = bool(system.hoist) or drivers.has_free_motion
    initial = None if free else systems.static_start(system, reached) if scene.static else {}
    trajectory = systems.simulate_form(SystemForm(system, drivers.forms), reached, initial)
    y = list(displacements(system, trajectory).values())
    z, v = (
        np.hstack([getattr(trajectory.bodies[name], what) @ form.inverse.T for name, form in drivers.forms.items()])
        for what in "qv"
    )
    t, modal = excitation.times, SystemForm(system, drivers.forms).modal
    anywhere = bool(drivers.moved_paths)
    shown = np.unique(np.linspace(0, len(t) - 1, min(INSTANTS, len(t))).round().astype(int))
    largest = np.abs(np.hstack([z, v])).max(axis=0)
    smallest = 1e-9 * np.repeat(largest.reshape(2, -1).max(axis=1), z.shape[1])
    nominal = np.maximum(largest, smallest)
    first = np.stack([inputs[0, 0], np.zeros(drivers.count)])
    if not drivers.shown_paths:
        first[0, : drivers.first_load_number] = [low for low, _ in drivers.data.rows.ranges]
    first[0, drivers.first_load_number : drivers.first_motion_number] = first_loads(drivers, scene)
    if drivers.frame is not None:
        started = [drivers.names.index(name) for name in drivers.started]
        first[:, started] = drivers.frame.start[:2, started]
    return Reference(
        stepping=reached.stepping,
        omega=contact_frequency_within(modal, system.ranges) if anywhere else contact_frequency(modal, reached),
        inputs=np.hstack([t[:, None], *inputs]),
        first=first,
        static=scene.static,
        t=t[shown],
        outputs=np.hstack([*y, trajectory.forces])[shown],
        nominal=np.where(nominal > 0.0, nominal, 1.0),
    )


def first_loads(drivers: Drivers, scene: StoredScene) -> Array:
    """Loads (i,) in N or N m of the inputs of `drivers` at the start, with the full weight."""
    if drivers.frame is None:
        at = dict.fromkeys(drivers.loads, 0.0) | dict(
            zip(drivers.system.load_names, scene.first_loads.tolist(), strict=True)
        )
        return np.array([at[name] for name in drivers.loads])
    return drivers.frame.start[0, drivers.frame.load_numbers]


class CubicSignal(SignalBase):
    """Signal of one cubic for each step, given by value and rates of order one to three at the step's beginning."""

    step: float  # s
    rates: tuple[tuple[float, ...], ...]  # (4, T)

    @property
    def strands(self) -> tuple[Strand, ...]:
        x = np.array(self.rates)
        breaks, polynomials = self.step * np.arange(x.shape[1]), x[::-1].T / [6.0, 2.0, 1.0, 1.0]
        return (Strand(breaks, np.ascontiguousarray(polynomials)),)

    def value(self, t: ArrayLike) -> Array:
        at, x, x1, x2, x3 = self._pieces(t)
        return np.asarray(x + at * (x1 + at / 2.0 * (x2 + at / 3.0 * x3)))

    def rate(self, t: ArrayLike) -> Array:
        at, _, x1, x2, x3 = self._pieces(t)
        return np.asarray(x1 + at * (x2 + at / 2.0 * x3))

    def _pieces(self, t: ArrayLike) -> Array:
        """Time in s since the current step began, then value and three rates at its beginning, (5, ...)."""
        at, rates = np.asarray(t, float), np.array(self.rates)
        number = np.clip(np.floor(at / self.step + 1e-9).astype(int), 0, rates.shape[1] - 1)
        return np.array([at - number * self.step, *rates[:, number]])


def _cubic_excitation(drivers: Drivers, excitation: Excitation, inputs: Array) -> Excitation:
    """Return the excitation with cubics over each step in place of the signals of its paths and loads.

    `inputs` (4, T, n) are value and rates of order one to three of the n drivers at T steps, as `input_cubics` returns
    them.  In a frame that moves, the excitation is returned unchanged.
    """
    if drivers.frame is not None:
        return excitation
    step = excitation.stepping.step

    def signal_of(number: int) -> CubicSignal:
        """Signal of the driver with this `number`, a cubic in each step."""
        return CubicSignal(step=step, rates=tuple(map(tuple, inputs[:, :, number].tolist())))

    paths = dict(excitation.paths) | {name: signal_of(k) for k, name in enumerate(drivers.shown_paths)}
    loads = {name: signal_of(drivers.first_load_number + k) for k, name in enumerate(drivers.loads)}
    driven = {name: loads.pop(name) for name in excitation.hoist}
    return replace(excitation, paths=paths, loads=loads, hoist=driven)


def input_cubics(drivers: Drivers, excitation: Excitation) -> Array:
    """Values and rates of order one to three (4, T, n) of n drivers at T steps: a cubic from each step to the next one.

    The cubic of a step has the exact values of the driver at both ends of the step.  Without a frame, it has the exact
    rates of paths and loads there too.  In a frame, it has the exact second rates of paths and angles, which accelerate
    the frame, and the exact rates of a cylinder's drive; all other drivers are straight lines.  At the last time the
    rates are zero.
    """
    t, h, n = excitation.times, excitation.stepping.step, drivers.count
    orders, frame = np.zeros((4, len(t), n)), drivers.frame
    if frame is not None:
        at = frame.motions(excitation, t)
        second = np.array([name in (*frame.paths, *frame.angles) for name in frame.drivers])
        orders[0] = at[0].T
        x, v, a = at[0].T, at[1].T, at[2].T
        lines, drives = straight_line(x[:-1], x[1:], h), (DRIVE, EXTENSION_DRIVE)
        drive = [name.startswith(drives) for name in frame.drivers]
        lines = np.where(drive, cubic_by_rates(x[:-1], x[1:], v[:-1], v[1:], h), lines)
        orders[:, :-1] = np.where(second, cubic_by_second_rates(x[:-1], x[1:], a[:-1], a[1:], h), lines)
        return orders
    signals = [*(excitation.paths[path] for path in drivers.shown_paths)]
    numbers = [*range(len(drivers.shown_paths)), *(drivers.first_load_number + k for k in range(len(drivers.loads)))]
    for number, signal in zip(
        numbers, [*signals, *signals_in_order({**excitation.loads, **excitation.hoist}, drivers.loads)], strict=True
    ):
        orders[0, :, number] = signal.value(t)
        ended = signal.rate(np.nextafter(t[1:], 0.0))  # at a kink the rate before it
        x = orders[0, :, number].copy()
        orders[:, :-1, number] = cubic_by_rates(x[:-1], x[1:], signal.rate(t[:-1]), ended, h)
    return orders


def inputs_csv(run: Reference, variables: Sequence[Variable]) -> str:
    """Text of resources/reference_in.csv: time and inputs of `run` at every step, with the names of `variables`."""
    shown = [variable for variable in variables if variable.role.causality == "input"]
    inputs = [variable for variable in shown if variable.reference < run.inputs.shape[1]]
    return _csv(["time", *(v.name for v in inputs)], run.inputs[:, [0, *(v.reference for v in inputs)]])


def outputs_csv(run: Reference, drivers: Drivers, variables: Sequence[Variable]) -> str:
    """Text of resources/reference_out.csv: time, body outputs and contact forces of a run, under the variables' names.

    `drivers` has the system.
    """
    titles = {*drivers.system.output_names, *map(force_name, drivers.system.contact_names)}
    outputs = [v for v in variables if v.role.causality == "output" and v.kind != "rate"]
    names = [v.name for v in outputs if v.description.partition("; ")[0] in titles]
    return _csv(["time", *names], np.hstack([run.t[:, None], run.outputs]))


def _csv(names: Sequence[str], rows: Array) -> str:
    """Comma-separated text of a header with `names` (k), and of `rows` (T, k) of numbers."""
    lines = [",".join(f'"{name}"' for name in names)]
    return "\n".join([*lines, *(",".join(map(repr, row)) for row in rows.tolist()), ""])


def cubic_by_rates(begun: Array, ended: Array, begun_rate: Array, ended_rate: Array, h: float) -> Array:
    """Value and rates of order one to three (4, ...) at the beginning of a step of h s: Hermite's cubic.

    The cubic has the values `begun`, `ended` (...) and the rates `begun_rate`, `ended_rate` (...) at both ends.
    """
    mean = (ended - begun) / h
    second = (6.0 * mean - 4.0 * begun_rate - 2.0 * ended_rate) / h
    return np.array([begun, begun_rate, second, 6.0 * (begun_rate + ended_rate - 2.0 * mean) / h**2])


def cubic_by_second_rates(begun: Array, ended: Array, begun_second: Array, ended_second: Array, h: float) -> Array:
    """Value and rates of order one to three (4, ...) at the beginning of a step of h s, of a cubic.

    The cubic has the values `begun`, `ended` (...) and the second rates `begun_second`, `ended_second` (...) at both
    ends.
    """
    third = (ended_second - begun_second) / h
    rate = (ended - begun) / h - h / 2.0 * begun_second - h**2 / 6.0 * third
    return np.array([begun, rate, begun_second, third])


def straight_line(begun: Array, ended: Array, h: float) -> Array:
    """Value and rates of order one to three (4, ...) at the beginning of a step of h s, of a straight line.

    The line leads from `begun` to `ended` (...); the second and third rates are zero.
    """
    rate = (ended - begun) / h
    return np.array([begun, rate, 0.0 * rate, 0.0 * rate])
