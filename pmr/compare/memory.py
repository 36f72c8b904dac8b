"""What a run's histories take of memory, said before it begins."""

from __future__ import annotations

import logging

from pmr.compare.responses import full_simulator
from pmr.errors import InputError
from pmr.scene import Scene

_log = logging.getLogger(__name__)

#: Arrays (T, n) at once where Exudyn simulates, which keeps all states: they, as its sensors and as ours have them.
#: The same of a reduced model whose error is estimated by two richer ones.  `march` keeps no states of a body alone, of
#: several bodies it does.
STATES = 4
#: Arrays (T, o) at once beside the responses, where the reduction's error is estimated, and elsewhere.  Measured with
#: two responses: 6.9 kB a step for 66 outputs and 10 coordinates, here 7.5; 1.7 kB for 51 outputs, here 2.3.
ESTIMATED, COMPARED = 10, 2
#: Numbers a step that each response holds beside its outputs.
BESIDE = 12
NUMBER = 8  # bytes
NOTICED = 2**30  # bytes, from which on it is worth a line


def needed_bytes(scene: Scene, size: int, outputs: int) -> int:
    """Memory in bytes that histories of all steps take at most at once; `size` and `outputs` of all full models."""
    bodies, full = scene.bodies.values(), full_simulator(scene, size)
    r, several = sum(body.reduction.coordinates for body in bodies), len(bodies) > 1
    responses = len(scene.compare.against) + len(scene.simulation.simulators) + 1  # one simulated again for its time
    responses += 2 * (scene.compare.richer not in ("auto", "none"))
    keeping = [r] if several or any(name != "march" for name in scene.simulation.simulators) else []
    if "full" in scene.compare.against and (full == "exudyn" or (several and full == "march")):
        keeping.append(size)
    estimated = all(body.reduction.estimable for body in bodies)
    states = max([*keeping, r if estimated else 0])
    a_step = responses * (outputs + BESIDE) + STATES * states + (ESTIMATED if estimated else COMPARED) * outputs
    return NUMBER * (scene.time.steps + 1) * a_step


def warnings(scene: Scene, size: int, outputs: int) -> list[str]:
    """A line where the histories take a lot."""
    total = needed_bytes(scene, size, outputs)
    return [] if total < NOTICED else [f"{scene.time.steps:,} steps take about {total / 1e9:.1f} GB of memory"]


def check(scene: Scene, size: int, outputs: int, free: int | None, tell: bool = True) -> None:
    """Refuse what does not fit into the `free` memory in bytes, and tell of what takes a lot of it, if asked to `tell`.

    Raises InputError with what would fit.
    """
    for message in warnings(scene, size, outputs):
        total = needed_bytes(scene, size, outputs)
        if free is not None and total > free:
            fitting = scene.time.steps * free // total
            allowed = f"{message}, {free / 1e9:.1f} GB are free; at most about {fitting:,} steps are allowed"
            raise InputError("scene", "time.step", scene.time.step, allowed)
        if tell:
            _log.warning("%s", message)
