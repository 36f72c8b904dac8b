"""A model that is dropped gives its memory back: a process may build one after the other."""

from pathlib import Path

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
    """M, D and K of 4,000 coordinates take 7 MiB: each of them was kept for ever."""
    small = scene.load(SHELL, ["mesh.size=0.2", "mesh.along=0.5"])
    sizes, kept = [], 0.0
    for _ in range(5):
        model = build(small, MPI.COMM_WORLD).model
        sizes.append(resident())
        entries = sum(A.getInfo(A.InfoType.LOCAL)["nz_used"] for A in (model.M, model.D, model.K))
        kept = entries * ENTRY / 2**20
        del model
    grown = MPI.COMM_WORLD.allreduce(sizes[-1] - sizes[2])
    assert grown < MPI.COMM_WORLD.allreduce(kept)  # two models' matrices would be twice this
