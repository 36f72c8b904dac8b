"""A process that judges mutations and prints a line for each: `python -m fuzz.worker kind first last [compiled]`.

One process for many, since FEniCSx takes seconds to load; another process starts it anew after one that killed it.  It
compiles first what mutations take, unless it is told that another process has: what is compiled is on disk.
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import sys
import tempfile
import warnings
from dataclasses import asdict
from pathlib import Path

import numpy as np

SEED = 20_260
READY, COMPILED = "ready", "compiled"
MOST_MEMORY = 6 * 2**30  # bytes of address space


def main() -> None:
    kind, numbers = sys.argv[1], range(int(sys.argv[2]), int(sys.argv[3]))
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    from fuzz.verdict import judged

    module = importlib.import_module(f"fuzz.{kind}")
    stamp = sum(map(ord, kind))
    prepare = None if COMPILED in sys.argv[4:] else getattr(module, "prepare", None)
    if prepare is not None:
        prepare()
    print(COMPILED if prepare is not None else READY, file=answers, flush=True)
    for number in numbers:
        rng = np.random.default_rng([SEED, stamp, number])
        with tempfile.TemporaryDirectory() as folder:
            verdict = judged(
                number, lambda rng=rng, folder=folder, number=number: module.case(number, rng, Path(folder))
            )
        print(json.dumps(asdict(verdict)), file=answers, flush=True)


if __name__ == "__main__":
    main()
