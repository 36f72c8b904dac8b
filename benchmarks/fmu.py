"""Time of a communication step of an FMU, called through its C interface by a program in C."""

from __future__ import annotations

import re
import subprocess
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import beams
from benchmarks.timing import Times, side_by_side
from pmr.export.fmi import PLATFORMS, write_fmu
from pmr.export.fmi.variables import ORDERS
from pmr.pipeline import reduce
from pmr.scene import load_any
from pmr.system.body import force_outputs
from pmr.system.system import System

CASES = {
    "evolved case": "evolved_residual.toml",
    "shell boom": "boom_shell.toml",
    "three sections on pads that push": "boom_three.toml",
}
STEPS = 20_000


def measure(repeats: int, steps: int = STEPS, cases: dict[str, str] = CASES) -> dict[str, Any]:
    """Processor time in s of an internal step, all inputs set and all displacements read, for each of the `cases`.

    These map names to scene files.
    """
    with tempfile.TemporaryDirectory() as made:
        ways = {}
        for name, file in cases.items():
            (folder := Path(made, name)).mkdir()
            system = reduce(load_any(beams.WORKFLOWS / file)).system
            written = write_fmu(system.save(folder / "system.npz"), folder / "body.fmu", "2", PLATFORMS[:1])
            timed, size = Timed(system, written, folder), sum(body.size for body in system.reduced.values())
            ways[f"{name}, {size} coordinates"] = lambda timed=timed: timed.seconds(steps)
        found: dict[str, Times] = side_by_side(ways, repeats)
    return {"steps": steps, "seconds": {name: times.summary() for name, times in found.items()}}


class Timed:
    """Timing program, with the library of an FMU of FMI 2.0 that is unpacked in a folder."""

    def __init__(self, system: System, file: Path, folder: Path) -> None:
        self._program = folder / "timing"
        source = Path(__file__).with_suffix(".c")
        subprocess.run(["cc", "-O2", str(source), "-o", str(self._program), "-ldl"], check=True)
        with zipfile.ZipFile(file) as archive:
            archive.extractall(folder)
        said = (folder / "modelDescription.xml").read_text()
        outputs = [int(n) for n in re.findall(r'valueReference="(\d+)" description="[^"]*" causality="output"', said)]
        # each has three rates beside it
        inputs, token = said.count('causality="input"') // ORDERS, re.findall(r'guid="([^"]*)"', said)[0]
        shown = sum(int(np.count_nonzero(~force_outputs(body))) for body in system.reduced.values())
        (step,) = re.findall(r'name="internal_step".*?start="([^"]*)"', said, re.DOTALL)
        library = next((folder / "binaries" / PLATFORMS[0].folder_2).iterdir())
        self._before, self._after = (
            [str(library), token],
            [
                *(step, *map(str, (min(outputs), shown, inputs, len(system.paths)))),
                (folder / "resources").resolve().as_uri(),
            ],
        )

    def seconds(self, steps: int) -> float:
        """Processor time in s of a step, the mean of `steps`."""
        command = [str(self._program), *self._before, str(steps), *self._after]
        return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
