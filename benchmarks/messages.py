"""Count what each of several ranks solves, sends and holds; counts do not depend on the number of cores.

A small library between the program and MPI (messages.c) counts each rank's messages and their bytes.
"""

from __future__ import annotations

import math
import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.messages_run import KINDS, SOLVED
from benchmarks.ranks import Bounds, record_of

SIZES = (0.1, 0.05)
MANY_SIZES = (*SIZES, 0.025)
RANKS = (1, 2, 4, 8)
TIMEOUT = 3600.0
#: A network: seconds that a message waits, and bytes a second.
NETWORKS = {"10 Gbit Ethernet": (20e-6, 1e9), "InfiniBand": (2e-6, 1e10)}
#: Model of a rank's memory above what the libraries take: MB, and bytes a coordinate on each rank and shared among all.
FIXED, OF_EACH, SHARED = 100.0, 3650.0, 2200.0


def measure(sizes: Sequence[float] = SIZES, ranks: Sequence[int] = RANKS) -> dict[str, Any]:
    """Records of a run at each size on each number of ranks."""
    memory = 0.85 * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    with TemporaryDirectory() as folder:
        arguments = [str(library(Path(folder)))]
        records = []
        for size in sizes:
            for number in ranks:
                begun = {"cells": size, "ranks": number, "each": []}
                run = record_of("benchmarks.messages_run", [*arguments, str(size)], number, Bounds(TIMEOUT, memory))
                records.append(begun | run)
    return {"records": records}


def library(folder: Path) -> Path:
    """Compile the counting library for this machine's MPI into a folder, and return its path.

    Open MPI keeps Fortran's calls in a library of its own.  Raises a `RuntimeError` with the compiler's message.
    """
    source, target = Path(__file__).with_name("messages.c"), folder / "messages.so"
    command = ["mpicc", "-O1", "-shared", "-fPIC", "-o", str(target), str(source)]
    for fortran in (["-lmpi_mpifh"], []):
        built = subprocess.run([*command, *fortran], capture_output=True, text=True)
        if built.returncode == 0:
            return target
    raise RuntimeError(built.stderr)


def share(record: Mapping[str, Any]) -> dict[str, dict[str, int]]:
    """Largest count of any rank, by stage and by kind of count."""
    return {
        stage: {
            kind: max(one["stages"][stage][k] for one in record["each"]) for k, kind in enumerate((*KINDS, *SOLVED))
        }
        for stage in record["each"][0]["stages"]
    }


def total(record: Mapping[str, Any], kind: str) -> int:
    """Largest count of any rank over all stages, of one kind."""
    k = (*KINDS, *SOLVED).index(kind)
    return max(sum(counts[k] for counts in one["stages"].values()) for one in record["each"])


def sent(record: Mapping[str, Any]) -> int:
    """Bytes that leave the rank which sends most."""
    return total(record, "message_bytes") + total(record, "collective_bytes")


def seconds(record: Mapping[str, Any], latency: float, speed: float) -> float:
    """Time in s of all messages of a rank, one after the other, on a network of this latency (s) and speed (B/s).

    A collective call counts as log2 of the number of ranks messages, rounded up.
    """
    rounds = total(record, "messages") + total(record, "collectives") * math.ceil(math.log2(record["ranks"]))
    return rounds * latency + sent(record) / speed


def memory(record: Mapping[str, Any]) -> list[float]:
    """Peak memory of each rank in MB, without what the libraries take."""
    return [one["peak_MB"] - one["loaded_MB"] for one in record["each"]]


def planned_memory(size: int, ranks: int) -> float:
    """Peak memory of a rank in MB by the model, for `size` coordinates on some ranks."""
    return FIXED + size * (OF_EACH + SHARED / ranks) / 2**20
