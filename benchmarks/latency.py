"""Time of one step of a stepper called from Python: median and worst cases.

``python -m benchmarks.latency [--earlier FOLDER]`` prints the processor time of a step of booms, of a machine on oil
with a hoist and outriggers, and of a machine that moves below a boom, in turn with an earlier checkout that has its own
.venv.
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
    assert np.isfinite(stepper.q).all()
    return np.diff(stamps[:, :2], axis=1)[:, 0] - float(np.diff(stamps[:, 1:], axis=1).min())


def _quantiles(ns: Array) -> dict[str, float]:
    """Quantiles of times in ns, by name."""
    return {name: float(np.quantile(ns, q)) for name, q in QUANTILES.items()}


#: Keys of a machine of three sections on oil that hoists a load, on outriggers.
_MACHINE = (
    "time.step=1e-3",
    "section.joint.extension={kind='smooth_ramp', times=[0.2, 2.0], values=[2.0, 2.3]}",
    "frame.slewing={kind='smooth_ramp', times=[0.1, 2.0], values=[0.0, 10.0]}",
    "hoist={payload=400.0, hook=50.0, EA=1.2e7, damping=5e4, falls=2, hanging=6.0, winch={at=[-0.5, 0.0, 0.4]}, "
    "speed={kind='smooth_ramp', times=[0.2, 1.0], values=[0.0, 0.3]}}",
    "frame.cylinder.oil.valve.opening={kind='smooth_ramp', times=[0.1, 0.5], values=[0.0, 0.6]}",
    "frame.ground={height=1.6, masses=[{name='carrier', mass=1.5e4, at=[-0.6, 0.0, -0.9], inertia=[7e3, 2e4, 2.3e4]}, "
    "{name='weight', mass=3e3, at=[-1.2, 0.0, -0.1], slews=true}], outriggers=[{name='a', at=[3, 3]}, "
    "{name='b', at=[-3, 3]}, {name='c', at=[-3, -3]}, {name='d', at=[3, -3]}]}",
)
#: Models, which both checkouts load.
_MODELS = """
import json, sys, pmr
machine = json.loads(sys.argv[3])
for name, scene, keys in (("boom_three",) * 2 + ([],), ("crane", sys.argv[2], []), ("machine", "luffing_oil", machine)):
    pmr.reduce(pmr.load_scene(scene, ["compare.against=[]", *keys])).system.save(f"{sys.argv[1]}/{name}.npz")
"""
#: The least of some hundred steps in microseconds, by public names that an earlier checkout has too.
_STEPS = """
import json, sys, time, warnings
import numpy, pmr
try:
    from pmr.simulation.native.free_motion import prepare_stepping
except ImportError:  # of an earlier checkout
    from pmr.simulation.native.free_motion import stepped_frame
else:
    stepped_frame = lambda system, source: prepare_stepping(system, source)[2]
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
machine = System.load(f"{folder}/machine.npz")
frame, excitation = stepped_frame(machine, "machine"), read_scene(machine, "machine", free=True).excitation
motions = frame.motions(excitation, 1e-3 * numpy.arange(4001)).tolist()
drives = [name for name in frame.loads if name.startswith("luffing drive")]
steps = []
for k in range(4001):
    F = {name: motion[0] for name, motion in given(frame.loads, k).items()} | {
        name: motion[:2] for name, motion in given(drives, k).items()}
    steps.append((given(frame.paths, k), F, given(["slewing"], k)))
of_machine = ["luffing angle", "force of the hoist rope", "fly: tip z", "use of the support polygon"]
for what, outputs in (("four outputs", of_machine), ("one output", ["fly: tip z"])):
    stepper = pmr.Stepper(machine, 1e-3, *steps[0][:2], frame=steps[0][2], outputs=outputs)
    times[f"hoist, oil and outriggers, {what}"] = least(lambda n: stepper.step(*steps[n + 1]))
    if hasattr(stepper, "motion_names"):  # of a later checkout
        stepper = pmr.Stepper(machine, 1e-3, *steps[0][:2], frame=steps[0][2], outputs=outputs)
        arrays = numpy.moveaxis(numpy.array(motions), 2, 0).copy()
        times[f"hoist, oil and outriggers, {what}, in an array"] = least(lambda n: stepper.step(arrays[n + 1]))
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
        subprocess.run([sys.executable, "-c", _MODELS, folder, str(beams.CRANE), json.dumps(_MACHINE)], check=True)
        pythons = [sys.executable, *([] if earlier is None else [str(earlier / ".venv" / "bin" / "python")])]
        runs = [
            subprocess.run(
                [python, "-c", _STEPS, folder, str(beams.CRANE)],
                check=True,
                stdout=subprocess.PIPE,
                text=True,
                cwd=folder,
            )
            for python in pythons
        ]
    times = [json.loads(run.stdout) for run in runs]
    return {name: [of.get(name, np.nan) for of in times] for name in times[0]}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--earlier", type=Path)
    for name, found in booms(parser.parse_args().earlier).items():
        print(f"{name:56} " + ", ".join(f"{us:.2f} us" for us in found), end="")
        print(f", ratio {found[0] / found[1]:.3f}" if len(found) > 1 else "")
