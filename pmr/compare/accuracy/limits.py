"""The best model that some coordinates or some time allow, and its error."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pmr.compare.accuracy.errors import Demand, Errors, Rung, rungs
from pmr.compare.accuracy.family import Family, Member
from pmr.compare.accuracy.search import Found, comparable, judged
from pmr.errors import InputError
from pmr.errors.text import rounded
from pmr.scene.asked import Budget

#: Steps over which a step is timed, and how often.
TIMED, TIMES = 4096, 3


@dataclass(frozen=True)
class _Option:
    member: Member
    rung: Rung


def best_within(family: Family, demand: Demand, budget: Budget, coarse: int) -> Found:
    """The member with the smallest error that a budget allows; the tolerance of the demand does not count.

    By coordinates or by the time of a step: the most that are allowed, with the longest step whose part of the error is
    no more than theirs.  By real time: for each step as many coordinates as there is time for.  Raises InputError if
    not even the smallest model is within it; SimulationError as for `pmr.compare.accuracy.search.search`.
    """
    family.load()
    begin, errors = time.perf_counter(), Errors(family, demand, coarse)
    options = list(_options(errors, budget))
    if not options:
        key = "microseconds_per_step" if budget.real_time is None else "real_time"
        took = seconds_a_step(family, family.member(family.fewest))
        allowed = f"the smallest model takes {rounded(took * 1e6)} us a step here"
        raise InputError("scene", f"budget.{key}", getattr(budget, key), allowed)

    def total(option: _Option) -> dict[str, float]:
        return errors.total(option.member, option.rung, comparable(option.rung.steps, coarse))

    best = min(options, key=lambda option: max(total(option).values()))
    at, took = comparable(best.rung.steps, coarse), seconds_a_step(family, best.member)
    ratio = family.end / (took * best.rung.steps)
    reasons = (
        f"{best.member.coordinates} coordinates are what the budget allows",
        f"a step takes {rounded(took * 1e6)} us here: {rounded(ratio)} times real time",
    )
    found = judged(errors, best.member, best.rung, at, reasons)
    return replace(found, holds=True, seconds=time.perf_counter() - begin)


def seconds_a_step(family: Family, member: Member) -> float:
    """Least time that `march` takes for a step of a member, on this machine."""
    return min(family.seconds(member, TIMED) for _ in range(TIMES)) / TIMED


def _options(errors: Errors, budget: Budget) -> Iterator[_Option]:
    """Models within the budget, each with a step."""
    family, coarse = errors.family, errors.coarse
    if budget.real_time is None:
        member = _most_coordinates(errors, budget.coordinates) if budget.coordinates else None
        member = member or _largest(family, budget, np.inf)
        if member is not None:
            yield _Option(member, _balanced(errors, member))
        return
    probe = family.member(min(8, family.most))
    for rung in rungs(family, probe, coarse, errors.demand.kinds):
        member = _largest(family, budget, family.end / (rung.steps * budget.real_time))
        if member is None:
            return
        yield _Option(member, rung)


def _most_coordinates(errors: Errors, allowed: int) -> Member:
    """The best member with so many coordinates: from the smallest one on, each goes where it helps most.

    Raises InputError if motions need more than are allowed.
    """
    family, at = errors.family, comparable(errors.family.excitation.stepping.steps, errors.coarse)
    member = family.member(family.fewest)
    if allowed < member.coordinates and len(member.sizes) > 1:
        least = f"at least {member.coordinates} are needed"
        needed = f"{least}: rigid-body motions, one mode of each section, those of cylinders"
        raise InputError("scene", "budget.coordinates", allowed, needed)
    while member.coordinates < allowed and (more := family.neighbours(member, 1)):
        member = more[0] if len(more) == 1 else min(more, key=lambda one: max(errors.reduction(one, at).values()))
    return member


def _largest(family: Family, budget: Budget, seconds: float) -> Member | None:
    """The member with most modes that a budget and the seconds a step allow."""
    if budget.microseconds_per_step is not None:
        seconds = 1e-6 * budget.microseconds_per_step
    low, high, middle = family.fewest - 1, family.most + 1, family.most
    while high - low > 1:  # all of them first: most budgets of time are generous
        low, high = (middle, high) if seconds_a_step(family, family.member(middle)) <= seconds else (low, middle)
        middle = (low + high) // 2
    return family.member(low) if low >= family.fewest else None


def _balanced(errors: Errors, member: Member) -> Rung:
    """The longest step whose part is no more than that of the reduction; else the shortest that was tried."""
    rung = None
    for rung in rungs(errors.family, member, errors.coarse, errors.demand.kinds):
        at = comparable(rung.steps, errors.coarse)
        size, most = (max(part.values()) for part in (errors.size(rung.missing, at), errors.reduction(member, at)))
        if rung.settled and size <= most and max(errors.step(rung, at).values()) <= most:
            return rung
    assert rung is not None
    return rung
