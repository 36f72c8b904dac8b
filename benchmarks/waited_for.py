"""What people wait for: processor time of commands, first with empty caches and later, beside what was asked."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

#: Seconds of processor time that were asked for.
ASKED = {
    "pmr --help": 0.3,
    "pmr info": 0.8,
    "pmr run of pmr new boom, first": 8.0,
    "pmr run of pmr new boom, later": 8.0,
    "pmr export --to fmu, first": 10.0,
    "pmr export --to fmu, later": 10.0,
    "pmr run boom_three, first": 7.5,
    "pmr run boom_three, later": 5.0,
    "pmr run boom on pads that push, --tolerance 1%, first": 2.0,
    "pmr run boom on pads that push, --tolerance 1%, later": 2.0,
    "pmr run of pmr new boom, first after pmr compile": 8.0,
    "pmr run boom_three, first after pmr compile": 7.5,
}


def measure() -> dict[str, dict[str, float]]:
    """Seconds of processor time of each, and those asked for."""
    with tempfile.TemporaryDirectory() as folder:
        at = Path(folder)
        pmr = (sys.executable, "-m", "pmr")
        caches = {"NUMBA_CACHE_DIR": folder, "ZIG_GLOBAL_CACHE_DIR": f"{folder}/zig", "OMP_NUM_THREADS": "1"}
        caches["PYTHONDONTWRITEBYTECODE"] = ""  # modules stay compiled from one command to the next, as for any user
        seconds_of(at, caches, *pmr, "new", "boom", "mine")
        commands = {
            "pmr --help": ("--help",),
            "pmr info": ("info",),
            "pmr run of pmr new boom, first": ("run", "mine"),
            "pmr run of pmr new boom, later": ("run", "mine"),
            "pmr export --to fmu, first": ("export", "reports/mine/reduced.npz", "--to", "fmu"),
            "pmr export --to fmu, later": ("export", "reports/mine/reduced.npz", "--to", "fmu"),
            "pmr run boom_three, first": ("run", "boom_three"),
            "pmr run boom_three, later": ("run", "boom_three"),
            "pmr run boom on pads that push, --tolerance 1%, first": ("run", "mine", "--tolerance", "1%"),
            "pmr run boom on pads that push, --tolerance 1%, later": ("run", "mine", "--tolerance", "1%"),
        }
        taken = {name: seconds_of(at, caches, *pmr, *rest) for name, rest in commands.items()}
        caches["NUMBA_CACHE_DIR"] = f"{folder}/compiled"
        seconds_of(at, caches, *pmr, "compile")
        for name, scene in (("pmr run of pmr new boom", "mine"), ("pmr run boom_three", "boom_three")):
            taken[f"{name}, first after pmr compile"] = seconds_of(at, caches, *pmr, "run", scene)
        return {name: {"seconds": seconds, "asked": ASKED[name]} for name, seconds in taken.items()}


def seconds_of(folder: Path, variables: dict[str, str], *command: str) -> float:
    """Seconds of processor time of a command and of the processes that it waits for; raises where it fails."""
    before = _of_children()
    subprocess.run(list(command), cwd=folder, env=os.environ | variables, capture_output=True, check=True)
    return _of_children() - before


def _of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
