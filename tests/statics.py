"""Static response of a full model without rows."""

import numpy as np

from pmr.fem.compat import PETSc
from pmr.fem.distributed import local_csr
from pmr.fullmodel.model import FullModel


def static_outputs(model: FullModel) -> np.ndarray:
    """Outputs (o, i) under a unit of each input, by MUMPS, equal on every rank; collective."""
    solver = PETSc.KSP().create(model.comm)
    solver.setOperators(model.K)
    solver.setType("preonly")
    solver.getPC().setType("cholesky")
    solver.getPC().setFactorSolverType("mumps")
    inputs, outputs = local_csr(model.B).toarray(), local_csr(model.outputs)
    x, b = model.K.createVecRight(), model.K.createVecLeft()
    answers = []
    for column in inputs.T:
        b.getArray()[:] = column
        solver.solve(b, x)
        answers.append(outputs.T @ x.getArray())
    return np.asarray(model.comm.allreduce(np.stack(answers, axis=1)))
