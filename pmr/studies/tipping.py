r"""A machine that tips over an edge of the polygon it stands on.

.. math::
    \frac{P\, (m_1 + \hat u \cdot (F_1 \times e))}{M_0} = 1

with the edge's direction e, the moment :math:`M_0` that keeps the machine from tipping about it without the load,
:math:`m_1` what a kg of the load adds to tipping at the undeformed tip, :math:`F_1` its force, and u how the tip is
displaced.  The boom's own weight acts where it does undeformed; `Tipping.bent` moves it as far as the tip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from pmr.scene.frame import rotation
from pmr.simulation.postures import HOOK, WEIGHT, Postures
from pmr.system.loaded import State

Array = NDArray[np.float64]


class Mass(BaseModel):
    """A part of the machine below the boom."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str = Field(description="Name of the mass, for the report")
    mass: float = Field(gt=0.0, description="kg")
    at: tuple[float, float, float] = Field(
        description="Position of its centre from the pivot, m: X where the boom points unslewed, Y to its left, Z up"
    )
    slews: bool = Field(default=False, description="Whether it turns with the boom, as a counterweight does")


@dataclass(frozen=True)
class Tipping:
    """About all edges at one place, anticlockwise: moments about them that are positive tip the machine."""

    held: Array  # (e,) N m: what keeps it from tipping without the load
    tips: Array  # (e,) N m: by a kg of the load
    moved: Array  # (e, o) N: by which that grows with outputs, of a kg of the load
    boom: Array  # (e, o) N: by which the boom's weight tips more if it moved as far as the tip

    @classmethod
    def of(
        cls,
        polygon: Sequence[tuple[float, float]],
        height: float,
        machine: Sequence[Mass],
        at: Postures,
        k: int,
        amounts: Array,
        gravity: float,
    ) -> Tipping:
        """At the k-th place, with corners X, Y in m from the pivot, which is `height` above them."""
        corners = np.array([(*one, -height) for one in polygon], float)
        if area(polygon) < 0.0:
            corners = corners[::-1]
        edges = np.roll(corners, -1, axis=0) - corners
        edges /= np.linalg.norm(edges, axis=1)[:, None]
        load = np.array([name == HOOK for name in at.parts])
        resting, hook = ((share * amounts) @ at.wrenches[:, k] for share in (~load, load))
        own = amounts[at.parts.index(WEIGHT)]
        weight = np.zeros(6)
        for one in machine:
            c, s = (np.cos(at.slewing[k]), np.sin(at.slewing[k])) if one.slews else (1.0, 0.0)
            x, y = c * one.at[0] - s * one.at[1], s * one.at[0] + c * one.at[1]
            pull = -one.mass * own * gravity
            weight += np.array([0.0, 0.0, pull, y * pull, -x * pull, 0.0])
        wrenches = np.stack([resting + weight, hook])[:, None]
        held, tips = np.einsum("ei,wei->we", edges, wrenches[..., 3:] - np.cross(corners, wrenches[..., :3]))
        tip = _displaced(at, k)
        boom = own * at.wrenches[at.parts.index(WEIGHT), k, :3]
        return cls(-held, tips, np.cross(hook[:3], edges) @ tip, np.cross(boom, edges) @ tip)

    def share(self, state: State, factor: float) -> float:
        """Of what keeps it from tipping that `factor` times the load uses, about the worst edge."""
        return self._worst(factor * state.load * (self.tips + self.moved @ state.outputs), self.held)

    def bent(self, state: State, factor: float) -> float:
        """The same with the boom's weight displaced as far as the tip, which is further than it is."""
        tips = factor * state.load * (self.tips + self.moved @ state.outputs)
        return self._worst(tips, self.held - np.abs(self.boom @ state.outputs))

    @staticmethod
    def _worst(tips: Array, held: Array) -> float:
        """Infinite where nothing keeps it from tipping."""
        return max(a / b if b > 0.0 else np.inf for a, b in zip(tips.tolist(), held.tolist(), strict=True))


def area(polygon: Sequence[tuple[float, float]]) -> float:
    """Twice the signed area, positive where the corners go round anticlockwise."""
    x, y = np.array(polygon, float).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _displaced(at: Postures, k: int) -> Array:
    """How outputs displace the tip along the ground's axes (3, o)."""
    turned = rotation(at.luffing[k : k + 1], at.slewing[k : k + 1])[0]
    found = np.zeros((3, len(at.output_names)))
    for number, (kind, name) in enumerate(zip(at.output_kinds, at.output_names, strict=True)):
        if kind == "tip" and name[-1] in "xyz":
            found[:, number] = turned[:, "xyz".index(name[-1])]
    return found
