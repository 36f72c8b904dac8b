"""Distributed matrices as dense copies on every rank."""

import numpy as np

from pmr.fem.compat import MPI
from pmr.fem.distributed import gather


def gathered(A) -> np.ndarray:
    """Gather a distributed matrix as a dense copy on every rank; collective."""
    matrix = gather(A)
    return MPI.COMM_WORLD.bcast(None if matrix is None else matrix.toarray())
