"""Simulate with a checkpoint at every step, and wait at some step to be killed.

python interrupted.py CHECKPOINT RESULT SHARE

From this SHARE of the steps on it waits until somebody kills it; with 1 it ends.
"""

import signal
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
from distributed import distributed
from driving import driven
from oracle import rich_body
from petsc_alone import observe

from pmr.fem.compat import MPI
from pmr.scene.signals import Chirp, Sine, Step
from pmr.simulation import TimeStepping
from pmr.simulation.petsc import Checkpoint

PATH = Sine(amplitude=0.7, frequency=4.0, offset=2.0)
LOADS = (Chirp(amplitude=300.0, times=(0.0, 0.2), frequencies=(3.0, 20.0)), Step(time=0.02, before=50.0, after=-400.0))
STEPPING = TimeStepping(end=0.08, step=1e-3, rho_inf=0.8)
STATES = (0.01, 0.07)


def main(checkpoint: str, result: str, last: str) -> None:
    """Simulate, and save the results on rank 0."""
    asked = Checkpoint(Path(checkpoint), seconds=0.0) if checkpoint else None
    taken = []

    def progress(share: float) -> None:
        """Count the steps, and wait for ever from the share `last` on."""
        taken.append(share)
        while float(last) <= share < 1.0:
            signal.pause()

    found = observe(
        distributed(rich_body()), driven(PATH, LOADS, STEPPING), STATES, progress=progress, checkpoint=asked
    )
    states = {name: np.concatenate(MPI.COMM_WORLD.allgather(getattr(found.states, name)), axis=1) for name in "qv"}
    if MPI.COMM_WORLD.rank == 0:
        np.savez(
            result,
            y=found.y,
            multipliers=found.multipliers,
            residual=found.residual_position,
            kinetic=found.energy.kinetic,
            total=found.energy.total,
            steps=len(taken),
            **states,
        )


main(*sys.argv[1:])
