"""One step at a time of a system of bodies: a boom whose extensions a controller or an operator decides.

::

    stepper = SystemStepper(System.load("system.npz"), step=1e-3, s={"fly": 1.5}, outputs=["fly: w(6)"])
    while running:
        y = stepper.step({"fly": s}, {"fly.tip force": F})
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.errors import BEYOND_ENDS, InputError, SimulationError
from pmr.errors.text import hint
from pmr.scene.built import force_of
from pmr.scene.names import named
from pmr.scene.signals import Constant, Ramp
from pmr.simulation.contact_step import contact_frequency
from pmr.simulation.excitation import Excitation
from pmr.simulation.native import loop as kernel
from pmr.simulation.native.arrays import ROW, Drive, Record, V, Z
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.march import March
from pmr.simulation.native.start import reason
from pmr.simulation.native.systems import static_start
from pmr.simulation.recorded import recorded_system
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import TimeStepping
from pmr.system.system import System

Array = NDArray[np.float64]
Values = Mapping[str, float] | ArrayLike


def output_names(system: System) -> tuple[str, ...]:
    """Of all bodies' outputs, in their order."""
    return tuple(
        named(name, one)
        for name, body in system.bodies.items()
        for one in body.output_names or tuple(f"output {k}" for k in range(len(body.output_positions)))
    )


