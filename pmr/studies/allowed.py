"""The loads that limits allow at one place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from pmr.simulation.postures import HOOK, Postures
from pmr.studies.limits import Limit
from pmr.system.loaded import Loaded, State

Array = NDArray[np.float64]

#: Loads at which is looked whether a limit is passed.
NODES = 9
#: How far beside a load that is known nearly, as a share of it.
BESIDE = 1e-2
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
        """What stands there."""
        named = dict(zip(self.at.parts, self.amounts, strict=True))
        return Loaded(self.at.at(self.k, named, named[HOOK]))

    def share(self, limit: Limit) -> Callable[[State], float]:
        """Of a limit that a state uses."""
        return limit.share(self.at, self.k, self.amounts, self.gravity)


def allowed_loads(limits: Sequence[Limit], place: Place, up_to: float, near: Array | None = None) -> Array:
    """The load in kg that each limit allows at a place, that of stability last; NaN where none up to `up_to`.

    `near` is what another model says.
    """
    loaded = place.loaded
    first = loaded.state(0.0)
    top = up_to if not loaded.both_ways else min(up_to, first.form.critical * (1.0 - 1e-9))
    found = []
    beside = np.full(len(limits) + 1, np.nan) if near is None else near
    for limit, known in zip(limits, beside.tolist(), strict=False):
        share = place.share(limit)

        def used(load: float, share: Callable[[State], float] = share) -> float:
            state = loaded.state(load)
            return share(state) if state.stands else np.inf

        load: float | None = 0.0
        if first.stands:
            own = limit.directly(first.form) if loaded.both_ways else None
            load = first_load(used, top, grows=limit.grows, near=known) if own is None else own if own <= top else None
        if load is not None and load > 0.0 and not loaded.state(load * (1.0 - BELOW)).stands:
            load = None  # it falls over before
        found.append(np.nan if load is None else load)
    return np.array([*found, _stable(loaded, up_to)])


def bent_further(limits: Sequence[Limit], place: Place, loads: Array, reach: float) -> Array:
    r"""What large rotations may change of allowed loads (l,) kg, that of stability last: none is known of that.

    A tip that is w to the side of a boom of length l stands by :math:`\theta \approx 3 w / 2 l` aside, and projections
    that second order takes as 1 are :math:`1 - \theta^2 / 2`.  Of a limit of which the rest uses :math:`u_0` these are
    :math:`\tfrac98 (w / l)^2 P / (1 - u_0)`; of overturning what the boom's own weight adds that moves as the tip does.
    """
    loaded, found = place.loaded, np.zeros(len(loads))
    tip = [n for n, kind in enumerate(place.at.output_kinds) if kind == "tip"]
    for n, (limit, load) in enumerate(zip(limits, loads.tolist(), strict=False)):
        if not load > 0.0 or not (state := loaded.state(load)).stands:
            continue
        share = PROJECTED * float(np.sum(state.outputs[tip] ** 2)) / reach**2
        if limit.of == "overturning":
            tipping = limit.tipping(place.at, place.k, place.amounts, place.gravity)
            used, more = tipping.share(state, limit.factor), tipping.bent(state, limit.factor)
            found[n] = load * (share + 1.0 - used / more)
        else:
            rest = place.share(limit)(loaded.state(0.0))
            found[n] = load * share / (1.0 - min(rest, MOST_AT_REST))
    return found


def _stable(loaded: Loaded, up_to: float) -> float:
    """The load in kg that nothing carries any more; NaN above `up_to`."""
    if loaded.both_ways:
        critical = loaded.state(0.0).form.critical
        return critical if critical <= up_to else np.nan

    def used(load: float) -> float:
        state = loaded.state(load)
        return load / state.form.critical if state.stands else np.inf

    found = first_load(used, up_to)
    return np.nan if found is None else found


def first_load(
    used: Callable[[float], float], top: float, *, grows: bool = False, near: float = np.nan
) -> float | None:
    """The smallest load in (0, top] at which `used` comes to 1, by a bracketed root; 0 where it does at no load.

    None where it does not.  Where it `grows` with the load, only its ends are looked at, else some loads between; where
    it is known to be `near` a load, a little below and above that.
    """

    def beyond(load: float) -> float:
        value = used(load)
        if not np.isfinite(value):
            return 1.0
        return 1.0 - 1.0 / value if value > 1.0 else value - 1.0

    if 0.0 < near < top:
        low, high = near * (1.0 - BESIDE), min(near * (1.0 + BESIDE), top)
        if beyond(low) < 0.0 <= beyond(high):
            return float(brentq(beyond, low, high, xtol=1e-12 * top, rtol=1e-13))
    if beyond(0.0) >= 0.0:
        return 0.0
    nodes = np.linspace(0.0, top, 2 if grows else NODES)
    for low, high in zip(nodes[:-1].tolist(), nodes[1:].tolist(), strict=True):
        if beyond(high) >= 0.0:
            return float(brentq(beyond, low, high, xtol=1e-12 * top, rtol=1e-13))
    return None
