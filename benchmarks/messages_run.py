"""One run of `benchmarks.messages`: reduce a model on some ranks and count what they send; print a JSON line."""

from __future__ import annotations

import ctypes
import functools
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from benchmarks.timing import peak_memory

KINDS = ("messages", "message_bytes", "collectives", "collective_bytes", "fortran")
#: What a rank solves with its factor: calls, and right-hand sides in all.
SOLVED = ("solves", "columns")


class Counter:
    """Counts of what this rank sends and solves, by stage; those of an inner stage are not part of the outer one's."""

    def __init__(self, library: str) -> None:
        # Before any library that calls MPI: these find its functions first.
        self._sent = ctypes.CDLL(library, ctypes.RTLD_GLOBAL).pmr_messages
        self._solved = np.zeros(2, int)
        self._inner = [np.zeros(len(KINDS) + 2, int)]
        self.stages = dict[str, Any]()

    def so_far(self) -> Any:
        """Counts of all kinds since the start."""
        found = (ctypes.c_longlong * len(KINDS))()
        self._sent(found)
        return np.append(np.array(found[:], int), self._solved)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count what is sent and solved within a ``with`` for the stage `name`."""
        self._inner.append(np.zeros(len(KINDS) + 2, int))
        before = self.so_far()
        yield
        spent = self.so_far() - before
        self.stages[name] = self.stages.get(name, 0) + spent - self._inner.pop()
        self._inner[-1] += spent

    def of(self, name: str, called: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a function so that it is counted as the stage `name`."""

        @functools.wraps(called, updated=())
        def counted(*arguments: Any, **named: Any) -> Any:
            """Call the function within its stage."""
            with self.stage(name):
                return called(*arguments, **named)

        return counted

    def solving(self, called: Callable[..., Any], place: int) -> Callable[..., Any]:
        """Wrap a solving method so that its right-hand sides are counted.

        They are the columns of the argument, or the result, at `place` among (arguments, result).
        """

        @functools.wraps(called)
        def counted(*arguments: Any) -> Any:
            """Call the method and count its right-hand sides."""
            answer = called(*arguments)
            self._solved += (1, (*arguments, answer)[place].shape[1])
            return answer

        return counted


def main(library: str, cells: float) -> None:
    """Reduce the boom with cells of `cells` m, and print counts by stage and peak memory of each rank."""
    counter = Counter(library)
    import pmr.pipeline
    from benchmarks.scale_run import STAGES, boom
    from pmr.fem.compat import MPI
    from pmr.fem.factor import Exchange, _PetscFactor
    from pmr.scene.keys import ALONE

    comm, loaded = MPI.COMM_WORLD, peak_memory()
    for stage, places in STAGES.items():
        for module, name in places:
            setattr(module, name, counter.of(stage, getattr(module, name)))
    _PetscFactor.solve_columns = counter.solving(_PetscFactor.solve_columns, 1)  # type: ignore[method-assign]
    Exchange.columns = counter.solving(Exchange.columns, -1)  # type: ignore[method-assign]
    with counter.stage("rest"):
        reduction = pmr.pipeline.reduce(boom(cells), comm)
    mine = {stage: counts.tolist() for stage, counts in counter.stages.items()}
    memory = {"loaded_MB": loaded, "peak_MB": peak_memory()}
    found = comm.gather({"stages": mine} | memory, root=0)
    if found is not None:
        size = reduction.built[ALONE].model.size
        print(json.dumps({"cells": cells, "size": size, "ranks": comm.size, "each": found}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
