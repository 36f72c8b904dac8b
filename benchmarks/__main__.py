"""Run the benchmarks: ``python -m benchmarks [--long] [--only NAME ...] [--earlier FOLDER] [--out DIR]``.

Writes benchmarks.json and benchmarks.html; sections that are not run this time are kept from an earlier
benchmarks.json.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from benchmarks import (
    approaches,
    chart,
    fmu,
    growth,
    kernel,
    latency,
    messages,
    offline,
    peer,
    report,
    requirements,
    scale,
    waited_for,
)
from pmr.errors import environment
from pmr.fem.compat import versions as fenicsx_versions

PEER_ELEMENTS = (50, 1000)
REPEATS = {False: 5, True: 9}


def sections(long: bool, earlier: Path | None = None) -> Mapping[str, Callable[[], Any]]:
    """Functions that measure each section, by its name, the quick ones first.

    `long` selects more sizes and repeats; `earlier` is a checkout with which commands are compared.
    """
    repeats = REPEATS[long]
    return {
        "latency": latency.measure,
        "kernel": kernel.measure,
        "growth": lambda: growth.measure(long),
        "fmu": lambda: fmu.measure(repeats),
        "waited for": lambda: waited_for.measure(long, earlier),
        "chart": chart.measure,
        "peer": lambda: [peer.measure(elements, repeats) for elements in PEER_ELEMENTS],
        "approaches": lambda: {
            "small": approaches.small(repeats),
            "in_exudyn": approaches.in_exudyn(repeats),
            "cases": {
                name: approaches.measure(name, repeats, 1.0 if long else approaches.SHARE)
                for name in approaches.beams.CASES
            },
        },
        "offline": lambda: offline.measure(long, 3 if long else 1),
        "scale": lambda: scale.measure(scale.MANY_SIZES if long else scale.SIZES),
        "messages": lambda: messages.measure(messages.MANY_SIZES if long else messages.SIZES),
    }


def main() -> int:
    """Run the chosen sections, write the page and print which requirements do not hold; return 0."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__.splitlines()[0])
    parser.add_argument("--long", action="store_true", help="the paper's way over its whole time span, a million dofs")
    parser.add_argument(
        "--only", nargs="+", choices=list(sections(False)), metavar="NAME", default=list(sections(False))
    )
    parser.add_argument("--out", type=Path, default=Path("reports/benchmarks"))
    parser.add_argument(
        "--earlier", type=Path, metavar="FOLDER", help="a checkout whose commands are waited for in turn"
    )
    chosen = parser.parse_args()
    logging.getLogger("pmr").setLevel(logging.ERROR)
    chosen.out.mkdir(parents=True, exist_ok=True)
    file = chosen.out / "benchmarks.json"
    results = json.loads(file.read_text()) if file.is_file() else {"sections": {}}
    for name, measure in sections(chosen.long, chosen.earlier).items():
        if name not in chosen.only:
            continue
        begin, load = time.perf_counter(), os.getloadavg()[0]
        print(f"{name} ...", end=" ", flush=True, file=sys.stderr)
        measured = measure()
        seconds = time.perf_counter() - begin
        print(f"{seconds:.0f} s", file=sys.stderr)
        about = {"seconds": seconds, "load_before": load, "commit": environment.checkout_commit(), "long": chosen.long}
        results["sections"][name] = measured
        results.setdefault("about", {})[name] = about
    results |= {
        "machine": environment.describe_machine(),
        "versions": environment.package_versions() | fenicsx_versions() | peer.version(),
        "requirements": requirements.judged(results["sections"]),
    }
    file.write_text(json.dumps(results, indent=1) + "\n")
    page = report.write(results, chosen.out)
    missed = [one["text"] for one in results["requirements"] if not one["holds"]]
    print(f"{page}: {len(results['requirements']) - len(missed)} of {len(results['requirements'])} requirements hold")
    for text in missed:
        print(f"  does not hold: {text}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
