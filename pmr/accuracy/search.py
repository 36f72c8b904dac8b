r"""The smallest model and the longest step that hold a tolerance.

With y_N the motion of all modes that a reduction has (the inertia of the rest kept), the error of r modes and step h is

.. math::
    e = \underbrace{(y_{N,h} - y_{r,h})}_{\text{reduction}} + \underbrace{(y_{r,0} - y_{r,h})}_{\text{step}}, \qquad
    1.1 \max(\lVert e \rVert, \lVert e_{reduction} \rVert, \lVert e_{step} \rVert) \le \text{tolerance}

in every kind of output that is asked for.  The first part is the error estimate with N - r enrichment modes
(`pmr.compare.estimate`), the second comes from shorter steps (`pmr.accuracy.steps`).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from pmr.accuracy.family import Family, Member
from pmr.accuracy.steps import Rung, coarser, rungs
from pmr.compare.outputs import Outputs, differences
from pmr.errors import SimulationError
from pmr.text import rounded

#: Of all errors; they are known better than an estimate by a few enrichment modes, whose margin is 1.25.
MARGIN = 1.1
#: Share of the tolerance that the reduction may take before a step is chosen.
OF_REDUCTION = 0.97
#: Coordinates that keeping the residual inertia has to save to be worth its time a step.
WORTH = 2
#: Steps up to which a member is simulated to be compared with all modes.
COMPARED = 16_000


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


@dataclass(frozen=True)
class Found:
    """What the search found.

    Attributes
    ----------
    member : Member
    steps : int
    reduction, step, total : mappings of kind to fraction
        Errors with margin; each by itself, and both together.
    holds : bool
        Whether the total is within the tolerance in every kind.
    reasons : tuple of str
        Why this model and this step, a clause each.
    seconds : float
        Wall time of the search.
    """

    member: Member
    steps: int
    reduction: dict[str, float]
    step: dict[str, float]
    total: dict[str, float]
    holds: bool
    reasons: tuple[str, ...]
    seconds: float


def search(family: Family, demand: Demand, coarse: int) -> Found:
    """The fewest coordinates, then the fewest steps from `coarse` on.

    Raises
    ------
    InputError, SimulationError
        As for `pmr.simulate.Simulator`, if even the motion of all modes can't be had.
    """
    begin, one = time.perf_counter(), _Search(family, demand, coarse)
    steps = _comparable(family.excitation.stepping.steps, coarse)
    member = one.fewest(steps)
    while True:
        rung, reached = one.longest_step(member, steps)
        finer = _comparable(rung.steps, coarse)
        if finer <= steps:
            break
        steps, member = finer, one.enlarged(member, finer)
    return one.found(member, rung, steps, reached, time.perf_counter() - begin)


def _comparable(steps: int, coarse: int) -> int:
    """So many steps, or fewer if that is more than `COMPARED`: a multiple of the coarsest number."""
    while steps > max(coarse, COMPARED):
        steps //= 2
    return steps


class _Search:
    def __init__(self, family: Family, demand: Demand, coarse: int) -> None:
        self.family, self.demand, self.coarse = family, demand, coarse
        self.floors = family.floors(coarse)
        self.plain = family.size
        self._best: dict[int, Outputs] = {}
        self._missing: dict[tuple[Member, int], Outputs | None] = {}

    def best(self, steps: int) -> Outputs:
        """Motion of all modes."""
        if steps not in self._best:
            self._best[steps] = self.family.motion(self.family.best, steps, self.coarse)
        return self._best[steps]

    def missing(self, member: Member, steps: int) -> Outputs | None:
        """What all modes have beyond a member; None where its motion can't be computed."""
        if (member, steps) not in self._missing:
            try:
                own = self.family.motion(member, steps, self.coarse)
                self._missing[member, steps] = self.best(steps).minus(own)
            except SimulationError:
                self._missing[member, steps] = None
        return self._missing[member, steps]

    def size(self, missing: Outputs, steps: int) -> dict[str, float]:
        """Error by kind, with margin."""
        best = self.best(steps)
        found = differences(best.minus(missing), best, self.floors, self.demand.kinds)
        return {kind: MARGIN * share for kind, share in found.items()}

    def within(self, member: Member, steps: int) -> bool:
        """Whether the reduction leaves room for the step."""
        missing = self.missing(member, steps)
        if missing is None:
            return False
        return max(self.size(missing, steps).values()) <= OF_REDUCTION * self.demand.tolerance

    def fewest(self, steps: int) -> Member:
        """The member with fewest coordinates that is within; the largest one if none is."""
        plain = self._smallest(False, steps)
        self.plain = plain.coordinates
        if not (self.demand.inertia and self.family.keeps_inertia):
            return plain
        inertial = self._smallest(True, steps)
        return inertial if inertial.coordinates <= plain.coordinates - WORTH else plain

    def enlarged(self, member: Member, steps: int) -> Member:
        """The first one from `member` on that is within; the largest one if none is."""
        while member.coordinates < self.family.size - 1 and not self.within(member, steps):
            member = Member(member.coordinates + 1, member.residual_inertia)
        return member

    def _smallest(self, inertia: bool, steps: int) -> Member:
        """By doubling and halving; every size between the last that fails and the first that holds is tried."""
        low, high = self.family.fewest - 1, max(self.family.fewest, 4)
        top = self.family.size - 1
        while high < top and not self.within(Member(high, inertia), steps):
            low, high = high, min(2 * high, top)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self.within(Member(middle, inertia), steps) else (middle, high)
        return Member(min(high, top), inertia)

    def total(self, member: Member, rung: Rung, steps: int) -> dict[str, float]:
        """Both parts together, by kind; no less than the larger one."""
        missing = self.missing(member, steps)
        if missing is None:
            return dict.fromkeys(self.demand.kinds, float("inf"))
        sizes = [self.size(part, steps) for part in (missing, rung.missing, missing.plus(rung.missing))]
        return {kind: max(size[kind] for size in sizes) for kind in self.demand.kinds}

    def holds(self, member: Member, rung: Rung, steps: int) -> bool:
        """Whether model and step are within the tolerance together."""
        return rung.settled and max(self.total(member, rung, steps).values()) <= self.demand.tolerance

    def longest_step(self, member: Member, at: int) -> tuple[Rung, bool]:
        """The first rung that holds, beside the reduction's part with `at` steps, and True; else the last and False."""
        rung = None
        for rung in rungs(self.family, member, self.coarse, self.demand.kinds):
            if self.holds(member, rung, at):
                before = coarser(self.family, rung, self.coarse)
                return next((one for one in before if self.holds(member, one, at)), rung), True
        if rung is None:
            raise SimulationError("no step is short enough to compute the motion with")
        return rung, False

    def found(self, member: Member, rung: Rung, steps: int, reached: bool, seconds: float) -> Found:
        """The result, with reasons."""
        unknown, missing = dict.fromkeys(self.demand.kinds, float("inf")), self.missing(member, steps)
        total = self.total(member, rung, steps)
        return Found(
            member=member,
            steps=rung.steps,
            reduction=unknown if missing is None else self.size(missing, steps),
            step=self.size(rung.missing, steps),
            total=total,
            holds=reached and max(total.values()) <= self.demand.tolerance,
            reasons=(*self._why(member, steps), *self._why_steps(rung, steps)),
            seconds=seconds,
        )

    def _why(self, member: Member, steps: int) -> Iterator[str]:
        r, kept = member.coordinates, member.residual_inertia
        tried = sorted(one.coordinates for one, at in self._missing if one.residual_inertia == kept and one != member)
        fewer = [one for one in tried if one < r]
        missing = self.missing(Member(fewer[-1], kept), steps) if fewer else None
        if missing is not None:
            size = rounded(100.0 * max(self.size(missing, steps).values()))
            yield f"{r} coordinates: with {fewer[-1]} the reduction alone is off by {size} %"
        else:
            yield f"{r} coordinates: the fewest that were tried"
        if kept:
            yield f"residual inertia kept: without it {self.plain} coordinates are needed"
        elif not self.demand.inertia:
            yield "residual inertia not kept: of the simulators named, not all can"
        else:
            yield f"residual inertia not kept: it would save fewer than {WORTH} coordinates, and cost more a step"

    def _why_steps(self, rung: Rung, steps: int) -> Iterator[str]:
        if rung.steps == self.coarse:
            yield f"{rung.steps} steps: fewer don't follow path and loads"
        else:
            before = next(one for one in coarser(self.family, rung, self.coarse) if 2 * one.steps == rung.steps)
            size = rounded(100.0 * max(self.size(before.missing, steps).values()))
            yield f"{rung.steps} steps: half as many are off by {size} %"
