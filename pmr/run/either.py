"""What `pmr.run` and the command line call: a scene of one body, or a boom of several sections."""

from __future__ import annotations

from pathlib import Path
from typing import overload

from pmr.environment import Clock
from pmr.fem.compat import MPI
from pmr.run import Outcome, run
from pmr.run.booms import BoomOutcome, run_boom
from pmr.scene import Boom, Scene
from pmr.simulate.petsc import Checkpoint


@overload
def run_either(
    scene: Scene,
    comm: MPI.Comm = ...,
    clock: Clock | None = None,
    checkpoint: Checkpoint | None = None,
    cache: Path | None = None,
) -> Outcome | None: ...
@overload
def run_either(
    scene: Boom,
    comm: MPI.Comm = ...,
    clock: Clock | None = None,
    checkpoint: Checkpoint | None = None,
    cache: Path | None = None,
) -> BoomOutcome | None: ...
def run_either(
    scene: Scene | Boom,
    comm: MPI.Comm = MPI.COMM_WORLD,
    clock: Clock | None = None,
    checkpoint: Checkpoint | None = None,
    cache: Path | None = None,
) -> Outcome | BoomOutcome | None:
    """Run a scene the whole way, as `pmr.run.run`, or a boom, as `pmr.run.booms.run_boom`."""
    if isinstance(scene, Boom):
        return run_boom(scene, comm, clock, checkpoint, cache)
    return run(scene, comm, clock, checkpoint, cache)
