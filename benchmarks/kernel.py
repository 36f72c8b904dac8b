"""The kernel beside march, in turn: processor time of the compiled loops, and of all that a step takes.

``python -m benchmarks.kernel [SCENE ...]`` prints a line for each scene.  The loop has samples of paths and loads and
records coordinates, rates, forces and energies, as march's does.  The whole of the kernel evaluates signals itself and
records outputs too; that of march has its sampling and balance of energy around its loop.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.kernel.kernel import Kernel, Record, Settings, State
from pmr.kernel.signals import Signals
from pmr.pipeline import reduce
from pmr.scene import load_any
from pmr.simulation.excitation import Excitation
from pmr.simulation.native import loop
from pmr.simulation.native import march as marching
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.march import March
from pmr.simulation.native.systems import static_start
from pmr.simulation.recorded import recorded

Array = NDArray[np.float64]
SCENES = ("evolved_residual", "boom_beam", "boom_two", "boom_three", "boom_four", "boom_three_shell")
WORKFLOWS = Path(__file__).parents[1] / "workflows"
LOOP = ("z", "v", "multipliers", "energy", "impulses", "peaks", "parts")
#: Samples are of so many times, of so many steps at least, as march has them.
TIMES, FINE = 2048, 64


class Clock:
    """Processor seconds of march's compiled loop alone."""

    def __init__(self) -> None:
        self.seconds, self._run = 0.0, loop.run

    def __call__(self, *arguments: Any) -> Any:
        begun = time.process_time()
        try:
            return self._run(*arguments)
        finally:
            self.seconds += time.process_time() - begun


class Case:
    """A scene in both."""

    def __init__(self, name: str) -> None:
        self.name = name
        system = reduce(load_any(WORKFLOWS / f"{name}.toml")).system
        self.excitation = excitation = recorded(system, name).excitation
        initial = static_start(system, excitation) if excitation.start == "equilibrium" else {}
        form, stepping = SystemForm.of(system), excitation.stepping
        self.march, self.steps = March(form, excitation, initial), stepping.steps
        started = self.march.loop
        self.parts = (1,) if started.levels is None else tuple(started.levels.parts.tolist())
        omega = 0.0 if started.control is None else float(started.control.bounds[1])
        self.kernel = Kernel.of(system, form.forms)
        self.state = State(self.kernel, Settings(stepping.step, stepping.rho_inf, self.parts, omega))
        self.signals = _signals(self.kernel, excitation)
        self.begun = self.signals.at(0.0)[0]
        self.record = Record(self.kernel, self.steps, LOOP)
        self.whole = Record(self.kernel, self.steps, (*LOOP, "outputs"))
        self._samples: dict[tuple[int, int], Array] = {}

    def sampled(self, first: int, per: int) -> Array:
        """Drivers of some steps at `per` parts of each, found once."""
        if (first, per) not in self._samples:
            last = min(self.steps, first + (self.steps if per == 1 == len(self.parts) else max(FINE, TIMES // per)))
            t = np.arange(first * per, last * per + 1) * (self.excitation.stepping.step / per)
            self._samples[first, per] = np.array([self.signals.at(at)[0] for at in t.tolist()])
        return self._samples[first, per]

    def kernel_loop(self) -> float:
        """Processor seconds of all steps with samples."""
        self.state.start(self.excitation.start, self.begun)
        at, per, seconds = 0, self.parts[0], 0.0
        while at < self.steps:
            u, begun = self.sampled(at, per), time.process_time()
            taken, needed = self.state.advance_sampled(u, per, self.record, at)
            seconds += time.process_time() - begun
            at, per = at + taken, needed or max(self.parts[0], per // 2)
        return seconds

    def kernel_whole(self) -> float:
        """Processor seconds of all steps with signals and outputs."""
        self.state.start(self.excitation.start, self.begun)
        begun = time.process_time()
        self.state.advance(self.signals, self.steps, self.whole)
        return time.process_time() - begun

    def march_both(self, clock: Clock) -> tuple[float, float]:
        """Processor seconds of the loop alone, and with what stands around it."""
        self.march.loop, clock.seconds = self.march._begun(), 0.0
        begun = time.process_time()
        self.march.run(lambda steps: None)
        return clock.seconds, time.process_time() - begun


def _signals(kernel: Kernel, excitation: Excitation) -> Signals:
    names, P = kernel.names("drivers"), kernel.paths
    paths = dict(excitation.paths) if len(excitation.paths) != 1 else {names[0]: excitation.path}
    return Signals([*(paths[name] for name in names[:P]), *(excitation.loads[name] for name in names[P:])])


def measure(scenes: Sequence[str] = SCENES, repeats: int = 5, say: Callable[[str], None] | None = None) -> list[Any]:
    """Least of some repeats in turn, in microseconds a step."""
    clock, found = Clock(), list[Any]()
    marching.kernel.run = clock  # type: ignore[assignment]
    try:
        for name in scenes:
            case, taken = Case(name), list[tuple[float, ...]]()
            for _ in range(repeats):
                loop_alone, whole = case.march_both(clock)
                taken.append((loop_alone, case.kernel_loop(), whole, case.kernel_whole()))
            least = 1e6 * np.min(taken, axis=0) / case.steps
            keys = ("march_loop", "kernel_loop", "march_whole", "kernel_whole")
            one = {"scene": name, **dict(zip(keys, least.tolist(), strict=True))}
            one |= {"state_bytes": case.state.memory, "system_bytes": len(case.kernel.block)}
            found.append(one)
            if say is not None:
                ratios = f"{least[1] / least[0]:.2f}, {least[3] / least[2]:.2f}"
                say(f"{name:18} loop {least[0]:.3f} {least[1]:.3f}, whole {least[2]:.3f} {least[3]:.3f} us: {ratios}")
    finally:
        marching.kernel.run = clock._run
    return found


if __name__ == "__main__":
    measure(sys.argv[1:] or SCENES, say=print)
