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

from pmr.body import SlidingBody
from pmr.errors import InputError, SimulationError
from pmr.simulate import march_kept, march_system
from pmr.simulate.march_arrays import V, Z
from pmr.simulate.march_scheme import GeneralizedAlpha
from pmr.simulate.march_start import reason, starting_state
from pmr.simulate.modal import modal_form
from pmr.simulate.start import InitialState, consistent_start

Array = NDArray[np.float64]


class Stepper:
    """The compiled simulator of `pmr.simulate.march`, advanced from outside.

    Neither the step nor its outputs allocate memory.  In compiled code of one's own (Numba), call
    ``step_and_observe(*stepper.arguments, s, f, y)`` of `pmr.simulate.march_kernel`, which involves no Python.

    Parameters
    ----------
    body : SlidingBody
        Usually a `ReducedModel`.
    step : float, s
    s : float, m
        Path coordinate at the start.
    F : (i,) array or float, N
        Loads at the start.
    rho_inf : float
        Less than 1 as long as rigid rows move.
    outputs : sequence of int, optional
        Numbers of the body's outputs that `step` returns; all by default.
    initial : InitialState, optional
        At rest and undeformed by default.

    Raises
    ------
    InputError
        If a number is out of its range, the initial position violates a rigid row, or a rigid row only pushes.
    SimulationError
        If rows that give way depend on each other at the start, and some of them only push.
    """

    def __init__(
        self,
        body: SlidingBody,
        step: float,
        s: float,
        F: ArrayLike = 0.0,
        rho_inf: float = 0.9,
        outputs: Sequence[int] | None = None,
        initial: InitialState | None = None,
    ) -> None:
        if not step > 0.0:
            raise InputError("stepper", "step", step, "more than 0 s is allowed")
        if not 0.0 <= rho_inf < 1.0:
            raise InputError("stepper", "rho_inf", rho_inf, "from 0 to less than 1 is allowed")
        chosen = np.arange(len(body.output_positions)) if outputs is None else np.asarray(outputs, dtype=np.int64)
        form = modal_form(body)
        method = GeneralizedAlpha(step, rho_inf)
        scheme = method.scheme()
        self._form, self._step = form, step
        self._low, self._high = body.domain
        self._s, self._f = float(s), np.zeros(len(body.input_names))
        self._check(self._s)
        self._f[:] = F
        start = form.start(consistent_start(body, self._s, 0.0, initial)) if initial else None
        self._state = starting_state(form, method, self._s, 0.0, self._f, start)
        # A single load is written through it in a third of the time that NumPy takes.
        self._single: Any = memoryview(self._f) if len(self._f) == 1 else None  # type: ignore[arg-type]
        self._y = np.zeros(len(chosen))
        self._steps = 0
        #: What `step_and_observe` takes before s (float), the loads f (i,) and the outputs y (o,).
        self.arguments = (
            march_system.system(form, scheme),
            scheme,
            march_system.outputs(form.body, chosen),
            self._state,
        )
        self._advance = march_kept.entry(self._state.contact is not None)
        self._memory = march_kept.keep(*self.arguments, self._f, self._y)
        self._address = self._memory.ctypes.data

    def step(self, s: float, F: ArrayLike) -> Array:
        """Advance by one step.

        Parameters
        ----------
        s : float, m
            Path coordinate at the end of the step.
        F : (i,) array or float, N
            Loads at the end of the step, one for each input; quickest as a Python float where there is one.

        Returns
        -------
        (o,) array, m
            The chosen outputs; the same array in every step, copy what is to be kept.

        Raises
        ------
        InputError
            If s lies off the path.
        SimulationError
            If rows depend on each other, or the state is no longer finite.
        """
        if type(F) is float and self._single is not None:
            self._single[0] = F
        else:
            self._f[:] = F
        failed = self._advance(self._address, s)
        if failed:
            self._check(s)
            raise SimulationError(f"{self._where(s)}: {reason(self._form.body, s, failed)}")
        self._steps += 1
        return self._y

    @property
    def time(self) -> float:
        """Time in s since the start."""
        return self._steps * self._step

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

    def _check(self, s: float) -> None:
        if not self._low <= s <= self._high:
            raise InputError("stepper", "s", s, f"{self._low:g} to {self._high:g} m is allowed")

    def _where(self, s: float) -> str:
        return f"march failed at step {self._steps + 1}, t = {self.time + self._step:g} s, slider at {s:g} m"
