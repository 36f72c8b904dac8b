"""Process that judges mutations and prints a line for each: `python -m fuzz.worker kind first last`.

One process judges many, since FEniCSx takes seconds to load: without arguments it reads such lines from its input,
until that ends; another process starts it anew if a mutation killed it.  It first compiles what mutations need, unless
a fourth word says that another process has: what is compiled is on disk.
"""

import importlib
import json
import os
import resource
import sys
import tempfile
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import TextIO

import numpy as np

SEED = 20_260
READY, COMPILED = "ready", "compiled"
MOST_MEMORY = 6 * 2**30  # bytes of address space


def main() -> None:
    """Judge the mutations that arguments, or lines of the input, name."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    for asked in [sys.argv[1:]] if len(sys.argv) > 1 else map(str.split, sys.stdin):
        kind, first, last, *told = asked
        judge(answers, kind, range(int(first), int(last)), COMPILED in told)


def judge(answers: TextIO, kind: str, numbers: range, is_compiled: bool) -> None:
    """Judge mutations of a kind and write a line for each to `answers`."""
    from fuzz.verdict import judged

    module = importlib.import_module(f"fuzz.{kind}")
    stamp = sum(map(ord, kind))
    prepare = None if is_compiled else getattr(module, "prepare", None)
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
