"""Processor time of the kernel's loop and of a whole `simulate`, each by step, beside an earlier checkout.

``python -m benchmarks.kernel [--earlier FOLDER] [SCENE ...]`` prints a line for each scene.  The loop gets samples of
its drivers and records coordinates, rates, forces and energies.  The whole also evaluates signals and returns a
trajectory of the bodies' coordinates.
"""

from __future__ import annotations

import argparse
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.beams import CRANE, WORKFLOWS
from pmr.kernel.state import Record
from pmr.pipeline import reduce
from pmr.scene import load_any
from pmr.simulation.excitation import Excitation
from pmr.simulation.moving import read_scene
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.systems import March

SCENES = ("evolved_residual", "boom_beam", "boom_two", "boom_three", "boom_four", "boom_three_shell", "crane")
LOOP = ("z", "v", "multipliers", "energy", "impulses", "peaks", "parts")
#: Samples are of so many times, of so many steps at least.
TIMES, FINE = 2048, 64
#: The whole in an earlier checkout, of its own workflow with the name; `read_scene` once had another name.
_EARLIER = """
import sys, time
from pmr.pipeline import reduce
from pmr.scene import load_any
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
try:
    from pmr.simulation.moving import read_scene
except ImportError:
    from pmr.simulation.recorded import recorded as read_scene
name, repeats = sys.argv[1:]
system = reduce(load_any(name)).system
excitation = read_scene(system, name).excitation
start = systems.start_of(system, excitation) if hasattr(systems, "start_of") else None
form, least = SystemForm.of(system), 1e9
for _ in range(int(repeats) + 1):
    begun = time.process_time()
    systems.simulate_form(form, excitation, start)
    least = min(least, time.process_time() - begun)
print(least)
"""


def _scene_file(name: str) -> Path:
    """Return the scene file called `name`: a workflow, or the crane of the benchmarks."""
    return CRANE if name == "crane" else WORKFLOWS / f"{name}.toml"


def measure(
    scenes: Sequence[str] = SCENES,
    repeats: int = 5,
    earlier: Path | None = None,
    say: Callable[[str], None] | None = None,
) -> list[dict[str, Any]]:
    """Least processor times of `repeats` runs in microseconds a step, and bytes of a state and of its system, by scene.

    Each line is passed to `say` when it is known; ``earlier`` is there only with an earlier checkout.
    """
    rows = list[dict[str, Any]]()
    for name in scenes:
        system = reduce(load_any(_scene_file(name))).system
        excitation = read_scene(system, name).excitation
        form, steps = SystemForm.of(system), excitation.stepping.steps
        march = March(form, excitation)
        row: dict[str, Any] = {
            "scene": name,
            "loop": 1e6 * min(_loop(march) for _ in range(repeats)) / steps,
            "whole": 1e6 * min(_whole(form, excitation) for _ in range(repeats)) / steps,
            "state_bytes": march.state.memory,
            "system_bytes": len(form.kernel.block),
        }
        if earlier is not None:
            row["earlier"] = (
                1e6 * _whole_in(earlier, str(_scene_file(name)) if name == "crane" else name, repeats) / steps
            )
        rows.append(row)
        if say is not None:
            ratio = f", earlier {row['earlier']:.3f}, ratio {row['whole'] / row['earlier']:.2f}" if earlier else ""
            say(f"{name:18} loop {row['loop']:.3f}, whole {row['whole']:.3f}{ratio} us")
    return rows


def _loop(march: March) -> float:
    """Processor time in s of the kernel's loop over all steps."""
    state, steps = march.state, len(march.t) - 1
    march.rerun()  # the caches are warm, and the state is opened
    march.restart()
    record, at, per, seconds = Record(state.kernel, steps, LOOP), 0, state.settings.parts[0], 0.0
    while at < steps:
        u = march.sample_drivers(at, min(steps, at + max(FINE, TIMES // per)), per)
        begun = time.process_time()
        taken, needed = state.advance_sampled(u, per, record, at)
        seconds += time.process_time() - begun
        at, per = at + taken, needed or max(state.settings.parts[0], per // 2)
    return seconds


def _whole(form: SystemForm, excitation: Excitation) -> float:
    """Processor time in s of a simulation."""
    begun = time.process_time()
    systems.simulate_form(form, excitation)
    return time.process_time() - begun


def _whole_in(earlier: Path, name: str, repeats: int) -> float:
    """Processor time in s of the simulation of a workflow in an earlier checkout, in a process of its own."""
    command = [str(earlier / ".venv/bin/python"), "-c", _EARLIER, name, str(repeats)]
    return float(subprocess.run(command, cwd=earlier, check=True, capture_output=True, text=True).stdout)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--earlier", type=Path)
    arguments = parser.parse_args()
    measure(arguments.scenes, earlier=arguments.earlier, say=print)
