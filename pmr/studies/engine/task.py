"""What a study is made of: tasks, each a function call with a name, and the plan that lists them."""

from __future__ import annotations

import hashlib
import inspect
import json
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from numpy.typing import NDArray

from pmr.errors import InputError

#: What stands in one cell of the table.
Scalar = float | int | bool | str | None
#: What a key of a task may be: it is the name of a file, too.
LONGEST = 120
KEY = re.compile(rf"[A-Za-z0-9][A-Za-z0-9._=,+-]{{0,{LONGEST - 1}}}")


def key_of(text: str) -> str:
    """A key that says what `text` does: what a key can't hold becomes ``_``, the end of what is too long a digest."""
    key = re.sub(r"[^A-Za-z0-9._=,+-]+", "_", text)
    key = key if key[:1].isalnum() else f"0{key}"
    return key if len(key) <= LONGEST else f"{key[: LONGEST - 9]}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def number(value: Scalar) -> float:
    """A cell that holds a number; raises TypeError if it is empty or holds a text."""
    if value is None or isinstance(value, str):
        raise TypeError(f"{value!r} is no number")
    return float(value)


@dataclass(frozen=True)
class TaskResult:
    """Result of a task.

    The figures of its `record`, one column of the table each, are the same on every machine that computes alike; so
    measured times, which differ from run to run, stand apart in `seconds`.  `warnings` are those of a run of the same
    scene, a line each; what is logged as a warning meanwhile joins them.
    """

    record: Mapping[str, Scalar] = field(default_factory=dict)  # a float must be finite; None leaves the cell empty
    arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)  # for other tasks or the report; no objects
    seconds: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


#: Arguments, and the results of what the task needs, by the names under which it needs them.
TaskFunction = Callable[[Mapping[str, Any], Mapping[str, TaskResult]], TaskResult]


@dataclass(frozen=True)
class Task:
    """One call of a function of a module, in a process of its own.

    It is called with `arguments` and the results of `needs`, sees one MPI process and one thread, and what it computes
    depends on nothing else.  A task that is `alone` measures time: it waits until nothing else is left to do, and no
    other one runs beside it.
    """

    key: str  # unique in its plan: letters, digits and ``._=,+-``
    function: TaskFunction
    arguments: Mapping[str, Any] = field(default_factory=dict)  # as JSON holds; of a file that is read its digest too
    needs: Mapping[str, str] = field(default_factory=dict)  # name for the function: key of the task whose result it is
    parameters: Mapping[str, Scalar] = field(default_factory=dict)  # first columns of the table, of failed runs too
    cost: float = 1.0  # expected effort in any unit: long ones start first, and the time left is estimated by it
    alone: bool = False

    def __post_init__(self) -> None:
        if not KEY.fullmatch(self.key):
            raise ValueError(f"task key {self.key!r}: {KEY.pattern} is allowed")
        if "." in self.function.__qualname__:
            raise ValueError(f"task {self.key}: {self.address} is no function of a module")

    @property
    def address(self) -> str:
        """``"module:name"`` of the function."""
        return f"{self.function.__module__}:{self.function.__qualname__}"

    def digest(self, code: str, needs: Mapping[str, str]) -> str:
        """Digest of what decides the result: the code, the source of the function's module, its arguments and, by name,
        the digests of what it needs.
        """
        content = [code, self.address, _source(self.function.__module__), self.arguments, needs]
        return hashlib.sha256(json.dumps(content, sort_keys=True, allow_nan=False).encode()).hexdigest()[:24]


@lru_cache
def _source(module: str) -> str:
    return inspect.getsource(sys.modules[module])


@dataclass(frozen=True)
class Plan:
    """The tasks of one study."""

    runs: tuple[Task, ...]  # one row of the table each, in this order
    shared: tuple[Task, ...] = ()  # what several runs need, without a row; computed once if a run still needs it

    def __post_init__(self) -> None:
        twice = [key for key, count in Counter(task.key.casefold() for task in self).items() if count > 1]
        if twice:
            allowed = f"two runs are called {', '.join(twice)}; names of scenes and cases, and values, must differ"
            raise InputError("study", "", None, allowed)
        keys = {task.key for task in self}
        for task in self:
            missing = set(task.needs.values()) - keys
            if missing:
                raise ValueError(f"task {task.key} needs {', '.join(sorted(missing))}, which the plan lacks")

    def __iter__(self) -> Iterator[Task]:
        """Everything, what is shared first."""
        return iter((*self.shared, *self.runs))
