"""One run of `benchmarks.offline`: everything before a simulation of a beam; print a JSON line.

Works under mpirun: seconds are those of the slowest rank, memory is that of the largest.
"""

from __future__ import annotations

import contextlib
import io
import json
import logging
import sys
import time
from collections.abc import Iterator

import numpy as np

from benchmarks import beams
from benchmarks.timing import peak_memory
from pmr.compare.frequencies import closed_form_frequencies
from pmr.errors import ConvergenceError, InputError
from pmr.fem.compat import MPI
from pmr.fem.distributed import tall
from pmr.fullmodel.build import full_model
from pmr.fullmodel.model import FullModel
from pmr.reduction.basis import pod, reduced_model
from pmr.reduction.snapshots import Snapshots, eigenmode_snapshots

SNAPSHOTS, MODES, COORDINATES = 5, 6, 20


def main(elements: int) -> None:
    """Measure assembly, snapshots, POD and projection of a beam of so many elements, and print the record."""
    comm, seconds = MPI.COMM_WORLD, dict[str, float]()
    warned = io.StringIO()
    logging.basicConfig(stream=warned, level=logging.WARNING, format="%(message)s", force=True)

    @contextlib.contextmanager
    def stage(name: str) -> Iterator[None]:
        """Measure the seconds of a ``with`` as the stage `name`, on the slowest rank; collective."""
        comm.Barrier()
        begin = time.perf_counter()
        yield
        seconds[name] = comm.allreduce(time.perf_counter() - begin, MPI.MAX)

    full_model(beams.scene(beams.CASES["evolved"]))  # forms compiled
    scene = beams.scene(beams.CASES["evolved"], f"mesh.elements={elements}", "reduction.solver=slepc")
    with stage("assemble"):
        model = full_model(scene)
    record = {"elements": elements, "size": model.size, "ranks": comm.size, "notes": []}
    try:
        with stage("snapshots"):
            snapshots = eigenmode_snapshots(model, scene)
        record["first_frequency_error"] = frequency_error(snapshots)
    except (ConvergenceError, InputError) as error:
        record["notes"].append(f"snapshots: {error}")
        snapshots = made_up(model)
    with stage("pod"):
        basis = pod(model, snapshots, COORDINATES, "euclidean", "slepc")
    with contextlib.suppress(InputError), stage("project"):
        reduced_model(model, basis, {})
    record["seconds"] = seconds
    own = peak_memory()
    record["peak_MB_a_rank"] = comm.allreduce(own, MPI.MAX)
    record["notes"] += sorted({line.strip() for line in warned.getvalue().splitlines() if line.strip()})[:1]
    if comm.rank == 0:
        print(json.dumps(record), flush=True)


def frequency_error(snapshots: Snapshots) -> float:
    """Largest relative error of the first frequency over all positions, against the closed form."""
    scene = beams.scene(beams.CASES["evolved"])
    at = np.unique(snapshots.s)
    exact = closed_form_frequencies(scene, at, 1)[:, 0]
    found = [snapshots.omega[snapshots.s == s].min() for s in at]
    return float(np.abs(found / exact - 1.0).max())


def made_up(model: FullModel) -> Snapshots:
    """Smooth columns of the same size as snapshots, for models too large to have eigenmodes in double precision."""
    low, high = model.M.getOwnershipRange()
    x = np.linspace(0.0, 1.0, model.size)[low:high]
    k = np.arange(1, SNAPSHOTS * MODES + 1)
    S = tall(np.sin(np.outer(x, k) * np.pi) / k, model.M)
    empty = np.zeros(len(k))
    return Snapshots(S, empty, empty, empty, "made up")


if __name__ == "__main__":
    main(int(sys.argv[1]))
