"""The matrix that a step of generalized-alpha solves with."""

from __future__ import annotations

from pmr.fem.compat import PETSc
from pmr.fem.matrices import without_zeros
from pmr.fullmodel.model import FullModel


def effective_matrix(model: FullModel, v_gain: float, q_gain: float) -> PETSc.Mat:
    """S = M + dv D + dq K: what an acceleration of the step's end costs in force."""
    S = model.K.copy()
    S.scale(q_gain)
    for factor, A in ((v_gain, model.D), (1.0, model.M)):
        S.axpy(factor, A, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    return without_zeros(S)
