"""Steps of full models in as many parts as a schedule says, or as pads that only push take: a factor for each length.

The parts of each step are those that a reduced model's forces asked for (src/substeps.c of `pmr.kernel`).  In
full order the same estimate asks for more and tells less: the walls under pads are light, so that every impact rings
in them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmr.fullmodel.system import FullSystem
from pmr.simulation import contact_step
from pmr.simulation.lengths import Lengths
from pmr.simulation.petsc.constraint import compliances, paths
from pmr.simulation.petsc.effective import BlockFactor
from pmr.simulation.petsc.integrate import Integrator
from pmr.simulation.petsc.pushing import Pushing
from pmr.simulation.petsc.recorder import Recorder, Sampled
from pmr.simulation.petsc.rows import PathCompliance
from pmr.simulation.petsc.start import State
from pmr.simulation.petsc.terms import Terms

Array = NDArray[np.float64]


def contact_frequency(system: FullSystem, x: Array, mass: BlockFactor) -> float:
    """Largest omega in rad/s of the contacts that only push, with the sides at x (T, q) m; collective."""
    pushing, largest = np.flatnonzero(~np.isnan(system.clearance)), 0.0
    steps = np.unique(np.linspace(0, len(x) - 1, contact_step.PLACES).astype(int))
    rows = paths(system, x[steps])
    mobility = PathCompliance(compliances(system, mass, rows.visited), rows)
    F = system.compliance.constant[np.ix_(pushing, pushing)]
    for k in range(len(steps)):
        rows.move(k)
        largest = max(largest, contact_step.frequency(F[None], mobility.of_rows(rows)[np.ix_(pushing, pushing)][None]))
    return float(system.comm.bcast(largest))


class PartedSteps:
    """Takes steps along a course that is sampled as finely as the most parts take it, from step `first` on; collective.

    A step in other parts than the one before begins anew from position, velocity and equilibrium of forces.
    """

    def __init__(self, system: FullSystem, lengths: Lengths, fine: Sampled, pushing: Pushing, first: int) -> None:
        self._lengths, self._fine, self._pushing = lengths, fine, pushing
        terms = Terms(system)
        self.rows, sizes = paths(system, fine.x, first * lengths.finest), np.unique(lengths.parts).tolist()
        self._integrators = {
            parts: Integrator(system, lengths.factors(parts), self.rows, pushing, terms, len(sizes)) for parts in sizes
        }

    def step(self, number: int, state: State, due: bool, recorder: Recorder) -> tuple[State, bool]:
        """The state after step `number`, and whether any rank is due for a checkpoint.

        Raises
        ------
        SimulationError
            As of `Integrator.step`.
        """
        finest, parts = self._lengths.finest, int(self._lengths.parts[number - 1])
        if parts != self._lengths.parts[max(number - 2, 0)] and self._pushing.pushes.any():
            state = replace(state, a=state.acceleration, share=np.where(self._pushing.pushes, state.multipliers, 0.0))
            self._pushing.begin(state)
        for part in range(1, parts + 1):
            at = (number - 1) * finest + part * (finest // parts)
            f, c = self._fine.f[at], self._fine.c[at]
            state, due = self._integrators[parts].step(at, state, f, c, due)
            recorder.follow(state, self.rows, self._fine.x[at], f, c)
        return state, due

    def destroy(self) -> None:
        """Give the factors' memory back."""
        for integrator in self._integrators.values():
            integrator.destroy()
        if self._pushing.mass is not None:
            self._pushing.mass.destroy()
