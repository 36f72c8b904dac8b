"""Where rows of the operators are assembled, and where they stand afterwards."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from pmr import scene as scenes
from pmr.fem.compat import MPI, assemble
from pmr.fullmodel.assembly import Rows, model_order, reordered, share
from pmr.fullmodel.from_scene import structure_of
from pmr.models import is_assembled

SCENE = Path(__file__).parents[2] / "workflows" / "boom_shell.toml"


@pytest.mark.mpi
def test_most_rows_are_assembled_where_they_stay() -> None:
    """All but those of a strip where the ranks meet, the mesh being cut across in the order of its vertices."""
    comm = MPI.COMM_WORLD
    model = structure_of(scenes.load(SCENE, ["mesh.size=0.1", "mesh.along=0.2"]), comm).model
    assert is_assembled(model)
    space = model.space(model.domain(comm))
    number = np.argsort(model_order(model, space))
    A = assemble(model.forms(space).mass)
    mine = number[slice(*A.getOwnershipRange())]
    first, last = share(len(number), comm)
    assert np.mean((mine >= first) & (mine < last)) > (0.95 if comm.size > 1 else 0.999)


@pytest.mark.mpi
def test_rows_come_from_wherever_they_are_known() -> None:
    """Also where ranks know those of others only, in any order."""
    comm, n = MPI.COMM_WORLD, 23
    rng = np.random.default_rng(2)
    whole = sp.random(n, n, 0.3, "csr", random_state=np.random.RandomState(4))
    order, known = rng.permutation(n), rng.permutation(n)
    mine = np.array_split(known, comm.size)[comm.rank]
    found = reordered(Rows(mine, whole[mine]), order, comm)
    first, last = share(n, comm)
    assert found.getOwnershipRange() == (first, last)
    expected = whole[order[first:last]][:, order].toarray()
    indptr, indices, values = found.getValuesCSR()
    assert np.array_equal(sp.csr_matrix((values, indices, indptr), (last - first, n)).toarray(), expected)
