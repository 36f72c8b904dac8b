r"""Errors of a family's members: against all modes, by a step, and both together.

What a step is off by is known from runs with ever shorter ones,

.. math::
    y_h - y \approx \frac{y_h - y_{h/4}}{1 - \rho^2}, \qquad
    \rho = \lVert y_{h/2} - y_{h/4} \rVert / \lVert y_h - y_{h/2} \rVert

as a geometric series (`pmr.compare.step_error`); rho is 1/4 for a scheme of second order, 1/2 behind a kink.  What the
scheme's own damping takes away comes on top, the difference of two runs with the step h.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from pmr.compare.accuracy.family import Family, Member
from pmr.compare.estimate import MARGIN, MARGIN_OF_ALL_MODES
from pmr.compare.halved_steps import ROUGH
from pmr.compare.outputs import Outputs, differences
from pmr.errors import SimulationError
from pmr.simulation.resolution import unseen


@dataclass(frozen=True)
class Demand:
    """What is asked for."""

    tolerance: float  # largest error in each of the `kinds`, a fraction
    kinds: Sequence[str]  # of `pmr.compare.outputs.KINDS`
    taken: Mapping[str, float] = field(default_factory=dict)  # by kind what the mesh takes of it

    def share(self, errors: Mapping[str, float]) -> float:
        """The largest error, as a share of what is left of the tolerance for it."""
        return max(errors[kind] / (self.tolerance - self.taken.get(kind, 0.0)) for kind in self.kinds)


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
            fewer = self.missing(self.family.less, steps)
            found = dict.fromkeys(self.demand.kinds, float("inf")) if fewer is None else self.size(fewer, steps)
            self._unsure[steps] = found
        return self._unsure[steps]

    def reduction(self, member: Member, steps: int) -> dict[str, float]:
        """Error of the reduction by kind, with an estimate's margin and what is unsure; infinite where nothing moves.

        Modes that all members lack move at other frequencies than those that this one lacks, so squares are added.
        """
        missing = self.missing(member, steps)
        if missing is None:
            return dict.fromkeys(self.demand.kinds, float("inf"))
        unsure = self.unsure(steps)
        return {kind: float(np.hypot(size, unsure[kind])) for kind, size in self.size(missing, steps, MARGIN).items()}

    def size(self, missing: Outputs, steps: int, margin: float = MARGIN_OF_ALL_MODES) -> dict[str, float]:
        """Error by kind, with margin."""
        best = self.best(steps)
        found = differences(best.minus(missing), best, self._floors, self.demand.kinds)
        return {kind: margin * share for kind, share in found.items()}

    def step(self, rung: Rung, steps: int) -> dict[str, float]:
        """A rung's part, by kind; no less than a run with its step says of it."""
        of_run = self.family.step_error(rung.member, rung.steps)
        return {kind: max(share, getattr(of_run, kind, 0.0)) for kind, share in self.size(rung.missing, steps).items()}

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


#: Steps of a run up to which shorter ones are tried.
LONGEST = 2_100_000
#: The same of several bodies, a step of which costs ten times as much.
LONGEST_OF_SEVERAL = 256_000
#: How often the step that a scene names is doubled at most.
COARSER = 6
#: Steps that a motion has at least.
FEWEST = 20


@dataclass(frozen=True)
class Rung:
    """A number of steps, and what they make of the motion."""

    member: Member  # whose motion it is
    steps: int
    missing: Outputs  # what the exact motion has beyond that of these steps, at the times of the coarsest rung
    settled: bool  # whether runs with shorter steps approach each other; else it is only a part of the error


def coarsest(family: Family, every: float | None = None) -> int:
    """The fewest steps, halves of the given number, that follow path and loads; `every` so many seconds one ends.

    Where rows only push it is the given number: steps take as many parts as impacts need, so longer ones save nothing.
    """
    given = family.excitation.stepping
    steps = given.steps
    if family.pushing:
        return steps
    for _ in range(COARSER):
        half = family.with_steps(max(1, steps // 2))
        share = 0.0 if every is None else every / half.stepping.step
        if steps % 2 or steps < 2 * FEWEST or abs(share - round(share)) > 1e-9 * share:
            break
        if unseen(half.signals, half.stepping):
            break
        steps = half.stepping.steps
    return steps


def rungs(family: Family, member: Member, coarse: int, kinds: Sequence[str]) -> Iterator[Rung]:
    """From the coarsest one on, each half the step of the one before, until runs become too long.

    A step with which the motion can't be computed is passed over.
    """
    steps, longest = coarse, LONGEST_OF_SEVERAL if family.costs_much(member) else LONGEST
    floors, runs = family.floors(coarse), list[tuple[int, Outputs]]()

    def apart(one: Outputs, other: Outputs) -> float:
        return max(differences(one, other, floors, kinds).values())

    while steps <= longest:
        try:
            runs.append((steps, family.motion(member, steps, coarse)))
        except SimulationError:
            runs.clear()
        steps *= 2
        if len(runs) < 3:
            continue
        (count, first), (_, second), (_, third) = runs[-3:]
        before, after = apart(first, second), apart(second, third)
        ratio = after / before if before > 0.0 else 0.0
        missing = third.minus(first).times(1.0 / (1.0 - min(ratio, ROUGH) ** 2))
        with suppress(SimulationError):
            damped = first.minus(family.own(member, count, coarse))
            yield Rung(member, count, missing.plus(damped), ratio <= ROUGH)


def coarser(family: Family, rung: Rung, coarse: int) -> Iterator[Rung]:
    """All rungs before one that is settled, from the coarsest on: what they leave out is known from that one.

    Some of them are not settled by themselves, and good enough all the same.
    """
    exact = family.own(rung.member, rung.steps, coarse).plus(rung.missing)
    steps = coarse
    while steps < rung.steps:
        try:
            yield Rung(rung.member, steps, exact.minus(family.own(rung.member, steps, coarse)), True)
        except SimulationError:
            pass
        steps *= 2
