"""One run of `benchmarks.scale`: reduce the reference boom from its mesh on; print a JSON line.

Works under mpirun: seconds are those of the slowest rank, memory is measured on each.  Stages are functions that a run
of pmr calls, so what is measured is what a run does.
"""

from __future__ import annotations

import functools
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

import pmr.fullmodel.build
import pmr.pipeline
import pmr.reduction.bodies
import pmr.reduction.residual
from benchmarks.timing import peak_memory
from pmr import scene
from pmr.fem.compat import MPI
from pmr.fullmodel.from_scene import structure_of
from pmr.fullmodel.model import assemble_model
from pmr.models import is_assembled
from pmr.reduction.bodies import Reduction
from pmr.scene.keys import ALONE
from pmr.scene.members import member_at
from pmr.system.carriers import Flexibility
from pmr.system.polynomials import evaluate

Array = NDArray[np.float64]

SCENE = Path(__file__).parents[1] / "workflows" / "boom_shell.toml"
#: Where the stages are called from.
STAGES = {
    "mesh": ((pmr.fullmodel.build, "structure_of"),),
    "assembly": ((pmr.fullmodel.build, "structural_model"),),
    "modes": ((pmr.reduction.bodies, "take_snapshots"),),
    "projection": ((pmr.reduction.residual, "galerkin"),),
    "flexibility": tuple((pmr.reduction.residual, name) for name in ("ResidualFlexibility", "load_powers", "tables")),
}
#: Values of tables compared: five between two breaks.
PLACES = 5


def main(cells: float, file: Path | None = None) -> None:
    """Reduce the boom meshed with cells of `cells` m around the section; save its modes and tables in any `file`."""
    comm = MPI.COMM_WORLD
    coarse = boom(1.0)
    model = structure_of(member_at(coarse), comm).model
    assert is_assembled(model)
    assemble_model(model, model.domain(comm))  # forms compiled
    timer, loaded = Timer(comm), peak_memory()
    for stage, places in STAGES.items():
        for module, name in places:
            setattr(module, name, timer.of(stage, getattr(module, name)))
    begin, before = time.perf_counter(), time.process_time()
    reduction = pmr.pipeline.reduce(boom(cells), comm)
    seconds = timer.seconds | {"total": comm.allreduce(time.perf_counter() - begin, MPI.MAX)}
    record = {
        "cells": cells,
        "size": reduction.built[ALONE].model.size,
        "entries": int(reduction.built[ALONE].model.K.getInfo()["nz_used"]),
        "ranks": comm.size,
        "seconds": seconds,
        "processor": comm.allreduce(time.process_time() - before, MPI.SUM),
        "processor_of_stages": {stage: spent.tolist() for stage, spent in timer.processor.items()},
        "peak_MB": timer.peak(),
        "peak_MB_after": timer.peaks,
        "loaded_MB": comm.allgather(loaded),
        "notes": [],
    }
    if file is not None:
        leave(reduction, file)
    if comm.rank == 0:
        print(json.dumps(record), flush=True)


def boom(cells: float) -> scene.Scene:
    """Scene of the reference boom as a shell of triangles, with ten coordinates."""
    return scene.load(SCENE, [f"mesh.size={cells}", f"mesh.along={2.0 * cells}"])


class Timer:
    """Wall seconds of stages on the slowest rank, and processor seconds and peak memory in MB on each.

    What an inner stage takes is not counted for the outer one.
    """

    def __init__(self, comm: MPI.Comm) -> None:
        self._comm, self.seconds = comm, dict[str, float]()
        self.processor, self.peaks = dict[str, Array](), dict[str, list[float]]()
        self._inner: list[Array] = []
        self._peak = 0.0

    def of(self, stage: str, called: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a function so that its calls are timed as `stage`, and added up; the wrapped function is collective."""

        @functools.wraps(called, updated=())
        def timed(*arguments: Any, **named: Any) -> Any:
            """Call the function and add up what it takes; collective."""
            self._comm.Barrier()
            self._inner.append(np.zeros(self._comm.size + 1))
            begin, before = time.perf_counter(), time.process_time()
            result = called(*arguments, **named)
            used = self._comm.allgather(time.process_time() - before)
            spent = np.array([self._comm.allreduce(time.perf_counter() - begin, MPI.MAX), *used])
            own = spent - self._inner.pop()
            if self._inner:
                self._inner[-1] += spent
            self.seconds[stage] = self.seconds.get(stage, 0.0) + own[0]
            self.processor[stage] = self.processor.get(stage, 0.0) + own[1:]
            self.peaks.pop(stage, None)  # in the order in which stages were left for the last time
            self.peaks[stage] = self.peak()
            return result

        return timed

    def peak(self) -> list[float]:
        """Peak memory in MB of each rank; collective.

        The largest value read so far is returned, as Linux counts pages in batches and its value may fall.
        """
        self._peak = max(self._peak, peak_memory())
        return self._comm.allgather(self._peak)


def leave(reduction: Reduction, file: Path) -> None:
    """Save modes, frequencies and values of the tables in a file, by rank 0; collective."""
    model, body, flexibility = reduction.built[ALONE].model, reduction.bodies[ALONE], reduction.reduced.flexibility
    shares = model.comm.gather(body.V, root=0)
    if shares is None:
        return
    assert flexibility is not None
    np.savez(file, modes=np.concatenate(shares), omega=body.snapshots.omega, **values(flexibility))


def values(flexibility: Flexibility) -> dict[str, Array]:
    """Values (p, c) of all tables at p positions, a column for each input, output or kind."""
    breaks = flexibility.rows.x
    share = (np.arange(PLACES) + 0.5) / PLACES
    s = (breaks[:-1, None] + np.diff(breaks)[:, None] * share).ravel()

    def along(table: PPoly, kept: int | None = None) -> Array:
        """Values of a table (m, c) at all positions; a column for each index of the axis `kept`, or one for all."""
        found = evaluate(table, s)
        return found.reshape(-1, 1) if kept is None else np.moveaxis(found, kept, -1).reshape(-1, found.shape[kept])

    return {
        "table rows": along(flexibility.rows),
        "table inputs": along(flexibility.inputs, 2),
        "table outputs": along(flexibility.outputs, 1),
    }


if __name__ == "__main__":
    main(float(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else None)
