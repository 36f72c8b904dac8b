"""Time of one step of a stepper called from Python: median and worst cases.

``python -m benchmarks.latency [--earlier FOLDER]`` prints the processor time of a step of booms, and of a machine that
moves below one, in turn with an earlier checkout that has its own .venv.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import beams
from pmr.simulation.native.stepper import Stepper

Array = NDArray[np.float64]

CALLS = 100_000
#: Of the slider's way to and fro, taken again and again.
STEPS = 15_000
QUANTILES = {"median": 0.5, "p99": 0.99, "p99.9": 0.999, "worst": 1.0}


def measure(calls: int = CALLS) -> dict[str, Any]:
    """Quantiles in ns of the time of a step, without that of the clock itself, for several models and outputs."""
    bodies = {"r = 20": beams.plain(20), "r = 20, two rows held": beams.reduced("evolved")}
    bodies |= {"r = 6": beams.plain(6), "r = 6, residual flexibility": beams.flexible(6)}
    times = {}
    for name, body in bodies.items():
        count = len(body.output_positions)
        for outputs, chosen in {"tip": [count - 1], f"{count} outputs": list(range(count))}.items():
            steps = _from_python(Stepper(body, *_start(), outputs=chosen), calls)
            times[f"{name}, {outputs}"] = _quantiles(steps)
    return {"calls": calls, "ns": times}


def _start() -> tuple[float, float, Array]:
    """Step in s, path in m and loads in N at the start."""
    drive = beams.sliding(STEPS)
    return drive.stepping.step, float(drive.s[0, 0]), drive.f[0]


def _inputs() -> tuple[Array, Array]:
    """Paths (T,) in m and loads (T, i) in N of all steps."""
    drive = beams.sliding(STEPS)
    return np.ascontiguousarray(drive.s[1:, 0]), drive.f[1:]


def _from_python(stepper: Stepper, calls: int) -> Array:
    """Time (calls,) in ns of each step: between two readings of the clock, less the least time of a reading."""
    s, f = (values.ravel().tolist() for values in _inputs())
    stamps = np.zeros((calls, 3), np.int64)
    for n in range(calls):
        position, force = s[n % len(s)], f[n % len(f)]
        a = time.perf_counter_ns()
        stepper.step(position, force)
        b = time.perf_counter_ns()
        stamps[n] = a, b, time.perf_counter_ns()
    stepper.check_finite()
    return np.diff(stamps[:, :2], axis=1)[:, 0] - float(np.diff(stamps[:, 1:], axis=1).min())


def _quantiles(ns: Array) -> dict[str, float]:
    """Quantiles of times in ns, by name."""
    return {name: float(np.quantile(ns, q)) for name, q in QUANTILES.items()}


#: Models, which both checkouts load.
_MODELS = """
import sys, pmr
for name, scene in (("boom_three", "boom_three"), ("crane", sys.argv[2])):
    pmr.reduce(pmr.load_scene(scene, ["compare.against=[]"])).system.save(f"{sys.argv[1]}/{name}.npz")
"""
#: The least of some hundred steps in microseconds, by public names that an earlier checkout has too.
_STEPS = """
import json, sys, time, warnings
import pmr
from pmr.simulation.native.machine import MachineRun
from pmr.simulation.moving import MovingFrame
from pmr.simulation.moving import read_scene
from pmr.system.system import System
warnings.simplefilter("ignore")

def least(step, count=200, repeats=20):
    best = 1e9
    for k in range(repeats):
        begun = time.process_time()
        for n in range(k * count, (k + 1) * count):
            step(n)
        best = min(best, (time.process_time() - begun) / count)
    return 1e6 * best

folder, times = sys.argv[1], {}
system = System.load(f"{folder}/boom_three.npz")
excitation = read_scene(system, "boom_three").excitation
fly = excitation.s[:, list(excitation.paths).index("fly")].tolist()
places = dict(zip(excitation.paths, excitation.s[0].tolist()))
for what, outputs in (("all outputs", None), ("one output", system.output_names[-1:])):
    stepper = pmr.Stepper(system, excitation.stepping.step, places, outputs=outputs)
    times[f"boom_three, {what}"] = least(lambda n: stepper.step({"fly": fly[n + 1]}))
system = System.load(f"{folder}/crane.npz")
of_system = MovingFrame.from_system if hasattr(MovingFrame, "from_system") else MovingFrame.of
frame, excitation = of_system(system), read_scene(system, "crane").excitation
motions = frame.motions(excitation, excitation.times[:4001]).tolist()
def given(names, k):
    numbers = [frame.drivers.index(name) for name in names]
    return {name: tuple(row[j][k] for row in motions) for name, j in zip(names, numbers)}
steps = [(given(frame.paths, k), given((*frame.angles, *frame.axes), k)) for k in range(4001)]
loads = {name: motion[0] for name, motion in given(frame.loads, 0).items()}
for what, outputs in (("all outputs", None), ("one output", system.output_names[-1:])):
    stepper = pmr.Stepper(system, excitation.stepping.step, steps[0][0], loads, frame=steps[0][1], outputs=outputs)
    times[f"crane in its frame, {what}"] = least(lambda n: stepper.step(steps[n + 1][0], frame=steps[n + 1][1]))
truck = [
    "compare.against=[]", "frame.machine={mass=2e4, center=[0.0, 0.0, -1.0], inertia=[2e4, 6e4, 6e4]}",
    "frame.machine.free=['x', 'z', 'rx', 'ry']", "frame.machine.stiffness={x=1e6, z=4e6, rx=8e6, ry=8e6}",
    "frame.second_order=true",
]
run = MachineRun(pmr.load_scene(sys.argv[2], [*truck, "time.end=1"]), system)
run.run()
machine = run.simulation if hasattr(run, "simulation") else run.carried  # its name in earlier checkouts
nothing, steps = 0.0 * machine.state.z, len(machine.motion) - 1
def advance(n):
    machine.start(machine.motion[0].copy(), nothing, nothing)
    begun = time.process_time()
    machine.advance(steps)
    return 1e6 * (time.process_time() - begun) / steps
times["crane on a machine with four free directions"] = min(map(advance, range(20)))
print(json.dumps(times))
"""


def booms(earlier: Path | None = None) -> dict[str, list[float]]:
    """Least processor time of a step in microseconds by case: in this checkout, then in the earlier one if given."""
    with TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-c", _MODELS, folder, str(beams.CRANE)], check=True)
        pythons = [sys.executable, *([] if earlier is None else [str(earlier / ".venv" / "bin" / "python")])]
        runs = [
            subprocess.run(
                [python, "-c", _STEPS, folder, str(beams.CRANE)], check=True, capture_output=True, text=True, cwd=folder
            )
            for python in pythons
        ]
    times = [json.loads(run.stdout) for run in runs]
    return {name: [of[name] for of in times] for name in times[0]}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--earlier", type=Path)
    for name, found in booms(parser.parse_args().earlier).items():
        print(f"{name:46} " + ", ".join(f"{us:.2f} us" for us in found), end="")
        print(f", ratio {found[0] / found[1]:.3f}" if len(found) > 1 else "")
