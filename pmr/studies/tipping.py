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
from functools import lru_cache
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from pmr.scene.frame import rotation
from pmr.scene.section import Usual
from pmr.simulation.postures import HOOK, WEIGHT, Postures
from pmr.system.loaded import States

Array = NDArray[np.float64]


class Mass(BaseModel):
    """A part of the machine below the boom."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str = Field(description="Name of the mass, for the report")
    mass: Annotated[float, Usual(0.02, 1e6, "boom", "kg")] = Field(gt=0.0, description="kg")
    at: Annotated[tuple[float, float, float], Usual(0.0, 3.0, "reach", "m")] = Field(
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
        about, load = _edges(tuple(polygon), height), np.array([name == HOOK for name in at.parts])
        resting, hook = ((share * amounts) @ at.wrenches[:, k] for share in (~load, load))
        own, c, s = amounts[at.parts.index(WEIGHT)], np.cos(at.slewing[k]), np.sin(at.slewing[k])
        for one in machine:
            x, y = (c * one.at[0] - s * one.at[1], s * one.at[0] + c * one.at[1]) if one.slews else one.at[:2]
            pull = -one.mass * own * gravity
            resting += np.array([0.0, 0.0, pull, y * pull, -x * pull, 0.0])
        tip, weight = _displaced(at, k), own * at.wrenches[at.parts.index(WEIGHT), k, :3]
        moved, boom = (about[:, 3:] @ (_across(force) @ tip) for force in (hook[:3], weight))
        return cls(-about @ resting, about @ hook, moved, boom)

    def share(self, states: States, factor: float) -> Array:
        """Of what keeps it from tipping that `factor` times the load uses, about the worst edge (p,)."""
        return self._worst(states, factor, self.held)

    def bent(self, states: States, factor: float) -> Array:
        """The same with the boom's weight displaced as far as the tip, which is further than it is."""
        return self._worst(states, factor, self.held - np.abs(states.outputs @ self.boom.T))

    def _worst(self, states: States, factor: float, held: Array) -> Array:
        """Infinite where nothing keeps it from tipping."""
        tips = factor * states.load[:, None] * (self.tips + states.outputs @ self.moved.T)
        return np.asarray(np.where(held > 0.0, tips / np.where(held > 0.0, held, 1.0), np.inf).max(axis=1))


def area(polygon: Sequence[tuple[float, float]]) -> float:
    """Twice the signed area, positive where the corners go round anticlockwise."""
    x, y = np.array(polygon, float).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


@lru_cache(64)  # each place of a chart has the same
def _edges(polygon: tuple[tuple[float, float], ...], height: float) -> Array:
    """Rows (e, 6) that make of a force and its moment about the pivot the moment about each edge, anticlockwise."""
    corners = np.array([(*one, -height) for one in polygon], float)
    if area(polygon) < 0.0:
        corners = corners[::-1]
    edges = np.roll(corners, -1, axis=0) - corners
    edges /= np.linalg.norm(edges, axis=1)[:, None]
    return np.hstack([-np.cross(edges, corners), edges])


def _across(force: Array) -> Array:
    """The matrix of u x F."""
    x, y, z = force.tolist()
    return np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])


def _displaced(at: Postures, k: int) -> Array:
    """How outputs displace the tip along the ground's axes (3, o)."""
    turned = rotation(at.luffing[k : k + 1], at.slewing[k : k + 1])[0]
    return np.asarray(turned @ _tip(at.output_names, at.output_kinds))


@lru_cache(64)
def _tip(names: tuple[str, ...], kinds: tuple[str, ...]) -> Array:
    """How outputs displace the tip along the boom's axes (3, o)."""
    tips = [name if kind == "tip" else "" for name, kind in zip(names, kinds, strict=True)]
    return np.array([[name.endswith(axis) for name in tips] for axis in "xyz"], dtype=float)
