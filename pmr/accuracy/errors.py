"""Errors of a family's members: against all modes, by a step, and both together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pmr.accuracy.family import Family, Member
from pmr.accuracy.steps import Rung
from pmr.compare.outputs import Outputs, differences
from pmr.errors import SimulationError

#: Of all errors; they are known better than an estimate by a few enrichment modes, whose margin is 1.25.
MARGIN = 1.1
#: So many modes less tell what all modes leave unsure.
LESS = 4


@dataclass(frozen=True)
class Demand:
    """What is asked for.

    Attributes
    ----------
    tolerance : float
        Largest error in each of the `kinds`, a fraction.
    kinds : sequence of str
        Of `pmr.compare.outputs.KINDS`.
    inertia : bool
        Whether the residual inertia may be kept, which only ``march`` simulates.
    """

    tolerance: float
    kinds: Sequence[str]
    inertia: bool


class Errors:
    """Errors in the kinds that are demanded, fractions with margin; motions are compared at `coarse` intervals."""

    def __init__(self, family: Family, demand: Demand, coarse: int) -> None:
        self.family, self.demand, self.coarse = family, demand, coarse
        self._floors = family.floors(coarse)
        self._unsure: dict[int, dict[str, float]] = {}
        self._missing: dict[tuple[Member, int], Outputs | None] = {}

    def best(self, steps: int) -> Outputs:
        """Motion of all modes."""
        return self.family.motion(self.family.best, steps, self.coarse)

    def missing(self, member: Member, steps: int) -> Outputs | None:
        """What all modes have beyond a member; None where its motion can't be computed."""
        if (member, steps) not in self._missing:
            try:
                own = self.family.motion(member, steps, self.coarse)
                self._missing[member, steps] = self.best(steps).minus(own)
            except SimulationError:
                self._missing[member, steps] = None
        return self._missing[member, steps]

    def unsure(self, steps: int) -> dict[str, float]:
        """What the motion of all modes may be off by itself, by kind: its difference to that of a few less."""
        if steps not in self._unsure:
            best, kept = self.family.best, self.family.best.residual_inertia
            fewer = self.missing(Member(max(self.family.fewest, best.coordinates - LESS), kept), steps)
            found = dict.fromkeys(self.demand.kinds, float("inf")) if fewer is None else self.size(fewer, steps)
            self._unsure[steps] = found
        return self._unsure[steps]

    def reduction(self, member: Member, steps: int) -> dict[str, float]:
        """Error of the reduction by kind, with margin and what is unsure; infinite where there is no motion.

        Modes that all members lack move at other frequencies than those that this one lacks, so squares are added.
        """
        missing = self.missing(member, steps)
        if missing is None:
            return dict.fromkeys(self.demand.kinds, float("inf"))
        unsure = self.unsure(steps)
        return {kind: float(np.hypot(size, unsure[kind])) for kind, size in self.size(missing, steps).items()}

    def size(self, missing: Outputs, steps: int) -> dict[str, float]:
        """Error by kind, with margin."""
        best = self.best(steps)
        found = differences(best.minus(missing), best, self._floors, self.demand.kinds)
        return {kind: MARGIN * share for kind, share in found.items()}

    def total(self, member: Member, rung: Rung, steps: int) -> dict[str, float]:
        """Both parts together, by kind; no less than the larger one."""
        missing = self.missing(member, steps)
        if missing is None:
            return dict.fromkeys(self.demand.kinds, float("inf"))
        step, both = (self.size(part, steps) for part in (rung.missing, missing.plus(rung.missing)))
        reduction, unsure = self.reduction(member, steps), self.unsure(steps)
        return {
            kind: max(reduction[kind], step[kind], float(np.hypot(both[kind], unsure[kind])))
            for kind in self.demand.kinds
        }
