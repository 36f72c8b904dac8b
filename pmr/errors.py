"""The errors that a user can mend; the command line turns them into one line and exit code 2."""

from __future__ import annotations

from typing import Any

from pmr.text import visible


class InputError(ValueError):
    """Something that was asked for cannot be done as stated.

    Parameters
    ----------
    source : str
        File (or option) in which the value stands.
    key : str
        Dotted key, e.g. ``body.length``; empty when the file as a whole is meant.
    value : object
        What was found.
    allowed : str
        What would be accepted, in words.
    """

    def __init__(self, source: str, key: str, value: Any, allowed: str) -> None:
        self.source, self.key, self.value, self.allowed = source, key, value, allowed
        super().__init__(self._line())

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, Any, str]]:
        # An exception is otherwise rebuilt from its line alone; errors travel between ranks and workers.
        return InputError, (self.source, self.key, self.value, self.allowed)

    def found_in(self, source: str) -> InputError:
        """The same, said of the file (or option) in which the user wrote it."""
        return InputError(source, self.key, self.value, self.allowed) if self.source == "scene" else self

    def _line(self) -> str:
        shown = "" if self.value is None else f" = {_short(self.value)}"
        where = f"{self.source}: {self.key}{shown}" if self.key else f"{self.source}{shown}"
        return visible(" ".join(f"{where}: {self.allowed}".split()))


class SimulationError(RuntimeError):
    """A simulation did not reach its end, or its result is not finite."""


class ConvergenceError(RuntimeError):
    """An iterative solver returned less than was asked for; the message says what to change."""


def _short(value: Any, width: int = 60) -> str:
    text = repr(value)
    return text if len(text) <= width else text[: width - 3] + "..."
