"""The reduced sections of a boom, by every simulator that it names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pmr.compare.booms import respond
from pmr.compare.responses import agreement
from pmr.environment import Clock
from pmr.results import Response
from pmr.scene import Boom
from pmr.simulate import Excitation, Progress, SystemSimulator, exudyn
from pmr.simulate.native import multibody
from pmr.system.system import System, SystemTrajectory

#: s: what takes no longer is simulated several times.
SHORT = 2.0


@dataclass(frozen=True)
class BoomSimulations:
    """What the simulators say: the first one's motion and response, seconds, and how far each two agree, in m."""

    first: SystemTrajectory
    response: Response
    seconds: Mapping[str, float]
    agreement: Mapping[str, float]


def simulate(boom: Boom, system: System, excitation: Excitation, clock: Clock) -> BoomSimulations:
    """From equilibrium, by all of them."""
    names, motions = boom.simulation.simulators, dict[str, SystemTrajectory]()
    for name in names:
        with clock.stage("reduced" if len(names) == 1 else f"reduced, {name}") as done:
            simulator = exudyn.simulate_system if name == "exudyn" else multibody.simulate
            motions[name] = _repeated(boom, system, excitation, simulator, done)
    found = {name: respond(system, motion) for name, motion in motions.items()}
    return BoomSimulations(
        motions[names[0]],
        found[names[0]],
        {name: motion.seconds for name, motion in motions.items()},
        agreement(found),
    )


def _repeated(
    boom: Boom, system: System, excitation: Excitation, simulator: SystemSimulator, done: Progress
) -> SystemTrajectory:
    """A short simulation is repeated as the scene says, and the fastest counts."""
    start = multibody.static_start(system, excitation)
    found = [simulator(system, excitation, start, done)]
    while len(found) < boom.simulation.repeats and found[0].seconds < SHORT:
        found.append(simulator(system, excitation, start))
    return min(found, key=lambda one: one.seconds)
