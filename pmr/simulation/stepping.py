r"""Time grid of a simulation, its steps block by block, and checks of what steps resolve: signals, and the energy.

A simulator evaluates its signals at the steps only.  A tone of frequency f, sampled with the step h, looks like a tone
of the frequency :math:`|f - k / h|` with the whole number k that makes this smallest (Nyquist, Shannon); if f is below
1 / (2 h), this is f itself.  Between two samples the tone exceeds both samples by up to :math:`A (1 - \cos \pi f h)`,
with its amplitude A.  Breaks of a signal are checked one by one.

A simulation hands over its steps in blocks, so that the coordinates of all steps need not be stored.

In a simulated motion a rise of the energy that neither loads nor moving rows put in is an error:

.. math::
    \frac{d}{dt} \Big( \tfrac12 \dot q^T M \dot q + \tfrac12 q^T K q + \tfrac12 \lambda^T k^{-1} \lambda \Big)
    = f^T \frac{d}{dt} (B^T q) + \dot s\, \lambda^T C' q - \dot q^T D \dot q

with coordinates q, matrices M, D and K, loads f on inputs B, contact forces :math:`\lambda`, stiffness k and rows C of
the contacts, whose derivative by the path s is C' (docs/moving_residual_flexibility.md, section 6, has the balance with
the residual flexibility).  Damping, and generalized-alpha with rho_inf < 1, only take energy, so that energy minus work
may fall but not rise.  The works of loads and moving rows in a step follow from the mean values over the step (marked
by a bar) and the changes (:math:`\Delta`) of loads f, contact forces, rows C, their displacements H by loads and their
flexibility G:

.. math::
    \Delta W = \bar f^T \Delta (B^T q)
    + \bar \lambda^T (\Delta C\, \bar q + \Delta H\, \bar f - \tfrac12 \Delta G\, \bar \lambda)

A contact force that changes its sign with every step does no work in this sum.  The forces of rigid rows that move grow
in this way at index 3 (docs/time_integration.md); the energy that such a motion gains is a surplus.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from pmr.errors import GrowthError, InputError, two_digits, two_digits_below
from pmr.files.arrays import Array, Indices
from pmr.scene.signals import SignalBase, Table
from pmr.system.body import SlidingBody, Trajectory
from pmr.system.states import SystemTrajectory

#: Function that is called with the share of the time span, 0 to 1, that is done.
Progress = Callable[[float], None]


@dataclass(frozen=True)
class TimeStepping:
    """Time grid t_k = k step, k = 0 ... steps, and settings for generalized-alpha at index 3.

    Attributes
    ----------
    end : float, s
        A whole number of steps.
    step : float, s
    rho_inf : float
        Spectral radius at infinite frequency: 1 keeps all energy, 0 removes the highest frequencies at once.
    parts : int
        Number of equal parts into which each step is divided if contacts only push.  With 0, the default, a step has
        the number of parts that these contacts need (`pmr.simulation.contact_step`).  Without such contacts a step is
        not divided.
    schedule : tuple of int
        Number of parts of each step, used instead of `parts`.  The numbers are powers of two that another simulation
        has chosen.

    Raises
    ------
    InputError
        If the values do not make up a time grid.
    """

    end: float
    step: float
    rho_inf: float = 0.9
    parts: int = 0
    schedule: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 < self.step <= self.end:
            allowed = f"more than 0 and at most end = {self.end:g} s is allowed"
            raise InputError("scene", "time.step", self.step, allowed)
        if abs(self.steps * self.step - self.end) > 1e-9 * self.end:
            allowed = f"a whole number of steps must make up end = {self.end:g} s"
            raise InputError("scene", "time.step", self.step, allowed)
        if not 0.0 <= self.rho_inf <= 1.0:
            raise InputError("scene", "time.rho_inf", self.rho_inf, "0 to 1 is allowed")
        if self.parts < 0:
            raise InputError("scene", "time.parts", self.parts, "0 or more is allowed")

    @property
    def steps(self) -> int:
        """Number of steps."""
        return round(self.end / self.step)

    def divide(self, parts: int) -> TimeStepping:
        """Time grid with `parts` equal steps, which are not divided further, in each step of this grid.

        For `parts` = 1 it is this grid itself, with its own `parts` and `schedule`.
        """
        return self if parts == 1 else TimeStepping(self.end, self.end / (self.steps * parts), self.rho_inf, 1)

    @property
    def times(self) -> Array:
        """Times (steps + 1,) in s of the steps, t = 0 included."""
        return np.arange(self.steps + 1) * self.step


#: Share of a signal's range by which the signal may exceed, between two steps, its values at the steps.
UNSEEN = 0.05
#: Least number n of steps in a period with which a tone satisfies `UNSEEN`: (1 - cos(pi / n)) / 2 < `UNSEEN`.
STEPS_A_PERIOD = 7


def describe_lost_features(signals: Sequence[tuple[str, SignalBase]], stepping: TimeStepping) -> list[str]:
    """Warnings about features of signals that the steps do not resolve, one line each; empty if nothing is lost.

    A feature is a tone that has too few steps in a period, or the course of a signal at a break between two steps.
    `signals` are pairs of a name and a signal, `stepping` is the time grid.  A line names the signals that lose the
    feature.  It leaves out signals that follow from other signals.  If all signals that lose the feature follow from
    others, the line names the first and says how many more there are: ``inertia x and 3 more``.
    """
    names, derived = dict[str, list[str]](), dict[str, list[str]]()
    for name, signal in signals:
        for what in dict.fromkeys(_describe_losses(signal, stepping)):
            (derived if signal.signals else names).setdefault(what, []).append(name)
    more = {what: f" and {len(of) - 1} more" if len(of) > 1 else "" for what, of in derived.items()}
    first = {what: [f"{of[0]}{more[what]}"] for what, of in derived.items()}
    return [f"{', '.join(of)}: {what}" for what, of in (first | names).items()]


def describe_overshoots(signals: Sequence[tuple[str, SignalBase]], stepping: TimeStepping) -> list[str]:
    """Warnings, one line for each table whose curve exceeds the table's values by more than `UNSEEN` of their range.

    `signals` are pairs of a name and a signal, which may have tables as parts.  Values after the end of the grid
    `stepping` do not count.
    """
    return [
        f"{name}: {what}"
        for name, signal in signals
        for part in signal.parts
        if isinstance(part, Table)
        for what in _describe_table_overshoot(part, stepping)
    ]


def is_aliased(signal: SignalBase, stepping: TimeStepping) -> bool:
    """Whether the signal has a tone of at least half the sampling rate, which looks slower at the steps."""
    return 2.0 * signal.highest_frequency(0.0, stepping.end) * stepping.step >= 1.0


def _describe_losses(signal: SignalBase, stepping: TimeStepping) -> list[str]:
    """Lines of `_describe_loss` on the signals from which a signal follows; if there are none, on the signal itself."""
    of_causes = [line for cause in signal.signals for line in _describe_losses(cause, stepping)]
    return of_causes or list(_describe_loss(signal, stepping))


def _describe_loss(signal: SignalBase, stepping: TimeStepping) -> Iterator[str]:
    """Yield a line for each tone of a signal that is too fast for the steps, then one for its overshoot at breaks.

    The overshoot (`_overshoot`) has a line only if it exceeds the share `UNSEEN` of the signal's range.
    """
    h = stepping.step
    for part in signal.parts:
        f = part.highest_frequency(0.0, stepping.end)
        if f * h >= 0.5:
            apparent = abs(f - round(f * h) / h)
            at_rest = "stands still" if apparent < 1.0 / stepping.end else f"looks like {apparent:.4g} Hz"
            yield f"{f:.6g} Hz {at_rest} at steps of {h:.4g} s; {_describe_needed_step(f)}"
        elif (1.0 - np.cos(np.pi * f * h)) / 2.0 > UNSEEN:
            yield f"{f:.6g} Hz has {1.0 / (f * h):.2g} steps of {h:.4g} s a period; {_describe_needed_step(f)}"
    share, at = _overshoot(signal, stepping)
    if share > UNSEEN:
        yield (
            f"what it does about t = {at:.6g} s passes between two steps of {h:.4g} s, "
            f"{two_digits(100.0 * share)} % of its whole range; smaller steps resolve it"
        )


def _describe_table_overshoot(table: Table, stepping: TimeStepping) -> Iterator[str]:
    """Yield a line if the curve of a table exceeds the table's values by more than `UNSEEN` of their range."""
    knots = [0.0, *(t for t in table.times if 0.0 < t < stepping.end), stepping.end]
    values, (low, high) = table.value(knots), table.bounds(0.0, stepping.end)
    least, most = float(values.min()), float(values.max())
    beyond = max(least - low, high - most)
    if beyond > UNSEEN * (most - least):
        yield (
            f"the curve through its table ({table.interpolation}) goes from {low:.6g} to {high:.6g}, "
            f"{two_digits(100.0 * beyond / (most - least))} % of the table's range beyond it; interpolation = "
            "'linear', or more rows where it turns, keep to the table"
        )


