"""Searches for the loads at which limits are reached, all side by side: what they ask for is computed at once."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.statics.loaded import Loaded, States

Array = NDArray[np.float64]
#: Asks for the shares of a limit that some loads use, and then of others, and returns the load that reaches it.
Search = Generator[tuple[float, ...], Sequence[float], float | None]
#: The shares (p,) of a limit that states use.
Share = Callable[[States], Array]
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
    """The smallest load in (0, top] at which all of a limit is used, by a bracketed root; 0 where it is without a load.

    None where it is not.  Where what is used `grows` with the load, only its ends are looked at, else some loads
    between, `at_once` or one after the other; where it is known to be `near` a load, loads beside that.
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
