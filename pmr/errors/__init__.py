"""Errors that a user can correct; the command line turns them into one line and exit code 2."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from pmr.errors.text import escape_controls

Found = TypeVar("Found")
WIDEST = 60  # letters of a value that is shown
#: Share of a range by which a path may exceed its ends, as measured paths do; it is then cut off at the end.
BEYOND_ENDS = 1e-5


class InputError(ValueError):
    """An input is not possible: a value of a scene, a study, an option or a file.

    `source` is the file (or option) with the value.  `key` is the dotted key, such as ``body.length``, or empty if the
    error is about the whole file.  `value` is the value that was read (None: not shown), and `allowed` says in words
    what is accepted.
    """

    def __init__(self, source: str, key: str, value: Any, allowed: str) -> None:
        self.source, self.key, self.value, self.allowed = source, key, value, allowed
        super().__init__(self._line())

    def __reduce__(self) -> tuple[type[InputError], tuple[Any, ...]]:
        # An exception is otherwise rebuilt from its line alone; errors travel between ranks and workers.
        return InputError, (self.source, self.key, self.value, self.allowed)

    def with_source(self, source: str) -> InputError:
        """Return this error with the file or option in which the user wrote the value, if its source is ``"scene"``."""
        return InputError(source, self.key, self.value, self.allowed) if self.source == "scene" else self

    def with_key(self, key: str) -> InputError:
        """Return this error with the key as the scene's file spells it, if its source is ``"scene"``."""
        return InputError(self.source, key, self.value, self.allowed) if self.source == "scene" else self

    def _line(self) -> str:
        """Return the message in one line: source, key, value and what is allowed."""
        text = repr(self.value)
        shown = "" if self.value is None else f" = {text if len(text) <= WIDEST else f'{text[: WIDEST - 3]}...'}"
        where = f"{self.source}: {self.key}{shown}" if self.key else f"{self.source}{shown}"
        return escape_controls(" ".join(f"{where}: {self.allowed}".split()))


class NotHeldError(InputError):
    """Something is free to move; `short` says what in a clause: ``"middle and fly can move along y"``."""

    def __init__(self, source: str, key: str, value: Any, allowed: str, short: str) -> None:
        super().__init__(source, key, value, allowed)
        self.short = short

    def __reduce__(self) -> tuple[type[InputError], tuple[Any, ...]]:
        return NotHeldError, (self.source, self.key, self.value, self.allowed, self.short)


class SimulationError(RuntimeError):
    """A simulation stopped before its end, or its result is not finite."""


class GrowthError(SimulationError):
    """A motion grows without bound: most of its energy was put in by neither loads nor moving rows.

    `rigid_rows` are the names of the moving rigid rows, whose multipliers may be the cause.
    """

    def __init__(self, message: str, rigid_rows: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.rigid_rows = rigid_rows

    def refusal(self, step: float, rho_inf: float) -> InputError:
        """Return this error as an InputError of the key to change: step (s), rho_inf or flexibility of the scene."""
        key, value, allowed = "time.step", step, "a smaller one is allowed"
        if self.rigid_rows and rho_inf > 0.0:
            key, value = "time.rho_inf", rho_inf
        elif self.rigid_rows:
            return InputError("scene", "reduction.flexibility", False, f"true is allowed: {self}")
        return InputError("scene", key, value, f"{allowed}: {self}")


class ConvergenceError(RuntimeError):
    """An iterative solver did not reach its tolerance; the message says what to change."""


class TooManyModesError(ConvergenceError):
    """More modes were requested than the `most` that a model has."""

    def __init__(self, count: int, most: int) -> None:
        super().__init__(
            f"{count} modes asked for, but the model has {most} free coordinates; ask for fewer modes or refine the "
            "mesh"
        )
        self.count, self.most = count, most

    def __reduce__(self) -> tuple[type[TooManyModesError], tuple[int, int]]:
        return TooManyModesError, (self.count, self.most)


def call_on_first_rank(comm: Any, make: Callable[[], Found]) -> Found | None:
    """Call `make` on rank 0; return its result there and None on other ranks; collective.

    An InputError, SimulationError or ConvergenceError on rank 0 is raised on all ranks: else the others would wait in
    the next exchange for a rank that has left.
    """
    result, refused = None, None
    if comm.rank == 0:
        try:
            result = make()
        except (InputError, SimulationError, ConvergenceError) as error:
            refused = error
    refused = comm.bcast(refused)
    if refused is not None:
        raise refused
    return result
