"""Loads that limits allow at one place, by searches side by side: states that several ask for are computed once."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.statics.loaded import Loaded, State, States
from pmr.simulation.statics.postures import HOOK, Postures
from pmr.studies.limits import Limit, Share

Array = NDArray[np.float64]
#: Asks for the shares of a limit that some loads use, and then of others, and returns the load that reaches it.
Search = Generator[tuple[float, ...], Sequence[float], float | None]
Key = TypeVar("Key")
#: A load, and what it uses less all of it.
Point = tuple[float, float]

#: Loads at which is looked whether a limit is passed.
NODES = 9
#: Where is looked beside a load that is known nearly, as shares of it.
BESIDE = (0.99, 0.998, 1.0, 1.002, 1.01)
#: How far off a load may be, as a share of the largest and of itself, and what is left of a limit that is round-off.
OF_TOP, OF_LOAD, NOTHING = 1e-12, 1e-13, 1e-13
#: Points of which a curve is made at most, and how many times its last change is taken as its error.
POINTS, DOUBT = 5, 2.0


def run_searches(loaded: Loaded, searches: Mapping[Key, tuple[Share, Search]]) -> dict[Key, float | None]:
    """Result of each search over equilibria at one place; used shares are infinite where nothing stands."""
    results, requests = dict[Key, float | None](), {key: next(search) for key, (_, search) in searches.items()}
    while requests:
        groups = list(dict.fromkeys(requests.values()))  # several may ask for the same
        every = loaded.states([load for loads in groups for load in loads])
        states = dict(zip(groups, every.split(map(len, groups)), strict=True))
        following = dict[Key, tuple[float, ...]]()
        for key, loads in requests.items():
            share, search = searches[key]
            try:
                following[key] = search.send(_used_shares(share, states[loads]))
            except StopIteration as end:
                results[key] = end.value
        requests = following
    return results


def _used_shares(share: Share, states: States) -> list[float]:
    if states.stands.all():
        return share(states).tolist()
    used = np.full(len(states.load), np.inf)
    if states.stands.any():
        used[states.stands] = share(states.some(states.stands))
    return used.tolist()


def first_load(top: float, *, grows: bool = False, near: float = np.nan, at_once: bool = True) -> Search:
    """Search for the smallest load in (0, top] at which all of a limit is used; it returns 0 where no load is needed.

    It returns None where `top` does not use all of it.  Where what is used `grows` with the load, only its ends are
    looked at, else some loads between, `at_once` or one after the other; where it is known to be `near` a load, loads
    beside that.
    """
    if 0.0 < near < top:
        points = yield from _look_at(tuple(dict.fromkeys(min(near * factor, top) for factor in BESIDE)))
        if points[0][1] < 0.0 <= points[-1][1]:
            return (yield from _root(points, OF_TOP * top))
    loads = (0.0, top) if grows else tuple(np.linspace(0.0, top, NODES).tolist())
    points = []
    for some in [loads] if at_once else [(load,) for load in loads]:
        points += yield from _look_at(some)
        if points[0][1] >= 0.0:
            return 0.0
        if any(excess >= 0.0 for _, excess in points):
            return (yield from _root(points, OF_TOP * top))
    return None


def _look_at(loads: tuple[float, ...]) -> Generator[tuple[float, ...], Sequence[float], list[Point]]:
    used = yield loads
    return [(load, share - 1.0) for load, share in zip(loads, used, strict=True)]


def _root(points: list[Point], apart: float) -> Generator[tuple[float, ...], Sequence[float], float]:
    """The first load of which points in order say that all is used between two of them.

    By a polynomial of the load over what is left (inverse interpolation), with its error from the one of a degree less;
    where that does not halve what the root lies in, by quarters of it.
    """
    before = np.inf
    while True:
        k = next(i for i, (_, left) in enumerate(points) if left >= 0.0)
        (low, below), (high, above) = points[k - 1], points[k]
        best, distance = (low, -below) if -below < above else (high, above)
        off = apart + OF_LOAD * high
        if high - low <= 2.0 * off or distance <= NOTHING:
            return best
        load, error = _curve(points, k)
        error = max(DOUBT * error, off)
        trial_loads = {load - error, load, load + error}
        if not (low < load < high and error < (high - low) / 8.0) or high - low > before / 2.0:
            trial_loads |= {low + share * (high - low) for share in (0.25, 0.5, 0.75)}
        trial_loads = {candidate for candidate in trial_loads if low < candidate < high}
        if not trial_loads:
            return best
        before = high - low
        points = sorted([*points, *(yield from _look_at(tuple(sorted(trial_loads))))])


def _curve(points: Sequence[Point], k: int) -> tuple[float, float]:
    """Load at which a polynomial through points about the k-th has its root, and its last change.

    By Neville's scheme, through those that ascend; no numbers where infinitely much is used.
    """
    if points[k][1] == np.inf:
        return np.nan, np.nan
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
    return root, change


#: Half the square of a cantilever's slope over that of its deflection by the length: (3 / 2)^2 / 2.
PROJECTED = 1.125
#: Share of a limit that is used without the load, at most, where a bar is made of what is left.
MOST_AT_REST = 0.99
#: Share of a load by which less of it has to stand.
BELOW = 1e-6


@dataclass(frozen=True)
class Place:
    """The k-th place of a boom, where each of the parts acts by its amount, and the load by a factor among these."""

    at: Postures
    k: int
    amounts: Sequence[float]
    gravity: float  # m/s^2

    @cached_property
    def loaded(self) -> Loaded:
        """Equilibria of the boom at this place under any load."""
        named = dict(zip(self.at.parts, self.amounts, strict=True))
        return Loaded(self.at.at(self.k, named, named[HOOK]))

    def share(self, limit: Limit) -> Share:
        """Function of states that returns the used share of a limit."""
        if limit not in self._shares:
            self._shares[limit] = limit.share(self.at, self.k, self.amounts)
        return self._shares[limit]

    @cached_property
    def _shares(self) -> dict[Limit, Share]:
        return {}

    def used(self, limit: Limit, state: State) -> float:
        """The share of a limit that a state uses."""
        return float(self.share(limit)(States.of([state]))[0])


def allowed_loads(limits: Sequence[Limit], place: Place, up_to: float, near: Array | None = None) -> Array:
    """The load in kg that each limit allows at a place, that of stability last; NaN where none up to `up_to`.

    `near` is what another model says.
    """
    loaded, near_loads = place.loaded, np.full(len(limits) + 1, np.nan) if near is None else near
    first = loaded.state(0.0)
    loads = np.zeros(len(limits) + 1)
    top = min(up_to, first.form.critical * (1.0 - 1e-9)) if loaded.both_ways else up_to
    if first.stands:
        loads[:-1] = _by_limit(limits, place, top, near_loads)
        reached = loads[:-1] > 0.0
        loads[:-1][reached] = _standing_loads(loaded, loads[:-1][reached])
    loads[-1] = _stable(loaded, up_to)
    return loads


def _standing_loads(loaded: Loaded, loads: Array) -> Array:
    """Return loads (l,) in kg; NaN in place of those under which, less a little, the boom does not stand."""
    return np.where(loaded.states((loads * (1.0 - BELOW)).tolist()).stands, loads, np.nan)


def _by_limit(limits: Sequence[Limit], place: Place, top: float, near: Array) -> Array:
    """The load in kg at which each limit is reached, NaN where it is not up to `top`."""
    loaded, loads, searches = place.loaded, np.full(len(limits), np.nan), dict[int, tuple[Share, Search]]()
    for n, (limit, guess) in enumerate(zip(limits, near.tolist(), strict=False)):
        direct = limit.directly(loaded.state(0.0).form, guess, top) if loaded.both_ways else None
        if direct is None:
            searches[n] = (
                place.share(limit),
                first_load(top, grows=limit.kind.grows, near=guess, at_once=loaded.both_ways),
            )
        elif direct <= top:
            loads[n] = direct
    for n, load in run_searches(loaded, searches).items():
        loads[n] = np.nan if load is None else load
    return loads


def bent_further(limits: Sequence[Limit], place: Place, loads: Array, reach: float) -> Array:
    r"""Change of allowed loads (l,) in kg by large rotations; 0 for stability, the last one, where it is unknown.

    A tip that is w to the side of a boom of length l stands by :math:`\theta \approx 3 w / 2 l` aside, and projections
    that second order takes as 1 are :math:`1 - \theta^2 / 2`.  Of a limit of which the rest uses :math:`u_0` these are
    :math:`\tfrac98 (w / l)^2 P / (1 - u_0)`; of overturning of the moment of load and boom together.
    """
    changes, tip = np.zeros(len(loads)), [n for n, kind in enumerate(place.at.output_kinds) if kind == "tip"]
    states, unloaded = place.loaded.states(loads.tolist()), place.loaded.states([0.0])
    for n, (limit, state) in enumerate(zip(limits, states.split([1] * len(loads)), strict=False)):
        load = float(state.load[0])
        if not load > 0.0 or not state.stands[0]:
            continue
        share = PROJECTED * float(np.sum(state.outputs[0, tip] ** 2)) / reach**2
        if limit.of == "overturning":
            changes[n] = share * limit.tipping(place.at, place.k, place.amounts).moved_by(state, limit.factor)
        else:
            used_unloaded = float(place.share(limit)(unloaded)[0])
            changes[n] = load * share / (1.0 - min(used_unloaded, MOST_AT_REST))
    return changes


def _stable(loaded: Loaded, up_to: float) -> float:
    """Load in kg from which on the boom has no stable equilibrium; NaN where that is above `up_to`."""
    if loaded.both_ways:
        critical = loaded.state(0.0).form.critical
        return critical if critical <= up_to else np.nan

    search = first_load(up_to, at_once=False)
    load = run_searches(loaded, {"stability": (_buckling_share, search)})["stability"]
    return np.nan if load is None else load


def _buckling_share(states: States) -> Array:
    """Loads of states as shares of the load that buckles the boom (p,)."""
    return states.load / np.array([form.critical for form in states.forms])