class SystemStepper:
    """The compiled simulator of systems, advanced from outside.

    Parameters
    ----------
    system : System
        Of reduced bodies.
    step : float, s
        One step is one step, also where contacts only push: `contact` says whether it resolves them.
    s : mapping of str to float, sequence of float, or float where there is one path, m
        Path coordinates at the start; a sequence is in the order of `System.paths`.
    F : mapping of str to float, or (i,) array, N (gravity m/s^2)
        Loads at the start; an array is in the order of `System.input_names`.  What a mapping leaves out, and all by
        default, is that of the scene of the system at t = 0, its weight in full, or zero where it knows none.
    rho_inf : float
        Less than 1.
    outputs : sequence of str or int, optional
        What `step` returns: names or numbers of `output_names`, forces of contacts among them; by default all outputs
        of the bodies.
    initial : mapping of str to InitialState, optional
        Of each body; those that are missing start at rest, undeformed.  By default all start in equilibrium with F, or
        as the scene says.

    Raises
    ------
    InputError
        If a number is out of its range, a name is none of the system's, loads are not one for each input, or nothing
        holds the bodies at the start.
    SimulationError
        If contacts depend on each other at the start.
    """

    def __init__(
        self,
        system: System,
        step: float,
        s: Values,
        F: Values | None = None,
        rho_inf: float = 0.9,
        outputs: Sequence[str | int] | None = None,
        initial: Mapping[str, InitialState] | None = None,
    ) -> None:
        if not step > 0.0:
            raise InputError("stepper", "step", step, "more than 0 s is allowed")
        if not 0.0 <= rho_inf < 1.0:
            raise InputError("stepper", "rho_inf", rho_inf, "from 0 to less than 1 is allowed")
        system.ensure_constant("stepper")
        self._system, self._step, self._steps = system, step, 0
        self._ranges = system.ranges
        #: Names of all that `outputs` chooses from: outputs of the bodies, then forces of the contacts.
        self.output_names = (*output_names(system), *map(force_of, system.contact_names))
        self._s, self._f = np.full(len(self._ranges), np.nan), np.zeros(len(system.input_names))
        self._take_path(s)
        known = recorded_system(system, "stepper") if "scene" in system.provenance else None
        if known is not None:
            self._f[:] = known.first_loads
        if F is not None:
            self._take_loads(F)
        excitation = self._excitation(system, step, rho_inf)
        if initial is None:
            initial = static_start(system, excitation) if known is None or known.static else {}
        self._march = March(SystemForm.of(system), excitation, initial)
        self._seen, y = self._march.outputs, self._march.first_outputs
        self._drive = Drive(np.stack([self._s, self._s]), np.stack([self._f, self._f]), None)
        self._record = Record(None, None, self._march.loop.state.multipliers[None].copy(), y=y[None])
        self._run(Record(None, None, self._record.multipliers[:0], y=self._record.y[:0]))  # compiles, or loads
        names = list(self.output_names)
        chosen: Sequence[str | int] = range(len(y)) if outputs is None else outputs
        self._chosen = np.array([_number(one, names, "outputs") for one in chosen], np.int64)

    def step(self, s: Values, F: Values | None = None) -> Array:
        """Advance by one step.

        Parameters
        ----------
        s : as for the start, m
            Path coordinates at the end of the step; what a mapping leaves out stays.
        F : as for the start, N (gravity m/s^2)
            Loads at the end of the step; what a mapping leaves out, and all by default, stays.

        Returns
        -------
        (o,) array
            The chosen outputs, in their units.

        Raises InputError where a path leaves its range, a name is none of the system's, or loads are not one for each
        input; SimulationError where contacts depend on each other.
        """
        self._take_path(s)
        if F is not None:
            self._take_loads(F)
        self._drive.s[1], self._drive.f[1] = self._s, self._f
        failed = self._run(self._record)
        if failed:
            why = reason(self._system, self._march.loop.state.modes[ROW:], failed)
            raise SimulationError(f"{self._where}: {why}")
        self._steps += 1
        return self.outputs[self._chosen]

    @property
    def outputs(self) -> Array:
        """All of `output_names`, at present."""
        return np.concatenate([self._record.y[0], self._record.multipliers[0]])

    @property
    def time(self) -> float:
        """Time in s since the start."""
        return self._steps * self._step

    @property
    def q(self) -> dict[str, Array]:
        """Coordinates (n,) of each body."""
        return self._coordinates(Z)

    @property
    def v(self) -> dict[str, Array]:
        """Their rates (n,)."""
        return self._coordinates(V)

    @property
    def forces(self) -> dict[str, float]:
        """Of the contacts in N, positive where they push."""
        return dict(zip(self._system.contact_names, self._march.loop.state.multipliers.tolist(), strict=True))

    @property
    def contact(self) -> float:
        """The step times the contact frequency of contacts that only push, all sections together; 0 without such.

        Above `contact_step.RESOLVED` impacts lose force and energy (docs/pads.md): a step is one step here.
        """
        ends = [Ramp(times=(0.0, self._step), values=one) for one in self._ranges.values()]
        excitation = self._excitation(self._system, self._step / 64.0, 0.0)
        paths = dict(zip(self._system.paths, ends, strict=True))
        stepping = TimeStepping(self._step, self._step / 64.0)
        return self._step * contact_frequency(self._system, replace(excitation, paths=paths, stepping=stepping))

    def check_finite(self) -> None:
        """Raise SimulationError if the state is not finite: loads may have been NaN."""
        if not np.all(np.isfinite(self._march.loop.state.modes[Z])):
            raise SimulationError(f"{self._where}: not finite")

    def _coordinates(self, row: int) -> dict[str, Array]:
        form, stacked = self._march.form, self._march.loop.state.modes[row]
        return {name: one.X @ stacked[form.columns[name]] for name, one in form.forms.items()}

    def _run(self, record: Record) -> int:
        """As many steps as the record has room for: what stopped them, or 0."""
        march = self._march
        return int(kernel.run(march.loop, march.scheme, self._seen, self._drive, record, 1)[1])

    def _excitation(self, system: System, step: float, rho_inf: float) -> Excitation:
        """Of one step on which nothing changes."""
        paths = {path: Constant(amount=float(s)) for path, s in zip(system.paths, self._s, strict=True)}
        known = dict(zip(self._system.input_names, self._f.tolist(), strict=True))
        loads = {name: Constant(amount=known.get(name, 0.0)) for name in system.input_names}
        return Excitation(paths, loads, TimeStepping(step, step, rho_inf, parts=1))

    def _take_path(self, s: Values) -> None:
        names = list(self._ranges)
        for number, value in _given(s, names, "s", "one path coordinate for each path"):
            low, high = self._ranges[names[number]]
            beyond = BEYOND_ENDS * (high - low)
            if not low - beyond <= value <= high + beyond:
                raise InputError("stepper", f"s.{names[number]}", value, f"{low:g} to {high:g} m is allowed")
            self._s[number] = min(max(value, low), high)
        if np.isnan(self._s).any():
            allowed = f"all paths are needed at the start: {', '.join(names)}"
            raise InputError("stepper", "s", None, allowed)

    def _take_loads(self, F: Values) -> None:
        for number, value in _given(F, list(self._system.input_names), "F", "one load for each input"):
            self._f[number] = value

    @property
    def _where(self) -> str:
        return f"march failed at step {self._steps + 1}, t = {self.time + self._step:g} s"


def _given(values: Values, names: list[str], key: str, what: str) -> Iterator[tuple[int, float]]:
    """Numbers and values of what was given by name, or of all in their order."""
    if isinstance(values, Mapping):
        yield from ((_number(name, names, key), float(value)) for name, value in values.items())
        return
    array = np.asarray(values, dtype=float)
    if array.shape != (len(names),) and not (array.ndim == 0 and len(names) == 1):
        allowed = f"{what} is allowed, in this order: {', '.join(names) or 'none'}; or some by their names"
        raise InputError("stepper", key, array.tolist(), allowed)
    yield from enumerate(np.atleast_1d(array).tolist())


def _number(name: str | int, names: list[str], key: str) -> int:
    """Of a name among all, or a number as it is."""
    if not isinstance(name, str) and 0 <= name < len(names):
        return int(name)
    if name not in names:
        raise InputError("stepper", key, name, f"{hint(name, names)}{', '.join(names) or 'none'} are allowed")
    return names.index(str(name))
