r"""Position of a slider that nobody measures, from an acceleration: a bank of models over the places of a path.

.. math::
    \dot x = \begin{bmatrix} 0 & w I \\ -M^{-1} K(s) / w & -M^{-1} D(s) \end{bmatrix} x, \qquad y = b(s)\,\ddot z,
    \qquad x = (w z, \dot z), \quad M = 1 + m\, b\, b^T

with modal coordinates z, the shape b of the modes at the sensor, and its mass m.  States mean the same at all places.
The bank (`src/bank.c`) has a Kalman filter with stationary gain for each place and each speed along the path.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.kernel.kernel import Bank, advance_bank

if TYPE_CHECKING:
    from pmr.export.state_space import StateSpace

#: w in rad/s: parts of a state have one size at 100 Hz.
SCALE = 2.0 * np.pi * 100.0
#: Points in a step at which noise of accelerations is added up.
POINTS = 8


@dataclass(frozen=True)
class PlaceModels:
    """Models for steps of constant length at S places of a path, with n = 2 m states and o further outputs.

    The m modes are the r modes of the body, and then further modes, such as those of the ground, which are the same at
    all places.
    """

    step: float  # s
    places: Array  # (S,) m
    frequencies: Array  # (S, r) Hz: of the body
    F: Array  # (S, n, n): transition from the state of a step to that of the next one
    H: Array  # (S, n): acceleration at the sensor by the state
    noise: Array  # (S, m, n, n): covariance of a step, for unit noise of each mode's acceleration at the sensor
    rows: Array  # (S, o, n): further outputs, such as displacements


class SensorModes(NamedTuple):
    """Modes of a body with a sensor mounted at each of S places of a path.

    The frequencies of each place ascend.  The mass includes that of the sensor.
    """

    frequencies: Array  # (S, r) Hz
    modes: Array  # (S, r, r): columns, orthonormal in the mass, on the modes without the sensor
    shapes: Array  # (S, r): b, displacement at the sensor by each mode without the sensor


def sensor_modes(space: StateSpace, load: str, mass: float) -> SensorModes:
    """Modes of the body of a state space at each of its places, with a sensor of `mass` kg where the load `load` acts.

    Raises InputError if the state space has no such load.
    """
    if load not in space.inputs:
        raise InputError("observe", "load", load, f"one of these is allowed: {', '.join(space.inputs)}")
    r = space.A.shape[1] // 2
    shapes = space.B[:, r:, space.inputs.index(load)]
    frequencies, modes = np.zeros((len(shapes), r)), np.zeros((len(shapes), r, r))
    for k, (A, b) in enumerate(zip(space.A, shapes, strict=True)):
        squares, modes[k] = scipy.linalg.eigh(-A[r:, :r], np.eye(r) + mass * np.outer(b, b))
        frequencies[k] = np.sqrt(np.abs(squares)) / (2.0 * np.pi)
    return SensorModes(frequencies, modes, shapes)


def place_models(
    space: StateSpace,
    load: str,
    step: float,
    damping: ArrayLike,
    mass: float = 0.0,
    measured: Mapping[float, Sequence[float]] | None = None,
    rows: Sequence[ArrayLike] = (),
    fixed: Mapping[float, float] | None = None,
) -> PlaceModels:
    """Return the models at all places of a state space with one path, for an accelerometer at the point of a load.

    Parameters
    ----------
    space : StateSpace
        State space over the places (`pmr.export.state_space`).
    load : str
        Load at the place and in the direction of the accelerometer.
    step : float, s
        Time step of the models.
    damping : (r,) or (S, r) array
        Damping ratios of the modes.
    mass : float, kg
        Mass of the sensor in addition to that of the model.
    measured : mapping, optional
        Frequencies in Hz, lowest first, by the place in m at which they were measured.  The model's frequencies are
        multiplied by the ratio of measured to computed ones, which is interpolated linearly between these places and
        constant beyond them.  Modes that are not measured at every place keep the model's frequencies.
    rows : sequence of (q,) arrays
        Weights of the state space's outputs for each further output.
    fixed : mapping, optional
        Damping ratios by frequency in Hz of further modes that are the same at all places, such as those of the
        ground.  These modes only add to the acceleration.

    Raises
    ------
    InputError
        If the state space has another number of paths than one, or no such load; if damping does not fit its modes.
    """
    if len(space.paths) != 1:
        raise InputError("observe", "paths", ", ".join(space.paths), "one path is allowed")
    places, S, r = space.s[:, 0], len(space.A), space.A.shape[1] // 2
    try:
        ratios = np.broadcast_to(np.asarray(damping, float), (S, r))
    except ValueError:
        raise InputError("observe", "damping", np.shape(damping), f"{(r,)} or {(S, r)} is allowed") from None
    frequencies, modes, shapes = sensor_modes(space, load, mass)
    if measured:
        at = np.array(sorted(measured))
        for k in range(min(len(measured[place]) for place in measured)):
            target = np.array([measured[place][k] for place in at])
            frequencies[:, k] *= np.interp(places, at, target / np.interp(at, places, frequencies[:, k]))
    fixed = fixed or {}
    f, alone = len(fixed), np.eye(len(fixed))
    n, m = 2 * (r + f), r + f
    F, H, noise = np.zeros((S, n, n)), np.zeros((S, n)), np.zeros((S, m, n, n))
    for k in range(S):
        b, vectors = np.append(shapes[k], np.ones(f)), scipy.linalg.block_diag(modes[k], alone)
        omega, damped = 2.0 * np.pi * np.append(frequencies[k], [*fixed]), np.append(ratios[k], [*fixed.values()])
        M = scipy.linalg.block_diag(np.eye(r) + mass * np.outer(shapes[k], shapes[k]), alone)
        momenta, inverse = M @ vectors, np.linalg.inv(M)
        A = np.zeros((n, n))
        A[:m, m:] = SCALE * np.eye(m)
        A[m:, :m] = -inverse @ (momenta * omega**2) @ momenta.T / SCALE
        A[m:, m:] = -inverse @ (momenta * (2.0 * damped * omega)) @ momenta.T
        F[k], H[k] = scipy.linalg.expm(A * step), b @ A[m:]
        for j in range(m):
            push = np.concatenate([np.zeros(m), vectors[:, j] / (np.abs(b @ vectors[:, j]) * omega[j])])
            for point in range(POINTS):
                response = scipy.linalg.expm(A * step * (point + 0.5) / POINTS) @ push
                noise[k, j] += np.outer(response, response) / POINTS
    weights = np.array(rows, float).reshape(len(rows), len(space.outputs))
    further = np.zeros((S, len(rows), n))
    further[:, :, :r] = np.einsum("oq,sqr->sor", weights, space.C[:, :, :r]) / SCALE
    return PlaceModels(step, places, frequencies, F, H, noise, further)


class SlidingNoise(NamedTuple):
    """Relation of the speed v of a slider to the power P of the vibration that its motion excites.

    P, the `activity` of a `PositionObserver`, grows with the third power of v.  P has the likelihood ``exp(-trust / 2
    ln^2((P + rest) / (rest + moving |v|^3)))``.
    """

    moving: float = 1.0  # power at 1 m/s
    rest: float = 1e-6  # power at rest
    trust: float = 0.0  # 0: the power tells nothing of the speed

    def log_likelihoods(self, power: Array, speeds: Array) -> Array:
        """Logarithms (T, D) of the likelihoods of D speeds (D,) in m/s, at T steps with the vibration's power (T,)."""
        expected = self.rest + self.moving * np.abs(speeds) ** 3
        return np.asarray(-0.5 * self.trust * np.log((power[:, None] + self.rest) / expected) ** 2)


