"""Start runs side by side, to see that none disturbs the start of MPI in another one.

python tests/starts.py [RUNS [AT_A_TIME [RANKS]]]      300 runs, six at a time, on one rank by default
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from processes import python

#: A run of the whole way but its report, in a second.
RUN = """
import pmr
keys = ["compare.against=[]", "mesh.elements=8", "reduction.coordinates=9", "time.end=0.1"]
pmr.run(pmr.load_scene("paper_simple", [*keys, "simulation.simulators=['march']"]))
"""


def failures(runs: int, at_a_time: int, ranks: int = 1) -> list[subprocess.CompletedProcess[str]]:
    """Start `runs` runs, `at_a_time` at once, and return the processes that did not end with exit code 0."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(at_a_time) as pool:
        done = pool.map(lambda _: python("-c", RUN, ranks=ranks, cwd=Path(folder)), range(runs))
        return [process for process in done if process.returncode != 0]


if __name__ == "__main__":
    runs, at_a_time, ranks = (*map(int, sys.argv[1:]), *(300, 6, 1)[len(sys.argv) - 1 :])
    failed = failures(runs, at_a_time, ranks)
    for process in failed:
        print(process.stderr)
    sys.exit(f"{len(failed)} of {runs} runs failed" if failed else 0)
