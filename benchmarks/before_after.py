"""Compare two checkouts: ``python -m benchmarks.before_after FOLDER [--sizes M ...] [--alone M ...]``.

Both the checkout in FOLDER and this one compute the reduced model from the mesh on (`benchmarks.scale_run`), in turn,
at each size on one rank and on two; only this one does so at the sizes of ``--alone``.  A line is printed after each
run.  Runs are repeated once, if they can be expected to end within ``--minutes``.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.ranks import HERE, Bounds, record_of
from benchmarks.scale import RANKS, STAGES, difference, own_memory


@dataclass(frozen=True)
class Case:
    """Size of cells in m and number of ranks, and the checkout that reduces the boom."""

    cells: float
    ranks: int
    checkout: str
    folder: Path

    def run(self, results: Path, seconds: float) -> dict[str, Any]:
        """Run the case, print its times and return its record; empty if it did not finish within `seconds`.

        The modes and tables of the model are left in a file in the folder `results`.
        """
        file = results / f"{self.cells:g} {self.ranks} {self.checkout}.npz"
        record = record_of(
            "benchmarks.scale_run", [str(self.cells), str(file)], self.ranks, Bounds(seconds), self.folder
        )
        if not record.get("seconds"):
            print(f"{self.cells:g} m, {self.ranks} ranks, {self.checkout}: {'; '.join(record['notes'])}", flush=True)
            return {}
        stages = ", ".join(f"{stage} {record['seconds'][stage]:.2f}" for stage in STAGES)
        print(
            f"{record['size']:9,} coordinates, {self.ranks} rank(s), {self.checkout:6}: "
            f"{record['seconds']['total']:7.2f} s, processor {record['processor']:7.2f} s, "
            f"{own_memory(record) * 1.024**2 * 1e3 / record['size']:5.2f} kB a coordinate ({stages})",
            flush=True,
        )
        return record


def main() -> int:
    """Run all cases, again while there is time, and print medians, ratios and differences between the models."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.before_after", description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="a checkout of before")
    parser.add_argument("--sizes", type=float, nargs="+", default=[0.05, 0.025], metavar="M")
    parser.add_argument("--alone", type=float, nargs="*", default=[], metavar="M")
    parser.add_argument("--minutes", type=float, default=12.0)
    asked = parser.parse_args()
    begin, both = time.perf_counter(), {"before": asked.folder.resolve(), "now": HERE}
    cases = [Case(size, ranks, *one) for size in asked.sizes for ranks in RANKS for one in both.items()]
    cases += [Case(size, ranks, "now", HERE) for size in asked.alone for ranks in RANKS]
    totals: dict[Case, list[float]] = {case: [] for case in cases}
    with TemporaryDirectory() as folder:
        for case in [*cases, *cases]:
            left = 60.0 * asked.minutes - (time.perf_counter() - begin)
            if left > 0.0 and 1.3 * max(totals[case], default=0.0) < left:
                record = case.run(Path(folder), left)
                totals[case] += [record["seconds"]["total"]] if record else []
        for size in asked.sizes:
            for ranks in RANKS:
                before, now = (Case(size, ranks, *one) for one in both.items())
                _compare(before, now, totals, Path(folder))
    for size in [*asked.sizes, *asked.alone]:
        one, two = (totals[Case(size, ranks, "now", HERE)] for ranks in RANKS)
        if one and two:
            print(
                f"{size:g} m: two ranks are {statistics.median(one) / statistics.median(two):.2f} times as fast as one"
            )
    return 0


def _compare(before: Case, now: Case, totals: dict[Case, list[float]], results: Path) -> None:
    """Print the times of both checkouts, their ratio, and how far their models are apart."""
    if not totals[before] or not totals[now]:
        return
    was, takes = statistics.median(totals[before]), statistics.median(totals[now])
    files = (results / f"{case.cells:g} {case.ranks} {case.checkout}.npz" for case in (before, now))
    apart = ", ".join(f"{name} {value:.1e}" for name, value in difference(*files).items())
    print(f"{now.cells:g} m, {now.ranks} rank(s): {was:.2f} -> {takes:.2f} s, {was / takes:.2f} times; apart: {apart}")


if __name__ == "__main__":
    sys.exit(main())
