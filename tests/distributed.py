"""Bodies of the tests as distributed models, equal on every rank."""

from __future__ import annotations

import scipy.sparse as sp

from pmr.fem.compat import MPI, PETSc
from pmr.fullmodel.assembly import share
from pmr.fullmodel.model import FullModel
from pmr.system.body import FullBody


def distributed(body: FullBody, comm: MPI.Comm = MPI.COMM_WORLD) -> FullModel:
    """Distribute the matrices of a body over the ranks, in consecutive shares of rows; collective."""
    first, last = share(body.size, comm)
    local = int(last - first)

    def matrix(A: sp.spmatrix, columns: int | None = None) -> PETSc.Mat:
        """Distribute a matrix by rows."""
        mine = sp.csr_matrix(A)[first:last]
        result = PETSc.Mat().createAIJ(
            ((local, body.size), (PETSc.DECIDE if columns is None else columns, A.shape[1])),
            csr=(mine.indptr.astype(PETSc.IntType), mine.indices.astype(PETSc.IntType), mine.data),
            comm=comm,
        )
        result.assemble()
        return result

    return FullModel(
        matrix(body.M, local),
        matrix(body.D, local),
        matrix(body.K, local),
        inputs=matrix(sp.csr_matrix(body.B)),
        outputs=matrix(body.outputs.T),
        rows=body.rows,
        input_names=body.input_names,
        output_positions=body.output_positions,
        reference_frequency=1.0,
    )
