"""Where rows of the operators are assembled, and where they stand afterwards."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from pmr import scene as scenes
from pmr.fem.compat import MPI, assemble, compiled_form, original_cells
from pmr.fullmodel.assembly import MatrixRows, model_order, reorder_rows, share
from pmr.fullmodel.from_scene import structure_of
from pmr.models.meshed import MeshedModel
from pmr.scene.members import member_at

SCENE = Path(__file__).parents[2] / "workflows" / "boom_shell.toml"


@pytest.mark.mpi
def test_cells_stand_on_the_rank_that_keeps_most_of_their_rows() -> None:
    """Equal shares of them, in the order of their lowest vertices; then all but rows where ranks meet stay."""
    comm = MPI.COMM_WORLD
    model = structure_of(member_at(scenes.load(SCENE, ["mesh.size=0.05", "mesh.along=0.1"])), comm).model
    assert isinstance(model, MeshedModel)
    space = model.space(model.domain(comm))
    cells = original_cells(space.mesh)[: space.mesh.topology.index_map(2).size_local]
    lowest = model.mesh.cells[cells].min(axis=1)
    ends = np.array(comm.allgather((lowest.min(), lowest.max(), len(lowest))))
    assert np.all(ends[:-1, 1] <= ends[1:, 0]) and np.ptp(ends[:, 2]) <= 1
    A = assemble(compiled_form(model.forms(space).mass))
    mine = np.argsort(model_order(model, space))[slice(*A.getOwnershipRange())]
    first, last = share(model.size, comm)
    assert np.mean((mine >= first) & (mine < last)) > (0.9 if comm.size > 1 else 0.999)


@pytest.mark.mpi
def test_rows_come_from_wherever_they_are_known() -> None:
    """Also where ranks know those of others only, in any order."""
    comm, n = MPI.COMM_WORLD, 23
    rng = np.random.default_rng(2)
    whole = sp.random(n, n, 0.3, "csr", random_state=np.random.RandomState(4))
    order, known = rng.permutation(n), rng.permutation(n)
    mine = np.array_split(known, comm.size)[comm.rank]
    found = reorder_rows(MatrixRows(mine, whole[mine]), order, comm)
    first, last = share(n, comm)
    assert found.getOwnershipRange() == (first, last)
    expected = whole[order[first:last]][:, order].toarray()
    indptr, indices, values = found.getValuesCSR()
    assert np.array_equal(sp.csr_matrix((values, indices, indptr), (last - first, n)).toarray(), expected)
