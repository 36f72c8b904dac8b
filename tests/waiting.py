"""Wait for other processes, however slow the machine is."""

import subprocess
import time
from collections.abc import Callable
from pathlib import Path

PATIENCE = 1200.0  # s: only what hangs takes so long


def wait_until(condition: Callable[[], object], process: subprocess.Popen | None = None) -> None:
    """Wait until the condition holds; fail after `PATIENCE` s, or if the process, if there is one, ends before."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert process is None or process.poll() is None, f"it ended with {process.returncode}"
        assert time.monotonic() < deadline
        time.sleep(0.005)


def is_alive(pid: int) -> bool:
    """Whether a process runs; one that has ended but is not collected by its parent does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False
