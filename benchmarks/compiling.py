"""How long the compiled loops take to compile, with an empty cache and from it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

_SCRIPT = """
import json, time
from benchmarks import beams
from pmr.simulation.modal import modal_form
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.stepper import Stepper

body, drive = beams.reduced("evolved"), beams.shorter(beams.drive("evolved"), 0.001)
form = SystemForm.alone(modal_form(body))
seconds = {}
def timed(name, work):
    begin = time.perf_counter()
    work()
    seconds[name] = time.perf_counter() - begin
timed("all steps kept", lambda: systems.simulate_form(form, drive))
timed("step by step", lambda: Stepper(body, 1e-3, 1.25).step(1.25, 0.0))
print(json.dumps(seconds))
"""


def measure() -> dict[str, dict[str, float]]:
    """Seconds of the first call of each loop, in a process of its own each time."""
    folder = Path(__file__).resolve().parents[1]
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"NUMBA_CACHE_DIR": cache, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(folder)}
        return {
            kind: json.loads(
                subprocess.run(
                    [sys.executable, "-c", _SCRIPT], cwd=folder, env=environment, capture_output=True, check=True
                ).stdout.splitlines()[-1]
            )
            for kind in ("empty cache", "from the cache")
        }
