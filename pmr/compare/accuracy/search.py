r"""The smallest model and the longest step that hold a tolerance.

With y_N the motion of all modes that a reduction has, and of attachment modes, which are static answers to the loads on
contacts, the error of r modes and step h is

.. math::
    e = \underbrace{(y_{N,h} - y_{r,h})}_{\text{reduction}} + \underbrace{(y_{r,0} - y_{r,h})}_{\text{step}}, \qquad
    \max(1.1 \lVert e \rVert, 1.25 \lVert e_{reduction} \rVert, 1.1 \lVert e_{step} \rVert) \le \text{tolerance}

in every kind of output that is asked for.  The first part is the error estimate with N - r enrichment modes
(`pmr.compare.estimate`), the second comes from shorter steps (`pmr.compare.accuracy.errors`), and is no less than what
the run itself says of its step (`pmr.compare.step_error`).  What is found is judged by the estimate of its own run,
with its step and its rho_inf; where that is beyond the tolerance, the search goes on with as much less.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from pmr.compare.accuracy.errors import Demand, Errors, Rung, coarser, rungs
from pmr.compare.accuracy.family import Family, Member
from pmr.compare.estimate import Estimate
from pmr.compare.step_error import StepError
from pmr.errors import SimulationError
from pmr.errors.text import rounded

#: Share of the tolerance that the reduction may take before a step is chosen.
OF_REDUCTION = 0.97
#: Share of the reduction's part that a step may have where no step is short enough.
SMALL = 0.1
#: Steps up to which a member is simulated to be compared with all modes.
COMPARED = 64_000
#: How often the search goes on where what it finds doesn't hold by its own estimate, at most.
TRIES = 4


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
    estimate: Estimate | None = None  # of a run with this model and this step, if there is one
    step_error: StepError | None = None  # what the same run says of its step


def search(family: Family, demand: Demand, coarse: int) -> Found:
    """The fewest coordinates, then the fewest steps from `coarse` on.

    Raises InputError or SimulationError as for `pmr.simulation.Simulator`, if even the motion of all modes can't be
    had.
    """
    family.load()
    begin, errors, less = time.perf_counter(), Errors(family, demand, coarse), 1.0
    for _ in range(TRIES):
        found, seen = _found(_Search(errors, demand, less))
        beyond = demand.share(found.total)
        if seen is None or beyond <= 1.0 or not np.isfinite(beyond):
            break
        less = 0.99 * min(less, seen) / beyond
    return replace(found, holds=seen is not None and beyond <= 1.0, seconds=time.perf_counter() - begin)


def _found(one: _Search) -> tuple[Found, float | None]:
    """What holds as far as the search can see, and the share of the tolerance that it sees; else the best, and None."""
    family, coarse = one.family, one.coarse
    steps = comparable(family.excitation.stepping.steps, coarse)
    family.begin(family.less, steps, coarse)
    while True:
        member = one.fewest(steps)
        if family.pushing:  # hardly any search leaves the steps that it begins with
            family.begin_estimate(member, coarse)
        rung, reached = one.longest_step(member, steps)
        finer = comparable(rung.steps, coarse)
        if finer <= steps:
            break
        steps = finer
    larger = family.roomier(member)
    if not reached and one.within(member, steps) and larger != member:
        beside, reached = one.longest_step(larger, steps)
        member, rung = (larger, beside) if reached else (member, rung)
    seen = one.demand.share(one.errors.total(member, rung, steps)) if reached else None
    return judged(one.errors, member, rung, steps, one.reasons(member, rung, steps)), seen


def judged(errors: Errors, member: Member, rung: Rung, steps: int, reasons: tuple[str, ...]) -> Found:
    """A choice with its errors, compared with `steps` and as its own run tells them; not yet whether it holds."""
    estimate = errors.family.estimate(member, rung.steps)
    of_run = {kind: 0.0 if estimate is None else estimate.of(kind) for kind in errors.demand.kinds}
    reduction, total = errors.reduction(member, steps), errors.total(member, rung, steps)
    step = errors.step(rung, steps)
    return Found(
        member=member,
        steps=rung.steps,
        reduction={kind: max(share, of_run[kind]) for kind, share in reduction.items()},
        step=step,
        total={kind: max(share, of_run[kind], step[kind]) for kind, share in total.items()},
        holds=False,
        reasons=reasons,
        seconds=0.0,
        estimate=estimate,
        step_error=errors.family.step_error(member, rung.steps),
    )


def comparable(steps: int, coarse: int) -> int:
    """So many steps, or fewer if that is more than `COMPARED`: a multiple of the coarsest number."""
    while steps > max(coarse, COMPARED):
        steps //= 2
    return steps


class _Search:
    def __init__(self, errors: Errors, demand: Demand, less: float) -> None:
        self.errors, self.demand, self.less = errors, demand, less  # so much of the tolerance is searched with
        self.family, self.coarse = errors.family, errors.coarse

    def within(self, member: Member, steps: int) -> bool:
        """Whether the reduction leaves room for the step."""
        return self.demand.share(self.errors.reduction(member, steps)) <= OF_REDUCTION * self.less

    def fewest(self, steps: int) -> Member:
        """The member with fewest coordinates that is within; the largest one if none is."""
        return self._without_what_it_can_spare(self._smallest(steps), steps)

    def _smallest(self, steps: int) -> Member:
        """By doubling and halving: one fewer than the member found has fails."""
        top = self.family.most
        low, high = self.family.fewest - 1, min(max(self.family.fewest, 4), top)
        while high < top and not self.within(self.family.member(high), steps):
            low, high = high, min(2 * high, top)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self.within(self.family.member(middle), steps) else (middle, high)
        return self.family.member(high)

    def _without_what_it_can_spare(self, member: Member, steps: int) -> Member:
        """With fewer coordinates of one body after the other, as long as the rest is within."""
        for body in range(len(member.sizes)):
            while len(fewer := self._fewer(member, body)) and self.within(fewer[0], steps):
                member = fewer[0]
        return member

    def _fewer(self, member: Member, body: int) -> list[Member]:
        """The member with one coordinate of a body less, if there is one."""
        return [one for one in self.family.neighbours(member, -1) if one.sizes[body] < member.sizes[body]]

    def together(self, member: Member, rung: Rung, steps: int) -> bool:
        """Whether model and step are within the tolerance together."""
        return rung.settled and self.demand.share(self.errors.total(member, rung, steps)) <= self.less

    def holds(self, member: Member, rung: Rung, steps: int) -> bool:
        """The same, and whether the step is as the run itself says, which takes runs of its own."""
        return self.together(member, rung, steps) and self.demand.share(self.errors.step(rung, steps)) <= 1.0

    def longest_step(self, member: Member, at: int) -> tuple[Rung, bool]:
        """The first rung that holds, beside the reduction's part with `at` steps, and True; else another and False.

        Where the reduction alone is beyond the tolerance, that is the first rung whose own part is small beside it;
        else the last one.
        """
        rung, alone = None, self.demand.share(self.errors.reduction(member, at))
        for rung in rungs(self.family, member, self.coarse, self.demand.kinds):
            if self.together(member, rung, at):
                for one in chain(coarser(self.family, rung, self.coarse), (rung,)):
                    if self.holds(member, one, at):
                        return one, True
            part = self.demand.share(self.errors.size(rung.missing, at))
            if rung.settled and part <= SMALL * alone and (1.0 + SMALL) * self.less < alone < np.inf:
                return rung, False
        if rung is None:
            raise SimulationError("no step is short enough to compute the motion with")
        return rung, False

    def reasons(self, member: Member, rung: Rung, steps: int) -> tuple[str, ...]:
        """Why this model and this step, a clause each."""
        return (*self._why(member, steps), *self._why_steps(rung, steps))

    def _why(self, member: Member, steps: int) -> Iterator[str]:
        r = member.coordinates
        if fewer := self.family.neighbours(member, -1):
            least = min(max(self.errors.reduction(one, steps).values()) for one in fewer)
            if any(self.within(one, steps) for one in fewer):
                yield f"{r} coordinates: fewer leave no room for the error of the step"
            else:
                yield f"{r} coordinates: with {r - 1} the reduction alone is off by {rounded(100.0 * least)} %"
        else:
            yield f"{r} coordinates: all rigid-body modes, and one mode at least"

    def _why_steps(self, rung: Rung, steps: int) -> Iterator[str]:
        before = None
        for one in coarser(self.family, rung, self.coarse):
            before = one
        if before is None:
            fewer = "would take as many parts where pads push" if self.family.pushing else "don't follow path and loads"
            yield f"{rung.steps} steps: fewer {fewer}"
        else:
            size = rounded(100.0 * max(self.errors.step(before, steps).values()))
            yield f"{rung.steps} steps: {before.steps} are off by {size} %"
