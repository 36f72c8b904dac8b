"""Bodies of the tests as distributed models, equal on every rank."""

import numpy as np
import scipy.sparse as sp

from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import share, sparse
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
        B=matrix(sp.csr_matrix(body.B)),
        outputs=matrix(body.outputs.T),
        rows=body.rows,
        input_names=body.input_names,
        output_positions=body.output_positions,
        reference_frequency=1.0,
    )


def laplacian(side: int) -> PETSc.Mat:
    """Five-point stencil on a square of `side` x `side` points, its rows in consecutive shares; collective."""
    chain, size = sp.diags([-np.ones(side - 1), 2.0 * np.ones(side), -np.ones(side - 1)], [-1, 0, 1]), side**2
    first, last = share(size, MPI.COMM_WORLD)
    like = PETSc.Mat().createAIJ(((last - first, size), (last - first, size)), comm=MPI.COMM_WORLD)
    return sparse(sp.csr_matrix(sp.kronsum(chain, chain))[first:last], like, columns=int(last - first))
