"""Simulated motion of a system, and the states of its bodies from which their full coordinates are recovered."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.system.body import Trajectory
from pmr.system.contacts import Friction
from pmr.system.system import Joined, System

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class SystemTrajectory:
    """A simulated system over time."""

    t: Array  # (T,) s
    # of each body: its coordinates, and for each of its places, as `System.sides` has them, the path coordinate ``s``
    # (T, sides) in m and the ``multipliers`` (T, sides) in N, with the sign of its side
    bodies: Mapping[str, Trajectory]
    forces: Array  # (T, m) N: of the contacts, positive where they push
    # (T, m) N: largest force within the step that ends at t of contacts that only push; of the others that at t
    peaks: Array
    loads: Array  # (T, i) N: as `System.input_names` names them
    # (T,) J: kinetic and strain energy, and what loads and travelling contacts did since t = 0; damping only takes
    energy: Array
    work: Array
    seconds: float  # wall time of the solver alone
    surplus: float  # share of the largest energy that nothing put in (`pmr.simulation.balance`)
    parts: NDArray[np.int64] | None = None  # (T,): of how many parts each step was made (`pmr.simulation.contact_step`)
    # (T, m) N s: of the step that ends at t, as generalized-alpha weighs forces; None where no contact only pushes
    impulses: Array | None = None
    amplitudes: Array | None = None  # c (T, k) of the system's terms, None where there are none
    # of the n pads that rub (`pmr.system.contacts`), (T, n) N along the boom, and their moments among those of all
    # contacts (T, m) N m; None where none rub
    friction: Array | None = None
    moments: Array | None = None
    rates: Array | None = None  # (T, P) m/s: how fast the paths lead on, None where not known

    @property
    def arrays(self) -> list[NDArray[Any]]:
        """All that is known of each step, of the bodies too."""
        of_bodies = [array for body in self.bodies.values() for array in _arrays(body).values()]
        return [*of_bodies, *_arrays(self).values()]

    def map_arrays(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> SystemTrajectory:
        """Return the trajectory with all of its arrays changed."""

        def change_arrays(trajectory: Trajectory | SystemTrajectory) -> dict[str, Any]:
            return {name: change(array) for name, array in _arrays(trajectory).items()}

        bodies = {name: replace(trajectory, **change_arrays(trajectory)) for name, trajectory in self.bodies.items()}
        return replace(self, bodies=bodies, **change_arrays(self))

    def at(self, steps: NDArray[np.int64] | slice) -> SystemTrajectory:
        """Some of its steps, by their numbers (S,); what belongs to a step that ends there is left out."""
        return replace(self.map_arrays(lambda array: array[steps]), parts=None, impulses=None)


def _arrays(trajectory: Trajectory | SystemTrajectory) -> dict[str, NDArray[Any]]:
    """Arrays among the fields, by their names."""
    return {name: value for name, value in vars(trajectory).items() if isinstance(value, np.ndarray)}


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
    # of friction (`pmr.system.contacts`) at its rows, (S, m): moments in N m, and what pulls it towards its tail in N
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