@dataclass(frozen=True)
class PositionSettings:
    """Random motion of a slider and of what excites the modes, found on measured series by workflows/dropbear.py."""

    mode_noise: tuple[float, ...] = (1.7e-5, 2.9e-3, 5.2e-3)  # (m,): of the modes, over that of the measurement
    speeds: tuple[float, ...] = (0.08,)  # m/s, in both directions beside rest
    turn: float = 0.01  # chance in a step that a speed changes to a neighbour
    start: float = 0.02  # the same at rest in motion, as `activity` tells; times `quiet` where nothing moves
    quiet: float = 0.02
    spread: float = 0.03  # chance in a step to be a place further than the speed says; a tenth of it at rest
    temper: float = 0.6  # exponent of likelihoods: errors of models are correlated in time
    attack: float = 0.39  # shares by which the level of innovations follows, up and down
    decay: float = 0.07
    floor: float = 1e-7  # least variance of innovations, (m/s^2)^2 or in the sensor's unit
    active: float = 1e-2  # `activity` at which the slider is as likely in motion as not
    share: float = 0.36  # least level over activity
    noise: SlidingNoise = SlidingNoise()  # what `activity` tells of the speed


class Band(NamedTuple):
    """Lower and upper end (T,) in m of a band of positions at T steps."""

    low: Array
    high: Array


