"""Forces of contacts, of which some only push, and what those that open leave in a step.

The complementarity problem is the kernel's (`pmr.kernel.laws`); ranks take the solution of the first one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.errors import on_first
from pmr.fullmodel.system import FullSystem
from pmr.kernel.laws import SchemeFactors, solve_contact
from pmr.simulation.petsc.effective import BlockFactor
from pmr.simulation.petsc.rows import PathRows
from pmr.simulation.petsc.start import State

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Prediction:
    """This rank's rows (n_local,) of a step's end without its acceleration: q*, v* and a*."""

    q: Array
    v: Array
    a: Array


class Pushing:
    """Contacts of a system, closed or open; `mass` is a factor of M, needed where some only push."""

    def __init__(self, system: FullSystem, mass: BlockFactor | None, state: State) -> None:
        self.mass, self.pushes, self._comm = mass, ~np.isnan(system.clearance), system.comm
        self._clearance = np.nan_to_num(system.clearance)
        self.begin(state)

    def begin(self, state: State) -> None:
        """Stand where a state does."""
        self._force, self.share = np.where(self.pushes, state.multipliers, 0.0), state.share.copy()
        self._closed = ~self.pushes | (state.multipliers > 0.0)

    def forces(self, matrix: Array, motion: Array) -> Array:
        """Multipliers (m,) in N, from A (m, m) and how far the rows come out without them, (m,) m.

        A ContactError is raised where contacts depend on each other, or which are closed is not settled.
        """

        def solution() -> tuple[Array, NDArray[np.bool_]]:
            return solve_contact(matrix, motion - self._clearance, self.pushes, self._closed)

        if self._comm.size == 1 or not self.pushes.any():
            forces, self._closed = solution()
        else:
            forces, self._closed = self._comm.bcast(on_first(self._comm, solution))
        return forces

    def release(self, rows: PathRows, factors: SchemeFactors) -> Prediction | None:
        """Take back what contacts that are open now add to the prediction by their last force; None if none does."""
        opened = ~self._closed & ((self._force != 0.0) | (self.share != 0.0))
        if not opened.any():
            return None
        assert self.mass is not None
        right = [rows.apply_transposed(np.where(opened, forces, 0.0)) for forces in (self._force, self.share)]
        self._force, self.share = (np.where(opened, 0.0, forces) for forces in (self._force, self.share))
        force, share = self.mass.solve_columns(np.stack(right, axis=1)).T
        return Prediction(
            q=factors.z_from_force * force + factors.z_from_share * share,
            v=factors.v_from_force * force + factors.v_from_share * share,
            a=factors.a_from_force * force + factors.a_from_share * share,
        )

    def end_step(self, multipliers: Array, factors: SchemeFactors) -> None:
        """Store what forces (m,) of a step leave for the next one."""
        share = factors.gain * multipliers + factors.a_from_force * self._force + factors.a_from_share * self.share
        self.share = np.where(self.pushes, share, 0.0)
        self._force = np.where(self.pushes, multipliers, 0.0)
