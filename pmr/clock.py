"""Wall seconds of each stage of a run, and whoever wants to be told of its progress."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from pmr.errors import SimulationError

#: Called with a stage's name and the share of it that is done.
Progress = Callable[[str, float], None]


@dataclass
class Clock:
    """Times stages by name."""

    progress: Progress = lambda stage, share: None
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[float], None]]:
        """Time a stage; what is yielded takes the share of it that is done."""
        self.progress(name, 0.0)
        start = time.perf_counter()
        try:
            yield lambda share: self.progress(name, share)
        except SimulationError as error:
            error.args = (f"{name}: {error}",)
            raise
        self.seconds[name] = time.perf_counter() - start
        self.progress(name, 1.0)