@dataclass(frozen=True)
class Positions:
    """Estimated position at T steps as probabilities of S places, mean states, and outputs of the likeliest place."""

    places: Array  # (S,) m
    probability: Array  # (T, S)
    states: Array  # (T, n)
    level: Array  # (T,): variance of innovations over that of the filters
    outputs: Array  # (T, o)

    @property
    def mean(self) -> Array:
        """Mean (T,) in m of the position's probability distribution at each step."""
        return np.asarray(self.probability @ self.places)

    @property
    def deviation(self) -> Array:
        """Standard deviation (T,) of the position in m."""
        return np.sqrt(np.maximum(self.probability @ self.places**2 - self.mean**2, 0.0))

    def quantile(self, share: float) -> Array:
        """Position (T,) in m below which the true one is with the probability `share`.

        The probability of each place is spread evenly between the midpoints to its neighbours.
        """
        width = np.diff(self.places).mean()
        edges = np.append(self.places - 0.5 * width, self.places[-1] + 0.5 * width)
        sums = np.cumsum(np.column_stack([np.zeros(len(self.probability)), self.probability]), axis=1)
        at = np.minimum(np.sum(sums[:, 1:] < share, axis=1), len(self.places) - 1)
        steps = np.arange(len(sums))
        within = (share - sums[steps, at]) / np.maximum(self.probability[steps, at], 1e-300)
        return np.asarray(edges[at] + width * np.clip(within, 0.0, 1.0))

    def band(self, share: float = 0.9) -> Band:
        """Band, at each of T steps, that holds the true position with the probability `share`."""
        return Band(self.quantile(0.5 - 0.5 * share), self.quantile(0.5 + 0.5 * share))


