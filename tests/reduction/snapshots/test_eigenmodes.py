from __future__ import annotations

import hashlib
import subprocess
import sys

import numpy as np
import pytest

from pmr.errors import InputError
from pmr.fem.compat import MPI
from pmr.fullmodel.build import full_model
from pmr.reduction.snapshots import eigenmode_snapshots, node_set, positions


@pytest.mark.parametrize(
    ("nodes", "snapshots", "expected"),
    [
        (51, 1, [25]),
        (51, 2, [2, 51]),
        (51, 5, [2, 14, 26, 38, 51]),
        (51, 10, [2, 7, 12, 18, 23, 29, 34, 40, 45, 51]),
        (10, 4, [2, 4, 7, 10]),
    ],
)
def test_the_papers_node_set(nodes: int, snapshots: int, expected: list[int]) -> None:
    assert node_set(nodes, snapshots).tolist() == expected


def at(load_scene, *overrides: str) -> np.ndarray:
    scene = load_scene("paper_simple", ["compare.against=['full']", *overrides])
    return positions(scene, full_model(scene))


def test_positions_on_nodes_over_the_path_or_as_listed(load_scene) -> None:
    assert at(load_scene) == pytest.approx([0.1, 1.3, 2.5, 3.7, 5.0])
    assert at(load_scene, "reduction.positions=path") == pytest.approx([1.25, 1.875, 2.5, 3.125, 3.75])
    listed = [1.0, 2.0, 2.22, 3.0, 4.0]
    assert at(load_scene, f"reduction.positions={listed}") == pytest.approx(listed)


@pytest.mark.parametrize(
    ("offsets", "first", "last"), [([0.0, 0.4], 0.1, 4.6), ([0.4, 0.0], 0.1, 4.6), ([0.0, -0.33], 0.5, 5.0)]
)
def test_with_several_sliders_all_of_them_stay_on_the_beam(load_scene, offsets, first: float, last: float) -> None:
    found = at(load_scene, f"slider.offsets={offsets}")
    assert (found[0], found[-1]) == pytest.approx((first, last))
    on_nodes = (found + offsets[0]) / 0.1
    assert on_nodes == pytest.approx(np.round(on_nodes))


def test_more_snapshots_than_nodes_are_refused(load_scene) -> None:
    with pytest.raises(InputError, match="at most 50"):
        at(load_scene, "reduction.snapshots=51")


@pytest.mark.mpi
def test_the_pool_holds_modes_at_each_position(load_scene) -> None:
    scene = load_scene()
    pool = eigenmode_snapshots(full_model(scene), scene)
    assert pool.S.getSize() == (153, 30) and pool.omega.shape == pool.residuals.shape == pool.s.shape == (30,)
    assert pool.s.reshape(5, 6)[:, 0] == pytest.approx([0.1, 1.3, 2.5, 3.7, 5.0])
    assert np.all(np.diff(pool.omega.reshape(5, 6)) > 0.0) and pool.residuals.max() < 1e-13


@pytest.mark.mpi
def test_a_position_on_the_support_is_refused(load_scene) -> None:
    scene = load_scene("paper_simple", ["reduction.positions=[0.0,2.0,2.22,3.0,4.0]"])
    with pytest.raises(InputError, match="slider"):
        eigenmode_snapshots(full_model(scene), scene)


DIGEST = """
import hashlib, sys
import numpy as np
from pmr import scene
from pmr.reduction.basis import pod
from pmr.fullmodel.build import full_model
from pmr.reduction.snapshots import eigenmode_snapshots
s = scene.load(sys.argv[1], ["reduction.solver=dense"])
model = full_model(s)
pool = eigenmode_snapshots(model, s)
basis = pod(model, pool, 20, solver="dense")
print(hashlib.sha256(pool.S.getDenseArray().tobytes() + basis.V.getDenseArray().tobytes()).hexdigest())
"""


@pytest.mark.slow
def test_two_runs_of_the_dense_path_agree_to_the_byte() -> None:
    scene = "workflows/paper_evolved.toml"
    digests = {
        subprocess.run([sys.executable, "-c", DIGEST, scene], capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    }
    assert len(digests) == 1 and len(digests.pop().strip()) == hashlib.sha256().digest_size * 2
    assert MPI.COMM_WORLD.size == 1
