"""Everything before a simulation, from a hundred to a million coordinates, on one rank and on two."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.timing import exponent

ELEMENTS = (33, 100, 333, 1000, 3333, 10_000)
MANY_ELEMENTS = (*ELEMENTS, 33_333, 100_000, 333_333)
RANKS = (1, 2)
TIMEOUT = 1200
STAGES = ("assemble", "snapshots", "pod", "project")
_MPI = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "OMPI_MCA_mpi_yield_when_idle": "1",
    "OMPI_MCA_hwloc_base_binding_policy": "none",
    "OMPI_MCA_btl_vader_single_copy_mechanism": "none",
}


def measure(long: bool, repeats: int) -> dict[str, Any]:
    """Records by ranks and size, the quickest of some repeats, and exponents of seconds over coordinates."""
    runs: dict[tuple[int, int], list[dict[str, Any]]] = {}
    for elements in MANY_ELEMENTS if long else ELEMENTS:
        for _ in range(repeats if elements <= 10_000 else 1):
            for ranks in RANKS:
                runs.setdefault((ranks, elements), []).append(_run(ranks, elements))
    records = [_quickest(repeated) for repeated in runs.values()]
    return {"records": records, "exponents": {str(ranks): _exponents(records, ranks) for ranks in RANKS}}


def _run(ranks: int, elements: int) -> dict[str, Any]:
    # The launcher that belongs to this Python's MPI stands beside it, where pip brought MPI along.
    beside = Path(sys.executable).parent / "mpiexec"
    launcher = str(beside) if beside.is_file() else shutil.which("mpirun") or "mpirun"
    command = [launcher, "-n", str(ranks), sys.executable, "-m", "benchmarks.offline_run", str(elements)]
    command = command if ranks > 1 else command[3:]
    environment = os.environ | _MPI | {"OMP_NUM_THREADS": "1"}
    folder = Path(__file__).resolve().parents[1]
    failed = {"elements": elements, "ranks": ranks, "size": 3 * (elements + 1), "seconds": {}}
    try:
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, timeout=TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired:
        return failed | {"notes": [f"stopped after {TIMEOUT} s"]}
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    if not lines:
        return failed | {"notes": ["failed: " + (done.stderr.strip().splitlines() or ["without a word"])[-1]]}
    return json.loads(lines[-1])  # type: ignore[no-any-return]


def _quickest(repeated: list[dict[str, Any]]) -> dict[str, Any]:
    stages = {stage for run in repeated for stage in run["seconds"]}
    least = {stage: min(run["seconds"].get(stage, np.inf) for run in repeated) for stage in stages}
    return repeated[0] | {"seconds": least, "repeats": len(repeated)}


def _exponents(records: list[dict[str, Any]], ranks: int) -> dict[str, float]:
    """Fitted from a thousand coordinates on, where work and not the start of it takes the time."""
    chosen = [record for record in records if record["ranks"] == ranks and record["size"] >= 1000]
    fitted = {}
    for stage in STAGES:
        known = [(record["size"], record["seconds"][stage]) for record in chosen if stage in record["seconds"]]
        if len(known) > 1:
            size, seconds = np.array(known, float).T
            fitted[stage] = exponent(size, seconds)
    return fitted
