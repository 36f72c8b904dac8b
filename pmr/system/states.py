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
    """States of a simulated reduced body at S times."""

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
            self, **{key: array[which] for key, array in vars(self).items() if key != "rows" and array is not None}
        )

    def share(self, columns: slice) -> BodyStates:
        """Return these states with some of the coordinates."""
        return replace(self, p=self.p[:, columns], v=self.v[:, columns])


def rubbed_on(
    system: Joined[Any], name: str, forces: Array, friction: Array | None
) -> tuple[Array, Array] | tuple[None, None]:
    """`moments` and `along` of a body's `BodyStates` under forces (S, m) of contacts, with friction (S, n) of pads."""
    rubbing = Friction.of(system.contacts)
    if rubbing is None or friction is None:
        return None, None
    sides, of_contacts = [system.sides[number] for number in system.sides_of(name)], np.zeros(forces.shape)
    of_contacts[:, rubbing.pads] = friction
    on = [side.contact for side in sides]
    ways = np.array([side.sign * system.contacts[side.contact].direction for side in sides])  # 1 of the inner section
    return system.pressed(name, rubbing.moments(friction, forces)), of_contacts[:, on] * ways


def states_of(system: System, trajectory: SystemTrajectory, steps: Indices) -> dict[str, BodyStates]:
    """States of every body at some of the steps of a trajectory."""
    states, first, at_steps = {}, 0, trajectory.at(steps)
    for name, body in system.bodies.items():
        motion, last = at_steps.bodies[name], first + len(body.input_names)
        rows = tuple(system.sides[number].place.row for number in system.sides_of(name))
        loads, rubbed = at_steps.loads[:, first:last], rubbed_on(system, name, at_steps.forces, at_steps.friction)
        states[name] = BodyStates(at_steps.t, motion.s, motion.q, motion.v, motion.multipliers, loads, rows, *rubbed)
        first = last
    return states
