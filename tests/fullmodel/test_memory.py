"""A model that is dropped gives its memory back: a process may build one after the other."""

from pathlib import Path

import numpy as np
import pytest
from processes import resident

from pmr import scene
from pmr.fem.compat import MPI
from pmr.fullmodel.build import build

SHELL = "boom_shell"
STATUS = Path("/proc/self/statm")

ENTRY = 12  # bytes of a number and its column


@pytest.mark.slow
@pytest.mark.skipif(not STATUS.exists(), reason="needs /proc")
def test_models_that_are_dropped_give_their_memory_back() -> None:
    """M, D and K of 4,000 coordinates take 5 MiB, and were kept for ever: each model made the process larger by this.

    The median counts, as a process now and then grows or shrinks by several MiB when it gets memory for another reason.
    """
    small = scene.load(SHELL, ["mesh.size=0.2", "mesh.along=0.5"])
    sizes, kept = [], 0.0
    for _ in range(9):
        model = build(small, MPI.COMM_WORLD).model
        sizes.append(resident())
        entries = sum(A.getInfo(A.InfoType.LOCAL)["nz_used"] for A in (model.M, model.D, model.K))
        kept = entries * ENTRY / 2**20
        del model
    grown = float(np.median(np.diff(sizes)[1:]))
    assert MPI.COMM_WORLD.allreduce(grown) < MPI.COMM_WORLD.allreduce(kept) / 2.0
