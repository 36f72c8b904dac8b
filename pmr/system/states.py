"""What the bodies of a system do at some times: all that their full coordinates are recovered from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.system.friction import Friction
from pmr.system.system import Joined, System, SystemTrajectory

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
    # of friction (`pmr.system.friction`) at its rows, (S, m): moments in N m, and what pulls it towards its tail in N
    # while its tail is pushed as much the other way; None without any
    moments: Array | None = None
    along: Array | None = None

    def __getitem__(self, which: slice) -> BodyStates:
        """Some of the states."""
        return replace(
            self, **{key: one[which] for key, one in vars(self).items() if key != "rows" and one is not None}
        )

    def share(self, own: slice) -> BodyStates:
        """The same with some of its coordinates."""
        return replace(self, p=self.p[:, own], v=self.v[:, own])


def rubbed_on(
    system: Joined[Any], name: str, forces: Array, friction: Array | None
) -> tuple[Array, Array] | tuple[None, None]:
    """`moments` and `along` of a body's `BodyStates` under forces (S, m) of contacts, with friction (S, n) of pads."""
    known = Friction.of(system.contacts)
    if known is None or friction is None:
        return None, None
    sides, of_contacts = [system.sides[number] for number in system.sides_of(name)], np.zeros(forces.shape)
    of_contacts[:, known.pads] = friction
    on = [side.contact for side in sides]
    ways = np.array([side.sign * system.contacts[side.contact].direction for side in sides])  # 1 of the inner section
    return system.pressed(name, known.moments(friction, forces)), of_contacts[:, on] * ways


def states_of(system: System, trajectory: SystemTrajectory, steps: Indices) -> dict[str, BodyStates]:
    """Of every body at some of the steps of a trajectory."""
    found, first, kept = {}, 0, trajectory.at(steps)
    for name, body in system.bodies.items():
        motion, last = kept.bodies[name], first + len(body.input_names)
        rows = tuple(system.sides[number].place.row for number in system.sides_of(name))
        loads, rubbed = kept.loads[:, first:last], rubbed_on(system, name, kept.forces, kept.friction)
        found[name] = BodyStates(kept.t, motion.s, motion.q, motion.v, motion.multipliers, loads, rows, *rubbed)
        first = last
    return found
