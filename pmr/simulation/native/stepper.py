"""One step at a time, for a simulation in a loop of one's own: hardware, a controller, an operator.

::

    stepper = Stepper(ReducedModel.load("reduced.npz"), step=1e-3, s=1.25)
    while running:
        y = stepper.step(s, F)  # outputs in m at the end of the step
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.errors import BEYOND_ENDS, InputError, SimulationError
from pmr.reduced.model import ReducedModel
from pmr.simulation.contact_step import PLACES, frequency_at
from pmr.simulation.modal import modal_form
from pmr.simulation.native import bound_step as bound_step
from pmr.simulation.native import tables
from pmr.simulation.native.arrays import ROW, V, Z
from pmr.simulation.native.building import loop_of
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.scheme import GeneralizedAlpha
from pmr.simulation.native.start import Onset, begin, reason
from pmr.simulation.recorded import recorded
from pmr.simulation.start import InitialState
from pmr.system.body import SlidingBody
from pmr.system.contacts import ALONE, SLIDER
from pmr.system.system import System

Array = NDArray[np.float64]


class Stepper:
    """The compiled simulator of `pmr.simulation.native.simulator`, advanced from outside.

    Neither the step nor its outputs allocate memory.  In compiled code of one's own (Numba), call
    ``step_on_tables(*stepper.arguments, s, f, y)`` of `pmr.simulation.native.part`, which involves no Python.

    Parameters
    ----------
    body : SlidingBody
        Usually a `ReducedModel`.
    step : float, s
    s : float, m
        Path coordinate at the start.
    F : (i,) array, or float where there is one load, N (gravity m/s^2)
        Loads at the start; by default those of the model's scene at t = 0, its weight in full even where it rises, and
        none for a model that knows no scene.
    rho_inf : float
        Less than 1 as long as rigid rows move.  Their multipliers (index 3) grow from step to step where it is near 1,
        the sooner the faster they move, and nothing here checks the energy as `march.simulate` does: at most 0.9, and
        `march.simulate` on the fastest path that may come (docs/time_integration.md has what was measured).  A model
        with residual flexibility has no such multipliers.
    outputs : sequence of int, optional
        Numbers of the body's outputs that `step` returns; all by default.
    initial : InitialState, optional
        At rest and undeformed by default.

    Raises
    ------
    InputError
        If a number is out of its range, loads are not one for each input, the initial position violates a rigid row, or
        a rigid row only pushes.
    SimulationError
        If rows that give way depend on each other at the start, and some of them only push.
    """

    def __init__(
        self,
        body: SlidingBody,
        step: float,
        s: float,
        F: ArrayLike | None = None,
        rho_inf: float = 0.9,
        outputs: Sequence[int] | None = None,
        initial: InitialState | None = None,
    ) -> None:
        if not step > 0.0:
            raise InputError("stepper", "step", step, "more than 0 s is allowed")
        if not 0.0 <= rho_inf < 1.0:
            raise InputError("stepper", "rho_inf", rho_inf, "from 0 to less than 1 is allowed")
        chosen = np.arange(len(body.output_positions)) if outputs is None else np.asarray(outputs, dtype=np.int64)
        body_form = modal_form(body)
        body_form.body.ensure_whole("model")
        form, method = SystemForm(System.of(body), {ALONE: body_form}), GeneralizedAlpha(step, rho_inf)
        self._system, self._form, self._step = form.system, body_form, step
        self._low, self._high = body.domain
        self._s, self._f = self._on_path(float(s)), np.zeros(len(body.input_names))
        if F is not None:
            self._f[:] = self._one_each(F)
        elif isinstance(body, ReducedModel) and "scene" in body.provenance:
            self._f[:] = recorded(body, "stepper").first_loads
        loop, at = loop_of(form, [method], (1,), 0.0, (SLIDER,)), np.array([self._s])
        x = form.system.coordinates({SLIDER: at})[0]
        start = {} if initial is None else {ALONE: initial}
        begin(loop, form, method, Onset((SLIDER,), at, x, np.zeros(len(x)), self._f, start))
        self._state = loop.state
        # A single load is written through it in a third of the time that NumPy takes.
        self._single: Any = memoryview(self._f) if len(self._f) == 1 else None  # type: ignore[arg-type]
        self._y = np.zeros(len(chosen))
        self._steps = 0
        assert loop.tables is not None and form.on_tables is not None
        observed = tables.outputs(form.on_tables, chosen.tolist())
        #: What `step_on_tables` takes before s (float), the loads f (i,) and the outputs y (o,).
        self.arguments = (loop.tables, loop.divided, method.scheme(), observed, self._state)
        self._advance = bound_step.entry(self._state.contact is not None)
        self._memory = bound_step.store(*self.arguments, self._f, self._y)
        self._address = self._memory.ctypes.data

    def step(self, s: float, F: ArrayLike) -> Array:
        """Advance by one step.

        Parameters
        ----------
        s : float, m
            Path coordinate at the end of the step; `pmr.errors.BEYOND_ENDS` of the path's length beyond an end it is
            taken there.
        F : (i,) array, or float where there is one load, N (gravity m/s^2)
            Loads at the end of the step, one for each of the body's `input_names`; quickest as a Python float.

        Returns
        -------
        (o,) array, m
            The chosen outputs; the same array in every step, copy what is to be kept.

        Raises
        ------
        InputError
            If s lies off the path, or loads are not one for each input.
        SimulationError
            If rows depend on each other, or the state is no longer finite.
        """
        if type(F) is float and self._single is not None:
            self._single[0] = F
        else:
            self._f[:] = self._one_each(F)
        failed = self._advance(self._address, s)
        if failed == bound_step.OFF_THE_PATH:
            failed = self._advance(self._address, self._on_path(s))
        if failed:
            why = reason(self._system, self._state.modes[ROW:], failed)
            raise SimulationError(f"{self._where(s)}: {why}")
        self._steps += 1
        return self._y

    @property
    def time(self) -> float:
        """Time in s since the start."""
        return self._steps * self._step

    @property
    def contact(self) -> float:
        """The step times the contact frequency of rows that only push, on the whole path; 0 without such rows.

        Above `contact_step.RESOLVED` impacts lose force and energy (docs/pads.md): a step is one step here.
        """
        x = self._system.coordinates({SLIDER: np.linspace(self._low, self._high, PLACES)})
        return self._step * frequency_at(self._system, x)

    @property
    def q(self) -> Array:
        """Coordinates (n,) of the body."""
        return self._form.X @ self._state.modes[Z, : self._form.body.size]

    @property
    def v(self) -> Array:
        """Their rates (n,)."""
        return self._form.X @ self._state.modes[V, : self._form.body.size]

    @property
    def multipliers(self) -> Array:
        """Multipliers (m,) in N; the sliders push with their negative."""
        return self._state.multipliers.copy()

    def check_finite(self) -> None:
        """Raise SimulationError if the state is not finite: loads may have been NaN."""
        if not np.all(np.isfinite(self._state.modes[Z])):
            raise SimulationError(f"{self._where(self._s)}: not finite")

    def _on_path(self, s: float) -> float:
        beyond = BEYOND_ENDS * (self._high - self._low)
        if not self._low - beyond <= s <= self._high + beyond:
            raise InputError("stepper", "s", s, f"{self._low:g} to {self._high:g} m is allowed")
        return min(max(s, self._low), self._high)

    def _one_each(self, F: ArrayLike) -> Array:
        loads, names = np.asarray(F, dtype=float), self._form.body.input_names
        if loads.shape == (len(names),) or (loads.ndim == 0 and len(names) == 1):
            return loads
        allowed = f"one load for each input is allowed, in this order: {', '.join(names) or 'none'}"
        raise InputError("stepper", "F", loads.tolist(), allowed)

    def _where(self, s: float) -> str:
        return f"march failed at step {self._steps + 1}, t = {self.time + self._step:g} s, slider at {s:g} m"
