"""Time of everything before a simulation, from a hundred to a million coordinates, on one rank and on two."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.ranks import Bounds, record_of
from benchmarks.timing import exponent

ELEMENTS = (33, 100, 333, 1000, 3333, 10_000)
MANY_ELEMENTS = (*ELEMENTS, 33_333, 100_000, 333_333)
RANKS = (1, 2)
TIMEOUT = 1200.0
STAGES = ("assemble", "snapshots", "pod", "project")


def measure(long: bool, repeats: int) -> dict[str, Any]:
    """Records by ranks and size, the quickest of `repeats`, and exponents of seconds over coordinates."""
    runs: dict[tuple[int, int], list[dict[str, Any]]] = {}
    for elements in MANY_ELEMENTS if long else ELEMENTS:
        for _ in range(repeats if elements <= 10_000 else 1):
            for ranks in RANKS:
                runs.setdefault((ranks, elements), []).append(_run(ranks, elements))
    records = [_quickest(repeated) for repeated in runs.values()]
    return {"records": records, "exponents": {str(ranks): _exponents(records, ranks) for ranks in RANKS}}


def _run(ranks: int, elements: int) -> dict[str, Any]:
    """Record of one run in processes of its own."""
    begun = {"elements": elements, "ranks": ranks, "size": 3 * (elements + 1), "seconds": {}}
    return begun | record_of("benchmarks.offline_run", [str(elements)], ranks, Bounds(TIMEOUT))


def _quickest(repeated: list[dict[str, Any]]) -> dict[str, Any]:
    """Record with the least seconds of each stage among repeated runs."""
    stages = {stage for run in repeated for stage in run["seconds"]}
    least = {stage: min(run["seconds"].get(stage, np.inf) for run in repeated) for stage in stages}
    return repeated[0] | {"seconds": least, "repeats": len(repeated)}


def _exponents(records: list[dict[str, Any]], ranks: int) -> dict[str, float]:
    """Exponents of each stage's seconds from 1000 coordinates on, where the work takes longer than its start."""
    chosen = [record for record in records if record["ranks"] == ranks and record["size"] >= 1000]
    fitted = {}
    for stage in STAGES:
        known = [(record["size"], record["seconds"][stage]) for record in chosen if stage in record["seconds"]]
        if len(known) > 1:
            size, seconds = np.array(known, float).T
            fitted[stage] = exponent(size, seconds)
    return fitted
