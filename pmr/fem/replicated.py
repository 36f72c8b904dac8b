"""A factor that every rank holds whole: each answers its share of the columns, and waits for nobody while it solves.

A factor that is spread over two ranks solves no faster than on one, and two fifths of its time go into how the answers
reach the ranks that own their rows, which PETSc finds out anew at each call.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.fem.compat import PETSc
from pmr.fem.distributed import freed
from pmr.fem.factor import BLOCK, NO_MEMORY, TOO_LITTLE, Factor, ample, factorised, free_memory, not_definite, solved

Array = NDArray[np.float64]

#: Share of the free memory that the factors of all ranks on a machine may take together.
COPIES = 0.25


class TooLargeError(Exception):
    """The whole factor takes more memory than a rank has for it."""


class ReplicatedFactor:
    """L L^T of a distributed matrix on each rank.

    Raises
    ------
    TooLargeError
        On all ranks, if it is so on one.
    InputError
        If the matrix, called `name`, is not positive definite.
    """

    def __init__(self, A: PETSc.Mat, name: str) -> None:
        comm = A.comm.tompi4py()
        self._exchange = Exchange(comm, A.getOwnershipRanges())
        whole = A.getRedundantMatrix(comm.size, PETSc.COMM_SELF)
        whole.setOption(PETSc.Mat.Option.SPD, True)
        free = free_memory(comm)
        self._factor = factorised(whole, min(max(1, int(COPIES * free)) if free else 0, ample(whole)))
        freed(whole)
        codes = comm.allgather(self._factor.getMumpsInfog(1))
        if {TOO_LITTLE, *NO_MEMORY} & set(codes):
            self.destroy()
            raise TooLargeError
        if min(codes) < 0:
            raise not_definite(name)

    def solve_columns(self, columns: Array) -> Array:
        """As `Factor.solve_columns`; best of as many times `BLOCK` columns as there are ranks."""
        result, many = np.empty(columns.shape, order="F"), BLOCK * self._exchange.ranks
        for k in range(0, columns.shape[1], many):
            mine = self._exchange.columns(np.asfortranarray(columns[:, k : k + many]))
            self._exchange.rows(solved(self._factor, mine), result[:, k : k + many])
        return result

    def destroy(self) -> None:
        """Give the factor's memory back."""
        self._factor.destroy()


def factor_for_columns(A: PETSc.Mat, name: str) -> Factor | ReplicatedFactor:
    """A factor for many columns at a time: of several ranks each holds it whole, where that fits into memory."""
    if A.comm.size > 1:
        try:
            return ReplicatedFactor(A, name)
        except TooLargeError:
            pass
    return Factor(A, name)


class Exchange:
    """Tall matrices (n, k) between ranks that own rows, as `ends` (ranks + 1,) has them, and ranks that own columns."""

    def __init__(self, comm: Any, ends: Array) -> None:
        self._comm, self._ends, self.ranks = comm, np.asarray(ends), comm.size

    def columns(self, local: Array) -> Array:
        """This rank's columns (n, k_own) of a matrix given by this rank's rows (n_local, k) in Fortran's order."""
        shares, heights = self._shares(local.shape[1]), np.diff(self._ends)
        own = shares[self._comm.rank]
        parts = np.empty(self._ends[-1] * own)
        self._comm.Alltoallv((local.ravel("F"), len(local) * shares), (parts, heights * own))
        whole, begin = np.empty((self._ends[-1], own), order="F"), 0
        for low, high in zip(self._ends[:-1], self._ends[1:], strict=True):
            end = begin + (high - low) * own
            whole[low:high] = parts[begin:end].reshape((high - low, own), order="F")
            begin = end
        return whole

    def rows(self, whole: Array, local: Array) -> None:
        """What `columns` undoes: this rank's rows, written to `local` (n_local, k) in Fortran's order."""
        shares, heights = self._shares(local.shape[1]), np.diff(self._ends)
        pieces = [whole[low:high].ravel("F") for low, high in zip(self._ends[:-1], self._ends[1:], strict=True)]
        found = local.T.reshape(-1)
        self._comm.Alltoallv((np.concatenate(pieces), heights * whole.shape[1]), (found, len(local) * shares))

    def _shares(self, k: int) -> Any:
        """How many of k columns each rank has."""
        return k // self.ranks + (np.arange(self.ranks) < k % self.ranks)
