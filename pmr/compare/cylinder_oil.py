"""Warnings about the oil of a cylinder: where a real one would boil, and where its pressure exceeds the supply's."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pmr.files.arrays import Array
from pmr.results import Response
from pmr.results.quantities import with_unit
from pmr.results.response import Extremes
from pmr.scene.cylinder import Oil

#: Pressure in Pa of the surroundings: oil boils where its pressure is lower by this.
VACUUM = 1e5
#: Share of the supply's pressure by which that of a chamber has to be above it for a warning.
ABOVE = 0.005


def boiling_warnings(cylinder: str, extremes: Mapping[str, Extremes], response: Response) -> list[str]:
    """A warning for each chamber of a `cylinder` whose oil would boil; `extremes` by ``pressure bore`` and the like."""
    return [
        f"the oil on the {key.removeprefix('pressure ')} side of the {cylinder} would have "
        f"{with_unit(of.least, 'Pa')} {response.when(of.t_least)}, and boils: the model pulls on it"
        for key, of in extremes.items()
        if key.startswith("pressure") and of.least < -VACUUM
    ]


def supply_warnings(
    cylinder: str, oil: Oil, histories: Mapping[str, Array], stop: Array, response: Response
) -> list[str]:
    """Warnings where the oil in a chamber of a `cylinder` has a higher pressure than the supply; two at most a chamber.

    The first warning is for times at which the valve connects the chamber to the supply: the supply is too weak for the
    load, and oil flows back unless a counterbalance valve stops it.  The second is for all other times: a real relief
    valve might open, which the model does not have.  The pressure has to exceed the supply by the valve's laminar
    pressure drop or the share `ABOVE`, whichever is larger.

    `histories` (T,) are by ``pressure bore`` and ``pressure rod``.  `stop` (T,) is how far a stop gives way: above 0 at
    the greatest length, below 0 at the smallest.  Times on a stop are ignored, and so are the times after a stop until
    the valve closes next, because the cylinder may rebound.  Without a valve there is no supply, and the list is empty.
    """
    if oil.valve is None:
        return []
    warnings, opening = list[str](), oil.valve.opening.value(response.t)
    supply = with_unit(oil.supply, "Pa")
    for side, way, verb in (("bore", 1.0, "extend"), ("rod", -1.0, "retract")):
        pressure = histories[f"pressure {side}"]
        above = (stop == 0.0) & (pressure > oil.supply + max(oil.valve.laminar, ABOVE * oil.supply))
        feeds, number = way * opening > oil.valve.dead_band, np.arange(len(opening))
        last_stop, last_shut = (
            np.maximum.accumulate(np.where(is_so, number, -1)) for is_so in (way * stop > 0.0, ~feeds)
        )
        fed = above & feeds & (last_stop <= last_shut)
        if fed.any():
            most = with_unit(float(pressure[fed].max()), "Pa")
            warnings.append(
                f"the supply of {supply} is too weak for the {cylinder}: {response.when(response.t[np.argmax(fed)])} "
                f"the valve is open to {verb} it, but the oil on the {side} side has up to {most}, and flows back "
                "unless a counterbalance valve holds it"
            )
        shut = above & ~feeds
        if shut.any():
            k = int(np.argmax(np.where(shut, pressure, -np.inf)))
            warnings.append(
                f"the oil on the {side} side of the {cylinder} has up to {with_unit(float(pressure[k]), 'Pa')} "
                f"{response.when(response.t[k])} while the supply does not feed it, more than the supply's {supply}: "
                "the model has no relief valve"
            )
    return warnings
