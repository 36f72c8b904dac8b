"""Loads that limits allow in one posture and load case."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pmr.files.arrays import Array
from pmr.simulation.statics.loaded import LoadedState, LoadedStates, LoadedStructure
from pmr.simulation.statics.postures import HOOK, PostureMatrices
from pmr.studies.limits import Limit, Share

#: Function from loads in kg to the shares of a limit that they use; infinite where there is no stable equilibrium.
UsedShares = Callable[[Sequence[float]], list[float]]
#: A load in kg, and the used share of a limit minus 1.
Point = tuple[float, float]

#: Number of loads at which the share is computed first.
NODES = 9
#: Loads that are tried close to an expected one, as shares of it.
FACTORS_AROUND_GUESS = (0.99, 0.998, 1.0, 1.002, 1.01)
#: Allowed error of a load over the largest load, and over the load itself; round-off in the distance of a share from 1.
TOP_TOLERANCE, LOAD_TOLERANCE, SHARE_TOLERANCE = 1e-12, 1e-13, 1e-13
#: Most points of an interpolating polynomial, and the factor on its last change that is taken as its error.
POINTS, DOUBT = 5, 2.0


def first_load(
    used: UsedShares, top: float, *, grows: bool = False, guess: float = np.nan, at_once: bool = True
) -> float:
    """Return the least load in kg in (0, top] at which the used share of a limit, by the function `used`, reaches 1.

    The result is 0 if the share is 1 or more without a load, and NaN if the share is below 1 at all loads tried.

    `guess` is a load in kg close to the expected result, or NaN. Loads around the guess are tried first.  If the share
    is below 1 at the least of these loads and not at the largest, the result is searched between them.

    If this fails, other loads are tried.  `grows` says that the share never falls while the load grows; then 0 and
    `top` are enough.  Otherwise, `NODES` evenly spaced loads are tried: all together if `at_once` is true, and one
    after the other if it is false.
    """
    if 0.0 < guess < top:
        points = _share_points(used, dict.fromkeys(min(guess * factor, top) for factor in FACTORS_AROUND_GUESS))
        if points[0][1] < 0.0 <= points[-1][1]:
            return _find_root(used, points, TOP_TOLERANCE * top)
    loads = [0.0, top] if grows else np.linspace(0.0, top, NODES).tolist()
    points = []
    for some in [loads] if at_once else [[load] for load in loads]:
        points += _share_points(used, some)
        if points[0][1] >= 0.0:
            return 0.0
        if any(excess >= 0.0 for _, excess in points):
            return _find_root(used, points, TOP_TOLERANCE * top)
    return np.nan


def _share_points(used: UsedShares, loads: Iterable[float]) -> list[Point]:
    """Return a point (load, share - 1) for each of the `loads` in kg, with the shares from the function `used`."""
    return [(load, share - 1.0) for load, share in zip(loads, used([*loads]), strict=True)]


def _find_root(used: UsedShares, points: list[Point], tolerance: float) -> float:
    """Return the first load in kg between `points` at which the share is 1.

    Each of the `points` is a load in kg and its share minus 1.  They ascend by load.  The share of the first one is
    below 1, that of a later one 1 or more; it may be infinite.  The function `used` gives shares at further loads.

    Two loads enclose the root.  The search ends when they differ by at most 2 (`tolerance` + `LOAD_TOLERANCE` times the
    upper load), or when the share at one of them is within `SHARE_TOLERANCE` of 1.  The load whose share is nearer to 1
    is returned, so that its share may be slightly above 1.

    The method is inverse interpolation: the load is a polynomial in share - 1, and the polynomial of one degree less
    gives an estimate of its error.  If a step does not at least halve the interval around the root, the quarters of the
    interval are tried as well.
    """
    before = np.inf
    while True:
        k = next(i for i, (_, excess) in enumerate(points) if excess >= 0.0)
        (low, below), (high, above) = points[k - 1], points[k]
        best, distance = (low, -below) if -below < above else (high, above)
        tolerance_here = tolerance + LOAD_TOLERANCE * high
        if high - low <= 2.0 * tolerance_here or distance <= SHARE_TOLERANCE:
            return best
        load, error = _interpolate_load(points, k)
        error = max(DOUBT * error, tolerance_here)
        trial_loads = {load - error, load, load + error}
        if not (low < load < high and error < (high - low) / 8.0) or high - low > before / 2.0:
            trial_loads |= {low + share * (high - low) for share in (0.25, 0.5, 0.75)}
        trial_loads = {candidate for candidate in trial_loads if low < candidate < high}
        if not trial_loads:
            return best
        before = high - low
        points = sorted([*points, *_share_points(used, sorted(trial_loads))])


class RootEstimate(NamedTuple):
    """Load in kg at which an interpolating polynomial has the share 1, and its change by the highest degree in kg."""

    load: float
    change: float


def _interpolate_load(points: Sequence[Point], k: int) -> RootEstimate:
    """Return the load in kg at which a polynomial through points near the k-th has share 1, and its last change.

    The `points` ascend by load; the k-th is the first with a share of 1 or more.  The load is a polynomial in share - 1
    through at most `POINTS` points along which the share increases, evaluated by Neville's scheme.  The last change is
    the difference from the value of the polynomial of one degree less.  Both numbers are NaN if the share of the k-th
    point is infinite.
    """
    if points[k][1] == np.inf:
        return RootEstimate(np.nan, np.nan)
    first, last = k - 1, k
    while last - first + 1 < POINTS:
        lower = first > 0 and points[first - 1][1] < points[first][1]
        higher = last + 1 < len(points) and points[last][1] < points[last + 1][1] < np.inf
        if not lower and not higher:
            break
        if lower and not (higher and points[last + 1][1] < -points[first - 1][1]):
            first -= 1
        else:
            last += 1
    loads, excesses = [load for load, _ in points[first : last + 1]], [excess for _, excess in points[first : last + 1]]
    root, change = loads[0], np.inf
    for degree in range(1, len(loads)):
        loads = [
            (excesses[i + degree] * loads[i] - excesses[i] * loads[i + 1]) / (excesses[i + degree] - excesses[i])
            for i in range(len(loads) - 1)
        ]
        root, change = loads[0], abs(loads[0] - root)
    return RootEstimate(root, change)


#: (3 / 2)^2 / 2: half the square of 3 / 2, the ratio of a cantilever's slope at the tip to its deflection over length.
ROTATION_FACTOR = 1.125
#: Share of a limit used without the load is taken as at most this when the error by large rotations is computed.
MOST_UNLOADED = 0.99
#: Share by which a load is reduced to be just below the load of a limit.
JUST_BELOW = 1e-6


@dataclass(frozen=True)
class Place:
    """A boom in one posture, the `k`-th of `postures`, and in one load case.

    `amounts` holds one number for each of ``postures.loads``: the factors on the weights of boom and machine and on the
    load that is searched for, and the scene's other loads in their own units, such as N.
    """

    postures: PostureMatrices
    k: int
    amounts: Sequence[float]
    gravity: float  # m/s^2

    @cached_property
    def equilibria(self) -> LoadedStructure:
        """Equilibria of the boom in this posture and load case, as a function of the load in kg."""
        named = dict(zip(self.postures.loads.names, self.amounts, strict=True))
        return LoadedStructure(self.postures.equations(self.k, named, named[HOOK]))

    def share(self, limit: Limit) -> Share:
        """Return the function from p states to the used shares (p,) of `limit` in this posture and load case."""
        return limit.share(self.postures, self.k, self.amounts)

    def used_share(self, limit: Limit, state: LoadedState) -> float:
        """Return the share of `limit` that the boom uses in one equilibrium state."""
        return float(self.share(limit)(LoadedStates.from_states([state]))[0])

    def allowed_load(self, limit: Limit, top: float, guess: float) -> float:
        """Return the least load in kg at which `limit` is reached; 0 if it is reached or exceeded without a load.

        The result is NaN if no load up to `top` in kg reaches the limit.  `guess` is a load in kg near which the result
        is expected, or NaN.
        """
        loaded = self.equilibria
        eigenvalue = limit.kind.eigenvalue
        if eigenvalue is not None and (loaded.holds_both_ways or eigenvalue.all_closed):
            direct = eigenvalue.load(loaded.equations.all_closed, limit.allowed_amount)
            return direct if direct <= top else np.nan
        used, at_once = _used_shares(loaded, self.share(limit)), loaded.holds_both_ways
        return first_load(used, top, grows=limit.kind.grows, guess=guess, at_once=at_once)


def allowed_loads(limits: Sequence[Limit], place: Place, up_to: float, guesses: Array | None = None) -> Array:
    """Return the load (l,) in kg that each of `limits` and, last, stability allow at a place.

    A place is a posture and a load case.  The load is 0 for a limit that is exceeded by the boom alone, without a load.
    It is NaN if no load up to `up_to` in kg reaches the limit, or if the boom has no stable equilibrium just below the
    load of the limit.  All loads are 0 if the boom alone is unstable.  `guesses` (l,) are loads in kg that another
    model allows, near which the searches begin.  Entries without a guess are NaN; None stands for no guesses.
    """
    loaded, near_loads = place.equilibria, np.full(len(limits) + 1, np.nan) if guesses is None else guesses
    first = loaded.state(0.0)
    loads = np.zeros(len(limits) + 1)
    top = min(up_to, first.form.critical * (1.0 - 1e-9)) if loaded.holds_both_ways else up_to
    if first.in_equilibrium:
        loads[:-1] = [place.allowed_load(limit, top, guess) for limit, guess in zip(limits, near_loads, strict=False)]
        reached = np.flatnonzero(loads[:-1] > 0.0)
        stable = loaded.states((loads[reached] * (1.0 - JUST_BELOW)).tolist()).in_equilibrium
        loads[reached[~stable]] = np.nan
    loads[-1] = _stability_load(loaded, up_to)
    return loads


def large_rotation_changes(limits: Sequence[Limit], place: Place, loads: Array, reach: float) -> Array:
    r"""Return the change (l,) in kg of the `loads` (l,) in kg that `limits` allow at a place, by large rotations.

    A tip that is displaced by w across a boom of length l (`reach` in m) is inclined by :math:`\theta \approx 3 w / 2
    l`.  Projections that the theory of second order takes as 1 are then :math:`1 - \theta^2 / 2`.  With the share
    :math:`u_0` of a limit that is used without a load, its allowed load P changes by :math:`\tfrac98 (w / l)^2 P / (1 -
    u_0)`.  For a limit on overturning, :math:`P / (1 - u_0)` is replaced by `TippingMoments.overturning_load`.

    The changes are magnitudes.  The change of a load of 0 or NaN is 0.  The last entry, of stability, is 0, too: how
    large rotations change the load at which stability is lost is not known.  The share u_0 counts as at most
    `MOST_UNLOADED`.
    """
    changes, tip = (np.zeros(len(loads)), [n for n, kind in enumerate(place.postures.output_kinds) if kind == "tip"])
    unloaded = place.equilibria.states([0.0])
    for n, (limit, load) in enumerate(zip(limits, loads.tolist(), strict=False)):
        if not load > 0.0 or not (state := place.equilibria.states([load])).in_equilibrium[0]:
            continue
        share = ROTATION_FACTOR * float(np.sum(state.outputs[0, tip] ** 2)) / reach**2
        if limit.of == "overturning":
            changes[n] = share * limit.tipping_moments(place.postures, place.k, place.amounts).overturning_load(
                state, limit.factor
            )
        else:
            used_unloaded = float(place.share(limit)(unloaded)[0])
            changes[n] = load * share / (1.0 - min(used_unloaded, MOST_UNLOADED))
    return changes


def _used_shares(loaded: LoadedStructure, share: Share) -> UsedShares:
    """Return the function from p loads in kg on a boom to the p shares of a limit that the loads use.

    A share is infinite under a load at which the boom has no equilibrium.
    """

    def used(loads: Sequence[float]) -> list[float]:
        """Return the used share under each of `loads` in kg; infinite where the boom has no equilibrium."""
        states = loaded.states(loads)
        shares, stands = np.full(len(loads), np.inf), states.in_equilibrium
        if stands.any():
            shares[stands] = share(states.select(stands))
        return shares.tolist()

    return used


def _stability_load(loaded: LoadedStructure, up_to: float) -> float:
    """Return the least load in kg under which the boom has no stable equilibrium; NaN for one above `up_to` in kg."""
    if loaded.holds_both_ways:
        critical = loaded.state(0.0).form.critical
        return critical if critical <= up_to else np.nan
    return first_load(_used_shares(loaded, _buckling_share), up_to, at_once=False)


def _buckling_share(states: LoadedStates) -> Array:
    """Return the shares (p,): the load of each of p states divided by the buckling load of this state.

    The buckling load of a state is that of the boom with the contacts that are closed in this state.
    """
    return states.load / np.array([form.critical for form in states.forms])