def _describe_needed_step(f: float) -> str:
    """Text with the longest steps that resolve a tone of f Hz."""
    return f"steps of {two_digits_below(1.0 / (STEPS_A_PERIOD * f))} s or less follow it"


def _overshoot(signal: SignalBase, stepping: TimeStepping) -> list[float]:
    """Largest overshoot of a signal at a break beyond its values at the neighbouring steps, and the break's time in s.

    The overshoot is a share of the signal's whole range.  Both are 0 if the values beside the breaks show that this
    share is at most `UNSEEN`.
    """
    steps, h, breaks = stepping.steps, stepping.step, np.array(signal.breaks)
    breaks = breaks[(breaks > 0.0) & (breaks < stepping.end)]
    if not len(breaks):
        return [0.0, 0.0]
    x = breaks / h
    first, last = np.ceil(x - 1e-9) - 1.0, np.floor(x + 1e-9) + 1.0  # a break on a step lies between its neighbours
    neighbours = h * np.clip([first, np.clip(np.round(x), first, last), last], 0, steps)
    values = signal.value(np.vstack([neighbours, breaks, np.nextafter(breaks, -np.inf)]))
    around, at_breaks = values[:3], values[3:]
    beyond = np.maximum(at_breaks - around.max(axis=0), around.min(axis=0) - at_breaks).max(axis=0)
    worst = int(np.argmax(beyond))
    least = float(np.ptp(values))  # of the whole range, for which signals may be evaluated at thousands of times
    if beyond[worst] <= UNSEEN * least:
        return [0.0, 0.0]
    low, high = signal.bounds(0.0, stepping.end)
    return [float(beyond[worst]) / max(high - low, least), float(breaks[worst])]


