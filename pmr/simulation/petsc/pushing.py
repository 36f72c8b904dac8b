"""Contacts that only push: which of them are closed, and what those that let go leave behind.

As in `pmr.simulation.native.contact`, where it is explained; ranks take what the first one finds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.fullmodel.system import FullSystem
from pmr.simulation.native import contact as native
from pmr.simulation.native.arrays import Memory
from pmr.simulation.native.handles import handle
from pmr.simulation.petsc.effective import BlockFactor
from pmr.simulation.petsc.rows import PathRows
from pmr.simulation.petsc.start import State

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Released:
    """Forces (m,) in N, and their shares in the acceleration-like variable, of contacts that have just opened."""

    force: Array
    share: Array


@dataclass(frozen=True)
class Ahead:
    """This rank's rows (n_local,) of a step's end without its acceleration: q*, v* and a*."""

    q: Array
    v: Array
    a: Array


class Pushing:
    """Contacts of a system, some of which only push; `mass` is a factor of M."""

    def __init__(self, system: FullSystem, memory: Memory, mass: BlockFactor, state: State) -> None:
        found = native.contact(system.clearance, memory)
        assert found is not None
        self._contact, self._comm, self.mass = found, system.comm, mass
        self._factor = np.zeros((len(system.contacts),) * 2)
        self.begin(state)

    def begin(self, state: State) -> None:
        """Stand where a state does."""
        contact = self._contact
        contact.force[:], contact.share[:] = np.where(contact.pushes, state.multipliers, 0.0), state.share
        contact.closed[:] = ~contact.pushes | (state.multipliers > 0.0)

    @property
    def pushes(self) -> NDArray[np.bool_]:
        """Contacts (m,) that only push."""
        return self._contact.pushes

    @property
    def share(self) -> Array:
        """Share (m,) of the forces in the acceleration-like variable at the step's end."""
        return self._contact.share.copy()

    def settle(self, matrix: Array, motion: Array) -> tuple[Array, int]:
        """Multipliers (m,) in N, and 0 or what failed, from A (m, m) and how far the rows come out without them."""
        contact, found = self._contact, motion.copy()
        contact.factored[0] = native.STALE
        failed = int(native.settle(handle(contact), np.ascontiguousarray(matrix), self._factor, found))
        if self._comm.size > 1:
            ruling = np.concatenate([found, contact.closed, [failed]])
            self._comm.Bcast(ruling)
            found, closed, failed = ruling[: len(found)], ruling[len(found) : -1] > 0.0, int(ruling[-1])
            contact.closed[:] = closed
        return found, failed

    def released(self) -> Released | None:
        """What contacts that are open now still add to this step, which is to be taken back; None where nothing is."""
        contact = self._contact
        open_now = ~contact.closed & ((contact.force != 0.0) | (contact.share != 0.0))
        if not open_now.any():
            return None
        force, share = (np.where(open_now, values, 0.0) for values in (contact.force, contact.share))
        contact.force[open_now] = contact.share[open_now] = 0.0
        return Released(force, share)

    def taken_back(self, rows: PathRows, released: Released, memory: Memory) -> Ahead:
        """What of a step's end goes with the contacts that let go."""
        right = [rows.transposed(forces) for forces in (released.force, released.share)]
        force, share = self.mass.solve_columns(np.stack(right, axis=1)).T
        return Ahead(
            q=memory.z_from_force * force + memory.z_from_share * share,
            v=memory.v_from_force * force + memory.v_from_share * share,
            a=memory.a_from_force * force + memory.a_from_share * share,
        )

    def remember(self, multipliers: Array, memory: Memory) -> None:
        """What the step leaves for the next one."""
        contact = self._contact
        left = memory.a_from_force * contact.force + memory.a_from_share * contact.share
        contact.share[:] = np.where(contact.pushes, memory.gain * multipliers + left, 0.0)
        contact.force[:] = np.where(contact.pushes, multipliers, 0.0)

    def unsettled(self, names: Sequence[str]) -> str:
        """Why a step is given up, in words."""
        pushing = ", ".join(name for name, pushes in zip(names, self._contact.pushes, strict=True) if pushes)
        return f"which of the contacts {pushing} are closed was not settled in {native.LIMIT} solves"
