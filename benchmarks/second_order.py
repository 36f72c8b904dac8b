"""Time of a step with second order and without, of the crane and of a body alone.

``python -m benchmarks.second_order`` prints a line for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pmr
from benchmarks.beams import CRANE as CRANE_SCENE
from benchmarks.beams import WORKFLOWS
from pmr import scene as scenes
from pmr.compare.simulated import excitation_of_scene
from pmr.simulation.native import systems

CRANE = ("section.mesh.elements=12", "section.reduction.estimate=false", "compare.against=[]")
ALONE = ("reduction.estimate=false", "compare.against=[]")
LUFFING = (
    "frame={{pivot=[0.0,0.0,0.0], unit='rad', second_order={}, "
    "luffing={{kind='smooth_ramp', times=[0.5,4.0], values=[0.2,1.0], degree=9}}}}"
)
#: Each is simulated so many times; the shortest counts.
TIMES = 5


def measure(scene: Path, changes: Sequence[str]) -> tuple[float, float]:
    """Seconds of a step of a scene with these settings, and its speed as a multiple of real time."""
    asked = scenes.load_any(scene, tuple(changes))
    system = pmr.reduce(asked).system
    excitation = excitation_of_scene(asked, system)
    start = systems.start_of(system, excitation)
    seconds = min(systems.simulate(system, excitation, start).seconds for _ in range(TIMES))
    return seconds / excitation.stepping.steps, excitation.stepping.end / seconds


def main() -> None:
    """Print a line for each case, with the ratio of its time to that of the first order."""
    orders = {f"{order} order": f"frame.second_order={on}" for order, on in (("first", "false"), ("second", "true"))}
    more = tuple(f"sections.{k}.reduction.coordinates=10" for k in (1, 2))
    alone = {f"{order} order": LUFFING.format(on) for order, on in (("first", "false"), ("second", "true"))}
    cases = {
        "crane, 6 a section": (CRANE_SCENE, CRANE, orders),
        "crane, 6 + 10 + 10 coordinates": (CRANE_SCENE, (*CRANE, *more), orders),
        "a body alone": (WORKFLOWS / "boom_beam.toml", ALONE, {"no frame": "title=A body alone"} | alone),
    }
    for name, (file, changes, ways) in cases.items():
        first = 0.0
        for way, change in ways.items():
            step, faster = measure(file, [*changes, change])
            first = first or step
            ratio = step / first
            print(f"{name}, {way}: {1e6 * step:.2f} us a step ({ratio:.1f} times), {faster:.0f} times real time")


if __name__ == "__main__":
    main()
