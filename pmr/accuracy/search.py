r"""The smallest model and the longest step that hold a tolerance.

With y_N the motion of all modes that a reduction has (the inertia of the rest kept), the error of r modes and step h is

.. math::
    e = \underbrace{(y_{N,h} - y_{r,h})}_{\text{reduction}} + \underbrace{(y_{r,0} - y_{r,h})}_{\text{step}}, \qquad
    1.1 \max(\lVert e \rVert, \lVert e_{reduction} \rVert, \lVert e_{step} \rVert) \le \text{tolerance}

in every kind of output that is asked for.  The first part is the error estimate with N - r enrichment modes
(`pmr.compare.estimate`), the second comes from shorter steps (`pmr.accuracy.errors`).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pmr.accuracy.errors import Demand, Errors, Rung, coarser, rungs
from pmr.accuracy.family import Family, Member
from pmr.errors import SimulationError
from pmr.errors.text import rounded

#: Share of the tolerance that the reduction may take before a step is chosen.
OF_REDUCTION = 0.97
#: Coordinates that keeping the residual inertia has to save to be worth its time a step.
WORTH = 2
#: Coordinates more that are tried where the fewest leave no room for the error of any step.
ROOM = 2
#: Share of the reduction's part that a step may have where no step is short enough.
SMALL = 0.1
#: Steps up to which a member is simulated to be compared with all modes.
COMPARED = 16_000


@dataclass(frozen=True)
class Found:
    """What the search found; errors are fractions by kind, with margin."""

    member: Member
    steps: int
    reduction: dict[str, float]
    step: dict[str, float]
    total: dict[str, float]  # of both together
    holds: bool  # whether the total is within the tolerance in every kind
    reasons: tuple[str, ...]  # why this model and this step, a clause each
    seconds: float  # wall time of the search; what is compiled or loaded for the first time is not in it


def search(family: Family, demand: Demand, coarse: int) -> Found:
    """The fewest coordinates, then the fewest steps from `coarse` on.

    Raises InputError or SimulationError as for `pmr.simulate.Simulator`, if even the motion of all modes can't be had.
    """
    family.load()
    begin, one = time.perf_counter(), _Search(family, demand, coarse)
    steps = comparable(family.excitation.stepping.steps, coarse)
    member = one.fewest(steps)
    while True:
        rung, reached = one.longest_step(member, steps)
        finer = comparable(rung.steps, coarse)
        if finer <= steps:
            break
        steps, member = finer, one.fitted(member, finer)
    larger = Member(min(member.coordinates + ROOM, family.most), member.residual_inertia)
    if not reached and one.within(member, steps) and larger != member:
        beside, reached = one.longest_step(larger, steps)
        member, rung = (larger, beside) if reached else (member, rung)
    return one.found(member, rung, steps, reached, time.perf_counter() - begin)


def comparable(steps: int, coarse: int) -> int:
    """So many steps, or fewer if that is more than `COMPARED`: a multiple of the coarsest number."""
    while steps > max(coarse, COMPARED):
        steps //= 2
    return steps


class _Search:
    def __init__(self, family: Family, demand: Demand, coarse: int) -> None:
        self.family, self.demand, self.coarse = family, demand, coarse
        self.errors, self.plain = Errors(family, demand, coarse), family.size

    def within(self, member: Member, steps: int) -> bool:
        """Whether the reduction leaves room for the step."""
        return max(self.errors.reduction(member, steps).values()) <= OF_REDUCTION * self.demand.tolerance

    def fewest(self, steps: int) -> Member:
        """The member with fewest coordinates that is within; the largest one if none is."""
        plain = self._smallest(False, steps, self.family.most)
        self.plain = plain.coordinates
        worth = Member(plain.coordinates - WORTH, True)
        asked = self.demand.inertia and self.family.keeps_inertia and worth.coordinates >= self.family.fewest
        return self._smallest(True, steps, worth.coordinates) if asked and self.within(worth, steps) else plain

    def fitted(self, member: Member, steps: int) -> Member:
        """The first one from `member` up that is within, or the last one down; the largest one if none is."""
        one, kept = member.coordinates, member.residual_inertia
        if self.within(member, steps):
            while one > self.family.fewest and self.within(Member(one - 1, kept), steps):
                one -= 1
            return Member(one, kept)
        while one < self.family.most and not self.within(Member(one, kept), steps):
            one += 1
        return Member(one, kept)

    def _smallest(self, inertia: bool, steps: int, top: int) -> Member:
        """Up to `top` coordinates, by doubling and halving: one fewer than the member found fails."""
        low, high = self.family.fewest - 1, min(max(self.family.fewest, 4), top)
        while high < top and not self.within(Member(high, inertia), steps):
            low, high = high, min(2 * high, top)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self.within(Member(middle, inertia), steps) else (middle, high)
        return Member(high, inertia)

    def holds(self, member: Member, rung: Rung, steps: int) -> bool:
        """Whether model and step are within the tolerance together."""
        return rung.settled and max(self.errors.total(member, rung, steps).values()) <= self.demand.tolerance

    def longest_step(self, member: Member, at: int) -> tuple[Rung, bool]:
        """The first rung that holds, beside the reduction's part with `at` steps, and True; else another and False.

        Where the reduction alone is beyond the tolerance, that is the first rung whose own part is small beside it;
        else the last one.
        """
        rung, alone = None, max(self.errors.reduction(member, at).values())
        for rung in rungs(self.family, member, self.coarse, self.demand.kinds):
            if self.holds(member, rung, at):
                before = coarser(self.family, rung, self.coarse)
                return next((one for one in before if self.holds(member, one, at)), rung), True
            part = max(self.errors.size(rung.missing, at).values())
            if rung.settled and part <= SMALL * alone and (1.0 + SMALL) * self.demand.tolerance < alone < np.inf:
                return rung, False
        if rung is None:
            raise SimulationError("no step is short enough to compute the motion with")
        return rung, False

    def found(self, member: Member, rung: Rung, steps: int, reached: bool, seconds: float) -> Found:
        """The result, with reasons."""
        total = self.errors.total(member, rung, steps)
        return Found(
            member=member,
            steps=rung.steps,
            reduction=self.errors.reduction(member, steps),
            step=self.errors.size(rung.missing, steps),
            total=total,
            holds=reached and max(total.values()) <= self.demand.tolerance,
            reasons=(*self._why(member, steps), *self._why_steps(rung, steps)),
            seconds=seconds,
        )

    def _why(self, member: Member, steps: int) -> Iterator[str]:
        r, kept = member.coordinates, member.residual_inertia
        if r > self.family.fewest and self.within(Member(r - 1, kept), steps):
            yield f"{r} coordinates: fewer leave no room for the error of the step"
        elif r > self.family.fewest:
            size = rounded(100.0 * max(self.errors.reduction(Member(r - 1, kept), steps).values()))
            yield f"{r} coordinates: with {r - 1} the reduction alone is off by {size} %"
        else:
            yield f"{r} coordinates: all rigid-body modes, and one mode at least"
        if kept:
            yield f"residual inertia kept: without it {self.plain} coordinates are needed"
        elif not self.demand.inertia:
            yield "residual inertia not kept: of the simulators named, not all can"
        elif not self.family.keeps_inertia:
            cause = "pads only push" if self.family.pushing else "damping couples modes"
            yield f"residual inertia not kept: no model can where {cause}"
        else:
            yield f"residual inertia not kept: it would save fewer than {WORTH} coordinates, and cost more a step"

    def _why_steps(self, rung: Rung, steps: int) -> Iterator[str]:
        before = None
        for one in coarser(self.family, rung, self.coarse):
            before = one
        if before is None:
            fewer = "would take as many parts where pads push" if self.family.pushing else "don't follow path and loads"
            yield f"{rung.steps} steps: fewer {fewer}"
        else:
            size = rounded(100.0 * max(self.errors.size(before.missing, steps).values()))
            yield f"{rung.steps} steps: {before.steps} are off by {size} %"
