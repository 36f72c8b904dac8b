r"""The compiled simulator: generalized-alpha in modal coordinates, a microsecond or less a step.

.. math::
    M \ddot q + D \dot q + K q + C(s)^T \lambda = B f, \qquad C(s) q + H(s) f - (G(s) + 1/k) \lambda = 0

M, K and D never change: they are diagonalised once (`pmr.simulate.modal`), and a step is r scalar updates and one
m x m solve for the multipliers (`pmr.simulate.march_kernel`), or a few where rows only push
(`pmr.simulate.march_contact`).  Rayleigh and modal damping stay in the diagonal; a damping that couples the modes costs
two products with an r x r matrix a step.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.body import SlidingBody, Trajectory, displacement
from pmr.errors import SimulationError
from pmr.signals import SignalBase
from pmr.simulate import inertial, march_system
from pmr.simulate import march_kernel as kernel
from pmr.simulate.march_arrays import V, Z
from pmr.simulate.march_scheme import GeneralizedAlpha
from pmr.simulate.march_start import check_stable, reason, starting_state
from pmr.simulate.modal import ModalForm, modal_form, support_forces
from pmr.simulate.start import InitialState, consistent_start
from pmr.simulate.stepping import Loads, Progress, TimeStepping, loads_at, one_for_each, path_at

Array = NDArray[np.float64]
#: Steps between two looks at the clock, the keyboard and the progress.
BLOCK = 4096


@dataclass(frozen=True)
class Observation:
    """Chosen outputs of a simulation, at every so many steps.

    Attributes
    ----------
    t : (T,) array, s
    y : (T, o) array, m
    multipliers : (T, m) array, N
    seconds : float
        Wall time of the solver alone.
    """

    t: Array
    y: Array
    multipliers: Array
    seconds: float


def simulate(
    body: SlidingBody,
    path: SignalBase,
    loads: Loads,
    stepping: TimeStepping,
    initial: InitialState | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Simulate a reduced body, or a full one of some thousand coordinates at most.

    Arguments and errors as for `pmr.simulate.Simulator`; the same equations, scheme and start as Exudyn's, so the
    trajectories agree to round-off.  `seconds` is the time of the steps, in modal coordinates; compiling (once on a
    machine), diagonalising and the way back to q are not in it.
    """
    form = modal_form(body)
    if initial is not None:
        s = float(path_at(path, body.domain, np.zeros(1))[0])
        initial = form.start(consistent_start(body, s, float(path.rate(0.0)), initial))
    modal = simulate_modal(form, path, loads, stepping, initial, progress)
    multipliers = np.empty((len(modal.t), len(body.row_names)))
    multipliers[:, form.rows] = modal.multipliers
    if body.held:
        f = loads_at(one_for_each(loads, body.input_names), modal.t)
        multipliers[:, list(body.held)] = support_forces(body, form, modal, f)
    q, v = modal.q @ form.X.T, modal.v @ form.X.T
    return Trajectory(modal.t, q, v, multipliers, modal.s, modal.seconds, modal.quasi_static)


