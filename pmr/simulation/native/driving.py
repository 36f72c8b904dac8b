"""What drives a stepper: where its paths lead, its loads and how its frame moves, at the end of a step and before."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.errors import BEYOND_ENDS, InputError
from pmr.errors.text import hint
from pmr.simulation import cubics
from pmr.simulation.moving import MovingFrame
from pmr.system.system import System

Array = NDArray[np.float64]
#: Of a motion: its value, or that with its rate, or with its rate and its second rate.
Motion = float | Sequence[float]
Values = Mapping[str, float] | Mapping[str, Motion] | ArrayLike


class Driving:
    """Drivers are paths, loads and what moves a frame, n of them; without a frame the loads are the system's inputs."""

    def __init__(self, system: System, ranges: Mapping[str, tuple[float, float]]) -> None:
        self.frame = MovingFrame.of(system)
        if self.frame is None:
            system.ensure_without_terms("stepper")
        self._ranges, self._paths = ranges, list(ranges)
        self.inputs = list(system.input_names if self.frame is None else self.frame.loads)
        self._moving = [] if self.frame is None else [*self.frame.angles, *self.frame.axes]
        self.s, self.f = np.full(len(ranges), np.nan), np.zeros(len(system.input_names))  # (P,) m, (i,) N
        self.c = np.zeros(len(system.terms)) if system.terms else None  # (K,): amplitudes of terms
        self._now = np.zeros((3, len(ranges) + len(self.inputs) + len(self._moving)))
        self._order = np.arange(self._now.shape[1])  # of the frame's drivers among these
        if self.frame is not None:
            if set(self.frame.paths) != set(ranges):
                raise InputError("stepper", "paths", ", ".join(ranges), f"{', '.join(self.frame.paths)} are allowed")
            self._order[: len(ranges)] = [self._paths.index(path) for path in self.frame.paths]
            self._now[:, len(ranges) :] = self.frame.start[:, len(ranges) :]
        # how many of value, rate and second rate have been given
        self._given = np.ones(self._now.shape[1], np.int64)
        self._before, self._given_before = self._now, self._given

    def leave(self) -> None:
        """Note where a step begins."""
        self._before, self._given_before = self._now.copy(), self._given
        self._given = np.ones_like(self._given)

    def take_path(self, s: Values) -> None:
        """Where paths lead; an InputError is raised where one leaves its range, or is missing at the start."""
        taken = self._taken(s, self._paths, "s", "one path coordinate for each path")
        for number, motion in taken.items():
            low, high = self._ranges[self._paths[number]]
            beyond = BEYOND_ENDS * (high - low)
            if not low - beyond <= motion[0] <= high + beyond:
                allowed = f"{low:g} to {high:g} m is allowed"
                raise InputError("stepper", f"s.{self._paths[number]}", motion[0], allowed)
            motion[0] = min(max(motion[0], low), high)
        missing = [k for k, at in enumerate(self.s) if np.isnan(at) and k not in taken]
        if missing:
            raise InputError("stepper", "s", None, f"all paths are needed at the start: {', '.join(self._paths)}")
        self._take(taken, 0)
        for number, motion in taken.items():
            self.s[number] = motion[0]

    def take_loads(self, F: Values) -> None:
        """Loads, as they are or as a frame turns them."""
        taken = self._taken(F, self.inputs, "F", "one load for each input")
        self._take(taken, len(self._paths))
        if self.frame is None:
            for number, motion in taken.items():
                self.f[number] = motion[0]

    def take_frame(self, frame: Mapping[str, Motion]) -> None:
        """How the frame moves."""
        taken = self._taken(frame, self._moving, "frame", "")
        for number, motion in taken.items():
            if not np.all(np.isfinite(motion)):
                raise InputError("stepper", f"frame.{self._moving[number]}", motion, "finite numbers are allowed")
        self._take(taken, len(self._paths) + len(self.inputs))

    def find(self) -> None:
        """Amplitudes of inputs and terms from the frame's motion at the end of the step."""
        if self.frame is not None:
            self.f[:], c = self.frame.find(self._now[:, self._order])
            if self.c is not None:
                self.c[:] = c

    def samples(self, parts: int, step: float) -> tuple[Array, Array, Array]:
        """Paths (parts + 1, P), loads (., i) and amplitudes (., K) at equal parts of a step, its beginning included."""
        begun, ended, first = self._before, self._now, len(self._paths)
        at = [begun, *self._between(parts, step), ended]
        s = np.array([motions[0, :first] for motions in at])
        if self.frame is None:
            return s, np.array([motions[0, first:] for motions in at]), np.empty((parts + 1, 0))
        found = [self.frame.find(motions[:, self._order]) for motions in at]
        return s, np.array([f for f, _ in found]), np.array([c for _, c in found])

    def _between(self, parts: int, step: float) -> list[Array]:
        """Motions (3, n) of the drivers at the parts of a step but its ends."""
        if parts == 1:
            return []
        begun, ended, both = self._before, self._now, np.minimum(self._given, self._given_before)
        smooth = cubics.by_rates(begun[0], ended[0], begun[1], ended[1], step)
        led_on = np.where(both >= 2, smooth, cubics.by_lines(begun[0], ended[0], step))
        if self.frame is not None:
            accelerated = cubics.by_second_rates(begun[0], ended[0], begun[2], ended[2], step)
            led_on = np.where(both >= 3, accelerated, led_on)
        return [cubics.after(led_on, step * k / parts) for k in range(1, parts)]

    def _take(self, taken: Mapping[int, list[float]], first: int) -> None:
        for number, motion in taken.items():
            self._now[:, first + number] = [*motion, 0.0, 0.0][:3]
            self._given[first + number] = len(motion)

    def _taken(self, values: Values, names: list[str], key: str, what: str) -> dict[int, list[float]]:
        """Motions that were given by name, or of all in their order, by their numbers."""
        return dict(_given(values, names, key, what))


def number_of(name: str | int, names: list[str], key: str) -> int:
    """Of a name among all, or a number as it is."""
    if not isinstance(name, str) and 0 <= name < len(names):
        return int(name)
    if name not in names:
        raise InputError("stepper", key, name, f"{hint(name, names)}{', '.join(names) or 'none'} are allowed")
    return names.index(str(name))


def _given(values: Values, names: list[str], key: str, what: str) -> Iterator[tuple[int, list[float]]]:
    if isinstance(values, Mapping):
        yield from ((number_of(name, names, key), _motion(value, f"{key}.{name}")) for name, value in values.items())
        return
    array = np.asarray(values, dtype=float)
    if array.shape != (len(names),) and not (array.ndim == 0 and len(names) == 1):
        allowed = f"{what} is allowed, in this order: {', '.join(names) or 'none'}; or some by their names"
        raise InputError("stepper", key, array.tolist(), allowed)
    yield from ((k, [value]) for k, value in enumerate(array.ravel().tolist()))


def _motion(value: Motion, key: str) -> list[float]:
    """Value, and as far as they are given rate and second rate."""
    given = np.atleast_1d(np.asarray(value, float))
    if given.ndim != 1 or not 1 <= len(given) <= 3:
        allowed = "a value, or that with its rate and its second rate, is allowed"
        raise InputError("stepper", key, given.tolist(), allowed)
    return list(given.tolist())
