"""What drives a stepper: where its paths lead, its loads and how its frame moves, at the end of a step and before."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.errors import BEYOND_ENDS, InputError
from pmr.errors.text import hint
from pmr.simulation import cubics
from pmr.simulation.moving import MovingFrame
from pmr.system.system import System

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)
#: Angles but that of slewing turn once at most, rad.  A motion that a step takes farther than this share of its range,
#: or of a turn, jumps; one in a frame that goes on by so much, m or rad, without second rates has no inertia.
WHOLE_TURN, JUMP, LEFT_OUT = 2.0 * np.pi, 0.1, 1e-6
#: Of a motion: its value, or that with its rate, or with its rate and its second rate.
Motion = float | Sequence[float]
Values = Mapping[str, float] | Mapping[str, Motion] | ArrayLike
#: Row of `Motions` with the number of rows above it that count.
GIVEN = 3
#: A driver's number, its value, rate and second rate, and how many of these were given.
Taken = tuple[int, float, float, float, int]


class Motions(NamedTuple):
    """Of n drivers in a step."""

    begun: Array  # (4, n): values, rates and second rates where it begins, and how many of these have been given
    ended: Array  # (4, n): where it ends
    step: float  # s: its length


class Driving:
    """Drivers are paths, loads and what moves a frame, n of them; without a frame the loads are the system's inputs.

    What is given at a step is written through memory views, in a tenth of the time that NumPy takes for a number.
    """

    def __init__(self, system: System, ranges: Mapping[str, tuple[float, float]], step: float) -> None:
        self.frame = MovingFrame.of(system)
        if self.frame is None:
            system.ensure_without_terms("stepper")
        self._paths, first = list(ranges), len(ranges)
        self.inputs = list(system.input_names if self.frame is None else self.frame.loads)
        moving = [] if self.frame is None else [*self.frame.angles, *self.frame.axes]
        n = first + len(self.inputs) + len(moving)
        self.motions = Motions(np.zeros((4, n)), np.zeros((4, n)), step)
        ended = self.motions.ended
        ended[GIVEN] = 1.0
        self._order = np.arange(n)  # of the frame's drivers among these
        if self.frame is not None:
            if set(self.frame.paths) != set(ranges):
                raise InputError("stepper", "paths", ", ".join(ranges), f"{', '.join(self.frame.paths)} are allowed")
            self._order[:first] = [self._paths.index(path) for path in self.frame.paths]
            ended[:GIVEN, first:] = self.frame.start[:, first:]
        self.s = ended[0, :first]  # (P,) m
        self.s[:] = np.nan
        self.f = ended[0, first:] if self.frame is None else np.zeros(len(system.input_names))  # (i,) N
        self.c = np.zeros(len(system.terms)) if system.terms else None  # (K,): amplitudes of terms
        self._written: list[Any] = [memoryview(row) for row in ended]
        self._numbers = (
            _numbers(self._paths, 0),
            _numbers(self.inputs, first),
            _numbers(moving, first + len(self.inputs)),
        )
        beyond = [BEYOND_ENDS * (high - low) for low, high in ranges.values()]
        self._ranges = [(low, high, low - b, high + b) for (low, high), b in zip(ranges.values(), beyond, strict=True)]
        self._missing, self._begun, self._told = True, False, set[str]()
        angles = () if self.frame is None else tuple(self.frame.angles)
        self._angles = {self._numbers[2][name]: name for name in angles}
        self._moves = [*range(first if self.frame is not None else 0), *self._angles]  # with an inertia of their own

    def leave(self) -> None:
        """Note where a step ended; without a frame compiled code does (`pmr.simulation.native.stepped`)."""
        begun, ended, _ = self.motions
        if self._begun:
            self._check_second_rates()
        self._begun = True
        begun[:] = ended
        ended[GIVEN] = 1.0

    def take_path(self, s: Values) -> None:
        """Where paths lead; an InputError is raised where one leaves its range, or is missing at the start."""
        taken = _taken(s, self._numbers[0], "s", "one path coordinate for each path")
        for n, (k, at, rate, second, count) in enumerate(taken):
            low, high, least, most = self._ranges[k]
            if not low <= at <= high:
                if not least <= at <= most:
                    allowed = f"{low:g} to {high:g} m is allowed"
                    raise InputError("stepper", f"s.{self._paths[k]}", at, allowed)
                taken[n] = k, min(max(at, low), high), rate, second, count
            if abs(rate) * self.motions.step > high - low:
                fastest = f"{(high - low) / self.motions.step:g} m/s, its range in a step, is allowed at most"
                raise InputError("stepper", f"s.{self._paths[k]}", [at, rate, second][:count], fastest)
            self.note_path(k, at)
        if self._missing:
            if len({k for k, *_ in taken}) < len(self._paths):
                raise InputError("stepper", "s", None, f"all paths are needed at the start: {', '.join(self._paths)}")
            self._missing = False
        self._take(taken)

    def take_loads(self, F: Values) -> None:
        """Loads, as they are or as a frame turns them."""
        what = "one load for each input"
        if _by_name(F):
            return self._take(_taken(F, self._numbers[1], "F", what))
        ended, own = self.motions.ended, slice(len(self._paths), len(self._paths) + len(self.inputs))
        ended[0, own], ended[GIVEN, own] = _in_order(F, self._numbers[1], "F", what), 1.0

    def take_frame(self, frame: Mapping[str, Motion]) -> None:
        """How the frame moves."""
        taken = _taken(frame, self._numbers[2], "frame", "")
        for k, value, *_ in taken:
            name = self._angles.get(k)
            if name not in (None, "slewing") and abs(value) > WHOLE_TURN:
                raise InputError("stepper", f"frame.{name}", value, "at most one turn is allowed, 2 pi: it is in rad")
            if name is not None and self._begun:
                self._note(name, abs(value - self.motions.ended[0, k]), WHOLE_TURN, "rad")
        self._take(taken)

    def note_path(self, k: int, at: float) -> None:
        """Warn, once, of a path that a step takes so far, to `at` m, that it jumps."""
        if not self._missing:
            low, high, *_ = self._ranges[k]
            self._note(self._paths[k], abs(at - self.s[k]), high - low, "m")

    def _note(self, name: str, change: float, whole: float, unit: str) -> None:
        if change > JUMP * whole and name not in self._told:
            self._told.add(name)
            said = "%s jumps by %g %s in a step of %g s, which excites what no boom does: give it at each step, in %s"
            logger.warning(said, name, change, unit, self.motions.step, unit)

    def _check_second_rates(self) -> None:
        """Warn, once, of what moves in a frame without second rates."""
        (begun, ended, h), at = self.motions, self._moves
        off = np.abs(ended[0, at] - begun[0, at] - h * begun[1, at])
        for n in np.flatnonzero((off > LEFT_OUT) & (begun[2, at] == 0.0) & (ended[2, at] == 0.0)):
            name = self._angles.get(at[n]) or self._paths[at[n]]
            if name not in self._told:
                self._told.add(name)
                said = "%s moves without a second rate, so the inertia of what moves is left out: both rates are needed"
                logger.warning(said, name)

    def find(self) -> None:
        """Amplitudes of inputs and terms from the frame's motion at the end of the step."""
        if self.frame is not None:
            self.f[:], c = self.frame.find(self.motions.ended[:GIVEN, self._order])
            if self.c is not None:
                self.c[:] = c

    def samples(self, parts: int) -> tuple[Array, Array, Array]:
        """Paths (parts + 1, P), loads (., i) and amplitudes (., K) at equal parts of a step, its beginning included.

        With a frame; without one compiled code finds them (`pmr.simulation.native.stepped`).
        """
        assert self.frame is not None
        at = [self.motions.begun, *self._between(parts), self.motions.ended]
        found = [self.frame.find(motions[:GIVEN, self._order]) for motions in at]
        s = np.array([motions[0, : len(self._paths)] for motions in at])
        return s, np.array([f for f, _ in found]), np.array([c for _, c in found])

    def _between(self, parts: int) -> list[Array]:
        """Motions (3, n) of the drivers at the parts of a step but its ends."""
        if parts == 1:
            return []
        (begun, ended, step), lines = self.motions, cubics.by_lines
        both = np.minimum(begun[GIVEN], ended[GIVEN])
        smooth = cubics.by_rates(begun[0], ended[0], begun[1], ended[1], step)
        led_on = np.where(both >= 2, smooth, lines(begun[0], ended[0], step))
        accelerated = cubics.by_second_rates(begun[0], ended[0], begun[2], ended[2], step)
        led_on = np.where(both >= 3, accelerated, led_on)
        return [cubics.after(led_on, step * k / parts) for k in range(1, parts)]

    def _take(self, taken: list[Taken]) -> None:
        values, rates, seconds, given = self._written
        for k, value, rate, second, count in taken:
            values[k], given[k] = value, count
            if count > 1 or self.frame is not None:  # else nobody asks for them
                rates[k], seconds[k] = rate, second