@dataclass(frozen=True)
class SimulationEnd:
    """Results at the end of a simulation."""

    seconds: float  # wall time of the solver
    surplus: float  # energy that no work explains, over the largest energy


class Recorder:
    """Callable that takes consecutive steps of a run and records those with the ascending numbers `steps` (S,)."""

    def __init__(self, steps: Indices) -> None:
        """Begin without records of the `steps` (S,)."""
        self._steps = steps
        self._recorded: SystemTrajectory | None = None

    def __call__(self, first: int, part: SystemTrajectory) -> None:
        """Record the selected steps of `part`, a part of the trajectory that begins with the step number `first`.

        Arrays of a part that is the whole run are not copied.
        """
        low, high = np.searchsorted(self._steps, [first, first + len(part.t)])
        if high - low == len(part.t) == len(self._steps):
            self._recorded = part  # the whole run: no later steps take its arrays
            return
        if self._recorded is None:
            self._recorded = part.map_arrays(lambda array: np.empty((len(self._steps), *array.shape[1:]), array.dtype))
        rows = slice(None) if high - low == len(part.t) else self._steps[low:high] - first
        for stored, array in zip(self._recorded.arrays, part.arrays, strict=True):
            stored[low:high] = array[rows]

    def trajectory(self, ended: SimulationEnd) -> SystemTrajectory:
        """Trajectory of the recorded steps, with the solver's wall time and the surplus of energy from `ended`."""
        assert self._recorded is not None  # every simulation has at least one block
        return replace(self._recorded, seconds=ended.seconds, surplus=ended.surplus)


#: Surplus over the largest energy from which on a motion is not compared with others.  Sound motions that
#: their steps resolve stay below 0.03; the share follows the error of the velocities, which grow first.
NOTABLE = 0.1
#: Surplus from which on a motion is a growing error, no result.  Sound motions reach 0.4 with three steps a period.
GROWN = 0.9
#: Share of an energy that counts as zero: for motions 1e-6 times as large as a free body's, as with a slider at a load.
ROUND_OFF = 1e-12
#: Steps that are evaluated at once, so that memory stays small.
BLOCK = 4096