@dataclass(frozen=True)
class PositionObserver:
    """Observer of a position from one acceleration.

    Attributes
    ----------
    models : PlaceModels
        Their places are evenly spaced.
    settings : PositionSettings

    Raises
    ------
    InputError
        If places are not evenly spaced, a speed passes more than half a place in a step, `mode_noise` has not one
        number for each mode, or a number of `noise` is not allowed.
    """

    models: PlaceModels
    settings: PositionSettings = field(default_factory=PositionSettings)

    def __post_init__(self) -> None:
        gaps = np.diff(self.models.places)
        if len(gaps) < 2 or np.ptp(gaps) > 1e-6 * gaps.mean():
            raise InputError("observe", "places", len(gaps) + 1, "three places or more, evenly spaced, are allowed")
        speeds, most = self.settings.speeds, 0.5 * gaps.mean() / self.models.step
        if not speeds or not all(0.0 < speed <= most for speed in speeds):
            allowed = f"one speed or more, above 0 and at most {most:g} m/s, is allowed"
            raise InputError("observe", "speeds", speeds, allowed)
        if len(self.settings.mode_noise) != self.models.noise.shape[1]:
            allowed = f"one number for each of {self.models.noise.shape[1]} modes is allowed"
            raise InputError("observe", "mode_noise", self.settings.mode_noise, allowed)
        noise = self.settings.noise
        if not (noise.rest > 0.0 and noise.moving > 0.0 and noise.trust >= 0.0):
            allowed = "rest and moving above 0 and trust from 0 on are allowed"
            raise InputError("observe", "noise", tuple(noise), allowed)

    @property
    def speeds(self) -> Array:
        """Speeds (D,) in m/s of the filters, in ascending order with rest in the middle."""
        fast = np.sort(self.settings.speeds)
        return np.concatenate([-fast[::-1], [0.0], fast])

    def bank(self) -> Bank:
        """Compute the bank of Kalman filters for the kernel: one with stationary gain for each place and each speed."""
        models, settings = self.models, self.settings
        S, n = models.H.shape
        speeds = self.speeds * models.step / np.diff(models.places).mean()
        gain, variance = np.zeros((S, n)), np.zeros(S)
        for k in range(S):
            Q = np.einsum("j,jab->ab", settings.mode_noise, models.noise[k]) + 1e-12 * np.eye(n)
            P = scipy.linalg.solve_discrete_are(models.F[k].T, models.H[k][:, None], Q, np.eye(1))
            variance[k] = models.H[k] @ P @ models.H[k] + 1.0
            gain[k] = P @ models.H[k] / variance[k]
        spread = np.where(speeds == 0.0, 0.1, 1.0) * settings.spread
        up, down = np.maximum(speeds, 0.0) + spread, np.maximum(-speeds, 0.0) + spread
        at_rest, in_motion = (
            self._changes(len(speeds), start) for start in (settings.start * settings.quiet, settings.start)
        )
        return Bank(
            models.F, models.H, gain, variance, up, down, at_rest, in_motion,
            {of: getattr(settings, of) for of in ("temper", "attack", "decay", "floor")},
        )  # fmt: skip

    def _changes(self, count: int, start: float) -> Array:
        """Transition matrix (D, D) of a step between D = `count` speeds, in ascending order with rest in the middle.

        Entry (d, e) is the chance to change from speed d to speed e; each row adds up to 1.  The chance to change from
        rest is `start`, from any other speed the setting `turn`; neighbouring speeds share it equally.
        """
        W = np.zeros((count, count))
        for d in range(count):
            neighbours = [e for e in (d - 1, d + 1) if 0 <= e < count]
            W[d, neighbours] = (start if d == count // 2 else self.settings.turn) / len(neighbours)
            W[d, d] = 1.0 - W[d].sum()
        return W

    def run(self, acceleration: ArrayLike, activity: ArrayLike = 0.0, delay: float = 0.0) -> Positions:
        """Estimate the position at T steps from accelerations (T,) in m/s^2 at the sensor, NaN where none was measured.

        A position follows from the accelerations up to `delay` s later; `math.inf` stands for all of the record.

        `activity` (T,), or one number for all steps, is the power of vibrations that only a slider in motion excites,
        such as those above the modes' frequencies.  The power has the unit of `active` and `noise` of the settings.

        Raises InputError for arrays of other shapes, for an activity that is not finite or below 0, and for a delay
        below 0.
        """
        y = np.ascontiguousarray(acceleration, float)
        if y.ndim != 1:
            raise InputError("observe", "acceleration", y.shape, "(T,) is allowed")
        if not delay >= 0.0:
            raise InputError("observe", "delay", delay, "0 s or more is allowed")
        later = round(min(delay / self.models.step, len(y)))
        power = np.asarray(activity, float)
        if power.shape not in {(), y.shape} or not np.all(np.isfinite(power) & (power >= 0.0)):
            allowed = f"finite numbers of 0 or more, {y.shape} or a single one, are allowed"
            raise InputError("observe", "activity", power.shape, allowed)
        power = np.ascontiguousarray(np.broadcast_to(power, y.shape))
        settings, models = self.settings, self.models
        in_motion, least = power / (power + settings.active), settings.share * power
        likelihoods = settings.noise.log_likelihoods(power, self.speeds)
        record = advance_bank(self.bank(), y, in_motion, least, likelihoods, later)
        likely = np.argmax(record.probability, axis=1)
        outputs = np.einsum("ton,tn->to", models.rows[likely], record.states)
        return Positions(models.places, record.probability, record.states, record.level, outputs)