def _numbers(names: Sequence[str], first: int) -> dict[str | int, int]:
    """Of drivers among all, by their names, in their order, and then by their numbers among these."""
    return {name: first + k for k, name in enumerate(names)} | {k: first + k for k in range(len(names))}


def number_of(name: str | int, names: list[str], key: str) -> int:
    """Of a name among all, or a number as it is."""
    if not isinstance(name, str) and 0 <= name < len(names):
        return int(name)
    if name not in names:
        raise InputError("stepper", key, name, f"{hint(name, names)}{', '.join(names) or 'none'} are allowed")
    return names.index(str(name))


def _by_name(values: Values) -> TypeGuard[Mapping[str, Motion]]:
    return type(values) is dict or isinstance(values, Mapping)  # the former is known sooner


def _taken(values: Values, numbers: Mapping[str | int, int], key: str, what: str) -> list[Taken]:
    """Motions that were given by name, or of all in their order, by their numbers."""
    if not _by_name(values):
        in_order = _in_order(values, numbers, key, what).tolist()
        return [(k, value, 0.0, 0.0, 1) for k, value in zip(numbers.values(), in_order, strict=False)]
    found = list[Taken]()
    for name, motion in values.items():
        if name not in numbers:
            number_of(name, _names(numbers), key)  # refused
        if isinstance(motion, float) and isfinite(motion):
            found.append((numbers[name], motion, 0.0, 0.0, 1))
        elif type(motion) is tuple and [*map(type, motion)] == [float, float] and isfinite(sum(motion)):
            found.append((numbers[name], motion[0], motion[1], 0.0, 2))
        else:
            value, rate, second = [*(given := _motion(motion, f"{key}.{_name(name, numbers)}")), 0.0, 0.0][:3]
            found.append((numbers[name], value, rate, second, len(given)))
    return found


