"""Limits of outputs that runs, steppers and FMUs watch, with the words of their warnings (`pmr_limits` of the kernel).

A limit is that of a sum of outputs.  Some limits belong to a family, such as the pads of a boom: forces that may be
negative, but by a small share of their other values alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.files.arrays import Array
from pmr.kernel._native import lib
from pmr.kernel.kernel import structure
from pmr.kernel.state import State

#: A force of a family is beyond its limits if it is below zero by more than the share `PULL` of its largest value, or
#: of `BESIDE` times the largest size of all forces of the family if that is more.
PULL, BESIDE = 0.01, 0.1
#: Number of steps from one look at limits that are `seldom` looked at to the next.
SELDOM: int = lib.PMR_SELDOM
#: Limit of what is unlimited, and the least number above zero.
UNLIMITED, ABOVE_ZERO = float(np.finfo(float).max), float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Watch:
    """How steppers and FMUs watch a limit beside other limits."""

    family: str = ""  # empty for a limit that stands by itself
    once: bool = False  # whether limits of the same cause have one warning together
    until: str = ""  # cause of limits with one warning, after which this limit says nothing any more
    seldom: bool = False  # whether it is looked at in each `SELDOM`-th step alone


@dataclass(frozen=True)
class Limit:
    """Smallest and largest value of a sum of outputs without a warning, and the words of the warning.

    If the limit belongs to a family of forces, `low` is negative: a force down to `low` in N may be round-off.
    """

    cause: str  # a run has one warning for all limits of a cause, about the worst
    event: str  # clause that says what happens beyond the limits
    advice: str  # clause that says what that means, with {} for `where`; or empty
    shares: Mapping[str, float]  # factors of the outputs in the sum, by the name of the output
    low: float = -UNLIMITED
    high: float = UNLIMITED
    unit: str = "N"
    where: str = ""  # place to which the advice refers
    extreme: str = " with up to {}"  # clause of a run, with the size of the worst value in place of {}
    watch: Watch = Watch()

    @property
    def message(self) -> str:
        """Warning that a stepper or an FMU gives beyond the limits: the event and, unless it is empty, the advice."""
        return ": ".join(filter(None, (self.event, self.advice.format(self.where))))


class LimitCheck:
    """Check of limits, which remembers of which of them it has warned."""

    def __init__(self, limits: Sequence[Limit], numbers: Mapping[str, int]) -> None:
        """Prepare the check of `limits`; those that are seldom looked at have to come last.

        `numbers` has the numbers of the outputs by name, as `pmr_observe` of the kernel counts them.
        """
        group_of = [limit.cause if limit.watch.once else str(k) for k, limit in enumerate(limits)]
        groups = {group: k for k, group in enumerate(dict.fromkeys(group_of))}
        families = sorted({limit.watch.family for limit in limits} - {""})
        self.limits = tuple(limits)
        #: names of the outputs of all sums, one sum after the other
        self.names = [name for limit in limits for name in limit.shares]
        #: arrays by name, as an FMU reads them
        self.arrays: dict[str, NDArray[np.int32] | Array] = {
            "first": np.cumsum([0, *(len(limit.shares) for limit in limits)], dtype=np.int32),
            "numbers": np.array([numbers[name] for name in self.names], np.int32),
            "shares": np.array([share for limit in limits for share in limit.shares.values()], float),
            "limits": np.array([(limit.low, limit.high) for limit in limits], float).ravel(),
            "groups": np.array([groups[group] for group in group_of], np.int32),
            "until": np.array([groups.get(limit.watch.until, -1) for limit in limits], np.int32),
            "family": np.array([families.index(of.watch.family) if of.watch.family else -1 for of in limits], np.int32),
            "law": np.array([PULL, BESIDE]),
            "often": np.array([sum(not limit.watch.seldom for limit in limits)], np.int32),
        }
        self._values, self._warned = np.zeros(len(self.names)), np.zeros(len(groups), np.int32)
        room = {"values": self._values, "warned": self._warned, "largest": np.zeros(2 * len(limits))}
        sizes = {"count": len(limits), "often": int(self.arrays["often"][0])}
        self.structure = structure("pmr_limits", self.arrays | sizes | room)

    def watch(self, state: State) -> int:
        """Return the number of a limit that does not hold in `state`, and was not returned before; -1 if there is none.

        Of limits that have one warning together (`Watch.once`), only the first that does not hold is returned.
        """
        return int(lib.pmr_watch(state.pointer, self.structure))

    def first_times(self, values: Array) -> dict[int, int]:
        """Number of the first of T times at which a limit does not hold, by the number of the limit.

        `values` (T, o) are the o outputs in `names`.  Limits that hold at all times are left out.

        A negative force of a family may be round-off, so its size is compared with the largest forces of all times.  If
        it is too large beside them, the time is the first at which it is also too large beside the forces up to then.
        A stepper, which knows no later forces, warns at this time.
        """
        so_far, in_all = (self._first_times(values) for _ in range(2))  # the second round knows what is largest
        return {number: so_far[number] for number in in_all}

    def _first_times(self, values: Array) -> dict[int, int]:
        """First times as `first_times`, but negative forces are only compared with the largest forces so far.

        Forces of earlier calls count, too.
        """
        self._warned[:], first = 0, dict[int, int]()
        for k, row in enumerate(values):
            self._values[:] = row
            while (number := lib.pmr_beyond(self.structure, len(self.limits))) >= 0:
                first[number] = k
        return first