def simulate_modal(
    form: ModalForm,
    path: SignalBase,
    loads: Loads,
    stepping: TimeStepping,
    initial: InitialState | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Simulate a body that is in modal form already; `initial` and the trajectory are in modal coordinates.

    A body that keeps the inertia of its residual part goes to `pmr.simulate.inertial`.
    """
    if form.body.flexibility is not None and form.body.flexibility.keeps_inertia:
        return inertial.simulate_modal(form, path, loads, stepping, initial, progress)
    march = _March(form, path, loads, stepping, initial)
    T, r, m = stepping.steps + 1, form.body.size, len(form.body.row_names)
    z, v, multipliers = (np.empty((T, size)) for size in (r, r, m))
    z[0], v[0] = march.start
    multipliers[0] = march.state.multipliers

    def steps(first: int, last: int) -> tuple[int, int]:
        kept = (array[first:last] for array in (z, v, multipliers))
        return kernel.run(march.system, march.scheme, march.state, march.s[first:last], march.f[first:last], *kept)

    seconds = march.advance(steps, 1, progress)
    march.check_finite(z)
    return Trajectory(stepping.times, z, v, multipliers, march.s, seconds)


def observe(
    form: ModalForm,
    path: SignalBase,
    loads: Loads,
    stepping: TimeStepping,
    outputs: Sequence[int] | None = None,
    every: int = 1,
) -> Observation:
    """Simulate from rest and keep nothing but outputs (all by default) and multipliers of each `every`-th step.

    Memory is of the order of what is kept: a long simulation of a large body needs little.

    Raises
    ------
    InputError, SimulationError
        As for `pmr.simulate.Simulator`.
    """
    march = _March(form, path, loads, stepping, None)
    chosen = np.arange(len(form.body.outputs)) if outputs is None else np.asarray(outputs, dtype=np.int64)
    tables = march_system.outputs(form.body, chosen)
    count = stepping.steps // every + 1
    y, multipliers = np.empty((count, len(chosen))), np.empty((count, len(form.body.row_names)))
    multipliers[0] = march.state.multipliers
    y[0] = displacement(form.body, march.start[:1], march.s[:1], multipliers[:1], march.f[:1])[0, chosen]

    def steps(first: int, last: int) -> tuple[int, int]:
        kept = slice((first - 1) // every + 1, (last - 1) // every + 1)
        arrays = march.s[first:last], march.f[first:last], every, y[kept], multipliers[kept]
        return kernel.run_observed(march.system, march.scheme, tables, march.state, *arrays)

    seconds = march.advance(steps, every, None)
    march.check_finite(y)
    return Observation(stepping.times[::every][:count], y, multipliers, seconds)


class _March:
    """One simulation: system, state, path and loads on the time grid."""

    def __init__(
        self, form: ModalForm, path: SignalBase, loads: Loads, stepping: TimeStepping, initial: InitialState | None
    ) -> None:
        body = form.body
        self.body, self.step = body, stepping.step
        self.s = path_at(path, body.domain, stepping.times)
        self.f = loads_at(one_for_each(loads, body.input_names), stepping.times)
        check_stable(body, self.s, stepping.rho_inf)
        method = GeneralizedAlpha(stepping.step, stepping.rho_inf)
        self.scheme = method.scheme()
        self.system = march_system.system(form, self.scheme)
        self.state = starting_state(form, method, self.s[0], float(path.rate(0.0)), self.f[0], initial)

    @property
    def start(self) -> Array:
        """Where the march stands: z and v (2, r)."""
        return self.state.modes[[Z, V], : self.body.size]

    def advance(self, steps: Callable[[int, int], tuple[int, int]], multiple: int, progress: Progress | None) -> float:
        """Take all steps, in blocks of a whole number of `multiple`; the seconds it took."""
        T, seconds = len(self.s), 0.0
        block = max(1, BLOCK // multiple) * multiple
        steps(1, 1)  # none: what is compiled or loaded for the first time is not the solver's time
        for first in range(1, T, block):
            last = min(first + block, T)
            begin = time.perf_counter()
            taken, failed = steps(first, last)
            seconds += time.perf_counter() - begin
            if failed:
                k = first + taken
                why = reason(self.body, float(self.s[k]), failed)
                raise SimulationError(f"march failed at {_where(self.s, k, self.step)}: {why}")
            if progress is not None:
                progress((last - 1) / (T - 1))
        return seconds

    def check_finite(self, kept: Array) -> None:
        """Raise SimulationError at the first row of `kept` that is not finite."""
        finite = np.isfinite(kept).all(axis=1)
        if not finite.all():
            k = int(np.argmin(finite)) * ((len(self.s) - 1) // max(1, len(kept) - 1))
            raise SimulationError(f"march failed at {_where(self.s, k, self.step)}: not finite")


def _where(s: Array, k: int, step: float) -> str:
    return f"step {k}, t = {k * step:g} s, slider at {s[k]:g} m"
