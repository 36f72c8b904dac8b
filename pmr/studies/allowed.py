"""The loads that limits allow at one place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.statics.loaded import Loaded, State, States
from pmr.simulation.statics.postures import HOOK, Postures
from pmr.studies.limits import Limit
from pmr.studies.searches import Search, Share, first_load, run_searches

Array = NDArray[np.float64]

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
    """The loads in kg under a little less of which it stands, NaN for the others, where it has fallen over before."""
    return np.where(loaded.states((loads * (1.0 - BELOW)).tolist()).stands, loads, np.nan)


def _by_limit(limits: Sequence[Limit], place: Place, top: float, near: Array) -> Array:
    """The load in kg at which each limit is reached, NaN where it is not up to `top`."""
    loaded, loads, searches = place.loaded, np.full(len(limits), np.nan), dict[int, tuple[Share, Search]]()
    for n, (limit, guess) in enumerate(zip(limits, near.tolist(), strict=False)):
        direct = limit.directly(loaded.state(0.0).form, guess, top) if loaded.both_ways else None
        if direct is None:
            searches[n] = place.share(limit), first_load(top, grows=limit.grows, near=guess, at_once=loaded.both_ways)
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
    """The load in kg that nothing carries any more; NaN above `up_to`."""
    if loaded.both_ways:
        critical = loaded.state(0.0).form.critical
        return critical if critical <= up_to else np.nan

    search = first_load(up_to, at_once=False)
    load = run_searches(loaded, {"stability": (_buckling_share, search)})["stability"]
    return np.nan if load is None else load


def _buckling_share(states: States) -> Array:
    """Share of the load that buckles it."""
    return states.load / np.array([form.critical for form in states.forms])
