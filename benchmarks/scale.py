"""Reduce the reference boom as a shell, from its mesh on: 18,000 to 1.1 million coordinates.

Each size runs in processes of its own, on one rank and on two, whose models are compared.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.ranks import Bounds, record_of
from benchmarks.timing import exponent

Array = NDArray[np.float64]

#: Edge length of the cells around the section, m; along the boom they are twice as long.
SIZES = (0.1, 0.05)
MANY_SIZES = (*SIZES, 0.025, 0.0125)
RANKS = (1, 2)
STAGES = ("mesh", "assembly", "modes", "projection", "flexibility")
#: Wall seconds of one run, and the share of the machine's memory that all its ranks may take.
TIMEOUT, SHARE = 7200.0, 0.85


def measure(sizes: Sequence[float]) -> dict[str, Any]:
    """Records by size and ranks, exponents over the coordinates, and differences between one and two ranks."""
    memory = SHARE * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    records, agreement = [], []
    for size in sizes:
        with TemporaryDirectory() as folder:
            files = [Path(folder, f"{ranks}.npz") for ranks in RANKS]
            for ranks, file in zip(RANKS, files, strict=True):
                load, begun = os.getloadavg()[0], {"cells": size, "ranks": ranks, "seconds": {}}
                done = record_of("benchmarks.scale_run", [str(size), str(file)], ranks, Bounds(TIMEOUT, memory))
                records.append(begun | done | {"load": (load, os.getloadavg()[0])})
            if all(file.is_file() for file in files):
                agreement.append({"size": records[-1]["size"]} | difference(*files))
    return {
        "records": records,
        "exponents": {str(ranks): exponents(records, ranks) for ranks in RANKS},
        "agreement": agreement,
        "bound_GiB": memory / 2**30,
    }


def exponents(records: list[dict[str, Any]], ranks: int) -> dict[str, float]:
    """Exponents over the coordinates of wall time by stage, of processor time, and of memory without libraries."""
    done = [record for record in records if record["ranks"] == ranks and record["seconds"]]
    if len(done) < 2:
        return {}
    size = np.array([record["size"] for record in done], float)
    series = {stage: [record["seconds"][stage] for record in done] for stage in (*STAGES, "total")}
    series["processor"] = [record["processor"] for record in done]
    series["memory"] = [own_memory(record) for record in done]
    return {name: exponent(size, np.array(values)) for name, values in series.items()}


def own_memory(record: Mapping[str, Any]) -> float:
    """Peak memory of all ranks in MB, without that of processes that have only loaded the libraries."""
    return float(sum(record["peak_MB"]) - sum(record["loaded_MB"]))


def difference(one: Path, other: Path) -> dict[str, float]:
    """Largest relative differences between the models in two files: frequencies, modes, and each table.

    Elastic modes are compared vector by vector, rigid-body modes, which may be combined at will, by the space they
    span.  Differences of tables are relative to the largest value in the same column: of one input, output or kind.
    """
    with np.load(one) as a, np.load(other) as b:
        rigid = a["omega"] == 0.0
        elastic = float(np.max(_apart(a["modes"][:, ~rigid], b["modes"][:, ~rigid]), initial=0.0))
        basis = np.linalg.qr(a["modes"][:, rigid])[0]
        outside = b["modes"][:, rigid] - basis @ (basis.T @ b["modes"][:, rigid])
        spaces = float(np.linalg.norm(outside)) / max(float(np.linalg.norm(b["modes"][:, rigid])), 1e-300)
        names = [name for name in a.files if name.startswith("table ")]
        tables = {name.removeprefix("table "): float(np.max(_apart(a[name], b[name]))) for name in names}
        omega = np.abs(b["omega"] / np.where(rigid, 1.0, a["omega"]) - ~rigid)
    return {"frequencies": float(omega.max()), "modes": max(elastic, spaces)} | tables


def _apart(a: Array, b: Array) -> Array:
    """Largest difference in each column, relative to the column's largest entry in `a`."""
    return np.asarray(np.abs(a - b).max(axis=0) / np.maximum(np.abs(a).max(axis=0), 1e-300))