def _names(numbers: Mapping[str | int, int]) -> list[str]:
    return [name for name in numbers if isinstance(name, str)]


def _name(name: str | int, numbers: Mapping[str | int, int]) -> str:
    return name if isinstance(name, str) else _names(numbers)[name]


def _in_order(values: Values, numbers: Mapping[str | int, int], key: str, what: str) -> Array:
    """Values of all drivers."""
    names = len(numbers) // 2
    array = np.asarray(values, dtype=float)
    if array.shape != (names,) and not (array.ndim == 0 and names == 1):
        allowed = f"{what} is allowed, in this order: {', '.join(_names(numbers)) or 'none'}; or some by their names"
        raise InputError("stepper", key, array.tolist(), allowed)
    if not np.isfinite(array).all():
        raise InputError("stepper", key, array.tolist(), "finite numbers are allowed")
    return array.ravel()


def _motion(value: Motion, key: str) -> list[float]:
    """Value, and as far as they are given rate and second rate."""
    given = np.atleast_1d(np.asarray(value, float))
    if given.ndim != 1 or not 1 <= len(given) <= 3:
        allowed = "a value, or that with its rate and its second rate, is allowed"
        raise InputError("stepper", key, given.tolist(), allowed)
    if not np.isfinite(given).all():
        raise InputError("stepper", key, value, "finite numbers are allowed")
    return list(given.tolist())