def load_potential(body: SlidingBody, trajectory: Trajectory, loads: Array) -> Array:
    """Potential energy (T,) in J of `loads` (T, i): minus the loads times the displacements of their points.

    `trajectory` has the body's coordinates and contact forces.  Without residual flexibility the energy is -q^T B f,
    with coordinates q and input matrix B (Weyrer et al., equation for H(t)).
    """
    motion = np.asarray(trajectory.q @ body.B)
    if body.flexibility is not None:
        motion = motion + body.flexibility.input_motion(trajectory.s, trajectory.multipliers, loads)
    return -row_products(motion, loads)


def energy_surplus(stored: Array, work: Array, least: float = 0.0, since_start: bool = False) -> float:
    """Largest rise of energy minus work, divided by the largest energy.

    The result is from 0 to slightly more than 1, and infinite if the energy overflows.

    Parameters
    ----------
    stored : (T,) array, J
        Kinetic and strain energy.
    work : (T,) array, J
        Work done on the body since t = 0.
    least : float, J
        If the energy never exceeds this, it is round-off and the surplus is 0.
    since_start : bool
        Whether the rise is measured from the first step instead of from the lowest value before.  Set it if contacts
        open and close between steps, because they lose energy and gain it back.
    """
    if not (np.isfinite(stored).all() and np.isfinite(work).all()):
        return np.inf
    excess, largest = stored - stored[0] - work, float(stored.max(initial=0.0))
    rise = excess if since_start else excess - np.minimum.accumulate(excess)
    return float(rise.max(initial=0.0)) / largest if largest > least else 0.0


def energy_round_off(mobility: Array, loads: Array, step: float) -> float:
    """Energy in J that counts as zero: a share of the most that `loads` (T, i) can give a free body in one step.

    They give the most if all act with their largest size at the same time and help each other.  `mobility` is
    B^T diag(M)^-1 B, (i, i) in 1/kg; `step` is in s.
    """
    largest = np.array([np.abs(load).max(initial=0.0) for load in loads.T])  # column by column: rows are too short
    return ROUND_OFF * float(largest @ np.abs(mobility) @ largest) * step**2 / 2.0


def refuse_growth(surplus: float, moving: list[str]) -> None:
    """Raise GrowthError if `surplus` exceeds `GROWN`; `moving` holds the names of the rigid rows that move."""
    if surplus > GROWN:
        line = f"the motion grows without bound, {describe_surplus(surplus)}{describe_remedy(moving)}"
        raise GrowthError(line, tuple(moving))


def describe_surplus(surplus: float) -> str:
    """Clause that states a surplus of energy, in per cent of the largest energy and 100 % at most, or an overflow."""
    if surplus == np.inf:
        return "its energy overflows"
    return f"{100.0 * min(surplus, 1.0):.3g} % of its largest energy was put in by neither loads nor moving rows"


def describe_remedy(moving: list[str]) -> str:
    """Text with remedies against a growing motion; `moving` holds the names of the rigid rows that move."""
    if not moving:
        return "; a smaller step or a smaller time.rho_inf helps"
    return (
        f"; the rigid row {', '.join(moving)} moves, and its multiplier (index 3) grows where time.rho_inf is near 1 "
        "or the path fast: a smaller time.rho_inf, pads that give way or a residual flexibility help, smaller steps "
        "need not"
    )


def half_form(A: Array | sp.csr_matrix, x: Array) -> Array:
    """Values x^T A x / 2 (T,), with A (n, n), for each row of x (T, n)."""
    if not sp.issparse(A) and not np.any(A - np.diag(np.diagonal(A))):
        return np.asarray(x**2 @ np.diagonal(A)) / 2.0  # A is diagonal in modal coordinates
    return row_products((A @ x.T).T, x) / 2.0


def row_products(a: Array, b: Array) -> Array:
    """Scalar products (T,) of the rows of a and b (T, n)."""
    return np.asarray(np.einsum("tn,tn->t", a, b))


def step_means(values: Array) -> Array:
    """Means (T - 1, ...) over the two ends of each step, of values (T, ...) at the ends of steps."""
    return np.asarray(values[1:] + values[:-1]) / 2.0
