"""Drivers of a stepper as the user gives them: paths, loads and motions of a frame at the end of a step."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from math import isfinite
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.errors import BEYOND_ENDS, InputError, similar_name_hint
from pmr.files.arrays import Array
from pmr.kernel._native import lib
from pmr.kernel.further import AXES
from pmr.kernel.kernel import pointer
from pmr.scene.keys import path_unit

logger = logging.getLogger(__name__)
#: Largest angle in rad, except for slewing.
WHOLE_TURN = 2.0 * np.pi
#: Share of its range, or of a turn, by which a motion may change in a step before a jump is warned of.
JUMP = 0.1
#: Distance in m or rad between a motion without a second rate and where its rate leads, above which a warning says that
#: inertia is left out.
LEFT_OUT = 1e-6
#: Share of its range, or of a turn, that a motion or the integral of its rates goes before the two are compared.
COMPARED = 0.01
#: Largest float that is taken without further checks; entry of an unknown name, with limits that refuse every value.
LARGEST, NOWHERE = 1e300, (0, 1.0, 0.0, 0.0, 0.0)
#: Types of the entries of motions with rates that are read without further checks.
FLOATS = [float] * 2, [float] * 3
#: Value of a motion; or a sequence of its value and rate, or of its value, rate and second rate.
Motion = float | Sequence[float]
Values = Mapping[str, float] | Mapping[str, Motion] | ArrayLike
#: A motion's number, its value, rate and second rate (zero if not given), and how many of these three were given.
Reading = tuple[int, float, float, float, int]
#: By name and number: a motion's number, its least and largest value, its largest change in a step, its fastest rate.
Limits = dict[str | int, tuple[int, float, float, float, float]]


class Drivers:
    """Motions (3, n) at the end of a step of n drivers: paths, then loads, then motions of a frame.

    The rows of `motions` are values, rates and second rates; a motion that is not given at a step keeps its three
    entries.  `rows` (n,) says how many of the three were given for the next step.  The kernel reads both arrays;
    writing them through memory views takes a tenth of NumPy's time.

    `names` are the names of paths, of loads with their numbers, and of motions of the frame (None without a frame).
    `ranges` are the smallest and largest coordinate of each path.  `in_parts` says whether steps are divided.
    Motions that are `free` are computed: values given for them have an effect at the start only.

    Raises InputError for a number out of its range or not finite, for an unknown name, and for a path that is missing
    at the start.
    """

    def __init__(
        self,
        motions: Array,
        rows: NDArray[np.int32],
        names: tuple[Sequence[str], Mapping[str, int], Sequence[str] | None],
        ranges: Mapping[str, tuple[float, float]],
        step: float,
        in_parts: bool,
        free: Collection[str] = (),
    ) -> None:
        """Bind the drivers to the arrays `motions` (3, n) and `rows` (n,), which the kernel reads.

        `step` is the time step in s; the class describes the other arguments.
        """
        self.motions, self.rows, self._step = motions, rows, step
        views: list[Any] = [memoryview(array) for array in (*motions, rows)]
        self._values, self._rates, self._seconds, self._counts = views
        rows[:] = 1
        paths, loads, frame = names  # in the order of motions; the last is None without a frame
        self._in_frame, self._in_parts = frame is not None, in_parts
        self.paths = list(paths)
        self._ranges = [ranges[path] for path in paths]
        self._path_numbers = _motion_numbers(list(ranges), [self.paths.index(path) for path in ranges])
        self._load_numbers = _motion_numbers([*loads], [*loads.values()])
        of_frame = motions.shape[1] - len(frame or ())
        self._frame_numbers = _motion_numbers(frame or (), range(of_frame, motions.shape[1]))
        self._angles = {of_frame + k: name for k, name in enumerate(frame or ()) if name not in AXES}
        #: names, by number, of drivers that have inertia in the frame and no warning yet of a missing second rate
        self._unwarned = (dict(enumerate(self.paths)) | self._angles) if self._in_frame else {}
        self._book, self._free = np.zeros((5, motions.shape[1])), free  # the book is that of `pmr_compare_rates`
        if in_parts or self._in_frame:
            sizes = [high - low for low, high in self._ranges] + [WHOLE_TURN] * len(self._angles)
            for (k, name), size in zip([*enumerate(self.paths), *self._angles.items()], sizes, strict=True):
                self._book[4, k] = 0.0 if name in free else COMPARED * size
        self._compare_rates = partial(
            lib.pmr_compare_rates, motions.shape[1], step, *map(pointer, (motions, self._book))
        )
        self._all: tuple[Array, Callable[[], int], Array] | None = None  # for `take_all`
        self._jumps, self._has_places, self._started = set[str](), False, False  # names of motions with a warning
        self._begun_motions, self._begun_rows = motions.copy(), rows.copy()  # motions at the end of the last step

        # by name: numbers of motions, and limits of values and changes that are taken without further checks
        unlimited = (-LARGEST, LARGEST, 2.0 * LARGEST, LARGEST)
        limits = [(low, high, JUMP * (high - low), (high - low) / step) for low, high in self._ranges]
        self._limits: Limits = {name: (k, *limits[k]) for name, k in self._path_numbers.items()}
        self._limits_of_loads: Limits = {name: (k, *unlimited) for name, k in self._load_numbers.items()}
        turn = (-WHOLE_TURN, WHOLE_TURN, JUMP * WHOLE_TURN, LARGEST)
        self._limits_of_frame: Limits = {
            name: (k, *(turn if k in self._angles else unlimited)) for name, k in self._frame_numbers.items()
        }

    def take_all(self, motions: Array, names: Sequence[str]) -> None:
        """Take the `motions` (3, n) of a frame: values, rates and second rates of all n `names`, in their order.

        Columns of motions that are free have no effect.  Errors and warnings are the same as those of `take_paths`,
        `take_loads` and `take_frame`.
        """
        if self._all is None:
            limits = np.full((5, len(names)), np.nan)
            of_all = self._limits | self._limits_of_loads | self._limits_of_frame
            for k, name in enumerate(names):
                if name not in self._free:
                    limits[:, k] = *of_all[name][1:], LEFT_OUT if k in self._unwarned else LARGEST
            room = np.zeros((3, len(names)))
            pointers = map(pointer, (room, limits, self.motions))
            self._all = room, partial(lib.pmr_take_motions, len(names), self._step, *pointers), limits
        room, take, _ = self._all
        if motions.shape != room.shape:
            allowed = f"{room.shape} is allowed: values, rates and second rates of {', '.join(names)}"
            raise InputError("stepper", "s", motions.shape, allowed)
        room[:] = motions
        if take() >= 0:  # one by one, for a message about the one that is beyond a limit
            by_name = {
                name: tuple(of) for name, of in zip(names, room.T.tolist(), strict=True) if name not in self._free
            }
            self.take_paths({name: of for name, of in by_name.items() if name in self._limits})
            self.take_loads({name: of for name, of in by_name.items() if name in self._limits_of_loads})
            self.take_frame({name: of for name, of in by_name.items() if name in self._limits_of_frame})

    @property
    def path_coordinates(self) -> dict[str, float]:
        """Coordinates of the paths in m, of a path `luffing` in rad, by name."""
        return {path: self._values[k] for path, k in self._path_numbers.items() if isinstance(path, str)}

    def take_paths(self, s: Values) -> None:
        """Take path coordinates; one that is up to `BEYOND_ENDS` of its range beyond an end is set to this end.

        If a path jumps in a step, a warning is logged, once for each path.  Raises InputError if a coordinate is
        farther beyond an end, if a path with its rate would cross more than its whole range in a step, or if a path is
        missing at the start.
        """
        if type(s) is dict and self._take_at_once(s, self._limits):
            return
        readings = self._read(s, self._path_numbers, "s", "one path coordinate for each path")
        for n, (k, at, rate, second, count) in enumerate(readings):
            (low, high), unit = self._ranges[k], path_unit(self.paths[k])
            if not low <= at <= high:
                beyond = BEYOND_ENDS * (high - low)
                if not low - beyond <= at <= high + beyond:
                    raise InputError("stepper", f"s.{self.paths[k]}", at, f"{low:g} to {high:g} {unit} is allowed")
                readings[n] = k, min(max(at, low), high), rate, second, count
            if abs(rate) * self._step > high - low:
                fastest = f"{(high - low) / self._step:g} {unit}/s, its range in a step, is allowed at most"
                raise InputError("stepper", f"s.{self.paths[k]}", [at, rate, second][:count], fastest)
            if self._has_places and abs(at - self._values[k]) > JUMP * (high - low):
                self._warn_of_jump(self.paths[k], abs(at - self._values[k]), unit)
        if not self._has_places:
            if len({k for k, *_ in readings}) < len(self.paths):
                raise InputError("stepper", "s", None, f"all paths are needed at the start: {', '.join(self.paths)}")
            self._has_places = True
        self._write(readings)

    def _take_at_once(self, values: dict[Any, Any], limits: Limits) -> bool:
        """Take all values at once if each is a float within its `limits`, and return True; or take none, return False.

        In a frame a value may have rates (`_take_motions_at_once`).  If False is returned, the caller reads one value
        after the other, which takes three times as long but gives a message for each error.  At the start, and if steps
        are divided into parts, the result is always False.
        """
        if self._in_parts or not self._started:
            return False
        if self._in_frame:
            return self._take_motions_at_once(values, limits)
        written = self._values
        for name, value in values.items():
            k, low, high, jump, _ = limits.get(name, NOWHERE)
            if type(value) is not float or not (low <= value <= high and -jump <= value - written[k] <= jump):
                return False
        for name, value in values.items():
            written[limits[name][0]] = value
        return True

    def _take_motions_at_once(self, motions: dict[Any, Any], limits: Limits) -> bool:
        """Take all `motions` of a frame at once and return True; or take none and return False.

        Each has to be a float, or a tuple of two or three floats: value, rate and second rate.  All have to be within
        the `limits` of the motion, and a second rate has to be there where inertia needs one.  Otherwise the caller
        takes one motion after the other.
        """
        written, rates, seconds, counts = self._values, self._rates, self._seconds, self._counts
        unwarned = self._unwarned
        for name, motion in motions.items():
            k, low, high, jump, fastest = limits.get(name, NOWHERE)
            if type(motion) is float:
                if not (low <= motion <= high and -jump <= motion - written[k] <= jump) or k in unwarned:
                    return False
                continue
            if type(motion) is not tuple or not 2 <= len(motion) <= 3:
                return False
            value, rate, second = motion if len(motion) == 3 else (*motion, 0.0)
            if not (
                type(value) is type(rate) is type(second) is float
                and low <= value <= high
                and -jump <= (change := value - written[k]) <= jump
                and -fastest <= rate <= fastest
                and -LARGEST <= second <= LARGEST
            ) or (second == 0.0 and k in unwarned and seconds[k] == 0.0 and self._lacks_inertia(k, change)):
                return False
        for name, motion in motions.items():
            k = limits[name][0]
            if type(motion) is float:
                written[k], rates[k], seconds[k] = motion, 0.0, 0.0
                counts[k] = 1  # a step that was refused has not been ended
            elif len(motion) == 3:
                written[k], rates[k], seconds[k] = motion
                counts[k] = 3
            else:
                written[k], rates[k] = motion
                seconds[k], counts[k] = 0.0, 2
        return True

    def take_loads(self, F: Values) -> None:
        """Take loads F in N or N m, by their input names; in a frame, by their names in the scene.

        Gravity, which is in m/s^2, is a load of a frame.
        """
        if type(F) is dict and self._take_at_once(F, self._limits_of_loads):
            return
        self._write(self._read(F, self._load_numbers, "F", "one load for each input"))

    def take_frame(self, frame: Mapping[str, Motion]) -> None:
        """Take motions of the frame; raise an InputError for an angle, other than slewing, of more than a turn.

        A warning is logged, once for each angle, if it jumps in a step.
        """
        if type(frame) is dict and self._take_at_once(frame, self._limits_of_frame):
            return
        readings = self._read(frame, self._frame_numbers, "frame", "")
        for k, value, *_ in readings:
            name = self._angles.get(k)
            if name is None:
                continue
            if name != "slewing" and abs(value) > WHOLE_TURN:
                raise InputError("stepper", f"frame.{name}", value, "at most one turn is allowed, 2 pi: it is in rad")
            if self._started and abs(value - self._values[k]) > JUMP * WHOLE_TURN:
                self._warn_of_jump(name, abs(value - self._values[k]), "rad")
        self._write(readings)

    def write_rates(self, rates: Array) -> None:
        """Write the rates of the n drivers at the beginning and the end of a step into `rates` (2, n).

        If the rate of a driver is given at both ends, both are taken as they are; otherwise both are the mean rate of
        the step.
        """
        smooth = np.minimum(self.rows, self._begun_rows) >= 2
        mean = (self.motions[0] - self._begun_motions[0]) / self._step
        rates[0], rates[1] = np.where(smooth, self._begun_motions[1], mean), np.where(smooth, self.motions[1], mean)

    def end_step(self) -> None:
        """End a step, or the start: values stay for the next step, but rates have to be given again."""
        if self._in_frame or self._in_parts:
            if self._compare_rates():
                self._warn_of_rates()
            if self._in_parts:
                self._begun_motions[:], self._begun_rows[:] = self.motions, self.rows
            self.rows.fill(1)
        self._started = True

    def _lacks_inertia(self, k: int, change: float) -> bool:
        """Whether to warn of motion k, which changes by `change` in a step and has no second rate at its end.

        The result is True if three conditions hold: inertia depends on the motion, no warning of it was given yet, and
        the change differs from the change by a constant rate (the rate at the beginning of the step).
        """
        return k in self._unwarned and abs(change - self._step * self._rates[k]) > LEFT_OUT

    def _warn_of_rates(self) -> None:
        """Log a warning for each motion whose rates do not lead from one of its values to the next.

        `pmr_compare_rates` marks these motions.  The marks are cleared, and the motions are not compared again.
        """
        _, _, changes, integrals, compared = self._book
        for k in np.flatnonzero(compared < 0.0).tolist():
            compared[k] = 0.0
            name, unit = (self.paths[k], path_unit(self.paths[k])) if k < len(self.paths) else (self._angles[k], "rad")
            message = "%s moves by %.3g %s where its rates lead by %.3g %s: its rates are needed, in %s/s"
            logger.warning(message, name, changes[k], unit, integrals[k], unit, unit)

    def _warn_of_jump(self, name: str, change: float, unit: str) -> None:
        """Log, once for each `name`, a warning that this motion changes by `change` in a step; `unit` is its unit."""
        if name in self._jumps:
            return
        self._jumps.add(name)
        message = "%s jumps by %g %s in a step of %g s, which excites what no boom does: give it at each step, in %s"
        logger.warning(message, name, change, unit, self._step, unit)

    def _write(self, readings: list[Reading]) -> None:
        """Write the motions in `readings` into the kernel's arrays.

        A warning is logged, once for each motion, if it moves without a second rate and inertia depends on it.
        """
        for k, value, rate, second, count in readings:
            if self._started and second == 0.0 == self._seconds[k] and self._lacks_inertia(k, value - self._values[k]):
                message = (
                    "%s moves without a second rate, so the inertia of what moves is left out: both rates are needed"
                )
                logger.warning(message, self._unwarned.pop(k))
            self._values[k] = value
            if self._in_frame or self._in_parts:  # the kernel reads no rates otherwise
                self._rates[k], self._seconds[k], self._counts[k] = rate, second, count

    def _read(self, values: Values, numbers: Mapping[str | int, int], key: str, what: str) -> list[Reading]:
        """Read motions `values`, a mapping from names or a sequence of all values in order without rates.

        Each result has the motion's number, its value, rate and second rate, and how many of these three were given;
        missing rates are 0.  `numbers` has the motions' numbers by their names and by their indices.

        Raises InputError about `key` for a name that is not in `numbers`, for a sequence of a wrong length, and for
        numbers that are not finite.  `what` is the text about what is allowed, for the message about a wrong length.
        """
        if not _is_mapping(values):
            in_order = _read_in_order(values, numbers, key, what).tolist()
            return [(k, value, 0.0, 0.0, 1) for k, value in zip(numbers.values(), in_order, strict=False)]
        readings = list[Reading]()
        for name, motion in values.items():
            k = numbers.get(name, -1)
            if k < 0:
                number_of(name, _motion_names(numbers), key)  # raises the error
            if isinstance(motion, float) and isfinite(motion):
                readings.append((k, motion, 0.0, 0.0, 1))
            elif type(motion) is tuple and [*map(type, motion)] in FLOATS and isfinite(sum(motion)):
                readings.append((k, *motion, 3) if len(motion) == 3 else (k, *motion, 0.0, 2))
            else:
                rows = _read_motion(motion, f"{key}.{name if isinstance(name, str) else _motion_names(numbers)[name]}")
                value, rate, second = [*rows, 0.0, 0.0][:3]
                readings.append((k, value, rate, second, len(rows)))
        return readings


def _motion_numbers(names: Sequence[str], numbers: Sequence[int]) -> dict[str | int, int]:
    """Map the name of each motion in `names`, and also its index there, to its entry in `numbers`."""
    return dict(zip(names, numbers, strict=True)) | dict(enumerate(numbers))


def number_of(name: str | int, names: Sequence[str], key: str) -> int:
    """Position of `name` in `names`; if `name` is a whole number in range, the number itself.

    Raises InputError with the key `key` for a name that is not in `names`, and for any other number.
    """
    if isinstance(name, int | np.integer) and 0 <= name < len(names):
        return int(name)
    if name not in names:
        allowed = f"{similar_name_hint(name, list(names))}{', '.join(names) or 'none'} are allowed"
        raise InputError("stepper", key, name, allowed)
    return names.index(str(name))


def _is_mapping(values: Values) -> TypeGuard[Mapping[str, Any]]:
    """Whether `values` are given by the names of motions, and not in their order."""
    return type(values) is dict or isinstance(values, Mapping)  # the first test is quicker


def _motion_names(numbers: Mapping[str | int, int]) -> list[str]:
    """Names of motions among the keys of `numbers`, which has names and indices as keys."""
    return [name for name in numbers if isinstance(name, str)]


def _read_in_order(values: Values, numbers: Mapping[str | int, int], key: str, what: str) -> Array:
    """Values of all m motions in `numbers` as a float array (m,), from a number or a sequence.

    Raises InputError about `key` unless there are m values, all of them finite.  `what` is the text about what is
    allowed, for the message about their number.
    """
    count = len(numbers) // 2
    array = np.asarray(values, dtype=float)
    if array.shape != (count,) and not (array.ndim == 0 and count == 1):
        allowed = (
            f"{what} is allowed, in this order: {', '.join(_motion_names(numbers)) or 'none'}; or some by their names"
        )
        raise InputError("stepper", key, array.tolist(), allowed)
    if not np.isfinite(array).all():
        raise InputError("stepper", key, array.tolist(), "finite numbers are allowed")
    return array.ravel()


def _read_motion(value: Motion, key: str) -> list[float]:
    """Value of a motion, then its rate and second rate as far as they are given, as a list of one to three floats.

    Raises InputError about `key` for other shapes and numbers that are not finite.
    """
    array = np.atleast_1d(np.asarray(value, float))
    if array.ndim != 1 or not 1 <= len(array) <= 3:
        allowed = "a value, or that with its rate and its second rate, is allowed"
        raise InputError("stepper", key, array.tolist(), allowed)
    if not np.isfinite(array).all():
        raise InputError("stepper", key, value, "finite numbers are allowed")
    return list(array.tolist())
