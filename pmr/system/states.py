"""What the bodies of a system do at some times: all that their full coordinates are recovered from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.system.system import System, SystemTrajectory

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class BodyStates:
    """What a simulated reduced body says at S times."""

    t: Array  # (S,) s
    s: Array  # (S, m) m: where each of its rows is
    # (S, r): coordinates and their rates
    p: Array
    v: Array
    multipliers: Array  # z (S, m) in N, those that deform the residual part
    loads: Array  # (S, i) N
    rows: tuple[str, ...]  # (m,): names

    def __getitem__(self, which: slice) -> BodyStates:
        """Some of the states."""
        t, s, p, v = self.t[which], self.s[which], self.p[which], self.v[which]
        return BodyStates(t, s, p, v, self.multipliers[which], self.loads[which], self.rows)

    def share(self, own: slice) -> BodyStates:
        """The same with some of its coordinates."""
        return replace(self, p=self.p[:, own], v=self.v[:, own])


def states_of(system: System, trajectory: SystemTrajectory, steps: Indices) -> dict[str, BodyStates]:
    """Of every body at some of the steps of a trajectory."""
    found, first, kept = {}, 0, trajectory.at(steps)
    for name, body in system.bodies.items():
        motion, last = kept.bodies[name], first + len(body.input_names)
        rows = tuple(system.sides[number].place.row for number in system.sides_of(name))
        loads = kept.loads[:, first:last]
        found[name] = BodyStates(kept.t, motion.s, motion.q, motion.v, motion.multipliers, loads, rows)
        first = last
    return found
