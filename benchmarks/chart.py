"""Time of a load chart: computed from the scene file, and again after a limit has changed."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

from benchmarks.beams import CRANE
from benchmarks.waited_for import taken_by

#: A boom of three sections as beams in space, at 40 extensions and 20 angles, with a limit of each kind that it has.
STUDY = f"""
kind = "chart"
title = "What the crane carries"
scene = "{CRANE}"
up_to = 100e3
extensions = {{ least = 0.6, most = 4.5, count = 40 }}
luffing = {{ least = 0.0, most = 76.0, count = 20 }}

[change.sections]
base.probes = [{{ name = "top", at = [3.0, 0.0, 0.2], measures = ["stress"] }}]
middle.probes = [{{ name = "top", at = [2.0, 0.0, 0.18], measures = ["stress"] }}]
fly.probes = [{{ name = "corner", at = [2.0, 0.11, 0.16], measures = ["stress"] }}]
fly.masses = []

[[limits]]
name = "stress"
of = "stress"
most = 120e6

[[limits]]
name = "pads"
of = "pad"
most = 40e3

[[limits]]
name = "cylinders"
of = "cylinder"
most = 15e3

[[limits]]
name = "support"
of = "support"
most = 100e3
which = ["*luffing*"]

[[limits]]
name = "luffing"
of = "luffing"
most = 300e3

[[limits]]
name = "tip"
of = "deflection"
most = 0.3

[[limits]]
name = "expression"
of = "expression"
expression = 'abs(force["cylinder of fly"]) + 0.1 * load'
most = 16e3

[[limits]]
name = "buckling"
of = "buckling"
least = 3.0

[[limits]]
name = "frequency"
of = "frequency"
least = 0.4

[[limits]]
name = "tipping"
of = "overturning"
factor = 1.33
polygon = [[2.5, 2.5], [-2.5, 2.5], [-2.5, -2.5], [2.5, -2.5]]
height = 1.5
machine = [{{ name = "carrier", mass = 14000.0, at = [-0.5, 0.0, -1.0] }}]
"""
#: What is written anew for the second run.
CHANGED = ("most = 0.3", "most = 0.25")
#: Seconds of wall time that were asked for, on two cores.
ASKED = {"from the scene file": 60.0, "with the reduction cached": 10.0}


def measure() -> dict[str, dict[str, float]]:
    """Seconds of wall and processor time of both runs, report included, and the wall time that is required."""
    with tempfile.TemporaryDirectory() as folder:
        return of(Path(folder))


def of(folder: Path) -> dict[str, dict[str, float]]:
    """Measure both runs in a folder, in which the first one leaves its cache for the second."""
    pmr = (sys.executable, "-m", "pmr")
    variables = {"OMP_NUM_THREADS": "1"}
    found = {}
    for name, text in zip(ASKED, (STUDY, STUDY.replace(*CHANGED)), strict=True):
        (folder / "chart.toml").write_text(text)
        used = taken_by(folder, variables, *pmr, "study", "chart.toml", "--jobs", "2")
        cores = float(os.cpu_count() or 1)
        found[name] = {"wall": used.wall, "processor": used.seconds, "asked": ASKED[name], "cores": cores}
    return found
