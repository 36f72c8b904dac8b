"""A boom that stops turning with its load: how far it swings, and what that uses of the limit that governs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from pmr.scene.keys import Usual
from pmr.simulation.statics.loaded import States
from pmr.simulation.statics.postures import HOOK
from pmr.simulation.statics.swings import Acting, stopping_swing
from pmr.studies.allowed import Place
from pmr.studies.limits import Limit

Array = NDArray[np.float64]


class Stop(BaseModel):
    """A stop of luffing or slewing, whose speed falls steadily to nothing."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    of: Literal["luffing", "slewing"] = Field(description="Motion that is stopped")
    speed: Annotated[float, Field(gt=0.0)] = Field(
        description="Speed before the stop, in the scene's unit of angles per second"
    )
    within: Annotated[float, Field(gt=0.0), Usual(1e-3, 60.0, unit="s")] = Field(description="Duration of the stop, s")
    class_factor: Annotated[float, Field(ge=1.0)] | None = Field(
        default=None, description="Factor on the drive's forces that a standard gives, for comparison"
    )


@dataclass(frozen=True)
class Stopping:
    """A stop in rad/s, and the loads (P, i) of a unit of the angle's acceleration at all places."""

    of: str
    speed: float
    within: float
    turned: Array

    def row(self, place: Place, load: float, limit: Limit | None) -> Array:
        """Five numbers: by which factor the tip swings beyond a steady deceleration, and what is used of a limit.

        The share at rest, under a steady deceleration, and at most in the stop, of both directions; the speed in rad/s.
        Not numbers where nothing stands, or the tip does not move.
        """
        none, state = np.array([*[np.nan] * 4, self.speed]), place.loaded.state(load)
        swing = stopping_swing(state.form, load, self._acting_loads(place, load), self.within) if state.stands else None
        if swing is None:
            return none
        tip = [n for n, kind in enumerate(place.at.output_kinds) if kind == "tip"]
        steady = swing.steady[0][tip]
        factor = np.abs(swing.outputs[:, tip] @ steady).max() / (steady @ steady) if np.any(steady) else np.nan
        if limit is None:
            return np.append(factor, none[1:])
        share, rate = place.share(limit), self.speed / self.within

        def most(outputs: Array, forces: Array) -> float:
            """In both directions."""
            of, by = (state.outputs, state.forces), (rate * outputs, rate * forces)
            extremes = [np.vstack([values + more, values - more]) for values, more in zip(of, by, strict=True)]
            return float(share(States.beside(state, *extremes)).max())

        steadily = most(*(values[None] for values in swing.steady))
        return np.array([factor, place.used(limit, state), steadily, most(swing.outputs, swing.forces), self.speed])

    def _acting_loads(self, place: Place, load: float) -> Acting:
        at, k = place.at, place.k
        f = self.turned[k].copy()
        if self.of == "luffing":  # the load hangs: what lifts its rope accelerates it, and nothing sideways
            x, _, z = at.tip[k]
            lifted = float(at.up[k] @ [-z, 0.0, x])  # by a radian
            f += load * lifted / place.gravity * at.f[at.parts.index(HOOK), k]
        return Acting(at.B @ f, -at.H[k] @ f, np.vstack([at.direct, at.machine_loads[k]]) @ f)
