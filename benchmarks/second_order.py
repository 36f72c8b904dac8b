"""A step of the crane with second order and without, in turn: ``python -m benchmarks.second_order``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pmr
from pmr import scene as scenes
from pmr.compare.simulated import excitation_in
from pmr.simulation.native import systems

WORKFLOWS = Path(__file__).parents[1] / "workflows"
CRANE = ("section.mesh.elements=12", "section.reduction.estimate=false", "compare.against=[]")
#: Each is simulated so many times; the shortest counts.
TIMES = 5


def measure(scene: Path, changes: Sequence[str]) -> tuple[float, float]:
    """Seconds of a step, and how many times faster than real time it is."""
    asked = scenes.load_any(scene, tuple(changes))
    system = pmr.reduce(asked).system
    excitation = excitation_in(asked, system)
    start = systems.start_of(system, excitation)
    seconds = min(systems.simulate(system, excitation, start).seconds for _ in range(TIMES))
    return seconds / excitation.stepping.steps, excitation.stepping.end / seconds


def main() -> None:
    """Print a line for each."""
    for name, coordinates in (("crane, 6 + 10 + 10 coordinates", ()), ("crane, 6 a section", (6, 6, 6))):
        sizes = [f"sections.{k}.reduction.coordinates={count}" for k, count in enumerate(coordinates)]
        first, second = (
            measure(WORKFLOWS / "crane.toml", [*CRANE, *sizes, f"frame.second_order={asked}"])
            for asked in ("false", "true")
        )
        print(f"{name}: {1e6 * first[0]:.2f} us a step, {first[1]:.0f} times as fast as real time")
        ratio = second[0] / first[0]
        print(f"  with second order {1e6 * second[0]:.2f} us, {second[1]:.0f} times; {ratio:.1f} times the step")


if __name__ == "__main__":
    main()
